//! A report from a design.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use pe_hls::rounding::Aim;
use pe_hls::two_slots;
use pe_ir::functions::{Scaled, Table};
use pe_ir::graph::{Chain, Factor, FormCost, Role, StepGraph, Term, ValueId};
use pe_ir::mapping::MappingCost as Cost;
use pe_ir::model::{Model, Rate};
use pe_ir::program::{CoefficientOperand, ControlWord, LinkSource, PeProgram, Program};
use pe_judge::conserved::Drift as Drifted;
use pe_judge::proof::{Certainty, Enclosed, Proof};
use pe_judge::runs::{Judged, ToDate};
use pe_judge::total::TotalError;
use pe_sim::reference::{ReferenceError, TOLERANCE};
use pe_target::area::{self, Area as Size, Family};
use pe_target::clock::{Basis, Clock as Frequency};
use pe_target::devices::Fit;

use super::counted::Events;
use super::errors::{DeviceFit, Drift, Errors, OfTotal, OutputError, Period, Use};
use super::network::{MappingCost, Start, WireLength};
use super::systems::{self, Pivot};
use super::types::{
    Area, AreaPart, AreaSplit, Cells, Certainties, Clock, EarlyStep, Figures, Form, FunctionTable, HostPart, LogicPart,
    Pairs, Parameters, Ranges, Report, SampleRate, ScaledFunction, TunableParameter, Word,
};
use crate::bottleneck::Bottleneck;
use crate::pipeline::Design;
use crate::variables::{self, Variable};
use crate::{features, scene};

/// Size and clock of a design.
#[derive(Clone, Copy, Debug)]
pub struct Silicon {
    /// Cells.
    pub area: Size,
    /// Clock.
    pub clock: Frequency,
}

/// What is known of the total error of a design: nothing where nobody asked.
pub type Total = Option<Result<TotalError, ReferenceError>>;

/// What a report tells beside the design itself.
pub struct Told<'a> {
    /// All variables.
    pub variables: &'a [Variable],
    /// Size and clock.
    pub silicon: Silicon,
    /// The total error.
    pub total: &'a Total,
    /// Seed of everything random.
    pub seed: u64,
    /// The command that makes the report.
    pub command: &'a str,
}

impl Report {
    /// The report on a design, without what the command line adds: check, device, choice, files.
    pub fn of(model: &Model, design: &Design, told: &Told) -> Report {
        let program = &design.program;
        let relayed = design.starts.iter().any(|start| start.relays > 0);
        let routed = design.starts.iter().any(|start| start.hops > 0);
        let starts = design.starts.iter().map(|start| Start {
            start: start.start.to_owned(),
            before: cost(&start.before),
            after: cost(&start.after),
            cycles_per_step: start.period,
            relays: relayed.then_some(start.relays),
            hops: routed.then_some(start.hops),
        });
        let early = model.phases.iter();
        let early = early.map(|phase| EarlyStep { until_s: phase.until, step_s: model.step / phase.ratio });
        let pivot = design.judged.smallest_pivot.as_ref();
        Report {
            generator: concat!("pe-synth ", env!("CARGO_PKG_VERSION")).to_owned(),
            model: model.name.clone(),
            odes: model.odes(),
            figures: Figures::of(model, design, told),
            pes_default: design.default_pes,
            forms: design.graph.forms.iter().map(form).collect(),
            early_steps: early.collect(),
            pairs: pairs(design),
            bottleneck: Bottleneck::of(design).report(program),
            wire_length: WireLength { total: design.wires.total, longest: design.wires.longest },
            writes_per_step: program.writes_per_step(),
            distinct_programs: distinct_programs(program),
            starts: starts.collect(),
            relays: relayed.then(|| design.starts[0].relays),
            hops: routed.then(|| design.starts[0].hops),
            instruction_words_max: program.period as usize,
            data_words_max: data_words(program),
            mechanism: None,
            events: design.judged.tally.as_ref().map(|tally| {
                let total = told.total.as_ref().and_then(|total| total.as_ref().ok());
                Events::of(model, tally, total.and_then(|total| total.events.as_ref()))
            }),
            eliminations: systems::eliminations(design),
            elimination_trials: systems::trials(design),
            smallest_pivot: pivot.map(|pivot| Pivot { state: pivot.state.clone(), magnitude: pivot.magnitude }),
            headroom: variables::report(told.variables),
            outputs: model.outputs.iter().map(|output| output.name.clone()).collect(),
            outputs_in: None,
            parameters: parameters(model, design),
            left_out: model.left_out.clone(),
            kept: scene::kept(model, &design.graph),
            features: features::features(program, &design.graph, &design.judged, &design.mapping),
            rates: (!model.rates.is_empty()).then(|| rates(model)),
            ranges: design.judged.proof.as_ref().map(|proof| ranges(proof, program, &design.graph, &design.judged)),
            functions: functions(&design.graph, &design.judged),
            stability: None,
            stability_reason: None,
            device: None,
            choice: None,
            seed: told.seed,
            command: told.command.to_owned(),
            files: BTreeMap::new(),
        }
    }
}

