//! Which hardware features the PEs of a design have, how many PEs have each, and what needs it.
//!
//! Nothing is decided here: features follow from the program. The report shows them as `features`.

use std::collections::BTreeMap;

use pe_ir::graph::StepGraph;
use pe_ir::index::ValueId;
use pe_ir::mapping::Mapping;
use pe_ir::program::{ControlWord, FieldName, Fold, Layout, Note, PeFeatures, PeProgram, Program};

use pe_judge::runs::Judged;

use crate::report::types::{Feature as FeatureRow, Features, Field, Folds, Histogram};

/// A feature that a PE has in some size or not at all.
struct Feature {
    name: &'static str,
    size: fn(&PeFeatures) -> u32,
    /// The size at which there is nothing to build.
    nothing: u32,
    /// What the PE needs it for.
    need: fn(&Program, &PeProgram) -> String,
}

/// What PEs have that look functions up; in reports of designs with such PEs.
const LOOKUPS: [Feature; 2] = [
    Feature {
        name: "index_memory",
        size: |features| features.index_words,
        nothing: 0,
        need: |program, pe| {
            let indexed = |word: &ControlWord| word.write_index.is_some();
            format!("looks a function up at {}", first(program, pe, indexed, |note| note.write))
        },
    },
    Feature {
        name: "octaves",
        size: |features| features.octave_bits,
        nothing: 0,
        need: |program, pe| {
            let octaves = |word: &ControlWord| word.write_index.is_some_and(|(_, octaves)| octaves);
            format!("a function of {} is steep near zero", first(program, pe, octaves, |note| note.write))
        },
    },
];

const FEATURES: [Feature; 12] = [
    Feature {
        name: "input_ports",
        size: |features| features.ports,
        nothing: 0,
        need: |program, pe| format!("receives {}", first(program, pe, receives, |note| note.receive)),
    },
    Feature {
        name: "imported_memory",
        size: |features| features.imported_words,
        nothing: 0,
        need: |program, pe| format!("keeps {} as it received it", first(program, pe, receives, |note| note.receive)),
    },
    Feature {
        name: "own_memory",
        size: |features| features.own_words,
        nothing: 0,
        need: |program, pe| format!("keeps {}", first(program, pe, |word| word.write.is_some(), |note| note.write)),
    },
    Feature {
        name: "base_memory",
        size: |features| features.base_words,
        nothing: 0,
        need: |program, pe| {
            let written = |word: &ControlWord| word.write.is_some_and(|target| target.base);
            match pe.words.iter().any(written) || pe.features.index_words == 0 {
                true => format!("increments are added to {}", first(program, pe, written, |note| note.write)),
                false => "keeps tables of functions".to_owned(),
            }
        },
    },
    Feature {
        name: "coefficient_memory",
        size: |features| features.coefficient_words,
        nothing: 0,
        need: |_, pe| match pe.features.factor {
            true => "keeps the values that others are multiplied by, and all coefficients".to_owned(),
            false => "its few distinct coefficients cost less there than in every control word".to_owned(),
        },
    },
    Feature {
        name: "accumulator",
        size: |features| features.accumulator_bits,
        nothing: 0,
        need: |program, pe| format!("sums the products of {}", first(program, pe, multiplies, |note| note.chain)),
    },
    Feature {
        name: "shift_choice",
        size: |features| features.shifts.len() as u32,
        nothing: 1,
        need: |_, pe| {
            let positions: Vec<String> = pe.features.shifts.iter().map(u8::to_string).collect();
            format!("the formats of its values need right shifts by {}", positions.join(", "))
        },
    },
    Feature {
        name: "factor",
        size: |features| u32::from(features.factor),
        nothing: 0,
        need: |program, pe| {
            let factor = |word: &ControlWord| word.write.is_some_and(|target| target.factor);
            format!("multiplies by {}", first(program, pe, factor, |note| note.write))
        },
    },
    Feature {
        name: "operand_addition",
        size: |features| u32::from(features.pre_adder),
        nothing: 0,
        need: |program, pe| {
            let joins = |word: &ControlWord| word.own.is_some() && word.imported.is_some();
            format!("{} has two products with equal coefficients", first(program, pe, joins, |note| note.chain))
        },
    },
    Feature {
        name: "swap",
        size: |features| u32::from(features.swap),
        nothing: 0,
        need: |_, _| "others still read a state of the one-stage method while its successor is written".to_owned(),
    },
    Feature {
        name: "base_last",
        size: |features| u32::from(features.base_last),
        nothing: 0,
        need: |program, _| format!("{} rounds of a step add to the same base", program.rounds),
    },
    Feature {
        name: "send",
        size: |features| u32::from(features.send),
        nothing: 0,
        need: |program, pe| format!("another PE reads {}", first(program, pe, |word| word.send, |note| note.write)),
    },
];

/// In designs with rings.
const RINGS: [Feature; 1] = [Feature {
    name: "rings",
    size: |features| features.ring_bits,
    nothing: 0,
    need: |program, pe| {
        let written = |word: &ControlWord| word.write.is_some_and(|target| target.address.ring);
        match pe.words.iter().any(written) {
            true => format!("keeps the past of {}", first(program, pe, written, |note| note.write)),
            false => {
                let received = |word: &ControlWord| word.receive.is_some_and(|(_, address)| address.ring);
                format!("reads the past of {}", first(program, pe, received, |note| note.receive))
            }
        }
    },
}];

