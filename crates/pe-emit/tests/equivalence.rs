//! The generated Rust reference, the GHDL test bench and Verilator print the same lines for random programs.

mod support;

use pe_ir::word::Pipeline;
use support::{Case, Design, assert_same, features, random_program, without_clocks};

/// Pairwise cover of features, memory sizes, ports, shift counts and multiplier sizes.
fn cases() -> Vec<Case> {
    let case = |name, storage, multiplier, period, inputs, seed, pes| Case {
        name,
        storage,
        multiplier,
        pipeline: Pipeline::Short,
        pes,
        period,
        inputs,
        seed,
    };
    vec![
        case(
            "Narrow[1]",
            32,
            (25, 18),
            29,
            2,
            1,
            vec![
                features(16, 8, 3, &[8, 12, 16, 20], 48, "fps"),
                features(32, 32, 4, &[10], 48, "pws"),
                features(2, 4, 1, &[9, 14], 46, "s"),
                features(8, 2, 5, &[0, 7, 13, 17, 40], 48, "fws"),
            ],
        ),
        case("alone", 32, (25, 18), 8, 0, 2, vec![features(4, 0, 0, &[12, 16, 20], 48, "f")]),
        case(
            "entity",
            32,
            (32, 32),
            33,
            1,
            3,
            vec![
                features(8, 4, 2, &[20, 26], 64, "fps"),
                features(4, 2, 1, &[17, 19, 22, 24, 31, 33, 36, 40], 64, "w"),
                features(4, 8, 5, &[31], 60, "fws"),
            ],
        ),
        case(
            "square",
            18,
            (18, 18),
            21,
            3,
            4,
            vec![features(64, 16, 2, &[3, 5, 9], 40, "pws"), features(4, 8, 3, &[1, 2, 4, 6, 8, 11], 40, "fws")],
        ),
        case("turned", 24, (18, 25), 17, 1, 5, vec![features(8, 4, 1, &[8, 13], 48, "fps")]),
        case(
            "mixed",
            32,
            (32, 18),
            26,
            1,
            6,
            vec![features(4, 4, 2, &[0, 14, 15], 56, "s"), features(8, 4, 2, &[14, 18], 50, "fws")],
        ),
        case("whole", 17, (25, 18), 19, 1, 7, vec![features(4, 4, 2, &[12, 16], 44, "fws")]),
        case(
            "tables",
            32,
            (25, 18),
            31,
            1,
            8,
            vec![
                features(4, 4, 2, &[6, 12, 16], 48, "fst"),
                features(32, 8, 2, &[9, 14], 48, "wst"),
                features(16, 4, 1, &[4, 10, 17], 48, "fpso"),
                features(64, 4, 1, &[8, 13], 48, "wo"),
                features(4, 4, 1, &[8, 13], 48, "wo"),
            ],
        ),
        case("wide_tables", 32, (32, 32), 23, 1, 9, vec![features(8, 4, 1, &[20, 26, 33], 64, "fso")]),
        case(
            "rings",
            32,
            (25, 18),
            27,
            1,
            10,
            vec![
                features(8, 16, 2, &[6, 12, 16], 48, "fpsr"),
                features(16, 8, 2, &[9, 14], 48, "wsr"),
                features(4, 4, 1, &[4, 10], 48, "sr"),
                features(2, 8, 1, &[4, 10, 17], 48, "r"),
                features(8, 4, 1, &[4, 10, 17], 48, "s"),
            ],
        ),
    ]
}

fn check(index: usize) {
    agree(&cases()[index], &format!("case{index}"));
}

fn check_deep(index: usize) {
    let case = Case { pipeline: Pipeline::Deep, ..cases().swap_remove(index) };
    agree(&case, &format!("deep{index}"));
}

fn agree(case: &Case, directory: &str) {
    let design = Design::new(&random_program(case), directory, 12);
    let expected = design.reference();
    design.analyse();
    assert_same("free run", &expected, &design.ghdl(&[]));
    let expected = without_clocks(expected);
    assert_same("clock enable", &expected, &without_clocks(design.ghdl(&["-gCE_SEED=99"])));
    assert_same("pauses", &expected, &without_clocks(design.ghdl(&["-gCE_SEED=5", "-gGAP=3"])));
}

#[test]
fn ghdl_agrees_on_narrow_pes() {
    check(0);
}

#[test]
fn ghdl_agrees_on_a_pe_without_links() {
    check(1);
}

#[test]
fn ghdl_agrees_on_wide_pes() {
    check(2);
}

#[test]
fn ghdl_agrees_on_square_multipliers() {
    check(3);
}

#[test]
fn ghdl_agrees_on_turned_multipliers() {
    check(4);
}

#[test]
fn ghdl_agrees_on_mixed_multipliers() {
    check(5);
}

#[test]
fn ghdl_agrees_on_words_without_dropped_bits() {
    check(6);
}

#[test]
fn ghdl_agrees_on_tables() {
    check(7);
}

#[test]
fn ghdl_agrees_on_wide_tables() {
    check(8);
}

#[test]
fn ghdl_agrees_on_rings() {
    check(9);
    check_deep(9);
}

#[test]
fn ghdl_agrees_on_deep_pipelines() {
    // Looped rounds with a pre-adder, swaps and factors; tables.
    check_deep(0);
    check_deep(7);
}

#[test]
fn ghdl_agrees_on_deep_pipelines_of_other_multipliers() {
    check_deep(2);
    check_deep(3);
    check_deep(5);
}

/// Verilator prints what the reference prints for a case, in a folder.
fn assert_verilator(index: usize, pipeline: Pipeline, directory: &str) {
    let case = Case { pipeline, ..cases().swap_remove(index) };
    let design = Design::new(&random_program(&case), directory, 12);
    let expected = design.reference();
    design.analyse();
    assert_same("verilator", &expected, &design.verilator());
}

#[test]
fn verilator_agrees() {
    assert_verilator(7, Pipeline::Short, "verilator_tables");
    // Each netlist takes a build of its own.
    if std::env::var_os("PE_LONG").is_some() {
        assert_verilator(0, Pipeline::Short, "verilator");
        assert_verilator(9, Pipeline::Short, "verilator_rings");
        assert_verilator(2, Pipeline::Deep, "verilator_deep_wide");
    }
}

#[test]
fn verilator_agrees_on_deep_pipelines() {
    assert_verilator(0, Pipeline::Deep, "verilator_deep");
}
