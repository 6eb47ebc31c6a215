//! Ranges that elements of arrays share where events come: in another word or step another neuron of a network fires, and does what
//! its siblings did.

use std::collections::BTreeMap;

use pe_hls::formats::Ranges;
use pe_ir::graph::{Role, StepGraph, ValueId};

/// Numbers of groups of values that are the same but for the indices in their names, by value.
#[derive(Clone, Debug)]
pub struct Siblings(Vec<usize>);

/// A name without indices and without the numbers behind words, which are counted through in a graph; and these numbers.
fn parts(name: &str, indices: bool) -> (String, Vec<u64>) {
    let (mut depth, mut word, mut numbers) = (0, String::new(), Vec::new());
    // Whether what stands before is a letter, or a number behind one.
    let mut behind_letter = false;
    let mut counting = false;
    for letter in name.chars() {
        depth += i32::from(letter == '[');
        let digit = letter.to_digit(10).filter(|_| depth == 0 && (behind_letter || counting));
        if let Some(digit) = digit {
            if !counting {
                numbers.push(0u64);
            }
            counting = true;
            let last = numbers.last_mut().expect("a number has begun");
            *last = last.saturating_mul(10).saturating_add(u64::from(digit));
        } else {
            counting = false;
            if depth == 0 || indices {
                word.push(letter);
            }
        }
        behind_letter = letter.is_ascii_alphabetic();
        depth -= i32::from(letter == ']');
    }
    (word, numbers)
}

impl Siblings {
    /// The groups of a step's values. Of values of one element that differ in such numbers the first belongs to the first of another
    /// element, and so on.
    pub fn of(graph: &StepGraph) -> Siblings {
        // By the name of an element, the numbers that its values have.
        let mut of_element: BTreeMap<String, Vec<(Vec<u64>, usize)>> = BTreeMap::new();
        let mut alone = Vec::new();
        for (index, value) in graph.values.iter().enumerate() {
            // What constants and tables hold is known.
            if matches!(value.role, Role::Constant(_) | Role::Column(..)) {
                alone.push(index);
                continue;
            }
            let (element, numbers) = parts(&graph.value_name(ValueId::at(index)), true);
            of_element.entry(element).or_default().push((numbers, index));
        }
        let mut groups: BTreeMap<(String, usize), usize> = BTreeMap::new();
        let mut of_value = vec![0; graph.values.len()];
        for (element, mut values) in of_element {
            values.sort_unstable();
            let family = parts(&element, false).0;
            for (place, (_, index)) in values.into_iter().enumerate() {
                let next = groups.len();
                of_value[index] = *groups.entry((family.clone(), place)).or_insert(next);
            }
        }
        for (number, index) in alone.into_iter().enumerate() {
            of_value[index] = groups.len() + number;
        }
        Siblings(of_value)
    }

    /// Gives all of a group what `join` makes of theirs.
    pub fn share<T: Copy>(&self, values: &mut [T], join: impl Fn(T, T) -> T) {
        let mut joined: BTreeMap<usize, T> = BTreeMap::new();
        for (group, value) in self.0.iter().zip(values.iter()) {
            joined.entry(*group).and_modify(|all| *all = join(*all, *value)).or_insert(*value);
        }
        self.0.iter().zip(values).for_each(|(group, value)| *value = joined[group]);
    }

    /// Gives all of a group the ranges of the largest.
    pub(super) fn include(&self, ranges: &mut Ranges) {
        self.share(&mut ranges.largest, f64::max);
        self.share(&mut ranges.widened, i32::max);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_behind_words_are_counted_and_indices_are_left_out() {
        let plain = |name: &str| parts(name, false);
        assert_eq!(plain("event_1[37].change12.stage254"), ("event_1.change.stage".to_owned(), vec![12, 254]));
        assert_eq!(plain("v[3]"), ("v".to_owned(), vec![]));
        assert_eq!(parts("x2[i1].y", true), ("x[i1].y".to_owned(), vec![2]));
    }
}
