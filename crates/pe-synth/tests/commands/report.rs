//! Report and map as types: files are read back to the byte, schemas are those of the types, and pages name every key.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use pe_flow::report::Report;
use pe_map::Map;
use pe_map::wrap::Wrap;
use pe_wrap::foreign::EntityMap;
use serde_json::Value;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The report of a model, and the rows of a sweep over it.
fn report(model: &str, options: &[&str]) -> String {
    let home = Path::new(env!("CARGO_TARGET_TMPDIR")).join("report").join(model);
    let spec = format!("models/{model}/{model}.spec");
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.current_dir(root()).args(["compile", &spec, "--quiet", "--no-pictures", "-o"]).arg(&home).args(options);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    fs::read_to_string(home.join("report.json")).unwrap()
}

#[test]
fn reports_of_every_kind_are_read_back_to_the_byte() {
    let device = ["--device", "LFE5UM-85F", "--reference", "--span", "2s"];
    let cases: [(&str, &[&str]); 7] = [
        ("van_der_pol", &device),
        ("kepler", &["--conserved", "x", "--reference", "--span", "2s"]),
        ("motor_pid", &["--span", "20ms", "--pes", "2"]),
        ("hodgkin_huxley", &["--span", "2ms", "--pes", "2"]),
        ("weibel5", &["--span", "20ms", "--proof", "off"]),
        ("harmonic_oscillator", &["--span", "500ms", "--max-error", "1e-3"]),
        ("lotka_volterra", &["--span", "2s", "--solver", "implicit_euler", "--step", "1ms"]),
    ];
    for (model, options) in cases {
        let text = report(model, options);
        let read: Report = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{model}: {error}"));
        assert!(read.text() == text, "{model}: what was read differs from what was written");
    }
}

/// What is written for others to read: page, schema and the schema of the types.
fn schemas() -> [(&'static str, &'static str, Value); 4] {
    let value = |schema: schemars::Schema| serde_json::to_value(schema).unwrap();
    [
        ("docs/report.md", "docs/report.schema.json", value(schemars::schema_for!(Report))),
        ("docs/map.md", "docs/map.schema.json", value(schemars::schema_for!(Map))),
        ("docs/wrapper.md", "docs/wrap.schema.json", value(schemars::schema_for!(Wrap))),
        ("docs/wrapper.md", "docs/entity.schema.json", value(schemars::schema_for!(EntityMap))),
    ]
}

#[test]
fn schemas_are_those_of_the_types() {
    for (_, path, schema) in schemas() {
        let schema = format!("{schema:#}\n");
        if std::env::var_os("UPDATE_SCHEMA").is_some() {
            fs::write(root().join(path), &schema).unwrap();
        }
        let shipped = fs::read_to_string(root().join(path)).unwrap_or_default();
        assert!(shipped == schema, "UPDATE_SCHEMA=1 cargo test -p pe-synth --test commands report renews {path}");
    }
}

/// Names of all properties of a schema.
fn properties(schema: &Value, names: &mut BTreeSet<String>) {
    match schema {
        Value::Object(object) => {
            if let Some(Value::Object(properties)) = object.get("properties") {
                names.extend(properties.keys().cloned());
            }
            object.values().for_each(|value| properties(value, names));
        }
        Value::Array(values) => values.iter().for_each(|value| properties(value, names)),
        _ => {}
    }
}

#[test]
fn the_pages_name_every_key() {
    for (path, _, schema) in schemas() {
        let mut names = BTreeSet::new();
        properties(&schema, &mut names);
        let page = fs::read_to_string(root().join(path)).unwrap();
        let words: BTreeSet<&str> = page.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).collect();
        let documented = |name: &&String| {
            let stem = name.trim_end_matches("_to_date").trim_end_matches("_reason");
            words.contains(name.as_str()) || words.contains(stem) || words.contains(format!("{stem}_s").as_str())
        };
        let missing: Vec<&String> = names.iter().filter(|name| !documented(name)).collect();
        assert!(missing.is_empty(), "{path} lacks {missing:?}");
    }
}
