//! Functions of one variable: exact ones, and the tables of polynomials that stand for them in hardware.
//!
//! A lookup takes the upper bits of its argument's word as the index into all columns of its table; the columns are the
//! coefficients of a polynomial in the lower bits, and reach the PE as base words. See `docs/decisions/0024`.

use crate::index::{self, ValueId};
use crate::model::{Expr, Variable};

/// Functions of a step graph.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Functions {
    /// Functions that chains apply; empty once tables stand for them.
    pub exact: Vec<ScalarFunction>,
    /// How all tables of the step divide the range of their arguments.
    pub segments: Segments,
    /// Tables.
    pub tables: Vec<Table>,
    /// Reads of tables.
    pub lookups: Vec<Lookup>,
}

/// A real function of one real variable.
#[derive(Clone, Debug, PartialEq)]
pub struct ScalarFunction {
    /// What messages call it.
    pub name: String,
    /// The expression.
    pub body: Expr,
    /// The only variable that the expression reads.
    pub variable: Variable,
}

impl ScalarFunction {
    /// The value at `x`, or the limit there if both sides have the same (`x/(1 - exp(-x))` at zero); not finite where
    /// the function is not defined.
    pub fn evaluate(&self, x: f64) -> f64 {
        self.evaluate_noting(x).0
    }

    /// The same, and whether it is a limit that stands in for 0/0.
    pub fn evaluate_noting(&self, x: f64) -> (f64, bool) {
        let value = self.body.evaluate(&|_| x);
        let limit = if value.is_finite() || !x.is_finite() { None } else { self.limit(x) };
        (limit.unwrap_or(value), limit.is_some())
    }

    /// The limit at `x`: what the means of two points around it, a distance, half and a quarter of it away, lead to, as far
    /// away as the first two and the last two lead to the same. Nearer ones would be rounded off.
    pub fn limit(&self, x: f64) -> Option<f64> {
        const CLOSE: f64 = 1e-9;
        let at = |distance: f64| {
            let (left, right) = (self.body.evaluate(&|_| x - distance), self.body.evaluate(&|_| x + distance));
            (left.is_finite() && right.is_finite()).then_some((left, right))
        };
        let mean = |(left, right): (f64, f64)| 0.5 * (left + right);
        let scale = if x == 0.0 { 1.0 } else { x.abs() };
        (4..40).map(|power| libm::scalbn(scale, -power)).find_map(|distance| {
            let (far, near, nearest) = (at(distance)?, at(0.5 * distance)?, at(0.25 * distance)?);
            let (first, last) = ((4.0 * mean(near) - mean(far)) / 3.0, (4.0 * mean(nearest) - mean(near)) / 3.0);
            let size = far.0.abs() + far.1.abs();
            // Across a pole or a jump the sides do not approach each other.
            let approaching = (near.0 - near.1).abs() <= 0.6 * (far.0 - far.1).abs() + CLOSE * size;
            (approaching && (first - last).abs() <= CLOSE * size).then_some(last)
        })
    }
}

/// How the arguments of tables, numbers from -1 to 1, become indices.
///
/// Invariant: a data operand has a bit for each octave and for the mantissa behind the last one,
/// `2^octave_bits - 1 + index_bits - octave_bits < data_bits`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Segments {
    /// Bits of an index.
    pub index_bits: u32,
    /// Upper bits of an index that count octaves, in tables that are divided so.
    pub octave_bits: u32,
}

/// Coefficients of a polynomial for each segment.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// What messages call it.
    pub name: String,
    /// Whether its segments are halves of octaves of 0 .. 1 and so forth, instead of equal parts of -1 .. 1.
    pub octaves: bool,
    /// For each column the numbers of all segments, `2^index_bits` of them.
    pub columns: Vec<Vec<f64>>,
    /// Arguments that it covers, before they are mapped to -1 .. 1.
    pub domain: (f64, f64),
    /// Largest difference to the function in that domain, in exact arithmetic; checked on a dense grid.
    pub error: f64,
    /// The functions that share it; none if it is that of one function as it is.
    pub stands_for: Vec<Scaled>,
}

