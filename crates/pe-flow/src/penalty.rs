//! Penalties of a mechanism that are too small for the step, or too large for the word: others are tried.

use std::sync::Arc;

use pe_ir::codes;
use pe_ir::mechanism::Mechanism;
use pe_ir::model::Solver;
use pe_ir::source::{Diagnostic, Severity};
use pe_judge::DesignPoint;

use crate::pipeline;
use crate::settings::Settings;
use crate::spec::LoadedModel;
use crate::watch::Stopwatch;

/// Penalties that are tried, in times of the one that is refused, or parts of it.
const FACTORS: [f64; 3] = [10.0, 100.0, 1000.0];

/// Error of the method, and of the word, with which another penalty is a cure.
const ERROR: f64 = 0.05;

/// What a refusal means where another penalty is not refused: the implicit step of a mechanism lags behind closures
/// that the penalty hardly feels, and a word that holds a large penalty has few bits for the masses beside it. None
/// where another penalty is no cure, or where none can be tried.
pub fn explained(
    loaded: &LoadedModel,
    settings: &Settings,
    point: &DesignPoint,
    refusals: &[Diagnostic],
) -> Option<Diagnostic> {
    let mechanism = loaded.model.mechanism.as_ref()?;
    if loaded.model.solver != Solver::Trapezoidal || loaded.stages.is_some() {
        return None;
    }
    let refusal = refusals.iter().find(|finding| finding.severity == Severity::Error)?;
    let small = match refusal.code {
        codes::DIVERGED | codes::STEP_TOO_LARGE | codes::OUTSIDE_DOMAIN => true,
        codes::SATURATED | codes::WORD_TOO_SHORT | codes::NO_FORMAT | codes::ACCUMULATOR => false,
        _ => return None,
    };
    FACTORS.into_iter().find_map(|factor| {
        let penalty = if small { factor * mechanism.penalty } else { mechanism.penalty / factor };
        let mut other = loaded.clone();
        other.model.mechanism = Some(Arc::new(Mechanism { penalty, ..(**mechanism).clone() }));
        let prepared = pipeline::prepare(&other, settings, point, &mut Stopwatch::silent()).ok()?;
        let errors = prepared.judged.errors;
        (errors.method <= ERROR && errors.word_length <= ERROR).then(|| {
            let (code, why) = match small {
                true => (codes::PENALTY_SMALL, "too small for this step"),
                false => (codes::PENALTY_LARGE, "too large for this word"),
            };
            let message = format!("the penalty of {} is {why}: {}", mechanism.penalty, refusal.message);
            let velocity = &loaded.model.states[mechanism.pairs[0].1].name;
            let help = format!(
                "`--set {}.penalty={penalty}` works (tried): method error {:.1e}, word-length error {:.1e}",
                velocity.split('[').next().unwrap_or(velocity),
                errors.method,
                errors.word_length
            );
            Diagnostic::error(code, mechanism.span, message).with_help(help)
        })
    })
}
