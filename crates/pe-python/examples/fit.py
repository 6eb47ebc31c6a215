#!/usr/bin/env python3
"""Fits two parameters of a fixed-point network to a measurement, with SciPy.

    python crates/pe-python/examples/fit.py

The parameters are tunable, so that the network is compiled once; each run computes what the hardware would with these
numbers. The measurement is a solution in double precision with noise.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import pe_synth

SPEC = """
model prey
solver rk4
step   10 ms
span   20 s

param alpha = 1   tunable in 0.8 .. 1.4
param beta  = 0.5 tunable in 0.3 .. 0.6

state prey     = 10 in 0 .. 60
state predator = 10 in 0 .. 30

prey'     = alpha*prey - beta*prey*predator
predator' = 0.1*prey*predator - 0.4*predator

output prey, predator
"""
TRUE = (1.1, 0.4)
EVERY = 50


def measured(time):
    """Both populations at these times."""

    def slope(_, z):
        return [TRUE[0] * z[0] - TRUE[1] * z[0] * z[1], 0.1 * z[0] * z[1] - 0.4 * z[1]]

    exact = solve_ivp(slope, (0, time[-1]), [10, 10], t_eval=time, rtol=1e-9, atol=1e-9).y.T
    return exact + np.random.default_rng(1).normal(0, 0.02, exact.shape)


def main():
    design = pe_synth.compile(text=SPEC, host=["states"])
    time = design.step * np.arange(EVERY, design.steps + 1, EVERY)
    wanted = measured(time)
    runs = 0

    def residuals(numbers):
        nonlocal runs
        runs += 1
        run = design.run(parameters=dict(zip(("alpha", "beta"), numbers)))
        return (run.outputs[EVERY - 1 :: EVERY] - wanted).ravel()

    # Words are steps: differences are taken over many of them.
    bounds = ([0.8, 0.3], [1.4, 0.6])
    found = least_squares(residuals, [1.0, 0.5], bounds=bounds, diff_step=1e-4, x_scale=[1.0, 0.5])
    for name, number in zip(("alpha", "beta"), found.x):
        print(f"{name}: {number:.3f}")
    print(f"largest residual: {np.abs(found.fun).max():.2f}")
    print(f"runs: {runs}")


if __name__ == "__main__":
    main()
