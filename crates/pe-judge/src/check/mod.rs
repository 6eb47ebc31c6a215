//! `check`: is the step stable and good enough, why, and what would be cheaper or safer?
//!
//! The verdict comes from runs of the step graph (`runs`); the eigenvalues of the model along a trusted trajectory
//! explain it (`prediction`), trials with other steps confirm it (`trials`), and what is proposed has been tried
//! (`remedies`). See `docs/decisions/0027-check.md`.

mod answer;
mod branches;
mod causes;
mod closures;
mod contradiction;
mod course;
mod findings;
mod losses;
mod observed;
mod prediction;
mod question;
mod remedies;
mod rest;
pub mod sampled;
pub mod stiffness;
mod swinging;
mod trials;
mod trusted;

use pe_ir::codes;
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;

use crate::runs::{self, Judged};

use self::trials::Trials;
use self::trusted::Trusted;

pub use self::answer::Check;
pub use self::contradiction::contradiction;
pub use self::findings::factor;
pub use self::observed::{Chaos, DeadBand, StepGrowth};
pub use self::prediction::{Prediction, eigenvalue};
pub use self::question::{ACCURACY, JUDGED_STATES, Question, SAFE, TRIED_STATES};
pub use self::rest::{Rest, Ringing};
pub use self::swinging::{Swing, swings};
pub use self::trials::{Accuracy, Found};

/// Refusals that the check can explain.
pub const EXPLAINED: [&str; 10] = [
    codes::DIVERGED,
    codes::SATURATED,
    codes::STEP_TOO_LARGE,
    codes::SMALL_PIVOT,
    codes::WORD_TOO_SHORT,
    codes::OUTSIDE_DOMAIN,
    codes::NO_FORMAT,
    codes::INPUT_UNSEEN,
    codes::INPUT_ALIASED,
    codes::PULSE_MISSED,
];

/// Findings of the check alone; others come from the runs.
const OWN: [&str; 16] = [
    codes::BRANCH_LEFT,
    codes::CONTRADICTION,
    codes::COMES_APART,
    codes::CLOSURES_OPEN,
    codes::CHATTERING,
    codes::QUOTIENT_SHORT,
    codes::LIMIT_TAKEN,
    codes::NEAR_LIMIT,
    codes::METHOD_GROWTH,
    codes::DEAD_BAND,
    codes::CHAOTIC,
    codes::STEP_SPAN,
    codes::STILL,
    codes::POLE,
    codes::POLE_MOVED,
    codes::RINGING,
];

impl Check {
    /// Judges a step whose runs succeeded.
    pub fn of_judged(question: &Question, judged: &Judged) -> Check {
        let model = question.model;
        let trusted = Trusted::of(model, Some((question.graph, judged)));
        let trials = Trials::new(model, &trusted);
        let mut check = Check::explain(question, &trusted, &trials);
        let stable = check.found.map(|found| found.stable);
        check.accuracy =
            question.goal.and_then(|goal| trials.accuracy_step(question.graph, judged.errors.method, goal, stable));
        check.stable = check.stable();
        check.stiffness_ratio = check.ratio(model, question.goal);
        check.growth = observed::step_growth(model, question.graph, &judged.fixed, &trusted);
        check.swing = swinging::swing(model, question.graph, &judged.fixed, &observed::scales(&trusted));
        check.pivot = judged.smallest_pivot.clone();
        check.dead_bands = observed::dead_bands(model, question.graph, &judged.fixed, &trusted);
        check.rest = rest::rest(model, question.graph, judged);
        if question.goal.is_some() && observed::may_be_sensitive(model, question.graph, judged, &trusted) {
            check.chaos = observed::sensitivity(model, question.graph, &trusted)
                .and_then(|found| observed::chaos(question.graph, Some(&judged.fixed), &trusted, found));
        }
        check.findings = check.warnings(question, judged, &trusted, &trials);
        check
    }

