//! The step graph: names, equations and values, then the chains as formulas.
//!
//! `chain V.stage2 = V + 2^-1*(0.5*V - 2*I)` writes the sum of products times a power of two on top of a base; without `V +` the
//! base is zero. Lines `interim` and `second` behind it are its other writes, whose `sum` is the chain's.

use std::fmt;
use std::str::FromStr;

use crate::functions::{Lookup, ScalarFunction, Segments, Table};
use crate::graph::{Chain, Equation, Factor, FormCost, Role, StageForm, StepGraph, Term, Value, ValueId, Write};
use crate::index::{self, EquationId, List, PeId, StateId};
use crate::model::Variable;
use crate::verify;

use super::labels::Labels;
use super::{Line, Section, Stage, TextError, elimination, expr, name, number, scaled, single};

/// What the variable of a function is called in its expression.
const ARGUMENT: &str = "x";

impl fmt::Display for StepGraph {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let of = |names: &[String]| Labels::of(names.iter().cloned());
        let labels = Lists {
            states: of(&self.names.states),
            inputs: of(&self.names.inputs),
            algebraics: of(&self.names.algebraics),
            auxiliaries: of(&self.names.auxiliaries),
            outputs: of(&self.names.outputs),
            equations: Labels::of(self.equations.iter().map(|equation| equation.name.clone())),
            values: Labels::of_values(self),
        };
        let printer = Printer { graph: self, labels };
        printer.declarations(f)?;
        printer.functions(f)?;
        self.chains.iter().try_for_each(|chain| printer.chain(f, chain))
    }
}

impl FromStr for StepGraph {
    type Err = TextError;

    fn from_str(text: &str) -> Result<StepGraph, TextError> {
        read(&single(text, Stage::Step)?)
    }
}

/// The text of a name that another item of its kind has, too: its label is not the name.
fn called(labels: &Labels, index: usize, own: &str) -> String {
    let own = name(own);
    if labels.text(index::number(index)) == own {
        own
    } else {
        format!("{} called {own}", labels.text(index::number(index)))
    }
}

/// What the items of each list are called in the text.
#[derive(Default)]
struct Lists {
    states: Labels,
    inputs: Labels,
    algebraics: Labels,
    auxiliaries: Labels,
    outputs: Labels,
    equations: Labels,
    values: Labels,
}

struct Printer<'a> {
    graph: &'a StepGraph,
    labels: Lists,
}

