//! Where lifted functions of one variable have kinks, jumps and steep places.

use pe_ir::model::{Expr, Function};
use pe_ir::turns::{self, MOST_MULTIPLES};

/// Slope and offset of a polynomial of degree one at most.
pub(crate) fn affine(expr: &Expr) -> Option<(f64, f64)> {
    match expr {
        Expr::Constant(number) => Some((0.0, *number)),
        Expr::Variable(_) => Some((1.0, 0.0)),
        Expr::Sum(members) => members.iter().try_fold((0.0, 0.0), |(slope, offset), member| {
            affine(member).map(|member| (slope + member.0, offset + member.1))
        }),
        Expr::Product(members) => members.iter().try_fold((0.0, 1.0), |(slope, offset), member| {
            let member = affine(member)?;
            (slope == 0.0 || member.0 == 0.0).then_some((slope * member.1 + offset * member.0, offset * member.1))
        }),
        Expr::Power(..) | Expr::Apply(..) | Expr::Select(_) | Expr::Solution(_) => None,
    }
}

/// Where an affine expression is zero, if anywhere alone.
pub(crate) fn root(expr: &Expr) -> Option<f64> {
    let (slope, offset) = affine(expr)?;
    // Adding zero turns -0 into 0.
    Some(-offset / slope + 0.0).filter(|root| root.is_finite())
}

/// Where an affine number of turns, as many as sums of angles have, is half a turn and any number of whole ones.
pub(crate) fn half_turns(expr: &Expr) -> Vec<f64> {
    let Some((slope, offset)) = affine(expr).filter(|(slope, _)| *slope != 0.0) else { return Vec::new() };
    let turns = (-MOST_MULTIPLES - 1..=MOST_MULTIPLES).map(|turns| turns as f64 + turns::HALF);
    let mut places: Vec<f64> = turns.map(|turns| (turns - offset) / slope).collect();
    places.sort_unstable_by(f64::total_cmp);
    places
}

/// Jumps of a rounded number that are looked at; a table has fewer segments.
const MOST_JUMPS: f64 = 8192.0;

/// Where a lifted function of one variable has a kink or jumps; where it rounds, from one argument to another.
pub(crate) fn kinks(body: &Expr, low: f64, high: f64) -> Vec<f64> {
    let mut found = Vec::new();
    collect_roots(body, &|function| matches!(function, Function::Abs | Function::Sign), true, &mut found);
    collect_steps(body, &mut |slope, offset| {
        let ends = [low, high].map(|end| slope * end + offset);
        let first = libm::ceil(ends[0].min(ends[1]));
        let count = (libm::floor(ends[0].max(ends[1])) - first + 1.0).clamp(0.0, MOST_JUMPS);
        // Adding zero turns -0 into 0.
        found.extend((0..count as u32).map(|step| (first + f64::from(step) - offset) / slope + 0.0));
    });
    found.sort_unstable_by(f64::total_cmp);
    found.dedup();
    found
}

/// A place and the distance of an even grid that all of several places, ascending, are on.
pub(crate) fn even_grid(places: &[f64]) -> Option<(f64, f64)> {
    const DIVISIONS: u32 = 64;
    const OFF: f64 = 1e-5;
    let shortest = places.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    let on = |spacing: &f64| {
        places.iter().all(|place| {
            let count = (place - places[0]) / spacing;
            (count - libm::round(count)).abs() <= OFF
        })
    };
    let first = places.first().copied()?;
    let spacing = (1..=DIVISIONS).map(|parts| shortest / f64::from(parts)).find(on)?;
    spacing.is_finite().then_some((first, spacing))
}

/// How high a lifted function of one variable jumps; none if it does not.
pub fn jump(body: &Expr) -> Option<f64> {
    let sides = |kink: f64, distance: f64| {
        let at = |x: f64| body.evaluate(&|_| x);
        (at(kink + distance) - at(kink - distance)).abs()
    };
    let height = |kink: f64| {
        let wide = 1e-6 * if kink == 0.0 { 1.0 } else { kink.abs() };
        let (far, near) = (sides(kink, wide), sides(kink, wide / 1024.0));
        // The difference of both sides of a mere kink falls with their distance.
        (near > 0.0 && near.is_finite() && near > 0.9 * far).then_some(near)
    };
    if !reads_one(body) {
        return None;
    }
    // One jump of a rounded number is like the others.
    let mut first = 0.0;
    collect_steps(body, &mut |slope, offset| first = -offset / slope);
    kinks(body, first, first).into_iter().filter_map(height).reduce(f64::max)
}

