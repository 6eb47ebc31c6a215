//! Exact functions of one variable in a run in double precision. Tables in their place are lookups of [`crate::tiles`].

use pe_ir::functions::ScalarFunction;
use pe_ir::graph::{Chain, StepGraph};
use pe_ir::index::at;

/// What a run needs to know of the step's functions.
///
/// Chains that apply a function are of classes of their own, so that tiles of plain sums stay what they are.
pub(crate) struct FunctionRun {
    functions: Vec<ScalarFunction>,
    /// By slot, smallest and largest argument of the function that computes its value.
    pub arguments: Vec<(f64, f64)>,
    /// Slot, function and argument where a function had no value.
    pub outside: Option<(u32, u32, f64)>,
    /// Slots whose functions took a limit in the place of 0/0, and the argument of the first time.
    pub limits: Vec<(u32, f64)>,
}

/// The range of no argument.
const NONE: (f64, f64) = (f64::INFINITY, f64::NEG_INFINITY);

impl FunctionRun {
    pub fn new(graph: &StepGraph, slots: usize) -> FunctionRun {
        let functions = graph.functions.exact.clone();
        let arguments = vec![NONE; if functions.is_empty() { 0 } else { slots }];
        FunctionRun { functions, arguments, outside: None, limits: Vec::new() }
    }

    /// The class of a chain: zero for plain sums.
    pub fn class(chain: &Chain) -> u32 {
        chain.function.map_or(0, |function| function + 1)
    }

    /// Applies the function of a class to the sums of a tile; `target` gives the slot of a lane.
    pub fn apply(&mut self, class: u32, numbers: &mut [f64], target: impl Fn(usize) -> u32) {
        let function = &self.functions[at(class) - 1];
        for (lane, number) in numbers.iter_mut().enumerate() {
            let (argument, slot) = (*number, target(lane));
            let (low, high) = &mut self.arguments[at(slot)];
            *low = low.min(argument);
            *high = high.max(argument);
            let (value, is_limit) = function.evaluate_noting(argument);
            *number = value;
            if is_limit && self.limits.iter().all(|(known, _)| *known != slot) {
                self.limits.push((slot, argument));
            }
            if !number.is_finite() && argument.is_finite() && self.outside.is_none() {
                self.outside = Some((slot, class - 1, argument));
            }
        }
    }

    /// Smallest and largest argument of the function that computes the value of a slot.
    pub fn argument(&self, slot: u32) -> (f64, f64) {
        self.arguments.get(at(slot)).copied().unwrap_or(NONE)
    }
}
