//! Random DiffSL models, evaluated cell by cell from what they were written from, and the specs that they become.

use std::collections::HashMap;
use std::fmt::Write;

use pe_frontend::{NoFiles, Overrides};
use pe_import::{Imported, Setting, Wanted};
use pe_ir::source::{Diagnostic, Sources};
use pe_sim::linear::Linearised;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Names that mean something in specs, or are long.
const NAMES: [&str; 20] = [
    "state",
    "param",
    "if",
    "step",
    "model",
    "time",
    "pi",
    "i",
    "j",
    "sum",
    "exp",
    "for",
    "e5",
    "output",
    "mod",
    "data",
    "x",
    "Ab3",
    "quotient",
    "wherewherewherewherewherewherewherewherewherewherewherewherewherewherewherewherewherewherewherewherewhere",
];

/// An expression as the test knows it.
enum Node {
    Number(f64),
    Time,
    /// A tensor, each dimension with its index.
    Read(String, Vec<char>),
    /// One cell of a vector.
    Cell(String, usize),
    Negated(Box<Node>),
    Binary(char, Box<[Node; 2]>),
    Call(&'static str, Vec<Node>),
}

/// Shape and values.
type Tensor = (Vec<usize>, Vec<f64>);

#[derive(Default)]
struct Known {
    tensors: HashMap<String, Tensor>,
    time: f64,
}

impl Known {
    /// The value of an expression where each index has a value.
    fn value(&self, node: &Node, at: &HashMap<char, usize>) -> f64 {
        let of = |node: &Node| self.value(node, at);
        match node {
            Node::Number(number) => *number,
            Node::Time => self.time,
            Node::Cell(name, cell) => self.tensors[name].1[*cell],
            Node::Read(name, indices) => {
                let (shape, values) = &self.tensors[name];
                let flat = indices
                    .iter()
                    .zip(shape)
                    .fold(0, |flat, (index, length)| flat * length + at[index].min(length - 1));
                values[flat]
            }
            Node::Negated(inner) => -of(inner),
            Node::Binary(sign, pair) => match (sign, of(&pair[0]), of(&pair[1])) {
                ('+', a, b) => a + b,
                ('-', a, b) => a - b,
                ('*', a, b) => a * b,
                (_, a, b) => a / b,
            },
            Node::Call(name, arguments) => {
                let x = of(&arguments[0]);
                match *name {
                    "sin" => libm::sin(x),
                    "tanh" => libm::tanh(x),
                    "arcsinh" => libm::asinh(x),
                    "sigmoid" => 1.0 / (1.0 + libm::exp(-x)),
                    "heaviside" => f64::from(u8::from(x >= 0.0)),
                    "abs" => x.abs(),
                    "max" => x.max(of(&arguments[1])),
                    "min" => x.min(of(&arguments[1])),
                    "pow" => libm::pow(x, of(&arguments[1])),
                    other => panic!("{other}"),
                }
            }
        }
    }
}

struct Writer {
    random: ChaCha8Rng,
    /// Tensors that may be read, with their shapes.
    readable: Vec<(String, Vec<usize>)>,
    known: Known,
    text: String,
    names: Vec<String>,
    /// Names that were made so far.
    named: usize,
}

/// Indices in scope, with their lengths.
type Axes = [(char, usize)];

impl Writer {
    fn below(&mut self, end: usize) -> usize {
        self.random.random_range(0..end)
    }

    fn chance(&mut self, of: f64) -> bool {
        self.random.random_bool(of)
    }

    fn name(&mut self) -> String {
        if self.chance(0.5) && !self.names.is_empty() {
            let index = self.below(self.names.len());
            return self.names.swap_remove(index);
        }
        self.named += 1;
        format!("q{}", self.named)
    }

    fn number(&mut self) -> (String, f64) {
        let texts = ["0.5", "2", "1.25e-1", "3.", "0.75", "1.5", "0.0"];
        let text = texts[self.below(texts.len())];
        (text.to_owned(), text.parse().unwrap())
    }

