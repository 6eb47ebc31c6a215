#!/usr/bin/env bash
# Writes cells.v, simulation models of the cells of a netlist, into the current folder.
#
#   testbenches/cells.sh YOSYS FAMILY NETLIST
#
# FAMILY is xc6v, ecp5 or gowin. Models are those that yosys carries, $CELLS_SIM in place of a search for them, and
# ours of cells that have none there.
set -euo pipefail

yosys=$1 family=$2 netlist=$3
here=$(dirname "$(realpath "$0")")
case $family in
  xc6v) library=xilinx/cells_sim.v ;;
  ecp5) library=lattice/common_sim.vh ;;
  gowin) library=gowin/cells_sim.v ;;
  *) echo "unknown family: $family" >&2; exit 2 ;;
esac
cells=${CELLS_SIM:-}
if [[ -z $cells ]]; then
  cells=$(find "$(dirname "$(dirname "$(realpath "$yosys")")")" -path "*/$library" 2> /dev/null | head -n 1)
fi
if [[ ! -f $cells ]]; then
  echo "set CELLS_SIM to yosys' share/$library" >&2
  exit 2
fi
if [[ $family == ecp5 ]]; then
  # Of this family yosys has models of logic only.
  awk '/^module (LUT4|LUT2|PFUMX|L6MUX21|TRELLIS_DPR16X4|TRELLIS_FF|CCU2C) *\(/ { inside = 1 }
       inside && /specify/ { timing = !timing; next }
       inside && !timing { print }
       /^endmodule/ { inside = 0 }' "$cells" "$(dirname "$cells")/ccu2c_sim.vh" > cells.v
  cat "$here/ecp5_cells.v" >> cells.v
elif [[ $family == gowin ]]; then
  # Multipliers are not among the models, and block RAM is empty there.
  awk '/^module SPX9 *\(/ { inside = 1 } !inside { print } /^endmodule/ { inside = 0 }' "$cells" > cells.v
  cat "$here/gowin_cells.v" >> cells.v
else
  # Of block RAM there are ports and timing.
  awk '/^module RAMB(18|36)E1 *\(/ { inside = 1 } !inside { print } /^endmodule/ { inside = 0 }' "$cells" > cells.v
  cat "$here/xilinx_cells.v" >> cells.v
fi
# A cell without behaviour would leave its outputs unknown, and nobody would know why.
awk 'FNR == NR { if ($1 ~ /^[A-Z][A-Z0-9_]*$/) used[$1] = 1; next }
     /^module / { name = $2; sub(/[^A-Za-z0-9_].*/, "", name); works = timing = 0; known[name] = 1 }
     /specify/ { timing = !/endspecify/ }
     !timing && (/(^|[^a-z])(assign|always|wire .*=)/ || /^ +[A-Za-z0-9_]+ +#?[A-Za-z0-9_]* *\(/) { behaves[name] = 1 }
     END { for (name in used) if (known[name] && !behaves[name]) { print name; bad = 1 } exit bad }' \
  "$netlist" cells.v > shells.txt ||
  { echo "no simulation model of $(paste -sd ' ' shells.txt)" >&2; exit 1; }
