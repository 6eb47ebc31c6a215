/// Registers of one PE, and its memories.
struct Pe {
    memories: Memories,
    /// Whether an operand of the sum in front of the multiplier, {% if deep %}two words{% else %}one word{% endif %}
    /// ago, was beyond half of full scale.
    too_large: bool,
{%- if deep %}
    /// The same of the word that was executed last.
    too_large_next: bool,
{%- endif %}
    /// Products between operand and product register; each control word takes the place of the next.
    products: [Sum; MULTIPLIER_LATENCY + 1],
    accumulator: Sum,
    hold: Sum,
    base: i64,
    shift: u32,
{%- if deep %}
    /// Base and shifted sum, registered in front of the adder.
    addends: (i64, Sum),
{%- endif %}
    sum: Sum,
    word: i64,
    saturated: bool,
    /// Index that the base address takes.
    index: u16,
}

impl Pe {
    fn new() -> Pe {
        Pe {
            memories: Memories::default(),
            too_large: false,
{%- if deep %}
            too_large_next: false,
{%- endif %}
            products: [0; MULTIPLIER_LATENCY + 1],
            accumulator: 0,
            hold: 0,
            base: 0,
            shift: 0,
{%- if deep %}
            addends: (0, 0),
{%- endif %}
            sum: 0,
            word: 0,
            saturated: false,
            index: 0,
        }
    }
}

/// The network clock by clock, register by register.
struct Clocked {
    /// Control words of each PE.
    words: Vec<Vec<Word>>,
    pes: Vec<Pe>,
    links: Vec<i64>,
    inputs: Vec<i64>,
    captured: Vec<i64>,
    received: Vec<i64>,
    index: usize,
    cycle: u64,
    /// Place of the product that leaves the multiplier.
    product: usize,
    odd: usize,
{%- if rings %}
    /// Steps whose words were all executed.
    turn: u64,
{%- endif %}
    settle: bool,
}

impl Clocked {
    fn new() -> Clocked {
        Clocked {
            words: program(),
            pes: Vec::new(),
            links: Vec::new(),
            inputs: Vec::new(),
            captured: Vec::new(),
            received: Vec::new(),
            index: 0,
            cycle: 0,
            product: 0,
            odd: 0,
{%- if rings %}
            turn: 0,
{%- endif %}
            settle: true,
        }
    }

    /// Begins anew: the first words only fill the pipelines.
    fn restart(&mut self, memories: &[Memories]) {
        self.pes = memories.iter().map(|memories| Pe { memories: memories.clone(), ..Pe::new() }).collect();
        self.links = vec![0; PES.len()];
        self.inputs = vec![0; INPUT_COUNT];
        self.captured = vec![0; OUTPUTS.len()];
        self.received = vec![0; PES.len()];
        self.index = 0;
        self.cycle = 0;
        self.product = 0;
        self.odd = 0;
{%- if rings %}
        self.turn = 0;
{%- endif %}
        self.settle = true;
        for _ in 0..PAUSE_WORD {
            self.clock(&mut [], &mut None);
        }
        self.settle = false;
    }

    /// Runs from one pause point to the next; the operands of the inputs arrive at the end of the first word.
    fn step(&mut self, operands: &[i64], flags: &mut [u32], observer: &mut Observer) {
        self.clock(flags, observer);
        self.inputs.copy_from_slice(operands);
        for _ in 1..PERIOD {
            self.clock(flags, observer);
        }
    }

    /// Stored word of a state, at a pause point.
    fn state(&self, state: &State) -> i64 {
{%- if rings %}
        if state.ring {
            let place = turned(state.address, self.turn, PES[state.pe].ring_bits);
            return kept(self.pes[state.pe].memories.own[place]);
        }
{%- endif %}
        let base = &self.pes[state.pe].memories.base;
        base[state.base_word()]
    }