impl Figures {
    /// The figures of a design that differ from point to point of a sweep.
    pub fn of(model: &Model, design: &Design, told: &Told) -> Figures {
        let program = &design.program;
        let (bound, binds) = design.bound.binding();
        let Silicon { area, clock } = told.silicon;
        let transfers = design.schedule.transfers.iter();
        let is_input = |value| matches!(design.graph.value(value).role, Role::Input(_));
        Figures {
            pes: program.pes.len(),
            solver: model.solver.name().to_owned(),
            stage_form: design.graph.form.name().to_owned(),
            step_s: model.step,
            span_s: model.span,
            cycles_per_step: program.period,
            macs_per_step: design.issued().macs(),
            bound_cycles: bound,
            bound_binds: binds.to_owned(),
            connections: connections(program),
            max_in_degree: program.pes.iter().map(|pe| pe.ports.len()).max().unwrap_or(0),
            transfers_per_step: transfers.filter(|transfer| !is_input(transfer.value)).count(),
            word: word(design),
            area: size(program, &area),
            clock: Clock::of(&clock),
            time_per_simulated_second_ms: f64::from(program.period) / clock.mhz * 1e-3 / model.mean_step(),
            error: errors(model, design, told.total),
            widenings: design.judged.widenings,
        }
    }
}

impl Clock {
    /// The clock as reports have it.
    pub fn of(clock: &Frequency) -> Clock {
        let error_mhz = (clock.basis == Basis::Estimated).then_some(clock.error_mhz);
        Clock { mhz: clock.mhz, basis: clock.basis.name().to_owned(), error_mhz }
    }
}

impl DeviceFit {
    /// A design held against a device.
    pub fn of(fit: &Fit) -> DeviceFit {
        let [lut, ff, dsp, bram18] =
            fit.uses.map(|of| Use { used: of.used, available: of.available, share: of.share() });
        DeviceFit {
            name: fit.device.name.to_owned(),
            vendor: fit.device.vendor.to_owned(),
            source: fit.device.source.to_owned(),
            fits: fit.fits(),
            exceeded: fit.exceeded().map(|of| of.resource.to_owned()).collect(),
            fitting_pes: fit.fitting_pes,
            family: fit.device.family.name().to_owned(),
            lut_inputs: fit.device.family.lut_inputs(),
            lut,
            ff,
            dsp,
            bram18,
        }
    }
}

fn cost(cost: &Cost) -> MappingCost {
    MappingCost { max_load: cost.max_load, connections: cost.connections, max_in_degree: cost.max_in_degree }
}

fn form(cost: &FormCost) -> Form {
    let FormCost { form, stages, products, largest, ports, cycles } = *cost;
    Form { form: form.name().to_owned(), stages, products, largest, ports, cycles }
}

fn pairs(design: &Design) -> Pairs {
    let Some(paired) = &design.paired else {
        let reason = if !design.graph.pre_adder {
            "they would save less than one product in 32, or --no-pre-adder"
        } else if design.judged.fixed.half_scale.contains(&true) {
            "no two operands with equal coefficients share a binary point on a PE"
        } else {
            "operands do not share a binary point, or the word-length error would be above 1e-3"
        };
        return Pairs { per_step: 0, sent_home: 0, missed: 0, left_out: Some(reason.to_owned()) };
    };
    let missed = design.issued().macs() - design.optimistic.macs();
    Pairs { per_step: paired.pairs, sent_home: paired.sent_home, missed, left_out: None }
}

