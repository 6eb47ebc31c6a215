//! Progress of long runs.

use std::sync::Arc;

/// Listens to a long run. Amounts of work are in steps of runs, or whatever unit the length was given in.
pub trait Progress: Send + Sync {
    /// All the work there is.
    fn set_length(&self, work: u64);
    /// There is more work than was said.
    fn add_length(&self, work: u64);
    /// So much more has been done.
    fn advance(&self, work: u64);
    /// So much has been done in all.
    fn set_position(&self, work: u64);
}

struct Silent;

impl Progress for Silent {
    fn set_length(&self, _: u64) {}
    fn add_length(&self, _: u64) {}
    fn advance(&self, _: u64) {}
    fn set_position(&self, _: u64) {}
}

/// Tells nobody.
pub fn silent() -> Arc<dyn Progress> {
    Arc::new(Silent)
}
