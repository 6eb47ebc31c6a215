//! SBML, levels 2 and 3 core.
//!
//! A species stands in expressions for its amount or for its concentration. It is a state of that kind, but where its
//! compartment changes during the run the amount is the state and the concentration is computed from it.

mod algebraic;
mod comp;
mod events;
mod fast;
mod functions;
mod reactions;
mod scope;
mod species;
mod units;

use std::collections::{HashMap, HashSet};

use pe_ir::codes;
use pe_ir::source::Diagnostic;
use roxmltree::{Document, Node};

use crate::expr::Expr;
use crate::mathml;
use crate::model::{Kind, Model, Quantity};
use crate::xml::{child, elements, listed, span};
use crate::{Wanted, number};

use self::fast::{Equilibrium, Fast};
use self::scope::Core;
use self::species::Species;

/// Reads a model; findings instead if it cannot be expressed.
pub(crate) fn read(document: &Document, wanted: &Wanted, findings: &mut Vec<Diagnostic>) -> Option<Model> {
    let sbml = document.root_element();
    let level = sbml.attribute("level").unwrap_or("?");
    let version = sbml.attribute("version").unwrap_or("?");
    if !["2", "3"].contains(&level) {
        let message = format!("SBML level {} cannot be read", level.escape_debug());
        let help = "convert it to level 2 or 3, say with libSBML";
        findings.push(Diagnostic::error(codes::IMPORT_UNSUPPORTED, span(sbml), message).with_help(help));
        return None;
    }
    let mut is_composed = false;
    for attribute in sbml.attributes() {
        if attribute.name() == "required" && attribute.value() == "true" {
            let url = attribute.namespace().unwrap_or("");
            if comp::is_package(url) {
                is_composed = true;
                continue;
            }
            let package = url.rsplit('/').nth(1).unwrap_or(url);
            let message = format!("the model needs the SBML package `{}`", package.escape_debug());
            let help = "only the core of SBML and composed models (`comp`) can be imported";
            findings.push(Diagnostic::error(codes::IMPORT_UNSUPPORTED, span(sbml), message).with_help(help));
        }
    }
    if is_composed {
        return composed(document, wanted, findings);
    }
    let Some(node) = child(sbml, "model") else {
        findings.push(Diagnostic::error(codes::IMPORT_SYNTAX, span(sbml), "there is no `<model>` in the file"));
        return None;
    };
    let mut reader = Reader::new(node, level == "2", findings);
    reader.model.format = format!("SBML level {level} version {}", version.escape_debug());
    reader.model.id = node.attribute("id").unwrap_or("").to_owned();
    reader.model.title = node.attribute("name").unwrap_or("").to_owned();
    reader.read();
    reader.outputs(wanted);
    Some(reader.model)
}

/// Reads a model that is composed of others.
fn composed(document: &Document, wanted: &Wanted, findings: &mut Vec<Diagnostic>) -> Option<Model> {
    let flat = comp::flat(document, findings)?;
    let mut own = Vec::new();
    let model = match crate::xml::read(&flat.text) {
        Ok(document) => read(&document, wanted, &mut own),
        Err(finding) => {
            own.push(finding);
            None
        }
    };
    findings.extend(own.into_iter().map(|finding| Diagnostic {
        span: finding.span.map(|span| flat.place(span)),
        labels: finding.labels.into_iter().map(|(span, text)| (flat.place(span), text)).collect(),
        ..finding
    }));
    model.map(|mut model| {
        for quantity in &mut model.quantities {
            (quantity.span, quantity.equation) = (flat.place(quantity.span), flat.place(quantity.equation));
        }
        model.functions.iter_mut().for_each(|function| function.span = flat.place(function.span));
        model.events.iter_mut().for_each(|event| event.span = flat.place(event.span));
        model
    })
}

