//! The netlist that GHDL synthesises, run by Verilator, against the simulator: 0 differing bits.

use crate::support::Family;
use crate::support::bench::assert_agreement;
use crate::support::flow::{Flow, Placement, format};
use pe_ir::graph::Role;
use pe_ir::model::Solver;
use pe_ir::program::{LinkSource, PeProgram, Program};
use pe_verify::engines::Engine;

const STEPS: u64 = 20;

/// What a design must use so that its comparison says something about the feature.
fn assert_uses_every_feature(flow: &Flow) {
    let any = |what: &str, used: &dyn Fn(&PeProgram) -> bool| {
        assert!(flow.program.pes.iter().any(used), "{}: no PE has {what}", flow.label);
    };
    let words = |pe: &PeProgram| pe.words.clone();
    any("several ports", &|pe| pe.ports.len() > 1);
    any("an input", &|pe| pe.ports.iter().any(|port| matches!(port, LinkSource::Input(_))));
    any("a product of two words", &|pe| words(pe).iter().any(|w| w.write.is_some_and(|target| target.factor)));
    any("a base", &|pe| words(pe).iter().any(|w| w.base.is_some()));
    any("several shifts", &|pe| pe.features.shifts.len() > 1);
    any("a send", &|pe| words(pe).iter().any(|w| w.send));
    let computed =
        |id: &pe_ir::graph::ValueId| matches!(flow.graph.value(*id).role, Role::Published(_) | Role::Algebraic(..));
    assert!(flow.graph.outputs.iter().any(computed), "{}: no computed output", flow.label);
}

fn swaps(program: &Program) -> bool {
    let swapping = |pe: &PeProgram| pe.words.iter().any(|word| word.write.is_some_and(|target| target.address.swap));
    program.pes.iter().any(swapping)
}

fn check(flow: &Flow) {
    assert_uses_every_feature(flow);
    let sum = assert_agreement(&flow.label, &[flow.middle(STEPS)], &[Engine::Verilator]);
    println!("{}: {} memory writes and {} outputs equal", flow.label, sum.writes, sum.outputs);
}

#[test]
fn the_netlist_with_swapping_buffers_and_a_single_multiplier_block_agrees() {
    let flow = Flow::random(Family::Shared, (8, 3), Solver::Euler, format(32, 25, 18), Placement::Scattered, 41);
    assert!(swaps(&flow.program));
    check(&flow);
}

#[test]
fn the_netlist_with_wide_multipliers_agrees() {
    let flow = Flow::random(Family::Shared, (6, 3), Solver::Rk4, format(32, 32, 32), Placement::Scattered, 42);
    check(&flow);
}

/// Halves the imported memories of which no control word uses the upper half.
fn shrink(program: &mut Program) {
    for pe in &mut program.pes {
        let used = pe.words.iter().flat_map(|word| [word.imported, word.receive.map(|(_, address)| address)]);
        let words = used.flatten().map(|address| u32::from(address.word) + 1).max().unwrap_or(0);
        if words > 0 && !pe.features.swap {
            pe.features.imported_words = words.next_power_of_two().max(2);
            pe.imported_image.truncate(pe.features.imported_words as usize);
        }
    }
}

#[test]
fn the_netlist_keeps_an_image_of_64_bits_whose_lower_half_is_0() {
    // GHDL 2.0 loses such constants; `pe_ram.vhd` avoids them.
    let lost = |pe: &PeProgram| pe.imported_image.len() == 2 && pe.imported_image[0] == 0 && pe.imported_image[1] != 0;
    let seeded = |seed| {
        let flow = Flow::random(Family::Shared, (6, 3), Solver::Rk4, format(32, 32, 32), Placement::Scattered, seed);
        let mut start = flow.middle(2);
        shrink(&mut start.program);
        start.program.pes.iter().any(lost).then_some((flow, start))
    };
    let (flow, start) = (42..62).find_map(seeded).expect("a PE has such an image");
    assert_agreement(&format!("{}, small memories", flow.label), &[start], &[Engine::Verilator]);
}
