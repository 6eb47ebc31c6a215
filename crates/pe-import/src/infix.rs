//! Expressions as they are written in lines: Myokit's and DiffSL's.

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

use crate::expr::{Expr, Relation};
use crate::mathml::operation;
use crate::number;

/// Deepest nesting of brackets.
const DEEPEST: usize = 150;

/// A name in an expression that was just read: [`Expr::Name`] holds its place in the list.
#[derive(Clone, Debug)]
pub(crate) struct Reference {
    /// The name, with dots.
    pub name: String,
    /// Whether its derivative is meant.
    pub is_rate: bool,
    /// Where it stands.
    pub span: Span,
}

/// Reads expressions from a text at a position.
pub(crate) struct Infix<'t> {
    pub text: &'t str,
    pub at: usize,
    /// Names that were read.
    pub references: Vec<Reference>,
    /// What begins a comment.
    comment: &'static str,
    /// Names of functions, each with what it is in the terms of MathML.
    functions: &'static [(&'static str, &'static str)],
    /// Whether line ends are blanks outside of brackets, too.
    is_free: bool,
    /// Brackets that are open, and nesting of all kinds.
    brackets: usize,
    depth: usize,
}

type Read = Result<Expr, Diagnostic>;

impl<'t> Infix<'t> {
    pub fn new(
        text: &'t str,
        at: usize,
        comment: &'static str,
        functions: &'static [(&'static str, &'static str)],
        is_free: bool,
    ) -> Self {
        Infix { text, at, references: Vec::new(), comment, functions, is_free, brackets: 0, depth: 0 }
    }

    /// Skips blanks, line ends within brackets, and comments.
    pub fn blanks(&mut self) {
        loop {
            let rest = &self.text[self.at..];
            if rest.starts_with(self.comment) {
                self.at += rest.find('\n').unwrap_or(rest.len());
            } else if rest.starts_with("\\\n") || rest.starts_with("\\\r\n") {
                self.at += rest.find('\n').unwrap_or(0) + 1;
            } else {
                match rest.chars().next() {
                    Some('\n') if self.brackets == 0 && !self.is_free => return,
                    Some(blank) if blank.is_whitespace() => self.at += blank.len_utf8(),
                    _ => return,
                }
            }
        }
    }

    /// Takes a sign if it stands here.
    pub fn take(&mut self, sign: &str) -> bool {
        self.blanks();
        let found = self.text[self.at..].starts_with(sign);
        if found {
            self.at += sign.len();
        }
        found
    }

