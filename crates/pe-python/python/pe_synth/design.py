"""A compiled design, and runs of it on arrays."""

from __future__ import annotations

import html
import json
import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Unpack

from . import _native
from ._options import words
from .errors import RunWarning, UsageError, _outside
from .host import Host, Snapshot
from .options import CompileOptions
from .pictures import Picture

if TYPE_CHECKING:
    import numpy
    import pandas

_DRAWN = 2000
"""Points of a curve in a picture of a run."""

_SHOWN = 12
"""Outputs in a picture of a run."""


@dataclass(frozen=True)
class Port:
    """An input, an output or a tunable parameter."""

    name: str
    unit: str | None
    range: tuple[float, float] | None
    """The numbers for which the design was judged; None if nothing is said, and for outputs."""
    bits: int
    exponent: int
    """A word `w` stands for `w * 2**exponent`."""


@dataclass(frozen=True)
class State:
    """A state as the network stores it."""

    name: str
    bits: int
    exponent: int
    """A stored word `w` stands for `(w - offset) * 2**exponent`."""
    offset: int
    initial: float


class Run:
    """What a run gave. Row i of each array is after step i + 1, at `time[i]`."""

    def __init__(self, design: Design, native: Any, steps: int) -> None:
        import numpy

        def array(data, kind, columns=None):
            made = numpy.frombuffer(data, dtype=kind)
            return made if columns is None else made.reshape(steps, columns)

        self.design = design
        self.time: numpy.ndarray = array(native.time(), numpy.float64)
        """Shape (steps,), in seconds."""
        self.outputs: numpy.ndarray = array(native.outputs(), numpy.float64, len(design.outputs))
        """Shape (steps, outputs), in the units of the outputs."""
        self.words: numpy.ndarray = array(native.output_words(), numpy.int64, len(design.outputs))
        """The same as words of the ports."""
        kept = native.state_words()
        self._states = None
        if kept is not None:
            count = len(design.states)
            self._states = (array(native.states(), numpy.float64, count), array(kept, numpy.int64, count))
        self.flags: tuple[str, ...] = tuple(native.flags)
        """What happened, such as `saturated`; docs/host.md lists them."""
        self.clamped: tuple[str, ...] = tuple(native.clamped)
        """Inputs and parameters that were beyond what the network takes, and became the nearest word."""
        self.beyond_range: tuple[str, ...] = tuple(native.beyond_range)
        """Inputs and parameters that were beyond the ranges for which the stated errors hold."""
        self.end: Snapshot = native.end
        """Where it ended, for `begin` of another run of this design."""

    @property
    def states(self) -> numpy.ndarray:
        """Shape (steps, states): numbers of the states; of runs with `states=True`."""
        return self._kept()[0]

    @property
    def state_words(self) -> numpy.ndarray:
        """The same as stored words."""
        return self._kept()[1]

    def _kept(self):
        if self._states is None:
            raise UsageError("the run kept no states: `run(states=True)` does")
        return self._states

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, name: str) -> numpy.ndarray:
        """Shape (steps,): the numbers of an output, or of a state of a run with `states=True`."""
        names = [output.name for output in self.design.outputs]
        if name in names:
            return self.outputs[:, names.index(name)]
        states = [state.name for state in self.design.states]
        if name in states:
            return self.states[:, states.index(name)]
        raise KeyError(f"there is no output or state {name!r}; outputs are {', '.join(names)}")

    def to_frame(self) -> pandas.DataFrame:
        """The outputs as columns over the time in seconds."""
        import pandas

        index = pandas.Index(self.time, name="t")
        return pandas.DataFrame(self.outputs, index=index, columns=[output.name for output in self.design.outputs])

    def picture(self, *names: str) -> Picture:
        """Outputs over time, the first ones if none is named."""
        names = names or tuple(output.name for output in self.design.outputs)[:_SHOWN]
        every = max(1, -(-len(self) // _DRAWN))
        units = {output.name: output.unit for output in self.design.outputs}
        curves = [(name, units.get(name) or "value", self[name][::every].tolist()) for name in names]
        return Picture(_native.curves(f"{self.design.name}: {len(self)} steps", self.time[::every].tolist(), curves))

    def _repr_svg_(self) -> str:
        return self.picture().svg

    def __repr__(self) -> str:
        return f"<Run of {self.design.name}: {len(self)} steps>"


class Design:
    """A compiled design. It does not change, and may be used by several threads at the same time."""

    def __init__(self, native: Any) -> None:
        self._native = native
        self.report: dict[str, Any] = json.loads(native.report)
        """The report, docs/report.md; `files` is that of a written folder."""
        map_ = json.loads(native.map)
        self.name: str = map_["model"]
        self.hash: str = map_["hash"]
        """Tells it from designs that compute other words."""
        self.step: float = map_["step"]
        """In seconds, early steps aside."""
        self.steps: int = native.steps
        """Steps of the span."""
        self.states: tuple[State, ...] = tuple(
            State(state["name"], state["bits"], state["exponent"], state["offset"], initial)
            for state, initial in zip(map_["states"], native.initial)
        )
        quantities = [port for port in map_["inputs"] if port["meaning"] == "quantity"]
        self.inputs: tuple[Port, ...] = tuple(_port(port, port) for port in quantities)
        self.outputs: tuple[Port, ...] = tuple(_port(port, port) for port in map_["outputs"])
        self.parameters: tuple[Port, ...] = tuple(
            _port(one, map_["states"][one["state"]]) for one in map_.get("parameters") or []
        )
        """The tunable parameters, which `run` can give other numbers."""
        self._defaults = {one["name"]: one["value"] for one in map_.get("parameters") or []}

    def run(
        self,
        inputs: Mapping[str, Any] | Any = None,
        *,
        steps: int | None = None,
        parameters: Mapping[str, float] | None = None,
        begin: Snapshot | None = None,
        states: bool = False,
    ) -> Run:
        """Runs the network, bit for bit what the hardware does, by the cycle-accurate simulator.

        `inputs` is an array of numbers of shape (steps, inputs), in the units and the order of the inputs, or a mapping
        from names to arrays of shape (steps,), or to one number for all steps; an input that is not named is driven by the
        spec, as `pe-synth sim` does. Row i acts in step i + 1; of an input that is interpolated it is the value at the end
        of that step. Arrays of integers of 64 bits in place of floats are words of the ports. `steps` need not be given
        if an array says it; else they are those of the span. `parameters` are numbers of tunable parameters, from the first
        step on. `begin` is where another run ended. `states` keeps the states of every step.

        Numbers that are clamped, that are beyond stated ranges, and flags are told by a `RunWarning`. A number that is NaN
        is an error.
        """
        import numpy

        columns, numbers, given, steps = self._given(inputs, steps)
        tuned = None
        if parameters:
            unknown = [name for name in parameters if name not in self._defaults]
            if unknown:
                help_ = "declare it `tunable in LEAST .. GREATEST`, or compile with `set`"
                raise UsageError(f"`{unknown[0]}` is no tunable parameter: {help_}")
            kept = {} if begin is None else self._parameters_of(begin)
            tuned = [float(parameters.get(name, kept.get(name, value))) for name, value in self._defaults.items()]
        native = self._native.run(
            steps,
            columns,
            numpy.ascontiguousarray(numbers, dtype=numpy.float64),
            numpy.ascontiguousarray(given, dtype=numpy.int64),
            tuned,
            begin,
            states,
        )
        run = Run(self, native, steps)
        for names, what in [
            (run.clamped, "clamped: they were beyond what the network takes"),
            (run.beyond_range, "beyond the range in the spec, for which the stated errors hold"),
            (run.flags, "set: flags of the network, see docs/host.md"),
        ]:
            if names:
                warnings.warn(RunWarning(f"{', '.join(names)} {what}"), stacklevel=_outside())
        return run

    def _parameters_of(self, begin: Snapshot) -> dict[str, float]:
        with self.host() as host:
            host.restore(begin)
            return dict(zip(host.parameters, host.read_parameters()))

    def _given(self, inputs: Any, steps: int | None):
        """Columns of numbers and words, these, and the number of steps."""
        import numpy

        names = [port.name for port in self.inputs]
        given: list[tuple[int, numpy.ndarray]] = []
        if isinstance(inputs, Mapping):
            for name, values in inputs.items():
                if name not in names:
                    raise UsageError(f"`{name}` is no input; inputs are {', '.join(names) or 'none'}")
                given.append((names.index(name), _array(name, values, 1)))
        elif inputs is not None:
            whole = _array("inputs", inputs, 2)
            if whole.ndim != 2 or whole.shape[1] != len(names):
                raise UsageError(f"inputs have the shape {whole.shape}; (steps, {len(names)}) is needed")
            given = list(enumerate(whole.T))
            steps = len(whole) if steps is None else steps
        lengths = {len(values) for _, values in given if values.ndim == 1}
        if len(lengths) > 1:
            raise UsageError(f"inputs have different numbers of steps: {', '.join(map(str, sorted(lengths)))}")
        if steps is None:
            steps = lengths.pop() if lengths else self.steps
        if isinstance(steps, bool) or not isinstance(steps, (int, numpy.integer)) or steps < 0:
            raise UsageError(f"{steps!r} is no number of steps")
        steps = int(steps)
        if lengths - {steps}:
            raise UsageError(f"inputs have {lengths.pop()} steps, and the run {steps}")
        columns, numbers, words_ = [], [], []
        for index, values in given:
            row = numpy.broadcast_to(values, (steps,))
            into = words_ if row.dtype.kind == "i" else numbers
            columns.append((index, -1 - len(into) if into is words_ else len(into)))
            into.append(row)
        stacked = [numpy.stack(rows, axis=1) if rows else numpy.empty((0, 0)) for rows in (numbers, words_)]
        return columns, stacked[0], stacked[1].astype(numpy.int64), steps

    def host(self) -> Host:
        """The network in its initial state, for closed loops: the interface of `pe_synth.host`."""
        return self._native.open()

    def initial_outputs(self) -> dict[str, float | None]:
        """The outputs at time zero with all inputs 0, as the network has them; None where it has none yet."""
        return dict(zip((output.name for output in self.outputs), self._native.sample_0()))

    def write(self, folder: str | os.PathLike[str], *, header: bool = False, pictures: bool = True) -> None:
        """Writes the files that `pe-synth compile` writes, but for the times that it took.

        The folder is complete or absent; one that was not written by pe-synth is not replaced. `header` adds the C header.
        """
        self._native.write(os.fspath(folder), header, pictures)

    @property
    def pictures(self) -> dict[str, Picture]:
        """The pictures by kind: `ranges`, `outputs`, and where they can be read `occupancy` and `network`."""
        drawn = self._native.pictures()
        return {name.rsplit("_", 1)[1].removesuffix(".svg"): Picture(svg) for name, svg in drawn}

    def _repr_html_(self) -> str:
        pictures = self.pictures
        shown = [kind for kind in ("network", "outputs") if kind in pictures]
        images = "".join(pictures[kind].html(f"{html.escape(self.name)}: {kind}") for kind in shown)
        return f"<pre>{html.escape(str(self))}</pre>{images}"

    def __str__(self) -> str:
        return self._native.table

    def __repr__(self) -> str:
        return f"<Design of {self.name}: {len(self.states)} states, {self.report['cycles_per_step']} cycles per step>"


def compile(
    spec: str | os.PathLike[str] | None = None,
    *,
    text: str | None = None,
    name: str = "model.spec",
    **options: Unpack[CompileOptions],
) -> Design:
    """Compiles a spec: by its path, or its text.

    Files that a text names are read from the folder of `name`, which messages call it. Options are those of
    `pe-synth compile` with `_` in place of `-`: numbers, words, `True` for those without a value, lists, and mappings for
    `set`: `compile(spec, pes=4, step="100us", set={"mu": 2.0}, host=["states"])`; `pe_synth.options` has their types. An
    underscore at the end is ignored: `from_=` is `--from`. A spec that is wrong is a `SpecError`, a warning about it a `SpecWarning`.
    """
    return Design(_native.compile(words(spec, text, name, options), text))


def _port(port: dict[str, Any], word: dict[str, Any]) -> Port:
    span = port.get("range")
    return Port(port["name"], port.get("unit"), span and tuple(span), word["bits"], word["exponent"])


def _array(name: str, values: Any, dimensions: int) -> numpy.ndarray:
    """What was given as an array of floats or of words of 64 bits."""
    import numpy

    array = numpy.asarray(values)
    if array.dtype.kind == "f" and array.dtype.itemsize <= 8:
        array = array.astype(numpy.float64, copy=False)
    elif array.dtype == numpy.int64 and array.ndim > 0:
        pass
    elif array.dtype.kind in "iu" and array.ndim == 0:
        array = array.astype(numpy.float64)
    else:
        raise UsageError(f"`{name}` has the type {array.dtype}: floats are numbers, int64 are words of the ports")
    if array.ndim not in ({0, 1} if dimensions == 1 else {2}):
        needed = "(steps,)" if dimensions == 1 else "(steps, inputs)"
        raise UsageError(f"`{name}` has the shape {array.shape}; {needed} is needed")
    return array
