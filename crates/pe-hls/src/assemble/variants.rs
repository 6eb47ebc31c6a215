//! Fields of control words that are stored once for all words in which they are alike; see
//! `docs/decisions/0102-fields-as-variants.md`.

use std::collections::HashMap;

use pe_ir::index::{at, number};
use pe_ir::memory::{LUT_ROM_WORDS, MemoryCells, rom, tables};
use pe_ir::program::{Effects, FieldName, Layout, PeProgram, Program, VARIANT_WORDS, index_bits};
use pe_ir::word::Pipeline;

/// Chooses for each PE the fields that come from its variant memory.
pub(super) fn choose(program: &mut Program) {
    // Behind more registers a variant would be known too late, and short programs are LUTs anyway.
    if program.format.pipeline == Pipeline::Deep || program.round_words() <= LUT_ROM_WORDS {
        return;
    }
    let chosen: Vec<Vec<FieldName>> = program.pes.iter().map(|pe| fields(program, pe)).collect();
    program.pes.iter_mut().zip(chosen).for_each(|(pe, chosen)| pe.varied = chosen);
}

/// The fields that take few values together, and with the bits that rounds need different values of. One after the other is
/// taken, the one that leaves the fewest bits in the loop memory; what was the cheapest on the way is the result.
fn fields(program: &Program, pe: &PeProgram) -> Vec<FieldName> {
    let layout = Layout::new(&pe.features, &program.format);
    let effects = Effects::of(program, pe);
    let (length, turns) = (at(program.round_words()), at(program.rounds.next_power_of_two()));
    let most = VARIANT_WORDS / turns;
    // For each place in a round a number of what some bits are in all rounds.
    let numbers = |mask: u128| -> (Vec<usize>, usize) {
        let mut known: HashMap<Vec<u128>, usize> = HashMap::new();
        let number = |slot: usize| {
            let places = (slot..effects.words.len()).step_by(length);
            let bits = places.map(|k| effects.words[k] & effects.cares[k] & mask).collect();
            let next = known.len();
            *known.entry(bits).or_insert(next)
        };
        let numbers = (0..length).map(number).collect();
        (numbers, known.len())
    };
    let mut mask = effects.differing;
    let (mut now, mut count) = numbers(mask);
    let mut open: Vec<(FieldName, Vec<usize>, usize)> = Vec::new();
    for field in layout.fields.iter().filter(|field| layout.mask(field.name) & !mask != 0) {
        let (numbers, count) = numbers(layout.mask(field.name));
        if count <= most {
            open.push((field.name, numbers, count));
        }
    }
    // Bits that are the same in all words are nowhere.
    let stored = || effects.words.iter().zip(&effects.cares).map(|(word, care)| word & care);
    let changing = stored().fold(0, |any, word| any | word) & !stored().fold(u128::MAX, |all, word| all & word);
    let bits = |mask: u128| (mask & changing).count_ones();
    let left = |mask: u128, variants: usize| bits(!mask) + index_bits(number(variants));
    let cost = |mask: u128, variants: usize| {
        let (kept, varied) = (left(mask, variants), bits(mask));
        let cells = [rom(number(length), kept), tables(number(variants * turns), varied)];
        cells.into_iter().sum::<MemoryCells>().equivalent_luts()
    };
    let mut taken: Vec<FieldName> = Vec::new();
    let mut best = (cost(mask, count), 0);
    // In which trial a pair of numbers was met.
    let mut met = vec![0u32; most * most];
    let mut trial = 0;
    while count <= most {
        let mut next: Option<((u32, usize), FieldName)> = None;
        open.retain(|(field, of, values)| {
            trial += 1;
            let mut together = 0;
            for (one, other) in now.iter().zip(of) {
                let pair = &mut met[one * values + other];
                together += usize::from(*pair != trial);
                *pair = trial;
            }
            let rank = (left(mask | layout.mask(*field), together), together);
            if together <= most && next.is_none_or(|(least, _)| rank < least) {
                next = Some((rank, *field));
            }
            // What are too many are no fewer later.
            together <= most
        });
        let Some((_, field)) = next else { break };
        open.retain(|(other, ..)| *other != field);
        taken.push(field);
        mask |= layout.mask(field);
        (now, count) = numbers(mask);
        let cost = cost(mask, count);
        if cost < best.0 {
            best = (cost, taken.len());
        }
    }
    taken.truncate(best.1);
    taken.sort_unstable();
    taken
}
