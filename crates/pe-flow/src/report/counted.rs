//! Events of a design that is judged by them, in the report.

use std::fmt;

use pe_ir::model::Model;
use pe_judge::runs::{Difference as Measured, Part, Tally};
use pe_judge::total::EventsOfSolution;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::values::Unbounded;

/// Events of the runs, counted.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Events {
    /// Numbers of jumps of states that have a name but for their indices, of those that jump in some run.
    pub counts: Vec<Counts>,
    /// In fixed point, from the same steps in double precision.
    pub fixed: Difference,
    /// With half the step, likewise.
    pub half_step: Difference,
    /// With initial values that differ by one bit of the stored words, likewise.
    pub disturbed: Difference,
    /// In fixed point, from the reference solution; only with `--reference`, as the next two.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_fixed: Option<Difference>,
    /// In double precision, from the reference solution.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_double: Option<Difference>,
    /// The solution by the second method, from that by the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_second: Option<Difference>,
}

/// Numbers of jumps of an array of states over the span.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Counts {
    /// The name.
    pub name: String,
    /// Number of states.
    pub states: usize,
    /// In double precision.
    pub double: u64,
    /// In fixed point.
    pub fixed: u64,
    /// With half the step.
    pub half_step: u64,
    /// With initial values that differ by one bit.
    pub disturbed: u64,
}

/// How far events of a run are from those of another one.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Difference {
    /// End of the first step in which an event comes in one run alone, in seconds; null if there is no such step.
    pub apart_s: Option<f64>,
    /// Largest difference of the numbers over the span, as a part of them.
    pub total: Largest,
    /// Largest difference of the numbers in a window, as a part of the mean number in windows.
    pub window: Largest,
    /// Where that window begins and ends, in seconds.
    pub window_s: [f64; 2],
    /// The state whose numbers of jumps differ most.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub single: Option<Single>,
    /// Largest difference of the mean or the deviation of all states of a name over the span, as a part of their largest magnitude.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub level: Option<Largest>,
}

/// A difference, and what it is made of.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Largest {
    /// The difference.
    pub part: Unbounded,
    /// The name of the states.
    pub name: String,
    /// The number of the run that is compared with.
    pub should: f64,
    /// The number of this run.
    pub is: f64,
}

/// Numbers of jumps of one state.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Single {
    /// The state.
    pub state: String,
    /// In the run that is compared with.
    pub should: u64,
    /// In this run.
    pub is: u64,
}

impl Events {
    /// Events of a design and, where that is known, of the reference solution.
    pub fn of(model: &Model, tally: &Tally, solution: Option<&EventsOfSolution>) -> Events {
        let [fixed, halved, disturbed] = tally.differences();
        let counts = |(number, family): (usize, &pe_judge::runs::Family)| Counts {
            name: family.name.clone(),
            states: family.states.len(),
            double: tally.count(&tally.double, number),
            fixed: tally.count(&tally.fixed, number),
            half_step: tally.count(&tally.halved, number),
            disturbed: tally.count(&tally.disturbed, number),
        };
        let counts = tally.families.iter().enumerate().map(counts);
        let difference = |measured: &Measured| Difference::of(model, tally, measured);
        Events {
            counts: counts.filter(|own| own.double + own.fixed + own.half_step + own.disturbed > 0).collect(),
            fixed: difference(&fixed),
            half_step: difference(&halved),
            disturbed: difference(&disturbed),
            reference_fixed: solution.map(|solution| difference(&solution.fixed)),
            reference_double: solution.map(|solution| difference(&solution.double)),
            reference_second: solution.and_then(|solution| solution.second.as_ref().map(difference)),
        }
    }
}

impl Difference {
    fn of(model: &Model, tally: &Tally, measured: &Measured) -> Difference {
        let largest = |part: &Part| Largest {
            part: part.part.into(),
            name: tally.families.get(part.family).map(|family| family.name.clone()).unwrap_or_default(),
            should: part.of.0,
            is: part.of.1,
        };
        let (window, from, to) = &measured.window;
        let single =
            measured.single.map(|(state, should, is)| Single { state: model.states[state].name.clone(), should, is });
        Difference {
            apart_s: measured.apart,
            total: largest(&measured.total),
            window: largest(window),
            window_s: [*from, *to],
            single,
            level: measured.level.as_ref().map(largest),
        }
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Difference { apart_s, total, window, single, .. } = self;
        match apart_s {
            Some(time) => write!(f, "same steps until {time:.3e} s")?,
            None => write!(f, "same steps")?,
        }
        write!(f, "; numbers {} apart over the span, {} in a window", total.part, window.part)?;
        match single {
            Some(Single { state, should, is }) if should != is => write!(f, "; `{state}` {is} for {should}"),
            _ => Ok(()),
        }
    }
}

impl Events {
    /// Rows of the summary.
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        let Events { fixed, half_step, disturbed, reference_fixed, reference_double, reference_second, .. } = self;
        let own = [("events", fixed), ("with half the step", half_step), ("with one bit moved", disturbed)];
        let of_solution = [
            ("from the reference", reference_fixed),
            ("double from it", reference_double),
            ("its second method", reference_second),
        ];
        let of_solution = of_solution.into_iter().filter_map(|(name, found)| found.as_ref().map(|found| (name, found)));
        own.into_iter().chain(of_solution).map(|(name, difference)| (name, difference.to_string())).collect()
    }
}
