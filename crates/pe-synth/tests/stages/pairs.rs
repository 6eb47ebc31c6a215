//! Own memories no deeper than their words need: pairs of words that change roles, beside base memories as deep and deeper.

use crate::support::agree::engines;
use crate::support::bench::assert_agreement;
use crate::support::flow::{Flow, Placement, format};
use crate::support::models::{Compiled, compile};
use pe_ir::index::PeId;
use pe_ir::memory::depth;
use pe_ir::model::Solver;
use pe_ir::program::{PeProgram, Program};
use pe_ir::verify;
use pe_ir::word::Pipeline;

/// A design of one stage with tables.
fn flow(pes: u32, pipeline: Pipeline, seed: u64) -> Flow {
    let format = format(32, 25, 18).with_pipeline(pipeline);
    Flow::tabled((9, pes), Solver::Euler, format, Placement::Scattered, seed)
}

/// A design with pairs that are written after the end of the round.
fn neuron() -> Compiled {
    compile("hodgkin_huxley", &["--solver", "euler", "--step", "5us", "--pes", "2", "--allow", "E0903"])
}

/// Whether pairs of a PE leave a bit of their own addresses out of those of the base memory.
fn is_shallow(pe: &PeProgram) -> bool {
    pe.features.swap && pe.features.own_words <= pe.features.base_words
}

/// How many own words of a PE something reads or writes.
fn used(program: &Program, index: PeId) -> u32 {
    let pe = &program.pes[index];
    let mut used = vec![false; pe.own_image.len()];
    let accesses = pe.words.iter().flat_map(|word| {
        [word.own, word.write.filter(|target| target.own).map(|target| target.address)].into_iter().flatten()
    });
    for address in accesses {
        let word = usize::from(address.word) & (used.len() - 1);
        used[word] = true;
        if address.swap {
            used[word ^ (pe.own_image.len() / 2)] = true;
        }
    }
    used.into_iter().map(u32::from).sum()
}

#[test]
fn own_memories_beside_deeper_ones_are_as_deep_as_their_words_need() {
    let (mut shallow, mut upper, mut lower) = (0, 0, 0);
    let random = [flow(3, Pipeline::Short, 201), flow(3, Pipeline::Deep, 202)];
    let random = random.map(|flow| (flow.label, flow.program));
    for (label, program) in random.into_iter().chain([("neuron".to_owned(), neuron().design.program)]) {
        for index in program.pes.ids().filter(|index| is_shallow(&program.pes[*index])) {
            shallow += 1;
            assert_eq!(program.pes[index].features.own_words, depth(used(&program, index)), "{label}: PE {index}");
        }
        for state in program.states.iter().filter(|state| is_shallow(&program.pes[state.own.0])) {
            let half = (program.pes[state.own.0].features.own_words / 2) as u16;
            // Pairs that are written after the end of the round start in the other half.
            *(if state.own.1 & half > 0 { &mut upper } else { &mut lower }) += 1;
        }
        let text = program.to_string();
        assert_eq!(text.parse::<Program>().unwrap().to_string(), text, "{label}");
    }
    assert!(shallow >= 4 && upper > 3 && lower > 0, "{shallow} PEs, pairs from {upper} upper and {lower} lower words");
}

#[test]
fn all_engines_agree_on_pairs_beside_deeper_base_memories() {
    let random = [flow(2, Pipeline::Short, 211), flow(2, Pipeline::Deep, 212)];
    let random = random.map(|flow| (flow.label.clone(), flow.starts(21)));
    for (label, starts) in random.into_iter().chain([("neuron".to_owned(), neuron().starts(21))]) {
        assert!(starts.iter().all(|start| start.program.pes.iter().any(is_shallow)), "{label}");
        let engines = engines(label == "neuron");
        let sum = assert_agreement(&label, &starts, engines);
        println!("{label}: {} memory writes and {} outputs equal", sum.writes, sum.outputs);
    }
}

#[test]
fn the_checker_finds_each_bit_that_tells_halves_apart() {
    let flow = flow(3, Pipeline::Short, 221);
    let found = |program: &Program| !verify::program::check(program, &flow.graph, &flow.fixed, 3).is_empty();
    assert!(!found(&flow.program));
    let (mut writes, mut bases) = (0, 0);
    for index in flow.program.pes.ids().filter(|index| is_shallow(&flow.program.pes[*index])) {
        let pe = &flow.program.pes[index];
        let half = (pe.features.own_words / 2) as u16;
        let states = flow.program.states.iter().filter(|state| state.own.0 == index);
        let states: Vec<u16> = states.map(|state| pe.features.state_base(state.own.1) as u16).collect();
        for at in 0..pe.words.len() {
            let mut damaged = flow.program.clone();
            let word = &mut damaged.pes.vec_mut()[index.index()].words[at];
            if let Some(target) = word.write.as_mut().filter(|target| target.base && target.address.swap) {
                target.address.word ^= half;
                assert!(found(&damaged), "PE {index}, word {at} writes the other word of the pair");
                writes += 1;
            }
            let mut damaged = flow.program.clone();
            let word = &mut damaged.pes.vec_mut()[index.index()].words[at];
            if let Some(base) = word.base.as_mut().filter(|base| states.contains(base)) {
                *base ^= half;
                assert!(found(&damaged), "PE {index}, word {at} adds to what is no state");
                bases += 1;
            }
        }
        // The whole pair the other way round: own words are right, the base word is not.
        let mut damaged = flow.program.clone();
        let pe = &mut damaged.pes.vec_mut()[index.index()];
        let turned = damaged.states.iter_mut().filter(|state| state.own.0 == index).count();
        for state in damaged.states.iter_mut().filter(|state| state.own.0 == index) {
            let (from, to) = (usize::from(state.own.1), usize::from(state.own.1 ^ half));
            pe.own_image.swap(from, to);
            state.own.1 ^= half;
        }
        for word in &mut pe.words {
            word.own.iter_mut().filter(|own| own.swap).for_each(|own| own.word ^= half);
            let targets = word.write.iter_mut().filter(|target| target.address.swap);
            targets.for_each(|target| target.address.word ^= half);
        }
        assert!(turned == 0 || found(&damaged), "PE {index}: pairs the other way round");
    }
    assert!(writes > 3 && bases > 3, "{writes} writes, {bases} bases");
}
