//! Properties of the emitted files: complete, deterministic, safe against hostile names.

mod support;

use std::collections::BTreeSet;

use pe_emit::{Artefact, EmitOptions, LIBRARY, emit};
use pe_ir::word::Pipeline;
use support::{Case, features, random_program};

fn design(model: &'static str) -> Vec<Artefact> {
    let pes = vec![features(4, 4, 2, &[12, 16], 44, "fws"), features(4, 4, 1, &[12, 16], 44, "fws")];
    let case = Case {
        name: model,
        storage: 32,
        multiplier: (25, 18),
        pipeline: Pipeline::Short,
        pes,
        period: 19,
        inputs: 1,
        seed: 7,
    };
    let options = EmitOptions {
        command: "pe-synth build <= 'a\nb' */ \\".to_owned(),
        spec: "x\n.ode".to_owned(),
        version: "0".to_owned(),
        stimulus: vec![vec![-1], vec![5]],
        c_header: true,
        default_steps: 2,
        files: vec![("x\n.ode".to_owned(), "00ff".to_owned())],
        provenance: pe_emit::Provenance {
            statements: vec![vec!["x.ode:1: a' = \\\n -a */".to_owned()]].into(),
            coefficients: vec![vec![Some(-0.1); 3]].into(),
        },
        interface: pe_emit::Interface { step: 1e-3, ..pe_emit::Interface::default() },
    };
    emit(&random_program(&case), &options)
}

fn text<'a>(design: &'a [Artefact], path: &str) -> &'a str {
    &design.iter().find(|artefact| artefact.path == path).unwrap_or_else(|| panic!("no file {path}")).text
}

#[test]
fn a_design_has_its_files() {
    let design = design("Process");
    let paths: BTreeSet<&str> = design.iter().map(|artefact| artefact.path.as_str()).collect();
    assert_eq!(paths.len(), design.len());
    let suffixes = [
        "_program_pkg.vhd",
        ".vhd",
        "_tb.vhd",
        ".f",
        ".h",
        "_reference.rs",
        "_verilator.cpp",
        "_map.json",
        "_stimulus.txt",
        "_shapes.txt",
    ];
    for suffix in suffixes {
        text(&design, &format!("process_x{suffix}"));
    }
    // Without ticks nothing counts steps, without ports for a host nothing looks at states, and few outputs are ports.
    let needless = ["pe_tick.vhd", "pe_access.vhd", "pe_output_memory.vhd", "pe_output_reader.vhd"];
    for (file, content) in LIBRARY.into_iter().filter(|(file, _)| !needless.contains(file)) {
        assert_eq!(text(&design, &format!("hdl/{file}")), content);
    }
    assert!(needless.iter().all(|file| design.iter().all(|artefact| artefact.path != format!("hdl/{file}"))));
    assert_eq!(text(&design, "process_x_stimulus.txt"), "ffffffff\n00000005\n");
    assert_eq!(text(&design, "process_x_shapes.txt").lines().count(), 2);
}

#[test]
fn nothing_is_escaped() {
    let design = design("m");
    for path in ["m.vhd", "m_tb.vhd", "m_program_pkg.vhd", "m_reference.rs", "m_verilator.cpp", "m.h"] {
        let text = text(&design, path);
        assert!(text.contains("Regenerate: pe-synth build <= 'a b' */ /\n"), "{path}");
        assert!(text.contains("Read: x .ode, SHA-256 00ff\n"), "{path}");
        assert!(!text.contains("&#"), "{path}");
        assert!(text.ends_with('\n') && !text.ends_with("\n\n"), "{path}");
        assert!(!text.contains('\t'), "{path}");
        assert!(text.is_ascii(), "{path}");
    }
}

#[test]
fn names_stay_in_their_comments() {
    let design = design("m");
    for line in text(&design, "m_program_pkg.vhd").lines() {
        if let Some(column) = line.find("hostile") {
            assert!(line[..column].contains("--"), "{line}");
        }
    }
}

#[test]
fn the_same_program_gives_the_same_bytes() {
    assert_eq!(design("m"), design("m"));
}

#[test]
fn control_words_tell_where_they_come_from() {
    let design = design("m");
    let package = text(&design, "m_program_pkg.vhd");
    assert!(package.contains("\n  --   x.ode:1: a' = /  -a */\n"), "{package}");
    // The first three control words of one PE were given numbers, which stand behind their coefficients.
    let numbers = package.lines().filter(|line| line.contains(" * ") && line.contains(" (-0.1)")).count();
    assert_eq!(package.matches(" (-0.1)").count(), numbers, "{package}");
    assert!((1..=3).contains(&numbers), "{package}");
}
