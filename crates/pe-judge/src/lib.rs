//! Judges the numbers of a design: runs over the span, the parts of the error, the total error, and the check of the
//! step.
//!
//! [`runs`] chooses formats and measures the parts of the error, [`proof`] proves ranges, [`total`] compares with a
//! reference of high accuracy, [`check`] says whether the step is stable and what would cure it. Findings are returned,
//! never printed.

mod angles;
pub mod check;
pub mod conserved;
pub mod corners;
mod criteria;
pub mod early;
pub mod feedback;
pub mod oscillation;
pub mod parse;
pub mod pivots;
mod point;
pub mod progress;
pub mod proof;
mod regular;
pub mod residuals;
pub mod runs;
pub mod slots;
pub mod tables;
pub mod times;
pub mod total;

pub use criteria::{Criteria, JudgedBy, ProofMode};
pub use point::{Coefficients, DesignPoint, FormChoice, MOST_STORAGE, default_ports};
