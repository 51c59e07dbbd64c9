#!/usr/bin/env bash
# Installs the foreign DDS that the tests in dds_peers.rs talk to: Eclipse Cyclone DDS with its
# Python binding, into a virtual environment under the target directory. Needs python3 with venv,
# and the network once.
set -euo pipefail
cd "$(dirname "$0")/../../../.."
dir="${CARGO_TARGET_DIR:-target}/peers/cyclonedds"
[ -e "$dir/installed-11.0.1" ] && exit 0
rm -rf "$dir"
python3 -m venv "$dir"
"$dir/bin/pip" install --quiet --disable-pip-version-check 'cyclonedds==11.0.1'
"$dir/bin/python" -c 'import cyclonedds.domain'
touch "$dir/installed-11.0.1"
