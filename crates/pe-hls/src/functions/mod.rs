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
mod fill;
mod fit;
mod known;
mod parts;
mod places;
mod quotients;
mod scaling;
mod shape;
mod share;
mod uses;

use std::collections::{BTreeSet, HashMap};

use expand::{Computed, Planned, PlannedPart, expand};

use pe_ir::codes;
use pe_ir::functions::Segments;
use pe_ir::graph::StepGraph;
use pe_ir::index::{ChainId, List, ValueId};
use pe_ir::source::{Diagnostic, Span};
use pe_ir::word::WordFormat;

use divisions::divisions;
use domain::Domain;
use fit::{Fit, Layout, Shape};
use known::Known;
use share::{Family, Rewritten, Shared};
use uses::Use;

/// Words of tables that are as good as twice the products.
const WORDS: f64 = 4096.0;

/// What the binary logarithm of what tables miss is multiplied by for that of their cost.
const MISSED: f64 = 8.0;

/// More than rounding makes of a bound.
const ROUNDED: f64 = 1.0 + 1e-9;

/// The same where functions share tables: a few columns serve all their lookups.
const SHARED_WORDS: f64 = 8192.0;

/// Functions that the division is chosen for, at most; they are spread over all.
const SAMPLED: usize = 24;

/// Largest error of a table, relative to the largest value of its function; a coarser one is refused.
const COARSEST: f64 = 1.0 / 256.0;

/// Price of tables that functions share over that of their own, from which on they do not share any.
const WORTH: f64 = 0.95;

/// Words of a block of memory.
const BLOCK: usize = 1024;

/// One product more among so many is what shared tables may cost.
const MORE: usize = 64;

/// Functions of a step whose families are asked one by one whether they share tables, at most.
const TRIED: usize = 64;

/// Findings about uses of one function, at most.
const MOST_FINDINGS: usize = 8;

/// A use of a function that has no table for its arguments.
#[derive(Clone, Debug)]
pub struct Untabled {
    /// What the function computes there, in all stages of the step.
    pub values: Vec<ValueId>,
    /// The argument where it grows beyond all bounds, or where its table is worst.
    pub at: f64,
    /// `E0904` or `E0916`.
    pub finding: Diagnostic,
}

/// The step graph with tables in place of its exact functions, for words of a format. `arguments` are smallest and
/// largest argument over the run of the function that computes a value, by value. Uses of a function whose arguments are
/// far apart have tables of their own; what one table does not hold becomes a sum of parts. Functions of one shape share
/// tables where that costs less; values that are `kept` stay what they are then.
///
/// # Errors
/// Uses whose function grows beyond all bounds between their arguments, or is too steep for tables.
pub fn tabulate(
    graph: &StepGraph,
    arguments: &[(f64, f64)],
    format: WordFormat,
    kept: &[ValueId],
) -> Result<StepGraph, Vec<Untabled>> {
    let known = Known::default();
    let price = Price { known: Some(&known), ..Price::of(format) };
    let own = Tabulated::of(graph, arguments, (&Shared::default(), kept), price)?;
    let families = share::families(graph, arguments, format);
    if families.is_empty() {
        return Ok(own.graph);
    }
    let price = Price { words: SHARED_WORDS, scaled_from: graph.functions.exact.len(), ..price };
    let with = |shared: &[bool]| {
        let taken: Vec<&Family> =
            families.iter().zip(shared).filter(|(_, taken)| **taken).map(|(family, _)| family).collect();
        let Rewritten { graph, arguments, shared } = share::rewritten(graph, arguments, &taken, kept);
        // What has no table as a shape has one as it is.
        let tabulated = Tabulated::of(&graph, &arguments, (&shared, kept), price).ok();
        // Less than a block of memory is not worth a product, and no memory is worth many.
        let most = own.graph.terms.len();
        let products = |shared: &Tabulated| shared.graph.terms.len();
        tabulated
            .filter(|shared| products(shared) <= most + if shared.words + BLOCK <= own.words { most / MORE } else { 0 })
    };
    let mut shared = vec![true; families.len()];
    let mut best = with(&shared).filter(|all| all.price < WORTH * own.price);
    if best.is_none() {
        shared = vec![false; families.len()];
    }
    let few = families.len() > 1 && graph.functions.exact.len() <= TRIED;
    for family in (0..families.len()).filter(|_| few) {
        shared[family] = !shared[family];
        let price = best.as_ref().map_or(WORTH * own.price, |best| best.price);
        match with(&shared).filter(|other| other.price < price) {
            Some(other) if shared.contains(&true) => best = Some(other),
            _ => shared[family] = !shared[family],
        }
    }
    Ok(best.unwrap_or(own).graph)
}

