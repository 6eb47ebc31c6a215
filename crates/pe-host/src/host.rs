//! The interface in numbers.

use std::path::Path;

use pe_map::{Input, Map, Meaning, Outside, Parameter};

use crate::design::{Design, States, count};
use crate::engine::{Counters, Engine, Flags, Limits, Ran};
use crate::error::Error;
use crate::transport::{Settings, Transport};

/// What became of the numbers that were written; indices count as the numbers do.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[must_use = "numbers may have been clamped"]
pub struct Written {
    /// Beyond `limits` of the map: the nearest word took their place.
    pub clamped: Vec<usize>,
    /// Beyond `range` of the map, for which alone formats and errors were judged. They act as they are, unless clamped.
    pub beyond_range: Vec<usize>,
}

/// What an exchange did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[must_use = "numbers may have been clamped"]
pub struct Exchanged {
    /// What became of the numbers that were written.
    pub written: Written,
    /// What the run did.
    pub ran: Ran,
}

/// Everything that a network goes on from but its inputs, between two steps. Any network of the same design takes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Snapshot {
    /// Hash of the design.
    pub hash: String,
    /// Steps since the initial state.
    pub sample: u64,
    /// The state words; see [`Engine::state`].
    pub state: Vec<i64>,
}

/// A network behind a transport.
///
/// Outputs are those of a sample. Sample 0 are the outputs of the initial state; sample k + 1 is what step k + 1 makes of
/// sample k and of the inputs that were written last.
pub struct Host {
    design: Design,
    engine: Box<dyn Engine>,
    /// Ports of the inputs that a caller gives.
    inputs: Vec<usize>,
    /// Port of the step ratio, of designs with early steps.
    ratio: Option<usize>,
    /// Words of all ports.
    words: Vec<i64>,
    outputs: Vec<Option<i64>>,
    /// Stored words of the tunable parameters.
    parameters: Vec<i64>,
    sample: u64,
}

impl Host {
    /// Opens a network of a folder, in its initial state and with all inputs 0.
    ///
    /// # Errors
    /// [`Error::WrongHash`] if what answers is another design; those of the transport.
    pub fn open(folder: &Path, transport: &Transport, settings: &Settings) -> Result<Host, Error> {
        let design = Design::open(folder)?;
        let engine = transport.open(&design, settings)?;
        Host::over(design, engine)
    }

    /// A network in its initial state that an engine runs.
    ///
    /// # Errors
    /// Those of the transport.
    pub fn over(design: Design, engine: Box<dyn Engine>) -> Result<Host, Error> {
        let map = design.map();
        let of = |meaning| (0..map.inputs.len()).filter(move |port| map.inputs[*port].meaning == meaning);
        let mut host = Host {
            inputs: of(Meaning::Quantity).collect(),
            ratio: of(Meaning::StepRatio).next(),
            words: vec![0; map.inputs.len()],
            outputs: vec![None; map.outputs.len()],
            parameters: Vec::new(),
            sample: 0,
            engine,
            design,
        };
        host.begin()?;
        Ok(host)
    }

    /// The map of the design.
    pub fn map(&self) -> &Map {
        self.design.map()
    }

    /// The inputs whose numbers are written, in this order.
    pub fn inputs(&self) -> impl ExactSizeIterator<Item = &Input> {
        self.inputs.iter().map(|port| &self.design.map().inputs[*port])
    }

    /// Number of the sample that the outputs are: steps since the initial state.
    pub fn sample(&self) -> u64 {
        self.sample
    }

    /// Time of that sample in seconds.
    pub fn time(&self) -> f64 {
        let (_, left, from, step) = self.stretch();
        from + left as f64 * step
    }

    /// Back to the initial state, with all inputs 0 and no flags.
    ///
    /// # Errors
    /// [`Error::Lacks`] if the network has no restart; those of the transport.
    pub fn reset(&mut self) -> Result<(), Error> {
        self.engine.reset()?;
        self.begin()
    }

    fn begin(&mut self) -> Result<(), Error> {
        self.sample = 0;
        self.parameters = self.design.map().parameters_of(&self.design.map().initial_state());
        self.words.fill(0);
        self.write_ratio();
        self.engine.write(&self.words)
    }

    /// Gives the inputs numbers, in the order of [`Host::inputs`]; they act from the next step on.
    ///
    /// # Errors
    /// [`Error::Count`] or [`Error::NotANumber`], in which case nothing was written; those of the transport.
    pub fn write(&mut self, numbers: &[f64]) -> Result<Written, Error> {
        let written = self.convert(numbers)?;
        self.engine.write(&self.words)?;
        Ok(written)
    }

    /// The same with words of the ports.
    ///
    /// # Errors
    /// [`Error::Count`] or [`Error::Range`], in which case nothing was written; those of the transport.
    pub fn write_words(&mut self, words: &[i64]) -> Result<(), Error> {
        self.take_words(words)?;
        self.engine.write(&self.words)
    }

