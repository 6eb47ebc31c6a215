//! How long each stage takes on two models of the paper: `cargo bench`, or one of them by name, such as
//! `cargo bench -- schedule/weibel11`. `xtask benchmarks` makes a table of what Criterion notes.

#![allow(missing_docs, reason = "Criterion's macros make public functions")]

use std::hint::black_box;
use std::path::PathBuf;

use clap::Parser;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use pe_flow::pipeline;
use pe_flow::spec::LoadedModel;
use pe_flow::watch::Stopwatch;
use pe_hls::mapping::{self, MapOptions, Problem};
use pe_ir::word::Latency;
use pe_judge::progress::silent;
use pe_judge::runs;
use pe_sim::double::DoubleRun;
use pe_sim::fixed::FixedRun;
use pe_sim::machine::Machine;
use pe_synth::options::DesignArgs;

/// Models, and the PEs of the smaller of the paper's two networks of each.
const MODELS: [(&str, &str); 2] = [("weibel11", "64"), ("atrial15", "63")];

/// Steps of a simulated stretch.
const STEPS: u64 = 20;

/// The command line of a model, with a span of ten steps.
fn options(model: &str, pes: &str) -> DesignArgs {
    let spec = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("../../models/{model}/{model}.spec"));
    let options = ["--pes", pes, "--step", "100us", "--span", "1ms", "--multiplier", "25x18", "--allow", "E0903"];
    let words = ["bench".into(), spec.into_os_string()].into_iter().chain(options.iter().map(Into::into));
    DesignArgs::parse_from(words)
}

fn stages(criterion: &mut Criterion) {
    for (model, pes) in MODELS {
        let options = options(model, pes);
        let load = || options.load().expect("the model is read");
        let compile =
            |loaded: &LoadedModel| options.design(loaded, &mut Stopwatch::silent()).expect("the model compiles");
        let loaded = load();
        let design = compile(&loaded);
        let (graph, fixed, program) = (&design.graph, &design.judged.fixed, &design.program);
        let (issued, issued_fixed) = (design.issued(), design.paired.as_ref().map_or(fixed, |paired| &paired.fixed));
        let mut bench = |stage: &str, amount: Throughput, work: &mut dyn FnMut()| {
            let mut group = criterion.benchmark_group(stage);
            group.sample_size(10).throughput(amount);
            group.bench_function(model, |bencher| bencher.iter(&mut *work));
            group.finish();
        };
        let equations = Throughput::Elements(graph.equations.len() as u64);
        let products = |steps: u64| Throughput::Elements(graph.macs() * steps);
        bench("parse", equations.clone(), &mut || drop(load()));
        let step_options = pe_flow::settings::step_options(&options.point.point(), &options.mapping.options());
        bench("step", equations.clone(), &mut || {
            drop(pe_hls::step::build_with(&loaded.model, &step_options).expect("built before"));
        });
        let problem = Problem::of(graph);
        let map_options = MapOptions {
            pes: design.mapping.pes,
            seed: options.model.seed,
            tries: MapOptions::default_tries(problem.equations()),
            max_in_degree: options.mapping.options().ports(),
        };
        bench("map", equations.clone(), &mut || drop(mapping::map(&problem, &map_options).expect("mapped before")));
        let latency = Latency::of(&fixed.format);
        bench("schedule", equations.clone(), &mut || {
            drop(pe_hls::schedule::schedule(issued, &design.mapping, latency));
        });
        let schedule = pe_hls::schedule::schedule(issued, &design.mapping, latency);
        bench("assemble", equations.clone(), &mut || {
            let assembled = pe_hls::assemble::assemble(&loaded.model, issued, issued_fixed, &design.mapping, &schedule);
            drop(assembled.expect("assembled before"));
        });
        let emit = pe_emit::EmitOptions { default_steps: 1, ..pe_emit::EmitOptions::default() };
        bench("emit", equations.clone(), &mut || drop(pe_emit::emit(program, &emit)));

        let inputs: Vec<Vec<f64>> =
            (0..STEPS).map(|step| loaded.model.sample_inputs(step as f64 * loaded.model.step)).collect();
        let mut double = DoubleRun::new(graph);
        bench("double", products(STEPS), &mut || {
            inputs.iter().for_each(|inputs| double.step(inputs).expect("the model is stable"));
        });
        let mut run = FixedRun::new(graph, fixed);
        let words: Vec<Vec<i64>> = (0..STEPS).map(|step| runs::port_words(&loaded.model, &run, step)).collect();
        // Beyond the span words may saturate, which takes as long.
        bench("fixed", products(STEPS), &mut || {
            for words in &words {
                black_box(run.step(words));
            }
        });
        let mut machine = Machine::new(program);
        let clocks = u64::from(program.period) * program.pes.len() as u64 * STEPS;
        let stimulus = pipeline::stimulus(&loaded.model, &design, 0, STEPS);
        bench("simulate", Throughput::Elements(clocks), &mut || {
            stimulus.iter().for_each(|words| machine.step(words, &mut |_| {}));
        });
        bench("runs", products(loaded.model.steps()), &mut || {
            let judged = runs::judge(&loaded.model, graph, fixed.format, &options.model.criteria(), silent());
            assert!(judged.is_ok(), "judged before");
        });
        bench("end to end", equations, &mut || drop(compile(&load())));
    }
}

criterion_group!(benches, stages);
criterion_main!(benches);