/// What tables are chosen by.
#[derive(Clone, Copy)]
struct Price<'a> {
    /// The words of a step.
    format: WordFormat,
    /// Words of tables that are as good as twice the products.
    words: f64,
    /// The function from which on arguments are scaled anyway.
    scaled_from: usize,
    /// What is known of functions that were asked for before.
    known: Option<&'a Known>,
}

impl<'a> Price<'a> {
    /// That of tables of functions as they are.
    fn of(format: WordFormat) -> Price<'a> {
        Price { format, words: WORDS, scaled_from: usize::MAX, known: None }
    }
}

/// A step with tables.
struct Tabulated {
    graph: StepGraph,
    /// Words of all tables.
    words: usize,
    /// Products and words of its lookups, and the bits that they lose, in products.
    price: f64,
}

impl Tabulated {
    /// The step with the tables of its functions, and what these stand for.
    fn of(
        graph: &StepGraph,
        arguments: &[(f64, f64)],
        (shared, kept): (&Shared, &[ValueId]),
        price: Price,
    ) -> Result<Tabulated, Vec<Untabled>> {
        let (uses, use_of) = uses::uses(graph, arguments);
        let exact = &graph.functions.exact;
        let about = |of: usize| {
            let Use { function, equation, range, .. } = &uses[of];
            let equation = &graph.equations[*equation];
            (&*exact[*function].name, (&*equation.name, equation.span), *range)
        };
        let untabled = |of: usize, at: f64, finding: Diagnostic| {
            (uses[of].function, Untabled { values: uses[of].values.clone(), at, finding })
        };
        let clusters = uses::clusters(exact, &uses, price).map_err(|places| {
            let of = |(of, at): (usize, f64)| {
                let (function, place, range) = about(of);
                untabled(of, at, unbounded(function, place, range, at))
            };
            few(places.into_iter().map(of).collect())
        })?;
        let mut cluster_of = vec![0; uses.len()];
        let (mut domains, mut counts, mut members, mut lost) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (index, cluster) in clusters.into_iter().enumerate() {
            cluster.uses.iter().for_each(|of| cluster_of[*of] = index);
            domains.push(cluster.domain);
            counts.push(cluster.count);
            members.push(cluster.uses);
            lost.push(cluster.lost);
        }
        let (segments, mut computed) = computed(domains, &counts, price);
        let missing = computed.iter().zip(&members).filter_map(|(computed, members)| {
            let (at, error) = computed.misses(COARSEST, parts::COARSE)?;
            // The use whose arguments come closest to the worst place.
            let distance = |of: &usize| {
                let (low, high) = uses[*of].range;
                (low - at).max(at - high).max(0.0)
            };
            let of = members.iter().copied().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
            let (function, place, range) = about(of);
            Some(untabled(of, at, too_steep(function, place, range, (at, error), computed.parts())))
        });
        let missing: Vec<(usize, Untabled)> = missing.collect();
        if !missing.is_empty() {
            return Err(few(missing));
        }
        let products: f64 = computed
            .iter()
            .zip(counts.iter().zip(&lost))
            .map(|(computed, (count, lost))| *count as f64 * computed.products(*lost))
            .sum();
        let words: usize = computed.iter().map(|computed| computed.words(segments)).sum();
        for (computed, members) in computed.iter_mut().zip(&members) {
            let Some(function) = members.first().map(|of| uses[*of].function) else { continue };
            if function >= price.scaled_from && computed.parts() > 1 {
                // What one table does not hold is no gain; nobody is told.
                return Err(Vec::new());
            }
            let values = members.iter().flat_map(|of| &uses[*of].values);
            let functions: BTreeSet<u32> = values.filter_map(|value| shared.of(*value)).collect();
            computed.stand_for(&Vec::from_iter(functions), shared.apart(function));
        }
        // What brings values back is in the step beside its lookups.
        let price = products * (1.0 + words as f64 / WORDS) + graph.terms.len() as f64;
        let cluster_of: List<ChainId, Option<usize>> = use_of.iter().map(|of| of.map(|of| cluster_of[of])).collect();
        Ok(Tabulated { graph: expand(graph, segments, (&computed, &cluster_of), (shared, kept)), words, price })
    }
}

