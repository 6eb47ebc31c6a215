//! A sweep over design points.
//!
//! ```text
//! axes       lists of values -> design points
//! family     points sorted by what they share
//! steps      steps that suit the model and the time between two outputs
//! sweep      design points -> rows, in parallel; shares what points have in common
//! row        what became of a point, and how it is stored
//! fronts     which points no other point beats
//! estimate   how long a sweep takes
//! queue      tasks of several threads, the cheapest first
//! ```
//!
//! A row holds what `compile` reports for its point: both go through the same functions of [`crate::pipeline`] and
//! [`crate::report`].

pub mod axes;
pub mod estimate;
pub mod family;
pub mod fronts;
pub mod queue;
pub mod row;
pub mod steps;
pub mod sweep;
