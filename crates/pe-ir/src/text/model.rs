//! The model: its settings, then an item for each variable and its equation.

use std::collections::BTreeSet;
use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use crate::index::{self, StateId, at};
use crate::mechanism::Mechanism;
use crate::model::{
    Algebraic, Entry, Expr, Input, Interpolation, Matrix, Model, Output, Phase, Rate, Right, Signal, Solution, Solver,
    State, Variable,
};
use crate::motion::{Motion, Source};
use crate::verify;

use super::{Line, Lines, Section, Stage, TextError, expr, labels::Labels, name, number, quoted, single, waveform};

const MOTIONS: [&str; 10] =
    ["clock", "sine", "cosine", "swept_sine", "swept_cosine", "held", "line", "before", "after", "delayed"];

impl fmt::Display for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Printer::of(self).print(f)
    }
}

impl FromStr for Model {
    type Err = TextError;

    fn from_str(text: &str) -> Result<Model, TextError> {
        read(&single(text, Stage::Model)?)
    }
}

struct Printer<'a> {
    model: &'a Model,
    states: Labels,
    inputs: Labels,
    algebraics: Labels,
}

impl Printer<'_> {
    fn of(model: &Model) -> Printer<'_> {
        Printer {
            model,
            states: Labels::of(model.states.iter().map(|state| state.name.clone())),
            inputs: Labels::of(model.inputs.iter().map(|input| input.name.clone())),
            algebraics: Labels::of(model.algebraics.iter().map(|algebraic| algebraic.name.clone())),
        }
    }

    fn variable(&self, variable: Variable) -> String {
        match variable {
            Variable::State(state) => self.states.text(state.number()).to_owned(),
            Variable::Input(input) => self.inputs.text(input).to_owned(),
            Variable::Algebraic(algebraic) => self.algebraics.text(algebraic).to_owned(),
        }
    }

    fn expr(&self, expr: &Expr) -> String {
        expr::print(expr, &|variable| self.variable(variable))
    }

    fn source(&self, source: Source) -> String {
        match source {
            Source::Input(input) => format!("input {}", self.inputs.text(input)),
            Source::Signal(signal) => format!("signal {signal}"),
        }
    }

    fn motion(&self, motion: Motion) -> String {
        match motion {
            Motion::Clock => "clock".to_owned(),
            Motion::Sine(speed) => format!("sine {}", number(speed)),
            Motion::Cosine(speed) => format!("cosine {}", number(speed)),
            Motion::SweptSine(state) => format!("swept_sine {}", self.states.text(state.number())),
            Motion::SweptCosine(state) => format!("swept_cosine {}", self.states.text(state.number())),
            Motion::Held(source) => format!("held {}", self.source(source)),
            Motion::Line(source) => format!("line {}", self.source(source)),
            Motion::Before(source) => format!("before {}", self.source(source)),
            Motion::After(source) => format!("after {}", self.source(source)),
            Motion::Delayed(seconds) => format!("delayed {}", number(seconds)),
            Motion::Along(..) => unreachable!("only within a step"),
        }
    }

    fn matrix(&self, f: &mut fmt::Formatter<'_>, matrix: &Matrix) -> fmt::Result {
        write!(f, "matrix {} number {} size {}", name(&matrix.name), matrix.number, matrix.size)?;
        write!(f, " first {} {}", matrix.first.0, matrix.first.1)?;
        writeln!(f, "{}", if matrix.symmetric { " symmetric" } else { "" })?;
        let entry = |Entry { row, column, value }: &Entry| format!("  entry {row} {column} = {}\n", self.expr(value));
        matrix.entries.iter().try_for_each(|each| f.write_str(&entry(each)))
    }

    fn mechanism(&self, f: &mut fmt::Formatter<'_>, mechanism: &Mechanism) -> fmt::Result {
        writeln!(f, "mechanism penalty {}", number(mechanism.penalty))?;
        for (coordinate, velocity) in &mechanism.pairs {
            let [coordinate, velocity] = [coordinate, velocity].map(|state| self.states.text(state.number()));
            writeln!(f, "  pair {coordinate} {velocity}")?;
        }
        for (word, entries) in [("mass", &mechanism.mass), ("lever", &mechanism.jacobian)] {
            for Entry { row, column, value } in entries {
                writeln!(f, "  {word} {row} {column} = {}", self.expr(value))?;
            }
        }
        let Mechanism { forces, gaps, bends, drifts, .. } = mechanism;
        for (word, values) in [("force", forces), ("gap", gaps), ("bend", bends), ("drift", drifts)] {
            values.iter().try_for_each(|value| writeln!(f, "  {word} = {}", self.expr(value)))?;
        }
        Ok(())
    }

    fn print(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let model = self.model;
        writeln!(f, "{}", Stage::Model.header())?;
        writeln!(f, "model {}", name(&model.name))?;
        if !model.title.is_empty() {
            writeln!(f, "title {}", quoted(&model.title))?;
        }
        writeln!(f, "solver {}", model.solver.name())?;
        writeln!(f, "step {}", number(model.step))?;
        for Phase { until, ratio } in &model.phases {
            writeln!(f, "phase until {} ratio {}", number(*until), number(*ratio))?;
        }
        writeln!(f, "span {}", number(model.span))?;
        for Rate { period, .. } in &model.rates {
            writeln!(f, "rate {}", number(*period))?;
        }
        for (index, input) in model.inputs.iter().enumerate() {
            write!(f, "input {}", self.inputs.text(index::number(index)))?;
            common(f, input.range, &input.unit)?;
            if input.between == Interpolation::Linear {
                write!(f, " linear")?;
            }
            writeln!(f, " = {}", waveform::print(&input.waveform))?;
        }
        for signal in &model.signals {
            writeln!(f, "signal {}", waveform::print(&signal.waveform))?;
        }
        let (mut matrices, mut rights) = (BTreeSet::new(), BTreeSet::new());
        for (index, algebraic) in model.algebraics.iter().enumerate() {
            if let Expr::Solution(solution) = &algebraic.expr {
                if matrices.insert(solution.matrix.number) {
                    self.matrix(f, &solution.matrix)?;
                }
                if rights.insert(solution.right.number) {
                    writeln!(f, "right {}", solution.right.number)?;
                    solution.right.values.iter().try_for_each(|value| writeln!(f, "  value = {}", self.expr(value)))?;
                }
            }
            write!(f, "algebraic {}", self.algebraics.text(index::number(index)))?;
            common(f, algebraic.range, &algebraic.unit)?;
            f.write_str(if algebraic.kept { " kept" } else { "" })?;
            f.write_str(if algebraic.angle { " angle" } else { "" })?;
            match &algebraic.expr {
                Expr::Solution(solution) => {
                    let Solution { matrix, right, row } = &**solution;
                    writeln!(f, " matrix {} right {} row {row}", matrix.number, right.number)?;
                }
                expr => writeln!(f, " = {}", self.expr(expr))?,
            }
        }
        for (index, state) in model.states.iter().enumerate() {
            let label = self.states.text(index::number(index));
            write!(f, "state {label} quantity {} initial {}", state.quantity, number(state.initial))?;
            common(f, state.range, &state.unit)?;
            f.write_str(if state.tunable { " tunable" } else { "" })?;
            f.write_str(if state.angle { " angle" } else { "" })?;
            if let Some(rate) = state.rate {
                write!(f, " rate {rate}")?;
            }
            if let Some(motion) = state.motion {
                write!(f, " motion {}", self.motion(motion))?;
            }
            let left = if state.rate.is_some() { format!("next {label}") } else { format!("{label}'") };
            writeln!(f, "\n  {left} = {}", self.expr(&state.derivative))?;
            if let Some(jump) = &state.jump {
                writeln!(f, "  jump = {}", self.expr(jump))?;
            }
            if let Some(wait) = &state.wait {
                writeln!(f, "  wait = {}", self.expr(wait))?;
            }
        }
        if let Some(mechanism) = &model.mechanism {
            self.mechanism(f, mechanism)?;
        }
        for output in &model.outputs {
            let variable = self.variable(output.variable);
            write!(f, "output {}", name(&output.name))?;
            let kind = match output.variable {
                Variable::State(_) => "state",
                Variable::Input(_) => "input",
                Variable::Algebraic(_) => "algebraic",
            };
            match variable == name(&output.name) {
                true => writeln!(f)?,
                false => writeln!(f, " of {kind} {variable}")?,
            }
        }
        model.left_out.iter().try_for_each(|left_out| writeln!(f, "left_out {}", name(left_out)))
    }
}

