//! Runs in double precision that a run of the step is compared with, and what smaller steps say about the method.

use pe_hls::step::StepOptions;
use pe_ir::codes;
use pe_ir::graph::StageForm;
use pe_ir::model::{Model, Solver};
use pe_ir::source::Diagnostic;
use pe_sim::double::DoubleRun;
use pe_sim::error::Trajectory;

use super::inputs::{self, Sight};
use super::{Plan, varying_inputs};

/// How a comparison run divides a step.
#[derive(Clone, Copy)]
pub(super) struct Substeps {
    pub count: u64,
    /// What it takes inputs for.
    pub inputs: Sight,
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
    let continuous = inputs::read_by_continuous_alone(model);
    for done in 1..=plan.steps {
        for substep in 0..substeps.count {
            let time = model.time(done - 1, substep as f64 / substeps.count as f64);
            let seen = match substeps.inputs {
                Sight::Held => finer.hold_inputs(model.time(done - 1, 0.0), time),
                Sight::Sampled => finer.sample_inputs(time),
                Sight::Mean => {
                    let end = model.time(done - 1, (substep + 1) as f64 / substeps.count as f64);
                    inputs::means(&finer, &continuous, (time, end))
                }
            };
            run.step(&seen).map_err(|_| {
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
    /// What the step does not see of inputs; none if they are constant, or covered by the method.
    pub(super) input_hold: Option<inputs::Blindness>,
    /// The finding that a large method error would be.
    pub(super) finding: Diagnostic,
}

impl Comparison {
    /// The method error that it found.
    pub fn method(&self) -> f64 {
        self.method
    }
}

/// Runs half the step, with inputs held as the hardware does and with their means.
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
    let covers = model.solver.covers_inputs();
    let own = Substeps { count: 2, inputs: if covers { Sight::Sampled } else { Sight::Held } };
    let halved = trajectory(model, DoubleRun::new(&graph), plan, own)?;
    let (worst, difference) = reference.deviation(&halved).worst(scales);
    // With error C h^p the difference of steps h and h/2 is C h^p (1 - 2^-p).
    let gain = f64::from(1u32 << model.solver.order());
    let mean = Substeps { count: 2, inputs: Sight::Mean };
    let mut input_hold = None;
    if varying_inputs(model) && !covers {
        // Both runs share the method error of h/2; a mean does in a substep what the signal itself does, to second order.
        let seen = trajectory(model, DoubleRun::new(&graph), plan, mean)?;
        input_hold = Some(inputs::Blindness::of(model, &halved, &seen, scales));
    } else if covers && inputs::cause(model).is_some() {
        // The order of these methods holds for inputs that are smooth.
        let one_step = Model { solver: Solver::Rk4, ..half };
        let graph = pe_hls::step::build_with(&one_step, &StepOptions::default())?;
        let seen = trajectory(model, DoubleRun::new(&graph), plan, mean)?;
        input_hold = Some(inputs::Blindness::of(model, reference, &seen, scales));
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
