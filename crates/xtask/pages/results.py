#!/usr/bin/env python3
"""Writes docs/results.md to standard output, from the raw results of `xtask measure`.

    crates/xtask/pages/results.py WORK
"""

import csv
import glob
import json
import math
import os
import re
import sys

work = ""

# Huang, Vahid, Givargis 2013, table II, "PE" rows: LUTs, DSPs, block RAMs of 36 kbit, equivalent LUTs, cycles per step,
# clock in MHz, ms per simulated second.
PAPER = {
    ("weibel11", 64): (13421, 64, 320, 144621, 3900, 181, 215),
    ("weibel11", 396): (89724, 396, 396, 331284, 780, 178, 44),
    ("lutchen4000", 63): (13008, 63, 315, 142158, 3247, 182, 178),
    ("lutchen4000", 397): (89761, 397, 397, 331931, 549, 179, 31),
    ("wave80", 63): (13780, 63, 189, 97570, 1402, 166, 372),
    ("wave80", 380): (93958, 380, 380, 325758, 269, 175, 68),
    ("atrial15", 63): (29696, 63, 315, 158846, 6225, 140, 445),
    ("atrial15", 309): (87452, 309, 309, 275942, 1320, 145, 91),
}
# Table I: input ports and words of data memory to LUTs, DSPs, block RAMs of 36 kbit, clock in MHz.
PAPER_PES = {
    (3, 32): (214, 1, 1, 193), (3, 64): (284, 1, 1, 194), (3, 128): (378, 1, 1, 197), (3, 1024): (184, 1, 2, 193),
    (1, 64): (264, 1, 1, 195), (7, 64): (312, 1, 1, 195), (15, 64): (376, 1, 1, 198),
}
# LUTs that the paper counts for a multiplier block and for a block RAM of 36 kbit.
LUTS_OF_DSP, LUTS_OF_BRAM = 250, 360
MULTIPLIERS = ("25x18", "18x25", "32x32")
# Forms of a step that take less block RAM and more cycles than the one that is chosen.
SMALLER = ("25x18 horner", "25x18 sums")
# What the paper's device, XC6VLX240T, has, and the error that a design in its area may have.
DEVICE = {"lut": 150720, "dsp": 768, "bram18": 832}
ERROR_LIMIT = 1e-3


def load(path):
    with open(path) as file:
        return json.load(file)


def both(folder):
    """Report and timing of a compiled folder."""
    return load(f"{folder}/report.json"), load(f"{folder}/report-timing.json")


def table(head, rows):
    print("| " + " | ".join(head) + " |")
    print("|---" * len(head) + "|")
    for row in rows:
        print("| " + " | ".join(str(cell) for cell in row) + " |")
    print()


def paragraph(text):
    """Prints text in lines of at most 120 characters."""
    line = ""
    for word in text.split():
        if line and len(line) + 1 + len(word) > 120:
            print(line)
            line = word
        else:
            line = f"{line} {word}" if line else word
    print(line + "\n")


def commits(results):
    """Which commits the results are from."""
    found = set()
    for result in results:
        path = result.rstrip("/") + ".commit"
        found.add(open(path).read().strip() if os.path.exists(path) else "not recorded")
    return ", ".join(f"`{commit}`" if re.fullmatch(r"[0-9a-f]+(-dirty)?", commit) else commit for commit in sorted(found))


def part(title, results, name):
    """Heads a section; false if there is nothing to show."""
    print(f"## {title}\n")
    if not results:
        print(f"Not measured: `cargo run -p xtask -- measure {name} report`.\n")
        return False
    paragraph(f"`cargo run -p xtask -- measure {name}`; commit {commits(results)}.")
    return True


def equivalent(lut, dsp, bram):
    return round(lut + LUTS_OF_DSP * dsp + LUTS_OF_BRAM * bram)


# The numbers of a row of `xtask measure-area`.
AREA_COLUMNS = ("shape", "PEs", "LUT", "packed", "logic", "memory", "SRL", "FF", "DSP", "RAMB18", "RAMB36")


def shapes(path):
    """Rows of `xtask measure-area`: numbers by column, BRAM among them, and features; without the mean."""
    lines = [line for line in open(path) if re.match(r"\d+ ", line)]
    rows = []
    for line in lines:
        *numbers, features = line.split(None, len(AREA_COLUMNS))
        row = dict(zip(AREA_COLUMNS, map(float, numbers)))
        rows.append((row | {"BRAM": row["RAMB18"] / 2 + row["RAMB36"]}, features.strip()))
    return rows


