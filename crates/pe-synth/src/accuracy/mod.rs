//! Error against run time: what `pe-synth accuracy` does, and how `--max-error` picks a design.
//!
//! ```text
//! lists      options -> design points: solvers, steps, word lengths
//! goal       the cheapest point that is right enough; more points where the first ones leave the question open
//! early      lists of steps that a search tries
//! view       rows -> front, chosen point, runners-up; accuracy.json, accuracy.csv
//! picture    the work-precision diagram
//! choice     the same for `compile --max-error`
//! ```
//!
//! The points are compiled by the sweep of [`crate::explore`], so that a row holds what `compile --reference` reports.

pub mod choice;
pub mod early;
pub mod goal;
pub mod lists;
pub mod picture;
pub mod view;
