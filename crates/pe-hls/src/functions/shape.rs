//! Shapes of functions: what functions have in common that differ by a factor of their value and by scale and shift of
//! their argument.
//!
//! What goes in is a function of one variable without bends; what comes out is `f(x) = factor*F(slope*x + offset) + a*x + b`,
//! with the same `F` for all functions of a shape; `a` and `b` are what is beside it in a sum. Quotients of polynomials, of the variable, of a power of it or of an
//! exponential, come into one form: no power below the highest one of the divisor, whose next coefficient is 1 or -1.
//! In other functions the argument of the first elementary one becomes the variable. Whether `F` is the function is for
//! others to prove.

use pe_ir::functions::ScalarFunction;
use pe_ir::model::{Expr, Function, Variable};

use crate::kinks::affine;

/// Highest power in a quotient of polynomials.
const HIGHEST_POWER: usize = 16;

/// Part of what was added up below which a coefficient is what rounding left of zero.
const ROUNDED: f64 = 1e-13;

/// What a function is made of.
#[derive(Clone, Debug)]
pub(super) struct Shaped {
    /// Equal for functions of the same shape.
    pub key: String,
    /// The shape, of the function's variable.
    pub body: Expr,
    /// What the value is multiplied by.
    pub factor: f64,
    /// What the argument is multiplied by.
    pub slope: f64,
    /// What is added to it then.
    pub offset: f64,
    /// What is beside it in a sum: what the function's argument is multiplied by, and a number.
    pub beside: (f64, f64),
    /// What may be chosen.
    pub free: Free,
}

/// Scales and shifts that leave a shape what it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Free {
    /// None.
    Nothing,
    /// `F(s y) = s^p F(y)`: the power.
    Scale(f64),
    /// `F(y + t) = exp(t) F(y)`.
    Shift,
}

/// The shape of a function, if it has one.
pub(super) fn shaped(function: &ScalarFunction) -> Option<Shaped> {
    if function.body.has_bends() {
        return None;
    }
    let place = Expr::Variable(function.variable);
    let (body, beside) = alone(&function.body);
    let shaped = ratio(&body).and_then(|ratio| ratio.shaped(&place)).or_else(|| substituted(&body, &place))?;
    let shaped = Shaped { beside, ..shaped };
    let numbers = [shaped.factor, shaped.slope, shaped.offset, beside.0, beside.1];
    let sound = numbers.iter().all(|number| number.is_finite()) && shaped.factor != 0.0 && shaped.slope != 0.0;
    sound.then_some(shaped)
}

/// A function without what is affine beside it in a sum, and that.
fn alone(body: &Expr) -> (Expr, (f64, f64)) {
    let Expr::Sum(members) = body else { return (body.clone(), (0.0, 0.0)) };
    let (mut rest, mut beside) = (Vec::new(), (0.0, 0.0));
    for member in members {
        match affine(member) {
            Some((slope, offset)) => beside = (beside.0 + slope, beside.1 + offset),
            None => rest.push(member.clone()),
        }
    }
    (Expr::sum(rest), beside)
}

/// What the polynomials of a quotient are polynomials of.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Atom {
    /// The variable.
    Plain,
    /// `exp(rate*x)`.
    Exp { rate: f64 },
    /// `(sign*(x - origin))^exponent`.
    Power { sign: f64, origin: f64, exponent: f64 },
}

/// A quotient of two polynomials of an atom, coefficients of the lowest power first; a number has no atom.
#[derive(Clone, Debug)]
struct Ratio {
    atom: Option<Atom>,
    above: Vec<f64>,
    below: Vec<f64>,
}

