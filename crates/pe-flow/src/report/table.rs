//! The summary on the terminal.

use pe_hls::mapping::RANDOM;

use super::counted::Events;
use super::errors::Errors;
use super::network::{Limiting, Start};
use super::types::{Area, Clock, Figures, FunctionTable, Headroom, OutputsIn, Parameters, Ranges, Report};
use super::values::Unbounded;

impl Report {
    /// The summary, a row per line; `size` says how large the model is.
    pub fn table(&self, size: &str) -> String {
        self.rows(size).iter().map(|(name, text)| row(name, text)).collect()
    }

    /// The rows of the summary: what a row is about, and what it says.
    pub fn rows(&self, size: &str) -> Vec<(&'static str, String)> {
        let Figures { word, error, .. } = &self.figures;
        let figures = &self.figures;
        let mut rows = vec![
            ("equations", format!("{size}, {} left out", self.left_out.len())),
            (
                "network",
                format!(
                    "{} PEs{}, {} connections, at most {} ports",
                    figures.pes,
                    if self.pes_default { " (default)" } else { "" },
                    figures.connections,
                    figures.max_in_degree
                ),
            ),
            ("mapping", format!("{}; seed {}", mapping(&self.starts), self.seed)),
            (
                "word",
                format!(
                    "{} + {} bits, multiplier {}x{}{}",
                    word.storage_bits,
                    word.guard_bits,
                    word.data_bits,
                    word.coefficient_bits,
                    if word.pipeline == "deep" { ", deep pipeline" } else { "" }
                ),
            ),
            (
                "cycles per step",
                format!(
                    "{}, {:.2} x the bound of {}: {}",
                    figures.cycles_per_step,
                    f64::from(figures.cycles_per_step) / f64::from(figures.bound_cycles),
                    figures.bound_cycles,
                    figures.bound_binds
                ),
            ),
            ("bottleneck", bottleneck(&self.bottleneck, figures.cycles_per_step)),
            (
                "speed",
                format!(
                    "{} per simulated second, {:.1} x real time at {}",
                    duration(figures.time_per_simulated_second_ms),
                    1e3 / figures.time_per_simulated_second_ms,
                    clock_words(&figures.clock)
                ),
            ),
            ("size", cells(&figures.area)),
        ];
        rows.extend(self.parameters.as_ref().map(|parameters| ("parameters", tunable(parameters))));
        rows.extend(self.outputs_in.as_ref().map(|outputs| ("outputs", outputs_in(outputs, self.outputs.len()))));
        rows.extend([
            ("headroom", headroom(self.headroom.first())),
            ("ranges", ranges(self.ranges.as_ref(), figures.pes)),
            (
                "word-length error",
                format!(
                    "{:.1e}, coefficients alone {:.1e}; worst `{}`",
                    error.word_length, error.coefficient, error.worst_state
                ),
            ),
            ("method error", format!("{:.1e} (half-step estimate)", error.method)),
            ("input-hold error", format!("{:.1e}", error.input_hold)),
        ]);
        if let Some(function) = error.function {
            rows.push(("function error", format!("{function:.1e}; {}", tables(&self.functions))));
        }
        rows.extend(self.eliminations.iter().map(|elimination| ("elimination", elimination.to_string())));
        rows.extend(self.mechanism.as_ref().map(|mechanism| ("closures", mechanism.to_string())));
        rows.extend(self.events.iter().flat_map(Events::rows));
        rows.extend(total(error).map(|text| ("total error", text)));
        let early = to_date(error);
        if !early.is_empty() {
            rows.push(("relative to date", format!("{}: of the largest magnitude up to then", early.join(", "))));
        }
        rows
    }
}

/// A row of the summary.
pub fn row(name: &str, text: &str) -> String {
    format!("  {name:<18} {text}\n")
}

fn clock_words(clock: &Clock) -> String {
    pe_target::clock::words(clock.mhz, clock.error_mhz, &clock.basis)
}

/// The best start and the random one side by side.
fn mapping(starts: &[Start]) -> String {
    let figure = |start: &Start| {
        let relays = start.relays.filter(|relays| *relays > 0);
        let relays = relays.map_or(String::new(), |relays| format!(", {relays} relays"));
        let hops = start.hops.map_or(String::new(), |hops| format!(", {hops} copies on the way"));
        format!(
            "{}: {} cycles, {} connections{relays}{hops}",
            start.start, start.cycles_per_step, start.after.connections
        )
    };
    let best = &starts[0];
    match starts.iter().find(|start| start.start == RANDOM) {
        Some(random) if best.start != RANDOM => format!("{}; {}", figure(best), figure(random)),
        _ => figure(best),
    }
}

fn bottleneck(of: &Limiting, period: u32) -> String {
    let from = of
        .main_source
        .as_ref()
        .map_or(String::new(), |source| format!(", {} of {} arrivals from {}", source.words, of.arrivals, source.from));
    let share = 100 * of.busy_cycles / period;
    format!("PE {}: {} equations, busy {share} % of the step, {}{from}", of.pe, of.equations, of.reason)
}

