//! What runs a network, in words.

use crate::design::count;
use crate::error::Error;

/// Flags of a network; they stay until they are cleared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags(u32);

impl Flags {
    /// A step took an input word beyond `words` of the map, and the nearest operand took its place.
    pub const INPUT_CLAMPED: Flags = Flags(1);
    /// A word that was written or sent saturated.
    pub const SATURATED: Flags = Flags(2);
    /// An operand was too large for a sum in front of a multiplier, and the sum may have wrapped.
    pub const OPERAND_TOO_LARGE: Flags = Flags(4);
    /// A number was out of range of which that was proven impossible, and wrapped. Networks in hardware have no such flag.
    pub const PROOF_BROKEN: Flags = Flags(8);
    /// One of the first three; the network does not tell which.
    pub const OVERFLOW: Flags = Flags(16);

    /// Names and flags, as other languages see them.
    pub const NAMES: [(&'static str, Flags); 5] = [
        ("input_clamped", Flags::INPUT_CLAMPED),
        ("saturated", Flags::SATURATED),
        ("operand_too_large", Flags::OPERAND_TOO_LARGE),
        ("proof_broken", Flags::PROOF_BROKEN),
        ("overflow", Flags::OVERFLOW),
    ];

    /// Of the bits in `docs/library.md`.
    pub(crate) fn of_bits(bits: u32) -> Flags {
        Flags(bits)
    }

    /// Whether any of these is set.
    pub fn has(self, any: Flags) -> bool {
        self.0 & any.0 != 0
    }

    /// Whether none is set.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Names of those that are set.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Flags::NAMES.into_iter().filter(move |(_, flag)| self.has(*flag)).map(|(name, _)| name)
    }

    /// These if a condition holds, else none.
    #[must_use]
    pub fn when(self, condition: bool) -> Flags {
        if condition { self } else { Flags::default() }
    }
}

impl std::ops::BitAnd for Flags {
    type Output = Flags;

    fn bitand(self, these: Flags) -> Flags {
        Flags(self.0 & these.0)
    }
}

impl std::ops::BitOr for Flags {
    type Output = Flags;

    fn bitor(self, more: Flags) -> Flags {
        Flags(self.0 | more.0)
    }
}

/// What a run did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ran {
    /// Steps.
    pub steps: u64,
    /// Paced steps that were not ready in time.
    pub overruns: u64,
}

/// What was counted since the initial state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Clocks with a step under way.
    pub clocks: u64,
    /// Clocks from the beginning of the longest step to its outputs; none before any step.
    pub longest: Option<u32>,
    /// The same of the shortest one.
    pub shortest: Option<u32>,
    /// Clocks that were left when a paced step was ready, in the worst case; below 0 if it was late. None before any.
    pub least_slack: Option<i32>,
    /// Paced steps that were not ready in time.
    pub overruns: u64,
}

/// What watches over the time that steps take, in clocks; hardware and simulations of it only.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Limits {
    /// Most clocks of a step; 0 is no limit. A longer step ends the run with [`Error::TimeExceeded`].
    pub clock_budget: u32,
    /// Clocks from the beginning of a step to that of the next one; 0 is as fast as possible. A step that is not ready in
    /// time ends the run with [`Error::Overrun`], unless the run is to go on.
    pub pace_period: u32,
    /// A run goes on after an overrun; [`Ran::overruns`] counts them.
    pub go_on: bool,
}

/// A network that can be run, in words: integers of 64 bits with the values of the words at the ports.
///
/// All engines share one order of events, `docs/host.md`: words that are written act in all steps that follow; after a
/// run the outputs are those of its last step; before the first step they are those of the initial state.
pub trait Engine: Send {
    /// Brings back the initial state, without flags. Inputs are undefined until they are written.
    ///
    /// # Errors
    /// [`Error::Lacks`], or those of the transport.
    fn reset(&mut self) -> Result<(), Error>;

    /// Words of all input ports.
    ///
    /// # Errors
    /// Those of the transport.
    fn write(&mut self, words: &[i64]) -> Result<(), Error>;