fn receives(word: &ControlWord) -> bool {
    word.receive.is_some()
}

fn multiplies(word: &ControlWord) -> bool {
    word.own.is_some() || word.imported.is_some()
}

/// Name of a value noted beside the first control word of a kind.
fn first(
    program: &Program,
    pe: &PeProgram,
    kind: fn(&ControlWord) -> bool,
    value: fn(&Note) -> Option<ValueId>,
) -> String {
    let note = pe.words.iter().position(kind).and_then(|at| value(&pe.notes[at]));
    format!("`{}`", program.name(note))
}

/// The features of the PEs with their reasons, and the fields of the control words.
pub fn features(program: &Program, graph: &StepGraph, judged: &Judged, mapping: &Mapping) -> Features {
    let lookups = program.pes.iter().any(|pe| pe.features.index_words > 0);
    let rings = program.pes.iter().any(|pe| pe.features.ring_bits > 0);
    let features = FEATURES.iter().chain(LOOKUPS.iter().filter(|_| lookups)).chain(RINGS.iter().filter(|_| rings));
    let mut rows: Vec<FeatureRow> = features.map(|feature| row(program, feature)).collect();
    rows.push(saturation(program, graph, judged, mapping));
    Features { pe: rows, control_word: fields(program), program: folds(program) }
}

fn row(program: &Program, feature: &Feature) -> FeatureRow {
    let mut sizes = Histogram::new();
    for pe in &program.pes {
        *sizes.entry((feature.size)(&pe.features)).or_default() += 1;
    }
    let without = sizes.get(&feature.nothing).copied().unwrap_or(0);
    let example = program.pes.numbered().find(|(_, pe)| (feature.size)(&pe.features) > feature.nothing);
    let because = match example {
        Some((index, pe)) => format!("PE {index}: {}", (feature.need)(program, pe)),
        None => "no PE needs it".to_owned(),
    };
    let with = program.pes.len() - without;
    FeatureRow { feature: feature.name.to_owned(), with, without, sizes, because, provable: None }
}

/// PEs that clamp words which are out of range, and those that are proven to write none.
fn saturation(program: &Program, graph: &StepGraph, judged: &Judged, mapping: &Mapping) -> FeatureRow {
    let without = program.pes.iter().filter(|pe| pe.features.proven).count();
    let enclosed = judged.proof.as_ref().and_then(|proof| proof.enclosed.as_ref());
    let saturating = program.pes.ids().find(|pe| program.saturates(*pe));
    let because = match (saturating, enclosed) {
        (None, _) => "every word is proven to be in range".to_owned(),
        (Some(_), None) if judged.proof.is_none() => "no proof of ranges was asked for".to_owned(),
        (Some(pe), None) => format!("PE {pe}: no bound of its values was found"),
        (Some(pe), Some(enclosed)) => {
            let own = graph.chains.iter().filter(|chain| mapping.pe_of[chain.equation] == pe);
            let mut values = own.flat_map(|chain| chain.writes()).map(|write| write.value);
            match values.find(|value| !enclosed.enclosure.fits(*value)) {
                Some(value) => format!("PE {pe}: nothing proves that `{}` stays in range", graph.value_name(value)),
                None => format!("PE {pe}: nothing proves that its sums of operands fit"),
            }
        }
    };
    FeatureRow {
        feature: "saturation".to_owned(),
        with: program.pes.len() - without,
        without,
        sizes: Histogram::new(),
        because,
        provable: Some(without),
    }
}

/// Rounds of a step, and how many PEs keep how many bits of their control words for each word of a round (`loop_bits`),
/// for each word of a step (`stream_bits`) or for each round of so many `variants`.
fn folds(program: &Program) -> Folds {
    let (mut loop_bits, mut stream_bits, mut variants) = (Histogram::new(), Histogram::new(), Histogram::new());
    for pe in &program.pes {
        let fold = Fold::of(program, pe);
        *loop_bits.entry(fold.loop_bits()).or_default() += 1;
        let stream = if fold.stream.is_empty() { 0 } else { fold.streamed_bits() };
        *stream_bits.entry(stream).or_default() += 1;
        if let Some(count) = fold.variants() {
            *variants.entry(count).or_default() += 1;
        }
    }
    let variants = (!variants.is_empty()).then_some(variants);
    Folds { rounds: program.rounds, round_words: program.round_words(), loop_bits, stream_bits, variants }
}

/// Control-word fields that some PE has: PEs with and without, and widths.
fn fields(program: &Program) -> Vec<Field> {
    let mut fields: BTreeMap<FieldName, Histogram> = BTreeMap::new();
    for pe in &program.pes {
        for field in Layout::new(&pe.features, &program.format).fields {
            *fields.entry(field.name).or_default().entry(field.width).or_default() += 1;
        }
    }
    let row = |(name, bits): (FieldName, Histogram)| {
        let with: usize = bits.values().sum();
        Field { field: name.text().to_owned(), with, without: program.pes.len() - with, bits }
    };
    fields.into_iter().map(row).collect()
}