/// Reads one `<model>`.
struct Reader<'a, 'f> {
    node: Node<'a, 'a>,
    /// Level 2, whose defaults differ from those of level 3.
    old: bool,
    model: Model,
    core: Core,
    findings: &'f mut Vec<Diagnostic>,
    units: HashMap<String, Option<String>>,
    /// What a rule determines, with whether it is the rate.
    rules: HashMap<String, (bool, Node<'a, 'a>)>,
    initial: HashMap<String, Node<'a, 'a>>,
    /// What events change.
    changed: HashSet<String>,
    /// Ids that expressions name.
    named: HashSet<String>,
    /// By quantity that stands for a species.
    species: HashMap<usize, Species<'a>>,
    /// Fast reactions.
    fast: Vec<Fast<'a>>,
    /// What they keep in equilibrium.
    equilibria: Vec<Equilibrium>,
    /// Parts of all expressions so far.
    parts: usize,
}

impl<'a, 'f> Reader<'a, 'f> {
    fn new(node: Node<'a, 'a>, old: bool, findings: &'f mut Vec<Diagnostic>) -> Self {
        let named = node.descendants().filter(|inner| inner.has_tag_name_of("ci")).map(crate::xml::text).collect();
        Reader {
            node,
            old,
            model: Model::default(),
            core: Core::default(),
            findings,
            units: units::definitions(node),
            rules: HashMap::new(),
            initial: HashMap::new(),
            changed: HashSet::new(),
            named,
            species: HashMap::new(),
            fast: Vec::new(),
            equilibria: Vec::new(),
            parts: 0,
        }
    }

    fn read(&mut self) {
        for part in ["listOfConstraints"] {
            for constraint in listed(self.node, part) {
                let finding =
                    Diagnostic::error(codes::IMPORT_LEFT_OUT, span(constraint), "constraint left out").into_warning();
                self.findings.push(finding.with_help("constraints only stop simulations; the equations stay the same"));
            }
        }
        let time = self.node.attribute("timeUnits").unwrap_or(if self.old { "time" } else { "" });
        self.model.time_unit = self.unit(time).filter(|unit| unit != "s");
        for heading in ["Compartments", "Parameters", "Species", "Reactions"] {
            self.model.group(heading);
        }
        self.functions();
        self.determined();
        let compartments = listed(self.node, "listOfCompartments");
        for compartment in &compartments {
            self.declare(*compartment, "Compartments");
        }
        let parameters = listed(self.node, "listOfParameters");
        for parameter in &parameters {
            self.declare(*parameter, "Parameters");
        }
        self.declare_species();
        self.declare_reactions();
        self.unknown_targets();
        for (node, value) in
            compartments.iter().map(|node| (node, "size")).chain(parameters.iter().map(|node| (node, "value")))
        {
            self.value(*node, value);
        }
        self.reactions();
        self.species();
        self.algebraic_rules();
        self.fast_reactions();
        self.events();
        self.rates_of();
    }

    /// Takes in an element with an id as a quantity; its number, if the id is new.
    fn declare(&mut self, node: Node<'a, 'a>, heading: &str) -> Option<usize> {
        let group = self.model.group(heading);
        let id = self.id(node)?;
        let mut quantity = Quantity::new(id.clone(), group, span(node));
        quantity.label = node.attribute("name").unwrap_or("").to_owned();
        quantity.unit = node.attribute("units").and_then(|unit| self.unit(unit));
        quantity.equation = self.rules.get(&id).or(None).map_or(span(node), |(_, rule)| span(*rule));
        let index = self.model.add(quantity);
        self.core.ids.insert(id, index);
        Some(index)
    }

    /// The id of an element, if it is there and new.
    fn id(&mut self, node: Node<'a, 'a>) -> Option<String> {
        let Some(id) = node.attribute("id") else {
            let message = format!("`<{}>` has no id", node.tag_name().name());
            self.findings.push(Diagnostic::error(codes::IMPORT_SYNTAX, span(node), message));
            return None;
        };
        if self.core.ids.contains_key(id) || self.core.functions.contains_key(id) {
            let message = format!("the id `{}` is there twice", id.escape_debug());
            self.findings.push(Diagnostic::error(codes::IMPORT_DUPLICATE, span(node), message));
            return None;
        }
        Some(id.to_owned())
    }

