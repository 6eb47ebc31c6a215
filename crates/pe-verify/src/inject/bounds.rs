//! Bounds of symbols: ranges of words, operands and sums of a step for any stored words at its beginning and any
//! inputs.
//!
//! A number is a sum of the places that it depends on, each anywhere in its range, and of a remainder (affine
//! arithmetic). So a state that a step damps is known not to leave its range, though what is added to it may have
//! either sign. By the rules of the datasheet alone.
//!
//! What is looked up is bounded segment by segment: in one, the argument is between its ends, and each column of the
//! table has one entry. All of them together would bound a polynomial by coefficients that never meet.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use super::datasheet::Design;
use super::symbols::{Id, Node, UNKNOWN_SHIFT};

/// What all arithmetic here may be off by, relative to the numbers: far more than double precision rounds.
const ROUNDING: f64 = 1.0 / (1u64 << 44) as f64;

/// The base of words without one, as `pe_scale.vhd` has it.
const OFFSET: &str = "offset(i) <= '1' when i = WORD_BITS - DATA_BITS - 1 else";

/// As what a symbol is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Kind {
    /// A stored word.
    Word,
    /// An operand of the data port.
    Operand,
    /// One of the coefficient port.
    Factor,
    /// A sum of products.
    Sum,
}

/// `center + sum of factor * place + remainder`, each place between -1 and 1, the remainder at most that; and between
/// limits, which may be narrower.
#[derive(Clone, Debug, Default)]
struct Form {
    center: f64,
    places: BTreeMap<Id, f64>,
    rest: f64,
    least: f64,
    most: f64,
}

impl Form {
    fn between(least: f64, most: f64) -> Form {
        Form { center: (least + most) / 2.0, places: BTreeMap::new(), rest: (most - least) / 2.0, least, most }
    }

    /// Anything in a range, and the same wherever it stands.
    fn place(id: Id, least: f64, most: f64) -> Form {
        let form = Form::between(least, most);
        Form { places: BTreeMap::from([(id, form.rest)]), rest: 0.0, ..form }
    }

    fn reach(&self) -> f64 {
        self.places.values().map(|factor| factor.abs()).sum::<f64>() + self.rest
    }

    /// Allows for rounding of the arithmetic, and for so much more on both sides.
    fn widened(mut self, more: f64) -> Form {
        let reach = self.reach();
        let more = more + ROUNDING * (self.center.abs() + reach + self.least.abs() + self.most.abs());
        self.rest += more;
        self.least = (self.least - more).max(self.center - reach - 2.0 * more);
        self.most = (self.most + more).min(self.center + reach + 2.0 * more);
        self
    }

    /// Between other limits as well, and no better known otherwise.
    fn limited(self, least: f64, most: f64) -> Form {
        Form { least: self.least.max(least), most: self.most.min(most), ..self }
    }

    fn times(&self, factor: f64) -> Form {
        let places = self.places.iter().map(|(id, of)| (*id, of * factor)).collect();
        let ends = [self.least * factor, self.most * factor];
        let (least, most) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        Form { center: self.center * factor, places, rest: self.rest * factor.abs(), least, most }.widened(0.0)
    }

    fn plus(&self, other: &Form) -> Form {
        let mut sum = self.clone();
        sum.center += other.center;
        sum.rest += other.rest;
        sum.least += other.least;
        sum.most += other.most;
        for (id, factor) in &other.places {
            *sum.places.entry(*id).or_default() += factor;
        }
        sum.widened(0.0)
    }

    fn product(&self, other: &Form) -> Form {
        let mut product = self.times(other.center).plus(&other.times(self.center));
        product.center -= self.center * other.center;
        product.rest += self.reach() * other.reach();
        let ends = [self.least, self.most].map(|a| [a * other.least, a * other.most]);
        let ends = ends.as_flattened();
        product.least = ends.iter().copied().fold(f64::INFINITY, f64::min);
        product.most = ends.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        product.widened(0.0)
    }
}

/// Cases of segments that are told apart for one question, at most.
const CASES: usize = 4096;

/// An index, and the segment that it is supposed to be.
#[derive(Clone, Copy, Debug)]
struct Case {
    index: Id,
    segment: usize,
    /// The word whose segment it is, and the ends of that.
    argument: Id,
    least: f64,
    most: f64,
}