/// A function of another shape's value, `factor*F(slope*x + offset) + beside.0*x + beside.1`.
#[derive(Clone, Debug, PartialEq)]
pub struct Scaled {
    /// What messages call the function.
    pub name: String,
    /// What the argument is multiplied by.
    pub slope: f64,
    /// What is added to it then.
    pub offset: f64,
    /// What the value is multiplied by.
    pub factor: f64,
    /// What is beside it in a sum: a multiple of the argument, and a number.
    pub beside: (f64, f64),
}

impl Scaled {
    /// Its arguments from those of the shape.
    pub fn arguments(&self, (low, high): (f64, f64)) -> (f64, f64) {
        let ends = [low, high].map(|end| (end - self.offset) / self.slope);
        (ends[0].min(ends[1]), ends[0].max(ends[1]))
    }
}

impl Table {
    /// The arguments of a function of such a name that it covers, if it stands for it.
    pub fn covers(&self, function: &str) -> Option<(f64, f64)> {
        if self.stands_for.is_empty() && self.name == function {
            return Some(self.domain);
        }
        Some(self.stands_for.iter().find(|of| of.name == function)?.arguments(self.domain))
    }

    /// The degree of its polynomials. A column more than their coefficients gives the local coordinate, with octaves
    /// two; constants need none.
    pub fn degree(&self) -> usize {
        let count = self.columns.len();
        if count == 1 { 0 } else { count - 2 - usize::from(self.octaves) }
    }
}

/// A table that is read at the index of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lookup {
    /// The value whose data operand gives the index; its number format is that of -1 .. 1.
    pub argument: ValueId,
    /// Index into [`Functions::tables`].
    pub table: u32,
    /// Index into [`Table::stands_for`] of the function that it is a lookup of, if the table is shared.
    pub function: Option<u32>,
}

impl Functions {
    /// The function that a lookup is one of, if it shares its table.
    pub fn shared(&self, lookup: Lookup) -> Option<&Scaled> {
        Some(&self.tables[index::at(lookup.table)].stands_for[index::at(lookup.function?)])
    }

    /// What messages call the function of a lookup, and the arguments that its table covers.
    pub fn looked_up(&self, lookup: Lookup) -> (&str, (f64, f64)) {
        let table = &self.tables[index::at(lookup.table)];
        self.shared(lookup).map_or((&table.name, table.domain), |of| (&of.name, of.arguments(table.domain)))
    }
}

impl Segments {
    /// Number of segments.
    pub fn count(self) -> usize {
        1 << self.index_bits
    }

    /// The segment of a data operand of `data_bits` bits. `octaves` as in [`Table::octaves`]: a leading one in bit
    /// `data_bits - 2` is octave 0; the last octave takes all numbers below it, and has no leading one; a negative
    /// operand counts as 0.
    pub fn index(self, operand: i64, data_bits: u32, octaves: bool) -> usize {
        if !octaves {
            return ((operand >> (data_bits - self.index_bits)) + (1 << (self.index_bits - 1))) as usize;
        }
        let (magnitude, width) = (operand.max(0), data_bits - 1);
        let mantissa_bits = self.index_bits - self.octave_bits;
        let last = (1u32 << self.octave_bits) - 1;
        let zeros = (magnitude as u64).leading_zeros() - (64 - width);
        let octave = zeros.min(last);
        // The bits behind the leading one, or, in the last octave, behind its place.
        let below = width - octave - u32::from(octave < last);
        let mantissa = (magnitude << mantissa_bits >> below) & ((1 << mantissa_bits) - 1);
        (index::at(octave) << mantissa_bits) | mantissa as usize
    }

