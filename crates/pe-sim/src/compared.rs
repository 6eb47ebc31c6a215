//! Two runs compared at every step: running maxima of their deviation.

use pe_ir::turns;

use crate::error::{SCALE_FLOOR, Trajectory};

/// Columns that are compared side by side: a cache line.
const LANES: usize = 8;

/// Numbers of a run at steps that follow each other, a row per step.
#[derive(Clone, Debug)]
pub struct Rows {
    width: usize,
    numbers: Vec<f64>,
}

impl Rows {
    /// No rows yet, `width` numbers each, at least one.
    pub fn new(width: usize) -> Rows {
        assert!(width > 0, "a row has numbers");
        Rows { width, numbers: Vec::new() }
    }

    /// Removes all rows.
    pub fn clear(&mut self) {
        self.numbers.clear();
    }

    /// Adds a row.
    ///
    /// # Panics
    /// If the numbers are not as many as a row has.
    pub fn add(&mut self, numbers: impl Iterator<Item = f64>) {
        self.numbers.extend(numbers);
        assert!(self.numbers.len().is_multiple_of(self.width), "a row has {} numbers", self.width);
    }

    /// The rows so far; none are left, but there is room for as many.
    pub fn take(&mut self) -> Rows {
        let room = Vec::with_capacity(self.numbers.len());
        Rows { width: self.width, numbers: std::mem::replace(&mut self.numbers, room) }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.numbers.len() / self.width
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.numbers.is_empty()
    }

    /// The rows but some, whose places ascend.
    #[must_use]
    pub fn without(&self, places: &[usize]) -> Rows {
        let mut rows = Rows::new(self.width);
        let kept = (0..self.len()).filter(|place| places.binary_search(place).is_err());
        kept.for_each(|place| rows.numbers.extend_from_slice(self.row(place)));
        rows
    }

    /// A row.
    pub fn row(&self, index: usize) -> &[f64] {
        &self.numbers[index * self.width..(index + 1) * self.width]
    }
}

/// What is known of the deviation of a run from another one after some steps, column by column.
///
/// All numbers of both runs are finite: a run ends where one is not.
#[derive(Clone, Debug)]
pub struct Compared {
    /// First column that is compared.
    from: usize,
    /// What deviations are relative to.
    scales: Vec<f64>,
    /// Largest magnitude so far of the run that is compared with.
    magnitudes: Vec<f64>,
    /// Largest deviation.
    largest: Vec<f64>,
    /// Largest deviation of those rows that were seen by others, too.
    seen: Vec<f64>,
    /// Largest deviation relative to the largest magnitude up to then, at least [`SCALE_FLOOR`] times the scale.
    to_date: Vec<f64>,
    /// Deviation in the last row.
    last: Vec<f64>,
    /// Largest relative deviation of each block, with the steps done at the end of its first one.
    course: Vec<(u64, f64)>,
    /// Columns that are angles, counted from the first one that is compared, each with the length of a turn.
    turns: Vec<(usize, f64)>,
}

impl Compared {
    /// Nothing compared yet. `scales` are what deviations of the columns from `from` on are relative to, `start` the
    /// numbers of these columns before the first step.
    pub fn new(from: usize, scales: &[f64], start: &[f64]) -> Compared {
        let count = scales.len();
        assert_eq!(count, start.len(), "every column has a scale");
        Compared {
            from,
            scales: scales.to_vec(),
            magnitudes: start.iter().map(|number| number.abs()).collect(),
            largest: vec![0.0; count],
            seen: vec![0.0; count],
            to_date: vec![0.0; count],
            last: vec![0.0; count],
            course: Vec::new(),
            turns: Vec::new(),
        }
    }

    /// The same, where some columns are angles: they deviate by what they differ by modulo a turn, whose length stands beside
    /// the column.
    #[must_use]
    pub fn modulo(self, turns: Vec<(usize, f64)>) -> Compared {
        Compared { turns, ..self }
    }

    /// Takes the numbers of columns that are angles, in a row, a turn further, so that they are closest to those of another
    /// row.
    fn turn(&self, run: &[f64], other: &mut [f64]) {
        for (column, turn) in &self.turns {
            let place = self.from + column;
            other[place] = turns::nearest(other[place], run[place], *turn);
        }
    }

    /// Goes on with a block of steps that ends after `done` steps: rows of the run that is compared with, and of the
    /// other one.
    ///
    /// # Panics
    /// If the rows are not as many, or none.
    pub fn include(&mut self, done: u64, run: &Rows, other: &Rows) {
        assert!(run.len() == other.len() && !run.is_empty(), "{} and {} rows", run.len(), other.len());
        let turned = (!self.turns.is_empty()).then(|| {
            let mut turned = other.clone();
            for (index, row) in turned.numbers.chunks_exact_mut(turned.width).enumerate() {
                self.turn(run.row(index), row);
            }
            turned
        });
        let other = turned.as_ref().unwrap_or(other);
        let worst = block(self, run, other);
        self.course.push((done + 1 - run.len() as u64, worst));
        let (own, others) = (run.row(run.len() - 1), other.row(run.len() - 1));
        for ((last, own), other) in self.last.iter_mut().zip(&own[self.from..]).zip(&others[self.from..]) {
            *last = (other - own).abs();
        }
    }