def introduction():
    print("# Results\n")
    paragraph("Written by `cargo run -p xtask -- measure` from its own runs; do not edit. \"Paper\" is Huang, Vahid, Givargis 2013 ([doi "
              "10.1145/2514641.2514650](https://doi.org/10.1145/2514641.2514650)). A section that was not measured again "
              "says from which commit it is.")
    print("What differs from the paper, in every table:\n")
    for line in (
            "**Clock.** None of ours is measured: times assume 150 MHz. The paper's are those of ISE 12.3 after routing, "
            "140 to 198 MHz.",
            "**Area.** Ours is *measured* where a table says so: GHDL `--synth` and yosys `synth_xilinx -family xc6v` of "
            "single PEs with their program memories, constrained to block RAM. yosys does not put two small functions into "
            "one LUT6, which ISE does, so its counts are on the high side. Elsewhere it is *estimated* by the formula of "
            "`crates/pe-target/src/area/mod.rs`, input and output registers included. The sequencer and the wiring are in none of "
            "ours; the paper's are whole networks.",
            "**Models.** The paper prints the wave equation and a few lines of the lung. The other right-hand sides and all "
            "parameter values are [reconstructions](../models/README.md) with the paper's number of states, topology, solver "
            "and step.",
            "**Numbers.** Ours: words of 32 bits and guard bits, one for 25x18 and 18x25, eight for 32x32; a binary point per "
            "value. Multiplier AxB: bits of data port x coefficient port; 25x18 and 18x25 are one DSP block per PE as in the paper, 32x32 four. Errors are the "
            "largest over all states and samples, relative to the state's largest magnitude, against the same step in double "
            "precision.",
            "**Atrial model.** The paper's row \"PE(219)\" has 309 DSPs and block RAMs and is taken as 309 PEs."):
        print("- " + wrapped_item(line))
    print()


def wrapped_item(text):
    lines, line = [], ""
    for word in text.split():
        if line and len(line) + 1 + len(word) > 118:
            lines.append(line)
            line = word
        else:
            line = f"{line} {word}" if line else word
    return "\n  ".join(lines + [line])


def table_one():
    path = f"{work}/pe/table1.txt"
    if not part("Table I: one PE by input ports and data memory", [path] if os.path.exists(path) else [], "pe"):
        return
    rows = []
    for numbers, features in shapes(path):
        own, imported, ports = (int(re.search(rf"{name} (\d+)", features)[1]) for name in ("own", "imported", "ports"))
        words, bits = re.search(r"(\d+) words of (\d+) bits", features).groups()
        lut, dsp, bram, clock = PAPER_PES[ports, own + imported]
        rows.append((ports, own + imported, lut, f"{numbers['LUT']:.0f}", f"{numbers['packed']:.0f}",
                     f"{numbers['memory']:.0f}", dsp, f"{numbers['DSP']:.0f}", bram, f"{numbers['BRAM']:g}", clock,
                     f"{words} x {bits}"))
    table(("ports", "data words", "LUT, paper", "LUT, measured", "packed", "of them memory", "DSP, paper", "DSP", "BRAM, paper", "BRAM",
           "MHz, paper", "program"), rows)
    paragraph("Multiplier 25x18, five right shifts, memory contents random so that nothing can be simplified away. Our data "
              "memory is counted as half own results (33 bits wide, with a copy for the operands) and half words from other "
              "PEs (25 bits); the paper's is one memory. The paper's port to itself is counted among its ports, ours has "
              "none. The program fills one block RAM. BRAM counts blocks of 36 kbit.")


def table_two(designs):
    if not part("Table II: four models, small and large designs", [d for d, _ in designs.values()], "cycles"):
        return
    rows = []
    for (model, pes), paper in PAPER.items():
        lut, dsp, bram, luts, cycles, clock, ms = paper
        rows.append((model, pes, "paper", lut, dsp, bram, luts, cycles, f"{clock} measured", ms, "", ""))
        for design in MULTIPLIERS + SMALLER:
            if (model, pes, design) in designs:
                rows.append((model, pes, design) + row_of_two(designs[model, pes, design][1][0]))
    table(("model", "PEs", "design", "LUT", "DSP", "BRAM", "equivalent LUTs", "cycles", "MHz", "ms per second", "error",
           "span of the error, s"), rows)
    paragraph(f"Our LUTs, DSPs and block RAMs are estimated, residuals under \"Area\". Equivalent LUTs are the paper's measure: "
              f"{LUTS_OF_DSP} per DSP, {LUTS_OF_BRAM} per block RAM of 36 kbit. \"ms per second\" is time per simulated second "
              "at that clock. Rows with `horner` and `sums` were compiled with that `--form`, which takes more cycles and less "
              "block RAM than the one that is chosen by default. The paper states no error for these designs.")


