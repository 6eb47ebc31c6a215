//! Penalties of a mechanism that are too small for the step, or too large for the word: others are tried.

use pe_ir::codes;
use pe_ir::model::Solver;
use pe_ir::source::{Diagnostic, Severity};
use pe_judge::DesignPoint;
use pe_judge::check::{contradiction, swings};
use pe_judge::residuals::Residuals;

use crate::pipeline;
use crate::settings::Settings;
use crate::spec::LoadedModel;
use crate::watch::Stopwatch;

/// Penalties that are tried, in times of the one that is refused, or parts of it.
const FACTORS: [f64; 3] = [10.0, 100.0, 1000.0];

/// Error of the method, and of the word, with which another penalty is a cure.
const ERROR: f64 = 0.05;

/// Refusals that closures may be the cause of that no position closes.
const HELD: [&str; 9] = [
    codes::DIVERGED,
    codes::STEP_TOO_LARGE,
    codes::OUTSIDE_DOMAIN,
    codes::COMES_APART,
    codes::SATURATED,
    codes::WORD_TOO_SHORT,
    codes::NO_FORMAT,
    codes::ACCUMULATOR,
    codes::ZERO_PIVOT,
];

/// What refusals mean where another penalty is not refused, in their place: the implicit step of a mechanism lags behind
/// closures that the penalty hardly feels, and a word that holds a large penalty has few bits for the masses beside it; a mechanism
/// that comes apart is told the penalty that holds it. None where another penalty is no cure, or where none can be tried: `other`
/// gives the model with another one.
pub fn explained(
    loaded: &LoadedModel,
    settings: &Settings,
    point: &DesignPoint,
    refusals: &[Diagnostic],
    other: &dyn Fn(&str, f64) -> Option<LoadedModel>,
) -> Option<Diagnostic> {
    let mechanism = loaded.model.mechanism.as_ref().filter(|_| loaded.stages.is_none())?;
    let refusal = refusals.iter().find(|finding| finding.severity == Severity::Error)?;
    // No penalty holds what cannot be held.
    if let Some(found) = Some(()).filter(|()| HELD.contains(&refusal.code)).and_then(|()| contradiction(&loaded.model))
    {
        return Some(found);
    }
    let implicit = loaded.model.solver == Solver::Trapezoidal;
    // Whether a larger one may help, what is likelier first.
    let smalls: &[bool] = match refusal.code {
        // Where accelerations close loops, the step lags behind nothing.
        codes::DIVERGED | codes::STEP_TOO_LARGE | codes::OUTSIDE_DOMAIN => implicit.then_some(&[true])?,
        codes::COMES_APART => &[true],
        // What rounding excites may swing itself up to the ends of all ranges.
        codes::SATURATED | codes::NO_FORMAT if implicit => &[false, true],
        codes::SATURATED | codes::WORD_TOO_SHORT | codes::NO_FORMAT | codes::ACCUMULATOR => &[false],
        _ => return None,
    };
    let velocity = &loaded.model.states[mechanism.pairs[0].1].name;
    let name = format!("{}.penalty", velocity.split('[').next().unwrap_or(velocity));
    let all = smalls.iter().flat_map(|small| FACTORS.map(|factor| (*small, factor)));
    all.into_iter().find_map(|(small, factor)| {
        let penalty = if small { factor * mechanism.penalty } else { mechanism.penalty / factor };
        let other = other(&name, penalty)?;
        let prepared = pipeline::prepare(&other, settings, point, &mut Stopwatch::silent()).ok()?;
        let errors = prepared.judged.errors;
        let held = || Residuals::of(&other.model, &prepared.graph, &prepared.judged.fixed, &[])?.finding(&other.model);
        if errors.method > ERROR || errors.word_length > ERROR || held().is_some() {
            return None;
        }
        let help = format!(
            "`--set {name}={penalty}` works (tried): method error {:.1e}, word-length error {:.1e}",
            errors.method, errors.word_length
        );
        let (code, why) = match (refusal.code, small) {
            (codes::COMES_APART, _) => return Some(refusal.clone().with_help(help)),
            (_, true) => (codes::PENALTY_SMALL, "too small for this step"),
            (_, false) => (codes::PENALTY_LARGE, "too large for this word"),
        };
        // Causes before symptoms.
        let swings = if small { swings(&loaded.model) } else { None };
        let what = swings.unwrap_or_else(|| refusal.message.clone());
        let message = format!("the penalty of {} is {why}: {what}", mechanism.penalty);
        Some(Diagnostic::error(code, mechanism.span, message).with_help(help))
    })
}
