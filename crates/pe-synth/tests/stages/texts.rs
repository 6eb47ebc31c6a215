//! The text forms of all stages: exactly what was printed is read back, and damaged texts are refused with a place.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use pe_flow::spec::ModelFolder;
use pe_ir::graph::StepGraph;
use pe_ir::model::{Model, Solver};
use pe_ir::source::{Sources, Span};
use pe_ir::text::Stage;

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models")
}

/// The specs of the validation set, and those of the shipped models that compile in a moment.
fn specs() -> Vec<PathBuf> {
    let large = [
        "lutchen4000",
        "wave80",
        "weibel11",
        "weibel11_pressure",
        "weibel11_square",
        "atrial15",
        "gray_scott",
        "dense42",
    ];
    let mut specs: Vec<PathBuf> = Vec::new();
    for entry in fs::read_dir(models()).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        let spec = path.join(format!("{name}.spec"));
        if spec.exists() && !large.contains(&name.as_str()) {
            specs.push(spec);
        }
    }
    for entry in fs::read_dir(models().join("validation")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "spec") {
            specs.push(path);
        }
    }
    specs.sort();
    specs
}

fn load(spec: &Path) -> Model {
    let mut sources = Sources::new("m.spec", &fs::read_to_string(spec).unwrap());
    let (model, _) = pe_frontend::compile(&mut sources, &ModelFolder::of(spec), &pe_frontend::Overrides::default())
        .unwrap_or_else(|findings| panic!("{}: {findings:?}", spec.display()));
    pe_hls::lift::lift(model)
}

/// A model without places in its spec, in full.
fn bare(model: &Model) -> String {
    format!("{:?}", model.without_spans())
}

fn bare_graph(graph: &StepGraph) -> String {
    let mut graph = graph.clone();
    graph.equations.iter_mut().for_each(|equation| equation.span = Span::default());
    format!("{graph:?}")
}

