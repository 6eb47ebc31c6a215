//! An instance of an FMU, whatever the version of the interface.

use std::path::Path;

use pe_host::{Design, Error, Flags, Host, Settings, Transport};
use pe_map::{Map, Output, Parameter};

use crate::saved::Saved;
use crate::variables::{DEFAULT_TRANSPORT, Variable, Variables, inputs, output_name};

/// How exactly a communication point or step has to meet the network's steps: this part of a step.
const EXACT: f64 = 1e-6;

/// What is said of calls that need the network before it is open.
const CLOSED: &str = "the FMU is not initialized";

/// How a call ended; both versions of the interface have these numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(i32)]
pub enum Status {
    /// As it should.
    Ok = 0,
    /// As it should, but something has to be told.
    Warning = 1,
    /// Not at all; the instance can go on.
    Error = 3,
    /// Not at all; the instance is of no more use.
    Fatal = 4,
}

/// What is told, and how much it matters.
pub type Told = (Status, String);

/// A network, its parameters, and what was told already.
pub struct Instance {
    design: Design,
    variables: Variables,
    transport: String,
    clock_budget: i32,
    /// Open from the initialization on.
    host: Option<Host>,
    /// Time of sample 0.
    start: f64,
    /// Numbers of the inputs.
    numbers: Vec<f64>,
    /// Numbers of the tunable parameters, and whether the network has not got them yet.
    parameters: Vec<f64>,
    pending: bool,
    /// Numbers and words of the outputs.
    outputs: Vec<(f64, i64)>,
    /// What was told about inputs, and flags: not again until a reset.
    clamped: Vec<bool>,
    beyond_range: Vec<bool>,
    tuned: Vec<bool>,
    flagged: Vec<&'static str>,
    undefined: bool,
    /// What is to be told by the call that runs.
    pub told: Vec<Told>,
}

/// A call that failed, and why.
pub type Outcome = Result<(), String>;

impl Instance {
    /// An instance of the design in a folder, which has to be the one with this hash.
    ///
    /// # Errors
    /// If it is not.
    pub fn new(folder: &Path, hash: &str) -> Result<Instance, String> {
        let design = Design::open(folder).map_err(|error| error.to_string())?;
        let map = design.map();
        if map.hash != hash {
            return Err(format!("the description is of design {hash}, the FMU holds {}", map.hash));
        }
        let count = inputs(map).count();
        Ok(Instance {
            variables: Variables::of(map),
            transport: DEFAULT_TRANSPORT.to_owned(),
            clock_budget: 0,
            host: None,
            start: 0.0,
            numbers: vec![0.0; count],
            parameters: stated(map),
            pending: false,
            outputs: vec![(f64::NAN, 0); map.outputs.len()],
            clamped: vec![false; count],
            beyond_range: vec![false; count],
            tuned: vec![false; map.parameters.len()],
            flagged: Vec::new(),
            undefined: false,
            told: Vec::new(),
            design,
        })
    }

    fn map(&self) -> &Map {
        self.design.map()
    }

    /// The variable with this number.
    ///
    /// # Errors
    /// If there is none.
    pub fn variable(&self, number: u32) -> Result<Variable, String> {
        self.variables.find(number).ok_or_else(|| format!("there is no variable {number}"))
    }

    /// Sets the time of sample 0.
    pub fn begin_at(&mut self, start: f64) {
        self.start = start;
    }

    /// Opens the network, with the inputs that were set.
    ///
    /// # Errors
    /// Those of the transport.
    pub fn open(&mut self) -> Outcome {
        let text = |error: Error| error.to_string();
        let transport: Transport = self.transport.parse().map_err(text)?;
        let engine = transport.open(&self.design, &Settings::default()).map_err(text)?;
        self.host = Some(Host::over(self.design.clone(), engine).map_err(text)?);
        self.tune()?;
        self.read()
    }

    /// As it was after instantiation.
    pub fn reset(&mut self) {
        self.host = None;
        self.numbers.fill(0.0);
        (self.parameters, self.pending) = (stated(self.map()), false);
        self.tuned.fill(false);
        self.clamped.fill(false);
        self.beyond_range.fill(false);
        self.flagged.clear();
        self.undefined = false;
    }

    /// Time of the sample that the outputs are.
    pub fn time(&self) -> f64 {
        self.start + self.host.as_ref().map_or(0.0, Host::time)
    }

    fn host(&mut self) -> Result<&mut Host, String> {
        self.host.as_mut().ok_or_else(|| CLOSED.to_owned())
    }