    /// The segment of a number from -1 to 1; numbers outside belong to the nearest one.
    pub fn index_of(self, number: f64, octaves: bool) -> usize {
        const BITS: u32 = 53;
        const SCALE: f64 = (1u64 << (BITS - 1)) as f64;
        let scaled = (number * SCALE).clamp(-SCALE, SCALE - 1.0);
        // Rounded towards zero, then down.
        let whole = scaled as i64;
        self.index(whole - i64::from(whole as f64 > scaled), BITS, octaves)
    }

    /// The range of numbers that have an index.
    pub fn range(self, index: usize, octaves: bool) -> (f64, f64) {
        if !octaves {
            let width = libm::scalbn(2.0, -(self.index_bits as i32));
            return (index as f64 * width - 1.0, (index + 1) as f64 * width - 1.0);
        }
        let mantissa_bits = self.index_bits - self.octave_bits;
        let (octave, mantissa) = (index >> mantissa_bits, index & ((1 << mantissa_bits) - 1));
        let last = (1usize << self.octave_bits) - 1;
        let width = libm::scalbn(1.0, -(octave as i32) - mantissa_bits as i32 - i32::from(octave < last));
        let start = if octave < last { libm::scalbn(1.0, -(octave as i32) - 1) } else { 0.0 };
        (start + mantissa as f64 * width, start + (mantissa + 1) as f64 * width)
    }
}

#[cfg(test)]
mod tests {
    use crate::index::StateId;

    use super::*;
    use crate::expr::Function;

    fn of(body: Expr) -> ScalarFunction {
        ScalarFunction { name: String::new(), body, variable: Variable::State(StateId::new(0)) }
    }

    #[test]
    fn removable_singularities_have_a_value_and_others_none() {
        let x = || Expr::Variable(Variable::State(StateId::new(0)));
        let over = |above: Expr, below: Expr| {
            of(Expr::product(vec![above, Expr::Apply(Function::Reciprocal, Box::new(below))]))
        };
        let apply = |function, argument| Expr::Apply(function, Box::new(argument));
        let rate = |centre: f64| {
            let moved = Expr::sum(vec![x(), Expr::Constant(-centre)]);
            let fallen = apply(Function::Exp, Expr::scaled(-0.1, moved.clone()));
            over(moved, Expr::sum(vec![Expr::Constant(1.0), Expr::scaled(-1.0, fallen)]))
        };
        for centre in [0.0, -40.0, 3e-3, 7e4] {
            let value = rate(centre).evaluate(centre);
            assert!((value - 10.0).abs() < 1e-7, "{centre}: {value}");
        }
        let sinc = over(apply(Function::Sin, x()), x());
        assert!((sinc.evaluate(0.0) - 1.0).abs() < 1e-8, "{}", sinc.evaluate(0.0));
        for pole in [over(Expr::Constant(1.0), x()), over(Expr::Constant(1.0), Expr::power(x(), 2))] {
            assert!(!pole.evaluate(0.0).is_finite());
        }
        let jump = over(apply(Function::Abs, x()), x());
        assert!(!jump.evaluate(0.0).is_finite());
        assert!(!of(apply(Function::Log, x())).evaluate(0.0).is_finite());
    }

    #[test]
    fn segments_follow_one_another_and_agree_with_their_ranges() {
        for (segments, octaves) in [
            (Segments { index_bits: 1, octave_bits: 0 }, false),
            (Segments { index_bits: 5, octave_bits: 0 }, false),
            (Segments { index_bits: 5, octave_bits: 3 }, true),
            (Segments { index_bits: 3, octave_bits: 3 }, true),
        ] {
            let mut seen = vec![0; segments.count()];
            for operand in -512i64..512 {
                let index = segments.index(operand, 10, octaves);
                seen[index] += 1;
                let number = operand as f64 / 512.0;
                assert_eq!(segments.index_of(number, octaves), index, "{number} in {segments:?}");
                let (low, high) = segments.range(index, octaves);
                assert!((low..high).contains(&number) || (octaves && number < 0.0), "{number}: {low} .. {high}");
            }
            assert!(octaves || seen.iter().all(|count| *count > 0), "{segments:?}: {seen:?}");
        }
    }
}
