/// Adds a sum to a base word; an operation on slots, which are homes first, then what a step computes.
struct Written {
    sum: u32,
    base: u32,
    /// Moves the base.
    segment: u32,
    target: u32,
    shift: u32,
    pe: u32,
    flagged: bool,
    /// Whether another operation writes the sum, too.
    kept: bool,
}

enum Run {
    /// Adds a product of an operand and a factor and so many others, and writes the sum. Products of `narrow` sums fit 64
    /// bits.
    Sum { operand: u32, factor: u32, others: u32, narrow: bool, written: Written },
    /// Writes a sum once more.
    Written(Written),
    Pair { target: u32, own: u32, imported: u32 },
    Segment { target: u32, word: u32, pe: u32, octaves: bool },
}

/// A stored word or a segment, and what the two ports of the multiplier see of it.
#[derive(Clone, Copy, Default)]
struct Slot {
    word: i64,
    operand: i64,
    factor: i64,
}

impl Slot {
    fn of(word: i64) -> Slot {
        Slot { word, operand: word >> (WORD_BITS - DATA_BITS), factor: word >> (WORD_BITS - COEFFICIENT_BITS) }
    }
}

/// What a home takes over at the end of a step.
struct Move {
    from: u32,
    to: u32,
}

/// What a step computes, without a pipeline and without clocks: found once by following the control words.
struct Fast {
    homes: Vec<Homes>,
    slots: Vec<Slot>,
    /// In their order.
    sums: Vec<Sum>,
    runs: Vec<Run>,
    /// Operand and factor of all products but the first of each sum, in their order.
    products: Vec<(u32, u32)>,
    /// Slots of coefficients, as factors.
    coefficients: Vec<(u32, i64)>,
    /// PE and operands of sums in front of a multiplier.
    checks: Vec<(u32, [u32; 2])>,
    outputs: Vec<u32>,
    /// Slot of the first input.
    inputs: usize,
    moves: Vec<Move>,
    moving: Vec<Slot>,
}

impl Fast {
    /// None if a step reads other words of the one before than the states.
    fn new() -> Option<Fast> {
        let (homes, count) = homes();
        let mut follower = Follower::new(&homes, count);
        (0..PAUSE_WORD).for_each(|word| follower.clock(true, PAUSE_WORD - word));
        let base_homes: Vec<u32> = STATES.iter().map(|state| base_home(&homes, state)).collect();
{%- if rings %}
        let copies = copies_in_rings().map(|(pe, place)| homes[pe].imported + place as u32);
        let base_homes: Vec<u32> = base_homes.into_iter().chain(copies).collect();
{%- endif %}
        let first = follower.pass(&base_homes);
        for (home, name) in base_homes.iter().zip(&first.states) {
            follower.passes.next[*home as usize] = Some(*name);
        }
        for pass in 2..=Passes::FOLLOWED {
            follower.passes.pass = pass;
            let now = follower.pass(&base_homes);
            follower.passes.compare(&first, &now, &base_homes);
            if !follower.passes.alike {
                return None;
            }
        }
        let Passes { first: operations, next, .. } = follower.passes;
        let mut fast = Fast::of(homes, count, operations);
        let slot = |name: &Name| if name.pass == 0 { name.index } else { count + name.index };
        fast.checks = first.checks.iter().map(|(pe, reads)| (*pe as u32, [slot(&reads[0]), slot(&reads[1])])).collect();
        fast.outputs = first.outputs.iter().map(slot).collect();
        // Only the places of states may change from step to step.
        let mut places = vec![false; count as usize];
        for (state, base_home) in STATES.iter().zip(base_homes) {
            places[base_home as usize] = true;
            places[fast.homes[state.pe].own as usize + state.address] = true;
            for (pe, place) in state.copies {
                places[fast.homes[*pe].imported as usize + place] = true;
            }
        }
        let next = (0..).zip(&next).filter_map(|(home, next)| Some((home, (*next)?)));
        let changing = next.filter(|(home, next)| *next != Name { pass: 0, index: *home });
        fast.moves = changing.map(|(home, next)| Move { from: slot(&next), to: home }).collect();
        fast.moves.iter().all(|moved| places[moved.to as usize]).then_some(fast)
    }