    /// The tunable parameters, in the order in which [`Host::write_parameters`] takes their numbers.
    pub fn parameters(&self) -> &[Parameter] {
        &self.design.map().parameters
    }

    /// The numbers that the network computes with, after rounding.
    pub fn read_parameters(&self) -> Vec<f64> {
        let map = self.design.map();
        let number = |(parameter, word): (&Parameter, &i64)| map.states[parameter.state as usize].number(*word);
        map.parameters.iter().zip(&self.parameters).map(number).collect()
    }

    /// Gives all tunable parameters a number, between the same two steps: they act from the next step on. Outputs stay those
    /// of the sample.
    ///
    /// # Errors
    /// [`Error::Count`] or [`Error::NotANumber`], in which case nothing was written; [`Error::Lacks`]; those of the
    /// transport.
    pub fn write_parameters(&mut self, numbers: &[f64]) -> Result<Written, Error> {
        let map = self.design.map();
        count(map.parameters.len(), numbers.len())?;
        let (mut written, mut words) = (Written::default(), Vec::with_capacity(numbers.len()));
        for (index, (parameter, number)) in map.parameters.iter().zip(numbers).enumerate() {
            let word = map.states[parameter.state as usize].word(*number);
            let word = word.ok_or_else(|| Error::NotANumber(parameter.name.clone()))?;
            words.push(word.word);
            if word.clamped {
                written.clamped.push(index);
            }
            let [least, most] = parameter.range;
            if !(least..=most).contains(number) {
                written.beyond_range.push(index);
            }
        }
        self.write_parameter_words(&words)?;
        Ok(written)
    }

    /// The same with stored words.
    ///
    /// # Errors
    /// [`Error::Count`] or [`Error::Range`], in which case nothing was written; [`Error::Lacks`]; those of the transport.
    pub fn write_parameter_words(&mut self, words: &[i64]) -> Result<(), Error> {
        self.engine.set_parameters(words)?;
        self.parameters.copy_from_slice(words);
        Ok(())
    }

    /// Runs so many steps.
    ///
    /// # Errors
    /// [`Error::TimeExceeded`], [`Error::Overrun`], [`Error::Late`], and others of the transport.
    pub fn run(&mut self, steps: u64) -> Result<Ran, Error> {
        let mut all = Ran::default();
        while all.steps < steps {
            let now = self.steps_alike().min(steps - all.steps);
            if self.write_ratio() {
                self.engine.write(&self.words)?;
            }
            let ran = self.engine.run(now)?;
            self.count(&mut all, now, ran);
        }
        Ok(all)
    }

    /// The outputs, in the order of the map.
    ///
    /// # Errors
    /// [`Error::NoSample`] if there is an output that has no value before the first step; [`Error::Count`]; those of the
    /// transport.
    pub fn read(&mut self, numbers: &mut [f64]) -> Result<(), Error> {
        count(self.outputs.len(), numbers.len())?;
        self.engine.read(&mut self.outputs)?;
        self.show(numbers)
    }

    /// The outputs that have a value: all of them after a step.
    ///
    /// # Errors
    /// Those of the transport.
    pub fn read_defined(&mut self) -> Result<Vec<Option<f64>>, Error> {
        self.engine.read(&mut self.outputs)?;
        let outputs = self.outputs.iter().zip(&self.design.map().outputs);
        Ok(outputs.map(|(word, output)| word.map(|word| output.format.number(word))).collect())
    }

    /// The words of the output ports that have one: all of them after a step.
    ///
    /// # Errors
    /// Those of the transport.
    pub fn read_words(&mut self) -> Result<Vec<Option<i64>>, Error> {
        self.engine.read(&mut self.outputs)?;
        Ok(self.outputs.clone())
    }

    /// The words that were read last, by whichever call.
    pub fn last_words(&self) -> &[Option<i64>] {
        &self.outputs
    }

    /// Writes, runs so many steps and reads, in one message if the transport has messages.
    ///
    /// # Errors
    /// As above.
    pub fn exchange(&mut self, inputs: &[f64], steps: u64, outputs: &mut [f64]) -> Result<Exchanged, Error> {
        count(self.outputs.len(), outputs.len())?;
        let written = self.convert(inputs)?;
        let ran = self.exchange_taken(steps)?;
        self.show(outputs)?;
        Ok(Exchanged { written, ran })
    }

    /// The same with words of the ports; gives those of the outputs.
    ///
    /// # Errors
    /// As above.
    pub fn exchange_words(&mut self, inputs: &[i64], steps: u64) -> Result<&[Option<i64>], Error> {
        self.take_words(inputs)?;
        self.exchange_taken(steps)?;
        Ok(&self.outputs)
    }

