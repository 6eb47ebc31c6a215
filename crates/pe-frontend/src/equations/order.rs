//! The pass that finds the dependency order of the algebraic equations, and the loops that prevent one.

use crate::equations::write::{Flat, Row};
use crate::evaluate::signals::SIGNALS;
use crate::names::table::Names;
use crate::report::Report;
use pe_ir::codes;
use pe_ir::index::{at, number};
use pe_ir::model::Variable;
use pe_ir::source::{Diagnostic, Span};

/// Members of a loop that are shown; the rest is left to dots.
const SHOWN: usize = 8;

/// Where the walk stands with an equation.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Mark {
    New,
    Open,
    Done,
}

/// The algebraic equations in an order in which each reads only earlier ones, in source order as far as possible.
/// Loops are reported and give `None`.
pub(crate) fn dependency_order(flat: &Flat, names: &Names, report: &mut Report) -> Option<Vec<u32>> {
    let (starts, reads) = reads_of(&flat.algebraics);
    let count = flat.algebraics.len();
    let mut marks = vec![Mark::New; count];
    let mut order = Vec::with_capacity(count);
    // Equation and next of its reads to look at. A stack of our own: chains can be as long as arrays.
    let mut path: Vec<(usize, usize)> = Vec::new();
    // Loops through the same equations of the spec are one finding.
    let mut seen: Vec<Vec<Span>> = Vec::new();
    for root in 0..count {
        if marks[root] != Mark::New || flat.algebraics[root].is_none() {
            continue;
        }
        marks[root] = Mark::Open;
        path.push((root, starts[root]));
        while let Some((equation, next)) = path.last_mut() {
            if *next == starts[*equation + 1] {
                marks[*equation] = Mark::Done;
                order.push(number(*equation));
                path.pop();
                continue;
            }
            let read = at(reads[*next]);
            *next += 1;
            match marks[read] {
                Mark::New => {
                    marks[read] = Mark::Open;
                    path.push((read, starts[read]));
                }
                Mark::Open => {
                    let cycle: Vec<usize> =
                        path.iter().map(|(equation, _)| *equation).skip_while(|open| *open != read).collect();
                    if let Some(finding) = loop_finding(flat, &cycle, &mut seen, names) {
                        report.push(finding);
                    }
                }
                Mark::Done => {}
            }
        }
    }
    seen.is_empty().then_some(order)
}

/// The finding about a loop, once for each set of places.
fn loop_finding(flat: &Flat, cycle: &[usize], seen: &mut Vec<Vec<Span>>, names: &Names) -> Option<Diagnostic> {
    let rows: Vec<&Row> = cycle.iter().filter_map(|equation| flat.algebraics[*equation].as_ref()).collect();
    let mut places: Vec<Span> = rows.iter().map(|row| row.span).collect();
    places.sort_unstable();
    places.dedup();
    if rows.is_empty() || seen.contains(&places) {
        return None;
    }
    seen.push(places);
    let name = |row: &Row| names.quantities[row.quantity].name_at(row.offset);
    let mut shown: Vec<String> = rows.iter().take(SHOWN).map(|row| format!("`{}`", name(row))).collect();
    if rows.len() > SHOWN {
        shown.push(format!("... ({} equations)", rows.len()));
    }
    shown.push(format!("`{}`", name(rows[0])));
    let message = format!("algebraic loop: {}", shown.join(" reads "));
    let mut error = Diagnostic::error(codes::ALGEBRAIC_LOOP, rows[0].span, message)
        .with_help("break it: solve the equations by hand, or make one quantity a state");
    for (place, row) in rows.iter().take(SHOWN).enumerate() {
        let next = rows[(place + 1) % rows.len()];
        error = error.with_label(row.span, format!("`{}` reads `{}`", name(row), name(next)));
    }
    Some(error)
}

/// The algebraic equations that each one reads: those of equation `i` are `reads[starts[i]..starts[i + 1]]`.
fn reads_of(rows: &[Option<Row>]) -> (Vec<usize>, Vec<u32>) {
    let mut starts = vec![0];
    let mut reads = Vec::new();
    for row in rows {
        if let Some(row) = row {
            row.expr.each_variable(&mut |variable| {
                if let Variable::Algebraic(read) = variable
                    && read < SIGNALS
                {
                    reads.push(read);
                }
            });
        }
        starts.push(reads.len());
    }
    (starts, reads)
}
