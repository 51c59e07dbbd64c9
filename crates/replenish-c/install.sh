#!/usr/bin/env bash
# Installs libreplenish below a prefix: the shared and the static library, headers, pkg-config and CMake
# files. Build first: cargo build --release -p replenish-c
#
#   crates/replenish-c/install.sh [--prefix DIR] [--from DIR]
#
# DIR of --from has libreplenish_c.so and libreplenish_c.a; default: target/release of this repository.
# DIR of --prefix: /usr/local. DESTDIR is put before it. The tree may be moved later.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
prefix=/usr/local
from=${CARGO_TARGET_DIR:-$here/../../target}/release
while [ $# -gt 0 ]; do
    case $1 in
    --prefix) prefix=$2 ;;
    --from) from=$2 ;;
    *) echo "unknown argument $1: --prefix DIR, --from DIR" >&2; exit 2 ;;
    esac
    shift 2
done
[ -e "$from/libreplenish_c.so" ] || {
    echo "no libreplenish_c.so in $from: cargo build --release -p replenish-c" >&2
    exit 1
}
version=$(sed -n '/^\[workspace.package\]/,/^\[/s/^version = "\(.*\)"/\1/p' "$here/../../Cargo.toml")
soname=libreplenish.so.${version%%.*} # as build.rs says
root=${DESTDIR:-}$prefix
lib=$root/lib
install -d "$lib/pkgconfig" "$lib/cmake/replenish" "$root/include"
install -m 755 "$from/libreplenish_c.so" "$lib/libreplenish.so.$version"
ln -sf "libreplenish.so.$version" "$lib/$soname"
ln -sf "$soname" "$lib/libreplenish.so"
install -m 644 "$from/libreplenish_c.a" "$lib/libreplenish.a"
install -m 644 "$here"/include/* "$root/include/"
for file in "$here/share/replenish.pc" "$here"/share/*.cmake; do
    case $file in
    *.pc) to=$lib/pkgconfig ;;
    *) to=$lib/cmake/replenish ;;
    esac
    sed "s/@VERSION@/$version/g" "$file" >"$to/$(basename "$file")"
done
echo "libreplenish $version is in $root"
