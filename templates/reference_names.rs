/// A word by its name: what a place held before the first step (pass 0), or what an operation gave in a later pass.
#[derive(Clone, Copy, PartialEq)]
struct Name {
    pass: u32,
    index: u32,
}

/// What an operation does with the words that it reads.
#[derive(PartialEq)]
enum Kind {
    /// Takes the operand of an input.
    Input,
    /// Adds two operands in front of the multiplier.
    Pair,
    /// Adds products: of an operand for each coefficient, then of operands and factors.
    Sum { coefficients: Vec<i64> },
    /// Adds a sum to a base word, or to the one of a column, from a home on, that a segment chooses.
    Word { shift: u32, pe: usize, flagged: bool, column: Option<u32> },
    Segment { pe: usize, octaves: bool },
}

struct Operation {
    kind: Kind,
    reads: Vec<Name>,
}

#[derive(Clone, Copy)]
enum Operand {
    One(Name),
    Two(Name, Name),
}

#[derive(Clone, Copy)]
enum Factor {
    Coefficient(i64),
    Word(Name),
}

#[derive(Clone, Copy)]
enum Base {
    Word(Name),
    Entry { column: u32, segment: Name },
}

/// A finished sum, and its name if an operation forms it.
#[derive(Default)]
struct Held {
    products: Vec<(Operand, Factor)>,
    sum: std::cell::Cell<Option<Name>>,
}

/// What becomes a result.
#[derive(Clone)]
struct Pending {
    base: Base,
    held: Rc<Held>,
    shift: u32,
}

/// Registers and memories of a PE, with names in place of words.
struct Followed {
    own: Vec<Name>,
    base: Vec<Name>,
    coefficients: Vec<Factor>,
    imported: Vec<Name>,
    indices: Vec<Name>,
    link: Name,
    products: [Option<(Operand, Factor)>; MULTIPLIER_LATENCY + 1],
    accumulator: Vec<(Operand, Factor)>,
    hold: Rc<Held>,
    base_register: Base,
    shift: u32,
    /// From the adder to the result register, which is the last one.
    results: [Pending; {% if deep %}3{% else %}2{% endif %}],
    index: Option<Name>,
    /// Homes: where its words lie between two steps.
    homes: Homes,
{%- if rings %}
    /// First words of its rings, in the own and in the imported memory.
    rings: [BTreeSet<usize>; 2],
    ring_bits: u32,
{%- endif %}
}

/// The first home of each memory.
#[derive(Clone, Copy)]
struct Homes {
    own: u32,
    base: u32,
    coefficients: u32,
    imported: u32,
    indices: u32,
    link: u32,
}

/// The homes of what a missing base adds, and of a missing segment; those of the inputs' registers follow.
const NO_BASE: u32 = 0;
const NO_SEGMENT: u32 = 1;
const INPUT_HOMES: u32 = 2;

/// The homes of each PE, and how many there are.
fn homes() -> (Vec<Homes>, u32) {
    let mut count = INPUT_HOMES + INPUT_COUNT as u32;
    let mut take = |words: usize| {
        count += words as u32;
        count - words as u32
    };
    let of = |pe: &Description| Homes {
        own: take(pe.own_image.len()),
        base: take(pe.base_image.len()),
        coefficients: take(pe.coefficient_image.len()),
        imported: take(pe.imported_image.len()),
        indices: take(pe.index_words as usize),
        link: take(1),
    };
    let homes = PES.iter().map(of).collect();
    (homes, count)
}

/// What a pass shows beside its operations.
struct Seen {
    /// PE and operands of sums in front of a multiplier whose flag rises in this pass.
    checks: Vec<(usize, [Name; 2])>,
    outputs: Vec<Name>,
    /// Base words of the states at its end{% if rings %}, and words of rings{% endif %}.
    states: Vec<Name>,
}

/// What passes have in common. What a step computes depends on the control words alone, so following them once more on names
/// shows whether each step does the same: which word a place held can only depend on the last two rounds.
struct Passes {
    pass: u32,
    /// Operations of the first pass, and how many there were so far in this one.
    first: Vec<Operation>,
    count: usize,
    /// What a home of the first pass is in the second.
    next: Vec<Option<Name>>,
    alike: bool,
}

impl Passes {
    /// How many are followed: from the third on, a pass differs from the one after the next by its names only.
    const FOLLOWED: u32 = 4;

