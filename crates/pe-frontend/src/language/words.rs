//! Names that have a meaning in every spec.

/// Numbers with a name.
pub(crate) const PREDEFINED: [(&str, f64); 1] = [("pi", std::f64::consts::PI)];

/// The time in seconds, unless the spec gives this name to something else.
pub(crate) const TIME: &str = "time";

/// The scalar product of two vectors.
pub(crate) const DOT: &str = "dot";

/// A matrix with rows and columns exchanged.
pub(crate) const TRANSPOSE: &str = "transpose";

/// The solution of a linear system.
pub(crate) const SOLVE: &str = "solve";

/// The accelerations of a mechanism.
pub(crate) const CONSTRAINED: &str = "constrained";

/// Functions of whole arrays, with the number of their arguments.
pub(crate) const OF_ARRAYS: [(&str, usize); 4] = [(DOT, 2), (TRANSPOSE, 1), (SOLVE, 2), (CONSTRAINED, 7)];

/// The value of a predefined number.
pub(crate) fn predefined(name: &str) -> Option<f64> {
    PREDEFINED.iter().find(|(word, _)| *word == name).map(|(_, value)| *value)
}
