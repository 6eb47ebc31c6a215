//! Reads the text of a DiffSL model into tensors, each with its elements.

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

use crate::expr::Expr;
use crate::number;

/// Deepest nesting of brackets and calls.
const DEEPEST: usize = 150;

/// Largest number of an index.
const LARGEST_INDEX: usize = 1_000_000_000;

/// A tensor as it is written.
pub(super) struct Tensor {
    pub name: String,
    /// Its indices, a letter each.
    pub indices: Vec<char>,
    pub elements: Vec<Element>,
    pub span: Span,
}

/// An element: where it stands in its tensor if that is said, its label, and its value.
pub(super) struct Element {
    pub place: Option<Vec<Range>>,
    pub label: Option<String>,
    pub value: Node,
    pub span: Span,
}

/// Numbers along one dimension: one, or from the first to before the end.
#[derive(Clone, Copy)]
pub(super) struct Range {
    pub first: usize,
    pub end: Option<usize>,
    /// Whether it is written with `..`, for a diagonal.
    pub diagonal: bool,
}

/// An expression with its place.
pub(super) struct Node {
    pub kind: NodeKind,
    pub span: Span,
}

pub(super) enum NodeKind {
    Number(Expr),
    Name {
        name: String,
        indices: Vec<char>,
        /// What stands in square brackets: a number, or from one to before another.
        at: Option<(i64, Option<i64>)>,
    },
    Negated(Box<Node>),
    /// An operand, and those behind it, each with its `+`, `-`, `*` or `/`.
    Chain(Box<Node>, Vec<(char, Node)>),
    Call(String, Vec<Node>),
}

type Read<T> = Result<T, Diagnostic>;

/// The tensors of a text; what cannot be read is left out and found.
pub(super) fn tensors(text: &str, findings: &mut Vec<Diagnostic>) -> Vec<Tensor> {
    let mut parser = Parser { text, at: 0, depth: 0 };
    let mut tensors = Vec::new();
    loop {
        match parser.blanks() {
            Ok(()) if parser.at == text.len() => return tensors,
            Ok(()) => {}
            Err(finding) => {
                findings.push(finding);
                return tensors;
            }
        }
        match parser.tensor() {
            Ok(tensor) => tensors.push(tensor),
            Err(finding) => {
                findings.push(finding);
                // What follows the next brace is read as well.
                let rest = &text[parser.at..];
                parser.at = rest.find('}').map_or(text.len(), |end| parser.at + end + 1);
                parser.depth = 0;
            }
        }
    }
}

struct Parser<'t> {
    text: &'t str,
    at: usize,
    depth: usize,
}

