/// How a network is computed. Both forms give the same words and flags after every step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// What a step computes, without clocks.
    Fast,
    /// Every register, clock by clock.
    Clocked,
}

/// Why a call had no effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error {
    /// The slice is not as long as there are inputs, outputs or state words.
    Length,
    /// The word with this number does not fit its format.
    Range(usize),
    /// The step reads more of the one before than the states, so it has no fast form.
    NoFastForm,
}

impl std::fmt::Display for Error {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Error::Length => write!(f, "there are not as many words"),
            Error::Range(word) => write!(f, "word {word} does not fit its format"),
            Error::NoFastForm => write!(f, "a step reads more of the one before than the states"),
        }
    }
}

impl std::error::Error for Error {}

/// Bits of [`Network::flags`]: an input word was too large for an operand, so that the largest one took its place.
pub const INPUT_CLAMPED: u32 = 1;
/// A word that was written or sent saturated.
pub const SATURATED: u32 = 2;
/// An operand was too large for a sum in front of a multiplier.
pub const OPERAND_TOO_LARGE: u32 = 4;
/// A number was out of range of which that was proven impossible, and wrapped: words since are not those of the model.
pub const PROOF_BROKEN: u32 = 8;

enum Running {
    Fast(Fast),
    Clocked(Clocked),
}

/// The network between two steps.
pub struct Network {
    running: Running,
    images: Vec<Memories>,
    /// Operands of ports, then of ticks.
    operands: Vec<i64>,
    /// Whether one of those of ports is clamped.
    clamped: bool,
    /// Steps since the last sample, of each tick.
    since: Vec<u64>,
    /// Whether a step was done since the states were set.
    stepped: bool,
    flags: u32,
    pe_flags: Vec<u32>,
}

{% if rings -%}
/// The stored word of a state that is kept as an operand alone.
fn kept(operand: i64) -> i64 {
    (operand << (WORD_BITS - DATA_BITS)) + OFFSET
}

{% endif -%}
/// Port word of a stored word, and whether it was out of range and is clamped.
fn port_word(stored: i64) -> (i64, bool) {
    let rounded = (stored - OFFSET + half(GUARD_BITS)) >> GUARD_BITS;
    let largest = (1i64 << (STORAGE_BITS - 1)) - 1;
    let clamped = rounded.clamp(-largest - 1, largest);
    (clamped, clamped != rounded)
}

impl Network {
    /// Number of input ports; words of each have [`Network::PORT_BITS`].
    pub const INPUTS: usize = INPUT_COUNT - TICKS.len();
    /// Number of outputs.
    pub const OUTPUTS: usize = OUTPUTS.len();
    /// Number of state words: the stored words of the states, in the order of the map, then for each tick the steps since
    /// its last sample.
    pub const STATE_WORDS: usize = STATES.len() + TICKS.len();
    /// Bits of the words of ports, two's complement.
    pub const PORT_BITS: u32 = STORAGE_BITS;
    /// Bits of stored words, two's complement.
    pub const STORED_BITS: u32 = WORD_BITS;
    /// Clocks from one step to the next in free run.
    pub const CLOCKS: u32 = PERIOD as u32;

    /// The network in its initial state, with all inputs 0.
    ///
    /// # Errors
    /// [`Error::NoFastForm`], which no design of the compiler has.
    pub fn new(form: Form) -> Result<Network, Error> {
        Network::with_images(form, images())
    }

    fn with_images(form: Form, images: Vec<Memories>) -> Result<Network, Error> {
        let running = match form {
            Form::Fast => Running::Fast(Fast::new().ok_or(Error::NoFastForm)?),
            Form::Clocked => Running::Clocked(Clocked::new()),
        };
        let mut network = Network {
            running,
            images,
            operands: Vec::new(),
            clamped: false,
            since: Vec::new(),
            stepped: false,
            flags: 0,
            pe_flags: Vec::new(),
        };
        network.reset();
        Ok(network)
    }

    /// Back to what [`Network::new`] gives.
    pub fn reset(&mut self) {
        self.operands = vec![0; INPUT_COUNT];
        self.take_inputs(&[0; Network::INPUTS]);
        self.since = TICKS.iter().map(|tick| tick.done % tick.steps).collect();
        self.clear_flags();
        let images = std::mem::take(&mut self.images);
        self.restart(&images);
        self.images = images;
    }

    fn restart(&mut self, memories: &[Memories]) {
        match &mut self.running {
            Running::Fast(fast) => fast.restart(memories),
            Running::Clocked(clocked) => clocked.restart(memories),
        }
        self.stepped = false;
    }

    /// Sets the words of all ports, for this step and those that follow. Words between the limits in the map and the end
    /// of the format are clamped, which sets a flag in each step.
    ///
    /// # Errors
    /// [`Error::Length`] or [`Error::Range`]; the inputs stay.
    pub fn set_inputs(&mut self, words: &[i64]) -> Result<(), Error> {
        fit(words, Network::INPUTS, |_, word| signed(word, STORAGE_BITS) == word)?;
        self.take_inputs(words);
        Ok(())
    }

