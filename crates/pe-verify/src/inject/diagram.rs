//! Binary decision diagrams, ordered and reduced: equal functions of bits have equal numbers.

use std::collections::HashMap;

/// Number of a function in its [`Diagrams`].
pub type Function = usize;

/// The function that is 0.
pub const FALSE: Function = 0;

/// The function that is 1.
pub const TRUE: Function = 1;

/// Place of a variable in the order, the functions if it is 1 and if it is 0.
type Node = (u32, Function, Function);

/// Functions of variables, each once.
pub struct Diagrams {
    nodes: Vec<Node>,
    numbers: HashMap<Node, Function>,
    choices: HashMap<(Function, Function, Function), Function>,
}

impl Default for Diagrams {
    fn default() -> Diagrams {
        let constant = (u32::MAX, FALSE, FALSE);
        Diagrams { nodes: vec![constant; 2], numbers: HashMap::new(), choices: HashMap::new() }
    }
}

impl Diagrams {
    /// Nodes of all diagrams.
    pub fn nodes(&self) -> usize {
        self.nodes.len()
    }

    /// The variable with that place in the order.
    pub fn variable(&mut self, place: u32) -> Function {
        self.node((place, TRUE, FALSE))
    }

    fn node(&mut self, node: Node) -> Function {
        if node.1 == node.2 {
            return node.1;
        }
        let next = self.nodes.len();
        let number = *self.numbers.entry(node).or_insert(next);
        if number == next {
            self.nodes.push(node);
        }
        number
    }

    /// `one` if the condition is 1, else `other`; none if there would be more nodes than that.
    pub fn choice(&mut self, condition: Function, one: Function, other: Function, most: usize) -> Option<Function> {
        match (condition, one, other) {
            (TRUE, _, _) => return Some(one),
            (FALSE, _, _) => return Some(other),
            (_, TRUE, FALSE) => return Some(condition),
            _ if one == other => return Some(one),
            _ => {}
        }
        let key = (condition, one, other);
        if let Some(known) = self.choices.get(&key) {
            return Some(*known);
        }
        if self.nodes.len() >= most {
            return None;
        }
        let place = [condition, one, other].map(|function| self.nodes[function].0).into_iter().min()?;
        let branch = |function: Function, is_one: bool| match self.nodes[function] {
            (own, one, other) if own == place => {
                if is_one {
                    one
                } else {
                    other
                }
            }
            _ => function,
        };
        let [upper, lower] = [true, false].map(|is_one| [condition, one, other].map(|f| branch(f, is_one)));
        let upper = self.choice(upper[0], upper[1], upper[2], most)?;
        let lower = self.choice(lower[0], lower[1], lower[2], most)?;
        let number = self.node((place, upper, lower));
        self.choices.insert(key, number);
        Some(number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_functions_have_equal_numbers_however_they_are_made() {
        let mut diagrams = Diagrams::default();
        let [a, b, c] = [2, 0, 1].map(|place| diagrams.variable(place));
        let mut choice = |condition, one, other| diagrams.choice(condition, one, other, 100).expect("small");
        let both = choice(a, b, FALSE);
        assert_eq!(both, choice(b, a, FALSE));
        let either = choice(both, TRUE, c);
        // c or (a and b) = (c or a) and (c or b)
        let (one, other) = (choice(c, TRUE, a), choice(c, TRUE, b));
        assert_eq!(either, choice(one, other, FALSE));
        assert_ne!(either, choice(one, b, FALSE));
        let not = choice(either, FALSE, TRUE);
        assert_eq!(choice(not, FALSE, TRUE), either);
        assert_eq!(choice(not, either, FALSE), FALSE);
    }

    #[test]
    fn what_is_too_large_is_no_function() {
        let mut diagrams = Diagrams::default();
        let mut sum = FALSE;
        let mut add = |place, most| {
            let (one, other) = (diagrams.variable(place), diagrams.variable(place + 20));
            let both = diagrams.choice(one, other, FALSE, usize::MAX)?;
            sum = diagrams.choice(both, TRUE, sum, most)?;
            Some(sum)
        };
        assert!((0..5).all(|place| add(place, 1_000).is_some()));
        assert!((5..20).any(|place| add(place, 1_000).is_none()));
    }
}
