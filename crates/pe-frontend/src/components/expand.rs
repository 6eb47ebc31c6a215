//! Writes out the instances of components, before anything else is done with a spec. No later pass meets a component.

use crate::components::rename::{Scope, prefixed, references};
use crate::nearest::suggestion;
use crate::report::Report;
use crate::syntax::ast::{
    Binder, Block, Component, Declared, Equation, Expr, LeftSide, Name, Range, Reference, Spec, Statement,
    StatementKind,
};
use pe_ir::source::{Diagnostic, Span};
use pe_ir::{codes, element};
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

/// Instances within instances.
const DEEPEST: usize = 32;

/// The spec without components, or `None` if it has none.
pub(crate) fn expand(spec: &Spec, report: &mut Report) -> Option<Spec> {
    let instance = |statement: &Statement| matches!(statement.kind, StatementKind::Instance { .. });
    if spec.components.is_empty() && !spec.statements.iter().any(instance) {
        return None;
    }
    let (mut components, mut broken) = (BTreeMap::new(), BTreeSet::new());
    for component in &spec.components {
        match components.entry(component.name.text.as_str()) {
            Entry::Vacant(place) => _ = place.insert(component),
            Entry::Occupied(first) => {
                let message = format!("the component `{}` is defined twice", component.name.text);
                let error = Diagnostic::error(codes::DUPLICATE, component.name.span, message);
                report.push(error.with_label(first.get().name.span, "first defined here"));
            }
        }
        if !fits(component, report) {
            broken.insert(component.name.text.as_str());
        }
    }
    let mut ranges = BTreeMap::new();
    for statement in &spec.statements {
        if let StatementKind::Index(binders) = &statement.kind {
            let known = |binder: &Binder| Some((binder.name.text.clone(), binder.range.clone()?));
            ranges.extend(binders.iter().filter_map(known));
        }
    }
    let indices = ranges.iter().map(|(name, range): (&String, &Range)| (name.as_str(), range.span)).collect();
    let clashing = instances_apart(&spec.statements, indices, report);
    let mut written = spec.emptied();
    written.names_missing |= spec.components.iter().any(|component| component.broken);
    let mut writer = Writer { components, broken, clashing, ranges, open: Vec::new(), written, report };
    let whole = Scope::default();
    for statement in &spec.statements {
        match &statement.kind {
            StatementKind::Instance { declared, component, arguments } => {
                writer.instance(&whole, declared, component, arguments);
            }
            _ => writer.written.statements.push(statement.clone()),
        }
    }
    let mut written = writer.written;
    whole_arrays(&mut written.statements);
    Some(written)
}

/// The name that a statement defines.
fn defined(kind: &StatementKind) -> Option<&Name> {
    match kind {
        StatementKind::Const { name, .. } => Some(name),
        StatementKind::Param { declared, .. }
        | StatementKind::Tunable { declared, .. }
        | StatementKind::Input { declared, .. }
        | StatementKind::State { declared, .. }
        | StatementKind::Matrix { declared, .. }
        | StatementKind::Connector { declared, .. }
        | StatementKind::Instance { declared, .. } => Some(&declared.name),
        StatementKind::Equation(equation) if equation.side == LeftSide::Algebraic => Some(&equation.target.name),
        _ => None,
    }
}

/// Own names of a component, with their places.
fn own(component: &Component) -> BTreeMap<&str, Span> {
    let mut own: BTreeMap<&str, Span> =
        component.parameters.iter().map(|parameter| (parameter.name.text.as_str(), parameter.name.span)).collect();
    for name in component.statements.iter().filter_map(|statement| defined(&statement.kind)) {
        own.entry(&name.text).or_insert(name.span);
    }
    own
}

