//! Whether two netlists are the same logic up to names: the coarsest bisimulation of their registers.
//!
//! Logic of single bits is a function of registers, inputs and the results of all other cells: a decision diagram
//! ([`super::diagram`]), whose number is the same for the same function. Such bits are of one class if cells of the
//! same kind and parameters drive them, from the same functions of classes; registers begin with the same value.
//! Classes are split until that holds. Two bits of a class then have the same value in every clock, by induction over
//! clocks and over the depth of the logic.

use std::collections::{BTreeSet, HashMap};

use serde_json::Value;

use super::diagram::{Diagrams, FALSE, Function, TRUE};

/// What drives a bit.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Driver {
    /// A cell whose function is not looked into, a register, an input: what its class depends on, and the bits that it
    /// is made of.
    Cell { label: String, inputs: Vec<usize> },
    /// Logic of single bits.
    Logic { gate: Gate, inputs: Vec<usize> },
    /// 0 or 1.
    Constant(bool),
}

/// A function of bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Gate {
    And,
    Or,
    Xor,
    /// Neither of all.
    Nor,
    /// An even number.
    Xnor,
    /// The second or, if the last is 1, the third.
    Choice,
}

/// The bits of both netlists.
#[derive(Default)]
struct Bits {
    drivers: Vec<Driver>,
    /// Bits that choose between others: first in the order of diagrams, or these grow.
    choosing: BTreeSet<usize>,
}

/// One netlist: index of each of its bits, and the bits of its output ports.
struct Side {
    outputs: Vec<(String, Vec<usize>)>,
}

/// Nodes that the diagrams of one turn may have; a bit beyond is taken for a cell.
const NODES: usize = 400_000;

/// Nodes that one bit may add to them.
const NODES_OF_BIT: usize = 4_000;

impl Bits {
    fn new_bit(&mut self, driver: Driver) -> usize {
        self.drivers.push(driver);
        self.drivers.len() - 1
    }

    /// Takes a flattened module as yosys writes it in JSON.
    fn take(&mut self, netlist: &Value, top: &str) -> Option<Side> {
        let module = &netlist["modules"][top];
        let mut places: HashMap<String, usize> = HashMap::new();
        let mut place = |bits: &mut Bits, bit: &Value| -> usize {
            // A bit is a number, or a constant.
            let (key, driver) = match bit.as_str() {
                Some("0") => ("0".into(), Driver::Constant(false)),
                Some("1") => ("1".into(), Driver::Constant(true)),
                Some(constant) => (constant.to_owned(), cell(format!("constant {constant}"), Vec::new())),
                None => (format!("n{bit}"), cell("undriven".into(), Vec::new())),
            };
            *places.entry(key).or_insert_with(|| bits.new_bit(driver))
        };
        let mut outputs = Vec::new();
        for (name, port) in module["ports"].as_object()? {
            let bits: Vec<usize> = port["bits"].as_array()?.iter().map(|bit| place(self, bit)).collect();
            if port["direction"] == "output" {
                outputs.push((name.clone(), bits));
            } else {
                for (index, bit) in bits.into_iter().enumerate() {
                    self.drivers[bit] = cell(format!("input {name} {index}"), Vec::new());
                }
            }
        }
        for instance in module["cells"].as_object()?.values() {
            let kind = instance["type"].as_str()?;
            let directions = instance["port_directions"].as_object()?;
            let mut ports: HashMap<&str, Vec<usize>> = HashMap::new();
            let mut inputs = Vec::new();
            for (port, bits) in instance["connections"].as_object()? {
                let bits: Vec<usize> = bits.as_array()?.iter().map(|bit| place(self, bit)).collect();
                if directions.get(port)? == "input" {
                    inputs.extend(&bits);
                }
                ports.insert(port, bits);
            }
            let mut parameters = instance["parameters"].clone();
            // The name of a memory tells nothing.
            parameters.as_object_mut()?.remove("MEMID");
            for (port, bits) in instance["connections"].as_object()? {
                if directions.get(port)? == "input" {
                    continue;
                }
                for index in 0..bits.as_array()?.len() {
                    let driver = self
                        .logic(kind, &ports, index)
                        .unwrap_or_else(|| cell(format!("{kind} {parameters} {port} {index}"), inputs.clone()));
                    self.drivers[ports[port.as_str()][index]] = driver;
                }
            }
        }
        for net in module["netnames"].as_object()?.values() {
            let Some(init) = net["attributes"]["init"].as_str() else { continue };
            for (bit, value) in net["bits"].as_array()?.iter().zip(init.chars().rev()) {
                if bit.is_number() && value != 'x' {
                    let bit = place(self, bit);
                    // A signal may have several names.
                    let init = format!(" init {value}");
                    if let Driver::Cell { label, .. } = &mut self.drivers[bit]
                        && !label.ends_with(&init)
                    {
                        label.push_str(&init);
                    }
                }
            }
        }
        Some(Side { outputs })
    }

