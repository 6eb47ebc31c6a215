//! The work of a sweep: every point compiled, in parallel, and nothing computed twice.
//!
//! ```text
//! step                     reference solution at the times of the samples
//! solver, step             step graph, runs in double precision          a family
//! multiplier, storage      number formats, run in fixed point            its formats
//! PEs                      mapping, schedule, program, checkers          its points
//! ```
//!
//! Each level hands tasks to the pool; a worker takes its newest task first and steals the oldest of another, so that
//! at most one family per worker is in memory. What a point yields does not depend on who computes it or when.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::Sender;
use std::sync::{Arc, OnceLock};

use pe_ir::codes;
use pe_ir::graph::StepGraph;
use pe_ir::model::Model;
use pe_ir::source::Severity;
use pe_sim::reference::ReferenceError;
use rayon::Scope;

use super::estimate::Estimate;
use super::family::{Family, Job, families, has_functions};
use super::row::{Compiled, Outcome, Reason};
use crate::candidates::Network;
use crate::failure::Failure;
use crate::outputs;
use crate::pipeline::{self, Compared, Stepped};
use crate::report::{Figures, Silicon, Told};
use crate::settings::Settings;
use crate::spec::LoadedModel;
use crate::variables::variables;
use crate::watch::Stopwatch;
use pe_judge::DesignPoint;
use pe_judge::check::sampled;
use pe_judge::conserved::Conserved;
use pe_judge::progress::silent;
use pe_judge::runs::{Comparison, Exact, Judged};
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
    /// The clock that speeds are computed with.
    pub clock: ClockSource,
    /// How long the pieces of work take.
    pub estimate: Estimate,
}

/// Something that got done.
pub enum Event {
    /// Work that was estimated to take so many seconds.
    Work(f64),
    /// A point, with its place in the sweep.
    Point(usize, Outcome),
    /// All points.
    Finished,
    /// Not by the sweep: the user wants it to end.
    Interrupted,
}

/// What the points of a family share.
struct Base {
    loaded: Arc<LoadedModel>,
    reference: Arc<OnceLock<Result<Reference, ReferenceError>>>,
    stepped: Stepped,
    compared: Compared,
}

/// What the points with the same formats share.
struct Format {
    base: Arc<Base>,
    /// The family's step graph, or that with coefficients in two slots.
    graph: Arc<StepGraph>,
    judged: Arc<Judged>,
    total: Result<TotalError, ReferenceError>,
}

/// Compiles all jobs in the pool and sends what got done; ends early if nobody listens any more.
pub fn run(sweep: &Sweep, jobs: Vec<Job>, pool: &rayon::ThreadPool, sender: &Sender<Event>) {
    let families = families(jobs, has_functions(&sweep.loaded.model));
    pool.scope(|scope| {
        // The newest task is taken first.
        for family in families.into_iter().rev() {
            scope.spawn(move |scope| sweep.family(family, scope, sender));
        }
    });
}

