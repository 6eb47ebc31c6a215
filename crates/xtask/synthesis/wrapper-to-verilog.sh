#!/usr/bin/env bash
# Prints a wrapped design as Verilog for yosys, with the attributes of memories, and analyses it in the current folder.
#
#   crates/xtask/synthesis/wrapper-to-verilog.sh DESIGN_DIRECTORY
set -euo pipefail
synthesis=$(dirname "$(realpath "$0")")

design=$(realpath "$1")
name=$(basename "$(find "$design" -maxdepth 1 -name '*_axi.f' | head -n 1)" _axi.f)
while read -r library file; do
  case $file in *_bus.vhd) continue ;; esac
  ghdl -a --std=08 --work="$library" "$design/$file"
done < "$design/${name}_axi.f"
ghdl --synth --no-formal --std=08 --out=verilog "${name}_axi" 2> ghdl.log | awk -f "$synthesis/styles.awk" ||
  { grep -i error ghdl.log >&2; exit 1; }