    /// Puts operations on slots in place of those on names.
    fn of(homes: Vec<Homes>, count: u32, operations: Vec<Operation>) -> Fast {
        let mut fast = Fast {
            homes,
            slots: Vec::new(),
            sums: Vec::new(),
            runs: Vec::new(),
            products: Vec::new(),
            coefficients: Vec::new(),
            checks: Vec::new(),
            outputs: Vec::new(),
            inputs: count as usize,
            moves: Vec::new(),
            moving: Vec::new(),
        };
        let mut slots = count + operations.len() as u32;
        // Place of the sum that an operation forms, and the run that writes each sum first.
        let mut sums = vec![0; operations.len()];
        let mut first = Vec::new();
        let mut known = BTreeMap::new();
        // The sum that is formed and not yet written.
        let mut open = None;
        for (target, operation) in (count..).zip(operations) {
            let slot = |name: &Name| if name.pass == 0 { name.index } else { count + name.index };
            let reads: Vec<u32> = operation.reads.iter().map(slot).collect();
            let run = match operation.kind {
                Kind::Input => continue,
                Kind::Sum { coefficients } => {
                    let (with, without) = reads.split_at(coefficients.len());
                    let bound: u128 = coefficients.iter().map(|number| u128::from(number.unsigned_abs())).sum();
                    let factors = (without.len() as u128 / 2) << (COEFFICIENT_BITS - 1);
                    let narrow = DATA_BITS + COEFFICIENT_BITS <= 64 && LEFT == 0
                        || (bound + factors) << (DATA_BITS - 1) << LEFT < 1 << 63;
                    let coefficient = |(operand, number): (&u32, i64)| {
                        let factor = *known.entry(number).or_insert(slots);
                        if factor == slots {
                            fast.coefficients.push((slots, number));
                            slots += 1;
                        }
                        (*operand, factor)
                    };
                    let mut products: Vec<(u32, u32)> = with.iter().zip(coefficients).map(coefficient).collect();
                    products.extend(without.chunks_exact(2).map(|pair| (pair[0], pair[1])));
                    let others = products.split_off(products.len().min(1));
                    let product = products.first().map_or((NO_SEGMENT, NO_SEGMENT), |product| *product);
                    open = Some((product, others.len() as u32, narrow));
                    fast.products.extend(others);
                    sums[(target - count) as usize] = fast.sums.len() as u32;
                    fast.sums.push(0);
                    first.push(fast.runs.len());
                    continue;
                }
                Kind::Word { shift, pe, flagged, column } => {
                    let (base, segment) = column.map_or((reads[1], NO_SEGMENT), |column| (column, reads[1]));
                    let (sum, pe) = (sums[(reads[0] - count) as usize], pe as u32);
                    let written = Written { sum, base, segment, target, shift, pe, flagged, kept: false };
                    match open.take() {
                        Some(((operand, factor), others, narrow)) => {
                            Run::Sum { operand, factor, others, narrow: narrow && shift < 63, written }
                        }
                        None => {
                            if let Some(Run::Sum { written, .. }) = fast.runs.get_mut(first[sum as usize]) {
                                written.kept = true;
                            }
                            Run::Written(written)
                        }
                    }
                }
                Kind::Pair => Run::Pair { target, own: reads[0], imported: reads[1] },
                Kind::Segment { pe, octaves } => Run::Segment { target, word: reads[0], pe: pe as u32, octaves },
            };
            fast.runs.push(run);
        }
        fast.slots = vec![Slot::default(); slots as usize];
        fast
    }

    /// Begins anew.
    fn restart(&mut self, memories: &[Memories]) {
        let Fast { slots, homes, coefficients, .. } = self;
        slots.fill(Slot::default());
        slots[NO_BASE as usize].word = OFFSET;
        for (slot, coefficient) in coefficients {
            slots[*slot as usize].factor = *coefficient;
        }
        let mut fill = |first: u32, words: &[i64], set: fn(&mut Slot, i64)| {
            slots[first as usize..].iter_mut().zip(words).for_each(|(slot, word)| set(slot, *word));
        };
        for (homes, memories) in homes.iter().zip(memories) {
            fill(homes.own, &memories.own, |slot, operand| slot.operand = operand);
            fill(homes.base, &memories.base, |slot, word| slot.word = word);
            fill(homes.coefficients, &memories.coefficients, |slot, factor| slot.factor = factor);
            fill(homes.imported, &memories.imported, |slot, operand| slot.operand = operand);
        }
    }

    /// Stored word of a state, between two steps.
    fn state(&self, state: &State) -> i64 {
{%- if rings %}
        if state.ring {
            return kept(self.slots[base_home(&self.homes, state) as usize].operand);
        }
{%- endif %}
        self.slots[base_home(&self.homes, state) as usize].word
    }

