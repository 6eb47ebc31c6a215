//! The pass that looks at a mechanism where it starts: `J` and `bend` have to be the derivatives of `gap` that they stand for,
//! masses have to be positive, and initial values are moved until loops are closed and velocities keep them closed.
//!
//! A correction is `-(M + b transpose(J) J) \ b transpose(J) r`, with `r` the closures or `J w`: repeated, it leaves what
//! closures hold, and nothing else, in the measure of the masses. The matrix is regular also where closures depend on each
//! other.

use std::collections::BTreeMap;

use super::moving::{others, reads_coordinates_alone};
use crate::names::table::{Kind, Names};
use crate::report::Report;
use pe_ir::cholesky;
use pe_ir::codes;
use pe_ir::index::{StateId, at};
use pe_ir::mechanism::Mechanism;
use pe_ir::model::{Entry, Expr, Model, Variable};
use pe_ir::place::Place;
use pe_ir::source::{Diagnostic, Span};
use pe_ir::turns::{self, RADIANS};

/// Part of what a closure is made of that is rounding.
const ROUNDING: f64 = 1e-12;

/// Weight of the closures beside the masses in a correction, in parts of their sizes: enough that a correction leaves
/// next to nothing, little enough that the elimination keeps digits of the masses.
const WEIGHT: f64 = 1e7;

/// Corrections before it is given up.
const CORRECTIONS: usize = 60;

/// Part to which each correction of the coordinates has to shrink, and part of the velocities that may be corrected, in the
/// measure of the masses: beyond it nobody knows which of several positions was meant.
const FAR: f64 = 0.1;

/// Steps of differences, in parts of the size of a coordinate, and the part by which a derivative may differ from them.
const DIFFERENCE: f64 = 1e-5;
const DIFFERS: f64 = 1e-4;

/// A difference that may be rounding where everything else is zero.
const NOISE: f64 = 1e-9;

/// Values that a finding names.
const NAMED: usize = 6;

/// Moves initial values of a mechanism so that its closures hold; tells what was moved, and what cannot be.
///
/// Without an error, closures hold up to rounding, and velocities keep them if closures read coordinates alone.
pub(crate) fn settle(model: &mut Model, names: &Names, report: &mut Report) -> Option<()> {
    let Some(mechanism) = model.mechanism.clone() else { return Some(()) };
    // A turn further angles are the same, and differences are taken in parts of coordinates.
    for state in model.states.iter_mut().filter(|state| state.angle) {
        state.initial = turns::principal(state.initial, RADIANS);
    }
    let finding = Start::of(model, &mechanism).settled();
    let (states, finding) = match finding {
        Ok(settled) => settled,
        Err(finding) => {
            report.push(*finding);
            return None;
        }
    };
    if let Some((moved, finding)) = finding {
        let label = |finding: Diagnostic, state: StateId| match declared(names, &model.states[state].name) {
            Some(span) => finding.with_label(span, "moved"),
            None => finding,
        };
        report.push(moved.into_iter().fold(finding, label));
        for (state, value) in model.states.iter_mut().zip(states) {
            state.initial = value;
        }
    }
    Some(())
}

/// Where the array of a state is declared.
fn declared(names: &Names, element: &str) -> Option<Span> {
    let is_its = |name: &str| element.strip_prefix(name).is_some_and(|rest| rest.is_empty() || rest.starts_with('['));
    let quantity = names.quantities.iter().find(|own| own.kind == Kind::State && is_its(&own.name.text));
    quantity.map(|quantity| quantity.name.span)
}

/// What was moved: the arrays' first elements, and the finding.
type Moved = (Vec<StateId>, Diagnostic);

/// A mechanism where it starts.
pub(super) struct Start<'m> {
    model: &'m Model,
    pub(super) mechanism: &'m Mechanism,
    inputs: Vec<f64>,
    /// Sizes of coordinates, and of velocities: the largest magnitude in the array of each.
    pub(super) sizes: (Vec<f64>, Vec<f64>),
    /// How fast states move that are no part of the mechanism, zero for all others; none if that is not known of what
    /// closures read.
    others: Option<Vec<f64>>,
}

/// Numbers of the mechanism at a place.
pub(super) struct Numbers {
    mass: Vec<f64>,
    pub(super) jacobian: Vec<f64>,
    pub(super) gaps: Vec<f64>,
    drifts: Vec<f64>,
}

