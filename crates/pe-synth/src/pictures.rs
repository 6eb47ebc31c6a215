//! The pictures of a design: network, occupancy, ranges, outputs.

use pe_ir::graph::{Role, StepGraph, ValueId};
use pe_ir::model::{Model, Variable};
use pe_plot::axis::Scale;
use pe_plot::chart::{AxisPlan, Chart, Figure, Series};
use pe_plot::ranges;
use pe_plot::style::Look;

use crate::pipeline::{Design, multiplier_name};
use crate::runs::Curves;

/// Networks with more PEs are not drawn: nobody could read it.
const DRAWN_PES: usize = 1000;

/// Outputs that a figure without a picture of them names.
const NAMED_OUTPUTS: usize = 12;

/// Draws the pictures that say something about the design: file names and texts.
pub fn draw(model: &Model, design: &Design) -> Vec<(String, String)> {
    let name = pe_emit::design_name(&design.program);
    let pes = design.program.pes.len();
    let mut pictures = vec![
        (format!("{name}_ranges.svg"), ranges::draw(&model.name, &variables(model, design))),
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

/// States, algebraic variables and inputs with what was measured and what their formats hold.
fn variables(model: &Model, design: &Design) -> Vec<ranges::Variable> {
    let (graph, judged) = (&design.graph, &design.judged);
    let fixed = &judged.fixed;
    let mut variables = Vec::new();
    let mut add = |name: &str, values: &mut dyn Iterator<Item = ValueId>| {
        // An algebraic variable has a value per stage; the one that comes closest to its limit speaks for it.
        let of_value = |value: ValueId| ranges::Variable {
            name: name.to_owned(),
            quantity: name.split('[').next().unwrap_or(name).to_owned(),
            largest: judged.largest[value.index()],
            step: libm::scalbn(1.0, fixed.exponents[value.index()]),
            limit: libm::scalbn(fixed.format.max_word() as f64, fixed.exponents[value.index()]),
        };
        let least = values.map(of_value).min_by(|a, b| a.headroom().total_cmp(&b.headroom()));
        variables.extend(least);
    };
    for (state, (value, next)) in model.states.iter().zip(&graph.states) {
        add(&state.name, &mut [*value, *next].into_iter());
    }
    let stages = algebraic_values(graph, model.algebraics.len());
    for (algebraic, values) in model.algebraics.iter().zip(stages) {
        add(&algebraic.name, &mut values.into_iter());
    }
    for (input, value) in model.inputs.iter().zip(&graph.inputs) {
        add(&input.name, &mut std::iter::once(*value));
    }
    variables
}

/// For each algebraic variable its values; none if it was put in place where it is read.
fn algebraic_values(graph: &StepGraph, algebraics: usize) -> Vec<Vec<ValueId>> {
    let mut values = vec![Vec::new(); algebraics];
    for (index, value) in graph.values.iter().enumerate() {
        if let Role::Algebraic(algebraic, _) = value.role {
            values[algebraic as usize].push(ValueId(index as u32));
        }
    }
    values
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
    let cells = (0..shown).map(|output| output_charts(model, curves, output)).collect();
    let title = format!("{}: outputs in fixed point and in double precision", model.name);
    let columns = if shown == 1 { 1 } else { 2 };
    Figure { title, caption, width: 960.0, columns, cells }.draw()
}

fn output_charts(model: &Model, curves: &Curves, output: usize) -> Vec<Chart> {
    let declared = &model.outputs[output];
    let unit = match declared.variable {
        Variable::State(index) => &model.states[index as usize].unit,
        Variable::Algebraic(index) => &model.algebraics[index as usize].unit,
        Variable::Input(index) => &model.inputs[index as usize].unit,
    };
    let of = |trajectory: &pe_sim::error::Trajectory| -> Vec<f64> {
        trajectory.samples.iter().skip(output).step_by(trajectory.states.max(1)).copied().collect()
    };
    let (double, fixed) = (of(&curves.double), of(&curves.fixed));
    let over_time = |numbers: Vec<f64>| curves.times.iter().copied().zip(numbers);
    let difference = fixed.iter().zip(&double).map(|(fixed, double)| fixed - double).collect();
    let end = curves.times.last().copied().unwrap_or(model.span);
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