/// A time in the unit that leaves a number before the point.
fn duration(ms: f64) -> String {
    match ms {
        ms if ms >= 0.1 => format!("{ms:.3} ms"),
        ms if ms >= 1e-4 => format!("{:.3} us", ms * 1e3),
        ms => format!("{:.3} ns", ms * 1e6),
    }
}

/// Cells; blocks of programs are named, because synthesis may make logic of them, and so are outputs that are most of a
/// design.
fn cells(area: &Area) -> String {
    let (all, split) = (&area.cells, &area.split);
    let error = if all.lut_error > 0.0 { format!(" ± {:.0}", all.lut_error) } else { String::new() };
    let programs = match split.programs.bram18 {
        0 => String::new(),
        blocks => format!(", {blocks} of them for programs"),
    };
    let outputs = split.outputs.lut;
    let outputs = if outputs > 0.5 * all.lut { format!("; {outputs:.0} LUT are of outputs") } else { String::new() };
    format!("{:.0}{error} LUT, {} DSP, {} BRAM18{programs} ({}){outputs}", all.lut, all.dsp, all.bram18, area.basis)
}

/// Tunable parameters, and how often the design was judged.
fn tunable(Parameters { tunable, judged_at }: &Parameters) -> String {
    let ends = judged_at.len();
    format!("{} tunable; judged with the values of the spec and at {ends} ends of their ranges", tunable.len())
}

/// Where outputs are, and what the other way would take.
fn outputs_in(outputs: &OutputsIn, count: usize) -> String {
    let OutputsIn { kind, reason, ports_lut, memory_lut } = outputs;
    let place = if kind == "memory" { "in memories with a read port" } else { "ports" };
    let sizes = match (ports_lut, memory_lut) {
        (Some(ports), Some(memory)) => {
            format!("; {ports:.0} LUT with ports, {memory:.0} with memories, blocks counted in")
        }
        _ => String::new(),
    };
    format!("{count} {place}: {reason}{sizes}")
}

fn headroom(least: Option<&Headroom>) -> String {
    least.map_or("no variable".to_owned(), |Headroom { name, bits, largest, limit, .. }| {
        format!("{bits:.2} bits at least: `{name}` reaches {largest:.3e} of {limit:.3e}")
    })
}

fn ranges(ranges: Option<&Ranges>, pes: usize) -> String {
    let Some(ranges) = ranges else { return "measured, without proof".to_owned() };
    let states = &ranges.states;
    let counts = [(states.proven, "proven"), (states.probable, "probable"), (states.unknown, "unknown")];
    let counts = counts.iter().filter(|(count, _)| *count > 0).map(|(count, name)| format!("{count} {name}"));
    let counts = counts.collect::<Vec<_>>().join(", ");
    if ranges.reason.is_some() {
        return format!("{counts}: no bound for this step");
    }
    let horizon = if ranges.for_ever == Some(true) { "for ever" } else { "over the span" };
    let widened = match (ranges.widened_bits, ranges.missing_bits.unwrap_or(0)) {
        (0, 0) => String::new(),
        (0, missing) => format!("; {missing} more bits would prove all"),
        (bits, _) => format!("; formats up to {bits} bits wider"),
    };
    format!("{counts}, {horizon}; {} of {pes} PEs without saturation{widened}", ranges.pes_without_saturation)
}

fn tables(tables: &[FunctionTable]) -> String {
    let words: usize = tables.iter().map(|table| table.words).sum();
    let lookups: u64 = tables.iter().map(|table| table.lookups).sum();
    let functions: usize = tables.iter().map(|table| table.shared_by.max(1)).sum();
    let shared = if functions > tables.len() { format!(" shared by {functions} functions") } else { String::new() };
    format!("{} tables{shared}, {words} words, {lookups} lookups per step", tables.len())
}

/// The total error; nothing where nobody asked for it.
fn total(error: &Errors) -> Option<String> {
    match (error.total, &error.of_total, &error.total_reason) {
        (Some(total), Some(of), _) => Some(format!(
            "{total:.1e}, worst `{}`; at the end {:.1e}; reference good to {:.0e}",
            of.total_worst_state, of.total_at_end, of.reference_uncertainty
        )),
        (_, _, Some(reason)) if reason != Errors::NOT_ASKED => Some(format!("unknown: {reason}")),
        _ => None,
    }
}

fn to_date(error: &Errors) -> Vec<String> {
    let parts = [
        ("total", &error.total_to_date),
        ("method", &error.method_to_date),
        ("word length", &error.word_length_to_date),
        ("coefficient", &error.coefficient_to_date),
        ("function", &error.function_to_date),
        ("input hold", &error.input_hold_to_date),
    ];
    let shown = |(name, part): (&str, &Option<Unbounded>)| match part.as_ref()? {
        Unbounded::Number(number) => Some(format!("{name} {number:.1e}")),
        Unbounded::Word(word) => Some(format!("{name} {word}")),
    };
    parts.into_iter().filter_map(shown).collect()
}
