//! Outputs in memories: each PE keeps the words that outputs show, in the order in which it writes them.

use std::collections::BTreeSet;

use pe_ir::index::{List, PeId, at, number};
use pe_ir::program::{Layout, Program};

/// Bits of the widest control word.
const MOST_BITS: u32 = 128;

/// Gives every output a place in the output memory of its PE. Outputs of the same word share one.
///
/// # Errors
/// Why the program cannot have output memories.
pub fn to_memory(program: &mut Program) -> Result<(), String> {
    let mut shown: List<PeId, BTreeSet<(u32, u32)>> = program.pes.iter().map(|_| BTreeSet::new()).collect();
    for output in &program.outputs {
        shown[output.pe].insert((program.since_pause(output.word), output.word));
    }
    let wide = |pe: &pe_ir::program::PeProgram| Layout::new(&pe.features, &program.format).bits == MOST_BITS;
    if let Some((pe, _)) = program.pes.numbered().find(|(pe, of)| !shown[*pe].is_empty() && wide(of)) {
        return Err(format!("the control words of PE {pe} have {MOST_BITS} bits already"));
    }
    // Control words of other rounds may then be the same.
    let last = program.rounds > 1 && program.outputs.iter().all(|output| program.ends_step(output.word));
    let round = program.round_words();
    for ((_, pe), shown) in program.pes.numbered_mut().zip(&shown).filter(|(_, shown)| !shown.is_empty()) {
        pe.features.shown_words = number(shown.len()).next_power_of_two().max(2);
        pe.features.show_last = last;
        for (_, word) in shown {
            let same = if last { (word % round..program.period).step_by(at(round)).collect() } else { vec![*word] };
            same.into_iter().for_each(|word| pe.words[at(word)].show = true);
        }
    }
    for output in &mut program.outputs {
        let words = &shown[output.pe];
        output.place = words.iter().position(|(_, word)| *word == output.word).map(|place| place as u16);
    }
    Ok(())
}
