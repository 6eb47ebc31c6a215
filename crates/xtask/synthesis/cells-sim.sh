#!/usr/bin/env bash
# Prints where the simulation models of Xilinx cells are that yosys carries: $CELLS_SIM, else beside the given yosys.
set -euo pipefail

cells=${CELLS_SIM:-}
if [[ -z $cells ]]; then
  root=$(dirname "$(dirname "$(realpath "$1")")")
  cells=$(find "$root" -path '*/xilinx/cells_sim.v' -print -quit 2> /dev/null)
fi
if [[ ! -f $cells ]]; then
  echo "set CELLS_SIM to yosys' share/xilinx/cells_sim.v" >&2
  exit 2
fi
echo "$cells"
