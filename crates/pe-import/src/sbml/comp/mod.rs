//! Models that are composed of others (package `comp`): one flat model is made of them, which is read like any other.
//!
//! Elements of a submodel `a` get ids `a__id`, as other tools name them. Deletions, replacements, ports and conversion
//! factors are those of the specification; what refers to other files is refused.

mod tree;

use std::collections::{HashMap, HashSet};

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};
use roxmltree::Document;

use self::tree::{Element, is_comp};

/// Models within models, at most, and elements of the flat model.
const DEEPEST: usize = 40;
const MOST_ELEMENTS: usize = 500_000;

/// Attributes that name another element of the model, and those that name a unit.
const REFERENCES: [&str; 9] = [
    "compartment",
    "species",
    "variable",
    "symbol",
    "conversionFactor",
    "compartmentType",
    "speciesType",
    "outside",
    "id",
];
const UNITS: [&str; 8] = [
    "units",
    "substanceUnits",
    "timeUnits",
    "volumeUnits",
    "areaUnits",
    "lengthUnits",
    "extentUnits",
    "spatialSizeUnits",
];

/// The text of a flat model, and the places that its elements come from.
pub(super) struct Flat {
    pub text: String,
    places: Vec<(usize, usize, Span)>,
}

impl Flat {
    /// Where in the file something stands that stands here in the flat model.
    pub fn place(&self, span: Span) -> Span {
        let (start, end) = (span.start as usize, span.end as usize);
        let last = self.places.partition_point(|(from, ..)| *from <= start);
        let around = self.places[..last].iter().rev().find(|(_, to, _)| *to >= end);
        around.map_or(Span::default(), |(.., origin)| *origin)
    }
}

/// Whether a namespace is that of the package.
pub(super) fn is_package(url: &str) -> bool {
    is_comp(url)
}

/// The flat model of a file; none if it cannot be made, with findings.
pub(super) fn flat(document: &Document, findings: &mut Vec<Diagnostic>) -> Option<Flat> {
    let root = Element::of(document.root_element());
    let mut flattener = Flattener { models: HashMap::new(), elements: 0, findings: Vec::new() };
    for model in root.listed("listOfModelDefinitions") {
        flattener.models.extend(model.get("id").map(|id| (id.to_owned(), model)));
    }
    for external in root.listed("listOfExternalModelDefinitions") {
        let message = format!("the model `{}` is in another file", shown(external.get("comp:id").unwrap_or("?")));
        let help = "flatten the model with a tool that reads all files, such as libSBML";
        let finding = Diagnostic::error(codes::IMPORT_UNSUPPORTED, external.span, message);
        flattener.findings.push(finding.with_help(help));
    }
    let model = root.child("model")?;
    let made = flattener.instance(model, 0);
    let is_made = flattener.findings.is_empty();
    findings.append(&mut flattener.findings);
    let made = made.filter(|_| is_made)?;
    let mut whole = Element::new("sbml", "", vec![made.model], root.span);
    whole.attributes = root.attributes.into_iter().filter(|(name, _)| name != "comp:required").collect();
    let (mut text, mut places) = (String::new(), Vec::new());
    whole.write(&mut text, &mut places);
    Some(Flat { text, places })
}

fn shown(id: &str) -> String {
    id.escape_debug().to_string()
}

/// What a reference means: the id of an element, of a unit, or an element by its `metaid`.
#[derive(Clone, Debug, PartialEq)]
enum Target {
    Id(String),
    Unit(String),
    Meta(String),
}

/// A model with its submodels put in.
struct Instance {
    model: Element,
    /// What stands for elements that were replaced, by id.
    replaced: HashMap<String, String>,
}

struct Flattener<'e> {
    models: HashMap<String, &'e Element>,
    elements: usize,
    findings: Vec<Diagnostic>,
}

impl<'e> Flattener<'e> {
    fn refuse(&mut self, code: &'static str, span: Span, message: String) {
        self.findings.push(Diagnostic::error(code, span, message));
    }

