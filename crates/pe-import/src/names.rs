//! Names that a spec can hold.

use std::collections::{HashMap, HashSet};

use crate::expr::Callee;
use crate::model::Model;

/// Longest name that is written.
const LONGEST: usize = 100;

/// Functions of the language; a function of a model has another name.
const FUNCTIONS: [&str; 36] = [
    "abs",
    "sign",
    "sqrt",
    "exp",
    "log",
    "log2",
    "log10",
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "sinh",
    "cosh",
    "tanh",
    "min",
    "max",
    "floor",
    "ceil",
    "round",
    "mod",
    "dot",
    "transpose",
    "solve",
    "data",
    "samples",
    "sine",
    "square",
    "pulse",
    "ramp",
    "chirp",
    "pwm",
    "constant",
    "sum",
    "quotient",
];

/// Names in a spec.
pub(crate) struct Names {
    /// Of the model.
    pub model: String,
    /// By quantity.
    pub quantities: Vec<String>,
    /// By array.
    pub arrays: Vec<String>,
    /// By function.
    pub functions: Vec<String>,
    /// Names of arguments, by function.
    pub arguments: Vec<Vec<String>>,
}

impl Names {
    /// Chooses names; `is_name` says whether the language takes a word as one.
    pub fn of(model: &Model, is_name: &dyn Fn(&str) -> bool) -> Names {
        let mut wanted: HashMap<&str, usize> = HashMap::new();
        for quantity in model.quantities.iter().filter(|quantity| !quantity.short.is_empty()) {
            *wanted.entry(&quantity.short).or_default() += 1;
        }
        let mut taken: HashSet<String> = ["pi", "time"].map(str::to_owned).into();
        let mut again: HashMap<String, usize> = HashMap::new();
        // Names that can stay as they are come first, so that no changed name takes theirs.
        let asked: Vec<&String> = model
            .quantities
            .iter()
            .map(|quantity| {
                let own = !quantity.short.is_empty() && wanted[quantity.short.as_str()] == 1;
                if own { &quantity.short } else { &quantity.id }
            })
            .chain(&model.arrays)
            .collect();
        let mut quantities = vec![String::new(); asked.len()];
        for plain in [true, false] {
            for (index, name) in quantities.iter_mut().enumerate() {
                let element = model.quantities.get(index).is_some_and(|quantity| quantity.element.is_some());
                let asked = asked[index];
                if name.is_empty() && !element && (!plain || safe(asked, is_name) == *asked && !taken.contains(asked)) {
                    *name = unique(safe(asked, is_name), &mut taken, &mut again);
                }
            }
        }
        let arrays = quantities.split_off(model.quantities.len());
        for (quantity, name) in model.quantities.iter().zip(&mut quantities) {
            if let Some((array, at)) = &quantity.element {
                *name = element(&arrays[*array], at, |subscript| subscript.to_string());
            }
        }
        let mut called: HashSet<String> = FUNCTIONS.map(str::to_owned).into();
        let functions = model.functions.iter();
        let functions: Vec<String> =
            functions.map(|function| unique(safe(&function.id, is_name), &mut called, &mut again)).collect();
        let arguments = model.functions.iter().map(|function| {
            let mut own = HashSet::new();
            let mut again = HashMap::new();
            function.arguments.iter().map(|name| unique(safe(name, is_name), &mut own, &mut again)).collect()
        });
        Names { model: title_name(&model.id, is_name), quantities, arrays, arguments: arguments.collect(), functions }
    }

    /// The name of who computes a call.
    pub fn callee(&self, callee: Callee) -> &str {
        match callee {
            Callee::Past => "delay",
            Callee::Language(name) => name,
            Callee::Own(function) => &self.functions[function],
        }
    }
}

/// The name of an element, with each subscript as `shown` writes it.
pub(crate) fn element(array: &str, at: &[usize], shown: impl Fn(usize) -> String) -> String {
    format!("{array}[{}]", at.iter().map(|subscript| shown(*subscript)).collect::<Vec<_>>().join(","))
}

/// The word with what a name cannot hold replaced.
fn safe(id: &str, is_name: &dyn Fn(&str) -> bool) -> String {
    let mut name: String =
        id.chars().map(|letter| if letter.is_ascii_alphanumeric() { letter } else { '_' }).take(LONGEST).collect();
    if !name.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_') {
        name.insert_str(0, "x_");
    }
    if name.bytes().all(|byte| byte == b'_') {
        name.push('x');
    }
    if !is_name(&name) {
        name.push('_');
    }
    name
}

/// Names of models begin with a letter.
fn title_name(id: &str, is_name: &dyn Fn(&str) -> bool) -> String {
    let name = safe(id, is_name);
    if name.starts_with('_') { format!("model{name}") } else { name }
}

/// The name, with a number behind it where it is taken.
fn unique(name: String, taken: &mut HashSet<String>, again: &mut HashMap<String, usize>) -> String {
    let mut found = name.clone();
    while !taken.insert(found.clone()) {
        let count = again.entry(name.clone()).or_insert(1);
        *count += 1;
        found = format!("{name}_{count}");
    }
    found
}
