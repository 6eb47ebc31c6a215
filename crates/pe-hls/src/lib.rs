//! From model to program: step graph, number formats, mapping, schedule, assembly.
//!
//! ```text
//! Model -> lift -> step -> StepGraph -> functions -> split -> formats -> FixedPoint -> mapping -> schedule -> assemble -> Program
//! ```

mod alike;
pub mod assemble;
pub mod even;
pub mod formats;
pub mod functions;
pub mod lift;
pub mod mapping;
pub mod norms;
pub mod pairs;
pub mod relay;
pub mod rounding;
pub mod rounds;
pub mod schedule;
pub mod split;
pub mod step;
pub mod two_slots;