    fn take_inputs(&mut self, words: &[i64]) {
        self.clamped = false;
        for (operand, word) in self.operands[..Network::INPUTS].iter_mut().zip(words) {
            let largest = (1i64 << (WORD_BITS - 1)) - 1;
            let stored = (word << GUARD_BITS) + OFFSET;
            self.clamped |= stored > largest;
            *operand = stored.min(largest) >> (WORD_BITS - DATA_BITS);
        }
    }

    /// Runs so many steps.
    pub fn step(&mut self, steps: u64) {
        (0..steps).for_each(|_| self.advance(&mut None));
    }

    /// Runs a step; without clocks there are no memory writes.
    fn advance(&mut self, observer: &mut Observer) {
        let due = self.operands[Network::INPUTS..].iter_mut().zip(&mut self.since);
        for ((operand, since), tick) in due.zip(TICKS) {
            *operand = if *since == 0 { tick.one } else { 0 };
            *since = (*since + 1) % tick.steps;
        }
        if self.clamped {
            self.flags |= INPUT_CLAMPED;
        }
        match &mut self.running {
            Running::Fast(fast) => fast.step(&self.operands, &mut self.pe_flags),
            Running::Clocked(clocked) => clocked.step(&self.operands, &mut self.pe_flags, observer),
        }
        self.stepped = true;
        if OUTPUTS.iter().enumerate().any(|(index, output)| output.proven && port_word(self.captured(index)).1) {
            self.flags |= PROOF_BROKEN;
        }
    }

    /// Stored word behind an output after a step.
    fn captured(&self, output: usize) -> i64 {
        match &self.running {
            Running::Fast(fast) => fast.captured(output),
            Running::Clocked(clocked) => clocked.captured[output],
        }
    }

    /// Stored word of a state.
    fn stored(&self, state: &State) -> i64 {
        match &self.running {
            Running::Fast(fast) => fast.state(state),
            Running::Clocked(clocked) => clocked.state(state),
        }
    }

    /// Port word of an output after the last step. Before the first step after [`Network::new`], [`Network::reset`] or
    /// [`Network::set_state`] it is that of the state which the output shows, and none if it shows no state.
    pub fn output(&self, index: usize) -> Option<i64> {
        let output = OUTPUTS.get(index)?;
        let stored = if self.stepped { self.captured(index) } else { self.stored(&STATES[output.state?]) };
        let (clamped, _) = port_word(stored);
        Some(clamped)
    }

    /// Everything that the following steps depend on but the inputs: see [`Network::STATE_WORDS`].
    ///
    /// # Errors
    /// [`Error::Length`].
    pub fn state(&self, words: &mut [i64]) -> Result<(), Error> {
        if words.len() != Network::STATE_WORDS {
            return Err(Error::Length);
        }
        let (states, since) = words.split_at_mut(STATES.len());
        states.iter_mut().zip(STATES).for_each(|(word, state)| *word = self.stored(state));
        since.iter_mut().zip(&self.since).for_each(|(word, since)| *word = *since as i64);
        Ok(())
    }

    /// Goes on from a state; inputs and flags stay.
    ///
    /// # Errors
    /// [`Error::Length`] or [`Error::Range`]; the state stays.
    pub fn set_state(&mut self, words: &[i64]) -> Result<(), Error> {
        fit(words, Network::STATE_WORDS, |index, word| match index.checked_sub(STATES.len()) {
            None => signed(word, WORD_BITS) == word,
            Some(tick) => (0..TICKS[tick].steps as i64).contains(&word),
        })?;
        let mut memories = self.images.clone();
        for (state, word) in STATES.iter().zip(words) {
            let pe = &mut memories[state.pe];
{%- if rings %}
            if !state.ring {
                pe.base[state.base_word()] = *word;
            }
{%- else %}
            pe.base[state.base_word()] = *word;
{%- endif %}
            pe.own[state.address] = word >> (WORD_BITS - DATA_BITS);
            for (pe, place) in state.copies {
                memories[*pe].imported[*place] = word >> (WORD_BITS - DATA_BITS);
            }
        }
        self.since = words[STATES.len()..].iter().map(|steps| *steps as u64).collect();
        self.restart(&memories);
        Ok(())
    }

    /// What happened since the flags were cleared: bits such as [`SATURATED`].
    pub fn flags(&self) -> u32 {
        (0..PES.len()).fold(self.flags, |flags, pe| flags | self.pe_flags(pe))
    }

    /// The flags of a PE.
    fn pe_flags(&self, pe: usize) -> u32 {
        match self.pe_flags[pe] {
            0 => 0,
            flags if PES[pe].proven => flags | PROOF_BROKEN,
            flags => flags,
        }
    }

    /// Clears all flags.
    pub fn clear_flags(&mut self) {
        self.flags = 0;
        self.pe_flags = vec![0; PES.len()];
    }
}

fn fit(words: &[i64], count: usize, fits: impl Fn(usize, i64) -> bool) -> Result<(), Error> {
    if words.len() != count {
        return Err(Error::Length);
    }
    match words.iter().enumerate().find(|(index, word)| !fits(*index, **word)) {
        Some((index, _)) => Err(Error::Range(index)),
        None => Ok(()),
    }
}
