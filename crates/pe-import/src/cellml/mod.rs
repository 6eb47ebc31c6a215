//! CellML 1.0, 1.1 and 2.0.
//!
//! Variables of several components that connections join are one quantity: that of the variable which an equation or an
//! initial value determines. Where a connection joins different units, what reads the quantity is scaled.

mod units;

use std::collections::HashMap;

use pe_ir::codes;
use pe_ir::source::Diagnostic;
use roxmltree::{Document, Node};

use crate::Wanted;
use crate::expr::Expr;
use crate::mathml::{self, Scope, bad};
use crate::model::{Kind, Model, Quantity};
use crate::number;
use crate::xml::{child, elements, span, text};

use self::units::{Size, Units};

/// A variable of a component.
struct Variable<'a> {
    node: Node<'a, 'a>,
    component: usize,
    name: &'a str,
    unit: &'a str,
}

/// What an equation says.
struct Equation<'a> {
    component: usize,
    is_rate: bool,
    node: Node<'a, 'a>,
    value: Node<'a, 'a>,
}

struct Reader<'a, 'f> {
    findings: &'f mut Vec<Diagnostic>,
    components: Vec<&'a str>,
    variables: Vec<Variable<'a>>,
    /// Variables by component and name.
    known: HashMap<(usize, &'a str), usize>,
    /// The variable that stands for each.
    stands: Vec<usize>,
    units: Units,
    /// By standing variable.
    equations: HashMap<usize, Equation<'a>>,
    /// The variable of time.
    time: Option<usize>,
    model: Model,
    /// Quantities of standing variables.
    quantities: HashMap<usize, usize>,
    rates: Vec<(usize, usize)>,
    parts: usize,
}

/// Numbers from here on stand for rates until these have names.
const MARKS: usize = usize::MAX / 2;

/// Reads a model; findings instead if it cannot be expressed.
pub(crate) fn read(document: &Document, wanted: &Wanted, findings: &mut Vec<Diagnostic>) -> Option<Model> {
    let root = document.root_element();
    let version = root.tag_name().namespace().unwrap_or("").trim_end_matches('#').rsplit('/').next().unwrap_or("");
    let format = format!("CellML {}", version.escape_debug());
    let model =
        Model { id: root.attribute("name").unwrap_or("").to_owned(), format, units_off: true, ..Model::default() };
    let mut reader = Reader {
        findings,
        components: Vec::new(),
        variables: Vec::new(),
        known: HashMap::new(),
        stands: Vec::new(),
        units: Units::of(root),
        equations: HashMap::new(),
        time: None,
        model,
        quantities: HashMap::new(),
        rates: Vec::new(),
        parts: 0,
    };
    reader.read(root);
    reader.outputs(wanted);
    Some(reader.model)
}

impl<'a> Reader<'a, '_> {
    fn read(&mut self, root: Node<'a, 'a>) {
        for part in root.descendants().filter(Node::is_element) {
            let (what, help) = match part.tag_name().name() {
                "import" => ("an import of another file cannot be expressed", "put the components into one file"),
                "reset" => ("a reset cannot be expressed", "a spec has no events"),
                "reaction" => ("a `<reaction>` of CellML cannot be expressed", "write its equations as `<math>`"),
                _ => continue,
            };
            let finding = Diagnostic::error(codes::IMPORT_UNSUPPORTED, span(part), what);
            self.findings.push(finding.with_help(help));
        }
        let components: Vec<Node> = elements(root).filter(|node| node.tag_name().name() == "component").collect();
        for node in &components {
            self.component(*node);
        }
        self.stands = (0..self.variables.len()).collect();
        for connection in elements(root).filter(|node| node.tag_name().name() == "connection") {
            self.connection(connection);
        }
        self.choose_standing();
        for (component, node) in components.iter().enumerate() {
            for equation in elements(*node).filter(|part| part.tag_name().name() == "math").flat_map(elements) {
                self.equation(component, equation);
            }
        }
        self.quantities();
        self.values();
    }

