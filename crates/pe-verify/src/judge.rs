//! Judges a compiled folder: every engine against the simulator, bit for bit, from the files in the folder.
//!
//! In: a folder that `compile` wrote, or a copy that something was done to. Out: a [`Verdict`], or the first thing that
//! is wrong. Nothing is emitted anew: other starts than the design's own replace initial words of states in a copy of
//! the folder's package ([`package`]), and give them to the folder's reference, and nothing else.

use std::path::Path;
use std::time::Duration;

use pe_ir::program::{Host, Program};
use pe_sim::coverage::Coverage;
use serde_json::{Value, json};

use crate::Scratch;
use crate::climb::{self, Memory};
use crate::coverage::{self, MemoryWord, Table};
use crate::engines::{self, Bench, Engine, Job, compare, liveliness, simulate};
use crate::folder::{Change, DesignFolder};
use crate::handshake::{self, Handshake, Met};
use crate::host::{self, Play};
use crate::pace::{Efforts, Pace};
use crate::package::{self, InitialWord};
use crate::stimuli::{self, Candidate, Observed, Purpose};
use pe_flow::failure::Failure;

pub use crate::pace::{Listener, Nobody};

/// What to run.
#[derive(Clone, Debug)]
pub struct Options {
    /// Engines to compare with the simulator, in this order.
    pub engines: Vec<Engine>,
    /// Steps from each start, at most; none: as many as the reference trace has.
    pub steps: Option<u64>,
    /// The time to which starts and steps are fitted; none: all of them.
    pub within: Option<Duration>,
}

/// What was found out about a folder whose engines agree.
#[derive(Clone, Debug)]
pub struct Verdict {
    /// Files that are not what the report says.
    pub changes: Vec<Change>,
    /// The runs that were compared, as JSON.
    pub runs: Vec<Value>,
    /// What was at work in them, for the table.
    pub coverage: Table,
    /// The same for programs.
    pub seen: Coverage,
    /// Starts and steps for which there was no time.
    pub left_out: Vec<String>,
    /// Parts that rest in what was compared, if something was left out.
    pub resting: Vec<String>,
}

impl Verdict {
    /// What was left out, and what rests in what was compared: a line each.
    pub fn limits(&self) -> String {
        let left_out = self.left_out.iter().map(|what| ("left out", what));
        let resting = self.resting.iter().map(|what| ("at rest", what));
        left_out.chain(resting).map(|(kind, what)| format!("{kind:>14}   {what}\n")).collect()
    }

    /// The verdict for tools.
    pub fn json(&self) -> Value {
        let changes: Vec<String> = self.changes.iter().map(ToString::to_string).collect();
        json!({"generator": concat!("pe-synth ", env!("CARGO_PKG_VERSION")), "changed": changes, "runs": self.runs,
               "coverage": self.coverage.json(), "left_out": self.left_out, "at_rest": self.resting})
    }
}

/// Where a compared run starts.
#[derive(Clone)]
struct Start {
    name: String,
    steps: u64,
    /// With the images of this start.
    program: Program,
    /// What differs from the folder's images.
    words: Vec<InitialWord>,
    stimulus: Vec<Vec<i64>>,
    /// The stimulus as a file, unless it is the design's own.
    lines: Option<String>,
    /// Whether clock enable and steps are held back now and then.
    held: bool,
}

/// A start and what every engine must show from it.
struct Expected {
    start: Start,
    observed: Observed,
    handshake: Handshake,
    /// Memory writes, counted from the control words.
    writes: u64,
}

/// Makes starts, each with what those before had at work in mind.
struct Starts<'a> {
    program: &'a Program,
    seen: Coverage,
    met: Met,
    /// Number of starts so far.
    started: u64,
    memory: Memory,
}

/// Takes a start as soon as it is made; whether all engines showed it.
type Take<'a> = &'a mut dyn FnMut(Expected) -> Result<bool, Failure>;