    /// Runs the steps from one communication point to the next.
    ///
    /// # Errors
    /// If these are not a whole number of steps, or those of the transport.
    pub fn advance(&mut self, from: f64, by: f64) -> Outcome {
        let now = self.time();
        let step = self.map().step;
        if from.is_nan() || (from - now).abs() > EXACT * step {
            return Err(format!("the communication point {from} s is not the end of the last step, {now} s"));
        }
        let Some(steps) = self.steps_until(now - self.start + by) else {
            return Err(format!("a communication step of {by} s is no multiple of the step of {step} s"));
        };
        self.tune()?;
        let numbers = std::mem::take(&mut self.numbers);
        let mut outputs = vec![0.0; self.outputs.len()];
        let exchanged = self.host()?.exchange(&numbers, steps, &mut outputs);
        self.numbers = numbers;
        let written = exchanged.map_err(|error| error.to_string())?.written;
        self.take_over()?;
        self.tell_inputs(&written.clamped, "was clamped: it is beyond what the port carries", |own| &mut own.clamped);
        self.tell_inputs(
            &written.beyond_range,
            "is beyond its stated range, for which alone formats and errors were judged",
            |own| &mut own.beyond_range,
        );
        self.tell_flags()?;
        self.tell_clocks()
    }

    /// Gives the network the parameters that were set.
    fn tune(&mut self) -> Outcome {
        if !std::mem::take(&mut self.pending) {
            return Ok(());
        }
        let numbers = self.parameters.clone();
        let written = self.host()?.write_parameters(&numbers).map_err(|error| error.to_string())?;
        for (which, what) in [(&written.clamped, "was clamped"), (&written.beyond_range, "is beyond its stated range")]
        {
            for index in which {
                if !std::mem::replace(&mut self.tuned[*index], true) {
                    let name = self.map().parameters[*index].name.clone();
                    self.told.push((Status::Warning, format!("parameter `{name}` {what}: {}", numbers[*index])));
                }
            }
        }
        Ok(())
    }

    /// Steps from the sample now to the one at a time of the network.
    fn steps_until(&self, end: f64) -> Option<u64> {
        let map = self.map();
        let (mut sample, mut from) = (0, 0.0);
        let within = |from: f64, until: f64, step: f64| ((until - from) / step).round();
        let mut length = map.step;
        for early in &map.early_steps {
            if end <= early.until + EXACT * early.step {
                length = early.step;
                break;
            }
            sample += within(from, early.until, early.step) as u64;
            from = early.until;
        }
        let more = within(from, end, length);
        let exact = (from + more * length - end).abs() <= EXACT * length;
        let now = self.host.as_ref().map_or(0, Host::sample);
        let reached = (exact && more >= 0.0).then_some(sample + more as u64)?;
        reached.checked_sub(now).filter(|steps| *steps > 0)
    }

    /// Reads the outputs.
    fn read(&mut self) -> Outcome {
        self.host()?.read_words().map_err(|error| error.to_string())?;
        self.take_over()
    }

    /// Takes over what was read last.
    fn take_over(&mut self) -> Outcome {
        let host = self.host.as_ref().ok_or(CLOSED)?;
        let words = host.last_words().iter().zip(&host.map().outputs);
        let number = |(word, output): (&Option<i64>, &Output)| {
            word.map_or((f64::NAN, 0), |word| (output.format.number(word), word))
        };
        self.outputs = words.map(number).collect();
        Ok(())
    }

    fn tell_inputs(&mut self, which: &[usize], what: &str, told: impl Fn(&mut Instance) -> &mut Vec<bool>) {
        for index in which {
            if !std::mem::replace(&mut told(self)[*index], true) {
                let name = inputs(self.map()).nth(*index).map_or(String::new(), |input| input.name.clone());
                let message = format!("input `{name}` {what}: {}", self.numbers[*index]);
                self.told.push((Status::Warning, message));
            }
        }
    }

    fn tell_flags(&mut self) -> Outcome {
        let flags: Flags = self.host()?.flags().map_err(|error| error.to_string())?;
        for name in flags.names() {
            if !self.flagged.contains(&name) {
                self.flagged.push(name);
                self.told.push((Status::Warning, format!("the network's flag `{name}` is set: results may be wrong")));
            }
        }
        Ok(())
    }

    /// Tells of steps that take more clocks than they may: those that were counted, or else those of the schedule.
    fn tell_clocks(&mut self) -> Outcome {
        let Ok(budget @ 1..) = u32::try_from(self.clock_budget) else { return Ok(()) };
        let scheduled = self.map().clocks_per_step;
        let longest = match self.host()?.counters() {
            Ok(counters) => counters.longest.unwrap_or(0),
            Err(Error::Lacks(_)) => scheduled,
            Err(error) => return Err(error.to_string()),
        };
        if longest > budget {
            self.told.push((Status::Warning, format!("time_exceeded: a step took {longest} clocks of {budget}")));
        }
        Ok(())
    }

