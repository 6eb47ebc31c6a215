#!/usr/bin/env python3
"""Solves the network on its own, and compares spikes with those of a run: `compare.py [sim.csv [PART]]`.

`pe-synth sim` writes the run. Nothing is shared with it but the two files of numbers. It fails where numbers of spikes differ by
more than a tenth, or a smaller part than PART of them falls in the same step.
"""

import csv
import sys

STEP, SPAN, DECAY = 0.5, 500.0, 5.0


def table(name: str) -> dict[str, list[float]]:
    """The columns of a file of numbers."""
    with open(name, encoding="utf-8") as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    names = [cell.split("[")[0].strip() for cell in rows[0]]
    return {name: [float(row[place]) for row in rows[1:]] for place, name in enumerate(names)}


def solved() -> list[tuple[int, int]]:
    """Step and neuron of every spike: Heun's method, as the spec says."""
    cells, edges = table("neurons.csv"), table("synapses.csv")
    count = len(cells["i"])
    reads: list[list[tuple[int, int, float]]] = [[] for _ in range(count)]
    for source, target, weight, delay in zip(edges["from"], edges["to"], edges["weight"], edges["delay"]):
        reads[int(target) - 1].append((int(source) - 1, round(delay / STEP), weight))
    longest = 1 + max(delay for row in reads for _, delay, _ in row)
    # What each lets flow at the beginning of the last steps, and at their ends.
    begins, ends = ([[0.0] * count for _ in range(longest)] for _ in range(2))
    v, u, s = list(cells["v"]), [b * v for b, v in zip(cells["b"], cells["v"])], [0.0] * count
    held = [False] * count
    spikes = []

    def slopes(v: float, u: float, i: int, at: list[list[float]]) -> tuple[float, float]:
        drive = cells["drive"][i] + sum(weight * at[delay][source] for source, delay, weight in reads[i])
        return 0.04 * v * v + 5 * v + 140 - u + drive, cells["a"][i] * (cells["b"][i] * v - u)

    for step in range(round(SPAN / STEP)):
        first, second = ([of[(step - delay) % longest] for delay in range(longest)] for of in (begins, ends))
        flow = list(s)
        for i in range(count):
            fast, slow = slopes(v[i], u[i], i, first)
            other, later = slopes(v[i] + STEP * fast, u[i] + STEP * slow, i, second)
            v[i], u[i] = v[i] + STEP / 2 * (fast + other), u[i] + STEP / 2 * (slow + later)
            s[i] *= 1 - STEP / DECAY + (STEP / DECAY) ** 2 / 2
        begins[step % longest], ends[step % longest] = flow, list(s)
        for i in range(count):
            if v[i] >= 30 and not held[i]:
                spikes.append((step + 1, i + 1))
                v[i], u[i], s[i] = cells["c"][i], u[i] + cells["d"][i], s[i] + 1
            held[i] = v[i] >= 30
    return spikes


def seen(name: str) -> set[tuple[int, int]]:
    """The same of a run, in which `fired` counts."""
    with open(name, encoding="utf-8") as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    found = set()
    for place, column in enumerate(rows[0]):
        if column.strip().startswith("fired["):
            neuron = int(column.strip()[6:].split("]")[0])
            for before, after in zip(rows[1:], rows[2:]):
                if float(after[place]) - float(before[place]) > 0.5:
                    found.add((round(float(after[0]) * 1000 / STEP), neuron))
    return found


if __name__ == "__main__":
    spikes = solved()
    count = len(table("neurons.csv")["i"])
    rates = [1000 / SPAN * sum(neuron == i for _, neuron in spikes) for i in range(1, count + 1)]
    print(f"{len(spikes)} spikes, {sum(rates) / count:.1f} a second and neuron, from {min(rates):.0f} to {max(rates):.0f}")
    if len(sys.argv) > 1:
        run = seen(sys.argv[1])
        same = len(run & set(spikes))
        print(f"{len(run)} in the run, {same} of them in the same step")
        part = float(sys.argv[2]) if len(sys.argv) > 2 else 0.0
        sys.exit(abs(len(run) - len(spikes)) > 0.1 * len(spikes) or same < part * len(spikes))
