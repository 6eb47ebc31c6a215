//! Parses one statement at a time with pest and builds the syntax tree.
//!
//! The builders return `None` where a pair does not have the children that the grammar promises. That cannot happen;
//! if it does after a change of the grammar, it becomes a syntax error and not a panic.

use crate::report::Report;
use crate::syntax::ast::*;
use crate::syntax::delay;
use crate::syntax::errors::describe;
use crate::syntax::grammar::{OdeParser, Rule};
use crate::syntax::lexer::{Token, TokenKind};
use crate::syntax::operators::{PRECEDENCE, join};
use crate::syntax::statements::text_of;
use pe_ir::index::{at, number};
use pe_ir::source::{Diagnostic, Span};
use pe_ir::{codes, element};
use pest::Parser;
use pest::iterators::Pair;

mod braces;

/// Parses one statement; an error is reported and gives `None`.
pub(crate) fn parse_statement(text: &str, tokens: &[Token], report: &mut Report) -> Option<Statement> {
    let (first, last) = (tokens.first()?, tokens.last()?);
    let span = Span { start: first.span.start, end: last.span.end };
    let statement = text.get(span.range())?;
    let rule = match text_of(text, *first) {
        "model" => Rule::model_statement,
        "solver" => Rule::solver_statement,
        "step" => Rule::step_statement,
        "span" => Rule::span_statement,
        "time" if !tokens.iter().any(|token| token.kind == TokenKind::Equals) => Rule::time_statement,
        "const" => Rule::const_statement,
        "index" => Rule::index_statement,
        "param" => Rule::param_statement,
        // Of a component: the instance says what it is.
        "input" if !tokens.iter().any(|token| token.kind == TokenKind::Equals) => Rule::connector_statement,
        "input" => Rule::input_statement,
        "component" => Rule::component_statement,
        "instance" => Rule::instance_statement,
        "state" => Rule::state_statement,
        "angle" => Rule::angle_statement,
        "output" => Rule::output_statement,
        "include" => Rule::include_statement,
        "function" => Rule::function_statement,
        "units" => Rule::units_statement,
        "every" => Rule::every_statement,
        "when" => Rule::when_statement,
        "next" => Rule::next_statement,
        "matrix" => Rule::matrix_statement,
        "}" => Rule::end_statement,
        _ => Rule::equation,
    };
    let mut builder = Builder { base: span.start, report, explained: false, files: Vec::new() };
    match OdeParser::parse(rule, statement) {
        Ok(mut pairs) => {
            let kind = pairs.next().and_then(|pair| builder.statement(pair));
            if kind.is_none() && !builder.explained {
                builder.report.push(Diagnostic::error(codes::SYNTAX, span, "this statement is not understood"));
            }
            Some(Statement { kind: kind?, block: None, span, files: builder.files })
        }
        Err(error) => {
            builder.report.push(describe(&error, text, tokens, span));
            None
        }
    }
}

type Node<'a> = Pair<'a, Rule>;

struct Builder<'a> {
    /// Offset of the statement in the file.
    base: u32,
    report: &'a mut Report,
    /// Whether the reason for a missing part has been reported.
    explained: bool,
    /// Data files named so far.
    files: Vec<Name>,
}

