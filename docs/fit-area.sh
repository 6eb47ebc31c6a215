#!/usr/bin/env bash
# Measures PEs and fits the area model to them and to those measured before:
#
#   docs/fit-area.sh [DESIGN_FOLDER...]
#
# Measures the single PEs that docs/single_pes.py writes, in out/pes-SET, and the PEs of each design folder, for each family, half
# a minute each. Needs what hdl/measure-area.sh needs. Rewrites measured.txt and fitted.rs in crates/pe-target/src/area and
# docs/area-model.md.
set -euo pipefail

cd "$(dirname "$0")/.."
folders=("$@")
for set in shifts pre_adder model deep tables widths; do
  python3 docs/single_pes.py "out/pes-$set" "$set"
  folders+=("out/pes-$set")
done
files=()
for folder in "${folders[@]}"; do
  for family in xc6v ecp5 gowin; do hdl/measure-area.sh "$folder" "$family"; done
  files+=("$folder"/*_area*.txt)
done
cargo run --quiet -p pe-synth --example fit_area -- "${files[@]}"
