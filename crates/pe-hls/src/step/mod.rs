//! Builds the step graph: one solver step of a model as chains of products.

mod append;
mod arrival;
mod build;
mod builder;
mod elimination;
mod forms;
mod jumps;
mod mechanism;
mod method;
mod motion;
mod past;
mod plan;
mod planned;
mod played;
mod polynomial;
mod price;
mod prune;
mod rows;
mod sampled;
mod score;
mod sharing;
mod staged;
mod still;
mod ticked;
mod turns;

pub use build::{build, build_with};
pub use elimination::order::Order;
pub use elimination::scheme::Scheme;
pub use elimination::system::{general, orders, schemes};
pub use forms::StepOptions;
pub use sampled::coupled;