def row_of_two(report):
    area, clock = report["area"], report["clock"]
    bram = area["bram18"] / 2
    return (f"{area['lut']:.0f}", area["dsp"], f"{bram:g}", equivalent(area["lut"], area["dsp"], bram),
            report["cycles_per_step"], f"{clock['mhz']:g} {clock['basis']}", f"{report['time_per_simulated_second_ms']:.1f}",
            f"{report['error']['word_length']:.1e}", f"{report['span_s']:g}")


def same_area():
    """The fastest design of each sweep that is not larger than the paper's and fits its device."""
    folders = {model: f"{work}/same_area/{model}" for model, pes in PAPER if pes > 300
               and os.path.exists(f"{work}/same_area/{model}/points.csv")}
    if not part("The fastest design in the paper's area, at the paper's clock", folders.values(), "same_area"):
        return
    rows, ratios = [], []
    for (model, pes), (_, _, _, luts, cycles, clock, ms) in PAPER.items():
        if pes < 300 or model not in folders:
            continue
        rows.append((model, pes, "paper", luts, cycles, clock, ms, "", ""))
        with open(f"{folders[model]}/points.csv") as file:
            points = [point for point in csv.DictReader(file) if point["status"] == "compiled"]
        points = [point for point in points if float(point["equivalent_lut"]) <= luts
                  and all(float(point[key]) <= limit for key, limit in DEVICE.items())
                  and float(point["error_word_length"]) <= ERROR_LIMIT]
        if not points:
            rows.append((model, "", "none fits", "", "", "", "", "", ""))
            continue
        best = min(points, key=lambda point: (int(point["cycles_per_step"]), float(point["equivalent_lut"])))
        ours = int(best["cycles_per_step"]) / float(best["step_s"]) / clock / 1e3
        ratios.append(cycles / int(best["cycles_per_step"]))
        rows.append((model, best["pes"], best["multiplier"], f"{float(best['equivalent_lut']):.0f}", best["cycles_per_step"],
                     clock, f"{ours:.1f}", f"{float(best['error_word_length']):.1e}", f"{ratios[-1]:.2f}"))
    table(("model", "PEs", "design", "equivalent LUTs", "cycles", "MHz, the paper's", "ms per second", "error", "faster"), rows)
    mean = math.exp(sum(map(math.log, ratios)) / len(ratios))
    paragraph(f"Geometric mean: {mean:.2f} times the paper's speed at equal clock. Of the designs that a sweep over 12 numbers "
              "of PEs and two multipliers of one block finds (`explore`, spec's solver and step), the one with the fewest cycles "
              f"that has no more equivalent LUTs than the paper's largest, fits its XC6VLX240T and has an error of at most "
              f"{ERROR_LIMIT:.0e} (word length and coefficients together, over the spans of table II). Area is estimated.")


def case_study(designs):
    ours = {multiplier: designs["weibel11", 200, multiplier] for multiplier in MULTIPLIERS
            if ("weibel11", 200, multiplier) in designs}
    if not part("Case study: the lung on 200 PEs", [folder for folder, _ in ours.values()], "cycles"):
        return
    # Section 6.4 of the paper. "186 of the 768 DSPs" for 200 PEs of one DSP each is what it prints.
    rows = [("paper", 57586, 186, 372, equivalent(57586, 186, 372), 1590, "164 measured", "97.0", "2e-3", "10", "", "")]
    for multiplier, (_, (report, _)) in ours.items():
        rows.append((multiplier,) + row_of_two(report) + (report["connections"], report["max_in_degree"]))
    table(("design", "LUT", "DSP", "BRAM", "equivalent LUTs", "cycles", "MHz", "ms per second", "error",
           "span of the error, s", "connections", "most ports"), rows)
    paragraph("The paper's error is that of the first branch's volume, read from its figure 20 (\"within 0.2 %\"); ours is "
              "that of the worst of all states. Its PEs have 310 LUTs and 2 block RAMs on average: 1590 instructions need "
              "more than one.")