    /// Explains why the runs of a step were refused.
    pub fn of_refused(question: &Question, refusals: Vec<Diagnostic>) -> Check {
        let model = question.model;
        let trusted = Trusted::of(model, None);
        let trials = Trials::new(model, &trusted);
        let mut check = Check::explain(question, &trusted, &trials);
        if refusals.iter().any(|refusal| refusal.code == codes::STEP_TOO_LARGE) {
            let sensitivity = observed::refused_sensitivity(model, question.graph, &trusted);
            check.chaos = sensitivity.and_then(|found| observed::chaos(question.graph, None, &trusted, found));
            check.parted = sensitivity.and_then(|sensitivity| sensitivity.parted);
        }
        check.findings =
            refusals.into_iter().map(|refusal| check.explained(question, refusal, &trusted, &trials)).collect();
        let short = [codes::SATURATED, codes::WORD_TOO_SHORT, codes::NO_FORMAT];
        if check.findings.iter().any(|finding| short.contains(&finding.code)) {
            check.findings.extend(losses::findings(question));
        }
        check.findings.extend(runs::outside(model));
        check.findings.extend(findings::of_span(model));
        check
    }

    /// Findings that the runs did not give: warnings, and refusals of a step whose runs succeeded.
    pub fn own_findings(&self) -> Vec<Diagnostic> {
        self.findings.iter().filter(|finding| OWN.contains(&finding.code)).cloned().collect()
    }

    /// Refusals of a model whose step has no tables, with what they really come from.
    pub fn of_unbuilt(model: &Model, refusals: Vec<Diagnostic>) -> Vec<Diagnostic> {
        let symptoms = [codes::DIVERGED, codes::OUTSIDE_DOMAIN, codes::SMALL_PIVOT];
        if model.states.len() > TRIED_STATES || !refusals.iter().any(|refusal| symptoms.contains(&refusal.code)) {
            return refusals;
        }
        let trusted = Trusted::of(model, None);
        if let Some((time, state)) = causes::end_of_solution(model, &trusted, &refusals) {
            return vec![findings::solution_ends(model, StateId::at(state), time)];
        }
        let prediction = Prediction::of(model, &trusted);
        let found =
            prediction.limit.as_ref().and_then(|limit| Trials::new(model, &trusted).limit(model.solver, limit.step));
        let certain = found.is_some_and(|found| found.unstable.is_some_and(|step| step <= model.step));
        let explained = |refusal: Diagnostic| {
            let unstable = causes::unstable(model, &prediction, &refusal).filter(|_| certain);
            unstable.unwrap_or(refusal)
        };
        refusals.into_iter().map(explained).collect()
    }

    /// The stable step.
    fn stable(&self) -> Option<f64> {
        let predicted = self.prediction.limit.as_ref().map(|limit| limit.step);
        match self.found {
            // Trials that met no end, say at the period of a sampled part, are a lower bound.
            Some(Found { stable, unstable: None, .. }) => Some(predicted?.max(stable)),
            Some(found) => Some(found.stable),
            None => predicted,
        }
    }

    /// The accuracy step over the stable one.
    fn ratio(&self, model: &Model, goal: Option<f64>) -> Option<f64> {
        let Accuracy { step, error, .. } = self.accuracy?;
        Some(stiffness::ratio(self.stable?, (step, error), goal?, model.solver))
    }

    fn explain(question: &Question, trusted: &Trusted, trials: &Trials) -> Check {
        let model = question.model;
        let prediction = Prediction::of(model, trusted);
        let guess = prediction.limit.as_ref().map_or(model.step, |limit| limit.step);
        let tried = model.states.len() <= TRIED_STATES;
        let found = if tried { trials.limit(model.solver, guess) } else { None };
        Check {
            prediction,
            own_trajectory: trusted.own,
            found,
            accuracy: None,
            stable: None,
            stiffness_ratio: None,
            growth: None,
            swing: None,
            pivot: None,
            dead_bands: Vec::new(),
            rest: None,
            chaos: None,
            parted: None,
            findings: Vec::new(),
        }
    }
}
