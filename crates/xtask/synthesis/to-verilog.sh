#!/usr/bin/env bash
# Prints a generated network as Verilog for yosys, with the attributes of its memories, which GHDL 2.0 drops.
#
#   cargo run -p xtask -- to-verilog DESIGN_DIRECTORY [GHDL_OPTION...]
#
# Options such as -gTRACE=true go to `ghdl --synth`.
set -euo pipefail
source "$(dirname "$(realpath "$0")")/../common.sh"

design=$(given_design "$@")
shift
make_work

cd "$work"
model=$("$synthesis/analyse.sh" "$design")
ghdl --synth --no-formal --std=08 --out=verilog "$@" "$model" 2> ghdl.log | awk -f "$synthesis/styles.awk" || { grep -i error ghdl.log >&2; exit 1; }
