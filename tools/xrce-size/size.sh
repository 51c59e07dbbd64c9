#!/bin/sh
# Prints .text and static RAM in bytes of a program that publishes and subscribes over the XRCE
# client, and of the same program without the client, for a Cortex-M4F.
set -eu
cd "$(dirname "$0")"
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-../../target/size}"
target=thumbv7em-none-eabihf
out="$CARGO_TARGET_DIR/$target/release/xrce-size"
size=$(command -v llvm-size || command -v arm-none-eabi-size || command -v size)
for features in "" "--features restore" "--features empty"; do
    # shellcheck disable=SC2086 # no features or two words
    RUSTFLAGS="-C link-arg=-eentry" cargo build --quiet --release --target "$target" $features
    # text and read-only data · data · bss
    "$size" "$out" | awk -v what="${features:-client}" \
        'NR == 2 { printf "%s: text %d bytes, static RAM %d bytes\n", what, $1, $2 + $3 }'
done