/// Pairs of PEs joined by a link in either direction.
fn connections(program: &Program) -> usize {
    let mut pairs = BTreeSet::new();
    for (to, pe) in program.pes.numbered() {
        for source in &pe.ports {
            // A PE may send words to itself.
            if let LinkSource::Pe(from) = source
                && *from != to
            {
                pairs.insert((to.min(*from), to.max(*from)));
            }
        }
    }
    pairs.len()
}

/// Programs that differ when coefficients are left aside: they could come from one memory.
fn distinct_programs(program: &Program) -> usize {
    fn structure(pe: &PeProgram) -> impl Iterator<Item = ControlWord> {
        pe.words.iter().map(|word| match word.coefficient {
            CoefficientOperand::Coefficient(_) => {
                ControlWord { coefficient: CoefficientOperand::Coefficient(0), ..*word }
            }
            CoefficientOperand::Stored(_) => *word,
        })
    }
    let mut pes: Vec<&PeProgram> = program.pes.iter().collect();
    pes.sort_unstable_by(|a, b| structure(a).cmp(structure(b)));
    pes.chunk_by(|a, b| structure(a).eq(structure(b))).count()
}

/// Own and imported memory of the PE that has most, in words.
fn data_words(program: &Program) -> u32 {
    program.pes.iter().map(|pe| pe.features.own_words + pe.features.imported_words).max().unwrap_or(0)
}

fn word(design: &Design) -> Word {
    let format = design.program.format;
    Word {
        storage_bits: format.storage_bits,
        guard_bits: format.guard_bits,
        data_bits: format.data_bits,
        coefficient_bits: format.coefficient_bits,
        mul_a_bits: format.data_bits,
        mul_b_bits: format.coefficient_bits,
        dsp_per_pe: format.dsp_per_pe(),
        coefficient_slots: 1 + u32::from(two_slots::used(&design.graph)),
        rounding: design.judged.aim.map_or("given", Aim::name).to_owned(),
        pipeline: format.pipeline.name().to_owned(),
    }
}

fn cells(of: &Size) -> Cells {
    Cells {
        family: of.family.name().to_owned(),
        lut: of.lut.round(),
        lut_error: of.lut_error.round(),
        ff: of.ff.round(),
        ff_error: of.ff_error.round(),
        dsp: of.dsp,
        bram18: of.bram18,
    }
}

fn size(program: &Program, area: &Size) -> Area {
    let split = &area.split;
    let part = |(lut, bram18): (f64, u32)| AreaPart { lut: lut.round(), bram18 };
    let logic = |(lut, ff): (f64, f64)| LogicPart { lut: lut.round(), ff: ff.round(), bram18: None };
    let blocks = program.output_memory().map(|_| split.outputs.2);
    let both = (split.inputs.0 + split.outputs.0, split.inputs.1 + split.outputs.1);
    Area {
        cells: cells(area),
        basis: area.basis().to_owned(),
        measured_pes: area.measured_pes,
        split: AreaSplit {
            pes: part(split.pes),
            function_tables: part(split.function_tables),
            programs: part(split.programs),
            inputs_outputs: LogicPart { bram18: blocks, ..logic(both) },
            inputs: logic(split.inputs),
            outputs: LogicPart { bram18: blocks, ..logic((split.outputs.0, split.outputs.1)) },
            sequencer: logic(split.sequencer),
            host: program.host.replaces().then(|| {
                let (lut, ff, bram18) = split.host;
                HostPart { lut: lut.round(), ff: ff.round(), bram18 }
            }),
        },
        families: Family::MEASURED.iter().map(|family| cells(&area::estimate(program, *family))).collect(),
    }
}

/// Tunable parameters, and where they were judged.
fn parameters(model: &Model, design: &Design) -> Option<Parameters> {
    let tunable = model.tunables().map(|(state, (least, greatest))| TunableParameter {
        name: state.name.clone(),
        value: state.initial,
        range: [least, greatest],
    });
    let tunable: Vec<TunableParameter> = tunable.collect();
    (!tunable.is_empty()).then(|| Parameters { tunable, judged_at: design.judged.corners.clone() })
}

