#!/usr/bin/env bash
# Builds the peers on the DDS of Debian 12: Cyclone DDS 0.10.2 and Fast DDS 2.9.1. The packages are
# unpacked below the target directory and not installed. Needs apt-get, dpkg, gcc and g++.
set -euo pipefail
cd "$(dirname "$0")/../../../.."
dir="$(realpath -m "${CARGO_TARGET_DIR:-target}")/peers/debian"
sources=crates/replenish/tests/ros2/foreign
wanted=$(cat "$0" $sources/*.c $sources/*.cpp $sources/*.idl | sha256sum | cut -c1-16)
[ -e "$dir/installed-$wanted" ] && exit 0
packages="cyclonedds-dev cyclonedds-tools libcycloneddsidl0 libddsc0debian libiceoryx-binding-c2
    libiceoryx-hoofs2 libiceoryx-platform2 libiceoryx-posh2 libfastcdr-dev libfastcdr1 libfastrtps-dev
    libfastrtps2.9 libfoonathan-memory-dev libfoonathan-memory0.7.2 libtinyxml2-9"
rm -rf "$dir"
mkdir -p "$dir/packages" "$dir/root" "$dir/bin"
# shellcheck disable=SC2086 # a list of words
(cd "$dir/packages" && { apt-get -q download $packages ||
    { apt-get -q -o DPkg::Lock::Timeout=300 update && apt-get -q download $packages; }; }) >&2
for package in "$dir"/packages/*.deb; do dpkg -x "$package" "$dir/root"; done
libraries=$(dirname "$(find "$dir/root/usr/lib" -name libddsc.so.0.10.2)")
[ -e "$libraries/libfastrtps.so.2.9.1" ]
include="$dir/root/usr/include"
flags="-O1 -I$include -I$include/ddsc -I$include/$(basename "$libraries") -I$dir/bin"
# Libraries of libraries are named too, and the old tag is used: they are looked for here, from the
# program's place on, so that the target directory may be moved.
here="\$ORIGIN/$(realpath --relative-to="$dir/bin" "$libraries")"
shared=$(cd "$libraries" && printf -- '-l:%s ' libiceoryx_*.so.2)
link="-L$libraries -Wl,--disable-new-dtags -Wl,-rpath,$here -Wl,-rpath-link,$libraries"
LD_LIBRARY_PATH="$libraries" "$dir/root/usr/bin/idlc" -o "$dir/bin" "$sources/types.idl"
# shellcheck disable=SC2086
gcc $flags "$sources/cyclone.c" "$dir/bin/types.c" -Wl,--no-as-needed $link -lddsc $shared -o "$dir/bin/cyclone"
# shellcheck disable=SC2086
g++ -std=c++17 $flags "$sources/fastdds.cpp" $link -lfastrtps -lfastcdr -o "$dir/bin/fastdds"
if ldd "$dir/bin/cyclone" "$dir/bin/fastdds" | grep 'not found'; then exit 1; fi
touch "$dir/installed-$wanted"
