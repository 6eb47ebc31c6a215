#!/usr/bin/env python3
"""Compiles the mechanisms of models/ and writes the table of docs/mechanics.md.

    cargo run -p xtask -- mechanics [--check] [ROW ...]

Builds pe-synth, or takes $PE_SYNTH. `--check` changes nothing and fails where the table differs. Words that a row's title
contains choose rows; others stay as they are, and the page is written after each row, so that the table can be made in parts.
Errors are those of the simulated fixed-point run: of the linkage against its exact solution, of all others against the same
step in double precision. All rows take half an hour.
"""

import csv
import json
import math
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from common import ROOT, built

PAGE = ROOT / "docs/mechanics.md"
BEGIN, END = "<!-- table by: cargo run -p xtask -- mechanics -->\n", "<!-- end of table -->\n"
HEADER = """| design | PEs | multiplier, storage | cycles per step | × real time at 125 MHz | largest error in fixed point |
|---|---|---|---|---|---|
"""
CLOCK = 125e6
GRAVITY = 9.81
FOUR_BAR = "models/four_bar/four_bar.spec"
IMPLICIT = "models/four_bar/implicit.spec"
SUSPENSION = "models/suspension/suspension.spec"
FOUR_POSTS = "models/suspension/four_posts.spec"
CAR_ON_POSTS = ("--pes", "7", "--multiplier", "35x35", "--storage", "40", "--proof", "off", "--elimination", "depth", "--factors", "ahead")
TWISTED = ("--storage", "40", "--elimination", "twisted", "--factors", "root")
LINKAGE = ("--allow", "E0903", "--pes", "4", "--multiplier", "35x35")
FORTY_BITS = ("--storage", "40", "--elimination", "search", "--factors", "root")
LONG_LINKAGE = ("--set", "N=20", "--span", "20s", "--allow", "E0903", "--allow", "E0907", "--pes", "8", "--multiplier", "35x35",
                "--storage", "40", "--elimination", "search", "--factors", "root")


def rows(program, *arguments):
    """Header and rows of numbers of a simulation."""
    done = subprocess.run([program, "sim", *arguments], cwd=ROOT, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                          text=True)
    header, *lines = csv.reader(done.stdout.splitlines())
    return header, [[float(cell) for cell in line] for line in lines]


