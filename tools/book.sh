#!/usr/bin/env bash
# The book: every page of `docs` is in its table of contents, and every relative link of a page leads to
# a file. `tools/book.sh build`: mdBook builds it into `target/book`, too.
set -euo pipefail
cd "$(dirname "$0")/.."
status=0
for page in docs/*.md; do
    name=${page#docs/}
    [ "$name" = SUMMARY.md ] || grep -qF "($name)" docs/SUMMARY.md || {
        echo "docs/SUMMARY.md lacks $name"
        status=1
    }
done
while IFS=: read -r page link; do
    target=${link%%#*}
    [ -z "$target" ] || [ -e "$(dirname "$page")/$target" ] || {
        echo "$page: $link leads nowhere"
        status=1
    }
done < <(grep -oHE '\]\([^) ]+\)' README.md CONTRIBUTING.md SECURITY.md docs/*.md |
    sed -E 's/\]\(([^)]*)\)/\1/' | grep -vE ':(https?|mailto):')
[ "${1-}" = build ] || exit $status
mdbook=$PWD/target/ci-tools/bin/mdbook
[ -x "$mdbook" ] || mdbook=$(command -v mdbook) || {
    echo "mdbook is missing: .ci/install lint-foreign"
    exit 1
}
"$mdbook" build
exit $status
