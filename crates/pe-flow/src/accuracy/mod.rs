//! Error against run time: which points are compared, and which is the cheapest that meets the goal.
//!
//! ```text
//! lists      lists of values -> design points: solvers, steps, word lengths
//! goal       the cheapest point that is right enough; more points where the first ones leave the question open
//! early      lists of steps that a search tries
//! wanted     limits that a design keeps, and the figure that is to be small: which row is the best
//! choice     the same for `compile --max-error`
//! ```
//!
//! The points are compiled by the sweep of [`crate::explore`], so that a row holds what `compile --reference` reports.

pub mod choice;
pub mod early;
pub mod goal;
pub mod lists;
pub mod wanted;
