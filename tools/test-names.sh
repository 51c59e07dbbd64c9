#!/usr/bin/env bash
# Lists every test of the workspace: one line a test, its crate and its path, sorted. Two such lists
# show what is missing: `comm -23 before after`.
#
# A path begins with the file that holds the test, wherever that file is linked: `tests/actions.rs` and
# `tests/it/actions.rs` give the same line. A doctest is named by its file and its item.
# Arguments go to `cargo test`, such as `-p sporadic`; without any the whole workspace is listed.
set -euo pipefail
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
