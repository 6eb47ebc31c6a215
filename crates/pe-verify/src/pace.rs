//! How far a judgement is, what is left of it, and what of that fits into a time.
//!
//! Work is counted in control words of all PEs: PEs times clocks. An engine takes a time to begin and one for each word, as its
//! runs say, without what is built once for all. Searches of a kind take what they took so far, before the first one what
//! its candidates take in the simulator, and the last ones what it takes to try everything there. Starts that are still to come
//! are those that are likely: fewer than at most where PEs are few, or what they are made for was seen.

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
    /// A run in the simulator.
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

/// The latest of the shortest and of the longest runs: words and seconds.
#[derive(Clone, Copy, Debug)]
struct Ends {
    short: (u64, f64),
    long: (u64, f64),
}

/// How many times the words of a run another one has that tells apart what beginning takes and what words take.
const APART: f64 = 1.5;

impl Ends {
    /// With another run, and what both ends say.
    fn with(before: Option<Ends>, run: (u64, f64)) -> (Ends, Option<Cost>) {
        let Ends { short, long } = before.unwrap_or(Ends { short: run, long: run });
        let ends =
            Ends { short: if run.0 <= short.0 { run } else { short }, long: if run.0 >= long.0 { run } else { long } };
        let Ends { short, long } = ends;
        let apart = long.0 as f64 > APART * short.0 as f64;
        let cost = apart.then(|| {
            let word = ((long.1 - short.1) / (long.0 - short.0) as f64).max(0.0);
            Cost { begin: (short.1 - word * short.0 as f64).max(0.0), word }
        });
        (ends, cost)
    }
}

/// Searches of a kind that try nearly everything: that which finds nothing, and one that finds something late.
const HARD: f64 = 2.0;

/// What a search takes: runs of the simulator, and their words.
#[derive(Clone, Copy, Debug, Default)]
pub struct Effort {
    /// Runs.
    pub runs: u64,
    /// Words of all of them.
    pub words: u64,
}

/// Searches of a kind: one that finds a start, and one for a start that is not there.
#[derive(Clone, Copy, Debug, Default)]
pub struct Efforts {
    /// If something is found.
    pub found: Effort,
    /// If nothing is.
    pub nothing: Effort,
}

/// Starts of a kind that are to come: how many, the words of each, and its searches.
#[derive(Clone, Copy, Debug)]
struct Planned {
    starts: u64,
    words: u64,
    search: Efforts,
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
    ends: BTreeMap<Work, Ends>,
    planned: BTreeMap<&'static str, Planned>,
    current: Option<Current>,
    /// Searches of each kind so far, and the mean of their seconds.
    searches: BTreeMap<&'static str, (f64, f64)>,
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

    /// What engines keep to; `heard` and `built` pass on to [`Pace::heard`] and [`Pace::built`].
    pub fn children<'b>(&self, heard: &'b dyn Fn(u64), built: &'b dyn Fn()) -> Children<'b> {
        Children { until: self.within.map(|within| self.begun + within), heard: Some(heard), built: Some(built) }
    }

    /// Says how many starts of a kind are to come, the words of each, and its searches.
    pub fn plan(&self, kind: &'static str, starts: u64, words: u64, search: Efforts) {
        self.state.borrow_mut().planned.insert(kind, Planned { starts, words, search });
    }

