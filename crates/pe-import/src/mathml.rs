//! Content MathML, as SBML and CellML have it.

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};
use roxmltree::Node;

use crate::expr::{Callee, Expr, Relation};
use crate::number;
use crate::xml::{child, elements, span, text};

/// Most parts of all expressions of a file together, after functions are put in place.
const MOST_PARTS: usize = 20_000_000;

/// What names mean, by format.
pub(crate) trait Scope {
    /// The value of `<ci>`.
    fn name(&mut self, id: &str, place: Node) -> Result<Expr, Diagnostic>;
    /// A call of a function of the model.
    fn call(&mut self, id: &str, arguments: Vec<Expr>, place: Node) -> Result<Expr, Diagnostic>;
    /// The value of `<csymbol>`.
    fn symbol(&mut self, url: &str, place: Node) -> Result<Expr, Diagnostic>;
    /// A call of `<csymbol>`.
    fn symbol_call(&mut self, url: &str, arguments: &[Node], place: Node) -> Result<Expr, Diagnostic>;
}

/// Reads expressions within a scope; findings are collected, and something takes the place of what is wrong.
pub(crate) struct Reader<'s> {
    pub scope: &'s mut dyn Scope,
    pub findings: &'s mut Vec<Diagnostic>,
    pub parts: &'s mut usize,
}

impl Reader<'_> {
    /// The number that a `<math>` element or an expression stands for.
    pub fn number(&mut self, node: Node) -> Expr {
        self.read(node).into_number()
    }

    /// The condition that it stands for.
    pub fn condition(&mut self, node: Node) -> Expr {
        self.read(node).into_condition()
    }

    /// Either.
    pub fn read(&mut self, node: Node) -> Expr {
        let result = self.expression(node);
        result.unwrap_or_else(|finding| {
            self.findings.push(finding);
            Expr::number(1.0)
        })
    }

    fn expression(&mut self, node: Node) -> Result<Expr, Diagnostic> {
        *self.parts += 1;
        if *self.parts > MOST_PARTS {
            return Err(Diagnostic::error(codes::IMPORT_LIMIT, span(node), "the expressions of the file are too long"));
        }
        match node.tag_name().name() {
            "math" | "semantics" => match elements(node).find(|child| child.tag_name().name() != "annotation") {
                Some(inner) => self.expression(inner),
                None => Err(bad(node, "there is no expression in it")),
            },
            "cn" => cn(node),
            "ci" => self.scope.name(&text(node), node),
            "csymbol" => self.scope.symbol(url(node), node),
            "pi" => Ok(Expr::Pi),
            "exponentiale" => Ok(Expr::call("exp", vec![Expr::number(1.0)])),
            "true" => Ok(Expr::Truth(true)),
            "false" => Ok(Expr::Truth(false)),
            "infinity" | "notanumber" => {
                let message = format!("`<{}/>` is no number that a spec can hold", node.tag_name().name());
                Err(Diagnostic::error(codes::IMPORT_NUMBER, span(node), message))
            }
            "piecewise" => self.piecewise(node),
            "apply" => self.apply(node),
            other => Err(bad(node, &format!("`<{other}>` is not known here"))),
        }
    }

    fn piecewise(&mut self, node: Node) -> Result<Expr, Diagnostic> {
        let mut pieces = Vec::new();
        let mut otherwise = None;
        for part in elements(node) {
            let inner: Vec<Node> = elements(part).collect();
            match (part.tag_name().name(), &inner[..]) {
                ("piece", [value, condition]) => pieces.push((self.condition(*condition), self.read(*value))),
                ("otherwise", [value]) => otherwise = Some(self.read(*value)),
                _ => return Err(bad(part, "it is no piece of a choice")),
            }
        }
        // Where nothing else is said, the last piece holds in all cases that are left only if its condition is known to.
        let Some(mut otherwise) = otherwise.or_else(|| match pieces.last() {
            Some((Expr::Truth(true), value)) => Some(value.clone()),
            _ => None,
        }) else {
            let finding = bad(node, "there is no value where no condition holds");
            return Err(finding.with_help("add `<otherwise>`"));
        };
        if pieces.iter().any(|(_, value)| !value.is_condition()) || !otherwise.is_condition() {
            pieces = pieces.into_iter().map(|(condition, value)| (condition, value.into_number())).collect();
            otherwise = otherwise.into_number();
        }
        Ok(Expr::choice(pieces, otherwise))
    }

    fn apply(&mut self, node: Node) -> Result<Expr, Diagnostic> {
        let mut children = elements(node);
        let Some(operator) = children.next() else { return Err(bad(node, "nothing is applied in it")) };
        let inner: Vec<Node> = children.collect();
        let name = operator.tag_name().name();
        match name {
            "ci" => {
                let arguments = inner.iter().map(|argument| self.read(*argument)).collect();
                return self.scope.call(&text(operator), arguments, node);
            }
            "csymbol" => return self.scope.symbol_call(url(operator), &inner, node),
            "diff" => return self.scope.symbol_call("diff", &inner, node),
            _ => {}
        }
        let qualifier = |name: &str| inner.iter().find(|child| child.tag_name().name() == name).copied();
        let (degree, base) = (qualifier("degree"), qualifier("logbase"));
        let plain = inner.iter().filter(|child| !["degree", "logbase"].contains(&child.tag_name().name()));
        let arguments: Vec<Expr> = plain.map(|argument| self.read(*argument)).collect();
        let qualified = |reader: &mut Self, node: Option<Node>| {
            node.and_then(|node| elements(node).next()).map(|inner| reader.number(inner))
        };
        let (degree, base) = (qualified(self, degree), qualified(self, base));
        match name {
            "root" => match (only(arguments, node)?, degree) {
                (radicand, None) => Ok(Expr::call("sqrt", vec![radicand])),
                (radicand, Some(degree)) if degree.literal() == Some(2.0) => Ok(Expr::call("sqrt", vec![radicand])),
                (radicand, Some(degree)) => Ok(radicand.power(Expr::number(1.0).over(degree))),
            },
            "log" => match (only(arguments, node)?, base) {
                (argument, None) => Ok(Expr::call("log10", vec![argument])),
                (argument, Some(base)) if base.literal() == Some(10.0) => Ok(Expr::call("log10", vec![argument])),
                (argument, Some(base)) if base.literal() == Some(2.0) => Ok(Expr::call("log2", vec![argument])),
                (argument, Some(base)) => Ok(Expr::call("log", vec![argument]).over(Expr::call("log", vec![base]))),
            },
            name => operation(name, arguments).map_err(|problem| bad(node, &problem)),
        }
    }
}

