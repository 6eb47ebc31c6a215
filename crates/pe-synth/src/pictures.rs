//! The pictures of a design: network, occupancy, ranges, outputs.

use pe_ir::model::{self, Model};
use pe_plot::axis::Scale;
use pe_plot::chart::{AxisPlan, Chart, Figure, Series};
use pe_plot::ranges;
use pe_plot::style::Look;

use pe_flow::pipeline::{Design, multiplier_name};
use pe_flow::scene::quantity_of;
use pe_flow::variables::Variable;
use pe_judge::runs::Judged;

/// Networks with more PEs are not drawn: nobody could read it.
const DRAWN_PES: usize = 1000;

/// Outputs that a figure without a picture of them names.
const NAMED_OUTPUTS: usize = 12;

/// Draws the pictures that say something about the design: file names and texts.
pub fn draw(model: &Model, design: &Design, variables: &[Variable]) -> Vec<(String, String)> {
    let name = pe_emit::design_name(&design.program);
    let pes = design.program.pes.len();
    let mut pictures = vec![
        (format!("{name}_ranges.svg"), ranges::draw(&model.name, &variables.iter().map(in_range).collect::<Vec<_>>())),
        (format!("{name}_outputs.svg"), outputs(model, design)),
    ];
    if pes <= DRAWN_PES {
        pictures.push((format!("{name}_occupancy.svg"), pe_plot::occupancy::draw(&design.program)));
    }
    if (2..=DRAWN_PES).contains(&pes) {
        pictures.push((format!("{name}_network.svg"), pe_plot::network::draw(&design.program)));
    }
    pictures
}

/// A variable as the picture of ranges takes it.
fn in_range(variable: &Variable) -> ranges::Variable {
    let Variable { name, largest, lsb, limit, .. } = variable;
    let quantity = quantity_of(name).to_owned();
    ranges::Variable { name: name.clone(), quantity, largest: *largest, step: *lsb, limit: *limit }
}

/// The outputs in fixed point over those in double precision, and the difference below.
fn outputs(model: &Model, design: &Design) -> String {
    let curves = &design.judged.curves;
    let shown = curves.double.states;
    let more = model.outputs.len() - shown;
    let mut caption = format!(
        "Word of {} + {} bits, multiplier {}, step {:e} s. Below each output the difference, on its own scale.",
        design.program.format.storage_bits,
        design.program.format.guard_bits,
        multiplier_name(&design.program.format),
        model.step
    );
    if more > 0 {
        let names: Vec<&str> = model.outputs[shown..].iter().take(NAMED_OUTPUTS).map(|o| o.name.as_str()).collect();
        caption += &format!(" Not shown: {}", names.join(", "));
        caption += &if more > names.len() { format!(" and {} more outputs.", more - names.len()) } else { ".".into() };
    }
    let cells = (0..shown).map(|output| output_charts(model, &design.judged, output)).collect();
    let title = format!("{}: outputs in fixed point and in double precision", model.name);
    let columns = if shown == 1 { 1 } else { 2 };
    Figure { title, caption, width: 960.0, columns, cells }.draw()
}

fn output_charts(model: &Model, judged: &Judged, output: usize) -> Vec<Chart> {
    let declared = &model.outputs[output];
    let unit = match declared.variable {
        model::Variable::State(index) => &model.states[index].unit,
        model::Variable::Algebraic(index) => &model.algebraics[index as usize].unit,
        model::Variable::Input(index) => &model.inputs[index as usize].unit,
    };
    let of = |trajectory: &pe_sim::error::Trajectory| -> Vec<f64> {
        trajectory.samples.iter().skip(output).step_by(trajectory.states.max(1)).copied().collect()
    };
    let (double, fixed) = (of(&judged.curves.double), of(&judged.curves.fixed));
    let over_time = |numbers: Vec<f64>| judged.times.iter().copied().zip(numbers);
    let difference = fixed.iter().zip(&double).map(|(fixed, double)| fixed - double).collect();
    let end = judged.times.last().copied().unwrap_or(model.span);
    let time = |label: &str| AxisPlan::between(label, Scale::Linear, 0.0, end);
    let unit = unit.as_deref().unwrap_or("value");
    vec![
        Chart {
            title: declared.name.clone(),
            x: time(""),
            y: AxisPlan::new(unit, Scale::Linear),
            series: vec![
                Series::new("double precision", Look::broad(), over_time(double)),
                Series::new("fixed point", Look::line(0), over_time(fixed)),
            ],
            height: 130.0,
        },
        Chart {
            title: String::new(),
            x: time("time / s"),
            y: AxisPlan::new("difference", Scale::Linear),
            series: vec![Series::new(
                "fixed point minus double precision",
                Look { line: Some(&[]), width: 1.0, ..Look::line(1) },
                over_time(difference),
            )],
            height: 64.0,
        },
    ]
}
