//! Components: instances are written out as statements of the whole spec, with names such as `soma.v`.

pub(crate) mod expand;
mod rename;
