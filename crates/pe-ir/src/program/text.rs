//! Text form of a program: for dumps, for files, and to read back.
//!
//! One line per item, one line per control word. After `#` a control-word line names the values it handles; the
//! names are read back as notes. Numbers are decimal, memory words hexadecimal in two's complement.

use std::collections::HashMap;
use std::fmt::{self, Display};

use super::{
    Address, ControlWord, InputPort, LinkSource, Multiplier, Note, OutputPort, PeFeatures, PeProgram, Program,
    StateRegister, Target, Tick,
};
use crate::word::{Pipeline, WordFormat};

const HEADER: &str = "pe-synth program 1";

/// A line that is not part of a program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParseError {
    /// 1-based line.
    pub line: usize,
    /// What was expected there.
    pub expected: String,
}

impl Display for ParseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: expected {}", self.line, self.expected)
    }
}

impl std::error::Error for ParseError {}

impl Display for Program {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let WordFormat { storage_bits, guard_bits, data_bits, coefficient_bits, pipeline } = self.format;
        let pipeline = match pipeline {
            Pipeline::Short => String::new(),
            Pipeline::Deep => format!(" pipeline {}", pipeline.name()),
        };
        writeln!(f, "{HEADER}\nmodel {}\nperiod {} rounds {}", self.model, self.period, self.rounds)?;
        writeln!(
            f,
            "format storage {storage_bits} guard {guard_bits} data {data_bits} coefficient {coefficient_bits}{pipeline}"
        )?;
        let unit = |unit: &Option<String>| unit.as_ref().map_or(String::new(), |unit| format!(" unit {unit}"));
        for input in &self.inputs {
            match input.tick {
                None => writeln!(f, "input {} exponent {}{}", input.name, input.exponent, unit(&input.unit))?,
                Some(Tick { steps, done }) => {
                    writeln!(f, "tick {} exponent {} steps {steps} done {done}", input.name, input.exponent)?;
                }
            }
        }
        for output in &self.outputs {
            let OutputPort { name, pe, word, exponent, .. } = output;
            writeln!(f, "output {name} pe {pe} word {word} exponent {exponent}{}", unit(&output.unit))?;
        }
        for state in &self.states {
            write!(f, "state {} exponent {} own {}:{}", state.name, state.exponent, state.own.0, state.own.1)?;
            state.imported.iter().try_for_each(|(pe, word)| write!(f, " imported {pe}:{word}"))?;
            writeln!(f)?;
        }
        for (index, pe) in self.pes.iter().enumerate() {
            write_pe(f, self, index, pe)?;
        }
        Ok(())
    }
}

fn write_pe(f: &mut fmt::Formatter<'_>, program: &Program, index: usize, pe: &PeProgram) -> fmt::Result {
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
    writeln!(f)?;
    for port in &pe.ports {
        match port {
            LinkSource::Pe(pe) => writeln!(f, "port pe {pe}")?,
            LinkSource::Input(input) => writeln!(f, "port input {input}")?,
        }
    }
    for equation in &pe.equations {
        writeln!(f, "equation {equation}")?;
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
            let name = |value| match program.name(value) {
                "" => "-",
                name => name,
            };
            f.write_str(" #")?;
            for value in [note.operand, note.chain, note.write, note.receive] {
                f.write_str(" ")?;
                f.write_str(name(value))?;
            }
        }
        writeln!(f)?;
    }
    Ok(())
}

fn write_word(f: &mut fmt::Formatter<'_>, word: &ControlWord) -> fmt::Result {
    let multiplies = word.own.is_some() || word.imported.is_some();
    match word.multiplier {
        Multiplier::Coefficient(value) if multiplies || value != 0 => write!(f, " times {value}")?,
        Multiplier::Stored(index) if multiplies || index != 0 => write!(f, " stored {index}")?,
        _ => {}
    }
    let address = |f: &mut fmt::Formatter<'_>, name: &str, Address { word, swap }: Address| {
        write!(f, " {name} {word}{}", if swap { "~" } else { "" })
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
    if word.send {
        write!(f, " send")?;
    }
    if let Some((port, a)) = word.receive {
        write!(f, " port {port}")?;
        address(f, "receive", a)?;
    }
    Ok(())
}

impl std::str::FromStr for Program {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Program, ParseError> {
        let mut parser = Parser { line: 0, names: HashMap::new(), program: Program::empty() };
        for (index, line) in text.lines().enumerate() {
            parser.line = index + 1;
            parser.line(line)?;
        }
        let complete = parser.program.pes.iter().all(|pe| pe.words.len() == parser.program.period as usize);
        if !complete || parser.program.period == 0 {
            return Err(parser.error("as many control words in each PE as the period says"));
        }
        Ok(parser.program)
    }
}

