//! What `pe-synth explore` does with the rows of a sweep.
//!
//! ```text
//! options    the axes on the command line
//! given      what the user gave, as words of commands
//! drive      threads, progress and end of a sweep
//! sheet      the rows that are there, and the fronts among them
//! cluster    parts of a sweep as jobs
//! store      points that several sweeps share
//! record     the rows as they come, the folder they are kept in, taking up an earlier result
//! seal       the checksum of a row in that result
//! show       rows as a person reads them
//! columns    tables for CSV files and pages
//! files      rows -> points.json, points.csv, pictures, page
//! ```

pub mod changes;
pub mod cluster;
pub mod columns;
pub mod drive;
pub mod files;
pub mod given;
pub mod options;
pub mod record;
pub mod seal;
pub mod sheet;
pub mod show;
pub mod store;