impl Builder<'_> {
    fn span(&self, pair: &Node) -> Span {
        let span = pair.as_span();
        Span::of(at(self.base) + span.start(), at(self.base) + span.end())
    }

    fn name(&self, pair: Node) -> Name {
        Name { text: pair.as_str().to_owned(), span: self.span(&pair) }
    }

    fn statement(&mut self, pair: Node) -> Option<StatementKind> {
        let rule = pair.as_rule();
        let mut parts = Parts::of(pair);
        Some(match rule {
            Rule::model_statement => {
                let name = self.name(parts.take(Rule::name)?);
                let text = parts.take(Rule::text).and_then(|text| text.into_inner().next());
                StatementKind::Model { name, title: text.map_or_else(String::new, |text| text.as_str().to_owned()) }
            }
            Rule::solver_statement => StatementKind::Solver(self.name(parts.take(Rule::name)?)),
            Rule::step_statement => {
                let mut early = Vec::new();
                while let Some(pair) = parts.take(Rule::early) {
                    let mut parts = Parts::of(pair);
                    let step = self.measure(parts.take(Rule::measure)?)?;
                    early.push((step, self.measure(parts.take(Rule::measure)?)?));
                }
                StatementKind::Step(self.measure(parts.take(Rule::measure)?)?, early)
            }
            Rule::span_statement => StatementKind::Span(self.measure(parts.take(Rule::measure)?)?),
            Rule::time_statement => StatementKind::Time(parts.take(Rule::unit).and_then(|unit| self.unit(unit))?),
            Rule::const_statement => {
                let name = self.name(parts.take(Rule::name)?);
                StatementKind::Const { name, value: self.expr(parts.take(Rule::expr)?)? }
            }
            Rule::index_statement => StatementKind::Index(self.binders(parts, Rule::binding)?),
            Rule::param_statement => {
                let declared = self.declared(&mut parts)?;
                let value = self.expr(parts.take(Rule::expr)?)?;
                match parts.take(Rule::tunable) {
                    None => StatementKind::Param { declared, value },
                    Some(tunable) => {
                        let within = self.within(&mut Parts::of(tunable))??;
                        StatementKind::Tunable { declared, value, within }
                    }
                }
            }
            Rule::input_statement => self.input(&mut parts)?,
            Rule::state_statement => {
                let declared = self.declared(&mut parts)?;
                let initial = self.expr(parts.take(Rule::expr)?)?;
                let sort = Sort::Plain;
                StatementKind::State { declared, initial, within: self.within(&mut parts)?, sort }
            }
            Rule::angle_statement => {
                let declared = self.declared(&mut parts)?;
                let initial = self.expr(parts.take(Rule::expr)?)?;
                StatementKind::State { declared, initial, within: None, sort: Sort::Angle }
            }
            Rule::matrix_statement => {
                let declared = self.declared(&mut parts)?;
                StatementKind::Matrix { declared, symmetric: parts.take(Rule::symmetric).is_some() }
            }
            Rule::output_statement => {
                let mut items = Vec::new();
                while let Some(item) = parts.take(Rule::output_item) {
                    let mut item = Parts::of(item);
                    let target = self.reference(item.take(Rule::reference)?)?;
                    let (ranges, condition) = self.clauses(&mut item)?;
                    items.push(OutputItem { target, ranges, condition });
                }
                StatementKind::Output(items)
            }
            Rule::include_statement => StatementKind::Include(self.text(&mut parts)?),
            Rule::units_statement => StatementKind::Units(self.name(parts.take(Rule::name)?)),
            Rule::function_statement => {
                let name = self.name(parts.take(Rule::name)?);
                let mut parameters = Vec::new();
                while let Some(parameter) = parts.take(Rule::name) {
                    parameters.push(self.name(parameter));
                }
                StatementKind::Function { name, parameters, body: self.expr(parts.take(Rule::expr)?)? }
            }
            Rule::equation => self.equation(&mut parts)?,
            Rule::next_statement => self.next_value(&mut parts)?,
            Rule::every_statement => StatementKind::Every(self.measure(parts.take(Rule::measure)?)?),
            Rule::when_statement => StatementKind::When(self.when(&mut parts)?),
            Rule::end_statement => StatementKind::End,
            Rule::component_statement => self.component(&mut parts)?,
            Rule::instance_statement => self.instance(&mut parts)?,
            Rule::connector_statement => {
                let declared = self.declared(&mut parts)?;
                StatementKind::Connector { declared, within: self.within(&mut parts)? }
            }
            _ => return None,
        })
    }

    fn input(&mut self, parts: &mut Parts) -> Option<StatementKind> {
        let declared = self.declared(parts)?;
        let signal = self.expr(parts.take(Rule::expr)?)?;
        let within = self.within(parts)?;
        let between = match parts.take(Rule::between) {
            Some(between) => Some(self.name(Parts::of(between).take(Rule::name)?)),
            None => None,
        };
        Some(StatementKind::Input { declared, signal, between, within })
    }

    fn equation(&mut self, parts: &mut Parts) -> Option<StatementKind> {
        let target = self.reference(parts.take(Rule::reference)?)?;
        let side = if parts.take(Rule::prime).is_some() { LeftSide::Derivative } else { LeftSide::Algebraic };
        let unit = parts.take(Rule::unit).and_then(|unit| self.unit(unit));
        let value = self.expr(parts.take(Rule::expr)?)?;
        let within = self.within(parts)?;
        let (ranges, condition) = self.clauses(parts)?;
        Some(StatementKind::Equation(Equation { target, side, unit, value, within, ranges, condition }))
    }

    fn next_value(&mut self, parts: &mut Parts) -> Option<StatementKind> {
        let target = self.reference(parts.take(Rule::reference)?)?;
        let value = self.expr(parts.take(Rule::expr)?)?;
        let (ranges, condition) = self.clauses(parts)?;
        let (side, unit, within) = (LeftSide::Next, None, None);
        Some(StatementKind::Equation(Equation { target, side, unit, value, within, ranges, condition }))
    }

    fn declared(&mut self, parts: &mut Parts) -> Option<Declared> {
        let mut declared = Parts::of(parts.take(Rule::declared)?);
        let name = self.name(declared.take(Rule::name)?);
        let dimensions = match declared.take(Rule::dimensions) {
            Some(dimensions) => self.binders(Parts::of(dimensions), Rule::binder)?,
            None => Vec::new(),
        };
        Some(Declared { name, dimensions, unit: parts.take(Rule::unit).and_then(|unit| self.unit(unit)) })
    }

    /// Text between the brackets, `None` if there is none.
    fn unit(&self, pair: Node) -> Option<Name> {
        let text = pair.into_inner().next()?;
        let span = self.span(&text);
        let trimmed = text.as_str().trim();
        let start = at(span.start) + text.as_str().len() - text.as_str().trim_start().len();
        let span = Span::of(start, start + trimmed.len());
        (!trimmed.is_empty()).then(|| Name { text: trimmed.to_owned(), span })
    }

    fn binders(&mut self, mut parts: Parts, rule: Rule) -> Option<Vec<Binder>> {
        let mut binders = Vec::new();
        while let Some(pair) = parts.take(rule) {
            binders.push(self.binder(pair)?);
        }
        Some(binders)
    }

    fn binder(&mut self, pair: Node) -> Option<Binder> {
        let mut parts = Parts::of(pair);
        let name = self.name(parts.take(Rule::name)?);
        let range = match parts.take(Rule::range) {
            Some(range) => Some(self.range(range)?),
            None => None,
        };
        let rows = match parts.take(Rule::rows) {
            Some(rows) => Some(self.path(&mut Parts::of(rows))?),
            None => None,
        };
        Some(Binder { name, range, rows })
    }

    fn range(&mut self, pair: Node) -> Option<Range> {
        let span = self.span(&pair);
        let mut parts = Parts::of(pair);
        let low = self.expr(parts.take(Rule::expr)?)?;
        Some(Range { low, high: self.expr(parts.take(Rule::expr)?)?, span })
    }

    /// The optional range of values; the outer `None` stands for a malformed tree.
    fn within(&mut self, parts: &mut Parts) -> Option<Option<Range>> {
        match parts.take(Rule::within) {
            Some(within) => Some(Some(self.range(Parts::of(within).take(Rule::range)?)?)),
            None => Some(None),
        }
    }

    fn clauses(&mut self, parts: &mut Parts) -> Option<(Vec<Binder>, Option<Expr>)> {
        let ranges = match parts.take(Rule::for_clause) {
            Some(clause) => self.binders(Parts::of(clause), Rule::binding)?,
            None => Vec::new(),
        };
        Some((ranges, self.condition(parts)?))
    }

    fn condition(&mut self, parts: &mut Parts) -> Option<Option<Expr>> {
        match parts.take(Rule::where_clause) {
            Some(clause) => Some(Some(self.expr(Parts::of(clause).take(Rule::expr)?)?)),
            None => Some(None),
        }
    }

    /// A text with the place of its quotes.
    fn text(&mut self, parts: &mut Parts) -> Option<Name> {
        let text = parts.take(Rule::text)?;
        let span = self.span(&text);
        Some(Name { text: text.into_inner().next()?.as_str().to_owned(), span })
    }

    /// A data file, which is noted.
    fn path(&mut self, parts: &mut Parts) -> Option<Name> {
        let path = self.text(parts)?;
        self.files.push(path.clone());
        Some(path)
    }

    /// A data file and a column of it.
    fn file_column(&mut self, parts: &mut Parts) -> Option<(Name, Name)> {
        Some((self.path(parts)?, self.text(parts)?))
    }

    fn measure(&mut self, pair: Node) -> Option<Measure> {
        let mut parts = Parts::of(pair);
        let value = self.expr(parts.take(Rule::expr)?)?;
        Some(Measure { value, unit: parts.take(Rule::unit_name).map(|unit| self.name(unit)) })
    }

    fn reference(&mut self, pair: Node) -> Option<Reference> {
        let span = self.span(&pair);
        let mut parts = Parts::of(pair);
        let mut name = self.name(parts.take(Rule::name)?);
        let mut subscripts = Vec::new();
        loop {
            let before = subscripts.len();
            if let Some(list) = parts.take(Rule::subscripts) {
                let mut list = Parts::of(list);
                while let Some(subscript) = list.take(Rule::expr) {
                    subscripts.push(self.expr(subscript)?);
                }
            }
            let Some(next) = parts.take(Rule::name) else { break };
            // One name for the array of all instances: that of `cell[3].v` is `cell[].v`.
            let next = self.name(next);
            name.text += &element::places(subscripts.len() - before);
            name.text = format!("{}.{}", name.text, next.text);
            name.span.end = next.span.end;
        }
        Some(Reference { name, subscripts, span })
    }

    fn expr(&mut self, pair: Node) -> Option<Expr> {
        let base = self.base;
        PRECEDENCE
            .map_primary(|primary| self.primary(primary))
            .map_prefix(|sign, operand| {
                let operand = operand?;
                let start = base + number(sign.as_span().start());
                let span = Span { start, end: operand.span.end };
                let operand = Box::new(operand);
                let negate = sign.as_rule() == Rule::negate;
                let kind = if negate { ExprKind::Negate(operand) } else { ExprKind::Not(operand) };
                Some(Expr { kind, span })
            })
            .map_infix(|left, operator, right| join(left?, operator.as_rule(), right?))
            .parse(pair.into_inner())
    }

    fn primary(&mut self, pair: Node) -> Option<Expr> {
        let span = self.span(&pair);
        let rule = pair.as_rule();
        let kind = match rule {
            Rule::number => ExprKind::Number(self.number(&pair)?),
            Rule::reference => ExprKind::Reference(self.reference(pair)?),
            Rule::expr => return self.expr(pair),
            Rule::conditional => {
                let mut parts = Parts::of(pair);
                let condition = Box::new(self.expr(parts.take(Rule::expr)?)?);
                let yes = Box::new(self.expr(parts.take(Rule::expr)?)?);
                ExprKind::If { condition, yes, no: Box::new(self.expr(parts.take(Rule::expr)?)?) }
            }
            Rule::measured => {
                let mut parts = Parts::of(pair);
                let value = self.number(&parts.take(Rule::number)?)?;
                match parts.take(Rule::unit).and_then(|unit| self.unit(unit)) {
                    Some(unit) => ExprKind::Measured(value, unit),
                    None => ExprKind::Number(value),
                }
            }
            Rule::sum => return self.sum(Parts::of(pair), span),
            Rule::data => {
                let (path, column) = self.file_column(&mut Parts::of(pair))?;
                ExprKind::Data { path, column }
            }
            Rule::samples => {
                let mut parts = Parts::of(pair);
                let (path, column) = self.file_column(&mut parts)?;
                ExprKind::Samples { path, column, interpolation: self.name(parts.take(Rule::name)?) }
            }
            Rule::matrix => {
                let mut rows = Vec::new();
                let mut parts = Parts::of(pair);
                while let Some(row) = parts.take(Rule::row) {
                    let mut cells = Vec::new();
                    let mut row = Parts::of(row);
                    while let Some(cell) = row.take(Rule::expr) {
                        cells.push(self.expr(cell)?);
                    }
                    rows.push(cells);
                }
                ExprKind::Matrix(rows)
            }
            Rule::call => {
                let mut parts = Parts::of(pair);
                let function = self.name(parts.take(Rule::function)?);
                let (mut arguments, mut units) = (Vec::new(), Vec::new());
                while let Some(argument) = parts.take(Rule::measure) {
                    let Measure { value, unit } = self.measure(argument)?;
                    units.extend(unit.map(|unit| (arguments.len(), unit)));
                    arguments.push(value);
                }
                delay::call(function, arguments, units)
            }
            Rule::delayed => {
                let mut parts = Parts::of(pair);
                let of = self.reference(parts.take(Rule::reference)?)?;
                let Measure { value, unit } = self.measure(parts.take(Rule::measure)?)?;
                ExprKind::Delayed { of, argument: Box::new(value), unit }
            }
            _ => return None,
        };
        Some(Expr { kind, span })
    }

    /// A sum over several indices is one sum inside the other; the condition, which may read them all, is the innermost's.
    fn sum(&mut self, mut parts: Parts, span: Span) -> Option<Expr> {
        let mut binders = Vec::new();
        while let Some(binder) = parts.take(Rule::summed) {
            binders.push(self.binder(binder)?);
        }
        let mut condition = self.condition(&mut parts)?.map(Box::new);
        let mut body = self.expr(parts.take(Rule::expr)?)?;
        for binder in binders.into_iter().rev() {
            let (binder, condition) = (Box::new(binder), condition.take());
            body = Expr { kind: ExprKind::SumOver { binder, condition, body: Box::new(body) }, span };
        }
        Some(body)
    }

    fn number(&mut self, pair: &Node) -> Option<f64> {
        let value: f64 = pair.as_str().parse().ok()?;
        if value.is_finite() {
            return Some(value);
        }
        let message = "number beyond the range of double precision (about 1.8e308)";
        self.report.push(Diagnostic::error(codes::BAD_LITERAL, self.span(pair), message));
        self.explained = true;
        None
    }
}

