//! Fits the area model to measured PEs by least squares and writes its coefficients and residuals.
//!
//!     cargo run -p pe-synth --example fit_area [-- FILE...]
//!
//! Reads `crates/pe-synth/src/area/measured.txt` and the lines of each FILE, all written by `hdl/measure-area.sh`; of
//! two lines for the same shape the later one counts. Writes `measured.txt` again, `fitted.rs` beside it and
//! `docs/area-model.md`. `docs/fit-area.sh` measures and fits. Residuals are weighted by the measured size, so that small PEs count as much as large ones.
//! Terms that the measured PEs do not tell apart stay near what a count of the circuit says, a table or flip-flop per
//! unit: a deviation from it costs as a residual does, times [`PULL`].

use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::Path;

use nalgebra::{SMatrix, SVector};
use pe_ir::word::Pipeline;
use pe_synth::area::{self, ENOUGH, FF_TERMS, LUT_TERMS, MeasuredShape, RARE_ERROR, TRAITS};

/// Weight of a coefficient's squared distance from its count, against squared relative residuals.
const PULL: f64 = 5e-2;

/// Counted coefficients.
const LUT_COUNTS: [f64; LUT_TERMS.len()] = [1.0, 1.0, 1.0, 1.0, 4.0, 2.0, 1.0, 16.0];
const FF_COUNTS: [f64; FF_TERMS.len()] = [1.0, 1.0, 1.0, 1.0, 1.0, 2.0];

/// Coefficients of the terms, and the root mean square of the relative residuals.
fn fit<const N: usize>(rows: &[([f64; N], f64)], counts: &[f64; N]) -> ([f64; N], f64) {
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
    let coefficients: [f64; N] = solution.map(|number| (number * 1e3).round() / 1e3).into();
    let squares: f64 = rows.iter().map(|row| residual(row, &coefficients).powi(2)).sum();
    (coefficients, (squares / rows.len() as f64).sqrt())
}

/// Coefficient of the one term that is left of deep PEs, and the root mean square of the relative residuals.
fn rest(rows: &[(f64, f64, f64)]) -> (f64, f64) {
    let slope = rows.iter().map(|(term, known, all)| term * (all - known) / (all * all)).sum::<f64>()
        / rows.iter().map(|(term, _, all)| (term / all).powi(2)).sum::<f64>();
    let slope = (slope * 1e3).round() / 1e3;
    let squares = rows.iter().map(|(term, known, all)| ((known + slope * term) / all - 1.0).powi(2)).sum::<f64>();
    (slope, (squares / rows.len() as f64).sqrt())
}

/// Largest relative residual.
fn worst<const N: usize>(rows: &[([f64; N], f64)], coefficients: &[f64; N]) -> f64 {
    rows.iter().map(|row| residual(row, coefficients).abs()).fold(0.0, f64::max)
}

fn residual<const N: usize>((terms, measured): &([f64; N], f64), coefficients: &[f64; N]) -> f64 {
    terms.iter().zip(coefficients).map(|(term, coefficient)| term * coefficient).sum::<f64>() / measured - 1.0
}

/// Measured shapes by what they are, in the order of their lines.
fn collect(texts: &[String]) -> Vec<MeasuredShape> {
    let shapes = texts.iter().flat_map(|text| area::read(text).expect("every line is a measured shape"));
    let by_key: BTreeMap<String, MeasuredShape> = shapes.map(|shape| (shape.key.clone(), shape)).collect();
    by_key.into_values().collect()
}

