//! The network in this process, by the compiler's simulator.

use std::sync::Arc;

use pe_ir::program::Program;
use pe_map::Map;
use pe_sim::clocked::{Causes, Clocked};
use pe_sim::machine::Machine;

use crate::design::{Design, States, count};
use crate::engine::{Engine, Flags, Ran, one_by_one};
use crate::error::Error;

/// The cycle-accurate simulator.
///
/// It runs what its control words compute, and changes to single registers when a sum of operands wraps, of which the
/// faster one knows no more.
pub struct Model {
    map: Arc<Map>,
    program: Arc<Program>,
    machine: Machine<Arc<Program>>,
    /// In place of the machine since a sum wrapped.
    registers: Option<Box<Clocked<Arc<Program>>>>,
    /// Flags of times before the machine or the registers began.
    flags: Flags,
    inputs: Vec<i64>,
    /// Stored words, and steps since the last sample of each tick, before the step that runs.
    state: Vec<i64>,
    stepped: bool,
    /// Outputs of the sample that no step has made: those of the initial state, or while parameters were written.
    shown: Option<Vec<Option<i64>>>,
}

impl Model {
    /// The network of a folder in its initial state.
    ///
    /// # Errors
    /// [`Error::File`], or [`Error::WrongHash`] if the program is not the map's.
    pub fn open(design: &Design) -> Result<Model, Error> {
        Ok(Model::over(design, Arc::new(design.program()?)))
    }

    /// The network of a program, which must be the one of the map.
    pub fn over(design: &Design, program: Arc<Program>) -> Model {
        let map = design.shared_map();
        Model {
            machine: Machine::new(Arc::clone(&program)),
            program,
            registers: None,
            flags: Flags::default(),
            inputs: vec![0; map.inputs.len()],
            state: map.initial_state(),
            stepped: false,
            shown: Some(first(&map)),
            map,
        }
    }

    /// The program with other state words in its images.
    fn with_state(&self, words: &[i64]) -> Arc<Program> {
        let mut program = Program::clone(&self.program);
        for (state, word) in self.program.states.iter().zip(words) {
            state.set(&mut program.pes, &self.program.format, *word);
        }
        let ticks = program.inputs.iter_mut().filter_map(|input| input.tick.as_mut());
        for (tick, since) in ticks.zip(&words[self.program.states.len()..]) {
            tick.done = u32::try_from(*since).unwrap_or(0);
        }
        Arc::new(program)
    }

    /// Puts the state words at the end of the last step in `self.state`.
    fn keep_state(&mut self) {
        let ids = self.program.states.ids();
        match &self.registers {
            None => self.state.iter_mut().zip(ids).for_each(|(word, id)| *word = self.machine.state(id)),
            Some(registers) => self.state.iter_mut().zip(ids).for_each(|(word, id)| *word = registers.state(id)),
        }
    }

    fn step(&mut self) {
        let before = flags_of(self.machine.causes());
        match &mut self.registers {
            Some(registers) => registers.step(&self.inputs, &mut |_| {}),
            None => self.machine.step(&self.inputs, &mut |_| {}),
        }
        if self.registers.is_none() && (self.machine.parted() || self.machine.escaped()) {
            // The same step again, register by register.
            self.flags = self.flags | before;
            let mut registers = Clocked::new(self.with_state(&self.state));
            registers.step(&self.inputs, &mut |_| {});
            self.registers = Some(Box::new(registers));
        }
        for (since, tick) in self.state[self.map.states.len()..].iter_mut().zip(&self.map.ticks) {
            *since = (*since + 1) % i64::from(tick.steps);
        }
        self.keep_state();
    }

    fn begin(&mut self, words: &[i64]) {
        self.flags = self.seen();
        self.machine.restart(self.with_state(words));
        self.registers = None;
        self.state.copy_from_slice(words);
        self.stepped = false;
        self.shown = None;
    }

    fn seen(&self) -> Flags {
        let (causes, escaped) = match &self.registers {
            None => (self.machine.causes(), self.machine.escaped()),
            Some(registers) => (registers.causes(), registers.escaped()),
        };
        self.flags | flags_of(causes) | Flags::PROOF_BROKEN.when(escaped)
    }
}

/// Outputs of the initial state.
fn first(map: &Map) -> Vec<Option<i64>> {
    let mut shown = vec![None; map.outputs.len()];
    map.first(&mut shown);
    shown
}

fn flags_of(Causes { saturated, operand, input }: Causes) -> Flags {
    Flags::INPUT_CLAMPED.when(input) | Flags::SATURATED.when(saturated) | Flags::OPERAND_TOO_LARGE.when(operand)
}

impl Engine for Model {
    fn reset(&mut self) -> Result<(), Error> {
        self.begin(&self.map.initial_state());
        self.shown = Some(first(&self.map));
        self.clear_flags()
    }

    fn write(&mut self, words: &[i64]) -> Result<(), Error> {
        count(self.inputs.len(), words.len())?;
        self.inputs.copy_from_slice(words);
        Ok(())
    }

    fn run(&mut self, steps: u64) -> Result<Ran, Error> {
        if steps > 0 {
            (self.stepped, self.shown) = (true, None);
        }
        (0..steps).for_each(|_| self.step());
        Ok(Ran { steps, overruns: 0 })
    }

    fn read(&mut self, words: &mut [Option<i64>]) -> Result<(), Error> {
        count(self.map.outputs.len(), words.len())?;
        if let Some(shown) = &self.shown {
            words.copy_from_slice(shown);
            return Ok(());
        }
        match &self.registers {
            _ if !self.stepped => self.map.shown(&self.state, words),
            Some(registers) => words.iter_mut().zip(registers.outputs()).for_each(|(word, new)| *word = Some(new)),
            None => words.iter_mut().zip(self.machine.outputs()).for_each(|(word, new)| *word = Some(*new)),
        }
        Ok(())
    }

    fn run_frames(&mut self, frames: usize, inputs: &[i64], outputs: &mut Vec<i64>) -> Result<Ran, Error> {
        let (ports, shown) = (self.map.inputs.len(), self.map.outputs.len());
        one_by_one(self, ports, shown, (frames, inputs, outputs))
    }

    fn state(&mut self, words: &mut [i64]) -> Result<(), Error> {
        count(self.state.len(), words.len())?;
        words.copy_from_slice(&self.state);
        Ok(())
    }

    fn set_state(&mut self, words: &[i64]) -> Result<(), Error> {
        self.map.check_state(words)?;
        self.begin(words);
        Ok(())
    }

    fn set_parameters(&mut self, words: &[i64]) -> Result<(), Error> {
        self.map.check_parameters(words)?;
        let (mut shown, mut state) = (vec![None; self.map.outputs.len()], self.state.clone());
        self.read(&mut shown)?;
        self.map.put_parameters(words, &mut state);
        self.begin(&state);
        self.shown = Some(shown);
        Ok(())
    }

    fn flags(&mut self) -> Result<Flags, Error> {
        Ok(self.seen())
    }

    fn clear_flags(&mut self) -> Result<(), Error> {
        self.flags = Flags::default();
        self.machine.clear_flags();
        if let Some(registers) = &mut self.registers {
            registers.clear_causes();
        }
        Ok(())
    }
}