impl Sweep {
    fn family<'a>(&'a self, family: Family, scope: &Scope<'a>, sender: &'a Sender<Event>) {
        let any = family.formats[0][0].point;
        let loaded = match guarded(|| self.at(&any)) {
            Ok(loaded) => loaded,
            Err(reason) => return fail(family.formats.iter().flatten(), &reason, sender),
        };
        // Widths that do not go together are found before anything runs, as in `compile`.
        let mut formats = Vec::new();
        for jobs in family.formats {
            match guarded(|| jobs[0].point.format(&self.loaded.model).map_err(Failure::Usage)) {
                Ok(_) => formats.push(jobs),
                Err(reason) => fail(&jobs, &reason, sender),
            }
        }
        if formats.is_empty() {
            return;
        }
        let base = self.base(loaded, &any, family.reference, sender);
        let _ = sender.send(Event::Work(self.estimate.family(&any)));
        match base {
            Ok(base) => {
                let base = Arc::new(base);
                for jobs in formats.into_iter().rev() {
                    let base = Arc::clone(&base);
                    scope.spawn(move |scope| self.format(&base, jobs, scope, sender));
                }
            }
            Err(reason) => fail(formats.iter().flatten(), &reason, sender),
        }
    }

    /// The model at a point.
    fn at(&self, point: &DesignPoint) -> Result<LoadedModel, Failure> {
        let mut loaded = self.loaded.clone();
        point.apply(&mut loaded.model).map_err(Failure::Usage)?;
        Ok(loaded)
    }

    /// What the points of a family share. A run in double precision that is more wrong than was asked for ends it: first at
    /// the times of the reference alone, then with what comes on top between them.
    fn base(
        &self,
        loaded: LoadedModel,
        point: &DesignPoint,
        reference: Arc<OnceLock<Result<Reference, ReferenceError>>>,
        sender: &Sender<Event>,
    ) -> Result<Base, Reason> {
        let stepped = guarded(|| {
            let watch = &mut Stopwatch::silent();
            let graph = pipeline::build(&loaded, point, &self.settings.mapping, watch)?;
            pipeline::run(&loaded, graph, watch)
        })?;
        let Stepped { graph, exact } = &stepped;
        let refused = |comparison: Option<&Comparison>| -> Option<Reason> {
            let limit = self.within?;
            let solution = self.reference(&reference, &loaded.model, exact, point, sender).as_ref().ok()?;
            let error = solution.double_error(&loaded.model, exact, comparison);
            (error > limit || error.is_nan()).then(|| Reason::beyond(error, error))
        };
        if let Some(reason) = refused(None) {
            return Err(reason);
        }
        let compared = guarded(|| Ok(exact.compare(&loaded.model, graph)))?;
        if let Some(reason) = compared.as_ref().ok().and_then(|comparison| refused(Some(comparison))) {
            return Err(reason);
        }
        Ok(Base { loaded: Arc::new(loaded), reference, stepped, compared })
    }

    fn format<'a>(&'a self, base: &Arc<Base>, jobs: Vec<Job>, scope: &Scope<'a>, sender: &'a Sender<Event>) {
        let judged = guarded(|| {
            let point = &jobs[0].point;
            let (graph, judged) = self.judged(base, &base.stepped, point)?;
            let total = self.total(base, &judged, point, sender);
            Ok(Format { base: Arc::clone(base), graph, judged: Arc::new(judged), total })
        });
        let _ = sender.send(Event::Work(self.estimate.format(&jobs[0].point)));
        match judged.and_then(|format| self.admitted(format)) {
            Ok(format) => {
                let format = Arc::new(format);
                for job in jobs.into_iter().rev() {
                    let format = Arc::clone(&format);
                    scope.spawn(move |_| {
                        let compiled = guarded(|| self.network(&format, &job, sender));
                        let outcome =
                            compiled.map_or_else(Outcome::Failed, |compiled| Outcome::Compiled(Box::new(compiled)));
                        let _ = sender.send(Event::Work(self.estimate.network(&job.point)));
                        let _ = sender.send(Event::Point(job.index, outcome));
                    });
                }
            }
            Err(reason) => fail(&jobs, &reason, sender),
        }
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
        reference: &'r OnceLock<Result<Reference, ReferenceError>>,
        model: &Model,
        exact: &Exact,
        point: &DesignPoint,
        sender: &Sender<Event>,
    ) -> &'r Result<Reference, ReferenceError> {
        reference.get_or_init(|| {
            let (times, looks) = exact.times();
            let solution = Reference::solve(model, &times, &looks, &self.conserved, &*silent());
            let _ = sender.send(Event::Work(self.estimate.reference(point)));
            solution
        })
    }

    /// The total error of a fixed-point run.
    fn total(
        &self,
        base: &Base,
        judged: &Judged,
        point: &DesignPoint,
        sender: &Sender<Event>,
    ) -> Result<TotalError, ReferenceError> {
        let model = &base.loaded.model;
        let reference = self.reference(&base.reference, model, &base.stepped.exact, point, sender).as_ref();
        reference.map(|reference| reference.compare(model, judged)).map_err(|error| *error)
    }

    /// The graph that a point has, and its formats and errors; what was run is the graph of the family or a split of it.
    fn judged(&self, base: &Base, stepped: &Stepped, point: &DesignPoint) -> Result<(Arc<StepGraph>, Judged), Failure> {
        let (loaded, criteria) = (&base.loaded, &self.settings.criteria);
        let watch = &mut Stopwatch::silent();
        let (graph, mut judged) = pipeline::formats(loaded, criteria, point, stepped, Some(&base.compared), watch)?;
        let findings = sampled::findings(&loaded.model, &graph, &judged).into_iter();
        let (refusals, warnings): (Vec<_>, Vec<_>) = findings.partition(|finding| finding.severity == Severity::Error);
        judged.warnings.extend(warnings);
        let refused = |findings| Failure::Spec(findings, loaded.sources.clone());
        judged.warnings.extend(criteria.permit(refusals).map_err(refused)?);
        Ok((graph, judged))
    }

    /// Designs the network of a point and reports on it as `compile` does.
    fn network(&self, format: &Format, job: &Job, sender: &Sender<Event>) -> Result<Compiled, Failure> {
        let Format { base, graph, judged, total } = format;
        let (loaded, point) = (&base.loaded, &job.point);
        let (mut graph, mut judged, mut total) = (Arc::clone(graph), Arc::clone(judged), total.clone());
        // Heavy equations are split differently for every number of PEs; then nothing is shared.
        let words = point.format(&loaded.model).map_err(Failure::Usage)?;
        if let Some(split) = pipeline::split(&base.stepped.graph, point.pes, &self.settings.mapping, words) {
            let stepped = pipeline::run(loaded, split, &mut Stopwatch::silent())?;
            let (of_split, judged_split) = self.judged(base, &stepped, point)?;
            total = self.total(base, &judged_split, point, sender);
            (graph, judged) = (of_split, Arc::new(judged_split));
        }
        let seed = self.settings.seed;
        let watch = &mut Stopwatch::silent();
        let network = Network { pes: point.pes, seed, given: None };
        let mut design = pipeline::implement(loaded, &graph, &judged, network, &self.settings.mapping, watch)?;
        outputs::place(&mut design.program, outputs::Wanted::Auto, self.clock.family())?;
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
    let result = catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
        Err(Failure::Internal(text.unwrap_or("panic").to_owned()))
    });
    result.map_err(|failure| Reason::of(&failure))
}

fn fail<'j>(jobs: impl IntoIterator<Item = &'j Job>, reason: &Reason, sender: &Sender<Event>) {
    for job in jobs {
        let _ = sender.send(Event::Point(job.index, Outcome::Failed(reason.clone())));
    }
}
