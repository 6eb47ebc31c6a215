//! How far a judgement is, what is left of it, and what of that fits into a time.
//!
//! Work is counted in control words of all PEs: PEs times clocks. An engine takes a time to begin and one for each word; both
//! are those of its last run, and searches take what they took so far. Starts that are still to come are those that are made at most, or fewer where PEs are few.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use crate::child::Children;
use crate::engines::Engine;

/// Hears of a judgement while it is made.
pub trait Listener {
    /// A line of the result.
    fn say(&self, line: &str);
    /// What is at work, how many runs are over, and the seconds that are left, once something is known of them.
    fn at(&self, what: &str, over: usize, left: Option<f64>);
}

/// Nobody listens.
pub struct Nobody;

impl Listener for Nobody {
    fn say(&self, _: &str) {}
    fn at(&self, _: &str, _: usize, _: Option<f64>) {}
}

/// What takes time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Work {
    /// A run of an engine.
    Engine(usize),
    /// Finding a start.
    Search,
    /// Its run in the simulator.
    Simulator,
}

/// Seconds to begin, and of each control word.
#[derive(Clone, Copy, Debug, Default)]
struct Cost {
    begin: f64,
    word: f64,
}

impl Cost {
    fn of(self, words: u64) -> f64 {
        self.begin + self.word * words as f64
    }
}

/// Starts of a kind that are to come: how many, and the words of each.
#[derive(Clone, Copy, Debug)]
struct Planned {
    starts: u64,
    words: u64,
}

/// The run at work.
struct Current {
    what: String,
    begun: Instant,
    /// When its first line came.
    first: Option<Instant>,
    /// Its lines, at least, and its estimated seconds.
    lines: u64,
    estimated: Option<f64>,
}

#[derive(Default)]
struct State {
    costs: BTreeMap<Work, Cost>,
    planned: BTreeMap<&'static str, Planned>,
    current: Option<Current>,
    /// Searches so far.
    searches: f64,
    over: usize,
    left_out: Vec<String>,
}

/// The times of a judgement.
pub struct Pace<'a> {
    engines: Vec<Engine>,
    begun: Instant,
    within: Option<Duration>,
    listener: &'a dyn Listener,
    state: RefCell<State>,
}