    /// Notes that others look at this step, too: a row of each run.
    pub fn see(&mut self, run: &[f64], other: &[f64]) {
        let turned = (!self.turns.is_empty()).then(|| {
            let mut turned = other.to_vec();
            self.turn(run, &mut turned);
            turned
        });
        let other = turned.as_deref().unwrap_or(other);
        for ((seen, own), other) in self.seen.iter_mut().zip(&run[self.from..]).zip(&other[self.from..]) {
            *seen = seen.max((other - own).abs());
        }
    }

    /// Compares a block; gives its largest relative deviation.
    #[inline(always)]
    fn block(&mut self, run: &Rows, other: &Rows) -> f64 {
        let count = self.scales.len();
        let whole = count - count % LANES;
        let mut worst = 0.0f64;
        for first in (0..whole).step_by(LANES) {
            worst = worst.max(self.columns::<LANES>(first, run, other));
        }
        for first in whole..count {
            worst = worst.max(self.columns::<1>(first, run, other));
        }
        worst
    }

    #[inline(always)]
    fn columns<const COUNT: usize>(&mut self, first: usize, run: &Rows, other: &Rows) -> f64 {
        let (mut worst, mut magnitudes) = ([0.0f64; COUNT], [0.0f64; COUNT]);
        let at = self.from + first;
        for (own, others) in run.numbers.chunks_exact(run.width).zip(other.numbers.chunks_exact(other.width)) {
            let (own, others) = (&own[at..at + COUNT], &others[at..at + COUNT]);
            for lane in 0..COUNT {
                let (deviation, magnitude) = ((others[lane] - own[lane]).abs(), own[lane].abs());
                worst[lane] = if deviation > worst[lane] { deviation } else { worst[lane] };
                magnitudes[lane] = if magnitude > magnitudes[lane] { magnitude } else { magnitudes[lane] };
            }
        }
        let mut relative = 0.0f64;
        for lane in 0..COUNT {
            let column = first + lane;
            relative = relative.max(quotient(worst[lane], self.scales[column]));
            self.largest[column] = self.largest[column].max(worst[lane]);
            // Rarely so: magnitudes only grow.
            if worst[lane] > self.to_date[column] * self.least(column).max(self.magnitudes[column]) {
                self.look_back(column, run, other);
            }
            self.magnitudes[column] = self.magnitudes[column].max(magnitudes[lane]);
        }
        relative
    }

    /// The smallest magnitude that a deviation is held against.
    fn least(&self, column: usize) -> f64 {
        SCALE_FLOOR * self.scales[column]
    }

    /// Step by step through a block whose deviation may be the largest against the magnitude up to then.
    fn look_back(&mut self, column: usize, run: &Rows, other: &Rows) {
        let mut magnitude = self.magnitudes[column].max(self.least(column));
        for index in 0..run.len() {
            let (own, other) = (run.row(index)[self.from + column], other.row(index)[self.from + column]);
            magnitude = magnitude.max(own.abs());
            self.to_date[column] = self.to_date[column].max(quotient((other - own).abs(), magnitude));
        }
    }

    /// The same with larger scales, where the run that is compared with has larger magnitudes. `quantity` is that of
    /// each column, as in [`Trajectory::scales`].
    pub fn in_scale(mut self, quantity: &[u32]) -> Compared {
        let whole = Trajectory { largest: self.magnitudes.clone(), ..Trajectory::new(self.scales.len()) };
        for (scale, larger) in self.scales.iter_mut().zip(whole.scales(quantity)) {
            *scale = scale.max(larger);
        }
        self
    }

    /// Largest deviation of each column, relative to its scale.
    pub fn relative(&self) -> impl Iterator<Item = f64> {
        self.largest.iter().zip(&self.scales).map(|(deviation, scale)| quotient(*deviation, *scale))
    }

    /// The worst column and its relative deviation.
    pub fn worst(&self) -> (usize, f64) {
        let worst = |worst: (usize, f64), (column, error)| if error > worst.1 { (column, error) } else { worst };
        self.relative().enumerate().fold((0, 0.0), worst)
    }

    /// Largest relative deviation in the last row.
    pub fn at_end(&self) -> f64 {
        self.last.iter().zip(&self.scales).map(|(last, scale)| quotient(*last, *scale)).fold(0.0, f64::max)
    }

    /// Largest deviation relative to the largest magnitude that the column has up to the step in question, at least
    /// [`SCALE_FLOOR`] times its scale.
    pub fn to_date(&self) -> f64 {
        self.to_date.iter().copied().fold(0.0, f64::max)
    }

