//! The pictures of a design: network, occupancy, ranges, outputs.

use std::collections::BTreeSet;

use pe_ir::model::Model;
use pe_plot::axis::Scale;
use pe_plot::chart::{AxisPlan, Chart, Field, Figure, Series};
use pe_plot::ranges;
use pe_plot::style::Look;

use crate::page::Shown;
use crate::page::names::{Names, three_digits};
use crate::page::outputs::{Array, Sorted, over_time, unit};
use pe_flow::pipeline::{Design, multiplier_name};
use pe_flow::variables::Variable;
use pe_ir::element;
use pe_judge::runs::Judged;

/// Outputs that a picture shows as curves, and arrays that it shows as maps.
const DRAWN_OUTPUTS: usize = 8;
const DRAWN_ARRAYS: usize = 4;

/// Elements of a map along an axis.
const DRAWN_ELEMENTS: usize = 48;

/// Heights of a curve, of the difference below, and of a map.
const PLANE: f64 = 130.0;
const DIFFERENCE: f64 = 64.0;
const MAP: f64 = 240.0;

/// Outputs that a figure without a picture of them names.
const NAMED_OUTPUTS: usize = 12;

/// Draws the pictures that say something about the design: file names and texts.
pub fn draw(shown: &Shown) -> Vec<(String, String)> {
    let Shown { model, design, variables, names, network } = shown;
    let name = pe_emit::design_name(&design.program);
    let ranged: Vec<ranges::Variable> = variables.iter().map(|variable| in_range(variable, names)).collect();
    let mut pictures = vec![
        (format!("{name}_ranges.svg"), ranges::draw(&model.name, &ranged)),
        (format!("{name}_outputs.svg"), outputs(model, design)),
    ];
    if let Some((network, places)) = network {
        pictures.push((format!("{name}_occupancy.svg"), pe_plot::occupancy::draw(&design.program)));
        if places.len() > 1 {
            pictures.push((format!("{name}_network.svg"), pe_plot::network::draw(&design.program, network, places)));
        }
    }
    pictures
}

/// A variable as the picture of ranges takes it.
fn in_range(variable: &Variable, names: &Names) -> ranges::Variable {
    let Variable { name, largest, lsb, limit, .. } = variable;
    let name = names.label(name).into_owned();
    let quantity = element::quantity(&name).into_owned();
    ranges::Variable { name, quantity, largest: *largest, step: *lsb, limit: *limit }
}

/// The outputs in fixed point over those in double precision, and the difference below.
fn outputs(model: &Model, design: &Design) -> String {
    let judged = &design.judged;
    let kept = &judged.curves.outputs;
    let Sorted { curves, arrays } = Sorted::of(model, kept);
    let shown = &curves[..curves.len().min(DRAWN_OUTPUTS)];
    let maps = &arrays[..arrays.len().min(DRAWN_ARRAYS)];
    let format = &design.program.format;
    let mut caption = format!(
        "Word of {} + {} bits, multiplier {}, step {:e} s.",
        format.storage_bits,
        format.guard_bits,
        multiplier_name(format),
        model.step
    );
    if !shown.is_empty() {
        caption += " Below each output the difference, on its own scale.";
    }
    if !maps.is_empty() {
        caption += " Maps are arrays in fixed point, the larger an element the darker.";
    }
    let on_maps: usize = maps.iter().map(|array| array.places.len()).sum();
    let more = model.outputs.len() - shown.len() - on_maps;
    if more > 0 {
        let drawn = maps.iter().flat_map(|array| &array.places).chain(shown).map(|place| kept[*place]);
        let drawn: BTreeSet<usize> = drawn.collect();
        let names = (0..model.outputs.len()).filter(|output| !drawn.contains(output)).take(NAMED_OUTPUTS);
        let names: Vec<&str> = names.map(|output| model.outputs[output].name.as_str()).collect();
        caption += &format!(" Not shown: {}", names.join(", "));
        caption += &if more > names.len() { format!(" and {} more outputs.", more - names.len()) } else { ".".into() };
    }
    let curves = shown.iter().map(|place| output_charts(model, judged, *place));
    let cells: Vec<Vec<Chart>> = curves.chain(maps.iter().map(|array| vec![map(model, judged, array)])).collect();
    let title = format!("{}: outputs in fixed point and in double precision", model.name);
    let columns = if cells.len() == 1 { 1 } else { 2 };
    Figure { title, caption, width: 960.0, columns, cells }.draw()
}