    /// Runs a step for each frame of numbers for the inputs, one after the other, and appends the numbers of all outputs after
    /// each; in few messages if the transport has messages, or through streams. Without inputs, frames are empty.
    ///
    /// # Errors
    /// [`Error::Count`] or [`Error::NotANumber`], in which case nothing was written; [`Error::TimeExceeded`],
    /// [`Error::Overrun`], and others of the transport.
    pub fn run_frames(&mut self, frames: usize, inputs: &[f64], outputs: &mut Vec<f64>) -> Result<Exchanged, Error> {
        let count_of = self.inputs.len();
        count(frames * count_of, inputs.len())?;
        let (mut words, mut written) = (Vec::with_capacity(frames * self.words.len()), Written::default());
        let kept = self.words.clone();
        for frame in 0..frames {
            let converted = self.convert(&inputs[frame * count_of..(frame + 1) * count_of]);
            let converted = converted.inspect_err(|_| self.words.clone_from(&kept))?;
            written.clamped.extend(converted.clamped);
            written.beyond_range.extend(converted.beyond_range);
            words.extend_from_slice(&self.words);
        }
        for list in [&mut written.clamped, &mut written.beyond_range] {
            list.sort_unstable();
            list.dedup();
        }
        let mut shown = Vec::new();
        let ran = self.run_converted(frames, words, &mut shown)?;
        let formats = self.design.map().outputs.iter().map(|output| output.format).cycle();
        outputs.extend(shown.iter().zip(formats).map(|(word, format)| format.number(*word)));
        Ok(Exchanged { written, ran })
    }

    /// The same with words of the ports.
    ///
    /// # Errors
    /// As above, and [`Error::Range`], in which case nothing was written.
    pub fn run_frames_words(&mut self, frames: usize, inputs: &[i64], outputs: &mut Vec<i64>) -> Result<Ran, Error> {
        let count_of = self.inputs.len();
        count(frames * count_of, inputs.len())?;
        let (mut words, kept) = (Vec::with_capacity(frames * self.words.len()), self.words.clone());
        for frame in 0..frames {
            let taken = self.take_words(&inputs[frame * count_of..(frame + 1) * count_of]);
            taken.inspect_err(|_| self.words.clone_from(&kept))?;
            words.extend_from_slice(&self.words);
        }
        self.run_converted(frames, words, outputs)
    }

    /// Runs frames of words of all ports, in which those of the step ratio are still to be set.
    fn run_converted(&mut self, frames: usize, mut words: Vec<i64>, outputs: &mut Vec<i64>) -> Result<Ran, Error> {
        let first = self.sample;
        if let Some(port) = self.ratio {
            for frame in words.chunks_mut(self.words.len()) {
                self.write_ratio();
                frame[port] = self.words[port];
                self.sample += 1;
            }
            self.sample = first;
        }
        let begin = outputs.len();
        let ran = self.engine.run_frames(frames, &words, outputs)?;
        self.sample = first + ran.steps;
        let shown = self.outputs.len();
        if outputs.len() - begin != frames * shown {
            return Err(Error::Damaged("there are not as many outputs as steps".to_owned()));
        }
        if let Some(last) = frames.checked_sub(1) {
            let last = outputs[begin + last * shown..].iter().copied().map(Some);
            self.outputs.iter_mut().zip(last).for_each(|(output, word)| *output = word);
        }
        Ok(ran)
    }

    fn exchange_taken(&mut self, steps: u64) -> Result<Ran, Error> {
        if steps == 0 || self.steps_alike() < steps {
            self.engine.write(&self.words)?;
            let ran = self.run(steps)?;
            self.engine.read(&mut self.outputs)?;
            return Ok(ran);
        }
        self.write_ratio();
        let ran = self.engine.exchange(&self.words, steps, &mut self.outputs)?;
        let mut all = Ran::default();
        self.count(&mut all, steps, ran);
        Ok(all)
    }

    /// Takes the state of the network between two steps.
    ///
    /// # Errors
    /// [`Error::Lacks`]; those of the transport.
    pub fn snapshot(&mut self) -> Result<Snapshot, Error> {
        let mut state = vec![0; self.design.map().state_words()];
        self.engine.state(&mut state)?;
        Ok(Snapshot { hash: self.design.map().hash.clone(), sample: self.sample, state })
    }

