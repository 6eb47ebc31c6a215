//! Text of the loops and of what is written out.

use pe_ir::index;
use std::fmt::Write;

use super::layout::Layout;
use crate::double::power_of_two;
use crate::tiles::{Chain, Factor, Outcome};

/// What a lane reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Read {
    /// One of [`Signature::values`].
    Value(usize),
    /// What it wrote before, by the number of the write.
    Earlier(usize),
}

/// How a product's second factor comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Second {
    /// A number for all lanes.
    Number,
    /// A number for each lane.
    Numbers,
    Value(Read),
}

/// How the base of a write comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum From {
    None,
    Number,
    /// A number for each lane, times one for all.
    Numbers,
    Value(Read),
}

/// A sum of products and its writes.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Sum {
    /// For each product the values whose sum is its operand, and the second factor.
    pub products: Vec<(Vec<Read>, Second)>,
    /// For each write its base, and whether it is stored.
    pub writes: Vec<(From, bool)>,
}

/// What loops have in common that are one function. Its arguments are, in this order: the values; for each sum the
/// second factors that are no values, and for each of its writes the target if it is stored, the base if that is
/// numbers, the weight.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Signature {
    /// For each value that is read whether it is one for all lanes.
    pub values: Vec<bool>,
    pub sums: Vec<Sum>,
}

/// The function of a loop while it is written.
#[derive(Default)]
struct Kernel {
    arguments: usize,
    call: String,
    parameters: String,
    rows: String,
}

impl Kernel {
    /// A parameter; `given` is what the call gives for it, made of its argument.
    fn parameter(&mut self, name: &str, kind: &str, given: impl FnOnce(String) -> String) {
        self.arguments += 1;
        let given = given(format!("a[{}]", self.arguments - 1));
        let _ = write!(self.call, ", {given}");
        let _ = write!(self.parameters, ", {name}: {kind}");
    }

    /// A number for each lane, from slots or from the table of numbers.
    fn row(&mut self, name: &str, from: &str) -> String {
        self.parameter(name, "&[R]", |argument| format!("{from}, {argument}, n)"));
        let _ = writeln!(self.rows, "    let {name} = &{name}[..n];");
        format!("{name}[i]")
    }

    fn target(&mut self, name: &str) -> String {
        self.parameter(name, "&mut [R]", |argument| format!("row_mut(v, {argument}, n)"));
        let _ = writeln!(self.rows, "    let {name} = &mut {name}[..n];");
        format!("{name}[i]")
    }

    /// The number in a slot, for all lanes.
    fn slot(&mut self, name: &str) -> String {
        self.parameter(name, "R", |argument| format!("*v.add({argument} as usize)"));
        name.to_owned()
    }

    /// A number of the table, for all lanes.
    fn number(&mut self, name: &str) -> String {
        self.parameter(name, "R", |argument| format!("number(t, {argument})"));
        name.to_owned()
    }
}

/// A function that runs a loop.
pub(super) fn kernel(text: &mut String, index: usize, signature: &Signature) {
    let (mut kernel, mut body) = (Kernel::default(), String::new());
    let values: Vec<String> = signature
        .values
        .iter()
        .enumerate()
        .map(|(value, same)| {
            let name = format!("x{value}");
            if *same { kernel.slot(&name) } else { kernel.row(&name, "row(v") }
        })
        .collect();
    let read = |read: Read| match read {
        Read::Value(value) => values[value].clone(),
        Read::Earlier(write) => format!("w{write}"),
    };
    let (mut product, mut write) = (0.., 0..);
    for sum in &signature.sums {
        for (index, (operands, second)) in sum.products.iter().enumerate() {
            let operand = operands.iter().map(|operand| read(*operand)).collect::<Vec<_>>().join(" + ");
            let name = format!("f{}", product.next().unwrap_or(0));
            let factor = match second {
                Second::Number => kernel.number(&name),
                Second::Numbers => kernel.row(&name, "numbers(t"),
                Second::Value(value) => read(*value),
            };
            let _ = match index {
                0 => writeln!(body, "        let sum = ({operand}) * {factor};"),
                _ => writeln!(body, "        let sum = fma({operand}, {factor}, sum);"),
            };
        }
        for (from, stored) in &sum.writes {
            let write: usize = write.next().unwrap_or(0);
            let target = stored.then(|| kernel.target(&format!("y{write}")));
            let z = format!("z{write}");
            let base = match from {
                From::None => None,
                From::Number => Some(kernel.number(&z)),
                From::Value(value) => Some(read(*value)),
                From::Numbers => {
                    let numbers = kernel.row(&z, "numbers(t");
                    Some(format!("{} * {numbers}", kernel.number(&format!("r{write}"))))
                }
            };
            let weight = kernel.number(&format!("s{write}"));
            let _ = match base {
                None => writeln!(body, "        let w{write} = {weight} * sum;"),
                Some(base) => writeln!(body, "        let w{write} = fma({weight}, sum, {base});"),
            };
            if let Some(target) = target {
                let _ = writeln!(body, "        {target} = w{write};");
            }
        }
    }
    let Kernel { call, parameters, rows, .. } = kernel;
    let _ = writeln!(
        text,
        "unsafe fn k{index}(t: &Tables, a: &[u32], n: usize, v: *mut R) {{
    b{index}(n{call})
}}
#[no_mangle]
#[inline(never)]
fn b{index}(n: usize{parameters}) {{
{rows}    for i in 0..n {{
{body}    }}
}}"
    );
}

