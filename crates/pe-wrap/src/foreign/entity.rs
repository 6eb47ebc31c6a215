//! A VHDL entity with generics and ports, out of the syntax trees of files.

use std::collections::BTreeMap;

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Sources, Span};
use vhdl_lang::ast::token_range::WithTokenSpan;
use vhdl_lang::ast::{
    AbstractLiteral, ActualPart, AnyDesignUnit, AnyPrimaryUnit, AnySecondaryUnit, CallOrIndexed, ConditionalExpression,
    ContextItem, Declaration, Designator, Direction, DiscreteRange, EntityDeclaration, Expression,
    InterfaceDeclaration, InterfaceList, Literal, Mode, ModeIndication, Name, ObjectClass, Operator, Range,
    SimpleModeIndication, SubtypeConstraint, SubtypeIndication,
};
use vhdl_lang::{HasTokenSpan, Token, TokenSpan};

use super::evaluate::{Binary, Fault, Names, Node, Term, Unary, Value};
use super::source::{Given, Parsed, parsed};

/// An entity that can perhaps be wrapped.
pub struct Entity {
    /// Name as its file has it.
    pub name: String,
    /// Its architecture.
    pub architecture: String,
    /// Place of its name.
    pub span: Span,
    /// Generics, in the order of the file.
    pub generics: Vec<Generic>,
    /// Ports, in the order of the file.
    pub ports: Vec<Port>,
    /// Package of its types `signed` and `unsigned`.
    pub arithmetic: &'static str,
    /// Entities, packages and others of all files, which share a library with the wrapper.
    pub units: Vec<(String, Span)>,
    packages: Packages,
}

/// A generic.
pub struct Generic {
    /// Name as in the file.
    pub name: String,
    /// Place of the name.
    pub span: Span,
    /// Type as in the file.
    pub declared: String,
    /// What values it has.
    pub kind: Kind,
    /// Value where none is given.
    pub default: Option<Term>,
}

/// What values a generic has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Integers from this one on.
    Integer(i64),
    /// True or false.
    Boolean,
    /// Others, of which the default is taken.
    Other,
}

/// A port.
pub struct Port {
    /// Name as in the file.
    pub name: String,
    /// Place of the name.
    pub span: Span,
    /// Whether it is an input; else it is an output.
    pub input: bool,
    /// Mode and type as in the file.
    pub declared: String,
    /// Type.
    pub of: PortType,
    /// Range of a vector: both ends, and whether it ascends.
    pub range: Option<(Term, Term, bool)>,
}

/// Types that ports may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortType {
    /// `std_logic`, `std_ulogic`.
    Bit,
    /// `std_logic_vector`, `std_ulogic_vector`.
    Vector,
    /// `signed`.
    Signed,
    /// `unsigned`.
    Unsigned,
}

/// Constants of packages, by lower-case names.
type Packages = BTreeMap<String, BTreeMap<String, Term>>;

/// Whether two VHDL names are the same: extended ones to the letter.
pub fn is_same(a: &str, b: &str) -> bool {
    if a.starts_with('\\') || b.starts_with('\\') { a == b } else { a.to_lowercase() == b.to_lowercase() }
}

/// A name as a key.
fn key(name: &str) -> String {
    if name.starts_with('\\') { name.to_owned() } else { name.to_lowercase() }
}

