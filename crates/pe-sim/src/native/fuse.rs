//! Loops within loops: a row that only the same lanes of later loops read is computed there, and never stored.

use std::collections::BTreeSet;

use super::loops::{Base, Factor, Loop, Memory, Place, Sum};

/// Lanes that may be computed at most where a loop goes to several others, in quarters of its own.
const MOST_LANES: usize = 5;

/// Puts loops, which are in the order of their levels, into those that read what they write, but for `needed` rows.
pub(super) fn fuse(loops: &mut Vec<Loop>, memory: &Memory, needed: &BTreeSet<usize>) {
    let mut gone = BTreeSet::new();
    for index in 0..loops.len() {
        let Some((first, row)) = only_target(&loops[index]).filter(|(_, row)| !needed.contains(row)) else { continue };
        let Some(readers) = readers(loops, (index, first, row), memory) else { continue };
        for (reader, start) in &readers {
            let inner = part(&loops[index], *start, loops[*reader].lanes);
            let place = Place::Row(first + *start as i64, row);
            put_before(&mut loops[*reader], inner, place);
        }
        if !readers.is_empty() {
            gone.insert(index);
        }
    }
    let mut index = 0..;
    loops.retain(|_| index.next().is_none_or(|index| !gone.contains(&index)));
}

/// The only row that a loop writes, if it is one that nothing else needs at another time.
fn only_target(one: &Loop) -> Option<(i64, usize)> {
    let mut targets = one.sums.iter().flat_map(|sum| &sum.writes).filter_map(|write| write.target);
    match (targets.next(), targets.next()) {
        (Some(Place::Row(first, row)), None) => Some((first, row)),
        _ => None,
    }
}

/// The loops that read what a loop writes, and from which of its lanes on; none if it cannot go there.
fn readers(loops: &[Loop], (index, first, row): (usize, i64, usize), memory: &Memory) -> Option<Vec<(usize, usize)>> {
    let one = &loops[index];
    memory.rows[row].until?;
    let mut readers = Vec::new();
    for (number, reader) in loops.iter().enumerate() {
        let lanes = reader.lanes as i64;
        let mut from = read(reader).filter_map(|place| match place {
            Place::Row(from, of) if of == row && from < first + one.lanes as i64 && first < from + lanes => Some(from),
            _ => None,
        });
        let Some(start) = from.next() else { continue };
        let within = first <= start && start + lanes <= first + one.lanes as i64;
        let at_once = from.all(|other| other == start);
        // What the loop reads has to be there later, and apart from what is written then.
        let kept = read(one).all(|place| match place {
            Place::Row(_, of) => memory.rows[of].until.is_none_or(|until| reader.level <= until),
            Place::Same(..) | Place::Earlier(_) => true,
        });
        let inner = part(one, (start - first).max(0) as usize, reader.lanes);
        if number <= index || !within || !at_once || !kept || !apart(&inner, reader, memory) {
            return None;
        }
        readers.push((number, (start - first) as usize));
    }
    let lanes: usize = readers.iter().map(|(reader, _)| loops[*reader].lanes).sum();
    (lanes * 4 <= one.lanes * MOST_LANES).then_some(readers)
}

/// Everything that a loop reads but numbers.
fn read(one: &Loop) -> impl Iterator<Item = Place> + '_ {
    let of_products = one.sums.iter().flat_map(|sum| &sum.products).flat_map(|(operand, factor)| {
        let factor = match factor {
            Factor::Value(place) => Some(*place),
            Factor::Numbers(_) => None,
        };
        [Some(*operand), factor].into_iter().flatten()
    });
    let of_writes = one.sums.iter().flat_map(|sum| &sum.writes).filter_map(|write| match &write.base {
        Base::Value(place) => Some(*place),
        Base::None | Base::Numbers(_) => None,
    });
    of_products.chain(of_writes)
}

/// Whether no lane of a part reads what a lane of the other loop writes, in this step and the next.
fn apart(inner: &Loop, outer: &Loop, memory: &Memory) -> bool {
    let starts = |place: Place| match place {
        Place::Row(first, row) => Some(memory.rows[row].shift.map(|shift| first + shift)),
        Place::Same(..) | Place::Earlier(_) => None,
    };
    let targets = || outer.sums.iter().flat_map(|sum| &sum.writes).filter_map(|write| write.target).filter_map(starts);
    read(inner)
        .filter_map(starts)
        .all(|read| targets().all(|target| (0..2).all(|step| (read[step] - target[step]).abs() >= outer.lanes as i64)))
}

/// Some lanes of a loop.
fn part(one: &Loop, start: usize, lanes: usize) -> Loop {
    let place = |place: Place| match place {
        Place::Row(first, row) => Place::Row(first + start as i64, row),
        other => other,
    };
    let end = (start + lanes).min(one.lanes);
    let numbers = |numbers: &[Option<f64>]| numbers[start.min(end)..end].to_vec();
    let mut inner = Loop { level: one.level, lanes, sums: one.sums.clone(), free: Vec::new() };
    for sum in &mut inner.sums {
        for (operand, factor) in &mut sum.products {
            *operand = place(*operand);
            *factor = match factor {
                Factor::Value(value) => Factor::Value(place(*value)),
                Factor::Numbers(all) => Factor::Numbers(numbers(all)),
            };
        }
        for write in &mut sum.writes {
            write.target = write.target.map(place);
            write.base = match &write.base {
                Base::None => Base::None,
                Base::Value(value) => Base::Value(place(*value)),
                Base::Numbers(all) => Base::Numbers(numbers(all)),
            };
        }
    }
    inner
}

/// Puts the sums of a part in front of a loop's own, which read its result in the place of a row.
fn put_before(outer: &mut Loop, inner: Loop, result: Place) {
    let number = |sums: &[Sum]| sums.iter().map(|sum| sum.writes.len()).sum::<usize>();
    let before = number(&inner.sums);
    let mut written = None;
    let mut sums = inner.sums;
    for (index, write) in sums.iter_mut().flat_map(|sum| &mut sum.writes).enumerate() {
        if write.target.take().is_some() {
            written = Some(index);
        }
    }
    let written = written.expect("the loop writes its result");
    let place = |place: Place| match place {
        Place::Earlier(earlier) => Place::Earlier(earlier + before),
        place if place == result => Place::Earlier(written),
        other => other,
    };
    for sum in &mut outer.sums {
        for (operand, factor) in &mut sum.products {
            *operand = place(*operand);
            if let Factor::Value(value) = factor {
                *value = place(*value);
            }
        }
        for write in &mut sum.writes {
            if let Base::Value(value) = &mut write.base {
                *value = place(*value);
            }
        }
    }
    sums.append(&mut outer.sums);
    outer.sums = sums;
}