    /// Goes on from a snapshot, which may come from another engine. Inputs and flags stay. As after a reset, an output
    /// that shows no state has no value before the next step.
    ///
    /// # Errors
    /// [`Error::WrongHash`], [`Error::Count`] or [`Error::Range`], in which case the state stays; [`Error::Lacks`]; those
    /// of the transport.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), Error> {
        let map = self.design.map();
        if snapshot.hash != map.hash {
            return Err(Error::WrongHash { expected: map.hash.clone(), found: snapshot.hash.clone() });
        }
        map.check_state(&snapshot.state)?;
        self.engine.set_state(&snapshot.state)?;
        self.parameters = self.design.map().parameters_of(&snapshot.state);
        self.sample = snapshot.sample;
        Ok(())
    }

    /// Flags since they were cleared.
    ///
    /// # Errors
    /// Those of the transport.
    pub fn flags(&mut self) -> Result<Flags, Error> {
        self.engine.flags()
    }

    /// Clears the flags.
    ///
    /// # Errors
    /// [`Error::Lacks`]; those of the transport.
    pub fn clear_flags(&mut self) -> Result<(), Error> {
        self.engine.clear_flags()
    }

    /// What the hardware, or a simulation of it, has counted since the initial state.
    ///
    /// # Errors
    /// [`Error::Lacks`] if there are no clocks; those of the transport.
    pub fn counters(&mut self) -> Result<Counters, Error> {
        self.engine.counters()
    }

    /// Watches over the time that steps take.
    ///
    /// # Errors
    /// [`Error::Lacks`] if there are no clocks; those of the transport.
    pub fn limit(&mut self, limits: &Limits) -> Result<(), Error> {
        self.engine.limit(limits)
    }

    /// Words for numbers; nothing is taken if one is wrong.
    fn convert(&mut self, numbers: &[f64]) -> Result<Written, Error> {
        let map = self.design.map();
        count(self.inputs.len(), numbers.len())?;
        if let Some((port, _)) = self.inputs.iter().zip(numbers).find(|(_, number)| number.is_nan()) {
            return Err(Error::NotANumber(map.inputs[*port].name.clone()));
        }
        let mut written = Written::default();
        for (index, (port, number)) in self.inputs.iter().zip(numbers).enumerate() {
            let input = &map.inputs[*port];
            let word = input.word(*number).ok_or_else(|| Error::NotANumber(input.name.clone()))?;
            self.words[*port] = word.word;
            if word.clamped {
                written.clamped.push(index);
            }
            if input.range.is_some_and(|[least, most]| !(least..=most).contains(number)) {
                written.beyond_range.push(index);
            }
        }
        Ok(written)
    }

    fn take_words(&mut self, words: &[i64]) -> Result<(), Error> {
        let map = self.design.map();
        count(self.inputs.len(), words.len())?;
        for (port, word) in self.inputs.iter().zip(words) {
            let input = &map.inputs[*port];
            // A network clamps words that it does not take; of a foreign entity's port more bits would be cut off.
            let [least, most] = if input.outside == Outside::Foreign { input.words } else { input.format.words() };
            if !(least..=most).contains(word) {
                return Err(Error::Range(map.inputs[*port].name.clone()));
            }
        }
        self.inputs.iter().zip(words).for_each(|(port, word)| self.words[*port] = *word);
        Ok(())
    }

    fn show(&self, numbers: &mut [f64]) -> Result<(), Error> {
        for ((number, word), output) in numbers.iter_mut().zip(&self.outputs).zip(&self.design.map().outputs) {
            *number = output.format.number(word.ok_or_else(|| Error::NoSample(output.name.clone()))?);
        }
        Ok(())
    }

    fn count(&mut self, all: &mut Ran, steps: u64, ran: Ran) {
        self.sample += steps;
        all.steps += ran.steps;
        all.overruns += ran.overruns;
    }

    /// The stretch of equal steps that the next one belongs to: its number, steps that are done in it, the time at which
    /// it begins, and its step.
    fn stretch(&self) -> (usize, u64, f64, f64) {
        let map = self.design.map();
        let (mut left, mut from) = (self.sample, 0.0);
        for (index, early) in map.early_steps.iter().enumerate() {
            let steps = steps_between(from, early.until, early.step);
            if left < steps {
                return (index, left, from, early.step);
            }
            left -= steps;
            from = early.until;
        }
        (map.early_steps.len(), left, from, map.step)
    }

    /// Steps from here on that are of one length.
    fn steps_alike(&self) -> u64 {
        let (stretch, done, from, step) = self.stretch();
        let early = self.design.map().early_steps.get(stretch);
        early.map_or(u64::MAX, |early| steps_between(from, early.until, step) - done)
    }

    /// Sets the word of the step ratio for the next step; whether it changed.
    fn write_ratio(&mut self) -> bool {
        let Some(port) = self.ratio else { return false };
        let map = self.design.map();
        let ratio = map.step / self.stretch().3;
        let word = map.inputs[port].word(ratio).map_or(0, |word| word.word);
        std::mem::replace(&mut self.words[port], word) != word
    }
}

fn steps_between(from: f64, until: f64, step: f64) -> u64 {
    ((until - from) / step).round() as u64
}
