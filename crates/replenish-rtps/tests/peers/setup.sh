#!/usr/bin/env bash
# Installs the foreign programs that tests/peers.rs talks to, into virtual environments under the target
# directory: genuine ROS 2 (rclpy of Kilted with Fast DDS) and Eclipse Cyclone DDS, whose environment
# the agent's tests share. Needs python3 3.11 with venv, and the network once.
set -euo pipefail
cd "$(dirname "$0")/../../../.."
crates/replenish-agent/tests/peers/setup.sh
dir="${CARGO_TARGET_DIR:-target}/peers/rclpy"
wanted=$(sha256sum crates/replenish-rtps/tests/peers/requirements.txt | cut -c1-16)
[ -e "$dir/installed-$wanted" ] && exit 0
rm -rf "$dir"
python3 -m venv "$dir"
"$dir/bin/pip" install --quiet --disable-pip-version-check \
    -r crates/replenish-rtps/tests/peers/requirements.txt
"$dir/bin/python" -c 'import rclpy, std_msgs.msg'
touch "$dir/installed-$wanted"