/// Control words of all PEs that the run in motion takes, if that makes it longer than [`SHORT`] steps.
const LONG: u64 = 8_000;

/// Steps of the run in motion: at least, and at most.
const SHORT: u64 = 12;
const LONGEST: u64 = 256;

/// Control words of all PEs that the run in motion may take to see every tick twice.
const TICKING: u64 = 5 * LONG;

/// Runs in motion of designs with tables, at most.
const TABLES: u64 = 6;

/// Steps of a run that saturates: what saturates soon stays there.
const SATURATING: u64 = 5;

/// Runs that saturate, at most: a PE often saturates on one side only, and the first flag hides the others. Large
/// designs get fewer.
const SATURATIONS: u64 = 10;

/// Finds a start that has more at work.
type Seek = fn(&mut Memory, &Program, u64, &Coverage) -> Option<Candidate>;

/// A kind of starts that are made for the hardware.
struct Made {
    name: &'static str,
    /// At most so many.
    times: u64,
    steps: u64,
    seek: Seek,
    /// How many of them are likely.
    likely: u64,
    search: Efforts,
}

/// Starts that are sought, of each kind at most so many: their name, and what finds them.
const SOUGHT: [(&str, u64, Seek); 3] = [
    ("sums beyond the limits", 4, |_, program, steps, seen| climb::too_large_unsent(program, steps, seen)),
    ("operands too large", 4, |_, program, steps, seen| climb::too_large_operands(program, steps, seen)),
    (ENTRIES, MOST_ENTRIES, climb::unread_entries),
];

/// Name of starts that read entries of tables, and their number at most.
const ENTRIES: &str = "entries not read";
const MOST_ENTRIES: u64 = 64;

/// Steps of these: the first one does it, and the next one shows it.
const BRIEF: u64 = 2;

/// Name of starts that saturate.
const LIMITS: &str = "words at the limits";

/// Names of the first two starts where it is told what is at work.
const OWN: [&str; 2] = ["the beginning", "the middle"];

/// Judges a folder; the listener hears every line of the result as it is found, and how far it is.
///
/// # Errors
/// [`Failure::Mismatch`] if something is wrong with the design, or nothing was compared that moves; others if it cannot be
/// judged.
pub fn judge(path: &Path, options: &Options, listener: &dyn Listener) -> Result<Verdict, Failure> {
    let pace = Pace::new(&options.engines, options.within, listener);
    let (heard, built) = (|lines| pace.heard(lines), || pace.built());
    let scratch = Scratch::new()?;
    let folder = DesignFolder::open(path)?;
    let changes = folder.changes();
    for change in &changes {
        pace.say(&format!("{:>14}   {change}\n", "changed"));
    }
    let (beginning, line) = beginning(&folder, options)?;
    pace.say(&line);
    let bench = Bench::new(&folder.path, &folder.design, &scratch.folder("bench")?)?;
    let mut bench = bench.with(pace.children(&heard, &built));
    let (mut runs, mut moved) = (Vec::new(), Vec::new());
    let Starts { seen, met, .. } = Starts::make(&folder, options, beginning, &pace, &mut |expected| {
        for (at, engine) in options.engines.iter().enumerate() {
            let run = match expected.timed(&pace, &mut bench, *engine) {
                Err(Failure::Interrupted(_)) if pace.is_over() => {
                    let names: Vec<&str> = options.engines[at..].iter().map(|engine| engine.name()).collect();
                    pace.leave_out(format!("{} from {}", names.join(" and "), expected.start.name));
                    return Ok(false);
                }
                run => run?,
            };
            pace.say(&expected.line(*engine, &run));
            runs.push(expected.json(*engine, &run));
            if expected.live() > 0.0 {
                moved.push(*engine);
            }
        }
        pace.say(&format!("{:>14}   {:.1} % of the words are not zero and changing\n", "", 100.0 * expected.live()));
        Ok(true)
    })?;
    runs.extend(played(&folder, options, &pace, &mut bench)?);
    let coverage = Table::new(&folder.program, &seen, met);
    pace.say(&coverage.text());
    let left_out = pace.left_out();
    // Where nothing was compared, all of it rests.
    let resting = if runs.is_empty() { Vec::new() } else { coverage::resting(&folder.program, &seen) };
    if left_out.is_empty() && !resting.is_empty() {
        return Err(Failure::Mismatch(format!("nothing was shown of a part that rests: {}", resting.join("; "))));
    }
    let verdict = Verdict { changes, runs, coverage, seen, left_out, resting };
    pace.say(&verdict.limits());
    let still: Vec<&str> = options.engines.iter().filter(|e| !moved.contains(e)).map(|e| e.name()).collect();
    if let (Some(within), false) = (options.within, still.is_empty()) {
        return Err(Failure::Mismatch(format!(
            "nothing that moves was compared in {} within {within:?}: `--within` needs more time, or `--engines` fewer engines",
            still.join(" and ")
        )));
    }
    Ok(verdict)
}

