//! Myokit's `.mmt`: a model in components, and a pacing protocol.

use std::collections::HashMap;

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

use crate::Wanted;
use crate::expr::Expr;
use crate::infix::{Infix, Reference};
use crate::model::{Kind, Model, Quantity};
use crate::number;

/// Functions, each with its name in MathML.
const FUNCTIONS: [(&str, &str); 12] = [
    ("abs", "abs"),
    ("exp", "exp"),
    ("log", "ln"),
    ("floor", "floor"),
    ("ceil", "ceiling"),
    ("sin", "sin"),
    ("cos", "cos"),
    ("tan", "tan"),
    ("asin", "arcsin"),
    ("acos", "arccos"),
    ("atan", "arctan"),
    ("not", "not"),
];

/// Pulses that a protocol repeats a number of times, at most.
const MOST_PULSES: f64 = 100.0;

/// Numbers from here on stand for rates until these have names.
const MARKS: usize = usize::MAX / 2;

/// A variable as it is declared.
struct Variable {
    component: usize,
    /// The variable that it is nested in.
    parent: Option<usize>,
    indent: usize,
    name: String,
    is_state: bool,
    value: Option<(Expr, Vec<Reference>)>,
    unit: Option<String>,
    label: String,
    bound: String,
    span: Span,
}

/// A component.
struct Component {
    name: String,
    /// Names for variables of others.
    aliases: HashMap<String, String>,
}

/// Reads a model; findings instead if it cannot be expressed.
pub(crate) fn read(text: &str, wanted: &Wanted, findings: &mut Vec<Diagnostic>) -> Option<Model> {
    let mut reader = Reader {
        text,
        at: 0,
        findings,
        section: Section::None,
        components: Vec::new(),
        variables: Vec::new(),
        initial: HashMap::new(),
        events: Vec::new(),
        model: Model { format: "Myokit".to_owned(), units_off: true, ..Model::default() },
    };
    reader.lines();
    reader.model(wanted);
    Some(reader.model)
}

/// The part of a file that a line belongs to.
#[derive(Clone, Copy, PartialEq)]
enum Section {
    None,
    Model,
    Protocol,
    Script,
}

struct Reader<'t, 'f> {
    text: &'t str,
    at: usize,
    findings: &'f mut Vec<Diagnostic>,
    section: Section,
    components: Vec<Component>,
    variables: Vec<Variable>,
    initial: HashMap<String, (Expr, Vec<Reference>, Span)>,
    /// Level, start, length, period, number.
    events: Vec<([f64; 5], Span)>,
    model: Model,
}