impl Printer<'_> {
    fn declarations(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let graph = self.graph;
        writeln!(f, "{}", Stage::Step.header())?;
        writeln!(f, "step {} form {} stages {}", number(graph.step), graph.form, graph.stages)?;
        for FormCost { form, stages, products, largest, ports, cycles } in &graph.forms {
            writeln!(
                f,
                "considered {form} stages {stages} products {products} largest {largest} ports {ports} cycles {cycles}"
            )?;
        }
        if graph.pre_adder {
            writeln!(f, "pre_adder")?;
        }
        if let Some((state, magnitude)) = graph.constant_pivot {
            writeln!(f, "constant_pivot {} magnitude {}", self.labels.states.text(state.number()), number(magnitude))?;
        }
        let algebraics = &self.labels.algebraics;
        graph.eliminations.iter().try_for_each(|each| elimination::print(f, each, algebraics))?;
        let value = |value: ValueId| self.labels.values.value(value);
        for ((index, (start, end)), initial) in graph.states.numbered().zip(&graph.initial) {
            let label = called(&self.labels.states, index.index(), &graph.names.states[index]);
            writeln!(f, "state {label} initial {} start {} end {}", number(*initial), value(*start), value(*end))?;
        }
        for (index, input) in graph.inputs.iter().enumerate() {
            let label = called(&self.labels.inputs, index, &graph.names.inputs[index]);
            writeln!(f, "input {label} value {}", value(*input))?;
        }
        for (index, algebraic) in graph.names.algebraics.iter().enumerate() {
            writeln!(f, "algebraic {}", called(&self.labels.algebraics, index, algebraic))?;
        }
        for (index, auxiliary) in graph.names.auxiliaries.iter().enumerate() {
            writeln!(f, "auxiliary {}", called(&self.labels.auxiliaries, index, auxiliary))?;
        }
        for (index, output) in graph.outputs.iter().enumerate() {
            let label = called(&self.labels.outputs, index, &graph.names.outputs[index]);
            writeln!(f, "output {label} value {}", value(*output))?;
        }
        for (index, equation) in graph.equations.iter().enumerate() {
            let place = equation.place.map_or_else(String::new, |pe| format!(" place {pe}"));
            writeln!(f, "equation {}{place}", called(&self.labels.equations, index, &equation.name))?;
        }
        for (index, stored) in graph.values.iter().enumerate() {
            write!(f, "value {} {}", self.labels.values.text(index::number(index)), self.role(stored.role))?;
            if let Some(equation) = stored.equation {
                write!(f, " in {}", self.labels.equations.text(equation.number()))?;
            }
            writeln!(f, "{}", if stored.factor { " factor" } else { "" })?;
        }
        Ok(())
    }

    fn role(&self, role: Role) -> String {
        let state =
            |kind: &str, state: StateId, number| format!("{kind} {} {number}", self.labels.states.text(state.number()));
        match role {
            Role::State(of) => format!("state {}", self.labels.states.text(of.number())),
            Role::Stage(of, stage) => state("stage", of, u32::from(stage)),
            Role::Sum(of, stage) => state("sum", of, u32::from(stage)),
            Role::Interim(of, stage) => state("interim", of, u32::from(stage)),
            Role::Next(of) => format!("next {}", self.labels.states.text(of.number())),
            Role::Algebraic(of, stage) => format!("algebraic {} {stage}", self.labels.algebraics.text(of)),
            Role::Inner(of, serial) => format!("inner {} {serial}", self.labels.equations.text(of.number())),
            Role::Partial(of, serial) => format!("partial {} {serial}", self.labels.equations.text(of.number())),
            Role::Relayed(of, relay) => format!("relayed {} {relay}", self.labels.values.value(of)),
            Role::Input(of) => format!("input {}", self.labels.inputs.text(of)),
            Role::Constant(constant) => format!("constant {}", number(constant)),
            Role::Published(of) => format!("published {}", self.labels.outputs.text(of)),
            Role::Auxiliary(of) => format!("auxiliary {}", self.labels.auxiliaries.text(of)),
            Role::Pivot(of, matrix) => state("pivot", of, u32::from(matrix)),
            Role::Column(lookup, column) => format!("column {lookup} {column}"),
        }
    }

    fn functions(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let functions = &self.graph.functions;
        for function in &functions.exact {
            let (kind, of) = match function.variable {
                Variable::State(of) => ("state", of.number()),
                Variable::Input(of) => ("input", of),
                Variable::Algebraic(of) => ("algebraic", of),
            };
            let body = expr::print(&function.body, &|_| ARGUMENT.to_owned());
            writeln!(f, "function {} {kind} {of} = {body}", name(&function.name))?;
        }
        if functions.segments != Segments::default() {
            let Segments { index_bits, octave_bits } = functions.segments;
            writeln!(f, "segments index_bits {index_bits} octave_bits {octave_bits}")?;
        }
        for table in &functions.tables {
            let ((low, high), error) = (table.domain, number(table.error));
            let octaves = if table.octaves { " octaves" } else { "" };
            writeln!(
                f,
                "table {}{octaves} domain {} .. {} error {error}",
                name(&table.name),
                number(low),
                number(high)
            )?;
            for column in &table.columns {
                let numbers: Vec<String> = column.iter().copied().map(number).collect();
                writeln!(f, "  column {}", numbers.join(" "))?;
            }
            table.stands_for.iter().try_for_each(|of| writeln!(f, "  stands_for {}", scaled::text(of)))?;
        }
        for Lookup { argument, table, function } in &functions.lookups {
            let function = function.map_or(String::new(), |function| format!(" function {function}"));
            writeln!(f, "lookup {} table {table}{function}", self.labels.values.value(*argument))?;
        }
        Ok(())
    }

    fn chain(&self, f: &mut fmt::Formatter<'_>, chain: &Chain) -> fmt::Result {
        let mut sum = String::new();
        for term in self.graph.chain_terms(chain) {
            let term = self.term(term);
            match (sum.is_empty(), term.strip_prefix('-')) {
                (true, _) => sum += &term,
                (false, Some(magnitude)) => sum += &format!(" - {magnitude}"),
                (false, None) => sum += &format!(" + {term}"),
            }
        }
        write!(f, "chain ")?;
        if self.graph.value(chain.write.value).equation != Some(chain.equation) {
            write!(f, "in {}: ", self.labels.equations.text(chain.equation.number()))?;
        }
        let function = chain.function.map_or_else(String::new, |function| format!("function {function} of "));
        writeln!(f, "{}", self.write(&chain.write, &function, &format!("({sum})")))?;
        let others = [("interim", &chain.interim), ("second", &chain.second)];
        for (kind, write) in others.into_iter().filter_map(|(kind, write)| Some((kind, write.as_ref()?))) {
            writeln!(f, "  {kind} {}", self.write(write, "", "sum"))?;
        }
        Ok(())
    }

    fn write(&self, write: &Write, function: &str, sum: &str) -> String {
        let base = write.base.map_or_else(String::new, |base| format!("{} + ", self.labels.values.value(base)));
        let weight = if write.weight == 0 { String::new() } else { format!("2^{}*", write.weight) };
        format!("{} = {function}{base}{weight}{sum}", self.labels.values.value(write.value))
    }

    fn term(&self, term: &Term) -> String {
        let factor = match term.factor {
            Factor::Coefficient(coefficient) => number(coefficient),
            Factor::Value(value) => self.labels.values.value(value).to_owned(),
        };
        let operand = self.labels.values.value(term.operand);
        match term.partner {
            Some(partner) => format!("{factor}*({operand} + {})", self.labels.values.value(partner)),
            None => format!("{factor}*{operand}"),
        }
    }
}

