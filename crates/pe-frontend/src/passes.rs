//! The passes, in the order in which they run. Each is one function of one module and reads only what those before it
//! have found.
//!
//! A quantity whose definition has an error is marked broken; whoever reads it stays silent, so that each mistake is
//! reported once.

use crate::arrays::write::{self as arrays, Written};
use crate::components::expand;
use crate::context::Context;
use crate::declare::initial::Initial;
use crate::declare::settings::Settings;
use crate::declare::{constants, initial, overrides as set, sizes, times};
use crate::equations::constrained::{self, Constrained};
use crate::equations::{events, order, sampled, systems, write as equations};
use crate::limits::Limits;
use crate::model::assemble::{self, Parts};
use crate::model::unused;
use crate::names::collect;
use crate::names::table::{Kind, Names};
use crate::outputs::spec as outputs;
use crate::report::Report;
use crate::syntax::ast::Spec;
use crate::units::check as units;
use crate::units::dimension::Units;
use pe_ir::index::at;
use pe_ir::model::{Interpolation, Model};
use pe_ir::source::Diagnostic;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// What the command line says in place of the spec.
#[derive(Clone, Debug, Default)]
pub struct Overrides {
    /// Values of constants, parameters and states at time zero: of `R` all elements, of `R[3]` one. The last counts.
    pub set: Vec<(String, f64)>,
    /// Lists of scalars, elements and whole arrays (`V[3], p`) that are the outputs; the spec's if there is none.
    pub observe: Vec<String>,
    /// How strictly units are checked; what the spec says, if this is not given.
    pub units: Option<Units>,
    /// What inputs are between two samples if the spec does not say; the earlier one, if this is not given.
    pub inputs: Option<Interpolation>,
}

/// What the passes found out about a quantity or an index, for tools that show it.
#[derive(Clone, Debug, PartialEq)]
pub struct Known {
    /// Its name; those that the front end makes for solutions of linear systems are no names of a spec.
    pub name: String,
    /// First and last value of each index.
    pub extents: Vec<(i64, i64)>,
    /// Values of a constant or parameter and initial values of a state, by element, the last index fastest; NaN where
    /// there is none, empty for all others.
    pub values: Vec<f64>,
}

/// What an elaboration gives.
#[derive(Debug, Default)]
pub struct Elaborated {
    /// The model, exactly if neither the syntax tree nor the elaboration has an error.
    pub model: Option<Model>,
    /// What the elaboration found, in source order.
    pub findings: Vec<Diagnostic>,
    /// What is known of quantities and indices, also where there are errors.
    pub known: Vec<Known>,
}

/// Builds the flat model of a spec, and tells what became of its quantities. Once `stop` is set the work ends early,
/// with a result that means nothing.
pub fn examine(spec: &Spec, overrides: &Overrides, stop: &Arc<AtomicBool>) -> Elaborated {
    elaborated(spec, overrides, &Limits::default(), Some(stop))
}

/// Builds the flat model of a spec.
///
/// The model is there exactly if neither the syntax tree nor the elaboration has an error.
pub fn elaborate(spec: &Spec, overrides: &Overrides) -> (Option<Model>, Vec<Diagnostic>) {
    elaborate_within(spec, overrides, &Limits::default())
}

/// [`elaborate`] with limits of the caller's.
pub fn elaborate_within(spec: &Spec, overrides: &Overrides, limits: &Limits) -> (Option<Model>, Vec<Diagnostic>) {
    let Elaborated { model, findings, .. } = elaborated(spec, overrides, limits, None);
    (model, findings)
}

fn elaborated(spec: &Spec, overrides: &Overrides, limits: &Limits, stop: Option<&Arc<AtomicBool>>) -> Elaborated {
    let mut report = Report::default();
    let expanded = expand::expand(spec, &mut report);
    let spec = expanded.as_ref().unwrap_or(spec);
    let mechanism = constrained::write_out(spec, &mut report);
    let repeats = expanded.is_some() || mechanism.is_some();
    let (spec, mechanism) = mechanism.as_ref().map_or((spec, None), |(spec, mechanism)| (spec, mechanism.as_ref()));
    let written = arrays::write_out(spec, &overrides.set, limits, &mut report);
    let plain = written.as_ref().map_or(spec, |written| &written.spec);
    let (model, mut report, known) = run(plain, mechanism, overrides, (limits, stop), report);
    if model.is_none() && !report.failed() && spec.broken.is_empty() {
        let unexplained = written.as_ref().and_then(Written::unexplained);
        unexplained.into_iter().for_each(|error| report.push(error));
    }
    let mut findings = report.finish();
    if repeats {
        // What is wrong with a statement of a component, or with a part of a mechanism, is said once.
        let mut said = BTreeSet::new();
        findings.retain(|finding| finding.span.is_none_or(|span| said.insert((span, finding.code))));
    }
    Elaborated { model, findings, known }
}

