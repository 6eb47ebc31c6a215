//! What all formats are read into, and specs are written from.

use pe_ir::source::Span;

use crate::expr::{Callee, Expr};
use crate::mathml;

/// An imported model. Quantities, functions and groups are numbered as they stand in the lists.
#[derive(Clone, Debug, Default)]
pub struct Model {
    /// Identifier of the model in its file, or the name of the file.
    pub id: String,
    /// What it is called in words; may be empty.
    pub title: String,
    /// The format it comes from, in words.
    pub format: String,
    /// Unit of time, in the terms of the language.
    pub time_unit: Option<String>,
    /// Whether units of numbers in expressions were left out, so that units cannot be checked.
    pub units_off: bool,
    /// Headings, in the order in which they are written.
    pub groups: Vec<String>,
    /// Functions.
    pub functions: Vec<Function>,
    /// Names of arrays in the file.
    pub arrays: Vec<String>,
    /// Quantities.
    pub quantities: Vec<Quantity>,
    /// Events.
    pub events: Vec<Event>,
    /// What a user wants to see: name of the column, quantity.
    pub outputs: Vec<(String, usize)>,
    /// What the file says of its simulation.
    pub run: Run,
}

/// What a file says of its simulation, in the unit of time of the model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Run {
    /// Time over which it is run.
    pub span: Option<f64>,
    /// Time from one row of results to the next.
    pub interval: Option<f64>,
}

/// A named value.
#[derive(Clone, Debug)]
pub struct Quantity {
    /// Its name in the file, complete.
    pub id: String,
    /// The name to use if no other quantity wants it; empty for that of the file.
    pub short: String,
    /// What it is called in words; may be empty.
    pub label: String,
    /// Unit, in the terms of the language.
    pub unit: Option<String>,
    /// Its group.
    pub group: usize,
    /// The array that it is an element of, and its subscripts.
    pub element: Option<(usize, Vec<usize>)>,
    /// What it is.
    pub kind: Kind,
    /// Where it is declared.
    pub span: Span,
    /// Where its equation stands.
    pub equation: Span,
}

/// What a quantity is.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// Nothing gives it a value.
    Missing,
    /// The same during the run; what it reads is taken at the beginning.
    Constant(Expr),
    /// Computed from others at all times.
    Algebraic(Expr),
    /// A state.
    State {
        /// Its value at the beginning.
        initial: Expr,
        /// Its derivative.
        rate: Expr,
    },
}

/// A function of the model. Its body gives a number and reads its arguments only.
#[derive(Clone, Debug)]
pub struct Function {
    /// Its name in the file.
    pub id: String,
    /// Names of its arguments.
    pub arguments: Vec<String>,
    /// Its body.
    pub body: Expr,
    /// Where it is defined.
    pub span: Span,
}

/// An event: when the trigger becomes true, all quantities take their new values at once.
#[derive(Clone, Debug)]
pub struct Event {
    /// Its name in the file; may be empty.
    pub id: String,
    /// The condition.
    pub trigger: Expr,
    /// Whether the trigger counts as true before the beginning.
    pub held_before: bool,
    /// Whether a delayed event comes also if the trigger is false again by then.
    pub persistent: bool,
    /// Whether new values are computed when the event is triggered rather than when it comes.
    pub early_values: bool,
    /// Time from the trigger to the new values.
    pub delay: Option<Expr>,
    /// Which of several events at one time comes first: the one with the greatest.
    pub priority: Option<Expr>,
    /// New values.
    pub assignments: Vec<(usize, Expr)>,
    /// Where it stands.
    pub span: Span,
}

/// Functions with bends or jumps, whose slope may be zero on either side of a value.
const BENDS: [&str; 9] = ["abs", "sign", "min", "max", "floor", "ceil", "round", "mod", "quotient"];

impl Event {
    /// The expressions it is made of.
    pub fn expressions(&self) -> impl Iterator<Item = &Expr> {
        let values = self.assignments.iter().map(|(_, value)| value);
        std::iter::once(&self.trigger).chain(&self.delay).chain(&self.priority).chain(values)
    }

    /// The same, to be changed.
    pub fn expressions_mut(&mut self) -> impl Iterator<Item = &mut Expr> {
        let values = self.assignments.iter_mut().map(|(_, value)| value);
        std::iter::once(&mut self.trigger).chain(&mut self.delay).chain(&mut self.priority).chain(values)
    }

    /// Whether it comes when something else than the time crosses a value.
    pub fn crosses(&self, model: &Model) -> bool {
        let mut found = false;
        self.trigger.each(&mut |part| {
            found |= matches!(part, Expr::Name(read) if !matches!(model.quantities[*read].kind, Kind::Constant(_)));
        });
        found
    }