fn common(f: &mut fmt::Formatter<'_>, range: Option<(f64, f64)>, unit: &Option<String>) -> fmt::Result {
    if let Some((low, high)) = range {
        write!(f, " range {} .. {}", number(low), number(high))?;
    }
    match unit {
        Some(unit) => write!(f, " unit {}", quoted(unit)),
        None => Ok(()),
    }
}

fn read_range(line: &mut Line) -> Result<Option<(f64, f64)>, TextError> {
    if !line.take_word("range") {
        return Ok(None);
    }
    let low = line.number()?;
    line.sign("..")?;
    let high = line.number()?;
    if low > high {
        return Err(line.error("expected an upper end that is no less than the lower one"));
    }
    Ok(Some((low, high)))
}

fn read_unit(line: &mut Line) -> Result<Option<String>, TextError> {
    if line.take_word("unit") { line.quoted().map(Some) } else { Ok(None) }
}

/// Reads the section of a model.
///
/// # Errors
/// An item is not one of a model, or they make no valid model.
pub fn read(section: &Section) -> Result<Model, TextError> {
    let mut reader = Reader::default();
    reader.declare(section)?;
    let model = reader.items(section)?;
    section.accept(model, "model", verify::model::check)
}

#[derive(Default)]
struct Reader {
    states: Labels,
    inputs: Labels,
    algebraics: Labels,
    /// Algebraic variables before the equation that is read.
    before: Option<u32>,
    /// Matrices and right-hand sides of linear systems.
    matrices: Vec<Arc<Matrix>>,
    rights: Vec<Arc<Right>>,
}

