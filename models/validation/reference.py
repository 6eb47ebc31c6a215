#!/usr/bin/env python3
"""Writes reference solutions of the validation models: models/validation/reference/NAME.csv.

    python3 -m venv VENV
    VENV/bin/pip install numpy==2.4.6 scipy==1.17.1 commonroad-vehicle-models==3.0.2 omegaconf==2.4.0
    VENV/bin/python models/validation/reference.py [NAME...]

The right-hand sides are written out in problems/ a second time, by hand and from the sources that README.md names, so
that a mistake in a spec shows. Every model is solved by two methods of scipy at tight tolerance. What differs between them at
the times of the file is printed, relative to the largest magnitude of the state, and may be LIMIT at most; so is the
difference to published values. A file has a row with the largest magnitudes over the span and one for each time.
"""

import os
import sys

import numpy as np
from scipy.integrate import solve_ivp

sys.dont_write_bytecode = True

from problems import CASES, extremes, fields, mechanics, published  # noqa: E402, F401

ROWS = 20
# Rows of a file whose times follow the solution: as many spread evenly, and as many where the solver's steps are short;
# fewer for models of many states.
DENSE, NUMBERS = 120, 500
FOLDER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "reference")


def last(case, start, end):
    """The last time of a piece at which a right-hand side may be asked: it must not see what comes after the jump."""
    return end - 1e-8 * (end - start) if case.jumps else np.nextafter(end, start)


def solve(case, method, times):
    """The states at the times, one row each, and their largest magnitudes over all steps of the solver."""
    size = np.abs(case.start)
    size = np.maximum(size, 1e-3 * np.max(size)) if np.max(size) > 0 else np.ones(len(size))
    atol = 1e-3 * case.finest * np.minimum(size, 1.0)
    state, largest, rows = case.start, np.abs(case.start), []
    bounds = [0, *case.jumps, times[-1]]
    if case.period:
        bounds = [case.period * number for number in range(round(times[-1] / case.period))] + [times[-1]]
    for start, end in zip(bounds, bounds[1:]):
        if case.sample:
            state = np.array(case.sample(state), float)
        before = last(case, start, end)
        result = solve_ivp(lambda t, y: case.f(min(t, before), y), (start, end), state, method, rtol=case.finest,
                           atol=atol, dense_output=True)
        if not result.success:
            raise SystemExit(f"{method}: {result.message}")
        wanted = times[(times > start * (1 + 1e-12)) & (times <= end * (1 + 1e-12))]
        if len(wanted):
            rows.append(result.sol(wanted).T)
        state, largest = result.y[:, -1], np.maximum(largest, np.max(np.abs(result.y), axis=1))
    return np.concatenate(rows), largest


def following(case):
    """Multiples of the grid that follow the solution: the first steps, as many where it is fast, as many evenly, and
    steps after jumps."""
    steps, dense = round(case.end / case.grid), min(DENSE, NUMBERS // len(case.names))
    state, taken = case.start, [np.zeros(1)]
    bounds = [0, *case.jumps, case.end]
    for start, end in zip(bounds, bounds[1:]):
        before = last(case, start, end)
        result = solve_ivp(lambda t, y: case.f(min(t, before), y), (start, end), state, case.methods[0], rtol=1e-6,
                           atol=1e-9 * np.maximum(np.abs(case.start), 1e-3 * np.max(np.abs(case.start)) + 1e-12))
        state = result.y[:, -1]
        taken.append(result.t[1:])
    taken = np.concatenate(taken)
    fast = np.interp(np.linspace(0, 1, dense), np.linspace(0, 1, len(taken)), taken) / case.grid
    # The first jumps and the last one, which may lie within steps.
    jumps = np.ceil(np.array([*case.jumps[:8], *case.jumps[8:][-1:]]) / case.grid - 1e-6)
    after = [jump + step for jump in jumps for step in (1, 2, 3, 5, 8, 20)]
    wanted = np.concatenate([np.arange(1, 11), np.linspace(1, steps, dense), fast, after])
    numbers = np.unique(np.clip(np.rint(wanted), 1, steps)).astype(int)
    return case.end * numbers / steps


def write(name):
    """Solves a case, judges the solution and writes its file."""
    case = CASES[name]
    times = np.array([case.end * row / ROWS for row in range(1, ROWS + 1)])
    if case.grid:
        times = following(case)
    (first, largest), (second, _) = (solve(case, method, times) for method in case.methods)
    agreement = np.max(np.abs(first - second) / largest)
    text = f"{name}: {case.methods[0]} and {case.methods[1]} differ by {agreement:.1e}"
    if not agreement <= case.limit:
        raise SystemExit(text + f", more than {case.limit:.1e}")
    if case.published:
        time, values, tolerance = case.published
        found = solve(case, case.methods[0], np.array([time]))[0][-1]
        pairs = [(value, known) for value, known in zip(found, values) if known is not None]
        worst = max(abs(value - known) / abs(known) for value, known in pairs)
        text += f"; published values at t = {time:g} differ by {worst:.1e}"
        if not worst <= tolerance:
            raise SystemExit(text + f", more than {tolerance:.1e}")
    print(text, flush=True)
    os.makedirs(FOLDER, exist_ok=True)
    with open(os.path.join(FOLDER, f"{name}.csv"), "w") as file:
        file.write(f"# {case.methods[0]} of scipy; {case.methods[1]} differs by {agreement:.1e}\n")
        file.write(",".join(["t"] + case.names) + "\n")
        file.write(",".join(["largest"] + [f"{number:.6e}" for number in largest]) + "\n")
        for time, row in zip(times, first):
            file.write(",".join([f"{time:.12g}"] + [f"{number:.12e}" for number in row]) + "\n")


def main():
    unknown = [name for name in sys.argv[1:] if name not in CASES]
    if unknown:
        raise SystemExit(f"unknown: {' '.join(unknown)}; known: {' '.join(CASES)}")
    for name in sys.argv[1:] or CASES:
        write(name)


main()
