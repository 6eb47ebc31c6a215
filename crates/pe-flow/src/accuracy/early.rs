//! Lists of steps that a search tries: short ones where the solution begins, longer ones behind them.

use pe_ir::model::{Model, Solver};

use crate::explore::row::Row;
use pe_judge::early::Early;

/// How much longer the last step is, and the part of the span that the beginning is, as divisors.
const LONGER: [f64; 3] = [4.0, 16.0, 64.0];
const PARTS: [f64; 5] = [4.0, 16.0, 64.0, 256.0, 1024.0];

/// The same of a further step behind a list.
const FURTHER: [f64; 2] = [4.0, 16.0];

/// Last steps in the span, at least; where there are many, their number is a multiple of this one, so that a longer
/// step finds room.
const FEWEST_STEPS: f64 = 10.0;
const MULTIPLE: f64 = 16.0;

/// Part of a step by which a time may miss a whole number of steps.
const SLACK: f64 = 1e-9;

/// A numerical method with its steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Method {
    /// The solver.
    pub solver: Solver,
    /// The step in seconds, or the last one.
    pub step: f64,
    /// Those for the beginning.
    pub early: Option<Early>,
}

impl Method {
    /// That of a row.
    pub fn of(row: &Row) -> Option<Method> {
        let (solver, step) = row.point.solver.zip(row.point.step)?;
        Some(Method { solver, step, early: row.point.early_steps })
    }

    /// Steps over the span of a model.
    pub fn steps(&self, model: &Model) -> f64 {
        match self.early {
            Some(early) => early.count(model.span, self.step),
            None => model.steps() as f64 * model.step / self.step,
        }
    }
}

/// Lists of two steps: about that of a method in the beginning, and one that is `scale` times 4, 16 or 64 times as
/// long; `suitable` gives the longest step up to one that goes with span and outputs. The beginning ends with a step of
/// the last length, so that all of these fall where they would without it.
pub fn single(method: Method, span: f64, scale: f64, suitable: impl Fn(f64) -> Option<f64>) -> Vec<Method> {
    let mut lists = Vec::new();
    for ratio in LONGER.map(|ratio| scale * ratio) {
        let count = span / (ratio * method.step);
        let rounded =
            if count > MULTIPLE { span / (libm::ceil(count / MULTIPLE) * MULTIPLE) } else { ratio * method.step };
        let Some(last) = suitable(rounded).filter(|last| span / last >= FEWEST_STEPS) else { continue };
        lists.extend(endings(span, last, 0.0).map(|until| Method {
            step: last,
            early: Early::new(&[(last / ratio, until)]),
            ..method
        }));
    }
    lists
}

/// Lists with one step more than that of a method, behind it.
pub fn longer(method: Method, span: f64, suitable: impl Fn(f64) -> Option<f64>) -> Vec<Method> {
    let Some(early) = method.early else { return Vec::new() };
    let begun = early.list().last().map_or(0.0, |(_, until)| *until);
    let mut lists = Vec::new();
    for ratio in FURTHER {
        let last = ratio * method.step;
        let fits = suitable(last).is_some_and(|step| (step - last).abs() <= SLACK * last);
        if !fits || span / last < FEWEST_STEPS {
            continue;
        }
        lists.extend(endings(span, last, begun).filter_map(|until| {
            let list: Vec<(f64, f64)> = early.list().iter().copied().chain([(method.step, until)]).collect();
            Some(Method { step: last, early: Some(Early::new(&list)?), ..method })
        }));
    }
    lists
}

/// Times at which a beginning may end, in steps of the last length, each once, after another time.
fn endings(span: f64, last: f64, after: f64) -> impl Iterator<Item = f64> {
    let mut counts: Vec<u64> = PARTS.iter().map(|part| libm::ceil(span / part / last) as u64).collect();
    counts.dedup();
    counts.into_iter().map(move |count| count as f64 * last).filter(move |until| *until > after + 0.5 * last)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_list_divides_the_span_and_its_own_times() {
        let method = Method { solver: Solver::Rodas3, step: 1e-3, early: None };
        let whole = |time: f64, step: f64| (time / step - libm::round(time / step)).abs() < 1e-6;
        let suitable = |step: f64| Some(40.0 / libm::ceil(40.0 / step - 1e-9));
        let lists = single(method, 40.0, 1.0, suitable);
        assert!(lists.len() > 8);
        let further: Vec<Method> = lists.iter().flat_map(|list| longer(*list, 40.0, suitable)).collect();
        assert!(!further.is_empty());
        for list in lists.iter().chain(&further) {
            let mut from = 0.0;
            for (step, until) in list.early.expect("a list").list() {
                assert!(whole(until - from, *step) && *until < 40.0 && *until > from, "{list:?}");
                from = *until;
            }
            assert!(whole(40.0 - from, list.step), "{list:?}");
        }
    }
}
