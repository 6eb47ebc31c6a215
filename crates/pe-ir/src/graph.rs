//! The step graph: one solver step as chains of products, and its number formats.
//!
//! A *chain* is a sum of products; the write side adds it to a base word. Every value is written once per step.
//! The unit of mapping is the *equation*, which owns chains.

use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;

use crate::functions::{Functions, Lookup, Scaled};
use crate::index::{self, ChainId, EquationId, List, PeId, StateId, at};
use crate::model::Model;
use crate::parts::Parts;
use crate::source::Span;
use crate::word::{Latency, WordFormat};

pub use crate::index::ValueId;

/// How the stages of a step are arranged; see `docs/decisions/0001-number-path.md`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StageForm {
    /// One stage, `y+ = y + h f(y)`.
    Euler,
    /// By increments: stages add their increments to a running sum; `s f + 1` products per state in `s` stages.
    Increments,
    /// By increments that have one scale in all stages, so that every stage is the same sum; `s f` products per state.
    Sums,
    /// The same polynomial by Horner's rule, for models affine in the state: `s f` products.
    Horner,
    /// The same polynomial as a product of its real factors, one stage each, with matrices that hold powers.
    Factors,
    /// The method's whole map as one matrix, one stage.
    Full,
    /// Equations of a method that is no explicit Runge-Kutta method, in an order in which states are overwritten in
    /// place.
    Method,
}

impl StageForm {
    /// All forms.
    pub const ALL: [StageForm; 7] = [
        StageForm::Euler,
        StageForm::Increments,
        StageForm::Sums,
        StageForm::Horner,
        StageForm::Factors,
        StageForm::Full,
        StageForm::Method,
    ];

    /// The name that options and reports have for it.
    pub fn name(self) -> &'static str {
        match self {
            StageForm::Euler => "euler",
            StageForm::Increments => "increments",
            StageForm::Sums => "sums",
            StageForm::Horner => "horner",
            StageForm::Factors => "factors",
            StageForm::Full => "full",
            StageForm::Method => "method",
        }
    }
}

impl fmt::Display for StageForm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// What a step in some form is estimated to cost before it is mapped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FormCost {
    /// The form.
    pub form: StageForm,
    /// Its stages.
    pub stages: u32,
    /// Products per step, without those of outputs.
    pub products: u64,
    /// Products of the largest equation.
    pub largest: u32,
    /// Most input ports of a PE; zero if not estimated.
    pub ports: u32,
    /// Cycles per step; without a number of PEs those of one PE.
    pub cycles: u64,
}

/// What a value is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Role {
    /// A state at the start of the step.
    State(StateId),
    /// A state in an intermediate stage (counted from 2).
    Stage(StateId, u8),
    /// Running sum of a state's increments after a stage; with [`StageForm::Sums`] the state is in it.
    Sum(StateId, u8),
    /// A state in an intermediate or the next stage, but for the rest of its increment: written and read by one chain.
    Interim(StateId, u8),
    /// A state at the end of the step.
    Next(StateId),
    /// A shared algebraic variable in a stage (counted from 1).
    Algebraic(u32, u8),
    /// An inner factor of a product, private to its chain: equation and serial number.
    Inner(EquationId, u32),
    /// A part of an equation's sum that another equation computes: the equation it is a part of, and serial number.
    Partial(EquationId, u32),
    /// A copy that a relay makes of a value of another equation: the value, and the number of the relay.
    Relayed(ValueId, u32),
    /// An external input, held over the step.
    Input(u32),
    /// A constant in memory.
    Constant(f64),
    /// An output computed at the end of the step: index into the model's outputs.
    Published(u32),
    /// A quantity of the method, such as a slope or an entry of a matrix: index into [`Names::auxiliaries`].
    Auxiliary(u32),
    /// The reciprocal of a pivot of the method's matrix: the state of its row, and which matrix of the step it is.
    Pivot(StateId, u8),
    /// What a lookup finds in a column of its table: index into [`Functions::lookups`], and the column. Only the base
    /// of a write reads it.
    Column(u32, u8),
}

