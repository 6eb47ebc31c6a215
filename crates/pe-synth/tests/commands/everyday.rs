//! What users do every day: pipes, units of time, new specs, laying them out, changing them while a command watches.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::support::bench::Folder;
use crate::support::models::spec;

const SMALL: &str = "model m\nsolver rk4\nstep 1 ms\nspan 50 ms\nstate x = 1\nx' = -x\noutput x\n";

fn pe_synth(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.args(arguments).current_dir(folder);
    command
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    pe_synth(folder, arguments).output().expect("pe-synth starts")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs a command that must end with this code; what it says on standard error.
fn ends(folder: &Path, arguments: &[&str], code: i32) -> String {
    let output = run(folder, arguments);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stderr)
}

/// Runs a command with a spec on standard input.
fn piped(folder: &Path, arguments: &[&str], spec: &str) -> Output {
    let mut command = pe_synth(folder, arguments);
    let mut child =
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("pe-synth starts");
    child.stdin.take().expect("a pipe").write_all(spec.as_bytes()).expect("the spec is read");
    child.wait_with_output().expect("pe-synth ends")
}

#[test]
fn a_spec_may_come_from_standard_input() {
    let folder = Folder::new("standard_input");
    fs::write(folder.0.join("m.spec"), SMALL).unwrap();
    let of_file = run(&folder.0, &["sim", "m.spec"]);
    let of_pipe = piped(&folder.0, &["sim", "-"], SMALL);
    assert!(of_pipe.status.success() && of_file.stdout == of_pipe.stdout, "{}", text(&of_pipe.stderr));
    let compiled = piped(&folder.0, &["compile", "-", "-o", "out"], SMALL);
    assert!(compiled.status.success(), "{}", text(&compiled.stderr));
    assert!(folder.0.join("out/m.vhd").exists());
    // Files that it names are those of the present folder.
    fs::write(folder.0.join("part.spec"), "param k = 2\n").unwrap();
    let including = SMALL.replace("x' = -x", "include \"part.spec\"\nx' = -k*x");
    let output = piped(&folder.0, &["sim", "-", "--double"], &including);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let broken = piped(&folder.0, &["check", "-"], "model m\nx' = (1\n");
    assert_eq!(broken.status.code(), Some(1));
    assert!(text(&broken.stderr).contains("standard input:2"), "{}", text(&broken.stderr));
}

#[test]
fn options_are_told_how_they_are_written() {
    let folder = Folder::new("written");
    fs::write(folder.0.join("m.spec"), SMALL).unwrap();
    for (arguments, code, wanted) in [
        (&["sim", "m.spec", "--span", "0.001min", "--double"][..], 0, ""),
        (&["check", "m.spec", "--step", "-1ms"], 2, "must be positive"),
        (&["check", "m.spec", "--span", "-2"], 2, "must be positive"),
        (&["check", "m.spec", "--step", "1 fortnight"], 2, "units are ns, us, ms, s, min and h"),
        (&["explore", "m.spec", "--step", "1ms,-2ms"], 2, "must be positive"),
        (&["accuracy", "m.spec", "--max-error", "-1"], 2, "expected a positive number"),
        (&["explore", "m.spec", "--max-error", "all"], 2, "or `any`"),
        (&["m.spec"], 2, "pe-synth compile m.spec"),
        (&["verify", "nowhere"], 3, "there is no such"),
    ] {
        let said = ends(&folder.0, arguments, code);
        assert!(said.contains(wanted), "{arguments:?}: {said}");
    }
}

