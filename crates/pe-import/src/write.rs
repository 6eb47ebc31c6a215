//! Writes an imported model as a spec that a person would write.

use std::fmt::Write;

use crate::expr::{Callee, Expr};
use crate::model::{Event, Kind, Model, Quantity};
use crate::names::{Names, element};
use crate::number::shown;
use crate::rolled::{marked, plain, rules_of, sum_of};

/// Columns after which a line is folded.
const WIDTH: usize = 110;

/// How a spec is run; times in the unit of time of the model.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// Name of the method.
    pub solver: String,
    /// Step.
    pub step: f64,
    /// Span.
    pub span: f64,
    /// Why these.
    pub reason: String,
}

/// How tightly an operator binds.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Level {
    Choice,
    Or,
    And,
    Not,
    Compare,
    Sum,
    Product,
    Minus,
    Power,
    Atom,
}

/// Writes one model.
pub(crate) struct Writer<'a> {
    pub model: &'a Model,
    pub names: &'a Names,
    /// Arguments of the function whose body is written.
    arguments: &'a [String],
    /// Names that are free for the two indices of declarations, the first of which equations have, and for that of sums.
    indices: [String; 3],
}

impl<'a> Writer<'a> {
    pub fn new(model: &'a Model, names: &'a Names) -> Self {
        let known = |name: &String| names.quantities.contains(name) || names.arrays.contains(name);
        let letters = ('i'..='n').map(String::from);
        let mut free = letters.chain((1..).map(|number| format!("index_{number}"))).filter(|name| !known(name));
        let indices = [free.next(), free.next(), free.next()].map(|name| name.expect("more numbers than names"));
        Writer { model, names, arguments: &[], indices }
    }

    /// The text of the spec.
    pub fn spec(&mut self, file: &str, setting: &Setting) -> String {
        let model = self.model;
        let mut text = format!("// Imported from {}, {}.\n", comment(file), model.format);
        let title = comment(&model.title).replace('"', "'");
        text += &format!("model {}", self.names.model);
        if !title.is_empty() {
            text += &format!(" \"{title}\"");
        }
        let unit = model.time_word().map_or_else(String::new, |unit| format!(" {unit}"));
        if let (Some(of_model), None) = (&model.time_unit, model.time_word()) {
            text += &format!("\n// Time is in {}: what is a second here is one of these.", comment(of_model));
        }
        if !setting.reason.is_empty() {
            text += &format!("\n// {}", setting.reason);
        }
        text += &format!("\nsolver {}\nstep   {}{unit}\n", setting.solver, shown(setting.step));
        text += &format!("span   {}{unit}\n", shown(setting.span));
        if let Some(word) = model.time_word().filter(|word| *word != "s") {
            text += &format!("time   [{word}]\n");
        }
        if model.units_off && model.quantities.iter().any(|quantity| quantity.unit.is_some()) {
            text += "units  off  // numbers in expressions had units, too\n";
        }
        self.functions(&mut text);
        for (group, heading) in model.groups.iter().enumerate() {
            self.group(&mut text, group, heading);
        }
        self.events(&mut text);
        text += "\n";
        let mut seen = std::collections::HashSet::new();
        let outputs: Vec<&str> = model
            .outputs
            .iter()
            .filter(|(_, quantity)| seen.insert(*quantity))
            .map(|(_, quantity)| self.names.quantities[*quantity].as_str())
            .collect();
        text += &folded(&format!("output {}", outputs.join(", ")));
        text.push('\n');
        text
    }

    fn functions(&mut self, text: &mut String) {
        let mut called = vec![false; self.model.functions.len()];
        let mut look = |expr: &Expr| {
            if let Expr::Call(crate::expr::Callee::Own(function), _) = expr {
                called[*function] = true;
            }
        };
        let of_quantities = self.model.quantities.iter().flat_map(|quantity| quantity.kind.expressions());
        let of_events = self.model.events.iter().flat_map(Event::expressions);
        let of_functions = self.model.functions.iter().map(|function| &function.body);
        of_quantities.chain(of_events).chain(of_functions).for_each(|expr| expr.each(&mut look));
        let names = self.names;
        let called: Vec<usize> = (0..called.len()).filter(|function| called[*function]).collect();
        if !called.is_empty() {
            text.push('\n');
        }
        for function in called {
            self.arguments = &names.arguments[function];
            let body = self.text(&self.model.functions[function].body);
            let line = format!("function {}({}) = {body}", names.functions[function], self.arguments.join(", "));
            *text += &folded(&line);
            text.push('\n');
            self.arguments = &[];
        }
    }

