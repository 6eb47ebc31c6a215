//! Estimates against synthesis: PEs, and what is beside them.

use std::collections::HashMap;

use pe_ir::program::PeFeatures;

use super::terms::{rare, weighted};
use super::*;

/// Index words, bits of an index, of these for octaves, and the LUTs of a synthesised PE beside those of the same
/// PE without lookups (`xtask single_pes FOLDER tables`).
const MEASURED_LOOKUPS: &[(u32, u32, u32, f64)] =
    &[(0, 0, 0, 0.0), (16, 5, 0, 13.0), (32, 6, 0, 14.0), (16, 5, 3, 28.0), (32, 6, 4, 53.0)];

#[test]
fn estimates_of_lookups_agree_with_synthesis() {
    for &(index_words, index_bits, octave_bits, lut) in MEASURED_LOOKUPS {
        let features = PeFeatures {
            own_words: 32,
            base_words: 256,
            coefficient_words: 32,
            imported_words: 16,
            ports: 3,
            shifts: vec![1, 2, 3, 4, 5],
            accumulator_bits: 43,
            factor: true,
            pre_adder: false,
            swap: false,
            base_last: false,
            send: true,
            proven: false,
            index_words: 0,
            index_bits: 0,
            octave_bits: 0,
            shown_words: 0,
            show_last: false,
            ring_bits: 0,
        };
        let format = WordFormat::new(32, 25, 18);
        let count = |features: &PeFeatures| weighted(&lut_terms(features, &format, Family::Virtex6), &fitted::XC6V.lut);
        let without = count(&features);
        let with = count(&PeFeatures { index_words, index_bits, octave_bits, ..features.clone() });
        assert!((with - without - lut).abs() < 4.0, "{index_words}: {} instead of {lut}", with - without);
    }
}

#[test]
fn estimates_of_what_is_beside_the_pes_agree_with_synthesis() {
    for line in include_str!("parts.txt").lines() {
        let fields: HashMap<&str, &str> = line.split_whitespace().filter_map(|word| word.split_once('=')).collect();
        let number = |name: &str| fields.get(name).map_or(0, |value| value.parse::<u32>().expect("a number"));
        let family = Family::named(fields["family"]).expect("a family");
        let deep = fields.get("DEEP").is_some_and(|value| *value == "true");
        let pipeline = if deep { Pipeline::Deep } else { Pipeline::Short };
        let format = WordFormat {
            storage_bits: number("STORAGE_BITS"),
            guard_bits: number("WORD_BITS").saturating_sub(number("STORAGE_BITS")),
            data_bits: number("DATA_BITS"),
            coefficient_bits: 18,
            pipeline,
        };
        let (lut, ff) = match fields["part"] {
            "pe_sequencer" => network::sequencer_alone(number("PERIOD"), number("ROUNDS"), deep, family),
            "pe_input" => network::input(&format, family),
            "pe_output" => {
                let saturates = fields.get("SATURATE").is_none_or(|value| *value == "true");
                network::output(&format, number("INDEX_BITS"), saturates, family)
            }
            "pe_tick" => network::tick(number("STEPS"), family),
            other => panic!("no part: {other}"),
        };
        let (lut_off, ff_off) = (lut - f64::from(number("lut")), ff - f64::from(number("ff")));
        assert!(lut_off.abs() <= 15.0 && ff_off.abs() <= 8.0, "{line}: {lut} and {ff}");
    }
}

/// Mean and worst of the residuals, and their root mean square.
fn summary(residuals: &[f64]) -> (f64, f64, f64) {
    let count = residuals.len() as f64;
    let sizes = residuals.iter().map(|residual| residual.abs());
    let squares: f64 = residuals.iter().map(|residual| residual * residual).sum();
    (sizes.clone().sum::<f64>() / count, sizes.fold(0.0, f64::max), (squares / count).sqrt())
}