#[test]
fn a_new_spec_compiles_and_nothing_is_overwritten() {
    let folder = Folder::new("new_spec");
    ends(&folder.0, &["new", "tank"], 0);
    ends(&folder.0, &["new", "deep/er/tank_2.spec"], 0);
    assert!(folder.0.join("deep/er/tank_2.spec").exists());
    assert_eq!(ends(&folder.0, &["compile", "tank.spec", "-q", "-o", "out"], 0), "");
    assert!(folder.0.join("out/tank.vhd").exists());
    ends(&folder.0, &["fmt", "--check", "tank.spec"], 0);
    fs::write(folder.0.join("tank.spec"), "mine").unwrap();
    let said = ends(&folder.0, &["new", "tank"], 3);
    assert!(said.contains("it exists"), "{said}");
    assert_eq!(fs::read_to_string(folder.0.join("tank.spec")).unwrap(), "mine");
    for name in ["state", "1st", "a b", "_x", "x\"\nsolver euler", "a.b"] {
        let said = ends(&folder.0, &["new", name], 2);
        assert!(said.contains("cannot be the name of a model"), "{name}: {said}");
    }
}

#[test]
fn fmt_writes_what_is_right_and_checks_without_writing() {
    let folder = Folder::new("fmt");
    let (untidy, tidy) = ("model m\nsolver rk4\nstep  1ms\nx'=-x\n", "model m\nsolver rk4\nstep   1 ms\nx' = -x\n");
    fs::write(folder.0.join("a.spec"), untidy).unwrap();
    fs::write(folder.0.join("b.spec"), tidy).unwrap();
    let said = ends(&folder.0, &["fmt", "--check", "a.spec", "b.spec"], 4);
    assert!(said.contains("a.spec") && !said.contains("b.spec"), "{said}");
    assert_eq!(fs::read_to_string(folder.0.join("a.spec")).unwrap(), untidy);
    // One that is broken keeps all as they are.
    fs::write(folder.0.join("c.spec"), "x' = (1\n").unwrap();
    ends(&folder.0, &["fmt", "a.spec", "c.spec"], 1);
    assert_eq!(fs::read_to_string(folder.0.join("a.spec")).unwrap(), untidy);
    ends(&folder.0, &["fmt", "a.spec", "b.spec"], 0);
    assert_eq!(fs::read_to_string(folder.0.join("a.spec")).unwrap(), tidy);
    ends(&folder.0, &["fmt", "--check", "a.spec", "b.spec"], 0);
    let output = piped(&folder.0, &["fmt", "-"], untidy);
    assert_eq!(text(&output.stdout), tidy);
    let left = fs::read_dir(&folder.0).unwrap().count();
    assert_eq!(left, 3, "files are left behind");
}

/// A command that watches, and the lines that it prints.
struct Watching {
    child: Child,
    lines: std::sync::mpsc::Receiver<String>,
}

impl Watching {
    fn start(folder: &Path, arguments: &[&str]) -> Watching {
        let mut child =
            pe_synth(folder, arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("starts");
        let stderr = child.stderr.take().expect("a pipe");
        let (sender, lines) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                let _ = sender.send(line);
            }
        });
        Watching { child, lines }
    }

    /// Waits until a run has ended, and gives its end.
    fn end_of_run(&self) -> String {
        let end = Instant::now() + Duration::from_secs(60);
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let line = self.lines.recv_timeout(left).expect("a run ends");
            if line.starts_with("--- ") {
                return line;
            }
        }
    }
}

impl Drop for Watching {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn watch_runs_again_after_a_change_of_any_file() {
    let folder = Folder::new("watch");
    let write = |name: &str, text: &str| fs::write(folder.0.join(name), text).unwrap();
    write("m.spec", &SMALL.replace("x' = -x", "include \"part.spec\"\nx' = -k*x"));
    let watching = Watching::start(&folder.0, &["sim", "m.spec", "--double", "-o", "x.csv", "--watch"]);
    // The included file is missing at first.
    assert!(watching.end_of_run().contains("failed (1); waiting for a change of 2 files"));
    write("part.spec", "param k = 2\n");
    assert!(watching.end_of_run().contains("done"));
    let first = fs::read(folder.0.join("x.csv")).unwrap();
    write("part.spec", "param k = 30\n");
    assert!(watching.end_of_run().contains("done"));
    assert_ne!(first, fs::read(folder.0.join("x.csv")).unwrap());
    write("m.spec", "model m\n");
    assert!(watching.end_of_run().contains("failed (1); waiting for a change of 1 file"));
    // What no command reads starts none.
    write("other.spec", "model other\n");
    assert!(watching.lines.recv_timeout(Duration::from_secs(1)).is_err());
}

#[test]
fn only_one_sweep_writes_to_a_folder() {
    let folder = Folder::new("locked_sweep");
    let model = spec("weibel5").display().to_string();
    let arguments = ["explore", &model, "--pes", "1,2,4,8", "--solver", "rk4", "--span", "40ms", "-o", "out"];
    let mut first = pe_synth(&folder.0, &arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let lock = folder.0.join(".out.lock");
    while !lock.exists() && first.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(5));
    }
    for command in ["explore", "accuracy"] {
        let said = ends(&folder.0, &[command, &model, "--solver", "rk4", "--span", "40ms", "-o", "out"], 3);
        assert!(said.contains("another sweep is writing to it"), "{said}");
    }
    first.kill().unwrap();
    first.wait().unwrap();
    // A lock that a killed process leaves behind is none.
    assert!(lock.exists());
    ends(&folder.0, &["explore", &model, "--pes", "2", "--solver", "rk4", "--span", "40ms", "-q", "-o", "out"], 0);
    assert!(!lock.exists(), "the lock is left behind");
}