const ITEMS: [&str; 16] = [
    "model",
    "title",
    "solver",
    "step",
    "phase",
    "span",
    "rate",
    "input",
    "signal",
    "matrix",
    "right",
    "algebraic",
    "state",
    "mechanism",
    "output",
    "left_out",
];

impl Reader {
    /// Finds the names of all variables, which equations may read before they are declared.
    fn declare(&mut self, section: &Section) -> Result<(), TextError> {
        for mut line in section.lines() {
            let labels = if line.take_word("input") {
                &mut self.inputs
            } else if line.take_word("algebraic") {
                &mut self.algebraics
            } else if line.take_word("state") {
                &mut self.states
            } else {
                continue;
            };
            let label = line.name("the name of a variable")?;
            labels.add(label.clone());
            let count =
                [&self.states, &self.inputs, &self.algebraics].iter().filter(|all| all.find(&label).is_some()).count();
            let all = self.states.len() + self.inputs.len() + self.algebraics.len();
            if count > 1 || self.known() != all {
                return Err(line.error(format!("`{label}` is declared twice")));
            }
        }
        Ok(())
    }

    fn known(&self) -> usize {
        [&self.states, &self.inputs, &self.algebraics].iter().map(|labels| labels.distinct()).sum()
    }

    fn variable(&self, label: &str) -> Option<Variable> {
        let state = self.states.find(label).map(|state| Variable::State(StateId::new(state)));
        let input = || self.inputs.find(label).map(Variable::Input);
        state.or_else(input).or_else(|| self.algebraics.find(label).map(Variable::Algebraic))
    }

