//! Text form of a program: for dumps, for files, and to read back.
//!
//! One line per item, one line per control word. After `#` a control-word line names the values it handles; the
//! names are read back as notes, and numbered as they come. Numbers are decimal, memory words hexadecimal in two's
//! complement. A name ends at a blank, and stands in quotes if it has some.

use std::borrow::Cow;
use std::collections::HashMap;
use std::fmt::{self, Display};
use std::str::FromStr;

use super::fits::fits;
use super::{
    Address, CoefficientOperand, ControlWord, FieldName, Host, InputPort, LinkSource, Note, OutputPort, PeFeatures,
    PeProgram, Program, StateRegister, Target, Tick,
};
use crate::index::{self, List, PeId, PortId, ValueId};
use crate::text::{Line, Section, Stage, TextError, fixed, quoted, single};
use crate::word::WordFormat;

impl Display for Program {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Program { model, period, rounds, .. } = self;
        writeln!(f, "{}\nmodel {}\nperiod {period} rounds {rounds}", Stage::Program.header(), name(model))?;
        writeln!(f, "{}", fixed::print_format(&self.format))?;
        if self.host != Host::default() {
            writeln!(f, "host {}", self.host.names().collect::<Vec<_>>().join(" "))?;
        }
        let unit = |unit: &Option<String>| unit.as_ref().map_or(String::new(), |unit| format!(" unit {}", rest(unit)));
        for input in &self.inputs {
            match input.tick {
                None => writeln!(f, "input {} exponent {}{}", name(&input.name), input.exponent, unit(&input.unit))?,
                Some(Tick { steps, done }) => {
                    let (name, exponent) = (name(&input.name), input.exponent);
                    writeln!(f, "tick {name} exponent {exponent} steps {steps} done {done}")?;
                }
            }
        }
        for output in &self.outputs {
            let OutputPort { pe, word, exponent, proven, place, .. } = output;
            let proven = if *proven { " proven" } else { "" };
            let place = place.map_or(String::new(), |place| format!(" place {place}"));
            write!(f, "output {} pe {pe} word {word} exponent {exponent}{proven}{place}", name(&output.name))?;
            writeln!(f, "{}", unit(&output.unit))?;
        }
        for state in &self.states {
            write!(f, "state {} exponent {} own {}:{}", name(&state.name), state.exponent, state.own.0, state.own.1)?;
            f.write_str(if state.tunable { " tunable" } else { "" })?;
            state.age.map_or(Ok(()), |age| write!(f, " age {age}"))?;
            state.imported.iter().try_for_each(|(pe, word)| write!(f, " imported {pe}:{word}"))?;
            writeln!(f)?;
        }
        for (index, pe) in self.pes.numbered() {
            write_pe(f, self, index, pe)?;
        }
        Ok(())
    }
}

fn write_pe(f: &mut fmt::Formatter<'_>, program: &Program, index: PeId, pe: &PeProgram) -> fmt::Result {
    let features = &pe.features;
    let shifts: Vec<String> = features.shifts.iter().map(u8::to_string).collect();
    write!(f, "pe {index} own {} base {}", features.own_words, features.base_words)?;
    write!(f, " coefficients {} imported {}", features.coefficient_words, features.imported_words)?;
    write!(f, " shifts {} accumulator {}", shifts.join(","), features.accumulator_bits)?;
    let flags = [
        (features.factor, "factor"),
        (features.pre_adder, "pre_adder"),
        (features.swap, "swap"),
        (features.base_last, "base_last"),
        (features.send, "send"),
        (features.proven, "proven"),
    ];
    for (present, name) in flags {
        if present {
            write!(f, " {name}")?;
        }
    }
    if features.index_words > 0 {
        write!(f, " index {} bits {}", features.index_words, features.index_bits)?;
        if features.octave_bits > 0 {
            write!(f, " octaves {}", features.octave_bits)?;
        }
    }
    if features.shown_words > 0 {
        write!(f, " shown {}{}", features.shown_words, if features.show_last { " last" } else { "" })?;
    }
    let rings = features.ring_bits;
    writeln!(f, "{}", if rings > 0 { format!(" rings {rings}") } else { String::new() })?;
    for port in &pe.ports {
        match port {
            LinkSource::Pe(pe) => writeln!(f, "port pe {pe}")?,
            LinkSource::Input(input) => writeln!(f, "port input {input}")?,
        }
    }
    for equation in &pe.equations {
        writeln!(f, "equation {}", name(equation))?;
    }
    if !pe.varied.is_empty() {
        let fields: Vec<&str> = pe.varied.iter().map(|field| field.text()).collect();
        writeln!(f, "varied {}", fields.join(" "))?;
    }
    let images = [
        ("own", &pe.own_image),
        ("base", &pe.base_image),
        ("coefficient", &pe.coefficient_image),
        ("imported", &pe.imported_image),
    ];
    for (name, image) in images {
        for (word, value) in image.iter().enumerate().filter(|(_, value)| **value != 0) {
            writeln!(f, "{name} {word} {value:x}")?;
        }
    }
    for (number, (word, note)) in pe.words.iter().zip(&pe.notes).enumerate() {
        write!(f, "word {number}")?;
        write_word(f, word)?;
        if *note != Note::default() {
            f.write_str(" #")?;
            for value in [note.operand, note.chain, note.write, note.receive] {
                match program.name(value) {
                    "" => f.write_str(" -")?,
                    named => write!(f, " {}", name(named))?,
                }
            }
        }
        writeln!(f)?;
    }
    Ok(())
}

