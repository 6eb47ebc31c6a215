//! Loops as calls of functions with their arguments, and everything else that the program reads.

use std::collections::{BTreeMap, BTreeSet};

use pe_ir::functions::Segments;
use pe_ir::graph::{Role, StepGraph};
use pe_ir::index;

use super::layout::Layout;
use super::loops::{Base, Factor, Loop, Place, Sum, uniform};
use super::source::{self, From, Read, Second, Signature};
use super::work::{Program, Work};
use crate::double::power_of_two;
use crate::tiles::{self, Outcome};

/// Lanes of a call: few enough that what it reads and writes stays in the nearest cache until the next level.
const LANES: usize = 1024;

/// Longest pattern of coefficients that is looked for.
const LONGEST_PATTERN: usize = LANES;

/// Products outside of loops up to which they are written out as text.
const WRITTEN_OUT: usize = 1500;

/// Relative difference of coefficients that are equal but for their rounding.
const ROUNDED: f64 = 4.0 * f64::EPSILON;

/// Where rows of numbers begin: a line of the cache in single precision.
const LINE: usize = 16;

/// The function of the template that runs a list of sums and lookups.
const LIST: usize = 0;

/// An argument of a call.
#[derive(Clone, Copy, Debug)]
enum Argument {
    /// A word as it is.
    Word(u32),
    /// A slot of a row, from which on as many are used.
    Slot(i64, usize, usize),
    /// How much further a row is moved in odd steps.
    Moved(i64),
}

struct Call {
    kernel: usize,
    lanes: usize,
    level: u32,
    arguments: Vec<Argument>,
    /// Slots that are to be cleared behind it, as the template's `clear` takes them.
    clear: Vec<Argument>,
}

/// Coefficients of a loop that others may share.
struct Shared {
    /// Rows and single numbers of its products.
    numbers: Vec<Vec<f64>>,
}

#[derive(Default)]
struct Assembler {
    kernels: BTreeMap<Signature, usize>,
    text: String,
    numbers: Vec<f64>,
    rows: BTreeMap<Vec<u64>, u32>,
    singles: BTreeMap<u64, u32>,
    shared: BTreeMap<(Signature, usize, usize), Vec<Shared>>,
    bases: BTreeMap<usize, Vec<Vec<f64>>>,
    calls: Vec<Call>,
    work: Work,
}

/// The program of a step.
pub(super) fn program(graph: &StepGraph, layout: &Layout) -> Program {
    let mut assembler = Assembler::default();
    let mut kernels = vec!["list".to_owned()];
    let rest = &layout.arranged.rest;
    let products_of = |chain: usize| layout.chains[chain].terms.len();
    let alone: usize = rest.iter().map(|(_, chain)| products_of(*chain)).sum();
    let mut rest = rest.iter().copied().peekable();
    let mut waiting: Vec<usize> = Vec::new();
    for one in &layout.arranged.loops {
        let mut last = 0;
        while let Some((level, chain)) = rest.next_if(|(level, _)| *level < one.level) {
            waiting.push(chain);
            last = level;
        }
        assembler.alone(layout, last, &mut waiting, alone, &mut kernels);
        assembler.in_a_loop(one, &layout.arranged.read_free, &mut kernels);
    }
    let last = layout.arranged.rest.last().map_or(0, |(level, _)| *level);
    waiting.extend(rest.map(|(_, chain)| chain));
    assembler.alone(layout, last, &mut waiting, alone, &mut kernels);
    assembler.finish(graph, layout, &kernels)
}

impl Assembler {
    fn row(&mut self, numbers: &[f64]) -> u32 {
        let bits: Vec<u64> = numbers.iter().map(|number| number.to_bits()).collect();
        let all = &mut self.numbers;
        *self.rows.entry(bits).or_insert_with(|| {
            all.resize(all.len().next_multiple_of(LINE), 0.0);
            all.extend(numbers);
            index::number(all.len() - numbers.len())
        })
    }

    fn single(&mut self, number: f64) -> Argument {
        let all = &mut self.numbers;
        Argument::Word(*self.singles.entry(number.to_bits()).or_insert_with(|| {
            all.push(number);
            index::number(all.len()) - 1
        }))
    }