    fn instance(&mut self, definition: &'e Element, depth: usize) -> Option<Instance> {
        self.elements += definition.size();
        if depth > DEEPEST || self.elements > MOST_ELEMENTS {
            let message =
                format!("models within models make more than {MOST_ELEMENTS} elements, or are {DEEPEST} levels deep");
            self.refuse(codes::IMPORT_LIMIT, definition.span, message);
            return None;
        }
        let mut model = definition.clone();
        model.name = "model".to_owned();
        model.children.retain(|child| !["listOfSubmodels", "listOfPorts"].contains(&child.name.as_str()));
        let mut instance = Instance { model, replaced: HashMap::new() };
        conversion_factors(&mut instance.model);
        for submodel in definition.listed("listOfSubmodels") {
            let (id, of) = (submodel.get("comp:id").unwrap_or(""), submodel.get("comp:modelRef").unwrap_or(""));
            let Some(inner) = self.models.get(of).copied() else {
                self.refuse(codes::IMPORT_UNKNOWN, submodel.span, format!("there is no model `{}`", shown(of)));
                continue;
            };
            let part = self.instance(inner, depth + 1)?;
            self.put_in(&mut instance, submodel, id, inner, part);
        }
        instance.model.each_mut(&mut |element| {
            element.children.retain(|child| !["listOfReplacedElements", "replacedBy"].contains(&child.name.as_str()));
        });
        Some(instance)
    }

    /// Puts a submodel into a model.
    fn put_in(&mut self, outer: &mut Instance, submodel: &Element, id: &str, inner: &'e Element, part: Instance) {
        let Instance { model: mut part, replaced } = part;
        prefix(&mut part, id);
        let mut known = HashSet::new();
        part.each(&mut |element| {
            known.extend(["id", "metaid"].into_iter().filter_map(|name| element.get(name).map(str::to_owned)));
        });
        let own = |name: &str| format!("{id}__{name}");
        outer.replaced.extend(replaced.into_iter().map(|(from, to)| (own(&from), own(&to))));
        for deletion in submodel.listed("listOfDeletions") {
            if let Some(target) = self.target(inner, deletion, id, &outer.replaced) {
                self.remove(&mut part, &target, deletion, &known);
            }
        }
        let (mut asked, mut given) = (Vec::new(), Vec::new());
        outer.model.each(&mut |element| {
            let to = (element.get("id").map(str::to_owned), element.name == "unitDefinition");
            for reference in element.listed("listOfReplacedElements") {
                if reference.get("comp:submodelRef") == Some(id) && reference.get("comp:deletion").is_none() {
                    asked.push((reference.clone(), to.clone()));
                }
            }
            given.extend(
                element
                    .child("replacedBy")
                    .filter(|by| by.get("comp:submodelRef") == Some(id))
                    .map(|by| (by.clone(), to.clone())),
            );
        });
        let mut names = HashMap::new();
        let mut units = HashMap::new();
        for (reference, (own, is_unit)) in asked {
            let Some(target) = self.target(inner, &reference, id, &outer.replaced) else { continue };
            if let (Target::Meta(meta), Some(own)) = (&target, &own) {
                local_parameter(&mut part, meta, own);
            }
            self.remove(&mut part, &target, &reference, &known);
            match (target, own) {
                (Target::Unit(unit), Some(own)) if is_unit => {
                    units.insert(unit, own);
                }
                (Target::Id(from), Some(own)) => {
                    if let Some(factor) = reference.get("comp:conversionFactor") {
                        scale(&mut part, &from, &own, factor);
                    }
                    outer.replaced.insert(from.clone(), own.clone());
                    names.insert(from, own);
                }
                _ => {}
            }
        }
        for (reference, (own, is_unit)) in given {
            let Some(target) = self.target(inner, &reference, id, &outer.replaced) else { continue };
            let Some(own) = own else {
                self.refuse(codes::IMPORT_UNSUPPORTED, reference.span, "what is replaced here has no id".to_owned());
                continue;
            };
            outer.model.remove(&|element| {
                element.get("id") == Some(&own)
                    && (element.name == "unitDefinition") == is_unit
                    && element.child("replacedBy").is_some()
            });
            match target {
                Target::Unit(unit) => {
                    units.insert(unit, own);
                }
                Target::Id(from) => {
                    outer.replaced.insert(from.clone(), own.clone());
                    names.insert(from, own);
                }
                Target::Meta(meta) => part.each_mut(&mut |element| {
                    if element.get("metaid") == Some(&meta) {
                        element.attributes.retain(|(name, _)| name != "id");
                        element.attributes.push(("id".to_owned(), own.clone()));
                    }
                }),
            }
        }
        rename(&mut part, &|name| names.get(name).cloned(), &|unit| units.get(unit).cloned());
        // What was replaced is in the units of the model around it.
        let factor = |name: &str| submodel.get(name).map(str::to_owned);
        convert(&mut part, factor("comp:timeConversionFactor"), factor("comp:extentConversionFactor"));
        for list in part.children {
            match outer.model.children.iter_mut().find(|known| known.name == list.name) {
                Some(known) => known.children.extend(list.children),
                None => outer.model.children.push(list),
            }
        }
    }