    fn operation(&mut self, kind: Kind, reads: Vec<Name>) -> Name {
        let index = self.count;
        self.count += 1;
        if self.pass == 1 {
            self.first.push(Operation { kind, reads });
        } else {
            match self.first.get(index) {
                Some(first) if first.kind == kind => {
                    let before = first.reads.clone();
                    self.meet(&before, &reads);
                }
                _ => self.alike = false,
            }
        }
        Name { pass: self.pass, index: index as u32 }
    }

    /// Compares what is seen of a pass with what is seen of the first one.
    fn compare(&mut self, before: &Seen, now: &Seen, base_homes: &[u32]) {
        self.alike &= self.count == self.first.len() && before.checks.len() == now.checks.len();
        for ((pe, before), (other, now)) in before.checks.iter().zip(&now.checks) {
            self.alike &= pe == other;
            self.meet(before, now);
        }
        self.meet(&before.outputs, &now.outputs);
        for (home, now) in base_homes.iter().zip(&now.states) {
            self.alike &= self.home(Name { pass: 0, index: *home }, self.pass + 1) == Some(*now);
        }
    }

    /// Compares names with those of the first pass.
    fn meet(&mut self, before: &[Name], now: &[Name]) {
        self.alike &= before.len() == now.len();
        for (before, now) in before.iter().zip(now) {
            let home = before.index as usize;
            if before.pass == 1 {
                self.alike &= *now == Name { pass: self.pass, ..*before };
            } else if self.pass == 2 && self.next[home].is_none() {
                self.alike &= now.pass < 2;
                self.next[home] = Some(*now);
            } else {
                self.alike &= self.home(*before, self.pass) == Some(*now);
            }
        }
    }

    /// What a home holds as a pass begins.
    fn home(&self, home: Name, pass: u32) -> Option<Name> {
        if pass == 1 {
            return Some(home);
        }
        match self.next[home.index as usize]? {
            Name { pass: 0, index } => self.home(Name { pass: 0, index }, pass - 1),
            Name { index, .. } => Some(Name { pass: pass - 1, index }),
        }
    }
}

impl Followed {
    fn new(pe: &Description, words: &[Word], homes: Homes) -> Followed {
        let names = |first: u32, count: usize| -> Vec<Name> {
            (first..first + count as u32).map(|index| Name { pass: 0, index }).collect()
        };
        let writes = words.iter().filter(|word| word.write_factor);
        let mut written = vec![false; pe.coefficient_image.len()];
        for place in writes.flat_map(|word| word.write{% if rings %}.address{% endif %}) {
            written[place as usize & (pe.coefficient_image.len() - 1)] = true;
        }
        let coefficient = |(place, number): (usize, &i64)| match written[place] {
            true => Factor::Word(Name { pass: 0, index: homes.coefficients + place as u32 }),
            false => Factor::Coefficient(*number),
        };
        let held = Rc::new(Held::default());
        let base_register = Base::Word(Name { pass: 0, index: NO_BASE });
        let nothing = Pending { base: base_register, held: Rc::clone(&held), shift: 0 };
        Followed {
            own: names(homes.own, pe.own_image.len()),
            base: names(homes.base, pe.base_image.len()),
            coefficients: pe.coefficient_image.iter().enumerate().map(coefficient).collect(),
            imported: names(homes.imported, pe.imported_image.len()),
            indices: names(homes.indices, pe.index_words as usize),
            link: Name { pass: 0, index: homes.link },
            products: [None; MULTIPLIER_LATENCY + 1],
            accumulator: Vec::new(),
            hold: held,
            base_register,
            shift: 0,
            results: [{% if deep %}nothing.clone(), {% endif %}nothing.clone(), nothing],
            index: None,
            homes,
{%- if rings %}
            rings: [BTreeSet::new(), BTreeSet::new()],
            ring_bits: pe.ring_bits,
{%- endif %}
        }
    }

    /// The base word that a control word reads; none if a column has words that change.
    fn base_word(&self, pe: &Description, address: u16) -> Option<Base> {
        let Some(segment) = self.index else { return Some(Base::Word(self.base[address as usize])) };
        let (first, count) = (address as usize, 1 << pe.index_width);
        let column = self.homes.base + address as u32;
        let constant = |(name, home): (&Name, u32)| *name == Name { pass: 0, index: home };
        let entries = self.base.get(first..first + count)?;
        let fixed = first % count == 0 && entries.iter().zip(column..).all(constant);
        fixed.then_some(Base::Entry { column, segment })
    }