impl<'t> Reader<'t, '_> {
    fn lines(&mut self) {
        while self.at < self.text.len() {
            let rest = &self.text[self.at..];
            let line = rest.lines().next().unwrap_or("");
            let content = line.trim_start_matches([' ', '\t']);
            let (indent, start) = (line.len() - content.len(), self.at + line.len() - content.len());
            let span = Span::of(start, start + content.trim_end().len());
            self.at += rest.find('\n').map_or(rest.len(), |end| end + 1);
            let content = content.trim_end();
            if content.is_empty() || content.starts_with('#') {
                continue;
            }
            if content.starts_with("[[") {
                self.section = match content.trim_start_matches('[').split(']').next().unwrap_or("").trim() {
                    "model" => Section::Model,
                    "protocol" => Section::Protocol,
                    _ => Section::Script,
                };
                continue;
            }
            match self.section {
                Section::Model => self.model_line(content, indent, start, span),
                Section::Protocol => self.protocol_line(content, span),
                Section::Script => {}
                Section::None => {
                    let finding =
                        Diagnostic::error(codes::IMPORT_SYNTAX, span, "the file does not begin with `[[model]]`");
                    self.findings.push(finding);
                    self.at = self.text.len();
                }
            }
        }
    }

    fn wrong(&mut self, span: Span, problem: &str) {
        self.findings.push(Diagnostic::error(codes::IMPORT_SYNTAX, span, problem));
    }

    fn model_line(&mut self, content: &'t str, indent: usize, start: usize, span: Span) {
        if let Some(name) = content.strip_prefix('[') {
            let name = name.split(']').next().unwrap_or("").trim().to_owned();
            if self.components.iter().any(|component| component.name == name) {
                let message = format!("the component `{}` is there twice", name.escape_debug());
                self.findings.push(Diagnostic::error(codes::IMPORT_DUPLICATE, span, message));
            }
            self.components.push(Component { name, aliases: HashMap::new() });
            return;
        }
        let end = content.find(|letter: char| !letter.is_alphanumeric() && letter != '_').unwrap_or(content.len());
        let (word, rest) = content.split_at(end);
        let is_equation = content.split(['#', '"', ':']).next().is_some_and(|start| start.contains('='));
        let owner = self.around(indent);
        match (word, owner) {
            _ if is_equation => self.equation(indent, start, span),
            ("use", _) if rest.starts_with([' ', '\t']) => self.aliases(rest),
            ("in" | "bind" | "label", Some(owner)) => self.properties(owner, start),
            _ if content.split('#').next().is_some_and(|text| text.contains(':')) => {
                let (key, value) = content.split_once(':').unwrap_or((content, ""));
                let value = self.description(start + key.len() + 1, value);
                match (key.trim(), self.components.is_empty()) {
                    ("name", true) => self.model.id = value,
                    ("display_name", true) => self.model.title = value,
                    ("desc", false) => {
                        if let Some(owner) = owner {
                            self.variables[owner].label = value;
                        }
                    }
                    _ => {}
                }
            }
            _ => self.wrong(span, "the line cannot be read"),
        }
    }

    /// The variable that a line is indented against, which may have nested variables between.
    fn around(&self, indent: usize) -> Option<usize> {
        let component = self.components.len().checked_sub(1).filter(|_| indent > 0)?;
        let mut own =
            self.variables.iter().enumerate().rev().take_while(|(_, variable)| variable.component == component);
        own.find(|(_, variable)| variable.indent < indent).map(|(index, _)| index)
    }

    /// A text behind a colon, on one line or between triple quotes; the reader goes on behind it.
    fn description(&mut self, start: usize, value: &str) -> String {
        if !value.trim_start().starts_with("\"\"\"") {
            return value.trim().to_owned();
        }
        let open = start + value.find('"').unwrap_or(0) + 3;
        let Some(length) = self.text[open..].find("\"\"\"") else {
            self.wrong(Span::of(open - 3, open), "the text is not closed");
            self.at = self.text.len();
            return String::new();
        };
        let rest = &self.text[open + length..];
        self.at = open + length + rest.find('\n').map_or(rest.len(), |end| end + 1);
        self.text[open..open + length].split_whitespace().collect::<Vec<_>>().join(" ")
    }

    /// `use membrane.V as V, ina.m`.
    fn aliases(&mut self, list: &str) {
        let Some(component) = self.components.last_mut() else { return };
        for item in list.split('#').next().unwrap_or("").split(',') {
            let (name, alias) = match item.split_once(" as ") {
                Some((name, alias)) => (name.trim(), alias.trim()),
                None => (item.trim(), item.trim().rsplit('.').next().unwrap_or("")),
            };
            component.aliases.insert(alias.to_owned(), name.to_owned());
        }
    }

    /// `x = ..`, `dot(x) = ..`, or in front of all components `a.x = ..`; with what else stands on the line.
    fn equation(&mut self, indent: usize, start: usize, span: Span) {
        let mut infix = Infix::new(self.text, start, "#", &FUNCTIONS, false);
        let is_state = infix.text[start..].starts_with("dot(") && infix.take("dot") && infix.take("(");
        let mut name = infix.word().to_owned();
        infix.at += name.len();
        while infix.text[infix.at..].starts_with('.') {
            infix.at += 1;
            let part = infix.word();
            infix.at += part.len();
            name = format!("{name}.{part}");
        }
        if name.is_empty() || is_state && !infix.take(")") || !infix.take("=") {
            return self.wrong(span, "the line cannot be read");
        }
        let value = match infix.expression() {
            Ok(value) => Some((value.into_number(), std::mem::take(&mut infix.references))),
            Err(finding) => {
                self.findings.push(finding);
                None
            }
        };
        let at = infix.at;
        let Some(component) = self.components.len().checked_sub(1) else {
            let (value, references) = value.unwrap_or((Expr::number(0.0), Vec::new()));
            if self.initial.insert(name, (value, references, span)).is_some() {
                self.findings.push(Diagnostic::error(codes::IMPORT_DUPLICATE, span, "it has an initial value already"));
            }
            return self.behind(at);
        };
        let parent = self.around(indent);
        let has_value = value.is_some();
        self.variables.push(Variable {
            component,
            parent,
            indent,
            name,
            is_state,
            value,
            unit: None,
            label: String::new(),
            bound: String::new(),
            span,
        });
        if has_value {
            self.properties(self.variables.len() - 1, at);
        }
    }

    /// Continues with the line after a position.
    fn behind(&mut self, at: usize) {
        let rest = &self.text[at..];
        self.at = at + rest.find('\n').map_or(rest.len(), |end| end + 1);
    }

    /// `in [mV]`, `bind time`, `label x` and `: words` behind an equation or on a line of their own.
    fn properties(&mut self, owner: usize, at: usize) {
        let mut infix = Infix::new(self.text, at, "#", &FUNCTIONS, false);
        let last = &mut self.variables[owner];
        loop {
            match infix.word() {
                "in" => {
                    infix.at += 2;
                    infix.blanks();
                    let rest = &infix.text[infix.at..];
                    let Some(close) = rest.find(']').filter(|_| rest.starts_with('[')) else { break };
                    last.unit = unit(&rest[1..close]);
                    infix.at += close + 1;
                }
                word @ ("bind" | "label") => {
                    infix.at += word.len();
                    let name = infix.word().to_owned();
                    infix.at += name.len();
                    if word == "bind" {
                        last.bound = name;
                    }
                }
                _ => break,
            }
        }
        infix.blanks();
        let rest = infix.text[infix.at..].lines().next().unwrap_or("");
        let at = infix.at;
        if let Some(words) = rest.strip_prefix(':') {
            last.label = words.trim().to_owned();
        } else if !rest.trim().is_empty() {
            self.wrong(Span::of(at, at + rest.trim_end().len()), "the rest of the line cannot be read");
        }
        self.behind(at);
    }

    fn protocol_line(&mut self, content: &str, span: Span) {
        let cells: Vec<&str> = content.split('#').next().unwrap_or("").split_whitespace().collect();
        let numbers: Vec<f64> = cells.iter().filter_map(|cell| number::literal(cell)?.literal()).collect();
        match numbers[..] {
            [level, start, length, period, count] if cells.len() == 5 && length > 0.0 => {
                self.events.push(([level, start, length, period, count], span));
            }
            _ => self.wrong(span, "an event has five numbers: level, start, length, period, multiplier"),
        }
    }

    /// The protocol as an expression.
    fn pace(&mut self) -> Expr {
        let mut pulses = Vec::new();
        for ([level, start, length, period, count], span) in std::mem::take(&mut self.events) {
            let pulse = |start: f64, period: f64| {
                (false, Expr::Pulse(Box::new([level, start, length, period].map(Expr::number))))
            };
            if period <= 0.0 || count == 1.0 {
                pulses.push(pulse(start, 0.0));
            } else if count == 0.0 {
                self.model.run.span.get_or_insert(period);
                // Steps divide the period, so that pulses begin with a step.
                self.model.run.interval.get_or_insert(period);
                pulses.push(pulse(start, period));
            } else if count <= MOST_PULSES {
                pulses.extend((0..count as u32).map(|index| pulse(start + f64::from(index) * period, 0.0)));
            } else {
                let message = format!("the pulse comes {count} times; at most {MOST_PULSES} can be written");
                let help = "write 0 for a pulse that never stops";
                self.findings.push(Diagnostic::error(codes::IMPORT_LIMIT, span, message).with_help(help));
            }
        }
        Expr::sum(pulses)
    }

    /// Makes quantities of all variables.
    fn model(&mut self, wanted: &Wanted) {
        let mut numbers: HashMap<String, usize> = HashMap::new();
        let mut children: HashMap<(usize, String), usize> = HashMap::new();
        let mut ids: Vec<String> = Vec::new();
        for index in 0..self.variables.len() {
            let variable = &self.variables[index];
            let component = &self.components[variable.component].name;
            let (id, short) = match variable.parent {
                Some(parent) => {
                    let own = self.variables[parent].name.clone();
                    (format!("{}.{}", ids[parent], variable.name), format!("{own}_{}", variable.name))
                }
                None => (format!("{component}.{}", variable.name), variable.name.clone()),
            };
            let group = self.model.group(component);
            let mut quantity = Quantity::new(id.clone(), group, variable.span);
            quantity.short = short;
            quantity.unit = variable.unit.clone();
            quantity.label = variable.label.clone();
            if variable.bound == "time" {
                self.model.time_unit = variable.unit.clone().filter(|unit| unit != "s");
            }
            if numbers.insert(id.clone(), index).is_some() {
                let message = format!("`{id}` is there twice");
                self.findings.push(Diagnostic::error(codes::IMPORT_DUPLICATE, variable.span, message));
            }
            if let Some(parent) = variable.parent {
                children.insert((parent, variable.name.clone()), index);
            }
            ids.push(id);
            self.model.add(quantity);
        }
        let pace = self.pace();
        let is_paced = pace != Expr::number(0.0);
        let mut rates = Vec::new();
        for (index, id) in ids.iter().enumerate() {
            let Some((value, references)) = self.variables[index].value.take() else { continue };
            let value = self.resolved(&value, &references, Some(index), &numbers, &children, &mut rates);
            let kind = if self.variables[index].is_state {
                match self.initial.remove(id) {
                    Some((initial, references, _)) => {
                        let initial = self.resolved(&initial, &references, None, &numbers, &children, &mut rates);
                        Kind::State { initial, rate: value }
                    }
                    None => Kind::Missing,
                }
            } else {
                match &self.variables[index].bound[..] {
                    // What reads it reads the time.
                    "time" => Kind::Missing,
                    "pace" if is_paced => Kind::Algebraic(pace.clone()),
                    _ => Kind::Algebraic(value),
                }
            };
            self.model.quantities[index].kind = kind;
        }
        let mut left: Vec<(&String, Span)> = self.initial.iter().map(|(id, (.., span))| (id, *span)).collect();
        left.sort();
        for (id, span) in left {
            let message = format!("there is no state `{}` for this initial value", id.escape_debug());
            self.findings.push(Diagnostic::error(codes::IMPORT_UNKNOWN, span, message));
        }
        self.rates(rates);
        let named = |id: &String| numbers.get(id).copied();
        match wanted {
            Wanted::Named(names) => {
                for name in names {
                    match named(name) {
                        Some(index) => self.model.outputs.push((name.clone(), index)),
                        None => self.findings.push(crate::no_output(name)),
                    }
                }
            }
            _ => {
                let states = (0..ids.len()).filter(|index| self.variables[*index].is_state);
                self.model.outputs = states.map(|index| (ids[index].clone(), index)).collect();
            }
        }
    }

    /// The derivatives that expressions read get names of their own.
    fn rates(&mut self, rates: Vec<(usize, usize)>) {
        for (of, mark) in rates {
            let Kind::State { rate, .. } = &self.model.quantities[of].kind else { continue };
            let (rate, base) = (rate.clone(), &self.model.quantities[of]);
            let mut quantity = Quantity::new(format!("{}.rate", base.id), base.group, base.span);
            quantity.short = format!("{}_rate", base.short);
            quantity.kind = Kind::Algebraic(rate);
            let index = self.model.add(quantity);
            self.model.rename(mark, index);
            if let Kind::State { rate, .. } = &mut self.model.quantities[of].kind {
                *rate = Expr::Name(index);
            }
        }
    }

    /// An expression with names of quantities; `of` is the variable that it belongs to.
    fn resolved(
        &mut self,
        expr: &Expr,
        references: &[Reference],
        of: Option<usize>,
        numbers: &HashMap<String, usize>,
        children: &HashMap<(usize, String), usize>,
        rates: &mut Vec<(usize, usize)>,
    ) -> Expr {
        let mut found = Vec::new();
        for Reference { name, is_rate, span } in references {
            let index = self.lookup(name, of, numbers, children);
            let expr = match index {
                Some(index) if self.variables[index].bound == "time" => Expr::Time,
                Some(index) if *is_rate && self.variables[index].is_state => {
                    let mark = rates.iter().find(|(known, _)| *known == index).map(|(_, mark)| *mark);
                    Expr::Name(mark.unwrap_or_else(|| {
                        let mark = MARKS + rates.len();
                        rates.push((index, mark));
                        mark
                    }))
                }
                Some(_) if *is_rate => {
                    let message = format!("`{}` is no state, and has no `dot`", name.escape_debug());
                    self.findings.push(Diagnostic::error(codes::IMPORT_UNKNOWN, *span, message));
                    Expr::number(1.0)
                }
                Some(index) => Expr::Name(index),
                None => {
                    let message = format!("there is no `{}` in the model", name.escape_debug());
                    self.findings.push(Diagnostic::error(codes::IMPORT_UNKNOWN, *span, message));
                    Expr::number(1.0)
                }
            };
            found.push(expr);
        }
        expr.map(&mut |leaf| if let Expr::Name(reference) = leaf { Some(found[*reference].clone()) } else { None })
    }

    /// The variable that a name means within a variable: nested ones first, then those of the component.
    fn lookup(
        &self,
        name: &str,
        of: Option<usize>,
        numbers: &HashMap<String, usize>,
        children: &HashMap<(usize, String), usize>,
    ) -> Option<usize> {
        if name.contains('.') {
            return numbers.get(name).copied();
        }
        let mut around = of;
        while let Some(variable) = around {
            if let Some(found) = children.get(&(variable, name.to_owned())) {
                return Some(*found);
            }
            around = self.variables[variable].parent;
        }
        let component = &self.components[self.variables[of?].component];
        let own = numbers.get(&format!("{}.{name}", component.name));
        own.or_else(|| numbers.get(component.aliases.get(name)?)).copied()
    }
}

/// A unit in the terms of the language; `None` for none and for those it has no word for.
fn unit(text: &str) -> Option<String> {
    let text = text.trim();
    let plain = text.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"^*/-".contains(&byte));
    (plain && !text.is_empty() && text != "1").then(|| text.to_owned())
}
