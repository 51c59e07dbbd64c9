#!/usr/bin/env bash
# Lists every test of the workspace, sorted: one line a test, its crate and its path.
#
#   tools/test-names.sh [ARGUMENTS]              what `cargo test ARGUMENTS` runs; else --workspace
#   tools/test-names.sh --compare BEFORE AFTER   two such lists: which tests moved, which are missing
#
# A path begins with the file that holds the test, wherever that file is linked: `tests/actions.rs` and
# `tests/it/actions.rs` give the same line. A doctest is named by its file and its item. A test has moved
# if a test with the name of its function (or item) is new elsewhere; a missing test ends with status 1.
set -euo pipefail

if [ "${1-}" = --compare ]; then
    export LC_ALL=C
    {
        comm -13 "$2" "$3" | sed 's/^/+ /'
        comm -23 "$2" "$3" | sed 's/^/- /'
    } | awk '
        { name = $0; sub(/.*(::| )/, "", name); line = substr($0, 3) }
        /^\+/ { new[name, ++there[name]] = line }
        /^-/ && ++used[name] <= there[name] { moved++; print line " -> " new[name, used[name]]; next }
        /^-/ { missing[++lost] = line }
        END {
            for (i = 1; i <= lost; i++) print "missing: " missing[i]
            printf "%d moved, %d missing\n", moved, lost
            exit lost > 0
        }'
    exit
fi

cd "$(dirname "$0")/.."
[ $# -gt 0 ] || set -- --workspace
tests() { # the lines of a test program's own list, without their ends
    sed -n 's/: test$//p'
}
{
    cargo test "$@" --no-run --message-format json |
        sed -nE 's#.*"manifest_path":"[^"]*/([^/"]+)/Cargo.toml","target":\{"kind":\["([a-z]+)"\].*"name":"([^"]+)".*"test":true\},"features".*"executable":"([^"]+)".*#\1 \2 \3 \4#p' |
        while read -r crate kind name program; do
            case $kind-$name in
            test-it | test-rt) prefix= ;;
            test-*) prefix=$name:: ;;
            *) prefix=src:: ;;
            esac
            "$program" --list 2>/dev/null | tests | sed "s|^|$crate $prefix|"
        done
    # `crates/sporadic/src/lib.rs - item (line 23)`
    cargo test "$@" --doc -- --list 2>/dev/null | tests |
        sed -E 's#^(.*/)?([^/]+)/src/([^ ]+) - (.*)\(line [0-9]+\)( - .*)?$#\2 doc \3 \4#; s/ +$//'
} | LC_ALL=C sort
