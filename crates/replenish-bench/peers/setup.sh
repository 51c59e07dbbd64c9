#!/usr/bin/env bash
# Builds the foreign ends of `bench ros2`, beside the peers that
# crates/replenish-rtps/tests/peers/setup.sh installs, which it runs first. Needs gcc.
set -euo pipefail
cd "$(dirname "$0")/../../.."
crates/replenish-rtps/tests/peers/setup.sh
target="$(realpath -m "${CARGO_TARGET_DIR:-target}")/peers"
here=crates/replenish-bench/peers
dir="$target/bench"
wanted=$(cat "$0" $here/*.[chp]* $here/*.idl | sha256sum | cut -c1-16)
[ -e "$dir/installed-$wanted" ] && exit 0
rm -rf "$dir"
mkdir -p "$dir"

# Cyclone DDS of Debian 12, unpacked and not installed.
debian="$target/debian/root"
libraries=$(dirname "$(find "$debian/usr/lib" -name libddsc.so.0.10.2)")
include="$debian/usr/include"
flags="-O2 -I$include -I$include/ddsc -I$include/$(basename "$libraries") -I$dir"
from="\$ORIGIN/$(realpath --relative-to="$dir" "$libraries")"
shared=$(cd "$libraries" && printf -- '-l:%s ' libiceoryx_*.so.2)
link="-L$libraries -Wl,--disable-new-dtags -Wl,-rpath,$from -Wl,-rpath-link,$libraries"
LD_LIBRARY_PATH="$libraries" "$debian/usr/bin/idlc" -o "$dir" "$here/blob.idl"
# shellcheck disable=SC2086
gcc $flags "$here/cyclone.c" "$dir/blob.c" -Wl,--no-as-needed $link -lddsc $shared -o "$dir/cyclone"

# rcl and Fast DDS of ROS 2 Kilted's wheels; a header stands in a directory of its package.
kilted="$target/kilted"
includes=$(find -L "$kilted/include" -mindepth 1 -maxdepth 1 -type d -printf '-I%p ')
# shellcheck disable=SC2086
gcc -O2 -fPIC -shared $includes "$here/rcl.c" -L"$kilted/lib" -Wl,--allow-shlib-undefined \
    -Wl,-rpath,"$kilted/lib" -lrcl -lrmw -lrcutils -lstd_msgs__rosidl_typesupport_c -o "$dir/rcl.so"
touch "$dir/installed-$wanted"
