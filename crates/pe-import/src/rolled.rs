//! Equations and sums that differ in their subscripts only, written once with an index.
//!
//! Subscripts that are numbers stand between marks in texts, so that they can be found again.

const OPEN: char = '\u{1}';
const CLOSE: char = '\u{2}';

/// Fewest equations or terms that are written as one.
const FEWEST: usize = 3;

/// A subscript with marks.
pub(crate) fn marked(subscript: usize) -> String {
    format!("{OPEN}{subscript}{CLOSE}")
}

/// A text without marks.
pub(crate) fn plain(text: &str) -> String {
    text.replace([OPEN, CLOSE], "")
}

/// A text, taken apart into what stands between subscripts and these.
struct Parts<'t> {
    texts: Vec<&'t str>,
    subscripts: Vec<usize>,
}

impl<'t> Parts<'t> {
    fn of(text: &'t str) -> Parts<'t> {
        let mut parts = Parts { texts: Vec::new(), subscripts: Vec::new() };
        for (index, piece) in text.split([OPEN, CLOSE]).enumerate() {
            match piece.parse() {
                Ok(subscript) if index % 2 == 1 => parts.subscripts.push(subscript),
                _ => parts.texts.push(piece),
            }
        }
        parts
    }

    /// Which subscripts grow by one from this text to the next; none if the texts differ in other ways.
    fn moves(&self, next: &Parts) -> Option<Vec<bool>> {
        if self.texts != next.texts {
            return None;
        }
        let pairs = self.subscripts.iter().zip(&next.subscripts);
        pairs.map(|(own, next)| next.checked_sub(*own).filter(|by| *by <= 1).map(|by| by == 1)).collect()
    }

    /// The text with an index in the place of what moves; the index is `start` here.
    fn with_index(&self, moves: &[bool], index: &str, start: usize) -> String {
        let mut text = self.texts[0].to_owned();
        for ((subscript, moves), after) in self.subscripts.iter().zip(moves).zip(&self.texts[1..]) {
            text += &match (moves, subscript.checked_sub(start)) {
                (false, _) => marked(*subscript),
                (true, Some(0)) => index.to_owned(),
                (true, Some(above)) => format!("{index}+{above}"),
                (true, None) => format!("{index}-{}", start - subscript),
            };
            text += after;
        }
        text
    }
}

/// How many of the texts from the first on go on alike, and what moves in them.
fn run(parts: &[Parts]) -> (usize, Vec<bool>) {
    let Some(moves) = parts.get(1).and_then(|next| parts[0].moves(next)) else { return (1, Vec::new()) };
    let more = parts.windows(2).take_while(|pair| pair[0].moves(&pair[1]).is_some_and(|own| own == moves));
    (1 + more.count(), moves)
}

/// Equations, those in a row that differ in a subscript only as one with a range.
pub(crate) fn rules_of(rules: &[String], index: &str) -> Vec<String> {
    let parts: Vec<Parts> = rules.iter().map(|rule| Parts::of(rule)).collect();
    let mut lines = Vec::new();
    let mut at = 0;
    while at < parts.len() {
        let (count, moves) = run(&parts[at..]);
        // The range is that of the last subscript on the left-hand side.
        let left = parts[at].texts.iter().take_while(|text| !text.contains('=')).count();
        let start = left.checked_sub(1).and_then(|last| parts[at].subscripts.get(last)).copied();
        match start.filter(|_| count >= FEWEST && moves[left - 1] && !moves[..left - 1].contains(&true)) {
            Some(start) => {
                let text = plain(&parts[at].with_index(&moves, index, start));
                lines.push(format!("{text} for {index} in {start}..{}", start + count - 1));
                at += count;
            }
            None => {
                lines.push(plain(&rules[at]));
                at += 1;
            }
        }
    }
    lines
}

/// Terms with their signs, those in a row that differ in a subscript only as one sum.
pub(crate) fn sum_of(terms: Vec<(bool, String)>, index: &str) -> Vec<(bool, String)> {
    if terms.len() <= FEWEST {
        return terms;
    }
    let parts: Vec<Parts> = terms.iter().map(|(_, term)| Parts::of(term)).collect();
    let mut joined = Vec::new();
    let mut at = 0;
    while at < terms.len() {
        let same = terms[at..].iter().take_while(|(negative, _)| *negative == terms[at].0).count();
        let (count, moves) = run(&parts[at..at + same]);
        let first = moves.iter().position(|moves| *moves).map(|first| parts[at].subscripts[first]);
        match first.filter(|_| count > FEWEST && !terms[at].1.contains(" in ")) {
            Some(start) => {
                let term = parts[at].with_index(&moves, index, start);
                let range = format!("{}..{}", marked(start), marked(start + count - 1));
                joined.push((terms[at].0, format!("sum({index} in {range}: {term})")));
                at += count;
            }
            None => {
                joined.push(terms[at].clone());
                at += 1;
            }
        }
    }
    joined
}

#[cfg(test)]
mod tests {
    use super::*;

    fn x(name: &str, at: &[usize]) -> String {
        crate::names::element(name, at, marked)
    }

    #[test]
    fn rows_that_go_on_alike_become_one() {
        let rule = |row: usize| format!("{}' = {} - {}", x("c", &[row]), x("c", &[row + 1]), x("b", &[0]));
        let rules: Vec<String> = (2..6).map(rule).chain([format!("{}' = 1", x("c", &[6]))]).collect();
        assert_eq!(rules_of(&rules, "i"), ["c[i]' = c[i+1] - b[0] for i in 2..5", "c[6]' = 1"]);
        // Two stay two, and so do those that differ in a number.
        assert_eq!(rules_of(&rules[..2], "i"), ["c[2]' = c[3] - b[0]", "c[3]' = c[4] - b[0]"]);
        let others: Vec<String> = (0..3).map(|row| format!("{} = {row}", x("c", &[row]))).collect();
        assert_eq!(rules_of(&others, "i"), ["c[0] = 0", "c[1] = 1", "c[2] = 2"]);
    }

    #[test]
    fn terms_of_a_row_become_a_sum_that_rows_share() {
        let row = |row: usize| {
            let terms = (0..5).map(|column| (false, format!("{}*{}", x("A", &[row, column]), x("u", &[column]))));
            let terms = sum_of(terms.collect(), "j");
            assert_eq!(terms.len(), 1);
            format!("{} = {}", x("v", &[row]), terms[0].1)
        };
        let rules: Vec<String> = (0..4).map(row).collect();
        assert_eq!(rules_of(&rules, "i"), ["v[i] = sum(j in 0..4: A[i,j]*u[j]) for i in 0..3"]);
        // A window that moves with the row.
        let window = |row: usize| {
            let terms = (row..row + 4).map(|column| (true, x("u", &[column]))).collect();
            let terms = sum_of(terms, "j");
            format!("{} = -{}", x("v", &[row]), terms[0].1)
        };
        let rules: Vec<String> = (0..4).map(window).collect();
        assert_eq!(rules_of(&rules, "i"), ["v[i] = -sum(j in i..i+3: u[j]) for i in 0..3"]);
    }
}