    /// Calls that run a loop.
    fn in_a_loop(&mut self, one: &Loop, read_free: &BTreeSet<usize>, kernels: &mut Vec<String>) {
        let (signature, parts) = Parts::of(one);
        let kernel = *self.kernels.entry(signature.clone()).or_insert_with(|| {
            source::kernel(&mut self.text, kernels.len(), &signature);
            kernels.push(format!("k{}", kernels.len()));
            kernels.len() - 1
        });
        let coefficients: Vec<(Vec<Vec<f64>>, f64)> = parts
            .coefficients
            .into_iter()
            .enumerate()
            .map(|(sum, own)| {
                let linear = own.len() == signature.sums[sum].products.len();
                self.share((signature.clone(), one.lanes, sum), own, linear)
            })
            .collect();
        let rows = coefficients.iter().flat_map(|(rows, _)| rows);
        let step = pattern(rows).map_or(LANES, |pattern| pattern * LANES.div_ceil(pattern));
        let read = |target: &Place| matches!(target, Place::Row(_, row) if read_free.contains(row));
        let writes = one.sums.iter().flat_map(|sum| &sum.writes);
        let targets: Vec<Place> = writes.filter_map(|write| write.target).filter(read).collect();
        for start in (0..one.lanes).step_by(step) {
            let lanes = step.min(one.lanes - start);
            let arguments = self.arguments(one, (start, lanes), &parts.values, &coefficients);
            self.count(&signature, lanes);
            let free: Vec<usize> =
                one.free.iter().copied().filter(|lane| (start..start + lanes).contains(lane)).collect();
            let mut clear = Vec::new();
            for (first, length, apart, count) in stretches(&free) {
                let words = [length, apart, count].map(|word| Argument::Word(index::number(word)));
                clear.extend(targets.iter().flat_map(|target| [at(*target, (first, 1))].into_iter().chain(words)));
            }
            self.work.moved += (free.len() * targets.len()) as u64;
            self.calls.push(Call { kernel, lanes, level: one.level, arguments, clear });
        }
    }

    /// Coefficients of an earlier loop, and what they are to be multiplied by, if there are such.
    fn share(&mut self, key: (Signature, usize, usize), own: Vec<Vec<f64>>, linear: bool) -> (Vec<Vec<f64>>, f64) {
        if !linear {
            return (own, 1.0);
        }
        let known = self.shared.entry(key).or_default();
        for shared in known.iter() {
            if let Some(ratio) = ratio(&own, &shared.numbers) {
                return (shared.numbers.clone(), ratio);
            }
        }
        known.push(Shared { numbers: own.clone() });
        (own, 1.0)
    }

    /// Arguments of a call, in the order that [`Signature`] says.
    fn arguments(
        &mut self,
        one: &Loop,
        (start, lanes): (usize, usize),
        values: &[Place],
        coefficients: &[(Vec<Vec<f64>>, f64)],
    ) -> Vec<Argument> {
        let mut arguments: Vec<Argument> = values.iter().map(|value| at(*value, (start, lanes))).collect();
        for (sum, (coefficients, ratio)) in one.sums.iter().zip(coefficients) {
            for numbers in coefficients {
                arguments.push(match &numbers[..] {
                    [number] => self.single(*number),
                    numbers => Argument::Word(self.row(&numbers[start..start + lanes])),
                });
            }
            for write in &sum.writes {
                arguments.extend(write.target.map(|target| at(target, (start, lanes))));
                if let Base::Numbers(numbers) = &write.base {
                    match uniform(numbers) {
                        Some(number) => arguments.push(self.single(number)),
                        None => {
                            let (numbers, ratio) = self.base(&filled(numbers));
                            let row = self.row(&numbers[start..start + lanes]);
                            arguments.extend([Argument::Word(row), self.single(ratio)]);
                        }
                    }
                }
                arguments.push(self.single(power_of_two(write.shift) * ratio));
            }
        }
        arguments
    }

    /// Bases of an earlier loop, and what they are to be multiplied by.
    fn base(&mut self, own: &[f64]) -> (Vec<f64>, f64) {
        let known = self.bases.entry(own.len()).or_default();
        for shared in known.iter() {
            if let Some(ratio) = ratio(&[own.to_vec()], std::slice::from_ref(shared)) {
                return (shared.clone(), ratio);
            }
        }
        known.push(own.to_vec());
        (own.to_vec(), 1.0)
    }

