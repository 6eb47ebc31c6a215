#!/usr/bin/env bash
# Writes the timing diagrams of docs/hardware.md, as testbenches/handshake_tb.vhd prints them in GHDL:
#
#   cargo run -p xtask -- timing [--check]       # --check changes nothing and fails if the document shows others
set -euo pipefail

source "$(dirname "$(realpath "$0")")/../common.sh"
make_work
cd "$work"
for unit in pe_pkg pe_replica pe_sequencer; do
  ghdl -a --std=08 --work=pe_lib "$root/hdl/$unit.vhd"
done
ghdl -a --std=08 "$root/testbenches/handshake_tb.vhd"

# A diagram: title, then generics.
diagram() {
  local title=$1
  shift
  printf '%s:\n\n' "$title"
  ghdl --elab-run --std=08 handshake_tb "${@/#/-g}" --assert-level=error > run.txt
  sed '/^checks/d; s/^/    /; s/ *$//' run.txt
  echo
}

{
  sed '/^<!-- timing -->$/q' "$root/docs/hardware.md"
  echo
  diagram 'Free run, `step_i` = 1'
  diagram '`step_i` gated by `done_o`, inputs that take three clocks to follow the outputs' GATED=true CLOCKS=70
  diagram 'Free run with gaps of the clock enable' GAPS=true CLOCKS=70
  diagram 'Deep pipeline, free run' DEEP=true
  diagram 'Deep pipeline, gated' DEEP=true GATED=true CLOCKS=70
  sed -n '/^<!-- end of timing -->$/,$p' "$root/docs/hardware.md"
} > hardware.md
if [[ ${1:-} != --check ]]; then
  cp hardware.md "$root/docs/hardware.md"
elif ! cmp -s hardware.md "$root/docs/hardware.md"; then
  echo 'docs/hardware.md has other timing diagrams than the test bench prints: run xtask timing' >&2
  exit 1
fi
