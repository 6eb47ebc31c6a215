//! Fits the area model to measured PEs by least squares and writes its coefficients and residuals.
//!
//!     cargo run -p pe-synth --example fit_area [-- FILE...]
//!
//! Reads `crates/pe-target/src/area/measured.txt` and the lines of each FILE, all written by `xtask measure-area`; of
//! two lines for the same shape the later one counts. Writes `measured.txt` again, `fitted.rs` beside it and
//! `docs/area-model.md`. `xtask fit-area` measures and fits. Residuals are weighted by the measured size, so that small
//! PEs count as much as large ones. Terms that the measured PEs do not tell apart stay near what a count of the circuit
//! says, a table or flip-flop per unit: a deviation from it costs as a residual does, times [`PULL`].

use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::Path;

use nalgebra::{SMatrix, SVector};
use pe_ir::word::Pipeline;
use pe_target::area::{self, ENOUGH, FF_TERMS, Family, LUT_TERMS, MeasuredShape, RARE_ERROR, TRAITS};

/// Weight of a coefficient's squared distance from its count, against squared relative residuals.
const PULL: f64 = 5e-2;

/// Counted coefficients; of tables of four inputs a PE has more beside the others.
fn lut_counts(family: Family) -> [f64; LUT_TERMS.len()] {
    [1.0, 1.0, 1.0, 1.0, 1.0, 4.0, 2.0, 1.0, 1.0, if family.wide_tables() { 16.0 } else { 45.0 }]
}

/// The same of flip-flops.
const FF_COUNTS: [f64; FF_TERMS.len()] = [1.0, 1.0, 1.0, 1.0, 1.0, 2.0];

/// Coefficients of the terms.
fn fit<const N: usize>(rows: &[([f64; N], f64)], counts: &[f64; N]) -> [f64; N] {
    // Normal equations; the pull makes them positive definite.
    let mut matrix = SMatrix::<f64, N, N>::identity() * PULL;
    let mut right = SVector::from(*counts) * PULL;
    for (terms, measured) in rows {
        let relative = SVector::from(*terms) / *measured;
        matrix += relative * relative.transpose();
        right += relative;
    }
    let solution = matrix.cholesky().expect("positive definite").solve(&right);
    // Three decimals are more than the figures bear.
    solution.map(|number| (number * 1e3).round() / 1e3).into()
}

/// Coefficient of the one term that is left of deep PEs; 0 if none of them has it.
fn rest(rows: &[(f64, f64, f64)]) -> f64 {
    let weight: f64 = rows.iter().map(|(term, _, all)| (term / all) * (term / all)).sum();
    let slope = rows.iter().map(|(term, known, all)| term * (all - known) / (all * all)).sum::<f64>();
    if weight > 0.0 { (slope / weight * 1e3).round() / 1e3 } else { 0.0 }
}

/// Measured shapes by what they are, in the order of their lines.
fn collect(texts: &[String]) -> Vec<MeasuredShape> {
    let shapes = texts.iter().flat_map(|text| area::read(text).expect("every line is a measured shape"));
    let by_key: BTreeMap<String, MeasuredShape> = shapes.map(|shape| (shape.key.clone(), shape)).collect();
    by_key.into_values().collect()
}

/// What was fitted to the measured PEs of a family, and its residuals.
struct Fit {
    family: Family,
    short: Vec<MeasuredShape>,
    deep: Vec<MeasuredShape>,
    lut: [f64; LUT_TERMS.len()],
    ff: [f64; FF_TERMS.len()],
    deep_lut: f64,
    deep_ff: f64,
    /// Relative residuals of LUTs and flip-flops, of the short ones and of the deep ones.
    residuals: [Vec<(f64, f64)>; 2],
    known: [u32; TRAITS.len()],
}

