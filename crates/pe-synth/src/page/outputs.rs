//! The outputs of a design over time, as data of its page: curves, and arrays whose elements are shown as a map.

use std::borrow::Cow;
use std::collections::BTreeMap;

use base64::prelude::{BASE64_STANDARD, Engine};
use pe_ir::element;
use pe_ir::model::{self, Model};
use pe_judge::runs::Judged;
use pe_sim::error::Trajectory;
use serde_json::{Value, json};

use crate::explore::columns::{digits, rounded};

/// Elements from which on an array of one index is a map; a smaller one is as many curves.
const SMALL_ARRAY: usize = 9;

/// Curves that a page has at most, and numbers of all arrays.
const MOST_CURVES: usize = 120;
const MOST_NUMBERS: usize = 200_000;

/// Outputs of a model: those that are curves, scalars first, and arrays that are maps.
pub struct Sorted<'a> {
    /// Places in the kept curves.
    pub curves: Vec<usize>,
    /// Arrays of at most three indices.
    pub arrays: Vec<Array<'a>>,
}

/// Outputs that are all elements of an array, or of a block of it.
pub struct Array<'a> {
    /// Name.
    pub name: Cow<'a, str>,
    /// First index along each axis.
    pub first: Vec<i64>,
    /// Elements along each axis.
    pub shape: Vec<usize>,
    /// Place of each element in the kept curves, the last index fastest.
    pub places: Vec<usize>,
}