/// Reads the section of a step graph.
///
/// # Errors
/// An item is not one of a step graph, or they make no valid one.
pub fn read(section: &Section) -> Result<StepGraph, TextError> {
    let mut lists = Lists::default();
    lists.declare(section)?;
    let graph = lists.items(section)?;
    section.accept(graph, "step graph", verify::step::check)
}

const ITEMS: [&str; 17] = [
    "step",
    "considered",
    "pre_adder",
    "constant_pivot",
    "elimination",
    "state",
    "input",
    "algebraic",
    "auxiliary",
    "output",
    "equation",
    "value",
    "function",
    "segments",
    "table",
    "lookup",
    "chain",
];

const ROLES: [&str; 15] = [
    "state",
    "stage",
    "sum",
    "interim",
    "next",
    "algebraic",
    "inner",
    "partial",
    "relayed",
    "input",
    "constant",
    "published",
    "auxiliary",
    "pivot",
    "column",
];

/// Reads the label of an item, and its name where that is another.
fn read_called(line: &mut Line) -> Result<String, TextError> {
    let label = line.name("a name")?;
    if line.take_word("called") { line.name("a name") } else { Ok(label) }
}

impl Lists {
    /// Finds all names, which items may have before they are declared.
    fn declare(&mut self, section: &Section) -> Result<(), TextError> {
        for mut line in section.lines() {
            let lists = [
                ("state", &mut self.states),
                ("input", &mut self.inputs),
                ("algebraic", &mut self.algebraics),
                ("auxiliary", &mut self.auxiliaries),
                ("output", &mut self.outputs),
                ("equation", &mut self.equations),
                ("value", &mut self.values),
            ];
            for (kind, labels) in lists {
                if line.take_word(kind) {
                    let label = line.name("a name")?;
                    if !labels.add(label.clone()) {
                        return Err(line.error(format!("`{label}` is declared twice")));
                    }
                    break;
                }
            }
        }
        Ok(())
    }

    fn form(line: &mut Line) -> Result<StageForm, TextError> {
        line.word("form")?;
        Ok(StageForm::ALL[line.one_of(&StageForm::ALL.map(StageForm::name))?])
    }

    fn items(&self, section: &Section) -> Result<StepGraph, TextError> {
        let mut graph: Option<StepGraph> = None;
        let mut lines = section.lines();
        while let Some(mut line) = lines.next() {
            let item = ITEMS[line.one_of(&ITEMS)?];
            if item == "step" {
                if graph.is_some() {
                    return Err(line.error("there is an item `step` already"));
                }
                let step = line.number()?;
                let form = Lists::form(&mut line)?;
                graph = Some(empty(step, form, line.keyed("stages")?));
                line.done()?;
                continue;
            }
            let Some(graph) = &mut graph else {
                return Err(line.error("expected the item `step` before all others"));
            };
            self.item(item, &mut line, graph)?;
            line.done()?;
            if item == "table" {
                while let Some(mut column) = lines.next_if("column") {
                    let mut numbers = Vec::new();
                    while !column.is_done() {
                        numbers.push(column.number()?);
                    }
                    graph.functions.tables.last_mut().expect("read above").columns.push(numbers);
                }
                while let Some(mut line) = lines.next_if("stands_for") {
                    let scaled = scaled::read(&mut line)?;
                    line.done()?;
                    graph.functions.tables.last_mut().expect("read above").stands_for.push(scaled);
                }
            }
            if item == "chain" {
                let interim = lines.next_if("interim").map(|line| self.other_write(line)).transpose()?;
                let second = lines.next_if("second").map(|line| self.other_write(line)).transpose()?;
                let chain = graph.chains.last_mut().expect("read above");
                (chain.interim, chain.second) = (interim, second);
            }
        }
        graph.ok_or_else(|| section.error("there is no item `step`"))
    }

