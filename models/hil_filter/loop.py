#!/usr/bin/env python3
"""A low pass at 25 MHz on PEs, in open loop: 1 ms of two sines and noise.

    venv/bin/python models/hil_filter/loop.py [--transport model,fast] [--steps 25000]

Fails if an integer differs between two transports, or an output deviates by more than 1e-5 from the filter in double
precision. docs/python.md tells how to install pe_synth.
"""

import random
from math import pi, sin
from pathlib import Path

from pe_synth.host import loops

SPEC = Path(__file__).resolve().parent / "hil_filter.spec"
SECTIONS = [
    (0.006299878989007241, 0.009761994380309637, 0.00629987898900724, -0.794835432424744, 0.1747440708550006),
    (1.0, 0.05421737463422856, 1.0, -0.9827461943560528, 0.37547853238106155),
    (1.0, -0.5546650773291735, 1.0, -1.2960112709142195, 0.7409957840385255),
]


class Filter:
    """Three sections of order two, each in transposed form II."""

    def __init__(self):
        self.memory = [[0.0, 0.0] for _ in SECTIONS]

    def step(self, inputs):
        (x,), outputs = inputs, []
        for (b0, b1, b2, a1, a2), memory in zip(SECTIONS, self.memory):
            y = b0 * x + memory[0]
            memory[:] = [b1 * x - a1 * y + memory[1], b2 * x - a2 * y]
            outputs.append(y)
            x = y
        return outputs[2], outputs[0]


class Source:
    """0.5 MHz to pass, 7 MHz and noise to stop."""

    def __init__(self):
        self.noise, self.k = random.Random(1), 0

    def step(self, _):
        self.k += 1
        time = self.k * 40e-9
        return [0.5 * sin(2 * pi * 5e5 * time) + 0.5 * sin(2 * pi * 7e6 * time) + 0.1 * self.noise.uniform(-1, 1)]


def loop(plant, source, steps):
    return loops.run(plant, source, (0.0, 0.0), steps, lambda k, outputs: outputs, lambda k, given: given)


if __name__ == "__main__":
    loops.compare("Low pass at 25 MHz, in open loop", [SPEC], lambda: (Filter(), Source()), loop, 25000, 1e-5)
