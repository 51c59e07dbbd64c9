#!/usr/bin/env bash
# Licences, bans and sources of every dependency, by `cargo deny` and `deny.toml`.
set -euo pipefail
cd "$(dirname "$0")/.."
PATH=$PWD/target/ci-tools/bin:$PATH
command -v cargo-deny >/dev/null || { echo "cargo-deny is missing: .ci/install supply"; exit 1; }
exec cargo deny --all-features check licenses bans sources
