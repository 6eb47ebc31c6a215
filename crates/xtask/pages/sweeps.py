#!/usr/bin/env python3
"""How long sweeps take, and how well that is told; see decisions/0083-time-of-sweeps.md.

    cargo run -p xtask -- sweeps FOLDER [MODEL]...

Runs `explore` on each model twice: as it is, and with `--max-error any`, which designs every point. Prints the time told
before and after a tenth of the sweep, the real one, and the processor time of both. $PE_SYNTH names a binary to use in
place of building one; if $PE_BEFORE names an older one, its processor time stands beside.
"""

import os
import re
import resource
import subprocess
import sys
import time

from common import ROOT, built

MODELS = {
    "models/pump_station/pump_station.spec": [],
    "models/validation/hires.spec": [],
    "models/hodgkin_huxley/hodgkin_huxley.spec": [],
    "models/lutchen_breathing/lutchen_breathing.spec": [],
    "models/weibel5/weibel5.spec": [],
    "models/mapk_cascade/mapk_cascade.spec": ["--set", "levels=3"],
}

UNITS = {"s": 1, "min": 60, "h": 3600}
TIME = r"([\d.]+) (s|min|h)"


def sweep(program, spec, target, *options):
    """What it told, none if it failed, its wall time and its processor time in seconds."""

    def used():
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    before, clock = used(), time.monotonic()
    command = [program, "explore", spec, "-o", target, *options]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    return run.stderr if run.returncode == 0 else None, time.monotonic() - clock, used() - before


def seconds(match):
    return sum(float(number) * UNITS[unit] for number, unit in re.findall(TIME, match)) if match else None


def main(folder, *models):
    program, older = built(), os.environ.get("PE_BEFORE")
    print("| model | points | told before, s | told after a tenth, s | real, s | told / real | processor time, s", end=" | ")
    print("of all points, s | ratio |" + (" before, s | ratio |" if older else ""))
    print("|---" * (11 if older else 9) + "|")
    for spec in models or MODELS:
        name = os.path.splitext(os.path.basename(spec))[0]
        options = MODELS.get(spec, [])
        spec, target = str(ROOT / spec), os.path.join(folder, name)
        told, real, used = sweep(program, spec, target, *options)
        _, _, whole = sweep(program, spec, target + "_any", "--max-error", "any", *options)
        points = re.search(r"(\d+) points =", told)
        before = seconds(re.search(rf"about {TIME} on", told)[0])
        tenth = re.search(rf"points after {TIME}; about {TIME} to go", told)
        tenth = seconds(tenth[0]) if tenth else None
        ratio = f"{tenth:.1f} | {real:.1f} | {tenth / real:.2f}" if tenth else f"- | {real:.1f} | -"
        row = f"| {name} | {points[1]} | {before:.1f} | {ratio} | {used:.1f} | {whole:.1f} | {used / whole:.2f} |"
        if older:
            known, _, then = sweep(older, spec, target + "_before", *options)
            row += f" {then:.1f} | {used / then:.2f} |" if known else " - | - |"
        print(row, flush=True)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(*sys.argv[1:])