/// Plays of a host in GHDL, as far as there is time.
fn played(folder: &DesignFolder, options: &Options, pace: &Pace, bench: &mut Bench) -> Result<Vec<Value>, Failure> {
    if folder.program.host == Host::default() {
        return Ok(Vec::new());
    }
    if !options.engines.contains(&Engine::Ghdl) {
        pace.say(&format!("{:>14}   nothing is shown of the ports for a host: only GHDL plays one\n", ""));
        return Ok(Vec::new());
    }
    let mut runs = Vec::new();
    let plays = if pace.is_over() { None } else { Some(host::plays(folder)?) };
    for play in plays.iter().flatten() {
        match play.judge(bench) {
            Err(Failure::Interrupted(_)) if pace.is_over() => break,
            judged => judged?,
        }
        pace.say(&play.line());
        runs.push(play.json());
    }
    if plays.is_none_or(|plays| runs.len() < plays.len()) {
        pace.leave_out("plays of a host".into());
    }
    Ok(runs)
}

/// All starts of a folder, the cheapest first: what damaged copies of its VHDL are judged by again and again.
pub struct Plan {
    design: String,
    runs: Vec<Expected>,
    plays: Vec<Play>,
    /// What is at work in the runs.
    seen: Coverage,
}

/// What a copy is judged by.
enum Judged<'a> {
    Run(&'a Expected),
    Play(&'a Play),
}

impl Plan {
    /// Makes the starts of a folder.
    ///
    /// # Errors
    /// As [`judge`].
    pub fn of(path: &Path, options: &Options) -> Result<Plan, Failure> {
        let folder = DesignFolder::open(path)?;
        let (beginning, _) = beginning(&folder, options)?;
        let mut runs = Vec::new();
        let pace = Pace::new(&[], None, &Nobody);
        let Starts { seen, .. } = Starts::make(&folder, options, beginning, &pace, &mut |expected| {
            runs.push(expected);
            Ok(true)
        })?;
        runs.sort_by_key(|run| run.handshake.control.len());
        Ok(Plan { plays: host::plays(&folder)?, design: folder.design, runs, seen })
    }

    /// Whether any run reads a word of a memory.
    pub fn reads(&self, word: MemoryWord) -> bool {
        word.is_read(&self.seen)
    }

    /// Judges the VHDL of a copy of the folder in GHDL, as [`judge`] does, up to the first run that fails: number of
    /// the runs before it, where it starts, and what is wrong.
    ///
    /// # Errors
    /// If the copy cannot be judged.
    pub fn judge(&self, copy: &Path, scratch: &Path) -> Result<Result<(), (usize, String, String)>, Failure> {
        let mut bench = Bench::new(copy, &self.design, scratch)?;
        let runs = self.runs.iter().map(|run| (run.start.name.as_str(), Judged::Run(run)));
        let plays = self.plays.iter().map(|play| (play.name(), Judged::Play(play)));
        for (passed, (name, judged)) in runs.chain(plays).enumerate() {
            let judged = match judged {
                Judged::Run(run) => run.compare(&mut bench, Engine::Ghdl).map(drop),
                Judged::Play(play) => play.judge(&mut bench),
            };
            match judged {
                Ok(()) => {}
                Err(Failure::Mismatch(message)) => return Ok(Err((passed, name.to_owned(), message))),
                Err(failure) => return Err(failure),
            }
        }
        Ok(Ok(()))
    }
}

/// The start with the design's own words, and the line that tells of its reference trace.
fn beginning(folder: &DesignFolder, options: &Options) -> Result<(Start, String), Failure> {
    let mut start = Start {
        name: "the beginning".into(),
        steps: 0,
        program: folder.program.clone(),
        words: Vec::new(),
        stimulus: folder.stimulus("stimulus")?,
        lines: None,
        held: false,
    };
    let (steps, line) = recorded(folder, &start)?;
    start.steps = options.steps.unwrap_or(steps);
    Ok((start, line))
}

/// Compares the design's reference trace with the simulator; returns the number of its steps, and a line that tells it.
fn recorded(folder: &DesignFolder, start: &Start) -> Result<(u64, String), Failure> {
    let recorded = engines::recorded(&folder.read("trace.txt")?, &folder.read("outputs.txt")?)
        .ok_or_else(|| folder.damaged("trace.txt", "it is damaged"))?;
    let steps = recorded.trace.len() as u64 / start.program.writes_per_step().max(1);
    engines::compare_recorded(&start.program, &recorded, steps, &start.stimulus).map_err(Failure::Mismatch)?;
    let writes = recorded.trace.len();
    Ok((steps, format!("reference trace = simulator: {writes} memory writes equal, {steps} steps\n")))
}

impl<'a> Starts<'a> {
    /// Makes them all, the design's own first.
    fn make(
        folder: &'a DesignFolder,
        options: &Options,
        beginning: Start,
        pace: &Pace,
        take: Take,
    ) -> Result<Starts<'a>, Failure> {
        let program = &folder.program;
        let middle = middle(folder, beginning.steps)?;
        let (seen, memory) = (Coverage::none(program), Memory::default());
        let mut starts = Starts { program, seen, met: Met::default(), started: 0, memory };
        let work = (program.pes.len() as u64 * u64::from(program.period)).max(1);
        let kinds = made(program, options, work);
        kinds.iter().for_each(|kind| pace.plan(kind.name, kind.likely, work * kind.steps, kind.search));
        OWN.iter().for_each(|name| pace.plan(name, 1, work * beginning.steps, Efforts::default()));
        if pace.within().is_some() && beginning.steps > BRIEF {
            // Tells what steps cost.
            starts.expect(Start { steps: BRIEF, ..beginning.clone() }, pace, take)?;
        }
        for (start, name) in [beginning, middle].into_iter().zip(OWN) {
            starts.own(start, name, work, pace, take)?;
        }
        for kind in kinds {
            starts.made(&kind, work * kind.steps, pace, take)?;
        }
        Ok(starts)
    }

    /// A start of the design's own, with as many of its steps as there is time for.
    fn own(&mut self, start: Start, name: &'static str, work: u64, pace: &Pace, take: Take) -> Result<(), Failure> {
        pace.done(name);
        let (all, from) = (start.steps, start.name.clone());
        match pace.steps(all, work) {
            None => pace.leave_out(format!("the start from {from}")),
            Some(steps) => {
                if steps < all {
                    pace.leave_out(format!("{} of {all} steps from {from}", all - steps));
                }
                self.expect(Start { steps, ..start }, pace, take)?;
            }
        }
        Ok(())
    }

    /// Runs of a kind that are made for the hardware, until no candidate shows more.
    fn made(&mut self, kind: &Made, words: u64, pace: &Pace, take: Take) -> Result<(), Failure> {
        let program = self.program;
        for number in 0..kind.times {
            if !pace.fits(kind.name, words) {
                let further = if number == 0 { "" } else { "further " };
                pace.leave_out(format!("{further}starts from {}", kind.name));
                break;
            }
            let found = pace.find(kind.name, || (kind.seek)(&mut self.memory, program, kind.steps, &self.seen));
            let Some(candidate) = found else { break };
            pace.begin(kind.name);
            let start = Start {
                name: kind.name.into(),
                steps: kind.steps,
                words: package::differences(program, &candidate.program),
                lines: Some(stimuli::lines(program, &candidate.stimulus)),
                program: candidate.program,
                stimulus: candidate.stimulus,
                held: true,
            };
            self.expect(start, pace, take)?;
        }
        pace.done(kind.name);
        Ok(())
    }

    /// What a start must show.
    fn expect(&mut self, start: Start, pace: &Pace, take: Take) -> Result<(), Failure> {
        let Start { name, steps, program, stimulus, .. } = &start;
        let writes = program.writes_per_step() * steps;
        let words = program.pes.len() as u64 * u64::from(program.period) * steps;
        let observed = pace.simulate(words, || stimuli::observe(program, stimulus, *steps));
        if observed.escaped {
            let what = format!("from {name}: a word of a PE without saturation is out of range");
            return Err(Failure::Mismatch(what));
        }
        agree(&start, &observed, writes)?;
        let held = start.held.then_some(self.started);
        let handshake = handshake::drive(program, *steps, observed.overflow_cycle, held);
        self.started += 1;
        let (coverage, met) = (observed.coverage.clone(), handshake.met);
        if take(Expected { start, observed, handshake, writes })? {
            self.seen.add(&coverage);
            self.met.add(&met);
        }
        let unread = || climb::unread_starts(self.program, &self.seen, &self.memory);
        pace.likely(ENTRIES, || unread().min(MOST_ENTRIES));
        Ok(())
    }
}

