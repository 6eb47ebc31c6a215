//! Random models through every stage up to the simulator.

mod support;

use pe_hls::formats::{self, Ranges};
use pe_ir::mapping::Mapping;
use pe_ir::model::Solver;
use pe_ir::word::{Latency, WordFormat};
use pe_sim::double::DoubleRun;
use pe_sim::fixed::FixedRun;
use pe_sim::machine::Machine;
use support::{FAMILIES, random_model};

#[test]
fn the_machine_computes_what_the_step_graph_says() {
    for format in [
        WordFormat { storage_bits: 32, guard_bits: 8, data_bits: 32, coefficient_bits: 32 },
        WordFormat { storage_bits: 32, guard_bits: 8, data_bits: 25, coefficient_bits: 18 },
    ] {
        for family in FAMILIES {
            for solver in [Solver::Euler, Solver::Rk4] {
                for (seed, states, pes) in [(1, 3, 1), (2, 8, 3), (3, 30, 5), (4, 25, 11)] {
                    let model = random_model(family, states, solver, seed);
                    let graph = pe_hls::step::build(&model).unwrap();
                    let mut run = DoubleRun::new(&graph);
                    for step in 0..50 {
                        run.step(&[model.inputs[0].waveform.at(step as f64 * model.step)]).unwrap();
                    }
                    let ranges = Ranges { largest: run.largest().to_vec(), widened: vec![0; graph.values.len()] };
                    let fixed = formats::choose(&graph, &ranges, format).unwrap();
                    let equations = graph.equations.len() as u32;
                    let mapping = Mapping { pes, pe_of: (0..equations).map(|e| e * 7919 % pes).collect() };
                    let latency = Latency::of(&format);
                    let schedule = pe_hls::schedule::schedule(&graph, &mapping, latency);
                    let bound = pe_hls::schedule::Bound::of(&graph, pes, latency).binding().0;
                    let violations = pe_ir::verify::schedule::check(&graph, &mapping, &schedule, latency);
                    assert!(violations.is_empty(), "{family:?} {solver:?} {seed}: {violations:#?}");
                    let program = pe_hls::assemble::assemble(&model, &graph, &fixed, &mapping, &schedule);
                    let violations = pe_ir::verify::program::check(&program, &graph, &fixed, 3);
                    assert!(violations.is_empty(), "{family:?} {solver:?} {seed}: {violations:#?}");
                    let mut machine = Machine::new(&program);
                    let mut reference = FixedRun::new(&graph, &fixed);
                    let mut lines = 0;
                    let mut worst = 0.0f64;
                    let mut run = DoubleRun::new(&graph);
                    for step in 0..20 {
                        let input = model.inputs[0].waveform.at(step as f64 * model.step);
                        let word = reference.encode_input(0, input).0;
                        reference.step(&[word]);
                        run.step(&[input]).unwrap();
                        machine.step(&[word], &mut |_| lines += 1);
                        for (index, (state, _)) in graph.states.iter().enumerate() {
                            assert_eq!(
                                machine.state(index),
                                reference.word(*state),
                                "{family:?} {solver:?} step {step}"
                            );
                            worst = worst
                                .max((run.state(index) - reference.state(index)).abs() / run.largest()[state.index()]);
                        }
                    }
                    println!(
                        "{family:?} {solver:?} {states}/{pes}: period {} bound {bound} macs {} error {worst:e} own {} imp {}",
                        schedule.period,
                        graph.macs(),
                        program.pes[0].features.own_words,
                        program.pes[0].features.imported_words
                    );
                    assert_eq!(lines, program.writes_per_step() * 20);
                }
            }
        }
    }
}
