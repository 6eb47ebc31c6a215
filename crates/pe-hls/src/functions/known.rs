//! What is known of the tables of a function, so that it is found only once.
//!
//! Every division of the range asks for the same equal segments, whether or not it counts octaves, and every choice of
//! functions that share a table asks again for all that do not. Answers do not depend on what was asked before.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use pe_ir::functions::{ScalarFunction, Segments};
use pe_ir::model::Expr;

use super::domain::Domain;
use super::fit::Shape;

/// What is asked of a function and its arguments.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Asked {
    /// The best table of equal segments, so many bits of them.
    Uniform(u32),
    /// That of the octave that tells all others.
    Octave(u32),
    /// The best of all that a division has: bits of an index, and those that count octaves.
    Best(u32, u32),
}

impl Asked {
    pub fn best(Segments { index_bits, octave_bits }: Segments) -> Asked {
        Asked::Best(index_bits, octave_bits)
    }
}

/// Shapes of the tables of one function for the same arguments.
#[derive(Debug, Default)]
pub(super) struct Answers(RefCell<BTreeMap<Asked, Answer>>);

/// What was found when so much was permitted.
#[derive(Clone, Copy, Debug)]
struct Answer {
    most: f64,
    shape: Option<Shape>,
}

impl Answers {
    /// The shape that misses least, if that is at most `most` times what is tolerated; `find` is asked if that is not known.
    pub fn shape(&self, asked: Asked, most: f64, find: impl FnOnce() -> Option<Shape>) -> Option<Shape> {
        let known = self.0.borrow().get(&asked).copied();
        match known {
            Some(Answer { shape: Some(shape), .. }) => return Some(shape).filter(|shape| shape.excess <= most),
            Some(Answer { most: before, shape: None }) if most <= before => return None,
            _ => {}
        }
        let shape = find();
        self.0.borrow_mut().insert(asked, Answer { most, shape });
        shape
    }
}

/// Bits of the least and the largest argument.
type Range = (u64, u64);

/// A function, and what is known of it.
#[derive(Debug)]
struct Member {
    body: Expr,
    /// Whether its arguments are scaled anyway.
    is_scaled: bool,
    answers: Rc<Answers>,
}

/// What is known of all functions, for words of one format.
#[derive(Debug, Default)]
pub(super) struct Known(RefCell<BTreeMap<Range, Vec<Member>>>);

impl Known {
    /// Gives the domain of a function for the arguments of a run what is known of it.
    pub fn join(&self, domain: &mut Domain, function: &ScalarFunction, run: (f64, f64)) {
        let mut all = self.0.borrow_mut();
        let alike = all.entry((run.0.to_bits(), run.1.to_bits())).or_default();
        let is_scaled = domain.is_scaled;
        let same = |member: &&Member| member.body == function.body && member.is_scaled == is_scaled;
        match alike.iter().find(same) {
            Some(member) => domain.answers = Rc::clone(&member.answers),
            None => {
                let (body, answers) = (function.body.clone(), Rc::clone(&domain.answers));
                alike.push(Member { body, is_scaled, answers });
            }
        }
    }
}
