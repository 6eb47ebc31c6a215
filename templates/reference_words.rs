{% if rings -%}
/// An address in even and in odd steps, and whether it is that of a ring.
#[derive(Clone, Copy)]
struct Place {
    address: [u16; 2],
    ring: bool,
}

impl Place {
    /// The word of the memory: the number of the step is added to the lowest bits of an address of a ring.
    fn word(&self, odd: usize, turn: u64, ring_bits: u32) -> usize {
        let address = self.address[odd] as usize;
        if self.ring { turned(address, turn, ring_bits) } else { address }
    }
}

/// The word of a ring in a step.
fn turned(address: usize, turn: u64, ring_bits: u32) -> usize {
    let mask = (1 << ring_bits) - 1;
    address & !mask | (address + turn as usize) & mask
}

{% endif -%}
/// Reads the fields of a control word from its most significant end.
struct Fields {
    word: u128,
    left: u32,
}

impl Fields {
    fn take(&mut self, width: u32) -> u64 {
        self.left -= width;
        (self.word >> self.left) as u64 & ((1u64 << width) - 1)
    }

    /// Enable, swap{% if rings %}, ring{% endif %} and address: the address in even and in odd steps.
    fn address(&mut self, present: bool, swap: bool, {% if rings %}rings: bool, {% endif %}width: u32) -> Option<{% if rings %}Place{% else %}[u16; 2]{% endif %}> {
        if !present {
            return None;
        }
        let enable = self.take(1) == 1;
        let swapped = swap && self.take(1) == 1;
{%- if rings %}
        let ring = rings && self.take(1) == 1;
{%- endif %}
        let address = self.take(width) as u16;
        let odd = if swapped { address ^ 1 << (width - 1) } else { address };
{%- if rings %}
        let place = Place { address: [address, odd], ring };
        if enable { Some(place) } else { None }
{%- else %}
        if enable { Some([address, odd]) } else { None }
{%- endif %}
    }
}

/// A decoded control word.
struct Word {
    own: Option<{% if rings %}Place{% else %}[u16; 2]{% endif %}>,
    imported: Option<{% if rings %}Place{% else %}[u16; 2]{% endif %}>,
    /// Word of the coefficient memory.
    stored: Option<u16>,
    coefficient: i64,
    close: bool,
    base: Option<u16>,
    /// Word of the index memory to fetch.
    index: Option<u16>,
    shift: u32,
    write_own: bool,
    write_base: bool,
    write_factor: bool,
    /// Write address in even and in odd steps.
    write: {% if rings %}Place{% else %}[u16; 2]{% endif %},
    /// Word of the index memory to write, and whether the index counts octaves.
    write_index: Option<(u16, bool)>,
    send: bool,
    receive: Option<({% if rings %}Place{% else %}[u16; 2]{% endif %}, Source)>,
    /// Whether an output captures the result.
    captured: bool,
}

impl Description {
    /// Words that a write address tells apart.
    fn write_words(&self) -> u32 {
        let factors = if self.factor { self.coefficient_words } else { 0 };
        self.own_words.max(self.base_words).max(factors)
    }

    /// Control words of a step, put together from their memories.
    fn control_words(&self) -> Vec<u128> {
        let read = |text: &str| -> Vec<u128> {
            let word = |line: &str| u128::from_str_radix(line.trim(), 16).expect("control words are hexadecimal");
            text.lines().filter(|line| !line.trim().is_empty()).map(word).collect()
        };
        let (repeated, stream, variants) = (read(self.repeated), read(self.stream), read(self.variants));
        let word = |k: usize| {
            let (round, place) = (k / ROUND_WORDS, k % ROUND_WORDS);
            let looped = repeated.get(place).copied().unwrap_or(0) & ((1 << self.repeated_bits) - 1);
            let streamed = if variants.is_empty() {
                stream.get(k).copied().unwrap_or(0)
            } else {
                let before = repeated[(place + ROUND_WORDS - 1) % ROUND_WORDS];
                let variant = (before >> self.repeated_bits) as usize;
                variants[variant * ROUNDS.next_power_of_two() + round]
            };
            spread(looped, !self.streamed) | spread(streamed, self.streamed)
        };
        (0..PERIOD).map(word).collect()
    }
}

impl Word {
    fn writes(&self) -> bool {
        self.write_own || self.write_base || self.write_factor
    }