/// The kinds of starts that are made for the hardware.
fn made(program: &Program, options: &Options, work: u64) -> Vec<Made> {
    let most = options.steps.unwrap_or(u64::MAX);
    // A tick that is due once in a run might never be due again.
    let tick = program.ticks().map(|(_, tick, _)| u64::from(tick.steps) + 2).max().unwrap_or(0);
    let steps = (LONG / work).clamp(SHORT, LONGEST);
    let steps = if tick * work <= TICKING { steps.max(tick) } else { steps };
    // An entry of a table is read where its argument is.
    let tables = program.pes.iter().any(|pe| pe.features.index_words > 0);
    let in_motion: Seek = |_, program, steps, seen| stimuli::choose(program, Purpose::Motion, steps, seen);
    let saturating: Seek = |_, program, steps, seen| stimuli::choose(program, Purpose::Saturation, steps, seen);
    let choice = |name, times, likely, steps: u64, seek, purpose| {
        let steps = steps.min(most);
        Made { name, times, steps, seek, likely: times.min(likely), search: stimuli::effort(program, purpose, steps) }
    };
    let times = if tables { TABLES } else { 1 };
    let random = choice("random words", times, times, steps, in_motion, Purpose::Motion);
    // More PEs have more places to saturate, those of which it is proven have none.
    let saturate = program.pes.iter().filter(|pe| !pe.features.proven).count() as u64;
    let (times, likely) = ((LONG / work).clamp(1, SATURATIONS), (3 * saturate).saturating_sub(1));
    let limits = choice(LIMITS, times, likely, SATURATING, saturating, Purpose::Saturation);
    let sought = SOUGHT.map(|(name, times, seek)| {
        let likely = if name == ENTRIES && !tables { 0 } else { 1 };
        Made { name, times, steps: BRIEF.min(most), seek, likely, search: climb::effort(program, likely) }
    });
    [random, limits].into_iter().chain(sought).collect()
}