    /// A bit of the result of a cell that works bit by bit, or of one whose result is a bit.
    fn logic(&mut self, kind: &str, ports: &HashMap<&str, Vec<usize>>, index: usize) -> Option<Driver> {
        let of = |port: &str| ports.get(port).map(Vec::as_slice);
        let (gate, inputs) = match kind {
            "$and" | "$or" | "$xor" | "$xnor" => {
                let gate = match kind {
                    "$and" => Gate::And,
                    "$or" => Gate::Or,
                    "$xor" => Gate::Xor,
                    _ => Gate::Xnor,
                };
                (gate, vec![*of("A")?.get(index)?, *of("B")?.get(index)?])
            }
            "$not" => (Gate::Nor, vec![*of("A")?.get(index)?]),
            "$mux" => {
                let choice = of("S")?[0];
                self.choosing.insert(choice);
                (Gate::Choice, vec![*of("A")?.get(index)?, *of("B")?.get(index)?, choice])
            }
            "$reduce_and" if index == 0 => (Gate::And, of("A")?.to_vec()),
            "$reduce_or" | "$reduce_bool" if index == 0 => (Gate::Or, of("A")?.to_vec()),
            "$reduce_xor" if index == 0 => (Gate::Xor, of("A")?.to_vec()),
            "$reduce_xnor" if index == 0 => (Gate::Xnor, of("A")?.to_vec()),
            "$logic_not" if index == 0 => (Gate::Nor, of("A")?.to_vec()),
            _ => return None,
        };
        Some(Driver::Logic { gate, inputs })
    }

    /// The function of each bit of classes that the netlists may have in common.
    fn functions(&self) -> Vec<Function> {
        let control = self.control();
        let mut labels: HashMap<&str, usize> = HashMap::new();
        let mut classes: Vec<usize> = Vec::with_capacity(self.drivers.len());
        for driver in &self.drivers {
            let next = labels.len();
            let label = if let Driver::Cell { label, .. } = driver { label.as_str() } else { "logic" };
            classes.push(*labels.entry(label).or_insert(next));
        }
        let mut count = labels.len();
        // Bits whose diagrams are too large; once they are, they stay cells.
        let mut opaque = vec![false; self.drivers.len()];
        loop {
            let known = opaque.iter().filter(|opaque| **opaque).count();
            let functions = Turn::of(self, &classes, &control, &mut opaque).functions;
            let mut seen: HashMap<Vec<usize>, usize> = HashMap::new();
            let mut finer = Vec::with_capacity(classes.len());
            for (bit, driver) in self.drivers.iter().enumerate() {
                let signature: Vec<usize> = match driver {
                    Driver::Cell { inputs, .. } => {
                        inputs.iter().map(|input| functions[*input]).chain([classes[bit]]).collect()
                    }
                    Driver::Logic { gate, inputs } if opaque[bit] => {
                        let kind = [usize::MAX, *gate as usize];
                        inputs.iter().map(|input| functions[*input]).chain(kind).chain([classes[bit]]).collect()
                    }
                    _ => vec![classes[bit]],
                };
                let next = seen.len();
                finer.push(*seen.entry(signature).or_insert(next));
            }
            classes = finer;
            if seen.len() == count && known == opaque.iter().filter(|opaque| **opaque).count() {
                return functions;
            }
            count = seen.len();
        }
    }

