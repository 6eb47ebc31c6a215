//! The models of `models/`, through the pipeline as the command line takes them.

use std::path::{Path, PathBuf};

use clap::Parser;
use pe_flow::pipeline::{self, Design};
use pe_flow::spec::LoadedModel;
use pe_flow::watch::Stopwatch;
use pe_synth::options::DesignArgs;

use super::flow::Start;

/// A compiled model.
pub struct Compiled {
    pub loaded: LoadedModel,
    pub design: Design,
}

/// Path of a model's spec.
pub fn spec(model: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("../../models/{model}/{model}.spec"))
}

/// Compiles a model with options of the command line.
pub fn compile(model: &str, options: &[&str]) -> Compiled {
    compile_file(&spec(model), options)
}

/// Compiles a spec with options of the command line.
pub fn compile_file(spec: &Path, options: &[&str]) -> Compiled {
    let model = spec.display();
    let words = ["test".into(), spec.as_os_str().to_owned()].into_iter().chain(options.iter().map(Into::into));
    let options = DesignArgs::parse_from(words);
    let compiled = options.load().and_then(|loaded| {
        let design = options.design(&loaded, &mut Stopwatch::silent())?;
        Ok(Compiled { loaded, design })
    });
    compiled.unwrap_or_else(|failure| panic!("{model}: {failure:?}"))
}

impl Compiled {
    /// The run from the initial values.
    pub fn beginning(&self, steps: u64) -> Start {
        let stimulus = pipeline::stimulus(&self.loaded.model, &self.design, 0, steps);
        Start { name: "beginning", program: self.design.program.clone(), stimulus, step: 0 }
    }

    /// Both.
    pub fn starts(&self, steps: u64) -> [Start; 2] {
        [self.beginning(steps), self.middle(steps)]
    }

    /// The run from the middle of the span.
    pub fn middle(&self, steps: u64) -> Start {
        let checkpoint = &self.design.judged.checkpoint;
        assert!(checkpoint.step > 0, "{}: the span has no middle", self.loaded.model.name);
        let mut program = self.design.program.clone();
        for (register, word) in program.states.iter().zip(&checkpoint.words) {
            register.set(&mut program.pes, &program.format, *word);
        }
        let stimulus = pipeline::stimulus(&self.loaded.model, &self.design, checkpoint.step, steps);
        Start { name: "middle", program, stimulus, step: checkpoint.step }
    }
}

/// Parameters that are written at run time, inputs, ticks, and two outputs that show no state: one has no sample 0.
pub const TUNED: &str = "\
model tuned
solver rk4
step 1 ms
span 200 ms
index i in 1..2
param rate [1/s] = 5 tunable in 1 .. 10
param gain[i] = i tunable in -2 .. 4
input drive = sine(1, 20 Hz) in -1 .. 1
input level = 2 in 1 .. 3
state x = 1
state y[i] = 0
x' = drive - rate*x
y[i]' = gain[i]*x - 3*y[i]
every 10 ms {
  state u = 0
  next u = u/2 + x
}
run = x*gain[1] + drive
share = x/level
output x, y, u, run, share
";