    fn component(&mut self, node: Node<'a, 'a>) {
        let component = self.components.len();
        let name = node.attribute("name").unwrap_or("");
        if self.components.contains(&name) {
            self.duplicate(node, name);
        }
        self.components.push(name);
        for variable in elements(node).filter(|part| part.tag_name().name() == "variable") {
            let name = variable.attribute("name").unwrap_or("");
            let unit = variable.attribute("units").unwrap_or("");
            if self.known.insert((component, name), self.variables.len()).is_some() {
                self.duplicate(variable, name);
            }
            self.variables.push(Variable { node: variable, component, name, unit });
        }
    }

    fn duplicate(&mut self, node: Node, name: &str) {
        let message = format!("`{}` is there twice", name.escape_debug());
        self.findings.push(Diagnostic::error(codes::IMPORT_DUPLICATE, span(node), message));
    }

    fn unknown(&mut self, node: Node, name: &str) {
        let message = format!("there is no `{}` in the model", name.escape_debug());
        self.findings.push(Diagnostic::error(codes::IMPORT_UNKNOWN, span(node), message));
    }

    /// Joins the variables of a connection.
    fn connection(&mut self, node: Node<'a, 'a>) {
        let of = child(node, "map_components").unwrap_or(node);
        let mut sides = [0; 2];
        for (side, attribute) in sides.iter_mut().zip(["component_1", "component_2"]) {
            let name = of.attribute(attribute).unwrap_or("");
            match self.components.iter().position(|known| *known == name) {
                Some(component) => *side = component,
                None => return self.unknown(of, name),
            }
        }
        for pair in elements(node).filter(|part| part.tag_name().name() == "map_variables") {
            let mut found = [0; 2];
            for (index, attribute) in ["variable_1", "variable_2"].into_iter().enumerate() {
                let name = pair.attribute(attribute).unwrap_or("");
                match self.known.get(&(sides[index], name)) {
                    Some(variable) => found[index] = *variable,
                    None => return self.unknown(pair, name),
                }
            }
            let (one, other) = (self.root(found[0]), self.root(found[1]));
            self.stands[one.max(other)] = one.min(other);
        }
    }

    fn root(&mut self, mut variable: usize) -> usize {
        while self.stands[variable] != variable {
            self.stands[variable] = self.stands[self.stands[variable]];
            variable = self.stands[variable];
        }
        variable
    }

    /// Lets the variable stand that others get their value from: no interface lets it in.
    fn choose_standing(&mut self) {
        let mut chosen: HashMap<usize, usize> = HashMap::new();
        for variable in 0..self.variables.len() {
            let root = self.root(variable);
            let node = self.variables[variable].node;
            let is_in =
                ["public_interface", "private_interface"].iter().any(|name| node.attribute(*name) == Some("in"));
            let rank = |node: Node, is_in: bool| (node.has_attribute("initial_value"), !is_in);
            let better = match chosen.get(&root) {
                None => true,
                Some(other) => {
                    let node_of = self.variables[*other].node;
                    let other_in = ["public_interface", "private_interface"]
                        .iter()
                        .any(|name| node_of.attribute(*name) == Some("in"));
                    rank(node, is_in) > rank(node_of, other_in)
                }
            };
            if better {
                chosen.insert(root, variable);
            }
        }
        let stands: Vec<usize> = (0..self.variables.len()).map(|variable| chosen[&self.root(variable)]).collect();
        self.stands = stands;
    }

