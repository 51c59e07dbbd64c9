#!/usr/bin/env bash
# Draws docs/img/top.svg, docs/img/top-worker.svg and docs/img/trace.svg: `replenish top` and
# `replenish trace` beside the rover of examples/robot_app. Without real-time priority the budgets are not held, and the pictures say so.
set -euo pipefail
cd "$(dirname "$0")/.."
cargo build -q -p replenish-cli -p robot-app
target=${CARGO_TARGET_DIR:-target}/debug
live=$(mktemp -d /dev/shm/replenish-pictures-XXXXXX)
export REPLENISH_LIVE=$live
REPLENISH_AGENT=in-process "$target/robot-app" >/dev/null &
program=$!
trap 'kill "$program" 2>/dev/null || true; rm -rf "$live"' EXIT
sleep 3
"$target/replenish" top --every 2s --svg docs/img/top.svg --columns 140
"$target/replenish" top --every 1s --svg docs/img/top-worker.svg --worker control --columns 140
"$target/replenish" trace "$program" --svg docs/img/trace.svg --last 200ms