def figure_twenty():
    folders = sorted(glob.glob(f"{work}/figure20/*/"))
    folders = [folder for folder in folders if os.path.exists(f"{folder}report.json")]
    if not part("Figure 20: volume of the first branch over 10 s", folders, "figure20"):
        return
    rows = [("both", "paper", "2e-3", "", "", "", "")]
    for wave in ("square", "sine"):
        for multiplier in MULTIPLIERS:
            path = f"{work}/figure20/{wave}-{multiplier}"
            if os.path.exists(f"{path}/report.json"):
                report, timing = both(path)
                error = report["error"]
                rows.append((wave, multiplier, f"{error['outputs'][0]['word_length']:.1e}", f"{error['word_length']:.1e}",
                             f"`{error['worst_state']}`", f"{error['method']:.1e}", f"{timing['seconds']['runs']:.0f}"))
    table(("pressure", "design", "error of V[1]", "error of the worst of all states", "which", "method",
           "seconds of runs"), rows)
    for wave in ("square", "sine"):
        if os.path.exists(f"{work}/figure20/{wave}-25x18/report.json"):
            print(f"![volume of the first branch under a {wave} wave](figures/figure20_{wave}.svg)\n")
        else:
            print(f"The {wave} wave has not been measured.\n")
    paragraph("The pictures are those that `compile` draws with 25x18 multipliers: fixed point over double precision, and the "
              "difference. Model [weibel11_pressure](../models/weibel11_pressure): a pressure of 0 to 5 cmH2O at the mouth, "
              "100,000 steps of 0.1 ms. Amplitude, frequency and all parameters are ours, for the paper gives none; it "
              "compares with a floating-point program on a computer, of which it does not state step or precision. Errors are "
              "relative to the largest magnitude of the state over the 400 samples of the pictures.")


def designs_of(root):
    designs = {}
    for path in sorted(glob.glob(f"{work}/{root}/*/report.json")):
        folder = os.path.dirname(path)
        model, pes, *design = os.path.basename(folder).split("-")
        designs[model, int(pes), " ".join(design)] = (folder, both(folder))
    return designs


def cycles(designs):
    print("## Cycles per step and their bound\n")
    if not designs:
        return
    rows = []
    for (model, pes), paper in PAPER.items():
        for design in MULTIPLIERS + SMALLER:
            if (model, pes, design) in designs:
                report = designs[model, pes, design][1][0]
                count, bound, error = report["cycles_per_step"], report["bound_cycles"], report["error"]
                rows.append((model, pes, design, paper[4], count, f"{paper[4] / count:.1f}", bound, f"{count / bound:.3f}",
                             report["connections"], report["transfers_per_step"], f"{error['word_length']:.1e}",
                             f"{error['coefficient']:.1e}"))
    table(("model", "PEs", "design", "paper", "cycles", "paper / cycles", "bound", "cycles / bound", "connections",
           "transfers", "error", "coefficients alone"), rows)
    paragraph("From the designs of table II. The bound is the largest of products over PEs, the largest equation and the "
              "dependencies. Connections are pairs of PEs, transfers are words that arrive at another PE in a step.")


def compiler_time(designs):
    print("## Time of the compiler\n")
    if not designs:
        return
    rows = []
    for (model, pes), _ in PAPER.items():
        for multiplier in MULTIPLIERS:
            if (model, pes, multiplier) in designs:
                timing = designs[model, pes, multiplier][1][1]
                rows.append((model, pes, multiplier, f"{timing['seconds_without_runs']:.1f}",
                             f"{timing['seconds']['map']:.1f}", f"{timing['seconds']['runs']:.1f}",
                             f"{timing['double_ns_per_mac']:.1f}", f"{timing['fixed_ns_per_mac']:.1f}",
                             f"{timing['peak_memory_mb']:.0f}"))
    table(("model", "PEs", "multiplier", "seconds without runs", "of it mapping", "runs", "ns per product, double",
           "ns per product, fixed point", "MB"), rows)
    paragraph("From the designs of table II. \"Without runs\" is from spec to written files without the runs over the span, "
              "which judge ranges and errors. Wall time on two cores that other work may have shared. The paper reports 62 to "
              "277 minutes, FPGA implementation included.")