/// Bounds of the symbols of a design.
pub(super) struct Bounds<'a> {
    nodes: &'a [Node],
    /// Bits that count octaves, if that is the same in all PEs with such indices.
    octave_bits: Option<u32>,
    /// What is supposed of indices.
    cases: Vec<Case>,
    /// Bits of stored word, data port, coefficient port, and of the shortest accumulator.
    widths: [u32; 4],
    /// Bits by which sums are shifted to the left.
    left: i32,
    /// Half an LSB of an output port less the offset of stored words.
    shown: f64,
    /// Whether every word that is out of range is clamped.
    clamps: bool,
    known: HashMap<(Id, Kind), Option<Form>>,
}

fn power(bits: i32) -> f64 {
    libm::scalbn(1.0, bits)
}

impl<'a> Bounds<'a> {
    pub(super) fn new(design: &Design, nodes: &'a [Node]) -> Bounds<'a> {
        let [word, data, coefficient] = design.widths;
        let sums = design.pes.iter().map(|pe| pe.features.accumulator_bits).min().unwrap_or(0);
        let half = |bits: u32| if bits == 0 { 0.0 } else { power(bits as i32 - 1) };
        let octaves: BTreeSet<u32> =
            design.pes.iter().map(|pe| pe.features.octave_width).filter(|bits| *bits > 0).collect();
        Bounds {
            nodes,
            octave_bits: octaves.first().copied().filter(|_| octaves.len() == 1),
            cases: Vec::new(),
            widths: [word, data, coefficient, sums],
            left: (word as i32 + 2 - data as i32 - coefficient as i32).max(0),
            shown: half(word - design.port_bits.min(word)) - half(word - data.min(word)),
            clamps: design.pes.iter().all(|pe| pe.features.saturate),
            known: HashMap::new(),
        }
    }

    /// Whether a word may be out of range before it is clamped.
    pub(super) fn may_saturate(&mut self, word: Id) -> bool {
        !self.always(word, |bounds| bounds.unclamped(word).is_some_and(|form| bounds.within(&form, 0, 0.0)))
    }

    /// Whether an output that shows a word may be out of range before it is clamped.
    pub(super) fn may_clamp(&mut self, word: Id) -> bool {
        let shown = self.shown;
        !self.always(word, |bounds| bounds.form(word, Kind::Word).is_some_and(|form| bounds.within(&form, 0, shown)))
    }

    /// Whether one of two operands may be too large for their sum.
    pub(super) fn may_be_too_large(&mut self, both: Id) -> bool {
        let Node::Both(own, imported, _) = self.nodes[both as usize] else { return true };
        let mut small = |id| {
            self.always(id, |bounds| bounds.form(id, Kind::Operand).is_some_and(|form| bounds.within(&form, 1, 0.0)))
        };
        !(small(own) && small(imported))
    }

    /// Whether something is known of a symbol, at once or in every case of the indices that it depends on.
    fn always(&mut self, id: Id, known: impl Fn(&mut Bounds) -> bool) -> bool {
        if known(self) {
            return true;
        }
        let indices = self.indices(id);
        let cases: Option<Vec<Vec<Case>>> =
            indices.iter().map(|(index, entries)| self.segments(*index, *entries)).collect();
        let Some(cases) = cases.filter(|cases| !cases.is_empty()) else { return false };
        let count = cases.iter().try_fold(1usize, |count, cases| count.checked_mul(cases.len()));
        let Some(count) = count.filter(|count| *count <= CASES) else { return false };
        (0..count).all(|mut number| {
            let mut turn = |cases: &Vec<Case>| {
                let case = cases[number % cases.len()];
                number /= cases.len();
                case
            };
            let cases = cases.iter().map(&mut turn).collect();
            known(&mut Bounds { cases, known: HashMap::new(), ..*self })
        })
    }

    /// The indices by which something is chosen that a symbol is made of, with the number of segments. What an argument
    /// is made of does not matter where its segment is known.
    fn indices(&self, id: Id) -> BTreeMap<Id, usize> {
        let all = self.indices_outside(id, &BTreeSet::new());
        let argument = |index: &Id| match self.nodes[*index as usize] {
            Node::Segment(argument, _) => Some(argument),
            _ => None,
        };
        self.indices_outside(id, &all.keys().filter_map(argument).collect())
    }

    /// The same without what some symbols are made of.
    fn indices_outside(&self, id: Id, outside: &BTreeSet<Id>) -> BTreeMap<Id, usize> {
        let (mut indices, mut done, mut left) = (BTreeMap::new(), outside.clone(), vec![id]);
        while let Some(id) = left.pop() {
            if !done.insert(id) {
                continue;
            }
            match &self.nodes[id as usize] {
                Node::Data(of) | Node::Factor(of) => left.push(*of),
                Node::Both(a, b, _) | Node::Product(a, b) | Node::Sum(a, b) | Node::Word(a, b, _) => {
                    left.extend([*a, *b]);
                }
                Node::Chosen(index, words) => {
                    indices.insert(*index, words.len());
                    left.extend(words);
                }
                _ => {}
            }
        }
        indices
    }

    /// The cases of an index, by the words of its segments; none if it is not known what those are. Segments that the
    /// argument does not reach are no cases.
    fn segments(&mut self, index: Id, entries: usize) -> Option<Vec<Case>> {
        let Node::Segment(argument, octaves) = self.nodes[index as usize] else { return None };
        let bits = self.widths[0];
        let octave_bits = if octaves { self.octave_bits? } else { 0 };
        let whole = self.form(argument, Kind::Word)?;
        let cases = (0..entries).map(|segment| {
            let (least, most) = segment_words(segment, entries.ilog2(), octave_bits, bits);
            Case { index, segment, argument, least: least.max(whole.least), most: most.min(whole.most) }
        });
        Some(cases.filter(|case| case.least <= case.most).collect())
    }

    /// Whether a number, and something more, is in the range of words (0), of halves of operands (1), operands (2),
    /// sums (3).
    fn within(&self, form: &Form, what: usize, more: f64) -> bool {
        let bits = [self.widths[0], self.widths[1] - 1, self.widths[1], self.widths[3]][what];
        let full = power(bits as i32 - 1);
        form.least + more >= -full && form.most + more <= full - 1.0
    }

    fn whole(&self, id: Id, kind: Kind) -> Option<Form> {
        let bits = match kind {
            Kind::Word => self.widths[0],
            Kind::Operand => self.widths[1],
            Kind::Factor => self.widths[2],
            Kind::Sum => return None,
        };
        let full = power(bits as i32 - 1);
        Some(Form::place(id, -full, full - 1.0))
    }

    fn form(&mut self, id: Id, kind: Kind) -> Option<Form> {
        if let Some(known) = self.known.get(&(id, kind)) {
            return known.clone();
        }
        let form = self.made(id, kind);
        self.known.insert((id, kind), form.clone());
        form
    }

    fn made(&mut self, id: Id, kind: Kind) -> Option<Form> {
        let nodes = self.nodes;
        if let Some(case) = self.cases.iter().find(|case| case.argument == id && kind == Kind::Word) {
            return Some(Form::place(id, case.least, case.most).widened(0.0));
        }
        match (&nodes[id as usize], kind) {
            (Node::Constant(0), _) => Some(Form::default()),
            (Node::Constant(bits), Kind::Word | Kind::Operand | Kind::Factor) => {
                let width = self.widths[kind as usize];
                let value = ((bits << (128 - width)) as i128 >> (128 - width)) as f64;
                Some(Form::between(value, value).widened(0.0))
            }
            (Node::Offset(made), Kind::Word) if made == OFFSET => {
                let dropped = self.widths[0] as i32 - self.widths[1] as i32;
                let offset = if dropped > 0 { power(dropped - 1) } else { 0.0 };
                Some(Form::between(offset, offset))
            }
            (Node::Data(word), Kind::Operand) => Some(self.cut(*word, self.widths[1])),
            (Node::Factor(word), Kind::Factor) => Some(self.cut(*word, self.widths[2])),
            (Node::Both(own, imported, true), Kind::Operand) => {
                let sum = self.form(*own, Kind::Operand)?.plus(&self.form(*imported, Kind::Operand)?);
                if self.within(&sum, 2, 0.0) { Some(sum) } else { self.whole(id, kind) }
            }
            (Node::Product(operand, factor), Kind::Sum) => {
                Some(self.form(*operand, Kind::Operand)?.product(&self.form(*factor, Kind::Factor)?))
            }
            (Node::Sum(before, product), Kind::Sum) => {
                let sum = self.form(*before, Kind::Sum)?.plus(&self.form(*product, Kind::Sum)?);
                self.within(&sum, 3, 0.0).then_some(sum)
            }
            (Node::Word(..), Kind::Word) => {
                let Some(form) = self.unclamped(id) else { return self.whole(id, kind) };
                let full = power(self.widths[0] as i32 - 1);
                if self.within(&form, 0, 0.0) {
                    return Some(form);
                }
                if !self.clamps {
                    return self.whole(id, kind);
                }
                // A clamped word is what it would have been, less what is too much. The largest one has eight ones.
                let ceiling = full - power(self.widths[0] as i32 - 8);
                let above = if form.most > full - 1.0 { form.most - ceiling } else { 0.0 };
                let taken = Form::between(-above, (-full - form.least).max(0.0));
                Some(form.plus(&taken).limited(-full, full - 1.0))
            }
            (Node::Chosen(index, words), Kind::Word) => {
                if let Some(case) = self.cases.iter().find(|case| case.index == *index) {
                    return self.form(words[case.segment], Kind::Word);
                }
                let mut range = (f64::INFINITY, f64::NEG_INFINITY);
                for word in words {
                    let form = self.form(*word, Kind::Word)?;
                    range = (range.0.min(form.least), range.1.max(form.most));
                }
                Some(Form::between(range.0, range.1).widened(0.0))
            }
            _ => self.whole(id, kind),
        }
    }

    /// The upper bits of a word.
    fn cut(&mut self, word: Id, bits: u32) -> Form {
        let dropped = self.widths[0] as i32 - bits as i32;
        let word = self.form(word, Kind::Word).expect("words are bounded");
        let full = power(bits as i32 - 1);
        let rest = if dropped > 0 { 1.0 } else { 0.0 };
        word.times(power(-dropped)).plus(&Form::between(-rest, 0.0)).limited(-full, full - 1.0)
    }

    /// Base and shifted sum.
    fn unclamped(&mut self, word: Id) -> Option<Form> {
        let Node::Word(base, held, shift) = self.nodes[word as usize] else { return self.form(word, Kind::Word) };
        if shift >= UNKNOWN_SHIFT {
            return None;
        }
        let sum = self.form(held, Kind::Sum)?.times(power(self.left - shift as i32));
        let sum = sum.widened(if shift > 0 { 0.5 } else { 0.0 });
        Some(self.form(base, Kind::Word)?.plus(&sum))
    }
}

/// The first and last word of a segment, by the datasheet: equal parts, or with so many bits that count octaves. All
/// negative words are in the last octave's first one.
fn segment_words(segment: usize, index_bits: u32, octave_bits: u32, word_bits: u32) -> (f64, f64) {
    let full = power(word_bits as i32 - 1);
    if octave_bits == 0 {
        let size = 2.0 * full * power(-(index_bits as i32));
        let first = segment as f64 * size - full;
        return (first, first + size - 1.0);
    }
    let mantissa_bits = index_bits - octave_bits;
    let (octave, mantissa) = (segment >> mantissa_bits, segment % (1 << mantissa_bits));
    let is_last = octave == (1 << octave_bits) - 1;
    // A leading one in bit N-2 is octave 0; the last octave has none.
    let place = full * power(-(octave as i32));
    let (start, size) = if is_last { (0.0, place) } else { (place / 2.0, place / 2.0) };
    let size = size * power(-(mantissa_bits as i32));
    let first = start + mantissa as f64 * size;
    (if is_last && mantissa == 0 { -full } else { first }, first + size - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A design of 32, 25 and 18 bits, whose ports have as many bits as its words.
    fn design() -> Design {
        Design { widths: [32, 25, 18], port_bits: 32, ..Design::default() }
    }

    /// `base + base * 2^-11 * factor`, as an own operand: base, word.
    fn nodes(factor: i64) -> Vec<Node> {
        let base = Node::Stored(0, 0);
        vec![
            Node::Constant(0),
            base,
            Node::Data(1),
            Node::Constant((factor & 0x3ffff) as u128),
            Node::Product(2, 3),
            Node::Word(1, 4, 4),
        ]
    }

    #[test]
    fn a_state_that_is_damped_stays_in_range_and_one_that_grows_may_not() {
        let design = Design { pes: Vec::new(), ..design() };
        for (factor, saturates) in [(-1000, false), (1000, true)] {
            let nodes = nodes(factor);
            let mut bounds = Bounds { widths: [32, 25, 18, 48], ..Bounds::new(&design, &nodes) };
            assert_eq!(bounds.may_saturate(5), saturates, "{factor}");
        }
    }

    #[test]
    fn what_is_not_known_may_be_anything() {
        let design = design();
        let nodes = vec![Node::Constant(0), Node::Stored(0, 0), Node::Word(1, 1, 3), Node::Word(1, 0, UNKNOWN_SHIFT)];
        let mut bounds = Bounds::new(&design, &nodes);
        assert!(bounds.may_saturate(2) && bounds.may_saturate(3) && bounds.may_clamp(1));
        assert!(!bounds.may_saturate(1));
    }

    #[test]
    fn products_keep_within_the_products_of_their_ranges() {
        let (a, b) = (Form::place(1, -3.0, 5.0), Form::place(2, -7.0, 2.0));
        let product = a.product(&b);
        assert!(product.least <= -35.0 && product.most >= 21.0 && product.least > -35.1 && product.most < 21.1);
        let square = a.product(&a);
        assert!(square.most >= 25.0 && square.least <= 0.0);
        let twice = a.plus(&a.times(-1.0));
        assert!(twice.most < 1e-9 && twice.least > -1e-9);
    }

    #[test]
    fn segments_take_each_word_once() {
        for octave_bits in [0, 2, 3] {
            let ends: Vec<(f64, f64)> = (0..32).map(|segment| segment_words(segment, 5, octave_bits, 14)).collect();
            let mut words: Vec<(f64, f64)> = ends.clone();
            words.sort_by(|a, b| a.0.total_cmp(&b.0));
            assert!(words.windows(2).all(|pair| pair[0].1 + 1.0 == pair[1].0), "{octave_bits}: {ends:?}");
            assert_eq!((words[0].0, words[31].1), (-8192.0, 8191.0));
        }
        // Leading ones in bits 12 and 11 of 14, and below.
        let octaves: Vec<(f64, f64)> = (0..8).map(|segment| segment_words(segment, 3, 2, 14)).collect();
        assert_eq!(octaves[0], (4096.0, 6143.0));
        assert_eq!(octaves[3], (3072.0, 4095.0));
        assert_eq!(octaves[7], (512.0, 1023.0));
    }

    #[test]
    fn what_is_looked_up_is_bounded_segment_by_segment() {
        // Two segments: base 0 and slope 1 below zero, base 0 and slope -1 above, so that the sum is never positive.
        let design = Design { pes: Vec::new(), ..design() };
        let word = |value: i64| Node::Constant((value & 0xffff_ffff) as u128);
        let slope = |value: i64| word(value << 14);
        let nodes = vec![
            Node::Constant(0),
            Node::Stored(0, 0),
            Node::Segment(1, false),
            slope(1000),
            slope(-1000),
            Node::Chosen(2, vec![3, 4]),
            Node::Data(1),
            Node::Factor(5),
            Node::Product(6, 7),
            word(i64::from(i32::MAX) - 1000),
            Node::Word(9, 8, 5),
        ];
        let bounds = |nodes| Bounds { widths: [32, 25, 18, 48], ..Bounds::new(&design, nodes) };
        let mut known = bounds(&nodes);
        // Without cases the slope may have either sign on both sides.
        assert!(known.unclamped(10).is_some_and(|form| form.most > f64::from(i32::MAX)));
        assert!(known.always(10, |bounds| bounds.unclamped(10).is_some_and(|form| form.most <= f64::from(i32::MAX))));
        assert!(!known.always(10, |bounds| bounds.unclamped(10).is_some_and(|form| form.most <= 0.0)));
    }

    #[test]
    fn what_an_argument_is_made_of_gives_no_cases() {
        let design = design();
        // What is looked up at 2 is added to the argument of the index 5.
        let nodes = vec![
            Node::Constant(0),
            Node::Stored(0, 0),
            Node::Segment(1, false),
            Node::Chosen(2, vec![0, 1]),
            Node::Word(3, 6, 3),
            Node::Segment(4, false),
            Node::Product(7, 8),
            Node::Data(1),
            Node::Factor(1),
            Node::Chosen(5, vec![1, 0]),
            Node::Data(4),
            Node::Product(10, 8),
            Node::Word(9, 11, 3),
        ];
        let bounds = Bounds::new(&design, &nodes);
        assert_eq!(bounds.indices(12), BTreeMap::from([(5, 2)]));
        assert_eq!(bounds.indices(4), BTreeMap::from([(2, 2)]));
    }
}