fn output_charts(model: &Model, judged: &Judged, place: usize) -> Vec<Chart> {
    let output = judged.curves.outputs[place];
    let [double, fixed] = [&judged.curves.double, &judged.curves.fixed].map(|curves| over_time(curves, place));
    let timed = |numbers: Vec<f64>| judged.times.iter().copied().zip(numbers);
    let difference = fixed.iter().zip(&double).map(|(fixed, double)| fixed - double).collect();
    let end = judged.times.last().copied().unwrap_or(model.span);
    let time = |label: &str| AxisPlan::between(label, Scale::Linear, 0.0, end);
    let unit = unit(model, output).unwrap_or("value");
    vec![
        Chart {
            title: model.outputs[output].name.clone(),
            x: time(""),
            y: AxisPlan::new(unit, Scale::Linear),
            series: vec![
                Series::new("double precision", Look::broad(), timed(double)),
                Series::new("fixed point", Look::line(0), timed(fixed)),
            ],
            field: None,
            height: PLANE,
        },
        Chart {
            title: String::new(),
            x: time("time / s"),
            y: AxisPlan::new("difference", Scale::Linear),
            series: vec![Series::new(
                "fixed point minus double precision",
                Look { line: Some(&[]), width: 1.0, ..Look::line(1) },
                timed(difference),
            )],
            field: None,
            height: DIFFERENCE,
        },
    ]
}

/// An array as a map: of one index over time, of two at the end of the span, of three its middle slice there.
fn map(model: &Model, judged: &Judged, array: &Array) -> Chart {
    let Array { name, first, shape, places } = array;
    let unit = unit(model, judged.curves.outputs[places[0]]).map_or(String::new(), |unit| format!(" {unit}"));
    let (fixed, times) = (&judged.curves.fixed, &judged.times);
    let end = times.last().copied().unwrap_or(model.span);
    let at = |place: usize, time: usize| fixed.samples[time * fixed.states + place];
    let last_time = times.len().saturating_sub(1);
    let thinned = |count: usize| (0..count).step_by(count.div_ceil(DRAWN_ELEMENTS)).collect::<Vec<_>>();
    let axis = |label: String, axis: usize| {
        let low = first[axis] as f64 - 0.5;
        AxisPlan::between(&label, Scale::Linear, low, low + shape[axis] as f64)
    };
    let (title, x, y, columns, numbers) = match shape.as_slice() {
        [length] => {
            let moments = thinned(times.len());
            let rows = thinned(*length);
            let numbers = rows.iter().flat_map(|row| moments.iter().map(move |time| at(places[*row], *time)));
            let x = AxisPlan::between("time / s", Scale::Linear, times.first().copied().unwrap_or(0.0), end);
            (name.to_string(), x, axis("index".to_owned(), 0), moments.len(), numbers.collect::<Vec<f64>>())
        }
        _ => {
            let [rows, columns] = [shape.len() - 2, shape.len() - 1];
            let slice = if shape.len() == 3 { shape[0] / 2 } else { 0 };
            let from = slice * shape[rows] * shape[columns];
            let (shown, across) = (thinned(shape[rows]), thinned(shape[columns]));
            let place = |row: usize, column: usize| places[from + row * shape[columns] + column];
            let place = &place;
            let numbers =
                shown.iter().flat_map(|row| across.iter().map(move |column| at(place(*row, *column), last_time)));
            let fixed = if shape.len() == 3 { format!("[{}, ..]", first[0] + slice as i64) } else { String::new() };
            let (x, y) = (axis(format!("index {}", columns + 1), columns), axis(format!("index {}", rows + 1), rows));
            (format!("{name}{fixed} at {end:.3} s"), x, y, across.len(), numbers.collect())
        }
    };
    let field = Field { columns, numbers };
    let (low, high) = field.ends();
    let thin = if shape.iter().any(|length| *length > DRAWN_ELEMENTS) { ", every few elements" } else { "" };
    Chart {
        title: format!("{title}: {} to {}{unit}{thin}", three_digits(low), three_digits(high)),
        x,
        y,
        series: Vec::new(),
        field: Some(field),
        height: MAP,
    }
}
