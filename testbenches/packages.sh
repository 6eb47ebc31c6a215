#!/usr/bin/env bash
# Makes the packages, and uses what is in them.
#
#   testbenches/packages.sh FOLDER
#
# FOLDER is for what it makes. The Debian package comes from $PE_SYNTH, or target/debug/pe-synth. The crates are packaged as
# they are in the working tree; that they build is shown by `--build`, which takes minutes.
set -euo pipefail
trap 'status=$?; ((status == 0)) || echo "packages: failed during: ${section:-start}" >&2; exit "$status"' EXIT

cd "$(dirname "$(realpath "$0")")/.."
folder=$(realpath -m "${1:?a folder}")
binary=$(realpath "${PE_SYNTH:-target/debug/pe-synth}")
fail() {
  echo "packages: $1" >&2
  exit 1
}
mkdir -p "$folder"

section='Debian package'
package=$(crates/xtask/packages/deb.sh "$binary" "$folder")
root=$folder/root
rm -rf "$root"
mkdir -p "$root/var/lib/dpkg"
touch "$root/var/lib/dpkg/status"
# What it depends on is in the system around this root.
install=(dpkg "--root=$root" --force-depends --force-not-root --log=/dev/null)
"${install[@]}" --install "$package" > "$folder/dpkg.log" 2>&1 || { cat "$folder/dpkg.log" >&2; fail 'not installed'; }
for file in bin/pe-synth lib/pe-synth/libpe_fmu.so share/man/man1/pe-synth.1.gz share/doc/pe-synth/copyright \
  share/doc/pe-synth/changelog.gz share/doc/pe-synth/changelog.Debian.gz share/bash-completion/completions/pe-synth \
  share/zsh/vendor-completions/_pe-synth share/fish/vendor_completions.d/pe-synth.fish; do
  [[ -s $root/usr/$file ]] || fail "the package lacks /usr/$file"
done
installed=$root/usr/bin/pe-synth
[[ $("$installed" --version) == "$("$binary" --version)" ]] || fail 'the installed program has another version'
grep -q '^\.TH PE-SYNTH' <(zcat "$root/usr/share/man/man1/pe-synth.1.gz") || fail 'the manual page is none'
grep -q 'License: MIT or Apache-2.0' "$root/usr/share/doc/pe-synth/copyright" || fail 'no licence'
grep -q 'WITHOUT WARRANTY' "$root/usr/share/doc/pe-synth/copyright" || fail 'no text of the licence'
rm -rf "$folder/design" "$folder/other"
compile=(compile models/lotka_volterra/lotka_volterra.spec --quiet --no-pictures)
"$installed" "${compile[@]}" -o "$folder/design"
"$binary" "${compile[@]}" -o "$folder/other"
diff -r -x report-timing.json "$folder/design" "$folder/other" || fail 'the installed program writes other files'
"$installed" fmu "$folder/design" --quiet
again=$(crates/xtask/packages/deb.sh "$binary" "$folder/again")
cmp "$package" "$again" || fail 'the package has other bytes the second time'
"${install[@]}" --purge pe-synth >> "$folder/dpkg.log" 2>&1 || fail 'not removed'
[[ -z $(find "$root/usr" -type f 2> /dev/null) ]] || fail 'something is left after it was removed'

section='crates'
cargo package --workspace --exclude xtask --exclude pe-python --no-verify --allow-dirty --exclude-lockfile --offline --quiet \
  --target-dir "$folder/target"
rm -rf "$folder/crates"
mkdir -p "$folder/crates"
for crate in "$folder"/target/package/pe-*.crate; do
  tar -C "$folder/crates" -xzf "$crate"
done
for name in pe-emit:hdl/pe.vhd pe-emit:templates/network.vhd pe-frontend:grammar/ode.pest pe-ir:src/diagnostics.md \
  pe-wrap:hdl/pe_stream.vhd pe-fmu:templates/fmu3.xml pe-verify:templates/native.rs pe-synth:LICENSE; do
  found=("$folder"/crates/"${name%%:*}"-*/"${name#*:}")
  [[ -f ${found[0]} && ! -L ${found[0]} ]] || fail "the crate ${name%%:*} lacks ${name#*:}"
done
if [[ ${2:-} == --build ]]; then
  section='crates, built from their packages'
  cp Cargo.lock "$folder/crates"
  {
    printf '[workspace]\nresolver = "3"\nmembers = ["pe-synth-*"]\n\n[patch.crates-io]\n'
    for crate in "$folder"/crates/pe-*/; do
      name=$(basename "$crate")
      printf '%s = { path = "%s" }\n' "${name%-*}" "$name"
    done
  } > "$folder/crates/Cargo.toml"
  cargo build --manifest-path "$folder/crates/Cargo.toml" --target-dir "$folder/built" --offline --quiet
  "$folder/built/debug/pe-synth" "${compile[@]}" -o "$folder/other"
  diff -r -x report-timing.json "$folder/design" "$folder/other" || fail 'the packaged crates write other files'
fi