    /// An expression over these indices, of which not all need to occur.
    fn expression(&mut self, axes: &Axes, depth: usize) -> (String, Node) {
        if depth == 0 || self.chance(0.2) {
            return self.leaf(axes);
        }
        let (left, a) = self.expression(axes, depth - 1);
        match self.below(8) {
            0 => (format!("(-{})", bracketed(&left)), Node::Negated(Box::new(a))),
            1 => {
                let name = ["sin", "tanh", "arcsinh", "sigmoid", "heaviside", "abs"][self.below(6)];
                (format!("{name}({left})"), Node::Call(name, vec![a]))
            }
            2 => {
                let (right, b) = self.expression(axes, depth - 1);
                let name = ["max", "min"][self.below(2)];
                (format!("{name}({left} , {right})"), Node::Call(name, vec![a, b]))
            }
            3 => {
                let power = [2.0, 3.0][self.below(2)];
                let inner = Node::Call("tanh", vec![a]);
                (format!("pow(tanh({left}), {power})"), Node::Call("pow", vec![inner, Node::Number(power)]))
            }
            4 => {
                let (right, b) = self.expression(axes, depth - 1);
                let below = Node::Binary('+', Box::new([Node::Number(1.5), Node::Call("abs", vec![b])]));
                (format!("{} / (1.5 + abs({right}))", bracketed(&left)), Node::Binary('/', Box::new([a, below])))
            }
            sign => {
                let (right, b) = self.expression(axes, depth - 1);
                let sign = ['+', '-', '*'][sign - 5];
                let text = format!("{} {sign}{} {}", bracketed(&left), self.blank(), bracketed(&right));
                (text, Node::Binary(sign, Box::new([a, b])))
            }
        }
    }

    fn blank(&mut self) -> &'static str {
        ["", " ", "\n    ", " /* in between */ ", " // to the end\n "][self.below(5)]
    }

    fn leaf(&mut self, axes: &Axes) -> (String, Node) {
        let fits: Vec<(String, Vec<usize>)> = self.readable.clone();
        for _ in 0..6 {
            let (name, shape) = &fits[self.below(fits.len())];
            if shape.len() == 1 && self.chance(0.3) {
                let cell = self.below(shape[0]);
                return (format!("{name}_k[{cell}]"), Node::Cell(name.clone(), cell));
            }
            let mut indices: Vec<char> = Vec::new();
            for length in shape {
                let free: Vec<char> = axes
                    .iter()
                    .filter(|(index, own)| (own == length || *length == 1) && !indices.contains(index))
                    .map(|axis| axis.0)
                    .collect();
                if free.is_empty() {
                    break;
                }
                indices.push(free[self.below(free.len())]);
            }
            if indices.len() == shape.len() {
                let with: String = indices.iter().collect();
                let text = if with.is_empty() { name.clone() } else { format!("{name}_{with}") };
                return (text, Node::Read(name.clone(), indices));
            }
        }
        if self.chance(0.2) {
            return ("t".to_owned(), Node::Time);
        }
        let (text, number) = self.number();
        (text, Node::Number(number))
    }

    /// The value of an element over its indices, with a sum over `over` if it has that.
    fn cells(&self, node: &Node, axes: &Axes, over: Option<(char, usize)>) -> Vec<f64> {
        let count = axes.iter().map(|axis| axis.1).product::<usize>();
        let cell = |flat: usize| {
            let (mut left, mut at) = (flat, HashMap::new());
            for (index, length) in axes.iter().rev() {
                at.insert(*index, left % length);
                left /= length;
            }
            (0..over.map_or(1, |axis| axis.1))
                .map(|sum| {
                    at.extend(over.map(|axis| (axis.0, sum)));
                    self.known.value(node, &at)
                })
                .sum()
        };
        (0..count).map(cell).collect()
    }