impl Program {
    fn empty() -> Program {
        Program {
            model: String::new(),
            format: WordFormat::new(0, 0, 0),
            period: 0,
            rounds: 1,
            pes: Vec::new(),
            inputs: Vec::new(),
            outputs: Vec::new(),
            states: Vec::new(),
            names: Vec::new(),
        }
    }
}

/// Whether everything a control word refers to exists in its PE.
fn fits(word: &ControlWord, pe: &PeProgram, coefficient_bits: u32) -> bool {
    let features = &pe.features;
    let own = |address: Option<Address>| address.is_none_or(|a| u32::from(a.word) < features.own_words);
    let imported = |address: Option<Address>| address.is_none_or(|a| u32::from(a.word) < features.imported_words);
    let multiplier = match word.multiplier {
        Multiplier::Coefficient(value) => {
            features.coefficient_words == 0
                && (1..64).contains(&coefficient_bits)
                && value >> (coefficient_bits - 1) == value >> 63
        }
        Multiplier::Stored(index) => u32::from(index) < features.coefficient_words,
    };
    let target = |target: Target| {
        u32::from(target.address.word) < features.write_words()
            && (features.factor || !target.factor)
            && (target.own || target.base || target.factor)
    };
    let written = word.write.map(|target| target.address);
    let swapping = [word.own, word.imported, written, word.receive.map(|(_, address)| address)];
    multiplier
        && own(word.own)
        && word.base.is_none_or(|base| u32::from(base) < features.base_words)
        && word.index.is_none_or(|index| u32::from(index) < features.index_words)
        && word.write_index.is_none_or(|(index, octaves)| {
            u32::from(index) < features.index_words && (features.octave_bits > 0 || !octaves)
        })
        && word.write.is_none_or(target)
        && imported(word.imported)
        && word.receive.is_none_or(|(port, a)| usize::from(port) < pe.ports.len() && imported(Some(a)))
        && (features.pre_adder || word.own.is_none() || word.imported.is_none())
        && usize::from(word.shift) < features.shifts.len()
        && (features.send || !word.send)
        && (features.swap || swapping.iter().flatten().all(|address| !address.swap))
}

struct Parser {
    line: usize,
    names: HashMap<String, u32>,
    program: Program,
}

/// Fields of a line, read one after another.
struct Fields<'a>(&'a str);

impl<'a> Fields<'a> {
    fn next(&mut self) -> Option<&'a str> {
        let text = self.0.trim_start();
        let end = text.find(' ').unwrap_or(text.len());
        self.0 = &text[end..];
        (end > 0).then(|| &text[..end])
    }
}

impl Parser {
    fn error(&self, expected: &str) -> ParseError {
        ParseError { line: self.line, expected: expected.to_owned() }
    }

    fn number<T: std::str::FromStr>(&self, field: Option<&str>) -> Result<T, ParseError> {
        field.and_then(|field| field.parse().ok()).ok_or_else(|| self.error("a number"))
    }

    /// The keyword, then a number.
    fn keyed<T: std::str::FromStr>(&self, fields: &mut Fields<'_>, keyword: &str) -> Result<T, ParseError> {
        if fields.next() != Some(keyword) {
            return Err(self.error(keyword));
        }
        self.number(fields.next())
    }

    fn pair<T: std::str::FromStr>(&self, field: Option<&str>) -> Result<(u32, T), ParseError> {
        let (first, second) = field.and_then(|f| f.split_once(':')).ok_or_else(|| self.error("`pe:word`"))?;
        Ok((self.number(Some(first))?, self.number(Some(second))?))
    }

    /// The pipeline; without one it is the short one.
    fn pipeline(&self, fields: &mut Fields<'_>) -> Result<Pipeline, ParseError> {
        match fields.next() {
            None => Ok(Pipeline::Short),
            Some("pipeline") => {
                let name = fields.next();
                let named = Pipeline::ALL.into_iter().find(|pipeline| Some(pipeline.name()) == name);
                named.ok_or_else(|| self.error("the name of a pipeline"))
            }
            Some(_) => Err(self.error("pipeline")),
        }
    }

    fn unit(&self, fields: &mut Fields<'_>) -> Option<String> {
        fields.0.strip_prefix(" unit ").map(str::to_owned)
    }

    fn pe(&mut self) -> Result<&mut PeProgram, ParseError> {
        let error = self.error("a `pe` line before it");
        self.program.pes.last_mut().ok_or(error)
    }