impl Fit {
    fn of(family: Family, shapes: &[MeasuredShape]) -> Fit {
        let of_family = shapes.iter().filter(|shape| shape.family == family).cloned();
        let (short, deep): (Vec<_>, Vec<_>) = of_family.partition(|s| s.format.pipeline == Pipeline::Short);
        // Control words are not a matter of the fit.
        let lut_terms = |s: &MeasuredShape| area::lut_terms(&s.features, &s.format, family);
        let ff_terms = |s: &MeasuredShape| area::ff_terms(&s.features, &s.format, family);
        let luts: Vec<_> = short.iter().map(|s| (lut_terms(s), f64::from(s.lut) - s.program.lut)).collect();
        let ffs: Vec<_> = short.iter().map(|s| (ff_terms(s), f64::from(s.ff) - s.program.ff)).collect();
        let lut = fit(&luts, &lut_counts(family));
        let ff = fit(&ffs, &FF_COUNTS);
        // Deep PEs do not move the coefficients of short ones.
        let weigh = |terms: &[f64], by: &[f64]| terms.iter().zip(by).map(|(term, weight)| term * weight).sum::<f64>();
        let known_lut = |s: &MeasuredShape| weigh(&lut_terms(s), &lut) + s.program.lut;
        let known_ff = |s: &MeasuredShape| weigh(&ff_terms(s), &ff) + s.program.ff;
        let deeper = |s: &MeasuredShape| area::deeper(&s.features, &s.format, family);
        let deep_luts: Vec<_> = deep.iter().map(|s| (deeper(s).0, known_lut(s), f64::from(s.lut))).collect();
        let deep_ffs: Vec<_> = deep.iter().map(|s| (deeper(s).1, known_ff(s), f64::from(s.ff))).collect();
        let (deep_lut, deep_ff) = (rest(&deep_luts), rest(&deep_ffs));
        let off = |(term, known, all): &(f64, f64, f64), by: f64| (known + by * term) / all - 1.0;
        let lut_off = |s: &MeasuredShape| known_lut(s) / f64::from(s.lut) - 1.0;
        let ff_off = |s: &MeasuredShape| known_ff(s) / f64::from(s.ff) - 1.0;
        let residuals = [
            short.iter().map(|s| (lut_off(s), ff_off(s))).collect(),
            deep_luts.iter().zip(&deep_ffs).map(|(l, f)| (off(l, deep_lut), off(f, deep_ff))).collect(),
        ];
        let mut known = [0; TRAITS.len()];
        for shape in &short {
            let traits = area::traits(&shape.features, &shape.format);
            known.iter_mut().zip(traits).for_each(|(count, has)| *count += u32::from(has));
        }
        Fit { family, short, deep, lut, ff, deep_lut, deep_ff, residuals, known }
    }

    /// Root mean square and worst of the residuals of LUTs and of flip-flops.
    fn deviations(&self, deep: bool) -> [(f64, f64); 2] {
        let of = &self.residuals[usize::from(deep)];
        let summary = |values: Vec<f64>| {
            let squares: f64 = values.iter().map(|value| value * value).sum();
            ((squares / values.len() as f64).sqrt(), values.iter().map(|value| value.abs()).fold(0.0, f64::max))
        };
        [summary(of.iter().map(|both| both.0).collect()), summary(of.iter().map(|both| both.1).collect())]
    }

    /// The constant of `fitted.rs`.
    fn code(&self) -> String {
        let ([lut, ff], [deep_lut, deep_ff]) = (self.deviations(false), self.deviations(true));
        format!(
            "\n/// {}.\npub const {}: Fitted = Fitted {{\n    lut: {:?},\n    lut_deviation: {:.4},\n    ff: {:?},\n    \
             ff_deviation: {:.4},\n    shapes: {:?},\n    deep_lut: {:?},\n    deep_lut_deviation: {:.4},\n    \
             deep_ff: {:?},\n    deep_ff_deviation: {:.4},\n}};\n",
            title(self.family),
            self.family.name().to_uppercase(),
            self.lut,
            lut.0,
            self.ff,
            ff.0,
            self.known,
            self.deep_lut,
            deep_lut.0,
            self.deep_ff,
            deep_ff.0,
        )
    }

    /// The section of the page.
    fn section(&self) -> String {
        let ([lut, ff], [deep_lut, deep_ff]) = (self.deviations(false), self.deviations(true));
        let percent = |value: f64| 100.0 * value;
        let mut page = format!(
            "## {}\n\n{} PEs with the short pipeline, root mean square of the relative residuals: {:.1} % of the \
             LUTs, worst {:.1} %;\n{:.1} % of the flip-flops, worst {:.1} %. {} with the deep one, fitted after the \
             others, whose coefficients stay: {:.1} % of the\nLUTs, worst {:.1} %; {:.1} % of the flip-flops, \
             worst {:.1} %. Bits that a deep pipeline chooses in LUTs of their\nown take {} LUTs each, bits of second \
             registers {} flip-flops. Registers of program memories are counted.\n\n",
            title(self.family),
            self.short.len(),
            percent(lut.0),
            percent(lut.1),
            percent(ff.0),
            percent(ff.1),
            self.deep.len(),
            percent(deep_lut.0),
            percent(deep_lut.1),
            percent(deep_ff.0),
            percent(deep_ff.1),
            self.deep_lut,
            self.deep_ff,
        );
        page += "| LUTs per unit of | | flip-flops per unit of | |\n|---|---|---|---|\n";
        for (index, (name, tables)) in LUT_TERMS.iter().zip(self.lut).enumerate() {
            let flip_flops =
                FF_TERMS.get(index).map_or("| |".to_owned(), |name| format!("{name} | {} |", self.ff[index]));
            writeln!(page, "| {name} | {tables} | {flip_flops}").unwrap();
        }
        page += "\n| trait | measured shapes | error of estimates |\n|---|---|---|\n";
        for (name, count) in TRAITS.iter().zip(self.known) {
            let error = if count < ENOUGH { RARE_ERROR } else { 2.0 * lut.0 };
            writeln!(page, "| {name} | {count} | {:.1} % |", percent(error)).unwrap();
        }
        page += HEAD;
        for (shapes, residuals) in [&self.short, &self.deep].into_iter().zip(&self.residuals) {
            for (shape, (lut, ff)) in shapes.iter().zip(residuals) {
                page += &row(shape, *lut, *ff);
            }
        }
        page + "\n"
    }
}

