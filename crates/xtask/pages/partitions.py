#!/usr/bin/env python3
"""Holds the mapper against METIS: connections x cycles, every mapping through the same scheduler.

    cargo run -p xtask -- partitions [MODEL:PES ...]

Builds the example `partitions` of pe-synth, or takes $PARTITIONS, and needs `pymetis` 2025.2.2 from PyPI. METIS gets
the ODE-dependency graph with the loads as weights and an imbalance of 0.5 %, and is run k-way, recursive and
contiguous with ten seeds each; the best of the thirty counts, in-degrees above 15 allowed. Our own mapping is the one
that `compile` takes with seed 1; the random start, alone and with regions cut anew, is the mean of five seeds. Takes
some minutes.
"""

import math
import subprocess
import sys
import tempfile
from pathlib import Path

import pymetis

from common import ROOT, built

CASES = [
    ("weibel11", 64), ("weibel11", 396), ("lutchen4000", 63), ("lutchen4000", 397),
    ("wave80", 63), ("wave80", 380), ("atrial15", 63), ("atrial15", 309),
]
METHODS = {"k-way": (False, {}), "recursive": (True, {}), "contiguous": (False, {"contig": True})}
METIS_SEEDS = range(1, 11)
OWN_SEEDS = 5
# Schedules that are this much longer than the shortest are not taken, as in pe-synth.
TOLERANCE = 1.02


def partitions(program, spec, pes, folder):
    """Writes the partitions of METIS and gives their files."""
    text = subprocess.run([program, spec, str(pes)], check=True, capture_output=True, text=True).stdout
    rows = [[int(word) for word in line.split()] for line in text.splitlines()[1:]]
    weights = [row[0] for row in rows]
    adjacency = [[node - 1 for node in row[1:]] for row in rows]
    files = []
    for name, (recursive, how) in METHODS.items():
        for seed in METIS_SEEDS:
            options = pymetis.Options(seed=seed, ufactor=5, **how)
            _, parts = pymetis.part_graph(
                pes, adjacency=adjacency, vweights=weights, options=options, recursive=recursive)
            file = Path(folder) / f"{name}-{seed}.txt"
            file.write_text("".join(f"{part}\n" for part in parts))
            files.append(str(file))
    return files


def main():
    cases = [(case.split(":")[0], int(case.split(":")[1])) for case in sys.argv[1:]] or CASES
    program = built("PARTITIONS", "examples/partitions", "--example", "partitions")
    print("| model, PEs | bound | own mapping: cycles, connections | its start | METIS: cycles, connections | its kind "
          "| ratio | random start / best | regions / best |")
    print("|---|---|---|---|---|---|---|---|---|")
    ratios, starts = [], {"random": [], "regions": []}
    for model, pes in cases:
        spec = str(ROOT / "models" / model / f"{model}.spec")
        with tempfile.TemporaryDirectory() as folder:
            files = partitions(program, spec, pes, folder)
            command = [program, spec, str(pes), str(OWN_SEEDS), *files]
            text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        rows = [line.split() for line in text.splitlines()]
        bound = int(rows[0][6])
        rows = [(row[0], row[1], int(row[4]), int(row[6])) for row in rows[1:]]
        product = lambda row: row[2] * row[3]
        metis = min((row for row in rows if row[0] in METHODS), key=product)
        own = [row for row in rows if row[0] not in METHODS]

        def taken(seed):
            mine = [row for row in own if row[1] == str(seed)]
            shortest = min(row[3] for row in mine)
            return min((row for row in mine if row[3] <= TOLERANCE * shortest), key=product)

        best = taken(1)
        ratios.append(product(best) / product(metis))
        for start, means in starts.items():
            of_start = [product(row) / product(taken(row[1])) for row in own if row[0] == start]
            means.append(sum(of_start) / len(of_start))
        print(f"| {model}, {pes} | {bound} | {best[3]}, {best[2]} | {best[0]} | {metis[3]}, {metis[2]} | {metis[0]} "
              f"| {ratios[-1]:.2f} | {starts['random'][-1]:.2f} | {starts['regions'][-1]:.2f} |", flush=True)
    mean = lambda values: math.exp(sum(map(math.log, values)) / len(values))
    means = " | ".join(f"{mean(of_start):.3f}" for of_start in starts.values())
    print(f"| geometric mean | | | | | | {mean(ratios):.3f} | {means} |")


if __name__ == "__main__":
    main()