    fn item(&self, item: &str, line: &mut Line, graph: &mut StepGraph) -> Result<(), TextError> {
        match item {
            "considered" => {
                graph.forms.push(FormCost {
                    form: StageForm::ALL[line.one_of(&StageForm::ALL.map(StageForm::name))?],
                    stages: line.keyed("stages")?,
                    products: line.keyed("products")?,
                    largest: line.keyed("largest")?,
                    ports: line.keyed("ports")?,
                    cycles: line.keyed("cycles")?,
                });
            }
            "pre_adder" => graph.pre_adder = true,
            "constant_pivot" => {
                graph.constant_pivot = Some((self.state(line)?, line.keyed_number("magnitude")?));
            }
            "elimination" => graph.eliminations.push(elimination::read(line, &self.algebraics)?),
            "state" => {
                graph.names.states.push(read_called(line)?);
                graph.initial.push(line.keyed_number("initial")?);
                line.word("start")?;
                let start = self.values.read_value(line)?;
                line.word("end")?;
                graph.states.push((start, self.values.read_value(line)?));
            }
            "input" | "output" => {
                let label = read_called(line)?;
                line.word("value")?;
                let value = self.values.read_value(line)?;
                let (names, values) = match item {
                    "input" => (&mut graph.names.inputs, &mut graph.inputs),
                    _ => (&mut graph.names.outputs, &mut graph.outputs),
                };
                names.push(label);
                values.push(value);
            }
            "algebraic" => graph.names.algebraics.push(read_called(line)?),
            "auxiliary" => graph.names.auxiliaries.push(read_called(line)?),
            "equation" => {
                let span = line.span();
                let name = read_called(line)?;
                let place = line.take_word("place").then(|| line.integer()).transpose()?.map(PeId::new);
                graph.equations.push(Equation { name, span, place });
            }
            "value" => {
                line.name("a name")?;
                let value = self.value(line)?;
                graph.values.push(value);
            }
            "function" => graph.functions.exact.push(Lists::function(line)?),
            "segments" => {
                graph.functions.segments =
                    Segments { index_bits: line.keyed("index_bits")?, octave_bits: line.keyed("octave_bits")? };
            }
            "table" => {
                let table = line.name("the name of a table")?;
                let octaves = line.take_word("octaves");
                line.word("domain")?;
                let low = line.number()?;
                line.sign("..")?;
                let domain = (low, line.number()?);
                let error = line.keyed_number("error")?;
                graph.functions.tables.push(Table {
                    name: table,
                    octaves,
                    columns: Vec::new(),
                    domain,
                    error,
                    stands_for: Vec::new(),
                });
            }
            "lookup" => {
                let argument = self.values.read_value(line)?;
                let table = line.keyed("table")?;
                let function = if line.take_word("function") { Some(line.integer()?) } else { None };
                graph.functions.lookups.push(Lookup { argument, table, function });
            }
            _ => self.chain(line, graph)?,
        }
        Ok(())
    }

    fn value(&self, line: &mut Line) -> Result<Value, TextError> {
        let role = match ROLES[line.one_of(&ROLES)?] {
            "state" => Role::State(self.state(line)?),
            "stage" => Role::Stage(self.state(line)?, line.integer()?),
            "sum" => Role::Sum(self.state(line)?, line.integer()?),
            "interim" => Role::Interim(self.state(line)?, line.integer()?),
            "next" => Role::Next(self.state(line)?),
            "algebraic" => Role::Algebraic(self.algebraics.read(line, "an algebraic variable")?, line.integer()?),
            "inner" => Role::Inner(self.equation(line)?, line.integer()?),
            "partial" => Role::Partial(self.equation(line)?, line.integer()?),
            "relayed" => Role::Relayed(self.values.read_value(line)?, line.integer()?),
            "input" => Role::Input(self.inputs.read(line, "an input")?),
            "constant" => Role::Constant(line.number()?),
            "published" => Role::Published(self.outputs.read(line, "an output")?),
            "auxiliary" => Role::Auxiliary(self.auxiliaries.read(line, "an auxiliary quantity")?),
            "pivot" => Role::Pivot(self.state(line)?, line.integer()?),
            _ => Role::Column(line.integer()?, line.integer()?),
        };
        let equation = if line.take_word("in") { Some(self.equation(line)?) } else { None };
        Ok(Value { role, equation, factor: line.take_word("factor") })
    }

