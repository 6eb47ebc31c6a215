#!/usr/bin/env python3
"""A rotary pendulum and the controller that balances it in closed loop, each once on PEs and once in this program.

    venv/bin/python models/hil_pendulum/loop.py [--transport model,fast] [--steps 50000]

Fails if an integer differs between two transports, or an angle deviates by more than 1e-5 from the loop in double
precision. docs/python.md tells how to install pe_synth.
"""

from math import cos, exp, pi, sin
from pathlib import Path

from pe_synth.host import loops

MODELS = Path(__file__).resolve().parents[1]
SPECS = [MODELS / "hil_pendulum/hil_pendulum.spec", MODELS / "hil_pendulum_control/hil_pendulum_control.spec"]
T = 1e-4
MP, LR, L, JR, JP, KM, RM, DR, DP, G = 0.024, 0.085, 0.0645, 5.7198e-5, 1.33e-4, 0.042, 8.4, 0.0015, 0.0005, 9.81
CORNER = 2 * pi * 50


class Pendulum:
    """The equations of hil_pendulum.spec, by a Runge-Kutta step of fourth order per sample."""

    def __init__(self):
        self.state = (0.0, 0.1, 0.0, 0.0)

    @staticmethod
    def slope(_, alpha, w, q, v):
        s, c = sin(alpha), cos(alpha)
        m11, m12 = MP * LR**2 + JR + JP * s**2, MP * L * LR * c
        t1 = KM * (v - KM * w) / RM - DR * w - 2 * JP * s * c * w * q + MP * L * LR * s * q**2
        t2 = JP * s * c * w**2 + MP * G * L * s - DP * q
        inverse = 1 / (JP * m11 - m12**2)
        return w, q, (JP * t1 - m12 * t2) * inverse, (m11 * t2 - m12 * t1) * inverse

    def step(self, inputs):
        def at(slope, part):
            return (x + part * d for x, d in zip(self.state, slope))

        a = self.slope(*self.state, *inputs)
        b = self.slope(*at(a, T / 2), *inputs)
        c = self.slope(*at(b, T / 2), *inputs)
        d = self.slope(*at(c, T), *inputs)
        self.state = tuple(x + T / 6 * (p + 2 * q + 2 * r + s) for x, p, q, r, s in zip(self.state, a, b, c, d))
        return self.state[:2]


class Controller:
    """State feedback from both angles and their filtered rates."""

    def __init__(self):
        self.slow = [0.0, 0.1]

    def step(self, inputs):
        target, *angles = inputs
        rates = [CORNER * (angle - slow) for angle, slow in zip(angles, self.slow)]
        wanted = 2.2361 * (angles[0] - target) + 53.5779 * angles[1] + 2.0253 * rates[0] + 3.8979 * rates[1]
        self.slow = [slow + (1 - exp(-CORNER * T)) * (angle - slow) for angle, slow in zip(angles, self.slow)]
        return [max(-10.0, min(10.0, wanted))]


def loop(plant, controller, steps):
    """The pendulum begins 0.1 rad from upright; the arm is to move by 0.3 rad at 2.5 s."""
    return loops.run(
        plant,
        controller,
        (0.0, 0.1),
        steps,
        lambda k, outputs: [0.3 if k >= 25000 else 0.0, *outputs[:2]],
        lambda k, given: given,
    )


if __name__ == "__main__":
    title = "Rotary pendulum and its controller at 10 kHz"
    loops.compare(title, SPECS, lambda: (Pendulum(), Controller()), loop, 50000, 1e-5)
