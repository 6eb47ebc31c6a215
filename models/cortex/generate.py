#!/usr/bin/env python3
"""Writes neurons.csv and synapses.csv of the network: `generate.py [NEURONS [SYNAPSES]]`, 100 and 20 if not given.

The numbers come from a generator that is written out here, so that every Python writes the same files.
"""

import sys

NEURONS, SYNAPSES = (int(number) for number in (sys.argv[1:] + ["100", "20"][len(sys.argv) - 1 :])[:2])
EXCITATORY = NEURONS * 4 // 5
LONGEST = 20

state = 2003


def chance() -> float:
    """The next number from 0 to 1: a linear congruence of 64 bits, its upper half."""
    global state
    state = (state * 6364136223846793005 + 1442695040888963407) % 2**64
    return (state >> 32) / 2**32


with open("neurons.csv", "w", encoding="utf-8") as file:
    file.write("# written by generate.py\ni, a [1/ms], b [1/ms], c [mV], d [mV/ms], drive [mV/ms], v [mV]\n")
    for i in range(1, NEURONS + 1):
        r, start = chance(), -70 + 10 * chance()
        if i <= EXCITATORY:
            a, b, c, d, drive = 0.02, 0.2, -65 + 15 * r * r, 8 - 6 * r * r, 3.2 + 2.2 * chance()
        else:
            a, b, c, d, drive = 0.02 + 0.08 * r, 0.25 - 0.05 * r, -65, 2, 1.2 + 1.2 * chance()
        file.write(f"{i}, {a:.4f}, {b:.4f}, {c:.3f}, {d:.3f}, {drive:.3f}, {start:.2f}\n")

with open("synapses.csv", "w", encoding="utf-8") as file:
    file.write("# written by generate.py\nfrom, to, weight [mV/ms], delay [ms]\n")
    for source in range(1, NEURONS + 1):
        excites = source <= EXCITATORY
        targets: set[int] = set()
        while len(targets) < SYNAPSES:
            # Inhibitory neurons reach excitatory ones alone, and at once, as in the model that this one is after.
            target = 1 + int(chance() * (NEURONS if excites else EXCITATORY))
            if target != source:
                targets.add(target)
        for target in sorted(targets):
            weight = (0.5 if excites else -1.0) * chance() * 40 / SYNAPSES
            delay = 1 + int(chance() * LONGEST) if excites else 1
            file.write(f"{source},{target},{weight:.3f},{delay}\n")
