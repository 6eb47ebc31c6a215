//! Reads the VHDL of a design as text: arrays of the program package, instances and wiring of the network, each with
//! its place, so that a damage can be put there.
//!
//! Only the layout that the emitter writes is understood; anything else is an error, never a guess.

use std::collections::BTreeMap;
use std::ops::Range;

/// A constant array of the program package.
#[derive(Clone, Debug)]
pub struct Array {
    /// Bits of an element.
    pub width: u32,
    /// Elements, from index 0 on.
    pub words: Vec<Bits>,
}

/// A bit string and where its digits stand, most significant first.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Bits {
    /// Value of the digits.
    pub value: u128,
    /// Byte offset of each digit in the file.
    pub places: Vec<usize>,
}

/// The program package.
#[derive(Clone, Debug, Default)]
pub struct Package {
    /// Widths and counts.
    pub scalars: BTreeMap<String, u32>,
    /// Programs and images.
    pub arrays: BTreeMap<String, Array>,
    /// Which bits of control words are streamed.
    pub masks: BTreeMap<String, Bits>,
}

/// One element of a generic or port map: where its value stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Association {
    /// Value as written.
    pub value: String,
    /// Bytes of the value in the file.
    pub range: Range<usize>,
}

/// An instance of an entity of the library.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Instance {
    /// `u_pe_3`.
    pub label: String,
    /// `pe`.
    pub entity: String,
    /// Generics by name.
    pub generics: BTreeMap<String, Association>,
    /// Ports by name.
    pub ports: BTreeMap<String, Association>,
}

/// The network's architecture.
#[derive(Clone, Debug, Default)]
pub struct Network {
    /// Instances in the order of the file.
    pub instances: Vec<Instance>,
    /// Concurrent assignments of whole signals: the expression of each target.
    pub assignments: BTreeMap<String, Association>,
}

/// Replaces comments with blanks, so that offsets stay.
fn without_comments(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    for line in text.split_inclusive('\n') {
        let code = line.find("--").unwrap_or(line.len());
        plain.push_str(&line[..code]);
        plain.extend(line[code..].chars().map(|c| if c == '\n' { '\n' } else { ' ' }));
        // A character of several bytes would move what follows.
        plain.extend(std::iter::repeat_n(' ', line[code..].len() - line[code..].chars().count()));
    }
    plain
}

/// The line of a byte, from 1.
pub fn line_of(text: &str, at: usize) -> usize {
    1 + text.as_bytes()[..at.min(text.len())].iter().filter(|byte| **byte == b'\n').count()
}

impl Package {
    /// Reads the package; the error is the line that is not understood.
    pub fn read(text: &str) -> Result<Package, String> {
        let mut package = Package::default();
        // Name and width of the array whose elements follow.
        let mut open: Option<(String, Array)> = None;
        let mut at = 0;
        for line in text.split_inclusive('\n') {
            let start = at;
            at += line.len();
            let code = line.split("--").next().unwrap_or("");
            let unread = || format!("`{}`", line.trim());
            if let Some((name, mut array)) = open.take() {
                if code.trim() == ");" {
                    package.arrays.insert(name, array);
                    continue;
                }
                if let Some((index, element)) = code.split_once("=>") {
                    if element.contains("others") {
                        array.words.push(Bits::default());
                    } else {
                        let bits = digits(text, start + code.len() - element.len(), start + code.len());
                        let complete = bits.places.len() == array.width as usize;
                        if index.trim().parse() != Ok(array.words.len()) || !complete {
                            return Err(unread());
                        }
                        array.words.push(bits);
                    }
                }
                open = Some((name, array));
                continue;
            }
            let Some(rest) = code.trim_start().strip_prefix("constant ") else { continue };
            let (name, declared) = rest.split_once(':').ok_or_else(unread)?;
            let (name, declared) = (name.trim().to_owned(), declared.trim());
            if declared.starts_with("word_array_t") {
                let width = declared.rsplit('(').next().and_then(|range| range.split(' ').next());
                let width: u32 = width.and_then(|msb| msb.parse().ok()).ok_or_else(unread)?;
                open = Some((name, Array { width: width + 1, words: Vec::new() }));
            } else if declared.starts_with("std_ulogic_vector") {
                let value = code.find("b\"").ok_or_else(unread)?;
                package.masks.insert(name, digits(text, start + value, start + code.len()));
            } else {
                let value = declared.split(":=").nth(1).map(|value| value.trim().trim_end_matches(';'));
                package.scalars.insert(name, value.and_then(|value| value.parse().ok()).ok_or_else(unread)?);
            }
        }
        Ok(package)
    }
}

