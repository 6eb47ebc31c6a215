"""Judging a step, and sweeps over many designs."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from . import _native
from ._options import words
from .errors import Finding, NoDesign, UsageError, _finding
from .options import AccuracyOptions, CheckOptions, ExploreOptions

if TYPE_CHECKING:
    import pandas


class Check:
    """What `pe-synth check` says about the step of a model."""

    def __init__(self, result: dict[str, Any], text: str) -> None:
        self.findings: tuple[Finding, ...] = tuple(_finding(told) for told in result.pop("findings"))
        """Errors if the step is refused, and warnings."""
        self.result = result
        """All figures, with the keys of `check --message-format json`; times in seconds, errors relative."""
        self.text = text
        """All of it in words."""

    @property
    def verdict(self) -> str:
        """What is to be thought of the step, in a word or two."""
        return self.result["verdict"]

    @property
    def refused(self) -> bool:
        """Whether `compile` refuses the step."""
        return any(finding.severity == "error" for finding in self.findings)

    def __str__(self) -> str:
        return self.text

    def __repr__(self) -> str:
        return f"<Check of {self.result['model']}: {self.verdict}>"


def check(
    spec: str | os.PathLike[str] | None = None,
    *,
    text: str | None = None,
    name: str = "model.spec",
    **options: Unpack[CheckOptions],
) -> Check:
    """Judges before anything is built whether the step is stable and accurate enough, and what would help.

    A step that is refused is a result; only a spec or options that are wrong are raised. Arguments as of `compile`, with the
    options of `pe-synth check`.
    """
    result, told = _native.check(words(spec, text, name, options), text)
    return Check(json.loads(result), told)


def explore(
    spec: str | os.PathLike[str] | None = None,
    *,
    text: str | None = None,
    name: str = "model.spec",
    output: str | os.PathLike[str] | None = None,
    **options: Unpack[ExploreOptions],
) -> pandas.DataFrame:
    """Compiles all combinations of lists of options: a row for each, with the columns of `points.csv`.

    Lists are lists of Python: `explore(spec, pes=[1, 2, 4], solver=["rk4", "heun"])`. `output` is a folder for all files,
    the page among them; a sweep that Ctrl-C has ended is there and goes on with `resume=True`. Other arguments as of
    `compile`, with the options of `pe-synth explore`. Raises `NoDesign`, which has the rows as `frame`, if no point can be
    compiled or none keeps the goals.
    """
    return _swept(_native.explore, "points.csv", spec, text, name, output, options)


def accuracy(
    spec: str | os.PathLike[str] | None = None,
    *,
    text: str | None = None,
    name: str = "model.spec",
    output: str | os.PathLike[str] | None = None,
    **options: Unpack[AccuracyOptions],
) -> pandas.DataFrame:
    """Error against run time for lists of solvers, steps and words: a row for each, with the columns of `accuracy.csv`.

    Arguments as of `explore`, with the options of `pe-synth accuracy`.
    """
    return _swept(_native.accuracy, "accuracy.csv", spec, text, name, output, options)


def _swept(command, table, spec, text, name, output, options) -> pandas.DataFrame:
    if output is None and (options.get("resume") or options.get("store")):
        raise UsageError("a sweep that goes on, or has a store, needs a folder: give `output`")
    given = words(spec, text, name, options)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(output) if output is not None else Path(scratch) / "sweep"
        try:
            command([f"--output={folder}", *given], text)
        except NoDesign as error:
            error.frame = _frame(folder / table)
            raise
        return _frame(folder / table)


def _frame(path: Path) -> pandas.DataFrame | None:
    import pandas

    return pandas.read_csv(path) if path.exists() else None
