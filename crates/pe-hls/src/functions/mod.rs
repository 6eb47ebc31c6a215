//! Tables of polynomials in place of the functions of a step graph; see `docs/decisions/0024`.
//!
//! What goes in is a step graph whose chains apply functions, and the arguments that these had over a run in double
//! precision; what comes out is a step graph of sums of products alone, in which each function is a lookup: its argument
//! mapped to -1 .. 1, a local coordinate in the segment that this falls into, and a polynomial of it by Horner's rule with
//! the coefficients of the segment.

mod domain;
mod expand;
mod fit;

use expand::expand;

use pe_ir::codes;
use pe_ir::functions::{Segments, Table};
use pe_ir::graph::StepGraph;
use pe_ir::source::{Diagnostic, Span};
use pe_ir::word::WordFormat;

use domain::{Domain, steepest_place};
use fit::{Fit, Layout};

/// Bits of an index that are tried.
const INDEX_BITS: std::ops::RangeInclusive<u32> = 3..=8;

/// Bits of an index that may count octaves.
const OCTAVE_BITS: std::ops::RangeInclusive<u32> = 2..=4;

/// Words of tables that are as good as twice the products.
const WORDS: f64 = 4096.0;

/// Functions that the division is chosen for, at most; they are spread over all.
const SAMPLED: usize = 24;

/// Largest error of a table, relative to the largest value of its function; a coarser one is refused.
const COARSEST: f64 = 1.0 / 256.0;

/// A function of the step and how it is computed.
struct Planned<'a> {
    domain: Domain<'a>,
    fit: Fit,
}

/// A function that grows beyond all bounds between its arguments.
#[derive(Clone, Debug)]
pub struct Unbounded {
    /// The function among those of the step graph.
    pub function: usize,
    /// The argument where it does.
    pub at: f64,
    /// `E0904`.
    pub finding: Diagnostic,
}

/// The step graph with tables in place of its exact functions, for words of a format. `arguments` are smallest and
/// largest argument of each function over the run.
///
/// # Errors
/// All functions that grow beyond all bounds between their arguments.
pub fn tabulate(graph: &StepGraph, arguments: &[(f64, f64)], format: WordFormat) -> Result<StepGraph, Vec<Unbounded>> {
    let mut uses = vec![0u64; graph.functions.exact.len()];
    let mut place: Vec<Option<(&str, Span)>> = vec![None; uses.len()];
    for chain in &graph.chains {
        if let Some(function) = chain.function {
            let equation = &graph.equations[chain.equation as usize];
            uses[function as usize] += 1;
            place[function as usize].get_or_insert((&equation.name, equation.span));
        }
    }
    let (mut domains, mut errors) = (Vec::new(), Vec::new());
    for (index, function) in graph.functions.exact.iter().enumerate() {
        let domain = match place[index] {
            None => None,
            Some(place) => match Domain::of(function, arguments[index], format) {
                Ok(domain) => Some(domain),
                Err(at) => {
                    let finding = unbounded(&function.name, place, arguments[index], at);
                    errors.push(Unbounded { function: index, at, finding });
                    None
                }
            },
        };
        domains.push(domain);
    }
    if !errors.is_empty() {
        return Err(errors);
    }
    let (segments, planned) = plan(domains, &uses, format);
    for (index, planned) in planned.iter().enumerate() {
        let (Some(planned), Some(place)) = (planned, place[index]) else { continue };
        if planned.fit.error > COARSEST * planned.domain.largest {
            let at = steepest_place(&graph.functions.exact[index], arguments[index], planned.fit.worst);
            let finding = unbounded(&graph.functions.exact[index].name, place, arguments[index], at);
            errors.push(Unbounded { function: index, at, finding });
        }
    }
    if errors.is_empty() { Ok(expand(graph, segments, &planned)) } else { Err(errors) }
}

/// The division of all tables, and of each function its table.
fn plan<'a>(
    domains: Vec<Option<Domain<'a>>>,
    uses: &[u64],
    format: WordFormat,
) -> (Segments, Vec<Option<Planned<'a>>>) {
    let known: Vec<(&Domain, u64)> =
        domains.iter().zip(uses).filter_map(|(domain, uses)| Some((domain.as_ref()?, *uses))).collect();
    let stride = known.len().div_ceil(SAMPLED).max(1);
    let mut sampled: Vec<(&Domain, u64)> = known.iter().step_by(stride).copied().collect();
    let mut segments = divide(&sampled, format);
    if stride > 1 {
        // The worst of those that were not asked have a say as well.
        let excess = |(index, (domain, _)): (usize, &(&Domain, u64))| (Fit::of(domain, segments).excess, index);
        let mut missed: Vec<(f64, usize)> = known.iter().enumerate().map(excess).collect();
        missed.retain(|(excess, _)| *excess > 1.0);
        missed.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        missed.truncate(SAMPLED);
        if !missed.is_empty() {
            sampled.extend(missed.iter().map(|(_, index)| known[*index]));
            segments = divide(&sampled, format);
        }
    }
    let planned = domains.into_iter().map(|domain| {
        let domain = domain?;
        Some(Planned { fit: Fit::of(&domain, segments), domain })
    });
    (segments, planned.collect())
}

/// The division with the fewest products of these functions, so often used, in not too many words.
fn divide(functions: &[(&Domain, u64)], format: WordFormat) -> Segments {
    let mut best: Option<(f64, Segments)> = None;
    let octaves = std::iter::once(0).chain(OCTAVE_BITS);
    for (index_bits, octave_bits) in INDEX_BITS.flat_map(|bits| octaves.clone().map(move |octaves| (bits, octaves))) {
        let segments = Segments { index_bits, octave_bits };
        let deepest = (1u32 << octave_bits) - 1 + index_bits.saturating_sub(octave_bits);
        if octave_bits >= index_bits || deepest >= format.data_bits {
            continue;
        }
        let fits: Vec<(Fit, u64)> = functions.iter().map(|(domain, uses)| (Fit::of(domain, segments), *uses)).collect();
        if octave_bits > 0 && !fits.iter().any(|(fit, _)| fit.layout == Layout::Octaves) {
            // The same as without octaves.
            continue;
        }
        let products: u64 = fits.iter().map(|(fit, uses)| uses * fit.products() as u64).sum();
        let words: usize = fits.iter().map(|(fit, _)| fit.columns.len() << index_bits).sum();
        // What misses the accuracy is worse than anything that holds it.
        let missed: f64 = fits.iter().map(|(fit, _)| libm::log2(fit.excess)).sum();
        let cost = products as f64 * (1.0 + words as f64 / WORDS) * libm::exp2(8.0 * missed);
        if best.is_none_or(|(least, _)| cost < least) {
            best = Some((cost, segments));
        }
    }
    best.expect("some division is tried").1
}

fn unbounded(function: &str, (name, span): (&str, Span), (low, high): (f64, f64), at: f64) -> Diagnostic {
    let message = format!(
        "`{name}` cannot be computed: `{function}` has no bounded values near x = {at:.6e}, between {low:.6e} and {high:.6e}"
    );
    Diagnostic::error(codes::OUTSIDE_DOMAIN, span, message)
        .with_help("keep the argument away from there, with `max`, `min` or `if`; or a smaller `--step` stays away")
}

impl Planned<'_> {
    /// The table of a function.
    fn table(&self, name: &str) -> Table {
        Table {
            name: name.to_owned(),
            octaves: self.fit.layout == Layout::Octaves,
            columns: self.fit.columns.clone(),
            domain: (self.domain.low, self.domain.high),
            error: self.fit.error,
        }
    }
}

#[cfg(test)]
mod tests;