    /// The word in the result register.
    fn result(&self, passes: &mut Passes, pe: usize, flagged: bool) -> Name {
        let pending = &self.results[self.results.len() - 1];
        let (base, column) = match pending.base {
            Base::Word(name) => (name, None),
            Base::Entry { column, segment } => (segment, Some(column)),
        };
        let formed = pending.held.sum.get().filter(|sum| sum.pass == passes.pass);
        let sum = formed.unwrap_or_else(|| {
            let (mut coefficients, mut reads, mut products) = (Vec::new(), Vec::new(), Vec::new());
            for (operand, factor) in &pending.held.products {
                let operand = match *operand {
                    Operand::One(name) => name,
                    Operand::Two(own, imported) => passes.operation(Kind::Pair, vec![own, imported]),
                };
                match *factor {
                    Factor::Coefficient(coefficient) => {
                        coefficients.push(coefficient);
                        reads.push(operand);
                    }
                    Factor::Word(name) => products.extend([operand, name]),
                }
            }
            reads.append(&mut products);
            passes.operation(Kind::Sum { coefficients }, reads)
        });
        pending.held.sum.set(Some(sum));
        passes.operation(Kind::Word { shift: pending.shift, pe, flagged, column }, vec![sum, base])
    }
}

/// The control words of all PEs, followed on names.
struct Follower {
    words: Vec<Vec<Word>>,
    passes: Passes,
    pes: Vec<Followed>,
    inputs: Vec<Name>,
    /// The PE and operands of sums in front of a multiplier that are checked in this pass and in the next one.
    checks: (Vec<(usize, [Name; 2])>, Vec<(usize, [Name; 2])>),
    outputs: Vec<Name>,
    index: usize,
    product: usize,
    odd: usize,
{%- if rings %}
    /// Steps of the pass whose words were all executed: between passes rings are as in the first step.
    turn: u64,
{%- endif %}
}

