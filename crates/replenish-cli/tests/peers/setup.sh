#!/usr/bin/env bash
# Installs Perfetto's own protobuf module, by which the trial trace.rs reads our traces, and
# Prometheus's client library, by which metrics.rs reads our metrics, into virtual environments under
# the target directory. Needs python3 with venv, and the network once.
set -euo pipefail
cd "$(dirname "$0")/../../../.."
peers="${CARGO_TARGET_DIR:-target}/peers"
environment() { # NAME VERSION MODULE PACKAGE…
    local dir="$peers/$1" done="$peers/$1/installed-$2" module="$3"
    [ -e "$done" ] && return
    rm -rf "$dir"
    python3 -m venv "$dir"
    "$dir/bin/pip" install --quiet --disable-pip-version-check "${@:4}"
    "$dir/bin/python" -c "import $module"
    touch "$done"
}
environment perfetto 0.59.1 perfetto.protos.perfetto.trace.perfetto_trace_pb2 'perfetto==0.59.1' protobuf
environment openmetrics 0.26.0 prometheus_client.openmetrics.parser 'prometheus_client==0.26.0'
