#!/usr/bin/env bash
# Debian's package of the command: `tools/deb.sh` builds it into target/deb, and says its name.
# REPLENISH_PROGRAM is a program that is built already; a directory as argument takes the package.
# Needs dpkg-deb, and strip for a small program.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-target/deb}
program=${REPLENISH_PROGRAM:-}
if [ -z "$program" ]; then
    cargo build --locked --profile deploy -p replenish-cli
    program=${CARGO_TARGET_DIR:-target}/deploy/replenish
fi
version=$("$program" --version | cut -d' ' -f2)
architecture=$(dpkg --print-architecture)
tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT

install -D -m 755 "$program" "$tree/usr/bin/replenish"
if [ -z "${REPLENISH_PROGRAM:-}" ] && command -v strip >/dev/null; then
    strip "$tree/usr/bin/replenish"
fi
"$program" man --dir "$tree/usr/share/man/man1"
gzip -9n "$tree"/usr/share/man/man1/*.1
mkdir -p "$tree"/usr/share/{bash-completion/completions,zsh/vendor-completions,fish/vendor_completions.d}
"$program" completions bash >"$tree/usr/share/bash-completion/completions/replenish"
"$program" completions zsh >"$tree/usr/share/zsh/vendor-completions/_replenish"
"$program" completions fish >"$tree/usr/share/fish/vendor_completions.d/replenish.fish"
# Debian's programs are in /usr/bin. The service is installed and not enabled.
mkdir -p "$tree/usr/lib/systemd/system"
sed 's#/usr/local/bin/replenish#/usr/bin/replenish#' deploy/replenish-agent.service \
    >"$tree/usr/lib/systemd/system/replenish-agent.service"
install -D -m 644 deploy/50-replenish.conf "$tree/etc/security/limits.d/50-replenish.conf"
mkdir -p "$tree/usr/share/doc/replenish" "$tree/DEBIAN"
gzip -9nc CHANGELOG.md >"$tree/usr/share/doc/replenish/changelog.gz"
cat >"$tree/usr/share/doc/replenish/copyright" <<END
Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
Upstream-Name: replenish
Source: https://github.com/replenish-rt/replenish

Files: *
Copyright: the authors of replenish
License: Apache-2.0
 On Debian systems the text is in /usr/share/common-licenses/Apache-2.0.
END

# The oldest C library that has each function which the program calls.
glibc=$(grep -ao 'GLIBC_2\.[0-9]*' "$program" | sort -uV | tail -n 1 | cut -d_ -f2)
size=$(du -sk --exclude=DEBIAN "$tree" | cut -f1)
cat >"$tree/DEBIAN/control" <<END
Package: replenish
Version: $version
Architecture: $architecture
Maintainer: The authors of replenish <replenish-rt@users.noreply.github.com>
Installed-Size: $size
Depends: libc6 (>= $glibc), libgcc-s1
Recommends: libpam-modules
Section: utils
Priority: optional
Homepage: https://github.com/replenish-rt/replenish
Description: CPU budgets for ROS 2 and micro-ROS, and the agent for boards
 The command of replenish: an agent for DDS-XRCE clients, CPU budgets for the
 threads of any program, plans for deployment files, and a view of what every
 budget is used for.
 .
 Members of the group realtime, which this package makes, may use real-time
 priorities.
END
echo /etc/security/limits.d/50-replenish.conf >"$tree/DEBIAN/conffiles"
cat >"$tree/DEBIAN/postinst" <<'END'
#!/bin/sh
set -e
if [ "$1" = configure ]; then
    getent group realtime >/dev/null || groupadd --system realtime
    [ ! -d /run/systemd/system ] || systemctl daemon-reload || true
fi
END
cat >"$tree/DEBIAN/prerm" <<'END'
#!/bin/sh
set -e
if [ "$1" = remove ] && [ -d /run/systemd/system ]; then
    systemctl disable --now replenish-agent || true
fi
END
chmod 755 "$tree"/DEBIAN/{postinst,prerm}
chmod -R go=rX "$tree"

mkdir -p "$out"
package=$out/replenish_${version}_$architecture.deb
dpkg-deb --root-owner-group -Z"${DEB_COMPRESSION:-xz}" --build "$tree" "$package" >/dev/null
echo "$package"
