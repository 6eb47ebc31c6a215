//! Runs in double precision that a run of the step is compared with, and what smaller steps say about the method.

use pe_hls::step::StepOptions;
use pe_ir::codes;
use pe_ir::graph::StageForm;
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;
use pe_sim::double::DoubleRun;
use pe_sim::error::Trajectory;

use super::{Plan, varying_inputs};

/// How a comparison run divides a step.
#[derive(Clone, Copy)]
pub(super) struct Substeps {
    pub count: u64,
    /// Whether inputs are sampled at each substep; otherwise they are held over the whole step.
    pub resample: bool,
}

/// Samples of a run in double precision at the reference's sample times.
pub(super) fn trajectory(
    model: &Model,
    mut run: DoubleRun,
    plan: &Plan,
    substeps: Substeps,
) -> Result<Trajectory, Vec<Diagnostic>> {
    let mut samples = Trajectory::new(model.states.len());
    let finer = Model { step: model.step / substeps.count as f64, ..model.clone() };
    for done in 1..=plan.steps {
        for substep in 0..substeps.count {
            let time = model.time(done - 1, substep as f64 / substeps.count as f64);
            let sampled = if substeps.resample { time } else { model.time(done - 1, 0.0) };
            run.step(&finer.hold_inputs(sampled, time)).map_err(|_| {
                let message = format!("a comparison run is not finite at t = {time:.6e} s");
                let help = "the model is at the edge of stability: try a smaller `--step`";
                vec![Diagnostic::global(codes::DIVERGED, message).with_help(help)]
            })?;
        }
        plan.advance(done, substeps.count);
        if plan.sampled(done) {
            samples.push(|state| run.state(state));
        }
    }
    Ok(samples)
}

/// Part of the largest difference to half the step from which on a finding counts time.
const PART: f64 = 0.1;

/// The first sample at which a state of two runs differs by more than a number; the first of all if none does.
pub(super) fn first_beyond(run: &Trajectory, other: &Trajectory, state: usize, difference: f64) -> usize {
    let of = |run: &Trajectory| run.samples.iter().skip(state).step_by(run.states).copied().collect::<Vec<f64>>();
    // What is not a number differs.
    let apart =
        |(own, other): (&f64, &f64)| (own - other).abs().partial_cmp(&difference).is_none_or(|order| order.is_gt());
    of(run).iter().zip(&of(other)).position(apart).unwrap_or(0)
}

/// What smaller steps say about the method.
#[derive(Clone)]
pub struct Comparison {
    pub(super) function: Option<f64>,
    pub(super) method: f64,
    pub(super) input_hold: f64,
    /// The finding that a large method error would be.
    pub(super) finding: Diagnostic,
}

impl Comparison {
    /// The method error that it found.
    pub fn method(&self) -> f64 {
        self.method
    }
}

/// Runs half the step, with inputs held as the hardware does and with inputs sampled twice as often.
pub(super) fn half_step_runs(
    model: &Model,
    form: StageForm,
    plan: &Plan,
    reference: &Trajectory,
    scales: &[f64],
) -> Result<Comparison, Vec<Diagnostic>> {
    let half = Model { step: model.step / 2.0, ..model.clone() };
    let graph = pe_hls::step::build_with(&half, &StepOptions { form: Some(form), ..StepOptions::default() })?;
    // Otherwise the method's own history of slopes would see inputs that move at every other of its steps.
    let resample = model.solver.covers_inputs();
    let halved = trajectory(model, DoubleRun::new(&graph), plan, Substeps { count: 2, resample })?;
    let (worst, difference) = reference.deviation(&halved).worst(scales);
    // With error C h^p the difference of steps h and h/2 is C h^p (1 - 2^-p).
    let gain = f64::from(1u32 << model.solver.order());
    let mut input_hold = 0.0;
    if varying_inputs(model) && !resample {
        let resampled = trajectory(model, DoubleRun::new(&graph), plan, Substeps { count: 2, resample: true })?;
        // Both runs share the method error of h/2; holding inputs is an error of first order.
        input_hold = 2.0 * halved.deviation(&resampled).worst(scales).1;
    }
    let name = &model.states[worst].name;
    let time = plan.times()[first_beyond(reference, &halved, worst, PART * difference * scales[worst])];
    let message = format!(
        "the step is too large for `{name}`: from t = {time:.6e} s on half of it changes the result by up to {difference:.1e}"
    );
    let finding = Diagnostic::error(codes::STEP_TOO_LARGE, model.states[worst].span, message)
        .with_help(format!("try `--step {:.3e}`; a chaotic model needs a shorter `--span`", model.step / 2.0));
    Ok(Comparison { function: None, method: difference * gain / (gain - 1.0), input_hold, finding })
}