    /// Notes what an `<apply><eq/>` determines.
    fn equation(&mut self, component: usize, node: Node<'a, 'a>) {
        let sides: Vec<Node> = elements(node).collect();
        let [operator, left, right] = sides[..] else {
            return self.findings.push(bad(node, "it is no equation with two sides"));
        };
        if operator.tag_name().name() != "eq" {
            return self.findings.push(bad(node, "it is no equation"));
        }
        let is_name = |side: Node| side.tag_name().name() == "ci";
        let rate_of = |side: Node<'a, 'a>| {
            let parts: Vec<Node> = elements(side).collect();
            match parts[..] {
                [diff, bound, of] if diff.tag_name().name() == "diff" => Some((child(bound, "ci")?, of)),
                _ => None,
            }
        };
        let (target, value, bound) = match (rate_of(left), rate_of(right)) {
            (Some((bound, of)), _) => (of, right, Some(bound)),
            (None, _) if is_name(left) => (left, right, None),
            (None, Some((bound, of))) => (of, left, Some(bound)),
            (None, None) if is_name(right) => (right, left, None),
            _ => {
                let message = "an equation that does not give the value of a variable cannot be expressed";
                let finding = Diagnostic::error(codes::IMPORT_UNSUPPORTED, span(node), message);
                return self.findings.push(finding.with_help("solve it for one variable"));
            }
        };
        if let Some(bound) = bound {
            match self.known.get(&(component, text(bound).as_str())) {
                Some(variable) => {
                    let stands = self.stands[*variable];
                    if self.time.is_some_and(|time| time != stands) {
                        let finding = Diagnostic::error(
                            codes::IMPORT_UNSUPPORTED,
                            span(bound),
                            "derivatives are by two variables",
                        );
                        self.findings.push(finding);
                    }
                    self.time = Some(stands);
                }
                None => self.unknown(bound, &text(bound)),
            }
        }
        let name = text(target);
        let Some(variable) = self.known.get(&(component, name.as_str())).copied() else {
            return self.unknown(target, &name);
        };
        let stands = self.stands[variable];
        let equation = Equation { component, is_rate: bound.is_some(), node, value };
        if self.equations.insert(stands, equation).is_some() {
            self.duplicate(node, &name);
        }
        // The side of a connection with the equation is the one whose units count.
        if variable != stands && !self.variables[stands].node.has_attribute("initial_value") {
            let equation = self.equations.remove(&stands).expect("inserted above");
            self.stands.iter_mut().filter(|of| **of == stands).for_each(|of| *of = variable);
            self.equations.insert(variable, equation);
            self.time = self.time.map(|time| if time == stands { variable } else { time });
        }
    }

    fn quantities(&mut self) {
        for variable in 0..self.variables.len() {
            if self.stands[variable] != variable {
                continue;
            }
            let Variable { node, component, name, unit } = &self.variables[variable];
            let component = self.components[*component];
            let unit = self.units.word(unit);
            if self.time == Some(variable) {
                self.model.time_unit = unit.filter(|unit| unit != "s");
                continue;
            }
            let group = self.model.group(component);
            let mut quantity = Quantity::new(format!("{component}.{name}"), group, span(*node));
            quantity.short = (*name).to_owned();
            quantity.unit = unit;
            if let Some(equation) = self.equations.get(&variable) {
                quantity.equation = span(equation.node);
            }
            let index = self.model.add(quantity);
            self.quantities.insert(variable, index);
        }
    }