impl Expected {
    /// Runs an engine and compares what it shows.
    fn compare(&self, bench: &mut Bench, engine: Engine) -> Result<engines::Run, Failure> {
        let Expected { start, observed, handshake, writes } = self;
        let job = Job {
            steps: start.steps,
            words: &start.words,
            stimulus: start.lines.as_deref(),
            control: Some(&handshake.control),
        };
        let run = bench.run_until_difference(engine, &job, Some(&observed.run.trace))?;
        let has_handshake = engine.has_handshake();
        let clocks = if has_handshake { handshake.clocks } else { observed.run.clocks };
        let expected = engines::Run { clocks, ..observed.run.clone() };
        engine.compare(&start.program, &run, &expected, *writes).map_err(Failure::Mismatch)?;
        if has_handshake && let Some(what) = handshake::difference(&run.events, &handshake.events) {
            return Err(Failure::Mismatch(format!("{}: {what}", engine.name())));
        }
        Ok(run)
    }

    /// The same, with its time noted.
    fn timed(&self, pace: &Pace, bench: &mut Bench, engine: Engine) -> Result<engines::Run, Failure> {
        let program = &self.start.program;
        let words = program.pes.len() as u64 * u64::from(program.period) * self.start.steps;
        let outputs = program.outputs.len() as u64 * self.start.steps;
        let lines = match engine {
            Engine::Fast => program.states.len() as u64 * self.start.steps,
            _ => self.writes,
        };
        pace.run(engine, &self.start.name, words, lines + outputs, || self.compare(bench, engine))
    }