fn main() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let table = root.join("src/area/measured.txt");
    let mut texts = vec![fs::read_to_string(&table).expect("measured.txt is there")];
    texts.extend(std::env::args().skip(1).map(|path| fs::read_to_string(path).expect("the file can be read")));
    let shapes = collect(&texts);
    fs::write(&table, shapes.iter().map(|shape| shape.line() + "\n").collect::<String>())
        .expect("measured.txt is written");

    // Control words are not a matter of the fit.
    let lut_row = |s: &MeasuredShape| (area::lut_terms(&s.features, &s.format), f64::from(s.lut) - s.program.lut);
    let ff_row = |s: &MeasuredShape| (area::ff_terms(&s.features, &s.format), f64::from(s.ff) - s.program.ff);
    let all = shapes;
    let (shapes, deep): (Vec<_>, Vec<_>) = all.into_iter().partition(|s| s.format.pipeline == Pipeline::Short);
    let luts: Vec<_> = shapes.iter().map(lut_row).collect();
    let ffs: Vec<_> = shapes.iter().map(ff_row).collect();
    let (lut, lut_deviation) = fit(&luts, &LUT_COUNTS);
    let (ff, ff_deviation) = fit(&ffs, &FF_COUNTS);
    // Deep PEs do not move the coefficients of short ones.
    let weigh = |terms: &[f64], by: &[f64]| terms.iter().zip(by).map(|(term, weight)| term * weight).sum::<f64>();
    let deep_lut = |s: &MeasuredShape| {
        let known = weigh(&area::lut_terms(&s.features, &s.format), &lut) + s.program.lut;
        (area::deeper(&s.features, &s.format).0, known, f64::from(s.lut))
    };
    let deep_ff = |s: &MeasuredShape| {
        let known = weigh(&area::ff_terms(&s.features, &s.format), &ff) + s.program.ff;
        (area::deeper(&s.features, &s.format).1, known, f64::from(s.ff))
    };
    let deep_luts: Vec<_> = deep.iter().map(deep_lut).collect();
    let deep_ffs: Vec<_> = deep.iter().map(deep_ff).collect();
    let ((more_lut, deep_lut_deviation), (more_ff, deep_ff_deviation)) = (rest(&deep_luts), rest(&deep_ffs));
    let mut known = [0; TRAITS.len()];
    for shape in &shapes {
        let traits = area::traits(&shape.features, &shape.format);
        known.iter_mut().zip(traits).for_each(|(count, has)| *count += u32::from(has));
    }

    let code = format!(
        "//! Written by `cargo run -p pe-synth --example fit_area`; do not edit.\n\n\
         /// Look-up tables per unit of each of `LUT_TERMS`.\npub const LUT: [f64; {}] = {lut:?};\n\n\
         /// Root mean square of the relative residuals of look-up tables.\n\
         pub const LUT_DEVIATION: f64 = {lut_deviation:.4};\n\n\
         /// Flip-flops per unit of each of `FF_TERMS`.\npub const FF: [f64; {}] = {ff:?};\n\n\
         /// Root mean square of the relative residuals of flip-flops.\n\
         pub const FF_DEVIATION: f64 = {ff_deviation:.4};\n\n\
         /// Measured PEs with each of `TRAITS`.\npub const SHAPES: [u32; {}] = {known:?};\n\n\
         /// Look-up tables per bit that a deep pipeline chooses in tables of their own.\n\
         pub const DEEP_LUT: f64 = {more_lut:?};\n\n\
         /// Root mean square of the relative residuals of the look-up tables of deep PEs.\n\
         pub const DEEP_LUT_DEVIATION: f64 = {deep_lut_deviation:.4};\n\n\
         /// Flip-flops per bit of second registers of a deep pipeline.\n\
         pub const DEEP_FF: f64 = {more_ff:?};\n\n\
         /// Root mean square of the relative residuals of the flip-flops of deep PEs.\n\
         pub const DEEP_FF_DEVIATION: f64 = {deep_ff_deviation:.4};\n",
        lut.len(),
        ff.len(),
        known.len(),
    );
    fs::write(root.join("src/area/fitted.rs"), code).expect("fitted.rs can be written");

    let mut page = format!(
        "# Area model\n\nWritten by `cargo run -p pe-synth --example fit_area`; do not edit. Look-up tables and flip-flops \
         of a PE without\nits program memory are sums of terms, fitted to {} PEs that `hdl/measure-area.sh` synthesised \
         (GHDL, yosys 0.70, xc6v)\nand whose netlists it simulated. [silicon.md](silicon.md) says how.\n\n\
         ```sh\ndocs/fit-area.sh [DESIGN_FOLDER...]   # measures single PEs and the PEs of designs, and fits again\n```\n\n\
         Root mean square of the relative residuals: {:.1} % of the look-up tables, worst {:.1} %; {:.1} % of the \
         flip-flops, worst\n{:.1} %. Estimates in reports carry twice the root mean square as error. {} shapes are few \
         for {} and {} coefficients, so\nthat these are pulled towards a count of the circuit.\n\n",
        shapes.len(),
        100.0 * lut_deviation,
        100.0 * worst(&luts, &lut),
        100.0 * ff_deviation,
        100.0 * worst(&ffs, &ff),
        shapes.len(),
        lut.len(),
        ff.len(),
    );
    let plain =
        shapes.iter().filter(|shape| (shape.format.data_bits, shape.format.coefficient_bits) == (25, 18)).count();
    write!(
        page,
        "{plain} of the shapes are 25x18, and many are alike. Estimates of PEs with a trait that fewer than {ENOUGH} \
         measured ones have carry {:.0} %\nas error, a round figure for what is not known; several such traits together \
         may be off by more:\n\n| trait | measured shapes | error of estimates |\n\
         |---|---|---|\n",
        100.0 * RARE_ERROR
    )
    .unwrap();
    for (name, count) in TRAITS.iter().zip(known) {
        let error = if count < ENOUGH { RARE_ERROR } else { 2.0 * lut_deviation };
        writeln!(page, "| {name} | {count} | {:.1} % |", 100.0 * error).unwrap();
    }
    page += "\n";
    page += "| look-up tables per unit of | | flip-flops per unit of | |\n|---|---|---|---|\n";
    for index in 0..LUT_TERMS.len() {
        let flip_flops = FF_TERMS.get(index).map_or(String::from("| |"), |name| format!("{name} | {} |", ff[index]));
        writeln!(page, "| {} | {} | {flip_flops}", LUT_TERMS[index], lut[index]).unwrap();
    }
    page += "\n";
    page += HEAD;
    let residuals = luts.iter().zip(&ffs).map(|(lut_row, ff_row)| (residual(lut_row, &lut), residual(ff_row, &ff)));
    for (shape, (lut_residual, ff_residual)) in shapes.iter().zip(residuals) {
        page += &row(shape, lut_residual, ff_residual);
    }
    let off = |(term, known, all): &(f64, f64, f64), by: f64| (known + by * term) / all - 1.0;
    let worst = |rows: &[(f64, f64, f64)], by| rows.iter().map(|row| off(row, by).abs()).fold(0.0, f64::max);
    write!(
        page,
        "\nA deep pipeline adds bits that are chosen in tables of their own because a register follows, {more_lut} tables \
         each, and bits\nof second registers, {more_ff} flip-flops each. Registers of program memories are counted. Fitted to \
         {} PEs after the others,\nwhose coefficients stay: root mean square {:.1} % of the look-up tables, worst {:.1} %; \
         {:.1} % of the flip-flops, worst {:.1} %.\n\n{HEAD}",
        deep.len(),
        100.0 * deep_lut_deviation,
        100.0 * worst(&deep_luts, more_lut),
        100.0 * deep_ff_deviation,
        100.0 * worst(&deep_ffs, more_ff),
    )
    .unwrap();
    for ((shape, lut_row), ff_row) in deep.iter().zip(&deep_luts).zip(&deep_ffs) {
        page += &row(shape, off(lut_row, more_lut), off(ff_row, more_ff));
    }
    fs::write(root.join("../../docs/area-model.md"), page).expect("area-model.md can be written");
    println!("{} shapes: {:.1} % of LUTs, {:.1} % of FFs", shapes.len(), 100.0 * lut_deviation, 100.0 * ff_deviation);
}

/// Head of the tables of measured PEs.
const HEAD: &str = "| word | multiplier | own, base | imported | coefficients | ports | shifts | accumulator | else | LUT | \
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