    fn line(&mut self, line: &str) -> Result<(), ParseError> {
        if self.line == 1 {
            return if line == HEADER { Ok(()) } else { Err(self.error(HEADER)) };
        }
        let mut fields = Fields(line);
        match fields.next() {
            Some("model") => self.program.model = fields.next().ok_or_else(|| self.error("a name"))?.to_owned(),
            Some("period") => {
                self.program.period = self.number(fields.next())?;
                self.program.rounds = self.keyed(&mut fields, "rounds")?;
                if self.program.rounds == 0 || !self.program.period.is_multiple_of(self.program.rounds) {
                    return Err(self.error("a number of rounds that divides the period"));
                }
            }
            Some("format") => {
                self.program.format = WordFormat {
                    storage_bits: self.keyed(&mut fields, "storage")?,
                    guard_bits: self.keyed(&mut fields, "guard")?,
                    data_bits: self.keyed(&mut fields, "data")?,
                    coefficient_bits: self.keyed(&mut fields, "coefficient")?,
                    pipeline: self.pipeline(&mut fields)?,
                };
            }
            Some("input") => {
                let name = fields.next().unwrap_or_default().to_owned();
                let exponent = self.keyed(&mut fields, "exponent")?;
                self.program.inputs.push(InputPort { name, exponent, unit: self.unit(&mut fields), tick: None });
            }
            Some("tick") => {
                let name = fields.next().unwrap_or_default().to_owned();
                let exponent = self.keyed(&mut fields, "exponent")?;
                let tick = Tick { steps: self.keyed(&mut fields, "steps")?, done: self.keyed(&mut fields, "done")? };
                if tick.steps == 0 || tick.done >= tick.steps || !(-62..=0).contains(&exponent) {
                    return Err(self.error("fewer steps done than there are, and a number that holds 1"));
                }
                self.program.inputs.push(InputPort { name, exponent, unit: None, tick: Some(tick) });
            }
            Some("output") => {
                let name = fields.next().unwrap_or_default().to_owned();
                let pe = self.keyed(&mut fields, "pe")?;
                let word = self.keyed(&mut fields, "word")?;
                let exponent = self.keyed(&mut fields, "exponent")?;
                self.program.outputs.push(OutputPort { name, pe, word, exponent, unit: self.unit(&mut fields) });
            }
            Some("state") => self.state(&mut fields)?,
            Some("pe") => self.features(&mut fields)?,
            Some("port") => {
                let source = match fields.next() {
                    Some("pe") => LinkSource::Pe(self.number(fields.next())?),
                    Some("input") => LinkSource::Input(self.number(fields.next())?),
                    _ => return Err(self.error("`pe` or `input`")),
                };
                self.pe()?.ports.push(source);
            }
            Some("equation") => {
                let name = fields.next().unwrap_or_default().to_owned();
                self.pe()?.equations.push(name);
            }
            Some(memory @ ("own" | "base" | "coefficient" | "imported")) => {
                let word: usize = self.number(fields.next())?;
                let value = fields.next().and_then(|field| u64::from_str_radix(field, 16).ok());
                let value = value.ok_or_else(|| self.error("a hexadecimal word"))? as i64;
                let error = self.error("a word within the memory");
                let pe = self.pe()?;
                let image = match memory {
                    "own" => &mut pe.own_image,
                    "base" => &mut pe.base_image,
                    "coefficient" => &mut pe.coefficient_image,
                    _ => &mut pe.imported_image,
                };
                *image.get_mut(word).ok_or(error)? = value;
            }
            Some("word") => self.word(&mut fields)?,
            _ => return Err(self.error("a program line")),
        }
        Ok(())
    }

    fn state(&mut self, fields: &mut Fields<'_>) -> Result<(), ParseError> {
        let name = fields.next().unwrap_or_default().to_owned();
        let exponent = self.keyed(fields, "exponent")?;
        if fields.next() != Some("own") {
            return Err(self.error("own"));
        }
        let own = self.pair(fields.next())?;
        let mut imported = Vec::new();
        while fields.next().is_some() {
            imported.push(self.pair(fields.next())?);
        }
        self.program.states.push(StateRegister { name, exponent, own, imported });
        Ok(())
    }

