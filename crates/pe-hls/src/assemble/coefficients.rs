//! Where the coefficients of each PE stand.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use pe_ir::graph::Factor;
use pe_ir::index::{ChainId, List, PeId, at, number};
use pe_ir::memory::{self as cells, depth};
use pe_ir::program::{CoefficientOperand, ControlWord, Layout, PeFeatures, PeProgram, index_bits};

use super::Assembler;
use crate::rounds::Rounds;

/// Coefficients that a term has in the rounds of different parts, ascending; empty if they are the same in all of them.
type Choice = Vec<i64>;

/// Words of the coefficients of each PE, if it has a coefficient memory.
pub(super) struct Coefficients {
    words: List<PeId, BTreeMap<(Choice, i64), u32>>,
    /// Choices of the terms of a part, by its chains and the places of terms in them.
    choices: HashMap<(ChainId, u32), Choice>,
}

impl Coefficients {
    /// No words yet.
    pub(super) fn of(
        rounds: &Rounds,
        graph: &pe_ir::graph::StepGraph,
        coefficients: &[i64],
        pes: usize,
    ) -> Coefficients {
        let mut choices: HashMap<(ChainId, u32), BTreeSet<i64>> = HashMap::new();
        if rounds.are_parts() {
            for (index, chain) in graph.chains.numbered() {
                for (place, term) in (0..).zip(chain.terms.clone()) {
                    choices.entry((rounds.chain(index).1, place)).or_default().insert(coefficients[at(term)]);
                }
            }
        }
        let choices = choices.into_iter().filter(|(_, choice)| choice.len() > 1);
        let choices = choices.map(|(term, choice)| (term, choice.into_iter().collect())).collect();
        Coefficients { words: List::filled(BTreeMap::new(), pes), choices }
    }

    fn choice(&self, chain: ChainId, place: u32) -> Choice {
        self.choices.get(&(chain, place)).cloned().unwrap_or_default()
    }
}

impl Assembler<'_> {
    /// The coefficient of a term, by its place in its chain.
    pub(super) fn coefficient(&self, pe: PeId, chain: ChainId, place: u32) -> CoefficientOperand {
        let coefficient = self.fixed.coefficients[at(self.graph.chains[chain].terms.start + place)];
        let choice = self.coefficients.choice(self.rounds.chain(chain).1, place);
        let stored = self.coefficients.words[pe].get(&(choice, coefficient));
        stored.map_or(CoefficientOperand::Coefficient(coefficient), |word| CoefficientOperand::Stored(*word as u16))
    }

    /// Decides where the coefficients of each PE stand. Factors need a coefficient memory, which then holds them all, and so do
    /// coefficients that differ from part to part, whose words differ in their upper bits alone; otherwise the cheaper place is
    /// taken: the control word, or a memory of the distinct ones and an index.
    pub(super) fn place_coefficients(&mut self, pes: &mut List<PeId, PeProgram>) {
        let mut distinct: List<PeId, BTreeSet<i64>> = List::filled(BTreeSet::new(), pes.len());
        let mut choices: List<PeId, BTreeSet<Choice>> = List::filled(BTreeSet::new(), pes.len());
        for (index, chain) in self.graph.chains.numbered() {
            let pe = self.mapping.pe_of[chain.equation];
            for (place, term) in (0..).zip(chain.terms.clone()) {
                if let Factor::Coefficient(_) = self.graph.terms[at(term)].factor {
                    match self.coefficients.choice(self.rounds.chain(index).1, place) {
                        choice if choice.is_empty() => distinct[pe].insert(self.fixed.coefficients[at(term)]),
                        choice => choices[pe].insert(choice),
                    };
                }
            }
        }
        for (pe, program) in pes.numbered_mut() {
            let (distinct, choices) = (&distinct[pe], &choices[pe]);
            let format = &self.fixed.format;
            let factors = self.memories.depths[pe].factors;
            let first = factors + number(distinct.len() + choices.len());
            // Words of a choice lie so far apart.
            let stride = first.next_power_of_two();
            let words = match choices.iter().map(Vec::len).max() {
                None => depth(first),
                Some(most) => depth(number(most) * stride),
            };
            let features = PeFeatures { coefficient_words: words, ..program.features.clone() };
            let indexed = Layout::bits_of(&features, format);
            let in_word = indexed - index_bits(words) + format.coefficient_bits;
            // Coefficients of stages differ from round to round; everything else is the same.
            let (period, count) = (self.schedule.period, self.rounds.count);
            let cost = |bits: u32, streamed: u32| match count {
                1 => cells::rom(period, bits).equivalent_luts(),
                _ if self.rounds.are_parts() => cells::rom(period / count, bits).equivalent_luts(),
                _ => {
                    cells::rom(period, streamed).equivalent_luts()
                        + cells::rom(period / count, bits - streamed).equivalent_luts()
                }
            };
            let memory = cells::rom(words, format.coefficient_bits).equivalent_luts();
            if !program.features.factor
                && choices.is_empty()
                && in_word < Layout::MOST_BITS
                && cost(in_word, format.coefficient_bits) <= cost(indexed, index_bits(words)) + memory
            {
                continue;
            }
            program.features.coefficient_words = words;
            program.coefficient_image = vec![0; at(words)];
            let mut store = |choice: &Choice, coefficient: i64, word: u32| {
                program.coefficient_image[at(word)] = coefficient;
                self.coefficients.words[pe].insert((choice.clone(), coefficient), word);
            };
            for (word, coefficient) in (factors..).zip(distinct) {
                store(&Vec::new(), *coefficient, word);
            }
            for (word, choice) in (factors + number(distinct.len())..).zip(choices) {
                for (turn, coefficient) in (0..).zip(choice) {
                    store(choice, *coefficient, word + turn * stride);
                }
            }
            let blank = ControlWord { coefficient: CoefficientOperand::Stored(0), ..ControlWord::default() };
            program.words.fill(blank);
        }
    }
}