/// A stored value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Value {
    /// What it is.
    pub role: Role,
    /// The equation that computes or owns it; none of inputs.
    pub equation: Option<EquationId>,
    /// Whether the coefficient port reads it; such a value is read by nothing else.
    pub factor: bool,
}

/// The second factor of a term.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Factor {
    /// A number.
    Coefficient(f64),
    /// A stored value of the same equation with [`Value::factor`] set.
    Value(ValueId),
}

/// One product of a chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Term {
    /// The data operand; of a pair the one in the own memory.
    pub operand: ValueId,
    /// The data operand in the imported memory that the multiplier's pre-adder adds to the other one: both have the same
    /// coefficient. Only a step graph that is mapped has pairs.
    pub partner: Option<ValueId>,
    /// The coefficient operand.
    pub factor: Factor,
}

impl Term {
    /// A product with a single data operand.
    pub fn new(operand: ValueId, factor: Factor) -> Term {
        Term { operand, partner: None, factor }
    }

    /// Data operands, one or two.
    pub fn operands(&self) -> impl Iterator<Item = ValueId> {
        std::iter::once(self.operand).chain(self.partner)
    }
}

/// `value := base + 2^weight * sum`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Write {
    /// The value that is written.
    pub value: ValueId,
    /// The base, of the same number format; none means zero.
    pub base: Option<ValueId>,
    /// Binary logarithm of the weight of the chain's sum.
    pub weight: i32,
}

/// A sum of products with up to three writes.
#[derive(Clone, Debug, PartialEq)]
pub struct Chain {
    /// The equation it belongs to.
    pub equation: EquationId,
    /// Its terms in [`StepGraph::terms`]; at least one.
    pub terms: Range<u32>,
    /// A write whose value is the base of `write`, which so adds three times the sum, or another sum of two powers of
    /// two. It goes to the base memory only.
    pub interim: Option<Write>,
    /// The write that may be sent to other PEs.
    pub write: Write,
    /// Another write.
    pub second: Option<Write>,
    /// The function in [`Functions::exact`] that the first write applies to base plus sum; only in a step graph whose
    /// functions are not tables yet.
    pub function: Option<u32>,
}

impl Chain {
    /// Its writes in the order of their words.
    pub fn writes(&self) -> impl Iterator<Item = &Write> {
        let (first, last) = match &self.interim {
            Some(interim) => (interim, Some(&self.write)),
            None => (&self.write, None),
        };
        std::iter::once(first).chain(self.second.as_ref()).chain(last)
    }

    /// Writes with the words between the first possible one and theirs.
    pub fn delayed(&self, latency: Latency) -> impl Iterator<Item = (u32, &Write)> {
        let interim = self.interim.is_some();
        self.writes().enumerate().map(move |(position, write)| {
            // What the interim write stores has to be there.
            let on_top = interim && std::ptr::eq(write, &self.write);
            (if on_top { latency.base_again() } else { index::number(position) }, write)
        })
    }

    /// Words for which the sum stays in the hold register.
    pub fn held(&self, latency: Latency) -> u32 {
        self.delayed(latency).map(|(delay, _)| delay + 1).max().unwrap_or(1)
    }

    /// Number of terms.
    pub fn len(&self) -> u32 {
        self.terms.end - self.terms.start
    }

    /// Whether there are no terms; never true in a valid graph.
    pub fn is_empty(&self) -> bool {
        self.terms.is_empty()
    }
}

/// A unit of mapping.
#[derive(Clone, Debug, PartialEq)]
pub struct Equation {
    /// Name of its left-hand side.
    pub name: String,
    /// Where the spec states it.
    pub span: Span,
    /// The PE that it was made for, where a step was cut to suit a mapping, which may begin with that.
    pub place: Option<PeId>,
}

