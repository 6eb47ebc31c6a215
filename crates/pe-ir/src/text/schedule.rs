//! The schedule: the first control word of each chain, and the receive of each transfer.

use crate::graph::StepGraph;
use crate::index::{List, at};
use crate::schedule::{Schedule, Transfer};

use super::labels::Labels;
use super::{Section, Stage, TextError};

/// The section of the schedule of a step graph.
pub fn print(graph: &StepGraph, schedule: &Schedule) -> String {
    let labels = Labels::of_values(graph);
    let mut text = format!("{}\nperiod {}\n", Stage::Schedule.header(), schedule.period);
    for (chain, start) in graph.chains.iter().zip(&schedule.starts) {
        text += &format!("chain {} start {start}", labels.chain(chain));
        let order = &schedule.order[at(chain.terms.start)..chain.terms.end as usize];
        if order.iter().copied().ne(chain.terms.clone()) {
            text += " order";
            order.iter().for_each(|term| text += &format!(" {}", i64::from(*term) - i64::from(chain.terms.start)));
        }
        text.push('\n');
    }
    for Transfer { value, to, receive } in &schedule.transfers {
        text += &format!("transfer {} to {to} receive {receive}\n", labels.value(*value));
    }
    text
}

/// Reads the section of the schedule of a step graph that is mapped to so many PEs.
///
/// # Errors
/// An item is not one of a schedule, or they do not fit the step graph.
pub fn read(section: &Section, graph: &StepGraph, pes: u32) -> Result<Schedule, TextError> {
    let labels = Labels::of_values(graph);
    let mut lines = section.lines();
    let mut line = lines.next().ok_or_else(|| section.error("there is no item `period`"))?;
    let period: u32 = line.keyed("period")?;
    if !(1..=1 << 24).contains(&period) {
        return Err(line.error("expected a number of control words, at least one"));
    }
    line.done()?;
    let mut schedule = Schedule { period, starts: List::new(), order: Vec::new(), transfers: Vec::new() };
    for chain in &graph.chains {
        let mut line = labels.line_of(chain, "time", &mut lines)?;
        let start = line.keyed("start")?;
        if start >= period {
            return Err(line.error("expected a control word within the period"));
        }
        schedule.starts.push(start);
        if line.take_word("order") {
            let mut seen = vec![false; at(chain.len())];
            for _ in chain.terms.clone() {
                let term: u32 = line.integer()?;
                match seen.get_mut(at(term)) {
                    Some(seen) if !*seen => *seen = true,
                    _ => return Err(line.error("expected each term of the chain once, counted from 0")),
                }
                schedule.order.push(chain.terms.start + term);
            }
        } else {
            schedule.order.extend(chain.terms.clone());
        }
        line.done()?;
    }
    for mut line in lines {
        line.word("transfer")?;
        let value = labels.read_value(&mut line)?;
        let transfer = Transfer { value, to: line.keyed("to")?, receive: line.keyed("receive")? };
        if schedule.transfers.last().is_some_and(|last| *last >= transfer) {
            return Err(line.error("expected transfers in the order of values, PEs and times, each once"));
        }
        if transfer.to.number() >= pes {
            return Err(line.error(format!("expected one of {pes} PEs")));
        }
        if u64::from(transfer.receive) >= 2 * u64::from(period) {
            return Err(line.error("expected a control word of this step or the next"));
        }
        line.done()?;
        schedule.transfers.push(transfer);
    }
    Ok(schedule)
}