fn write_word(f: &mut fmt::Formatter<'_>, word: &ControlWord) -> fmt::Result {
    let multiplies = word.own.is_some() || word.imported.is_some();
    match word.coefficient {
        CoefficientOperand::Coefficient(value) if multiplies || value != 0 => write!(f, " times {value}")?,
        CoefficientOperand::Stored(index) if multiplies || index != 0 => write!(f, " stored {index}")?,
        _ => {}
    }
    let address = |f: &mut fmt::Formatter<'_>, name: &str, Address { word, swap, ring }: Address| {
        write!(f, " {name} {word}{}{}", if swap { "~" } else { "" }, if ring { "+" } else { "" })
    };
    if let Some(own) = word.own {
        address(f, "own", own)?;
    }
    if let Some(imported) = word.imported {
        address(f, "imported", imported)?;
    }
    if word.close {
        write!(f, " close")?;
    }
    if let Some(base) = word.base {
        write!(f, " base {base}")?;
    }
    if let Some(index) = word.index {
        write!(f, " index {index}")?;
    }
    if word.shift != 0 {
        write!(f, " shift {}", word.shift)?;
    }
    if let Some(target) = word.write {
        address(f, "write", target.address)?;
        for (taken, memory) in [(target.own, " to-own"), (target.base, " to-base"), (target.factor, " to-factor")] {
            f.write_str(if taken { memory } else { "" })?;
        }
    }
    if let Some((index, octaves)) = word.write_index {
        write!(f, " {} {index}", if octaves { "to-octave" } else { "to-index" })?;
    }
    if word.show {
        write!(f, " show")?;
    }
    if word.send {
        write!(f, " send")?;
    }
    if let Some((port, a)) = word.receive {
        write!(f, " port {port}")?;
        address(f, "receive", a)?;
    }
    Ok(())
}

/// A name as a field: in quotes where it would not read back.
fn name(name: &str) -> Cow<'_, str> {
    let fits = !name.contains(|letter: char| letter.is_whitespace() || letter.is_control());
    let is_plain = fits && !name.is_empty() && name != "-" && !name.starts_with(['"', '#']);
    if is_plain { Cow::Borrowed(name) } else { Cow::Owned(quoted(name)) }
}

/// A text that takes the rest of a line: in quotes where it would not read back.
fn rest(text: &str) -> Cow<'_, str> {
    let fits = text.trim() == text && !text.is_empty() && !text.starts_with('"');
    if fits && !text.contains(char::is_control) { Cow::Borrowed(text) } else { Cow::Owned(quoted(text)) }
}

fn read_name(line: &mut Line) -> Result<String, TextError> {
    if line.rest().starts_with('"') {
        return line.quoted();
    }
    match line.field() {
        Some(name) => Ok(name.to_owned()),
        None => Err(line.expected("a name")),
    }
}

fn read_unit(line: &mut Line) -> Result<Option<String>, TextError> {
    if !line.take_word("unit") {
        line.done()?;
        return Ok(None);
    }
    if line.rest().starts_with('"') {
        let unit = line.quoted()?;
        line.done()?;
        return Ok(Some(unit));
    }
    match line.take_rest() {
        "" => Err(line.expected("a unit")),
        unit => Ok(Some(unit.to_owned())),
    }
}

impl Program {
    fn empty() -> Program {
        Program {
            model: String::new(),
            format: WordFormat::new(0, 0, 0),
            period: 0,
            rounds: 1,
            pes: List::new(),
            inputs: Vec::new(),
            outputs: Vec::new(),
            states: List::new(),
            names: List::new(),
            host: Host::default(),
        }
    }
}

