//! Error against run time: what `pe-synth accuracy` does with the rows of a study.
//!
//! ```text
//! options    the lists on the command line, and which axes a command fixes
//! view       rows -> front, chosen point, runners-up; accuracy.json
//! picture    the work-precision diagram
//! page       the columns of its table, and the page
//! files      all of them
//! ```

pub mod files;
pub mod options;
pub mod page;
pub mod picture;
pub mod view;
