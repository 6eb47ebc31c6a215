//! The work-precision diagram: error against run time, a line for each solver.

use pe_flow::explore::row;
use pe_ir::model::Solver;
use pe_plot::axis::Scale;
use pe_plot::chart::{AxisPlan, Chart, Point, Series};
use pe_plot::style::Look;

use super::view::{View, seconds};
use pe_flow::accuracy::lists::Word;
use pe_flow::explore::row::Row;
use pe_flow::report::Figures;

/// Size of the picture in points.
const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 460.0;

/// Draws the diagram as SVG.
pub fn work_precision(view: &View) -> String {
    let sheet = view.sheet;
    let chart = Chart {
        title: format!("{}: error against run time", sheet.title),
        x: AxisPlan::new("run time for the span [s]", Scale::Log),
        y: AxisPlan::new("total error", Scale::Log),
        series: series(view),
        field: None,
        height: HEIGHT,
    };
    let lines = "Lines join the steps of a solver with one word length; pale ones have no point of the front. ";
    chart.draw(&caption(view, lines), WIDTH)
}

/// What picture and page say about the points, and what one of them adds.
pub fn caption(view: &View, more: &str) -> String {
    let sheet = view.sheet;
    let text = sheet.points("study", "diverged or failed");
    let chosen = match (view.chosen, sheet.max_error) {
        (None, _) => String::new(),
        (Some(_), Some(limit)) => format!(" Ring: the cheapest point with an error of at most {limit:e}."),
        (Some(_), None) => " Ring: knee of the front.".to_owned(),
    };
    format!(
        "{text}. Clock {}. {more}Error: largest deviation of a state from the library's solution over the span, relative to \
         its largest magnitude.{chosen}",
        sheet.clock
    )
}

fn place(view: &View, row: &Row) -> Option<(f64, f64)> {
    Some((seconds(view.sheet, row)?, row.figures().and_then(Figures::total_error)?))
}

fn series(view: &View) -> Vec<Series> {
    let rows = &view.sheet.rows;
    let at = |index: &usize| place(view, &rows[*index]);
    let mut all = vec![Series::new("Pareto front", Look::broad(), view.front.iter().filter_map(at))];
    if let Some(limit) = view.sheet.max_error {
        let shown: Vec<f64> = rows.iter().filter_map(|row| place(view, row)).map(|(time, _)| time).collect();
        let (first, last) = shown.iter().fold((f64::MAX, 0.0f64), |(low, high), x| (low.min(*x), high.max(*x)));
        if !shown.is_empty() {
            all.push(Series::new(&format!("error {limit:e}"), Look::limit(), [(first, limit), (last, limit)]));
        }
    }
    let mut words: Vec<(Solver, Word)> = Vec::new();
    for row in rows {
        let Some(solver) = row.point.solver else { continue };
        let word = (solver, Word::of(&row.point));
        if !words.contains(&word) {
            words.push(word);
        }
    }
    let several = several_words(rows);
    // Lines that no point of the front is on stay behind those that matter.
    let on_front = |(solver, word): &(Solver, Word)| {
        view.front.iter().any(|at| rows[*at].point.solver == Some(*solver) && Word::of(&rows[*at].point) == *word)
    };
    words.sort_by_key(on_front);
    let best: Vec<Solver> = words.iter().filter(|word| on_front(word)).map(|(solver, _)| *solver).collect();
    for (solver, word) in words {
        let front = on_front(&(solver, word));
        let member = |row: &&Row| row.point.solver == Some(solver) && Word::of(&row.point) == word;
        let mut points: Vec<Point> = rows.iter().filter(member).filter_map(|row| point(view, row)).collect();
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        // The end of a line says which word it is.
        if let Some(last) = points.last_mut().filter(|last| several && front && last.label.is_none()) {
            last.label = Some(bits(word));
        }
        let look = Look::of_solver(solver);
        let look = if front { look } else { look.pale() };
        // A solver is in the legend once.
        let name = if front || !best.contains(&solver) { solver.name() } else { "" };
        all.push(Series { name: name.to_owned(), points, look });
    }
    if let Some(chosen) = view.chosen {
        all.push(Series::new("chosen", Look::ring(), at(&chosen)));
    }
    all.retain(|series| !series.points.is_empty());
    all
}

/// A row as a point; on the front with its step, and its word if there are several.
fn point(view: &View, row: &Row) -> Option<Point> {
    let (x, y) = place(view, row)?;
    let rows = &view.sheet.rows;
    let several = several_words(rows);
    let label = view.front.iter().any(|index| std::ptr::eq(&rows[*index], row)).then(|| {
        let step = row::step(&row.point);
        if several { format!("{step}, {}", bits(Word::of(&row.point))) } else { step }
    });
    Some(Point { x, y, label })
}

/// A word as a label: `32 bits, 25x18`.
fn bits(word: Word) -> String {
    word.name().replacen(' ', " bits, ", 1)
}

fn several_words(rows: &[Row]) -> bool {
    rows.windows(2).any(|pair| Word::of(&pair[0].point) != Word::of(&pair[1].point))
}
