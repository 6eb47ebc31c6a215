//! States that are the past of a value: at the end of the step each of them is what another one was at its beginning.
//!
//! Where one state follows another there is no chain: all that follow one another, and those that the first of them has beside
//! it, are words of a *ring*, which moves on with every step. The first one, the head, is what a chain writes.

use crate::graph::{Role, StepGraph};
use crate::index::{List, StateId};

/// Where a state is in a ring.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Past {
    /// The state whose end value the ring takes in every step.
    pub head: StateId,
    /// How many steps ago what the state holds was written; 1 for the head.
    pub age: u32,
}

/// All states that are in rings.
#[derive(Clone, Debug)]
pub struct Pasts {
    of: List<StateId, Option<Past>>,
    /// The largest age in the ring of each head, else zero.
    oldest: List<StateId, u32>,
}

impl Pasts {
    /// Those of a step. States that follow one another in a circle are in no ring.
    pub fn of(graph: &StepGraph) -> Pasts {
        let mut pasts =
            Pasts { of: List::filled(None, graph.states.len()), oldest: List::filled(0, graph.states.len()) };
        let followed = |state: StateId| match graph.value(graph.states[state].1).role {
            Role::State(other) => Some(other),
            _ => None,
        };
        for state in graph.states.ids() {
            let mut way = vec![state];
            while let Some(next) = followed(way[way.len() - 1]) {
                if pasts.of[next].is_some() || way.len() > graph.states.len() {
                    way.push(next);
                    break;
                }
                way.push(next);
            }
            let last = way[way.len() - 1];
            if way.len() == 1 || way.len() > graph.states.len() {
                continue;
            }
            let known = pasts.of[last].unwrap_or(Past { head: last, age: 1 });
            for (age, state) in (known.age..).zip(way.into_iter().rev()) {
                pasts.of[state] = Some(Past { age, ..known });
                pasts.oldest[known.head] = pasts.oldest[known.head].max(age);
            }
        }
        pasts
    }

    /// Where a state is in a ring, if it is.
    pub fn find(&self, state: StateId) -> Option<Past> {
        self.of[state]
    }

    /// Whether there are no rings.
    pub fn is_empty(&self) -> bool {
        self.heads().next().is_none()
    }

    /// Heads with the largest age of their rings.
    pub fn heads(&self) -> impl Iterator<Item = (StateId, u32)> + '_ {
        self.oldest.numbered().filter(|(_, oldest)| **oldest > 0).map(|(head, oldest)| (head, *oldest))
    }

    /// States that are in rings.
    pub fn members(&self) -> impl Iterator<Item = (StateId, Past)> + '_ {
        self.of.numbered().filter_map(|(state, past)| Some((state, (*past)?)))
    }
}
