//! Constant expressions of integers: widths of ports, values of generics.

use pe_ir::source::Span;

/// An expression with its place.
#[derive(Clone, Debug)]
pub struct Term {
    /// What it is.
    pub node: Node,
    /// Where it is.
    pub span: Span,
}

/// What a [`Term`] is.
#[derive(Clone, Debug)]
pub enum Node {
    /// An integer.
    Number(i64),
    /// A name, with the names before it that are joined by points.
    Name(Vec<String>),
    /// An operator before an operand.
    Unary(Unary, Box<Term>),
    /// An operator between operands.
    Binary(Binary, Box<Term>, Box<Term>),
    /// The least or greatest of two.
    Extreme(bool, Box<Term>, Box<Term>),
    /// Anything else.
    Other,
}

/// Operators before an operand.
#[derive(Clone, Copy, Debug)]
pub enum Unary {
    /// Nothing.
    Plus,
    /// Another sign.
    Minus,
    /// Without sign.
    Abs,
}

/// Operators between operands.
#[derive(Clone, Copy, Debug)]
pub enum Binary {
    /// Sum.
    Plus,
    /// Difference.
    Minus,
    /// Product.
    Times,
    /// Quotient, towards zero.
    Divide,
    /// Remainder with the sign of the second.
    Mod,
    /// Remainder with the sign of the first.
    Rem,
    /// Power.
    Power,
}

/// Value of an expression.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Value {
    /// An integer.
    Integer(i64),
    /// True or false.
    Boolean(bool),
}

/// Why an expression has no value, and where.
pub type Fault = (Span, String);

/// What a name stands for: none if nobody knows.
pub type Names<'a> = dyn Fn(&[String]) -> Option<Result<Value, Fault>> + 'a;

impl Term {
    /// Its value.
    pub fn value(&self, names: &Names) -> Result<Value, Fault> {
        if let Node::Name(path) = &self.node {
            match (names(path), path.join(".").to_lowercase().as_str()) {
                (Some(value), _) => return value,
                (None, "true") => return Ok(Value::Boolean(true)),
                (None, "false") => return Ok(Value::Boolean(false)),
                (None, _) => return Err((self.span, format!("`{}` has no value that is known here", path.join(".")))),
            }
        }
        self.number(names).map(Value::Integer)
    }

    /// Its value, an integer.
    pub fn number(&self, names: &Names) -> Result<i64, Fault> {
        let large = || (self.span, "number too large".to_owned());
        match &self.node {
            Node::Number(number) => Ok(*number),
            Node::Name(path) => match self.value(names)? {
                Value::Integer(number) => Ok(number),
                Value::Boolean(_) => Err((self.span, format!("`{}` is no integer", path.join(".")))),
            },
            Node::Unary(operator, operand) => {
                let operand = operand.number(names)?;
                let result = match operator {
                    Unary::Plus => Some(operand),
                    Unary::Minus => operand.checked_neg(),
                    Unary::Abs => operand.checked_abs(),
                };
                result.ok_or_else(large)
            }
            Node::Binary(operator, first, second) => {
                let [a, b] = [first.number(names)?, second.number(names)?];
                if b == 0 && matches!(operator, Binary::Divide | Binary::Mod | Binary::Rem) {
                    return Err((self.span, "division by zero".to_owned()));
                }
                let result = match operator {
                    Binary::Plus => a.checked_add(b),
                    Binary::Minus => a.checked_sub(b),
                    Binary::Times => a.checked_mul(b),
                    Binary::Divide => a.checked_div(b),
                    Binary::Rem => a.checked_rem(b),
                    Binary::Mod => {
                        a.checked_rem(b).map(|rest| if rest != 0 && (rest < 0) != (b < 0) { rest + b } else { rest })
                    }
                    Binary::Power if b < 0 => return Err((second.span, "negative exponent".to_owned())),
                    Binary::Power => u32::try_from(b).ok().and_then(|b| a.checked_pow(b)),
                };
                result.ok_or_else(large)
            }
            Node::Extreme(greatest, first, second) => {
                let [a, b] = [first.number(names)?, second.number(names)?];
                Ok(if *greatest { a.max(b) } else { a.min(b) })
            }
            Node::Other => Err((self.span, "no constant expression of integers".to_owned())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(number: i64) -> Box<Term> {
        Box::new(Term { node: Node::Number(number), span: Span::default() })
    }

    fn binary(operator: Binary, a: i64, b: i64) -> Result<i64, String> {
        let term = Term { node: Node::Binary(operator, number(a), number(b)), span: Span::default() };
        term.number(&|_| None).map_err(|(_, message)| message)
    }

    #[test]
    fn operators_are_those_of_vhdl() {
        assert_eq!([binary(Binary::Divide, -7, 2), binary(Binary::Rem, -7, 2)], [Ok(-3), Ok(-1)]);
        assert_eq!(
            [binary(Binary::Mod, -7, 3), binary(Binary::Mod, 7, -3), binary(Binary::Mod, -6, 3)],
            [Ok(2), Ok(-2), Ok(0)]
        );
        assert_eq!([binary(Binary::Power, 2, 10), binary(Binary::Power, 0, 0)], [Ok(1024), Ok(1)]);
        for (operator, a, b) in [
            (Binary::Divide, 1, 0),
            (Binary::Mod, 1, 0),
            (Binary::Power, 2, -1),
            (Binary::Power, 2, 64),
            (Binary::Times, i64::MAX, 2),
            (Binary::Divide, i64::MIN, -1),
        ] {
            assert!(binary(operator, a, b).is_err(), "{a} {operator:?} {b}");
        }
    }
}
