#!/usr/bin/env bash
# Measures what a network has beside its PEs, each part alone: sequencers, inputs, ticks and outputs of several sizes.
#
#   cargo run -p xtask -- measure-parts [FAMILY...] > crates/pe-target/src/area/parts.txt
#
# FAMILY is xc6v, ecp5 or gowin, by default all three. Prints a line per part and family, which the tests of the area
# model read. Needs what xtask measure-network needs.
set -euo pipefail
source "$(dirname "$(realpath "$0")")/../common.sh"

families=("$@")
((${#families[@]} > 0)) || families=(xc6v ecp5 gowin)
yosys=$(find_yosys)
make_work

# Entity, then its generics.
parts='
pe_sequencer PERIOD=25 ROUNDS=1 PAUSE_WORD=7
pe_sequencer PERIOD=216 ROUNDS=1 PAUSE_WORD=7
pe_sequencer PERIOD=1500 ROUNDS=1 PAUSE_WORD=9
pe_sequencer PERIOD=216 ROUNDS=4 PAUSE_WORD=7
pe_sequencer PERIOD=216 ROUNDS=1 PAUSE_WORD=10 DEEP=true
pe_sequencer PERIOD=40 ROUNDS=1 PAUSE_WORD=10 DEEP=true
pe_input STORAGE_BITS=32 WORD_BITS=33 DATA_BITS=25
pe_input STORAGE_BITS=32 WORD_BITS=32 DATA_BITS=18
pe_input STORAGE_BITS=32 WORD_BITS=40 DATA_BITS=32
pe_input STORAGE_BITS=18 WORD_BITS=26 DATA_BITS=25
pe_input STORAGE_BITS=32 WORD_BITS=32 DATA_BITS=18 DEEP=true
pe_output STORAGE_BITS=32 WORD_BITS=33 DATA_BITS=25 INDEX_BITS=6 CAPTURE_WORD=21
pe_output STORAGE_BITS=32 WORD_BITS=33 DATA_BITS=25 INDEX_BITS=6 CAPTURE_WORD=21 SATURATE=false
pe_output STORAGE_BITS=32 WORD_BITS=32 DATA_BITS=18 INDEX_BITS=8 CAPTURE_WORD=121 SATURATE=false
pe_output STORAGE_BITS=32 WORD_BITS=33 DATA_BITS=25 INDEX_BITS=11 CAPTURE_WORD=1207
pe_output STORAGE_BITS=32 WORD_BITS=32 DATA_BITS=18 INDEX_BITS=8 CAPTURE_WORD=121
pe_output STORAGE_BITS=32 WORD_BITS=40 DATA_BITS=32 INDEX_BITS=8 CAPTURE_WORD=121
pe_output STORAGE_BITS=32 WORD_BITS=40 DATA_BITS=25 INDEX_BITS=8 CAPTURE_WORD=121
pe_output STORAGE_BITS=18 WORD_BITS=26 DATA_BITS=25 INDEX_BITS=8 CAPTURE_WORD=121
pe_output STORAGE_BITS=32 WORD_BITS=32 DATA_BITS=18 INDEX_BITS=8 CAPTURE_WORD=121 DEEP=true
pe_tick STEPS=10 DONE=0 ONE_BIT=20 DATA_BITS=25
pe_tick STEPS=1000 DONE=3 ONE_BIT=20 DATA_BITS=25
'
cd "$work"
for file in pe_pkg pe_write_pkg pe_style_pkg pe_replica pe_sequencer pe_input pe_tick pe_output; do
  ghdl -a --std=08 --work=pe_lib "$root/hdl/$file.vhd"
done
while read -r entity generics; do
  [[ -n $entity ]] || continue
  read -ra values <<< "$generics"
  ghdl --synth --no-formal --std=08 --work=pe_lib --out=verilog "${values[@]/#/-g}" "$entity" > part.v 2> ghdl.log ||
    { cat ghdl.log >&2; exit 1; }
  for family in "${families[@]}"; do
    case $family in
      ecp5) flow='synth_ecp5' ;;
      gowin) flow='synth_gowin -noiopads' ;;
      *) flow="synth_xilinx -family $family -flatten -noiopad -noclkbuf" ;;
    esac
    "$yosys" -q -p "read_verilog part.v; $flow -top $entity; tee -q -o stat.txt stat" > yosys.log 2>&1 ||
      { cat yosys.log >&2; exit 1; }
    read -r logic memory shift ff _ <<< "$(awk -f "$synthesis/count-cells.awk" stat.txt)"
    echo "part=$entity $generics family=$family lut=$((logic + memory + shift)) ff=$ff"
  done
done <<< "$parts"
