//! Expressions: sums, products, powers, functions and choices as a spec has them, and exactly the tree that was
//! printed.
//!
//! A minus sign belongs to the number behind it; in front of anything else it is read as a factor of -1. `1/x` is the
//! reciprocal, `a/b` a product with one, `(1)/b` a product of the number one; `x^3` is an integer power and `x^(0.5)`
//! any other; sums and products of fewer than two members have a name, `sum(x)`.

use std::fmt::Write;

use crate::model::{Expr, Function, Select, Variable};

use super::{Line, TextError, number};

/// Deepest nesting that is read.
const DEEPEST: usize = 400;

/// How tightly an expression has to bind where it stands.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
enum Rank {
    Choice,
    Sum,
    Product,
    Power,
    Primary,
}

fn rank(expr: &Expr) -> Rank {
    match expr {
        Expr::Select(_) => Rank::Choice,
        Expr::Sum(members) if members.len() > 1 => Rank::Sum,
        Expr::Product(members) if members.len() > 1 => Rank::Product,
        Expr::Apply(Function::Reciprocal, _) => Rank::Product,
        Expr::Constant(number) if number.is_sign_negative() => Rank::Product,
        Expr::Power(..) | Expr::Apply(Function::RealPower(_), _) => Rank::Power,
        _ => Rank::Primary,
    }
}

/// The text of an expression; `variable` gives those of variables.
pub fn print(expr: &Expr, variable: &dyn Fn(Variable) -> String) -> String {
    let mut text = String::new();
    Printer { text: &mut text, variable }.at(expr, Rank::Choice);
    text
}

struct Printer<'a> {
    text: &'a mut String,
    variable: &'a dyn Fn(Variable) -> String,
}

impl Printer<'_> {
    fn push(&mut self, text: &str) {
        self.text.push_str(text);
    }

    fn at(&mut self, expr: &Expr, least: Rank) {
        if rank(expr) < least {
            self.push("(");
            self.expr(expr);
            self.push(")");
        } else {
            self.expr(expr);
        }
    }

    fn list(&mut self, name: &str, members: &[Expr]) {
        self.push(name);
        self.push("(");
        for member in members {
            self.at(member, Rank::Choice);
        }
        self.push(")");
    }

    fn expr(&mut self, expr: &Expr) {
        match expr {
            Expr::Constant(constant) => self.push(&number(*constant)),
            Expr::Variable(variable) => {
                let name = (self.variable)(*variable);
                self.push(&name);
            }
            Expr::Sum(members) if members.len() < 2 => self.list("sum", members),
            Expr::Product(members) if members.len() < 2 => self.list("product", members),
            Expr::Sum(members) => {
                for (index, member) in members.iter().enumerate() {
                    let begin = self.text.len();
                    self.at(member, Rank::Product);
                    if index == 0 {
                        continue;
                    }
                    // `a - 3*b` is the sum of `a` and `-3*b`.
                    if self.text[begin..].starts_with('-') {
                        self.text.replace_range(begin..=begin, " - ");
                    } else {
                        self.text.insert_str(begin, " + ");
                    }
                }
            }
            Expr::Product(members) => {
                for (index, member) in members.iter().enumerate() {
                    match member {
                        Expr::Apply(Function::Reciprocal, divisor) if index > 0 => {
                            self.push("/");
                            self.at(divisor, Rank::Power);
                        }
                        Expr::Apply(Function::Reciprocal, divisor) => {
                            self.push("1/");
                            self.at(divisor, Rank::Power);
                        }
                        // What follows it would be read as what one is divided by.
                        Expr::Constant(1.0) if index == 0 => self.push("(1)"),
                        Expr::Constant(constant) => {
                            self.push(if index > 0 { "*" } else { "" });
                            self.push(&number(*constant));
                        }
                        member => {
                            self.push(if index > 0 { "*" } else { "" });
                            self.at(member, Rank::Power);
                        }
                    }
                }
            }
            Expr::Power(base, exponent) => {
                self.at(base, Rank::Primary);
                _ = write!(self.text, "^{exponent}");
            }
            Expr::Apply(Function::Reciprocal, divisor) => {
                self.push("1/");
                self.at(divisor, Rank::Power);
            }
            Expr::Apply(Function::RealPower(exponent), base) => {
                self.at(base, Rank::Primary);
                _ = write!(self.text, "^({})", number(*exponent));
            }
            Expr::Apply(function, argument) => self.list(function.name(), std::slice::from_ref(argument)),
            Expr::Select(select) => {
                self.push("if ");
                self.at(&select.condition, Rank::Sum);
                self.push(" > 0 then ");
                self.at(&select.yes, Rank::Sum);
                self.push(" else ");
                self.at(&select.no, Rank::Sum);
            }
            // Of a whole equation, which the model prints in its own way.
            Expr::Solution(solution) => _ = write!(self.text, "solution {}", solution.row),
        }
    }
}

