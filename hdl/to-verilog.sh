#!/usr/bin/env bash
# Prints a generated network as Verilog for yosys, with the attributes of its memories, which GHDL 2.0 drops.
#
#   hdl/to-verilog.sh DESIGN_DIRECTORY [GHDL_OPTION...]
#
# Options such as -gTRACE=true go to `ghdl --synth`.
set -euo pipefail

if (($# < 1)); then
  sed -n '2,6s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
design=$(realpath "$1")
shift
here=$(dirname "$(realpath "$0")")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

cd "$work"
model=$("$here/analyse.sh" "$design")
ghdl --synth --no-formal --std=08 --out=verilog "$@" "$model" 2> ghdl.log | awk -f "$here/styles.awk" || { grep -i error ghdl.log >&2; exit 1; }