/// One solver step.
#[derive(Clone, Debug)]
pub struct StepGraph {
    /// Stage form.
    pub form: StageForm,
    /// Number of stages of that form.
    pub stages: u32,
    /// The forms that were considered, in the order of their stages, most first.
    pub forms: Vec<FormCost>,
    /// Step in seconds.
    pub step: f64,
    /// Whether operands with equal coefficients may be added in front of the multiplier.
    pub pre_adder: bool,
    /// Units of mapping.
    pub equations: List<EquationId, Equation>,
    /// Values.
    pub values: Vec<Value>,
    /// Chains; each reads only what earlier chains write, states, inputs and constants.
    pub chains: List<ChainId, Chain>,
    /// Terms of all chains.
    pub terms: Vec<Term>,
    /// For each state its value at the start and at the end of the step; the states of the model come first.
    pub states: List<StateId, (ValueId, ValueId)>,
    /// Initial value of each state.
    pub initial: List<StateId, f64>,
    /// For each input its value.
    pub inputs: Vec<ValueId>,
    /// For each output the value to publish.
    pub outputs: Vec<ValueId>,
    /// Functions of one variable.
    pub functions: Functions,
    /// The pivot of least magnitude among those that are numbers, of implicit methods: its state and the magnitude.
    pub constant_pivot: Option<(StateId, f64)>,
    /// How the matrices of the model's linear systems are eliminated.
    pub eliminations: Vec<Elimination>,
    /// Names: states, inputs, algebraic variables, outputs. States that the method keeps from step to step, such as
    /// slopes, come after those of the model.
    pub names: Names,
    /// Parts of the step that are computed in turns.
    pub parts: Parts,
}

/// How the matrix of linear systems is eliminated.
#[derive(Clone, Debug, PartialEq)]
pub struct Elimination {
    /// Name of the matrix.
    pub name: String,
    /// Name of the order.
    pub order: String,
    /// Name of the scheme in which its triangles are computed.
    pub scheme: String,
    /// Rows.
    pub size: u32,
    /// Whether it is symmetric.
    pub symmetric: bool,
    /// Entries that are not zero all the time.
    pub entries: u32,
    /// Entries that the elimination adds to them; of a symmetric matrix to those of one triangle.
    pub fill: u32,
    /// Most pivots that wait for one another.
    pub depth: u32,
    /// Its pivots, in the order of the elimination.
    pub pivots: Vec<Pivot>,
}

/// A pivot of an elimination.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pivot {
    /// A number.
    Number(f64),
    /// One that varies.
    Varying {
        /// The algebraic variable that is its reciprocal.
        reciprocal: u32,
        /// Its least and largest value over the span, known once functions are tables.
        range: Option<(f64, f64)>,
    },
}

/// Names of a model's variables.
#[derive(Clone, Debug, Default)]
pub struct Names {
    /// States.
    pub states: List<StateId, String>,
    /// Inputs.
    pub inputs: Vec<String>,
    /// Algebraic variables.
    pub algebraics: Vec<String>,
    /// Outputs.
    pub outputs: Vec<String>,
    /// Quantities of the method.
    pub auxiliaries: Vec<String>,
}

impl Names {
    /// Collects the names of a model.
    pub fn of(model: &Model) -> Names {
        Names {
            states: model.states.iter().map(|s| s.name.clone()).collect(),
            inputs: model.inputs.iter().map(|s| s.name.clone()).collect(),
            algebraics: model.algebraics.iter().map(|s| s.name.clone()).collect(),
            outputs: model.outputs.iter().map(|s| s.name.clone()).collect(),
            auxiliaries: Vec::new(),
        }
    }
}

impl StepGraph {
    /// A value.
    pub fn value(&self, id: ValueId) -> &Value {
        &self.values[id.index()]
    }

    /// The equation that computes or owns a value; none of inputs.
    pub fn equation_of(&self, id: ValueId) -> Option<&Equation> {
        self.value(id).equation.map(|equation| &self.equations[equation])
    }

    /// Terms of a chain.
    pub fn chain_terms(&self, chain: &Chain) -> &[Term] {
        &self.terms[at(chain.terms.start)..chain.terms.end as usize]
    }