    /// Events, as they stand in the file.
    fn events(&self, text: &mut String) {
        if !self.model.events.is_empty() {
            *text += "\n// Events\n";
        }
        for event in &self.model.events {
            let mut head = format!("when {}", self.text(&event.trigger));
            if let Some(delay) = event.delay.as_ref().filter(|delay| delay.literal() != Some(0.0)) {
                let unit = self.model.time_word().map_or_else(String::new, |unit| format!(" {unit}"));
                head += &format!(" after {}{unit}", self.text(delay));
            }
            let delayed = event.delay.is_some();
            let early = event.early_values && (delayed || self.model.events.len() > 1);
            let words = [
                (event.refines(), "refine"),
                (early, "frozen"),
                (!event.persistent, "cancelled"),
                (!event.held_before, "initially"),
            ];
            words.iter().filter(|(says, _)| *says).for_each(|(_, word)| head += &format!(", {word}"));
            if let Some(priority) = &event.priority {
                head += &format!(", priority {}", self.text(priority));
            }
            let note = if event.id.is_empty() { String::new() } else { format!("  // {}", comment(&event.id)) };
            let _ = writeln!(text, "{} {{{note}", folded(&head));
            for (target, value) in &event.assignments {
                let name = match &self.model.quantities[*target].element {
                    Some((array, at)) => plain(&element(&self.names.arrays[*array], at, marked)),
                    None => self.names.quantities[*target].clone(),
                };
                let _ = writeln!(text, "    {}", folded(&plain(&format!("{name} = {}", self.text(value)))));
            }
            *text += "}\n";
        }
    }

    fn group(&self, text: &mut String, group: usize, heading: &str) {
        let members: Vec<(usize, &Quantity)> =
            self.model.quantities.iter().enumerate().filter(|(_, quantity)| quantity.group == group).collect();
        let (mut declared, mut states, mut equations) = (String::new(), String::new(), String::new());
        let mut arrays: Vec<usize> = Vec::new();
        for (index, quantity) in &members {
            if let Some((array, _)) = quantity.element {
                if !arrays.contains(&array) {
                    arrays.push(array);
                    self.array(array, &members, [&mut declared, &mut states, &mut equations]);
                }
                continue;
            }
            let name = &self.names.quantities[*index];
            let unit = quantity.unit.as_ref().map_or_else(String::new, |unit| format!(" [{unit}]"));
            let line = |to: &mut String, line: String, note: bool| {
                let note = if note { self.note(*index) } else { String::new() };
                let line = folded(&plain(&line));
                let _ = writeln!(to, "{line}{note}");
            };
            match &quantity.kind {
                Kind::Missing => {}
                Kind::Constant(expr) => line(&mut declared, format!("param {name}{unit} = {}", self.text(expr)), true),
                Kind::Algebraic(expr) => line(&mut equations, format!("{name}{unit} = {}", self.text(expr)), true),
                Kind::State { initial, rate } => {
                    line(&mut states, format!("state {name}{unit} = {}", self.text(initial)), true);
                    line(&mut equations, format!("{name}' = {}", self.text(rate)), false);
                }
            }
        }
        declared += &states;
        if declared.is_empty() && equations.is_empty() {
            return;
        }
        let _ = write!(text, "\n// {}\n{declared}", comment(heading));
        if !declared.is_empty() && !equations.is_empty() {
            text.push('\n');
        }
        text.push_str(&equations);
    }

