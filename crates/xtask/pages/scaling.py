#!/usr/bin/env python3
"""Measures what compiling takes as models grow, and writes docs/scaling.md.

    cargo run -p xtask -- scaling [PART ...]        parts: paper, hundred, growth, million; default: all

`paper` compiles the four models of the paper, `hundred` 100,000 ODEs on 1024 PEs in three shapes, `growth` the same
shapes in several sizes, `million` a chain of 1,000,000 ODEs. All stages but the runs over the span, which take as long
as the span is: here ten steps. Times are processor seconds, memory is the largest resident set, both from
`report-timing.json`. Rows of parts that are not asked for are kept. Needs cargo; $PE_SYNTH names a binary to use in
place of building one. One compilation at a time, output in a temporary folder ($TMPDIR), of several GB for `million`.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from common import ROOT, built

PAGE = ROOT / "docs/scaling.md"
STAGES = ["read", "step", "map", "schedule", "assemble", "check", "write", "draw"]
# Shape, model, step, and how many ODEs a value of its size constant gives.
SHAPES = {
    "wave": ("wave80", "n", "22us", lambda n: n * n),
    "chain": ("lutchen4000", "n", "100us", lambda n: n),
    "tree": ("weibel11", "generations", "1us", lambda n: 2 * (2**n - 1)),
}


def case(shape, size, pes):
    model, constant, step, _ = SHAPES[shape]
    return shape, model, ["--set", f"{constant}={size}", "--pes", str(pes), "--step", step, "--span", times(step, 10)]


def times(step, count):
    return f"{int(step.removesuffix('us')) * count}us"


def paper(model, pes, step):
    return model, model, ["--pes", str(pes), "--step", step, "--span", times(step, 10)]


PARTS = {
    "paper": (
        "The models of the paper",
        [paper("weibel11", 64, "100us"), paper("weibel11", 396, "100us"),
         paper("lutchen4000", 63, "100us"), paper("lutchen4000", 397, "100us"),
         paper("wave80", 63, "22us"), paper("wave80", 380, "22us"),
         paper("atrial15", 63, "100us"), paper("atrial15", 309, "100us")],
    ),
    "hundred": (
        "100,000 ODEs on 1024 PEs",
        [case("wave", 320, 1024), case("chain", 100000, 1024), case("tree", 16, 1024)],
    ),
    "growth": (
        "Growth",
        [case("wave", 32, 16), case("wave", 100, 128), case("wave", 320, 1024),
         case("chain", 1000, 16), case("chain", 10000, 128), case("chain", 100000, 1024),
         case("tree", 9, 16), case("tree", 12, 128), case("tree", 16, 1024)],
    ),
    "million": ("1,000,000 ODEs", [case("chain", 1000000, 4096)]),
}


def measure(binary, shape, model, options):
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "design"
        # What a long step does to the result is of no interest here.
        command = [binary, "compile", f"models/{model}/{model}.spec", *options, "--allow", "E0903", "--quiet"]
        subprocess.run([*command, "-o", str(target)], cwd=ROOT, check=True, stderr=subprocess.DEVNULL)
        report = json.loads((target / "report.json").read_text())
        timing = json.loads((target / "report-timing.json").read_text())
        written = sum(file.stat().st_size for file in target.rglob("*") if file.is_file())
    seconds = timing["processor_seconds"]
    cells = [shape, f"{report['odes']:,}", f"{report['pes']}", f"{report['cycles_per_step']}"]
    cells.append(f"{report['cycles_per_step'] / report['bound_cycles']:.3f}")
    cells.append(f"**{timing['processor_seconds_without_runs']:.1f}**")
    cells += [f"{seconds.get(stage, 0):.1f}" for stage in STAGES]
    cells += [f"{timing['peak_memory_mb']:,.0f}", f"{written / 1e6:,.0f}"]
    return "| " + " | ".join(cells) + " |", " ".join(["pe-synth compile", f"models/{model}/{model}.spec", *options])


def section(binary, title, cases):
    columns = ["model", "ODEs", "PEs", "cycles", "of bound", "seconds", *STAGES, "MiB", "files, MB"]
    lines = [f"## {title}", "", "| " + " | ".join(columns) + " |", "|---" * len(columns) + "|"]
    commands = []
    for shape, model, options in cases:
        row, command = measure(binary, shape, model, options)
        print(row, file=sys.stderr, flush=True)
        lines.append(row)
        commands.append(command)
    return "\n".join([*lines, "", "```sh", *commands, "```", ""])


def main():
    parts = sys.argv[1:] or list(PARTS)
    unknown = [part for part in parts if part not in PARTS]
    if unknown:
        sys.exit(f"unknown part {unknown[0]}; known: {' '.join(PARTS)}")
    binary = built()
    page = PAGE.read_text()
    for part in parts:
        title, cases = PARTS[part]
        begin, end = f"<!-- {part} -->\n", f"<!-- end of {part} -->\n"
        before, rest = page.split(begin)
        _, after = rest.split(end)
        page = before + begin + section(binary, title, cases) + end + after
        PAGE.write_text(page)


main()
