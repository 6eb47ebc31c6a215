//! The report: `report.json`, `report-timing.json`, and the table on the terminal.

use std::collections::{BTreeMap, BTreeSet};

use pe_hls::mapping::RANDOM;
use pe_hls::rounding::Aim;
use pe_hls::two_slots;
use pe_ir::graph::{FormCost, Role};
use pe_ir::mapping::MappingCost;
use pe_ir::model::{Model, Rate};
use pe_ir::program::{ControlWord, LinkSource, Multiplier, PeProgram, Program};
use pe_ir::word::Pipeline;
use pe_sim::reference::{ReferenceError, TOLERANCE};
use serde_json::{Value, json};

use crate::bottleneck::Bottleneck;
use crate::pipeline::{Design, StartResult, multiplier_name};
use crate::variables::{self, Variable};
use crate::watch::{StageTime, Stopwatch};
use crate::{features, scene};
use pe_judge::conserved::Drift;
use pe_judge::runs::ToDate;
use pe_judge::tables;
use pe_judge::total::TotalError;
use pe_target::area::{self, Area, Family};
use pe_target::clock::{Basis, Clock};
use pe_target::devices::Fit;

/// Size and clock of a design.
#[derive(Clone, Copy, Debug)]
pub struct Silicon {
    /// Cells.
    pub area: Area,
    /// Clock.
    pub clock: Clock,
}

/// Largest indices and counts of a program.
struct Sizes {
    connections: usize,
    max_in_degree: usize,
    distinct_programs: usize,
    instruction_words: usize,
    data_words: u32,
    transfers: usize,
}

impl Sizes {
    fn of(design: &Design) -> Sizes {
        let program = &design.program;
        let transfers = design.schedule.transfers.iter();
        let is_input = |value| matches!(design.graph.value(value).role, Role::Input(_));
        Sizes {
            connections: connections(program),
            max_in_degree: program.pes.iter().map(|pe| pe.ports.len()).max().unwrap_or(0),
            distinct_programs: distinct_programs(program),
            instruction_words: program.period as usize,
            data_words: program.pes.iter().map(|p| p.features.own_words + p.features.imported_words).max().unwrap_or(0),
            transfers: transfers.filter(|transfer| !is_input(transfer.value)).count(),
        }
    }
}

/// Pairs of PEs joined by a link in either direction.
fn connections(program: &Program) -> usize {
    let mut pairs = BTreeSet::new();
    for (to, pe) in program.pes.iter().enumerate() {
        for source in &pe.ports {
            // A PE may send words to itself.
            if let LinkSource::Pe(from) = source
                && *from != to as u32
            {
                let to = to as u32;
                pairs.insert((to.min(*from), to.max(*from)));
            }
        }
    }
    pairs.len()
}

/// Programs that differ when coefficients are left aside: they could come from one memory.
fn distinct_programs(program: &Program) -> usize {
    fn structure(pe: &PeProgram) -> impl Iterator<Item = ControlWord> {
        pe.words.iter().map(|word| match word.multiplier {
            Multiplier::Coefficient(_) => ControlWord { multiplier: Multiplier::Coefficient(0), ..*word },
            Multiplier::Stored(_) => *word,
        })
    }
    let mut pes: Vec<&PeProgram> = program.pes.iter().collect();
    pes.sort_unstable_by(|a, b| structure(a).cmp(structure(b)));
    pes.chunk_by(|a, b| structure(a).eq(structure(b))).count()
}