    /// The write address without swap{% if rings %} and ring{% endif %}.
    fn unsteered(&self) -> usize {
        usize::from(self.write{% if rings %}.address{% endif %}[0])
    }

    fn decode(pe: &Description, word: u128) -> Word {
        let own = index_bits(pe.own_words);
        let imports = pe.imported_words > 0;
        let imported = if imports { index_bits(pe.imported_words) } else { 0 };
        let swap = pe.swap as u32;
{%- if rings %}
        let rings = pe.ring_bits > 0;
        let swap = swap + rings as u32;
{%- endif %}
        let address = |present: bool, swap: u32, width: u32| if present { 1 + swap + width } else { 0 };
        let shift_bits = index_bits(pe.shifts.len() as u32);
        let port_bits = index_bits(pe.ports.len() as u32);
        let base_bits = index_bits(pe.base_words);
        let stored_bits = index_bits(pe.coefficient_words.max(1));
        let coefficient_bits = if pe.coefficient_words == 0 { COEFFICIENT_BITS } else { 0 };
        let write_bits = index_bits(pe.write_words());
        let indexed = pe.index_words > 0;
        let octaves = indexed && pe.octave_width > 0;
        let place_bits = if indexed { index_bits(pe.index_words) } else { 0 };
        let bits = address(true, swap, own)
            + 2 * address(imports, swap, imported)
            + stored_bits
            + coefficient_bits
            + 1
            + address(true, 0, base_bits)
            + shift_bits
            + 2
            + pe.factor as u32
            + swap
            + write_bits
            + 2 * address(indexed, 0, place_bits)
            + octaves as u32
{%- if memory %}
            + pe.shows as u32
{%- endif %}
            + pe.send as u32
            + port_bits;
        let mut fields = Fields { word, left: bits };
        let own_operand = fields.address(true, pe.swap, {% if rings %}rings, {% endif %}own);
        let imported_operand = fields.address(imports, pe.swap, {% if rings %}rings, {% endif %}imported);
        let coefficient = match coefficient_bits {
            0 => 0,
            bits => signed(fields.take(bits) as i64, bits),
        };
        let stored = fields.take(stored_bits) as u16;
        let close = fields.take(1) == 1;
        let base_enable = fields.take(1) == 1;
        let base = fields.take(base_bits) as u16;
        let fetch = indexed && fields.take(1) == 1;
        let place = fields.take(place_bits) as u16;
        let shift = pe.shifts.get(fields.take(shift_bits) as usize).copied().unwrap_or(0);
        let write_own = fields.take(1) == 1;
        let write_base = fields.take(1) == 1;
        let write_factor = pe.factor && fields.take(1) == 1;
        let write_swap = pe.swap && fields.take(1) == 1;
{%- if rings %}
        let write_ring = rings && fields.take(1) == 1;
{%- endif %}
        let even = fields.take(write_bits) as u16;
        let odd = if write_swap { even ^ 1 << (own - 1) } else { even };
        let write_index = indexed && fields.take(1) == 1;
        let octaves = octaves && fields.take(1) == 1;
        let written = fields.take(place_bits) as u16;
{%- if memory %}
        // Outputs know their words.
        fields.take(pe.shows as u32);
{%- endif %}
        let send = pe.send && fields.take(1) == 1;
        let receive = fields.address(imports, pe.swap, {% if rings %}rings, {% endif %}imported);
        let port = fields.take(port_bits) as usize;
        Word {
            own: own_operand,
            imported: imported_operand,
            stored: (pe.coefficient_words > 0).then_some(stored),
            coefficient,
            close,
            base: base_enable.then_some(base),
            index: fetch.then_some(place),
            shift,
            write_own,
            write_base,
            write_factor,
            write: {% if rings %}Place { address: [even, odd], ring: write_ring }{% else %}[even, odd]{% endif %},
            write_index: write_index.then_some((written, octaves)),
            send,
            receive: receive.map(|address| (address, pe.ports[port])),
            captured: false,
        }
    }
}

/// The control words of every PE.
fn program() -> Vec<Vec<Word>> {
    let decode = |pe: &Description| pe.control_words().into_iter().map(|word| Word::decode(pe, word)).collect();
    let mut program: Vec<Vec<Word>> = PES.iter().map(decode).collect();
    for output in OUTPUTS {
        program[output.pe][output.word].captured = true;
    }
    program
}