/// The first findings about each function.
fn few(all: Vec<(usize, Untabled)>) -> Vec<Untabled> {
    let mut counts: HashMap<usize, usize> = HashMap::new();
    let first = all.into_iter().filter(|(function, _)| {
        let count = counts.entry(*function).or_default();
        *count += 1;
        *count <= MOST_FINDINGS
    });
    first.map(|(_, untabled)| untabled).collect()
}

/// The division of all tables, and how each domain is computed with them: by one table, or by parts if one does not
/// hold it and parts do. `uses` are the lookups of each.
fn computed<'a>(domains: Vec<Domain<'a>>, uses: &[u64], price: Price) -> (Segments, Vec<Computed<'a>>) {
    let (segments, planned) = plan(domains, uses, price);
    let misses = |planned: &Planned| planned.fit.blurred_excess > parts::COARSE;
    let divided: Vec<Option<Vec<parts::Part>>> = planned
        .iter()
        .map(|planned| if misses(planned) { parts::parts(&planned.domain, price.format) } else { None })
        .collect();
    if divided.iter().all(Option::is_none) {
        return (segments, planned.into_iter().map(Computed::whole).collect());
    }
    // Tables of parts have a say in the division of all.
    let (mut domains, mut again, mut shapes) = (Vec::new(), Vec::new(), Vec::new());
    for ((planned, divided), uses) in planned.into_iter().zip(divided).zip(uses) {
        let shape: Option<Vec<(usize, f64)>> =
            divided.as_ref().map(|parts| parts.iter().map(|part| (part.clamps.len(), part.origin)).collect());
        shapes.push((planned.domain.largest, shape));
        let of: Vec<Domain> = match divided {
            Some(parts) => parts.into_iter().flat_map(|part| part.clamps.into_iter().chain([part.domain])).collect(),
            None => vec![planned.domain],
        };
        again.extend(of.iter().map(|_| *uses));
        domains.extend(of);
    }
    let (segments, planned) = plan(domains, &again, price);
    let mut planned = planned.into_iter();
    let mut next = || planned.next().expect("as many plans as domains");
    let computed = shapes.into_iter().map(|(largest, shape)| {
        let Some(shape) = shape else { return Computed::whole(next()) };
        let part = |(clamps, origin): (usize, f64)| {
            let clamps = (0..clamps).map(|_| next()).collect();
            PlannedPart { clamps, table: next(), origin }
        };
        Computed { largest, parts: shape.into_iter().map(part).collect() }
    });
    let computed = computed.collect();
    (segments, computed)
}

/// The division of all tables, and of each domain its table.
fn plan<'a>(domains: Vec<Domain<'a>>, uses: &[u64], price: Price) -> (Segments, Vec<Planned<'a>>) {
    let known: Vec<(&Domain, u64)> = domains.iter().zip(uses).map(|(domain, uses)| (domain, *uses)).collect();
    let segments = divide_sampled(&known, price);
    let planned =
        domains.into_iter().map(|domain| Planned { fit: Fit::of(&domain, segments), domain, stands_for: Vec::new() });
    (segments, planned.collect())
}

