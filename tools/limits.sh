#!/usr/bin/env bash
# Limits that keep the code readable, each with the count it has now: conditional compilation and
# features of `replenish`, the width of comments (tables and drawings apart), overflow checks, and lines
# that mutants change.
# The limit for cfg sites is 80; the limit goes down with the count.
set -euo pipefail
cd "$(dirname "$0")/.."
status=0
limit() { # NAME COUNT MOST
    printf '%-58s %4d of %d\n' "$1" "$2" "$3"
    [ "$2" -le "$3" ] || status=1
}
count() { grep -rE --include='*.rs' "$@" | wc -l; }
limit 'cfg sites in crates/replenish/src' "$(count 'cfg(_attr)?!?\(' crates/replenish/src)" 77
limit 'features of replenish besides default' \
    "$(sed -n '/^\[features\]/,/^\[/p' crates/replenish/Cargo.toml | grep -cE '^[a-z]+ = ' | awk '{ print $1 - 1 }')" 8
wide=$(git ls-files '*.rs' | LC_ALL=C.UTF-8 xargs grep -nE '^ *//' | grep -vE '//[/!]? *\||[─│►▼◄┌└]' | LC_ALL=C.UTF-8 sed -nE '/^[^:]*:[0-9]*:.{101,}/s/^([^:]*:[0-9]*):.*/\1/p')
limit 'comment lines wider than 100 columns' "$(printf '%s' "$wide" | grep -c . || true)" 0
[ -z "$wide" ] || printf '%s\n' "$wide" | head -n 20
# An overflow in the length of a stranger's field must not go on as a wrong length.
unchecked=0
for crate in wire xrce msg rtps recorder agent plan; do
    sed -n "/^\[profile.release.package.replenish-$crate\]/,/^$/p" Cargo.toml |
        grep -qx 'overflow-checks = true' || unchecked=$((unchecked + 1))
done
limit 'parsing crates without overflow checks in release' "$unchecked" 0
# What is not built for tests must have none.
untested=0
for manifest in $(git grep -l '^doctest = false' -- '*Cargo.toml'); do
    untested=$((untested + $( (grep -rhE '^ *//[/!] ```' "$(dirname "$manifest")/src" || true) | awk 'NR % 2 && !/```(text|ignore|toml|sh|json)/' | wc -l)))
done
for main in $(git grep -l '^test = false # no test' -- '*Cargo.toml'); do
    untested=$((untested + $(grep -c '#\[test\]' "$(dirname "$main")/src/main.rs" || true)))
done
limit 'tests and examples that no test command builds' "$untested" 0
stale=$(python3 tools/stale_mutants.py)
limit 'lines of mutants that the code does not have' "$(printf '%s' "$stale" | grep -c . || true)" 0
[ -z "$stale" ] || printf '%s\n' "$stale"
exit $status