    /// The word that stands here, without taking it.
    pub fn word(&mut self) -> &'t str {
        self.blanks();
        let rest = &self.text[self.at..];
        let is_first = rest.starts_with(|first: char| first.is_alphabetic() || first == '_');
        let end = rest.find(|letter: char| !letter.is_alphanumeric() && letter != '_').unwrap_or(rest.len());
        if is_first { &rest[..end] } else { "" }
    }

    fn keyword(&mut self, keyword: &str) -> bool {
        let found = self.word() == keyword;
        if found {
            self.at += keyword.len();
        }
        found
    }

    /// A finding at the position.
    pub fn wrong(&self, problem: &str) -> Diagnostic {
        let end = self.text[self.at..].chars().next().map_or(self.at, |letter| self.at + letter.len_utf8());
        Diagnostic::error(codes::IMPORT_MATH, Span::of(self.at, end), problem)
    }

    /// An expression.
    pub fn expression(&mut self) -> Read {
        let mut left = self.comparison()?;
        loop {
            let name = if self.keyword("and") || self.take("&&") {
                "and"
            } else if self.keyword("or") || self.take("||") {
                "or"
            } else {
                return Ok(left);
            };
            let right = self.comparison()?;
            left = self.operation(name, vec![left, right])?;
        }
    }

    fn operation(&self, name: &str, arguments: Vec<Expr>) -> Read {
        operation(name, arguments).map_err(|problem| self.wrong(&problem))
    }

    fn comparison(&mut self) -> Read {
        if self.keyword("not") {
            let inner = self.nested(Self::comparison)?;
            return Ok(inner.into_condition().opposite());
        }
        let left = self.sum()?;
        let relations = [
            ("==", Relation::Equal),
            ("!=", Relation::NotEqual),
            ("<=", Relation::LessEqual),
            (">=", Relation::GreaterEqual),
            ("<", Relation::Less),
            (">", Relation::Greater),
        ];
        for (sign, relation) in relations {
            if self.take(sign) {
                let right = self.sum()?;
                return Ok(Expr::compare(relation, left, right));
            }
        }
        Ok(left)
    }

    fn sum(&mut self) -> Read {
        let mut members = vec![(false, self.product()?)];
        loop {
            let negative = if self.take("+") {
                false
            } else if self.take("-") {
                true
            } else {
                return Ok(if members.len() == 1 { members.remove(0).1 } else { Expr::sum(members) });
            };
            members.push((negative, self.product()?));
        }
    }

    fn product(&mut self) -> Read {
        let mut left = self.prefixed()?;
        loop {
            left = if self.take("//") {
                let quotient = left.over(self.prefixed()?);
                Expr::call("floor", vec![quotient])
            } else if self.take("*") {
                left.times(self.prefixed()?)
            } else if self.take("/") {
                left.over(self.prefixed()?)
            } else if self.take("%") {
                let right = self.prefixed()?;
                Expr::call("mod", vec![left, right])
            } else {
                return Ok(left);
            }
        }
    }

    fn nested(&mut self, read: fn(&mut Self) -> Read) -> Read {
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

    fn prefixed(&mut self) -> Read {
        if self.take("-") {
            return Ok(self.nested(Self::prefixed)?.negated());
        }
        if self.take("+") {
            return self.nested(Self::prefixed);
        }
        let mut base = self.primary()?;
        while self.take("^") {
            let exponent = if self.take("-") { self.primary()?.negated() } else { self.primary()? };
            base = base.power(exponent);
        }
        Ok(base)
    }

    fn primary(&mut self) -> Read {
        if self.take("(") {
            // Lines may end within brackets.
            self.brackets += 1;
            let inner = self.nested(Self::expression)?;
            self.blanks();
            self.brackets -= 1;
            return if self.take(")") { Ok(inner) } else { Err(self.wrong("a bracket is not closed")) };
        }
        let start = self.at;
        if self.text[start..].starts_with(|first: char| first.is_ascii_digit() || first == '.') {
            return self.number();
        }
        let word = self.word();
        if word.is_empty() {
            return Err(self.wrong("a number or a name is expected here"));
        }
        self.at += word.len();
        let mut name = word.to_owned();
        while self.text[self.at..].starts_with('.') {
            self.at += 1;
            let part = self.word();
            self.at += part.len();
            name = format!("{name}.{part}");
        }
        let span = Span::of(start, self.at);
        if !self.text[self.at..].trim_start_matches([' ', '\t']).starts_with('(') {
            self.references.push(Reference { name, is_rate: false, span });
            return Ok(Expr::Name(self.references.len() - 1));
        }
        self.call(&name, span)
    }

    fn number(&mut self) -> Read {
        let rest = &self.text[self.at..];
        let mut end = rest.find(|letter: char| !letter.is_ascii_digit() && letter != '.').unwrap_or(rest.len());
        if rest[end..].starts_with(['e', 'E']) {
            let sign = usize::from(rest[end + 1..].starts_with(['+', '-']));
            let digits = rest[end + 1 + sign..].bytes().take_while(u8::is_ascii_digit).count();
            if digits > 0 {
                end += 1 + sign + digits;
            }
        }
        let literal = number::literal(&rest[..end]).ok_or_else(|| {
            let span = Span::of(self.at, self.at + end);
            Diagnostic::error(codes::IMPORT_NUMBER, span, format!("`{}` is no finite number", &rest[..end]))
        })?;
        self.at += end;
        // `5 [mV]`: a unit says nothing about the value.
        let after = self.text[self.at..].trim_start_matches([' ', '\t']);
        if !self.is_free && after.starts_with('[') {
            let close = after.find(']').ok_or_else(|| self.wrong("the bracket of a unit is not closed"))?;
            self.at = self.text.len() - after.len() + close + 1;
        }
        Ok(literal)
    }

    fn call(&mut self, name: &str, span: Span) -> Read {
        self.take("(");
        let mut arguments = Vec::new();
        self.brackets += 1;
        while !self.take(")") {
            if !arguments.is_empty() && !self.take(",") {
                return Err(self.wrong("`,` or `)` is expected here"));
            }
            arguments.push(self.nested(Self::expression)?);
        }
        self.brackets -= 1;
        let wrong = |problem: String| Diagnostic::error(codes::IMPORT_MATH, span, problem);
        let count = arguments.len();
        match (name, count) {
            ("dot", 1) => {
                let Expr::Name(of) = arguments[0] else {
                    return Err(wrong("`dot` takes the name of a variable".to_owned()));
                };
                let inner = self.references[of].clone();
                self.references.push(Reference { is_rate: true, ..inner });
                Ok(Expr::Name(self.references.len() - 1))
            }
            ("if", 3) | ("piecewise", 3..) if count % 2 == 1 => {
                let otherwise = arguments.pop().expect("at least three").into_number();
                let mut members = arguments.into_iter();
                let mut pieces = Vec::new();
                while let (Some(condition), Some(value)) = (members.next(), members.next()) {
                    pieces.push((condition.into_condition(), value.into_number()));
                }
                Ok(Expr::choice(pieces, otherwise))
            }
            ("log", 2) => {
                let base = Expr::call("log", vec![arguments.pop().expect("two").into_number()]);
                Ok(Expr::call("log", vec![arguments.pop().expect("two").into_number()]).over(base))
            }
            ("log10" | "log2" | "sqrt", 1) => {
                let function = ["log10", "log2", "sqrt"].into_iter().find(|known| *known == name);
                let argument = arguments.pop().expect("one").into_number();
                Ok(Expr::call(function.expect("one of these"), vec![argument]))
            }
            ("sigmoid", 1) => {
                let argument = arguments.pop().expect("one").into_number();
                let below =
                    Expr::sum([(false, Expr::number(1.0)), (false, Expr::call("exp", vec![argument.negated()]))]);
                Ok(Expr::number(1.0).over(below))
            }
            ("heaviside", 1) => {
                let condition = Expr::compare(Relation::GreaterEqual, arguments.pop().expect("one"), Expr::number(0.0));
                Ok(condition.into_number())
            }
            _ => match self.functions.iter().find(|(known, _)| *known == name) {
                Some((_, meaning)) => operation(meaning, arguments).map_err(wrong),
                None => Err(wrong(format!("the function `{name}` is not known, or takes another number of arguments"))),
            },
        }
    }
}