    /// Bits that choosing ones are made of.
    fn control(&self) -> Vec<bool> {
        let mut control = vec![false; self.drivers.len()];
        let mut left: Vec<usize> = self.choosing.iter().copied().collect();
        while let Some(bit) = left.pop() {
            if !std::mem::replace(&mut control[bit], true)
                && let Driver::Logic { inputs, .. } = &self.drivers[bit]
            {
                left.extend(inputs);
            }
        }
        control
    }
}

fn cell(label: String, inputs: Vec<usize>) -> Driver {
    Driver::Cell { label, inputs }
}

/// The functions of all bits of given classes.
struct Turn<'a> {
    bits: &'a Bits,
    diagrams: Diagrams,
    /// Place of each class in the order of diagrams.
    order: Vec<u32>,
    classes: &'a [usize],
    functions: Vec<Function>,
}

/// A function that is not known yet.
const OPEN: Function = usize::MAX;

impl<'a> Turn<'a> {
    fn of(bits: &'a Bits, classes: &'a [usize], control: &[bool], opaque: &mut [bool]) -> Turn<'a> {
        let count = classes.iter().max().map_or(0, |most| most + 1);
        let mut chooses = vec![false; count];
        classes.iter().zip(control).for_each(|(class, control)| chooses[*class] |= control);
        let mut places: Vec<usize> = (0..count).collect();
        places.sort_by_key(|class| (!chooses[*class], *class));
        let mut order = vec![0; count];
        for (place, class) in (0..).zip(places) {
            order[class] = place;
        }
        let functions = vec![OPEN; classes.len()];
        let mut turn = Turn { bits, diagrams: Diagrams::default(), order, classes, functions };
        for bit in 0..classes.len() {
            turn.function(bit, opaque);
        }
        turn
    }

    /// Computes the function of a bit and of those that it is made of.
    fn function(&mut self, bit: usize, opaque: &mut [bool]) {
        let mut left = vec![bit];
        while let Some(bit) = left.last().copied() {
            if self.functions[bit] != OPEN {
                left.pop();
                continue;
            }
            let function = match &self.bits.drivers[bit] {
                Driver::Constant(one) => {
                    if *one {
                        TRUE
                    } else {
                        FALSE
                    }
                }
                Driver::Logic { gate, inputs } if !opaque[bit] => {
                    let open: Vec<usize> =
                        inputs.iter().copied().filter(|input| self.functions[*input] == OPEN).collect();
                    if !open.is_empty() {
                        // Logic that feeds itself has no function.
                        opaque[bit] = left.iter().filter(|other| **other == bit).count() > 1;
                        if !opaque[bit] {
                            left.extend(open);
                        }
                        continue;
                    }
                    let most = NODES.min(self.diagrams.nodes() + NODES_OF_BIT);
                    let inputs: Vec<Function> = inputs.iter().map(|input| self.functions[*input]).collect();
                    match apply(&mut self.diagrams, *gate, &inputs, most) {
                        Some(function) => function,
                        None => {
                            opaque[bit] = true;
                            continue;
                        }
                    }
                }
                _ => self.diagrams.variable(self.order[self.classes[bit]]),
            };
            self.functions[bit] = function;
            left.pop();
        }
    }
}