    /// By how much the largest deviation of each column is larger than that of the steps seen by others, relative to
    /// its scale.
    pub fn unseen(&self) -> impl Iterator<Item = f64> {
        let columns = self.largest.iter().zip(&self.seen).zip(&self.scales);
        columns.map(|((largest, seen), scale)| quotient((largest - seen).max(0.0), *scale))
    }

    /// Largest relative deviation in blocks that end after so many steps; zero if there is none.
    pub fn after(&self, steps: u64) -> f64 {
        // All that end by then but the last one are followed by one that begins by then.
        let ended = self.course.partition_point(|(first, _)| *first <= steps + 1).saturating_sub(1);
        self.course[ended..].iter().map(|(_, worst)| *worst).fold(0.0, f64::max)
    }

    /// Steps done at the beginning of the first block in which some relative deviation is above a limit; of the first
    /// of all if there is none.
    pub fn since(&self, limit: f64) -> u64 {
        let beyond = self.course.iter().find(|(_, worst)| *worst > limit);
        beyond.or(self.course.first()).map_or(0, |(done, _)| *done)
    }
}

/// A deviation relative to a scale; none is none of anything.
fn quotient(deviation: f64, scale: f64) -> f64 {
    if deviation == 0.0 { 0.0 } else { deviation / scale }
}

/// [`Compared::block`] with the widest vectors that this processor has.
#[multiversion::multiversion(targets = "simd")]
fn block(compared: &mut Compared, run: &Rows, other: &Rows) -> f64 {
    compared.block(run, other)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows with a column more in front, which is not compared.
    fn rows(numbers: &[[f64; 9]]) -> Rows {
        let mut rows = Rows::new(10);
        for number in numbers {
            rows.add(std::iter::once(1e9 * number[0]).chain(number.iter().copied()));
        }
        rows
    }

    #[test]
    fn maxima_are_those_of_all_steps_whatever_the_blocks() {
        let number = |step: usize, column: usize| libm::sin((step * 7 + column * 3) as f64) * (step as f64);
        let other = |step: usize, column: usize| number(step, column) + 1e-3 * libm::cos((step + column) as f64);
        let at = |of: &dyn Fn(usize, usize) -> f64, step: usize| std::array::from_fn(|column| of(step, column));
        let scales: [f64; 9] =
            std::array::from_fn(|column| (0..40).map(|step| number(step, column).abs()).fold(0.0, f64::max));
        for block in [1, 3, 8, 40] {
            let mut compared = Compared::new(1, &scales, &[0.0; 9]);
            for from in (0..40).step_by(block) {
                let steps = from..(from + block).min(40);
                let of = |of: &dyn Fn(usize, usize) -> f64| {
                    rows(&steps.clone().map(|step| at(of, step)).collect::<Vec<_>>())
                };
                compared.include(steps.end as u64, &of(&number), &of(&other));
            }
            let deviation = |step: usize, column: usize| (other(step, column) - number(step, column)).abs();
            for (column, relative) in compared.relative().enumerate() {
                let wanted = (0..40).map(|step| deviation(step, column)).fold(0.0, f64::max) / scales[column];
                assert_eq!(relative, wanted, "column {column}, blocks of {block}");
            }
            let to_date = (0..9).flat_map(|column| {
                let mut magnitude = SCALE_FLOOR * scales[column];
                (0..40).map(move |step| {
                    magnitude = magnitude.max(number(step, column).abs());
                    deviation(step, column) / magnitude
                })
            });
            assert_eq!(compared.to_date(), to_date.fold(0.0, f64::max), "blocks of {block}");
            let end = (0..9).map(|column| deviation(39, column) / scales[column]).fold(0.0, f64::max);
            assert_eq!(compared.at_end(), end);
        }
    }

    #[test]
    fn what_others_do_not_see_is_known() {
        let mut compared = Compared::new(0, &[2.0], &[0.0]);
        let of = |numbers: &[f64]| {
            let mut rows = Rows::new(1);
            numbers.iter().for_each(|number| rows.add(std::iter::once(*number)));
            rows
        };
        let (run, other) = (of(&[1.0, 1.0, 1.0]), of(&[1.0, 2.0, 1.5]));
        compared.include(3, &run, &other);
        compared.see(run.row(2), other.row(2));
        assert_eq!((compared.worst(), compared.at_end()), ((0, 0.5), 0.25));
        assert_eq!(compared.unseen().collect::<Vec<_>>(), [0.25]);
        assert_eq!((compared.since(0.1), compared.to_date()), (1, 1.0));
        compared.include(5, &of(&[1.0, 1.0]), &of(&[1.2, 1.2]));
        let after = [0, 2, 3, 4].map(|steps| compared.after(steps));
        assert_eq!(after.map(|worst| (10.0 * worst).round()), [5.0, 5.0, 1.0, 1.0]);
    }
}
