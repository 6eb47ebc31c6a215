//! The passes from model to program, in the order in which they run.

/// A pass: what it is called, what goes in and what comes out.
#[derive(Clone, Copy, Debug)]
pub struct Pass {
    /// Its module, and the folder of its cases in `tests/passes`.
    pub name: &'static str,
    /// What it reads.
    pub reads: &'static str,
    /// What it makes.
    pub makes: &'static str,
    /// What it is for.
    pub purpose: &'static str,
}

const fn pass(name: &'static str, reads: &'static str, makes: &'static str, purpose: &'static str) -> Pass {
    Pass { name, reads, makes, purpose }
}

/// All passes. Runs over the span lie between `step` and `functions`, and between `split` and `formats`: ranges come
/// from them.
pub const PASSES: &[Pass] = &[
    pass("fuse", "Model", "Model", "writes out equations within functions of one variable"),
    pass("lift", "Model", "Model", "makes functions of one variable equations of their own"),
    pass("step", "Model", "StepGraph", "writes one step of the method as chains of products"),
    pass("functions", "StepGraph", "StepGraph", "replaces functions by function tables"),
    pass("split", "StepGraph", "StepGraph", "splits heavy equations into partial sums"),
    pass("grid", "StepGraph", "StepGraph", "cuts sums over nearly everything to suit a grid of PEs"),
    pass("shorten", "StepGraph", "StepGraph", "evaluates polynomials of tables with squares where latency binds"),
    pass("sums", "StepGraph", "StepGraph", "cuts sums that the accumulator does not hold"),
    pass("parts", "StepGraph", "StepGraph", "gives parts of a step that are alike the same terms"),
    pass("two_slots", "StepGraph", "StepGraph", "gives coefficients a second issue slot on request"),
    pass("formats", "StepGraph", "FixedPoint", "chooses a number format for every value"),
    pass("rounding", "StepGraph", "FixedPoint", "rounds coefficients so that errors cancel"),
    pass("rings", "StepGraph, FixedPoint", "StepGraph, FixedPoint", "keeps long rows of past words in rings of memory"),
    pass("relay", "StepGraph", "StepGraph", "copies what many equations read of several others"),
    pass("mapping", "StepGraph", "Mapping", "assigns every equation to a PE"),
    pass("route", "StepGraph, Mapping", "StepGraph, Mapping", "lets values travel over PEs that copy them"),
    pass("pairs", "StepGraph, Mapping", "StepGraph", "joins operands with equal coefficients"),
    pass("schedule", "StepGraph, Mapping", "Schedule", "assigns every chain and transfer to a control word"),
    pass("rounds", "StepGraph, Schedule", "Schedule", "runs stages that are alike as rounds of one program"),
    pass("assemble", "StepGraph, Schedule", "Program", "writes control words, memory images and links"),
    pass("outputs", "Program", "Program", "moves outputs into memories"),
];
