//! Time of each compiler stage, and the listener that is notified of it.

use std::sync::Arc;
use std::time::Instant;

use pe_ir::source::{Diagnostic, Sources};
use pe_judge::progress::{Progress, silent};
use pe_judge::times::processor_seconds;

/// Stages that take as long as the span is.
const RUNS: [&str; 7] = ["choose", "functions", "slots", "runs", "ranges", "stability", "reference"];

/// Hears of stages while they are at work, and of warnings as they come up.
pub trait Listener {
    /// A long stage begins that tells how far it is.
    fn progress(&self, stage: &'static str) -> Arc<dyn Progress>;
    /// A stage begins.
    fn begin(&self, stage: &'static str);
    /// What the stage that began last is at.
    fn say(&self, text: String);
    /// The stage that began last is over.
    fn end(&self);
    /// What came out of a stage, in a few words, and the seconds it took.
    fn done(&self, stage: &'static str, figure: &str, seconds: f64);
    /// Findings that do not end the work.
    fn warn(&self, findings: &[Diagnostic], sources: &Sources);
}

/// Nobody listens.
struct Nobody;

impl Listener for Nobody {
    fn progress(&self, _: &'static str) -> Arc<dyn Progress> {
        silent()
    }
    fn begin(&self, _: &'static str) {}
    fn say(&self, _: String) {}
    fn end(&self) {}
    fn done(&self, _: &'static str, _: &str, _: f64) {}
    fn warn(&self, _: &[Diagnostic], _: &Sources) {}
}

/// What a stage took.
pub struct StageTime {
    /// The stage.
    pub stage: &'static str,
    /// Seconds.
    pub seconds: f64,
    /// Seconds of processor time, where the system tells: on a loaded machine the fairer figure.
    pub processor_seconds: Option<f64>,
}

/// Times of each stage, in order.
pub struct Stopwatch {
    /// Stages done.
    pub stages: Vec<StageTime>,
    start: Instant,
    listener: Box<dyn Listener>,
}

impl Stopwatch {
    /// A stopwatch whose listener hears of every stage.
    pub fn new(listener: impl Listener + 'static) -> Self {
        Stopwatch { stages: Vec::new(), start: Instant::now(), listener: Box::new(listener) }
    }

    /// A stopwatch to which nobody listens.
    pub fn silent() -> Self {
        Stopwatch::new(Nobody)
    }

    /// Seconds since the beginning, without those of stages that run over the span.
    pub fn seconds_without_runs(&self) -> f64 {
        self.start.elapsed().as_secs_f64() - self.runs().map(|time| time.seconds).sum::<f64>()
    }

    /// The same in processor time, where the system tells.
    pub fn processor_seconds_without_runs(&self) -> Option<f64> {
        let runs: Option<f64> = self.runs().map(|time| time.processor_seconds).sum();
        processor_seconds().zip(runs).map(|(all, runs)| all - runs)
    }

    fn runs(&self) -> impl Iterator<Item = &StageTime> {
        self.stages.iter().filter(|time| RUNS.contains(&time.stage))
    }

    /// Who hears of it all.
    pub fn listener(&self) -> &dyn Listener {
        &*self.listener
    }

    /// Who hears how far a long stage is.
    pub fn progress(&self, stage: &'static str) -> Arc<dyn Progress> {
        self.listener.progress(stage)
    }

    /// Findings that do not end the work.
    pub fn warn(&self, findings: &[Diagnostic], sources: &Sources) {
        self.listener.warn(findings, sources);
    }

    /// Times a stage and shows that it is at work; `figure` says in a few words what came out of it.
    pub fn stage<T>(&mut self, name: &'static str, work: impl FnOnce() -> T, figure: impl FnOnce(&T) -> String) -> T {
        self.stage_saying(name, |_| work(), figure)
    }

    /// The same of a long stage that can say what it is at.
    pub fn stage_saying<T>(
        &mut self,
        name: &'static str,
        work: impl FnOnce(&dyn Fn(String)) -> T,
        figure: impl FnOnce(&T) -> String,
    ) -> T {
        self.listener.begin(name);
        let begun = Begun::now();
        let result = work(&|text| self.listener.say(text));
        self.listener.end();
        self.note(name, &begun);
        self.tell(name, figure(&result));
        result
    }

    /// Times a stage that shows its progress itself.
    pub fn timed<T>(&mut self, name: &'static str, work: impl FnOnce() -> T, figure: impl FnOnce(&T) -> String) -> T {
        let result = self.part(name, work);
        self.tell(name, figure(&result));
        result
    }

    /// A stage made of others, whose times count as theirs; nobody hears of these.
    pub fn absorbing<T>(
        &mut self,
        name: &'static str,
        inner: &mut Stopwatch,
        work: impl FnOnce(&mut Stopwatch) -> T,
        figure: impl FnOnce(&T) -> String,
    ) -> T {
        self.listener.begin(name);
        let begun = Begun::now();
        let result = work(inner);
        self.listener.end();
        for StageTime { stage, seconds, processor_seconds } in inner.stages.drain(..) {
            self.include(stage, seconds, processor_seconds);
        }
        self.listener.done(name, &figure(&result), begun.wall.elapsed().as_secs_f64());
        result
    }

    /// Times a part of a stage that goes on after another one; nothing is told yet.
    pub fn part<T>(&mut self, name: &'static str, work: impl FnOnce() -> T) -> T {
        let begun = Begun::now();
        let result = work();
        self.note(name, &begun);
        result
    }

    fn tell(&self, name: &'static str, figure: String) {
        let seconds = self.stages.iter().find(|time| time.stage == name).map_or(0.0, |time| time.seconds);
        self.listener.done(name, &figure, seconds);
    }

    fn note(&mut self, name: &'static str, begun: &Begun) {
        let seconds = begun.wall.elapsed().as_secs_f64();
        let processor_seconds = processor_seconds().zip(begun.processor).map(|(after, before)| after - before);
        self.include(name, seconds, processor_seconds);
    }

    fn include(&mut self, name: &'static str, seconds: f64, processor_seconds: Option<f64>) {
        match self.stages.iter_mut().find(|time| time.stage == name) {
            Some(time) => {
                time.seconds += seconds;
                time.processor_seconds = time.processor_seconds.zip(processor_seconds).map(|(all, more)| all + more);
            }
            None => self.stages.push(StageTime { stage: name, seconds, processor_seconds }),
        }
    }
}

/// When a stage began, on the wall and in processor time.
struct Begun {
    wall: Instant,
    processor: Option<f64>,
}

impl Begun {
    fn now() -> Begun {
        Begun { wall: Instant::now(), processor: processor_seconds() }
    }
}
