//! The rows of a work-precision study: `accuracy.json`, the cells of its table, and the table for the terminal.

use pe_flow::explore::row;
use serde_json::{Map, Value, json};

use crate::explore::files::{cell, plain};
use crate::explore::seal::sealed;
use crate::explore::sheet::Sheet;
use pe_flow::accuracy::goal::cheapest;
use pe_flow::accuracy::lists::Word;
use pe_flow::explore::fronts::{front, knee, time_and_error};
use pe_flow::explore::row::{Outcome, Reason, Row};
use pe_flow::report::Figures;
use pe_flow::report::errors::{Drift, OfTotal};
use pe_flow::report::values::Unbounded;

/// Rows and what they amount to.
pub struct View<'a> {
    /// The rows.
    pub sheet: &'a Sheet,
    /// Points that no other beats in error and run time, by run time.
    pub front: Vec<usize>,
    /// With a largest error the cheapest point that is right enough; without one the knee of the front.
    pub chosen: Option<usize>,
    /// The next points that are right enough.
    pub runners_up: Vec<usize>,
}

/// Seconds that the network takes for the span, at its clock.
pub fn seconds(sheet: &Sheet, row: &Row) -> Option<f64> {
    let span = sheet.head.get("span_s").and_then(Value::as_f64)?;
    Some(row.figures()?.time_ms() * 1e-3 * span)
}

/// Steps in the span: of a model with a list of steps there are more than the last one gives.
fn steps(sheet: &Sheet, row: &Row) -> Option<f64> {
    let figures = row.figures()?;
    let clocks = seconds(sheet, row)? * figures.clock.mhz * 1e6;
    Some(libm::round(clocks / f64::from(figures.cycles_per_step)))
}

/// Something that comes with a total error; null without one.
fn of_total(figures: &Figures, of: fn(&OfTotal) -> Value) -> Value {
    figures.error.of_total.as_deref().map_or(Value::Null, of)
}

/// Errors of a point that has no figures: what is known of one that misses the goal, else infinite.
fn missed(row: &Row) -> Value {
    match &row.outcome {
        Outcome::Failed(Reason { beyond: Some((total, double)), .. }) => json!({"total": total, "double": double}),
        _ => json!({"total": "inf"}),
    }
}