    /// The graph with other chains, which write the same values.
    pub fn with_chains(&self, chains: List<ChainId, Chain>, terms: Vec<Term>) -> StepGraph {
        StepGraph {
            form: self.form,
            stages: self.stages,
            forms: self.forms.clone(),
            step: self.step,
            pre_adder: self.pre_adder,
            equations: self.equations.clone(),
            values: self.values.clone(),
            chains,
            terms,
            states: self.states.clone(),
            initial: self.initial.clone(),
            inputs: self.inputs.clone(),
            outputs: self.outputs.clone(),
            functions: self.functions.clone(),
            constant_pivot: self.constant_pivot,
            eliminations: self.eliminations.clone(),
            names: self.names.clone(),
            parts: self.parts.clone(),
        }
    }

    /// Values of algebraic variables that are those of a shape, with the function of it that the variables are: what reads
    /// them scales them.
    pub fn scaled(&self) -> BTreeMap<ValueId, &Scaled> {
        let producers = self.producers();
        let column = |value: ValueId| {
            let base = self.chains[producers[value.index()]?].write.base?;
            self.lookup(base).map(|(_, lookup)| lookup)
        };
        let shape = |chain: &Chain| {
            let is_variable = matches!(self.value(chain.write.value).role, Role::Algebraic(..));
            let lookup = match (self.lookup(chain.write.base.unwrap_or(chain.write.value)), self.chain_terms(chain)) {
                (Some((_, lookup)), _) => lookup,
                // The value of one octave, brought back by what another table gives.
                (None, [Term { operand, factor: Factor::Value(factor), .. }]) => {
                    column(*factor).and(column(*operand))?
                }
                _ => return None,
            };
            self.functions.shared(lookup).filter(|_| is_variable)
        };
        self.chains.iter().filter_map(|chain| Some((chain.write.value, shape(chain)?))).collect()
    }

    /// Whether states are kept in pairs of words that change roles from step to step: in a single stage every equation
    /// reads old states and writes new ones, so no order of writes suits all readers.
    pub fn swaps(&self) -> bool {
        self.stages == 1 && self.form != StageForm::Method
    }

    /// Products per step.
    pub fn macs(&self) -> u64 {
        self.terms.len() as u64
    }

    /// Display name of a value.
    pub fn value_name(&self, id: ValueId) -> String {
        let value = self.value(id);
        match value.role {
            Role::State(s) => self.names.states[s].clone(),
            Role::Stage(s, stage) => format!("{}.stage{stage}", self.names.states[s]),
            Role::Sum(s, stage) => format!("{}.sum{stage}", self.names.states[s]),
            Role::Interim(s, stage) => format!("{}.interim{stage}", self.names.states[s]),
            Role::Next(s) => format!("{}.next", self.names.states[s]),
            Role::Algebraic(a, stage) => format!("{}.stage{stage}", self.names.algebraics[at(a)]),
            Role::Inner(equation, serial) => {
                format!("{}.factor{serial}", self.equations[value.equation.unwrap_or(equation)].name)
            }
            Role::Partial(equation, serial) => format!("{}.partial{serial}", self.equations[equation].name),
            Role::Relayed(value, relay) => format!("{}.relayed{relay}", self.value_name(value)),
            Role::Input(i) => self.names.inputs[at(i)].clone(),
            Role::Constant(c) => format!("{c:e}"),
            Role::Auxiliary(a) => self.names.auxiliaries[at(a)].clone(),
            Role::Pivot(s, matrix) => format!("{}.pivot{matrix}", self.names.states[s]),
            Role::Published(o) => format!("{}.published", self.names.outputs[at(o)]),
            Role::Column(lookup, column) => {
                let lookup = &self.functions.lookups[at(lookup)];
                let table = &self.functions.tables[at(lookup.table)].name;
                format!("{table}.column{column}[{}]", self.value_name(lookup.argument))
            }
        }
    }

