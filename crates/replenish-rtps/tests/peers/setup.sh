#!/usr/bin/env bash
# Installs the foreign programs that tests/peers.rs and replenish's tests/ros2 talk to, into virtual
# environments under the target directory: genuine ROS 2 (rclpy of Kilted and of Jazzy with Fast DDS)
# and Eclipse Cyclone DDS, whose environment the agent's tests share. On Debian 12 also the DDS of its
# packages, unpacked and not installed. Needs python3 3.11 with venv, gcc, g++, and the network once.
set -euo pipefail
cd "$(dirname "$0")/../../../.."
crates/replenish-agent/tests/peers/setup.sh
for distro in kilted jazzy; do
    dir="${CARGO_TARGET_DIR:-target}/peers/$distro"
    requirements="crates/replenish-rtps/tests/peers/$distro.txt"
    wanted=$(sha256sum "$requirements" | cut -c1-16)
    [ -e "$dir/installed-$wanted" ] && continue
    rm -rf "$dir"
    python3 -m venv "$dir"
    "$dir/bin/pip" install --quiet --disable-pip-version-check -r "$requirements"
    "$dir/bin/python" -c 'import rclpy.action, rclpy.lifecycle, nav_msgs.msg, std_srvs.srv, test_msgs.action'
    touch "$dir/installed-$wanted"
done
crates/replenish-rtps/tests/peers/debian.sh
