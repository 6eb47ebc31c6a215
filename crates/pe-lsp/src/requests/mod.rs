//! What is asked about a place or a file, each answered from a [`crate::view::View`].

pub(crate) mod complete;
pub(crate) mod fixes;
pub(crate) mod hover;
pub(crate) mod layout;
pub(crate) mod navigate;
pub(crate) mod rename;
