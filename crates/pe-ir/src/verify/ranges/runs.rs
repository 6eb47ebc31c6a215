//! Responses of an affine step to its initial states, and to an impulse at each input.

use super::norm::Measured;
use super::system::System;
use crate::index::{ValueId, at};

/// Responses that are computed side by side: that to the initial states, and those to inputs.
const LANES: usize = 4;

/// Steps between two looks at how much is still moving.
const STRIDE: u64 = 64;

/// What is left of the responses where the runs end early, relative to the largest word.
const LEFT: f64 = 1.0 / 8192.0;

/// Numbers below this are taken for zero at the end of a step, so that none gets so small that it takes a processor
/// longer; in LSB.
const CUT: f64 = 1.0 / (1u64 << 60) as f64;

/// What the responses are at most.
pub(super) struct Responses {
    /// For each value the largest of the magnitude of the initial states' response plus the sum of those to the inputs.
    pub peaks: Vec<f64>,
    /// For each value the sum of the magnitudes of the responses to the inputs alone.
    pub sums: Vec<f64>,
    /// Steps that were computed.
    pub steps: u64,
    /// For each state at the end the magnitudes of the responses to inputs, and the last change of that to the initial
    /// states.
    pub last: Vec<f64>,
    /// What cutting small numbers off can have moved every state by, over all steps and responses.
    pub cut: f64,
}

impl Responses {
    /// Runs over so many steps, or until hardly anything moves.
    pub fn run(system: &System, measured: &Measured, steps: u64) -> Responses {
        let mut all = Responses {
            peaks: vec![0.0; system.values],
            sums: vec![0.0; system.values],
            steps,
            last: vec![0.0; system.states.len()],
            cut: 0.0,
        };
        // One lane of the first run has the initial states; those of others are at rest.
        let mut inputs: &[ValueId] = &system.inputs;
        let mut first = true;
        while first || !inputs.is_empty() {
            let (these, others) = inputs.split_at(inputs.len().min(if first { LANES - 1 } else { LANES }));
            let run = match these.len() + usize::from(first) {
                1 => Run::<1>::new(system, these, first).over(measured, steps),
                2 => Run::<2>::new(system, these, first).over(measured, steps),
                _ => Run::<LANES>::new(system, these, first).over(measured, steps),
            };
            all.steps = all.steps.min(run.steps);
            all.cut += run.cut;
            let add = |to: &mut Vec<f64>, of: &[f64]| to.iter_mut().zip(of).for_each(|(to, of)| *to += of);
            add(&mut all.peaks, &run.peaks);
            add(&mut all.sums, &run.sums);
            add(&mut all.last, &run.last);
            (inputs, first) = (others, false);
        }
        all
    }
}

/// Some responses side by side. The last lane is that of the initial states, if it is among them.
struct Run<'a, const L: usize> {
    system: &'a System,
    /// Numbers of all values.
    numbers: Vec<[f64; L]>,
    /// Sums of magnitudes of all values, over steps and inputs.
    sums: Vec<f64>,
    peaks: Vec<f64>,
    inputs: &'a [ValueId],
    first: bool,
}

impl<'a, const L: usize> Run<'a, L> {
    fn new(system: &'a System, inputs: &'a [ValueId], first: bool) -> Self {
        let mut numbers = vec![[0.0; L]; system.values];
        if first {
            for ((start, _), initial) in system.states.iter().zip(&system.initial) {
                numbers[start.index()][L - 1] = *initial;
            }
            for (constant, number) in &system.constants {
                numbers[at(*constant)][L - 1] = *number;
            }
        }
        for (lane, input) in inputs.iter().enumerate() {
            numbers[input.index()][lane] = system.input;
        }
        let sums = vec![0.0; system.values];
        let peaks = numbers.iter().map(|lanes| lanes[L - 1].abs()).collect();
        Run { system, numbers, sums, peaks, inputs, first }
    }

    fn over(mut self, measured: &Measured, steps: u64) -> Responses {
        let mut done = 0;
        let mut changes = vec![0.0; self.system.states.len()];
        let reach = measured.reach.iter().fold(0.0, |most: f64, reach| most.max(*reach));
        while done < steps {
            let looks = (done + 1) % STRIDE == 0 || done + 1 == steps;
            self.step();
            if done == 0 {
                self.rest();
            }
            done += 1;
            self.finish(&mut changes, looks);
            if looks && done < steps {
                let rest = measured.sum_of_growth(Some(steps - done));
                if reach * rest * measured.of_magnitudes(&changes) < LEFT * self.system.input {
                    break;
                }
            }
        }
        let mut sums = self.sums;
        for input in &self.system.inputs {
            sums[input.index()] = 0.0;
        }
        for input in self.inputs {
            sums[input.index()] = self.system.input;
            self.peaks[input.index()] = self.system.input;
        }
        for (start, end) in &self.system.states {
            sums[start.index()] = sums[end.index()];
            self.peaks[start.index()] = self.peaks[start.index()].max(self.peaks[end.index()]);
        }
        let cut = CUT * (done * L as u64) as f64;
        Responses { peaks: self.peaks, sums, steps: done, last: changes, cut }
    }

    /// One step.
    fn step(&mut self) {
        let system = self.system;
        for sum in &system.sums {
            let mut total = [0.0; L];
            for (operand, coefficient) in &system.terms[sum.terms.clone()] {
                let numbers = &self.numbers[operand.index()];
                for lane in 0..L {
                    total[lane] += coefficient * numbers[lane];
                }
            }
            for store in &system.stores[sum.stores.clone()] {
                let mut word = [0.0; L];
                if let Some(base) = store.base {
                    word = self.numbers[base.index()];
                }
                let target = store.target.index();
                for lane in 0..L {
                    word[lane] += store.scale * total[lane];
                }
                let driven = if self.first { L - 1 } else { L };
                // The response to the initial states counts where it is, not in a sum.
                let free = if self.first { word[L - 1].abs() } else { 0.0 };
                self.sums[target] += word[..driven].iter().map(|number| number.abs()).sum::<f64>();
                self.peaks[target] = self.peaks[target].max(self.sums[target] + free);
                self.numbers[target] = word;
            }
        }
    }

    /// The impulses are over.
    fn rest(&mut self) {
        for (lane, input) in self.inputs.iter().enumerate() {
            self.numbers[input.index()][lane] = 0.0;
        }
    }

    /// The states of the end are those of the next start. If they are looked at, what still moves is put down.
    fn finish(&mut self, changes: &mut [f64], looks: bool) {
        for ((start, end), change) in self.system.states.iter().zip(changes) {
            let mut next = self.numbers[end.index()];
            for number in &mut next {
                if number.abs() < CUT {
                    *number = 0.0;
                }
            }
            if looks {
                let before = self.numbers[start.index()];
                let of_inputs: f64 = next[..L - usize::from(self.first)].iter().map(|number| number.abs()).sum();
                let of_start = if self.first { (next[L - 1] - before[L - 1]).abs() } else { 0.0 };
                *change = of_inputs + of_start;
            }
            self.numbers[start.index()] = next;
        }
    }
}
