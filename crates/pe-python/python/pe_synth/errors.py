"""Exceptions and warnings of the package, and the findings that they carry."""

from __future__ import annotations

import json
import warnings
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Place:
    """A stretch of text: lines and columns count from 1, characters each; the end is the first character behind it."""

    file: str
    line: int
    column: int
    end_line: int
    end_column: int
    span: tuple[int, int]
    """First byte in the file, and the first one behind."""


@dataclass(frozen=True)
class Finding:
    """What was found about a spec. `pe-synth explain CODE` and docs/diagnostics.md tell more about a code."""

    severity: str
    """`error` or `warning`."""
    code: str
    message: str
    file: str
    place: Place | None
    """None if it concerns the whole spec."""
    labels: tuple[tuple[Place, str], ...]
    """Other places that have to do with it, with what is there."""
    help: str | None
    text: str
    """All of it, with the lines it is about."""

    @property
    def line(self) -> int | None:
        return self.place and self.place.line

    @property
    def column(self) -> int | None:
        return self.place and self.place.column

    @property
    def span(self) -> tuple[int, int] | None:
        return self.place and self.place.span

    def __str__(self) -> str:
        return self.text


class Error(Exception):
    """A command failed."""

    kind = "internal"
    """One of `model`, `usage`, `file`, `mismatch`, `missing-tool`, `internal`, `interrupted`."""


class SpecError(Error):
    """The spec is wrong, or its result would be. What is beside `findings` is that of the first one."""

    kind = "model"

    def __init__(self, findings: tuple[Finding, ...]) -> None:
        super().__init__("\n\n".join(finding.text for finding in findings))
        self.findings = findings
        first = findings[0]
        self.code = first.code
        self.message = first.message
        self.file = first.file
        self.line = first.line
        self.column = first.column
        self.span = first.span
        self.help = first.help

    def __reduce__(self):
        return SpecError, (self.findings,)


class NoDesign(Error):
    """Every one of several designs is refused, or none keeps the goals."""

    kind = "model"
    frame: Any = None
    """Of a sweep: its rows, which have the reasons."""


class UsageError(Error, ValueError):
    """Options or arguments that do not exist, or do not go together."""

    kind = "usage"


class FileError(Error, OSError):
    """A file cannot be read or written."""

    kind = "file"


class MissingTool(Error):
    """A program that is needed is not installed."""

    kind = "missing-tool"


class InternalError(Error):
    """A bug of the compiler; please report it with the spec and the options."""


class SpecWarning(UserWarning):
    """A warning about a spec."""

    def __init__(self, finding: Finding) -> None:
        super().__init__(finding.text)
        self.finding = finding

    def __reduce__(self):
        return SpecWarning, (self.finding,)


class RunWarning(UserWarning):
    """Numbers of a run that were clamped, or for which the stated errors do not hold; flags that it has set."""


_KINDS: dict[str, type[Error]] = {
    kind.kind: kind for kind in (NoDesign, UsageError, FileError, MissingTool, InternalError)
}


def _place(told: dict[str, Any]) -> Place:
    return Place(
        told["file"],
        told["line"],
        told["column"],
        told["end_line"],
        told["end_column"],
        (told["start"], told["end"]),
    )


def _finding(told: dict[str, Any]) -> Finding:
    return Finding(
        told["severity"],
        told["code"],
        told["message"],
        told["file"],
        told["place"] and _place(told["place"]),
        tuple((_place(label["place"]), label["text"]) for label in told["labels"]),
        told["help"],
        told["text"],
    )


def _raised(kind: str, text: str, findings: str) -> Error:
    """The exception for a failure of the native part."""
    all_findings = tuple(_finding(told) for told in json.loads(findings))
    return SpecError(all_findings) if all_findings else _KINDS.get(kind, InternalError)(text)


def _warn(findings: str) -> None:
    """Warns of findings, as of the line outside of this package that called it."""
    for told in json.loads(findings):
        warnings.warn(SpecWarning(_finding(told)), stacklevel=_outside())


def _outside() -> int:
    """The `stacklevel` of the first caller outside of this package, as seen from the function that asks."""
    import sys

    level, frame = 1, sys._getframe(1)
    while frame.f_back and frame.f_globals.get("__name__", "").split(".")[0] == "pe_synth":
        level, frame = level + 1, frame.f_back
    return level
