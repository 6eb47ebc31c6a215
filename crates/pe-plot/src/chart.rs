//! Charts of points and lines, alone or several in a figure.

use plotters::prelude::*;

use crate::axis::{Axis, Scale};
use crate::canvas::{Anchor, Canvas, INFALLIBLE, font, picture, stroke, units};
use crate::style::{
    FINE_GRID, GRID, INK, LABEL, Look, MARGIN, SMALL, SOFT, TITLE, fitted, shaded, text_width, wrapped,
};

/// A point, with a name if it shall be read in the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Place.
    pub x: f64,
    /// Place.
    pub y: f64,
    /// Written beside it where there is room.
    pub label: Option<String>,
}

impl From<(f64, f64)> for Point {
    fn from((x, y): (f64, f64)) -> Point {
        Point { x, y, label: None }
    }
}

/// Points that belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name in the legend; series without one are not in it, those with the same name and look once.
    pub name: String,
    /// The points in the order in which they are joined.
    pub points: Vec<Point>,
    /// How they look.
    pub look: Look,
}

impl Series {
    /// A series of points without labels.
    pub fn new(name: &str, look: Look, points: impl IntoIterator<Item = (f64, f64)>) -> Series {
        Series { name: name.to_owned(), points: points.into_iter().map(Point::from).collect(), look }
    }
}

/// An axis as it is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisPlan {
    /// What it shows, with the unit.
    pub label: String,
    /// Linear or logarithmic.
    pub scale: Scale,
    /// Numbers that shall be seen whatever the points are.
    pub include: Vec<f64>,
    /// Whether the axis ends where the numbers do; otherwise there is some space.
    pub whole: bool,
}

impl AxisPlan {
    /// An axis that shows the points and some space around them.
    pub fn new(label: &str, scale: Scale) -> AxisPlan {
        AxisPlan { label: label.to_owned(), scale, include: Vec::new(), whole: false }
    }

    /// An axis from `low` to `high`, or further if the points are.
    pub fn between(label: &str, scale: Scale, low: f64, high: f64) -> AxisPlan {
        AxisPlan { label: label.to_owned(), scale, include: vec![low, high], whole: true }
    }
}

/// A chart. Points that an axis cannot show, and their number, are named below it.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// Its name, above it.
    pub title: String,
    /// Horizontal axis.
    pub x: AxisPlan,
    /// Vertical axis.
    pub y: AxisPlan,
    /// Its series, the first one at the bottom.
    pub series: Vec<Series>,
    /// Numbers that fill the plane as shades, below the series.
    pub field: Option<Field>,
    /// Height of the plane in points.
    pub height: f64,
}

/// Numbers over a rectangle, each as a shade: the larger the darker.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Numbers of a row.
    pub columns: usize,
    /// Row by row, the first one at the bottom.
    pub numbers: Vec<f64>,
}

impl Field {
    /// Shades that can be told apart.
    const SHADES: f64 = 24.0;

    fn draw(&self, canvas: &Canvas, (left, top): (f64, f64), (width, height): (f64, f64)) {
        let (low, high) = self.ends();
        let shade =
            |number: f64| (if high > low { (number - low) / (high - low) } else { 0.5 } * Field::SHADES).round();
        let rows = self.numbers.chunks(self.columns);
        let (across, up) = (width / self.columns as f64, height / rows.len() as f64);
        for (row, numbers) in rows.enumerate() {
            let bottom = top + height - row as f64 * up;
            let mut from = 0;
            // Neighbours of the same shade are one rectangle.
            for to in 1..=numbers.len() {
                if to < numbers.len() && shade(numbers[to]) == shade(numbers[from]) {
                    continue;
                }
                let (start, end) = (left + from as f64 * across, left + to as f64 * across);
                // A little larger, so that no seam shows.
                let (end, upper) = ((end + 0.4).min(left + width), (bottom - up - 0.4).max(top));
                canvas.fill((start, upper), (end, bottom), shaded(shade(numbers[from]) / Field::SHADES));
                from = to;
            }
        }
    }

    /// The smallest and the largest number.
    pub fn ends(&self) -> (f64, f64) {
        let ends = |(low, high): (f64, f64), number: &f64| (low.min(*number), high.max(*number));
        self.numbers.iter().fold((f64::INFINITY, f64::NEG_INFINITY), ends)
    }
}

/// Charts under a common title and legend: cells side by side, in each cell charts one above the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Title.
    pub title: String,
    /// A line or two below the title.
    pub caption: String,
    /// Width of the picture.
    pub width: f64,
    /// Cells in a row.
    pub columns: usize,
    /// The cells, row by row. Charts of a cell have their vertical axes at the same place.
    pub cells: Vec<Vec<Chart>>,
}