fn errors(model: &Model, design: &Design, total: &Total) -> Errors {
    let errors = design.judged.errors;
    let to_date = errors.to_date;
    let known = total.as_ref().and_then(|total| total.as_ref().ok());
    let apart = |error: f64, to_date: f64| (to_date > ToDate::APART * error).then(|| to_date.into());
    let outputs = model.outputs.iter().zip(&design.judged.output_errors);
    Errors {
        worst_state: model.states[errors.worst_state].name.clone(),
        total: known.map(|total| total.whole.error),
        total_reason: match total {
            None => Some(Errors::NOT_ASKED.to_owned()),
            Some(Err(error)) => Some(error.to_string()),
            Some(Ok(_)) => None,
        },
        method: errors.method,
        word_length: errors.word_length,
        coefficient: errors.coefficient,
        word_length_at_end: errors.at_end.0,
        coefficient_at_end: errors.at_end.1,
        function: errors.function,
        function_reason: match errors.function {
            None => Some("the model has no elementary function of a variable".to_owned()),
            Some(_) => None,
        },
        input_hold: errors.input_hold,
        steps: design.judged.steps,
        samples: design.judged.times.len(),
        outputs: outputs
            .map(|(output, error)| OutputError { name: output.name.clone(), word_length: *error })
            .collect(),
        of_total: known.map(|total| Box::new(of_total(model, total))),
        total_to_date: known.and_then(|total| apart(total.whole.error, total.to_date)),
        method_to_date: apart(errors.method, to_date.method),
        word_length_to_date: apart(errors.word_length, to_date.word_length),
        coefficient_to_date: apart(errors.coefficient, to_date.coefficient),
        function_to_date: errors.function.zip(to_date.function).and_then(|(error, to_date)| apart(error, to_date)),
        input_hold_to_date: apart(errors.input_hold, to_date.input_hold),
    }
}

fn of_total(model: &Model, total: &TotalError) -> OfTotal {
    let period = total.period.map(|period| Period {
        state: model.states[period.state].name.clone(),
        seconds: period.seconds,
        error: period.error.into(),
    });
    let drift = |drift: &Drifted| Drift { name: drift.name.clone(), drift: drift.drift.into() };
    let agreement = total.agreement.ok();
    OfTotal {
        total_worst_state: model.states[total.whole.state].name.clone(),
        total_between_times: total.between,
        total_times: total.compared,
        total_at_end: total.end.error,
        total_at_end_worst_state: model.states[total.end.state].name.clone(),
        total_l2: total.l2,
        digits_at_end: total.digits,
        double: total.double.0,
        double_at_end: total.double.1,
        diverged_s: total.diverged,
        period,
        conserved: total.drift.iter().map(drift).collect(),
        reference_tolerance: TOLERANCE,
        reference_uncertainty: total.uncertainty,
        reference_method: total.method.name().to_owned(),
        reference_second_method: agreement.map(|agreement| agreement.method.name().to_owned()),
        reference_agreement: agreement.map(|agreement| agreement.difference),
        reference_agreement_reason: total.agreement.err().map(|error| error.to_string()),
        reference_apart_s: agreement.map(|agreement| agreement.apart),
    }
}

fn rates(model: &Model) -> Vec<SampleRate> {
    let steps: BTreeMap<u32, u64> = model.ticks().collect();
    let rate = |(number, rate): (u32, &Rate)| SampleRate {
        period_s: rate.period,
        steps: *steps.get(&number).unwrap_or(&1),
        states: model.states.iter().filter(|state| state.rate == Some(number)).count(),
    };
    (0..).zip(&model.rates).map(rate).collect()
}

fn ranges(proof: &Proof, program: &Program, graph: &StepGraph, judged: &Judged) -> Ranges {
    let states = proof.states(graph, &judged.fixed, &judged.largest);
    let count = |of: Certainty| states.iter().filter(|(certainty, _)| *certainty == of).count();
    let mut ranges = Ranges {
        states: Certainties {
            proven: count(Certainty::Proven),
            probable: count(Certainty::Probable),
            unknown: count(Certainty::Unknown),
        },
        pes_without_saturation: program.pes.iter().filter(|pe| pe.features.proven).count(),
        widened_bits: proof.widened,
        word_length_before: proof.word_length,
        reason: None,
        for_ever: None,
        norm: None,
        growth: None,
        rounding: None,
        missing_bits: None,
    };
    match &proof.enclosed {
        None => ranges.reason = Some("the step is not affine, or grows in every norm that was tried".to_owned()),
        Some(Enclosed { enclosure, drift, norm }) => {
            let written = graph.chains.iter().flat_map(pe_ir::graph::Chain::writes).map(|write| write.value);
            let scale = judged.fixed.format.max_word() as f64;
            let rounding = written.map(|value| enclosure.rounding[value.index()] / scale).fold(0.0, f64::max);
            ranges.for_ever = Some(enclosure.lasts);
            ranges.norm = Some(norm.to_string());
            ranges.growth = Some(drift.growth);
            ranges.rounding = Some(rounding);
            ranges.missing_bits = Some(proof.missing(graph));
        }
    }
    ranges
}