/// Control words of a program, and PEs, at most: what no device has, and what keeps a damaged text from taking all memory.
const MOST_WORDS: u32 = 1 << 24;

impl FromStr for Program {
    type Err = TextError;

    fn from_str(text: &str) -> Result<Program, TextError> {
        read(&single(text, Stage::Program)?)
    }
}

/// Reads the section of a program.
///
/// # Errors
/// An item is not one of a program, or what it refers to is not there.
pub fn read(section: &Section) -> Result<Program, TextError> {
    let mut parser = Parser { names: HashMap::new(), program: Program::empty() };
    for mut line in section.lines() {
        parser.line(&mut line)?;
    }
    let program = parser.program;
    let complete = program.pes.iter().all(|pe| pe.words.len() == index::at(program.period));
    if program.period == 0 {
        return Err(section.error("there is no item `period`"));
    }
    if !complete || program.pes.is_empty() {
        return Err(section.error("expected as many control words in each PE as the period says"));
    }
    let pe = |pe: PeId| program.pes.find(pe);
    let outputs = program.outputs.iter().all(|output| pe(output.pe).is_some() && output.word < program.period);
    let states = program.states.iter().all(|state| {
        let holds = |at: &(PeId, u16)| pe(at.0).is_some_and(|pe| u32::from(at.1) < pe.features.imported_words);
        let own = pe(state.own.0).is_some_and(|pe| u32::from(state.own.1) < pe.features.own_words);
        own && state.imported.iter().all(holds)
    });
    let ports = program.pes.iter().flat_map(|pe| &pe.ports).all(|port| match port {
        LinkSource::Pe(pe) => program.pes.find(*pe).is_some(),
        LinkSource::Input(input) => (index::at(*input)) < program.inputs.len(),
    });
    match outputs && states && ports {
        true => match program.check_outputs() {
            Ok(()) => Ok(program),
            Err(what) => Err(section.error(what)),
        },
        false => Err(section.error("an output, a state or a port refers to a PE, word or input that does not exist")),
    }
}

struct Parser {
    names: HashMap<String, ValueId>,
    program: Program,
}

const ITEMS: [&str; 17] = [
    "model",
    "period",
    "format",
    "host",
    "input",
    "tick",
    "output",
    "state",
    "pe",
    "port",
    "equation",
    "varied",
    "own",
    "base",
    "coefficient",
    "imported",
    "word",
];

const OPERATIONS: [&str; 19] = [
    "times",
    "stored",
    "own",
    "imported",
    "close",
    "base",
    "index",
    "to-index",
    "to-octave",
    "shift",
    "write",
    "to-own",
    "to-base",
    "to-factor",
    "show",
    "send",
    "port",
    "receive",
    "#",
];

impl Parser {
    fn pe(&mut self, line: &Line) -> Result<&mut PeProgram, TextError> {
        self.program.pes.last_mut().ok_or_else(|| line.error("expected an item `pe` before it"))
    }