    fn count(&mut self, signature: &Signature, lanes: usize) {
        let products = || signature.sums.iter().flat_map(|sum| &sum.products);
        let writes = || signature.sums.iter().flat_map(|sum| &sum.writes);
        let rows = signature.values.iter().filter(|same| !**same).count()
            + products().filter(|(_, second)| *second == Second::Numbers).count()
            + writes().map(|(from, stored)| usize::from(*stored) + usize::from(*from == From::Numbers)).sum::<usize>();
        let operands: usize = products().map(|(operands, _)| operands.len()).sum();
        let operations = operands + products().count() + 2 * writes().count();
        self.work.moved += (lanes * rows) as u64;
        self.work.operations += (lanes * operations) as u64;
        self.work.in_loops += (lanes * operands) as u64;
    }

    /// A call that runs the waiting chains one by one, written out unless they are many.
    fn alone(
        &mut self,
        layout: &Layout,
        level: u32,
        waiting: &mut Vec<usize>,
        alone: usize,
        kernels: &mut Vec<String>,
    ) {
        if waiting.is_empty() {
            return;
        }
        for chain in waiting.iter() {
            let (products, writes) = (layout.chains[*chain].terms.len(), layout.chains[*chain].writes().count());
            self.work.operations += 2 * (products + writes) as u64;
            self.work.moved += (2 * products + 2 * writes) as u64;
        }
        let (kernel, arguments) = if alone <= WRITTEN_OUT {
            source::sums(&mut self.text, kernels.len(), layout, waiting);
            kernels.push(format!("k{}", kernels.len()));
            let moved = layout.memory.moved();
            (kernels.len() - 1, vec![Argument::Moved(moved), Argument::Moved(-moved)])
        } else {
            (LIST, waiting.iter().flat_map(|chain| self.listed(layout, *chain)).collect())
        };
        self.calls.push(Call { kernel, lanes: waiting.len(), level, arguments, clear: Vec::new() });
        waiting.clear();
    }

    /// A chain as words of a list: what it is, and its slots.
    fn listed(&mut self, layout: &Layout, chain: usize) -> Vec<Argument> {
        let slot = |slot: u32| Argument::Slot(i64::from(slot), layout.memory.row(slot), 1);
        let chain = &layout.chains[chain];
        match chain.outcome {
            Outcome::Segment { target, argument, octaves } => {
                vec![Argument::Word(1 + u32::from(octaves)), slot(target), slot(argument)]
            }
            Outcome::Choice { target, segment, among } => {
                vec![Argument::Word(3), slot(target), slot(segment), slot(among)]
            }
            Outcome::Words(..) | Outcome::Kept(_) => {
                let terms = &layout.terms[index::at(chain.terms.start)..chain.terms.end as usize];
                let with_number = terms.iter().filter(|term| matches!(term.factor, tiles::Factor::Coefficient(_)));
                let counts = [with_number.count(), terms.len(), chain.writes().count()];
                let mut words = vec![Argument::Word(0)];
                words.extend(counts.map(|count| Argument::Word(index::number(count))));
                for term in terms {
                    words.push(slot(term.operand));
                    words.push(match term.factor {
                        tiles::Factor::Coefficient(number) => self.single(number),
                        tiles::Factor::Value(value) => slot(value),
                    });
                }
                for write in chain.writes() {
                    words.extend([slot(write.target), slot(write.base), self.single(power_of_two(write.shift))]);
                }
                words
            }
        }
    }