impl<'m> Start<'m> {
    fn of(model: &'m Model, mechanism: &'m Mechanism) -> Start<'m> {
        let mut largest: BTreeMap<u32, f64> = BTreeMap::new();
        for state in &model.states {
            let largest = largest.entry(state.quantity).or_default();
            *largest = largest.max(state.initial.abs());
        }
        let size = |state: StateId, none: f64| {
            Some(largest[&model.states[state].quantity]).filter(|size| *size > 0.0).unwrap_or(none)
        };
        let coordinates = mechanism.pairs.iter().map(|pair| size(pair.0, 1.0)).collect();
        let velocities = mechanism.pairs.iter().map(|pair| size(pair.1, 0.0)).collect();
        Start {
            model,
            mechanism,
            inputs: model.sample_inputs(0.0),
            sizes: (coordinates, velocities),
            others: others(model, mechanism),
        }
    }

    pub(super) fn size(&self) -> usize {
        self.mechanism.pairs.len()
    }

    pub(super) fn rows(&self) -> usize {
        self.mechanism.gaps.len()
    }

    fn name(&self, state: StateId) -> &str {
        &self.model.states[state].name
    }

    /// Parts of the mechanism with the states at these numbers.
    pub(super) fn at(&self, states: &[f64]) -> Numbers {
        let place = Place::new(self.model, states, &self.inputs);
        let number = |part: &Expr| part.evaluate(&|variable| place.number(variable));
        let dense = |entries: &[Entry], rows: usize| {
            let mut numbers = vec![0.0; rows * self.size()];
            for entry in entries {
                numbers[at(entry.row) * self.size() + at(entry.column)] = number(&entry.value);
            }
            numbers
        };
        Numbers {
            mass: dense(&self.mechanism.mass, self.size()),
            jacobian: dense(&self.mechanism.jacobian, self.rows()),
            gaps: self.mechanism.gaps.iter().map(number).collect(),
            drifts: match self.mechanism.drifts.is_empty() {
                true => vec![0.0; self.rows()],
                false => self.mechanism.drifts.iter().map(number).collect(),
            },
        }
    }

    fn bends(&self, states: &[f64]) -> Vec<f64> {
        let place = Place::new(self.model, states, &self.inputs);
        self.mechanism.bends.iter().map(|bend| bend.evaluate(&|variable| place.number(variable))).collect()
    }

    /// The states with coordinates, and if told so velocities, moved by parts of `by`.
    pub(super) fn moved(&self, states: &[f64], velocities: bool, part: f64, by: &[f64]) -> Vec<f64> {
        let mut moved = states.to_vec();
        for (pair, by) in self.mechanism.pairs.iter().zip(by) {
            moved[if velocities { pair.1 } else { pair.0 }.index()] += part * by;
        }
        moved
    }

    /// States at which the loops are closed, with what was moved and the finding about it.
    fn settled(&self) -> Result<(Vec<f64>, Option<Moved>), Box<Diagnostic>> {
        let given: Vec<f64> = self.model.states.iter().map(|state| state.initial).collect();
        let numbers = self.at(&given);
        // Runs tell which equation has no value, and when.
        if [&numbers.mass, &numbers.jacobian, &numbers.gaps].into_iter().flatten().any(|number| !number.is_finite()) {
            return Ok((given, None));
        }
        self.check_masses(&numbers)?;
        self.check_jacobian(&given, &numbers)?;
        self.check_drifts(&given, &numbers)?;
        if self.others.is_some() {
            self.check_bends(&given)?;
        }
        let settled = self.slowed(&self.closed(&given)?)?;
        let moved = self.told(&given, &settled);
        Ok((settled, moved))
    }

    pub(super) fn refused(&self, code: &'static str, message: String, help: impl Into<String>) -> Box<Diagnostic> {
        Box::new(Diagnostic::error(code, self.mechanism.span, message).with_help(help))
    }

    /// Masses that are positive in all directions, and closures that hold what has no mass.
    fn check_masses(&self, numbers: &Numbers) -> Result<(), Box<Diagnostic>> {
        let (size, masses) = (self.size(), &numbers.mass);
        let largest = (0..size).map(|row| masses[row * size + row].abs()).fold(0.0, f64::max);
        let mut lifted = masses.clone();
        // Some directions may be without a mass, so that the last pivots are rounding.
        (0..size).for_each(|row| lifted[row * size + row] += 1e-9 * largest);
        let of = |row: usize| self.name(self.mechanism.pairs[row].1);
        let help = "look at the signs and at missing entries of the mass matrix: `w M w` is twice the kinetic energy";
        if let Err(row) = cholesky::factor(&mut lifted, 0.0) {
            let message = format!(
                "where it starts, the mass matrix is not positive: it fails at the row of `{}`, whose pivot is {:.3e}",
                of(row),
                lifted[row * size + row]
            );
            return Err(self.refused(codes::NO_MASS, message, help));
        }
        if let Err((row, pivot)) = self.factor(numbers) {
            let message = format!(
                "where it starts, nothing holds `{}`: neither a mass nor a closure, the pivot is {pivot:.3e}",
                of(row)
            );
            let mass = if largest > 0.0 { 0.01 * largest } else { 1.0 };
            let mut held =
                Numbers { mass: masses.clone(), jacobian: numbers.jacobian.clone(), gaps: vec![], drifts: vec![] };
            held.mass[row * size + row] += mass;
            let help = match self.factor(&held) {
                Ok(_) => format!(
                    "a mass of {mass:.1e} in its row of the mass matrix holds it (tried), or a closure that reads it"
                ),
                Err((other, _)) => format!("give it a mass, or a closure that reads it, and `{}` as well", of(other)),
            };
            return Err(self.refused(codes::NO_MASS, message, help));
        }
        Ok(())
    }

    /// The factor of `M + b transpose(J) J` with the weight, or the row that has no pivot, and what it is.
    fn factor(&self, numbers: &Numbers) -> Result<(Vec<f64>, f64), (usize, f64)> {
        let (size, jacobian) = (self.size(), &numbers.jacobian);
        let diagonal = |matrix: &dyn Fn(usize) -> f64| (0..size).map(matrix).fold(0.0, f64::max);
        let mass = diagonal(&|row| numbers.mass[row * size + row].abs());
        let levers = |column: usize| jacobian.iter().skip(column).step_by(size);
        let lever = diagonal(&|column| levers(column).map(|lever| lever * lever).sum::<f64>());
        let weight = if lever > 0.0 && mass > 0.0 { WEIGHT * mass / lever } else { WEIGHT };
        let mut matrix = numbers.mass.clone();
        for row in 0..self.rows() {
            let own = &jacobian[row * size..(row + 1) * size];
            for (place, entry) in matrix.iter_mut().enumerate() {
                *entry += weight * own[place / size] * own[place % size];
            }
        }
        match cholesky::factor(&mut matrix, 1e-14) {
            Ok(()) => Ok((matrix, weight)),
            Err(row) => Err((row, matrix[row * size + row])),
        }
    }

    /// What a correction takes away where closures, or their rates, are `open`.
    fn correction(&self, numbers: &Numbers, open: &[f64]) -> Vec<f64> {
        let size = self.size();
        let Ok((factor, weight)) = self.factor(numbers) else { return vec![f64::NAN; size] };
        let mut right: Vec<f64> = (0..size)
            .map(|column| {
                let pulls = open.iter().enumerate().map(|(row, open)| numbers.jacobian[row * size + column] * open);
                weight * pulls.sum::<f64>()
            })
            .collect();
        cholesky::solve(&factor, &mut right);
        right
    }

    /// For each closure what is rounding, with coordinates or velocities of such sizes.
    fn tolerances(&self, numbers: &Numbers, sizes: &[f64]) -> Vec<f64> {
        let reach = |own: &[f64]| own.iter().zip(sizes).map(|(lever, size)| lever.abs() * size).sum::<f64>();
        let reaches: Vec<f64> = numbers.jacobian.chunks_exact(self.size()).map(reach).collect();
        let largest = reaches.iter().copied().fold(0.0, f64::max);
        reaches.into_iter().map(|reach| ROUNDING * reach.max(1e-3 * largest)).collect()
    }

    /// The closure that is open most, and by how much, if that is not rounding.
    fn open(open: &[f64], tolerances: &[f64]) -> Option<(usize, f64)> {
        let worst = open
            .iter()
            .zip(tolerances)
            .enumerate()
            .filter(|(_, (open, rounding))| open.is_nan() || open.abs() > **rounding);
        let worst = worst.max_by(|one, other| (one.1.0.abs() / one.1.1).total_cmp(&(other.1.0.abs() / other.1.1)));
        worst.map(|(row, (open, _))| (row, *open))
    }

    /// The states with coordinates moved until loops are closed: Newton's iteration.
    fn closed(&self, given: &[f64]) -> Result<Vec<f64>, Box<Diagnostic>> {
        let mut states = given.to_vec();
        let mut before = f64::INFINITY;
        for _ in 0..CORRECTIONS {
            let numbers = self.at(&states);
            let tolerances = self.tolerances(&numbers, &self.sizes.0);
            let Some((row, open)) = Start::open(&numbers.gaps, &tolerances) else { return Ok(states) };
            let correction = self.correction(&numbers, &numbers.gaps);
            let length = correction.iter().zip(&self.sizes.0).map(|(by, size)| (by / size).abs()).fold(0.0, f64::max);
            let rounding = length <= 1e3 * ROUNDING;
            if !length.is_finite() || (length > FAR * before && !rounding) {
                let first = Start::open(&self.at(given).gaps, &tolerances).unwrap_or((row, open));
                let message = format!(
                    "inconsistent initial values: closure {} is {:.3e}, and Newton's iteration from there does not close \
                     the loops at once",
                    self.closure(first.0),
                    first.1
                );
                return Err(self.unclosed(given, message));
            }
            before = length;
            states = self.moved(&states, false, -1.0, &correction);
        }
        let numbers = self.at(&states);
        match Start::open(&numbers.gaps, &self.tolerances(&numbers, &self.sizes.0)) {
            None => Ok(states),
            // What closures cannot tell apart is rounding of theirs.
            Some((_, open)) if open.abs() <= 1e3 * ROUNDING * self.sizes.0.iter().copied().fold(0.0, f64::max) => {
                Ok(states)
            }
            Some((row, open)) => {
                let message = format!("inconsistent initial values: closure {} stays at {open:.3e}", self.closure(row));
                Err(self.unclosed(given, message))
            }
        }
    }

    /// The states with velocities that keep closures closed.
    fn slowed(&self, given: &[f64]) -> Result<Vec<f64>, Box<Diagnostic>> {
        let numbers = self.at(given);
        let tolerances = self.tolerances(&numbers, &self.sizes.1);
        let size = self.size();
        let velocities =
            |states: &[f64]| -> Vec<f64> { self.mechanism.pairs.iter().map(|pair| states[pair.1.index()]).collect() };
        let rates = |states: &[f64]| -> Vec<f64> {
            let own = velocities(states);
            let row = |levers: &[f64]| levers.iter().zip(&own).map(|(lever, own)| lever * own).sum();
            let moved = numbers.jacobian.chunks_exact(size).map(row);
            moved.zip(&numbers.drifts).map(|(moved, drift): (f64, &f64)| moved + drift).collect()
        };
        let Some((row, open)) = Start::open(&rates(given), &tolerances) else { return Ok(given.to_vec()) };
        let mut states = given.to_vec();
        for _ in 0..CORRECTIONS {
            let open = rates(&states);
            if Start::open(&open, &tolerances).is_none() {
                break;
            }
            states = self.moved(&states, true, -1.0, &self.correction(&numbers, &open));
        }
        let energy = |own: &[f64]| -> f64 {
            let place = numbers.mass.iter().enumerate();
            place.map(|(place, mass)| own[place / size] * mass * own[place % size]).sum::<f64>() / 2.0
        };
        let (before, after) = (velocities(given), velocities(&states));
        let lost: Vec<f64> = before.iter().zip(&after).map(|(before, after)| before - after).collect();
        let part = libm::sqrt(energy(&lost) / energy(&before));
        if part <= FAR {
            return Ok(states);
        }
        let message = format!(
            "inconsistent initial values: closure {} opens at {open:.3e} per second; to keep all of them closed takes \
             {:.0} % of the velocities",
            self.closure(row),
            100.0 * part
        );
        let all: Vec<StateId> = self.mechanism.pairs.iter().map(|pair| pair.1).collect();
        let help = format!(
            "give all velocities so that closures stay closed; the nearest ones are {}",
            self.list(&all, &states)
        );
        Err(self.refused(codes::INCONSISTENT_START, message, help))
    }

    /// Values of states in words.
    pub(super) fn list(&self, states: &[StateId], values: &[f64]) -> String {
        let value = |state: &StateId| format!("{} = {}", self.name(*state), shown(values[state.index()]));
        let named: Vec<String> = states.iter().take(NAMED).map(value).collect();
        let rest = if states.len() > NAMED { format!(" and {} more", states.len() - NAMED) } else { String::new() };
        named.join(", ") + &rest
    }

    /// A closure's name.
    pub(super) fn closure(&self, row: usize) -> String {
        match &self.mechanism.gaps[row] {
            Expr::Variable(Variable::Algebraic(algebraic)) => {
                format!("`{}`", self.model.algebraics[at(*algebraic)].name)
            }
            _ => format!("{row}, which is a number,"),
        }
    }

    /// The finding about values that were moved.
    fn told(&self, given: &[f64], settled: &[f64]) -> Option<Moved> {
        let by = |state: &StateId| (settled[state.index()] - given[state.index()]).abs();
        let pairs = &self.mechanism.pairs;
        let all = pairs.iter().map(|pair| pair.0).chain(pairs.iter().map(|pair| pair.1));
        let moved: Vec<StateId> = all.filter(|state| by(state) > 0.0).collect();
        let largest = |velocities: bool| {
            let own = pairs.iter().map(|pair| if velocities { pair.1 } else { pair.0 });
            own.filter(|state| by(state) > 0.0).max_by(|one, other| by(one).total_cmp(&by(other)))
        };
        let far = [largest(false), largest(true)].into_iter().flatten();
        let far: Vec<String> = far.map(|state| format!("`{}` by {:.1e}", self.name(state), by(&state))).collect();
        if far.is_empty() {
            return None;
        }
        let message = format!("initial values are moved to where loops are closed: {} at most", far.join(", "));
        let finding = Diagnostic::error(codes::START_MOVED, self.mechanism.span, message).into_warning();
        let finding = finding.with_help(format!("the values are now {}", self.list(&moved, settled)));
        let mut firsts: Vec<StateId> = Vec::new();
        for state in moved {
            let quantity = |state: StateId| self.model.states[state].quantity;
            if firsts.iter().all(|first| quantity(*first) != quantity(state)) {
                firsts.push(state);
            }
        }
        Some((firsts, finding))
    }

    /// Directions in which derivatives are compared with differences: sizes of coordinates with signs and parts that no
    /// mechanism shares.
    fn directions(&self) -> Vec<f64> {
        let part = |place: usize| 0.55 + 0.45 * libm::sin(1.0 + 2.4 * place as f64);
        let sign = |place: usize| if place % 3 == 1 { -1.0 } else { 1.0 };
        self.sizes.0.iter().enumerate().map(|(place, size)| sign(place) * part(place) * size).collect()
    }

    /// The derivative of what `of` gives for states moved along `along`, and those that are no part of the mechanism along
    /// `others`; none where it has a bend or is not finite.
    fn slopes(
        &self,
        states: &[f64],
        (along, others): (&[f64], &[f64]),
        of: &dyn Fn(&[f64]) -> Vec<f64>,
    ) -> Vec<Option<f64>> {
        let side = |part: f64| {
            let mut moved = self.moved(states, false, part, along);
            moved.iter_mut().zip(others).for_each(|(moved, by)| *moved += part * by);
            of(&moved)
        };
        let (ahead, behind, middle) = (side(DIFFERENCE), side(-DIFFERENCE), of(states));
        let both = ahead.into_iter().zip(behind).zip(middle);
        let slope = |((ahead, behind), middle): ((f64, f64), f64)| {
            let slope = (ahead - behind) / (2.0 * DIFFERENCE);
            let bent = (ahead - 2.0 * middle + behind) / DIFFERENCE;
            (slope.is_finite() && bent.abs() <= 0.01 * slope.abs().max(libm::sqrt(DIFFERENCE))).then_some(slope)
        };
        both.map(slope).collect()
    }

    /// Each row of the Jacobian against differences of its closure.
    fn check_jacobian(&self, given: &[f64], numbers: &Numbers) -> Result<(), Box<Diagnostic>> {
        let size = self.size();
        let one = |column: usize| -> Vec<f64> {
            (0..size).map(|place| if place == column { self.sizes.0[column] } else { 0.0 }).collect()
        };
        let levers = numbers.jacobian.iter().enumerate();
        let whole = levers.map(|(place, lever)| (lever * self.sizes.0[place % size]).abs()).fold(0.0, f64::max);
        for column in 0..size {
            let along = one(column);
            for (row, slope) in
                self.slopes(given, (&along, &[]), &|states| self.at(states).gaps).into_iter().enumerate()
            {
                let own = &numbers.jacobian[row * size..(row + 1) * size];
                let largest =
                    own.iter().zip(&self.sizes.0).map(|(lever, size)| (lever * size).abs()).fold(0.0, f64::max);
                let (Some(slope), said) = (slope, own[column] * along[column]) else { continue };
                if (slope - said).abs() > DIFFERS * largest.max(slope.abs()).max(DIFFERS * whole) + NOISE {
                    let coordinate = self.name(self.mechanism.pairs[column].0);
                    let message = format!(
                        "where it starts, the derivative of {} by `{coordinate}` is {:.6}, and `J` has {:.6}",
                        self.closure(row),
                        slope / along[column],
                        own[column]
                    );
                    let help = "write the derivative of each closure by each coordinate into its row of `J`";
                    return Err(self.refused(codes::NO_DERIVATIVE, message, help));
                }
            }
        }
        Ok(())
    }

    /// Closures that move by themselves have drifts, which are compared with differences where that can be done.
    fn check_drifts(&self, given: &[f64], numbers: &Numbers) -> Result<(), Box<Diagnostic>> {
        if self.mechanism.drifts.is_empty() {
            if reads_coordinates_alone(self.model, self.mechanism) {
                return Ok(());
            }
            let message = "closures read more than coordinates, and nothing says how fast they move by themselves";
            let help = "give the derivatives of `gap` by time where no coordinate moves as an eighth argument, \
                        `constrained(M, f, J, gap, bend, penalty, rate, drift)`; `bend` has the derivatives of `drift`, too";
            return Err(self.refused(codes::UNSUITABLE_MECHANISM, message.to_owned(), help));
        }
        let Some(others) = &self.others else { return Ok(()) };
        let still = vec![0.0; self.size()];
        let slopes = self.slopes(given, (&still, others), &|states| self.at(states).gaps);
        for (row, (slope, drift)) in slopes.into_iter().zip(&numbers.drifts).enumerate() {
            let Some(slope) = slope.filter(|slope| (slope - drift).abs() > DIFFERS * slope.abs() + NOISE) else {
                continue;
            };
            let message = format!(
                "where it starts and no coordinate moves, closure {} changes by {slope:.6} per second, and its drift is \
                 {drift:.6}",
                self.closure(row)
            );
            let help = "write the derivative of each closure by time into `drift`, with coordinates as they are";
            return Err(self.refused(codes::NO_DERIVATIVE, message, help));
        }
        Ok(())
    }

    /// Each bend against differences of the Jacobian and the drifts, with velocities of any kind.
    fn check_bends(&self, given: &[f64]) -> Result<(), Box<Diagnostic>> {
        let (size, along) = (self.size(), self.directions());
        let others = self.others.as_deref().unwrap_or_default();
        let mut states = given.to_vec();
        for (pair, velocity) in self.mechanism.pairs.iter().zip(&along) {
            states[pair.1.index()] = *velocity;
        }
        let rates = |states: &[f64]| -> Vec<f64> {
            let numbers = self.at(states);
            let row = |own: &[f64]| own.iter().zip(&along).map(|(lever, velocity)| lever * velocity).sum();
            let moved = numbers.jacobian.chunks_exact(size).map(row);
            moved.zip(&numbers.drifts).map(|(moved, drift): (f64, &f64)| moved + drift).collect()
        };
        let magnitudes = |states: &[f64]| -> Vec<f64> {
            let numbers = self.at(states);
            let row = |own: &[f64]| own.iter().zip(&along).map(|(lever, velocity)| (lever * velocity).abs()).sum();
            numbers.jacobian.chunks_exact(size).map(row).collect()
        };
        let slopes = self.slopes(&states, (&along, others), &rates);
        for (row, ((slope, bend), magnitude)) in
            slopes.into_iter().zip(self.bends(&states)).zip(magnitudes(&states)).enumerate()
        {
            let Some(slope) = slope else { continue };
            if (slope - bend).abs() > DIFFERS * magnitude.max(slope.abs()) + NOISE {
                let message = format!(
                    "with other velocities where it starts, the bend of {} has to be {slope:.6}, and is {bend:.6}",
                    self.closure(row)
                );
                let help = "`bend` is what is left of the second derivative of `gap` by time if nothing accelerates: the \
                            derivative of `J` by time, times `w`";
                return Err(self.refused(codes::NO_DERIVATIVE, message, help));
            }
        }
        Ok(())
    }
}

/// A value with so many digits that it is the same when it is read back.
fn shown(value: f64) -> String {
    if value != 0.0 && !(1e-4..1e6).contains(&value.abs()) { format!("{value:e}") } else { format!("{value}") }
}
