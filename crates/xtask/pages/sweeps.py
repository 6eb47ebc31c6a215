#!/usr/bin/env python3
"""How long sweeps take, and how well that is told; see decisions/0083-time-of-sweeps.md.

    cargo run -p xtask -- sweeps FOLDER [MODEL]...

Runs `explore` on each model twice: as it is, and with `--max-error any`, which designs every point. Prints the time told
before and after a tenth of the sweep, the real one, and the processor time of both. $PE_SYNTH names a binary to use in
place of building one.
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
}

UNITS = {"s": 1, "min": 60, "h": 3600}
TIME = r"([\d.]+) (s|min|h)"


def sweep(program, spec, target, *options):
    """What it told, its wall time and its processor time in seconds."""

    def used():
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    before, clock = used(), time.monotonic()
    command = [program, "explore", spec, "-o", target, *options]
    told = subprocess.run(command, capture_output=True, text=True, check=False).stderr
    return told, time.monotonic() - clock, used() - before


def seconds(match):
    return sum(float(number) * UNITS[unit] for number, unit in re.findall(TIME, match)) if match else None


def main(folder, *models):
    program = built()
    print("| model | points | told before, s | told after a tenth, s | real, s | told / real | processor time, s | of all points, s | ratio |")
    print("|---|---|---|---|---|---|---|---|---|")
    for spec in models or MODELS:
        name = os.path.splitext(os.path.basename(spec))[0]
        target = os.path.join(folder, name)
        told, real, used = sweep(program, str(ROOT / spec), target, *MODELS.get(spec, []))
        _, _, whole = sweep(program, str(ROOT / spec), target + "_any", "--max-error", "any", *MODELS.get(spec, []))
        points = re.search(r"(\d+) points =", told)
        before = seconds(re.search(rf"about {TIME} on", told)[0])
        tenth = re.search(rf"points after {TIME}; about {TIME} to go", told)
        tenth = seconds(tenth[0]) if tenth else None
        ratio = f"{tenth:.0f} | {real:.0f} | {tenth / real:.2f}" if tenth else f"- | {real:.0f} | -"
        print(f"| {name} | {points[1]} | {before:.1f} | {ratio} | {used:.0f} | {whole:.0f} | {used / whole:.2f} |", flush=True)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(*sys.argv[1:])
