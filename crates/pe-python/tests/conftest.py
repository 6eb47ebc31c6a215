"""Shared by the tests. $PE_SYNTH names the compiler, $PE_DESIGN the folder of motor_pid.

    python -m pytest crates/pe-python/tests
"""

import os
import subprocess
import warnings
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
MODELS = ROOT / "models"


def spec(name):
    return MODELS / name / f"{name}.spec"


def command(*words, **options):
    """What a command of the program prints."""
    program = [os.environ["PE_SYNTH"], *map(str, words)]
    return subprocess.run(program, capture_output=True, text=True, check=True, **options).stdout


HEAD = "model m\nsolver rk4\nstep 1 ms\nspan 20 ms\n"


@pytest.fixture(scope="session")
def driven():
    """A design with two inputs and a tunable parameter."""
    import pe_synth

    text = (
        HEAD
        + "param k = 20 tunable in 1 .. 100\ninput u = sine(0.5, 50 Hz) in -1 .. 1\ninput v = constant(0.25) in -1 .. 1\n"
        + "state x = 0.5 in -2 .. 2\nstate y = 0 in -2 .. 2\nx' = k*(u - x)\ny' = 50*(x*v - y)\noutput y, x\n"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pe_synth.SpecWarning)
        return pe_synth.compile(text=text, host=["states"])
