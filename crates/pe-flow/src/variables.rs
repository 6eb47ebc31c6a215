//! Every variable with its number format: measured range, limit, headroom, error.

use std::collections::BTreeMap;

use pe_ir::functions::Scaled;
use pe_ir::graph::{Role, StepGraph, ValueId};
use pe_ir::model::Model;
use serde_json::{Value, json};

use pe_judge::progress::silent;
use pe_judge::proof::Certainty;
use pe_judge::runs::{self, Judged};
use pe_judge::{Criteria, DesignPoint};

use crate::failure::Failure;
use crate::pipeline;
use crate::report::types::Headroom;
use crate::settings::MappingOptions;
use crate::spec::LoadedModel;
use crate::watch::Stopwatch;

/// Products that an equation takes on average, where they have not been counted.
const PRODUCTS_PER_EQUATION: u64 = 8;

/// Variables that reports list: those with the least headroom.
const LISTED: usize = 10;

/// Variables that a terminal shows unless asked for all.
const SHOWN: usize = 6;

/// A state, algebraic variable or input.
#[derive(Clone, Debug, PartialEq)]
pub struct Variable {
    /// Its name.
    pub name: String,
    /// `state`, `algebraic` or `input`.
    pub kind: &'static str,
    /// Unit as written.
    pub unit: Option<String>,
    /// Largest magnitude over the span in double precision, intermediate stages included.
    pub largest: f64,
    /// The format's step: what its LSB is worth, guard bits included.
    pub lsb: f64,
    /// Largest magnitude that the format holds.
    pub limit: f64,
    /// Largest difference between fixed point and double precision, relative to the largest magnitude; states only.
    pub word_length: Option<f64>,
    /// How sure it is that it stays in range; states only.
    pub range: Option<Certainty>,
    /// Magnitude that it is proven not to exceed over the span; proven states only.
    pub bound: Option<f64>,
}

impl Variable {
    /// Bits between the largest magnitude and the limit.
    pub fn headroom(&self) -> f64 {
        libm::log2(self.limit / self.largest.max(self.lsb))
    }
}

/// All variables of a judged step: states, algebraic variables that are computed on their own, inputs; in the spec's
/// order.
pub fn variables(model: &Model, graph: &StepGraph, judged: &Judged) -> Vec<Variable> {
    let (fixed, scaled) = (&judged.fixed, graph.scaled());
    // Of the values that a variable has in the stages of a step the one that comes closest to its limit speaks for it.
    let measure = |name: &str, kind, unit: &Option<String>, values: &[ValueId]| {
        let of_value = |value: &ValueId| {
            // What reads a value of a shape multiplies it by the factor.
            let scale = scaled.get(value).map_or(1.0, |of| of.factor.abs());
            Variable {
                name: name.to_owned(),
                kind,
                unit: unit.clone(),
                largest: scale * judged.largest[value.index()],
                lsb: libm::scalbn(scale, fixed.exponents[value.index()]),
                limit: scale * libm::scalbn(fixed.format.max_word() as f64, fixed.exponents[value.index()]),
                word_length: None,
                range: None,
                bound: None,
            }
        };
        values.iter().map(of_value).min_by(|a, b| a.headroom().total_cmp(&b.headroom()))
    };
    let [states, algebraics] = values_of(graph, model, &scaled);
    let proven = judged.proof.as_ref().map(|proof| proof.states(graph, &judged.fixed, &judged.largest));
    let mut variables = Vec::new();
    for (index, state) in model.states.iter().enumerate() {
        let kind = if state.motion.is_some() { "signal" } else { "state" };
        let measured = measure(&state.name, kind, &state.unit, &states[index]);
        let word_length = Some(judged.state_errors[index]);
        let (range, bound) = proven.as_ref().map_or((None, None), |proven| (Some(proven[index].0), proven[index].1));
        variables.extend(measured.map(|variable| Variable { word_length, range, bound, ..variable }));
    }
    for (algebraic, values) in model.algebraics.iter().zip(&algebraics) {
        variables.extend(measure(&algebraic.name, "algebraic", &algebraic.unit, values));
    }
    for (input, value) in model.inputs.iter().zip(&graph.inputs) {
        variables.extend(measure(&input.name, "input", &input.unit, &[*value]));
    }
    variables
}