    fn line(&mut self, line: &mut Line) -> Result<(), TextError> {
        match ITEMS[line.one_of(&ITEMS)?] {
            "model" => self.program.model = read_name(line)?,
            "period" => {
                self.program.period = line.integer()?;
                if !(1..=MOST_WORDS).contains(&self.program.period) {
                    return Err(line.error(format!("expected a period of 1 to {MOST_WORDS} control words")));
                }
                self.program.rounds = line.keyed("rounds")?;
                if self.program.rounds == 0 || !self.program.period.is_multiple_of(self.program.rounds) {
                    return Err(line.error("expected a number of rounds that divides the period"));
                }
            }
            // What PEs may have depends on it.
            "format" if !self.program.pes.is_empty() => return Err(line.error("expected it in front of the PEs")),
            "format" => self.program.format = fixed::read_format(line)?,
            "host" => {
                while !line.rest().is_empty() {
                    self.program.host.add(Host::NAMES[line.one_of(&Host::NAMES)?]);
                }
            }
            "input" => {
                let (name, exponent) = (read_name(line)?, line.keyed("exponent")?);
                self.program.inputs.push(InputPort { name, exponent, unit: read_unit(line)?, tick: None });
            }
            "tick" => {
                let (name, exponent) = (read_name(line)?, line.keyed("exponent")?);
                let tick = Tick { steps: line.keyed("steps")?, done: line.keyed("done")? };
                if tick.steps == 0 || tick.done >= tick.steps || !(-62..=0).contains(&exponent) {
                    return Err(line.error("expected fewer steps done than there are, and a number that holds 1"));
                }
                self.program.inputs.push(InputPort { name, exponent, unit: None, tick: Some(tick) });
            }
            "output" => {
                let name = read_name(line)?;
                let (pe, word, exponent) = (line.keyed("pe")?, line.keyed("word")?, line.keyed("exponent")?);
                let proven = line.take_word("proven");
                let place = if line.take_word("place") { Some(line.integer()?) } else { None };
                let unit = read_unit(line)?;
                self.program.outputs.push(OutputPort { name, pe, word, exponent, proven, place, unit });
            }
            "state" => self.state(line)?,
            "pe" => self.features(line)?,
            "port" => {
                let source = match line.one_of(&["pe", "input"])? {
                    0 => LinkSource::Pe(line.integer()?),
                    _ => LinkSource::Input(line.integer()?),
                };
                let pe = self.pe(line)?;
                if !pe.words.is_empty() || pe.ports.len() > usize::from(u8::MAX) {
                    return Err(line.error("expected at most 256 ports, in front of the control words"));
                }
                pe.ports.push(source);
            }
            "equation" => {
                let name = read_name(line)?;
                self.pe(line)?.equations.push(name);
            }
            "varied" => {
                let all = FieldName::ALL.map(FieldName::text);
                while !line.is_done() {
                    let field = FieldName::ALL[line.one_of(&all)?];
                    self.pe(line)?.varied.push(field);
                }
            }
            "word" => self.word(line)?,
            memory => {
                let word: usize = line.integer()?;
                let place = line.last();
                let value = line.field().and_then(|field| u64::from_str_radix(field, 16).ok());
                let value = value.ok_or_else(|| line.error("expected a hexadecimal word"))? as i64;
                let pe = self.pe(line)?;
                let image = match memory {
                    "own" => &mut pe.own_image,
                    "base" => &mut pe.base_image,
                    "coefficient" => &mut pe.coefficient_image,
                    _ => &mut pe.imported_image,
                };
                *image.get_mut(word).ok_or_else(|| line.error_at(place, "expected a word within the memory"))? = value;
            }
        }
        line.done()
    }

    fn state(&mut self, line: &mut Line) -> Result<(), TextError> {
        let (name, exponent) = (read_name(line)?, line.keyed("exponent")?);
        line.word("own")?;
        let own = place(line)?;
        let tunable = line.take_word("tunable");
        let age = if line.take_word("age") { Some(line.integer()?) } else { None };
        let mut imported = Vec::new();
        while line.take_word("imported") {
            imported.push(place(line)?);
        }
        self.program.states.push(StateRegister { name, exponent, own, imported, age, tunable });
        Ok(())
    }

    fn features(&mut self, line: &mut Line) -> Result<(), TextError> {
        if self.program.format == Program::empty().format {
            return Err(line.error("expected an item `format` before it"));
        }
        let index: usize = line.integer()?;
        if index != self.program.pes.len() {
            return Err(line.error("expected PEs in order"));
        }
        let (own_words, base_words): (u32, u32) = (line.keyed("own")?, line.keyed("base")?);
        let (coefficient_words, imported_words): (u32, u32) = (line.keyed("coefficients")?, line.keyed("imported")?);
        line.word("shifts")?;
        let mut shifts = vec![line.integer()?];
        while line.take_sign(",") {
            shifts.push(line.integer()?);
        }
        let mut features = PeFeatures {
            own_words,
            base_words,
            coefficient_words,
            imported_words,
            ports: 0,
            shifts,
            accumulator_bits: line.keyed("accumulator")?,
            factor: line.take_word("factor"),
            pre_adder: line.take_word("pre_adder"),
            swap: line.take_word("swap"),
            base_last: line.take_word("base_last"),
            send: line.take_word("send"),
            proven: line.take_word("proven"),
            index_words: 0,
            index_bits: 0,
            octave_bits: 0,
            shown_words: 0,
            show_last: false,
            ring_bits: 0,
        };
        let depth = |words: u32| words.is_power_of_two() && (2..=1 << 16).contains(&words);
        let optional = |words: u32| words == 0 || depth(words);
        if !depth(own_words) || !depth(base_words) || !optional(coefficient_words) || !optional(imported_words) {
            return Err(line.error("expected memory depths that are powers of two up to 65536"));
        }
        if features.shifts.iter().any(|shift| *shift > 63) || !(2..=127).contains(&features.accumulator_bits) {
            return Err(line.error("expected shifts up to 63, and an accumulator of 2 to 127 bits"));
        }
        if line.take_word("index") {
            features.index_words = line.integer()?;
            features.index_bits = line.keyed("bits")?;
            features.octave_bits = if line.take_word("octaves") { line.integer()? } else { 0 };
            let PeFeatures { index_words, index_bits, octave_bits, .. } = features;
            let data_bits = self.program.format.data_bits;
            let indexed = depth(index_words)
                && (1..16).contains(&index_bits)
                && base_words >= 1 << index_bits
                && octave_bits < 6
                && octave_bits <= index_bits
                && (1u32 << octave_bits) - 1 + index_bits - octave_bits < data_bits;
            if !indexed {
                return Err(
                    line.error("expected an index memory whose indices are within a data operand and the base memory")
                );
            }
        }
        if line.take_word("shown") {
            features.shown_words = line.integer()?;
            features.show_last = line.take_word("last");
            if !depth(features.shown_words) {
                return Err(line.error("expected a number of shown words that is a power of two up to 65536"));
            }
        }
        if line.take_word("rings") {
            features.ring_bits = line.integer()?;
            let deepest = own_words.max(imported_words);
            if !(1..16).contains(&features.ring_bits) || deepest >> features.ring_bits == 0 {
                return Err(line.error("expected rings that a memory has room for"));
            }
        }
        self.program.pes.push(PeProgram {
            own_image: vec![0; index::at(own_words)],
            base_image: vec![0; index::at(base_words)],
            coefficient_image: vec![0; index::at(coefficient_words)],
            imported_image: vec![0; index::at(imported_words)],
            features,
            ports: List::new(),
            equations: Vec::new(),
            words: Vec::new(),
            notes: Vec::new(),
            varied: Vec::new(),
        });
        Ok(())
    }