impl Chart {
    /// The chart as a picture of its own.
    pub fn draw(&self, caption: &str, width: f64) -> String {
        let chart = Chart { title: String::new(), ..self.clone() };
        let cells = vec![vec![chart]];
        Figure { title: self.title.clone(), caption: caption.to_owned(), width, columns: 1, cells }.draw()
    }

    fn points(&self) -> impl Iterator<Item = &Point> {
        self.series.iter().flat_map(|series| &series.points)
    }

    fn shows(&self, point: &Point) -> bool {
        self.x.scale.shows(point.x) && self.y.scale.shows(point.y)
    }

    fn axes(&self, width: f64) -> (Axis, Axis) {
        let shown = || self.points().filter(|point| self.shows(point));
        let numbers = shown().map(|point| point.y).chain(self.y.include.iter().copied());
        let y = Axis::new(self.y.scale, numbers, self.y.whole, (self.height / 26.0) as usize);
        let mut most = (width / 40.0) as usize;
        loop {
            let numbers = shown().map(|point| point.x).chain(self.x.include.iter().copied());
            let x = Axis::new(self.x.scale, numbers, self.x.whole, most);
            let widest = widest_label(&x);
            if most <= 2 || (widest + 14.0) * x.ticks().len() as f64 <= width {
                return (x, y);
            }
            most -= 1;
        }
    }

    /// Height of title, plane, labels and note.
    fn total_height(&self) -> f64 {
        self.title_height() + self.height + self.foot_height()
    }

    fn title_height(&self) -> f64 {
        if self.title.is_empty() { 8.0 } else { LABEL + 12.0 }
    }

    fn foot_height(&self) -> f64 {
        let name = if self.x.label.is_empty() { 0.0 } else { LABEL + 6.0 };
        let note = if self.hidden() > 0 { SMALL + 4.0 } else { 0.0 };
        SMALL + 11.0 + name + note
    }

    fn hidden(&self) -> usize {
        self.points().filter(|point| !self.shows(point)).count()
    }
}

fn widest_label(axis: &Axis) -> f64 {
    axis.ticks().iter().map(|tick| text_width(&axis.label(*tick), SMALL)).fold(0.0, f64::max)
}

impl Figure {
    /// Draws the figure.
    pub fn draw(&self) -> String {
        let columns = self.columns.clamp(1, self.cells.len().max(1));
        let inner = self.width - 2.0 * MARGIN;
        let caption = wrapped(&self.caption, SMALL, inner);
        let entries = self.legend();
        let rows = legend_rows(&entries, inner);
        let head = MARGIN + TITLE + 8.0 + caption.len() as f64 * (SMALL + 4.0) + rows.len() as f64 * (LABEL + 6.0);
        let cell_height = |cell: &Vec<Chart>| cell.iter().map(Chart::total_height).sum::<f64>();
        let row_heights: Vec<f64> =
            self.cells.chunks(columns).map(|row| row.iter().map(cell_height).fold(0.0, f64::max) + 10.0).collect();
        let height = (head + row_heights.iter().sum::<f64>() + MARGIN).ceil();
        let cell_width = (inner - (columns - 1) as f64 * 2.0 * MARGIN) / columns as f64;
        picture(&self.title, (self.width, height), |canvas| {
            let mut y = title(canvas, &self.title, &caption, inner);
            for row in &rows {
                draw_legend_row(canvas, row, y);
                y += LABEL + 6.0;
            }
            // Planes of a column begin at the same place.
            let in_column = |column| self.cells.iter().skip(column).step_by(columns).flatten();
            let margins: Vec<f64> = (0..columns).map(|column| left_margin(in_column(column), cell_width)).collect();
            for (index, row) in self.cells.chunks(columns).enumerate() {
                for (column, cell) in row.iter().enumerate() {
                    let left = MARGIN + column as f64 * (cell_width + 2.0 * MARGIN);
                    draw_cell(canvas, cell, (left, y), cell_width, margins[column]);
                }
                y += row_heights[index];
            }
        })
    }

    fn legend(&self) -> Vec<(&str, Look)> {
        let mut entries: Vec<(&str, Look)> = Vec::new();
        for series in self.cells.iter().flatten().flat_map(|chart| &chart.series) {
            let entry = (series.name.as_str(), series.look);
            if !series.name.is_empty() && !entries.contains(&entry) {
                entries.push(entry);
            }
        }
        entries
    }
}