    fn live(&self) -> f64 {
        liveliness(&self.observed.run)
    }

    fn line(&self, engine: Engine, run: &engines::Run) -> String {
        let compared = match engine {
            Engine::Fast => format!("{} words of states", run.states.len()),
            _ => format!("{} memory writes", run.trace.len()),
        };
        format!(
            "{:>14} = simulator from {}: {compared} and {} outputs equal, {}\n",
            engine.name(),
            self.start.name,
            run.outputs.len(),
            duration(&self.start, &self.handshake, engine),
        )
    }

    fn json(&self, engine: Engine, run: &engines::Run) -> Value {
        json!({"start": self.start.name, "engine": engine.name(), "steps": self.start.steps, "writes": run.trace.len(),
               "states": run.states.len(), "outputs": run.outputs.len(), "live": self.live()})
    }
}

/// Steps and clocks of a run.
fn duration(start: &Start, handshake: &Handshake, engine: Engine) -> String {
    match (start.steps, start.held && engine.has_handshake()) {
        (steps, _) if engine == Engine::Fast => format!("{steps} steps"),
        (steps, true) => {
            let clocks = handshake.events.last().map_or(0, |event| event.clock);
            format!("{steps} steps in {clocks} clocks")
        }
        // A single step has no other one to count clocks to.
        (1, false) => "1 steps".to_owned(),
        (steps, false) => format!("{steps} steps, {} clocks per step", start.program.period),
    }
}

/// Compares the two simulators: what a step computes, and clock by clock.
fn agree(start: &Start, observed: &Observed, writes: u64) -> Result<(), Failure> {
    // What wrapped is known to one of them only.
    if observed.wrapped {
        return Ok(());
    }
    let simulated = simulate(&start.program, &start.stimulus, start.steps);
    compare(&start.program, "simulator clock by clock", &observed.run, &simulated, writes).map_err(Failure::Mismatch)
}

/// The middle of the span: states and inputs as they are there.
fn middle(folder: &DesignFolder, steps: u64) -> Result<Start, Failure> {
    let (step, words) = folder.checkpoint()?;
    let mut program = folder.program.clone();
    for (state, word) in program.states.iter().zip(&words) {
        state.set(&mut program.pes, &program.format, *word);
    }
    let stimulus = folder.stimulus("checkpoint_stimulus")?;
    Ok(Start {
        name: format!("step {step}"),
        steps,
        words: package::differences(&folder.program, &program),
        lines: Some(stimuli::lines(&program, &stimulus)),
        program,
        stimulus,
        held: true,
    })
}