impl<'t> Parser<'t> {
    fn rest(&self) -> &'t str {
        &self.text[self.at..]
    }

    fn wrong(&self, problem: &str) -> Diagnostic {
        let end = self.rest().chars().next().map_or(self.at, |letter| self.at + letter.len_utf8());
        Diagnostic::error(codes::IMPORT_SYNTAX, Span::of(self.at, end), problem)
    }

    /// Skips blanks and comments.
    fn blanks(&mut self) -> Read<()> {
        loop {
            let rest = self.rest();
            if rest.starts_with("//") {
                self.at += rest.find('\n').unwrap_or(rest.len());
            } else if rest.starts_with("/*") {
                let end = rest.find("*/").ok_or_else(|| self.wrong("a comment is not closed"))?;
                self.at += end + 2;
            } else if let Some(blank) = rest.chars().next().filter(|letter| letter.is_whitespace()) {
                self.at += blank.len_utf8();
            } else {
                return Ok(());
            }
        }
    }

    fn take(&mut self, sign: &str) -> Read<bool> {
        self.blanks()?;
        let found = self.rest().starts_with(sign);
        if found {
            self.at += sign.len();
        }
        Ok(found)
    }

    fn expect(&mut self, sign: &str) -> Read<()> {
        if self.take(sign)? { Ok(()) } else { Err(self.wrong(&format!("`{sign}` is expected here"))) }
    }

    /// Letters and digits that begin with a letter, without blanks before them; empty if there are none.
    fn name(&mut self) -> &'t str {
        let rest = self.rest();
        let end = rest.find(|letter: char| !letter.is_ascii_alphanumeric()).unwrap_or(rest.len());
        let name = if rest.starts_with(|first: char| first.is_ascii_alphabetic()) { &rest[..end] } else { "" };
        self.at += name.len();
        name
    }

    /// A name and the indices behind it.
    fn indexed(&mut self) -> Read<(String, Vec<char>)> {
        self.blanks()?;
        let name = self.name().to_owned();
        if name.is_empty() {
            return Err(self.wrong("a name is expected here"));
        }
        let mut indices = Vec::new();
        if self.rest().starts_with('_') {
            self.at += 1;
            indices = self.name().chars().collect();
            if indices.is_empty() {
                return Err(self.wrong("indices are expected behind `_`, a letter each"));
            }
        }
        Ok((name, indices))
    }

    fn tensor(&mut self) -> Read<Tensor> {
        let start = self.at;
        let (name, indices) = self.indexed()?;
        let span = Span::of(start, self.at);
        if name == "in" && self.take("=")? {
            let finding = Diagnostic::error(codes::IMPORT_SYNTAX, span, "inputs are given as a list of names");
            return Err(
                finding.with_help("write `in_i { k = 1.0 }`, as DiffSL does since its list of inputs was dropped")
            );
        }
        self.expect("{")?;
        let mut elements = Vec::new();
        while !self.take("}")? {
            if !elements.is_empty() {
                self.expect(",")?;
                if self.take("}")? {
                    break;
                }
            }
            elements.push(self.element()?);
        }
        if elements.is_empty() {
            let message = format!("`{name}` has no elements");
            return Err(Diagnostic::error(codes::IMPORT_SYNTAX, span, message));
        }
        Ok(Tensor { name, indices, elements, span })
    }

    fn element(&mut self) -> Read<Element> {
        self.blanks()?;
        let start = self.at;
        let place = self.place()?;
        self.blanks()?;
        let before = self.at;
        let word = self.name();
        let label = if !word.is_empty() && self.take("=")? {
            Some(word.to_owned())
        } else {
            self.at = before;
            None
        };
        self.blanks()?;
        let before = self.at;
        if self.name() == "read" && self.take("(")? {
            self.blanks()?;
            if self.rest().starts_with('\'') {
                let span = Span::of(before, self.at);
                let finding = Diagnostic::error(codes::IMPORT_UNSUPPORTED, span, "a tensor is read from another file");
                return Err(finding.with_help("write its entries into the model: `(0, 1): 0.5`"));
            }
        }
        self.at = before;
        let value = self.expression()?;
        Ok(Element { place, label, value, span: Span::of(start, self.at) })
    }

    /// `(0:3, 1):` in front of an element.
    fn place(&mut self) -> Read<Option<Vec<Range>>> {
        let start = self.at;
        let mut ranges = Vec::new();
        if self.take("(")? {
            while let Some(first) = self.whole()? {
                let diagonal = self.take("..")?;
                let end = if diagonal || self.take(":")? { self.whole()? } else { None };
                ranges.push(Range { first, end, diagonal });
                if !self.take(",")? {
                    break;
                }
            }
            if !ranges.is_empty() && self.take(")")? && self.take(":")? {
                return Ok(Some(ranges));
            }
        }
        self.at = start;
        Ok(None)
    }

    /// A number without a sign.
    fn whole(&mut self) -> Read<Option<usize>> {
        self.blanks()?;
        let digits = self.rest().bytes().take_while(u8::is_ascii_digit).count();
        let number = self.rest()[..digits].parse().ok().filter(|number| *number <= LARGEST_INDEX);
        if digits > 0 && number.is_none() {
            let message = "an index is too large";
            return Err(Diagnostic::error(codes::IMPORT_LIMIT, Span::of(self.at, self.at + digits), message));
        }
        self.at += digits;
        Ok(number)
    }

    fn nested<T>(&mut self, read: impl FnOnce(&mut Self) -> Read<T>) -> Read<T> {
        self.depth += 1;
        let result = if self.depth > DEEPEST {
            let message = format!("expressions are nested more than {DEEPEST} deep");
            Err(Diagnostic { code: codes::IMPORT_LIMIT, ..self.wrong(&message) })
        } else {
            read(self)
        };
        self.depth -= 1;
        result
    }

    /// Operands between any of two operators.
    fn chain(&mut self, signs: [char; 2], operand: fn(&mut Self) -> Read<Node>) -> Read<Node> {
        let first = operand(self)?;
        let mut others = Vec::new();
        loop {
            self.blanks()?;
            let Some(sign) = signs.into_iter().find(|sign| self.rest().starts_with(*sign)) else { break };
            self.at += 1;
            others.push((sign, operand(self)?));
        }
        let Some((_, last)) = others.last() else { return Ok(first) };
        let span = Span::of(first.span.range().start, last.span.range().end);
        Ok(Node { kind: NodeKind::Chain(Box::new(first), others), span })
    }

    fn expression(&mut self) -> Read<Node> {
        self.nested(|parser| parser.chain(['+', '-'], |parser| parser.chain(['*', '/'], Self::factor)))
    }

    fn factor(&mut self) -> Read<Node> {
        self.blanks()?;
        let start = self.at;
        if self.take("-")? {
            let inner = self.operand()?;
            return Ok(Node { kind: NodeKind::Negated(Box::new(inner)), span: Span::of(start, self.at) });
        }
        self.take("+")?;
        self.operand()
    }

    fn operand(&mut self) -> Read<Node> {
        if self.take("(")? {
            let inner = self.expression()?;
            self.expect(")")?;
            return Ok(inner);
        }
        let start = self.at;
        if self.rest().starts_with(|first: char| first.is_ascii_digit()) {
            return self.number();
        }
        if !self.rest().starts_with(|first: char| first.is_ascii_alphabetic()) {
            return Err(self.wrong("a number, a name or `(` is expected here"));
        }
        let (name, indices) = self.indexed()?;
        if indices.is_empty() && self.take("(")? {
            let mut arguments = vec![self.expression()?];
            while self.take(",")? {
                arguments.push(self.expression()?);
            }
            self.expect(")")?;
            return Ok(Node { kind: NodeKind::Call(name, arguments), span: Span::of(start, self.at) });
        }
        let mut end = self.at;
        // A bracket belongs to a name that it follows at once.
        let at = if self.text[end..].starts_with('[') {
            self.at = end + 1;
            let first = self.integer()?;
            let last = if self.take("..")? || self.take(":")? { Some(self.integer()?) } else { None };
            self.expect("]")?;
            end = self.at;
            Some((first, last))
        } else {
            self.at = end;
            None
        };
        Ok(Node { kind: NodeKind::Name { name, indices, at }, span: Span::of(start, end) })
    }

    fn number(&mut self) -> Read<Node> {
        let rest = self.rest();
        let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
        let mut end = digits(rest);
        if rest[end..].starts_with('.') && !rest[end..].starts_with("..") {
            end += 1 + digits(&rest[end + 1..]);
        }
        if rest[end..].starts_with('e') {
            let sign = usize::from(rest[end + 1..].starts_with(['+', '-']));
            let exponent = digits(&rest[end + 1 + sign..]);
            end += if exponent > 0 { 1 + sign + exponent } else { 0 };
        }
        let span = Span::of(self.at, self.at + end);
        let literal = number::literal(&rest[..end]).ok_or_else(|| {
            Diagnostic::error(codes::IMPORT_NUMBER, span, format!("`{}` is no finite number", &rest[..end]))
        })?;
        self.at += end;
        Ok(Node { kind: NodeKind::Number(literal), span })
    }

    /// An expression of whole numbers and of `N`, which is 0: the number of the system that runs at the beginning.
    fn integer(&mut self) -> Read<i64> {
        self.nested(|parser| {
            let mut sum = parser.integer_product()?;
            loop {
                let right = match parser.take("+")? {
                    true => parser.integer_product()?,
                    false if parser.take("-")? => parser.integer_product()?.saturating_neg(),
                    false => return Ok(sum),
                };
                sum = sum.checked_add(right).ok_or_else(|| parser.wrong("an index is too large"))?;
            }
        })
    }

    fn integer_product(&mut self) -> Read<i64> {
        let mut left = self.integer_factor()?;
        loop {
            self.blanks()?;
            let Some(sign) = self.rest().chars().next().filter(|sign| "*/%".contains(*sign)) else { return Ok(left) };
            self.at += 1;
            let right = self.integer_factor()?;
            left = match sign {
                '*' => left.checked_mul(right),
                '/' => left.checked_div(right),
                _ => left.checked_rem(right),
            }
            .ok_or_else(|| self.wrong("the index has no value"))?;
        }
    }

    fn integer_factor(&mut self) -> Read<i64> {
        if self.take("-")? {
            return Ok(self.nested(Self::integer_factor)?.saturating_neg());
        }
        self.take("+")?;
        if self.take("(")? {
            let inner = self.integer()?;
            self.expect(")")?;
            return Ok(inner);
        }
        if let Some(number) = self.whole()? {
            return i64::try_from(number).map_err(|_| self.wrong("an index is too large"));
        }
        let start = self.at;
        if self.name() == "N" {
            return Ok(0);
        }
        self.at = start;
        Err(self.wrong("a whole number or `N` is expected here"))
    }
}