/// Writes title and caption at the top of a picture; returns where they end.
pub(crate) fn title(canvas: &Canvas, title: &str, caption: &[String], width: f64) -> f64 {
    let mut y = MARGIN + TITLE / 2.0;
    // Bold text is a little wider than `text_width` says.
    canvas.bold(&fitted(title, TITLE * 1.1, width), (MARGIN, y), TITLE, Anchor::Start);
    y += TITLE / 2.0 + 8.0;
    for line in caption {
        canvas.toned(line, (MARGIN, y + SMALL / 2.0), SMALL, Anchor::Start, SOFT);
        y += SMALL + 4.0;
    }
    y
}

/// Length of a line in the legend.
const SAMPLE: f64 = 30.0;

/// An entry of the legend with its place in its row.
struct Entry {
    x: f64,
    text: String,
    look: Look,
}

fn legend_rows(entries: &[(&str, Look)], width: f64) -> Vec<Vec<Entry>> {
    let mut rows: Vec<Vec<Entry>> = Vec::new();
    let mut x = 0.0;
    for (name, look) in entries {
        let text = fitted(name, SMALL, width - SAMPLE - 8.0);
        let needed = SAMPLE + 6.0 + text_width(&text, SMALL);
        if rows.is_empty() || x + needed > width {
            rows.push(Vec::new());
            x = 0.0;
        }
        rows.last_mut().expect("there is a row").push(Entry { x: MARGIN + x, text, look: *look });
        x += needed + 18.0;
    }
    rows
}

fn draw_legend_row(canvas: &Canvas, row: &[Entry], top: f64) {
    let y = top + LABEL / 2.0;
    for Entry { x, text, look } in row {
        canvas.dashed(&[(*x, y), (x + SAMPLE, y)], *look);
        if let Some(marker) = look.marker {
            canvas.marker((x + SAMPLE / 2.0, y), marker, look.tone);
        }
        canvas.text(text, (x + SAMPLE + 6.0, y), SMALL, Anchor::Start);
    }
}

/// Space for the labels of vertical axes.
fn left_margin<'a>(charts: impl Iterator<Item = &'a Chart>, width: f64) -> f64 {
    // Vertical axes do not depend on the width.
    let labels = charts.map(|chart| widest_label(&chart.axes(width).1)).fold(0.0, f64::max);
    labels + 10.0 + LABEL + 8.0
}

fn draw_cell(canvas: &Canvas, cell: &[Chart], (left, top): (f64, f64), width: f64, margin: f64) {
    let mut y = top;
    for chart in cell {
        draw_chart(canvas, chart, (left, y), width, margin);
        y += chart.total_height();
    }
}

fn draw_chart(canvas: &Canvas, chart: &Chart, (left, top): (f64, f64), width: f64, margin: f64) {
    let right_margin = 14.0;
    let plane_width = width - margin - right_margin;
    let plane_top = top + chart.title_height();
    let origin = (left + margin, plane_top + chart.height);
    if !chart.title.is_empty() {
        let text = fitted(&chart.title, LABEL * 1.1, plane_width);
        canvas.bold(&text, (origin.0, top + LABEL / 2.0 + 4.0), LABEL, Anchor::Start);
    }
    let (x_axis, y_axis) = chart.axes(plane_width);
    let place = |point: &Point| {
        (origin.0 + x_axis.place(point.x) * plane_width, origin.1 - y_axis.place(point.y) * chart.height)
    };
    mesh(canvas, &x_axis, &y_axis, (left + margin, plane_top), (plane_width, chart.height));
    if let Some(field) = &chart.field {
        field.draw(canvas, (left + margin, plane_top), (plane_width, chart.height));
        canvas.frame((left + margin, plane_top), (left + margin + plane_width, origin.1), SOFT, 1.0);
    }

    let foot = origin.1 + SMALL + 11.0;
    if !chart.x.label.is_empty() {
        let text = fitted(&chart.x.label, LABEL, plane_width);
        canvas.text(&text, (origin.0 + plane_width / 2.0, foot + LABEL / 2.0), LABEL, Anchor::Middle);
    }
    let name = fitted(&chart.y.label, LABEL, chart.height + 20.0);
    canvas.upright(&name, (left + LABEL / 2.0, plane_top + chart.height / 2.0), LABEL, Anchor::Middle);
    let hidden = chart.hidden();
    if hidden > 0 {
        let points = if hidden == 1 { "1 point is" } else { &format!("{hidden} points are") };
        let note = format!("{points} not shown: not finite, or not positive on a logarithmic axis");
        let below = if chart.x.label.is_empty() { foot } else { foot + LABEL + 6.0 };
        let text = fitted(&note, SMALL, plane_width);
        canvas.toned(&text, (origin.0, below + SMALL / 2.0), SMALL, Anchor::Start, SOFT);
    }
    let mut taken: Vec<[f64; 4]> = Vec::new();
    let mut named: Vec<((f64, f64), &str)> = Vec::new();
    for series in &chart.series {
        let shown: Vec<&Point> = series.points.iter().filter(|point| chart.shows(point)).collect();
        let places: Vec<(f64, f64)> = shown.iter().map(|point| place(point)).collect();
        canvas.dashed(&places, series.look);
        if series.look.line.is_some() && shown.len() <= NAMEABLE {
            taken.extend(along(&places));
        }
        for (point, (x, y)) in shown.iter().zip(&places) {
            if let Some(marker) = series.look.marker {
                canvas.marker((*x, *y), marker, series.look.tone);
                taken.push([x - 5.0, y - 5.0, x + 5.0, y + 5.0]);
            }
            if let Some(label) = &point.label {
                named.push(((*x, *y), label));
            }
        }
    }
    let plane = [origin.0, plane_top, origin.0 + plane_width, origin.1];
    name_points(canvas, &named, &mut taken, plane);
}

