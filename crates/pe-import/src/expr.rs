//! Expressions of imported models, in the terms of the language of specs.

/// A relation between two numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Relation {
    /// `==`
    Equal,
    /// `!=`
    NotEqual,
    /// `<`
    Less,
    /// `<=`
    LessEqual,
    /// `>`
    Greater,
    /// `>=`
    GreaterEqual,
}

impl Relation {
    /// Whether it says which of two numbers is larger.
    pub fn is_order(self) -> bool {
        !matches!(self, Relation::Equal | Relation::NotEqual)
    }

    /// The operator in a spec.
    pub fn sign(self) -> &'static str {
        match self {
            Relation::Equal => "==",
            Relation::NotEqual => "!=",
            Relation::Less => "<",
            Relation::LessEqual => "<=",
            Relation::Greater => ">",
            Relation::GreaterEqual => ">=",
        }
    }
}

/// Who computes a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Callee {
    /// What the first member, a quantity, was some time ago, which is the second member.
    Past,
    /// A function of the language.
    Language(&'static str),
    /// A function of the model, by its number.
    Own(usize),
}

/// An expression: a number, or a condition.
#[derive(Clone, Debug, PartialEq)]
pub enum Expr {
    /// A number, with its text where a spec can hold it as it was written.
    Number(f64, Option<String>),
    /// The number of the circle.
    Pi,
    /// The time of the model.
    Time,
    /// A quantity of the model, by its number.
    Name(usize),
    /// An argument of the function whose body this is.
    Argument(usize),
    /// Members with `true` are subtracted. At least one member.
    Sum(Vec<(bool, Expr)>),
    /// Members with `true` are divided by. At least one member.
    Product(Vec<(bool, Expr)>),
    /// Base and exponent.
    Power(Box<(Expr, Expr)>),
    /// A call.
    Call(Callee, Vec<Expr>),
    /// A pulse train: height, start, width, period (0 for a single pulse), times in the unit of time of the model.
    Pulse(Box<[Expr; 4]>),
    /// Pairs of condition and value, and the value where no condition holds.
    Choice(Vec<(Expr, Expr)>, Box<Expr>),
    /// A condition that is known.
    Truth(bool),
    /// A comparison.
    Compare(Relation, Box<(Expr, Expr)>),
    /// All of them; at least two.
    And(Vec<Expr>),
    /// At least one of them; at least two.
    Or(Vec<Expr>),
    /// The opposite.
    Not(Box<Expr>),
}

impl Expr {
    /// A number with its unit behind it, as it is needed in products; anything else as it is.
    pub fn measured(self, unit: Option<&str>) -> Expr {
        match (self, unit) {
            (Expr::Number(value, Some(text)), Some(unit)) if value != 0.0 && !unit.is_empty() => {
                Expr::Number(value, Some(format!("{text} [{unit}]")))
            }
            (expr, _) => expr,
        }
    }

    /// A number that no text stands for.
    pub fn number(value: f64) -> Expr {
        Expr::Number(value, None)
    }

    /// The value of a literal, with its sign.
    pub fn literal(&self) -> Option<f64> {
        match self {
            Expr::Number(value, _) => Some(*value),
            Expr::Sum(members) => match &members[..] {
                [(true, Expr::Number(value, _))] => Some(-value),
                _ => None,
            },
            _ => None,
        }
    }

    /// The sum; members that are sums themselves are taken apart, and zeros left out.
    pub fn sum(members: impl IntoIterator<Item = (bool, Expr)>) -> Expr {
        let mut flat = Vec::new();
        for (negative, member) in members {
            match member.into_number() {
                Expr::Number(0.0, _) => {}
                Expr::Sum(inner) => flat.extend(inner.into_iter().map(|(sign, member)| (sign != negative, member))),
                member => flat.push((negative, member)),
            }
        }
        match flat.len() {
            0 => Expr::number(0.0),
            1 if !flat[0].0 => flat.remove(0).1,
            _ => Expr::Sum(flat),
        }
    }

    /// `-self`.
    pub fn negated(self) -> Expr {
        Expr::sum([(true, self)])
    }