    fn expr(&self, line: &mut Line) -> Result<Expr, TextError> {
        let expr = expr::read(line, &|label| {
            self.variable(label).filter(|variable| match variable {
                Variable::Algebraic(algebraic) => self.before.is_none_or(|before| *algebraic < before),
                _ => true,
            })
        })?;
        line.done()?;
        Ok(expr)
    }

    fn state_named(&self, line: &mut Line) -> Result<StateId, TextError> {
        self.states.read(line, "a state").map(StateId::new)
    }

    fn source(&self, line: &mut Line) -> Result<Source, TextError> {
        match line.one_of(&["input", "signal"])? {
            0 => self.inputs.read(line, "an input").map(Source::Input),
            _ => line.integer().map(Source::Signal),
        }
    }

    fn motion(&self, line: &mut Line) -> Result<Motion, TextError> {
        Ok(match MOTIONS[line.one_of(&MOTIONS)?] {
            "clock" => Motion::Clock,
            "sine" => Motion::Sine(line.number()?),
            "cosine" => Motion::Cosine(line.number()?),
            "swept_sine" => Motion::SweptSine(self.state_named(line)?),
            "swept_cosine" => Motion::SweptCosine(self.state_named(line)?),
            "held" => Motion::Held(self.source(line)?),
            "line" => Motion::Line(self.source(line)?),
            "before" => Motion::Before(self.source(line)?),
            "delayed" => Motion::Delayed(positive(line)?),
            _ => Motion::After(self.source(line)?),
        })
    }

    fn items(&mut self, section: &Section) -> Result<Model, TextError> {
        let (mut model_name, mut title, mut solver, mut step, mut span) = (None, String::new(), None, None, None);
        let mut model = Model::new("", Solver::Rk4, 0.0, 0.0);
        let mut lines = section.lines();
        while let Some(mut line) = lines.next() {
            let whole = line.span();
            match ITEMS[line.one_of(&ITEMS)?] {
                "model" => model_name = Some(line.name("the name of the model")?),
                "title" => title = line.quoted()?,
                "solver" => {
                    let names = Solver::ALL.map(Solver::name);
                    solver = Some(Solver::ALL[line.one_of(&names)?]);
                }
                "step" => step = Some(positive(&mut line)?),
                "phase" => {
                    line.word("until")?;
                    let until = positive(&mut line)?;
                    if model.phases.last().is_some_and(|last| last.until >= until) {
                        return Err(line.error("expected a time after that of the phase before"));
                    }
                    line.word("ratio")?;
                    let ratio = positive(&mut line)?;
                    model.phases.push(Phase { until, ratio });
                }
                "span" => span = Some(positive(&mut line)?),
                "rate" => model.rates.push(Rate { period: positive(&mut line)?, span: whole }),
                "input" => {
                    let label = line.name("a name")?;
                    let (range, unit) = (read_range(&mut line)?, read_unit(&mut line)?);
                    let is_linear = line.take_word("linear");
                    line.sign("=")?;
                    let waveform = waveform::read(&mut line)?;
                    let between = if is_linear { Interpolation::Linear } else { Interpolation::Hold };
                    model.inputs.push(Input { name: label, unit, waveform, range, between, span: whole });
                }
                "signal" => model.signals.push(Signal { waveform: waveform::read(&mut line)?, span: whole }),
                "matrix" => {
                    self.before = Some(index::number(model.algebraics.len()));
                    let matrix = self.matrix(&mut line, &mut lines)?;
                    self.matrices.push(Arc::new(matrix));
                }
                "right" => {
                    self.before = Some(index::number(model.algebraics.len()));
                    let right = self.right(&mut line, &mut lines)?;
                    self.rights.push(Arc::new(right));
                }
                "algebraic" => {
                    let label = line.name("a name")?;
                    let (range, unit) = (read_range(&mut line)?, read_unit(&mut line)?);
                    let kept = line.take_word("kept");
                    let angle = line.take_word("angle");
                    self.before = Some(index::number(model.algebraics.len()));
                    let expr = if line.take_word("matrix") {
                        self.solution(&mut line)?
                    } else {
                        line.sign("=")?;
                        self.expr(&mut line)?
                    };
                    self.before = None;
                    model.algebraics.push(Algebraic { name: label, unit, expr, range, kept, angle, span: whole });
                }
                "state" => {
                    let mut state = self.state(&mut line)?;
                    line.done()?;
                    let Some(mut equation) = lines.next() else {
                        return Err(lines.error(format!("expected the equation of `{}`", state.name)));
                    };
                    state.span = equation.span();
                    state.derivative = self.equation(&mut equation, &state)?;
                    if let Some(mut jump) = lines.next_if("jump") {
                        jump.sign("=")?;
                        state.jump = Some(self.expr(&mut jump)?);
                    }
                    if let Some(mut wait) = lines.next_if("wait") {
                        wait.sign("=")?;
                        state.wait = Some(self.expr(&mut wait)?);
                    }
                    model.states.push(state);
                }
                "mechanism" => model.mechanism = Some(Arc::new(self.mechanism(&mut line, &mut lines)?)),
                "output" => model.outputs.push(self.output(&mut line)?),
                _ => model.left_out.push(line.name("a name")?),
            }
            line.done()?;
        }
        model.name = model_name.ok_or_else(|| section.error("there is no item `model NAME`"))?;
        model.title = title;
        model.solver = solver.ok_or_else(|| section.error("there is no item `solver`"))?;
        model.step = step.ok_or_else(|| section.error("there is no item `step`"))?;
        model.span = span.ok_or_else(|| section.error("there is no item `span`"))?;
        Ok(model)
    }