/// The entity of a name in files, as far as it could be understood.
pub fn read(files: &[Given], name: &str, sources: &mut Sources, findings: &mut Vec<Diagnostic>) -> Option<Entity> {
    let parsed: Vec<Parsed> = files.iter().filter_map(|file| parsed(file, sources, findings)).collect();
    let text = sources.text();
    let mut units = Vec::new();
    let mut found: Vec<(Reader, &EntityDeclaration, Span)> = Vec::new();
    let mut architectures: Vec<(String, Span)> = Vec::new();
    let mut entities = Vec::new();
    let mut packages = Packages::new();
    for file in &parsed {
        for (tokens, unit) in file.units() {
            let reader = Reader { file, text, tokens };
            match unit {
                AnyDesignUnit::Primary(AnyPrimaryUnit::Entity(entity)) => {
                    let place = reader.token(entity.ident.tree.token);
                    let own = text[place.range()].to_owned();
                    if is_same(&own, name) {
                        found.push((reader, entity, place));
                    }
                    entities.push(own.clone());
                    units.push((own, place));
                }
                AnyDesignUnit::Primary(AnyPrimaryUnit::Package(package)) => {
                    let place = reader.token(package.ident.tree.token);
                    let constants = packages.entry(key(&text[place.range()])).or_default();
                    for declaration in &package.decl {
                        reader.constants(&declaration.item, constants);
                    }
                    units.push((text[place.range()].to_owned(), place));
                }
                AnyDesignUnit::Primary(AnyPrimaryUnit::Configuration(unit)) => {
                    let place = reader.token(unit.ident.tree.token);
                    units.push((text[place.range()].to_owned(), place));
                }
                AnyDesignUnit::Secondary(AnySecondaryUnit::Architecture(body)) => {
                    let of = reader.token(body.entity_name.item.token);
                    if is_same(&text[of.range()], name) {
                        let place = reader.token(body.ident.tree.token);
                        architectures.push((text[place.range()].to_owned(), place));
                    }
                }
                _ => {}
            }
        }
    }
    let Some((reader, entity, span)) = found.first() else {
        // What was not understood may have held it.
        if findings.is_empty() {
            findings.push(missing(name, &entities, parsed.first()));
        }
        return None;
    };
    for (_, _, other) in &found[1..] {
        let message = format!("entity `{name}` is there more than once");
        let finding = Diagnostic::error(codes::SEVERAL_ENTITIES, *other, message).with_label(*span, "here, too");
        findings.push(finding.with_help("give files of which one has it"));
    }
    let architecture = architecture(name, &architectures, *span, findings)?;
    let arithmetic = reader.arithmetic(entity);
    let mut result = Entity {
        name: text[span.range()].to_owned(),
        architecture,
        span: *span,
        generics: Vec::new(),
        ports: Vec::new(),
        arithmetic: arithmetic.unwrap_or(NUMERIC_STD),
        units,
        packages: reader.visible(entity, &packages),
    };
    for item in items(entity.generic_clause.as_ref()) {
        reader.generic(item, &mut result, findings);
    }
    for item in items(entity.port_clause.as_ref()) {
        reader.port(item, &mut result, findings);
    }
    let names = result.generics.iter().map(|g| (&g.name, g.span)).chain(result.ports.iter().map(|p| (&p.name, p.span)));
    let mut known: BTreeMap<String, Span> = BTreeMap::new();
    for (name, span) in names {
        if let Some(first) = known.insert(key(name), span) {
            let finding = Diagnostic::error(codes::VHDL_SYNTAX, span, format!("`{name}` is declared twice"));
            findings.push(finding.with_label(first, "here, too"));
        }
    }
    Some(result)
}

/// Where `signed` and `unsigned` are usually from.
const NUMERIC_STD: &str = "ieee.numeric_std";

fn items(list: Option<&InterfaceList>) -> impl Iterator<Item = &InterfaceDeclaration> {
    list.into_iter().flat_map(|list| &list.items)
}

fn missing(name: &str, entities: &[String], file: Option<&Parsed>) -> Diagnostic {
    let span = file.map_or(Span::default(), |file| Span { end: file.span().start, ..file.span() });
    let near = entities.iter().min_by_key(|other| strsim::osa_distance(&other.to_lowercase(), &name.to_lowercase()));
    let help = match near {
        Some(near) if strsim::normalized_damerau_levenshtein(&near.to_lowercase(), &name.to_lowercase()) > 0.5 => {
            format!("did you mean `{near}`?")
        }
        Some(_) => format!("there are {}", entities.iter().map(|e| format!("`{e}`")).collect::<Vec<_>>().join(", ")),
        None => "the files have no entity; give more of them, each with --vhdl".to_owned(),
    };
    Diagnostic::error(codes::NO_ENTITY, span, format!("there is no entity `{name}`")).with_help(help)
}