    /// Notes what rules, initial assignments and events determine.
    fn determined(&mut self) {
        for rule in listed(self.node, "listOfRules") {
            let is_rate = match rule.tag_name().name() {
                "assignmentRule" => false,
                "rateRule" => true,
                _ => continue,
            };
            let target = rule.attribute("variable").unwrap_or("").to_owned();
            if child(rule, "math").is_some() && self.rules.insert(target.clone(), (is_rate, rule)).is_some() {
                let message = format!("two rules determine `{}`", target.escape_debug());
                self.findings.push(Diagnostic::error(codes::IMPORT_DUPLICATE, span(rule), message));
            }
        }
        for assignment in listed(self.node, "listOfInitialAssignments") {
            let target = assignment.attribute("symbol").unwrap_or("").to_owned();
            if child(assignment, "math").is_some() && self.initial.insert(target.clone(), assignment).is_some() {
                let message = format!("two initial assignments give a value to `{}`", target.escape_debug());
                self.findings.push(Diagnostic::error(codes::IMPORT_DUPLICATE, span(assignment), message));
            }
        }
        for event in listed(self.node, "listOfEvents") {
            let targets = listed(event, "listOfEventAssignments").into_iter();
            let targets = targets.filter(|assignment| child(*assignment, "math").is_some());
            self.changed.extend(targets.filter_map(|assignment| assignment.attribute("variable")).map(str::to_owned));
        }
    }

    /// Finds rules and assignments of what is not there.
    fn unknown_targets(&mut self) {
        let rules = self.rules.iter().map(|(id, (_, node))| (id, *node));
        let initial = self.initial.iter().map(|(id, node)| (id, *node));
        let mut unknown: Vec<(Node, String)> = rules
            .chain(initial)
            .filter(|(id, _)| !self.core.ids.contains_key(*id))
            .map(|(id, node)| (node, id.clone()))
            .collect();
        unknown.sort_by_key(|(node, _)| node.range().start);
        for (node, id) in unknown {
            self.findings.push(unknown_id(node, &id));
        }
    }

    /// The value of a compartment or a parameter, whose attribute has this name.
    fn value(&mut self, node: Node<'a, 'a>, attribute: &str) {
        let Some(index) = node.attribute("id").and_then(|id| self.core.ids.get(id)).copied() else { return };
        if self.model.quantities[index].span != span(node) {
            return;
        }
        let start = self.attribute(node, attribute);
        let start = self.start(index).or(start);
        self.model.quantities[index].kind = self.ruled(index, start);
    }

    /// What an initial assignment gives a quantity.
    fn start(&mut self, index: usize) -> Option<Expr> {
        let node = *self.initial.get(&self.model.quantities[index].id)?;
        Some(self.math(node))
    }

    /// A quantity with this value at the beginning, that rules and events may determine.
    fn ruled(&mut self, index: usize, start: Option<Expr>) -> Kind {
        let id = self.model.quantities[index].id.clone();
        match (self.rules.get(&id).copied(), start) {
            (Some((false, rule)), _) => Kind::Algebraic(self.math(rule)),
            (Some((true, rule)), Some(initial)) => Kind::State { initial, rate: self.math(rule) },
            (None, Some(initial)) if self.changed.contains(&id) => Kind::State { initial, rate: Expr::number(0.0) },
            (None, Some(value)) => Kind::Constant(value),
            (_, None) => Kind::Missing,
        }
    }

    /// Whether a quantity can change during the run, by its rules and events.
    fn varies(&self, id: &str) -> bool {
        self.rules.contains_key(id) || self.changed.contains(id)
    }

    /// The number in an attribute, if it is there.
    fn attribute(&mut self, node: Node, name: &str) -> Option<Expr> {
        let text = node.attribute(name)?;
        let value = number::literal(text);
        if value.is_none() {
            let message = format!("`{}` is no finite number", text.escape_debug());
            self.findings.push(Diagnostic::error(codes::IMPORT_NUMBER, span(node), message));
        }
        value.or(Some(Expr::number(1.0)))
    }

    /// The number that the `<math>` of an element stands for.
    fn math(&mut self, node: Node) -> Expr {
        self.reader_for(node, None, |reader, math| reader.number(math))
    }

    fn reader_for(
        &mut self,
        node: Node,
        locals: Option<&HashMap<String, usize>>,
        read: impl FnOnce(&mut mathml::Reader, Node) -> Expr,
    ) -> Expr {
        let Some(math) = child(node, "math") else {
            self.findings.push(mathml::bad(node, "there is no `<math>` in it"));
            return Expr::number(1.0);
        };
        let mut scope = self.core.scope(&self.model.quantities, &self.model.functions, locals);
        read(&mut mathml::Reader { scope: &mut scope, findings: self.findings, parts: &mut self.parts }, math)
    }