    fn finish(mut self, graph: &StepGraph, layout: &Layout, kernels: &[String]) -> Program {
        let (slots, rows) = (&layout.slots, &layout.memory.rows);
        let in_step = |slot: i64, row: usize, step: usize| slot + rows[row].shift[step];
        // Lanes whose product is zero may read beyond both ends.
        let (mut margin, mut end) = (0i64, 0i64);
        for step in [0, 1] {
            for row in rows {
                end = end.max(i64::from(row.slots.end) + row.shift[step]);
            }
            for argument in self.calls.iter().flat_map(|call| call.arguments.iter().chain(&call.clear)) {
                if let Argument::Slot(slot, row, lanes) = *argument {
                    margin = margin.max(-in_step(slot, row, step));
                    end = end.max(in_step(slot, row, step) + lanes as i64);
                }
            }
        }
        let margin = (margin as u64).next_multiple_of(LINE as u64) as i64;
        let at = |slot: u32, step: usize| {
            let row = layout.memory.row(slot);
            (in_step(i64::from(slot), row, step) + margin) as usize
        };
        let mut memory = vec![0.0; (margin + end) as usize];
        for (slot, number) in (0..).zip(&layout.memory.constants) {
            if let Some(number) = number {
                memory[at(slot, 0)] = *number;
            }
        }
        for ((state, _), number) in graph.states.iter().zip(&graph.initial) {
            memory[at(slots.of(*state), 0)] = *number;
        }
        for (value, segment, entry) in slots.column_entries(graph) {
            if let Role::Column(lookup, column) = graph.value(value).role {
                let table = graph.functions.lookups[index::at(lookup)].table;
                let column = &graph.functions.tables[index::at(table)].columns[usize::from(column)];
                memory[at(entry, 0)] = column[segment];
            }
        }
        self.work.kept = (memory.len() + self.numbers.len()) as u64;
        let (mut arguments, mut calls) = ([Vec::new(), Vec::new()], Vec::new());
        for call in &self.calls {
            calls.extend([call.kernel as u64, call.lanes as u64, u64::from(call.level)]);
            calls.extend([arguments[0].len() as u64, call.arguments.len() as u64, call.clear.len() as u64]);
            for (step, arguments) in (0..).zip(&mut arguments) {
                arguments.extend(call.arguments.iter().chain(&call.clear).map(|argument| match *argument {
                    Argument::Word(word) => u64::from(word),
                    Argument::Slot(slot, row, _) => (in_step(slot, row, step) + margin) as u64,
                    Argument::Moved(by) => (by * step as i64 + (1 << 31)) as u64,
                }));
            }
        }
        let of_state =
            |step: usize| graph.states.iter().map(|(state, _)| at(slots.of(*state), step) as u64).collect::<Vec<u64>>();
        let copies = if layout.memory.moved() == 0 { slots.copies() } else { &[] };
        let copies =
            copies.iter().flat_map(|(from, to, length)| [at(*from, 0) as u64, at(*to, 0) as u64, u64::from(*length)]);
        let bits = |numbers: &[f64]| numbers.iter().map(|number| number.to_bits()).collect::<Vec<u64>>();
        let [even, odd] = arguments;
        let inputs = graph.inputs.iter().map(|input| at(slots.of(*input), 0) as u64);
        let sections: [Vec<u64>; 9] = [
            bits(&memory),
            bits(&self.numbers),
            calls,
            even,
            odd,
            inputs.collect(),
            of_state(0),
            of_state(1),
            copies.collect(),
        ];
        let mut tables = Vec::new();
        for section in &sections {
            tables.extend((section.len() as u64).to_le_bytes());
            tables.extend(section.iter().flat_map(|word| word.to_le_bytes()));
        }
        let list = kernels.iter().map(|kernel| format!("{kernel}, ")).collect::<String>();
        let mut source = segment_function(graph.functions.segments);
        source += &self.text;
        source += &format!("static KERNELS: &[Kernel] = &[{}];\n", list.trim_end_matches(", "));
        source += &format!("const MARGIN: usize = {margin};\n");
        Program { source, tables, work: self.work }
    }
}

/// What a loop reads and multiplies, in the order of its signature.
struct Parts {
    values: Vec<Place>,
    /// For each sum rows and single numbers of its products.
    coefficients: Vec<Vec<Vec<f64>>>,
}

impl Parts {
    /// Values are read once, and those with the same number are added before they are multiplied.
    fn of(one: &Loop) -> (Signature, Parts) {
        let mut parts = Parts { values: Vec::new(), coefficients: Vec::new() };
        let sums = one.sums.iter().map(|sum| parts.sum(sum)).collect();
        let values = parts.values.iter().map(|value| matches!(value, Place::Same(..))).collect();
        (Signature { values, sums }, parts)
    }

    fn sum(&mut self, sum: &Sum) -> source::Sum {
        let mut products: Vec<(Vec<Read>, Second)> = Vec::new();
        let mut numbered: BTreeMap<u64, usize> = BTreeMap::new();
        let mut coefficients = Vec::new();
        for (operand, factor) in &sum.products {
            let operand = self.read(*operand);
            let second = match factor {
                Factor::Value(value) => Second::Value(self.read(*value)),
                Factor::Numbers(numbers) => match uniform(numbers) {
                    Some(number) => {
                        if let Some(product) = numbered.get(&number.to_bits()) {
                            products[*product].0.push(operand);
                            continue;
                        }
                        numbered.insert(number.to_bits(), products.len());
                        coefficients.push(vec![number]);
                        Second::Number
                    }
                    None => {
                        coefficients.push(filled(numbers));
                        Second::Numbers
                    }
                },
            };
            products.push((vec![operand], second));
        }
        self.coefficients.push(coefficients);
        let from = |base: &Base, parts: &mut Parts| match base {
            Base::None => From::None,
            Base::Value(value) => From::Value(parts.read(*value)),
            Base::Numbers(numbers) if uniform(numbers).is_some() => From::Number,
            Base::Numbers(_) => From::Numbers,
        };
        let writes = sum.writes.iter().map(|write| (from(&write.base, self), write.target.is_some())).collect();
        source::Sum { products, writes }
    }

