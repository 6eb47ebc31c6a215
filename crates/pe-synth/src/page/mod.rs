//! The page of a design: what a person asks of it, in one file for a browser.
//!
//! ```text
//! names      what variables and values are called
//! work       network and occupancy
//! outputs    curves, and arrays as maps
//! ```

pub mod names;
pub mod outputs;
pub mod work;

use pe_emit::page::Page;
use pe_flow::pipeline::Design;
use pe_flow::variables::Variable;
use pe_ir::model::Model;
use pe_plot::layout::Place;
use pe_plot::network::Network;
use pe_plot::style::{LOOKS, Look};
use serde_json::{Map, Value, json};

use crate::explore::columns::{self, Column, Kind};
use crate::explore::drive::GENERATOR;
use names::Names;

/// Name of the page's file.
pub const FILE: &str = "index.html";

/// Networks with more PEs are not drawn: nobody could read it.
const DRAWN_PES: usize = 1000;

/// Variables that a page shows at most.
const MOST_VARIABLES: usize = 12_000;

/// Columns of the ranges.
const RANGES: [Column; 9] = [
    Column::shown("name", "name", Kind::Text),
    Column::shown("kind", "kind", Kind::Text),
    Column::shown("unit", "unit", Kind::Text),
    Column::shown("headroom_bits", "headroom [bits]", Kind::Number),
    Column::shown("largest", "largest", Kind::Number),
    Column::shown("limit", "limit", Kind::Number),
    Column::shown("lsb", "LSB", Kind::Number),
    Column::shown("word_length_error", "word-length error", Kind::Number),
    Column::shown("range", "range", Kind::Text),
];

/// What is told of a design besides its parts.
pub struct About<'a> {
    /// The command that makes it.
    pub command: &'a str,
    /// Its summary.
    pub rows: Vec<(&'static str, String)>,
}

/// What pages and pictures show.
pub struct Shown<'a> {
    /// The model.
    pub model: &'a Model,
    /// The design.
    pub design: &'a Design,
    /// All variables.
    pub variables: &'a [Variable],
    /// What they are called.
    pub names: Names,
    /// The network with the places of its PEs; none if it has more than [`DRAWN_PES`].
    pub network: Option<(Network, Vec<Place>)>,
}

impl Shown<'_> {
    /// Gathers it.
    pub fn of<'a>(model: &'a Model, design: &'a Design, variables: &'a [Variable]) -> Shown<'a> {
        let network = (design.program.pes.len() <= DRAWN_PES).then(|| {
            let network = Network::of(&design.program);
            let places = network.places();
            (network, places)
        });
        Shown { model, design, variables, names: Names::of(model), network }
    }
}

/// Draws the page; `pictures` are files in the same folder.
pub fn draw(shown: &Shown, about: &About, pictures: &[&str]) -> String {
    let Shown { model, design, names, .. } = shown;
    let program = &design.program;
    let name = pe_emit::design_name(program);
    let title = if model.title.is_empty() { String::new() } else { format!(": {}", model.title) };
    let mut data = Map::new();
    let mut put = |key: &str, value: Value| data.insert(key.to_owned(), value);
    put("kind", json!("design"));
    put("command", json!(about.command));
    put("summary", json!(about.rows));
    put("period", json!(program.period));
    put("drawnPes", json!(DRAWN_PES));
    put("looks", (0..LOOKS.len()).map(|at| columns::look(Look::joined(at))).collect());
    put("ranges", ranges(shown));
    put("variables", json!(shown.variables.len()));
    put("variablesFile", json!(format!("{name}_variables.csv")));
    if let Some((network, places)) = &shown.network {
        put("network", work::network(program, network, places, names));
        put("occupancy", work::occupancy(program, names));
    }
    for (key, value) in outputs::data(model, &design.judged) {
        put(key, value);
    }
    let own = [(format!("{name}_variables.csv"), "all variables as CSV"), ("report.json".to_owned(), "report as JSON")];
    let own = own.map(|(file, what)| (file, what.to_owned()));
    let pictures = pictures.iter().map(|file| (file.to_string(), file.to_string()));
    let page = Page {
        title: format!("{}{title}", model.name),
        paragraphs: Vec::new(),
        files: own.into_iter().chain(pictures).collect(),
        data: Value::Object(data).to_string(),
        footer: format!("{GENERATOR}: {}", about.command),
    };
    page.render()
}

/// The variables with their formats, those with the least headroom if they are very many.
fn ranges(shown: &Shown) -> Value {
    let mut order: Vec<&Variable> = shown.variables.iter().collect();
    if order.len() > MOST_VARIABLES {
        order.sort_by(|a, b| a.headroom().total_cmp(&b.headroom()));
        order.truncate(MOST_VARIABLES);
    }
    let row = |variable: &&Variable| {
        [
            shown.names.label(&variable.name).into_owned(),
            variable.kind.to_owned(),
            variable.unit.clone().unwrap_or_default(),
            variable.headroom().to_string(),
            variable.largest.to_string(),
            variable.limit.to_string(),
            variable.lsb.to_string(),
            variable.word_length.map_or(String::new(), |error| error.to_string()),
            variable.range.map_or(String::new(), |range| range.name().to_owned()),
        ]
    };
    let rows: Vec<[String; 9]> = order.iter().map(row).collect();
    let Value::Array(mut stored) = columns::data(&RANGES, &rows, &[]) else { unreachable!("a list of columns") };
    // The bar is drawn from other columns.
    let mut bar = stored[3].clone();
    bar["key"] = json!("bar");
    bar["name"] = json!("range in the format");
    bar["bar"] = json!(true);
    stored.insert(3, bar);
    let formulas: Vec<[String; 1]> = order.iter().map(|variable| [shown.names.formula(&variable.name)]).collect();
    if formulas.iter().any(|[formula]| !formula.is_empty()) {
        let column = [Column::shown("formula", "formula", Kind::Text)];
        stored.extend(columns::data(&column, &formulas, &[]).as_array().expect("a list of columns").iter().cloned());
    }
    Value::Array(stored)
}