/// Reports instances that have the name of something else, and gives their places.
fn instances_apart<'s>(
    statements: &'s [Statement],
    mut taken: BTreeMap<&'s str, Span>,
    report: &mut Report,
) -> BTreeSet<Span> {
    let mut clashing = BTreeSet::new();
    let instance = |kind: &StatementKind| matches!(kind, StatementKind::Instance { .. });
    for others in [true, false] {
        for statement in statements.iter().filter(|statement| instance(&statement.kind) != others) {
            let Some(name) = defined(&statement.kind) else { continue };
            match taken.get(name.text.as_str()) {
                Some(first) if !others => {
                    let message = format!("`{}` is defined twice", name.text);
                    let error = Diagnostic::error(codes::DUPLICATE, name.span, message);
                    report.push(error.with_label(*first, "first defined here"));
                    clashing.insert(name.span);
                }
                Some(_) => {}
                None => _ = taken.insert(&name.text, name.span),
            }
        }
    }
    clashing
}

/// Whether a component is right whatever its instances are; reports what is wrong with it.
fn fits(component: &Component, report: &mut Report) -> bool {
    let own = own(component);
    let before = report.count();
    let wrong = |report: &mut Report, span: Span, message: String, help: &str| {
        report.push(Diagnostic::error(codes::BAD_COMPONENT, span, message).with_help(help));
    };
    for (at, parameter) in component.parameters.iter().enumerate() {
        if component.parameters[..at].iter().any(|earlier| earlier.name.text == parameter.name.text) {
            wrong(
                report,
                parameter.name.span,
                format!("two parameters `{}`", parameter.name.text),
                "give one another name",
            );
        }
    }
    let parameters = component.parameters.iter().map(|parameter| (parameter.name.text.as_str(), parameter.name.span));
    instances_apart(&component.statements, parameters.collect(), report);
    for statement in &component.statements {
        if let StatementKind::Equation(equation) = &statement.kind {
            let name = &equation.target.name;
            if name.text.contains('.') {
                let help =
                    "an equation stands in the component that has the quantity; instances are told what they read";
                wrong(report, name.span, format!("`{}` belongs to an instance", name.text), help);
            } else if equation.side != LeftSide::Algebraic && !own.contains_key(name.text.as_str()) {
                let message = format!("`{}` has an equation and is no state of the component", name.text);
                wrong(report, name.span, message, "declare it here: `state NAME = 0`");
            }
        }
    }
    report.count() == before
}

struct Writer<'a, 'r> {
    components: BTreeMap<&'a str, &'a Component>,
    /// Those that are wrong whatever their instances are.
    broken: BTreeSet<&'a str>,
    /// Instances that have the name of something else.
    clashing: BTreeSet<Span>,
    /// Default ranges of the indices of the spec.
    ranges: BTreeMap<String, Range>,
    /// Components that are being written, the innermost last.
    open: Vec<&'a str>,
    written: Spec,
    report: &'r mut Report,
}

