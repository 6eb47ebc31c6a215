//! Findings from what the check found.

use pe_ir::codes;
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;
use pe_sim::linear::is_affine;

use super::answer::Check;
use super::branches;
use super::causes;
use super::contradiction::contradiction;
use super::course;
use super::losses;
use super::observed;
use super::prediction::{Basis, eigenvalue};
use super::question::{Question, SAFE, rounded};
use super::remedies::{self, Remedy};
use super::sampled;
use super::swinging;
use super::trials::Trials;
use super::trusted::Trusted;
use crate::residuals::Residuals;
use crate::runs::Judged;

/// Part of the largest stable step, found by trial, above which a step is near the limit.
const NEAR: f64 = 0.9;

/// Natural logarithm of the growth over the span from which on it is told: by a tenth.
const GROWTH: f64 = 0.1;

/// Excess of one step's growth with rounded coefficients, over the span, from which on it is told.
const ROUNDED_GROWTH: f64 = 0.1;

/// Part of a step by which a span may miss a whole number of them: rounding.
const SPAN_ROUNDING: f64 = 1e-6;

/// Whether the span is a whole number of steps; a warning if not.
pub fn of_span(model: &Model) -> Option<Diagnostic> {
    let end = model.time(model.steps(), 0.0);
    let over = (model.span - end) / model.step;
    let steps = model.steps() as f64 + over;
    if over.abs() <= SPAN_ROUNDING * steps.clamp(1.0, 1e3) {
        return None;
    }
    let message =
        format!("the span of {} s is {steps:.3} steps of {:e} s; it was judged to t = {end} s", model.span, model.step);
    let count = libm::ceil(steps);
    let help = match model.rates.is_empty() {
        true => format!("take `--span {end}`, or `--step {}/{count}`", model.span),
        false => format!("take `--span {end}`"),
    };
    Some(Diagnostic::global(codes::STEP_SPAN, message).with_help(help).into_warning())
}

impl Check {
    /// Warnings about a step whose runs succeeded, those of the runs first.
    pub(super) fn warnings(
        &self,
        question: &Question,
        judged: &Judged,
        trusted: &Trusted,
        trials: &Trials,
    ) -> Vec<Diagnostic> {
        let model = question.model;
        let mut findings = judged.warnings.clone();
        findings.extend(self.near_limit(model).or_else(|| self.unseen_instability(model, trusted)));
        findings.extend(self.growing(model));
        findings.extend(self.rounded_growth(model));
        findings.extend(self.poles(question, trusted));
        findings.extend(self.ringing(question, judged));
        // Looked for once, and for those that are about the step.
        if findings.iter().any(is_about_step) {
            let remedy = remedies::for_step(model, trials, &self.prediction, question.point, &question.format, true);
            findings = findings.into_iter().map(|finding| with_remedy(finding, &remedy)).collect();
        }
        if findings.iter().any(|finding| finding.code == codes::WORD_SHORT) {
            let remedy = remedies::for_word(question);
            let about_word = |finding: Diagnostic| match &remedy {
                Some(remedy) if finding.code == codes::WORD_SHORT => add_help(finding, &remedy.text()),
                _ => finding,
            };
            findings = findings.into_iter().map(about_word).collect();
            findings.extend(losses::findings(question));
        }
        findings.extend(self.dead_band(model));
        let (scales, worst) = (observed::scales(trusted), judged.errors.method.max(judged.errors.word_length));
        if let Some(swing) = swinging::finding(model, question.graph, self.swing.as_ref(), &scales, worst) {
            // What the step makes of differences is no chaos.
            findings.retain(|finding| finding.code != codes::CHAOTIC);
            findings.extend(question.criteria.permit(vec![swing]).unwrap_or_else(|refused| refused));
        }
        let open = Residuals::of(model, question.graph, &judged.fixed, &[]).and_then(|of| of.finding(model));
        findings.extend(open.map(|open| contradiction(model).unwrap_or(open)));
        let left = branches::finding(question, judged).map(|left| question.criteria.permit(vec![left]));
        findings.extend(left.into_iter().flat_map(|left| left.unwrap_or_else(|refused| refused)));
        if findings.iter().all(|finding| finding.code != codes::CHAOTIC) {
            findings.extend(self.chaotic(model));
        }
        findings.extend(course::findings(model, question.graph));
        findings.extend(of_span(model));
        if observed::is_still(model, trusted) {
            let message = "no state moves: all derivatives are zero over the whole span".to_owned();
            let help = "check the initial values, the inputs and the parameters";
            findings.push(Diagnostic::global(codes::STILL, message).with_help(help).into_warning());
        }
        findings
    }

