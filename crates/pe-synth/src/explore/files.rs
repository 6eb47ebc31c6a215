//! Rows as files: `points.json`, `points.csv`, two pictures, and a page with everything.

use pe_emit::page::{Page, Table, TableRow};
use pe_flow::explore::row;
use pe_plot::axis::Scale;
use pe_plot::chart::{AxisPlan, Chart, Point, Series};
use pe_plot::style::Look;
use serde_json::{Map, Value, json};

use super::sheet::{Front, Sheet};
use super::show;
use crate::output::Files;
use pe_flow::accuracy::wanted::{Figure, Goals};
use pe_flow::explore::fronts::{Pair, size_and_time, time_and_error};
use pe_flow::explore::row::{Outcome, Row};
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
        let pictures = [self.error_time(&fronts[0]), self.size_speed(&fronts[1])];
        let page = self.page(&fronts, &pictures);
        let [error_time, size_speed] = pictures;
        let files = [
            ("points.json", self.json(&fronts)),
            ("points.csv", self.csv(&fronts)),
            ("error_time.svg", error_time),
            ("size_speed.svg", size_speed),
            ("index.html", page),
        ];
        Ok(files.map(|(path, text)| (path, text.into_bytes())).into())
    }

    fn json(&self, fronts: &[Front]) -> String {
        let rows = self.rows.iter().zip(&self.places).enumerate().map(|(index, (row, place))| {
            let mut stored = row.to_json();
            stored.insert("point".into(), json!(place));
            let on = fronts.iter().filter(|front| front.rows.contains(&index)).map(|front| front.key);
            stored.insert("fronts".into(), json!(on.collect::<Vec<_>>()));
            Value::Object(stored)
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

    fn csv(&self, fronts: &[Front]) -> String {
        const HEAD: [&str; 28] = [
            "point",
            "status",
            "solver",
            "step_s",
            "pes",
            "multiplier",
            "storage_bits",
            "cycles_per_step",
            "bound_cycles",
            "time_per_simulated_second_ms",
            "lut",
            "ff",
            "dsp",
            "bram18",
            "equivalent_lut",
            "connections",
            "error_total",
            "error_method",
            "error_word_length",
            "error_coefficient",
            "error_input_hold",
            "worst_state",
            "on_error_time_front",
            "on_size_speed_front",
            "warnings",
            "code",
            "message",
            "command",
        ];
        table(
            HEAD,
            self.rows.iter().zip(&self.places).enumerate().map(|(index, (row, place))| {
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
            }),
        )
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
                    format!("{} PEs, {}", point.pes.unwrap_or(0), row::step(point))
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

    fn page(&self, fronts: &[Front; 2], pictures: &[String; 2]) -> String {
        let text = |key: &str| self.head.get(key).and_then(Value::as_str).unwrap_or("").to_owned();
        let mut tables: Vec<Table> = fronts
            .iter()
            .map(|front| Table {
                title: format!("{}: what no other point beats", front.title),
                head: show::HEAD.map(str::to_owned).to_vec(),
                rows: front
                    .rows
                    .iter()
                    .map(|index| TableRow {
                        cells: show::cells(&self.rows[*index]).to_vec(),
                        marked: front.knee == Some(*index),
                    })
                    .collect(),
            })
            .collect();
        let all = self.rows.iter().map(|row| {
            let mut cells = show::cells(row).to_vec();
            cells.push(match &row.outcome {
                Outcome::Compiled(compiled) => compiled.warnings.join(" "),
                Outcome::Failed(reason) => format!("{} {}", reason.code.as_deref().unwrap_or(""), reason.message),
            });
            cells.push(row.command.clone());
            TableRow { cells, marked: false }
        });
        let head = show::HEAD.iter().copied().chain(["warnings, or why it failed", "command"]);
        tables.push(Table { title: "All points".into(), head: head.map(str::to_owned).collect(), rows: all.collect() });
        let page = Page {
            title: format!("{}: size, speed and error", self.title),
            paragraphs: vec![
                self.caption("A bold row is the knee of its front."),
                "Equivalent LUTs are LUTs, 250 for each DSP block and 180 for each BRAM18, all estimated. Errors are \
                 relative to the largest magnitude of a state; the worst state counts."
                    .into(),
            ],
            pictures: pictures.to_vec(),
            tables,
            footer: format!("{}: {}", text("generator"), text("command")),
        };
        page.render()
    }
}

/// A table as a CSV file.
pub fn table<const N: usize>(head: [&str; N], rows: impl Iterator<Item = [String; N]>) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for fields in std::iter::once(head.map(str::to_owned)).chain(rows) {
        writer.write_record(fields).expect("memory takes every record");
    }
    let bytes = writer.into_inner().expect("memory takes every record");
    String::from_utf8(bytes).expect("fields are text")
}

/// A value as a cell of a table: nothing where there is none.
pub fn cell(value: Option<Value>) -> String {
    value.filter(|value| !value.is_null()).as_ref().map(plain).unwrap_or_default()
}

/// A value without quotes.
pub fn plain(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}
