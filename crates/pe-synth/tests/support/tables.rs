//! Steps with tables, made by hand: what is written to some values goes through a polynomial that is looked up.

#![allow(clippy::disallowed_methods, reason = "the tests' own numbers may come from the standard library")]

use std::collections::BTreeMap;

use pe_ir::functions::{Functions, Lookup, Segments, Table};
use pe_ir::graph::{Chain, Factor, Role, StepGraph, Term, Value, ValueId, Write};
use pe_ir::index::{EquationId, List};
use pe_sim::double::DoubleRun;

/// How the tables are divided.
pub const SEGMENTS: Segments = Segments { index_bits: 4, octave_bits: 2 };

/// Steps of the run that tells the ranges of arguments.
const STEPS: usize = 60;

/// Puts a function between each algebraic variable and those who read it: odd ones through octaves, even ones through
/// equal segments, all of the two tables. The functions are near the identity, so that runs stay what they were.
///
/// # Panics
/// If the step has no algebraic variables.
pub fn tabled(graph: &StepGraph) -> StepGraph {
    let mut run = DoubleRun::new(graph);
    for _ in 0..STEPS {
        run.step(&vec![1.2; graph.inputs.len()]).expect("random models stay finite");
    }
    let largest = run.largest();
    let largest = largest.iter().enumerate().filter(|(index, _)| is_algebraic(graph.values[*index].role));
    let scale = 1.7 * largest.fold(1e-3, |most: f64, (_, largest)| most.max(*largest));
    let scale = scale.log2().ceil().exp2();
    let mut builder = Builder { graph: graph.clone(), scale, replaced: BTreeMap::new(), serial: 1000 };
    builder.graph.terms.clear();
    builder.graph.chains = List::new();
    builder.graph.functions = Functions {
        exact: Vec::new(),
        segments: SEGMENTS,
        tables: vec![equal(scale), octaves(scale)],
        lookups: vec![],
    };
    for chain in &graph.chains {
        builder.copy(graph, chain);
        if is_algebraic(graph.value(chain.write.value).role) {
            builder.look_up(chain.write.value);
        }
    }
    assert!(!builder.replaced.is_empty(), "no algebraic variables");
    let Builder { mut graph, replaced, .. } = builder;
    graph.outputs.iter_mut().for_each(|output| *output = replaced.get(output).copied().unwrap_or(*output));
    graph
}

fn is_algebraic(role: Role) -> bool {
    matches!(role, Role::Algebraic(..))
}

/// What the tables say of `z` in -1 .. 1: close to `z` times the scale.
pub fn exact(z: f64, scale: f64) -> f64 {
    scale * (z + 0.05 * (3.0 * z).sin())
}

/// Columns of a polynomial of second degree in the local coordinate -1 .. 1 of each segment, then those of its centre
/// and half its width.
fn columns(octaves: bool, scale: f64, at: impl Fn(f64) -> f64) -> Vec<Vec<f64>> {
    let mut columns = vec![Vec::new(); 5];
    for segment in 0..SEGMENTS.count() {
        let (low, high) = SEGMENTS.range(segment, octaves);
        let (centre, half) = (0.5 * (low + high), 0.5 * (high - low));
        let (left, middle, right) = (exact(at(low), scale), exact(at(centre), scale), exact(at(high), scale));
        let numbers = [middle, 0.5 * (right - left), 0.5 * (left + right) - middle, centre / half, 1.0 / half];
        columns.iter_mut().zip(numbers).for_each(|(column, number)| column.push(number));
    }
    columns
}

/// A table of equal segments: the local coordinate is `2^index_bits z` minus the segment's centre.
fn equal(scale: f64) -> Table {
    let mut columns = columns(false, scale, |z| z);
    columns[3].iter_mut().for_each(|centre| *centre = -*centre);
    columns.truncate(4);
    Table { name: "equal".into(), octaves: false, columns, domain: (-scale, scale), error: 0.0, stands_for: vec![] }
}

/// A table of octaves of `z` from 0 on, which stands for `2 z - 1`; the slope of the local coordinate is a column.
fn octaves(scale: f64) -> Table {
    let mut columns = columns(true, scale, |z| 2.0 * z - 1.0);
    columns[3].iter_mut().for_each(|centre| *centre = -*centre);
    Table { name: "octaves".into(), octaves: true, columns, domain: (-scale, scale), error: 0.0, stands_for: vec![] }
}

struct Builder {
    graph: StepGraph,
    scale: f64,
    /// What is read in the place of an algebraic variable.
    replaced: BTreeMap<ValueId, ValueId>,
    serial: u32,
}

impl Builder {
    fn copy(&mut self, from: &StepGraph, chain: &Chain) {
        let start = self.graph.terms.len() as u32;
        for term in from.chain_terms(chain) {
            let operand = self.replaced.get(&term.operand).copied().unwrap_or(term.operand);
            self.graph.terms.push(Term { operand, ..*term });
        }
        self.graph.chains.push(Chain { terms: start..self.graph.terms.len() as u32, ..chain.clone() });
    }

    fn look_up(&mut self, value: ValueId) {
        let equation = self.graph.value(value).equation.expect("chains compute it");
        let odd = matches!(self.graph.value(value).role, Role::Algebraic(a, _) if a % 2 == 1);
        let coefficient = |number: f64| Factor::Coefficient(number);
        let lookup = self.graph.functions.lookups.len() as u32;
        // In octaves of 0 .. 1 the argument is in the middle, and now and then below 0.
        let (factor, middle) = if odd { (0.5 / self.scale, 0.1) } else { (1.0 / self.scale, 0.0) };
        let base = odd.then(|| self.value(Role::Constant(middle), equation, false));
        let z = self.chain(equation, (value, coefficient(factor)), base, false);
        self.graph.functions.lookups.push(Lookup { argument: z, table: u32::from(odd), function: None });
        let column = |builder: &mut Builder, column: u8, factor: bool| {
            Some(builder.value(Role::Column(lookup, column), equation, factor))
        };
        let local = match odd {
            true => {
                let base = column(self, 4, true);
                Factor::Value(self.chain(equation, (z, coefficient(0.0)), base, true))
            }
            false => coefficient(f64::from(1u32 << SEGMENTS.index_bits)),
        };
        let base = column(self, 3, false);
        let u = self.chain(equation, (z, local), base, false);
        let base = column(self, 2, true);
        let second = self.chain(equation, (u, coefficient(0.0)), base, true);
        let base = column(self, 1, true);
        let first = self.chain(equation, (u, Factor::Value(second)), base, true);
        let base = column(self, 0, false);
        let result = self.chain(equation, (u, Factor::Value(first)), base, false);
        self.replaced.insert(value, result);
    }

    fn value(&mut self, role: Role, equation: EquationId, factor: bool) -> ValueId {
        self.graph.values.push(Value { role, equation: Some(equation), factor });
        ValueId::new(self.graph.values.len() as u32 - 1)
    }

    /// A chain of one product.
    fn chain(
        &mut self,
        equation: EquationId,
        (operand, by): (ValueId, Factor),
        base: Option<ValueId>,
        factor: bool,
    ) -> ValueId {
        self.serial += 1;
        let value = self.value(Role::Inner(equation, self.serial), equation, factor);
        let start = self.graph.terms.len() as u32;
        self.graph.terms.push(Term::new(operand, by));
        let write = Write { value, base, weight: 0 };
        self.graph.chains.push(Chain {
            equation,
            terms: start..start + 1,
            interim: None,
            write,
            second: None,
            function: None,
        });
        value
    }
}
