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
    let luts: Vec<_> = shapes.iter().map(lut_row).collect();
    let ffs: Vec<_> = shapes.iter().map(ff_row).collect();
    let (lut, lut_deviation) = fit(&luts, &LUT_COUNTS);
    let (ff, ff_deviation) = fit(&ffs, &FF_COUNTS);
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
         /// Measured PEs with each of `TRAITS`.\npub const SHAPES: [u32; {}] = {known:?};\n",
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
    page += "\n| word | multiplier | own, base | imported | coefficients | ports | shifts | accumulator | else | LUT | \
             residual | FF | residual |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n";
    for ((shape, lut_row), ff_row) in shapes.iter().zip(&luts).zip(&ffs) {
        let MeasuredShape { features, format, .. } = shape;
        let shifts: Vec<String> = features.shifts.iter().map(u8::to_string).collect();
        let flags = [
            (features.factor, "factor"),
            (features.pre_adder, "pre-adder"),
            (features.swap, "swap"),
            (features.send, "send"),
        ];
        let flags: Vec<&str> = flags.into_iter().filter(|flag| flag.0).map(|flag| flag.1).collect();
        writeln!(
            page,
            "| {} | {}x{} | {}, {} | {} | {} | {} | {} | {} | {} | {} | {:+.1} % | {} | {:+.1} % |",
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
            100.0 * residual(lut_row, &lut),
            shape.ff,
            100.0 * residual(ff_row, &ff),
        )
        .unwrap();
    }
    fs::write(root.join("../../docs/area-model.md"), page).expect("area-model.md can be written");
    println!("{} shapes: {:.1} % of LUTs, {:.1} % of FFs", shapes.len(), 100.0 * lut_deviation, 100.0 * ff_deviation);
}