    /// What a reference into a submodel means, in the ids of the model around it.
    fn target(
        &mut self,
        inner: &'e Element,
        reference: &Element,
        submodel: &str,
        replaced: &HashMap<String, String>,
    ) -> Option<Target> {
        let target = match self.resolved(inner, reference, 0)? {
            Target::Id(id) => {
                let mut id = format!("{submodel}__{id}");
                // As many steps as there are levels at most.
                for _ in 0..DEEPEST {
                    let Some(next) = replaced.get(&id) else { break };
                    id.clone_from(next);
                }
                Target::Id(id)
            }
            Target::Unit(unit) => Target::Unit(format!("{submodel}__{unit}")),
            Target::Meta(meta) => Target::Meta(format!("{submodel}__{meta}")),
        };
        Some(target)
    }

    /// What a reference means, in the ids of the model that it leads into.
    fn resolved(&mut self, model: &'e Element, reference: &Element, depth: usize) -> Option<Target> {
        let unknown = |flattener: &mut Self, what: &str| {
            flattener.refuse(
                codes::IMPORT_UNKNOWN,
                reference.span,
                format!("there is no `{}` in the submodel", shown(what)),
            );
            None
        };
        if depth > DEEPEST {
            return unknown(self, "port");
        }
        if let Some(name) = reference.get("comp:portRef") {
            let port = model.listed("listOfPorts").find(|port| port.get("comp:id") == Some(name));
            return match port {
                Some(port) => self.resolved(model, port, depth + 1),
                None => unknown(self, name),
            };
        }
        if let Some(unit) = reference.get("comp:unitRef") {
            return Some(Target::Unit(unit.to_owned()));
        }
        let mut name = reference.get("comp:idRef").map(str::to_owned);
        if let Some(meta) = reference.get("comp:metaIdRef") {
            let mut found = None;
            model.each(&mut |element| {
                if element.get("metaid") == Some(meta) {
                    // A local parameter has no id outside of its reaction.
                    let is_local = element.name == "localParameter";
                    let id = element.get("id").or(element.get("comp:id")).filter(|_| !is_local);
                    found = Some(id.map(str::to_owned));
                }
            });
            match found {
                None => return unknown(self, meta),
                Some(None) => return Some(Target::Meta(meta.to_owned())),
                Some(id) => name = id,
            }
        }
        let Some(name) = name else { return unknown(self, "element") };
        let within = model.listed("listOfSubmodels").find(|submodel| submodel.get("comp:id") == Some(&name));
        let Some(submodel) = within else { return Some(Target::Id(name)) };
        let Some(next) = reference.child("sBaseRef") else {
            let message = format!("`{}` is a whole submodel, and cannot be replaced or deleted", shown(&name));
            self.refuse(codes::IMPORT_UNSUPPORTED, reference.span, message);
            return None;
        };
        let inner = self.models.get(submodel.get("comp:modelRef").unwrap_or("")).copied()?;
        let under = |inner: String| format!("{name}__{inner}");
        Some(match self.resolved(inner, next, depth + 1)? {
            Target::Id(id) => Target::Id(under(id)),
            Target::Unit(unit) => Target::Unit(under(unit)),
            Target::Meta(meta) => Target::Meta(under(meta)),
        })
    }

