//! Numbers that JSON cannot represent, and keys that may be present and null.

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

/// Reads a number that is null in the file where it is not finite: NaN then.
///
/// # Errors
/// Those of the deserializer.
pub fn nullable<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

/// Reads a key that is there, be it null.
///
/// # Errors
/// Those of the deserializer.
pub fn present<'de, T: Deserialize<'de>, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Option<T>>, D::Error> {
    Option::deserialize(deserializer).map(Some)
}

/// A number, or the word `inf`.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Unbounded {
    /// Finite.
    Number(f64),
    /// `inf`.
    Word(String),
}

impl From<f64> for Unbounded {
    fn from(number: f64) -> Self {
        if number.is_finite() { Unbounded::Number(number) } else { Unbounded::Word("inf".to_owned()) }
    }
}
