//! Closures that cannot all hold: what is said where Newton's iteration from the initial values closes no loops.
//!
//! Other positions are tried, near and far. Where one of them leads to closed loops, initial values are to blame; where none does, the
//! closures are, and each of those that stay open is left out in turn.

use super::consistent::Start;
use pe_ir::closing::{Openings, anywhere};
use pe_ir::codes;
use pe_ir::index::StateId;
use pe_ir::source::Diagnostic;

/// Part of the closure that stays open most, above which another one stays open as well.
const ALSO: f64 = 0.1;

/// Closures that a finding names.
const NAMED: usize = 4;

impl Start<'_> {
    /// The finding about closures that Newton's iteration does not close from where they are given, in the words of the iteration.
    pub(super) fn unclosed(&self, given: &[f64], message: String) -> Box<Diagnostic> {
        let near = match self.anywhere(given, None) {
            Ok(near) => near,
            Err(open) => return self.contradicts(given, &open),
        };
        let coordinates: Vec<StateId> = self.mechanism.pairs.iter().map(|pair| pair.0).collect();
        let help = format!(
            "give coordinates that close the loops, or make lengths follow from the position, as parameters; loops are closed at {}",
            self.list(&coordinates, &near)
        );
        self.refused(codes::INCONSISTENT_START, message, help)
    }

    /// The finding about closures that stay open wherever it is tried, `open` at least.
    fn contradicts(&self, given: &[f64], open: &[f64]) -> Box<Diagnostic> {
        let most = open.iter().fold(0.0f64, |most, open| most.max(open.abs()));
        let mut rows: Vec<usize> = (0..open.len()).filter(|row| open[*row].abs() > ALSO * most).collect();
        rows.sort_by(|one, other| open[*other].abs().total_cmp(&open[*one].abs()));
        let named: Vec<String> =
            rows.iter().take(NAMED).map(|row| format!("{} {:.3e}", self.closure(*row), open[*row])).collect();
        let more = if rows.len() > NAMED { format!(" and {} more", rows.len() - NAMED) } else { String::new() };
        let message = format!(
            "closures contradict each other where it starts: no position was found that closes all of them; {}{more} stay open",
            named.join(", ")
        );
        // Of those that stay open alike the last one is likelier to be too much.
        let mut tried: Vec<usize> = (0..open.len()).rev().filter(|row| rows.contains(row)).collect();
        tried.truncate(NAMED);
        let help = match tried.into_iter().find(|row| self.anywhere(given, Some(*row)).is_ok()) {
            Some(row) => format!("leave out closure {}: the others can be closed (tried)", self.closure(row)),
            None => "none of them alone is too much: look at lengths and signs, and leave out what others hold already"
                .to_owned(),
        };
        self.refused(codes::CONTRADICTION, message, help)
    }

    /// States at which all closures but one hold, from the given ones or others; else how far they stay open where they are
    /// open least.
    fn anywhere(&self, given: &[f64], without: Option<usize>) -> Result<Vec<f64>, Vec<f64>> {
        let (size, sizes) = (self.size(), &self.sizes.0);
        let moved = |position: &[f64]| {
            let by: Vec<f64> = position.iter().zip(sizes).map(|(part, size)| part * size).collect();
            self.moved(given, false, 1.0, &by)
        };
        let openings = |position: &[f64]| {
            let mut numbers = self.at(&moved(position));
            if let Some(row) = without {
                numbers.gaps[row] = 0.0;
                numbers.jacobian[row * size..(row + 1) * size].fill(0.0);
            }
            let levers =
                numbers.jacobian.iter().enumerate().map(|(place, lever)| lever * sizes[place % size]).collect();
            Openings { levers, gaps: numbers.gaps }
        };
        anywhere(&[vec![0.0; size]], &openings).map(|position| moved(&position))
    }
}