/// Builds `report.json`. The same command gives the same bytes; machine timings are in [`timing`].
pub fn report(
    model: &Model,
    design: &Design,
    variables: &[Variable],
    Silicon { area, clock }: Silicon,
    total: &Option<Result<TotalError, ReferenceError>>,
    seed: u64,
    command: &str,
) -> Value {
    let program = &design.program;
    let sizes = Sizes::of(design);
    let (bound, binds) = design.bound.binding();
    let per_step_us = f64::from(program.period) / clock.mhz;
    let cost = |cost: &MappingCost| json!({"max_load": cost.max_load, "connections": cost.connections, "max_in_degree": cost.max_in_degree});
    let starts: Vec<Value> = design
        .starts
        .iter()
        .map(|start| {
            json!({"start": start.start, "before": cost(&start.before), "after": cost(&start.after),
                   "cycles_per_step": start.period})
        })
        .collect();
    let bottleneck = Bottleneck::of(design);
    let mut report = json!({
        "generator": concat!("pe-synth ", env!("CARGO_PKG_VERSION")),
        "model": model.name,
        "odes": model.odes(),
        "pes": program.pes.len(),
        "pes_default": design.default_pes,
        "solver": model.solver.name(),
        "stage_form": design.graph.form.name(),
        "forms": design.graph.forms.iter().map(form).collect::<Vec<_>>(),
        "step_s": model.step,
        "early_steps": model.phases.iter().map(|phase| json!({"until_s": phase.until, "step_s": model.step / phase.ratio})).collect::<Vec<_>>(),
        "span_s": model.span,
        "cycles_per_step": program.period,
        "macs_per_step": design.issued().macs(),
        "pairs": pairs(design),
        "bound_cycles": bound,
        "bound_binds": binds,
        "bottleneck": bottleneck.report(program),
        "connections": sizes.connections,
        "wire_length": {"total": design.wires.total, "longest": design.wires.longest},
        "max_in_degree": sizes.max_in_degree,
        "transfers_per_step": sizes.transfers,
        "writes_per_step": program.writes_per_step(),
        "distinct_programs": sizes.distinct_programs,
        "starts": starts,
        "word": word(design),
        "instruction_words_max": sizes.instruction_words,
        "data_words_max": sizes.data_words,
        "area": size(program, &area),
        "clock": clock_value(&clock),
        "time_per_simulated_second_ms": per_step_us * 1e-3 / model.mean_step(),
        "error": error(model, design, total),
        "smallest_pivot": design.judged.smallest_pivot.as_ref().map(|pivot| json!({"state": pivot.state, "magnitude": pivot.magnitude})),
        "headroom": variables::report(variables),
        "saturations": 0,
        "widenings": design.judged.widenings,
        "outputs": model.outputs.iter().map(|output| output.name.as_str()).collect::<Vec<_>>(),
        "left_out": model.left_out,
        "kept": scene::kept(model, &design.graph),
        "features": features::features(program, &design.graph, &design.judged, &design.mapping),
        "seed": seed,
        "command": command,
    });
    if !model.rates.is_empty() {
        let steps: BTreeMap<u32, u64> = model.ticks().collect();
        let rate = |(number, rate): (u32, &Rate)| {
            let states = model.states.iter().filter(|state| state.rate == Some(number)).count();
            json!({"period_s": rate.period, "steps": steps.get(&number).unwrap_or(&1), "states": states})
        };
        report["rates"] = json!((0..).zip(&model.rates).map(rate).collect::<Vec<_>>());
    }
    if design.starts.iter().any(|start| start.relays > 0) {
        report["relays"] = json!(design.starts[0].relays);
        for (index, start) in design.starts.iter().enumerate() {
            report["starts"][index]["relays"] = json!(start.relays);
        }
    }
    if let Some(proof) = &design.judged.proof {
        report["ranges"] = proof.report(program, &design.graph, &design.judged);
    }
    report["functions"] = json!(tables::report(&design.graph, &design.judged.fixed));
    report
}

/// The key `word`.
fn word(design: &Design) -> Value {
    let format = design.program.format;
    json!({
        "storage_bits": format.storage_bits,
        "guard_bits": format.guard_bits,
        "mul_a_bits": format.data_bits,
        "mul_b_bits": format.coefficient_bits,
        "dsp_per_pe": format.dsp_per_pe(),
        "coefficient_slots": 1 + u32::from(two_slots::used(&design.graph)),
        "rounding": design.judged.aim.map_or("given", Aim::name),
        "pipeline": format.pipeline.name(),
    })
}

/// The key `pairs`.
fn pairs(design: &Design) -> Value {
    let Some(paired) = &design.paired else {
        let reason = if !design.graph.pre_adder {
            "they could not save one product of 32, or --no-pre-adder"
        } else if design.judged.fixed.headroom.contains(&true) {
            "no two operands with equal coefficients share a binary point on a PE"
        } else {
            "operands do not share a binary point, or the word-length error would be above 1e-3"
        };
        return json!({"per_step": 0, "sent_home": 0, "missed": 0, "left_out": reason});
    };
    let missed = design.issued().macs() - design.hoped.macs();
    json!({"per_step": paired.pairs, "sent_home": paired.sent_home, "missed": missed, "left_out": null})
}