    /// The product; factors that are products themselves are taken apart, and ones left out. With a zero it is zero.
    pub fn product(members: impl IntoIterator<Item = (bool, Expr)>) -> Expr {
        let mut flat = Vec::new();
        for (inverse, member) in members {
            match member.into_number() {
                Expr::Number(1.0, _) => {}
                Expr::Product(inner) if !inverse => flat.extend(inner),
                member => flat.push((inverse, member)),
            }
        }
        if flat.iter().any(|(inverse, member)| !inverse && matches!(member, Expr::Number(0.0, _))) {
            return Expr::number(0.0);
        }
        match flat.len() {
            0 => Expr::number(1.0),
            1 if !flat[0].0 => flat.remove(0).1,
            _ => Expr::Product(flat),
        }
    }

    /// `self/divisor`.
    pub fn over(self, divisor: Expr) -> Expr {
        Expr::product([(false, self), (true, divisor)])
    }

    /// `self*factor`.
    pub fn times(self, factor: Expr) -> Expr {
        Expr::product([(false, self), (false, factor)])
    }

    /// `self^exponent`.
    pub fn power(self, exponent: Expr) -> Expr {
        if exponent.literal() == Some(1.0) { self } else { Expr::Power(Box::new((self, exponent))) }
    }

    /// A call of a function of the language.
    pub fn call(function: &'static str, arguments: Vec<Expr>) -> Expr {
        Expr::Call(Callee::Language(function), arguments)
    }

    /// A comparison.
    pub fn compare(relation: Relation, left: Expr, right: Expr) -> Expr {
        if relation == Relation::NotEqual && left.is_condition() && right == Expr::number(0.0) {
            return left;
        }
        Expr::Compare(relation, Box::new((left.into_number(), right.into_number())))
    }

    /// All of the conditions.
    pub fn all(mut conditions: Vec<Expr>) -> Expr {
        match conditions.len() {
            0 => Expr::Truth(true),
            1 => conditions.remove(0),
            _ => Expr::And(conditions),
        }
    }

    /// At least one of the conditions.
    pub fn any(mut conditions: Vec<Expr>) -> Expr {
        match conditions.len() {
            0 => Expr::Truth(false),
            1 => conditions.remove(0),
            _ => Expr::Or(conditions),
        }
    }

    /// The opposite of a condition.
    pub fn opposite(self) -> Expr {
        match self {
            Expr::Truth(value) => Expr::Truth(!value),
            Expr::Not(inner) => *inner,
            other => Expr::Not(Box::new(other)),
        }
    }

    /// A choice; what never or always holds is decided.
    pub fn choice(pieces: Vec<(Expr, Expr)>, otherwise: Expr) -> Expr {
        let mut kept = Vec::new();
        let mut otherwise = otherwise;
        for (condition, value) in pieces {
            match condition {
                Expr::Truth(false) => {}
                Expr::Truth(true) => {
                    otherwise = value;
                    break;
                }
                condition => kept.push((condition, value)),
            }
        }
        if kept.is_empty() { otherwise } else { Expr::Choice(kept, Box::new(otherwise)) }
    }

    /// Whether this is a condition; calls of functions of the model always give numbers.
    pub fn is_condition(&self) -> bool {
        match self {
            Expr::Truth(_) | Expr::Compare(..) | Expr::And(_) | Expr::Or(_) | Expr::Not(_) => true,
            Expr::Choice(pieces, otherwise) => {
                otherwise.is_condition() && pieces.iter().all(|(_, value)| value.is_condition())
            }
            _ => false,
        }
    }

    /// As a number: 1 for a condition that holds, else 0.
    pub fn into_number(self) -> Expr {
        match self {
            Expr::Truth(value) => Expr::number(f64::from(u8::from(value))),
            condition if condition.is_condition() => {
                Expr::choice(vec![(condition, Expr::number(1.0))], Expr::number(0.0))
            }
            Expr::Choice(pieces, otherwise) => {
                let pieces = pieces.into_iter().map(|(condition, value)| (condition, value.into_number())).collect();
                Expr::Choice(pieces, Box::new(otherwise.into_number()))
            }
            number => number,
        }
    }

