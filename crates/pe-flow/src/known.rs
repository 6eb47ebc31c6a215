//! Mappings and schedules that designs of a command have in common.
//!
//! Neither depends on the numbers of a step: points of a sweep that differ in the step, or in words of the same latency, often
//! have the same. What is kept is found by all that it depends on, so sharing changes no result.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use pe_hls::mapping::{self, Candidate, MapError, MapOptions};
use pe_hls::schedule;
use pe_ir::graph::StepGraph;
use pe_ir::mapping::Mapping;
use pe_ir::schedule::Schedule;
use pe_ir::word::Latency;

/// Equations and terms that all questions which are kept have together, at most.
const MOST_KEPT: usize = 1 << 22;

/// What is known so far.
#[derive(Default)]
pub struct Known {
    mappings: Answers<(mapping::Problem, MapOptions), Result<Vec<Candidate>, MapError>>,
    schedules: Answers<(schedule::Problem, bool), Schedule>,
}

impl Known {
    /// The mappings of [`mapping::annealed`].
    pub(crate) fn annealed(
        &self,
        problem: &mapping::Problem,
        options: &MapOptions,
    ) -> Result<Vec<Candidate>, MapError> {
        let size = problem.loads().len();
        let find = |(problem, options): &(mapping::Problem, MapOptions)| mapping::annealed(problem, options);
        self.mappings.get((problem.clone(), *options), size, find)
    }

    /// The schedule of a mapped step graph, or a first one.
    pub(crate) fn schedule(&self, graph: &StepGraph, mapping: &Mapping, latency: Latency, draft: bool) -> Schedule {
        let problem = schedule::Problem::new(graph, mapping, latency);
        let find =
            |(problem, draft): &(schedule::Problem, bool)| if *draft { problem.draft() } else { problem.schedule() };
        self.schedules.get((problem, draft), graph.terms.len(), find)
    }
}

/// Answers to questions that were asked before.
struct Answers<Q, A>(Mutex<Asked<Q, A>>);

struct Asked<Q, A> {
    answers: HashMap<Arc<Q>, Arc<OnceLock<A>>>,
    /// Of all questions together.
    size: usize,
}

impl<Q, A> Default for Answers<Q, A> {
    fn default() -> Answers<Q, A> {
        Answers(Mutex::new(Asked { answers: HashMap::new(), size: 0 }))
    }
}

impl<Q: Eq + Hash, A: Clone> Answers<Q, A> {
    /// The answer to a question of such a size. Who asks what another thread is about to find waits for it.
    fn get(&self, question: Q, size: usize, find: impl FnOnce(&Q) -> A) -> A {
        let question = Arc::new(question);
        let answer = {
            let Asked { answers, size: all } = &mut *self.0.lock().unwrap_or_else(PoisonError::into_inner);
            let kept = answers.get(&question).map(Arc::clone);
            kept.or_else(|| {
                *all = all.checked_add(size).filter(|all| *all <= MOST_KEPT)?;
                Some(Arc::clone(answers.entry(Arc::clone(&question)).or_default()))
            })
        };
        match answer {
            Some(answer) => answer.get_or_init(|| find(&question)).clone(),
            None => find(&question),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn a_question_is_asked_once_and_large_ones_are_not_kept() {
        let answers: Answers<u32, u32> = Answers::default();
        let asked = AtomicUsize::new(0);
        let find = |question: &u32| {
            asked.fetch_add(1, Ordering::Relaxed);
            question * question
        };
        let all = [3, 4, 3, 4, 3].map(|question| answers.get(question, 1, find));
        assert_eq!((all, asked.load(Ordering::Relaxed)), ([9, 16, 9, 16, 9], 2));
        let large = [5, 5, 3].map(|question| answers.get(question, MOST_KEPT, find));
        assert_eq!((large, asked.load(Ordering::Relaxed)), ([25, 25, 9], 4));
    }
}
