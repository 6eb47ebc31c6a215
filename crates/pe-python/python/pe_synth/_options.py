"""Options of Python as words of a command: `max_error=1e-3` is `--max-error=0.001`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from .errors import UsageError

_OTHERWISE = {
    "quiet": "nothing is printed in any case",
    "message_format": "messages are exceptions and warnings",
    "watch": "call it again after a change",
    "cluster": "jobs of a cluster run the command: `pe-synth explore --cluster`",
    "shard": "parts of a sweep run the command: `pe-synth explore --shard`",
    "all": "all ranges are part of the result",
    "output": "`Design.write` takes it",
    "header": "`Design.write` takes it",
    "no_pictures": "`Design.write` takes `pictures`",
}
"""Options of commands that are something else here."""

_REPEATED = ("set", "observe", "allow")
"""Options that are given once for each value."""


def words(spec: str | os.PathLike[str] | None, text: str | None, name: str, options: Mapping[str, Any]) -> list[str]:
    """The words behind a command's name."""
    told: list[str] = []
    for key, value in options.items():
        option = key.rstrip("_").replace("_", "-")
        if key in _OTHERWISE:
            raise UsageError(f"`{key}` is no option here: {_OTHERWISE[key]}")
        if value is None or value is False:
            continue
        if value is True:
            told.append(f"--{option}")
        elif isinstance(value, Mapping):
            told.extend(f"--{option}={name}={_word(key, one)}" for name, one in value.items())
        elif key in _REPEATED and not isinstance(value, str):
            told.extend(f"--{option}={_word(key, one)}" for one in value)
        else:
            told.append(f"--{option}={_word(key, value)}")
    if spec is not None and text is not None:
        raise UsageError("give the path of a spec or its text, not both")
    if text is not None:
        if not isinstance(text, str):
            raise UsageError(f"the text of a spec is a str, not {type(text).__name__}")
        return [*told, "--", name]
    if spec is None:
        return told
    path = os.fspath(spec)
    if not isinstance(path, str) or "\n" in path:
        raise UsageError("a spec is given by its path; its text is given as `text=`")
    return [*told, "--", path if path != "-" else "./-"]


def _word(key: str, value: Any) -> str:
    """A value as a word."""
    if isinstance(value, str):
        return value
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, (list, tuple)) or hasattr(value, "tolist"):
        listed = value.tolist() if hasattr(value, "tolist") else value
        return ",".join(_word(key, one) for one in listed) if isinstance(listed, (list, tuple)) else _word(key, listed)
    if isinstance(value, (int, float)):
        return repr(value)
    raise UsageError(f"`{key}` cannot be a {type(value).__name__}")
