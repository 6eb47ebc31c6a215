#!/usr/bin/env bash
# Writes the timing diagrams of docs/hardware.md, as testbenches/handshake_tb.vhd and host_ports_tb.vhd print them in GHDL:
#
#   cargo run -p xtask -- timing [--check]       # --check changes nothing and fails if the document shows others
set -euo pipefail

source "$(dirname "$(realpath "$0")")/../common.sh"
make_work
cd "$work"
for unit in pe_pkg pe_style_pkg pe_replica pe_ram pe_rom pe_sequencer pe_access pe_output pe_output_memory pe_output_reader; do
  ghdl -a --std=08 --work=pe_lib "$root/hdl/$unit.vhd"
done
ghdl -a --std=08 "$root/testbenches/handshake_tb.vhd"
ghdl -a --std=08 "$root/testbenches/host_ports_tb.vhd"

# A diagram: test bench, title, then generics.
drawn() {
  local bench=$1 title=$2
  shift 2
  printf '%s:\n\n' "$title"
  ghdl --elab-run --std=08 "$bench" "${@/#/-g}" --assert-level=error --ieee-asserts=disable-at-0 > run.txt
  sed '/^checks/d; s/^/    /; s/ *$//' run.txt
  echo
}

diagram() {
  drawn handshake_tb "$@"
}

{
  sed '/^<!-- timing -->$/q' "$root/docs/hardware.md"
  echo
  diagram 'Free run, `step_i` = 1'
  diagram '`step_i` gated by `done_o`, inputs that take three clocks to follow the outputs' GATED=true CLOCKS=70
  diagram 'Free run with gaps of the clock enable' GAPS=true CLOCKS=70
  diagram 'Deep pipeline, free run' DEEP=true
  diagram 'Deep pipeline, gated' DEEP=true GATED=true CLOCKS=70
  drawn host_ports_tb 'Outputs in two memories in free run: the number of the output that is read, the one that is there, and its step' \
    SHOWN=outputs FIRST=21 CLOCKS=60
  drawn host_ports_tb 'Reading the states of two PEs at the pause point' SHOWN=read CLOCKS=44
  drawn host_ports_tb 'Reading them, deep pipeline' SHOWN=read DEEP=true CLOCKS=44
  drawn host_ports_tb 'Replacing two states' SHOWN=replace FIRST=11 CLOCKS=90
  drawn host_ports_tb 'Restart with two states' SHOWN=restart FIRST=11 CLOCKS=98
  sed -n '/^<!-- end of timing -->$/,$p' "$root/docs/hardware.md"
} > hardware.md
if [[ ${1:-} != --check ]]; then
  cp hardware.md "$root/docs/hardware.md"
elif ! cmp -s hardware.md "$root/docs/hardware.md"; then
  echo 'docs/hardware.md has other timing diagrams than the test bench prints: run xtask timing' >&2
  exit 1
fi