    /// A tensor of these lengths whose elements read what there is.
    fn tensor(&mut self, shape: &[usize], depth: usize) {
        let name = self.name();
        let letters = ['i', 'j', 'a'];
        let axes: Vec<(char, usize)> = letters.into_iter().zip(shape.iter().copied()).collect();
        let with: String = axes.iter().map(|axis| axis.0).collect();
        let head = if with.is_empty() { name.clone() } else { format!("{name}_{with}") };
        let count: usize = shape.iter().product();
        let mut values = vec![0.0; count];
        let mut text = String::new();
        match shape {
            // A matrix of single entries, of diagonals, or of a whole.
            [rows, columns] if self.chance(0.7) => {
                if rows == columns && self.chance(0.4) {
                    let (number, value) = self.number();
                    let _ = write!(text, "(0..{rows}, 0..{rows}): {number},");
                    (0..*rows).for_each(|row| values[row * columns + row] = value);
                } else {
                    for (row, column) in (0..*rows).flat_map(|row| (0..*columns).map(move |column| (row, column))) {
                        // The last entry says how large the matrix is.
                        if self.chance(0.5) || row + 1 == *rows && column + 1 == *columns {
                            let (number, node) = self.expression(&[], 1);
                            values[row * columns + column] = self.known.value(&node, &HashMap::new());
                            let _ = write!(text, "({row}, {column}): {number}, ");
                        }
                    }
                }
            }
            // A vector in two parts.
            [length] if *length > 1 && self.chance(0.4) => {
                let cut = 1 + self.below(length - 1);
                for (from, to) in [(0, cut), (cut, *length)] {
                    let (part, node) = self.expression(&[('i', to - from)], depth);
                    let own = self.cells(&node, &[('i', to - from)], None);
                    values[from..to].copy_from_slice(&own);
                    let _ = write!(text, "({from}:{to}): {part}, ");
                }
            }
            _ => {
                let vectors: Vec<(String, usize)> = self
                    .readable
                    .iter()
                    .filter_map(
                        |(name, shape)| if let [length] = **shape { Some((name.clone(), length)) } else { None },
                    )
                    .collect();
                let over = (!vectors.is_empty() && self.chance(0.4)).then(|| self.below(vectors.len()));
                let over = over.map(|vector| vectors[vector].clone());
                let sum = over.as_ref().map(|(_, length)| ('s', *length));
                let all: Vec<(char, usize)> = axes.iter().copied().chain(sum).collect();
                let (mut part, mut node) = self.expression(&all, depth);
                if let Some((vector, _)) = over {
                    part = format!("{vector}_s * ({part})");
                    node = Node::Binary('*', Box::new([Node::Read(vector, vec!['s']), node]));
                }
                values = self.cells(&node, &axes, sum);
                let ranges: Vec<String> = shape.iter().map(|length| format!("0:{length}")).collect();
                text = if axes.is_empty() { part } else { format!("({}): {part}", ranges.join(", ")) };
            }
        }
        let blank = self.blank();
        let _ = writeln!(self.text, "{head} {{{blank}{text}{blank}}}");
        self.known.tensors.insert(name.clone(), (shape.to_vec(), values));
        self.readable.push((name, shape.to_vec()));
    }
}

fn bracketed(text: &str) -> String {
    format!("({text})")
}

/// The states of a model: label, length (0 for a scalar), values.
type States = Vec<(String, usize, Vec<f64>)>;

impl Writer {
    fn states(&mut self) -> States {
        let mut states = Vec::new();
        let mut text = String::new();
        let mut at = 0;
        for _ in 0..2 + self.below(2) {
            let (name, length) = (self.name(), [0, 0, 1, 3, 5][self.below(5)]);
            let count = length.max(1);
            let values: Vec<f64> = (0..count).map(|_| self.random.random_range(-1.5..1.5)).collect();
            let _ = match length {
                0 => write!(text, "{name} = 0.25, "),
                _ => write!(text, "\n  ({at}:{}): {name} = 0.25, ", at + count),
            };
            at += count;
            states.push((name, length, values));
        }
        let _ = writeln!(self.text, "u_i {{ {text} }}");
        states
    }

    /// What `F` has for each state, and its text.
    fn right(&mut self, states: &States) -> (String, Vec<f64>) {
        let (mut text, mut values) = (String::new(), Vec::new());
        for (_, length, own) in states {
            let axes: &Axes = &[('i', own.len())];
            let (part, node) = self.expression(if *length == 0 { &[] } else { axes }, 2);
            values.extend(self.cells(&node, axes, None));
            // A value of one cell says how many it is for.
            let at = values.len() - own.len();
            let _ = writeln!(text, "  ({at}:{}): {part},", values.len());
        }
        (text, values)
    }
}

/// A model, and the derivative of each state at values of the states and a time.
struct Case {
    text: String,
    states: States,
    time: f64,
    derivatives: Vec<f64>,
}