    /// What `rateOf` of a quantity is.
    fn rates_of(&mut self) {
        let asked: Vec<(usize, String)> = std::mem::take(&mut self.core.rates_of);
        for (of, id) in asked {
            let rate = match &self.model.quantities[of].kind {
                Kind::State { rate, .. } => rate.clone(),
                Kind::Constant(_) => Expr::number(0.0),
                _ => {
                    let span = self.model.quantities[of].span;
                    let message = format!(
                        "`rateOf` of `{}` cannot be expressed: no rate determines it",
                        self.model.quantities[of].id
                    );
                    self.findings.push(Diagnostic::error(codes::IMPORT_UNSUPPORTED, span, message));
                    continue;
                }
            };
            let base = &self.model.quantities[of];
            let mut quantity = Quantity::new(id, base.group, base.span);
            quantity.equation = base.equation;
            quantity.label = format!("rate of {}", base.id);
            let constant = rate.literal().is_some();
            quantity.kind = Kind::Algebraic(rate);
            let index = self.model.add(quantity);
            let placeholder = self.core.rate_marks[&of];
            self.model.rename(placeholder, index);
            if let Kind::State { rate, .. } = &mut self.model.quantities[of].kind
                && !constant
            {
                *rate = Expr::Name(index);
            }
        }
    }

    /// Chooses the outputs.
    fn outputs(&mut self, wanted: &Wanted) {
        match wanted {
            Wanted::Usual => {
                let reactions = self.model.group("Reactions");
                let mut declared: Vec<(String, usize)> =
                    self.core.ids.iter().map(|(id, index)| (id.clone(), *index)).collect();
                declared.retain(|(_, index)| self.model.quantities[*index].group != reactions);
                declared.sort_by_key(|(_, index)| *index);
                let moves =
                    |index: usize| matches!(self.model.quantities[index].kind, Kind::State { .. } | Kind::Algebraic(_));
                if declared.iter().any(|(_, index)| moves(*index)) {
                    declared.retain(|(_, index)| moves(*index));
                }
                self.model.outputs = declared;
            }
            Wanted::Named(names) => {
                for name in names {
                    match self.core.ids.get(name) {
                        Some(index) => self.model.outputs.push((name.clone(), *index)),
                        None => self.findings.push(crate::no_output(name)),
                    }
                }
            }
            Wanted::Suite(settings) => {
                for name in &settings.variables {
                    let Some(index) = self.core.ids.get(name).copied() else {
                        self.findings.push(crate::no_output(name));
                        continue;
                    };
                    let index = if settings.amounts.contains(name) {
                        self.amount(index)
                    } else if settings.concentrations.contains(name) {
                        self.concentration(index)
                    } else {
                        index
                    };
                    self.model.outputs.push((name.clone(), index));
                }
            }
        }
    }
}

/// A reference to what is not there.
fn unknown_id(node: Node, id: &str) -> Diagnostic {
    if id.is_empty() {
        let message = format!("`<{}>` lacks the id that it refers to", node.tag_name().name());
        return Diagnostic::error(codes::IMPORT_SYNTAX, span(node), message);
    }
    let message = format!("there is no `{}` in the model", id.escape_debug());
    Diagnostic::error(codes::IMPORT_UNKNOWN, span(node), message)
}

/// A value of true or false in an attribute.
fn flag(node: Node, name: &str, default: bool) -> bool {
    node.attribute(name).map_or(default, |value| matches!(value.trim(), "true" | "1"))
}

/// Tests of element names that do not look at namespaces, which the versions of SBML differ in.
trait Named {
    fn has_tag_name_of(&self, name: &str) -> bool;
}

impl Named for Node<'_, '_> {
    fn has_tag_name_of(&self, name: &str) -> bool {
        self.is_element() && self.tag_name().name() == name
    }
}

/// All elements below a node, itself left out.
fn below<'a>(node: Node<'a, 'a>) -> impl Iterator<Item = Node<'a, 'a>> {
    elements(node).flat_map(|inner| inner.descendants()).filter(Node::is_element)
}