    /// The lookup that a column's value belongs to, with its index.
    pub fn lookup(&self, value: ValueId) -> Option<(u32, Lookup)> {
        match self.value(value).role {
            Role::Column(lookup, _) => Some((lookup, self.functions.lookups[at(lookup)])),
            _ => None,
        }
    }

    /// For each value the chain that writes it; none for states, inputs and constants.
    pub fn producers(&self) -> Vec<Option<ChainId>> {
        let mut producers = vec![None; self.values.len()];
        for (id, chain) in self.chains.numbered() {
            for write in chain.writes() {
                producers[write.value.index()] = Some(id);
            }
        }
        producers
    }

    /// The arcs of the ODE-dependency graph: `(read, reader)` pairs of distinct equations, sorted, without repeats.
    pub fn dependencies(&self) -> Vec<(EquationId, EquationId)> {
        let mut arcs: Vec<(EquationId, EquationId)> = Vec::new();
        for chain in &self.chains {
            for operand in self.chain_terms(chain).iter().flat_map(Term::operands) {
                let source = self.value(operand).equation.filter(|source| *source != chain.equation);
                arcs.extend(source.map(|source| (source, chain.equation)));
            }
        }
        arcs.sort_unstable();
        arcs.dedup();
        arcs
    }

    /// Issue slots that each equation needs per step: its products, or its writes where those are more.
    pub fn loads(&self) -> List<EquationId, u32> {
        let mut loads = List::filled(0, self.equations.len());
        for chain in &self.chains {
            loads[chain.equation] += chain.len().max(index::number(chain.writes().count()));
        }
        loads
    }
}

/// Number formats of a step graph: the fixed-point form of every value, coefficient and write.
#[derive(Clone, Debug, PartialEq)]
pub struct FixedPoint {
    /// Word widths.
    pub format: WordFormat,
    /// For each value the exponent of its stored word's LSB.
    pub exponents: Vec<i32>,
    /// For each value whether it is at most half of full scale, so that the sum of two fits the multiplier's data port.
    pub half_scale: Vec<bool>,
    /// For each term the quantised coefficient; 0 for products of two values.
    pub coefficients: Vec<i64>,
    /// For each chain the exponent of the product LSB.
    pub products: List<ChainId, i32>,
    /// For each chain the right shifts of its writes.
    pub shifts: List<ChainId, [u8; 3]>,
    /// For each chain the accumulator bits that its sum can need.
    pub accumulator_bits: List<ChainId, u8>,
}

impl FixedPoint {
    /// The offset that a value's stored words carry.
    pub fn offset(&self, value: &Value) -> i64 {
        if value.factor { self.format.factor_offset() } else { self.format.data_offset() }
    }

    /// The stored word of a constant value.
    pub fn constant_word(&self, graph: &StepGraph, id: ValueId) -> i64 {
        let value = graph.value(id);
        match value.role {
            Role::Constant(number) => self.number_word(number, id, value),
            _ => panic!("{} is not a constant", graph.value_name(id)),
        }
    }

    /// The base word that a column's value is in a segment of its table.
    pub fn column_word(&self, graph: &StepGraph, id: ValueId, segment: usize) -> i64 {
        let value = graph.value(id);
        match value.role {
            Role::Column(lookup, column) => {
                let table = graph.functions.lookups[at(lookup)].table;
                let number = graph.functions.tables[at(table)].columns[usize::from(column)][segment];
                self.number_word(number, id, value)
            }
            _ => panic!("{} is not in a table", graph.value_name(id)),
        }
    }

    /// The stored word of a number with the format of a value.
    pub fn number_word(&self, number: f64, id: ValueId, value: &Value) -> i64 {
        self.format.encode(number, self.exponents[id.index()], self.offset(value)).0
    }

    /// The real number that a term's quantised coefficient stands for.
    pub fn coefficient_value(&self, graph: &StepGraph, chain: ChainId, term: usize) -> f64 {
        let operand = graph.terms[term].operand.index();
        let operand_exponent = self.exponents[operand] + self.format.data_drop() as i32;
        libm::scalbn(self.coefficients[term] as f64, self.products[chain] - operand_exponent)
    }
}