fn case(seed: u64) -> Case {
    let mut writer = Writer {
        random: ChaCha8Rng::seed_from_u64(seed),
        readable: Vec::new(),
        known: Known::default(),
        text: "/* A random model. */\n".to_owned(),
        names: NAMES.map(str::to_owned).into(),
        named: 0,
    };
    writer.known.time = writer.random.random_range(0.1..2.0);
    let input = writer.name();
    let _ = writeln!(writer.text, "in_i {{ {input} = 0.75 }}");
    writer.known.tensors.insert(input.clone(), (vec![1], vec![0.75]));
    writer.readable.push((input, vec![1]));
    for _ in 0..3 {
        let shape =
            [vec![], vec![3], vec![5], vec![3, 3], vec![5, 5], vec![3, 5], vec![12, 12]][writer.below(7)].clone();
        writer.tensor(&shape, 1);
    }
    let states = writer.states();
    for (name, length, values) in &states {
        let shape = if *length == 0 { Vec::new() } else { vec![*length] };
        writer.known.tensors.insert(name.clone(), (shape.clone(), values.clone()));
        writer.readable.push((name.clone(), shape));
    }
    for _ in 0..3 {
        let shape = [vec![], vec![3], vec![5], vec![3, 5], vec![1]][writer.below(5)].clone();
        writer.tensor(&shape, 2);
    }
    let (right, mut derivatives) = writer.right(&states);
    let count = derivatives.len();
    if writer.chance(0.5) {
        // A triangular mass matrix: each derivative after those that its row reads.
        let names: Vec<String> = (0..count).map(|state| format!("d{state}dt")).collect();
        let _ = writeln!(
            writer.text,
            "dudt_i {{ {} }}",
            names.iter().map(|name| format!("{name} = 0, ")).collect::<String>()
        );
        let mut rows = String::new();
        for row in 0..count {
            let own = [1.0, 2.0, 0.5, -4.0][writer.below(4)];
            let mut text = if own == 1.0 { names[row].clone() } else { format!("{own} * {}", names[row]) };
            if row > 0 && writer.chance(0.3) {
                let other = writer.below(row);
                let _ = write!(text, " + 0.5 * {}", names[other]);
                derivatives[row] -= 0.5 * derivatives[other];
            }
            derivatives[row] /= own;
            let _ = write!(rows, "{text}, ");
        }
        let _ = writeln!(writer.text, "M_i {{ {rows} }}");
    }
    let _ = writeln!(writer.text, "F_i {{\n{right}}}");
    Case { text: writer.text, states, time: writer.known.time, derivatives }
}

fn import(text: &str) -> (Sources, Result<Imported, Vec<Diagnostic>>) {
    let is_name = |word: &str| {
        let mut sources = Sources::new("", &format!("param {word} = 1"));
        pe_frontend::parse(&mut sources, &NoFiles).1.is_empty()
    };
    pe_import::import("random.diffsl", text.as_bytes(), &Wanted::Usual, &is_name)
}

#[test]
fn random_models_have_the_derivatives_that_they_were_written_with() {
    let mut compared = 0;
    for seed in 0..300 {
        let case = case(seed);
        let findings = |sources: &Sources, findings: &[Diagnostic]| {
            let lines = findings.iter().map(|finding| {
                let place = finding.span.map(|span| sources.position(span.start).line);
                format!("{} {place:?} {}\n", finding.code, finding.message)
            });
            format!("{seed}\n{}{}", sources.text(), lines.collect::<String>())
        };
        let (sources, result) = import(&case.text);
        let imported = result.unwrap_or_else(|found| panic!("{}", findings(&sources, &found)));
        let setting = Setting { solver: "rk4".to_owned(), step: 0.001, span: 1.0, reason: String::new() };
        let mut spec = Sources::new("random.spec", &imported.spec(&setting));
        let compiled = pe_frontend::compile(&mut spec, &NoFiles, &Overrides::default());
        let (model, _) = compiled.unwrap_or_else(|found| panic!("{}\n{}", case.text, findings(&spec, &found)));
        // By the names of the file.
        let columns: HashMap<&str, &str> = imported.columns().into_iter().collect();
        let states: Vec<(String, f64)> = case
            .states
            .iter()
            .flat_map(|(name, length, values)| {
                let name = |cell: usize| if *length > 1 { format!("{name}[{cell}]") } else { name.clone() };
                values.iter().enumerate().map(move |(cell, value)| (name(cell), *value)).collect::<Vec<_>>()
            })
            .collect();
        let place = |name: &str| model.states.iter().position(|state| state.name == columns[name]);
        let mut point: Vec<f64> = model.states.iter().map(|state| state.initial).collect();
        for (name, value) in &states {
            point[place(name).unwrap_or_else(|| panic!("{name}: {}", spec.text()))] = *value;
        }
        if let Some(clock) = model.states.iter().position(|state| state.motion.is_some()) {
            // It counts steps.
            point[clock] = case.time / model.step;
        }
        let found = Linearised::at(&model, &point, &[]).derivatives;
        for ((name, _), wanted) in states.iter().zip(&case.derivatives) {
            let found = found[place(name).expect("found above")];
            let close = (found - wanted).abs() <= 1e-11 * wanted.abs().max(1.0);
            assert!(close, "{seed} {name}: {found} {wanted}\n{}\n{}", case.text, spec.text());
            compared += 1;
        }
    }
    assert!(compared > 1_000, "{compared}");
}
