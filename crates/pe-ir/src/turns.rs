//! Angles: states that count turns, of which the step drops whole ones, and values that are the same a turn further.

use crate::index::{StateId, at};
use crate::model::{Expr, Model, Variable};

/// A turn in radians.
pub const RADIANS: f64 = 2.0 * core::f64::consts::PI;

/// Half a turn, in turns: the magnitude that errors of angles are relative to.
pub const HALF: f64 = 0.5;

/// Number of turns that an angle is expected to reach: half a turn, and what it moves in a step. With the margin of formats
/// and tables it is just below 1, so that the word of an angle is the argument of its functions.
pub const REACH: f64 = 0.8;

/// The largest move of an angle in a step, in turns, for which the step still finds back to the first half turn.
pub const LONGEST_MOVE: f64 = 0.45;

/// Turns that an angle may be multiplied by in an argument, added up over all angles of a sum.
pub const MOST_MULTIPLES: i64 = 8;

/// What an angle is without whole turns, which are `turn` long: from minus half of one to half of one.
pub fn principal(angle: f64, turn: f64) -> f64 {
    angle - turn * libm::floor(angle / turn + 0.5)
}

/// The number that differs from `number` by whole turns and is closest to `other`.
pub fn nearest(number: f64, other: f64, turn: f64) -> f64 {
    let whole = libm::round((number - other) / turn);
    // As many turns as they have in common are not subtracted: what is close stays as it is.
    if whole == 0.0 { number } else { number - turn * whole }
}

impl Model {
    /// Whether some state is an angle.
    pub fn has_angles(&self) -> bool {
        self.states.iter().any(|state| state.angle)
    }

    /// Number of turns that an algebraic variable reaches, if it is a sum of angles and nothing else.
    pub fn turns_of_sum(&self, algebraic: u32) -> Option<f64> {
        let term = |expr: &Expr| match expr {
            Expr::Variable(Variable::State(state)) if self.states[*state].angle => Some(REACH),
            Expr::Product(members) => match &members[..] {
                [Expr::Constant(factor), Expr::Variable(Variable::State(state))] if self.states[*state].angle => {
                    Some(factor.abs() * REACH)
                }
                _ => None,
            },
            _ => None,
        };
        match &self.algebraics.get(at(algebraic))?.expr {
            Expr::Sum(members) => members.iter().map(term).sum(),
            expr => term(expr),
        }
    }

    /// What one value of a state is more than another one, of an angle modulo a turn.
    pub fn difference(&self, state: StateId, one: f64, other: f64) -> f64 {
        let angle = self.states.find(state).is_some_and(|state| state.angle);
        if angle { principal(one - other, 1.0) } else { one - other }
    }

    /// What a unit of a state is in the unit of the spec: of an angle a turn in radians.
    pub fn radians(&self, state: StateId) -> f64 {
        if self.states[state].angle { RADIANS } else { 1.0 }
    }

    /// The states that are angles, each with the length of a turn.
    pub fn turns(&self) -> Vec<(usize, f64)> {
        let angles = self.states.iter().enumerate().filter(|(_, state)| state.angle);
        angles.map(|(index, _)| (index, 1.0)).collect()
    }

    /// The outputs that are angles, each with the length of a turn.
    pub fn output_turns(&self) -> Vec<(usize, f64)> {
        let turn = |variable: Variable| match variable {
            Variable::State(state) => self.states[state].angle.then_some(1.0),
            Variable::Algebraic(algebraic) => self.algebraics[at(algebraic)].angle.then_some(RADIANS),
            Variable::Input(_) => None,
        };
        let outputs = self.outputs.iter().enumerate();
        outputs.filter_map(|(index, output)| turn(output.variable).map(|turn| (index, turn))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn principal_values_lie_in_one_turn_and_differ_by_whole_ones() {
        for angle in [-7.3, -0.5, -0.2, 0.0, 0.49, 0.5, 1.0, 12.75] {
            let own = principal(angle, 1.0);
            assert!((-0.5..0.5).contains(&own) && libm::rint(angle - own) == angle - own, "{angle}: {own}");
        }
        assert_eq!(nearest(0.49, -0.49, 1.0), -0.51);
        assert_eq!(nearest(3.2, 0.1, RADIANS), 3.2);
    }
}