/// The bit string between the first two quotes of a part of the text.
fn digits(text: &str, from: usize, to: usize) -> Bits {
    let mut bits = Bits::default();
    let mut inside = false;
    for (place, byte) in (from..).zip(text.as_bytes()[from..to].iter()) {
        match byte {
            b'"' if inside => break,
            b'"' => inside = true,
            b'0' | b'1' if inside => {
                bits.value = bits.value << 1 | u128::from(byte - b'0');
                bits.places.push(place);
            }
            _ => {}
        }
    }
    bits
}

impl Network {
    /// Wires all that one signal drives to another one.
    pub fn rewire(&mut self, from: &str, to: &str) {
        let ports = self.instances.iter_mut().flat_map(|instance| &mut instance.ports);
        let driven = ports.filter(|(name, port)| name.ends_with("_i") && port.value == from);
        driven.for_each(|(_, port)| port.value = to.to_owned());
    }

    /// Reads instances and assignments; the error tells what is not understood.
    pub fn read(text: &str) -> Result<Network, String> {
        let plain = without_comments(text);
        let mut network = Network::default();
        let body = plain.find("\nbegin\n").ok_or("the network has no body")?;
        let mut at = body + "\nbegin\n".len();
        // Instances of the level of the architecture; what is inside processes and generates is not wiring of ours.
        while let Some(end) = statement_end(&plain, at) {
            let statement = &plain[at..end];
            let start = at + statement.len() - statement.trim_start().len();
            let head = plain[start..end].trim_start();
            at = end + 1;
            let first: Vec<&str> = head.split_ascii_whitespace().take(4).collect();
            match first[..] {
                ["end", ..] => break,
                [label, ":", "process" | "if" | "for", ..] => at = block_end(&plain, at, label).ok_or(label)?,
                [label, ":", "entity", entity] => {
                    let entity = entity.rsplit('.').next().unwrap_or(entity).to_owned();
                    let generics = map_of(&plain, start, end, "generic map")?;
                    let ports = map_of(&plain, start, end, "port map")?;
                    network.instances.push(Instance { label: label.to_owned(), entity, generics, ports });
                }
                [target, "<=", ..] => {
                    let from = start + plain[start..end].find("<=").unwrap_or(0) + 2;
                    network.assignments.insert(target.to_owned(), association(&plain, from, end));
                }
                _ => {}
            }
        }
        if network.instances.is_empty() {
            return Err("the network has no instances".into());
        }
        Ok(network)
    }

    /// Instances of an entity.
    pub fn of<'a>(&'a self, entity: &'a str) -> impl Iterator<Item = &'a Instance> {
        self.instances.iter().filter(move |instance| instance.entity == entity)
    }
}

/// Where the statement that begins at `at` has its semicolon.
fn statement_end(plain: &str, at: usize) -> Option<usize> {
    plain.get(at..)?.find(';').map(|place| at + place)
}

/// Behind the end of a process or generate statement with a label.
fn block_end(plain: &str, at: usize, label: &str) -> Option<usize> {
    let label = label.trim_end_matches(':');
    ["process", "generate"].iter().find_map(|kind| {
        let end = format!("end {kind} {label};");
        plain[at..].find(&end).map(|place| at + place + end.len())
    })
}