#[test]
fn a_damaged_or_other_record_is_told_in_words() {
    let folder = Folder::new("damaged_sweep");
    fs::write(folder.0.join("m.spec"), SMALL).unwrap();
    let sweep = |span: &str, code: i32| {
        let arguments = [
            "explore", "m.spec", "--pes", "1", "--solver", "rk4", "--step", "1ms", "--span", span, "-o", "out",
            "--resume",
        ];
        ends(&folder.0, &arguments, code)
    };
    sweep("50ms", 0);
    let said = sweep("60ms", 2);
    assert!(said.contains("`--span` was `50ms`, now it is `60ms`") && said.contains("leave out `--resume`"), "{said}");
    fs::write(folder.0.join("m.spec"), SMALL.replace("-x", "-2*x")).unwrap();
    let said = sweep("50ms", 2);
    assert!(said.contains("equations, parameters, initial values") && !said.contains("sha"), "{said}");
    fs::write(folder.0.join("m.spec"), SMALL).unwrap();
    let record = folder.0.join("out/points.json");
    let whole = fs::read(&record).unwrap();
    // A row that was changed is computed again, whatever in it was; so is one that is no row.
    let text = std::str::from_utf8(&whole).unwrap();
    let rows = text.find("\"points\":").unwrap();
    let changes = ["cycles_per_step", "total", "command", "sha256", "status", "point"];
    for key in changes {
        let place = rows + text[rows..].find(&format!("\"{key}\": ")).unwrap() + key.len() + 4;
        let changed = match &text[place..=place] {
            "\"" => format!("{}x{}", &text[..=place], &text[place + 1..]),
            _ => format!("{}1{}", &text[..place], &text[place..]),
        };
        fs::write(&record, changed).unwrap();
        let said = sweep("50ms", 0);
        assert!(said.contains("1 point was damaged, and was computed again"), "{key}: {said}");
        assert!(fs::read(&record).unwrap() == whole, "{key}");
    }
    assert!(!sweep("50ms", 0).contains("damaged"));
    // What is left may show that it is ours, or not; then nothing is replaced.
    let ours = b"{\n  \"generator\": \"pe-synth ";
    for (part, code, remedy) in [
        (&whole[..whole.len() - 5], 2, "leave out `--resume`"),
        (&ours[..], 2, "leave out `--resume`"),
        (b"", 3, "remove the folder"),
        (b"{}", 3, "remove the folder"),
        (b"\xff", 3, "remove the folder"),
    ] {
        fs::write(&record, part).unwrap();
        let said = sweep("50ms", code);
        assert!(said.contains("is damaged") && said.contains(remedy), "{said}");
        assert!(!said.contains("EOF") && !said.contains("line "), "{said}");
    }
}