impl Follower {
    fn new(homes: &[Homes], count: u32) -> Follower {
        let words = program();
        let pes = PES.iter().zip(&words).zip(homes);
{%- if rings %}
        let mut follower = Follower {
{%- else %}
        Follower {
{%- endif %}
            passes: Passes {
                pass: 1,
                first: Vec::new(),
                count: 0,
                next: vec![None; count as usize],
                alike: true,
            },
            pes: pes.map(|((pe, words), homes)| Followed::new(pe, words, *homes)).collect(),
            inputs: (INPUT_HOMES..).take(INPUT_COUNT).map(|index| Name { pass: 0, index }).collect(),
            checks: (Vec::new(), Vec::new()),
            outputs: vec![Name { pass: 0, index: NO_BASE }; OUTPUTS.len()],
            index: 0,
            product: 0,
            odd: 0,
{%- if rings %}
            turn: 0,
            words,
        };
        let rings = STATES.iter().filter(|state| state.ring);
        let own = rings.clone().map(|state| (state.pe, 0, state.address));
        let copies = rings.flat_map(|state| state.copies).map(|(pe, place)| (*pe, 1, *place));
        for (pe, memory, word) in own.chain(copies) {
            let pe = &mut follower.pes[pe];
            pe.rings[memory].insert(word >> pe.ring_bits << pe.ring_bits);
        }
        follower
    }
{%- else %}
            words,
        }
    }
{%- endif %}

    /// Follows the words from one pause point to the next.
    fn pass(&mut self, base_homes: &[u32]) -> Seen {
        self.passes.count = 0;
        self.checks.0 = std::mem::take(&mut self.checks.1);
        let inputs = (0..INPUT_COUNT).map(|_| self.passes.operation(Kind::Input, Vec::new())).collect();
        self.clock(false, PERIOD);
        self.inputs = inputs;
        (1..PERIOD).for_each(|clock| self.clock(false, PERIOD - clock));
{%- if rings %}
        self.turn = 0;
        for pe in &mut self.pes {
            for (memory, rings) in [&mut pe.own, &mut pe.imported].into_iter().zip(&pe.rings) {
                rings.iter().for_each(|first| memory[*first..][..1 << pe.ring_bits].rotate_left(1));
            }
        }
{%- endif %}
        let state = |(state, home): (&State, &u32)| {
            let pe = &self.pes[state.pe];
{%- if rings %}
            if state.ring {
                return pe.own[state.address];
            }
{%- endif %}
            pe.base[(home - pe.homes.base) as usize]
        };
        Seen {
            checks: std::mem::take(&mut self.checks.0),
            outputs: self.outputs.clone(),
{%- if rings %}
            states: (STATES.iter().zip(base_homes).map(state))
                .chain(copies_in_rings().map(|(pe, place)| self.pes[pe].imported[place]))
                .collect(),
{%- else %}
            states: STATES.iter().zip(base_homes).map(state).collect(),
{%- endif %}
        }
    }

    /// Follows one control word of every PE; so many are left in this pass.
    fn clock(&mut self, settle: bool, left: usize) {
        let (k, odd) = (self.index, self.odd);
{%- if rings %}
        let turn = self.turn;
{%- endif %}
        let ends_step = (k + PERIOD - PAUSE_WORD) % PERIOD / ROUND_WORDS == ROUNDS - 1;
        let receive = |words: &Vec<Word>| match words[k].receive {
            Some((_, Source::Pe(sender))) => Some(self.pes[sender].link),
            Some((_, Source::Input(input))) => Some(self.inputs[input]),
            None => None,
        };
        let received: Vec<Option<Name>> = self.words.iter().map(receive).collect();
        for (index, (pe, words)) in self.pes.iter_mut().zip(&self.words).enumerate() {
            let (word, description) = (&words[k], &PES[index]);
            let own = word.own.map(|address| pe.own[{% if rings %}address.word(odd, turn, description.ring_bits){% else %}address[odd] as usize{% endif %}]);
            let imported = word.imported.map(|address| pe.imported[{% if rings %}address.word(odd, turn, description.ring_bits){% else %}address[odd] as usize{% endif %}]);
            let operand = match (own, imported) {
                (Some(own), Some(imported)) => Some(Operand::Two(own, imported)),
                (one, other) => one.or(other).map(Operand::One),
            };
            if let (true, Some(Operand::Two(own, imported))) = (description.pre_adder, operand) {
                if left <= OPERAND_FLAG {
                    self.checks.1.push((index, [own, imported]));
                } else if !settle {
                    self.checks.0.push((index, [own, imported]));
                }
            }
            let stored = |address: u16| pe.coefficients[address as usize];
            let factor = word.stored.map_or(Factor::Coefficient(word.coefficient), stored);
            let base = match word.base {
                None => Some(Base::Word(Name { pass: 0, index: NO_BASE })),
                Some(address) => pe.base_word(description, address),
            };
            self.passes.alike &= base.is_some();
            let fetched = word.index.map(|place| pe.indices[place as usize]);
            let taken = word.writes() || word.write_index.is_some() || word.send;
            if !settle && (taken || word.captured) {
                let result = pe.result(&mut self.passes, index, taken);
                let address = {% if rings %}word.write.word(odd, turn, description.ring_bits){% else %}word.write[odd] as usize{% endif %};
                if word.write_own {
                    let place = address & (pe.own.len() - 1);
                    pe.own[place] = result;
                }
                if word.write_base && (ends_step || !description.base_last) {
                    let place = word.unsteered() & (pe.base.len() - 1);
                    pe.base[place] = result;
                }
                if word.write_factor {
                    let place = word.unsteered() & (pe.coefficients.len() - 1);
                    pe.coefficients[place] = Factor::Word(result);
                }
                if let Some((place, octaves)) = word.write_index {
                    let segment = Kind::Segment { pe: index, octaves };
                    pe.indices[place as usize] = self.passes.operation(segment, vec![result]);
                }
                if word.send {
                    pe.link = result;
                }
                let captured = if word.captured { OUTPUTS } else { &[] };
                for (shown, output) in self.outputs.iter_mut().zip(captured) {
                    if (output.pe, output.word) == (index, k) {
                        *shown = result;
                    }
                }
            }
            if let (false, Some((address, _)), Some(name)) = (settle, word.receive, received[index]) {
                pe.imported[{% if rings %}address.word(odd, turn, description.ring_bits){% else %}address[odd] as usize{% endif %}] = name;
            }
            pe.results.rotate_right(1);
            pe.results[0] = Pending { base: pe.base_register, held: Rc::clone(&pe.hold), shift: pe.shift };
            pe.base_register = base.unwrap_or(pe.base_register);
            pe.shift = word.shift;
            pe.index = fetched;
            if word.close {
                let products = std::mem::take(&mut pe.accumulator);
                pe.hold = Rc::new(Held { products, ..Held::default() });
            }
            pe.accumulator.extend(pe.products[self.product]);
            pe.products[self.product] = operand.map(|operand| (operand, factor));
        }
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
