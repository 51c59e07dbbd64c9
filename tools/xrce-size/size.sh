#!/bin/sh
# Prints .text and static RAM in bytes of a program that publishes and subscribes over the XRCE
# client, with what a small build has and with fragments and restoration, and of the same program
# without the client, for a Cortex-M4F. Fails if it is more than the limits below: who needs more
# raises them, and says so.
set -eu
cd "$(dirname "$0")"
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-../../target/size}"
target=thumbv7em-none-eabihf
out="$CARGO_TARGET_DIR/$target/release/xrce-size"
size=$(command -v llvm-size || command -v arm-none-eabi-size || command -v size)
limits() {
    case $1 in
    "") echo "15000 6300" ;;
    *restore) echo "23000 9400" ;;
    *) echo "200 0" ;;
    esac
}
for features in "" "--features restore" "--features empty"; do
    # shellcheck disable=SC2086 # no features or two words
    RUSTFLAGS="-C link-arg=-eentry" cargo build --quiet --release --target "$target" $features
    # text and read-only data · data · bss
    "$size" "$out" | awk -v what="${features:-client}" -v limits="$(limits "$features")" '
        NR == 2 {
            split(limits, most, " "); ram = $2 + $3
            printf "%s: text %d bytes of %d, static RAM %d bytes of %d\n", what, $1, most[1], ram, most[2]
            exit ($1 > most[1] || ram > most[2])
        }'
done
