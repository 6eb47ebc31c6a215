"""Compiles ordinary differential equations to hardware, and runs what comes out bit for bit.

    import pe_synth

    design = pe_synth.compile("models/lotka_volterra/lotka_volterra.spec", pes=2)
    run = design.run(steps=1000)
    run["prey"]  # the numbers that the network gives, by step

`compile`, `check`, `explore` and `accuracy` take the options of the commands of the same names. What is wrong with a spec is
a `SpecError`, a warning about it a `SpecWarning`. `pe_synth.host` drives networks, whatever they run on. docs/python.md
says more.
"""

from . import host
from .design import Design, Port, Run, State, compile
from .errors import (
    Error,
    FileError,
    Finding,
    InternalError,
    MissingTool,
    NoDesign,
    Place,
    RunWarning,
    SpecError,
    SpecWarning,
    UsageError,
)
from .pictures import Picture
from .studies import Check, accuracy, check, explore
from .symbolic import from_sympy

__all__ = [
    "Check",
    "Design",
    "Error",
    "FileError",
    "Finding",
    "InternalError",
    "MissingTool",
    "NoDesign",
    "Picture",
    "Place",
    "Port",
    "Run",
    "RunWarning",
    "SpecError",
    "SpecWarning",
    "State",
    "UsageError",
    "accuracy",
    "check",
    "compile",
    "explore",
    "from_sympy",
    "host",
]
