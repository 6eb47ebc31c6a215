//! Tables in place of the functions of a step: the run that finds their arguments, and what the report says of them.

use indicatif::ProgressBar;
use pe_hls::functions::Untabled;
use pe_ir::functions::Table;
use pe_ir::graph::{FixedPoint, Role, StepGraph};
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;
use pe_ir::word::WordFormat;
use pe_sim::double::DoubleRun;
use serde_json::{Value, json};

use crate::runs;

/// Steps between two signs of life.
const STRIDE: u64 = 256;

/// Runs the exact functions over the span, and puts tables in their place for the arguments that they had.
///
/// # Errors
/// `E0901` non-finite, `E0904` a function outside its domain, `E0916` one that is too steep for a table.
pub fn tabulate(
    model: &Model,
    graph: &StepGraph,
    format: WordFormat,
    progress: &ProgressBar,
) -> Result<StepGraph, Vec<Diagnostic>> {
    progress.set_length(model.steps());
    let mut run = DoubleRun::new(graph);
    for step in 0..model.steps() {
        let time = model.time(step, 0.0);
        run.step(&model.sample_inputs(time)).map_err(|diverged| vec![runs::non_finite(graph, diverged, time)])?;
        if step.is_multiple_of(STRIDE) {
            progress.inc(STRIDE);
        }
    }
    pe_hls::functions::tabulate(graph, run.arguments(), format)
        .map_err(|untabled| untabled.into_iter().map(|untabled| with_time(model, graph, untabled)).collect())
}

/// The finding with the time at which the arguments reach the place where the function has no bounds or no table, or pass it.
fn with_time(model: &Model, graph: &StepGraph, untabled: Untabled) -> Diagnostic {
    let Untabled { function, at, mut finding } = untabled;
    let mut run = DoubleRun::new(graph);
    for step in 0..model.steps() {
        let time = model.time(step, 0.0);
        let finite = run.step(&model.sample_inputs(time)).is_ok();
        let (low, high) = run.arguments()[function];
        if low <= at && at <= high {
            finding.message += &format!("; x gets there at t = {time:.6e} s");
            break;
        }
        if !finite {
            break;
        }
    }
    finding
}

/// The tables of a step in a few words.
pub fn summary(graph: &StepGraph) -> String {
    let words: usize = graph.functions.tables.iter().flat_map(|table| &table.columns).map(Vec::len).sum();
    format!(
        "{} tables, {words} words, {} lookups per step",
        graph.functions.tables.len(),
        graph.functions.lookups.len()
    )
}

/// The key `functions` of the report: for each table its domain, its size, and its largest error, in units of the lowest
/// bit that a data port sees of the result.
pub fn report(graph: &StepGraph, fixed: &FixedPoint) -> Vec<Value> {
    let tables = &graph.functions.tables;
    let mut uses = vec![0u64; tables.len()];
    let mut units = vec![f64::INFINITY; tables.len()];
    for write in graph.chains.iter().map(|chain| &chain.write) {
        let Some(Role::Column(lookup, column)) = write.base.map(|base| graph.value(base).role) else { continue };
        let table = graph.functions.lookups[lookup as usize].table as usize;
        if usize::from(column) + 1 == tables[table].columns.len() {
            let exponent = fixed.exponents[write.value.index()] + fixed.format.data_drop() as i32;
            uses[table] += 1;
            units[table] = units[table].min(libm::exp2(f64::from(exponent)));
        }
    }
    let row = |(index, table): (usize, &Table)| {
        json!({"name": table.name, "low": table.domain.0, "high": table.domain.1,
               "layout": if table.octaves { "octaves" } else { "uniform" },
               "segments": graph.functions.segments.count(), "degree": table.degree(),
               "words": table.columns.iter().map(Vec::len).sum::<usize>(), "lookups": uses[index],
               "bound": table.error, "bound_lsb": table.error / units[index]})
    };
    tables.iter().enumerate().map(row).collect()
}
