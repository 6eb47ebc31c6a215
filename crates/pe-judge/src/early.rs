//! Other steps for the beginning of a run, as given by an option.

use std::fmt;

use pe_ir::model::Model;

use crate::parse::duration;

/// Steps for the beginning, at most.
const MOST: usize = 4;

/// Part of a step by which a time may miss a whole number of steps.
const SLACK: f64 = 1e-6;

/// Steps for the beginning of a run: each with the time until which it is taken, both in seconds, ascending.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Early {
    steps: [(f64, f64); MOST],
    count: usize,
}

impl Early {
    /// A list; none if it is empty or too long.
    pub fn new(list: &[(f64, f64)]) -> Option<Early> {
        let mut steps = [(0.0, 0.0); MOST];
        steps.get_mut(..list.len()).filter(|steps| !steps.is_empty())?.copy_from_slice(list);
        Some(Early { steps, count: list.len() })
    }

    /// The steps, each with the time until which it is taken.
    pub fn list(&self) -> &[(f64, f64)] {
        &self.steps[..self.count]
    }

    /// Steps over a span whose other steps are `step` long.
    pub fn count(&self, span: f64, step: f64) -> f64 {
        let mut from = 0.0;
        let early = self.list().iter().map(|(step, until)| {
            let count = (until - from) / step;
            from = *until;
            count
        });
        early.sum::<f64>() + (span - self.list().last().map_or(0.0, |(_, until)| *until)) / step
    }

    /// Puts them in the place of those that a model has.
    ///
    /// # Errors
    /// If a time is not within the span, not after the one before, or no whole number of steps; of a model whose steps are equal.
    pub fn apply(&self, model: &mut Model) -> Result<(), String> {
        if model.has_equal_steps() {
            return Err("`--early-steps`: a model with events or delays takes a single step".to_owned());
        }
        let mut from = 0.0;
        for (step, until) in self.list() {
            let steps = (until - from) / step;
            let whole = (steps - libm::round(steps)).abs() <= SLACK * steps;
            if !(*until > from && *until < model.span && whole) {
                let message = format!(
                    "`--early-steps`: the phase from {from} s to {until} s is {steps} steps of {step} s; it must be a whole \
                     number of them, and end before the span of {} s",
                    model.span
                );
                return Err(message);
            }
            from = *until;
        }
        model.set_early_steps(self.list());
        Ok(())
    }
}

impl fmt::Display for Early {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        for (place, (step, until)) in self.list().iter().enumerate() {
            write!(formatter, "{}{step:e}@{until:e}", if place == 0 { "" } else { "," })?;
        }
        Ok(())
    }
}

/// Parses steps and the times until which they are taken: `0.5ms@40ms,20ms@0.4s`.
///
/// # Errors
/// What was expected.
pub fn parse(text: &str) -> Result<Early, String> {
    let one = |part: &str| -> Option<(f64, f64)> {
        let (step, until) = part.split_once('@')?;
        Some((duration(step).ok()?, duration(until).ok()?))
    };
    let list: Option<Vec<(f64, f64)>> = text.split(',').map(one).collect();
    let expected =
        || format!("expected up to {MOST} steps and the times until which they are taken, `0.5ms@40ms,20ms@0.4s`");
    list.and_then(|list| Early::new(&list)).ok_or_else(expected)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_is_read_as_it_is_written() {
        let early = parse("0.5ms@40ms,20ms@0.4s").expect("two steps");
        assert_eq!(early.list(), [(5e-4, 4e-2), (2e-2, 0.4)]);
        assert_eq!(parse(&early.to_string()), Ok(early));
        assert!((early.count(40.0, 0.2) - (80.0 + 18.0 + 198.0)).abs() < 1e-9);
        for wrong in ["", "1ms", "1ms@", "1ms@2ms,1ms@3ms,1ms@4ms,1ms@5ms,1ms@6ms"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
