//! Whether two netlists are the same logic up to names: the coarsest bisimulation of their bits.
//!
//! Bits are of one class if cells of the same kind and parameters drive them from bits of the same classes; registers begin
//! with the same value. Classes are split until that holds. Two bits of a class then have the same value in every clock, by
//! induction over clocks and over the depth of the logic.

use std::collections::HashMap;

use serde_json::Value;

/// What drives a bit: what its class depends on, and the bits that it is made of.
#[derive(Clone, Debug, Default)]
struct Driver {
    /// Kind, parameters, port and place; the name of an input; a constant; the initial value.
    label: String,
    inputs: Vec<usize>,
}

/// The bits of both netlists.
#[derive(Default)]
struct Bits {
    drivers: Vec<Driver>,
}

/// One netlist: index of each of its bits, and the bits of its output ports.
struct Side {
    outputs: Vec<(String, Vec<usize>)>,
}

/// Cells whose result does not depend on the order of the bits of their only operand.
const UNORDERED: [&str; 3] = ["$reduce_or", "$reduce_and", "$reduce_bool"];

impl Bits {
    fn new_bit(&mut self, label: &str) -> usize {
        self.drivers.push(Driver { label: label.to_owned(), inputs: Vec::new() });
        self.drivers.len() - 1
    }

    /// Takes a flattened module as yosys writes it in JSON.
    fn take(&mut self, netlist: &Value, top: &str) -> Option<Side> {
        let module = &netlist["modules"][top];
        let mut places: HashMap<String, usize> = HashMap::new();
        let mut place = |bits: &mut Bits, bit: &Value| -> usize {
            // A bit is a number, or a constant.
            let (key, label) = match bit.as_str() {
                Some(constant) => (format!("c{constant}"), format!("constant {constant}")),
                None => (bit.to_string(), "undriven".to_owned()),
            };
            *places.entry(key).or_insert_with(|| bits.new_bit(&label))
        };
        let mut outputs = Vec::new();
        for (name, port) in module["ports"].as_object()? {
            let bits: Vec<usize> = port["bits"].as_array()?.iter().map(|bit| place(self, bit)).collect();
            if port["direction"] == "output" {
                outputs.push((name.clone(), bits));
            } else {
                for (index, bit) in bits.into_iter().enumerate() {
                    self.drivers[bit].label = format!("input {name} {index}");
                }
            }
        }
        for cell in module["cells"].as_object()?.values() {
            let kind = cell["type"].as_str()?;
            let directions = cell["port_directions"].as_object()?;
            let mut inputs = Vec::new();
            for (port, bits) in cell["connections"].as_object()? {
                if directions.get(port)? == "input" {
                    inputs.extend(bits.as_array()?.iter().map(|bit| place(self, bit)));
                }
            }
            let mut parameters = cell["parameters"].clone();
            // The name of a memory tells nothing.
            parameters.as_object_mut()?.remove("MEMID");
            for (port, bits) in cell["connections"].as_object()? {
                if directions.get(port)? == "input" {
                    continue;
                }
                for (index, bit) in bits.as_array()?.iter().enumerate() {
                    let bit = place(self, bit);
                    self.drivers[bit] =
                        Driver { label: format!("{kind} {parameters} {port} {index}"), inputs: inputs.clone() };
                }
            }
        }
        for net in module["netnames"].as_object()?.values() {
            let Some(init) = net["attributes"]["init"].as_str() else { continue };
            for (bit, value) in net["bits"].as_array()?.iter().zip(init.chars().rev()) {
                if bit.is_number() && value != 'x' {
                    let bit = place(self, bit);
                    let label = &mut self.drivers[bit].label;
                    // A signal may have several names.
                    let init = format!(" init {value}");
                    if !label.ends_with(&init) {
                        label.push_str(&init);
                    }
                }
            }
        }
        Some(Side { outputs })
    }

    /// The class of each bit.
    fn classes(&self) -> Vec<usize> {
        let mut labels: HashMap<&str, usize> = HashMap::new();
        let mut classes: Vec<usize> = Vec::with_capacity(self.drivers.len());
        for driver in &self.drivers {
            let next = labels.len();
            classes.push(*labels.entry(driver.label.as_str()).or_insert(next));
        }
        let mut count = labels.len();
        loop {
            let mut seen: HashMap<Vec<usize>, usize> = HashMap::new();
            let mut finer = Vec::with_capacity(classes.len());
            for (bit, driver) in self.drivers.iter().enumerate() {
                let mut signature: Vec<usize> = driver.inputs.iter().map(|input| classes[*input]).collect();
                if UNORDERED
                    .iter()
                    .any(|kind| driver.label.strip_prefix(kind).is_some_and(|rest| rest.starts_with(' ')))
                {
                    signature.sort_unstable();
                }
                signature.push(classes[bit]);
                let next = seen.len();
                finer.push(*seen.entry(signature).or_insert(next));
            }
            classes = finer;
            if seen.len() == count {
                return classes;
            }
            count = seen.len();
        }
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
    let classes = bits.classes();
    if gold.outputs.len() != gate.outputs.len() {
        return Err("the networks have other ports".into());
    }
    for ((name, gold), (other, gate)) in gold.outputs.iter().zip(&gate.outputs) {
        let equal = |(a, b): (&usize, &usize)| classes[*a] == classes[*b];
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
