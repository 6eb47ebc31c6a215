//! The shapes of PEs as text: everything that the size of a PE depends on.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::{Fold, Layout, PeFeatures, Program};
use crate::index::PeId;
use crate::word::Pipeline;

/// The text of `<model>_shapes.txt`: one `key=value` line per set of PEs that differ only in content.
pub fn shapes(program: &Program, folds: &[Fold]) -> String {
    let mut shapes: BTreeMap<(&PeFeatures, u32, Option<u32>), Vec<PeId>> = BTreeMap::new();
    for ((index, pe), fold) in program.pes.numbered().zip(folds) {
        shapes.entry((&pe.features, fold.streamed_bits(), fold.variants())).or_default().push(index);
    }
    let mut text = String::new();
    for (number, members) in shapes.values().enumerate() {
        let (count, example) = (members.len(), members[0]);
        let shape = shape(program, example, &folds[example.index()]);
        writeln!(text, "shape={number} count={count} example={example} {shape}").expect("writing to a string succeeds");
    }
    text
}

/// Widths, features and program size of a PE as `key=value` words, which say all that its size depends on.
pub fn shape(program: &Program, index: PeId, fold: &Fold) -> String {
    let format = &program.format;
    let features = &program.pes[index].features;
    let shifts = features.shifts.iter().map(u8::to_string).collect::<Vec<_>>().join(",");
    let mut text = format!(
        "storage_bits={} word_bits={} data_bits={} coefficient_bits={} own_words={} base_words={} \
         coefficient_words={} imported_words={} ports={} shifts={shifts} accumulator_bits={} factor={} pre_adder={} \
         swap={} base_last={} send={} program_words={} program_bits={} rounds={} streamed_bits={}",
        format.storage_bits,
        format.word_bits(),
        format.data_bits,
        format.coefficient_bits,
        features.own_words,
        features.base_words,
        features.coefficient_words,
        features.imported_words,
        features.ports,
        features.accumulator_bits,
        features.factor,
        features.pre_adder,
        features.swap,
        features.base_last,
        features.send,
        program.period,
        Layout::new(features, format).bits,
        program.rounds,
        fold.streamed_bits(),
    );
    if let Some(variants) = fold.variants() {
        write!(text, " variants={variants}").expect("writing to a string succeeds");
    }
    if features.proven {
        text += " proven=true";
    }
    if features.index_words > 0 {
        let PeFeatures { index_words, index_bits, octave_bits, .. } = features;
        write!(text, " index_words={index_words} index_bits={index_bits} octave_bits={octave_bits}")
            .expect("writing to a string succeeds");
    }
    if features.shown_words > 0 {
        write!(text, " shown_words={} show_last={}", features.shown_words, features.show_last)
            .expect("writing to a string succeeds");
    }
    if features.ring_bits > 0 {
        write!(text, " ring_bits={}", features.ring_bits).expect("writing to a string succeeds");
    }
    if format.pipeline != Pipeline::Short {
        write!(text, " pipeline={}", format.pipeline.name()).expect("writing to a string succeeds");
    }
    text
}