/// Equations of a table that the report names, at most.
const NAMED_EQUATIONS: usize = 8;

/// Functions that share a table that the report names, at most.
const NAMED_FUNCTIONS: usize = 8;

fn scaled(function: &Scaled) -> ScaledFunction {
    let Scaled { name, slope, offset, factor, beside } = function;
    ScaledFunction {
        name: name.clone(),
        slope: *slope,
        offset: *offset,
        factor: *factor,
        beside_slope: beside.0,
        beside_offset: beside.1,
    }
}

/// By value of a table that holds one octave what it is brought back to, by a factor or a term that another table gives.
fn results(graph: &StepGraph) -> HashMap<ValueId, ValueId> {
    let is_column = |value: ValueId| matches!(graph.value(value).role, Role::Column(..));
    let producers = graph.producers();
    let looked_up = |value: ValueId| producers[value.index()].and_then(|chain| graph.chains[chain].write.base);
    let brought_back = |chain: &Chain| {
        let [Term { operand, factor, .. }] = graph.chain_terms(chain) else { return None };
        let by = match factor {
            Factor::Value(factor) => looked_up(*factor),
            Factor::Coefficient(number) => chain.write.base.filter(|_| *number != 0.0),
        };
        by.filter(|by| is_column(*by)).map(|_| (*operand, chain.write.value))
    };
    graph.chains.iter().filter_map(brought_back).collect()
}

/// For each table its domain, its size, and its largest error, in units of the lowest bit that a data port sees of the result.
fn functions(graph: &StepGraph, judged: &Judged) -> Vec<FunctionTable> {
    let (tables, fixed) = (&graph.functions.tables, &judged.fixed);
    let mut uses = vec![0u64; tables.len()];
    let mut units = vec![f64::INFINITY; tables.len()];
    let mut equations: Vec<Vec<String>> = vec![Vec::new(); tables.len()];
    // The argument of a lookup is computed for it alone.
    let of_argument: HashMap<ValueId, usize> =
        graph.functions.lookups.iter().map(|lookup| (lookup.argument, lookup.table as usize)).collect();
    let mut products = vec![0u64; tables.len()];
    let results = results(graph);
    let unit = |value: ValueId| libm::exp2(f64::from(fixed.exponents[value.index()] + fixed.format.data_drop() as i32));
    for chain in &graph.chains {
        let write = &chain.write;
        if let Some(table) = of_argument.get(&write.value) {
            products[*table] += u64::from(chain.len());
        }
        let Some(Role::Column(lookup, column)) = write.base.map(|base| graph.value(base).role) else { continue };
        let table = graph.functions.lookups[lookup as usize].table as usize;
        products[table] += u64::from(chain.len());
        if usize::from(column) + 1 == tables[table].columns.len() {
            uses[table] += 1;
            units[table] = units[table].min(unit(*results.get(&write.value).unwrap_or(&write.value)));
            let name = graph.equation_of(write.value).map_or("", |equation| &equation.name);
            let known = equations[table].iter().any(|known| known == name);
            if equations[table].len() < NAMED_EQUATIONS && !known {
                equations[table].push(name.to_owned());
            }
        }
    }
    let row = |(index, table): (usize, &Table)| FunctionTable {
        name: table.name.clone(),
        low: table.domain.0,
        high: table.domain.1,
        layout: if table.octaves { "octaves" } else { "uniform" }.to_owned(),
        segments: graph.functions.segments.count(),
        degree: table.degree(),
        words: table.columns.iter().map(Vec::len).sum(),
        lookups: uses[index],
        products: products[index] / uses[index].max(1),
        shared_by: table.stands_for.len(),
        stands_for: table.stands_for.iter().take(NAMED_FUNCTIONS).map(scaled).collect(),
        equations: equations[index].clone(),
        bound: table.error,
        bound_lsb: table.error / units[index],
    };
    tables.iter().enumerate().map(row).collect()
}
