//! Causes of large errors other than step and word length.

use pe_ir::codes;
use pe_ir::graph::{FixedPoint, StepGraph};
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;
use pe_sim::error::Trajectory;

use super::sensitivity::APART;

/// Part of a standard deviation by which two means may differ, and part by which two deviations may, for statistics to
/// agree: what is left is the chance of a finite run.
const AGREES: f64 = 0.5;

/// Bits below the smallest normal number of double precision, whose magnitude has too few digits left.
const LOST_BITS: i32 = 32;

/// Mean and standard deviation of a state over the samples of a run.
pub fn statistics(run: &Trajectory, state: usize) -> (f64, f64) {
    let numbers = || run.samples.iter().skip(state).step_by(run.states.max(1));
    let count = run.len().max(1) as f64;
    let mean = numbers().sum::<f64>() / count;
    (mean, libm::sqrt(numbers().map(|number| (number - mean) * (number - mean)).sum::<f64>() / count))
}

/// The warning about a chaotic model, whose trajectory says nothing after a while, in place of a refusal. `scales` are the
/// magnitudes of the states, `rate` is that at which differences grow.
pub(super) fn chaotic(
    model: &Model,
    graph: &StepGraph,
    fixed: &FixedPoint,
    (scales, rate): (&[f64], f64),
    (double, hardware): (&Trajectory, &Trajectory),
) -> Option<Diagnostic> {
    let lsb =
        |index: usize| libm::scalbn(1.0, fixed.exponents[graph.states[StateId::at(index)].0.index()]) / scales[index];
    let largest = (0..scales.len()).map(lsb).fold(f64::MIN_POSITIVE, f64::max);
    let divergence = libm::log(APART / largest) / rate;
    // The state whose statistics differ most.
    let differs = |state: usize| {
        let ((mean, deviation), (own_mean, own_deviation)) = (statistics(double, state), statistics(hardware, state));
        ((own_mean - mean).abs() / deviation).max((own_deviation / deviation - 1.0).abs())
    };
    let worst = (0..scales.len()).max_by(|a, b| differs(*a).total_cmp(&differs(*b)))?;
    let (is, should) = (statistics(hardware, worst), statistics(double, worst));
    let verdict = if differs(worst) <= AGREES { "statistics agree" } else { "statistics differ as well" };
    let message = format!(
        "the model is chaotic: a difference of one LSB grows by e every {:.2e} s, so that values mean nothing after t = {divergence:.3e} s; \
         {verdict}: `{}` has mean {:.3e} and standard deviation {:.3e} in double precision, {:.3e} and {:.3e} in fixed point",
        1.0 / rate,
        model.states[StateId::at(worst)].name,
        should.0,
        should.1,
        is.0,
        is.1
    );
    let help = format!("judge trajectories over `--span {:.1e}` at most, and longer runs by averages", divergence);
    Some(
        Diagnostic::error(codes::CHAOTIC, model.states[StateId::at(worst)].span, message)
            .with_help(help)
            .into_warning(),
    )
}

/// The refusal of a state whose numbers are so small that double precision itself does not hold them.
pub(super) fn too_small(model: &Model, state: StateId, scale: f64) -> Option<Diagnostic> {
    if scale == 0.0 || scale >= libm::scalbn(f64::MIN_POSITIVE, -LOST_BITS) {
        return None;
    }
    let state = &model.states[state];
    let message = format!(
        "`{}` is never larger than {scale:.1e}: below {:.1e} double precision loses digits, so that no run says what is right",
        state.name,
        f64::MIN_POSITIVE
    );
    let help = "write the model in another unit, so that the state has a magnitude between 1e-100 and 1e100";
    Some(Diagnostic::error(codes::TOO_SMALL, state.span, message).with_help(help))
}
