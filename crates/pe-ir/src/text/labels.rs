//! Unique names for values that the representations identify by number.

use std::collections::{HashMap, HashSet};

use crate::graph::{Chain, StepGraph, ValueId};
use crate::index::{self, at};

use super::{Line, Lines, TextError, name};

/// Different names for all members of a list: their own, with `~2` and so on behind those that were there before.
pub fn distinct(names: impl Iterator<Item = String>) -> Vec<String> {
    let names: Vec<String> = names.collect();
    let own: HashSet<&str> = names.iter().map(String::as_str).collect();
    let mut taken: HashSet<String> = HashSet::new();
    let mut repeats: HashMap<&str, u32> = HashMap::new();
    let mut labels = Vec::with_capacity(names.len());
    for name in &names {
        let mut label = name.clone();
        let repeat = repeats.entry(name).or_insert(1);
        while (label != *name && own.contains(label.as_str())) || !taken.insert(label.clone()) {
            *repeat += 1;
            label = format!("{name}~{repeat}");
        }
        labels.push(label);
    }
    labels
}

/// Names of a list, as they are printed and found again.
#[derive(Clone, Debug, Default)]
pub struct Labels {
    texts: Vec<String>,
    numbers: HashMap<String, u32>,
}

impl Labels {
    /// Of names, which become different.
    pub fn of(names: impl Iterator<Item = String>) -> Labels {
        let mut labels = Labels::default();
        for label in distinct(names) {
            labels.add(label);
        }
        labels
    }

    /// Of the values of a step graph.
    pub fn of_values(graph: &StepGraph) -> Labels {
        Labels::of((0..graph.values.len() as u32).map(|value| graph.value_name(ValueId::new(value))))
    }

    /// One more; false if there is one of this name.
    pub fn add(&mut self, label: String) -> bool {
        let number = index::number(self.texts.len());
        let is_new = self.numbers.insert(label.clone(), number).is_none();
        self.texts.push(name(&label));
        is_new
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.texts.len()
    }

    /// How many different names there are.
    pub fn distinct(&self) -> usize {
        self.numbers.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.texts.is_empty()
    }

    /// The text of a member.
    pub fn text(&self, number: u32) -> &str {
        &self.texts[at(number)]
    }

    /// The text of a value.
    pub fn value(&self, value: ValueId) -> &str {
        self.text(value.number())
    }

    /// The text of a chain: that of its write that may be sent.
    pub fn chain(&self, chain: &Chain) -> &str {
        self.value(chain.write.value)
    }

    /// The member of this name.
    pub fn find(&self, label: &str) -> Option<u32> {
        self.numbers.get(label).copied()
    }

    /// Reads the name of a member; `what` says of what.
    ///
    /// # Errors
    /// No member has it.
    pub fn read(&self, line: &mut Line, what: &str) -> Result<u32, TextError> {
        let label = line.name(&format!("the name of {what}"))?;
        self.find(&label).ok_or_else(|| line.error(format!("`{label}` is not the name of {what}")))
    }

    /// The line of the next chain, behind its label; `what` stands in it.
    ///
    /// # Errors
    /// There is no further line, or it is another chain's.
    pub fn line_of<'a>(&self, chain: &Chain, what: &str, lines: &mut Lines<'a>) -> Result<Line<'a>, TextError> {
        let label = self.chain(chain);
        let mut line = lines.next().ok_or_else(|| lines.error(format!("expected the {what} of the chain {label}")))?;
        line.word("chain")?;
        if self.read_value(&mut line)? == chain.write.value {
            Ok(line)
        } else {
            Err(line.error(format!("expected {label}: chains are in the order of the step")))
        }
    }

    /// Reads the name of a value.
    ///
    /// # Errors
    /// No value has it.
    pub fn read_value(&self, line: &mut Line) -> Result<ValueId, TextError> {
        self.read(line, "a value").map(ValueId::new)
    }
}
