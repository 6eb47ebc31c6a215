//! Gaussian elimination as equations, for the linear systems of a model and for the matrices of implicit methods.
//!
//! The order is fixed at compile time ([`order`]), without exchanges by size. A pivot takes one reciprocal; entries that
//! are numbers are computed here. Of a symmetric matrix one triangle is eliminated, in a [`scheme`].

pub mod order;
pub mod scheme;
pub mod system;

use std::collections::BTreeMap;

use pe_ir::model::Expr;

use order::Pattern;
use scheme::Scheme;

/// Entries of both triangles, at most.
const LARGEST: usize = 1 << 22;

/// Entries of a row by column.
pub type Row = BTreeMap<usize, Expr>;

/// Where the equations of an elimination go.
pub trait Sink {
    /// What a row is called.
    fn row_name(&self, row: usize) -> String;

    /// Something that stands for an expression of a row and is cheap to read.
    fn quantity(&mut self, row: usize, name: &dyn Fn() -> String, expr: Expr) -> Expr;

    /// The reciprocal of a pivot that is no number, or of its square root.
    fn reciprocal(&mut self, row: usize, pivot: Expr, root: bool) -> Expr;

    /// Takes note of a pivot that is a number.
    fn constant_pivot(&mut self, row: usize, number: f64);

    /// Whether products are spent for short paths: entries right of a pivot are divided by it once, one product less between
    /// two unknowns; those of a symmetric matrix are in any case.
    fn is_short(&self) -> bool;

    /// Whether products of so many entries right of a pivot, and below it, are computed ahead of its reciprocal; those of
    /// one entry alone are for the next pivot, which then does not wait for the multiple of a row.
    fn multiplies_ahead(&self, entries: usize) -> bool;

    /// How a symmetric matrix is eliminated.
    fn scheme(&self) -> Scheme;
}

/// Why a matrix cannot be eliminated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Obstacle {
    /// There is no pivot in a row.
    Singular(usize),
    /// Both triangles fill in beyond a limit.
    Large,
}

/// Entries that triangles may have at most.
pub const fn largest() -> usize {
    LARGEST
}

/// Both triangles of a matrix, ready to solve systems with it.
pub struct Factors {
    /// Whether the entries right of the pivots are over these.
    scaled: bool,
    /// Rows in the order of their elimination.
    order: Vec<usize>,
    /// For each row the multiples of earlier rows that were subtracted from its own.
    lower: Vec<Vec<(usize, Expr)>>,
    /// For each row the entries right of its pivot.
    upper: Vec<Vec<(usize, Expr)>>,
    /// Reciprocals of the pivots, or of their roots.
    reciprocals: Vec<Reciprocal>,
    /// Whether all entries are numbers.
    pub constant: bool,
}

/// What entries are divided by.
enum Reciprocal {
    /// The reciprocal of the pivot.
    Whole(Expr),
    /// That of its square root.
    Root(Expr),
}

/// The places of the entries of a matrix.
pub fn pattern(rows: &[Row]) -> Pattern {
    Pattern::new(rows.iter().map(|row| row.keys().copied().collect()).collect())
}

