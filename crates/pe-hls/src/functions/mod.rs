//! Tables of polynomials in place of the functions of a step graph; see `docs/decisions/0024`.
//!
//! What goes in is a step graph whose chains apply functions, and the arguments that these had over a run in double
//! precision; what comes out is a step graph of sums of products alone, in which each function is a lookup: its argument
//! mapped to -1 .. 1, a local coordinate in the segment that this falls into, and a polynomial of it by Horner's rule with
//! the coefficients of the segment.

mod divisions;
mod domain;
mod enclosure;
mod expand;
mod fit;
mod parts;
mod places;

use expand::{Computed, Planned, PlannedPart, expand};

use pe_ir::codes;
use pe_ir::functions::Segments;
use pe_ir::graph::StepGraph;
use pe_ir::index;
use pe_ir::source::{Diagnostic, Span};
use pe_ir::word::WordFormat;

use divisions::divisions;
use domain::Domain;
use fit::{Fit, Layout};

/// Words of tables that are as good as twice the products.
const WORDS: f64 = 4096.0;

/// Functions that the division is chosen for, at most; they are spread over all.
const SAMPLED: usize = 24;

/// Largest error of a table, relative to the largest value of its function; a coarser one is refused.
const COARSEST: f64 = 1.0 / 256.0;

/// A function that has no table for its arguments.
#[derive(Clone, Debug)]
pub struct Untabled {
    /// The function among those of the step graph.
    pub function: usize,
    /// The argument where it grows beyond all bounds, or where its table is worst.
    pub at: f64,
    /// `E0904` or `E0916`.
    pub finding: Diagnostic,
}

/// The step graph with tables in place of its exact functions, for words of a format. `arguments` are smallest and
/// largest argument of each function over the run. A function that one table does not hold becomes a sum of parts.
///
/// # Errors
/// All functions that grow beyond all bounds between their arguments, or that are too steep for tables.
pub fn tabulate(graph: &StepGraph, arguments: &[(f64, f64)], format: WordFormat) -> Result<StepGraph, Vec<Untabled>> {
    let mut uses = vec![0u64; graph.functions.exact.len()];
    let mut place: Vec<Option<(&str, Span)>> = vec![None; uses.len()];
    for chain in &graph.chains {
        if let Some(function) = chain.function {
            let equation = &graph.equations[chain.equation];
            uses[index::at(function)] += 1;
            place[index::at(function)].get_or_insert((&equation.name, equation.span));
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
                    errors.push(Untabled { function: index, at, finding });
                    None
                }
            },
        };
        domains.push(domain);
    }
    if !errors.is_empty() {
        return Err(errors);
    }
    let (segments, computed) = computed(domains, &uses, format);
    for (index, computed) in computed.iter().enumerate() {
        let (Some(computed), Some(place)) = (computed, place[index]) else { continue };
        if let Some((at, error)) = computed.misses(COARSEST, parts::COARSE) {
            let name = &graph.functions.exact[index].name;
            let finding = too_steep(name, place, arguments[index], (at, error), computed.parts());
            errors.push(Untabled { function: index, at, finding });
        }
    }
    if errors.is_empty() { Ok(expand(graph, segments, &computed)) } else { Err(errors) }
}

/// The division of all tables, and how each function is computed with them: by one table, or by parts if one does not
/// hold it and parts do.
fn computed<'a>(
    domains: Vec<Option<Domain<'a>>>,
    uses: &[u64],
    format: WordFormat,
) -> (Segments, Vec<Option<Computed<'a>>>) {
    let (segments, planned) = plan(domains, uses, format);
    let misses = |planned: &Planned| planned.fit.blurred_excess > parts::COARSE;
    let divided: Vec<Option<Vec<parts::Part>>> = planned
        .iter()
        .map(|planned| parts::parts(&planned.as_ref().filter(|planned| misses(planned))?.domain, format))
        .collect();
    if divided.iter().all(Option::is_none) {
        return (segments, planned.into_iter().map(|planned| planned.map(Computed::whole)).collect());
    }
    // Tables of parts have a say in the division of all.
    let (mut domains, mut again, mut shapes) = (Vec::new(), Vec::new(), Vec::new());
    for ((planned, divided), uses) in planned.into_iter().zip(divided).zip(uses) {
        shapes.push(match (&planned, &divided) {
            (None, _) => None,
            (Some(_), None) => Some(Vec::new()),
            (Some(planned), Some(parts)) => {
                let largest = planned.domain.largest;
                Some(parts.iter().map(|part| (part.clamps.len(), part.origin, largest)).collect::<Vec<_>>())
            }
        });
        let of: Vec<Domain> = match divided {
            Some(parts) => parts.into_iter().flat_map(|part| part.clamps.into_iter().chain([part.domain])).collect(),
            None => planned.into_iter().map(|planned| planned.domain).collect(),
        };
        again.extend(of.iter().map(|_| *uses));
        domains.extend(of.into_iter().map(Some));
    }
    let (segments, planned) = plan(domains, &again, format);
    let mut planned = planned.into_iter().map(|planned| planned.expect("a domain has a plan"));
    let mut next = || planned.next().expect("as many plans as domains");
    let computed = shapes.into_iter().map(|shape| {
        let shape = shape?;
        if shape.is_empty() {
            return Some(Computed::whole(next()));
        }
        let largest = shape[0].2;
        let part = |(clamps, origin, _): (usize, f64, f64)| {
            let clamps = (0..clamps).map(|_| next()).collect();
            PlannedPart { clamps, table: next(), origin }
        };
        Some(Computed { largest, parts: shape.into_iter().map(part).collect() })
    });
    let computed = computed.collect();
    (segments, computed)
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
    for segments in divisions(format) {
        let Segments { index_bits, octave_bits } = segments;
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

fn too_steep(
    function: &str,
    (name, span): (&str, Span),
    (low, high): (f64, f64),
    (at, error): (f64, f64),
    parts: usize,
) -> Diagnostic {
    let tried = if parts > 1 { format!("{parts} tables together are") } else { "the best table is".to_owned() };
    let message = format!(
        "`{name}` is too steep for a table: of `{function}` between x = {low:.6e} and {high:.6e} {tried} wrong by {error:.1e} \
         of its largest value, near x = {at:.6e}"
    );
    Diagnostic::error(codes::TOO_STEEP, span, message).with_help(
        "the values are bounded, but change within too small a part of the arguments: narrow these with `max` and `min`, or \
         compute the function from a variable that changes less",
    )
}

#[cfg(test)]
mod matrix;
#[cfg(test)]
mod tests;