/// Whether a lifted function rounds its argument.
pub(crate) fn rounds(body: &Expr) -> bool {
    let mut found = false;
    collect_steps(body, &mut |_, _| found = true);
    found
}

/// Slopes and offsets of the affine arguments that are rounded.
fn collect_steps(expr: &Expr, found: &mut impl FnMut(f64, f64)) {
    match expr {
        Expr::Constant(_) | Expr::Variable(_) | Expr::Solution(_) => {}
        Expr::Sum(members) | Expr::Product(members) => {
            members.iter().for_each(|member| collect_steps(member, found));
        }
        Expr::Power(base, _) => collect_steps(base, found),
        Expr::Apply(Function::Floor, argument) => {
            if let Some((slope, offset)) = affine(argument).filter(|(slope, _)| *slope != 0.0) {
                found(slope, offset);
            }
        }
        Expr::Apply(_, argument) => collect_steps(argument, found),
        Expr::Select(select) => {
            [&select.yes, &select.no].into_iter().for_each(|branch| collect_steps(branch, found));
        }
    }
}

/// Where divisors, radicands and arguments of logarithms in a function of one variable are zero, as far as they are
/// affine: near these places it may be steep.
pub(crate) fn edges(body: &Expr) -> Vec<f64> {
    let ends = |function: Function| {
        matches!(function, Function::Reciprocal | Function::RealPower(_) | Function::Sqrt | Function::Log)
    };
    let mut found = Vec::new();
    collect_roots(body, &ends, false, &mut found);
    found
}

/// Where what powers and functions are of is zero, as far as that is affine: places that a power may be one of the distance
/// from.
pub(crate) fn origins(body: &Expr) -> Vec<f64> {
    fn collect(expr: &Expr, found: &mut Vec<f64>) {
        match expr {
            Expr::Constant(_) | Expr::Variable(_) | Expr::Solution(_) | Expr::Select(_) => {}
            Expr::Sum(members) | Expr::Product(members) => members.iter().for_each(|member| collect(member, found)),
            Expr::Power(base, _) | Expr::Apply(_, base) => {
                found.extend(root(base));
                collect(base, found);
            }
        }
    }
    let mut found = Vec::new();
    collect(body, &mut found);
    found
}

/// The roots of the affine arguments of some functions, and of conditions if these count.
fn collect_roots(expr: &Expr, counts: &impl Fn(Function) -> bool, conditions: bool, found: &mut Vec<f64>) {
    match expr {
        Expr::Constant(_) | Expr::Variable(_) | Expr::Solution(_) => {}
        Expr::Sum(members) | Expr::Product(members) => {
            members.iter().for_each(|member| collect_roots(member, counts, conditions, found));
        }
        Expr::Power(base, _) => collect_roots(base, counts, conditions, found),
        Expr::Apply(function, argument) => {
            match function {
                Function::Wrap if conditions => found.extend(half_turns(argument)),
                _ => found.extend(root(argument).filter(|_| counts(*function))),
            }
            collect_roots(argument, counts, conditions, found);
        }
        Expr::Select(select) => {
            found.extend(root(&select.condition).filter(|_| conditions));
            [&select.yes, &select.no].into_iter().for_each(|branch| collect_roots(branch, counts, conditions, found));
        }
    }
}

/// Places where an expression of one variable bends or jumps; none if these are not those of affine conditions and
/// magnitudes alone.
pub(crate) fn bends(expr: &Expr) -> Option<Vec<f64>> {
    fn collect(expr: &Expr, found: &mut Vec<f64>) -> Option<()> {
        match expr {
            Expr::Constant(_) | Expr::Variable(_) => Some(()),
            Expr::Solution(_) | Expr::Apply(Function::Floor | Function::Wrap, _) => None,
            Expr::Sum(members) | Expr::Product(members) => members.iter().try_for_each(|member| collect(member, found)),
            Expr::Power(base, _) => collect(base, found),
            Expr::Apply(function, argument) => {
                if matches!(function, Function::Abs | Function::Sign) {
                    affine(argument)?;
                    found.extend(root(argument));
                }
                collect(argument, found)
            }
            Expr::Select(select) => {
                affine(&select.condition)?;
                found.extend(root(&select.condition));
                collect(&select.yes, found)?;
                collect(&select.no, found)
            }
        }
    }
    let mut found = Vec::new();
    collect(expr, &mut found)?;
    found.sort_unstable_by(f64::total_cmp);
    found.dedup();
    Some(found)
}

/// Whether an expression reads one variable at most.
fn reads_one(body: &Expr) -> bool {
    let (mut first, mut one) = (None, true);
    body.each_variable(&mut |variable| one &= *first.get_or_insert(variable) == variable);
    one
}