fn architecture(name: &str, found: &[(String, Span)], span: Span, findings: &mut Vec<Diagnostic>) -> Option<String> {
    match found {
        [(only, _)] => Some(only.clone()),
        [] => {
            let finding = Diagnostic::error(codes::ARCHITECTURES, span, format!("entity `{name}` has no architecture"));
            findings.push(finding.with_help("give the file that has it with another --vhdl"));
            None
        }
        [(first, _), others @ ..] => {
            let message = format!("entity `{name}` has {} architectures", found.len());
            let mut finding = Diagnostic::error(codes::ARCHITECTURES, others[0].1, message);
            finding.labels = others[1..].iter().map(|(_, span)| (*span, "another one".to_owned())).collect();
            finding.labels.insert(0, (found[0].1, "the first one".to_owned()));
            findings.push(finding.with_help("leave one, in files without the others"));
            Some(first.clone())
        }
    }
}

/// A unit that is read.
struct Reader<'a> {
    file: &'a Parsed,
    text: &'a str,
    tokens: &'a Vec<Token>,
}

impl Reader<'_> {
    fn token(&self, token: vhdl_lang::TokenId) -> Span {
        self.span(TokenSpan::new(token, token))
    }

    fn span(&self, span: TokenSpan) -> Span {
        self.file.span_of(self.text, self.tokens, span)
    }

    fn word(&self, token: vhdl_lang::TokenId) -> &str {
        &self.text[self.token(token).range()]
    }

    /// Text of a place, on one line and without comments.
    fn shown(&self, span: Span) -> String {
        let lines = self.text[span.range()].lines().map(|line| line.split("--").next().unwrap_or(""));
        lines.flat_map(str::split_whitespace).collect::<Vec<_>>().join(" ")
    }

    fn constants(&self, declaration: &Declaration, constants: &mut BTreeMap<String, Term>) {
        let Declaration::Object(object) = declaration else { return };
        let Some(expression) = object.expression.as_ref().filter(|_| object.class == ObjectClass::Constant) else {
            return;
        };
        let term = self.conditional(&expression.item, self.span(expression.span));
        let names = object.idents.iter().map(|ident| key(self.word(ident.tree.token)));
        constants.extend(names.map(|name| (name, term.clone())));
    }

    /// Names that a unit uses, each as its parts.
    fn used(&self, entity: &EntityDeclaration) -> Vec<Vec<String>> {
        let mut used = Vec::new();
        for item in &entity.context_clause {
            let names = match item {
                ContextItem::Use(clause) => &clause.name_list,
                ContextItem::Context(clause) => &clause.name_list,
                ContextItem::Library(_) => continue,
            };
            used.extend(names.iter().filter_map(|name| self.path(&name.item)));
        }
        used
    }

    /// Parts of a name that are joined by points; `all` is left out.
    fn path(&self, name: &Name) -> Option<Vec<String>> {
        match name {
            Name::Designator(designator) => match &designator.item {
                Designator::Identifier(symbol) => Some(vec![symbol.name_utf8()]),
                _ => None,
            },
            Name::Selected(prefix, suffix) => {
                let mut path = self.path(&prefix.item)?;
                path.push(self.word(suffix.token).to_owned());
                Some(path)
            }
            Name::SelectedAll(prefix) => self.path(&prefix.item),
            _ => None,
        }
    }

    /// The package of `signed` and `unsigned`; none if no package that has them is used.
    fn arithmetic(&self, entity: &EntityDeclaration) -> Option<&'static str> {
        let packages = [NUMERIC_STD, "ieee.std_logic_arith", "ieee.numeric_bit"];
        self.used(entity).iter().find_map(|path| {
            let path: Vec<String> = path.iter().map(|part| part.to_lowercase()).collect();
            let path = path.join(".");
            if path == "ieee.ieee_std_context" {
                return Some(NUMERIC_STD);
            }
            packages.into_iter().find(|package| path == *package || path.starts_with(&format!("{package}.")))
        })
    }

    /// Constants by the names that a unit may use for them.
    fn visible(&self, entity: &EntityDeclaration, packages: &Packages) -> Packages {
        let mut visible = packages.clone();
        let mut direct = BTreeMap::new();
        for path in self.used(entity) {
            let parts: Vec<String> = path.iter().map(|part| key(part)).collect();
            if let Some(package) = parts.get(1).and_then(|name| packages.get(name)) {
                let wanted = |name: &String| parts.get(2).is_none_or(|only| only == name);
                let of = |name: &String| Node::Name(vec![parts[1].clone(), name.clone()]);
                direct.extend(
                    package
                        .iter()
                        .filter(|(name, _)| wanted(name))
                        .map(|(name, term)| (name.clone(), Term { node: of(name), span: term.span })),
                );
            }
        }
        // No package has this name.
        visible.insert(String::new(), direct);
        visible
    }

    fn generic(&self, item: &InterfaceDeclaration, entity: &mut Entity, findings: &mut Vec<Diagnostic>) {
        let InterfaceDeclaration::Object(object) = item else {
            let span = self.span(item.span());
            let finding = Diagnostic::error(codes::BAD_GENERIC, span, "a generic that is no constant");
            findings.push(finding.with_help("wrap an entity that instantiates this one with all such generics set"));
            return;
        };
        let ModeIndication::Simple(mode) = &object.mode else { return };
        let declared = self.shown(self.subtype_span(&mode.subtype_indication));
        let kind = match self.type_name(&mode.subtype_indication).as_str() {
            "integer" => Kind::Integer(i64::from(i32::MIN)),
            "natural" => Kind::Integer(0),
            "positive" => Kind::Integer(1),
            "boolean" => Kind::Boolean,
            _ => Kind::Other,
        };
        let default = mode.expression.as_ref().map(|value| self.conditional(&value.item, self.span(value.span)));
        for ident in &object.idents {
            let span = self.token(ident.tree.token);
            let name = self.text[span.range()].to_owned();
            if kind == Kind::Other && default.is_none() {
                let message = format!("generic `{name}` has no value, and none of type `{declared}` can be set");
                let finding = Diagnostic::error(codes::BAD_GENERIC, span, message);
                findings.push(finding.with_help("give it a default; integers and booleans can be set in the map"));
            }
            entity.generics.push(Generic { name, span, declared: declared.clone(), kind, default: default.clone() });
        }
    }

    fn port(&self, item: &InterfaceDeclaration, entity: &mut Entity, findings: &mut Vec<Diagnostic>) {
        let InterfaceDeclaration::Object(object) = item else { return };
        let names: Vec<Span> = object.idents.iter().map(|ident| self.token(ident.tree.token)).collect();
        let mut refuse = |code, span: Span, message: &str, help: &str| {
            for name in &names {
                let message = format!("port `{}` {message}", &self.text[name.range()]);
                findings.push(Diagnostic::error(code, span, message).with_help(help));
            }
        };
        let ModeIndication::Simple(mode) = &object.mode else {
            return refuse(codes::BAD_MODE, self.span(object.span()), "has a view", "make each of its parts a port");
        };
        let input = match mode.mode.as_ref().map_or(Mode::In, |mode| mode.item) {
            Mode::In => true,
            Mode::Out => false,
            other => {
                let span = mode.mode.as_ref().map_or(names[0], |mode| self.token(mode.token));
                let word = format!("{other:?}").to_lowercase();
                let help = "make it `in` or `out`; VHDL-2008 permits to read an `out`";
                return refuse(codes::BAD_MODE, span, &format!("is `{word}`"), help);
            }
        };
        let place = self.subtype_span(&mode.subtype_indication);
        let typed = self.shown(place);
        let Some(of) = self.port_type(mode, entity.arithmetic) else {
            let help =
                "ports may be `std_logic`, `std_logic_vector`, `signed`, `unsigned`, or these without resolution";
            return refuse(codes::BAD_TYPE, place, &format!("has type `{typed}`"), help);
        };
        let constraint = mode.subtype_indication.constraint.as_ref();
        let range = match (of, constraint.map(|constraint| &constraint.item)) {
            (PortType::Bit, None) => None,
            (PortType::Bit, Some(_)) => {
                return refuse(codes::BAD_TYPE, place, &format!("has type `{typed}`"), "leave the constraint out");
            }
            (_, Some(SubtypeConstraint::Array(ranges, None))) if ranges.len() == 1 => {
                Some(self.ends(&ranges[0].item, self.span(ranges[0].span)))
            }
            _ => {
                let help = "write its range, such as `(WIDTH - 1 downto 0)`";
                return refuse(codes::UNCONSTRAINED, place, "has no range", help);
            }
        };
        for name in &names {
            entity.ports.push(Port {
                name: self.text[name.range()].to_owned(),
                span: *name,
                input,
                declared: format!("{} {typed}", if input { "in" } else { "out" }),
                of,
                range: range.clone(),
            });
        }
    }

    fn subtype_span(&self, subtype: &SubtypeIndication) -> Span {
        let first = subtype.resolution.as_ref().map_or(subtype.type_mark.span.start_token, |r| r.get_start_token());
        let last = subtype.constraint.as_ref().map_or(subtype.type_mark.span, |constraint| constraint.span);
        self.span(TokenSpan::new(first, last.end_token))
    }

    /// The last part of the name of a type, in lower case.
    fn type_name(&self, subtype: &SubtypeIndication) -> String {
        let path = self.path(&subtype.type_mark.item).filter(|_| subtype.resolution.is_none());
        path.and_then(|path| path.last().map(|name| key(name))).unwrap_or_default()
    }

    fn port_type(&self, mode: &SimpleModeIndication, arithmetic: &str) -> Option<PortType> {
        let of = match self.type_name(&mode.subtype_indication).as_str() {
            "std_logic" | "std_ulogic" => PortType::Bit,
            "std_logic_vector" | "std_ulogic_vector" => PortType::Vector,
            "signed" | "u_signed" | "unresolved_signed" => PortType::Signed,
            "unsigned" | "u_unsigned" | "unresolved_unsigned" => PortType::Unsigned,
            _ => return None,
        };
        let of_bits = matches!(of, PortType::Signed | PortType::Unsigned) && arithmetic == "ieee.numeric_bit";
        (!of_bits).then_some(of)
    }

    fn ends(&self, range: &DiscreteRange, span: Span) -> (Term, Term, bool) {
        let ends = match range {
            DiscreteRange::Range(Range::Range(ends)) | DiscreteRange::Discrete(_, Some(Range::Range(ends))) => ends,
            _ => {
                let other = Term { node: Node::Other, span };
                return (other.clone(), other, false);
            }
        };
        let term = |end: &WithTokenSpan<Expression>| self.term(&end.item, self.span(end.span));
        (term(&ends.left_expr), term(&ends.right_expr), ends.direction == Direction::Ascending)
    }

    fn conditional(&self, expression: &ConditionalExpression, span: Span) -> Term {
        match expression {
            ConditionalExpression::Simple(expression) => self.term(expression, span),
            ConditionalExpression::Conditional(_) => Term { node: Node::Other, span },
        }
    }

    fn term(&self, expression: &Expression, span: Span) -> Term {
        let operand = |operand: &WithTokenSpan<Expression>| Box::new(self.term(&operand.item, self.span(operand.span)));
        let node = match expression {
            Expression::Literal(Literal::AbstractLiteral(AbstractLiteral::Integer(number))) => {
                i64::try_from(*number).map_or(Node::Other, Node::Number)
            }
            Expression::Name(name) => self.name(name),
            Expression::Unary(operator, of) => match operator.item.item {
                Operator::Plus => Node::Unary(Unary::Plus, operand(of)),
                Operator::Minus => Node::Unary(Unary::Minus, operand(of)),
                Operator::Abs => Node::Unary(Unary::Abs, operand(of)),
                _ => Node::Other,
            },
            Expression::Binary(operator, first, second) => {
                let binary = match operator.item.item {
                    Operator::Plus => Some(Binary::Plus),
                    Operator::Minus => Some(Binary::Minus),
                    Operator::Times => Some(Binary::Times),
                    Operator::Div => Some(Binary::Divide),
                    Operator::Mod => Some(Binary::Mod),
                    Operator::Rem => Some(Binary::Rem),
                    Operator::Pow => Some(Binary::Power),
                    _ => None,
                };
                binary.map_or(Node::Other, |binary| Node::Binary(binary, operand(first), operand(second)))
            }
            Expression::Parenthesized(inner) => self.conditional(&inner.item, self.span(inner.span)).node,
            _ => Node::Other,
        };
        Term { node, span }
    }

    fn name(&self, name: &Name) -> Node {
        if let Name::CallOrIndexed(call) = name {
            return self.extreme(call).unwrap_or(Node::Other);
        }
        self.path(name).map_or(Node::Other, Node::Name)
    }

    /// `maximum` and `minimum` of two.
    fn extreme(&self, call: &CallOrIndexed) -> Option<Node> {
        let greatest = match self.path(&call.name.item)?.join(".").to_lowercase().as_str() {
            "maximum" => true,
            "minimum" => false,
            _ => return None,
        };
        let [first, second] = &call.parameters.items[..] else { return None };
        let term = |actual: &WithTokenSpan<ActualPart>| match &actual.item {
            ActualPart::Expression(expression) => Some(Box::new(self.conditional(expression, self.span(actual.span)))),
            ActualPart::Open => None,
        };
        Some(Node::Extreme(greatest, term(&first.actual)?, term(&second.actual)?))
    }
}

