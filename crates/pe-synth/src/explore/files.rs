//! Rows as files: `points.json`, `points.csv`, two pictures, and a page with everything.

use pe_emit::page::Page;
use pe_flow::explore::row;
use pe_ir::index::at;
use pe_plot::axis::Scale;
use pe_plot::chart::{AxisPlan, Chart, Point, Series};
use pe_plot::style::{Look, counted};
use serde_json::{Map, Value, json};

use super::columns::{self, Column, Kind};
use super::seal::sealed;
use super::sheet::{Front, Sheet};
use crate::output::Files;
use pe_flow::accuracy::wanted::{Figure, Goals, USUAL_ERROR};
use pe_flow::explore::fronts::{Pair, size_and_time, time_and_error};
use pe_flow::explore::row::Row;
use pe_flow::failure::Failure;
use pe_flow::report::Figures;

/// Looks that can be told apart in black and white.
const LOOKS: usize = 6;

/// Size of the pictures in points.
const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 420.0;

impl Sheet {
    /// All files: path and content.
    ///
    /// # Errors
    /// None here; sweeps of other kinds have files that may fail.
    pub fn files(&self) -> Result<Files, Failure> {
        let fronts = self.fronts();
        let [error_time, size_speed] = [self.error_time(&fronts[0]), self.size_speed(&fronts[1])];
        let cells = self.cells(&fronts);
        let files = [
            ("points.json", self.json(&fronts)),
            ("points.csv", columns::csv(&COLUMNS, &cells)),
            ("error_time.svg", error_time),
            ("size_speed.svg", size_speed),
            ("index.html", self.page(&cells, &fronts)),
        ];
        Ok(files.map(|(path, text)| (path, text.into_bytes())).into())
    }

    fn json(&self, fronts: &[Front]) -> String {
        let rows = self.rows.iter().zip(&self.places).enumerate().map(|(index, (row, place))| {
            let mut stored = row.to_json();
            stored.insert("point".into(), json!(place));
            let on = fronts.iter().filter(|front| front.rows.contains(&index)).map(|front| front.key);
            stored.insert("fronts".into(), json!(on.collect::<Vec<_>>()));
            sealed(stored)
        });
        let mut whole = self.head.clone();
        whole.insert("points".into(), rows.collect());
        whole.insert("points_total".into(), json!(self.total));
        whole.insert("max_error".into(), json!(self.max_error));
        whole.insert("complete".into(), json!(self.rows.len() == self.total));
        let place = |row: Option<usize>| row.map(|row| self.places[row]);
        let knees: Map<String, Value> =
            fronts.iter().map(|front| (front.key.to_owned(), json!(place(front.knee)))).collect();
        whole.insert("knees".into(), Value::Object(knees));
        if self.goals.limits().next().is_some() {
            let mut met = self.goals.ranked(&self.rows).into_iter();
            whole.insert("chosen".into(), json!(place(met.next())));
            let next = met.take(row::RUNNERS_UP).map(|row| json!(self.places[row]));
            whole.insert("runners_up".into(), next.collect());
        }
        let Goals { realtime, fit, minimise, .. } = self.goals;
        if realtime.is_some() || fit.is_some() || minimise != Figure::default() {
            let binding =
                self.goals.binding(&self.rows).map(|(limit, gain)| json!({"limit": limit.name(), "gain": gain}));
            let misses = self.goals.misses(&self.rows).into_iter().map(|miss| {
                let limits = miss.limits.iter().map(|(limit, factor)| json!({"limit": limit.name(), "factor": factor}));
                json!({"point": self.places[miss.row], "limits": limits.collect::<Vec<_>>()})
            });
            let goals = json!({
                "realtime": realtime,
                "fits": fit.map(|device| device.name),
                "minimise": minimise.name(),
                "binding": binding,
                "misses": misses.collect::<Vec<_>>(),
            });
            whole.insert("goals".into(), goals);
        }
        format!("{:#}\n", Value::Object(whole))
    }