#[test]
fn models_and_steps_are_read_as_they_were_printed() {
    let mut failures = Vec::new();
    for spec in specs() {
        let model = load(&spec);
        let text = model.to_string();
        let name = spec.file_stem().unwrap().to_str().unwrap();
        match text.parse::<Model>() {
            Ok(read) if bare(&read) == bare(&model) => assert_eq!(read.to_string(), text, "{name}"),
            Ok(_) => failures.push(format!("{name}: another model")),
            Err(error) => {
                failures.push(format!("{name}: {error}\n  {}", text.lines().nth(error.line - 1).unwrap_or("")))
            }
        }
        let graph = match pe_hls::step::build(&model) {
            Ok(graph) => graph,
            Err(_) => continue,
        };
        check_step(name, &graph, &mut failures);
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

fn check_step(name: &str, graph: &StepGraph, failures: &mut Vec<String>) {
    let text = graph.to_string();
    match text.parse::<StepGraph>() {
        Ok(read) if bare_graph(&read) == bare_graph(graph) => assert_eq!(read.to_string(), text, "{name}"),
        Ok(read) => failures.push(format!("{name}: another step: {}", parting(&bare_graph(&read), &bare_graph(graph)))),
        Err(error) => failures.push(format!("{name}: {error}\n  {}", text.lines().nth(error.line - 1).unwrap_or(""))),
    }
}

/// What two texts have around the first character that differs.
fn parting(one: &str, other: &str) -> String {
    let same = one.chars().zip(other.chars()).take_while(|(one, other)| one == other).count();
    let around = |text: &str| text.chars().skip(same.saturating_sub(100)).take(200).collect::<String>();
    format!("`{}` is not `{}`", around(one), around(other))
}

#[test]
fn steps_of_every_method_are_read_as_they_were_printed() {
    let mut failures = Vec::new();
    for name in
        ["lotka_volterra", "harmonic_oscillator", "hodgkin_huxley", "pendulum", "motor_pid", "rc_ladder", "kepler"]
    {
        let model = load(&models().join(name).join(format!("{name}.spec")));
        for solver in Solver::ALL {
            if let Ok(graph) = pe_hls::step::build(&Model { solver, ..model.clone() }) {
                check_step(&format!("{name}, {}", solver.name()), &graph, &mut failures);
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// A folder of a test's own, empty at first.
fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("texts").join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

fn pe_synth(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(words).output().unwrap()
}

/// What a command that must succeed prints.
fn printed(words: &[&str]) -> String {
    let output = pe_synth(words);
    assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// All files of a design without its report, pictures, and the lines that name the command or the spec.
fn files(folder: &Path) -> Vec<(PathBuf, String)> {
    let (mut waiting, mut found) = (vec![folder.to_owned()], Vec::new());
    while let Some(next) = waiting.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap().to_owned();
            if path.is_dir() {
                waiting.push(path);
            } else if !name.starts_with("report") {
                let text = fs::read_to_string(&path).unwrap();
                let origin = ["pe-synth", "generated", "SHA-256", ".spec:"];
                let kept = text.lines().filter(|line| !origin.iter().any(|word| line.contains(word)));
                found.push((path.strip_prefix(folder).unwrap().to_owned(), kept.collect::<Vec<_>>().join("\n")));
            }
        }
    }
    found.sort();
    found
}

/// The text up to a stage: a section and all before it.
fn up_to(text: &str, stage: Stage) -> String {
    let next = Stage::ALL.into_iter().find(|other| *other > stage);
    let end = next.and_then(|next| text.find(&format!("{}\n", next.header())));
    text[..end.unwrap_or(text.len())].to_owned()
}

/// Compiles a model from its spec and from each stage that can be dumped; the files must be the same.
fn compare(name: &str, options: &[&str]) {
    let home = folder(name);
    let spec = models().join(name).join(format!("{name}.spec"));
    let spec = spec.to_str().unwrap();
    let path = |file: &str| home.join(file).to_str().unwrap().to_owned();
    let target = path("spec");
    printed(&[&["compile", spec, "-q", "--no-pictures", "-o", &target], options].concat());
    let expected = files(&home.join("spec"));
    assert!(expected.len() > 5, "{name}");
    let dump = |stage: &str| printed(&[&["dump", "--stage", stage, spec], options].concat());
    let (schedule, program) = (dump("schedule"), dump("program"));
    for stage in Stage::ALL {
        // What a stage hands on holds all stages before it, but that a program has the schedule of its rounds.
        let text = if stage == Stage::Program { program.clone() } else { up_to(&schedule, stage) };
        let (file, target) = (path(&format!("{}.txt", stage.name())), path(stage.name()));
        fs::write(&file, &text).unwrap();
        let words = ["compile", "--from", &file, "-q", "--no-pictures", "-o", &target];
        // Options that the text has decided cannot be asked for again.
        let pes = if stage < Stage::Mapping { 0 } else { 2 };
        let solver = options.iter().position(|option| *option == "--solver").filter(|_| stage > Stage::Model);
        let options = &options[pes..solver.unwrap_or(options.len())];
        printed(&[&words, options].concat());
        for ((path, found), (_, wanted)) in files(&home.join(stage.name())).iter().zip(&expected) {
            assert!(found == wanted, "{name} from {}: {} differs", stage.name(), path.display());
        }
        let again = printed(&[&["dump", "--from", &file, "--stage", stage.name()], options].concat());
        assert!(again == text, "{name}: dump from {} prints another text", stage.name());
    }
}

#[test]
fn a_design_from_the_text_of_any_stage_is_the_same() {
    for (name, span) in [
        ("lorenz", "500ms"),
        ("lotka_volterra", "2s"),
        ("hodgkin_huxley", "20ms"),
        ("motor_pid", "20ms"),
        ("wave6", "2ms"),
        ("rc_ladder", "20ms"),
        ("lutchen_breathing", "100ms"),
    ] {
        compare(name, &["--pes", "2", "--span", span]);
    }
}

#[test]
fn other_words_and_rounds_come_back_from_texts() {
    let all = ["--span", "500ms", "--multiplier", "25x18", "--storage", "24", "--pipeline", "deep"];
    compare("harmonic_oscillator", &[&["--pes", "2"], &all[..]].concat());
    compare("rc_ladder", &["--pes", "1", "--span", "20ms", "--loop", "on"]);
    // Quantities of this method share their names.
    compare("van_der_pol", &["--pes", "2", "--span", "500ms", "--solver", "trapezoidal"]);
    compare("rc_ladder", &["--pes", "2", "--span", "20ms", "--multiplier", "25x18", "--coefficients", "two-slot"]);
}

/// The complaint about a text in place of the one that `dump` printed.
fn complaint(test: &str, text: &str, options: &[&str]) -> (Option<i32>, String) {
    let file = folder("complaints").join(format!("{test}.txt"));
    fs::write(&file, text).unwrap();
    let output = pe_synth(&[&["dump", "--stage", "program", "--from", file.to_str().unwrap()], options].concat());
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn what_is_wrong_in_a_text_is_told_with_its_place() {
    let spec = models().join("van_der_pol/van_der_pol.spec");
    let words = ["dump", "--stage", "schedule", "--span", "1s", "--pes", "2", spec.to_str().unwrap()];
    let text = printed(&words);
    let line = |start: &str| text.lines().find(|line| line.starts_with(start)).unwrap();
    let start = line("chain x");
    let moved = text.replacen(line("chain x.next start"), "chain x.next start 0", 1);
    let moved = if moved == text { text.replacen(" start ", " start 1", 1) } else { moved };
    for (test, broken, place, message) in [
        ("name", text.replacen(start, "chain nothing = (1*x)", 1), "name.txt:", "`nothing` is not the name of a value"),
        ("version", text.replacen("step 1\n", "step 2\n", 1), "version.txt:", "expected version 1"),
        ("formats", text.replacen("product -", "product -1", 1), "formats.txt:", "these formats do not fit the step"),
        ("mapping", text.replacen("\ny 1\n", "\ny 3\n", 1).replacen("\ny 0\n", "\ny 3\n", 1), "mapping.txt:", "PE"),
        ("moved", moved, "moved.txt:", "this schedule is wrong"),
        ("gap", up_to(&text, Stage::Model) + &text[text.find("pe-synth fixed").unwrap()..], "gap.txt:", "is missing"),
        ("empty", String::new(), "empty.txt", "expected the header of a stage"),
    ] {
        assert_ne!(broken, text, "{test}");
        let (code, complaint) = complaint(test, &broken, &[]);
        assert_eq!(code, Some(1), "{test}: {complaint}");
        assert!(complaint.contains("error[E0809]") || complaint.contains("error[E0808]"), "{test}: {complaint}");
        assert!(complaint.contains(place) && complaint.contains(message), "{test}: {complaint}");
    }
    for options in [
        &["--solver", "euler"][..],
        &["--step", "1ms"],
        &["--form", "horner"],
        &["--span", "2s"],
        &["--storage", "24"],
        &["--multiplier", "25x18"],
        &["--pipeline", "deep"],
        &["--coefficients", "two-slot"],
        &["--pes", "1"],
        &["--mapping", "x.map"],
        &["--set", "mu=2"],
        &["--observe", "x"],
    ] {
        let (code, complaint) = complaint("options", &text, options);
        assert_eq!(code, Some(2), "{options:?}: {complaint}");
    }
    let file = folder("others").join("step.txt");
    fs::write(&file, up_to(&text, Stage::Step)).unwrap();
    let output = pe_synth(&["check", "--from", file.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2), "{}", String::from_utf8_lossy(&output.stderr));
    fs::write(&file, up_to(&text, Stage::Model)).unwrap();
    printed(&["sim", "--double", "--from", file.to_str().unwrap(), "--span", "50ms"]);
}

#[test]
fn damaged_texts_end_in_a_finding_or_a_proved_design() {
    let spec = models().join("van_der_pol/van_der_pol.spec");
    let words = ["dump", "--stage", "program", "--span", "100ms", "--pes", "2", spec.to_str().unwrap()];
    let text = printed(&words);
    let lines: Vec<&str> = text.lines().collect();
    let mut seed = 5u64;
    let mut next = |limit: usize| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as usize % limit
    };
    let mut refused = 0;
    for _ in 0..120 {
        let mut damaged: Vec<String> = lines.iter().map(|line| (*line).to_owned()).collect();
        let at = next(damaged.len());
        let fields: Vec<String> = damaged[at].split(' ').map(str::to_owned).collect();
        let field = next(fields.len());
        let mut other = fields.clone();
        match next(4) {
            0 => other[field] = format!("{}", next(40) as i64 - 10),
            1 => drop(other.remove(field)),
            2 => other.insert(field, fields[next(fields.len())].clone()),
            _ => other[field].push(['0', '9', 'x', '~', '"'][next(5)]),
        }
        damaged[at] = other.join(" ");
        let (code, complaint) = complaint("damaged", &(damaged.join("\n") + "\n"), &[]);
        assert!(code == Some(0) || code == Some(1) || code == Some(2), "{}: {complaint}", damaged[at]);
        refused += usize::from(code != Some(0));
    }
    assert!(refused > 60, "{refused}");
}
