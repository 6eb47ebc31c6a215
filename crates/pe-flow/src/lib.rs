//! The flow from the text of a spec to a judged program, once for all commands.
//!
//! ```text
//! spec       files -> Model
//! stages     the text of a stage -> all that was decided up to it
//! pipeline   Model -> Design: step graph, runs, mapping, schedule, program, checkers
//! report     Design -> the report
//! explore    points of the design space, compiled in parallel; nothing is computed twice
//! accuracy   the cheapest point that meets an error goal
//! ```
//!
//! Nothing is printed here: results and failures are returned, and a [`watch::Listener`] hears of progress and warnings
//! as they come up.

pub mod accuracy;
mod assembled;
pub mod bottleneck;
pub mod candidates;
mod design;
pub mod elimination;
pub mod explore;
pub mod failure;
pub mod features;
pub mod known;
pub mod mapping_file;
pub mod outputs;
mod parts;
pub mod penalty;
pub mod pipeline;
pub mod read;
pub mod report;
mod rings;
pub mod scene;
pub mod selection;
pub mod settings;
pub mod sized;
pub mod spec;
pub mod stages;
pub mod variables;
pub mod watch;