    /// Removes an element, which may have gone with one around it.
    fn remove(&mut self, part: &mut Element, target: &Target, reference: &Element, known: &HashSet<String>) {
        let removed = match target {
            Target::Id(id) => part.remove(&|element| element.get("id") == Some(id) && element.name != "unitDefinition"),
            Target::Unit(id) => {
                part.remove(&|element| element.get("id") == Some(id) && element.name == "unitDefinition")
            }
            Target::Meta(id) => part.remove(&|element| element.get("metaid") == Some(id)),
        };
        let (Target::Id(id) | Target::Unit(id) | Target::Meta(id)) = target;
        if !removed && !known.contains(id) {
            let message = format!("there is no `{}` in the submodel", shown(id));
            self.refuse(codes::IMPORT_UNKNOWN, reference.span, message);
        }
    }
}

/// Names of local parameters of a kinetic law, or of arguments of a function.
fn local_names(element: &Element) -> Vec<String> {
    match element.name.as_str() {
        "kineticLaw" => {
            let lists = ["listOfParameters", "listOfLocalParameters"];
            let all = lists.iter().flat_map(|list| element.listed(list));
            all.filter_map(|parameter| parameter.get("id").map(str::to_owned)).collect()
        }
        "lambda" => {
            let bound = element.children.iter().filter(|child| child.name == "bvar").flat_map(|bound| &bound.children);
            bound.map(|name| name.text.clone()).collect()
        }
        _ => Vec::new(),
    }
}

/// Reads a quantity in a kinetic law in place of a local parameter with this `metaid`.
fn local_parameter(part: &mut Element, meta: &str, by: &str) {
    part.each_mut(&mut |element| {
        let local = element.listed("listOfLocalParameters").find(|local| local.get("metaid") == Some(meta));
        let Some(id) = local.and_then(|local| local.get("id")).map(str::to_owned) else { return };
        element.each_mut(&mut |inner| {
            if inner.name == "ci" && inner.text == id {
                by.clone_into(&mut inner.text);
            }
        });
    });
}

/// Gives names and units others wherever they stand.
fn rename(element: &mut Element, name: &dyn Fn(&str) -> Option<String>, unit: &dyn Fn(&str) -> Option<String>) {
    fn walk(
        element: &mut Element,
        locals: &[String],
        name: &dyn Fn(&str) -> Option<String>,
        unit: &dyn Fn(&str) -> Option<String>,
    ) {
        let mut known = local_names(element);
        known.extend(locals.iter().cloned());
        let is_local = ["parameter", "localParameter"].contains(&element.name.as_str())
            && element.get("id").is_some_and(|id| locals.iter().any(|local| local == id));
        let is_unit = element.name == "unitDefinition";
        for (attribute, value) in &mut element.attributes {
            let new = match attribute.as_str() {
                "id" if is_unit => unit(value),
                "id" if is_local => None,
                attribute if REFERENCES.contains(&attribute) => name(value),
                attribute if UNITS.contains(&attribute) => unit(value),
                _ => None,
            };
            new.into_iter().for_each(|new| *value = new);
        }
        if element.name == "ci" && !known.contains(&element.text) {
            name(&element.text).into_iter().for_each(|new| element.text = new);
        }
        element.children.iter_mut().for_each(|child| walk(child, &known, name, unit));
    }
    walk(element, &[], name, unit);
}

/// Puts the id of its submodel in front of all ids of a model.
fn prefix(model: &mut Element, submodel: &str) {
    let mut units = Vec::new();
    model.each(&mut |element| {
        if element.name == "unitDefinition" {
            units.extend(element.get("id").map(str::to_owned));
        }
    });
    let own = |name: &str| Some(format!("{submodel}__{name}"));
    rename(model, &own, &|unit| if units.iter().any(|known| known == unit) { own(unit) } else { None });
    model.each_mut(&mut |element| {
        for (attribute, value) in &mut element.attributes {
            if attribute == "metaid" {
                *value = format!("{submodel}__{value}");
            }
        }
    });
}