    /// As many starts of a kind are likely to come, if any still is.
    pub fn likely(&self, kind: &'static str, starts: impl FnOnce() -> u64) {
        if let Some(planned) = self.state.borrow_mut().planned.get_mut(kind) {
            planned.starts = starts();
        }
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

    /// Whether a start of a kind with so many words is likely to end in time; nothing is known of the first one.
    pub fn fits(&self, kind: &'static str, words: u64) -> bool {
        let Some(within) = self.within() else { return true };
        let state = self.state.borrow();
        let search = state.searches.get(kind).map_or(0.0, |(_, seconds)| *seconds);
        let needed = state.start(&self.engines, words).map_or(0.0, |start| start + search);
        !self.is_over() && self.elapsed() + needed <= within
    }

    /// The most steps, of so many words each, that fit into half of the time that is left; none if not even one does.
    pub fn steps(&self, most: u64, words: u64) -> Option<u64> {
        let Some(within) = self.within() else { return Some(most) };
        if !self.fits("", words) {
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
    pub fn find<T>(&self, kind: &'static str, find: impl FnOnce() -> T) -> T {
        self.tell(kind);
        let begun = Instant::now();
        let found = find();
        let took = begun.elapsed().as_secs_f64();
        let mut state = self.state.borrow_mut();
        let (count, mean) = state.searches.entry(kind).or_default();
        *mean = (*count * *mean + took) / (*count + 1.0);
        *count += 1.0;
        found
    }

    /// Runs a start in the simulator, and notes its time.
    pub fn simulate<T>(&self, words: u64, run: impl FnOnce() -> T) -> T {
        let begun = Instant::now();
        let result = run();
        let took = begun.elapsed().as_secs_f64();
        self.state.borrow_mut().note(
            Work::Simulator,
            (words, took),
            Cost { begin: 0.0, word: took / words.max(1) as f64 },
        );
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
            state.note(work, (words, all), Cost { begin, word: (all - begin) / words.max(1) as f64 });
        }
        result
    }

    /// Hears that what an engine builds once is there: other runs do not take that time.
    pub fn built(&self) {
        if let Some(current) = &mut self.state.borrow_mut().current {
            current.begun = Instant::now();
        }
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
        let Cost { begin, word } = state.costs.get(&Work::Simulator).copied().unwrap_or_default();
        let seconds = |effort: Effort| begin * effort.runs as f64 + word * effort.words as f64;
        let of = |(kind, planned): (&&'static str, &Planned)| {
            let Planned { starts, words, search } = *planned;
            let one = state.searches.get(kind).map_or_else(|| seconds(search.found), |(_, seconds)| *seconds);
            Some((state.start(&self.engines, words)? + one) * starts as f64 + HARD * seconds(search.nothing))
        };
        let left = state.planned.iter().map(of).sum::<Option<f64>>()? + current;
        Some(self.within().map_or(left, |within| left.min((within - self.elapsed()).max(0.0))))
    }
}

impl State {
    /// Notes a run of so many words and seconds. What it says alone counts until others have more or fewer words: programs
    /// whose lines come together do not tell when they began.
    fn note(&mut self, work: Work, run: (u64, f64), alone: Cost) {
        let (ends, cost) = Ends::with(self.ends.get(&work).copied(), run);
        self.ends.insert(work, ends);
        self.costs.insert(work, cost.unwrap_or(alone));
    }

    /// Seconds of a start with so many words in all engines; none until each has run.
    fn start(&self, engines: &[Engine], words: u64) -> Option<f64> {
        let cost = |work| self.costs.get(&work).map(|cost| cost.of(words));
        let engines: f64 = engines.iter().map(|engine| cost(Work::Engine(*engine as usize))).sum::<Option<f64>>()?;
        Some(engines + cost(Work::Simulator).unwrap_or(0.0))
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
        pace.plan("random words", 3, 100, Efforts::default());
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
        // What is built once is not built again, and a search that finds nothing takes as long as the simulator.
        pace.run(Engine::Ghdl, "random words", 100, 10, || {
            spend(0.2);
            pace.built();
            spend(0.01);
            pace.heard(1);
        });
        let again = pace.left(&pace.state.borrow()).unwrap();
        assert!(again < 0.2, "{again}");
        pace.simulate(100, || spend(0.01));
        let nothing = Effort { runs: 100, words: 10_000 };
        pace.plan("random words", 2, 100, Efforts { nothing, ..Efforts::default() });
        let sought = pace.left(&pace.state.borrow()).unwrap() - again;
        assert!((1.8..60.0).contains(&sought), "{sought}");
        // Of a kind that was not sought its candidates tell, and fewer starts take less.
        pace.plan("entries", 4, 100, Efforts { found: nothing, ..Efforts::default() });
        let entries = pace.left(&pace.state.borrow()).unwrap() - again - sought;
        assert!((3.6..120.0).contains(&entries), "{entries}");
        pace.likely("entries", || 1);
        pace.find("entries", || spend(0.02));
        let fewer = pace.left(&pace.state.borrow()).unwrap() - again - sought;
        assert!(fewer < entries / 4.0, "{fewer} {entries}");
        pace.done("entries");
        pace.likely("entries", || unreachable!());
        pace.done("random words");
        assert_eq!(pace.left(&pace.state.borrow()), Some(0.0));
    }

    #[test]
    fn runs_of_two_lengths_tell_what_words_take() {
        let (ends, alone) = Ends::with(None, (100, 3.0));
        assert!(alone.is_none());
        let (ends, cost) = Ends::with(Some(ends), (200, 4.0));
        assert_eq!(cost.map(|cost| (cost.begin, cost.word)), Some((2.0, 0.01)));
        // The load of the machine may turn it around.
        let (_, cost) = Ends::with(Some(ends), (50, 5.0));
        assert_eq!(cost.map(|cost| (cost.begin, cost.word)), Some((5.0, 0.0)));
    }

    #[test]
    fn steps_and_starts_fit_into_the_time() {
        let pace = Pace::new(&[Engine::Ghdl], Some(Duration::from_secs(5)), &Nobody);
        // Nothing is known of the first start.
        assert_eq!(pace.steps(1000, 10), Some(1000));
        pace.state.borrow_mut().costs.insert(Work::Engine(Engine::Ghdl as usize), Cost { begin: 0.5, word: 1e-3 });
        let steps = pace.steps(1000, 10).unwrap();
        assert!((150..=201).contains(&steps), "{steps}");
        assert!(pace.fits("random words", 4_000) && !pace.fits("random words", 5_000));
        assert_eq!(pace.steps(1000, 5_000), None);
    }
}
