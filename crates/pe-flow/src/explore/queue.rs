//! Tasks that bring forth others, taken by several threads in an order of their own.

use std::collections::BTreeMap;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Tasks that wait: the smallest level first, of a level the cheapest first, of equally cheap ones the oldest.
pub struct Queue<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
}

struct State<T> {
    waiting: BTreeMap<(u8, u64, u64), T>,
    /// Tasks that were taken and may still bring forth others.
    running: usize,
    added: u64,
}

/// A task that was taken; it is done when this is dropped, also by a panic.
struct Taken<'q, T>(&'q Queue<T>);

impl<T> Drop for Taken<'_, T> {
    fn drop(&mut self) {
        self.0.lock().running -= 1;
        self.0.changed.notify_all();
    }
}

impl<T> Default for Queue<T> {
    fn default() -> Queue<T> {
        let state = State { waiting: BTreeMap::new(), running: 0, added: 0 };
        Queue { state: Mutex::new(state), changed: Condvar::new() }
    }
}

impl<T> Queue<T> {
    /// Adds a task of a level that costs so many seconds.
    pub fn add(&self, level: u8, seconds: f64, task: T) {
        let mut state = self.lock();
        let key = (level, seconds.max(0.0).to_bits(), state.added);
        state.added += 1;
        state.waiting.insert(key, task);
        drop(state);
        self.changed.notify_all();
    }

    /// Does tasks until none is left and none is under way that could add any, or until some time: then none is begun.
    pub fn work(&self, until: Option<Instant>, run: impl Fn(T)) {
        while let Some(task) = self.take(until) {
            let _taken = Taken(self);
            run(task);
        }
    }

    fn take(&self, until: Option<Instant>) -> Option<T> {
        let mut state = self.lock();
        loop {
            if until.is_some_and(|until| Instant::now() >= until) {
                return None;
            }
            if let Some((_, task)) = state.waiting.pop_first() {
                state.running += 1;
                return Some(task);
            }
            if state.running == 0 {
                return None;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tasks_that_tasks_add_are_done_before_others_and_the_cheapest_first() {
        let queue = Queue::default();
        queue.add(1, 2.0, "dear");
        queue.add(1, 0.5, "cheap");
        let order = Mutex::new(Vec::new());
        queue.work(None, |task| {
            order.lock().unwrap().push(task);
            if task == "cheap" {
                queue.add(0, 9.0, "child");
            }
        });
        assert_eq!(*order.lock().unwrap(), ["cheap", "child", "dear"]);
        queue.add(0, 0.0, "late");
        queue.work(Some(Instant::now()), |_| panic!("it is too late"));
    }

    #[test]
    fn several_threads_wait_for_what_others_may_add() {
        let queue = Queue::default();
        queue.add(0, 0.0, 10u32);
        let done = Mutex::new(0);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    queue.work(None, |count| {
                        *done.lock().unwrap() += 1;
                        (count > 0).then(|| [0, 1].map(|_| queue.add(0, f64::from(count), count - 1)));
                    });
                });
            }
        });
        assert_eq!(*done.lock().unwrap(), 2047);
    }
}
