//! Methods other than explicit Runge-Kutta methods with as many stages as their order, as plans of a step.

mod adams;
mod chebyshev;
mod exponential;
mod gates;
mod implicit;
mod jacobian;
mod partitioned;
mod suit;

use pe_ir::model::{Model, Solver};
use pe_ir::source::Diagnostic;

pub use exponential::exponential;

use super::elimination::order::Order;
use super::plan::Plan;
pub(super) use suit::unsuitable;

/// The step of a model by its method, which eliminates its matrices in an order; none if the method is an explicit
/// Runge-Kutta method, or needs no plan.
///
/// # Errors
/// `E0806` if the method does not suit the model.
pub fn plan(model: &Model, order: Order) -> Result<Option<Plan<'_>>, Vec<Diagnostic>> {
    if !model.phases.is_empty() && !model.solver.takes_lists() {
        let reason = "a list of steps needs an implicit solver";
        return Err(unsuitable(
            model,
            reason,
            "take `rodas3`, `ros2`, `implicit_euler` or `trapezoidal`, or a single step",
        ));
    }
    let plan = match model.solver {
        Solver::Euler | Solver::Heun | Solver::Heun3 | Solver::Rk4 | Solver::Exact => return Ok(None),
        Solver::SymplecticEuler => partitioned::symplectic_euler(model)?,
        Solver::Leapfrog => partitioned::leapfrog(model)?,
        Solver::Ab2 | Solver::Ab3 | Solver::Ab4 => adams::plan(model),
        Solver::Rkc5 | Solver::Rkc10 => chebyshev::plan(model),
        Solver::ImplicitEuler => implicit::implicit_euler(model, order)?,
        Solver::Trapezoidal => implicit::trapezoidal(model, order)?,
        Solver::Ros2 => implicit::ros2(model, order)?,
        Solver::Rodas3 => implicit::rodas3(model, order)?,
        Solver::RushLarsen => gates::plan(model)?,
    };
    Ok(Some(plan))
}
