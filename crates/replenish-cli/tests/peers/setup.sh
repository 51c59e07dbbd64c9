#!/usr/bin/env bash
# Installs Perfetto's own protobuf module, by which the test live.rs reads our traces, into a virtual
# environment under the target directory. Needs python3 with venv, and the network once.
set -euo pipefail
cd "$(dirname "$0")/../../../.."
dir="${CARGO_TARGET_DIR:-target}/peers/perfetto"
[ -e "$dir/installed-0.59.1" ] && exit 0
rm -rf "$dir"
python3 -m venv "$dir"
"$dir/bin/pip" install --quiet --disable-pip-version-check 'perfetto==0.59.1' protobuf
"$dir/bin/python" -c 'from perfetto.protos.perfetto.trace import perfetto_trace_pb2'
touch "$dir/installed-0.59.1"
