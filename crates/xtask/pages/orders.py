#!/usr/bin/env python3
"""Compares the order of elimination that the compiler finds with others, on five sparse systems; see
decisions/0067-linear-systems.md.

    cargo run -p xtask -- orders [RANDOM]       RANDOM: random orders of each system, 1000 unless given

Every order is compiled as the natural one of a system whose rows are exchanged. Prints cycles per step: of the compiler's
own order, of minimum degree (SuperLU's, by SciPy), nested dissection, cyclic reduction, and the best random one. Exit code
4: the compiler's order takes more than 1.1 times the fewest cycles. $PE_SYNTH names a binary to use in place of building
one.
"""

import json
import os
import random
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from common import built

LIMIT = 1.1
PES = "4"


def systems():
    """Pairs of rows that are coupled, by the name of the system, with its number of rows."""
    tree = [(node, (node - 1) // 2) for node in range(1, 31)]
    grid = [(6 * row + column, 6 * (row + down) + column + right) for row in range(6) for column in range(6)
            for down, right in ((0, 1), (1, 0)) if row + down < 6 and column + right < 6]
    ring = [(node, (node + 1) % 28) for node in range(28)] + [(node, node + 14) for node in range(0, 14, 4)]
    bordered = [(node, node + 1) for node in range(27)] + [(node, last) for last in (28, 29) for node in range(0, 28, 3)]
    choice = random.Random(7)
    scattered = {tuple(sorted(choice.sample(range(26), 2))) for _ in range(34)}
    return {"tree": (31, tree), "grid": (36, grid), "ring": (28, ring), "bordered": (30, bordered),
            "scattered": (26, sorted(scattered))}


def spec(rows, pairs, order):
    """The spec of a system whose rows stand in an order."""
    place = {row: position + 1 for position, row in enumerate(order)}
    lines = ["model system", "solver rk4", "step 1 ms", "span 5 ms", f"index i in 1..{rows}, j in 1..{rows}",
             "state c = 1", "state s = 0.2", "c' = -s", "s' = c", "matrix T[i, j] symmetric"]
    for one, other in pairs:
        high, low = sorted((place[one], place[other]), reverse=True)
        lines.append(f"T[{high}, {low}] = {0.2 + 0.01 * one}*c + {0.1 + 0.01 * other}*s")
    lines += [f"T[{place[row]}, {place[row]}] = {4 + 0.1 * row} + {0.5 + 0.01 * row}*c" for row in range(rows)]
    lines += [f"b[{place[row]}] = {1 + 0.1 * row}*s + 1" for row in range(rows)]
    return "\n".join(lines + ["x = solve(T, b)", "output x", ""])


def cycles(program, text, elimination=()):
    """Cycles per step of a spec."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "system.spec"
        path.write_text(text)
        command = [program, "compile", path, "--pes", PES, "--tries", "2000", "-o", Path(folder) / "out", *elimination]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            sys.exit(f"{' '.join(map(str, command))}\n{done.stderr}")
        return json.loads((Path(folder) / "out/report.json").read_text())["cycles_per_step"]


def minimum_degree(rows, pairs):
    """SuperLU's order of minimum degree."""
    matrix = 10 * numpy.eye(rows)
    for one, other in pairs:
        matrix[one, other] = matrix[other, one] = 1
    factors = splu(csc_matrix(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0, options={"SymmetricMode": True})
    return list(numpy.argsort(factors.perm_c))


def main():
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    program = os.environ.get("PE_SYNTH") or built()
    print("| system | rows | compiler | minimum degree | nested dissection | cyclic reduction | best of random | ratio |")
    print("|---|---|---|---|---|---|---|---|")
    failed = False
    for name, (rows, pairs) in systems().items():
        natural = list(range(rows))
        text = spec(rows, pairs, natural)
        own = cycles(program, text)
        degree = cycles(program, spec(rows, pairs, minimum_degree(rows, pairs)), ["--elimination", "natural"])
        dissection = cycles(program, text, ["--elimination", "dissection"])
        cyclic = cycles(program, text, ["--elimination", "depth"])
        choice = random.Random(1)
        orders = [choice.sample(natural, rows) for _ in range(count)]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            one = lambda order: cycles(program, spec(rows, pairs, order), ["--elimination", "natural"])
            best = min(pool.map(one, orders), default=None)
        others = [figure for figure in (degree, dissection, cyclic, best) if figure]
        ratio = own / min(others)
        failed |= ratio > LIMIT
        print(f"| {name} | {rows} | {own} | {degree} | {dissection} | {cyclic} | {best} | {ratio:.2f} |", flush=True)
    sys.exit(4 if failed else 0)


if __name__ == "__main__":
    main()