/// The children of a pair, taken by rule in order; keywords and signs between them are skipped.
struct Parts<'a>(Vec<Node<'a>>);

impl<'a> Parts<'a> {
    fn of(pair: Node<'a>) -> Self {
        let mut children: Vec<Node> = pair.into_inner().filter(|child| carries_content(child.as_rule())).collect();
        children.reverse();
        Parts(children)
    }

    /// The next child if it is of this rule.
    fn take(&mut self, rule: Rule) -> Option<Node<'a>> {
        self.0.pop_if(|child| child.as_rule() == rule)
    }
}

fn carries_content(rule: Rule) -> bool {
    !matches!(
        rule,
        Rule::EOI
            | Rule::equals
            | Rule::kw_model
            | Rule::kw_solver
            | Rule::kw_step
            | Rule::kw_until
            | Rule::kw_tunable
            | Rule::kw_matrix
            | Rule::kw_symmetric
            | Rule::kw_span
            | Rule::kw_time
            | Rule::kw_const
            | Rule::kw_index
            | Rule::kw_param
            | Rule::kw_input
            | Rule::kw_state
            | Rule::kw_angle
            | Rule::kw_output
            | Rule::kw_include
            | Rule::kw_function
            | Rule::kw_units
            | Rule::kw_every
            | Rule::kw_when
            | Rule::kw_after
            | Rule::kw_next
            | Rule::kw_component
            | Rule::kw_instance
            | Rule::block_start
            | Rule::block_end
            | Rule::data_word
            | Rule::samples_word
            | Rule::rows_word
            | Rule::kw_if
            | Rule::kw_then
            | Rule::kw_else
            | Rule::kw_sum
            | Rule::kw_where
            | Rule::kw_for
            | Rule::kw_in
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::syntax::lexer::tokenize;

    /// Prints an expression with all its parentheses.
    fn show(expr: &Expr) -> String {
        let list = |items: &[Expr], mark: &str| items.iter().map(show).collect::<Vec<_>>().join(mark);
        match &expr.kind {
            ExprKind::Number(value) => value.to_string(),
            ExprKind::Measured(value, unit) => format!("{value}[{}]", unit.text),
            ExprKind::Reference(reference) if reference.subscripts.is_empty() => reference.name.text.clone(),
            ExprKind::Reference(reference) => {
                format!("{}[{}]", reference.name.text, list(&reference.subscripts, ","))
            }
            ExprKind::Sum(terms) => {
                let term = |(sign, term): &(Sign, Expr)| format!("{sign:?} {}", show(term));
                format!("({})", terms.iter().map(term).collect::<Vec<_>>().join(" "))
            }
            ExprKind::Product(first, rest) => {
                let factor = |(operator, factor): &(Factor, Expr)| format!(" {operator:?} {}", show(factor));
                format!("({}{})", show(first), rest.iter().map(factor).collect::<String>())
            }
            ExprKind::Power(base, exponent) => format!("({}^{})", show(base), show(exponent)),
            ExprKind::Negate(operand) => format!("(-{})", show(operand)),
            ExprKind::If { condition, yes, no } => format!("({}?{}:{})", show(condition), show(yes), show(no)),
            ExprKind::SumOver { binder, body, .. } => format!("sum({}:{})", binder.name.text, show(body)),
            ExprKind::Call { function, arguments, .. } => format!("{}({})", function.text, list(arguments, ",")),
            ExprKind::Matrix(rows) => {
                format!("[{}]", rows.iter().map(|row| list(row, ",")).collect::<Vec<_>>().join(";"))
            }
            ExprKind::Delayed { of, argument, .. } => format!("{}({})", of.name.text, show(argument)),
            ExprKind::Data { path, column } => format!("data({},{})", path.text, column.text),
            ExprKind::Samples { path, column, .. } => format!("samples({},{})", path.text, column.text),
            ExprKind::Compare(operator, left, right) => format!("({} {operator:?} {})", show(left), show(right)),
            ExprKind::Logical(connective, operands) => {
                format!("({})", list(operands, &format!(" {connective:?} ")))
            }
            ExprKind::Not(operand) => format!("(not {})", show(operand)),
            ExprKind::Solved { .. } => unreachable!("no text has it"),
        }
    }

    fn shape(expression: &str) -> String {
        let text = format!("x = {expression}");
        let mut report = Report::default();
        let tokens = tokenize(&text, 0, &mut report);
        let statement = parse_statement(&text, &tokens, &mut report);
        match statement.map(|statement| statement.kind) {
            Some(StatementKind::Equation(equation)) => show(&equation.value),
            _ => format!("{:?}", report.finish()),
        }
    }

    #[test]
    fn precedence_is_that_of_mathematics() {
        assert_eq!(shape("a + b*c^2"), "(Plus a Plus (b Multiply (c^2)))");
        assert_eq!(shape("-a^2"), "(-(a^2))");
        assert_eq!(shape("-a*b"), "((-a) Multiply b)");
        assert_eq!(shape("2^-a^b"), "(2^(-(a^b)))");
        assert_eq!(shape("2^3^2"), "(2^(3^2))");
        assert_eq!(shape("a - b - c"), "(Plus a Minus b Minus c)");
        assert_eq!(shape("a - (b - c)"), "(Plus a Minus (Plus b Minus c))");
        assert_eq!(shape("a/b*c mod 2"), "(a Divide b Multiply c Modulo 2)");
        assert_eq!(shape("mod(a, 2) mod 3"), "(mod(a,2) Modulo 3)");
    }

    #[test]
    fn conditions_bind_looser_than_arithmetic() {
        assert_eq!(
            shape("if not a + 1 == b and c > 2 or d < 1 then 1 else 2 + 3"),
            "((((not ((Plus a Plus 1) Equal b)) And (c Greater 2)) Or (d Less 1))?1:(Plus 2 Plus 3))"
        );
    }

    #[test]
    fn a_range_is_not_read_as_a_decimal_point() {
        assert_eq!(shape("sum(k in 1..n: V[k])"), "sum(k:V[k])");
    }

    #[test]
    fn a_sum_over_several_indices_is_one_in_another() {
        assert_eq!(shape("sum(i, k in 1..i where k > 1: V[k])"), "sum(i:sum(k:V[k]))");
    }

    #[test]
    fn a_bracket_after_a_number_and_a_blank_holds_its_unit() {
        assert_eq!(shape("1 + x/0.02 [mM]"), "(Plus 1 Plus (x Divide 0.02[mM]))");
    }

    #[test]
    fn a_keyword_may_begin_a_longer_name() {
        assert_eq!(shape("input_1 + iffy + in_ + notion"), "(Plus input_1 Plus iffy Plus in_ Plus notion)");
    }
}