/// Factors a matrix in an order of its rows. Of a symmetric one both triangles are given, and one is read.
///
/// # Errors
/// An obstacle.
pub fn factor(
    sink: &mut dyn Sink,
    mut rows: Vec<Row>,
    symmetric: bool,
    order: Vec<usize>,
) -> Result<Factors, Obstacle> {
    let count = rows.len();
    let mut place = vec![0; count];
    order.iter().enumerate().for_each(|(at, row)| place[*row] = at);
    let constant = rows.iter().flat_map(BTreeMap::values).all(|entry| entry.as_constant().is_some());
    let mut columns = vec![Vec::new(); count];
    for (index, row) in rows.iter_mut().enumerate() {
        if symmetric {
            row.retain(|column, _| place[*column] >= place[index]);
        } else {
            row.keys().filter(|column| place[**column] < place[index]).for_each(|column| columns[*column].push(index));
        }
    }
    let mut factors = Factors {
        scaled: symmetric || sink.is_short(),
        lower: vec![Vec::new(); count],
        upper: vec![Vec::new(); count],
        reciprocals: Vec::new(),
        order: Vec::new(),
        constant,
    };
    let mut reciprocals: Vec<Option<Reciprocal>> = (0..count).map(|_| None).collect();
    let rooted = symmetric && sink.scheme() == Scheme::Root;
    let mut entries = 0;
    for pivot in order.iter().copied() {
        let mut row = std::mem::take(&mut rows[pivot]);
        let diagonal = row.remove(&pivot).unwrap_or(Expr::Constant(0.0));
        let name = sink.row_name(pivot);
        // A reciprocal that is a number keeps all bits.
        let (reciprocal, root) = match diagonal {
            Expr::Constant(number) if number == 0.0 || !number.is_finite() => return Err(Obstacle::Singular(pivot)),
            Expr::Constant(number) => {
                sink.constant_pivot(pivot, number);
                (Expr::Constant(1.0 / number), false)
            }
            expr => (sink.reciprocal(pivot, expr, rooted), rooted),
        };
        let mut upper: Vec<(usize, Expr)> = Vec::with_capacity(row.len());
        for (column, expr) in row {
            let other = sink.row_name(column);
            upper.push((column, sink.quantity(pivot, &|| format!("{name}.upper({other})"), expr)));
        }
        let below: Vec<(usize, Expr)> = match symmetric {
            true => upper.clone(),
            false => {
                let mut below = std::mem::take(&mut columns[pivot]);
                below.sort_unstable();
                below.into_iter().filter_map(|other| Some((other, rows[other].remove(&pivot)?))).collect()
            }
        };
        entries += upper.len() + 1;
        let varies = reciprocal.as_constant().is_none() && !root;
        let ahead = varies && sink.multiplies_ahead(upper.len().max(below.len()));
        let mut multiples = Vec::with_capacity(below.len());
        for (other, entry) in below {
            let own = sink.row_name(other);
            let next = varies && sink.multiplies_ahead(1) && place[other] == place[pivot] + 1;
            let entry = match ahead || next {
                true => sink.quantity(other, &|| format!("{own}.below({name})"), entry),
                false => entry,
            };
            let mut multiple = Expr::product(vec![entry.clone(), reciprocal.clone()]);
            let part = if root { "rooted" } else { "lower" };
            multiple = sink.quantity(other, &|| format!("{own}.{part}({name})"), multiple);
            for (column, expr) in upper.iter().filter(|(column, _)| !symmetric || place[*column] >= place[other]) {
                let fills = if ahead || (next && *column == other) {
                    let across = sink.row_name(*column);
                    let product = Expr::product(vec![entry.clone(), expr.clone()]);
                    let product = sink.quantity(other, &|| format!("{own}.product({name},{across})"), product);
                    subtract(&mut rows[other], &reciprocal, *column, &product)
                } else if root {
                    // As a product, so that it goes to the coefficient port at once, and not as a copy.
                    let rooted = Expr::product(vec![expr.clone(), reciprocal.clone()]);
                    subtract(&mut rows[other], &multiple, *column, &rooted)
                } else {
                    subtract(&mut rows[other], &multiple, *column, expr)
                };
                if fills && !symmetric && place[*column] < place[other] {
                    columns[*column].push(other);
                }
            }
            if root {
                let lower = Expr::product(vec![multiple, reciprocal.clone()]);
                multiple = sink.quantity(other, &|| format!("{own}.lower({name})"), lower);
            }
            factors.lower[other].push((pivot, multiple.clone()));
            multiples.push((other, multiple));
        }
        factors.upper[pivot] = if symmetric {
            multiples
        } else if factors.scaled {
            let mut scale = |(column, expr): (usize, Expr)| {
                let scaled = Expr::product(vec![expr, reciprocal.clone()]);
                let other = sink.row_name(column);
                (column, sink.quantity(pivot, &|| format!("{name}.scaled({other})"), scaled))
            };
            upper.into_iter().map(&mut scale).collect()
        } else {
            upper
        };
        if entries > LARGEST {
            return Err(Obstacle::Large);
        }
        reciprocals[pivot] = Some(if root { Reciprocal::Root(reciprocal) } else { Reciprocal::Whole(reciprocal) });
    }
    factors.reciprocals = reciprocals.into_iter().map(|each| each.expect("each row has a pivot")).collect();
    factors.order = order;
    Ok(factors)
}

/// Subtracts a multiple of an entry from that of a row in the same column; whether the row had none there.
fn subtract(row: &mut Row, multiple: &Expr, column: usize, expr: &Expr) -> bool {
    let product = Expr::product(vec![Expr::Constant(-1.0), multiple.clone(), expr.clone()]);
    let before = row.remove(&column);
    let fills = before.is_none();
    row.insert(column, before.map_or(product.clone(), |entry| Expr::sum(vec![entry, product])));
    fills
}

impl Factors {
    /// The solution for a right-hand side, a number per row; `name` is what its parts are called.
    pub fn solve(&self, sink: &mut dyn Sink, right: Vec<Expr>, name: &str) -> Vec<Expr> {
        let zero = || vec![Expr::Constant(0.0); right.len()];
        let (mut reduced, mut solution) = (zero(), zero());
        let mut right: Vec<Option<Expr>> = right.into_iter().map(Some).collect();
        let minus =
            |entry: &Expr, other: &Expr| Expr::product(vec![Expr::Constant(-1.0), entry.clone(), other.clone()]);
        for row in self.order.iter().copied() {
            let mut terms = vec![right[row].take().expect("each row is eliminated once")];
            terms.extend(self.lower[row].iter().map(|(other, multiple)| minus(multiple, &reduced[*other])));
            let own = sink.row_name(row);
            reduced[row] = sink.quantity(row, &|| format!("{own}.reduced.{name}"), Expr::sum(terms));
        }
        for row in self.order.iter().rev().copied() {
            let own = sink.row_name(row);
            let (reciprocal, reduced) = match &self.reciprocals[row] {
                Reciprocal::Whole(reciprocal) => (reciprocal, reduced[row].clone()),
                Reciprocal::Root(root) => {
                    let rooted = Expr::product(vec![reduced[row].clone(), root.clone()]);
                    (root, sink.quantity(row, &|| format!("{own}.rooted.{name}"), rooted))
                }
            };
            let known = self.upper[row].iter().map(|(column, entry)| minus(entry, &solution[*column]));
            let expr = if self.scaled {
                let first = Expr::product(vec![reciprocal.clone(), reduced]);
                Expr::sum(std::iter::once(first).chain(known).collect())
            } else {
                let terms: Vec<Expr> = std::iter::once(reduced).chain(known).collect();
                match reciprocal {
                    Expr::Constant(1.0) => Expr::sum(terms),
                    Expr::Constant(number) => {
                        Expr::sum(terms.into_iter().map(|term| Expr::scaled(*number, term)).collect())
                    }
                    reciprocal => Expr::product(vec![reciprocal.clone(), Expr::sum(terms)]),
                }
            };
            solution[row] = sink.quantity(row, &|| format!("{own}.{name}"), expr);
        }
        solution
    }
}
