//! Judges a compiled folder: every engine against the simulator, bit for bit, from the files as they lie there.
//!
//! In: a folder that `compile` wrote, or a copy that something was done to. Out: a [`Verdict`], or the first thing that
//! is wrong. Nothing is emitted anew: other starts than the design's own replace initial words of states in a copy of
//! the folder's package ([`package`]), and give them to the folder's reference, and nothing else.

pub mod folder;
pub mod handshake;
pub mod package;

use std::path::Path;

use pe_ir::program::Program;

use crate::cmd_verify::Scratch;
use crate::engines::{self, Bench, Engine, Job, compare, liveliness, simulate};
use crate::failure::Failure;
use folder::{Change, DesignFolder};
use package::InitialWord;

/// What to run.
#[derive(Clone, Debug)]
pub struct Options {
    /// Engines to compare with the simulator, in this order.
    pub engines: Vec<Engine>,
    /// Steps from each start; none: as many as the reference trace has.
    pub steps: Option<u64>,
}

/// What was found out about a folder whose engines agree.
#[derive(Clone, Debug)]
pub struct Verdict {
    /// Files that are not what the report says.
    pub changes: Vec<Change>,
}

/// Where a compared run starts.
struct Start {
    name: String,
    /// With the images of this start.
    program: Program,
    /// What differs from the folder's images.
    words: Vec<InitialWord>,
    stimulus: Vec<Vec<i64>>,
    /// The stimulus as a file, unless it is the design's own.
    lines: Option<String>,
}

/// Judges a folder; every line of the result goes to `say` as it is found.
///
/// # Errors
/// [`Failure::Mismatch`] if something is wrong with the design; others if it cannot be judged.
pub fn judge(path: &Path, options: &Options, say: &mut dyn FnMut(&str)) -> Result<Verdict, Failure> {
    let scratch = Scratch::new()?;
    let folder = DesignFolder::open(path)?;
    let changes = folder.changes();
    for change in &changes {
        say(&format!("{:>14}   {change}\n", "changed"));
    }
    let beginning = Start {
        name: "the beginning".into(),
        program: folder.program.clone(),
        words: Vec::new(),
        stimulus: folder.stimulus("stimulus")?,
        lines: None,
    };
    let recorded = recorded(&folder, &beginning, say)?;
    let steps = options.steps.unwrap_or(recorded);
    let mut bench = Bench::new(&folder.path, &folder.design, &scratch.folder("bench")?)?;
    for start in [beginning, middle(&folder)?] {
        run(&start, options, &mut bench, steps, say)?;
    }
    Ok(Verdict { changes })
}

/// Compares the design's reference trace with the simulator; returns the number of its steps.
fn recorded(folder: &DesignFolder, start: &Start, say: &mut dyn FnMut(&str)) -> Result<u64, Failure> {
    let recorded = engines::recorded(&folder.read("trace.txt")?, &folder.read("outputs.txt")?)
        .ok_or_else(|| folder.damaged("trace.txt", "it is damaged"))?;
    let steps = recorded.trace.len() as u64 / start.program.writes_per_step().max(1);
    engines::compare_recorded(&start.program, &recorded, steps, &start.stimulus).map_err(Failure::Mismatch)?;
    let writes = recorded.trace.len();
    say(&format!("reference trace = simulator: {writes} memory writes equal, {steps} steps\n"));
    Ok(steps)
}

/// Compares the engines from one start.
fn run(
    start: &Start,
    options: &Options,
    bench: &mut Bench,
    steps: u64,
    say: &mut dyn FnMut(&str),
) -> Result<(), Failure> {
    let expected = simulate(&start.program, &start.stimulus, steps);
    let writes = start.program.writes_per_step() * steps;
    let job = Job { steps, words: &start.words, stimulus: start.lines.as_deref(), control: None };
    for engine in &options.engines {
        let run = bench.run(*engine, &job)?;
        compare(&start.program, engine.name(), &run, &expected, writes).map_err(Failure::Mismatch)?;
        // A single step has no other one to count clocks to.
        let clocks = if steps < 2 { String::new() } else { format!(", {} clocks per step", run.clocks) };
        say(&format!(
            "{:>14} = simulator from {}: {} memory writes and {} outputs equal, {steps} steps{clocks}\n",
            engine.name(),
            start.name,
            run.trace.len(),
            run.outputs.len(),
        ));
    }
    let live = 100.0 * liveliness(&expected);
    say(&format!("{:>14}   {live:.1} % of the words are not zero and changing\n", ""));
    Ok(())
}

/// The middle of the span: states and inputs as they are there.
fn middle(folder: &DesignFolder) -> Result<Start, Failure> {
    let (step, words) = folder.checkpoint()?;
    let mut program = folder.program.clone();
    for (state, word) in program.states.iter().zip(&words) {
        state.set(&mut program.pes, &program.format, *word);
    }
    let stimulus = folder.stimulus("checkpoint_stimulus")?;
    Ok(Start {
        name: format!("step {step}"),
        words: package::differences(&folder.program, &program),
        lines: Some(lines(&program, &stimulus)),
        program,
        stimulus,
    })
}

/// Input words as a stimulus file has them: padded, for VHDL reads no others.
fn lines(program: &Program, stimulus: &[Vec<i64>]) -> String {
    let bits = program.format.storage_bits;
    let digits = bits.div_ceil(4) as usize;
    let word = |word: &i64| format!("{:0digits$x}", *word as u64 & (u64::MAX >> (64 - bits)));
    let line = |words: &Vec<i64>| words.iter().map(word).collect::<Vec<_>>().join(" ") + "\n";
    stimulus.iter().map(line).collect()
}