    /// The step is close to where runs leave the solution.
    fn near_limit(&self, model: &Model) -> Option<Diagnostic> {
        let found = self.found.filter(|found| found.unstable.is_some() && model.step > NEAR * found.stable)?;
        let state = self.prediction.limit.as_ref().map_or(StateId::new(0), |limit| limit.state);
        let message = format!(
            "the step of {:e} s is {:.2} of the largest stable one, {:.2e} s; `{}` would diverge first",
            model.step,
            model.step / found.stable,
            found.stable,
            model.states[state].name
        );
        let safe = rounded(SAFE * found.stable);
        let help = match model.suitable_step(safe) {
            Some(step) => format!("try `--step {step:e}`"),
            None => "take a smaller step".to_owned(),
        };
        Some(Diagnostic::error(codes::NEAR_LIMIT, model.states[state].span, message).with_help(help).into_warning())
    }

    /// The step is unstable, and the run does not show it, for it does not excite the mode.
    fn unseen_instability(&self, model: &Model, trusted: &Trusted) -> Option<Diagnostic> {
        let limit = self.prediction.limit.as_ref().filter(|limit| model.step > causes::BEYOND * limit.step)?;
        let certain = self.prediction.basis == Basis::All && (is_affine(model) || observed::is_still(model, trusted));
        if !certain || !model.rates.is_empty() || !model.phases.is_empty() {
            return None;
        }
        let state = &model.states[limit.state];
        let message = format!(
            "the step of {:e} s is unstable, {:.2} of the largest stable one, {:.2e} s by eigenvalues: this run does not excite the \
             mode of `{}`, but any disturbance of it grows",
            model.step,
            model.step / limit.step,
            limit.step,
            state.name
        );
        let help = format!("try `--step {:e}`", rounded(SAFE * limit.step));
        Some(Diagnostic::error(codes::NEAR_LIMIT, state.span, message).with_help(help).into_warning())
    }

    /// The method lets modes grow that the model does not.
    fn growing(&self, model: &Model) -> Option<Diagnostic> {
        if self.prediction.growth < GROWTH {
            return None;
        }
        let message = format!(
            "{} lets undamped oscillations grow {} over the span",
            model.solver.title(),
            factor(self.prediction.growth)
        );
        let finding = Diagnostic::global(codes::METHOD_GROWTH, message)
            .with_help("take a method whose stability region holds a part of the imaginary axis, such as rk4");
        Some(finding.into_warning())
    }

    /// Rounded coefficients let the step grow.
    fn rounded_growth(&self, model: &Model) -> Option<Diagnostic> {
        let growth = self.growth.as_ref().filter(|growth| growth.exact() <= 1.0 + 1e-12 && model.rates.is_empty())?;
        let over_span = libm::log(growth.rounded()) * model.steps() as f64;
        if over_span < ROUNDED_GROWTH {
            return None;
        }
        let message = format!(
            "rounded coefficients let the solution grow {} over the span: a step multiplies it by {:.9}, not {:.9}",
            factor(over_span),
            growth.rounded(),
            growth.exact()
        );
        let help = "take a wider coefficient port, the second number in `--multiplier AxB`";
        Some(Diagnostic::global(codes::METHOD_GROWTH, message).with_help(help).into_warning())
    }