/// An expression of one variable as a quotient.
fn ratio(expr: &Expr) -> Option<Ratio> {
    if let Some((slope, offset)) = affine(expr) {
        return Some(match slope == 0.0 {
            true => Ratio::number(offset),
            false => Ratio { atom: Some(Atom::Plain), above: vec![offset, slope], below: vec![1.0] },
        });
    }
    match expr {
        Expr::Sum(members) => members.iter().try_fold(Ratio::number(0.0), |sum, member| sum.plus(ratio(member)?)),
        Expr::Product(members) => {
            members.iter().try_fold(Ratio::number(1.0), |product, member| product.times(ratio(member)?))
        }
        Expr::Power(base, exponent) => ratio(base)?.power(*exponent),
        Expr::Apply(Function::Reciprocal, argument) => ratio(argument)?.inverse(),
        Expr::Apply(Function::RealPower(exponent), argument) => {
            let whole = -libm::round(*exponent);
            if whole == -*exponent && (1.0..=HIGHEST_POWER as f64).contains(&whole) {
                return ratio(argument)?.power(whole as u32)?.inverse();
            }
            power(argument, *exponent)
        }
        Expr::Apply(Function::Sqrt, argument) => power(argument, 0.5),
        Expr::Apply(Function::Exp, argument) => {
            let (slope, offset) = affine(argument)?;
            let grown = vec![0.0, libm::exp(if slope > 0.0 { offset } else { -offset })];
            let ratio = Ratio { atom: Some(Atom::Exp { rate: slope.abs() }), above: grown, below: vec![1.0] };
            if slope > 0.0 { Some(ratio) } else { ratio.inverse() }
        }
        _ => None,
    }
}

/// A power of an affine argument.
fn power(argument: &Expr, exponent: f64) -> Option<Ratio> {
    let (slope, offset) = affine(argument).filter(|(slope, _)| *slope != 0.0)?;
    let (sign, origin) = (slope.signum(), -offset / slope + 0.0);
    let atom = Some(Atom::Power { sign, origin, exponent: exponent.abs() });
    let ratio = Ratio { atom, above: vec![0.0, libm::pow(slope.abs(), exponent.abs())], below: vec![1.0] };
    if exponent > 0.0 { Some(ratio) } else { ratio.inverse() }
}

/// The polynomial with each power so many times as high.
fn spread(polynomial: &[f64], times: usize) -> Option<Vec<f64>> {
    let highest = (polynomial.len() - 1) * times;
    let mut all = vec![0.0; highest + 1];
    polynomial.iter().enumerate().for_each(|(power, coefficient)| all[power * times] = *coefficient);
    (highest <= HIGHEST_POWER).then_some(all)
}

/// The product of two polynomials.
fn product(one: &[f64], other: &[f64]) -> Option<Vec<f64>> {
    let mut all = vec![0.0; one.len() + other.len() - 1];
    for (power, a) in one.iter().enumerate() {
        other.iter().enumerate().for_each(|(next, b)| all[power + next] += a * b);
    }
    (all.len() <= HIGHEST_POWER + 1).then_some(all)
}

/// The sum of two polynomials.
fn sum(one: &[f64], other: &[f64]) -> Vec<f64> {
    let at = |polynomial: &[f64], power: usize| polynomial.get(power).copied().unwrap_or(0.0);
    (0..one.len().max(other.len())).map(|power| at(one, power) + at(other, power)).collect()
}

/// The polynomial of `u` that another one is of `u + shift`.
fn shifted(polynomial: &[f64], shift: f64) -> Vec<f64> {
    // Beside each coefficient the magnitudes that were added up for it.
    let mut all: Vec<(f64, f64)> = vec![(0.0, 0.0); polynomial.len()];
    for coefficient in polynomial.iter().rev() {
        for power in (0..all.len()).rev() {
            let below = if power == 0 { (0.0, 0.0) } else { all[power - 1] };
            all[power] = (all[power].0 * shift + below.0, all[power].1 * shift.abs() + below.1);
        }
        all[0] = (all[0].0 + coefficient, all[0].1 + coefficient.abs());
    }
    all.into_iter().map(|(is, added)| if is.abs() <= ROUNDED * added { 0.0 } else { is }).collect()
}

/// The two highest powers of a polynomial, and what its argument is divided by so that their coefficients are equal.
fn scale(polynomial: &[f64]) -> Option<(usize, f64)> {
    let highest = polynomial.len() - 1;
    let next = polynomial[..highest].iter().rposition(|coefficient| *coefficient != 0.0)?;
    let ratio = (polynomial[next] / polynomial[highest]).abs();
    Some((next, libm::pow(ratio, 1.0 / (highest - next) as f64)))
}

/// The position of the only coefficient that is not zero.
fn only(polynomial: &[f64]) -> Option<usize> {
    let mut all = polynomial.iter().enumerate().filter(|(_, coefficient)| **coefficient != 0.0);
    let (power, _) = all.next()?;
    all.next().is_none().then_some(power)
}

impl Ratio {
    fn number(number: f64) -> Ratio {
        Ratio { atom: None, above: vec![number], below: vec![1.0] }
    }

