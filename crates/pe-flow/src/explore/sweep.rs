//! The work of a sweep: every point compiled, in parallel, and nothing computed twice.
//!
//! ```text
//! step                     reference solution at the times of the samples
//! solver, step             step graph, run in double precision; other runs in double precision      a family
//! multiplier, storage      number formats, run in fixed point                                       its formats
//! PEs                      mapping, schedule, program, checkers                                     its points
//! ```
//!
//! Cheap work comes first, and of a family that was begun all of it before the next one; only their first runs come before
//! everything else, where they fit in memory together: they say which families are right enough. What a point yields does
//! not depend on who computes it or when.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Sender;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use pe_ir::codes;
use pe_ir::graph::StepGraph;
use pe_ir::model::Model;
use pe_ir::source::{Diagnostic, Severity};
use pe_sim::reference::ReferenceError;

use super::estimate::{Estimate, Kind, Work};
use super::family::{Family, Job, families};
use super::queue::Queue;
use super::row::{Compiled, Outcome, Reason};
use crate::candidates::Network;
use crate::failure::Failure;
use crate::known::Known;
use crate::outputs;
use crate::parts;
use crate::pipeline::{self, Compared, Stepped, Unformatted};
use crate::report::{Figures, Silicon, Told};
use crate::settings::Settings;
use crate::sized;
use crate::spec::LoadedModel;
use crate::variables::variables;
use crate::watch::Stopwatch;
use pe_judge::DesignPoint;
use pe_judge::check::sampled;
use pe_judge::conserved::Conserved;
use pe_judge::progress::silent;
use pe_judge::runs::{Comparison, Exact, Judged, Kept, Room};
use pe_judge::times::thread_seconds;
use pe_judge::total::{Reference, TotalError};
use pe_target::area;
use pe_target::clock::ClockSource;

/// What all points have in common.
pub struct Sweep {
    /// The model with the spec's solver and step.
    pub loaded: LoadedModel,
    /// What all designs have in common.
    pub settings: Settings,
    /// Quantities that the user says are conserved.
    pub conserved: Vec<Conserved>,
    /// Largest total error of points whose networks are designed; others fail. All are designed if there is none.
    pub within: Option<f64>,
    /// Whether runs end as soon as they are more wrong than that; then it is not known how wrong they would become.
    pub early: bool,
    /// When no more work is begun; points that are not done by then are not told.
    pub until: Option<Instant>,
    /// The clock that speeds are computed with.
    pub clock: ClockSource,
    /// How long the pieces of work take.
    pub estimate: Estimate,
}

/// Something that got done.
pub enum Event {
    /// Work that needs not be done any more.
    Work(Work),
    /// A point, with its place in the sweep.
    Point(usize, Outcome),
    /// All points.
    Finished,
    /// Not by the sweep: the user wants it to end.
    Interrupted,
}

/// The solution that a family is compared with.
type Shared = Arc<OnceLock<Result<Reference, ReferenceError>>>;

/// A family that was run.
struct Ran {
    loaded: LoadedModel,
    reference: Shared,
    stepped: Stepped,
    formats: Vec<Vec<Job>>,
}

/// What the points of a family share.
struct Base {
    loaded: Arc<LoadedModel>,
    reference: Shared,
    stepped: Stepped,
    comparison: Result<Comparison, Vec<Diagnostic>>,
    kept: Option<Kept>,
    /// Word-length error with which no total error is small enough, and what is subtracted for a lower bound of that.
    most: Option<(f64, f64)>,
}

/// What the points with the same formats share.
struct Format {
    base: Arc<Base>,
    /// The family's step graph, or that with coefficients in two slots.
    graph: Arc<StepGraph>,
    judged: Arc<Judged>,
    total: Result<TotalError, ReferenceError>,
}

/// A piece of work.
enum Task {
    Run(Family),
    Compare(Box<Ran>),
    Format(Arc<Base>, Vec<Job>),
    Network(Arc<Format>, Job),
}

/// Levels of tasks: those of the smallest one come first.
const NETWORK: u8 = 1;
const FORMAT: u8 = 2;
const COMPARE: u8 = 3;

/// States of all families together that are run before anything else.
const MOST_STATES: usize = 100_000;

