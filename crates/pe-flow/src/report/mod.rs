//! The report: `report.json` as a type, how it is built from a design, and how a terminal shows it.
//!
//! ```text
//! types, errors   what the file holds
//! network         what it holds about the network and its mapping
//! compared        what of it is compared over time
//! build           Design -> Report
//! counted         events of designs that are judged by them
//! mechanism       how well closures are kept
//! systems         pivots and eliminations: their keys, and how they are built
//! stability       the check of the step -> its key
//! table           Report -> summary
//! timing          report-timing.json
//! ```
//!
//! The same command gives the same bytes, `report-timing.json` excepted.

mod build;
pub mod compared;
pub mod counted;
pub mod errors;
pub mod mechanism;
pub mod network;
mod stability;
pub mod systems;
pub mod table;
mod timing;
pub mod types;
pub mod values;

pub use build::{Silicon, Told, Total};
pub use errors::{Chosen, DeviceFit, Errors, RunnerUp, Stability};
pub use stability::{not_found, verdict};
pub use timing::timing;
pub use types::{Clock, Figures, Report};

impl Report {
    /// The text of `report.json`: keys in alphabetical order.
    pub fn text(&self) -> String {
        let value = serde_json::to_value(self).expect("a report has text keys and plain values");
        format!("{value:#}\n")
    }
}