/// An entry of the key `forms`.
fn form(cost: &FormCost) -> Value {
    json!({"form": cost.form.name(), "stages": cost.stages, "products": cost.products, "largest": cost.largest,
           "ports": cost.ports, "cycles": cost.cycles})
}

/// The key `error`.
fn error(model: &Model, design: &Design, total: &Option<Result<TotalError, ReferenceError>>) -> Value {
    let errors = design.judged.errors;
    let mut value = json!({
        "worst_state": model.states[errors.worst_state].name,
        "total": null,
        "method": errors.method,
        "word_length": errors.word_length,
        "coefficient": errors.coefficient,
        "word_length_at_end": errors.at_end.0,
        "coefficient_at_end": errors.at_end.1,
        "function": errors.function,
        "input_hold": errors.input_hold,
        "steps": design.judged.steps,
        "samples": design.judged.times.len(),
        "outputs": output_errors(model, design),
    });
    for (name, error, to_date) in to_date(design, total) {
        if to_date > ToDate::APART * error {
            value[format!("{name}_to_date")] = finite(to_date);
        }
    }
    if errors.function.is_none() {
        value["function_reason"] = json!("the model has no elementary function of a variable");
    }
    match total {
        None => value["total_reason"] = json!("no reference solution was asked for with --reference"),
        Some(Err(error)) => value["total_reason"] = json!(error.to_string()),
        Some(Ok(total)) => {
            value["total"] = json!(total.whole.error);
            value["total_worst_state"] = json!(model.states[total.whole.state].name);
            value["total_between_times"] = json!(total.between);
            value["total_times"] = json!(total.compared);
            value["total_at_end"] = json!(total.end.error);
            value["total_at_end_worst_state"] = json!(model.states[total.end.state].name);
            value["total_l2"] = json!(total.l2);
            value["digits_at_end"] = json!(total.digits);
            value["double"] = json!(total.double.0);
            value["double_at_end"] = json!(total.double.1);
            value["diverged_s"] = json!(total.diverged);
            value["period"] = json!(total.period.map(|period| {
                json!({"state": model.states[period.state].name, "seconds": period.seconds,
                       "error": finite(period.error)})
            }));
            let drift = |drift: &Drift| json!({"name": drift.name, "drift": finite(drift.drift)});
            value["conserved"] = total.drift.iter().map(drift).collect();
            value["reference_tolerance"] = json!(TOLERANCE);
            value["reference_uncertainty"] = json!(total.uncertainty);
            value["reference_method"] = json!(total.method.name());
            match total.agreement {
                Ok(agreement) => {
                    value["reference_second_method"] = json!(agreement.method.name());
                    value["reference_agreement"] = json!(agreement.difference);
                    value["reference_apart_s"] = json!(agreement.apart);
                }
                Err(error) => {
                    value["reference_agreement"] = Value::Null;
                    value["reference_agreement_reason"] = json!(error.to_string());
                }
            }
        }
    }
    value
}