    /// The cells of the table, in the order of [`COLUMNS`].
    fn cells(&self, fronts: &[Front]) -> Vec<[String; 28]> {
        let cells = self.rows.iter().zip(&self.places).enumerate().map(|(index, (row, place))| {
            let point = &row.point;
            let field = |of: fn(&Figures) -> Value| cell(row.figures().map(of));
            let on = |front: &Front| (front.rows.contains(&index) as u8).to_string();
            let [status, warnings, code, message] = row.outcome.columns();
            [
                place.to_string(),
                status,
                point.solver.map_or("", |solver| solver.name()).to_owned(),
                point.step.map_or(String::new(), |step| format!("{step:e}")),
                point.pes.map_or(String::new(), |pes| pes.to_string()),
                row::multiplier(point),
                point.storage.to_string(),
                field(|of| json!(of.cycles_per_step)),
                field(|of| json!(of.bound_cycles)),
                field(|of| json!(of.time_per_simulated_second_ms)),
                field(|of| json!(of.area.cells.lut)),
                field(|of| json!(of.area.cells.ff)),
                field(|of| json!(of.area.cells.dsp)),
                field(|of| json!(of.area.cells.bram18)),
                row.figures().map(|figures| figures.equivalent_lut().to_string()).unwrap_or_default(),
                field(|of| json!(of.connections)),
                field(|of| json!(of.error.total)),
                field(|of| json!(of.error.method)),
                field(|of| json!(of.error.word_length)),
                field(|of| json!(of.error.coefficient)),
                field(|of| json!(of.error.input_hold)),
                field(|of| json!(of.error.worst_state)),
                on(&fronts[0]),
                on(&fronts[1]),
                warnings,
                code,
                message,
                row.command.clone(),
            ]
        });
        cells.collect()
    }

    /// What a picture says about its points.
    fn caption(&self, more: &str) -> String {
        format!("{}. Clock {}. {more}", self.points("sweep", "failed, or are too wrong for a network,"), self.clock)
    }

    fn error_time(&self, front: &Front) -> String {
        let without = self.rows.iter().filter_map(Row::figures).filter(|row| row.total_error().is_none()).count();
        let mut more = "Total error: largest deviation of a state from the library's solution, relative to its \
                        largest magnitude."
            .to_owned();
        if without > 0 {
            more += &format!(" {without} have no total error and are not shown.");
        }
        let chart = Chart {
            title: format!("{}: error against run time", self.title),
            x: AxisPlan::new("run time per simulated second [ms]", Scale::Log),
            y: AxisPlan::new("total error", Scale::Log),
            series: self.series(front, time_and_error),
            field: None,
            height: HEIGHT,
        };
        chart.draw(&self.caption(&more), WIDTH)
    }

    fn size_speed(&self, front: &Front) -> String {
        fn size_and_speed(figures: &Figures) -> Option<(f64, f64)> {
            size_and_time(figures).map(|(size, time_ms)| (size, 1e3 / time_ms))
        }
        let chart = Chart {
            title: format!("{}: {}", self.title, front.title.to_lowercase()),
            x: AxisPlan::new("size [equivalent LUTs]", Scale::Log),
            y: AxisPlan::new("speed [times real time]", Scale::Log),
            series: self.series(front, size_and_speed),
            field: None,
            height: HEIGHT,
        };
        let mut more = "Equivalent LUTs: LUTs, 250 for each DSP block, 180 for each BRAM18; estimated.".to_owned();
        if self.max_error.is_some() {
            more += " Points of a larger error are shown, but do not compete.";
        }
        chart.draw(&self.caption(&more), WIDTH)
    }

    /// The front, and the points by solver, multiplier and storage as far as looks go.
    fn series(&self, front: &Front, pair: Pair) -> Vec<Series> {
        let place = |index: usize| pair(self.rows[index].figures()?);
        let line = Series::new("Pareto front", Look::broad(), front.rows.iter().filter_map(|index| place(*index)));
        let names = self.series_names();
        let mut kinds: Vec<&String> = Vec::new();
        names.iter().for_each(|name| {
            if !kinds.contains(&name) {
                kinds.push(name)
            }
        });
        let series = kinds.iter().enumerate().map(|(kind, name)| {
            let members = (0..self.rows.len()).filter(|index| names[*index] == **name);
            let points = members.filter_map(|index| {
                let (x, y) = place(index)?;
                let label = front.rows.contains(&index).then(|| {
                    let point = &self.rows[index].point;
                    format!("{}, {}", counted(at(point.pes.unwrap_or(0)), "PE"), row::step(point))
                });
                Some(Point { x, y, label })
            });
            Series { name: (*name).clone(), points: points.collect(), look: Look::markers(kind) }
        });
        std::iter::once(line).chain(series).filter(|series| !series.points.is_empty()).collect()
    }

    /// The series that each row belongs to: told by as many properties as there are looks for.
    fn series_names(&self) -> Vec<String> {
        let properties: [fn(&Row) -> String; 3] = [
            |row| row.point.solver.map_or("", |solver| solver.name()).to_owned(),
            |row| row::multiplier(&row.point),
            |row| format!("{} bits", row.point.storage),
        ];
        let mut names = vec![String::new(); self.rows.len()];
        for property in properties {
            let values: Vec<String> = self.rows.iter().map(property).collect();
            if values.windows(2).all(|pair| pair[0] == pair[1]) {
                continue;
            }
            let finer: Vec<String> =
                names.iter().zip(&values).map(|(name, value)| format!("{name} {value}").trim().to_owned()).collect();
            let kinds: std::collections::BTreeSet<&String> = finer.iter().collect();
            if kinds.len() <= LOOKS {
                names = finer;
            }
        }
        names
    }

