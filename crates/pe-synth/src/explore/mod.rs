//! A sweep over design points: what `pe-synth explore` does.
//!
//! ```text
//! axes       lists of options -> design points
//! steps      steps that suit the model and the time between two outputs
//! drive      threads, progress and end of a sweep
//! sweep      design points -> rows, in parallel; shares what points have in common
//! row        what became of a point, and how it is stored
//! record     the rows as they come, the folder they are kept in, taking up an earlier result
//! fronts     which points no other point beats
//! files      rows -> points.json, points.csv, pictures, page
//! ```
//!
//! A row holds what `compile` reports for its point: both go through the same functions of [`crate::pipeline`] and
//! [`crate::report`].

pub mod axes;
pub mod drive;
pub mod estimate;
pub mod files;
pub mod fronts;
pub mod given;
pub mod record;
pub mod row;
pub mod show;
pub mod steps;
pub mod sweep;