/// A conversion factor of a model is one of its species, which keep it in another model.
fn conversion_factors(model: &mut Element) {
    let Some(factor) = model.get("conversionFactor").map(str::to_owned) else { return };
    model.attributes.retain(|(name, _)| name != "conversionFactor");
    model.each_mut(&mut |element| {
        if element.name == "species" && element.get("conversionFactor").is_none() {
            element.attributes.push(("conversionFactor".to_owned(), factor.clone()));
        }
    });
}

/// `operator(first, second)`.
fn apply(operator: &str, first: Element, second: Element) -> Element {
    let span = first.span;
    Element::new("apply", "", vec![Element::new(operator, "", Vec::new(), span), first, second], span)
}

fn ci(name: &str, span: Span) -> Element {
    Element::new("ci", name, Vec::new(), span)
}

/// Makes something else of the expression of an element.
fn change_math(element: &mut Element, change: &dyn Fn(Element) -> Element) {
    if let Some(math) = element.children.iter_mut().find(|child| child.name == "math")
        && let Some(body) = math.children.pop()
    {
        math.children.push(change(body));
    }
}

/// Counts time and extent of a submodel in the units of the model around it.
fn convert(part: &mut Element, time: Option<String>, extent: Option<String>) {
    if time.is_none() && extent.is_none() {
        return;
    }
    let mut reactions = Vec::new();
    part.each(&mut |element| {
        if element.name == "reaction" {
            reactions.extend(element.get("id").map(str::to_owned));
        }
    });
    let over_time = |expr: Element| match &time {
        Some(time) => {
            let factor = ci(time, expr.span);
            apply("divide", expr, factor)
        }
        None => expr,
    };
    let by = |expr: Element, factor: &Option<String>| match factor {
        Some(factor) => {
            let factor = ci(factor, expr.span);
            apply("times", expr, factor)
        }
        None => expr,
    };
    part.each_mut(&mut |element| {
        let url = element.get("definitionURL").unwrap_or("").to_owned();
        match element.name.as_str() {
            "csymbol" if url.ends_with("/time") => *element = over_time(element.clone()),
            "apply"
                if element
                    .children
                    .first()
                    .is_some_and(|first| first.get("definitionURL").unwrap_or("").ends_with("/rateOf")) =>
            {
                *element = by(element.clone(), &time);
            }
            "apply"
                if element.children.len() == 3
                    && element.children[0].get("definitionURL").unwrap_or("").ends_with("/delay") =>
            {
                element.children[2] = by(element.children[2].clone(), &time);
            }
            // The rate of a reaction is in the units around by now.
            "ci" if reactions.contains(&element.text) => {
                let own = by(element.clone(), &time);
                *element = match &extent {
                    Some(extent) => {
                        let factor = ci(extent, own.span);
                        apply("divide", own, factor)
                    }
                    None => own,
                };
            }
            _ => {}
        }
    });
    part.each_mut(&mut |element| match element.name.as_str() {
        "rateRule" => change_math(element, &over_time),
        "kineticLaw" => change_math(element, &|expr| over_time(by(expr, &extent))),
        "delay" => change_math(element, &|expr| by(expr, &time)),
        _ => {}
    });
}

/// What a quantity is replaced by is a factor times it: it is that over the factor where it is read, and what is assigned to
/// it is multiplied.
fn scale(part: &mut Element, from: &str, to: &str, factor: &str) {
    part.each_mut(&mut |element| {
        if element.name == "ci" && element.text == from {
            *element = apply("divide", ci(to, element.span), ci(factor, element.span));
        }
        if element.get("variable").or(element.get("symbol")) == Some(from) {
            change_math(element, &|expr| {
                let factor = ci(factor, expr.span);
                apply("times", expr, factor)
            });
        }
    });
}
