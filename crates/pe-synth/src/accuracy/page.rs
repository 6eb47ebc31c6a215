//! The page of a work-precision study, and the columns of its table.

use pe_emit::page::Page;
use serde_json::{Value, json};

use super::picture;
use super::view::View;
use crate::explore::columns::{self, Column, Kind};

/// Columns of `accuracy.csv`.
pub const COLUMNS: [Column; 50] = [
    Column::shown("point", "point", Kind::Count),
    Column::new("status", "status", Kind::Text),
    Column::shown("solver", "solver", Kind::Text),
    Column::shown("step_s", "step", Kind::Seconds),
    Column::new("steps", "steps", Kind::Count),
    Column::new("form", "form of the step", Kind::Text),
    Column::new("pes", "PEs", Kind::Count),
    Column::shown("storage_bits", "bits", Kind::Count),
    Column::new("guard_bits", "guard bits", Kind::Count),
    Column::shown("multiplier", "multiplier", Kind::Text),
    Column::new("coefficient_slots", "products per coefficient", Kind::Count),
    Column::shown("cycles_per_step", "cycles per step", Kind::Count),
    Column::new("products_per_step", "products per step", Kind::Count),
    Column::new("operations", "products over the span", Kind::Number),
    Column::new("clock_mhz", "clock [MHz]", Kind::Number),
    Column::shown("seconds", "run time for the span", Kind::Seconds),
    Column::shown("speed", "times real time", Kind::Number),
    Column::new("lut", "LUTs", Kind::Number),
    Column::new("ff", "flip-flops", Kind::Number),
    Column::new("dsp", "DSP blocks", Kind::Count),
    Column::new("bram18", "BRAM18", Kind::Count),
    Column::shown("equivalent_lut", "equivalent LUTs", Kind::Number),
    Column::shown("error_total", "total error", Kind::Number),
    Column::new("worst_state", "worst state", Kind::Text),
    Column::new("error_total_at_end", "total error at the end", Kind::Number),
    Column::new("error_l2", "L2 error", Kind::Number),
    Column::new("digits_at_end", "digits at the end", Kind::Number),
    Column::new("error_double", "error in double precision", Kind::Number),
    Column::new("error_double_at_end", "the same at the end", Kind::Number),
    Column::shown("error_method", "method error", Kind::Number),
    Column::shown("error_word_length", "word-length error", Kind::Number),
    Column::new("error_word_length_at_end", "word-length error at the end", Kind::Number),
    Column::new("error_coefficient", "coefficient error", Kind::Number),
    Column::new("error_coefficient_at_end", "coefficient error at the end", Kind::Number),
    Column::new("error_function", "function error", Kind::Number),
    Column::new("error_input_hold", "input-hold error", Kind::Number),
    Column::new("diverged_s", "wrong by a tenth from", Kind::Seconds),
    Column::new("period_state", "state with a period", Kind::Text),
    Column::new("period_s", "period", Kind::Seconds),
    Column::new("period_error", "error of the period", Kind::Text),
    Column::new("conserved", "conserved", Kind::Text),
    Column::new("drift", "drift of it", Kind::Text),
    Column::new("reference_uncertainty", "uncertainty of the reference", Kind::Number),
    Column::new("reference_agreement", "agreement of the references", Kind::Number),
    Column::new("on_front", "on the front", Kind::Count),
    Column::new("chosen", "chosen", Kind::Count),
    Column::new("warnings", "warnings", Kind::Text),
    Column::new("code", "code", Kind::Text),
    Column::shown("message", "why it failed", Kind::Text),
    Column::new("command", "command", Kind::Text),
];

/// What the page tells of a point under the pointer.
const TOLD: [&str; 9] = [
    "solver",
    "step_s",
    "storage_bits",
    "multiplier",
    "error_total",
    "error_method",
    "error_word_length",
    "seconds",
    "equivalent_lut",
];

/// The page, with the cells of the table.
pub fn page(view: &View, cells: &[[String; 50]]) -> String {
    let sheet = view.sheet;
    let text = |key: &str| sheet.head.get(key).and_then(Value::as_str).unwrap_or("");
    let time = "run time for the span [s]";
    let data = columns::page_data(json!({
        "columns": columns::data(&COLUMNS, cells, &["seconds", "equivalent_lut", "error_total"]),
        "plots": [
            {"title": "Error against run time", "x": "seconds", "y": "error_total", "names": [time, "total error"]},
            {"title": "Run time against size", "x": "equivalent_lut", "y": "seconds",
             "names": ["size [equivalent LUTs]", time], "least": 0.0},
        ],
        "error": "error_total",
        "limit": sheet.max_error,
        "chosen": view.chosen,
        "naming": ["solver", "step_s", "storage_bits", "multiplier"],
        "telling": TOLD,
        "colours": ["solver", "multiplier", "storage_bits", "coefficient_slots", "status"],
        "file": "accuracy.csv",
        "report": "accuracy.json",
    }));
    let files = [
        ("accuracy.csv", "all points as CSV"),
        ("accuracy.json", "reports of all points as JSON"),
        ("work-precision.svg", "error against run time as SVG"),
        ("work-precision.png", "the same as PNG"),
    ];
    let mut reference = view.reference();
    reference.replace_range(..1, &reference[..1].to_uppercase());
    let page = Page {
        title: format!("{}: error against run time", sheet.title),
        paragraphs: vec![picture::caption(view, ""), format!("{reference}.")],
        files: files.map(|(file, what)| (file.to_owned(), what.to_owned())).into(),
        data: data.to_string(),
        footer: format!("{}: {}", text("generator"), text("command")),
    };
    page.render()
}
