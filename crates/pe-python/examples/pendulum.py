#!/usr/bin/env python3
"""From the Lagrangian of a damped pendulum to a network, with SymPy.

    python crates/pe-python/examples/pendulum.py

SymPy derives the equation of motion, the network computes it in fixed point, and SciPy in double precision.
"""

import numpy as np
import sympy
from scipy.integrate import solve_ivp

import pe_synth


def equations():
    """Angle and angular velocity as functions of time, their slopes, and the parameters."""
    t = sympy.Symbol("t")
    mass, length, g, d = sympy.symbols("m L g d", positive=True)
    angle, omega = sympy.Function("angle")(t), sympy.Function("omega")(t)
    lagrangian = mass * length**2 * angle.diff(t) ** 2 / 2 + mass * g * length * sympy.cos(angle)
    momentum = lagrangian.diff(angle.diff(t)).diff(t)
    motion = sympy.Eq(momentum - lagrangian.diff(angle), -d * angle.diff(t))
    acceleration = sympy.solve(motion, angle.diff(t, 2))[0].subs(angle.diff(t), omega)
    return {angle: omega, omega: sympy.simplify(acceleration)}, {mass: 1.0, length: 0.5, g: 9.81, d: 0.1}


def main():
    slopes, parameters = equations()
    begin = dict(zip(slopes, [1.5, 0.0]))
    time = sympy.Symbol("t")
    spec = pe_synth.from_sympy(
        [sympy.Eq(state.diff(time), slope) for state, slope in slopes.items()],
        begin,
        parameters=parameters,
        name="pendulum",
        step="1 ms",
        span="3 s",
    )
    design = pe_synth.compile(text=spec.text)
    run = design.run()
    slope = sympy.lambdify(list(slopes), [value.subs(parameters) for value in slopes.values()])
    times = run.time.clip(max=3)
    exact = solve_ivp(lambda _, z: slope(*z), (0, 3), list(begin.values()), t_eval=times, rtol=1e-9, atol=1e-9)
    print(f"steps: {len(run)}")
    print(f"cycles per step: {design.report['cycles_per_step']}")
    print(f"largest difference: {np.abs(run.outputs - exact.y.T).max():.1e}")


if __name__ == "__main__":
    main()