/// What a family is.
fn title(family: Family) -> &'static str {
    match family {
        Family::Virtex6 | Family::UltraScale => "Xilinx 6 and 7 series, and LUTs of UltraScale+",
        Family::Ecp5 => "Lattice ECP5",
        Family::Gowin => "Gowin GW1N and GW2A",
    }
}

fn main() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let table = root.join("../pe-target/src/area/measured.txt");
    let mut texts = vec![fs::read_to_string(&table).expect("measured.txt is there")];
    texts.extend(std::env::args().skip(1).map(|path| fs::read_to_string(path).expect("the file can be read")));
    let shapes = collect(&texts);
    fs::write(&table, shapes.iter().map(|shape| shape.line() + "\n").collect::<String>())
        .expect("measured.txt is written");
    let fits = Family::MEASURED.map(|family| Fit::of(family, &shapes));

    let code = root.join("../pe-target/src/area/fitted.rs");
    let text = fs::read_to_string(&code).expect("fitted.rs is there");
    let kept = text.find("\n/// Xilinx").expect("the constants begin");
    let constants: String = fits.iter().map(Fit::code).collect();
    fs::write(&code, text[..kept].to_owned() + &constants).expect("fitted.rs can be written");

    let mut page = format!(
        "# Area model\n\nWritten by `cargo run -p pe-synth --example fit_area`; do not edit. LUTs and flip-flops \
         of a PE without\nmemories that nothing writes are sums of terms, fitted for each family of devices to {} PEs that \
         `cargo run -p xtask -- measure-area`\nsynthesised (GHDL, yosys 0.70); it simulated the netlists of Virtex-6. \
         [silicon.md](silicon.md) describes the measurements and compares whole\nnetworks with the estimates.\n\n\
         ```sh\ncargo run -p xtask -- fit-area [DESIGN_FOLDER...]   # measures single PEs and the PEs of designs, and fits again\n```\n\n\
         Reports state twice the root mean square of the residuals as the error of an estimate. There are few shapes for so many \
         coefficients,\nso these are regularised towards a count of the circuit. Estimates of PEs with a trait that fewer \
         than {ENOUGH} measured ones have\ncarry {:.0} % as error, a round figure for the unknown; several such traits \
         together may be off by more.\n\n",
        shapes.len(),
        100.0 * RARE_ERROR
    );
    page += &fits.iter().map(Fit::section).collect::<String>();
    fs::write(root.join("../../docs/area-model.md"), page.trim_end().to_owned() + "\n")
        .expect("area-model.md can be written");
    for fit in &fits {
        let [lut, ff] = fit.deviations(false);
        println!(
            "{}: {} and {} shapes, {:.1} % of LUTs, {:.1} % of FFs",
            fit.family.name(),
            fit.short.len(),
            fit.deep.len(),
            100.0 * lut.0,
            100.0 * ff.0
        );
    }
}

/// Head of the tables of measured PEs.
const HEAD: &str = "\n| word | multiplier | own, base | imported | coefficients | ports | shifts | accumulator | else | LUT | \
                    residual | FF | residual |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n";

/// A measured PE with the residuals of its estimate.
fn row(shape: &MeasuredShape, lut_residual: f64, ff_residual: f64) -> String {
    let MeasuredShape { features, format, .. } = shape;
    let shifts: Vec<String> = features.shifts.iter().map(u8::to_string).collect();
    let flags = [
        (features.factor, "factor"),
        (features.pre_adder, "pre-adder"),
        (features.swap, "swap"),
        (features.send, "send"),
        (format.pipeline == Pipeline::Deep, "deep"),
    ];
    let flags: Vec<&str> = flags.into_iter().filter(|flag| flag.0).map(|flag| flag.1).collect();
    format!(
        "| {} | {}x{} | {}, {} | {} | {} | {} | {} | {} | {} | {} | {:+.1} % | {} | {:+.1} % |\n",
        format.word_bits(),
        format.data_bits,
        format.coefficient_bits,
        features.own_words,
        features.base_words,
        features.imported_words,
        features.coefficient_words,
        features.ports,
        shifts.join(" "),
        features.accumulator_bits,
        flags.join(", "),
        shape.lut,
        100.0 * lut_residual,
        shape.ff,
        100.0 * ff_residual,
    )
}