/// Errors over the span by the names of their keys, each with the same relative to the magnitudes up to then.
fn to_date<'a>(
    design: &Design,
    total: &Option<Result<TotalError, ReferenceError>>,
) -> impl Iterator<Item = (&'a str, f64, f64)> + use<'a> {
    let errors = design.judged.errors;
    let to_date = errors.to_date;
    let total = total.as_ref().and_then(|total| total.as_ref().ok()).map(|total| (total.whole.error, total.to_date));
    let pairs = [
        ("total", total),
        ("method", Some((errors.method, to_date.method))),
        ("word_length", Some((errors.word_length, to_date.word_length))),
        ("coefficient", Some((errors.coefficient, to_date.coefficient))),
        ("function", errors.function.zip(to_date.function)),
        ("input_hold", Some((errors.input_hold, to_date.input_hold))),
    ];
    pairs.into_iter().filter_map(|(name, pair)| pair.map(|(error, to_date)| (name, error, to_date)))
}

/// A number, or `inf` for one that has no place in JSON.
fn finite(number: f64) -> Value {
    if number.is_finite() { json!(number) } else { json!("inf") }
}

/// Word-length errors of the outputs that are drawn.
fn output_errors(model: &Model, design: &Design) -> Vec<Value> {
    let named = model.outputs.iter().zip(&design.judged.output_errors);
    named.map(|(output, error)| json!({"name": output.name, "word_length": error})).collect()
}

/// Builds `report-timing.json`.
pub fn timing(watch: &Stopwatch, design: &Design) -> Value {
    let map = |of: &dyn Fn(&StageTime) -> Value| -> serde_json::Map<String, Value> {
        watch.stages.iter().map(|time| (time.stage.to_owned(), of(time))).collect()
    };
    json!({
        "seconds": map(&|time| json!(time.seconds)),
        "seconds_without_runs": watch.seconds_without_runs(),
        "processor_seconds": map(&|time| json!(time.processor_seconds)),
        "processor_seconds_without_runs": watch.processor_seconds_without_runs(),
        "double_ns_per_mac": design.judged.ns_per_mac.0,
        "fixed_ns_per_mac": design.judged.ns_per_mac.1,
        "peak_memory_mb": peak_memory_mb(),
    })
}

/// Peak resident memory of this process, where the system tells.
fn peak_memory_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_ascii_whitespace().nth(1)?.parse::<f64>().ok().map(|kib| kib / 1024.0)
}

/// Best start and random start side by side.
fn mapping_row(design: &Design) -> String {
    let figure = |start: &StartResult| {
        let relays = if start.relays > 0 { format!(", {} relays", start.relays) } else { String::new() };
        format!("{}: {} cycles, {} connections{relays}", start.start, start.period, start.after.connections)
    };
    let random = design.starts.iter().find(|start| start.start == RANDOM);
    let best = &design.starts[0];
    match random {
        Some(random) if best.start != RANDOM => format!("{}; {}", figure(best), figure(random)),
        _ => figure(best),
    }
}

/// What is proven about ranges, in words.
fn ranges(design: &Design) -> String {
    match &design.judged.proof {
        None => "measured, without proof".to_owned(),
        Some(proof) => proof.summary(&design.program, &design.graph, &design.judged),
    }
}

/// The total error in words.
fn total_row(model: &Model, total: &Result<TotalError, ReferenceError>) -> String {
    match total {
        Ok(total) => format!(
            "{:.1e}, worst `{}`; at the end {:.1e}; reference good to {:.0e}",
            total.whole.error, model.states[total.whole.state].name, total.end.error, total.uncertainty
        ),
        Err(error) => format!("unknown: {error}"),
    }
}

/// The summary table.
pub fn table(
    model: &Model,
    design: &Design,
    variables: &[Variable],
    Silicon { area, clock }: Silicon,
    total: &Option<Result<TotalError, ReferenceError>>,
    seed: u64,
) -> String {
    let program = &design.program;
    let errors = design.judged.errors;
    let sizes = Sizes::of(design);
    let (bound, binds) = design.bound.binding();
    let time_ms = f64::from(program.period) / clock.mhz * 1e-3 / model.mean_step();
    let defaulted = if design.default_pes { " (default)" } else { "" };
    let mut rows = vec![
        ("equations", format!("{}, {} left out", model.size(), model.left_out.len())),
        (
            "network",
            format!(
                "{} PEs{defaulted}, {} connections, at most {} ports",
                program.pes.len(),
                sizes.connections,
                sizes.max_in_degree
            ),
        ),
        ("mapping", format!("{}; seed {seed}", mapping_row(design))),
        (
            "word",
            format!(
                "{} + {} bits, multiplier {}{}",
                program.format.storage_bits,
                program.format.guard_bits,
                multiplier_name(&program.format),
                if program.format.pipeline == Pipeline::Deep { ", deep pipeline" } else { "" }
            ),
        ),
        (
            "cycles per step",
            format!(
                "{}, {:.2} x the bound of {bound}: {binds}",
                program.period,
                f64::from(program.period) / f64::from(bound)
            ),
        ),
        ("bottleneck", Bottleneck::of(design).summary(program)),
        (
            "speed",
            format!(
                "{} per simulated second, {:.1} x real time at {}",
                duration(time_ms),
                1e3 / time_ms,
                clock.words()
            ),
        ),
        ("size", size_row(&area)),
        ("headroom", variables::summary(variables)),
        ("ranges", ranges(design)),
        (
            "word-length error",
            format!(
                "{:.1e}, coefficients alone {:.1e}; worst `{}`",
                errors.word_length, errors.coefficient, model.states[errors.worst_state].name
            ),
        ),
        ("method error", format!("{:.1e} (half-step estimate)", errors.method)),
        ("input-hold error", format!("{:.1e}", errors.input_hold)),
    ];
    if let Some(function) = errors.function {
        rows.push(("function error", format!("{function:.1e}; {}", tables::summary(&design.graph))));
    }
    if let Some(total) = total {
        rows.push(("total error", total_row(model, total)));
    }
    let early = to_date(design, total).filter(|(_, error, to_date)| *to_date > ToDate::APART * *error);
    let early: Vec<String> =
        early.map(|(name, _, to_date)| format!("{} {to_date:.1e}", name.replace('_', " "))).collect();
    if !early.is_empty() {
        rows.push(("relative to date", format!("{}: of the largest magnitude up to then", early.join(", "))));
    }
    rows.iter().map(|(name, text)| row(name, text)).collect()
}