#[test]
fn estimates_agree_with_synthesis() {
    let shapes = read(include_str!("measured.txt")).expect("the file is read");
    for family in Family::MEASURED {
        let fitted = family.fitted();
        let mut known = [0; TRAITS.len()];
        for pipeline in Pipeline::ALL {
            let (mut luts, mut ffs) = (Vec::new(), Vec::new());
            let alike = |shape: &&MeasuredShape| (shape.format.pipeline, shape.family) == (pipeline, family);
            for shape in shapes.iter().filter(alike) {
                let (features, format) = (&shape.features, &shape.format);
                let (lut, ff) = pe(features, format, family);
                luts.push((lut + shape.program.lut) / f64::from(shape.lut) - 1.0);
                ffs.push((ff + shape.program.ff) / f64::from(shape.ff) - 1.0);
                let blocks = terms::memories(features, format, family).0.bram18 + shape.program.bram18;
                assert_eq!(blocks, shape.bram18, "{shape:?}");
                assert_eq!(format.half_blocks(family.tiles()), shape.half_blocks, "{shape:?}");
                if pipeline == Pipeline::Short {
                    known.iter_mut().zip(traits(features, format)).for_each(|(count, has)| *count += u32::from(has));
                }
            }
            let deviations = match pipeline {
                Pipeline::Short => [fitted.lut_deviation, fitted.ff_deviation],
                Pipeline::Deep => [fitted.deep_lut_deviation, fitted.deep_ff_deviation],
            };
            for (cells, residuals, deviation) in [("LUTs", luts, deviations[0]), ("flip-flops", ffs, deviations[1])] {
                let (mean, worst, square) = summary(&residuals);
                let text = format!(
                    "{cells}, {}, {}, residuals: {} shapes, mean {:.1} %, root mean square {:.1} %, worst {:.1} %",
                    family.name(),
                    pipeline.name(),
                    residuals.len(),
                    100.0 * mean,
                    100.0 * square,
                    100.0 * worst
                );
                println!("{text}");
                let limits = match (family, pipeline) {
                    (Family::Virtex6, Pipeline::Short) => (0.02, 0.07),
                    (Family::Virtex6, Pipeline::Deep) => (0.04, 0.07),
                    (_, Pipeline::Short) => (0.04, 0.07),
                    (_, Pipeline::Deep) => (0.06, 0.17),
                };
                assert!(mean < limits.0 && worst < limits.1, "{text}");
                assert!((square - deviation).abs() < 1e-4, "{text}: run the example fit_area again");
            }
        }
        assert_eq!(known, fitted.shapes, "run the example fit_area again");
    }
}

#[test]
fn estimates_of_what_was_hardly_measured_have_wider_errors() {
    let shapes = read(include_str!("measured.txt")).expect("the file is read");
    for family in Family::MEASURED {
        let few = |shape: &&MeasuredShape| shape.family == family && rare(&shape.features, &shape.format, family);
        for shape in shapes.iter().filter(few) {
            let (lut, ff) = terms::errors(&shape.features, &shape.format, family);
            assert!(lut >= RARE_ERROR && ff >= RARE_ERROR, "{shape:?}");
        }
    }
}

/// Depths that decide between tables and blocks stand in three places.
#[test]
fn depths_of_blocks_are_the_same_in_vhdl_verilog_and_estimate() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let read = |file: &str| std::fs::read_to_string(root.join(file)).expect("a file of the project");
    let (package, styles) = (read("hdl/pe_style_pkg.vhd"), read("crates/xtask/synthesis/styles.awk"));
    let deepest = memory::LUT_ROM_WORDS;
    assert!(package.contains(&format!("TABLE_ROM_WORDS : positive := {deepest};")));
    assert!(styles.contains(&format!("words[i] > {deepest} ")));
    for (words, bits) in [(64, 36), (64, 48), (128, 36), (128, 37), (256, 4), (256, 40)] {
        let block = words > 128 || (words == 128 && bits <= 36);
        assert_eq!(memory::ram(words, bits).bram18 > 0, block, "{words} of {bits} bits");
    }
    assert!(
        package.contains("TABLE_RAM_WORDS : positive := 128;") && package.contains("BLOCK_BITS      : positive := 36;")
    );
    assert!(styles.contains("words[i] > 128 || (words[i] == 128 && bits[i] <= 36)"));
}