/// Numbers of all runs that are kept from the beginning: 256 MiB.
const MOST_KEPT: u64 = 1 << 25;

/// Part of the span that a run has behind it before the solution is asked for that it may be ended by: what blows up at
/// once needs none.
const BEGINNING: f64 = 1.0 / 64.0;

/// Word-length error over that from which on no total error is small enough: scales of the run and of the solution differ.
const CLEARLY: f64 = 1.2;

/// A sweep at work.
struct Crew<'a> {
    sweep: &'a Sweep,
    queue: Queue<Task>,
    sender: &'a Sender<Event>,
    /// Whether nobody hears any more.
    deserted: AtomicBool,
    /// What points have in common beyond their families.
    known: Known,
    /// Where runs are kept until their families are done.
    room: Arc<Room>,
}

/// Compiles all jobs in the pool and sends what got done, as long as somebody hears it.
pub fn run(sweep: &Sweep, jobs: Vec<Job>, pool: &rayon::ThreadPool, sender: &Sender<Event>) {
    let model = &sweep.loaded.model;
    let families = families(jobs, model);
    let together = families.len().saturating_mul(model.states.len()) <= MOST_STATES;
    let crew = Crew {
        sweep,
        queue: Queue::default(),
        sender,
        deserted: AtomicBool::new(false),
        known: Known::default(),
        room: Room::new(MOST_KEPT),
    };
    for family in families {
        crew.queue.add(if together { 0 } else { COMPARE + 1 }, sweep.estimate.whole(&family), Task::Run(family));
    }
    pool.broadcast(|_| crew.queue.work(sweep.until, |task| crew.take(task)));
}

