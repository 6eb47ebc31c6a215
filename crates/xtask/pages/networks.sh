#!/usr/bin/env bash
# Compiles designs, synthesises each as a whole for three families, and writes their cells beside the estimates into
# docs/silicon.md:
#
#   cargo run -p xtask -- networks
#
# Designs and rows go to $WORK, default target/networks; what is there is not made again. $PE_SYNTH names a binary to
# use in place of building one. Needs what xtask measure-network needs. 20 minutes on an idle core.
set -euo pipefail

source "$(dirname "$(realpath "$0")")/../common.sh"
work=$(realpath -m "${WORK:-$target/networks}")
mkdir -p "$work/cells"
pe_synth=$(built PE_SYNTH pe-synth)
cd "$root"

# Name, model, options.
designs='
weibel5 weibel5 --pes 4 --span 20ms --multiplier 25x18
motor_pid motor_pid
hodgkin_huxley hodgkin_huxley
breathing lutchen_breathing --pes 4 --span 0.1 --multiplier 25x18
wave6 wave6 --multiplier 32x32
lorenz lorenz --multiplier 25x35
van_der_pol_deep van_der_pol --pes 2 --multiplier 18x18 --pipeline deep
'
others='
kepler kepler
atrial3 atrial3 --pes 2 --multiplier 18x25
lotka_volterra lotka_volterra --multiplier 24x27
pendulum_deep pendulum --pes 2 --pipeline deep
lutchen20 lutchen20 --pes 3 --span 20ms --multiplier 27x24
'
table() {
  local name model options
  while read -r name model options; do
    [[ -n $name ]] || continue
    if [[ ! -f $work/$name/report.json ]]; then
      # shellcheck disable=SC2086
      "$pe_synth" compile "models/$model/$model.spec" $options --quiet --no-pictures -o "$work/$name"
    fi
    if [[ ! -f $work/$name.rows ]]; then
      CELLS=$work/cells "$synthesis/measure-network.sh" "$work/$name" > "$work/$name.rows.part"
      mv "$work/$name.rows.part" "$work/$name.rows"
    fi
    [[ -n ${head:-} ]] || head -n 2 "$work/$name.rows"
    head=done
    tail -n +3 "$work/$name.rows"
  done <<< "$1"
}

{
  sed '/^<!-- networks -->$/q' docs/silicon.md
  echo
  (table "$designs")
  printf '\nDesigns by which the model may be mended:\n\n'
  (table "$others")
  echo
  printf 'Options: %s.\n\n' "$(awk 'NF > 2 { name = $1; $1 = $2 = ""; sub(/^ */, ""); printf "%s%s `%s`", sep, name, $0; sep = ", " }' <<< "$designs$others")"
  sed -n '/^<!-- end of networks -->$/,$p' docs/silicon.md
} > "$work/silicon.md"
cp "$work/silicon.md" docs/silicon.md