/// All variables of a model with default options, judged over as much from the beginning of its span as costs about so
/// many products per run, and at least one step; with the seconds that this is.
///
/// # Errors
/// Those of the step and of the runs.
pub fn over_beginning(loaded: &LoadedModel, products: u64) -> Result<(Vec<Variable>, f64), Failure> {
    let (point, mapping) = (DesignPoint::default(), MappingOptions::default());
    let mut loaded = loaded.clone();
    let equations = (loaded.model.states.len() + loaded.model.algebraics.len()) as u64;
    // Tables of functions need runs themselves, so the true number of products is not known yet.
    let step = equations * u64::from(loaded.model.solver.stages()) * PRODUCTS_PER_EQUATION;
    let steps = (products / step.max(1)).clamp(1, loaded.model.steps());
    loaded.model.span = loaded.model.span.min(loaded.model.time(steps, 0.0));
    let graph = pipeline::step(&loaded, &point, &mapping, &mut Stopwatch::silent())?;
    let format = point.format(&loaded.model).map_err(Failure::Usage)?;
    let refused = |findings| Failure::Spec(findings, loaded.sources.clone());
    let judged = runs::judge(&loaded.model, &graph, format, &Criteria::default(), silent()).map_err(refused)?;
    Ok((variables(&loaded.model, &graph, &judged), loaded.model.span))
}

/// The values of each state and of each algebraic variable; none of one that was put in place where it is read, as a whole
/// or as a sum with what is `scaled`.
fn values_of(graph: &StepGraph, model: &Model, scaled: &BTreeMap<ValueId, &Scaled>) -> [Vec<Vec<ValueId>>; 2] {
    let mut states = vec![Vec::new(); model.states.len()];
    let mut algebraics = vec![Vec::new(); model.algebraics.len()];
    for (index, value) in graph.values.iter().enumerate() {
        let id = ValueId::new(index as u32);
        match value.role {
            // Behind the states of the model come those that its method keeps.
            Role::State(state) | Role::Stage(state, _) | Role::Next(state) => {
                states.get_mut(state.index()).into_iter().for_each(|values| values.push(id));
            }
            // Behind the algebraic variables of the model come those of its linear systems.
            Role::Algebraic(algebraic, _) if scaled.get(&id).is_none_or(|of| of.beside == (0.0, 0.0)) => {
                algebraics.get_mut(algebraic as usize).into_iter().for_each(|values| values.push(id));
            }
            _ => {}
        }
    }
    [states, algebraics]
}

/// Indices of all variables, the least headroom first.
fn by_headroom(variables: &[Variable]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..variables.len()).collect();
    order.sort_by(|a, b| variables[*a].headroom().total_cmp(&variables[*b].headroom()));
    order
}

/// The variables with the least headroom, as the report has them.
pub fn report(variables: &[Variable]) -> Vec<Headroom> {
    let row = |index: usize| {
        let variable = &variables[index];
        Headroom {
            name: variable.name.clone(),
            kind: variable.kind.to_owned(),
            bits: variable.headroom(),
            largest: variable.largest,
            limit: variable.limit,
        }
    };
    by_headroom(variables).into_iter().take(LISTED).map(row).collect()
}

/// Every variable as JSON, in the spec's order.
pub fn complete(variables: &[Variable]) -> Vec<Value> {
    let row = |variable: &Variable| {
        json!({"name": variable.name, "kind": variable.kind, "unit": variable.unit, "largest": variable.largest,
               "limit": variable.limit, "bits": variable.headroom(), "lsb": variable.lsb,
               "word_length": variable.word_length, "range": variable.range.map(Certainty::name),
               "bound": variable.bound})
    };
    variables.iter().map(row).collect()
}

/// The variables with the least headroom as a table for a terminal, or all of them; the last line counts the rest.
pub fn ranges(variables: &[Variable], all: bool) -> String {
    let shown = if all { variables.len() } else { SHOWN };
    let mut text =
        format!("  {:<24} {:<9} {:>10} {:>10} {:>8} {:>9}\n", "range", "", "largest", "limit", "headroom", "LSB");
    for index in by_headroom(variables).into_iter().take(shown) {
        let variable = &variables[index];
        let Variable { name, kind, largest, limit, lsb, .. } = variable;
        let bits = variable.headroom();
        text += &format!("  {name:<24} {kind:<9} {largest:>10.3e} {limit:>10.3e} {bits:>8.2} {lsb:>9.1e}\n");
    }
    if variables.len() > shown {
        text += &format!("  {} more with more headroom; `--all` shows them\n", variables.len() - shown);
    }
    text
}

/// The table of all variables as CSV.
pub fn table(variables: &[Variable]) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut write = |row: &[String]| writer.write_record(row).expect("writing to memory");
    write(
        &["name", "kind", "unit", "largest", "limit", "headroom_bits", "lsb", "word_length_error", "range", "bound"]
            .map(str::to_owned),
    );
    for variable in variables {
        write(&[
            variable.name.clone(),
            variable.kind.to_owned(),
            variable.unit.clone().unwrap_or_default(),
            format!("{:e}", variable.largest),
            format!("{:e}", variable.limit),
            format!("{:.3}", variable.headroom()),
            format!("{:e}", variable.lsb),
            variable.word_length.map_or(String::new(), |error| format!("{error:e}")),
            variable.range.map_or(String::new(), |range| range.name().to_owned()),
            variable.bound.map_or(String::new(), |bound| format!("{bound:e}")),
        ]);
    }
    String::from_utf8(writer.into_inner().expect("writing to memory")).expect("all cells are text")
}