    /// Runs so many steps.
    ///
    /// # Errors
    /// Those of the transport, [`Error::TimeExceeded`] and [`Error::Overrun`].
    fn run(&mut self, steps: u64) -> Result<Ran, Error>;

    /// Words of all outputs; those without a sample 0 are none before the first step, and after a state was set.
    ///
    /// # Errors
    /// Those of the transport.
    fn read(&mut self, words: &mut [Option<i64>]) -> Result<(), Error>;

    /// Writes, runs at least one step and reads, in one message if the transport has messages.
    ///
    /// # Errors
    /// Those of the transport, [`Error::TimeExceeded`] and [`Error::Overrun`].
    fn exchange(&mut self, inputs: &[i64], steps: u64, outputs: &mut [Option<i64>]) -> Result<Ran, Error> {
        self.write(inputs)?;
        let ran = self.run(steps)?;
        self.read(outputs)?;
        Ok(ran)
    }

    /// Runs a step for each frame of words of all input ports, and appends the words of all outputs of each step; in few
    /// messages if the transport has messages. With an error, what was appended is no more than part of it.
    ///
    /// # Errors
    /// [`Error::Count`]; those of the transport, [`Error::TimeExceeded`] and [`Error::Overrun`].
    fn run_frames(&mut self, frames: usize, inputs: &[i64], outputs: &mut Vec<i64>) -> Result<Ran, Error>;

    /// The state words: stored words of all states in the order of the map, then of each tick the steps since its last
    /// sample.
    ///
    /// # Errors
    /// [`Error::Lacks`], or those of the transport.
    fn state(&mut self, words: &mut [i64]) -> Result<(), Error>;

    /// Goes on from a state.
    ///
    /// # Errors
    /// [`Error::Lacks`], or those of the transport.
    fn set_state(&mut self, words: &[i64]) -> Result<(), Error>;

    /// Gives the tunable parameters stored words, in the order of the map, all between the same two steps: they act in all
    /// steps that follow. Outputs stay those of the sample until the next step.
    ///
    /// # Errors
    /// [`Error::Lacks`], [`Error::Count`] or [`Error::Range`], or those of the transport.
    fn set_parameters(&mut self, words: &[i64]) -> Result<(), Error>;

    /// Flags.
    ///
    /// # Errors
    /// Those of the transport.
    fn flags(&mut self) -> Result<Flags, Error>;

    /// Clears the flags.
    ///
    /// # Errors
    /// [`Error::Lacks`], or those of the transport.
    fn clear_flags(&mut self) -> Result<(), Error>;

    /// What hardware, or a simulation of it, has counted.
    ///
    /// # Errors
    /// [`Error::Lacks`], or those of the transport.
    fn counters(&mut self) -> Result<Counters, Error> {
        Err(Error::Lacks("clocks to count"))
    }

    /// Watches over the time that steps take.
    ///
    /// # Errors
    /// [`Error::Lacks`], or those of the transport.
    fn limit(&mut self, limits: &Limits) -> Result<(), Error> {
        if *limits == Limits::default() { Ok(()) } else { Err(Error::Lacks("clocks to watch")) }
    }
}

/// Runs frames as so many exchanges: for engines without messages. In with the number of frames, their words, and where the
/// words of the outputs go.
pub(crate) fn one_by_one(
    engine: &mut (impl Engine + ?Sized),
    ports: usize,
    shown: usize,
    (frames, inputs, outputs): (usize, &[i64], &mut Vec<i64>),
) -> Result<Ran, Error> {
    count(frames * ports, inputs.len())?;
    let (mut words, mut ran) = (vec![None; shown], Ran::default());
    for frame in 0..frames {
        let exchanged = engine.exchange(&inputs[frame * ports..(frame + 1) * ports], 1, &mut words)?;
        (ran.steps, ran.overruns) = (ran.steps + exchanged.steps, ran.overruns + exchanged.overruns);
        outputs.extend(words.iter().map(|word| word.unwrap_or(0)));
    }
    Ok(ran)
}
