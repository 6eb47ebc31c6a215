//! States that represent signals of the model: they move exactly, whatever the method, and depend on nothing.

use crate::index::StateId;

/// How a state moves that no method approximates. Within a step methods may treat it by its derivative; what it is at the
/// end of a step is exact but for rounding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// It counts time in units of [`crate::model::Model::tick`]; its derivative is a number.
    Clock,
    /// The sine of an angle that grows by so many radians per second; the next state is the cosine.
    Sine(f64),
    /// The cosine of an angle that grows by so many radians per second; the state before is the sine.
    Cosine(f64),
    /// The sine of an angle whose speed in radians per second is a line, the state of this number; the next state is the
    /// cosine.
    SweptSine(StateId),
    /// The cosine; the state before is the sine.
    SweptCosine(StateId),
    /// A signal that jumps, constant over a step: what it is shortly before the middle of the step ([`MIDDLE`]).
    Held(Source),
    /// A signal along a straight line over a step, from what it is at its beginning to what it is at its end. The next
    /// state is [`Motion::Before`].
    Line(Source),
    /// What a signal is at the beginning of a step, over the whole step.
    Before(Source),
    /// What a signal is at the end of a step, over the whole step.
    After(Source),
    /// What its derivative, a variable, was so many seconds ago; before time zero what it was then. No derivative tells it.
    Delayed(f64),
    /// Within a step from what it is over what the second state holds in the middle, if it is told, to what the first holds
    /// at the end. Made where a step is built.
    Along(StateId, Option<StateId>),
}

/// Where a signal comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// An input, sampled for the end of each step.
    Input(u32),
    /// One of [`Model::signals`], computed in the network.
    Signal(u32),
}

/// Part of a step at which a signal that jumps is looked at: a jump in the first half counts from the beginning of the step,
/// one in the second half from its end. Not the middle itself, which jumps may fall on and rounding would decide.
pub const MIDDLE: f64 = 31.0 / 64.0;

impl Motion {
    /// The signal that it follows, if it is no function of the time that equations tell.
    pub fn source(self) -> Option<Source> {
        match self {
            Motion::Held(source) | Motion::Line(source) | Motion::Before(source) | Motion::After(source) => {
                Some(source)
            }
            Motion::Clock | Motion::Sine(_) | Motion::Cosine(_) | Motion::SweptSine(_) | Motion::SweptCosine(_) => None,
            Motion::Delayed(_) | Motion::Along(..) => None,
        }
    }

    /// Whether it is a sine or cosine whose frequency changes.
    pub fn is_swept(self) -> bool {
        matches!(self, Motion::SweptSine(_) | Motion::SweptCosine(_))
    }

    /// Whether the state is the same all over a step.
    pub fn rests(self) -> bool {
        matches!(self, Motion::Held(_) | Motion::Before(_) | Motion::After(_))
    }
}