def errors():
    found = {path.split("/")[-2].split("-")[1]: os.path.dirname(path) for path in glob.glob(f"{work}/errors/*/report.json")}
    if not part("Error of weibel11 over its whole span", found.values(), "errors"):
        return
    rows = []
    for multiplier, limit in (("32x32", "1e-5"), ("25x18", "3e-4"), ("18x25", "")):
        if multiplier in found:
            report, timing = both(found[multiplier])
            error = report["error"]
            rows.append((multiplier, report["word"]["dsp_per_pe"], f"{report['span_s']:g}", f"{error['word_length']:.1e}",
                         f"{error['coefficient']:.1e}", limit, f"`{error['worst_state']}`", f"{error['method']:.1e}",
                         f"{error['input_hold']:.1e}", f"{timing['seconds']['runs']:.0f}"))
    table(("multiplier", "DSP per PE", "span s", "error", "coefficients alone", "goal", "worst state", "method",
           "input hold", "seconds of runs"), rows)


def area(designs):
    found = sorted(glob.glob(f"{work}/area/*-*-*.txt"))
    if not part("Area", found, "area"):
        return
    print("Every shape of PE that the design instantiates, with its generics and its program memory\n"
          "(`cargo run -p xtask -- measure-area`). BRAM counts blocks of 36 kbit.\n")
    for path in found:
        model, pes, multiplier = os.path.basename(path)[:-4].rsplit("-", 2)
        pes = int(pes)
        rows_of_file = shapes(path)
        shown = ("LUT", "packed", "logic", "memory", "FF", "DSP", "BRAM")
        mean = {name: sum(row["PEs"] * row[name] for row, _ in rows_of_file) / pes for name in shown}
        assert sum(row["PEs"] for row, _ in rows_of_file) == pes, path
        rows = []
        if (model, pes) in PAPER:
            lut, dsp, bram = PAPER[model, pes][:3]
            rows.append(("paper", f"{lut / pes:.0f}", "", "", "", "", f"{dsp / pes:.0f}", f"{bram / pes:.1f}"))
        rows.append((f"measured, {len(rows_of_file)} shapes", *(f"{mean[name]:.1f}" for name in shown)))
        if (model, pes, multiplier) in designs:
            folder, (report, _) = designs[model, pes, multiplier]
            estimate = report["area"]
            rows.append((f"estimated at commit {commits([folder])}", f"{estimate['lut'] / pes:.1f}", "", "", "",
                         f"{estimate['ff'] / pes:.1f}", f"{estimate['dsp'] / pes:.1f}", f"{estimate['bram18'] / 2 / pes:.1f}"))
        print(f"**{model}, {pes} PEs, {multiplier}**, mean per PE:\n")
        table(("",) + shown, rows)
        most = sorted(rows_of_file, key=lambda shape: -shape[0]["PEs"])[:12]
        rows = [(*(f"{row[name]:g}" for name in ("PEs",) + shown), features) for row, features in most]
        print("The twelve most frequent shapes:\n")
        table(("PEs",) + shown + ("features",), rows)
    residuals = f"{work}/area/residuals.txt"
    if os.path.exists(residuals):
        line = re.search(r"residuals: (.*)", open(residuals).read())
        if line:
            paragraph(f"Estimate against synthesis ([area model](area-model.md)), LUTs: {line[1]}; commit "
                      f"{commits([residuals])}.")


def verify():
    found = sorted(glob.glob(f"{work}/verify/*.txt"), key=lambda path: ("-" in os.path.basename(path), path))
    if not part("Bit-exact comparison", found, "verify"):
        return
    rows = []
    for path in found:
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
            rows.append((name, report["pes"], engine, steps, writes, outputs, f"{bits / 1e6:.2f} M", seconds, commits([path])))
    table(("design", "PEs", "engine", "steps", "words", "outputs", "bits", "seconds, all engines", "commit"), rows)
    paragraph("`pe-synth verify` with the 25x18 multiplier, every memory write and output equal to the simulator's: from the "
              "initial values, and once more from the state in the middle of the span. Steps are per start, words are the "
              "memory writes of both; bits are words times their width, 40 in own and 25 in imported memories, and outputs. "
              "Seconds are wall time of the whole command, compilers and reading of the design included.")


def main():
    global work
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    work = sys.argv[1]
    designs = designs_of("designs")
    introduction()
    table_one()
    table_two(designs)
    same_area()
    case_study(designs)
    figure_twenty()
    cycles(designs)
    compiler_time(designs)
    errors()
    area(designs)
    verify()


if __name__ == "__main__":
    main()
