#!/usr/bin/env python3
"""Processor time of `check` against that of `compile`; see decisions/0027-check.md.

    cargo run -p xtask -- check-cost FOLDER [MODEL]...

Runs both commands in turn on each model, three times, and prints the least processor time of each and their ratio. Without
models, all of models/ and models/validation but the largest. $PE_SYNTH names a binary to use in place of building one.
"""

import os
import resource
import subprocess
import sys

from common import ROOT, built

LARGE = {"weibel11", "weibel11_pressure", "weibel11_square", "lutchen4000", "wave80", "atrial15"}


def specs():
    for folder in sorted(os.listdir(ROOT / "models")):
        if folder not in LARGE and (ROOT / f"models/{folder}/{folder}.spec").exists():
            yield str(ROOT / f"models/{folder}/{folder}.spec")
    for name in sorted(os.listdir(ROOT / "models/validation")):
        if name.endswith(".spec"):
            yield str(ROOT / f"models/validation/{name}")


def seconds(program, *command):
    def used():
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    before = used()
    done = subprocess.run([program, *command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)
    return used() - before, done.returncode


def main(folder, *models):
    program = built()
    print("| model | compile, s | check, s | ratio |")
    print("|---|---|---|---|")
    worst = (0, "")
    for spec in models or specs():
        name = os.path.splitext(os.path.basename(spec))[0]
        compiles, checks = [], []
        for _ in range(3):
            compiles.append(seconds(program, "compile", spec, "-q", "-o", os.path.join(folder, name)))
            checks.append(seconds(program, "check", spec))
        (compiled, code), (checked, _) = min(compiles), min(checks)
        refused = " (refused)" if code else ""
        print(f"| {name}{refused} | {compiled:.3f} | {checked:.3f} | {checked / compiled:.2f} |", flush=True)
        if not code:
            worst = max(worst, (checked / compiled, name))
    print(f"\nworst: {worst[1]}, {worst[0]:.2f}")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(*sys.argv[1:])