    fn read(&mut self, place: Place) -> Read {
        if let Place::Earlier(write) = place {
            return Read::Earlier(write);
        }
        Read::Value(self.values.iter().position(|known| *known == place).unwrap_or_else(|| {
            self.values.push(place);
            self.values.len() - 1
        }))
    }
}

/// Lanes from one on.
fn at(place: Place, (start, lanes): (usize, usize)) -> Argument {
    match place {
        Place::Row(first, row) => Argument::Slot(first + start as i64, row, lanes),
        Place::Same(slot, row) => Argument::Slot(i64::from(slot), row, 1),
        Place::Earlier(_) => unreachable!("it is in no slot"),
    }
}

/// Lanes as stretches of one length, equally far apart: first lane, length, distance, count.
fn stretches(lanes: &[usize]) -> Vec<(usize, usize, usize, usize)> {
    let mut found: Vec<(usize, usize)> = Vec::new();
    for lane in lanes {
        match found.last_mut() {
            Some((first, length)) if *first + *length == *lane => *length += 1,
            _ => found.push((*lane, 1)),
        }
    }
    let mut grouped: Vec<(usize, usize, usize, usize)> = Vec::new();
    for (lane, of_length) in found {
        match grouped.last_mut() {
            Some((first, length, apart, count))
                if *length == of_length && (*count == 1 || lane == *first + *apart * *count) =>
            {
                *apart = (lane - *first) / *count;
                *count += 1;
            }
            _ => grouped.push((lane, of_length, 0, 1)),
        }
    }
    grouped
}

fn filled(numbers: &[Option<f64>]) -> Vec<f64> {
    numbers.iter().map(|number| number.unwrap_or(0.0)).collect()
}

/// What all of `shared` have to be multiplied by to become `own`, but for the rounding of each.
fn ratio(own: &[Vec<f64>], shared: &[Vec<f64>]) -> Option<f64> {
    let mut pairs = own.iter().flatten().zip(shared.iter().flatten());
    let (first, of) = pairs.clone().find(|(_, of)| **of != 0.0)?;
    let ratio = first / of;
    let alike = pairs.all(|(own, shared)| (own - ratio * shared).abs() <= ROUNDED * own.abs());
    (alike && ratio.is_normal()).then_some(ratio)
}

/// The longest pattern that is repeated in rows of few different numbers, such as which elements have a neighbour.
fn pattern<'a>(rows: impl Iterator<Item = &'a Vec<f64>>) -> Option<usize> {
    let pattern = |row: &Vec<f64>| {
        let longest = LONGEST_PATTERN.min(row.len() / 2);
        (2..=longest).find(|length| row.iter().zip(&row[*length..]).all(|(number, later)| number == later))
    };
    let found: Vec<usize> = rows.filter(|row| row.len() > 1).filter_map(pattern).collect();
    let longest = found.iter().copied().max()?;
    found.iter().all(|length| longest.is_multiple_of(*length)).then_some(longest)
}

/// A function that gives the segment of a number, as [`Segments::index_of`] has it.
fn segment_function(segments: Segments) -> String {
    let count = segments.count();
    let last = (1u32 << segments.octave_bits) - 1;
    let mantissas = 1u32 << (segments.index_bits - segments.octave_bits);
    format!(
        "fn segment(x: R, octaves: bool) -> usize {{
    if !octaves {{
        return (((x + 1.0) * {half}.0).max(0.0) as usize).min({count} - 1);
    }}
    let (mut x, mut octave) = (x.max(0.0), 0);
    while octave < {last} && x < 0.5 {{
        x *= 2.0;
        octave += 1;
    }}
    let mantissa = if octave < {last} {{ (x - 0.5) * 2.0 }} else {{ x }};
    octave * {mantissas} + ((mantissa * {mantissas}.0) as usize).min({mantissas} - 1)
}}
",
        half = count / 2,
    )
}
