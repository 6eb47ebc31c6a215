#!/usr/bin/env python3
"""Processor time of `check` against that of `compile`; see decisions/0027-check.md.

    docs/check-cost.py FOLDER [MODEL]...

Runs both commands in turn on each model, three times, and prints the least processor time of each and their ratio. Without
models, all of models/ and models/validation but the largest. $PE_SYNTH is the binary, default target/release/pe-synth.
"""

import os
import resource
import subprocess
import sys

PE_SYNTH = os.environ.get("PE_SYNTH", "target/release/pe-synth")
LARGE = {"weibel11", "weibel11_pressure", "weibel11_square", "lutchen4000", "wave80", "atrial15"}


def specs():
    for folder in sorted(os.listdir("models")):
        if folder not in LARGE and os.path.exists(f"models/{folder}/{folder}.spec"):
            yield f"models/{folder}/{folder}.spec"
    for name in sorted(os.listdir("models/validation")):
        if name.endswith(".spec"):
            yield f"models/validation/{name}"


def seconds(*command):
    def used():
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    before = used()
    done = subprocess.run([PE_SYNTH, *command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)
    return used() - before, done.returncode


def main(folder, *models):
    print("| model | compile, s | check, s | ratio |")
    print("|---|---|---|---|")
    worst = (0, "")
    for spec in models or specs():
        name = os.path.splitext(os.path.basename(spec))[0]
        compiles, checks = [], []
        for _ in range(3):
            compiles.append(seconds("compile", spec, "-q", "-o", os.path.join(folder, name)))
            checks.append(seconds("check", spec))
        (compiled, code), (checked, _) = min(compiles), min(checks)
        refused = " (refused)" if code else ""
        print(f"| {name}{refused} | {compiled:.3f} | {checked:.3f} | {checked / compiled:.2f} |", flush=True)
        if not code:
            worst = max(worst, (checked / compiled, name))
    print(f"\nworst: {worst[1]}, {worst[0]:.2f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