    /// Executes one control word in every PE.
    fn clock(&mut self, flags: &mut [u32], observer: &mut Observer) {
        let k = self.index;
        let odd = self.odd;
{%- if rings %}
        let turn = self.turn;
{%- endif %}
        // Writes before the place of the pause point in a round finish the round before.
        let ends_step = (k + PERIOD - PAUSE_WORD) % PERIOD / ROUND_WORDS == ROUNDS - 1;
        // Ports show the link registers of the word before.
        for (words, received) in self.words.iter().zip(&mut self.received) {
            if let Some((_, source)) = words[k].receive {
                *received = match source {
                    Source::Pe(sender) => self.links[sender],
                    Source::Input(input) => self.inputs[input],
                };
            }
        }
        for (index, (pe, words)) in self.pes.iter_mut().zip(&self.words).enumerate() {
            let word = &words[k];
            let description = &PES[index];
            let Memories { own, base, coefficients, imported, indices } = &mut pe.memories;
            // Everything that is read.
            let own_operand = word.own.map_or(0, |address| own[{% if rings %}address.word(odd, turn, description.ring_bits){% else %}address[odd] as usize{% endif %}]);
            let imported_operand = word.imported.map_or(0, |address| imported[{% if rings %}address.word(odd, turn, description.ring_bits){% else %}address[odd] as usize{% endif %}]);
            let multiplier = word.stored.map_or(word.coefficient, |address| coefficients[address as usize]);
            let base_word = word.base.map_or(OFFSET, |address| base[(address | pe.index) as usize]);
            let fetched = word.index.map_or(0, |place| indices[place as usize]);
            let result = pe.word;
            let saturated = pe.saturated;
            (pe.word, pe.saturated) = limited(pe.sum, description.proven);
            // Adder.
            let shifted = rounded(pe.hold, pe.shift);
{%- if deep %}
            pe.sum = added(pe.addends.0, pe.addends.1);
            pe.addends = (pe.base, shifted);
{%- else %}
            pe.sum = added(pe.base, shifted);
{%- endif %}
            // Scale group.
            pe.base = base_word;
            pe.shift = word.shift;
            pe.index = fetched;
            // Accumulate group.
            let product = pe.products[self.product];
            let mut kept = pe.accumulator;
            if word.close {
                pe.hold = kept;
                kept = 0;
            }
            pe.accumulator = wrapped(kept.wrapping_add(product), description.accumulator_bits);
            // Operand group.
            let operand = signed(own_operand + imported_operand, DATA_BITS);
            pe.products[self.product] = Sum::from(operand) * Sum::from(multiplier);
            if pe.too_large && !self.settle {
                flags[index] |= OPERAND_TOO_LARGE;
            }
            let both = description.pre_adder && word.own.is_some() && word.imported.is_some();
            let too_large = both && (beyond_half(own_operand) || beyond_half(imported_operand));
{%- if deep %}
            pe.too_large = pe.too_large_next;
            pe.too_large_next = too_large;
{%- else %}
            pe.too_large = too_large;
{%- endif %}
            // Write group.
            if word.send {
                self.links[index] = result >> (WORD_BITS - DATA_BITS);
            }
            if !self.settle {
                let writes = word.writes();
                let address = {% if rings %}word.write.word(odd, turn, description.ring_bits){% else %}word.write[odd] as usize{% endif %};
                if saturated && (writes || word.write_index.is_some() || word.send) {
                    flags[index] |= SATURATED;
                }
                // Each memory takes as many low bits of the address as it needs; base and coefficients are no pairs.
                if word.write_own {
                    let place = address & (own.len() - 1);
                    own[place] = result >> (WORD_BITS - DATA_BITS);
                }
                if word.write_base && (ends_step || !description.base_last) {
                    let place = word.unsteered() & (base.len() - 1);
                    base[place] = result;
                }
                if word.write_factor {
                    let place = word.unsteered() & (coefficients.len() - 1);
                    coefficients[place] = result >> (WORD_BITS - COEFFICIENT_BITS);
                }
                if let Some((place, octaves)) = word.write_index {
                    indices[place as usize] = segment(result, description, octaves);
                }
                if let (true, Some(observe)) = (writes, observer.as_mut()) {
                    let value = unsigned(result, WORD_BITS);
                    observe(Write { cycle: self.cycle, pe: index, address: address as u64, value });
                }
                if let Some((address, _)) = word.receive {
                    let place = {% if rings %}address.word(odd, turn, description.ring_bits){% else %}address[odd] as usize{% endif %};
                    imported[place] = self.received[index];
                    if let Some(observe) = observer {
                        let value = unsigned(self.received[index], DATA_BITS);
                        let address = u64::from(description.write_words()) + place as u64;
                        observe(Write { cycle: self.cycle, pe: index, address, value });
                    }
                }
            }
            if word.captured {
                for (captured, output) in self.captured.iter_mut().zip(OUTPUTS) {
                    if (output.pe, output.word) == (index, k) {
                        *captured = result;
                    }
                }
            }
        }
        self.cycle += 1;
        self.product = if self.product == MULTIPLIER_LATENCY { 0 } else { self.product + 1 };
        self.index += 1;
        if self.index % ROUND_WORDS == 0 {
            self.odd ^= 1;
        }
        if self.index == PERIOD {
            self.index = 0;
{%- if rings %}
            self.turn += 1;
{%- endif %}
        }
    }
}