    /// A number.
    ///
    /// # Errors
    /// If the variable has none.
    pub fn number(&mut self, number: u32) -> Result<f64, String> {
        match self.variable(number)? {
            Variable::Time => Ok(self.time()),
            Variable::Input(index) => Ok(self.numbers[index]),
            Variable::Parameter(index) => Ok(self.parameters[index]),
            Variable::Output(index) => {
                self.tell_undefined(index);
                Ok(self.outputs[index].0)
            }
            other => Err(format!("{other:?} is no real number")),
        }
    }

    /// Tells of an output that has no value before the first step; it shows as NaN, its word as 0.
    fn tell_undefined(&mut self, index: usize) {
        if self.outputs[index].0.is_nan() && self.host.is_some() && !std::mem::replace(&mut self.undefined, true) {
            let name = output_name(self.map(), &self.map().outputs[index]);
            self.told.push((Status::Warning, format!("output `{name}` has no value before the first step")));
        }
    }

    /// Gives an input or a tunable parameter a number, which acts from the next step on.
    ///
    /// # Errors
    /// If the variable is neither, or this no number.
    pub fn set_number(&mut self, number: u32, value: f64) -> Outcome {
        match self.variable(number)? {
            Variable::Input(index) if !value.is_nan() => {
                self.numbers[index] = value;
                Ok(())
            }
            Variable::Parameter(index) if !value.is_nan() => {
                self.parameters[index] = value;
                self.pending = true;
                Ok(())
            }
            Variable::Input(_) | Variable::Parameter(_) => Err("NaN is no number for a variable".to_owned()),
            other => Err(format!("{other:?} is no input, and no parameter that can be tuned")),
        }
    }

    /// An integer.
    ///
    /// # Errors
    /// If the variable has none.
    pub fn integer(&mut self, number: u32) -> Result<i64, String> {
        match self.variable(number)? {
            Variable::ClockBudget => Ok(i64::from(self.clock_budget)),
            Variable::Word(index) => Ok(self.outputs[index].1),
            Variable::Low(index) => Ok(i64::from(self.outputs[index].1 as i32)),
            Variable::High(index) => Ok(self.outputs[index].1 >> 32),
            other => Err(format!("{other:?} is no integer")),
        }
    }

    /// Sets an integer.
    ///
    /// # Errors
    /// If the variable is no parameter of this type.
    pub fn set_integer(&mut self, number: u32, value: i32) -> Outcome {
        match self.variable(number)? {
            Variable::ClockBudget if value >= 0 => self.clock_budget = value,
            Variable::ClockBudget => return Err("a clock budget is 0 or more".to_owned()),
            other => return Err(format!("{other:?} is no integer that can be set")),
        }
        Ok(())
    }

    /// A text.
    ///
    /// # Errors
    /// If the variable has none.
    pub fn text(&self, number: u32) -> Result<&str, String> {
        match self.variable(number)? {
            Variable::Transport => Ok(&self.transport),
            other => Err(format!("{other:?} is no text")),
        }
    }

    /// Sets a text.
    ///
    /// # Errors
    /// If the variable is no parameter of this type, cannot be set any more, or is no transport.
    pub fn set_text(&mut self, number: u32, value: &str) -> Outcome {
        match self.variable(number)? {
            Variable::Transport if self.host.is_some() && value != self.transport => {
                return Err("the transport cannot change after the initialization".to_owned());
            }
            Variable::Transport => {
                value.parse::<Transport>().map_err(|error| error.to_string())?;
                value.clone_into(&mut self.transport);
            }
            other => return Err(format!("{other:?} is no text")),
        }
        Ok(())
    }

    /// All that the instance goes on from.
    ///
    /// # Errors
    /// Those of the transport; before the initialization there is nothing to save.
    pub fn save(&mut self) -> Result<Saved, String> {
        self.tune()?;
        let numbers = self.numbers.clone();
        let start = self.start;
        let snapshot = self.host()?.snapshot().map_err(|error| error.to_string())?;
        Ok(Saved { start, numbers, snapshot })
    }

    /// Goes on from there.
    ///
    /// # Errors
    /// If it is of another design; those of the transport.
    pub fn restore(&mut self, saved: &Saved) -> Outcome {
        if saved.numbers.len() != self.numbers.len() {
            return Err("the state is of another design".to_owned());
        }
        self.host()?.restore(&saved.snapshot).map_err(|error| error.to_string())?;
        self.start = saved.start;
        self.numbers.clone_from(&saved.numbers);
        (self.parameters, self.pending) = (self.host()?.read_parameters(), false);
        self.read()
    }
}

/// Parameters as the spec has them.
fn stated(map: &Map) -> Vec<f64> {
    map.parameters.iter().map(|parameter: &Parameter| parameter.value).collect()
}