impl<'a> Writer<'a, '_> {
    fn refuse(&mut self, span: Span, message: String, help: Option<String>) {
        let error = Diagnostic::error(codes::BAD_COMPONENT, span, message);
        self.report.push(Diagnostic { help, ..error });
    }

    /// Writes an instance that stands in `outer`.
    fn instance(&mut self, outer: &Scope, declared: &Declared, named: &Name, arguments: &[(Name, Expr)]) {
        let Some(component) = self.components.get(named.text.as_str()).copied() else {
            let error =
                Diagnostic::error(codes::UNKNOWN_NAME, named.span, format!("unknown component `{}`", named.text));
            let help = suggestion(&named.text, self.components.keys().copied());
            if !self.written.names_missing {
                self.report.push(Diagnostic { help, ..error });
            }
            self.written.names_missing = true;
            return;
        };
        if self.broken.contains(component.name.text.as_str()) || self.clashing.contains(&declared.name.span) {
            self.written.names_missing = true;
            return;
        }
        if self.open.contains(&component.name.text.as_str()) || self.open.len() >= DEEPEST {
            let message = format!("`{}` contains an instance of itself", component.name.text);
            self.refuse(named.span, message, Some("components may contain others, but no circle of them".to_owned()));
            self.written.names_missing = true;
            return;
        }
        let Some((scope, arguments_scope)) = self.scope(outer, declared, component) else {
            self.written.names_missing = true;
            return;
        };
        self.arguments(component, declared, arguments);
        let told: BTreeMap<&str, &Expr> = arguments.iter().map(|(name, value)| (name.text.as_str(), value)).collect();
        for parameter in &component.parameters {
            let value = match (told.get(parameter.name.text.as_str()), &parameter.value) {
                (Some(value), _) => arguments_scope.expr(value),
                (None, Some(value)) => scope.expr(value),
                (None, None) => {
                    self.untold(component, declared, &parameter.name);
                    continue;
                }
            };
            let mut declared =
                Declared { name: parameter.name.clone(), dimensions: Vec::new(), unit: parameter.unit.clone() };
            scope.declared(&mut declared);
            self.push(StatementKind::Param { declared, value }, parameter.name.span);
        }
        let first_block = self.written.blocks.len();
        for block in &component.blocks {
            let mut block: Block = block.clone();
            if !scope.indices.is_empty() && block.period.as_ref().is_some_and(|period| scope.reads_own(&period.value)) {
                let message = "the instances of an array have one period".to_owned();
                let help = "give it as a number or a constant of the spec".to_owned();
                self.refuse(block.span, message, Some(help));
                block.period = None;
            }
            if let Some(period) = &mut block.period {
                period.value = scope.expr(&period.value);
            }
            self.written.blocks.push(block);
        }
        self.open.push(&component.name.text);
        for statement in &component.statements {
            let kind = match &statement.kind {
                StatementKind::Instance { declared, component, arguments } => {
                    self.instance(&scope, declared, component, arguments);
                    continue;
                }
                StatementKind::Connector { declared: connector, within } => {
                    match told.get(connector.name.text.as_str()) {
                        Some(value) => connected(&scope, &arguments_scope, connector, within.as_ref(), value),
                        None => {
                            self.untold(component, declared, &connector.name);
                            continue;
                        }
                    }
                }
                StatementKind::Input { declared: input, within, .. } if told.contains_key(input.name.text.as_str()) => {
                    connected(&scope, &arguments_scope, input, within.as_ref(), told[input.name.text.as_str()])
                }
                kind => scope.statement(kind),
            };
            let block = statement.block.map(|block| first_block + block);
            self.written.statements.push(Statement {
                kind,
                block,
                span: statement.span,
                files: statement.files.clone(),
            });
        }
        self.open.pop();
    }

    /// The scope of what an instance has, and that of what it is told.
    fn scope(&mut self, outer: &Scope, declared: &Declared, component: &Component) -> Option<(Scope, Scope)> {
        let path = format!("{}{}", outer.prefix, declared.name.text);
        let mut told = outer.clone();
        let mut indices = outer.indices.clone();
        for binder in &declared.dimensions {
            let name = &binder.name;
            let range = match &binder.range {
                Some(range) => Range { low: outer.expr(&range.low), high: outer.expr(&range.high), span: range.span },
                None => match self.ranges.get(&name.text) {
                    Some(range) => {
                        self.written.of_instances.insert(name.text.clone());
                        range.clone()
                    }
                    None => {
                        let error =
                            Diagnostic::error(codes::UNKNOWN_NAME, name.span, format!("unknown index `{}`", name.text));
                        let help = format!("give it a range: `{}[{} in 1..10]`", declared.name.text, name.text);
                        self.report.push(error.with_help(help));
                        return None;
                    }
                },
            };
            // Blanks keep this name apart from those of the component.
            let text = format!("{} of {}", name.text, element::bare(&path));
            told.renamed.insert(name.text.clone(), text.clone());
            indices.push(Binder { name: Name { text, span: name.span }, range: Some(range), rows: None });
        }
        let prefix = format!("{path}{}.", element::places(declared.dimensions.len()));
        let own = own(component).into_keys().map(str::to_owned).collect();
        Some((Scope { prefix, indices, own, renamed: BTreeMap::new() }, told))
    }

    /// Reports what a component is told in vain.
    fn arguments(&mut self, component: &Component, declared: &Declared, arguments: &[(Name, Expr)]) {
        for (at, (name, _)) in arguments.iter().enumerate() {
            if arguments[..at].iter().any(|(earlier, _)| earlier.text == name.text) {
                self.refuse(name.span, format!("`{}` is told `{}` twice", declared.name.text, name.text), None);
            }
            let wanted = component.parameters.iter().map(|parameter| &parameter.name);
            let connectors = component.statements.iter().filter_map(|statement| match &statement.kind {
                StatementKind::Connector { declared, .. } | StatementKind::Input { declared, .. } => {
                    Some(&declared.name)
                }
                _ => None,
            });
            let wanted: Vec<&Name> = wanted.chain(connectors).collect();
            if wanted.iter().any(|wanted| wanted.text == name.text) || component.broken {
                continue;
            }
            let inner = own(component).get(name.text.as_str()).copied();
            let message = match inner {
                Some(_) => format!("`{}` is no parameter or input of `{}`", name.text, component.name.text),
                None => format!("`{}` has no parameter or input `{}`", component.name.text, name.text),
            };
            let near = suggestion(&name.text, wanted.iter().map(|name| name.text.as_str()));
            let all: Vec<String> = wanted.iter().map(|name| format!("`{}`", name.text)).collect();
            let help = near.or_else(|| match all.is_empty() {
                true => Some("this component is told nothing".to_owned()),
                false => Some(format!("it has {}", all.join(", "))),
            });
            let error = Diagnostic { help, ..Diagnostic::error(codes::BAD_COMPONENT, name.span, message) };
            self.report.push(match inner {
                Some(span) => error.with_label(span, "defined here"),
                None => error,
            });
        }
    }

    /// Reports a parameter or connector that an instance is not told, and keeps silent about its readers.
    fn untold(&mut self, component: &Component, instance: &Declared, name: &Name) {
        let message = format!("`{}` is not told its `{}`", instance.name.text, name.text);
        let error = Diagnostic::error(codes::BAD_COMPONENT, instance.name.span, message);
        let help = format!("write `{}({} = ...)`", component.name.text, name.text);
        self.report.push(error.with_label(name.span, "without a value here").with_help(help));
        self.written.names_missing = true;
    }

    fn push(&mut self, kind: StatementKind, span: Span) {
        self.written.statements.push(Statement { kind, block: None, span, files: Vec::new() });
    }
}

