#!/usr/bin/env python3
"""A motor and its controller in closed loop, each once on PEs and once in this program.

    venv/bin/python models/hil_motor/loop.py [--transport model,fast] [--steps 10000]

Fails if an integer differs between two transports, or the motor deviates by more than 1e-5 from the loop in double
precision. docs/python.md tells how to install pe_synth.
"""

from pathlib import Path

from pe_synth.host import loops

MODELS = Path(__file__).resolve().parents[1]
SPECS = [MODELS / "hil_motor/hil_motor.spec", MODELS / "hil_motor_pid/hil_motor_pid.spec"]
T = 1e-3


class Motor:
    """w' = (K i - b w - tau)/J, i' = (u - R i - K w)/L, by a Runge-Kutta step of fourth order per sample."""

    def __init__(self):
        self.state = (0.0, 0.0)

    @staticmethod
    def slope(w, i, u, tau):
        return (0.01 * i - 0.1 * w - tau) / 0.01, (u - i - 0.01 * w) / 0.5

    def step(self, inputs):
        w, i = self.state
        a = self.slope(w, i, *inputs)
        b = self.slope(w + T / 2 * a[0], i + T / 2 * a[1], *inputs)
        c = self.slope(w + T / 2 * b[0], i + T / 2 * b[1], *inputs)
        d = self.slope(w + T * c[0], i + T * c[1], *inputs)
        self.state = tuple(x + T / 6 * (p + 2 * q + 2 * r + s) for x, p, q, r, s in zip(self.state, a, b, c, d))
        return self.state


class Controller:
    """PID with a filtered derivative of the speed; integrates only while nothing is clamped."""

    def __init__(self):
        self.integral = self.filtered = 0.0

    def step(self, inputs):
        target, w = inputs
        error = target - w
        wanted = 100 * error + 200 * self.integral - 10 * 100 / (1 + 100 * T) * (w - self.filtered)
        if abs(wanted) < 24:
            self.integral += T * error
        self.filtered += 100 * T / (1 + 100 * T) * (w - self.filtered)
        return [max(-24.0, min(24.0, wanted))]


def loop(plant, controller, steps):
    """The speed is to be 1/s, from 5 s on half of that; a load begins at 8 s."""
    return loops.run(
        plant,
        controller,
        (0.0, 0.0),
        steps,
        lambda k, outputs: [1.0 if k < 5000 else 0.5, outputs[0]],
        lambda k, given: [given[0], 0.02 if k >= 8000 else 0.0],
    )


if __name__ == "__main__":
    loops.compare("DC motor and PID controller at 1 kHz", SPECS, lambda: (Motor(), Controller()), loop, 10000, 1e-5)
