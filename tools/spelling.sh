#!/usr/bin/env bash
# Spelling of everything that git tracks, by `typos`; `_typos.toml` has the words it does not know.
set -euo pipefail
cd "$(dirname "$0")/.."
typos=$PWD/target/ci-tools/pip/bin/typos
[ -x "$typos" ] || typos=$(command -v typos) || { echo "typos is missing: .ci/install lint"; exit 1; }
exec "$typos"
