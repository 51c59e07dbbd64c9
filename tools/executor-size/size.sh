#!/bin/sh
# Prints .text and static RAM in bytes of pong over the executor and the XRCE client, without kernel
# and heap, and of the same program without them, for a Cortex-M4F.
set -eu
cd "$(dirname "$0")"
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-../../target/size}"
target=thumbv7em-none-eabihf
out="$CARGO_TARGET_DIR/$target/release/executor-size"
size=$(command -v llvm-size || command -v arm-none-eabi-size || command -v size)
# The kernel's functions are not there: the figures are without it.
export RUSTFLAGS="-C link-arg=-eentry -C link-arg=--unresolved-symbols=ignore-all"
for features in "" "--features empty"; do
    # shellcheck disable=SC2086 # no features or two words
    cargo build --quiet --release --target "$target" $features
    # text and read-only data · data · bss
    "$size" "$out" | awk -v what="${features:-executor}" \
        'NR == 2 { printf "%s: text %d bytes, static RAM %d bytes\n", what, $1, $2 + $3 }'
done
