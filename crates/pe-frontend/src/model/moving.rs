//! What closures of a mechanism read besides coordinates, and how fast that moves.

use pe_ir::index::StateId;
use pe_ir::mechanism::Mechanism;
use pe_ir::model::{Expr, Model, Variable};
use pe_ir::motion::Motion;
use pe_ir::place::Place;

/// Whether closures read coordinates and tunable parameters alone.
pub(super) fn reads_coordinates_alone(model: &Model, mechanism: &Mechanism) -> bool {
    let mut alone = true;
    each_read(model, &mechanism.gaps, &mut |variable| match variable {
        Variable::Algebraic(_) => {}
        Variable::State(state) => {
            alone &= model.states[state].tunable || mechanism.pairs.iter().any(|pair| pair.0 == state);
        }
        Variable::Input(_) => alone = false,
    });
    alone
}

/// Visits what parts of a mechanism read, also by way of equations.
fn each_read(model: &Model, parts: &[Expr], look: &mut dyn FnMut(Variable)) {
    let mut read = Vec::new();
    parts.iter().for_each(|part| part.each_variable(&mut |variable| read.push(variable)));
    read.iter().for_each(|variable| look(*variable));
    let needed = model.needed(read);
    let all = model.algebraics.iter().zip(needed).filter(|(_, needed)| *needed);
    all.for_each(|(algebraic, _)| algebraic.expr.each_variable(&mut |variable| look(variable)));
}

/// How fast states move where the mechanism starts that are no part of it, zero for the others; none where closures or drifts
/// read inputs or signals, which follow no equation.
pub(super) fn others(model: &Model, mechanism: &Mechanism) -> Option<Vec<f64>> {
    let mut known = true;
    let own = |state: StateId| mechanism.pairs.iter().any(|pair| pair.0 == state || pair.1 == state);
    let mut look = |variable: Variable| match variable {
        Variable::Algebraic(_) => {}
        Variable::State(state) => known &= matches!(model.states[state].motion, None | Some(Motion::Clock)),
        Variable::Input(_) => known = false,
    };
    [&mechanism.gaps, &mechanism.drifts, &mechanism.bends]
        .into_iter()
        .for_each(|parts| each_read(model, parts, &mut look));
    let states: Vec<f64> = model.states.iter().map(|state| state.initial).collect();
    let inputs = model.sample_inputs(0.0);
    let derivatives = known.then(|| Place::new(model, &states, &inputs).derivatives())?;
    let all = model.states.numbered().zip(derivatives);
    Some(all.map(|((state, _), derivative)| if own(state) { 0.0 } else { derivative }).collect())
}