    fn state(&self, line: &mut Line) -> Result<StateId, TextError> {
        self.states.read(line, "a state").map(StateId::new)
    }

    fn equation(&self, line: &mut Line) -> Result<EquationId, TextError> {
        self.equations.read(line, "an equation").map(EquationId::new)
    }

    fn function(line: &mut Line) -> Result<ScalarFunction, TextError> {
        let name = line.name("the name of a function")?;
        let variable = match line.one_of(&["state", "input", "algebraic"])? {
            0 => Variable::State(line.integer()?),
            1 => Variable::Input(line.integer()?),
            _ => Variable::Algebraic(line.integer()?),
        };
        line.sign("=")?;
        let body = expr::read(line, &|name| (name == ARGUMENT).then_some(variable))?;
        Ok(ScalarFunction { name, body, variable })
    }

    fn chain(&self, line: &mut Line, graph: &mut StepGraph) -> Result<(), TextError> {
        let mut ahead = line.clone();
        let equation = if ahead.take_word("in") && !ahead.rest().starts_with('=') {
            *line = ahead;
            let equation = self.equation(line)?;
            line.sign(":")?;
            Some(equation)
        } else {
            None
        };
        let value = self.values.read_value(line)?;
        let place = line.last();
        let written = graph.values.get(value.index()).and_then(|value| value.equation);
        let Some(equation) = equation.or(written) else {
            return Err(line.error_at(place, "expected a value of an equation"));
        };
        line.sign("=")?;
        let mut ahead = line.clone();
        let function = if ahead.take_word("function") && ahead.has_digits() {
            *line = ahead;
            let function = line.integer()?;
            line.word("of")?;
            Some(function)
        } else {
            None
        };
        let (base, weight) = self.base(line)?;
        line.sign("(")?;
        let begin = index::number(graph.terms.len());
        self.terms(line, &mut graph.terms)?;
        line.sign(")")?;
        let terms = begin..graph.terms.len() as u32;
        let write = Write { value, base, weight };
        graph.chains.push(Chain { equation, terms, interim: None, write, second: None, function });
        Ok(())
    }

    /// The line of a chain's other write.
    fn other_write(&self, mut line: Line) -> Result<Write, TextError> {
        let value = self.values.read_value(&mut line)?;
        line.sign("=")?;
        let (base, weight) = self.base(&mut line)?;
        line.word("sum")?;
        line.done()?;
        Ok(Write { value, base, weight })
    }

    /// What a sum is added to, and its weight.
    fn base(&self, line: &mut Line) -> Result<(Option<ValueId>, i32), TextError> {
        let mut ahead = line.clone();
        let has_base = ahead.has_name() && ahead.name("a value").is_ok() && ahead.take_sign("+");
        let base = if has_base {
            let base = self.values.read_value(line)?;
            line.sign("+")?;
            Some(base)
        } else {
            None
        };
        let weight = if line.take_sign("2^") {
            let weight = line.integer()?;
            line.sign("*")?;
            weight
        } else {
            0
        };
        Ok((base, weight))
    }

    fn terms(&self, line: &mut Line, terms: &mut Vec<Term>) -> Result<(), TextError> {
        let mut minus = line.take_sign("-");
        loop {
            let factor = if minus || line.has_digits() {
                let magnitude = line.magnitude()?;
                Factor::Coefficient(if minus { -magnitude } else { magnitude })
            } else {
                Factor::Value(self.values.read_value(line)?)
            };
            line.sign("*")?;
            let (operand, partner) = if line.take_sign("(") {
                let operand = self.values.read_value(line)?;
                line.sign("+")?;
                let partner = self.values.read_value(line)?;
                line.sign(")")?;
                (operand, Some(partner))
            } else {
                (self.values.read_value(line)?, None)
            };
            terms.push(Term { operand, partner, factor });
            minus = line.take_sign("-");
            if !minus && !line.take_sign("+") {
                return Ok(());
            }
        }
    }
}

fn empty(step: f64, form: StageForm, stages: u32) -> StepGraph {
    StepGraph {
        form,
        stages,
        forms: Vec::new(),
        step,
        pre_adder: false,
        equations: List::new(),
        values: Vec::new(),
        chains: List::new(),
        terms: Vec::new(),
        states: List::new(),
        initial: List::new(),
        inputs: Vec::new(),
        outputs: Vec::new(),
        functions: Default::default(),
        constant_pivot: None,
        eliminations: Vec::new(),
        names: Default::default(),
        parts: Default::default(),
    }
}