/// Cells in words; blocks of programs are named, because synthesis may make logic of them.
fn size_row(area: &Area) -> String {
    let programs = area.split.programs.1;
    let note = match programs {
        0 => String::new(),
        _ => format!(", {programs} of them for programs"),
    };
    format!("{}, {} DSP, {} BRAM18{note} ({})", area.lut_words(), area.dsp, area.bram18, area.basis())
}

/// A time in the unit that leaves a number before the point.
fn duration(ms: f64) -> String {
    match ms {
        ms if ms >= 0.1 => format!("{ms:.3} ms"),
        ms if ms >= 1e-4 => format!("{:.3} us", ms * 1e3),
        ms => format!("{:.3} ns", ms * 1e6),
    }
}

/// Cells, where they are, and what other families take.
fn size(program: &Program, area: &Area) -> Value {
    let cells = |of: &Area| {
        json!({"family": of.family.name(), "lut": of.lut.round(), "lut_error": of.lut_error.round(),
               "ff": of.ff.round(), "ff_error": of.ff_error.round(), "dsp": of.dsp, "bram18": of.bram18})
    };
    let mut size = cells(area);
    size["basis"] = json!(area.basis());
    size["measured_pes"] = json!(area.measured_pes);
    let split = &area.split;
    size["split"] = json!({
        "pes": {"lut": split.pes.0.round(), "bram18": split.pes.1},
        "programs": {"lut": split.programs.0.round(), "bram18": split.programs.1},
        "inputs_outputs": {"lut": split.ports.round()},
        "sequencer": {"lut": split.sequencer.round()},
    });
    size["families"] = Family::MEASURED.iter().map(|family| cells(&area::estimate(program, *family))).collect();
    size
}

/// The key `clock`.
pub fn clock_value(clock: &Clock) -> Value {
    let mut value = json!({"mhz": clock.mhz, "basis": clock.basis.name()});
    if clock.basis == Basis::Estimated {
        value["error_mhz"] = json!(clock.error_mhz);
    }
    value
}

/// The key `device`.
pub fn fit_value(fit: &Fit) -> Value {
    let mut value = json!({
        "name": fit.device.name,
        "vendor": fit.device.vendor,
        "source": fit.device.source,
        "fits": fit.fits(),
        "exceeded": fit.exceeded().map(|of| of.resource).collect::<Vec<_>>(),
        "fitting_pes": fit.fitting_pes,
        "family": fit.device.family.name(),
        "lut_inputs": fit.device.family.lut_inputs(),
        "lut_inputs_counted": fit.device.family.lut_inputs(),
    });
    for of in &fit.uses {
        value[of.resource] = json!({"used": of.used, "available": of.available, "share": of.share()});
    }
    value
}

/// A row of the summary table.
pub fn row(name: &str, text: &str) -> String {
    format!("  {name:<18} {text}\n")
}
