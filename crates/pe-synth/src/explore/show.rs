//! Rows as a person reads them.

use super::sheet::Sheet;
use pe_flow::accuracy::wanted::Figure;
use pe_flow::explore::row::{self, RUNNERS_UP};
use pe_flow::explore::row::{Outcome, Row};
use pe_flow::report::Figures;

/// Columns of [`cells`].
pub const HEAD: [&str; 12] =
    ["error", "ms per s", "x real time", "eq. LUT", "LUT", "DSP", "BRAM18", "cycles", "PEs", "solver", "step", "word"];

/// The figures of a row.
pub fn cells(row: &Row) -> [String; 12] {
    let point = &row.point;
    let figure = |show: &dyn Fn(&Figures) -> String| row.figures().map_or("-".to_owned(), show);
    let count = |of: fn(&Figures) -> f64| figure(&|figures| format!("{:.0}", of(figures)));
    [
        figure(&|figures| figures.total_error().map_or("-".into(), |error| format!("{error:.1e}"))),
        figure(&|figures| format!("{:.3}", figures.time_ms())),
        figure(&|figures| format!("{:.1}", 1e3 / figures.time_ms())),
        figure(&|figures| format!("{:.0}", figures.equivalent_lut())),
        count(|of| of.area.cells.lut),
        count(|of| of.area.cells.dsp.into()),
        count(|of| of.area.cells.bram18.into()),
        count(|of| of.cycles_per_step.into()),
        point.pes.map_or(String::new(), |pes| pes.to_string()),
        point.solver.map_or("", |solver| solver.name()).to_owned(),
        row::step(point),
        format!("{} bits, {}", point.storage, row::multiplier(point)),
    ]
}

/// The summary for the terminal: both fronts, and the points that failed by reason.
pub fn summary(sheet: &Sheet) -> String {
    let mut text = String::new();
    for front in sheet.fronts() {
        if front.rows.is_empty() {
            text += &format!("  {}: no point\n", front.title);
            continue;
        }
        text += &format!("  {}: points that no other beats in both\n", front.title);
        let lines = front.rows.iter().map(|index| {
            let knee = if front.knee == Some(*index) { "  <- knee" } else { "" };
            (cells(&sheet.rows[*index]), knee)
        });
        text += &columns(&lines.collect::<Vec<_>>());
    }
    let goals = &sheet.goals;
    if goals.limits().next().is_some() {
        let met = goals.ranked(&sheet.rows);
        let order = match goals.minimise {
            Figure::Time => "Cheapest by run time, then size",
            Figure::Area => "Smallest, then by run time",
            Figure::Error => "Smallest total error, then by run time",
        };
        text += &format!("  {order}, with {}\n", goals.words());
        let lines = met
            .iter()
            .take(1 + RUNNERS_UP)
            .enumerate()
            .map(|(place, index)| (cells(&sheet.rows[*index]), if place == 0 { "  <- chosen" } else { "" }));
        text += &columns(&lines.collect::<Vec<_>>());
        if sheet.rows.iter().any(|row| row.figures().is_some()) && goals.concern_others() {
            text += &judged(sheet);
        }
    }
    if let Some(smallest) = sheet.out_of_reach() {
        text += &format!("  The smallest total error is {smallest:.1e}: `--max-error any` lets all points compete\n");
    }
    let mut reasons: Vec<(String, usize)> = Vec::new();
    for row in &sheet.rows {
        if let Outcome::Failed(reason) = &row.outcome {
            let limit = sheet.runs_within();
            let name = match (reason.is_beyond(), limit) {
                (true, Some(limit)) => format!("total error beyond {limit:e}; `--max-error any` designs these, too"),
                _ => reason.code.clone().unwrap_or_else(|| reason.message.clone()),
            };
            match reasons.iter_mut().find(|(known, _)| *known == name) {
                Some((_, count)) => *count += 1,
                None => reasons.push((name, 1)),
            }
        }
    }
    for (name, count) in reasons {
        text += &format!("  {count} failed: {name}\n");
    }
    if sheet.late {
        let (done, total) = (sheet.rows.len(), sheet.total);
        text += &format!("  {done} of {total} points in the time of `--within`; `--resume` goes on\n");
    }
    text
}

/// What the goals cost, and what would meet them with a little more.
fn judged(sheet: &Sheet) -> String {
    let (goals, rows) = (&sheet.goals, &sheet.rows);
    let mut text = String::new();
    if let Some((limit, gain)) = goals.binding(rows) {
        let figure = goals.minimise.words();
        text += &format!("  binding: {}; without it the {figure} could be {gain:.2} times smaller\n", limit.name());
    }
    if goals.ranked(rows).is_empty() {
        let (why, nearest) = goals.refusal(rows, described);
        return text + &format!("  {why}; {nearest}\n");
    }
    for miss in goals.misses(rows) {
        let row = &rows[miss.row];
        let taken: Vec<String> = miss.limits.iter().map(|limit| goals.taken(*limit, row)).collect();
        text += &format!("  missed: {} would take {}\n", described(row), taken.join(" and "));
    }
    text
}

/// A point in a few words.
pub fn described(row: &Row) -> String {
    let [.., pes, solver, step, word] = cells(row);
    format!("{solver}, step {step}, {word}, PEs: {pes}")
}

fn columns(lines: &[([String; 12], &str)]) -> String {
    let mut widths = HEAD.map(str::len);
    for (cells, _) in lines {
        for (width, cell) in widths.iter_mut().zip(cells) {
            *width = (*width).max(cell.len());
        }
    }
    let row = |cells: [&str; 12]| {
        let cells = cells.iter().zip(widths).map(|(cell, width)| format!("{cell:>width$}"));
        format!("    {}", cells.collect::<Vec<_>>().join("  "))
    };
    let mut text = row(HEAD) + "\n";
    for (cells, note) in lines {
        text += &format!("{}{note}\n", row(cells.each_ref().map(String::as_str)));
    }
    text
}
