#!/usr/bin/env python3
"""One test program on everything that can run the designs of the loops in models/hil_*: the table of differing integers.

    testbenches/loops.py FOLDER [--steps N] [--on NAME,...]

Inputs change in every step, from random numbers and from the outputs before, so that what differs once differs on. Each
design is compiled, wrapped with streams and packed as FMU; each column counts the words of outputs, of all steps, that are
not those of `model`. Needs pe_synth and fmpy (testbenches/test-all.sh installs them), rustc, GHDL and Verilator; $PE_SYNTH
names a binary.
"""

import argparse
import json
import random
import subprocess
import sys
from pathlib import Path

from pe_synth import host as hosts
from fmu import PE_SYNTH, ROOT, Unit, outputs_of

DESIGNS = ["hil_motor", "hil_motor_pid", "hil_pendulum", "hil_pendulum_control", "hil_filter"]
COLUMNS = ["model", "fast", "clocked", "ghdl", "verilator", "ghdl, frames", "verilator, frames", "FMI 2.0", "FMI 3.0"]


def built(folder, name):
    run = lambda *command: subprocess.run([PE_SYNTH, *map(str, command)], check=True)
    run("compile", ROOT / f"models/{name}/{name}.spec", "--host", "restart,states,flags", "-q", "--no-pictures", "-o", folder)
    run("wrap", folder, "--stream", "--quiet")
    run("fmu", folder, "--quiet")
    return json.loads((folder / f"{name}_map.json").read_text())


class Program:
    """Words of the inputs of each step: now and then a wide jump, else small ones, which leave controllers unclamped."""

    def __init__(self, design):
        self.random = random.Random(7)
        self.limits = [(low // 2, high // 2) for low, high in (port["words"] for port in design["inputs"])]
        self.steps = 0

    def inputs(self, outputs):
        fed = sum(word or 0 for word in outputs) >> 3
        narrow = 0 if self.steps % 25 == 0 else 4 + self.steps % 9
        self.steps += 1
        return [min(max(self.random.randint(low, high) // 2 + fed, low), high) >> narrow for low, high in self.limits]


def by_host(folder, design, transport, steps):
    program, seen = Program(design), []
    with hosts.open(folder, transport, timeout=60.0) as host:
        words = host.read_words()
        for _ in range(steps):
            words = host.exchange_words(program.inputs(words))
            seen.append(words)
    return seen


def by_frames(folder, transport, frames):
    with hosts.open(folder, transport, timeout=60.0) as host:
        return host.run_frames_words(frames)


def by_fmu(path, design, steps):
    program, seen, unit = Program(design), [], Unit(path)
    names = outputs_of(design)
    words = unit.words(names)
    for _ in range(steps):
        inputs = program.inputs(words)
        unit.set([port["name"] for port in design["inputs"]], [word * 2.0 ** port["exponent"] for word, port in zip(inputs, design["inputs"])])
        unit.step(design["step"])
        words = unit.words(names)
        seen.append(words)
    unit.close()
    return seen


def frames_of(design, seen, first):
    """The inputs that the program gave."""
    program, frames, words = Program(design), [], first
    for shown in seen:
        frames.append(program.inputs(words))
        words = shown
    return frames


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--on", default=",".join(DESIGNS), help="designs, separated by commas")
    options = parser.parse_args()
    print("| design | integers | " + " | ".join(COLUMNS[1:]) + " |\n|" + "---|" * (len(COLUMNS) + 1), flush=True)
    failed = False
    for name in options.on.split(","):
        folder = options.folder / name
        design = built(folder, name)
        wanted = by_host(folder, design, "model", options.steps)
        with hosts.open(folder, "model") as host:
            frames = frames_of(design, wanted, host.read_words())
        changes = sum(a != b for a, b in zip(wanted, wanted[1:]))
        counts = []
        for column in COLUMNS[1:]:
            kind = column.split(",")[0]
            if column.startswith("FMI"):
                seen = by_fmu(folder / f"{name}_fmi{column[4]}.fmu", design, options.steps)
            elif column.endswith("frames"):
                seen = by_frames(folder, kind, frames)
            else:
                seen = by_host(folder, design, kind, options.steps)
            short = abs(len(wanted) - len(seen)) * len(design["outputs"])
            counts.append(short + sum(a != b for row, other in zip(wanted, seen) for a, b in zip(row, other)))
        print(f"| {name} | {options.steps * len(design['outputs'])} | " + " | ".join(map(str, counts)) + " |", flush=True)
        if changes < options.steps // 2:
            print(f"loops.py: {name}: outputs change in {changes} of {options.steps} steps, too few to compare", file=sys.stderr)
        failed |= any(counts) or changes < options.steps // 2
    sys.exit(failed)


if __name__ == "__main__":
    main()
