#!/usr/bin/env bash
# Times the generated native programs against plain C loops and writes docs/baseline.md.
#
#   cargo run -p xtask -- baseline
#
# Needs cargo and gcc. The C programs are in the folder baseline, one per model of the paper, built with -O3
# -march=native. `pe-synth bench --against` runs all programs in turn and takes the fastest of many repetitions of each,
# so that other work on the machine meets all of them. $PE_SYNTH names a binary to use in place of building one. Exit
# code 4: a program computes something else, or a generated one is slower than its rival.
set -euo pipefail

source "$(dirname "$(realpath "$0")")/../common.sh"
pe_synth=$(built PE_SYNTH pe-synth)
cd "$root"
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
models=(weibel11:64 lutchen4000:63 wave80:63 atrial15:63)
for entry in "${models[@]}"; do
  model=${entry%:*}
  against=()
  for precision in double:double single:float; do
    program=$scratch/$model-${precision%:*}
    gcc -O3 -march=native -std=c11 -D_POSIX_C_SOURCE=200809L -Wall -Wextra -Werror -DR="${precision#*:}" -o "$program" \
      "$pages/baseline/$model.c" -lm
    against+=(--against "${precision%:*}=$program")
  done
  # Formats and mapping are of no interest here: a short span, and few tries.
  "$pe_synth" bench "models/$model/$model.spec" --pes "${entry#*:}" --span 1ms --tries 1000 "${against[@]}" \
    --message-format json -o "$scratch/$model.json" > /dev/null
done
code=0
python3 "$pages/baseline.py" "$scratch" "$(gcc --version | head -1)" > "$scratch/page.md" || code=$?
if ((code == 0 || code == 4)); then
  cp "$scratch/page.md" docs/baseline.md
  chmod 644 docs/baseline.md
fi
exit "$code"