/// Packages within each other that constants are looked for in.
const LONGEST_CHAIN: usize = 64;

impl Entity {
    /// Value of an expression of generics, which have these values, and of constants of packages.
    pub fn value(&self, term: &Term, generics: &BTreeMap<String, Value>) -> Result<Value, Fault> {
        term.value(&|path| self.lookup(path, "", generics, 0))
    }

    /// The same, an integer.
    pub fn number(&self, term: &Term, generics: &BTreeMap<String, Value>) -> Result<i64, Fault> {
        term.number(&|path| self.lookup(path, "", generics, 0))
    }

    fn lookup(
        &self,
        path: &[String],
        package: &str,
        generics: &BTreeMap<String, Value>,
        depth: usize,
    ) -> Option<Result<Value, Fault>> {
        let (last, before) = path.split_last()?;
        let last = key(last);
        if before.is_empty()
            && package.is_empty()
            && let Some(value) = generics.get(&last)
        {
            return Some(Ok(*value));
        }
        let package = before.last().map_or(package.to_owned(), |name| key(name));
        let term = self.packages.get(&package)?.get(&last)?;
        if depth > LONGEST_CHAIN {
            return Some(Err((term.span, format!("`{last}` depends on itself"))));
        }
        // What a package does not have itself may be visible to the entity only: no guess.
        let inner: &Names = &|path| self.lookup(path, &package, generics, depth + 1);
        Some(term.value(inner))
    }