#[test]
fn an_interrupted_study_goes_on_to_the_same_bytes() {
    let folder = Folder::new("resumed_study");
    let model = spec("van_der_pol").display().to_string();
    let study = |target: &str, more: &[&str]| {
        let mut words =
            vec!["accuracy", &model, "--solver", "heun,rk4", "--span", "2s", "--max-error", "1e-3", "--jobs", "1"];
        words.extend(["-o", target]);
        words.extend(more);
        pe_synth(&folder.0, &words)
    };
    let clock = Instant::now();
    assert!(study("whole", &["-q"]).status().unwrap().success());
    let duration = clock.elapsed();
    let files = |target: &str| {
        let mut files: Vec<_> =
            fs::read_dir(folder.0.join(target)).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        files.iter().map(|path| fs::read(path).unwrap()).collect::<Vec<_>>()
    };
    let mut interrupted = 0;
    for share in [60, 40, 80, 20, 90] {
        let target = format!("part{share}");
        let mut child = study(&target, &["-q"]).stderr(Stdio::piped()).spawn().unwrap();
        std::thread::sleep(duration * share / 100);
        let _ = Command::new("kill").arg("-INT").arg(child.id().to_string()).stderr(Stdio::null()).status();
        let code = child.wait().unwrap().code();
        let mut said = String::new();
        child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        if code != Some(130) || !folder.0.join(&target).exists() {
            continue;
        }
        assert!(said.contains("`--resume` continues"), "{said}");
        assert!(study(&target, &["-q", "--resume"]).status().unwrap().success());
        assert!(files("whole") == files(&target), "after {share} %");
        interrupted += 1;
    }
    assert!(interrupted > 0, "no study was interrupted in {duration:?}");
}

#[test]
fn designs_that_are_wrong_by_more_than_a_percent_are_shown_only_if_asked_for() {
    let folder = Folder::new("wrong_designs");
    let model = spec("van_der_pol").display().to_string();
    let sweep = |more: &[&str]| {
        let words = ["explore", &model, "--pes", "1", "--solver", "euler,rk4", "--step", "5ms", "--span", "10s"];
        let words = [&words[..], &["--multiplier", "32x32", "-o", "out"], more].concat();
        let output = run(&folder.0, &words);
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stdout)
    };
    let fronts = |said: &str| said.split("Cheapest").next().unwrap_or("").to_owned();
    let usual = sweep(&[]);
    assert!(usual.contains("total error at most 1e-2") && !fronts(&usual).contains("euler"), "{usual}");
    let any = sweep(&["--max-error", "any"]);
    assert!(!any.contains("at most") && fronts(&any).contains("euler"), "{any}");
    let none = sweep(&["--max-error", "1e-12"]);
    assert!(none.contains("`--max-error any` lets all points compete"), "{none}");
}

#[test]
fn check_prints_steps_that_agree_and_tells_what_holds_locally() {
    let folder = Folder::new("consistent_check");
    let output = run(&folder.0, &["check", &spec("weibel5").display().to_string()]);
    let said = text(&output.stdout);
    let word = |row: &str, at: usize| {
        let line = said.lines().find(|line| line.trim_start().starts_with(row)).unwrap_or_else(|| panic!("{said}"));
        line.trim_start()[row.len()..].split_whitespace().nth(at).unwrap_or("").to_owned()
    };
    // Accuracy would allow more than stability does: the row says so, with the step of the row above.
    assert_eq!((word("accuracy step", 0), word("accuracy step", 1)), (">".to_owned(), word("found by trial", 0)));
    assert!(
        said.contains("accuracy / stable step ~1.") && said.lines().all(|line| line.chars().count() <= 80),
        "{said}"
    );
    let limited = "model n\nsolver rk4\nstep 1 ms\nspan 40 ms\nstate x = 0.5\nx' = -u\nevery 4 ms {\n\
                   u = 600*min(max(x, -1), 1) + 0.001*x^2\n}\noutput x\n";
    fs::write(folder.0.join("n.spec"), limited).unwrap();
    let said = ends(&folder.0, &["check", "n.spec"], 0);
    assert!(
        said.contains("W0912") && said.contains("linearised at t = 2.000e-2 s") && said.contains("locally"),
        "{said}"
    );
    assert!(!said.contains("is unstable"), "{said}");
}