    /// Stored word of an output after a step.
    fn captured(&self, output: usize) -> i64 {
        self.slots[self.outputs[output] as usize].word
    }

    fn step(&mut self, inputs: &[i64], flags: &mut [u32]) {
        let Fast { slots, sums, .. } = self;
        slots[self.inputs..].iter_mut().zip(inputs).for_each(|(slot, operand)| slot.operand = *operand);
        let mut products = &self.products[..];
        for run in &self.runs {
            let (written, sum) = match run {
                Run::Sum { operand, factor, others, narrow, written } => {
                    let (others, left) = products.split_at(*others as usize);
                    products = left;
                    let product = |operand: u32, factor: u32| {
                        let (operand, factor) = (&slots[operand as usize], &slots[factor as usize]);
                        (operand.operand, factor.factor)
                    };
                    if *narrow {
                        let narrow = |(operand, factor): (i64, i64)| operand * factor;
                        let (mut sum, mut fits) = (narrow(product(*operand, *factor)), true);
                        for (operand, factor) in others {
                            let (more, beyond) = sum.overflowing_add(narrow(product(*operand, *factor)));
                            sum = more;
                            fits &= !beyond;
                        }
                        let word = word_of(sum, base_of(slots, written), written.shift);
                        if let Some(word) = word.filter(|_| fits) {
                            if written.kept {
                                sums[written.sum as usize] = Sum::from(sum);
                            }
                            slots[written.target as usize] = Slot::of(word);
                            continue;
                        }
                    }
                    let wide = |(operand, factor): (i64, i64)| Sum::from(operand) * Sum::from(factor);
                    let mut sum = wide(product(*operand, *factor));
                    for (operand, factor) in others {
                        sum += wide(product(*operand, *factor));
                    }
                    sums[written.sum as usize] = sum;
                    (written, sum)
                }
                Run::Written(written) => (written, sums[written.sum as usize]),
                Run::Pair { target, own, imported } => {
                    let pair = slots[*own as usize].operand + slots[*imported as usize].operand;
                    slots[*target as usize].operand = signed(pair, DATA_BITS);
                    continue;
                }
                Run::Segment { target, word, pe, octaves } => {
                    let segment = segment(slots[*word as usize].word, &PES[*pe as usize], *octaves);
                    slots[*target as usize].word = i64::from(segment);
                    continue;
                }
            };
            let base = base_of(slots, written);
            let (word, beyond) = limited(added(base, rounded(sum, written.shift)), PES[written.pe as usize].proven);
            if beyond && written.flagged {
                flags[written.pe as usize] |= SATURATED;
            }
            slots[written.target as usize] = Slot::of(word);
        }
        for (pe, [own, imported]) in &self.checks {
            if beyond_half(slots[*own as usize].operand) || beyond_half(slots[*imported as usize].operand) {
                flags[*pe as usize] |= OPERAND_TOO_LARGE;
            }
        }
        // All leave before the first one arrives.
        self.moving.clear();
        self.moving.extend(self.moves.iter().map(|Move { from, .. }| slots[*from as usize]));
        self.moves.iter().zip(&self.moving).for_each(|(Move { to, .. }, slot)| slots[*to as usize] = *slot);
    }
}

/// The base word that an operation reads.
fn base_of(slots: &[Slot], written: &Written) -> i64 {
    if written.segment == NO_SEGMENT {
        return slots[written.base as usize].word;
    }
    slots[written.base as usize + slots[written.segment as usize].word as usize].word
}

/// The word of a sum that fits 64 bits shifted to the left; none if it is out of range.
fn word_of(sum: i64, base: i64, shift: u32) -> Option<i64> {
    let left = sum << LEFT;
    // The last bit that is shifted out rounds.
    let word = base.saturating_add((left >> shift) + (left << 1 >> shift & 1));
    (signed(word, WORD_BITS) == word).then_some(word)
}

{% if rings -%}
/// PE and place of each copy of a state in a ring of an imported memory.
fn copies_in_rings() -> impl Iterator<Item = (usize, usize)> {
    STATES.iter().filter(|state| state.ring).flat_map(|state| state.copies).copied()
}

{% endif -%}
/// The home of a state's base word{% if rings %}, or of its operand in a ring{% endif %}.
fn base_home(homes: &[Homes], state: &State) -> u32 {
{%- if rings %}
    if state.ring {
        return homes[state.pe].own + state.address as u32;
    }
{%- endif %}
    homes[state.pe].base + state.base_word() as u32
}
