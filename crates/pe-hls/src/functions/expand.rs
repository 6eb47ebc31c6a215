//! Chains of lookups in place of chains that apply functions.

use pe_ir::functions::{Functions, Lookup, Segments};
use pe_ir::graph::{Chain, Factor, Role, StepGraph, Term, Value, ValueId, Write};

use super::Planned;
use super::fit::{Fit, Layout};

/// Largest magnitude of a base in a chain whose result has full scale 1.
const LARGEST_BASE: f64 = 0.99;

/// The step graph with the tables of its functions.
pub(super) fn expand(graph: &StepGraph, segments: Segments, planned: &[Option<Planned>]) -> StepGraph {
    let mut tables = Vec::new();
    let table_of: Vec<u32> = planned
        .iter()
        .zip(&graph.functions.exact)
        .map(|(planned, function)| {
            tables.extend(planned.as_ref().map(|planned| planned.table(&function.name)));
            tables.len() as u32 - u32::from(planned.is_some())
        })
        .collect();
    let mut serials = vec![0; graph.equations.len()];
    for value in &graph.values {
        if let Role::Inner(equation, serial) = value.role {
            let last: &mut u32 = &mut serials[equation as usize];
            *last = serial.max(*last);
        }
    }
    let functions = Functions { exact: Vec::new(), segments, tables, lookups: Vec::new() };
    let mut expansion = Expansion {
        graph: StepGraph {
            terms: Vec::with_capacity(graph.terms.len()),
            chains: Vec::with_capacity(graph.chains.len()),
            functions,
            ..graph.clone()
        },
        serials,
    };
    for chain in &graph.chains {
        match chain.function {
            None => {
                let terms = graph.chain_terms(chain).to_vec();
                expansion.chain(chain.equation, terms, chain.write, chain.second);
            }
            Some(function) => {
                let fit = &planned[function as usize].as_ref().expect("a function in use is planned").fit;
                expansion.lookup(graph, chain, fit, table_of[function as usize]);
            }
        }
    }
    expansion.graph
}

struct Expansion {
    graph: StepGraph,
    /// Last serial number of the inner values of each equation.
    serials: Vec<u32>,
}

impl Expansion {
    fn lookup(&mut self, graph: &StepGraph, chain: &Chain, fit: &Fit, table: u32) {
        let equation = chain.equation;
        let z = self.argument(graph, chain, fit);
        let lookup = self.graph.functions.lookups.len() as u32;
        self.graph.functions.lookups.push(Lookup { argument: z, table });
        let nothing = |operand| Term::new(operand, Factor::Coefficient(0.0));
        let result = chain.write;
        let last = fit.columns.len() as u8 - 1;
        if fit.degree == 0 {
            self.write(equation, nothing(z), result.value, (lookup, last));
            return;
        }
        // The columns in their order: local coordinate, its scale with octaves, coefficients.
        let u = self.inner(equation, false);
        let mut column = 1;
        let term = match fit.layout {
            Layout::Uniform => {
                let scale = libm::scalbn(1.0, self.graph.functions.segments.index_bits as i32);
                Term::new(z, Factor::Coefficient(scale))
            }
            Layout::Octaves => {
                let scale = self.inner(equation, true);
                self.write(equation, nothing(z), scale, (lookup, column));
                column += 1;
                Term::new(z, Factor::Value(scale))
            }
        };
        self.write(equation, term, u, (lookup, 0));
        let mut factor = self.inner(equation, true);
        self.write(equation, nothing(u), factor, (lookup, column));
        for column in column + 1..last {
            let next = self.inner(equation, true);
            self.write(equation, Term::new(u, Factor::Value(factor)), next, (lookup, column));
            factor = next;
        }
        self.write(equation, Term::new(u, Factor::Value(factor)), result.value, (lookup, last));
    }

    /// The chain of the argument, mapped to -1 .. 1.
    fn argument(&mut self, graph: &StepGraph, chain: &Chain, fit: &Fit) -> ValueId {
        let z = self.inner(chain.equation, false);
        let terms = graph.chain_terms(chain).iter().map(|term| match term.factor {
            Factor::Coefficient(coefficient) => {
                Term { factor: Factor::Coefficient(coefficient * fit.map.slope), ..*term }
            }
            Factor::Value(_) => unreachable!("the argument of a function is affine"),
        });
        let mut terms: Vec<Term> = terms.collect();
        let constant = chain.write.base.map_or(0.0, |base| match graph.value(base).role {
            Role::Constant(number) => number,
            _ => unreachable!("the argument of a function has a constant base"),
        });
        let mut constant = constant * fit.map.slope + fit.map.offset;
        if constant.abs() >= LARGEST_BASE {
            // The base has the argument's format, -1 .. 1. A whole number is a product, exact whatever the port.
            let one = self.value(Role::Constant(1.0), chain.equation, false);
            terms.push(Term::new(one, Factor::Coefficient(libm::round(constant))));
            constant -= libm::round(constant);
        }
        let base = (constant != 0.0).then(|| self.value(Role::Constant(constant), chain.equation, false));
        self.chain(chain.equation, terms, Write { value: z, base, weight: chain.write.weight }, None);
        z
    }

    /// A chain of one term whose base is a column.
    fn write(&mut self, equation: u32, term: Term, value: ValueId, (lookup, column): (u32, u8)) {
        let factor = self.graph.value(value).factor;
        let base = Some(self.value(Role::Column(lookup, column), equation, factor));
        self.chain(equation, vec![term], Write { value, base, weight: 0 }, None);
    }

    fn inner(&mut self, equation: u32, factor: bool) -> ValueId {
        let serial = &mut self.serials[equation as usize];
        *serial += 1;
        let role = Role::Inner(equation, *serial);
        self.value(role, equation, factor)
    }

    fn value(&mut self, role: Role, equation: u32, factor: bool) -> ValueId {
        self.graph.values.push(Value { role, equation, factor });
        ValueId(self.graph.values.len() as u32 - 1)
    }

    fn chain(&mut self, equation: u32, terms: Vec<Term>, write: Write, second: Option<Write>) {
        let start = self.graph.terms.len() as u32;
        self.graph.terms.extend(terms);
        let terms = start..self.graph.terms.len() as u32;
        self.graph.chains.push(Chain { equation, terms, interim: None, write, second, function: None });
    }
}