/// A function that runs chains one by one. In odd steps states and those of the next step are elsewhere: by `a[0]` and
/// `a[1]` slots, offset by 2^31.
pub(super) fn sums(text: &mut String, index: usize, layout: &Layout, chains: &[usize]) {
    let _ = writeln!(
        text,
        "unsafe fn k{index}(_: &Tables, a: &[u32], _: usize, v: *mut R) {{
    let v = v.add(MARGIN);
    let moved = |by: u32| v.offset(by as isize - (1 << 31));
    let (p, q) = (moved(a[0]), moved(a[1]));"
    );
    for chain in chains {
        let chain = &layout.chains[*chain];
        match chain.outcome {
            Outcome::Segment { target, argument, octaves } => {
                let argument = read(layout, argument);
                let _ = writeln!(text, "    {} = segment({argument}, {octaves}) as R;", at(layout, target));
            }
            Outcome::Choice { target, segment, among } => {
                let (target, segment) = (at(layout, target), read(layout, segment));
                let among = really(layout, among);
                let _ = writeln!(text, "    {target} = *v.add({among} + {segment} as usize);");
            }
            Outcome::Words(..) | Outcome::Kept(_) => sum(text, layout, chain),
        }
    }
    text.push_str("    let _ = (p, q);\n}\n");
}

fn sum(text: &mut String, layout: &Layout, chain: &Chain) {
    for (index, term) in layout.terms[index::at(chain.terms.start)..chain.terms.end as usize].iter().enumerate() {
        let factor = match term.factor {
            Factor::Coefficient(number) => literal(number),
            Factor::Value(slot) => read(layout, slot),
        };
        let operand = read(layout, term.operand);
        let _ = match index {
            0 => writeln!(text, "    let sum = {operand} * {factor};"),
            _ => writeln!(text, "    let sum = fma({operand}, {factor}, sum);"),
        };
    }
    for write in chain.writes() {
        let (target, weight) = (at(layout, write.target), literal(power_of_two(write.shift)));
        let _ = if write.base == layout.memory.zero {
            writeln!(text, "    {target} = {weight} * sum;")
        } else {
            writeln!(text, "    {target} = fma({weight}, sum, {});", read(layout, write.base))
        };
    }
}

/// Where a slot really is in even steps.
fn really(layout: &Layout, slot: u32) -> i64 {
    i64::from(slot) + layout.memory.rows[layout.memory.row(slot)].shift[0]
}

/// A slot.
fn at(layout: &Layout, slot: u32) -> String {
    let shift = layout.memory.rows[layout.memory.row(slot)].shift;
    let pointer = match shift[1] - shift[0] {
        0 => "v",
        moved if moved == layout.memory.moved() => "p",
        _ => "q",
    };
    format!("*{pointer}.add({})", really(layout, slot))
}

/// The number in a slot.
fn read(layout: &Layout, slot: u32) -> String {
    match layout.memory.constants[index::at(slot)] {
        Some(number) => literal(number),
        None => at(layout, slot),
    }
}

/// A number that reads back the same.
fn literal(number: f64) -> String {
    format!("({number:e} as R)")
}
