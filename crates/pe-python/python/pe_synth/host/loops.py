"""Closed loops of a plant and a controller, each of which is a network or a Python object, and their comparison.

Plants and controllers have a method `step` that takes the inputs of a step and gives the outputs after it. The
controller sees sample k of the plant; what it gives acts from there to sample k + 1.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

from .._native import open_host


class Part(Protocol):
    """A plant or a controller."""

    def step(self, inputs: Sequence[float]) -> Sequence[float]:
        """Outputs after a step with these inputs."""


class Network:
    """A network as a part of a loop; inputs that are clamped are an error."""

    def __init__(self, folder: str | os.PathLike[str], transport: str) -> None:
        self.host = open_host(folder, transport)

    def step(self, inputs: Sequence[float]) -> list[float]:
        exchanged = self.host.exchange(inputs)
        if exchanged.clamped:
            raise ValueError(f"sample {self.host.sample}: {', '.join(exchanged.clamped)} clamped")
        return exchanged.outputs


def run(
    plant: Part,
    controller: Part,
    begin: Sequence[float],
    steps: int,
    measured: Callable[[int, Sequence[float]], Sequence[float]],
    driven: Callable[[int, Sequence[float]], Sequence[float]],
) -> list[tuple[float, ...]]:
    """Outputs of the plant at each sample from 1 on, and those of the controller that lead there.

    begin: outputs of the plant at sample 0; measured: inputs of the controller, from k and the plant's outputs; driven:
    inputs of the plant, from k and the controller's outputs.
    """
    outputs, seen = begin, []
    for k in range(steps):
        given = controller.step(measured(k, outputs))
        outputs = plant.step(driven(k, given))
        seen.append((*outputs, *given))
    return seen


def compiled(spec: Path, folder: str) -> str:
    """Compiles a spec and wraps the design; $PE_SYNTH names the compiler, else it is built."""
    program = os.environ.get("PE_SYNTH")
    command = [program] if program else ["cargo", "run", "--release", "--quiet", "--"]
    compile_it = ["compile", str(spec), "--host", "restart,states,flags", "-q", "--no-pictures", "-o", folder]
    for arguments in [compile_it, ["wrap", folder, "-q"]]:
        subprocess.run(command + arguments, cwd=spec.parent, check=True)
    return folder


def compare(
    title: str,
    specs: Sequence[Path],
    parts: Callable[[], tuple[Part, Part]],
    loop: Callable[[Part, Part, int], list[tuple[float, ...]]],
    steps: int,
    most: float,
) -> None:
    """Runs a loop from both sides over transports of the command line, and ends the program.

    specs: of plant and controller, or of the plant only, for open loops; parts: both in double precision, anew; loop: of
    a plant and a controller, so many steps. The exit code is 1 if an integer differs between transports, an output of
    the plant deviates by more than `most` from the loop in double precision, or a flag is set.
    """
    parser = argparse.ArgumentParser(description=title)
    parser.add_argument("--transport", default="model,fast", help="transports, separated by commas")
    parser.add_argument("--steps", type=int, default=steps)
    options = parser.parse_args()
    exact = loop(*parts(), options.steps)
    failed = False
    with tempfile.TemporaryDirectory() as scratch:
        folders = [compiled(spec, os.path.join(scratch, spec.stem)) for spec in specs]
        for side, name in enumerate(["plant", "controller"][: len(folders)]):
            first = None
            for transport in options.transport.split(","):
                both: list[Part] = list(parts())
                network = both[side] = Network(folders[side], transport)
                seen = loop(both[0], both[1], options.steps)
                first = first or seen
                differing = sum(a != b for a, b in zip(first, seen))
                shown = len(seen[0]) - 1
                deviation = max(abs(x - y) for a, b in zip(exact, seen) for x, y in zip(a[:shown], b[:shown]))
                flags = "".join(f", {flag}" for flag in network.host.flags())
                counts = f"{len(seen)} samples, {differing} differing, {deviation:.1e} from double"
                print(f"{name} on PEs, {transport}: {counts}{flags}")
                failed |= differing > 0 or deviation > most or flags != ""
    sys.exit(failed)
