#!/usr/bin/env bash
# Runs every test bench of the hand-written VHDL in GHDL; fails if one fails or checks nothing. `misuse` runs illegal
# generics and handshakes, one after the other, and fails if one of them does not end in the assertion that it is about.
#
#   testbenches/run.sh [BENCH...]      for example testbenches/run.sh pe_sequencer_tb
set -euo pipefail

here=$(dirname "$(realpath "$0")")
hdl=$here/../hdl
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"

for unit in pe_pkg pe_write_pkg pe_style_pkg pe_replica pe_ram pe_rom pe_multiplier pe_index pe_scale pe_coefficient pe pe_sequencer pe_input pe_tick pe_access pe_output pe_output_memory pe_output_reader pe_trace_pkg; do
  ghdl -a --std=08 --work=pe_lib "$hdl/$unit.vhd"
done
ghdl -a --std=08 "$here/check_pkg.vhd"
benches=("$@")
if ((${#benches[@]} == 0)); then
  mapfile -t benches < <(cd "$here" && basename -s .vhd -- *_tb.vhd misuse.vhd)
fi

misuse() {
  local count=0 number text output
  ghdl --elab-run --std=08 misuse > legal.log 2>&1 || { echo "misuse: the legal scenario fails" >&2; cat legal.log >&2; exit 1; }
  while read -r number text; do
    if output=$(ghdl --elab-run --std=08 misuse -gSCENARIO="$number" 2>&1); then
      echo "misuse: scenario $number passes" >&2
      exit 1
    fi
    if ! grep -qF "$text" <<< "$output"; then
      printf 'misuse: scenario %s does not say "%s" but\n%s\n' "$number" "$text" "$output" >&2
      exit 1
    fi
    count=$((count + 1))
  done < <(sed -n 's/^-- *\([0-9][0-9]*\) \(pe.*\)$/\1 \2/p' "$here/misuse.vhd")
  ((count > 0)) || { echo 'misuse checked nothing' >&2; exit 1; }
  printf '%-20s %6s checks\n' misuse "$count"
}

for bench in "${benches[@]}"; do
  ghdl -a --std=08 "$here/$bench.vhd"
  if [[ $bench == misuse ]]; then
    misuse
    continue
  fi
  output=$(ghdl --elab-run --std=08 "$bench" --assert-level=error 2>&1) || { echo "$output" >&2; exit 1; }
  checks=$(sed -n 's/^checks \([0-9]*\)$/\1/p' <<< "$output")
  if ((${checks:-0} == 0)); then
    echo "$bench checked nothing" >&2
    exit 1
  fi
  printf '%-20s %6s checks\n' "$bench" "$checks"
done