    /// As a condition: a number holds unless it is zero. A choice between conditions is written with `and` and `or`.
    pub fn into_condition(self) -> Expr {
        match self {
            Expr::Choice(pieces, otherwise) => {
                let mut members = Vec::new();
                let mut before: Vec<Expr> = Vec::new();
                for (condition, value) in pieces {
                    let mut held = before.clone();
                    held.extend([condition.clone(), value.into_condition()]);
                    members.push(Expr::all(held));
                    before.push(condition.opposite());
                }
                before.push(otherwise.into_condition());
                members.push(Expr::all(before));
                Expr::any(members)
            }
            Expr::Number(value, _) => Expr::Truth(value != 0.0),
            condition if condition.is_condition() => condition,
            number => Expr::compare(Relation::NotEqual, number, Expr::number(0.0)),
        }
    }

    /// Its parts, one level down.
    pub fn parts(&self) -> Vec<&Expr> {
        match self {
            Expr::Sum(members) | Expr::Product(members) => members.iter().map(|(_, member)| member).collect(),
            Expr::Power(pair) | Expr::Compare(_, pair) => vec![&pair.0, &pair.1],
            Expr::Call(_, members) | Expr::And(members) | Expr::Or(members) => members.iter().collect(),
            Expr::Choice(pieces, otherwise) => {
                let pieces = pieces.iter().flat_map(|(condition, value)| [condition, value]);
                pieces.chain([&**otherwise]).collect()
            }
            Expr::Not(inner) => vec![inner],
            Expr::Pulse(pulse) => pulse.iter().collect(),
            Expr::Number(..) | Expr::Pi | Expr::Time | Expr::Name(_) | Expr::Argument(_) | Expr::Truth(_) => Vec::new(),
        }
    }

    /// The same with other leaves: `leaf` gives what takes the place of a part without parts, of a pulse or of what something
    /// was, `None` to keep it.
    pub fn map(&self, leaf: &mut dyn FnMut(&Expr) -> Option<Expr>) -> Expr {
        let pairs = |members: &[(bool, Expr)], leaf: &mut dyn FnMut(&Expr) -> Option<Expr>| {
            members.iter().map(|(sign, member)| (*sign, member.map(leaf))).collect::<Vec<_>>()
        };
        match self {
            Expr::Sum(members) => Expr::sum(pairs(members, leaf)),
            Expr::Product(members) => Expr::product(pairs(members, leaf)),
            Expr::Power(pair) => Expr::Power(Box::new((pair.0.map(leaf), pair.1.map(leaf)))),
            Expr::Compare(relation, pair) => Expr::compare(*relation, pair.0.map(leaf), pair.1.map(leaf)),
            Expr::Call(callee, members) => {
                let past = if *callee == Callee::Past { leaf(self) } else { None };
                past.unwrap_or_else(|| Expr::Call(*callee, members.iter().map(|member| member.map(leaf)).collect()))
            }
            Expr::And(members) => Expr::And(members.iter().map(|member| member.map(leaf)).collect()),
            Expr::Or(members) => Expr::Or(members.iter().map(|member| member.map(leaf)).collect()),
            Expr::Not(inner) => inner.map(leaf).opposite(),
            Expr::Choice(pieces, otherwise) => {
                let pieces = pieces.iter().map(|(condition, value)| (condition.map(leaf), value.map(leaf))).collect();
                Expr::choice(pieces, otherwise.map(leaf))
            }
            Expr::Pulse(pulse) => leaf(self).unwrap_or_else(|| {
                let [height, start, width, period] = &**pulse;
                Expr::Pulse(Box::new([height.map(leaf), start.map(leaf), width.map(leaf), period.map(leaf)]))
            }),
            other => leaf(other).unwrap_or_else(|| other.clone()),
        }
    }

    /// Calls `visit` for itself and all its parts.
    pub fn each(&self, visit: &mut dyn FnMut(&Expr)) {
        visit(self);
        for part in self.parts() {
            part.each(visit);
        }
    }

    /// How deep it is nested, and how many parts it has.
    pub fn extent(&self) -> (usize, usize) {
        self.parts()
            .into_iter()
            .map(Expr::extent)
            .fold((1, 1), |(depth, size), (inner, parts)| (depth.max(inner + 1), size.saturating_add(parts)))
    }
}