    fn inverse(self) -> Option<Ratio> {
        let Ratio { atom, above, below } = self;
        above.iter().any(|coefficient| *coefficient != 0.0).then_some(Ratio { atom, above: below, below: above })
    }

    /// Two quotients as those of one atom.
    fn joined(self, other: Ratio) -> Option<(Ratio, Ratio)> {
        let (one, two) = match (self.atom, other.atom) {
            (None, atom) => return Some((Ratio { atom, ..self }, other)),
            (atom, None) => return Some((self, Ratio { atom, ..other })),
            (Some(one), Some(two)) => (one, two),
        };
        let times = match (one, two) {
            (one, two) if one == two => return Some((self, other)),
            (Atom::Exp { rate }, Atom::Exp { rate: other }) => other / rate,
            (
                Atom::Power { sign, origin, exponent },
                Atom::Power { sign: other_sign, origin: other_origin, exponent: other },
            ) if sign == other_sign && origin == other_origin => other / exponent,
            _ => return None,
        };
        let whole = |times: f64| (times - libm::round(times)).abs() <= ROUNDED * times;
        let again = |ratio: Ratio, times: f64, atom: Atom| {
            let times = libm::round(times).min(1.0 + HIGHEST_POWER as f64) as usize;
            Some(Ratio { atom: Some(atom), above: spread(&ratio.above, times)?, below: spread(&ratio.below, times)? })
        };
        if times >= 1.0 && whole(times) {
            Some((self, again(other, times, one)?))
        } else if times < 1.0 && whole(1.0 / times) {
            Some((again(self, 1.0 / times, two)?, other))
        } else {
            None
        }
    }

    fn plus(self, other: Ratio) -> Option<Ratio> {
        let (one, other) = self.joined(other)?;
        if one.below == other.below {
            return Some(Ratio { above: sum(&one.above, &other.above), ..one });
        }
        let above = sum(&product(&one.above, &other.below)?, &product(&other.above, &one.below)?);
        Some(Ratio { atom: one.atom, above, below: product(&one.below, &other.below)? })
    }

    fn times(self, other: Ratio) -> Option<Ratio> {
        let (one, other) = self.joined(other)?;
        let (above, below) = (product(&one.above, &other.above)?, product(&one.below, &other.below)?);
        Some(Ratio { atom: one.atom, above, below })
    }

    fn power(self, exponent: u32) -> Option<Ratio> {
        (1..exponent).try_fold(self.clone(), |power, _| power.times(self.clone()))
    }

    /// Without common powers of the atom, and without highest powers that are zero.
    fn trimmed(mut self) -> Option<Ratio> {
        for polynomial in [&mut self.above, &mut self.below] {
            let highest = polynomial.iter().rposition(|coefficient| *coefficient != 0.0)?;
            polynomial.truncate(highest + 1);
        }
        let lowest = |polynomial: &[f64]| polynomial.iter().position(|coefficient| *coefficient != 0.0).unwrap_or(0);
        let common = lowest(&self.above).min(lowest(&self.below));
        self.above.drain(..common);
        self.below.drain(..common);
        Some(self)
    }

