//! `pe-synth import`: a model of another format becomes a spec.

use std::path::{Path, PathBuf};

use pe_flow::failure::Failure;
use pe_import::{Settings, Wanted};
use pe_ir::model::Solver;
use pe_judge::DesignPoint;
use pe_judge::parse::duration;

use crate::console;
use crate::import::compare::{self, Results};
use crate::import::propose::{self, Asked};
use crate::import::{self, suite};
use crate::messages::{MessageFormat, print_findings};
use crate::options;
use crate::output;

/// Writes a model of another format as a spec: SBML of levels 2 and 3, CellML, Myokit, DiffSL
///
/// What a spec cannot express is told as a whole, each with its place, and nothing is written then.
#[derive(clap::Args, Debug)]
#[command(
    override_usage = "pe-synth import [OPTIONS] <FILE>\n       pe-synth import [OPTIONS] --suite <FOLDER>",
    after_help = "\
Examples:
  pe-synth import model.xml -o model.spec
  pe-synth import model.xml -o model.spec --outputs S1,S2 --span 100s
  pe-synth import model.xml -o model.spec --compare results.csv --relative 1e-4
  pe-synth import --suite cases/semantic -o table.md"
)]
pub struct Import {
    /// The model
    #[arg(required_unless_present = "suite", conflicts_with = "suite")]
    file: Option<PathBuf>,
    /// The spec, or the table of a suite [default: standard output]
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<PathBuf>,
    /// Outputs, by their names in the model [default: what changes]
    #[arg(long, value_name = "NAME[,NAME...]", value_delimiter = ',', help_heading = "Model")]
    outputs: Vec<String>,
    /// Numerical method [default: by the fastest rate at the beginning]
    #[arg(long, value_parser = options::solver(), help_heading = "Model")]
    solver: Option<Solver>,
    /// Step [default: by the fastest rate at the beginning]
    #[arg(long, value_name = "T", value_parser = duration, help_heading = "Model")]
    step: Option<f64>,
    /// Time over which the model is run [default: what the file or the settings say]
    #[arg(long, value_name = "T", value_parser = duration, help_heading = "Model")]
    span: Option<f64>,
    /// Settings in the form of the SBML Test Suite: outputs, span, rows, tolerances
    #[arg(long, value_name = "FILE", conflicts_with = "outputs", help_heading = "Model")]
    settings: Option<PathBuf>,
    /// Compares the fixed-point run with the columns of a CSV file over its first column, the time
    #[arg(long, value_name = "FILE", help_heading = "Comparison")]
    compare: Option<PathBuf>,
    /// Difference that is always allowed [default: that of the settings, else 1e-6]
    #[arg(long, value_name = "D", value_parser = options::positive, help_heading = "Comparison")]
    absolute: Option<f64>,
    /// Difference that is allowed for each unit of the result [default: that of the settings, else 1e-3]
    #[arg(long, value_name = "D", value_parser = options::positive, help_heading = "Comparison")]
    relative: Option<f64>,
    /// Imports all cases of a folder of the SBML Test Suite, compares each with its results and writes a table
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["settings", "compare", "outputs"], help_heading = "Comparison")]
    suite: Option<PathBuf>,
    /// Cases of the suite whose names begin so; may be repeated
    #[arg(long, value_name = "NAME", requires = "suite", help_heading = "Comparison")]
    case: Vec<String>,
    /// Prints errors and warnings only
    #[arg(short, long, help_heading = "Diagnostics")]
    quiet: bool,
    /// Format of errors and warnings on standard error
    #[arg(long, value_enum, default_value_t, help_heading = "Diagnostics")]
    message_format: MessageFormat,
}

impl Import {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.message_format
    }

    /// Runs the command.
    ///
    /// # Errors
    /// What cannot be expressed; results that differ.
    pub fn run(&self) -> Result<(), Failure> {
        match (&self.file, &self.suite) {
            (_, Some(folder)) => self.write(&suite::page(&suite::run(
                folder,
                &self.case,
                self.quiet || self.message_format == MessageFormat::Json,
            )?)),
            (Some(file), None) => self.import(file),
            (None, None) => Err(Failure::Usage("give a model, or `--suite FOLDER`".to_owned())),
        }
    }

    fn import(&self, file: &Path) -> Result<(), Failure> {
        let settings = self.settings.as_deref().map(settings).transpose()?;
        let results = self.compare.as_deref().map(Results::read).transpose()?;
        let tolerances = settings.as_ref().map_or((1e-6, 1e-3), |settings| settings.tolerances);
        let tolerances = (self.absolute.unwrap_or(tolerances.0), self.relative.unwrap_or(tolerances.1));
        let of_settings = settings.as_ref();
        let wanted = match settings.clone() {
            Some(settings) => Wanted::Suite(settings),
            None if self.outputs.is_empty() => Wanted::Usual,
            None => Wanted::Named(self.outputs.clone()),
        };
        let (imported, sources) = import::read(file, &wanted)?;
        print_findings(&imported.warnings, &sources, self.message_format);
        let of_model = |seconds: f64| seconds / imported.model.seconds();
        let asked = Asked {
            solver: self.solver,
            step: self.step.map(of_model),
            span: self
                .span
                .map(of_model)
                .or(of_settings.map(|settings| settings.start + settings.duration))
                .or(results.as_ref().map(Results::end)),
            interval: of_settings
                .map(|settings| settings.duration / f64::from(settings.steps))
                .or(results.as_ref().map(Results::interval)),
        };
        let name = self.output.as_deref().map_or("the spec".to_owned(), |path| path.display().to_string());
        let setting = propose::setting(&imported, &asked, &name)?;
        // What is written has been read back.
        let loaded = import::load(&imported, &setting, &name)?;
        self.write(&imported.spec(&setting))?;
        let Some(results) = results else { return Ok(()) };
        let columns: Vec<(String, String)> =
            imported.columns().into_iter().map(|(column, output)| (column.to_owned(), output.to_owned())).collect();
        let found = compare::compare(
            &loaded,
            &DesignPoint::default(),
            &results,
            &columns,
            tolerances,
            imported.model.seconds(),
        )?;
        let table = compare::table(&found);
        match &self.output {
            _ if self.quiet => {}
            Some(_) => console::out(&table)?,
            None => console::err(&table),
        }
        match found.iter().filter(|column| column.ratio > 1.0).count() {
            0 => Ok(()),
            count => Err(Failure::Mismatch(format!(
                "{count} of {} columns differ by more than their tolerance",
                found.len()
            ))),
        }
    }

    fn write(&self, text: &str) -> Result<(), Failure> {
        match &self.output {
            Some(path) => output::write_file(path, text.as_bytes()),
            None => console::out(text),
        }
    }
}

/// Reads settings of the suite.
fn settings(path: &Path) -> Result<Settings, Failure> {
    let text = std::fs::read_to_string(path).map_err(|error| Failure::file("read", path, error))?;
    Settings::read(&text).map_err(|problem| Failure::file("read", path, problem))
}
