#!/usr/bin/env bash
# Makes a Debian package of a built pe-synth.
#
#   cargo run -p xtask -- deb BINARY FOLDER
#
# BINARY has the shared library of FMUs beside it, as cargo leaves it. Prints the path of the package in FOLDER. The same
# binary and commit give the same bytes. Needs binutils, git and dpkg.
set -euo pipefail

[[ $# == 2 ]] || { echo 'usage: deb.sh BINARY FOLDER' >&2; exit 2; }
root=$(dirname "$(realpath "$0")")/../../..
binary=$(realpath "$1")
folder=$2
for tool in dpkg dpkg-deb strip objdump git gzip; do
  command -v "$tool" > /dev/null || { echo "deb: $tool is missing: apt-get install binutils dpkg git gzip" >&2; exit 1; }
done

version=$("$binary" --version | sed 's/^pe-synth //')
architecture=$(dpkg --print-architecture)
maintainer='pe-synth maintainers <maintainers@pe-synth.invalid>'
# The date of the commit stands in for that of the package.
SOURCE_DATE_EPOCH=$(git -C "$root" log -1 --format=%ct)
export SOURCE_DATE_EPOCH

tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
chmod 755 "$tree"
umask 022
share=$tree/usr/share
doc=$share/doc/pe-synth
mkdir -p "$tree"/{DEBIAN,usr/bin,usr/lib/pe-synth} "$share"/man/man1 "$share"/bash-completion/completions \
  "$share"/zsh/vendor-completions "$share"/fish/vendor_completions.d "$doc"

strip -o "$tree/usr/bin/pe-synth" "$binary"
library=$(dirname "$binary")/libpe_fmu.so
[[ -f $library ]] || library=$(dirname "$binary")/deps/libpe_fmu.so
strip --strip-unneeded -o "$tree/usr/lib/pe-synth/libpe_fmu.so" "$library"
chmod 644 "$tree/usr/lib/pe-synth/libpe_fmu.so"

"$binary" man | gzip -9n > "$share/man/man1/pe-synth.1.gz"
"$binary" completions bash > "$share/bash-completion/completions/pe-synth"
"$binary" completions zsh > "$share/zsh/vendor-completions/_pe-synth"
"$binary" completions fish > "$share/fish/vendor_completions.d/pe-synth.fish"
gzip -9nc "$root/docs/CHANGELOG.md" > "$doc/changelog.gz"
gzip -9n > "$doc/changelog.Debian.gz" << CHANGES
pe-synth ($version-1) unstable; urgency=low

  * Version $version; changelog.gz says what is new.

 -- $maintainer  $(date -uRd "@$SOURCE_DATE_EPOCH")
CHANGES
{
  printf 'Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/\nUpstream-Name: pe-synth\n\n'
  printf 'Files: *\nCopyright: 2026 the pe-synth authors\nLicense: MIT or Apache-2.0\n'
  sed -n '/^Permission is hereby granted/,/^====/{/^====/!{s/^$/./; s/^/ /; p}}' "$root/LICENSE"
  printf ' .\n On Debian systems, the Apache License, Version 2.0, is in /usr/share/common-licenses/Apache-2.0.\n'
} > "$doc/copyright"

# The newest version of the C library whose symbols are used.
glibc=$(objdump -T "$tree/usr/bin/pe-synth" "$tree/usr/lib/pe-synth/libpe_fmu.so" |
  grep -o 'GLIBC_[0-9.]*' | sed 's/GLIBC_//' | sort -uV | tail -n 1)
cat > "$tree/DEBIAN/control" << CONTROL
Package: pe-synth
Version: $version-1
Section: electronics
Priority: optional
Architecture: $architecture
Maintainer: $maintainer
Installed-Size: $(du -sk "$tree/usr" | cut -f 1)
Depends: libc6 (>= $glibc), libgcc-s1
Recommends: gcc, ghdl, rustc
Suggests: verilator, g++, make
Description: compiler from ordinary differential equations to FPGA networks
 A spec states the equations as on paper. pe-synth compiles it to a network of
 small microcoded processing elements, written as VHDL-2008 for any FPGA,
 together with a Rust program that computes the same bits, and reports size,
 speed and error of the result.
CONTROL
(cd "$tree" && find usr -type f -print0 | sort -z | xargs -0 md5sum > DEBIAN/md5sums)
find "$tree" -exec touch -hd "@$SOURCE_DATE_EPOCH" {} +

mkdir -p "$folder"
package=$folder/pe-synth_$version-1_$architecture.deb
# Level 1: a tenth of the time of the default for a fifth more bytes.
dpkg-deb --root-owner-group -Zxz -z1 --build "$tree" "$package" > /dev/null
echo "$package"
