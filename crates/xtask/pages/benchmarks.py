#!/usr/bin/env python3
"""Measures the stages of a compilation with Criterion and writes docs/benchmarks.md.

    cargo run -p xtask -- benchmarks [--keep]       --keep: takes what `cargo bench` measured last in place of measuring

Needs cargo. Some minutes; other work on the machine shows in the intervals.
"""

import json
import subprocess
import sys

from common import ROOT, TARGET

PAGE = ROOT / "docs/benchmarks.md"
# Stage, what it is, and what its throughput counts.
STAGES = [
    ("parse", "spec to flat model", "equations"),
    ("step", "model to step graph", "equations"),
    ("map", "all starts and their annealing", "equations"),
    ("schedule", "one mapping", "equations"),
    ("assemble", "control words and images", "equations"),
    ("emit", "all files, in memory", "equations"),
    ("double", "the step graph in double precision", "products"),
    ("fixed", "the step graph in fixed point", "products"),
    ("simulate", "the program, clock by clock, checksums on", "PE-cycles"),
    ("runs", "formats and errors over ten steps", "products"),
    ("end to end", "spec to program, runs over ten steps included", "equations"),
]
HEAD = """# Benchmarks

Written by `cargo run -p xtask -- benchmarks`, which runs `cargo bench` (Criterion, release build, one process). The
times are medians with Criterion's interval of 95 %; those below were measured on two loaded cores, which costs up to a
factor of two. The models are two of the paper's, with 25x18 multipliers: `weibel11` on 64 PEs, 4,094 affine equations,
and `atrial15` on 63 PEs, 3,375 cubic ones. [scaling.md](scaling.md) has whole compilations of larger models, with their
memory.

To profile a compiler stage by function: release builds keep line tables, so `perf record --call-graph dwarf
target/release/deps/stages-* --bench --profile-time 10 schedule/weibel11` works as it is.

| stage | model | median | 95 % interval | throughput |
|---|---|---|---|---|
"""


def duration(nanoseconds):
    for unit, size in (("s", 1e9), ("ms", 1e6), ("µs", 1e3)):
        if nanoseconds >= size:
            return f"{nanoseconds / size:.3g} {unit}"
    return f"{nanoseconds:.3g} ns"


def row(folder, stage, what, unit):
    model = folder.name
    median = json.loads((folder / "new/estimates.json").read_text())["median"]
    amount = json.loads((folder / "new/benchmark.json").read_text())["throughput"]["Elements"]
    time = median["point_estimate"]
    interval = median["confidence_interval"]
    rate = amount / time * 1e9
    scaled = f"{rate / 1e6:.3g} million" if rate >= 1e6 else f"{rate / 1e3:.3g} thousand"
    bounds = f"{duration(interval['lower_bound'])} .. {duration(interval['upper_bound'])}"
    return f"| {stage}: {what} | {model} | {duration(time)} | {bounds} | {scaled} {unit}/s |\n"


def main():
    if "--keep" not in sys.argv[1:]:
        subprocess.run(["cargo", "bench", "-p", "pe-synth", "--bench", "stages"], cwd=ROOT, check=True)
    measured = TARGET / "criterion"
    rows = ""
    for stage, what, unit in STAGES:
        folders = sorted(path for path in (measured / stage.replace(" ", "_")).glob("*") if (path / "new").is_dir())
        folders = folders or sorted(path for path in (measured / stage).glob("*") if (path / "new").is_dir())
        if not folders:
            sys.exit(f"Criterion has measured nothing of stage {stage}")
        rows += "".join(row(folder, stage, what, unit) for folder in folders)
    PAGE.write_text(HEAD + rows)


main()