    fn features(&mut self, fields: &mut Fields<'_>) -> Result<(), ParseError> {
        let index: usize = self.number(fields.next())?;
        if index != self.program.pes.len() {
            return Err(self.error("PEs in order"));
        }
        let own_words: u32 = self.keyed(fields, "own")?;
        let base_words: u32 = self.keyed(fields, "base")?;
        let coefficient_words: u32 = self.keyed(fields, "coefficients")?;
        let imported_words: u32 = self.keyed(fields, "imported")?;
        if fields.next() != Some("shifts") {
            return Err(self.error("shifts"));
        }
        let list = fields.next().unwrap_or_default();
        let shifts = list.split(',').map(|shift| self.number(Some(shift))).collect::<Result<Vec<u8>, _>>()?;
        let accumulator_bits = self.keyed(fields, "accumulator")?;
        let rest: Vec<&str> = std::iter::from_fn(|| fields.next()).collect();
        let has = |name: &str| rest.contains(&name);
        let after = |name: &str| match rest.iter().position(|field| *field == name) {
            Some(place) => self.number(rest.get(place + 1).copied()),
            None => Ok(0),
        };
        let (index_words, index_bits, octave_bits): (u32, u32, u32) =
            (after("index")?, after("bits")?, after("octaves")?);
        let features = PeFeatures {
            own_words,
            base_words,
            coefficient_words,
            imported_words,
            ports: 0,
            shifts,
            accumulator_bits,
            factor: has("factor"),
            pre_adder: has("pre_adder"),
            swap: has("swap"),
            base_last: has("base_last"),
            send: has("send"),
            proven: has("proven"),
            index_words,
            index_bits,
            octave_bits,
        };
        let depth = |words: u32| words.is_power_of_two() && (2..=1 << 16).contains(&words);
        let optional = |words: u32| words == 0 || depth(words);
        if !depth(own_words) || !depth(base_words) || !optional(coefficient_words) || !optional(imported_words) {
            return Err(self.error("memory depths that are powers of two up to 65536"));
        }
        let data_bits = self.program.format.data_bits;
        let indexed = depth(index_words)
            && (1..16).contains(&index_bits)
            && base_words >= 1 << index_bits
            && octave_bits < 6
            && octave_bits <= index_bits
            && (1u32 << octave_bits) - 1 + index_bits - octave_bits < data_bits;
        let absent = index_words == 0 && index_bits == 0 && octave_bits == 0;
        if !absent && !indexed {
            return Err(self.error("an index memory whose indices are within a data operand and the base memory"));
        }
        self.program.pes.push(PeProgram {
            own_image: vec![0; own_words as usize],
            base_image: vec![0; base_words as usize],
            coefficient_image: vec![0; coefficient_words as usize],
            imported_image: vec![0; imported_words as usize],
            features,
            ports: Vec::new(),
            equations: Vec::new(),
            words: Vec::new(),
            notes: Vec::new(),
        });
        Ok(())
    }

    fn word(&mut self, fields: &mut Fields<'_>) -> Result<(), ParseError> {
        let number: usize = self.number(fields.next())?;
        let mut word = ControlWord::default();
        if self.pe()?.features.coefficient_words > 0 {
            word.multiplier = Multiplier::Stored(0);
        }
        let mut note = Note::default();
        let mut port = 0;
        let mut target = None;
        while let Some(field) = fields.next() {
            match field {
                "times" => word.multiplier = Multiplier::Coefficient(self.number(fields.next())?),
                "stored" => word.multiplier = Multiplier::Stored(self.number(fields.next())?),
                "own" => word.own = Some(self.address(fields.next())?),
                "imported" => word.imported = Some(self.address(fields.next())?),
                "close" => word.close = true,
                "base" => word.base = Some(self.number(fields.next())?),
                "index" => word.index = Some(self.number(fields.next())?),
                "to-index" => word.write_index = Some((self.number(fields.next())?, false)),
                "to-octave" => word.write_index = Some((self.number(fields.next())?, true)),
                "shift" => word.shift = self.number(fields.next())?,
                "write" => target = Some(Target { address: self.address(fields.next())?, ..Target::default() }),
                "to-own" | "to-base" | "to-factor" => {
                    let error = self.error("`write` before it");
                    let target = target.as_mut().ok_or(error)?;
                    match field {
                        "to-own" => target.own = true,
                        "to-base" => target.base = true,
                        _ => target.factor = true,
                    }
                }
                "send" => word.send = true,
                "port" => port = self.number(fields.next())?,
                "receive" => word.receive = Some((port, self.address(fields.next())?)),
                "#" => {
                    for slot in [&mut note.operand, &mut note.chain, &mut note.write, &mut note.receive] {
                        *slot = self.note(fields.next());
                    }
                }
                _ => return Err(self.error("an operation")),
            }
        }
        word.write = target;
        let error = self.error("control words in order");
        let bits = self.program.format.coefficient_bits;
        let pe = self.pe()?;
        if number != pe.words.len() {
            return Err(error);
        }
        if !fits(&word, pe, bits) {
            return Err(ParseError { expected: "coefficients and addresses within their fields".into(), ..error });
        }
        pe.words.push(word);
        pe.notes.push(note);
        pe.features.ports = pe.ports.len() as u32;
        Ok(())
    }

    fn address(&self, field: Option<&str>) -> Result<Address, ParseError> {
        let field = field.unwrap_or_default();
        let (number, swap) = field.strip_suffix('~').map_or((field, false), |number| (number, true));
        Ok(Address { word: self.number(Some(number))?, swap })
    }

    fn note(&mut self, name: Option<&str>) -> u32 {
        match name {
            None | Some("-") => Note::NONE,
            Some(name) => *self.names.entry(name.to_owned()).or_insert_with(|| {
                self.program.names.push(name.to_owned());
                self.program.names.len() as u32 - 1
            }),
        }
    }
}