/// Reads an expression; `variable` finds a variable by its name.
///
/// # Errors
/// There is none, or it reads an unknown variable.
pub fn read(line: &mut Line, variable: &dyn Fn(&str) -> Option<Variable>) -> Result<Expr, TextError> {
    Reader { line, variable, depth: 0 }.choice()
}

struct Reader<'a, 'b> {
    line: &'a mut Line<'b>,
    variable: &'a dyn Fn(&str) -> Option<Variable>,
    depth: usize,
}

impl Reader<'_, '_> {
    fn choice(&mut self) -> Result<Expr, TextError> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(self.line.expected(format!("an expression that is nested at most {DEEPEST} deep")));
        }
        let expr = if self.line.take_word("if") { self.select()? } else { self.sum()? };
        self.depth -= 1;
        Ok(expr)
    }

    fn select(&mut self) -> Result<Expr, TextError> {
        let condition = self.sum()?;
        self.line.sign(">")?;
        self.line.word("0")?;
        self.line.word("then")?;
        let yes = self.sum()?;
        self.line.word("else")?;
        let no = self.sum()?;
        Ok(Expr::Select(Box::new(Select { condition, yes, no })))
    }

    fn sum(&mut self) -> Result<Expr, TextError> {
        let minus = self.line.take_sign("-");
        let mut members = vec![self.product(minus)?];
        loop {
            let minus = self.line.take_sign("-");
            if !minus && !self.line.take_sign("+") {
                break;
            }
            let minus = minus || self.line.take_sign("-");
            members.push(self.product(minus)?);
        }
        Ok(if members.len() == 1 { members.remove(0) } else { Expr::Sum(members) })
    }

    /// A product. A minus sign in front of it belongs to its first number, or stands for the factor -1.
    fn product(&mut self, minus: bool) -> Result<Expr, TextError> {
        let is_scaled = minus && !self.line.has_digits();
        let first = if is_scaled {
            Expr::Constant(-1.0)
        } else if minus {
            Expr::Constant(-self.line.magnitude()?)
        } else if self.line.has_digits() {
            let text = self.line.rest();
            let magnitude = self.line.magnitude()?;
            let is_one = text.strip_prefix('1').is_some_and(|rest| rest.trim_start().starts_with('/'));
            if is_one {
                self.line.sign("/")?;
                Expr::Apply(Function::Reciprocal, Box::new(self.power()?))
            } else {
                self.raised(Expr::Constant(magnitude))?
            }
        } else {
            self.power()?
        };
        let mut members = vec![first];
        if is_scaled {
            members.push(self.power()?);
        }
        loop {
            if self.line.take_sign("*") {
                let minus = self.line.take_sign("-");
                members.push(if minus { Expr::Constant(-self.line.magnitude()?) } else { self.power()? });
            } else if self.line.take_sign("/") {
                members.push(Expr::Apply(Function::Reciprocal, Box::new(self.power()?)));
            } else {
                break;
            }
        }
        Ok(if members.len() == 1 { members.remove(0) } else { Expr::Product(members) })
    }

    fn power(&mut self) -> Result<Expr, TextError> {
        let base = self.primary()?;
        self.raised(base)
    }

    fn raised(&mut self, base: Expr) -> Result<Expr, TextError> {
        if !self.line.take_sign("^") {
            return Ok(base);
        }
        if self.line.take_sign("(") {
            let exponent = self.line.number()?;
            self.line.sign(")")?;
            return Ok(Expr::Apply(Function::RealPower(exponent), Box::new(base)));
        }
        match self.line.integer()? {
            exponent @ 2.. => Ok(Expr::Power(Box::new(base), exponent)),
            _ => Err(self.line.error("expected an exponent of at least 2, or one in parentheses")),
        }
    }

    fn primary(&mut self) -> Result<Expr, TextError> {
        if self.line.has_digits() {
            return self.line.magnitude().map(Expr::Constant);
        }
        if self.line.take_sign("(") {
            let inside = self.choice()?;
            self.line.sign(")")?;
            return Ok(inside);
        }
        let is_quoted = self.line.rest().starts_with('"');
        let name = self.line.name("an expression")?;
        if is_quoted || !self.line.rest().starts_with('(') {
            let variable = (self.variable)(&name).map(Expr::Variable);
            return variable.ok_or_else(|| self.line.error(format!("no variable is called `{name}`")));
        }
        let function = Function::NAMED.into_iter().find(|function| function.name() == name);
        if function.is_none() && name != "sum" && name != "product" {
            return Err(self.line.error(format!("no function is called `{name}`")));
        }
        self.line.sign("(")?;
        let inside =
            if function.is_none() && self.line.rest().starts_with(')') { Vec::new() } else { vec![self.choice()?] };
        self.line.sign(")")?;
        Ok(match function {
            Some(function) => Expr::Apply(function, Box::new(inside.into_iter().next().expect("read above"))),
            None if name == "sum" => Expr::Sum(inside),
            None => Expr::Product(inside),
        })
    }
}