impl Crew<'_> {
    fn take(&self, task: Task) {
        if self.deserted.load(Ordering::Relaxed) {
            return;
        }
        match task {
            Task::Run(family) => self.family(family),
            Task::Compare(ran) => self.compare(*ran),
            Task::Format(base, jobs) => self.format(&base, jobs),
            Task::Network(format, job) => self.network(&format, &job),
        }
    }

    fn family(&self, family: Family) {
        let (sweep, any) = (self.sweep, family.formats[0][0].point);
        let loaded = match guarded(|| sweep.at(&any)) {
            Ok(loaded) => loaded,
            Err(reason) => return self.give_up_family(family.formats, &reason),
        };
        // Widths that do not go together are found before anything runs, as in `compile`.
        let mut formats = Vec::new();
        for jobs in family.formats {
            match guarded(|| jobs[0].point.format(&sweep.loaded.model).map_err(Failure::Usage)) {
                Ok(_) => formats.push(jobs),
                Err(reason) => self.give_up(&jobs, &reason),
            }
        }
        if formats.is_empty() {
            return self.give_up_family(formats, &Reason::of(&Failure::Internal("no formats".to_owned())));
        }
        let clock = thread_seconds();
        // Time in which the reference was solved, and tables were made.
        let waited = Cell::new(0.0);
        let stepped =
            guarded_reason(|| sweep.run(&loaded, &any, &family.reference, &waited, (self.sender, &self.room)));
        let took = thread_seconds() - clock - waited.get();
        self.tell(Kind::Run, sweep.estimate.run(&any), stepped.is_ok().then_some(took));
        match stepped {
            Ok(stepped) => {
                let seconds = sweep.estimate.comparison(&any);
                let ran = Ran { loaded, reference: family.reference, stepped, formats };
                self.queue.add(COMPARE, seconds, Task::Compare(Box::new(ran)));
            }
            Err(reason) => self.give_up_family(formats, &reason),
        }
    }

    fn compare(&self, ran: Ran) {
        let (sweep, clock) = (self.sweep, thread_seconds());
        let Ran { loaded, reference, stepped, formats } = ran;
        let any = formats[0][0].point;
        let waited = Cell::new(0.0);
        let base = guarded_reason(|| sweep.base(loaded, &any, reference, stepped, &waited, self.sender));
        let took = thread_seconds() - clock - waited.get();
        self.tell(Kind::Comparison, sweep.estimate.comparison(&any), base.is_ok().then_some(took));
        match base {
            Ok(base) => {
                let base = Arc::new(base);
                for jobs in formats {
                    let seconds = sweep.estimate.format(&jobs[0].point);
                    self.queue.add(FORMAT, seconds, Task::Format(Arc::clone(&base), jobs));
                }
            }
            Err(reason) => formats.iter().for_each(|jobs| self.give_up(jobs, &reason)),
        }
    }

    fn format(&self, base: &Arc<Base>, jobs: Vec<Job>) {
        let (sweep, clock) = (self.sweep, thread_seconds());
        let point = &jobs[0].point;
        let waited = Cell::new(0.0);
        let format = guarded_reason(|| {
            let (graph, judged) = sweep.judged(base, &base.stepped, point)?;
            let total = sweep.total(base, &judged, point, &waited, self.sender);
            sweep.admitted(Format { base: Arc::clone(base), graph, judged: Arc::new(judged), total })
        });
        let took = thread_seconds() - clock - waited.get();
        self.tell(Kind::Format, sweep.estimate.format(point), format.is_ok().then_some(took));
        match format {
            Ok(format) => {
                let format = Arc::new(format);
                for job in jobs {
                    let seconds = sweep.estimate.network(&job.point);
                    self.queue.add(NETWORK, seconds, Task::Network(Arc::clone(&format), job));
                }
            }
            Err(reason) => {
                self.tell(Kind::Network, sweep.estimate.networks(&jobs), None);
                fail(&jobs, &reason, self.sender);
            }
        }
    }

    fn network(&self, format: &Format, job: &Job) {
        let clock = thread_seconds();
        let compiled = guarded_reason(|| self.sweep.network(format, job, &self.known, self.sender));
        let outcome = compiled.map_or_else(Outcome::Failed, |compiled| Outcome::Compiled(Box::new(compiled)));
        let took = matches!(outcome, Outcome::Compiled(_)).then(|| thread_seconds() - clock);
        self.tell(Kind::Network, self.sweep.estimate.network(&job.point), took);
        let _ = self.sender.send(Event::Point(job.index, outcome));
    }

    /// Points of the same formats fail before these are known.
    fn give_up(&self, jobs: &[Job], reason: &Reason) {
        let Some(first) = jobs.first() else { return };
        self.tell(Kind::Format, self.sweep.estimate.format(&first.point), None);
        self.tell(Kind::Network, self.sweep.estimate.networks(jobs), None);
        fail(jobs, reason, self.sender);
    }

    /// The same of all points of a family.
    fn give_up_family(&self, formats: Vec<Vec<Job>>, reason: &Reason) {
        if let Some(first) = formats.first() {
            self.tell(Kind::Comparison, self.sweep.estimate.comparison(&first[0].point), None);
        }
        formats.iter().for_each(|jobs| self.give_up(jobs, reason));
    }

    fn tell(&self, kind: Kind, estimated: f64, took: Option<f64>) {
        if self.sender.send(Event::Work(Work { kind, estimated, took })).is_err() {
            self.deserted.store(true, Ordering::Relaxed);
        }
    }
}

impl Sweep {
    /// The model at a point.
    fn at(&self, point: &DesignPoint) -> Result<LoadedModel, Failure> {
        let mut loaded = self.loaded.clone();
        point.apply(&mut loaded.model).map_err(Failure::Usage)?;
        Ok(loaded)
    }

    /// The run in double precision of a family. One that is more wrong than was asked for ends it, at the times of the
    /// reference.
    fn run(
        &self,
        loaded: &LoadedModel,
        point: &DesignPoint,
        reference: &Shared,
        waited: &Cell<f64>,
        (sender, room): (&Sender<Event>, &Arc<Room>),
    ) -> Result<Stepped, Reason> {
        let (model, watch) = (&loaded.model, &mut Stopwatch::silent());
        let solution = || self.reference(reference, model, point, waited, sender).as_ref().ok();
        let clock = thread_seconds();
        let graph = guarded(|| pipeline::build(loaded, point, &self.settings.mapping, watch))?;
        waited.set(thread_seconds() - clock);
        let (samples, looks) = Exact::times(model);
        let early = |time: &&f64| **time < BEGINNING * model.span;
        let beginning = samples.iter().chain(&looks).filter(early).count();
        let mut known: Option<&Reference> = None;
        let mut ended = None;
        let mut goes_on = |index: usize, states: &[f64]| -> bool {
            let Some(limit) = self.within.filter(|_| self.early) else { return true };
            if index < beginning {
                return true;
            }
            known = known.or_else(solution);
            let Some(solution) = known else { return true };
            let error = solution.deviation(index, states);
            if error > limit {
                ended = Some(Reason::at_least(error, solution.time(index)));
            }
            error <= limit
        };
        let stepped = guarded(|| pipeline::run_while(loaded, graph, &mut goes_on, room))?;
        let Some(stepped) = stepped else { return Err(ended.expect("it was ended by its error")) };
        let Some((limit, solution)) = self.within.zip(solution()) else { return Ok(stepped) };
        let error = solution.double_error(model, &stepped.exact, None);
        if error > limit || error.is_nan() { Err(Reason::beyond(error, error)) } else { Ok(stepped) }
    }