/// A finding about an element.
pub(crate) fn bad(node: Node, problem: &str) -> Diagnostic {
    let message = format!("`<{}>` cannot be read: {problem}", node.tag_name().name());
    Diagnostic::error(codes::IMPORT_MATH, span(node), message)
}

/// The place of an element.
pub(crate) fn place(node: Node) -> Span {
    span(node)
}

fn url<'a>(node: Node<'a, '_>) -> &'a str {
    node.attribute("definitionURL").unwrap_or("").trim()
}

fn only(mut arguments: Vec<Expr>, node: Node) -> Result<Expr, Diagnostic> {
    match arguments.len() {
        1 => Ok(arguments.remove(0).into_number()),
        count => Err(bad(node, &format!("it has {count} arguments and takes 1"))),
    }
}

/// A number.
fn cn(node: Node) -> Result<Expr, Diagnostic> {
    let written = text(node);
    let second = child(node, "sep").and_then(|sep| sep.next_sibling()).and_then(|next| next.text()).unwrap_or("");
    let first = node.first_child().and_then(|first| first.text()).unwrap_or("");
    let number = match node.attribute("type").unwrap_or("real") {
        "e-notation" => number::with_exponent(first, second),
        "rational" => match (number::literal(first), number::literal(second)) {
            (Some(above), Some(below)) if below.literal() != Some(0.0) => Some(above.over(below)),
            _ => None,
        },
        _ => number::literal(&written),
    };
    number.ok_or_else(|| {
        Diagnostic::error(codes::IMPORT_NUMBER, span(node), format!("`{}` is no finite number", written.escape_debug()))
    })
}