    /// Poles of a model with sampled parts that lie outside of the unit circle, or that rounding moves there.
    fn poles(&self, question: &Question, trusted: &Trusted) -> Option<Diagnostic> {
        let finding = sampled::poles(question.model, self.growth.as_ref())?;
        if finding.code != codes::POLE_MOVED {
            return Some(finding);
        }
        let refusal = with_help_of(finding, &remedies::for_poles(question, trusted));
        question.criteria.permit(vec![refusal]).unwrap_or_else(|refused| refused).into_iter().next()
    }

    /// A sampled part that does not come to rest without inputs.
    fn ringing(&self, question: &Question, judged: &Judged) -> Option<Diagnostic> {
        let finding = sampled::ringing(question.model, self.rest.as_ref())?;
        Some(with_help_of(finding, &remedies::for_rest(question, judged)))
    }

    /// States that lose increments.
    fn dead_band(&self, model: &Model) -> Option<Diagnostic> {
        let worst = self.dead_bands.first()?;
        let state = &model.states[worst.state];
        let more = self.dead_bands.len() - 1;
        let others = if more == 0 { String::new() } else { format!("; so do {more} others") };
        let message = format!(
            "`{}` loses {:.1e} of its largest magnitude from t = {:.3e} s on: its increments are below one LSB for {:.0} % of the run{others}",
            state.name,
            worst.loss,
            worst.time,
            100.0 * worst.part
        );
        let help = "take more `--storage` bits, a larger step, or a narrower stated range";
        Some(Diagnostic::error(codes::DEAD_BAND, state.span, message).with_help(help).into_warning())
    }

    /// The model is chaotic over a span that is longer than the word can follow.
    fn chaotic(&self, model: &Model) -> Option<Diagnostic> {
        let chaos = self.chaos.filter(|chaos| chaos.divergence < model.span)?;
        let message = format!(
            "the model is chaotic: a difference of one LSB grows by e every {:.2e} s, so that values mean nothing after t = {:.3e} s",
            1.0 / chaos.rate,
            chaos.divergence
        );
        let help = format!("judge it over `--span {:e}`, or by averages only", rounded(chaos.divergence));
        Some(Diagnostic::global(codes::CHAOTIC, message).with_help(help).into_warning())
    }

    /// A refusal of the runs with what explains it and with what helps.
    pub(super) fn explained(
        &self,
        question: &Question,
        refusal: Diagnostic,
        trusted: &Trusted,
        trials: &Trials,
    ) -> Diagnostic {
        let model = question.model;
        if let Some((time, state)) = Some(())
            .filter(|()| causes::is_symptom(&refusal))
            .and_then(|()| causes::end_of_solution(model, trusted, std::slice::from_ref(&refusal)))
        {
            return solution_ends(model, StateId::at(state), time);
        }
        if let Some(left) =
            Some(()).filter(|()| refusal.code == codes::STEP_TOO_LARGE).and_then(|()| branches::refused(model))
        {
            return left;
        }
        let certain = is_affine(model)
            || observed::is_still(model, trusted)
            || self.found.is_some_and(|found| found.unstable.is_some_and(|step| step <= model.step));
        // What grew beyond all numbers is told as such, with the limit.
        let grew = refusal.code == codes::DIVERGED;
        let unstable = causes::unstable(model, &self.prediction, &refusal).filter(|_| certain && !grew);
        if let Some(finding) = unstable {
            return self.with_limit(question, finding, trials);
        }
        if let Some(finding) = causes::near_singular(model, question.graph, &refusal) {
            return self.with_limit(question, finding, trials);
        }
        match refusal.code {
            codes::DIVERGED => self.with_limit(question, refusal, trials),
            codes::STEP_TOO_LARGE | codes::SMALL_PIVOT => self.with_limit(question, refusal, trials),
            codes::SATURATED | codes::WORD_TOO_SHORT => {
                let remedy = remedies::for_word(question);
                with_help_of(refusal, &remedy)
            }
            _ => refusal,
        }
    }

