"""Options of commands with their types: `compile(spec, pes=2)` is `pe-synth compile --pes 2`.

Written by the test `python_options`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Literal, TypeAlias, TypedDict

Path: TypeAlias = str | PathLike[str]
Value: TypeAlias = str | float
"""A number, or text as it is typed behind the option, such as '1 ms'."""
Allow: TypeAlias = Literal["E0903", "E0907", "E0908", "E0913", "E0914", "E0915", "E0927", "E0932"]
Coefficients: TypeAlias = Literal["one-slot", "two-slot", "auto"]
Device: TypeAlias = Literal["XC6VLX240T", "XC7Z020", "LFE5UM-85F", "GW2A-LV18", "XCAU25P", "XCVU9P", "XCVU13P"]
Elimination: TypeAlias = Literal["natural", "fill", "depth", "twisted", "dissection", "search"]
Factors: TypeAlias = Literal["ahead", "plain", "root"]
Form: TypeAlias = Literal["auto", "increments", "sums", "horner", "factors", "full"]
Host: TypeAlias = Literal["restart", "states", "flags"]
Judge: TypeAlias = Literal["trajectories", "events"]
Loop: TypeAlias = Literal["auto", "on", "off"]
Minimise: TypeAlias = Literal["area", "time", "error"]
Outputs: TypeAlias = Literal["auto", "ports", "memory"]
Pipeline: TypeAlias = Literal["short", "deep"]
Proof: TypeAlias = Literal["off", "ranges"]
Solver: TypeAlias = Literal[
    "euler",
    "heun",
    "heun3",
    "rk4",
    "symplectic_euler",
    "leapfrog",
    "ab2",
    "ab3",
    "ab4",
    "rkc5",
    "rkc10",
    "implicit_euler",
    "trapezoidal",
    "ros2",
    "rodas3",
    "rush_larsen",
    "exact",
]


class DesignOptions(TypedDict, total=False):
    """Options of all commands that design."""

    allow: Allow | Sequence[Allow]
    """Turns a refusal into a warning; may be repeated."""

    elimination: Elimination
    """The order in which matrices are eliminated; by default that of a trial for linear systems, and the one
    that fills in least for implicit solvers."""

    factors: Factors
    """How symmetric matrices of linear systems are eliminated; by default what a trial finds."""

    form: Form
    """Form of the step of a model that is affine in its states."""

    from_: Path
    """Continues from the text of a compiler stage printed by `dump` instead of a spec: `compile` and `dump`
    from any stage, other commands from a model."""

    inputs: Value
    """Inputs between two samples, unless the spec says: hold or linear."""

    judge: Judge
    """What the runs of a design are compared by."""

    loop: Loop
    """One round of control words for all stages of a step."""

    mapping: Path
    """Reads the PE of each equation from a file, in the form that `dump --stage mapping` prints."""

    max_in_degree: int
    """Most input ports a PE may have [default: 15, or more if no mapping does with 15]."""

    no_pre_adder: bool
    """Does not use the pre-adder for operands with equal coefficients."""

    observe: Value | Sequence[Value]
    """Outputs: scalars, elements, whole arrays; overrides the spec; may be repeated."""

    proof: Proof
    """Whether ranges are proven in addition to being measured."""

    seed: int
    """Seed of all random numbers."""

    set: Mapping[str, float] | Sequence[str] | str
    """Sets a constant, a parameter or an initial value, or one element (`R[3]=2`); may be repeated."""

    span: Value
    """Time over which ranges and errors are judged; overrides the spec."""

    tries: int
    """Annealing budget in moves tried [default: grows with the number of equations]."""

    units: Value
    """How strictly units are checked: strict, warn or off; overrides the spec."""

    widen: int
    """Most bits by which formats may be widened to prove all ranges."""


class SingleOptions(DesignOptions, total=False):
    """Options of commands that take one design."""

    coefficients: Coefficients
    """Issue slots per coefficient: with two, a coefficient port of 18 bits computes with about 35."""

    early_steps: Value | Sequence[Value]
    """Other steps for the beginning, each with the time at which it ends, for implicit solvers; overrides the
    spec."""

    multiplier: Value
    """Multiplier: bits of the data port x bits of the coefficient port [default: 32x32; 35x35 for sampled
    feedback that may ring]."""

    pes: int
    """Number of processing elements; all of them are used [default: one for every 200 words of a step, as far
    as more PEs make it shorter]."""

    pipeline: Pipeline
    """Pipeline of the PEs: short, or deep for a faster clock on devices without registers in their blocks."""

    solver: Solver
    """Numerical method; overrides the spec."""

    step: Value
    """Step, for example `1e-4` or `100us`; overrides the spec."""

    storage: int
    """Bits of a stored word, without its guard bits."""


class SweepOptions(DesignOptions, total=False):
    """Options of commands that compare designs."""

    clock: Value
    """Clock for the speed [default: an estimate for some devices, else 150, marked as assumed]."""

    device: Device
    """Estimates the clock for this device, if networks were measured on its family; `compile` compares the
    size with it."""

    jobs: int
    """Points compiled at the same time; the result does not depend on it [default: one per core]."""

    parts: int
    """Jobs that `--cluster` submits at once."""

    pipeline: Pipeline
    """Pipeline of the PEs."""

    sample: Value
    """Longest time between two outputs: steps divide this time."""

    store: Path
    """Folder of points that several sweeps share: what it has is not computed again."""

    within: Value
    """Stops after this time with the best points that were found, the cheapest to compute first; the one
    option with which the result may differ from run to run."""


class CompileOptions(SingleOptions, total=False):
    """Options of `pe-synth compile`."""

    area_from: Path
    """Uses measured sizes of PEs instead of estimates, from a file that `cargo run -p xtask -- measure-area`
    wrote."""

    clock: Value
    """Clock for the speed [default: an estimate for some devices, else 150, marked as assumed]."""

    conserved: Value | Sequence[Value]
    """Outputs that should stay constant, such as an energy: their drift is reported."""

    device: Device
    """Estimates the clock for this device, if networks were measured on its family; `compile` compares the
    size with it."""

    fit: bool
    """Keeps designs that fit the device of `--device`."""

    host: Host | Sequence[Host]
    """Gives the network ports for a host: `restart` brings back the initial state, `states` reads and replaces
    states between two steps, `flags` has one flag per cause and clears them."""

    max_error: Value
    """Chooses solver, step, multiplier and storage that meet this total error with the shortest run time;
    options that are given are kept."""

    minimise: Minimise
    """What is to be small among the designs that keep all limits [default: time]."""

    outputs: Outputs
    """Outputs as ports, or in memories with one read port; `auto` chooses beyond 16 outputs what takes less."""

    realtime: Value
    """Keeps designs that are at least so many times as fast as real time at their clock."""

    reference: bool
    """Solves the model with a library for differential equations to measure the total error."""

    sample: Value
    """Longest time between two outputs of the design that `--max-error` or another goal chooses: its step
    divides this time."""


class CheckOptions(SingleOptions, total=False):
    """Options of `pe-synth check`."""

    max_error: Value
    """Method error for which the accuracy step is computed."""


class ExploreOptions(SweepOptions, total=False):
    """Options of `pe-synth explore`."""

    fit: bool
    """Keeps designs that fit the device of `--device`."""

    max_error: Value
    """Largest total error of points that compete in size and speed, or `any` [default: 0.01]."""

    minimise: Minimise
    """What is to be small among the designs that keep all limits [default: time]."""

    multiplier: Value | Sequence[Value]
    """Multipliers [default: 25x18,18x25,32x32]."""

    pes: int | Sequence[int]
    """Numbers of processing elements [default: powers of two, as long as more PEs can be faster]."""

    realtime: Value
    """Keeps designs that are at least so many times as fast as real time at their clock."""

    resume: bool
    """Continues the sweep in the output folder: points that it holds are not compiled again."""

    solver: Solver | Sequence[Solver]
    """Numerical methods [default: euler,heun,heun3,rk4; for stiff models all that apply]."""

    step: Value | Sequence[Value]
    """Steps [default: the spec's, its half and its double]."""

    storage: int | Sequence[int]
    """Bits of a stored word, without its guard bits."""


class AccuracyOptions(SweepOptions, total=False):
    """Options of `pe-synth accuracy`."""

    coefficients: Coefficients | Sequence[Coefficients]
    """Issue slots per coefficient: one-slot, two-slot, auto [default: one-slot]."""

    conserved: Value | Sequence[Value]
    """Outputs that should stay constant, such as an energy: their drift is reported."""

    max_error: Value
    """Picks the cheapest point with at most this total error, trying more steps and words; points that miss it
    show only their error."""

    multiplier: Value | Sequence[Value]
    """Multipliers; with these lists every solver and step is combined with every word length."""

    pes: int
    """Number of processing elements of every point [default: one for every 200 issue slots]."""

    resume: bool
    """Continues the study in the output folder: points that it holds are not compiled again."""

    solver: Solver | Sequence[Solver]
    """Numerical methods [default: all that apply]."""

    step: Value | Sequence[Value]
    """Steps [default: the spec's, times and divided by 2 and 4; with many solvers by 2 only]."""

    storage: int | Sequence[int]
    """Bits of a stored word, without its guard bits [default: 32]."""