    /// As a shape of a variable.
    fn shaped(self, place: &Expr) -> Option<Shaped> {
        let Ratio { atom, above, below } = self.trimmed()?;
        match atom? {
            Atom::Plain => {
                let highest = below.len() - 1;
                if highest == 0 {
                    return None;
                }
                let origin = -below[highest - 1] / (highest as f64 * below[highest]) + 0.0;
                let (mut above, mut below) = (above, below);
                if origin != 0.0 {
                    (above, below) = (shifted(&above, origin), shifted(&below, origin));
                    below[highest - 1] = 0.0;
                }
                let Ratio { above, below, .. } = Ratio { atom, above, below }.trimmed()?;
                let normal = Normal::of(above, below);
                let slope = 1.0 / normal.scale;
                let free = normal.power.map_or(Free::Nothing, |power| Free::Scale(f64::from(power)));
                Some(normal.shaped("plain", place.clone(), (slope, -origin * slope), free))
            }
            Atom::Power { sign, origin, exponent } => {
                let normal = Normal::of(above, below);
                let slope = sign / libm::pow(normal.scale, 1.0 / exponent);
                let free = normal.power.map_or(Free::Nothing, |power| Free::Scale(f64::from(power) * exponent));
                let (offset, grown) = (-origin * slope + 0.0, |exponent| Function::RealPower(exponent));
                if let Free::Scale(power) = free {
                    // One power, whatever its atom was.
                    let body = Expr::Apply(grown(power), Box::new(place.clone()));
                    let key = format!("power {power:.9e}");
                    return Some(Shaped { key, body, factor: normal.factor, slope, offset, beside: (0.0, 0.0), free });
                }
                let atom = Expr::Apply(grown(exponent), Box::new(place.clone()));
                Some(normal.shaped(&format!("power {exponent:.9e}"), atom, (slope, offset), free))
            }
            Atom::Exp { rate } => {
                let growing = |above: Vec<f64>, below: Vec<f64>, rate: f64| {
                    let normal = Normal::of(above, below);
                    if let Some(power) = normal.power {
                        let (slope, body) =
                            (rate * f64::from(power), Expr::Apply(Function::Exp, Box::new(place.clone())));
                        let (key, free, factor) = ("exp".to_owned(), Free::Shift, normal.factor);
                        return Shaped { key, body, factor, slope, offset: 0.0, beside: (0.0, 0.0), free };
                    }
                    let (offset, atom) =
                        (-libm::log(normal.scale), Expr::Apply(Function::Exp, Box::new(place.clone())));
                    normal.shaped("exp", atom, (rate, offset), Free::Nothing)
                };
                // What grows with the argument falls with its negative.
                let length = above.len().max(below.len());
                let mirrored = |polynomial: &[f64]| -> Vec<f64> {
                    let mut all = polynomial.to_vec();
                    all.resize(length, 0.0);
                    all.into_iter().rev().collect()
                };
                let mirror = Ratio { atom, above: mirrored(&above), below: mirrored(&below) }.trimmed()?;
                let (one, other) = (growing(above, below, rate), growing(mirror.above, mirror.below, -rate));
                Some(if other.key < one.key { other } else { one })
            }
        }
    }
}

/// A quotient of polynomials whose highest coefficients are 1, and the next one of the divisor 1 or -1.
struct Normal {
    above: Vec<f64>,
    below: Vec<f64>,
    /// The old argument over the new one.
    scale: f64,
    factor: f64,
    /// The power that it is, if it is only one.
    power: Option<i32>,
}

impl Normal {
    fn of(mut above: Vec<f64>, mut below: Vec<f64>) -> Normal {
        let power = only(&above).zip(only(&below)).map(|(above, below)| above as i32 - below as i32);
        let (of_below, of_above) = (scale(&below), scale(&above));
        let scaled = of_below.or(of_above).map_or(1.0, |(_, scale)| scale);
        for polynomial in [&mut above, &mut below] {
            let mut power = 1.0;
            for coefficient in polynomial.iter_mut() {
                *coefficient *= power;
                power *= scaled;
            }
        }
        let highest = |polynomial: &[f64]| polynomial[polynomial.len() - 1];
        let factor = highest(&above) / highest(&below);
        for polynomial in [&mut above, &mut below] {
            let highest = highest(polynomial);
            polynomial.iter_mut().for_each(|coefficient| *coefficient /= highest);
        }
        match (of_below, of_above) {
            (Some((next, _)), _) => below[next] = below[next].signum(),
            (None, Some((next, _))) => above[next] = above[next].signum(),
            (None, None) => {}
        }
        Normal { above, below, scale: scaled, factor, power }
    }

    fn shaped(self, kind: &str, atom: Expr, (slope, offset): (f64, f64), free: Free) -> Shaped {
        let polynomial = |coefficients: &[f64]| {
            let terms = coefficients.iter().enumerate().rev().filter(|(_, coefficient)| **coefficient != 0.0);
            let term = |(power, coefficient): (usize, &f64)| {
                Expr::scaled(*coefficient, Expr::power(atom.clone(), u32::try_from(power).unwrap_or(u32::MAX)))
            };
            Expr::sum(terms.map(term).collect())
        };
        let mut factors = vec![polynomial(&self.above)];
        if self.below.len() > 1 {
            factors.push(Expr::Apply(Function::Reciprocal, Box::new(polynomial(&self.below))));
        }
        let digits =
            |coefficients: &[f64]| coefficients.iter().map(|number| format!(" {number:.9e}")).collect::<String>();
        let key = format!("{kind}:{} over{}", digits(&self.above), digits(&self.below));
        let (body, factor, beside) = (Expr::product(factors), self.factor, (0.0, 0.0));
        Shaped { key, body, factor, slope, offset, beside, free }
    }
}