    /// Declarations and equations of an array.
    fn array(&self, array: usize, members: &[(usize, &Quantity)], [declared, states, equations]: [&mut String; 3]) {
        let own = members.iter().filter_map(|(index, quantity)| match &quantity.element {
            Some((of, at)) if *of == array => Some((at, self.names.quantities[*index].as_str(), &quantity.kind)),
            _ => None,
        });
        let mut own: Vec<(&Vec<usize>, &str, &Kind)> = own.collect();
        own.sort_by_key(|(at, ..)| *at);
        let name = &self.names.arrays[array];
        let other = &self.model.arrays[array];
        let note = if name == other { String::new() } else { format!("  // id {}", comment(other)) };
        let (mut values, mut rates, mut rules) = (Vec::new(), Vec::new(), Vec::new());
        for (at, _, kind) in own {
            let rule = |right: &Expr, mark: &str| format!("{}{mark} = {}", element(name, at, marked), self.text(right));
            match kind {
                Kind::Missing => {}
                Kind::Constant(value) => values.push((at, self.within(value, Level::Sum))),
                Kind::Algebraic(value) => rules.push(rule(value, "")),
                Kind::State { initial, rate } => {
                    values.push((at, self.within(initial, Level::Sum)));
                    rates.push(rule(rate, "'"));
                }
            }
        }
        if !values.is_empty() {
            let (to, word) = if rates.is_empty() { (declared, "param") } else { (states, "state") };
            let line = format!("{word} {}", self.filled(name, &values));
            let _ = writeln!(to, "{}{note}", folded(&plain(&line)));
        } else if !note.is_empty() && !rules.is_empty() {
            let _ = writeln!(equations, "{}", note.trim_start());
        }
        for line in rules_of(&rates, &self.indices[0]).into_iter().chain(rules_of(&rules, &self.indices[0])) {
            let _ = writeln!(equations, "{}", folded(&line));
        }
    }

    /// `x[i in 0..2] = 0`, or with a table of the values by place; what a matrix lacks is zero.
    fn filled(&self, name: &str, values: &[(&Vec<usize>, String)]) -> String {
        let rank = values[0].0.len();
        let ends: Vec<usize> = (0..rank).map(|axis| values.iter().map(|(at, _)| at[axis]).max().unwrap_or(0)).collect();
        let ranges = self.indices.iter().zip(&ends).map(|(index, end)| format!("{index} in 0..{end}"));
        let head = format!("{name}[{}] = ", ranges.collect::<Vec<_>>().join(", "));
        if rank == 1 && values.iter().all(|(_, value)| *value == values[0].1) {
            return head + &values[0].1;
        }
        let mut values = values.iter().peekable();
        let mut cell = |place: &[usize]| match values.next_if(|(at, _)| at.as_slice() == place) {
            Some((_, value)) => value.clone(),
            None => "0".to_owned(),
        };
        let mut row = |first: Option<usize>| {
            let cells = (0..=ends[rank - 1]).map(|last| match first {
                Some(first) => cell(&[first, last]),
                None => cell(&[last]),
            });
            cells.collect::<Vec<_>>().join(", ")
        };
        let rows: Vec<String> =
            if rank == 1 { vec![row(None)] } else { (0..=ends[0]).map(|first| row(Some(first))).collect() };
        format!("{head}[{}]", rows.join("; "))
    }

    /// The comment behind a declaration: the name in the file if it is another one, and the one in words.
    fn note(&self, index: usize) -> String {
        let (quantity, name) = (&self.model.quantities[index], &self.names.quantities[index]);
        let mut parts = Vec::new();
        if *name != quantity.id && *name != quantity.short {
            parts.push(format!("id {}", comment(&quantity.id)));
        }
        let label = comment(&quantity.label);
        if !label.is_empty() && label != *name && label != quantity.id {
            parts.push(label);
        }
        if parts.is_empty() { String::new() } else { format!("  // {}", parts.join(": ")) }
    }

    /// An expression on its own.
    pub fn text(&self, expr: &Expr) -> String {
        self.within(expr, Level::Choice)
    }

    /// An expression as part of one that binds as tightly as `level`.
    fn within(&self, expr: &Expr, level: Level) -> String {
        let (text, own) = self.operators(expr);
        if own < level { format!("({text})") } else { text }
    }

    fn list(&self, members: &[Expr], level: Level, between: &str) -> String {
        members.iter().map(|member| self.within(member, level)).collect::<Vec<_>>().join(between)
    }

