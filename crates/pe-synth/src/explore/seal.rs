//! Rows in the record of a sweep, each with a checksum: what was changed since is computed again.

use pe_map::sha256;
use serde_json::{Map, Value};

/// Key of the checksum.
const KEY: &str = "sha256";

/// A row with the checksum of all that it says.
pub fn sealed(mut row: Map<String, Value>) -> Value {
    let sum = sum(&row);
    row.insert(KEY.into(), sum.into());
    Value::Object(row)
}

/// Whether a row says what was written.
pub fn is_whole(row: &Value) -> bool {
    let Some(mut row) = row.as_object().cloned() else { return false };
    row.remove(KEY).is_some_and(|stored| stored == sum(&row))
}

fn sum(row: &Map<String, Value>) -> String {
    let text: Vec<String> = row.iter().map(|(key, value)| format!("{key:?}:{value}")).collect();
    sha256(text.join("\n").as_bytes())
}