impl<'a> Sorted<'a> {
    /// Sorts the outputs whose curves were kept.
    pub fn of(model: &'a Model, kept: &[usize]) -> Sorted<'a> {
        let name = |place: usize| model.outputs[kept[place]].name.as_str();
        let mut groups: BTreeMap<Cow<'a, str>, Vec<usize>> = BTreeMap::new();
        (0..kept.len()).for_each(|place| groups.entry(element::quantity(name(place))).or_default().push(place));
        let array = |(quantity, places): (&Cow<'a, str>, &Vec<usize>)| {
            let elements: BTreeMap<Vec<i64>, usize> =
                places.iter().map(|place| Some((element::parse(name(*place))?.1?, *place))).collect::<Option<_>>()?;
            let (first, last) = (elements.first_key_value()?.0, elements.last_key_value()?.0);
            let shape: Vec<usize> =
                first.iter().zip(last).map(|(a, b)| usize::try_from(b - a + 1).ok()).collect::<Option<_>>()?;
            // Every element, once: probes at single places are curves.
            let whole = elements.len() == places.len() && shape.iter().product::<usize>() == elements.len();
            let drawn = (2..=3).contains(&shape.len()) || (shape.len() == 1 && elements.len() >= SMALL_ARRAY);
            let inside = |index: &Vec<i64>| {
                index.len() == first.len()
                    && index.iter().zip(first.iter().zip(last)).all(|(i, (a, b))| a <= i && i <= b)
            };
            (whole && drawn && shape.iter().filter(|length| **length > 1).count() > 0 && elements.keys().all(inside))
                .then(|| Array {
                    name: quantity.clone(),
                    first: first.clone(),
                    shape,
                    places: elements.values().copied().collect(),
                })
        };
        let arrays: Vec<Array> = groups.iter().filter_map(array).collect();
        let in_array: std::collections::BTreeSet<usize> =
            arrays.iter().flat_map(|array| array.places.clone()).collect();
        let mut curves: Vec<usize> = (0..kept.len()).filter(|place| !in_array.contains(place)).collect();
        curves.sort_by_key(|place| name(*place).contains('['));
        Sorted { curves, arrays }
    }
}

/// Unit of an output.
pub fn unit(model: &Model, output: usize) -> Option<&str> {
    let unit = match model.outputs[output].variable {
        model::Variable::State(index) => &model.states[index].unit,
        model::Variable::Algebraic(index) => &model.algebraics[index as usize].unit,
        model::Variable::Input(index) => &model.inputs[index as usize].unit,
    };
    unit.as_deref()
}

/// An output at all sample times.
pub fn over_time(trajectory: &Trajectory, place: usize) -> Vec<f64> {
    trajectory.samples.iter().skip(place).step_by(trajectory.states.max(1)).copied().collect()
}

/// Keys of the page's data.
pub fn data(model: &Model, judged: &Judged) -> Vec<(&'static str, Value)> {
    let kept = &judged.curves;
    let Sorted { curves, arrays } = Sorted::of(model, &kept.outputs);
    let both = |place: &usize| (over_time(&kept.fixed, *place), over_time(&kept.double, *place));
    let shown = &curves[..curves.len().min(MOST_CURVES)];
    let curve = |place: &usize| {
        let (fixed, double) = both(place);
        let output = kept.outputs[*place];
        json!({
            "name": model.outputs[output].name,
            "unit": unit(model, output),
            "fixed": fixed.iter().copied().map(|number| digits(number, 7)).collect::<Vec<_>>(),
            "difference": fixed.iter().zip(&double).map(|(a, b)| rounded(a - b)).collect::<Vec<_>>(),
            "error": errors(&[(fixed, double)]),
        })
    };
    // All arrays have the same share of the times.
    let elements: usize = arrays.iter().map(|array| array.places.len()).sum();
    let times = judged.times.len();
    let frames = times.min((MOST_NUMBERS / elements.max(1)).max(2)).max(1);
    let frames: Vec<usize> = (0..frames).map(|at| at * times.saturating_sub(1) / (frames - 1).max(1)).collect();
    let array = |array: &Array| {
        let all: Vec<(Vec<f64>, Vec<f64>)> = array.places.iter().map(both).collect();
        let field = |of: &dyn Fn(f64, f64) -> f64| -> Value {
            let at = |time: usize| all.iter().map(move |(fixed, double)| of(fixed[time], double[time]));
            packed(frames.iter().flat_map(|time| at(*time)).collect())
        };
        json!({
            "name": array.name,
            "unit": unit(model, kept.outputs[array.places[0]]),
            "first": array.first,
            "shape": array.shape,
            "frames": frames,
            "fixed": field(&|fixed, _| fixed),
            "difference": field(&|fixed, double| fixed - double),
            "error": errors(&all),
        })
    };
    vec![
        ("times", json!(judged.times.iter().copied().map(rounded).collect::<Vec<_>>())),
        ("curves", shown.iter().map(curve).collect()),
        ("arrays", arrays.iter().map(array).collect()),
        ("left", json!(curves.len() - shown.len() + model.outputs.len() - kept.outputs.len())),
    ]
}

/// At each time the largest difference of several outputs, relative to the largest magnitude of any of them.
fn errors(outputs: &[(Vec<f64>, Vec<f64>)]) -> Vec<f64> {
    let scale = outputs.iter().flat_map(|(_, double)| double).fold(0.0f64, |scale, number| scale.max(number.abs()));
    let at = |time: usize| outputs.iter().map(|(fixed, double)| (fixed[time] - double[time]).abs()).fold(0.0, f64::max);
    let times = outputs.first().map_or(0, |(fixed, _)| fixed.len());
    (0..times).map(|time| if scale > 0.0 { rounded(at(time) / scale) } else { 0.0 }).collect()
}

/// Numbers as 16 bits each between the smallest and the largest, in base 64.
fn packed(numbers: Vec<f64>) -> Value {
    let (low, high) =
        numbers.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), n| (low.min(*n), high.max(*n)));
    let share = |number: f64| if high > low { (number - low) / (high - low) } else { 0.0 };
    let bytes: Vec<u8> = numbers.iter().flat_map(|n| ((share(*n) * 65535.0).round() as u16).to_le_bytes()).collect();
    json!({"low": low, "high": high, "packed": BASE64_STANDARD.encode(bytes)})
}