    /// A matrix and the lines of its entries.
    fn matrix(&self, line: &mut Line, lines: &mut Lines) -> Result<Matrix, TextError> {
        let label = line.name("a name")?;
        let number = line.keyed("number")?;
        if self.matrices.iter().any(|known| known.number == number) {
            return Err(line.error(format!("matrix {number} is declared twice")));
        }
        let size = line.keyed("size")?;
        line.word("first")?;
        let first = (line.integer()?, line.integer()?);
        let symmetric = line.take_word("symmetric");
        let mut entries = Vec::new();
        while let Some(mut entry) = lines.next_if("entry") {
            let (row, column) = (entry.integer()?, entry.integer()?);
            entry.sign("=")?;
            entries.push(Entry { row, column, value: self.expr(&mut entry)? });
        }
        Ok(Matrix { number, name: label, symmetric, size, first, entries })
    }

    /// A mechanism and the lines of its parts.
    fn mechanism(&self, line: &mut Line, lines: &mut Lines) -> Result<Mechanism, TextError> {
        line.word("penalty")?;
        let penalty = positive(line)?;
        let mut pairs = Vec::new();
        while let Some(mut pair) = lines.next_if("pair") {
            pairs.push((self.state_named(&mut pair)?, self.state_named(&mut pair)?));
            pair.done()?;
        }
        let mut entries = |word: &str| {
            let mut entries = Vec::new();
            while let Some(mut entry) = lines.next_if(word) {
                let (row, column) = (entry.integer()?, entry.integer()?);
                entry.sign("=")?;
                entries.push(Entry { row, column, value: self.expr(&mut entry)? });
            }
            Ok(entries)
        };
        let (mass, jacobian) = (entries("mass")?, entries("lever")?);
        let mut values = |word: &str| {
            let mut values = Vec::new();
            while let Some(mut value) = lines.next_if(word) {
                value.sign("=")?;
                values.push(self.expr(&mut value)?);
            }
            Ok(values)
        };
        let (forces, gaps, bends, drifts) = (values("force")?, values("gap")?, values("bend")?, values("drift")?);
        let fits = |entries: &[Entry], rows: usize| {
            entries.iter().all(|entry| at(entry.row) < rows && at(entry.column) < pairs.len())
        };
        let moves = drifts.is_empty() || drifts.len() == gaps.len();
        let sized = forces.len() == pairs.len() && bends.len() == gaps.len() && moves;
        if !(sized && fits(&mass, pairs.len()) && fits(&jacobian, gaps.len())) {
            return Err(line.error("the parts of the mechanism do not fit each other"));
        }
        Ok(Mechanism { pairs, mass, forces, jacobian, gaps, bends, drifts, penalty, span: line.span() })
    }

