//! What quantities that are read some time later were: a polynomial for each step of the method.
//!
//! A bend or jump of a quantity is one in what reads it later, so that steps end there: [`History::next`] tells where. Each time
//! it is one derivative higher, until the method no longer sees it.

use std::collections::VecDeque;

use super::interior::{NODES, at};

/// How often a bend is followed from one delay to the next.
const GENERATIONS: u8 = 7;

/// Times closer than this, relative to their magnitude, are the same time.
const SAME: f64 = 1e-13;

/// Part of the way to the middle of a step by which a time is taken to lie within it.
const INWARDS: f64 = 1e-6;

/// A step that was taken.
struct Piece {
    from: f64,
    to: f64,
    /// Up to where it counts.
    until: f64,
    /// Values at the nodes, of each delayed quantity in turn.
    values: Vec<f64>,
}

/// The past of some quantities, each with its delay in seconds.
pub(super) struct History {
    delays: Vec<f64>,
    /// What each was before time zero.
    before: Vec<f64>,
    pieces: Vec<Piece>,
    /// Times at which something bends or jumps, ascending, with how often it was followed.
    bends: VecDeque<(f64, u8)>,
    /// The step that is being taken.
    step: (f64, f64),
    /// Whether steps are kept.
    keeps: bool,
}

impl History {
    pub fn new(delays: Vec<f64>, before: Vec<f64>) -> History {
        History { delays, before, pieces: Vec::new(), bends: VecDeque::new(), step: (0.0, 0.0), keeps: true }
    }

    /// Forgets all that was.
    pub fn reset(&mut self) {
        *self = History::new(std::mem::take(&mut self.delays), std::mem::take(&mut self.before));
    }

    pub fn is_empty(&self) -> bool {
        self.delays.is_empty()
    }

    /// The shortest delay; infinite if there is none.
    pub fn shortest(&self) -> f64 {
        self.delays.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// Says which step is being taken: what jumps at an end of it is what it is within.
    pub fn takes(&mut self, from: f64, to: f64) {
        self.step = (from, to);
    }

    /// Whether steps are to be kept.
    pub fn keep(&mut self, keeps: bool) {
        self.keeps = keeps;
    }

    pub fn keeps(&self) -> bool {
        self.keeps && !self.is_empty()
    }

    /// A delayed quantity as it was before `time` by its delay.
    pub fn value(&self, number: usize, time: f64) -> f64 {
        let delay = self.delays[number];
        let was = time - delay;
        let middle = 0.5 * (self.step.0 + self.step.1);
        let inside = was + INWARDS * (middle - time);
        if inside <= 0.0 {
            return self.before[number];
        }
        let place = self.pieces.partition_point(|piece| piece.until < inside).min(self.pieces.len().max(1) - 1);
        let Some(piece) = self.pieces.get(place) else { return self.before[number] };
        let x = (2.0 * was - piece.from - piece.to) / (piece.to - piece.from);
        let values = &piece.values[number * NODES..(number + 1) * NODES];
        at(values, x)
    }

    /// Keeps a step: `values` has those of all quantities at one time after the other.
    pub fn add(&mut self, from: f64, to: f64, values: &[f64]) {
        let count = self.delays.len();
        let of = |number: usize| (0..NODES).map(move |node| values[node * count + number]);
        let values = (0..count).flat_map(of).collect();
        self.pieces.push(Piece { from, to, until: to, values });
    }

    /// Forgets what came after a time.
    pub fn cut(&mut self, time: f64) {
        while self.pieces.last().is_some_and(|piece| piece.from >= time) {
            self.pieces.pop();
        }
        if let Some(last) = self.pieces.last_mut() {
            last.until = last.until.min(time);
        }
    }

    /// Something bends or jumps at a time.
    pub fn bend(&mut self, time: f64, generation: u8) {
        if generation >= GENERATIONS {
            return;
        }
        for delay in self.delays.clone() {
            let later = time + delay;
            let place = self.bends.partition_point(|(known, _)| *known < later - SAME * later);
            match self.bends.get_mut(place) {
                Some((known, own)) if (*known - later).abs() <= SAME * later => *own = (*own).min(generation + 1),
                _ => self.bends.insert(place, (later, generation + 1)),
            }
        }
    }

    /// The next time behind this one at which a step must end; those up to it are taken to have been reached, and whether there
    /// was one.
    pub fn next(&mut self, time: f64) -> (f64, bool) {
        let mut reached = false;
        while let Some((bend, generation)) = self.bends.front().copied().filter(|(bend, _)| bend - time <= SAME * time)
        {
            self.bends.pop_front();
            self.bend(bend, generation);
            reached = true;
        }
        (self.bends.front().map_or(f64::INFINITY, |(bend, _)| *bend), reached)
    }

    /// What is to come, for those who go back.
    pub fn bends(&self) -> VecDeque<(f64, u8)> {
        self.bends.clone()
    }

    pub fn set_bends(&mut self, bends: VecDeque<(f64, u8)>) {
        self.bends = bends;
    }
}

#[cfg(test)]
mod tests {
    use super::super::interior::times;
    use super::*;

    #[test]
    fn a_step_is_kept_to_rounding_and_a_jump_belongs_to_the_step_that_reads_it() {
        let mut history = History::new(vec![1.0], vec![-5.0]);
        for (from, to, sign) in [(0.0, 0.7, 1.0), (0.7, 1.0, -1.0)] {
            let values: Vec<f64> = times(from, to).map(|time| sign * libm::sin(time)).collect();
            history.add(from, to, &values);
        }
        history.takes(1.5, 1.7);
        assert!((history.value(0, 1.6) - libm::sin(0.6)).abs() < 1e-12);
        assert!((history.value(0, 1.7) - libm::sin(0.7)).abs() < 1e-12, "the end of a step");
        history.takes(1.7, 1.9);
        assert!((history.value(0, 1.7) + libm::sin(0.7)).abs() < 1e-12, "its beginning");
        history.takes(0.5, 0.9);
        assert_eq!(history.value(0, 0.9), -5.0);
    }

    #[test]
    fn bends_come_again_after_every_delay() {
        let mut history = History::new(vec![1.0, 2.0], vec![0.0, 0.0]);
        history.bend(0.0, 0);
        assert_eq!(history.next(0.0), (1.0, false));
        assert_eq!(history.next(1.0), (2.0, true));
        assert_eq!(history.next(2.0), (3.0, true));
    }
}