    /// What the points of a family share. A run that is more wrong than was asked for, with what comes on top between the
    /// times of the reference, ends it.
    fn base(
        &self,
        loaded: LoadedModel,
        point: &DesignPoint,
        reference: Shared,
        stepped: Stepped,
        waited: &Cell<f64>,
        sender: &Sender<Event>,
    ) -> Result<Base, Reason> {
        let model = &loaded.model;
        let Stepped { graph, exact } = &stepped;
        let (comparison, kept) = guarded(|| Ok(exact.compare_keeping(model, graph)))?;
        let mut most = None;
        if let (Some(limit), Ok(compared)) = (self.within, &comparison)
            && let Ok(solution) = self.reference(&reference, model, point, waited, sender)
        {
            let error = solution.double_error(model, exact, Some(compared));
            if error > limit || error.is_nan() {
                return Err(Reason::beyond(error, error));
            }
            most = self.early.then_some((CLEARLY * (limit + error), error));
        }
        Ok(Base { loaded: Arc::new(loaded), reference, stepped, comparison, kept, most })
    }

    /// The runs of points if they are right enough for a network.
    fn admitted(&self, format: Format) -> Result<Format, Reason> {
        let (Some(limit), Ok(total)) = (self.within, &format.total) else { return Ok(format) };
        let error = total.whole.error;
        if error <= limit { Ok(format) } else { Err(Reason::beyond(error, total.double.0)) }
    }