    /// A right-hand side and the lines of its values.
    fn right(&self, line: &mut Line, lines: &mut Lines) -> Result<Right, TextError> {
        let number = line.integer()?;
        if self.rights.iter().any(|known| known.number == number) {
            return Err(line.error(format!("right-hand side {number} is declared twice")));
        }
        let mut values = Vec::new();
        while let Some(mut value) = lines.next_if("value") {
            value.sign("=")?;
            values.push(self.expr(&mut value)?);
        }
        Ok(Right { number, values })
    }

    fn solution(&self, line: &mut Line) -> Result<Expr, TextError> {
        let number: u32 = line.integer()?;
        let matrix = self.matrices.iter().find(|matrix| matrix.number == number).map(Arc::clone);
        let matrix = matrix.ok_or_else(|| line.error(format!("there is no matrix {number} above")))?;
        let number: u32 = line.keyed("right")?;
        let right = self.rights.iter().find(|right| right.number == number).map(Arc::clone);
        let right = right.ok_or_else(|| line.error(format!("there is no right-hand side {number} above")))?;
        Ok(Expr::Solution(Box::new(Solution { matrix, right, row: line.keyed("row")? })))
    }

    fn state(&self, line: &mut Line) -> Result<State, TextError> {
        let label = line.name("a name")?;
        let quantity = line.keyed("quantity")?;
        let initial = line.keyed_number("initial")?;
        let (range, unit) = (read_range(line)?, read_unit(line)?);
        let tunable = line.take_word("tunable");
        let angle = line.take_word("angle");
        let rate = if line.take_word("rate") { Some(line.integer()?) } else { None };
        let motion = if line.take_word("motion") { Some(self.motion(line)?) } else { None };
        let derivative = Expr::Constant(0.0);
        let span = line.span();
        let state = State {
            quantity,
            initial,
            range,
            tunable,
            angle,
            unit,
            rate,
            motion,
            span,
            ..State::new(label, derivative)
        };
        Ok(state)
    }

    /// The line of a state's equation.
    fn equation(&self, line: &mut Line, state: &State) -> Result<Expr, TextError> {
        let left = name(&state.name);
        let expected = if state.rate.is_some() { format!("next {left} =") } else { format!("{left}' =") };
        let is_next = state.rate.is_none() || line.take_word("next");
        let fits = is_next && line.take_sign(&left) && (state.rate.is_some() || line.take_sign("'"));
        if !fits {
            return Err(line.expected(format!("the equation `{expected} ...`")));
        }
        line.sign("=")?;
        self.expr(line)
    }

    fn output(&self, line: &mut Line) -> Result<Output, TextError> {
        let span = line.span();
        let label = line.name("a name")?;
        let variable = if line.take_word("of") {
            match line.one_of(&["state", "input", "algebraic"])? {
                0 => Variable::State(self.state_named(line)?),
                1 => Variable::Input(self.inputs.read(line, "an input")?),
                _ => Variable::Algebraic(self.algebraics.read(line, "an algebraic variable")?),
            }
        } else {
            self.variable(&label).ok_or_else(|| line.error(format!("no variable is called `{label}`")))?
        };
        Ok(Output { name: label, variable, span })
    }
}

fn positive(line: &mut Line) -> Result<f64, TextError> {
    let number = line.number()?;
    if number > 0.0 { Ok(number) } else { Err(line.error("expected a positive number")) }
}