/// What an operator makes of its arguments; the problem in words if it cannot.
pub(crate) fn operation(name: &str, arguments: Vec<Expr>) -> Result<Expr, String> {
    let relation = match name {
        "eq" => Some(Relation::Equal),
        "neq" => Some(Relation::NotEqual),
        "lt" => Some(Relation::Less),
        "leq" => Some(Relation::LessEqual),
        "gt" => Some(Relation::Greater),
        "geq" => Some(Relation::GreaterEqual),
        _ => None,
    };
    if let Some(relation) = relation {
        return Ok(related(relation, arguments));
    }
    match name {
        "and" | "or" | "xor" | "not" | "implies" => {
            return logic(name, arguments.into_iter().map(Expr::into_condition).collect());
        }
        _ => {}
    }
    let arguments: Vec<Expr> = arguments.into_iter().map(Expr::into_number).collect();
    match (name, arguments.len()) {
        ("plus", _) => return Ok(Expr::sum(arguments.into_iter().map(|argument| (false, argument)))),
        ("times", _) => return Ok(Expr::product(arguments.into_iter().map(|argument| (false, argument)))),
        ("max" | "min", 1) => return Ok(arguments.into_iter().next().expect("one argument")),
        ("max", 2..) => return Ok(Expr::call("max", arguments)),
        ("min", 2..) => return Ok(Expr::call("min", arguments)),
        _ => {}
    }
    let count = arguments.len();
    let wrong = |takes: &str| Err(format!("it has {count} arguments and takes {takes}"));
    let mut arguments = arguments.into_iter();
    let (first, second) = (arguments.next(), arguments.next());
    match (name, first, second, count) {
        ("minus", Some(x), None, 1) => Ok(x.negated()),
        ("minus", Some(x), Some(y), 2) => Ok(Expr::sum([(false, x), (true, y)])),
        ("divide", Some(x), Some(y), 2) => Ok(x.over(y)),
        ("power", Some(x), Some(y), 2) => Ok(x.power(y)),
        ("quotient", Some(x), Some(y), 2) => Ok(Expr::call("quotient", vec![x, y])),
        ("rem", Some(x), Some(y), 2) => {
            let whole = Expr::call("quotient", vec![x.clone(), y.clone()]);
            Ok(Expr::sum([(false, x), (true, y.times(whole))]))
        }
        ("minus", ..) => wrong("1 or 2"),
        ("divide" | "power" | "quotient" | "rem", ..) => wrong("2"),
        ("factorial", Some(x), None, 1) => factorial(&x),
        (name, Some(x), None, 1) => one(name, x),
        ("max" | "min", None, ..) => wrong("at least 1"),
        (name, ..) if one(name, Expr::number(0.5)).is_ok() => wrong("1"),
        (name, ..) => Err(format!("`{name}` is not known")),
    }
}

fn factorial(x: &Expr) -> Result<Expr, String> {
    let value = x.literal().filter(|value| *value >= 0.0 && *value == value.trunc() && *value <= 170.0);
    let value = value.ok_or("`factorial` is known of whole numbers up to 170 only")?;
    Ok(Expr::number((1..=value as u32).fold(1.0, |product, factor| product * f64::from(factor))))
}