/// Any other function, of the argument of the first elementary function in it.
fn substituted(body: &Expr, place: &Expr) -> Option<Shaped> {
    let (slope, offset) = first_argument(body)?;
    let (factor, body) = of_argument(body, (slope, offset), place)?;
    let fixed = Expr::Variable(Variable::Input(0));
    let key = format!("other: {:?}", rounded(&body.substituted(&|_| fixed.clone())));
    Some(Shaped { key, body, factor, slope, offset, beside: (0.0, 0.0), free: Free::Nothing })
}

/// Slope and offset of the first affine argument of an elementary function.
fn first_argument(expr: &Expr) -> Option<(f64, f64)> {
    match expr {
        Expr::Constant(_) | Expr::Variable(_) | Expr::Select(_) | Expr::Solution(_) => None,
        Expr::Sum(members) | Expr::Product(members) => members.iter().find_map(first_argument),
        Expr::Power(base, _) | Expr::Apply(Function::Reciprocal, base) => first_argument(base),
        Expr::Apply(_, argument) => {
            affine(argument).filter(|(slope, _)| *slope != 0.0).or_else(|| first_argument(argument))
        }
    }
}

/// An expression of `x` as one of `slope*x + offset`, and a number that it is multiplied by.
fn of_argument(expr: &Expr, (slope, offset): (f64, f64), place: &Expr) -> Option<(f64, Expr)> {
    let again = |expr: &Expr| of_argument(expr, (slope, offset), place);
    let whole = |(factor, expr): (f64, Expr)| Expr::scaled(factor, expr);
    if let Some((own, added)) = affine(expr).filter(|(own, _)| *own != 0.0) {
        let (factor, moved) = (own / slope, own * offset / slope);
        let nearest = libm::round(factor);
        let factor = if (factor - nearest).abs() <= ROUNDED * factor.abs() { nearest } else { factor };
        let rest = added - moved;
        let rest = if rest.abs() <= ROUNDED * (added.abs() + moved.abs()) { 0.0 } else { rest / factor };
        return Some((factor, Expr::sum(vec![place.clone(), Expr::Constant(rest)])));
    }
    Some(match expr {
        Expr::Constant(number) => (*number, Expr::Constant(1.0)),
        Expr::Variable(_) | Expr::Select(_) | Expr::Solution(_) => return None,
        Expr::Sum(members) => {
            let members = members.iter().map(|member| again(member).map(whole)).collect::<Option<Vec<Expr>>>()?;
            (1.0, Expr::sum(members))
        }
        Expr::Product(members) => {
            let members = members.iter().map(again).collect::<Option<Vec<(f64, Expr)>>>()?;
            let factor = members.iter().map(|(factor, _)| factor).product();
            (factor, Expr::product(members.into_iter().map(|(_, member)| member).collect()))
        }
        Expr::Power(base, exponent) => {
            let (factor, base) = again(base)?;
            (libm::pow(factor, f64::from(*exponent)), Expr::power(base, *exponent))
        }
        Expr::Apply(Function::Reciprocal, argument) => {
            let (factor, argument) = again(argument)?;
            (1.0 / factor, Expr::Apply(Function::Reciprocal, Box::new(argument)))
        }
        Expr::Apply(function, argument) => (1.0, Expr::Apply(*function, Box::new(whole(again(argument)?)))),
    })
}

/// An expression with the digits of its numbers that count.
fn rounded(expr: &Expr) -> Expr {
    match expr {
        Expr::Constant(number) => Expr::Constant(format!("{number:.9e}").parse().unwrap_or(*number)),
        Expr::Variable(_) | Expr::Select(_) | Expr::Solution(_) => expr.clone(),
        Expr::Sum(members) => Expr::Sum(members.iter().map(rounded).collect()),
        Expr::Product(members) => Expr::Product(members.iter().map(rounded).collect()),
        Expr::Power(base, exponent) => Expr::Power(Box::new(rounded(base)), *exponent),
        Expr::Apply(function, argument) => Expr::Apply(*function, Box::new(rounded(argument))),
    }
}