/// The division for so many tables that only some of them are asked.
fn divide_sampled(known: &[(&Domain, u64)], price: Price) -> Segments {
    let stride = known.len().div_ceil(SAMPLED).max(1);
    let mut sampled: Vec<(&Domain, u64)> = known.iter().step_by(stride).copied().collect();
    let mut segments = divide(&sampled, price);
    if stride > 1 {
        // The worst of those that were not asked have a say as well.
        let excess = |(index, (domain, _)): (usize, &(&Domain, u64))| (Shape::of(domain, segments).excess, index);
        let mut missed: Vec<(f64, usize)> = known.iter().enumerate().map(excess).collect();
        missed.retain(|(excess, _)| *excess > 1.0);
        missed.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        missed.truncate(SAMPLED);
        if !missed.is_empty() {
            sampled.extend(missed.iter().map(|(_, index)| known[*index]));
            segments = divide(&sampled, price);
        }
    }
    segments
}

/// The division with the fewest products of these functions, so often used, in not too many words. What misses the accuracy
/// is worse than anything that holds it; by how much it misses it is asked only where it may be the best even so.
fn divide(functions: &[(&Domain, u64)], price: Price) -> Segments {
    let mut least = f64::INFINITY;
    let mut costs: Vec<(Segments, Cost)> = Vec::new();
    for segments in divisions(price.format) {
        let cost = Cost::of(functions, (segments, price.words), 1.0, least);
        if let Cost::Products(products) = cost {
            least = least.min(products);
        }
        costs.push((segments, cost));
    }
    let mut best: Option<(f64, Segments)> = None;
    for (segments, cost) in costs {
        let cost = match cost {
            Cost::Misses => Cost::of(functions, (segments, price.words), f64::INFINITY, least),
            known => known,
        };
        let Cost::Products(cost) = cost else { continue };
        if best.is_none_or(|(least, _)| cost < least) {
            best = Some((cost, segments));
            least = least.min(cost);
        }
    }
    best.expect("some division is tried").1
}

/// What a division costs.
enum Cost {
    /// As much as so many products.
    Products(f64),
    /// More than was asked for, or as much as another one of which it is a copy.
    Useless,
    /// Some table misses more than was asked for.
    Misses,
}

impl Cost {
    /// With tables of which `dear` words are as good as twice the products, that miss at most so many times what is tolerated, as far as it is at most `bound`.
    fn of(functions: &[(&Domain, u64)], (segments, dear): (Segments, f64), most: f64, bound: f64) -> Cost {
        let Segments { index_bits, octave_bits } = segments;
        let price = |products: u64, words: usize, missed: f64| {
            products as f64 * (1.0 + words as f64 / dear) * libm::exp2(MISSED * missed)
        };
        let (mut products, mut words, mut missed, mut octaves) = (0, 0, 0.0, false);
        // What those that follow cost at least.
        let mut open: u64 = functions.iter().map(|(_, uses)| uses * Shape::FEWEST_PRODUCTS).sum();
        for (domain, uses) in functions {
            let room = libm::log2(bound / price(products + open, words, 0.0)) / MISSED - missed;
            let affordable = ROUNDED * libm::exp2(room).max(1.0);
            let Some(shape) = Shape::within(domain, segments, most.min(affordable)) else {
                return if affordable < most { Cost::Useless } else { Cost::Misses };
            };
            open -= uses * Shape::FEWEST_PRODUCTS;
            octaves |= shape.layout == Layout::Octaves || shape.scaling.is_some();
            products += uses * shape.products() as u64;
            words += shape.columns() << index_bits;
            missed += libm::log2(shape.excess);
            if price(products + open, words, missed) > ROUNDED * bound {
                return Cost::Useless;
            }
        }
        // The same as without octaves.
        if octave_bits > 0 && !octaves { Cost::Useless } else { Cost::Products(price(products, words, missed)) }
    }
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
mod families;
#[cfg(test)]
mod matrix;
#[cfg(test)]
mod scalings;
#[cfg(test)]
mod shapes;
#[cfg(test)]
mod tests;
