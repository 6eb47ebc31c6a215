#!/usr/bin/env python3
"""Prints docs/baseline.md from the figures that xtask baseline has measured.

    crates/xtask/pages/baseline.py FOLDER GCC        FOLDER: one MODEL.json per model, GCC: the compiler's name and version

Exit code 4: a program computes something else than the compiler's own run, or a generated one is slower.
"""

import json
import sys
from pathlib import Path

# Largest error of a program in double precision, relative to the largest magnitudes; of one in single precision.
LARGEST = {"double": 1e-12, "single": 1e-3}
MODELS = ["weibel11", "lutchen4000", "wave80", "atrial15"]
HEAD = """# The native program against plain C

Written by `cargo run -p xtask -- baseline`. `pe-synth bench` compares the hardware with a program that is generated for
the model; here that program is compared with hand-written C loops, which are in
[baseline](../crates/xtask/pages/baseline): the same method and step, precomputed reciprocals, loops that the compiler
can vectorise, no tricks.

- C: {gcc}, `-O3 -march=native`. Generated: {kernel}, `-C opt-level=3 -C target-cpu=native`, with vectors of 256 or of
  512 bits, whichever is faster.
- All on one core, in turn; the fastest of {repetitions} repetitions counts. Absolute times are those of this loaded
  machine; only the ratio can be compared.
- **error**: largest deviation of a state after the run from the compiler's own run in double precision, relative to its
  largest magnitude.
- **arithmetic** and **memory**: share of a core's peak that the generated program reaches, measured with products and
  sums in registers, and with `z = x + a y` on as much memory as a step uses. A loop that hits a closer cache exceeds
  100 % of memory.

| model | precision | C us/step | generated us/step | ratio | error of C | of generated | bits | arithmetic | memory |
|---|---|---|---|---|---|---|---|---|---|
"""


def main():
    folder, gcc = Path(sys.argv[1]), sys.argv[2]
    rows, failed, computer = "", False, {}
    for model in MODELS:
        computer = json.loads((folder / f"{model}.json").read_text())["computer"]
        for precision in ("double", "single"):
            runs = [run for run in computer["runs"] if run["precision"] == precision and run["cores"] == 1]
            own = next(run for run in runs if run["program"] is None)
            rival = next(run for run in runs if run["program"] is not None)
            ratio = rival["generated_takes"]
            failed |= ratio > 1 or max(own["error"], rival["error"]) > LARGEST[precision]
            rows += (f"| {model} | {precision} | {rival['us_per_step']:.2f} | {own['us_per_step']:.2f} | {ratio:.2f} "
                     f"| {rival['error']:.0e} | {own['error']:.0e} | {own['vector_bits']} "
                     f"| {own['of_arithmetic']:.0%} | {own['of_memory']:.0%} |\n")
    kernel = computer["kernel"].removeprefix("Rust generated for the model, ")
    sys.stdout.write(HEAD.format(gcc=gcc, kernel=kernel, repetitions=computer["repetitions"]) + rows)
    return 4 if failed else 0


sys.exit(main())