def report(program, spec, *options):
    """The report of a design, compiled without its pictures."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([program, "compile", spec, *options, "--quiet", "--no-pictures", "-o", folder], cwd=ROOT, check=True,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return json.loads((Path(folder) / "report.json").read_text())


def exact(loops, step, steps):
    """Angle of the uprights against the vertical and its rate after each step, by twenty steps of RK4 for one."""
    rate = GRAVITY * ((loops + 1) / 2 + loops) / ((loops + 1) / 3 + loops)
    h, angle, speed, found = step / 20, 0.0, 1.0, [(0.0, 1.0)]
    for _ in range(steps):
        for _ in range(20):
            k1 = speed, rate * math.sin(angle)
            k2 = speed + h / 2 * k1[1], rate * math.sin(angle + h / 2 * k1[0])
            k3 = speed + h / 2 * k2[1], rate * math.sin(angle + h / 2 * k2[0])
            k4 = speed + h * k3[1], rate * math.sin(angle + h * k3[0])
            angle += h / 6 * (k1[0] + 2 * k2[0] + 2 * k3[0] + k4[0])
            speed += h / 6 * (k1[1] + 2 * k2[1] + 2 * k3[1] + k4[1])
        found.append((angle, speed))
    return found


def energy(q, w):
    """Of the linkage: links of 1 m and 1 kg, uprights with even numbers, each but the last with a link at its tip."""
    last = len(q) - 1
    kinetic = potential = 0.0
    for i in range(len(q)):
        carries = i % 2 == 0 and i < last
        kinetic += (1 / 3 + carries) * w[i] ** 2 / 2
        potential += GRAVITY * math.sin(q[i]) * (1.5 if carries else 0.5)
        if carries:
            kinetic += math.cos(q[i] - q[i + 1]) * w[i] * w[i + 1] / 2
    return kinetic + potential


def linkage(program, spec, *options):
    """The largest errors of the angles of the uprights, and of the energy, of four loops."""
    header, states = rows(program, spec, *LINKAGE, *options)
    first, speeds, count = header.index("q[0]"), header.index("w[0]"), 9
    angles = [angle for angle, _ in exact(4, 4e-3, len(states) - 1)]
    start = energy(states[0][first:first + count], states[0][speeds:speeds + count])
    angle = max(abs(math.pi / 2 - state[first + i] - right) for state, right in zip(states, angles) for i in range(0, count, 2))
    drift = max(abs(energy(state[first:first + count], state[speeds:speeds + count]) - start) for state in states)
    return f"angle {angle:.1e} rad, energy {drift:.1e} J of {start:.1f} J"


def tip(program, *options):
    """The largest errors of position and velocity of joint B0, the tip of the first upright, of twenty loops."""
    header, states = rows(program, FOUR_BAR, *options)
    first, speeds = header.index("q[0]"), header.index("w[0]")
    place = velocity = 0.0
    for state, (angle, speed) in zip(states, exact(20, 4e-3, len(states) - 1)):
        (q, w), (right, rate) = (state[first], state[speeds]), (math.pi / 2 - angle, -speed)
        place = max(place, math.hypot(math.cos(q) - math.cos(right), math.sin(q) - math.sin(right)))
        velocity = max(velocity, math.hypot(w * math.sin(q) - rate * math.sin(right), w * math.cos(q) - rate * math.cos(right)))
    return f"B0 {place:.1e} m, {velocity:.1e} m/s"


def against_double(program, spec, columns, text, *options):
    """The largest difference of some columns from the run in double precision, absolute and relative to the largest."""
    header, fixed = rows(program, spec, *options)
    _, double = rows(program, spec, "--double", *options)
    picked = [at for at, name in enumerate(header) if name.split("[")[0] in columns]
    largest = max(abs(row[at]) for row in double for at in picked)
    worst = max(abs(one[at] - other[at]) for one, other in zip(fixed, double) for at in picked)
    return text.format(worst, worst / largest)


def short(text):
    """Exponents without leading zeros."""
    return re.sub(r"e-0(\d)", r"e-\1", text)


def designs(program, general):
    """Title, spec, options of each row, and what finds its error; `general` is the dense system without symmetry."""
    dense = "models/dense42/dense42.spec"
    relative = "x {1:.1e} of its largest entry"
    return [
        ("N-four-bar, N = 4, RK4 4 ms", FOUR_BAR, (*LINKAGE, *FORTY_BITS), lambda: linkage(program, FOUR_BAR, *FORTY_BITS)),
        ("the same, 32 bits stored", FOUR_BAR, LINKAGE, lambda: linkage(program, FOUR_BAR)),
        ("the same linkage, implicit step of 4 ms", IMPLICIT, (*LINKAGE, *TWISTED), lambda: linkage(program, IMPLICIT, *TWISTED)),
        ("N-four-bar, N = 20, 20 s, RK4 4 ms", FOUR_BAR, LONG_LINKAGE, lambda: tip(program, *LONG_LINKAGE)),
        *((f"dense 42 x 42, {kind}", spec, ("--pes", pes), lambda spec=spec: against_double(program, spec, ("x",), relative))
          for kind, spec in (("symmetric", dense), ("general", general)) for pes in ("8", "16")),
        ("car, 29 states, RK4 4 ms", "models/car/car.spec", ("--pes", "4"),
         lambda: against_double(program, "models/car/car.spec", ("x", "y"), "position {0:.1e} m")),
        ("virtual sensor on the car, RK4 2 ms", "models/car/observer.spec", ("--pes", "4"),
         lambda: against_double(program, "models/car/observer.spec", ("vy",), "side slip {0:.1e} m/s")),
        ("spatial crank, RK4 1 ms", "models/spatial_crank/spatial_crank.spec", ("--pes", "3", "--multiplier", "35x35"),
         lambda: against_double(program, "models/spatial_crank/spatial_crank.spec", ("rock",), "angles {0:.1e} rad", "--multiplier", "35x35")),
        ("the same with all bodies as outputs", "models/spatial_crank/bodies.spec", ("--pes", "3", "--multiplier", "35x35"),
         lambda: against_double(program, "models/spatial_crank/bodies.spec", ("x_rocker", "x_rod"), "places {0:.1e} m", "--multiplier", "35x35")),
        ("suspension, implicit step of 1 ms", SUSPENSION, ("--pes", "4", "--multiplier", "35x35", "--storage", "40"),
         lambda: against_double(program, SUSPENSION, ("hub",), "wheel {0:.1e} m", "--multiplier", "35x35", "--storage", "40")),
        ("car on four suspensions, implicit step of 1 ms", FOUR_POSTS, CAR_ON_POSTS,
         lambda: against_double(program, FOUR_POSTS, ("q",), "coordinates {0:.1e} m or rad", *CAR_ON_POSTS)),
        ("double pendulum, RK4 1 ms", "models/double_pendulum/double_pendulum.spec", ("--pes", "2"),
         lambda: against_double(program, "models/double_pendulum/double_pendulum.spec", ("x", "y"), "positions {0:.1e} m")),
    ]


def row(program, title, spec, options, error):
    """The row of a design."""
    found = report(program, spec, *options)
    cycles, word = found["cycles_per_step"], found["word"]
    bits = f"{word['mul_a_bits']}x{word['mul_b_bits']}, {word['storage_bits']}"
    return short(f"| {title} | {found['pes']} | {bits} | {cycles} | {found['step_s'] * CLOCK / cycles:.0f} | {error()} |\n")


def renewed(page, rows):
    """The page with these rows, by title and PEs; None where there is none yet."""
    before, rest = page.split(BEGIN)
    _, after = rest.split(END)
    return before + BEGIN + HEADER + "".join(row for row in rows.values() if row) + END + after


def main():
    program = built()
    arguments = [argument for argument in sys.argv[1:] if argument != "--check"]
    given = PAGE.read_text()
    table = given.split(BEGIN)[1].split(END)[0].splitlines(keepends=True)
    known = {tuple(line[2:].split(" | ")[:2]): line for line in table}
    general = (ROOT / "models/dense42/dense42.spec").read_text().replace("] symmetric", "]").replace("where i > j", "where i != j")
    with tempfile.TemporaryDirectory() as folder:
        other = Path(folder) / "general.spec"
        other.write_text(general)
        all_designs = designs(program, str(other))
        keys = [(title, options[options.index("--pes") + 1]) for title, _, options, _ in all_designs]
        rows = {key: known.get(key) for key in keys}
        for key, (title, spec, options, error) in zip(keys, all_designs):
            if arguments and not any(word in title for word in arguments):
                continue
            rows[key] = row(program, title, spec, options, error)
            print(rows[key], end="", flush=True)
            if "--check" not in sys.argv[1:]:
                PAGE.write_text(renewed(PAGE.read_text(), rows))
            elif rows[key] != known.get(key):
                raise SystemExit("docs/mechanics.md differs from what is compiled: run it without --check")


main()
