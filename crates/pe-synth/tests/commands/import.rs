//! `import`: models of other tools become specs that compile, or findings and no file.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("import").join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

fn samples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../pe-import/tests/files")
}

fn import(file: &Path, options: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pe-synth")).arg("import").arg(file).args(options).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn samples_become_specs_that_simulate_or_findings_and_no_file() {
    let home = folder("samples");
    let (mut written, mut refused) = (0, 0);
    for entry in fs::read_dir(samples()).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|end| end == "expect" || end == "md") {
            continue;
        }
        let spec = home.join("m.spec");
        let _ = fs::remove_file(&spec);
        let output = import(&path, &["-o", spec.to_str().unwrap()]);
        let told = text(&output.stderr);
        if output.status.success() {
            written += 1;
            let sim =
                Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(["sim", "--double"]).arg(&spec).output().unwrap();
            assert!(sim.status.success(), "{}: {}", path.display(), text(&sim.stderr));
        } else {
            refused += 1;
            assert_eq!(output.status.code(), Some(1), "{told}");
            assert!(told.contains("error[E11") && !spec.exists(), "{told}");
        }
    }
    assert!(written >= 2 && refused >= 2, "{written} written, {refused} refused");
}

/// S decays to half in ln 2.
const DECAY: &str = r#"<sbml xmlns="http://www.sbml.org/sbml/level3/version2/core" level="3" version="2"><model id="decay">
<listOfParameters><parameter id="S" value="1" constant="false"/><parameter id="k" value="1" constant="true"/></listOfParameters>
<listOfRules><rateRule variable="S"><math xmlns="http://www.w3.org/1998/Math/MathML"><apply><minus/><apply><times/><ci>k</ci><ci>S</ci></apply></apply></math></rateRule></listOfRules>
</model></sbml>"#;

#[test]
fn results_that_agree_give_zero_and_others_four() {
    let home = folder("compare");
    let (model, results, spec) = (home.join("decay.xml"), home.join("results.csv"), home.join("decay.spec"));
    fs::write(&model, DECAY).unwrap();
    let compare = |value: &str, more: &[&str]| {
        fs::write(&results, format!("time, S\n0,1\n0.5,0.6065306597126334\n1,{value}\n")).unwrap();
        let options = [&["-o", spec.to_str().unwrap(), "--compare", results.to_str().unwrap()], more].concat();
        import(&model, &options)
    };
    let agrees = compare("0.36787944117144233", &["--absolute", "1e-7", "--relative", "1e-6"]);
    assert!(agrees.status.success(), "{}", text(&agrees.stderr));
    assert!(text(&agrees.stdout).contains("agrees"), "{}", text(&agrees.stdout));
    let differs = compare("0.368", &["--relative", "1e-6"]);
    assert_eq!(differs.status.code(), Some(4));
    assert!(text(&differs.stdout).contains("differs"));
    assert_eq!(compare("NaN", &[]).status.code(), Some(4));
    // A cell that is no number, and a row between steps.
    assert_eq!(compare("x", &[]).status.code(), Some(3));
    assert_eq!(compare("0.36787944117144233", &["--step", "0.3"]).status.code(), Some(2));
    assert!(fs::read_to_string(&spec).unwrap().contains("S' = -k*S\n"));
}

/// A delay of 1.3 s, wherever it stands, divides no decimal part of a span of three seconds.
#[test]
fn proposed_steps_divide_delays_in_functions_and_in_events() {
    let home = folder("delays");
    let (model, spec) = (home.join("late.xml"), home.join("late.spec"));
    let delay = "<apply><ci>over</ci><cn>0.325</cn><ci>k</ci></apply>";
    let past = format!(
        "<apply><csymbol encoding=\"text\" definitionURL=\"http://www.sbml.org/sbml/symbols/delay\">delay</csymbol>\
        <ci>S</ci>{delay}</apply>"
    );
    let math = |text: &str| format!("<math xmlns=\"http://www.w3.org/1998/Math/MathML\">{text}</math>");
    let function = math(
        "<lambda><bvar><ci>x</ci></bvar><bvar><ci>y</ci></bvar>\
        <apply><times/><ci>x</ci><apply><power/><ci>y</ci><cn type=\"integer\">-1</cn></apply></apply></lambda>",
    );
    let trigger = math("<apply><lt/><ci>S</ci><cn>0.5</cn></apply>");
    let event = |delay: &str, value: &str| {
        format!(
            "<listOfEvents><event useValuesFromTriggerTime=\"true\"><trigger initialValue=\"false\" persistent=\"true\">\
            {trigger}</trigger>{delay}<listOfEventAssignments><eventAssignment variable=\"S\">{}</eventAssignment>\
            </listOfEventAssignments></event></listOfEvents></model>",
            math(value)
        )
    };
    let functions = format!(
        "<listOfFunctionDefinitions><functionDefinition id=\"over\">{function}</functionDefinition>\
        </listOfFunctionDefinitions><listOfParameters>"
    );
    let decay =
        DECAY.replace("<listOfParameters>", &functions).replace("id=\"k\" value=\"1\"", "id=\"k\" value=\"0.25\"");
    let waits = format!("<delay>{}</delay>", math(delay));
    for event in [event(&waits, "<cn>1</cn>"), event("", &past)] {
        fs::write(&model, decay.replace("</model>", &event)).unwrap();
        let output = import(&model, &["-o", spec.to_str().unwrap(), "--span", "3s"]);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let sim = Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(["sim", "--double"]).arg(&spec).output().unwrap();
        assert!(sim.status.success(), "{}", text(&sim.stderr));
    }
}

#[test]
fn a_suite_is_told_by_kind_and_reason() {
    let home = folder("suite");
    for (name, model) in
        [("00001", DECAY), ("00002", "<sbml level=\"3\" version=\"2\"><model/></sbml>"), ("00003", "<x/>")]
    {
        let case = home.join(name);
        fs::create_dir_all(&case).unwrap();
        fs::write(case.join(format!("{name}-sbml-l3v2.xml")), model).unwrap();
        fs::write(case.join(format!("{name}-results.csv")), "time,S\n0,1\n1,0.36787944117144233\n").unwrap();
        let settings =
            "start: 0\nduration: 1\nsteps: 1\nvariables: S\nabsolute: 1e-6\nrelative: 1e-4\namount:\nconcentration:\n";
        fs::write(case.join(format!("{name}-settings.txt")), settings).unwrap();
        fs::write(case.join(format!("{name}-model.m")), "componentTags: Parameter\ntestType: TimeCourse\n").unwrap();
    }
    let output = Command::new(env!("CARGO_BIN_EXE_pe-synth")).arg("import").arg("--suite").arg(&home).output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    let table = text(&output.stdout);
    assert!(table.contains("| all | 3 | 1 | 2 | 0 | 0 |"), "{table}");
    assert!(table.contains("E1101") && table.contains("E1104"), "{table}");
}