impl<'a> Pace<'a> {
    /// At the beginning.
    pub fn new(engines: &[Engine], within: Option<Duration>, listener: &'a dyn Listener) -> Pace<'a> {
        Pace { engines: engines.to_vec(), begun: Instant::now(), within, listener, state: RefCell::default() }
    }

    /// Says a line of the result.
    pub fn say(&self, line: &str) {
        self.listener.say(line);
    }

    /// The time that was given, in seconds.
    pub fn within(&self) -> Option<f64> {
        self.within.map(|within| within.as_secs_f64())
    }

    /// Seconds since the beginning.
    fn elapsed(&self) -> f64 {
        self.begun.elapsed().as_secs_f64()
    }

    /// What engines keep to; `heard` passes on to [`Pace::heard`].
    pub fn children<'b>(&self, heard: &'b dyn Fn(u64)) -> Children<'b> {
        Children { until: self.within.map(|within| self.begun + within), heard: Some(heard) }
    }

    /// Says how many starts of a kind are to come at most, and the words of each.
    pub fn plan(&self, kind: &'static str, starts: u64, words: u64) {
        self.state.borrow_mut().planned.insert(kind, Planned { starts, words });
    }

    /// One start of a kind less is to come.
    pub fn begin(&self, kind: &'static str) {
        if let Some(planned) = self.state.borrow_mut().planned.get_mut(kind) {
            planned.starts = planned.starts.saturating_sub(1);
        }
    }

    /// No other start of a kind is to come.
    pub fn done(&self, kind: &'static str) {
        self.state.borrow_mut().planned.remove(kind);
    }

    /// Notes what has no time.
    pub fn leave_out(&self, what: String) {
        self.state.borrow_mut().left_out.push(what);
    }

    /// All that had no time.
    pub fn left_out(&self) -> Vec<String> {
        self.state.borrow().left_out.clone()
    }

    /// Whether the time is over.
    pub fn is_over(&self) -> bool {
        self.within.is_some_and(|within| self.begun.elapsed() >= within)
    }

    /// Whether a start with so many words is likely to end in time; nothing is known of the first one.
    pub fn fits(&self, words: u64) -> bool {
        let Some(within) = self.within() else { return true };
        let needed = self.state.borrow().start(&self.engines, words).unwrap_or(0.0);
        !self.is_over() && self.elapsed() + needed <= within
    }

    /// The most steps, of so many words each, that fit into half of the time that is left; none if not even one does.
    pub fn steps(&self, most: u64, words: u64) -> Option<u64> {
        let Some(within) = self.within() else { return Some(most) };
        if !self.fits(words) {
            return None;
        }
        let left = (within - self.elapsed()) / 2.0;
        let state = self.state.borrow();
        let (Some(one), Some(two)) = (state.start(&self.engines, words), state.start(&self.engines, 2 * words)) else {
            return Some(most);
        };
        let more = (left - one) / (two - one).max(f64::MIN_POSITIVE);
        Some(most.min(1 + more.clamp(0.0, 1e15) as u64))
    }

    /// Finds a start, and notes the time that this took.
    pub fn find<T>(&self, kind: &str, find: impl FnOnce() -> T) -> T {
        self.tell(kind);
        let begun = Instant::now();
        let found = find();
        let took = begun.elapsed().as_secs_f64();
        let mut state = self.state.borrow_mut();
        let (searches, before) = (state.searches, state.costs.get(&Work::Search).map_or(0.0, |cost| cost.begin));
        let mean = (searches * before + took) / (searches + 1.0);
        state.searches += 1.0;
        state.costs.insert(Work::Search, Cost { begin: mean, word: 0.0 });
        found
    }

    /// Runs a start in the simulator, and notes its time.
    pub fn simulate<T>(&self, words: u64, run: impl FnOnce() -> T) -> T {
        let begun = Instant::now();
        let result = run();
        let cost = Cost { begin: 0.0, word: begun.elapsed().as_secs_f64() / words.max(1) as f64 };
        self.state.borrow_mut().costs.insert(Work::Simulator, cost);
        result
    }

    /// Runs an engine, and notes its time.
    pub fn run<T>(&self, engine: Engine, from: &str, words: u64, lines: u64, run: impl FnOnce() -> T) -> T {
        let work = Work::Engine(engine as usize);
        let what = format!("{} from {from}", engine.name());
        {
            let mut state = self.state.borrow_mut();
            let estimated = state.costs.get(&work).map(|cost| cost.of(words));
            state.current = Some(Current { what: what.clone(), begun: Instant::now(), first: None, lines, estimated });
        }
        self.tell(&what);
        let result = run();
        let mut state = self.state.borrow_mut();
        state.over += 1;
        if let Some(current) = state.current.take() {
            let all = current.begun.elapsed().as_secs_f64();
            let begin = current.first.map_or(all, |first| (first - current.begun).as_secs_f64());
            state.costs.insert(work, Cost { begin, word: (all - begin) / words.max(1) as f64 });
        }
        result
    }

    /// Hears of lines that a running engine has printed.
    pub fn heard(&self, lines: u64) {
        let what = {
            let mut state = self.state.borrow_mut();
            let Some(current) = &mut state.current else { return };
            if lines > 0 && current.first.is_none() {
                current.first = Some(Instant::now());
            }
            let took = current.begun.elapsed().as_secs_f64();
            let part = lines as f64 / current.lines.max(1) as f64;
            // Lines tell more than earlier runs do.
            if let Some(first) = current.first.filter(|_| part > 0.05) {
                let begin = (first - current.begun).as_secs_f64();
                current.estimated = Some(begin + (took - begin) / part.min(1.0));
            }
            current.what.clone()
        };
        self.tell(&what);
    }

    fn tell(&self, what: &str) {
        let state = self.state.borrow();
        self.listener.at(what, state.over, self.left(&state));
    }

    /// Seconds that are left; unknown until every engine has run.
    fn left(&self, state: &State) -> Option<f64> {
        let current = state.current.as_ref().map_or(Some(0.0), |current| {
            let took = current.begun.elapsed().as_secs_f64();
            current.estimated.map(|estimated| (estimated - took).max(0.0))
        })?;
        let starts = state
            .planned
            .values()
            .map(|planned| state.start(&self.engines, planned.words).map(|seconds| seconds * planned.starts as f64));
        let left = starts.sum::<Option<f64>>()? + current;
        Some(self.within().map_or(left, |within| left.min((within - self.elapsed()).max(0.0))))
    }
}

impl State {
    /// Seconds of a start with so many words in all engines; none until each has run.
    fn start(&self, engines: &[Engine], words: u64) -> Option<f64> {
        let cost = |work| self.costs.get(&work).map(|cost| cost.of(words));
        let beside: f64 = [Work::Search, Work::Simulator].into_iter().filter_map(cost).sum();
        let engines: f64 = engines.iter().map(|engine| cost(Work::Engine(*engine as usize))).sum::<Option<f64>>()?;
        Some(beside + engines)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spend(seconds: f64) {
        std::thread::sleep(Duration::from_secs_f64(seconds));
    }

    #[test]
    fn what_is_left_follows_from_what_runs_took() {
        let pace = Pace::new(&[Engine::Ghdl], None, &Nobody);
        pace.plan("random words", 3, 100);
        assert_eq!(pace.left(&pace.state.borrow()), None);
        pace.find("random words", || spend(0.02));
        pace.run(Engine::Ghdl, "random words", 100, 10, || {
            spend(0.02);
            pace.heard(1);
            spend(0.04);
        });
        pace.begin("random words");
        let left = pace.left(&pace.state.borrow()).unwrap();
        assert!((0.14..0.6).contains(&left), "{left}");
        pace.done("random words");
        assert_eq!(pace.left(&pace.state.borrow()), Some(0.0));
    }

    #[test]
    fn steps_and_starts_fit_into_the_time() {
        let pace = Pace::new(&[Engine::Ghdl], Some(Duration::from_secs(5)), &Nobody);
        // Nothing is known of the first start.
        assert_eq!(pace.steps(1000, 10), Some(1000));
        pace.state.borrow_mut().costs.insert(Work::Search, Cost::default());
        pace.state.borrow_mut().costs.insert(Work::Engine(Engine::Ghdl as usize), Cost { begin: 0.5, word: 1e-3 });
        let steps = pace.steps(1000, 10).unwrap();
        assert!((150..=201).contains(&steps), "{steps}");
        assert!(pace.fits(4_000) && !pace.fits(5_000));
        assert_eq!(pace.steps(1000, 5_000), None);
    }
}