/// A function of one argument.
fn one(name: &str, x: Expr) -> Result<Expr, String> {
    let call = |name, x: Expr| Expr::call(name, vec![x]);
    let number = Expr::number;
    let over_one = |x: Expr| number(1.0).over(x);
    // x^2 + 1 and x^2 - 1 under the root.
    let root =
        |x: &Expr, minus: bool| call("sqrt", Expr::sum([(false, x.clone().power(number(2.0))), (minus, number(1.0))]));
    let arsinh = |x: Expr| call("log", Expr::sum([(false, x.clone()), (false, root(&x, false))]));
    let arcosh = |x: Expr| call("log", Expr::sum([(false, x.clone()), (false, root(&x, true))]));
    let artanh = |x: Expr| {
        let above = Expr::sum([(false, number(1.0)), (false, x.clone())]);
        let below = Expr::sum([(false, number(1.0)), (true, x)]);
        number(0.5).times(call("log", above.over(below)))
    };
    Ok(match name {
        "abs" => call("abs", x),
        "exp" => call("exp", x),
        "ln" => call("log", x),
        "floor" => call("floor", x),
        "ceiling" => call("ceil", x),
        "sin" => call("sin", x),
        "cos" => call("cos", x),
        "tan" => call("tan", x),
        "arcsin" => call("asin", x),
        "arccos" => call("acos", x),
        "arctan" => call("atan", x),
        "sinh" => call("sinh", x),
        "cosh" => call("cosh", x),
        "tanh" => call("tanh", x),
        "sec" => over_one(call("cos", x)),
        "csc" => over_one(call("sin", x)),
        "cot" => over_one(call("tan", x)),
        "sech" => over_one(call("cosh", x)),
        "csch" => over_one(call("sinh", x)),
        "coth" => over_one(call("tanh", x)),
        "arcsec" => call("acos", over_one(x)),
        "arccsc" => call("asin", over_one(x)),
        "arccot" => call("atan", over_one(x)),
        "arcsinh" => arsinh(x),
        "arccosh" => arcosh(x),
        "arctanh" => artanh(x),
        "arccsch" => arsinh(over_one(x)),
        "arcsech" => arcosh(over_one(x)),
        "arccoth" => artanh(over_one(x)),
        name => return Err(format!("`{name}` is not known")),
    })
}

/// A chain of comparisons, each with its neighbour.
fn related(relation: Relation, arguments: Vec<Expr>) -> Expr {
    let conditions = arguments.iter().any(Expr::is_condition);
    let pairs = arguments.windows(2).map(|pair| {
        let (left, right) = (pair[0].clone(), pair[1].clone());
        if conditions && matches!(relation, Relation::Equal | Relation::NotEqual) {
            let differ = differ(left.into_condition(), right.into_condition());
            if relation == Relation::Equal { differ.opposite() } else { differ }
        } else {
            Expr::compare(relation, left.into_number(), right.into_number())
        }
    });
    Expr::all(pairs.collect())
}

/// Exactly one of two conditions.
fn differ(left: Expr, right: Expr) -> Expr {
    match (left, right) {
        (Expr::Truth(true), other) | (other, Expr::Truth(true)) => other.opposite(),
        (Expr::Truth(false), other) | (other, Expr::Truth(false)) => other,
        (left, right) => Expr::any(vec![
            Expr::all(vec![left.clone(), right.clone().opposite()]),
            Expr::all(vec![left.opposite(), right]),
        ]),
    }
}

fn logic(name: &str, arguments: Vec<Expr>) -> Result<Expr, String> {
    // What is known goes: a neutral member, or all others.
    let joined = |arguments: Vec<Expr>, neutral: bool| {
        if arguments.contains(&Expr::Truth(!neutral)) {
            return Expr::Truth(!neutral);
        }
        let left = arguments.into_iter().filter(|member| *member != Expr::Truth(neutral)).collect();
        if neutral { Expr::all(left) } else { Expr::any(left) }
    };
    match (name, arguments.len()) {
        ("and", _) => Ok(joined(arguments, true)),
        ("or", _) => Ok(joined(arguments, false)),
        ("xor", _) => Ok(arguments.into_iter().fold(Expr::Truth(false), differ)),
        ("not", 1) => Ok(arguments.into_iter().next().expect("one argument").opposite()),
        ("implies", 2) => {
            let mut members = arguments.into_iter();
            let first = members.next().expect("two arguments").opposite();
            Ok(joined(std::iter::once(first).chain(members).collect(), false))
        }
        (_, count) => Err(format!("it has {count} arguments")),
    }
}

/// Puts arguments in place of those of a function.
pub(crate) fn inlined(body: &Expr, arguments: &[Expr]) -> Expr {
    body.map(&mut |leaf| {
        let Expr::Argument(argument) = leaf else { return None };
        Some(arguments[*argument].clone())
    })
}

/// Whether a body uses a function by name.
pub(crate) fn calls(body: &Expr, names: &[&str]) -> bool {
    let mut found = false;
    body.each(&mut |part| {
        found |= matches!(part, Expr::Call(Callee::Language(name), _) if names.contains(name));
    });
    found
}
