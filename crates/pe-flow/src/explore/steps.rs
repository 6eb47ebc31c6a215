//! Steps that suit a model and the time between two outputs.

use pe_ir::model::Model;

use crate::failure::Failure;

/// Divisions of the time between two outputs that are looked at for one that suits the span.
const DIVISIONS: u32 = 64;

/// Part of a step by which a time may miss a whole number of steps.
const SLACK: f64 = 1e-9;

/// The longest step up to this one of which a time is a whole multiple.
fn whole_part(time: f64, step: f64) -> f64 {
    let steps = time / step;
    let whole = libm::round(steps).max(1.0);
    if (steps - whole).abs() <= SLACK * whole { step } else { time / libm::ceil(steps) }
}

/// The longest step up to this one, or nearly so, of which the span and the time between two outputs are whole
/// multiples, all in seconds; none if no reasonable one suits the model.
pub fn suitable(model: &Model, sample: Option<f64>, step: f64) -> Option<f64> {
    let step = sample.map_or(step, |sample| whole_part(sample, step.min(sample)));
    // A list of steps has times of its own, and so have blocks and delays.
    if !model.phases.is_empty() || !model.rates.is_empty() || model.delays().chain(model.waits()).next().is_some() {
        return model.suitable_step(step);
    }
    match sample {
        None => Some(whole_part(model.span, step)),
        Some(sample) => {
            let parts = libm::round(sample / step) as u32;
            let mut candidates = (parts..parts.saturating_add(DIVISIONS)).map(|parts| sample / f64::from(parts));
            let fits = |step: &f64| whole_part(model.span, *step) == *step;
            Some(candidates.find(fits).unwrap_or(step))
        }
    }
}

/// Refuses steps of the user's that miss the times of outputs that the user wants.
///
/// # Errors
/// A usage error that names the first of them.
pub fn hit(steps: &[f64], sample: Option<f64>) -> Result<(), Failure> {
    let Some(sample) = sample else { return Ok(()) };
    let misses = |step: &&f64| whole_part(sample, **step) != **step || **step > sample * (1.0 + SLACK);
    steps.iter().find(misses).map_or(Ok(()), |step| {
        let help = format!("take one that divides it, for example `--step {:e}`", whole_part(sample, step.min(sample)));
        Err(Failure::Usage(format!("a step of {step:e} s misses multiples of `--sample`, {sample:e} s; {help}")))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_of_the_users_hits_the_times_of_outputs_or_is_refused() {
        assert!(hit(&[1e-3, 2.5e-3, 1e-2], Some(1e-2)).is_ok() && hit(&[3e-3], None).is_ok());
        let refused = |step: f64| hit(&[step], Some(1e-2)).map_or_else(|failure| failure.code(), |()| 0);
        assert_eq!((refused(3e-3), refused(2e-2)), (2, 2));
    }
}
