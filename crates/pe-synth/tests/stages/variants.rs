//! Control words are the same bit by bit, whatever memories they are put together from.

use crate::support::bench::assert_lively_agreement;
use crate::support::flow::{Flow, Placement, format};
use crate::support::models::compile;
use pe_ir::index::at;
use pe_ir::memory::{LUT_ROM_WORDS, rom};
use pe_ir::model::Solver;
use pe_ir::program::{Fold, Layout, PeProgram, Program};
use pe_verify::engines::Engine;

/// What goes wrong between control words and the memories that they are put together from; nothing if all bits with an
/// effect are there.
fn wrong(program: &Program, pe: &PeProgram, fold: &Fold) -> Option<String> {
    let layout = Layout::new(&pe.features, &program.format);
    let length = pe.words.len();
    for (k, word) in (0..).zip(&pe.words) {
        let end = &pe.words[(k + at(program.latency().scale_to_write())) % length];
        let result = end.write.is_some() || end.write_index.is_some() || end.send || end.show;
        let differing = (fold.word(k) ^ layout.encode(word)) & layout.effective(word, result);
        if differing != 0 {
            return Some(format!("word {k}: {differing:#x}"));
        }
    }
    // The hardware begins with the first variant, before a word of the loop memory tells.
    (fold.variant_of.first().is_some_and(|first| *first != 0)).then(|| "the first word has another variant".to_owned())
}

#[test]
fn fields_that_take_few_values_are_stored_once_and_all_words_stay() {
    let (mut varied, mut flat) = (0, 0);
    let designs = [(Solver::Rk4, (40, 2)), (Solver::Euler, (60, 2)), (Solver::Heun, (50, 3)), (Solver::Rk4, (9, 5))];
    for (seed, (solver, size)) in (301..).zip(designs) {
        let flow = Flow::tabled(size, solver, format(32, 32, 32), Placement::Scattered, seed);
        for pe in &flow.program.pes {
            let fold = Fold::of(&flow.program, pe);
            let found = wrong(&flow.program, pe, &fold);
            assert_eq!(found, None, "{}", flow.label);
            let bits = Layout::new(&pe.features, &flow.program.format).bits;
            let plain = rom(flow.program.period, bits);
            assert!(fold.cells().equivalent_luts() <= plain.equivalent_luts(), "{}", flow.label);
            match fold.variants() {
                Some(variants) => {
                    assert!((2..=512).contains(&variants) && flow.program.period > LUT_ROM_WORDS, "{}", flow.label);
                    varied += 1;
                    // A damaged variant is found.
                    let mut damaged = fold.clone();
                    let used = at(damaged.variant_of[1]);
                    damaged.variant_words[used] ^= damaged.streamed;
                    assert!(wrong(&flow.program, pe, &damaged).is_some(), "{}", flow.label);
                }
                None => flat += 1,
            }
        }
    }
    assert!(varied > 4, "{varied} PEs with variants, {flat} without");
}

#[test]
fn a_program_of_which_every_field_is_stored_once_is_the_same_in_hardware() {
    let compiled = compile("ventilator", &["--pes", "3", "--span", "4s"]);
    let program = &compiled.design.program;
    let bare = program.pes.iter().map(|pe| Fold::of(program, pe)).filter(|fold| fold.repeated_bits() == 0);
    assert!(bare.filter(|fold| fold.variants().is_some()).count() > 0, "no PE keeps numbers of variants alone");
    // Most of its words belong to events, and stand still between them.
    assert_lively_agreement("ventilator", &[compiled.middle(12)], &[Engine::Ghdl], 0.05);
}