/// A gate of functions, unless the diagrams become larger than that.
fn apply(diagrams: &mut Diagrams, gate: Gate, inputs: &[Function], most: usize) -> Option<Function> {
    let mut all = |from: Function, step: fn(Function, Function, Function) -> [Function; 3]| -> Option<Function> {
        inputs.iter().try_fold(from, |sum, input| {
            let negated = diagrams.choice(*input, FALSE, TRUE, most)?;
            let [condition, one, other] = step(sum, *input, negated);
            diagrams.choice(condition, one, other, most)
        })
    };
    let result = match gate {
        Gate::And => all(TRUE, |sum, input, _| [sum, input, FALSE])?,
        Gate::Or | Gate::Nor => all(FALSE, |sum, input, _| [sum, TRUE, input])?,
        Gate::Xor | Gate::Xnor => all(FALSE, |sum, input, negated| [sum, negated, input])?,
        Gate::Choice => return diagrams.choice(inputs[2], inputs[1], inputs[0], most),
    };
    match gate {
        Gate::Nor | Gate::Xnor => diagrams.choice(result, FALSE, TRUE, most),
        _ => Some(result),
    }
}

/// Whether all outputs of a module are the same in two netlists; the first that may differ otherwise.
///
/// # Errors
/// That output, or that the netlists are not understood.
pub fn same(gold: &Value, gate: &Value, top: &str) -> Result<(), String> {
    let mut bits = Bits::default();
    let sides = [gold, gate].map(|netlist| bits.take(netlist, top));
    let [Some(gold), Some(gate)] = sides else { return Err("yosys wrote no netlist".into()) };
    let functions = bits.functions();
    if gold.outputs.len() != gate.outputs.len() {
        return Err("the networks have other ports".into());
    }
    for ((name, gold), (other, gate)) in gold.outputs.iter().zip(&gate.outputs) {
        let equal = |(a, b): (&usize, &usize)| functions[*a] == functions[*b];
        if name != other || gold.len() != gate.len() || !gold.iter().zip(gate).all(equal) {
            return Err(format!("`{name}` may differ"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// Two registers, the second one loaded from the first, and an or of both.
    fn netlist(first: &str, second: &str, or: [u32; 2], kind: &str) -> Value {
        let register = |from: u32, to: u32| {
            json!({"type": "$dff", "parameters": {"WIDTH": "1"}, "port_directions": {"CLK": "input", "D": "input",
                   "Q": "output"}, "connections": {"CLK": [2], "D": [from], "Q": [to]}})
        };
        json!({"modules": {"top": {
            "ports": {"clk": {"direction": "input", "bits": [2]}, "d": {"direction": "input", "bits": [3]},
                      "q": {"direction": "output", "bits": [6]}},
            "cells": {
                "a": register(3, 4), "b": register(4, 5),
                "c": {"type": kind, "parameters": {}, "port_directions": {"A": "input", "Y": "output"},
                      "connections": {"A": or, "Y": [6]}},
            },
            "netnames": {"x": {"bits": [4], "attributes": {"init": first}},
                         "y": {"bits": [5], "attributes": {"init": second}}},
        }}})
    }

    #[test]
    fn order_and_names_do_not_matter_but_kinds_initial_values_and_wires_do() {
        let gold = netlist("0", "1", [4, 5], "$reduce_or");
        assert_eq!(same(&gold, &gold, "top"), Ok(()));
        assert_eq!(same(&gold, &netlist("0", "1", [5, 4], "$reduce_or"), "top"), Ok(()));
        for other in [
            netlist("0", "0", [4, 5], "$reduce_or"),
            netlist("1", "1", [4, 5], "$reduce_or"),
            netlist("0", "1", [4, 4], "$reduce_or"),
            netlist("0", "1", [4, 5], "$reduce_and"),
            netlist("0", "1", [3, 5], "$reduce_or"),
        ] {
            assert!(same(&gold, &other, "top").is_err(), "{other}");
        }
        let ordered = |or| netlist("0", "1", or, "$sub");
        assert!(same(&ordered([4, 5]), &ordered([5, 4]), "top").is_err());
        assert!(same(&gold, &json!({}), "top").is_err());
    }
}