    /// Values of the generics: what is set, or their defaults; those without a value are left out.
    pub fn generics(&self, set: &BTreeMap<String, Value>) -> BTreeMap<String, Value> {
        let mut values = BTreeMap::new();
        for generic in &self.generics {
            let name = key(&generic.name);
            let default = || generic.default.as_ref().and_then(|term| self.value(term, &values).ok());
            if let Some(value) = set.get(&name).copied().or_else(default) {
                values.insert(name, value);
            }
        }
        values
    }

    /// Key of a name in sets of values.
    pub fn key(name: &str) -> String {
        key(name)
    }

    /// Bits of a port; an error has a place.
    pub fn bits(&self, port: &Port, generics: &BTreeMap<String, Value>) -> Result<u32, Fault> {
        let Some((left, right, ascending)) = &port.range else { return Ok(1) };
        let [left_end, right_end] = [self.number(left, generics)?, self.number(right, generics)?];
        let [least, most] = if *ascending { [left_end, right_end] } else { [right_end, left_end] };
        let bits = i128::from(most) - i128::from(least) + 1;
        let span = Span { end: right.span.end.max(left.span.end), start: left.span.start.min(right.span.start) };
        match u32::try_from(bits) {
            Ok(bits @ 1..=65_536) => Ok(bits),
            _ => Err((span, format!("its range has {} elements", bits.max(0)))),
        }
    }
}
