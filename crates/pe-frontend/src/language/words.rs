//! Names that have a meaning in every spec.

use crate::language::functions;
use crate::language::waveforms::WAVEFORMS;

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

/// Whether a name is that of a function or signal of the language.
pub(crate) fn is_built_in(name: &str) -> bool {
    functions::find(name).is_some()
        || WAVEFORMS.iter().any(|(word, ..)| *word == name)
        || OF_ARRAYS.iter().any(|(word, _)| *word == name)
}

/// The value of a predefined number.
pub(crate) fn predefined(name: &str) -> Option<f64> {
    PREDEFINED.iter().find(|(word, _)| *word == name).map(|(_, value)| *value)
}