impl<'a> View<'a> {
    /// Finds front and choice.
    pub fn new(sheet: &'a Sheet) -> View<'a> {
        let all: Vec<usize> = (0..sheet.rows.len()).collect();
        let front = front(&sheet.rows, &all, time_and_error);
        let (chosen, runners_up) = match sheet.max_error {
            Some(limit) => {
                let ranked = cheapest(&sheet.rows, limit);
                (ranked.first().copied(), ranked.into_iter().skip(1).take(row::RUNNERS_UP).collect())
            }
            None => (knee(&sheet.rows, &front, time_and_error), Vec::new()),
        };
        View { sheet, front, chosen, runners_up }
    }

    /// `accuracy.json`.
    pub fn json(&self) -> String {
        let sheet = self.sheet;
        let rows = sheet.rows.iter().zip(&sheet.places).enumerate().map(|(index, (row, place))| {
            let mut stored = row.to_json();
            if row.figures().is_none() {
                stored.insert("error".into(), missed(row));
            }
            stored.insert("point".into(), json!(place));
            stored.insert("steps".into(), json!(steps(sheet, row)));
            stored.insert("operations".into(), json!(self.operations(row)));
            stored.insert("seconds".into(), json!(seconds(sheet, row)));
            stored.insert("on_front".into(), json!(self.front.contains(&index)));
            sealed(stored)
        });
        let place = |index: &usize| json!(sheet.places[*index]);
        let mut whole: Map<String, Value> = sheet.head.clone();
        whole.insert("points".into(), rows.collect());
        whole.insert("points_total".into(), json!(sheet.total));
        whole.insert("complete".into(), json!(sheet.rows.len() == sheet.total));
        whole.insert("max_error".into(), json!(sheet.max_error));
        whole.insert("chosen".into(), self.chosen.as_ref().map_or(Value::Null, place));
        whole.insert("runners_up".into(), self.runners_up.iter().map(place).collect());
        whole.insert("reference_agreement".into(), json!(self.agreement()));
        whole.insert("reference_vouched".into(), json!(self.vouched()));
        format!("{:#}\n", Value::Object(whole))
    }

    /// Products over the span.
    fn operations(&self, row: &Row) -> Option<f64> {
        Some(row.figures()?.macs_per_step as f64 * steps(self.sheet, row)?)
    }

    /// Largest difference of the two reference methods; none if the second found no solution.
    fn agreement(&self) -> Option<f64> {
        let figures = || self.sheet.rows.iter().filter_map(Row::figures).filter(|row| row.total_error().is_some());
        let all: Option<Vec<f64>> =
            figures().map(|row: &Figures| row.error.of_total.as_ref()?.reference_agreement).collect();
        all.filter(|all| !all.is_empty()).map(|all| all.into_iter().fold(0.0, f64::max))
    }

    /// Smallest total error.
    fn smallest(&self) -> f64 {
        let errors = self.sheet.rows.iter().filter_map(|row| row.figures()?.total_error());
        errors.fold(f64::INFINITY, f64::min)
    }

    /// Whether the reference methods agree to a tenth of the smallest error.
    fn vouched(&self) -> bool {
        self.agreement().is_some_and(|difference| 10.0 * difference <= self.smallest())
    }

    /// What there is to say about the reference.
    pub fn reference(&self) -> String {
        let figures = || self.sheet.rows.iter().filter_map(Row::figures);
        if figures().all(|row| row.total_error().is_none()) {
            let reason = figures().find_map(|row| row.error.total_reason.as_deref());
            return format!("no reference: {}", reason.unwrap_or("no point was compiled"));
        }
        let Some(difference) = self.agreement() else {
            let reason = figures().find_map(|row| row.error.of_total.as_ref()?.reference_agreement_reason.as_deref());
            return format!("reference not checked by a second method: {}", reason.unwrap_or("it gave no solution"));
        };
        let apart =
            figures().filter_map(|row| row.error.of_total.as_ref()?.reference_apart_s.flatten()).reduce(f64::min);
        let smallest = self.smallest();
        match apart {
            Some(time) => format!(
                "the two reference methods part at t = {time:.4} s (difference {difference:.0e}): the model is \
                 chaotic or unstable, and errors after that mean nothing; take a shorter --span"
            ),
            None if self.vouched() => format!(
                "two reference methods agree to {difference:.0e}, a tenth or less of the smallest error {smallest:.1e}"
            ),
            None => format!(
                "two reference methods agree to {difference:.0e} only: errors below {:.0e} mean little",
                10.0 * difference
            ),
        }
    }

    /// The cells of the table, in the order of [`COLUMNS`].
    pub fn cells(&self) -> Vec<[String; 50]> {
        let rows = self.sheet.rows.iter().zip(&self.sheet.places).enumerate();
        rows.map(|(index, (row, place))| self.fields(index, row, *place)).collect()
    }

    fn fields(&self, index: usize, row: &Row, place: usize) -> [String; 50] {
        let point = &row.point;
        let field = |of: fn(&Figures) -> Value| cell(row.figures().map(of));
        // Of a point without a result every error is infinite.
        let error = |of: fn(&Figures) -> Value| match row.figures() {
            Some(_) => field(of),
            None => "inf".to_owned(),
        };
        // What is known of a point that misses the goal.
        let missed = |known: fn((f64, f64)) -> f64, of: fn(&Figures) -> Value| match &row.outcome {
            Outcome::Failed(Reason { beyond: Some(errors), .. }) => plain(&json!(known(*errors))),
            _ => error(of),
        };
        let number = |number: Option<f64>| number.map_or(String::new(), |number| number.to_string());
        let drift = |of: fn(&Drift) -> Value| {
            let all = row.figures().and_then(|figures| figures.error.of_total.as_ref()).map(|total| &total.conserved);
            all.into_iter().flatten().map(|drift| plain(&of(drift))).collect::<Vec<_>>().join("; ")
        };
        let [status, warnings, code, message] = row.outcome.columns();
        [
            place.to_string(),
            status,
            point.solver.map_or("", |solver| solver.name()).to_owned(),
            point.step.map_or(String::new(), |step| format!("{step:e}")),
            number(steps(self.sheet, row)),
            field(|of| json!(of.stage_form)),
            field(|of| json!(of.pes)),
            point.storage.to_string(),
            field(|of| json!(of.word.guard_bits)),
            row::multiplier(point),
            field(|of| json!(of.word.coefficient_slots)),
            field(|of| json!(of.cycles_per_step)),
            field(|of| json!(of.macs_per_step)),
            number(self.operations(row)),
            field(|of| json!(of.clock.mhz)),
            number(seconds(self.sheet, row)),
            number(row.figures().map(|figures| 1e3 / figures.time_ms())),
            field(|of| json!(of.area.cells.lut)),
            field(|of| json!(of.area.cells.ff)),
            field(|of| json!(of.area.cells.dsp)),
            field(|of| json!(of.area.cells.bram18)),
            number(row.figures().map(|figures| figures.equivalent_lut())),
            missed(|errors| errors.0, |of| json!(of.error.total)),
            field(|of| of_total(of, |total| json!(total.total_worst_state))),
            error(|of| of_total(of, |total| json!(total.total_at_end))),
            error(|of| of_total(of, |total| json!(total.total_l2))),
            field(|of| of_total(of, |total| json!(total.digits_at_end))),
            missed(|errors| errors.1, |of| of_total(of, |total| json!(total.double))),
            error(|of| of_total(of, |total| json!(total.double_at_end))),
            error(|of| json!(of.error.method)),
            error(|of| json!(of.error.word_length)),
            error(|of| json!(of.error.word_length_at_end)),
            error(|of| json!(of.error.coefficient)),
            error(|of| json!(of.error.coefficient_at_end)),
            error(|of| json!(of.error.function)),
            error(|of| json!(of.error.input_hold)),
            field(|of| of_total(of, |total| json!(total.diverged_s))),
            field(|of| {
                json!(of.error.of_total.as_ref().and_then(|total| total.period.as_ref()).map(|period| &period.state))
            }),
            field(|of| {
                json!(of.error.of_total.as_ref().and_then(|total| total.period.as_ref()).map(|period| &period.seconds))
            }),
            field(|of| {
                json!(of.error.of_total.as_ref().and_then(|total| total.period.as_ref()).map(|period| &period.error))
            }),
            drift(|drift| json!(drift.name)),
            drift(|drift| json!(drift.drift)),
            field(|of| of_total(of, |total| json!(total.reference_uncertainty))),
            field(|of| of_total(of, |total| json!(total.reference_agreement))),
            u8::from(self.front.contains(&index)).to_string(),
            u8::from(self.chosen == Some(index)).to_string(),
            warnings,
            code,
            message,
            row.command.clone(),
        ]
    }

    /// The table for the terminal: front, choice with the parts of its error, what failed, what was left out.
    pub fn summary(&self) -> String {
        let mut text = format!("  {:<7} {HEADINGS}\n", "error");
        for index in &self.front {
            text += &self.line(*index, if self.chosen == Some(*index) { "<" } else { "" });
        }
        if self.front.is_empty() {
            text += "  no point has an error\n";
        }
        match (self.sheet.max_error, self.chosen) {
            (Some(limit), Some(_)) => {
                let met = cheapest(&self.sheet.rows, limit).len();
                text += &format!("  cheapest of the {met} points with an error of at most {limit:e}:\n");
            }
            (Some(limit), None) => text += &format!("  no point has an error of at most {limit:e}\n"),
            (None, Some(_)) => text += "  knee of the front, where both error and run time are small:\n",
            (None, None) => {}
        }
        if let Some(chosen) = self.chosen {
            text += &self.line(chosen, "<");
            text += &self.parts(chosen);
        }
        if !self.runners_up.is_empty() {
            text += "  next:\n";
            self.runners_up.iter().for_each(|index| text += &self.line(*index, ""));
        }
        text += &wrapped(&self.reference());
        text + &self.missing()
    }

    fn line(&self, index: usize, mark: &str) -> String {
        let row = &self.sheet.rows[index];
        let error = row.figures().and_then(|figures| figures.total_error()).unwrap_or(f64::INFINITY);
        let seconds = seconds(self.sheet, row).unwrap_or(f64::NAN);
        let line = format!(
            "  {error:<7.1e} {seconds:>9.2e} {:>6.0} {:>7.1e} {:<16} {:>8} {:<10}{:>7.0} {mark}",
            row.figures().map_or(f64::NAN, |figures| f64::from(figures.cycles_per_step)),
            self.operations(row).unwrap_or(f64::NAN),
            row.point.solver.map_or("", |solver| solver.name()),
            row::step(&row.point),
            Word::of(&row.point).name(),
            row.figures().map_or(f64::NAN, |figures| figures.equivalent_lut()),
        );
        line.trim_end().to_owned() + "\n"
    }

    /// The parts of a point's error, and what else is known of it.
    fn parts(&self, index: usize) -> String {
        let Some(figures) = self.sheet.rows[index].figures() else { return String::new() };
        let part =
            |name: &str, error: Option<f64>| error.map_or_else(String::new, |error| format!("{name} {error:.1e}, "));
        let shown = |number: &Unbounded| match number {
            Unbounded::Number(number) => format!("{number:.1e}"),
            Unbounded::Word(word) => word.clone(),
        };
        let error = &figures.error;
        let total = error.of_total.as_deref();
        let mut text = part("method", Some(error.method))
            + &part("word length", Some(error.word_length))
            + &part("of it coefficients", Some(error.coefficient))
            + &part("functions", error.function)
            + &part("input hold", Some(error.input_hold))
            + &part("at the end", total.map(|total| total.total_at_end))
            + &part("L2", total.map(|total| total.total_l2));
        if let Some(total) = total {
            text += &format!("{:.1} digits, ", total.digits_at_end);
            if let Some(period) = &total.period {
                text += &format!("period {:.4} s wrong by {}, ", period.seconds, shown(&period.error));
            }
            for conserved in &total.conserved {
                text += &format!("drift of {} {}, ", conserved.name, shown(&conserved.drift));
            }
            if let Some(time) = total.diverged_s {
                text += &format!("wrong by a tenth from t = {time:.4} s on, ");
            }
        }
        wrapped(text.trim_end_matches(", "))
    }

    /// Points without a result by reason, and methods that were left out.
    fn missing(&self) -> String {
        // Points of a solver that fail for one reason are told once, with the message of the first.
        let mut reasons: Vec<((&str, &str), &str, usize)> = Vec::new();
        for row in &self.sheet.rows {
            let Outcome::Failed(reason) = &row.outcome else { continue };
            let solver = row.point.solver.map_or("", |solver| solver.name());
            let key = (solver, reason.code.as_deref().unwrap_or(&reason.message));
            match reasons.iter_mut().find(|(known, ..)| *known == key) {
                Some((.., count)) => *count += 1,
                None => reasons.push((key, &reason.message, 1)),
            }
        }
        let mut text = String::new();
        for ((solver, key), message, count) in reasons {
            let code = if key == message { String::new() } else { format!("{key} ") };
            text += &wrapped(&format!("{count} failed: {solver}: {code}{message}"));
        }
        for left_out in self.sheet.head.get("left_out").and_then(Value::as_array).into_iter().flatten() {
            text += &wrapped(&format!("left out: {}: {}", plain(&left_out["solver"]), plain(&left_out["reason"])));
        }
        text
    }
}

/// Columns of the table after the error.
const HEADINGS: &str = " run time cycles  prod. solver               step word       eq. LUT";

/// Text in lines of at most 78 characters, indented.
fn wrapped(text: &str) -> String {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.len() + 1 + word.len() <= 74 => *line += &format!(" {word}"),
            _ => lines.push(word.to_owned()),
        }
    }
    let indented = lines.iter().enumerate().map(|(place, line)| {
        let indent = if place == 0 { "  " } else { "    " };
        format!("{indent}{line}\n")
    });
    indented.collect()
}
