#!/bin/sh
# Runs the tests of the operating-system edge against its NuttX back end, on this Linux machine: the
# same Rust code and the same C shim, over the C library's pthreads. Everything on one CPU, as on a
# board. Real-time trials need the privilege that the others need, too.
set -eu
cd "$(dirname "$0")/../.."
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-target}/nuttx-host"
host=$(rustc -vV | sed -n 's/^host: //p')
mkdir -p "$CARGO_TARGET_DIR"
cc -Wall -Wextra -Werror -O2 -fPIC -c crates/replenish-os/nuttx/shim.c -o "$CARGO_TARGET_DIR/shim.o"
# Only what is linked for the target gets the shim, build scripts do not.
RUSTFLAGS="--cfg nuttx_host -Clink-arg=$(realpath "$CARGO_TARGET_DIR")/shim.o"
export RUSTFLAGS
cpu=$(taskset -cp $$ | sed 's/.*[^0-9]//')
tests="--lib --test rt --test it"
# shellcheck disable=SC2086 # several words
cargo test --target "$host" -p replenish-os $tests --no-run
# shellcheck disable=SC2086
exec taskset -c "$cpu" cargo test --target "$host" -p replenish-os $tests "$@"