    fn values(&mut self) {
        for variable in 0..self.variables.len() {
            let Some(index) = self.quantities.get(&variable).copied() else { continue };
            let Variable { node, component, .. } = self.variables[variable];
            let initial = node.attribute("initial_value").and_then(|written| {
                let value = number::literal(written).or_else(|| {
                    let named = *self.known.get(&(component, written.trim()))?;
                    Some(self.read_variable(named))
                });
                if value.is_none() {
                    let message = format!("`{}` is no finite number", written.escape_debug());
                    self.findings.push(Diagnostic::error(codes::IMPORT_NUMBER, span(node), message));
                }
                value
            });
            let equation = self.equations.get(&variable).map(|of| (of.component, of.is_rate, of.value));
            let kind = match (equation, initial) {
                (None, Some(value)) => Kind::Constant(value),
                (None, None) => Kind::Missing,
                (Some((component, is_rate, value)), initial) => {
                    // The value is in the units of the component of the equation.
                    let value = self.math(component, value);
                    match (is_rate, initial) {
                        (false, _) => Kind::Algebraic(value),
                        (true, Some(initial)) => Kind::State { initial, rate: value },
                        (true, None) => Kind::Missing,
                    }
                }
            };
            self.model.quantities[index].kind = kind;
        }
        for (of, mark) in std::mem::take(&mut self.rates) {
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

    fn math(&mut self, component: usize, node: Node<'a, 'a>) -> Expr {
        let (mut parts, mut findings) = (self.parts, Vec::new());
        let mut scope = Within { reader: self, component };
        let value = mathml::Reader { scope: &mut scope, findings: &mut findings, parts: &mut parts }.number(node);
        self.findings.append(&mut findings);
        self.parts = parts;
        value
    }

    /// The value of a variable in its own units.
    fn read_variable(&mut self, variable: usize) -> Expr {
        let stands = self.stands[variable];
        let value = match self.quantities.get(&stands) {
            Some(index) => Expr::Name(*index),
            None => Expr::Time,
        };
        let (from, to) = (self.variables[stands].unit, self.variables[variable].unit);
        if from == to {
            return value;
        }
        match (self.units.size(from), self.units.size(to)) {
            (Some(Size { factor: from, dimension: a }), Some(Size { factor: to, dimension: b })) if a == b => {
                if ((from - to) / to).abs() < 1e-12 { value } else { value.times(Expr::number(from / to)) }
            }
            _ => {
                let node = self.variables[variable].node;
                let message =
                    format!("`{}` and `{}` are connected, and no factor is known between these units", from, to);
                self.findings.push(Diagnostic::error(codes::IMPORT_UNSUPPORTED, span(node), message));
                value
            }
        }
    }

    fn outputs(&mut self, wanted: &Wanted) {
        if let Wanted::Named(names) = wanted {
            for name in names {
                let found = self.model.quantities.iter().position(|quantity| quantity.id == *name);
                match found {
                    Some(index) => self.model.outputs.push((name.clone(), index)),
                    None => self.findings.push(crate::no_output(name)),
                }
            }
            return;
        }
        let states = self.model.quantities.iter().enumerate();
        let states = states.filter(|(_, quantity)| matches!(quantity.kind, Kind::State { .. }));
        self.model.outputs = states.map(|(index, quantity)| (quantity.id.clone(), index)).collect();
    }
}

/// Expressions of one component.
struct Within<'r, 'a, 'f> {
    reader: &'r mut Reader<'a, 'f>,
    component: usize,
}

impl Scope for Within<'_, '_, '_> {
    fn name(&mut self, id: &str, place: Node) -> Result<Expr, Diagnostic> {
        match self.reader.known.get(&(self.component, id)).copied() {
            Some(variable) => Ok(self.reader.read_variable(variable)),
            None => {
                let message = format!("there is no `{}` in the component", id.escape_debug());
                Err(Diagnostic::error(codes::IMPORT_UNKNOWN, mathml::place(place), message))
            }
        }
    }

    fn call(&mut self, id: &str, _: Vec<Expr>, place: Node) -> Result<Expr, Diagnostic> {
        Err(bad(place, &format!("there is no function `{}`", id.escape_debug())))
    }

    fn symbol(&mut self, url: &str, place: Node) -> Result<Expr, Diagnostic> {
        Err(bad(place, &format!("the symbol `{}` is not known", url.escape_debug())))
    }

    fn symbol_call(&mut self, url: &str, arguments: &[Node], place: Node) -> Result<Expr, Diagnostic> {
        let ("diff", [_, of]) = (url, arguments) else {
            return Err(bad(place, &format!("the symbol `{}` is not known", url.escape_debug())));
        };
        match self.name(&text(*of), *of)? {
            Expr::Name(index) => {
                let mark = self.reader.rates.iter().find(|(known, _)| *known == index).map(|(_, mark)| *mark);
                Ok(Expr::Name(mark.unwrap_or_else(|| {
                    let mark = MARKS + self.reader.rates.len();
                    self.reader.rates.push((index, mark));
                    mark
                })))
            }
            _ => Err(bad(place, "the derivative of this cannot be expressed")),
        }
    }
}