/// Lines of more points than this do not keep names away.
const NAMEABLE: usize = 200;

/// Small boxes along a line.
fn along(places: &[(f64, f64)]) -> Vec<[f64; 4]> {
    let mut boxes = Vec::new();
    for pair in places.windows(2) {
        let (from, to) = (pair[0], pair[1]);
        let count = ((to.0 - from.0).abs().max((to.1 - from.1).abs()) / 4.0).ceil().max(1.0);
        for index in 0..=count as usize {
            let share = index as f64 / count;
            let (x, y) = (from.0 + share * (to.0 - from.0), from.1 + share * (to.1 - from.1));
            boxes.push([x - 1.0, y - 1.0, x + 1.0, y + 1.0]);
        }
    }
    boxes
}

/// Writes names beside points where they cover nothing.
fn name_points(canvas: &Canvas, named: &[((f64, f64), &str)], taken: &mut Vec<[f64; 4]>, plane: [f64; 4]) {
    for ((x, y), label) in named {
        let text = fitted(label, SMALL, 160.0);
        let (w, h) = (text_width(&text, SMALL), SMALL + 2.0);
        let corners = [(x + 7.0, y - h - 2.0), (x + 7.0, y + 2.0), (x - 7.0 - w, y - h - 2.0), (x - 7.0 - w, y + 2.0)];
        let boxes = corners.map(|(left, top)| [left, top, left + w, top + h]);
        let free = |b: &[f64; 4]| {
            b[0] >= plane[0]
                && b[1] >= plane[1]
                && b[2] <= plane[2]
                && b[3] <= plane[3]
                && taken.iter().all(|t| b[2] < t[0] || b[0] > t[2] || b[3] < t[1] || b[1] > t[3])
        };
        if let Some(free) = boxes.into_iter().find(free) {
            canvas.text(&text, (free[0], free[1] + h / 2.0), SMALL, Anchor::Start);
            taken.push(free);
        }
    }
}

/// Draws grid, frame and labels of a plane.
fn mesh(canvas: &Canvas, x: &Axis, y: &Axis, (left, top): (f64, f64), (width, height): (f64, f64)) {
    let label_space = (widest_label(y) + 11.0, SMALL + 11.0);
    let area = canvas.area.clone().shrink(
        (units(left - label_space.0), units(top)),
        (units(width + label_space.0), units(height + label_space.1)),
    );
    let mut chart = ChartBuilder::on(&area)
        .x_label_area_size(units(label_space.1))
        .y_label_area_size(units(label_space.0))
        .build_cartesian_2d(x.clone(), y.clone())
        .expect(INFALLIBLE);
    let style = font(SMALL, INK, false);
    chart
        .configure_mesh()
        .bold_line_style(stroke(GRID, 0.8))
        .light_line_style(stroke(FINE_GRID, 0.6))
        .axis_style(stroke(SOFT, 1.0))
        .label_style(style)
        .set_all_tick_mark_size(units(5.0))
        .x_label_formatter(&|number| x.label(*number))
        .y_label_formatter(&|number| y.label(*number))
        .draw()
        .expect(INFALLIBLE);
    canvas.frame((left, top), (left + width, top + height), SOFT, 1.0);
}
