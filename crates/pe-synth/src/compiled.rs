//! A compiled design and its files.

use pe_emit::EmitOptions;
use pe_flow::failure::Failure;
use pe_flow::pipeline::{self, Design};
use pe_flow::report::Report;
use pe_flow::spec::LoadedModel;
use pe_flow::variables::{self, Variable};
use pe_flow::watch::Stopwatch;
use pe_sim::machine::Machine;

use crate::command::shown_path;
use crate::origin;
use crate::output::OutputFolder;
use crate::page::{self, About, Shown};

/// Lines of the reference trace that is written with a design, roughly.
const TRACE_LINES: u64 = 120_000;

/// A compiled design, with all that is told of it.
pub struct Compiled {
    /// The model with the design's solver and step.
    pub loaded: LoadedModel,
    /// The design.
    pub design: Design,
    /// The least and largest numbers of what it computes.
    pub variables: Vec<Variable>,
    /// The report; which files there are is known when they are written.
    pub report: Report,
    /// Rows of the table beside those of the report.
    pub rows: String,
    /// What its files say made them.
    pub command: String,
}

/// Files that are written on request.
#[derive(Clone, Copy, Debug)]
pub struct Files {
    /// The C header of the reference.
    pub header: bool,
    /// The pictures.
    pub pictures: bool,
}

impl Compiled {
    /// Writes all files of the design but the times that it took.
    ///
    /// # Errors
    /// If one cannot be written.
    pub fn write(&self, folder: &OutputFolder, files: Files, watch: &mut Stopwatch) -> Result<(), Failure> {
        let Compiled { loaded, design, variables, .. } = self;
        let target = folder.target().display().to_string();
        watch.stage("write", || self.write_design(folder, files.header), |_| target)?;
        folder.write(&format!("{}_variables.csv", self.name()), &variables::table(variables))?;
        if files.pictures {
            let model = &loaded.model;
            let about = About { command: &self.command, rows: self.report.rows(&model.size().to_string()) };
            let shown = || Shown::of(model, design, variables);
            let told = |drawn: &Vec<_>| format!("{} pictures", drawn.len() - 1);
            let drawn = watch.stage("draw", || drawn(&shown(), &about), told);
            for (path, text) in &drawn {
                folder.write(path, text)?;
            }
        }
        let report = Report { files: folder.hashes(), ..self.report.clone() };
        folder.write("report.json", &report.text())
    }

    /// The design in words, as `compile` prints it.
    pub fn table(&self) -> String {
        self.report.table(&self.loaded.model.size().to_string()) + &self.rows
    }

    /// First part of the names of its files.
    pub fn name(&self) -> String {
        pe_emit::design_name(&self.design.program)
    }

    /// Words of all input ports for so many steps from a step on, as the spec drives them; by step.
    pub fn stimulus(&self, from: u64, steps: u64) -> Vec<Vec<i64>> {
        pipeline::stimulus(&self.loaded.model, &self.design, from, steps)
    }

    /// What hosts need to know of it.
    pub fn map(&self) -> String {
        pe_emit::map(&self.design.program, &self.emit_options(false, Vec::new(), 0))
    }

    fn emit_options(&self, c_header: bool, stimulus: Vec<Vec<i64>>, steps: u32) -> EmitOptions {
        let LoadedModel { model, sources, .. } = &self.loaded;
        EmitOptions {
            command: self.command.clone(),
            spec: shown_path(sources.main().name()).to_owned(),
            files: origin::files(sources),
            provenance: origin::provenance(&self.design, &self.loaded),
            interface: origin::interface(model),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            stimulus,
            c_header,
            default_steps: steps,
        }
    }

    fn write_design(&self, folder: &OutputFolder, header: bool) -> Result<(), Failure> {
        let Compiled { loaded: LoadedModel { model, .. }, design, .. } = self;
        let steps = trace_steps(&design.program, model.steps());
        let stimulus = self.stimulus(0, steps);
        let options = self.emit_options(header, stimulus.clone(), steps as u32);
        for artefact in pe_emit::emit(&design.program, &options) {
            folder.write(&artefact.path, &artefact.text)?;
        }
        let name = self.name();
        folder.write(&format!("{name}_program.txt"), &design.program.to_string())?;
        let (trace, outputs) = reference_trace(design, &stimulus);
        folder.write(&format!("{name}_trace.txt"), &trace)?;
        folder.write(&format!("{name}_outputs.txt"), &outputs)?;
        let checkpoint = &design.judged.checkpoint;
        let words: String = checkpoint.words.iter().map(|word| format!("{word:x}\n")).collect();
        folder.write(&format!("{name}_checkpoint.txt"), &format!("step {}\n{words}", checkpoint.step))?;
        let stimulus = self.stimulus(checkpoint.step, steps);
        let line = |words: &Vec<i64>| {
            let mask = u64::MAX >> (64 - design.program.format.storage_bits);
            words.iter().map(|word| format!("{:x}", *word as u64 & mask)).collect::<Vec<_>>().join(" ") + "\n"
        };
        folder.write(&format!("{name}_checkpoint_stimulus.txt"), &stimulus.iter().map(line).collect::<String>())
    }
}

/// The pictures of a design, and its page as the last file.
fn drawn(shown: &Shown, about: &About) -> Vec<(String, String)> {
    let mut drawn = crate::pictures::draw(shown);
    let pictures: Vec<&str> = drawn.iter().map(|(path, _)| path.as_str()).collect();
    let page = page::draw(shown, about, &pictures);
    drawn.push((page::FILE.to_owned(), page));
    drawn
}

/// Steps of the reference trace: enough to see the model move, few enough to stay readable.
fn trace_steps(program: &pe_ir::program::Program, span: u64) -> u64 {
    (TRACE_LINES / program.writes_per_step().max(1)).clamp(2, 24).min(span)
}

/// Memory writes and outputs of the first steps, in the trace format.
fn reference_trace(design: &Design, stimulus: &[Vec<i64>]) -> (String, String) {
    let mut machine = Machine::new(&design.program);
    let mut trace = String::new();
    let mut outputs = String::new();
    let mask = u64::MAX >> (64 - design.program.format.storage_bits);
    for (step, inputs) in stimulus.iter().enumerate() {
        machine.step(inputs, &mut |line| trace += &format!("{line}\n"));
        assert!(!machine.escaped(), "step {step}: a word is out of range, which was proven impossible");
        for (index, word) in machine.outputs().iter().enumerate() {
            outputs += &format!("{step} {index} {:x}\n", *word as u64 & mask);
        }
    }
    (trace, outputs)
}