/// The equation of an input that an instance is told.
fn connected(scope: &Scope, told: &Scope, declared: &Declared, within: Option<&Range>, value: &Expr) -> StatementKind {
    let name = prefixed(&scope.prefix, &declared.name);
    let end = |expr: &Expr| scope.expr(expr);
    StatementKind::Equation(Equation {
        target: Reference { subscripts: scope.leading(), span: name.span, name },
        side: LeftSide::Algebraic,
        unit: declared.unit.clone(),
        value: told.expr(value),
        within: within.map(|range| Range { low: end(&range.low), high: end(&range.high), span: range.span }),
        ranges: scope.indices.clone(),
        condition: None,
    })
}

/// Gives whole arrays of instances their names: `cell.v` is `cell[].v`.
fn whole_arrays(statements: &mut [Statement]) {
    let mut known = BTreeSet::new();
    for statement in statements.iter() {
        match &statement.kind {
            StatementKind::Param { declared, .. }
            | StatementKind::Input { declared, .. }
            | StatementKind::State { declared, .. }
            | StatementKind::Matrix { declared, .. } => known.insert(declared.name.text.clone()),
            StatementKind::Equation(equation) => known.insert(equation.target.name.text.clone()),
            _ => false,
        };
    }
    let arrays: BTreeMap<String, String> =
        known.iter().filter(|name| name.contains("].")).map(|name| (element::bare(name), name.clone())).collect();
    for statement in statements {
        references(&mut statement.kind, &mut |reference| {
            let name = &mut reference.name.text;
            if name.contains('.')
                && reference.subscripts.is_empty()
                && !known.contains(name.as_str())
                && let Some(array) = arrays.get(name.as_str())
            {
                name.clone_from(array);
            }
        });
    }
}