/// All passes over a spec without whole arrays.
fn run(
    spec: &Spec,
    mechanism: Option<&Constrained>,
    overrides: &Overrides,
    (limits, stop): (&Limits, Option<&Arc<AtomicBool>>),
    mut report: Report,
) -> (Option<Model>, Report, Vec<Known>) {
    let mut names = collect::collect(spec, &mut report);
    let settings = Settings::collect(spec, &mut report);
    names.time = settings.time.unwrap_or_default();
    let mut context = Context::new(spec, names, limits, report);
    context.evaluator.stop_on(stop.cloned());
    let set = set::check(&context.names, &overrides.set, &mut context.report);

    // Constants first: index ranges read them, and with these the sizes of arrays are known.
    constants::compute(&mut context, Kind::Const, &set);
    sizes::index_ranges(&mut context);
    sizes::extents(&mut context);
    constants::compute(&mut context, Kind::Param, &set);

    // What is fixed before time zero.
    let times = times::times(&mut context, &settings);
    context.evaluator.signals.span = times.as_ref().map_or(1.0, |times| times.span);
    context.evaluator.signals.unit = context.names.time;
    let initials = initial::states(&mut context, &set);
    let known = known(&context.names, &initials);
    let inputs = initial::inputs(&mut context, overrides.inputs);
    let rates = times::rates(&mut context);

    let mut flat = equations::write_out(&mut context);
    let events = events::events(&mut context, times.as_ref());
    let mut outputs = outputs::outputs(&mut context, &mut flat, &overrides.observe);
    let numbers = systems::fold(&mut flat, &outputs, &context.names);
    let holders = sampled::hold(&mut flat, &mut outputs, spec, &context.names);
    let mut order = order::dependency_order(&flat, &context.names, &mut context.report);
    if let Some(known) = &order
        && systems::mirror(&mut flat, (known, &numbers), &outputs, &context.names, &mut context.report)
    {
        order = order::dependency_order(&flat, &context.names, &mut context.report);
    }
    equations::check_unused_functions(&mut context);
    let mode = overrides.units.or(settings.units).unwrap_or_default();
    units::check(spec, &mut context.names, &mut context.report, mode);

    let Context { names, mut report, evaluator, .. } = context;
    let parts = (|| {
        if report.failed() || !spec.broken.is_empty() {
            return None;
        }
        unused::warn(&names, &mut report);
        unused::empty_sums(&evaluator.sums, &mut report);
        let mechanism = match mechanism {
            Some(named) => Some(constrained::mechanism(named, &names, &flat, &numbers, &mut report)?),
            None => None,
        };
        Some(Parts {
            header: settings.header()?,
            times: times?,
            flat,
            events,
            holders,
            rates: rates?,
            order: order?,
            initials,
            inputs,
            outputs,
            mechanism,
            observed: !overrides.observe.is_empty(),
        })
    })();
    let model = parts.and_then(|parts| assemble::assemble(parts, &names, evaluator.signals, &mut report));
    (model, report, known)
}

/// What is known of quantities and indices once all constants and initial values are.
fn known(names: &Names, initials: &[Initial]) -> Vec<Known> {
    let states = names.quantities.iter().filter(|quantity| quantity.kind == Kind::State);
    // After an error there are fewer values, and those left are out of place.
    let complete = states.map(|state| state.length).fold(0, usize::saturating_add) == initials.len();
    let quantities = names.quantities.iter().map(|quantity| {
        let from = at(quantity.base);
        let values = match quantity.kind {
            Kind::Const | Kind::Param => quantity.values.clone(),
            Kind::State if complete => initials[from..from + quantity.length].iter().map(|state| state.value).collect(),
            _ => Vec::new(),
        };
        let extents = quantity.dimensions.iter().map(|dimension| (dimension.low, dimension.high)).collect();
        Known { name: quantity.name.text.clone(), extents, values }
    });
    let indices = names.indices.iter().map(|index| Known {
        name: index.name.text.clone(),
        extents: index.range.into_iter().collect(),
        values: Vec::new(),
    });
    quantities.chain(indices).collect()
}
