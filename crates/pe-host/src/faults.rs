//! The fault table: what each kind of error means, when it is told, and what to do. `docs/host.md` shows it.

/// A kind of error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fault {
    /// As [`Error::kind`](crate::Error::kind) gives it.
    pub kind: &'static str,
    /// What it means.
    pub means: &'static str,
    /// When it is told.
    pub told: &'static str,
    /// What to do.
    pub remedy: &'static str,
}

const fn fault(kind: &'static str, means: &'static str, told: &'static str, remedy: &'static str) -> Fault {
    Fault { kind, means, told, remedy }
}

const AT_ONCE: &str = "at once";
const ON_OPEN: &str = "by `open`";
const IN_TIME: &str = "after the timeout";
const WHEN_READ: &str = "when the host reads the status, at most 20 ms later";

/// All kinds, those of hardware and lines first.
pub const FAULTS: &[Fault] = &[
    fault(
        "wrong-hash",
        "what answers is another design than that of the folder: its wrapper, library, program or snapshot has another hash",
        ON_OPEN,
        "compile and wrap again, configure the board with this design, or open the folder of the design that is there",
    ),
    fault(
        "foreign",
        "what answers is no wrapper of a network, or one of another version, or no server of these messages",
        ON_OPEN,
        "look at address, offset, port and device; take the same version of `pe-synth` at both ends",
    ),
    fault(
        "lost",
        "the connection was closed, or the simulation ended; with its last message",
        AT_ONCE,
        "look at the message; start the server again; a step that was under way may be done or not, so open again",
    ),
    fault(
        "late",
        "no answer came, or a run did not go on",
        IN_TIME,
        "look at cable, clock and clock enable of the board; a busy computer or a slow line needs a longer timeout; `reset` before \
         going on",
    ),
    fault(
        "damaged",
        "answers are cut short or changed, five times in a row, or are answers to something else",
        AT_ONCE,
        "look at cable, baud rate and ground; `reset` before going on",
    ),
    fault(
        "time-exceeded",
        "a step took more clocks than the budget; the network stands still in the middle of it",
        WHEN_READ,
        "a budget below `CLOCKS_MAX` is too small; `reset` before going on",
    ),
    fault(
        "overrun",
        "a paced step was not ready when its time came, and the run ended",
        WHEN_READ,
        "take a longer period (`counters` has the least slack) or a faster design, or let runs go on and look at the number \
         of overruns; `reset` before going on",
    ),
    fault(
        "refused",
        "the bus answers an access by an error",
        AT_ONCE,
        "somebody else uses the registers, or the server refuses what its hardware cannot do; `reset`",
    ),
    fault(
        "no-sample",
        "an output was read that has no value before the next step: its equation is not defined in the initial state with \
         inputs of 0, or it shows no state and states were replaced",
        AT_ONCE,
        "run a step, or use `read_defined`",
    ),
    fault(
        "count",
        "another number of values is needed",
        AT_ONCE,
        "`inputs` and `parameters` name them; nothing was done",
    ),
    fault(
        "not-a-number",
        "what was given for an input or parameter is NaN",
        AT_ONCE,
        "look at its origin; nothing was done",
    ),
    fault("range", "a word does not fit its format", AT_ONCE, "the map has least and greatest words; nothing was done"),
    fault(
        "lacks",
        "the network was compiled without what is asked for, or the transport has no clocks",
        AT_ONCE,
        "`compile --host restart,states,flags`; `wrap` again",
    ),
    fault("file", "a file or device cannot be opened, or holds something else", ON_OPEN, "see the message"),
    fault("transport", "the transport is not understood", ON_OPEN, "take one of the table above"),
    fault(
        "missing-tool",
        "a program that the transport needs is not installed",
        ON_OPEN,
        "the message says how to install it",
    ),
    fault("tool", "a program that builds or simulates the network failed", ON_OPEN, "see its message"),
];

/// The table of `docs/host.md`.
pub fn table() -> String {
    let mut text = String::from("| kind | what it means | told | what to do |\n|---|---|---|---|\n");
    for Fault { kind, means, told, remedy } in FAULTS {
        text += &format!("| `{kind}` | {means} | {told} | {remedy} |\n");
    }
    text
}
