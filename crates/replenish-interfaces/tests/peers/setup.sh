#!/usr/bin/env bash
# Installs the foreign codec that the test rosbags.rs compares with: rosbags, in pure Python, into a
# virtual environment under the target directory. Needs python3 with venv, and the network once.
set -euo pipefail
cd "$(dirname "$0")/../../../.."
dir="${CARGO_TARGET_DIR:-target}/peers/rosbags"
[ -e "$dir/installed-0.11.9" ] && exit 0
rm -rf "$dir"
python3 -m venv "$dir"
"$dir/bin/pip" install --quiet --disable-pip-version-check 'rosbags==0.11.9'
"$dir/bin/python" -c 'import rosbags.typesys'
touch "$dir/installed-0.11.9"