    /// Adds the largest stable step and the cheapest remedy.
    fn with_limit(&self, question: &Question, refusal: Diagnostic, trials: &Trials) -> Diagnostic {
        let model = question.model;
        // A span that is not shorter is no advice.
        let chaos = self.chaos.filter(|chaos| 0.5 * chaos.divergence < model.span);
        if let Some(chaos) = chaos.filter(|_| refusal.code == codes::STEP_TOO_LARGE) {
            let help = format!(
                "the model is chaotic: errors grow by e every {:.2e} s. Judge it over a shorter span, such as `--span {:e}`",
                1.0 / chaos.rate,
                rounded(0.5 * chaos.divergence)
            );
            return refusal.with_help(help);
        }
        let accurate = refusal.code == codes::STEP_TOO_LARGE;
        let remedy = remedies::for_step(model, trials, &self.prediction, question.point, &question.format, accurate);
        let mut finding = match (&remedy, self.parted) {
            (None, Some(time)) => {
                let help = format!(
                    "try `--step {:e}` or less: the model is not chaotic, the step and half of it part at t = {time:.3e} s because \
                     they are too large for what happens there",
                    rounded(model.step / 2.0)
                );
                refusal.with_help(help)
            }
            _ => with_help_of(refusal, &remedy),
        };
        if self.prediction.growth > GROWTH {
            let growth = factor(self.prediction.growth);
            let help = finding.help.take().unwrap_or_default();
            finding.help = Some(format!("{} lets undamped oscillations grow {growth}. {help}", model.solver.title()));
        }
        if let Some(limit) = &self.prediction.limit {
            let text = format!(
                "steps above {:.2e} s are unstable for `{}`: eigenvalue {} at t = {:.3e} s",
                limit.step,
                model.states[limit.state].name,
                eigenvalue(limit.eigenvalue),
                limit.time
            );
            finding = finding.with_label(model.states[limit.state].span, text);
        }
        finding
    }
}

/// A growth in words, from its natural logarithm.
pub fn factor(logarithm: f64) -> String {
    if logarithm < 20.0 {
        format!("by a factor of {:.2}", libm::exp(logarithm))
    } else {
        format!("by a factor of 1e{:.0}", logarithm / std::f64::consts::LN_10)
    }
}

/// The solution itself ends within the span.
pub(super) fn solution_ends(model: &Model, state: StateId, time: f64) -> Diagnostic {
    let state = &model.states[state];
    let message = format!("the solution ends at t = {time:.6e} s: `{}` leaves all bounds there", state.name);
    let help = format!(
        "no step and no method gets past it: check the equation, or end earlier with `--span {:e}`",
        rounded(0.95 * time)
    );
    Diagnostic::error(codes::SOLUTION_ENDS, state.span, message).with_help(help)
}

/// Whether a smaller step or another method may help.
fn is_about_step(finding: &Diagnostic) -> bool {
    [codes::NEAR_LIMIT, codes::METHOD_GROWTH, codes::STEP_LARGE, codes::STEP_TOO_LARGE].contains(&finding.code)
}

fn with_remedy(finding: Diagnostic, remedy: &Option<Remedy>) -> Diagnostic {
    match remedy {
        Some(remedy) if is_about_step(&finding) => Diagnostic { help: Some(remedy.text()), ..finding },
        _ => finding,
    }
}

fn add_help(finding: Diagnostic, text: &str) -> Diagnostic {
    Diagnostic { help: Some(text.to_owned()), ..finding }
}

/// The remedy in place of general advice, if there is one.
fn with_help_of(finding: Diagnostic, remedy: &Option<Remedy>) -> Diagnostic {
    match remedy {
        Some(remedy) => add_help(finding, &remedy.text()),
        None => finding,
    }
}