    /// Whether a spec can have its time within the step found.
    pub fn refines(&self) -> bool {
        let mut bends = false;
        self.trigger.each(&mut |part| {
            bends |= match part {
                Expr::Call(Callee::Language(name), _) => BENDS.contains(name),
                Expr::Call(Callee::Own(_), _) | Expr::Choice(..) | Expr::Pulse(_) => true,
                _ => false,
            }
        });
        let single = !bends && matches!(&self.trigger, Expr::Compare(relation, _) if relation.is_order());
        single && self.delay.as_ref().is_none_or(|delay| delay.literal() == Some(0.0))
    }
}

impl Quantity {
    /// A quantity without a value so far.
    pub fn new(id: impl Into<String>, group: usize, span: Span) -> Quantity {
        Quantity {
            id: id.into(),
            short: String::new(),
            label: String::new(),
            unit: None,
            group,
            element: None,
            kind: Kind::Missing,
            span,
            equation: span,
        }
    }
}

impl Kind {
    /// The expressions it is made of, to be changed.
    pub fn expressions_mut(&mut self) -> Vec<&mut Expr> {
        match self {
            Kind::Missing => Vec::new(),
            Kind::Constant(expr) | Kind::Algebraic(expr) => vec![expr],
            Kind::State { initial, rate } => vec![initial, rate],
        }
    }

    /// The expressions it is made of.
    pub fn expressions(&self) -> Vec<&Expr> {
        match self {
            Kind::Missing => Vec::new(),
            Kind::Constant(expr) | Kind::Algebraic(expr) => vec![expr],
            Kind::State { initial, rate } => vec![initial, rate],
        }
    }
}

/// Units of time that the language has, in seconds.
const TIMES: [(&str, f64); 6] = [("ns", 1e-9), ("us", 1e-6), ("ms", 1e-3), ("s", 1.0), ("min", 60.0), ("h", 3600.0)];

impl Model {
    /// Seconds in the unit of time, as the spec counts it: one if the language does not have the unit.
    pub fn seconds(&self) -> f64 {
        let unit = self.time_unit.as_deref().unwrap_or("s");
        TIMES.iter().find(|(known, _)| *known == unit).map_or(1.0, |(_, seconds)| *seconds)
    }

    /// The word of the language for the unit of time; `None` if it has none.
    pub fn time_word(&self) -> Option<&'static str> {
        let unit = self.time_unit.as_deref().unwrap_or("s");
        TIMES.iter().find(|(known, _)| *known == unit).map(|(known, _)| *known)
    }

    /// The value of an expression that is the same during the run, if it is simple.
    pub fn known(&self, expr: &Expr) -> Option<f64> {
        match expr {
            Expr::Number(value, _) => Some(*value),
            Expr::Name(read) => match &self.quantities[*read].kind {
                Kind::Constant(value) => self.known(value),
                _ => None,
            },
            Expr::Sum(members) => members.iter().try_fold(0.0, |sum, (negative, member)| {
                let value = self.known(member)?;
                Some(if *negative { sum - value } else { sum + value })
            }),
            Expr::Product(members) => members.iter().try_fold(1.0, |product, (inverse, member)| {
                let value = self.known(member)?;
                Some(if *inverse { product / value } else { product * value })
            }),
            Expr::Power(pair) => Some(libm::pow(self.known(&pair.0)?, self.known(&pair.1)?)),
            Expr::Call(Callee::Own(function), arguments) => {
                self.known(&mathml::inlined(&self.functions[*function].body, arguments))
            }
            _ => None,
        }
    }

    /// Takes in one more quantity; its number.
    pub fn add(&mut self, quantity: Quantity) -> usize {
        self.quantities.push(quantity);
        self.quantities.len() - 1
    }

    /// Takes in one more array; its number.
    pub fn array(&mut self, name: &str) -> usize {
        self.arrays.push(name.to_owned());
        self.arrays.len() - 1
    }

    /// Puts one number of a quantity in the place of another in all expressions.
    pub fn rename(&mut self, from: usize, to: usize) {
        let own = self.quantities.iter_mut().flat_map(|quantity| quantity.kind.expressions_mut());
        for expr in own.chain(self.events.iter_mut().flat_map(Event::expressions_mut)) {
            *expr = expr.map(&mut |leaf| (*leaf == Expr::Name(from)).then_some(Expr::Name(to)));
        }
    }

    /// The number of a group; it is made where it is missing.
    pub fn group(&mut self, heading: &str) -> usize {
        self.groups.iter().position(|known| known == heading).unwrap_or_else(|| {
            self.groups.push(heading.to_owned());
            self.groups.len() - 1
        })
    }
}
