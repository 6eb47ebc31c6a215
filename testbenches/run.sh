#!/usr/bin/env bash
# Runs every test bench of the hand-written VHDL in GHDL; fails if one fails or checks nothing.
#
#   testbenches/run.sh [BENCH...]      for example testbenches/run.sh pe_sequencer_tb
set -euo pipefail

here=$(dirname "$(realpath "$0")")
hdl=$here/../hdl
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"

for unit in pe_pkg pe_write_pkg pe_style_pkg pe_replica pe_ram pe_rom pe_multiplier pe_index pe_scale pe pe_sequencer pe_input pe_tick pe_output pe_trace_pkg; do
  ghdl -a --std=08 --work=pe_lib "$hdl/$unit.vhd"
done
benches=("$@")
if ((${#benches[@]} == 0)); then
  mapfile -t benches < <(cd "$here" && basename -s .vhd -- *_tb.vhd)
fi
for bench in "${benches[@]}"; do
  ghdl -a --std=08 "$here/$bench.vhd"
  output=$(ghdl --elab-run --std=08 "$bench" --assert-level=error 2>&1) || { echo "$output" >&2; exit 1; }
  checks=$(sed -n 's/^checks \([0-9]*\)$/\1/p' <<< "$output")
  if ((${checks:-0} == 0)); then
    echo "$bench checked nothing" >&2
    exit 1
  fi
  printf '%-20s %6s checks\n' "$bench" "$checks"
done
