#!/usr/bin/env bash
# Analyses the VHDL of a generated design, without its test bench, in the current folder, and prints the design's name:
#
#   crates/xtask/synthesis/analyse.sh DESIGN_DIRECTORY
set -euo pipefail

design=$(realpath "$1")
model=$(basename "$(find "$design" -maxdepth 1 -name '*_shapes.txt' | head -n 1)" _shapes.txt)
while read -r library file; do
  case $file in *_tb.vhd) continue ;; esac
  ghdl -a --std=08 --work="$library" "$design/$file"
done < "$design/$model.f"
echo "$model"