    fn operators(&self, expr: &Expr) -> (String, Level) {
        match expr {
            Expr::Number(value, text) => {
                let text = text.clone().unwrap_or_else(|| shown(*value));
                let level = if text.starts_with('-') { Level::Minus } else { Level::Atom };
                (text, level)
            }
            Expr::Pi => ("pi".to_owned(), Level::Atom),
            Expr::Time => ("time".to_owned(), Level::Atom),
            Expr::Name(quantity) => match &self.model.quantities[*quantity].element {
                Some((array, at)) => (element(&self.names.arrays[*array], at, marked), Level::Atom),
                None => (self.names.quantities[*quantity].clone(), Level::Atom),
            },
            Expr::Argument(argument) => (self.arguments[*argument].clone(), Level::Atom),
            Expr::Sum(members) => self.sum(members),
            Expr::Product(members) => (self.product(members), Level::Product),
            Expr::Power(pair) => {
                let (base, exponent) = (self.within(&pair.0, Level::Atom), self.within(&pair.1, Level::Atom));
                (format!("{base}^{exponent}"), Level::Power)
            }
            Expr::Call(Callee::Past, members) => {
                let (of, delay) = (self.text(&members[0]), self.within(&members[1], Level::Product));
                (format!("{of}(t - {delay})"), Level::Atom)
            }
            Expr::Call(callee, members) => {
                (format!("{}({})", self.names.callee(*callee), self.list(members, Level::Choice, ", ")), Level::Atom)
            }
            Expr::Pulse(pulse) => {
                let [height, start, width, period] = pulse.each_ref().map(|part| self.text(part));
                let again = if pulse[3].literal() == Some(0.0) { String::new() } else { format!(", 0, {period}") };
                (format!("pulse({height}, {start}, {width}{again})"), Level::Atom)
            }
            Expr::Choice(pieces, otherwise) => {
                let mut text = String::new();
                for (condition, value) in pieces {
                    let (condition, value) = (self.within(condition, Level::Or), self.within(value, Level::Or));
                    let _ = write!(text, "if {condition} then {value} else ");
                }
                (text + &self.within(otherwise, Level::Choice), Level::Choice)
            }
            Expr::Truth(value) => ((if *value { "0 == 0" } else { "0 == 1" }).to_owned(), Level::Compare),
            Expr::Compare(relation, pair) => {
                let (left, right) = (self.within(&pair.0, Level::Sum), self.within(&pair.1, Level::Sum));
                (format!("{left} {} {right}", relation.sign()), Level::Compare)
            }
            Expr::And(members) => (self.list(members, Level::Not, " and "), Level::And),
            Expr::Or(members) => (self.list(members, Level::And, " or "), Level::Or),
            Expr::Not(inner) => (format!("not ({})", self.text(inner)), Level::Not),
        }
    }

    fn sum(&self, members: &[(bool, Expr)]) -> (String, Level) {
        // A sum that begins with a minus is one with a plus in front, if it has one.
        let first = members.iter().position(|(negative, _)| !negative).unwrap_or(0);
        let order = std::iter::once(first).chain((0..members.len()).filter(|index| *index != first));
        let terms = order.map(|index| (members[index].0, self.within(&members[index].1, Level::Product))).collect();
        let terms = sum_of(terms, &self.indices[2]);
        let mut text = String::new();
        for (negative, shown) in &terms {
            text += match (text.is_empty(), negative) {
                (true, true) => "-",
                (true, false) => "",
                (false, true) => " - ",
                (false, false) => " + ",
            };
            text += shown;
        }
        let alone = terms.len() == 1;
        (
            text,
            if alone && terms[0].0 {
                Level::Minus
            } else if alone {
                Level::Atom
            } else {
                Level::Sum
            },
        )
    }

    fn product(&self, members: &[(bool, Expr)]) -> String {
        let mut text = String::new();
        for (index, (inverse, member)) in members.iter().enumerate() {
            match (index, inverse) {
                (0, true) => text += "1/",
                (0, false) => {}
                (_, true) => text.push('/'),
                (_, false) => text.push('*'),
            }
            // Of `a*b/(c*d)` the divisor keeps its brackets.
            text += &self.within(member, if *inverse || index > 0 { Level::Power } else { Level::Minus });
        }
        text
    }
}

/// Text that cannot end a comment or a text in quotes.
fn comment(text: &str) -> String {
    let words: String = text.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect();
    let words = words.split_whitespace().collect::<Vec<_>>().join(" ");
    words.chars().take(160).collect()
}

/// A statement on several lines, broken where an operator or a comma tells that it goes on.
fn folded(line: &str) -> String {
    let mut text = String::new();
    let mut length = 0;
    let words: Vec<&str> = line.split(' ').collect();
    for (index, word) in words.iter().enumerate() {
        if index == 0 {
            text += word;
            length = word.len();
            continue;
        }
        let operator = matches!(*word, "+" | "-" | "and" | "or" | "then" | "else");
        let may_break = operator || words[index - 1].ends_with([',', ';']);
        // An operator belongs to what follows it.
        let next = if operator { words.get(index + 1).map_or(0, |next| next.len() + 1) } else { 0 };
        if may_break && length + 1 + word.len() + next > WIDTH {
            text += "\n    ";
            length = 4;
        } else {
            text.push(' ');
            length += 1;
        }
        text += word;
        length += word.len();
    }
    text
}