    fn word(&mut self, line: &mut Line) -> Result<(), TextError> {
        let number: usize = line.integer()?;
        let place = line.last();
        let mut word = ControlWord::default();
        if self.pe(line)?.features.coefficient_words > 0 {
            word.coefficient = CoefficientOperand::Stored(0);
        }
        let mut note = Note::default();
        let mut port = 0;
        while !line.is_done() {
            match OPERATIONS[line.one_of(&OPERATIONS)?] {
                "times" => word.coefficient = CoefficientOperand::Coefficient(line.integer()?),
                "stored" => word.coefficient = CoefficientOperand::Stored(line.integer()?),
                "own" => word.own = Some(address(line)?),
                "imported" => word.imported = Some(address(line)?),
                "close" => word.close = true,
                "base" => word.base = Some(line.integer()?),
                "index" => word.index = Some(line.integer()?),
                "to-index" => word.write_index = Some((line.integer()?, false)),
                "to-octave" => word.write_index = Some((line.integer()?, true)),
                "shift" => word.shift = line.integer()?,
                "write" => word.write = Some(Target { address: address(line)?, ..Target::default() }),
                memory @ ("to-own" | "to-base" | "to-factor") => {
                    let target = word.write.as_mut().ok_or_else(|| line.error("expected `write` before it"))?;
                    match memory {
                        "to-own" => target.own = true,
                        "to-base" => target.base = true,
                        _ => target.factor = true,
                    }
                }
                "show" => word.show = true,
                "send" => word.send = true,
                "port" => port = line.integer()?,
                "receive" => word.receive = Some((PortId::new(port), address(line)?)),
                _ => {
                    for slot in [&mut note.operand, &mut note.chain, &mut note.write, &mut note.receive] {
                        *slot = self.note(line)?;
                    }
                }
            }
        }
        let bits = self.program.format.coefficient_bits;
        let period = index::at(self.program.period);
        let pe = self.pe(line)?;
        if number != pe.words.len() || number >= period {
            return Err(line.error_at(place, "expected control words in order, as many as the period says"));
        }
        if !fits(&word, pe, bits) {
            return Err(line.error_at(line.span(), "expected coefficients and addresses within their fields"));
        }
        pe.words.push(word);
        pe.notes.push(note);
        pe.features.ports = index::number(pe.ports.len());
        Ok(())
    }

    fn note(&mut self, line: &mut Line) -> Result<Option<ValueId>, TextError> {
        if line.is_done() || line.take_sign("- ") || line.rest() == "-" && line.take_sign("-") {
            return Ok(None);
        }
        let name = read_name(line)?;
        Ok(Some(*self.names.entry(name).or_insert_with_key(|name| self.program.names.push(name.clone()))))
    }
}

/// A PE and a word in its memory.
fn place(line: &mut Line) -> Result<(PeId, u16), TextError> {
    let pe = line.integer()?;
    line.sign(":")?;
    Ok((pe, line.integer()?))
}

fn address(line: &mut Line) -> Result<Address, TextError> {
    Ok(Address { word: line.integer()?, swap: line.take_sign("~"), ring: line.take_sign("+") })
}
