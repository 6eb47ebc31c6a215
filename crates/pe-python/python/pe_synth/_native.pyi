"""What the package stands on; `pe_synth.host` has the part about hosts, other modules wrap the remainder."""

from collections.abc import Sequence
from os import PathLike
from types import TracebackType
from typing import Any

TRANSPORTS: dict[str, str]
"""All transports, with what they are."""

class HostError(Exception):
    """A call failed, within the timeout."""

    kind: str
    """One of the kinds in docs/host.md, such as `late`."""

class Written:
    """What became of the numbers that were written."""

    @property
    def clamped(self) -> list[str]:
        """Inputs whose numbers were clamped."""
    @property
    def beyond_range(self) -> list[str]:
        """Inputs whose numbers are beyond the range in the spec, for which stated errors hold."""

class Exchanged(Written):
    """What an exchange gave."""

    @property
    def outputs(self) -> list[float]:
        """All outputs after the last step."""
    @property
    def overruns(self) -> int:
        """Paced steps that were not ready in time."""

class Frames(Written):
    """What a run of frames gave."""

    @property
    def outputs(self) -> list[list[float]]:
        """All outputs after each step."""
    @property
    def overruns(self) -> int:
        """Paced steps that were not ready in time."""

class Snapshot:
    """Everything that a network goes on from but its inputs. Any network of the same design takes it."""

    def __init__(self, hash: str, sample: int, state: Sequence[int]) -> None: ...
    @property
    def hash(self) -> str: ...
    @property
    def sample(self) -> int: ...
    @property
    def state(self) -> list[int]: ...

class Host:
    """A network behind a transport. All methods raise `HostError`."""

    @property
    def inputs(self) -> list[str]:
        """Names of the inputs, in the order of numbers."""
    @property
    def outputs(self) -> list[str]:
        """Names of the outputs, in the order of numbers."""
    @property
    def parameters(self) -> list[str]:
        """Names of the tunable parameters, in the order of numbers."""
    @property
    def limits(self) -> list[tuple[float, float]]:
        """The numbers of each input that are not clamped."""
    @property
    def hash(self) -> str:
        """Hash of the design."""
    @property
    def step(self) -> float:
        """Time in seconds that a step stands for, early steps aside."""
    @property
    def sample(self) -> int:
        """Steps since the initial state."""
    @property
    def time(self) -> float:
        """Time of that sample in seconds."""
    def reset(self) -> None:
        """Back to the initial state, with all inputs 0 and no flags."""
    def write(self, numbers: Sequence[float]) -> Written:
        """Gives all inputs a number; they act from the next step on."""
    def write_words(self, words: Sequence[int]) -> None:
        """The same with the words of the ports."""
    def read_parameters(self) -> list[float]:
        """The numbers of the tunable parameters that the network computes with."""
    def write_parameters(self, numbers: Sequence[float]) -> Written:
        """Gives all tunable parameters a number; they act from the next step on."""
    def run(self, steps: int = 1) -> int:
        """Runs so many steps; gives the paced steps that were not ready in time."""
    def read(self) -> list[float]:
        """All outputs; an error if one has no value before the first step."""
    def read_defined(self) -> list[float | None]:
        """All outputs, None for those that have no value before the first step."""
    def read_words(self) -> list[int | None]:
        """The same as words of the ports."""
    def exchange(self, numbers: Sequence[float], steps: int = 1) -> Exchanged:
        """Writes, runs so many steps and reads."""
    def exchange_words(self, words: Sequence[int], steps: int = 1) -> list[int | None]:
        """The same with words of the ports."""
    def run_frames(self, frames: Sequence[Sequence[float]]) -> Frames:
        """Runs a step for each frame of numbers of all inputs, one after the other, in few messages."""
    def run_frames_words(self, frames: Sequence[Sequence[int]]) -> list[list[int]]:
        """The same with words of the ports."""
    def snapshot(self) -> Snapshot:
        """Takes the state between two steps."""
    def restore(self, snapshot: Snapshot) -> None:
        """Goes on from a snapshot, which may come from another transport."""
    def flags(self) -> list[str]:
        """Names of the flags that are set."""
    def clear_flags(self) -> None:
        """Clears all flags."""
    def limit(self, clock_budget: int = 0, pace_period: int = 0, go_on: bool = False) -> None:
        """Watches over the clocks that steps take; 0 is no limit."""
    def counters(self) -> dict[str, int | None]:
        """What the hardware has counted: clocks, longest, shortest, least_slack, overruns."""
    def close(self) -> None:
        """Ends the connection or simulation; every later call is an error."""
    def __enter__(self) -> Host: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None: ...

def open_host(
    folder: str | PathLike[str],
    transport: str = "model",
    timeout: float | None = None,
    library: str | PathLike[str] | None = None,
) -> Host:
    """Opens a network of a folder that `compile` wrote, in its initial state and with all inputs 0.

    timeout in seconds; None is what the transport needs. library is a reference that was built before, for `fast` and
    `clocked`.
    """

class Run:
    """What a run gave. Arrays are bytes of 8 per number, step by step."""

    flags: list[str]
    clamped: list[str]
    beyond_range: list[str]
    end: Snapshot
    def time(self) -> bytearray: ...
    def outputs(self) -> bytearray: ...
    def output_words(self) -> bytearray: ...
    def states(self) -> bytearray | None: ...
    def state_words(self) -> bytearray | None: ...

class Design:
    """A compiled design."""

    report: str
    """In JSON."""
    table: str
    map: str
    """In JSON."""
    steps: int
    initial: list[float]
    def sample_0(self) -> list[float | None]: ...
    def pictures(self) -> list[tuple[str, str]]:
        """Names of files and SVG."""
    def write(self, folder: str, header: bool, pictures: bool) -> None: ...
    def open(self) -> Host: ...
    def run(
        self,
        steps: int,
        columns: Sequence[tuple[int, int]],
        numbers: Any,
        words: Any,
        parameters: Sequence[float] | None,
        begin: Snapshot | None,
        states: bool,
    ) -> Run:
        """Runs steps. columns: for each given input its number and its column, -1 - c for column c of words."""

def compile(words: Sequence[str], text: str | None) -> Design: ...
def check(words: Sequence[str], text: str | None) -> tuple[str, str]:
    """The result in JSON, and in words."""

def explore(words: Sequence[str], text: str | None) -> None: ...
def accuracy(words: Sequence[str], text: str | None) -> None: ...
def curves(title: str, time: Sequence[float], curves: Sequence[tuple[str, str, Sequence[float]]]) -> str:
    """A picture in SVG: curves with a name, a unit and numbers."""