    /// The point that meets the goals best; the knee of a front if there is none.
    fn best(&self, fronts: &[Front]) -> Option<usize> {
        let chosen = self.goals.limits().next().and_then(|_| self.goals.ranked(&self.rows).into_iter().next());
        chosen.or(fronts[1].knee).or(fronts[0].knee)
    }

    fn page(&self, cells: &[[String; 28]], fronts: &[Front]) -> String {
        let text = |key: &str| self.head.get(key).and_then(Value::as_str).unwrap_or("").to_owned();
        let time = "run time per simulated second [ms]";
        let size = "size [equivalent LUTs]";
        let data = columns::page_data(json!({
            "columns": columns::data(&COLUMNS, cells, &["time_per_simulated_second_ms", "equivalent_lut", "error_total"]),
            "plots": [
                {"title": "Error against run time", "x": "time_per_simulated_second_ms", "y": "error_total",
                 "names": [time, "total error"], "least": USUAL_ERROR},
                {"title": "Run time against size", "x": "equivalent_lut", "y": "time_per_simulated_second_ms",
                 "names": [size, time], "least": 0.0},
            ],
            "error": "error_total",
            "limit": self.max_error,
            "chosen": self.best(fronts),
            "naming": ["solver", "step_s", "storage_bits", "multiplier", "pes"],
            "telling": TOLD,
            "colours": ["solver", "multiplier", "storage_bits", "pes", "status"],
            "file": "points.csv",
            "report": "points.json",
        }));
        let files = [
            ("points.csv", "all points as CSV"),
            ("points.json", "reports of all points as JSON"),
            ("error_time.svg", "error against run time as SVG"),
            ("size_speed.svg", "size against speed as SVG"),
        ];
        let page = Page {
            title: format!("{}: size, speed and error", self.title),
            paragraphs: vec![
                self.caption("Ring: the point that meets the goals best, else the knee of a front."),
                "Equivalent LUTs are LUTs, 250 for each DSP block and 180 for each BRAM18, all estimated. Errors are \
                 relative to the largest magnitude of a state; the worst state counts."
                    .into(),
            ],
            files: files.map(|(file, what)| (file.to_owned(), what.to_owned())).into(),
            data: data.to_string(),
            footer: format!("{}: {}", text("generator"), text("command")),
        };
        page.render()
    }
}

/// What the page tells of a point under the pointer.
const TOLD: [&str; 9] = [
    "solver",
    "step_s",
    "storage_bits",
    "multiplier",
    "pes",
    "error_total",
    "time_per_simulated_second_ms",
    "equivalent_lut",
    "cycles_per_step",
];

/// Columns of `points.csv`.
const COLUMNS: [Column; 28] = [
    Column::shown("point", "point", Kind::Count),
    Column::new("status", "status", Kind::Text),
    Column::shown("solver", "solver", Kind::Text),
    Column::shown("step_s", "step", Kind::Seconds),
    Column::shown("pes", "PEs", Kind::Count),
    Column::shown("multiplier", "multiplier", Kind::Text),
    Column::shown("storage_bits", "bits", Kind::Count),
    Column::shown("cycles_per_step", "cycles per step", Kind::Count),
    Column::new("bound_cycles", "lower bound of the cycles", Kind::Count),
    Column::shown("time_per_simulated_second_ms", "ms per simulated second", Kind::Number),
    Column::shown("lut", "LUTs", Kind::Number),
    Column::new("ff", "flip-flops", Kind::Number),
    Column::shown("dsp", "DSP blocks", Kind::Count),
    Column::shown("bram18", "BRAM18", Kind::Count),
    Column::shown("equivalent_lut", "equivalent LUTs", Kind::Number),
    Column::new("connections", "connections", Kind::Count),
    Column::shown("error_total", "total error", Kind::Number),
    Column::new("error_method", "method error", Kind::Number),
    Column::new("error_word_length", "word-length error", Kind::Number),
    Column::new("error_coefficient", "coefficient error", Kind::Number),
    Column::new("error_input_hold", "input-hold error", Kind::Number),
    Column::new("worst_state", "worst state", Kind::Text),
    Column::new("on_error_time_front", "on the front of errors", Kind::Count),
    Column::new("on_size_speed_front", "on the front of sizes", Kind::Count),
    Column::new("warnings", "warnings", Kind::Text),
    Column::new("code", "code", Kind::Text),
    Column::shown("message", "why it failed", Kind::Text),
    Column::new("command", "command", Kind::Text),
];

/// A value as a cell of a table: nothing where there is none.
pub fn cell(value: Option<Value>) -> String {
    value.filter(|value| !value.is_null()).as_ref().map(plain).unwrap_or_default()
}

/// A value without quotes.
pub fn plain(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}