    /// The solution that a family is compared with.
    fn reference<'r>(
        &self,
        reference: &'r Shared,
        model: &Model,
        point: &DesignPoint,
        waited: &Cell<f64>,
        sender: &Sender<Event>,
    ) -> &'r Result<Reference, ReferenceError> {
        let clock = thread_seconds();
        let solution = reference.get_or_init(|| {
            let (times, looks) = Exact::times(model);
            let solution = Reference::solve(model, &times, &looks, &self.conserved, &*silent());
            let took = Some(thread_seconds() - clock);
            let work = Work { kind: Kind::Reference, estimated: self.estimate.reference(point), took };
            let _ = sender.send(Event::Work(work));
            solution
        });
        waited.set(waited.get() + thread_seconds() - clock);
        solution
    }

    /// The total error of a fixed-point run.
    fn total(
        &self,
        base: &Base,
        judged: &Judged,
        point: &DesignPoint,
        waited: &Cell<f64>,
        sender: &Sender<Event>,
    ) -> Result<TotalError, ReferenceError> {
        let model = &base.loaded.model;
        let reference = self.reference(&base.reference, model, point, waited, sender).as_ref();
        reference.map(|reference| reference.compare(model, judged)).map_err(|error| *error)
    }

    /// The graph that a point has, and its formats and errors; what was run is the graph of the family or a split of it.
    fn judged(&self, base: &Base, stepped: &Stepped, point: &DesignPoint) -> Result<(Arc<StepGraph>, Judged), Reason> {
        let (loaded, criteria) = (&base.loaded, &self.settings.criteria);
        let watch = &mut Stopwatch::silent();
        let own = std::ptr::eq(stepped, &base.stepped);
        let compared = Compared {
            comparison: &base.comparison,
            kept: base.kept.as_ref().filter(|_| own),
            most: base.most.map(|(most, _)| most).filter(|_| own),
        };
        let formats = pipeline::formats(loaded, criteria, point, stepped, Some(compared), watch);
        let (graph, mut judged) = formats.map_err(|unformatted| match unformatted {
            Unformatted::Failed(failure) => Reason::of(&failure),
            Unformatted::Beyond(beyond) => {
                let known = base.most.map_or(0.0, |(_, double)| double);
                Reason::at_least(beyond.error - known, beyond.time)
            }
        })?;
        let findings = sampled::findings(&loaded.model, &graph, &judged).into_iter();
        let (refusals, warnings): (Vec<_>, Vec<_>) = findings.partition(|finding| finding.severity == Severity::Error);
        judged.warnings.extend(warnings);
        let refused = |findings| Reason::of(&Failure::Spec(findings, loaded.sources.clone()));
        judged.warnings.extend(criteria.permit(refusals).map_err(refused)?);
        Ok((graph, judged))
    }

    /// Designs the network of a point and reports on it as `compile` does.
    fn network(&self, format: &Format, job: &Job, known: &Known, sender: &Sender<Event>) -> Result<Compiled, Reason> {
        let failed = |failure: Failure| Reason::of(&failure);
        let Format { base, graph, judged, total } = format;
        let (loaded, point) = (&base.loaded, &job.point);
        let (mut graph, mut judged, mut total) = (Arc::clone(graph), Arc::clone(judged), total.clone());
        // Heavy equations are split differently for every number of PEs, and tables shortened; then nothing is shared.
        let words = point.format(&loaded.model).map_err(|text| failed(Failure::Usage(text)))?;
        let options = &self.settings.mapping;
        let split = sized::for_pes(&base.stepped.graph, point.pes, None, options, words);
        let whole = split.as_ref().unwrap_or(&base.stepped.graph);
        let arranged = parts::arranged(loaded, whole, point, options, (point.pes, words));
        if let Some(split) = arranged.or(split) {
            let stepped = pipeline::run(loaded, split, &mut Stopwatch::silent()).map_err(failed)?;
            let (of_split, judged_split) = self.judged(base, &stepped, point)?;
            total = self.total(base, &judged_split, point, &Cell::new(0.0), sender);
            (graph, judged) = (of_split, Arc::new(judged_split));
        }
        let seed = self.settings.seed;
        let watch = &mut Stopwatch::silent();
        let network = Network { pes: point.pes, exact: true, seed, given: None };
        let mapping = &self.settings.mapping;
        let mut design =
            pipeline::implement(loaded, &graph, &judged, network, mapping, known, watch).map_err(failed)?;
        outputs::place(&mut design.program, outputs::Wanted::Auto, self.clock.family()).map_err(failed)?;
        let (model, total) = (&loaded.model, Some(total));
        let silicon = Silicon {
            area: area::estimate(&design.program, self.clock.family()),
            clock: self.clock.of(&design.program.format, design.program.pes.len() as u32),
        };
        let variables = variables(model, &design.graph, &design.judged);
        let told = Told { variables: &variables, silicon, total: &total, seed, command: &job.command };
        let figures = Figures::of(model, &design, &told);
        let of_reference = match &total {
            Some(Ok(total)) => total.doubt().map(|doubt| doubt.code),
            Some(Err(_)) => Some(codes::NO_REFERENCE),
            None => None,
        };
        let warnings = judged.warnings.iter().map(|warning| warning.code).chain(of_reference);
        Ok(Compiled { figures, warnings: warnings.map(str::to_owned).collect() })
    }
}

/// Does work of which neither a failure nor a panic shall end the sweep.
fn guarded<T>(work: impl FnOnce() -> Result<T, Failure>) -> Result<T, Reason> {
    guarded_reason(|| work().map_err(|failure| Reason::of(&failure)))
}

/// The same of work that knows why it fails.
fn guarded_reason<T>(work: impl FnOnce() -> Result<T, Reason>) -> Result<T, Reason> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
        Err(Reason::of(&Failure::Internal(text.unwrap_or("panic").to_owned())))
    })
}

fn fail<'j>(jobs: impl IntoIterator<Item = &'j Job>, reason: &Reason, sender: &Sender<Event>) {
    for job in jobs {
        let _ = sender.send(Event::Point(job.index, Outcome::Failed(reason.clone())));
    }
}