/// The elements of a generic or port map of an instance, none if there is no such map.
fn map_of(plain: &str, start: usize, end: usize, kind: &str) -> Result<BTreeMap<String, Association>, String> {
    let mut elements = BTreeMap::new();
    let Some(place) = plain[start..end].find(kind) else { return Ok(elements) };
    let open = start + place + plain[start + place..end].find('(').ok_or(kind)?;
    let (mut depth, mut from) = (0, open + 1);
    for (at, byte) in (open..end).zip(plain.as_bytes()[open..end].iter()) {
        match byte {
            b'(' => depth += 1,
            b')' => depth -= 1,
            _ => {}
        }
        if depth == 0 || (depth == 1 && *byte == b',') {
            let element = &plain[from..at];
            let arrow = element.find("=>").ok_or_else(|| format!("`{}`", element.trim()))?;
            elements.insert(element[..arrow].trim().to_owned(), association(plain, from + arrow + 2, at));
            from = at + 1;
        }
        if depth == 0 {
            return Ok(elements);
        }
    }
    Err(format!("a {kind} without end"))
}

/// The trimmed value between two bytes.
fn association(plain: &str, from: usize, to: usize) -> Association {
    let value = &plain[from..to];
    let start = from + value.len() - value.trim_start().len();
    Association { value: value.trim().to_owned(), range: start..start + value.trim().len() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NETWORK: &str = "architecture network of m is\n  signal a : std_ulogic; -- <= b;\nbegin\n\n  \
        u_pe_0 : entity pe_lib.pe\n    generic map (\n      SHIFTS => (0 => 23, 1 => 24),\n      DEEP   => true\n    )\n    \
        port map (\n      clk_i => clk_i, -- a comment, with (\n      word_o => word_0\n    );\n\n  -- Ports: µ\n  \
        ports_0 <= link_1 & input_0;\n\n  p_x : process (clk_i) is\n  begin\n    inside <= '1';\n  end process p_x;\n\n  \
        done <= last;\n\nend architecture network;\n";

    #[test]
    fn instances_and_assignments_are_read_with_their_places() {
        let network = Network::read(NETWORK).expect("a network");
        assert_eq!(network.instances.len(), 1);
        let pe = &network.instances[0];
        assert_eq!((pe.label.as_str(), pe.entity.as_str()), ("u_pe_0", "pe"));
        assert_eq!(pe.generics["SHIFTS"].value, "(0 => 23, 1 => 24)");
        assert_eq!(pe.ports["word_o"].value, "word_0");
        let ports = &network.assignments["ports_0"];
        assert_eq!(&NETWORK[ports.range.clone()], "link_1 & input_0");
        assert_eq!(line_of(NETWORK, ports.range.start), 16);
        let targets: Vec<&str> = network.assignments.keys().map(String::as_str).collect();
        assert_eq!(targets, ["done", "ports_0"], "not what is inside the process");
    }

    #[test]
    fn packages_are_read_bit_by_bit() {
        let text = "  constant PERIOD : positive := 12;\n  constant PE0_STREAM : word_array_t(0 to 1)(3 downto 0) :=\n  (\n    \
                    -- name\n    0 => b\"0_10_0\", -- close\n    1 => b\"1_00_1\"\n  );\n  constant PE0_STREAMED : \
                    std_ulogic_vector(2 downto 0) := b\"1_01\";\n";
        let package = Package::read(text).expect("a package");
        assert_eq!(package.scalars["PERIOD"], 12);
        let array = &package.arrays["PE0_STREAM"];
        assert_eq!((array.width, array.words.len()), (4, 2));
        assert_eq!(array.words.iter().map(|word| word.value).collect::<Vec<_>>(), [0b0100, 0b1001]);
        let last = array.words[1].places[3];
        assert_eq!(&text[last..=last], "1");
        assert_eq!(package.masks["PE0_STREAMED"].value, 0b101);
        assert!(Package::read(&text.replace("b\"1_00_1\"", "b\"1_00\"")).is_err(), "a bit is missing");
    }
}
