#!/usr/bin/env bash
# Measures PEs and fits the area model to them and to those measured before:
#
#   cargo run -p xtask -- fit-area [DESIGN_FOLDER...]
#
# Measures the single PEs that xtask single_pes writes, in out/pes-SET, and the PEs of each design folder, for each
# family, half a minute each. Needs what xtask measure-area needs. Rewrites measured.txt and fitted.rs in
# crates/pe-target/src/area and docs/area-model.md.
set -euo pipefail

source "$(dirname "$(realpath "$0")")/../common.sh"
folders=()
for folder in "$@"; do folders+=("$(realpath "$folder")"); done
cd "$root"
for set in shifts pre_adder model deep tables widths ports; do
  python3 "$synthesis/single_pes.py" "out/pes-$set" "$set"
  folders+=("out/pes-$set")
done
files=()
for folder in "${folders[@]}"; do
  for family in xc6v ecp5 gowin; do "$synthesis/measure-area.sh" "$folder" "$family"; done
  files+=("$folder"/*_area*.txt)
done
cargo run --quiet -p pe-synth --example fit_area -- "${files[@]}"
