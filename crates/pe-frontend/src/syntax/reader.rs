//! Reads a spec: its main file and, where they stand, the files that it includes.

use crate::report::Report;
use crate::syntax::ast::Sort;
use crate::syntax::ast::{
    Binder, Block, Broken, Component, Equation, Expr, ExprKind, LeftSide, Measure, Name, Parameter, Reference, Spec,
    Statement, StatementKind, When,
};
use crate::syntax::files::{LARGEST_FILE, Loader, folder, load, resolve};
use crate::syntax::lexer::{SECTIONS, Token, TokenKind, tokenize};
use crate::syntax::tables::Table;
use crate::syntax::{parser, quotients, statements};
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Sources, Span};
use std::sync::Arc;

/// Files that include one another one inside the other.
const DEEPEST_INCLUDE: usize = 32;

/// Sections that describe the whole model.
const MAIN_ONLY: [&str; 6] = ["model", "solver", "step", "span", "units", "time"];

/// Parses all files of a spec; `sources` holds the main one and takes up the others.
pub(crate) fn read(sources: &mut Sources, loader: &dyn Loader, report: &mut Report) -> Spec {
    let spec = Spec::default();
    let mut reader = Reader {
        sources,
        loader,
        report,
        spec,
        open: Vec::new(),
        block: None,
        component: None,
        event: None,
        done: Vec::new(),
        data: Vec::new(),
    };
    let main = reader.sources.main().span();
    let size = main.length();
    if size > LARGEST_FILE {
        let message = format!("the file has {size} bytes; the most allowed is {LARGEST_FILE}");
        reader.report.push(
            Diagnostic::global(codes::FILE_TOO_LARGE, message)
                .with_help("describe repeated equations with indices instead of writing them out"),
        );
        reader.give_up();
    } else {
        reader.file(main, "");
    }
    reader.spec
}

/// An included file and the place that includes it.
struct Included {
    path: String,
    named: Span,
    file: Span,
}

/// The block whose statements are being read.
#[derive(Clone, Copy)]
struct OpenBlock {
    number: usize,
    empty: bool,
}

struct Reader<'a> {
    sources: &'a mut Sources,
    loader: &'a dyn Loader,
    report: &'a mut Report,
    spec: Spec,
    /// Files whose statements are being read, the innermost last; the main file is not among them.
    open: Vec<Included>,
    block: Option<OpenBlock>,
    /// The component whose statements are being read.
    component: Option<Component>,
    /// The event whose assignments are being read.
    event: Option<Statement>,
    /// Files that were included so far.
    done: Vec<Included>,
    /// Data files that were read so far, with their places and the numbers of their tables.
    data: Vec<(String, Span, Option<usize>)>,
}

impl Reader<'_> {
    /// Reads the statements of a file.
    fn file(&mut self, file: Span, own_folder: &str) {
        let text = &self.sources.text()[..file.range().end];
        let tokens = tokenize(text, file.start, self.report);
        let measured = |pair: &[Token]| pair[0].kind == TokenKind::Number && pair[1].kind == TokenKind::Unit;
        self.spec.measured |= tokens.windows(2).any(measured);
        let mut parsed = Vec::new();
        let statements = statements::split(text, &tokens);
        quotients::warn(text, &statements, self.report);
        for statement in statements {
            let tree = statements::check(text, &statement, self.report)
                .then(|| parser::parse_statement(text, &statement, self.report))
                .flatten();
            let span = statement.first().map_or(file, |first| first.span);
            parsed.push(tree.ok_or_else(|| (statements::salvage(text, &statement), span)));
        }
        for statement in parsed {
            match statement {
                Ok(statement) if self.blocks(&statement) => {}
                Ok(mut statement) => match &statement.kind {
                    StatementKind::Include(path) => self.include(path, own_folder),
                    kind => {
                        let section = section(kind).filter(|_| !self.open.is_empty());
                        match section {
                            Some(section) => self.misplaced(section, statement.span),
                            None => {
                                statement.files.iter().for_each(|path| self.data_file(path, own_folder));
                                statement.block = self.block.map(|block| block.number);
                                let statements = match &mut self.component {
                                    Some(component) => &mut component.statements,
                                    None => &mut self.spec.statements,
                                };
                                statements.extend(written_out(statement));
                            }
                        }
                    }
                },
                Err((broken, span)) => {
                    match broken.section.as_str() {
                        "include" => self.give_up(),
                        // What follows is taken for its content.
                        "every" => self.open_block(None, span),
                        "component" => self.open_component(broken.names.first().cloned(), Vec::new(), span),
                        "when" => self.event = Some(Statement::broken_event(span)),
                        _ => {}
                    }
                    self.fill_block();
                    if let Some(component) = &mut self.component {
                        component.broken = true;
                    }
                    self.spec.broken.push(broken);
                }
            }
        }
        if let Some(event) = self.event.take() {
            let message = "the event is not closed at the end of the file";
            let help = "close it with `}` behind what it assigns";
            self.refuse(Diagnostic::error(codes::BAD_BLOCK, event.span, message).with_help(help));
        }
        if let Some(block) = self.block.take() {
            let message = "the block is not closed at the end of the file";
            let help = "close it with `}` on a line of its own";
            let span = self.block_list()[block.number].span;
            self.refuse(Diagnostic::error(codes::BAD_BLOCK, span, message).with_help(help));
        }
        if let Some(component) = self.component.take() {
            let message = format!("the component `{}` is not closed at the end of the file", component.name.text);
            let help = "close it with `}` on a line of its own";
            self.refuse(Diagnostic::error(codes::BAD_BLOCK, component.span, message).with_help(help));
        }
    }

    /// Reports a mistake after which the spec is no model, whatever else it says.
    fn refuse(&mut self, error: Diagnostic) {
        self.report.push(error);
        self.spec.broken.push(Broken::default());
    }

    /// Takes the statements that begin or end a block, and those that cannot stand in one.
    fn blocks(&mut self, statement: &Statement) -> bool {
        let wrong =
            |message: String, help: &str| Diagnostic::error(codes::BAD_BLOCK, statement.span, message).with_help(help);
        if self.event.is_some() {
            return self.of_event(statement);
        }
        match (&statement.kind, self.block) {
            (StatementKind::When(_), None) => self.event = Some(statement.clone()),
            (StatementKind::When(_), Some(outer)) => {
                let outer = self.block_list()[outer.number].span;
                let help = "move it outside of the block: events belong to what changes all the time";
                let error = wrong("an event in a block".to_owned(), help);
                self.refuse(error.with_label(outer, "the block begins here"));
                self.fill_block();
                self.event = Some(Statement::broken_event(statement.span));
            }
            (StatementKind::Every(period), None) => self.open_block(Some(period.clone()), statement.span),
            (StatementKind::Every(_), Some(outer)) => {
                let outer = self.block_list()[outer.number].span;
                let error = wrong("a block in a block".to_owned(), "close the first block with `}` before this one");
                self.refuse(error.with_label(outer, "the first block begins here"));
                self.block = None;
                self.open_block(None, statement.span);
            }
            (StatementKind::End, None) if self.component.is_some() => {
                let closed = self.component.take().map(|mut component| {
                    component.extent.end = statement.span.end;
                    component
                });
                self.spec.components.extend(closed);
            }
            (StatementKind::Component { name, parameters }, block) => {
                if let Some(outer) = &self.component {
                    let error =
                        wrong("a component in a component".to_owned(), "close the first one with `}` before this one");
                    let error = error.with_label(outer.span, "the first component begins here");
                    self.refuse(error);
                    self.spec.components.extend(self.component.take());
                } else if block.is_some() {
                    self.refuse(wrong("a component in a block".to_owned(), "close the block with `}` before it"));
                }
                self.block = None;
                self.open_component(Some(name.text.clone()), parameters.clone(), statement.span);
                if let Some(component) = &mut self.component {
                    component.name = name.clone();
                }
            }
            (StatementKind::End, None) => {
                self.refuse(wrong("`}` closes no block".to_owned(), "a block begins with `every 1 ms {`"));
            }
            (StatementKind::End, Some(block)) => {
                if block.empty {
                    let span = self.block_list()[block.number].span;
                    let help = "put equations between the braces, for example `u = 2*x`, or remove the block";
                    let error = Diagnostic::error(codes::BAD_BLOCK, span, "the block is empty");
                    self.refuse(error.with_help(help));
                }
                self.block = None;
            }
            (StatementKind::State { sort: Sort::Angle, .. }, Some(_)) => {
                self.fill_block();
                let help = "sampled states are no angles: declare it outside of the block";
                self.refuse(wrong("an angle in a block".to_owned(), help));
                return false;
            }
            (StatementKind::State { .. } | StatementKind::Matrix { .. } | StatementKind::Equation(_), _) => {
                self.fill_block();
                return false;
            }
            (StatementKind::Connector { .. }, None) if self.component.is_none() => {
                let help = "write what drives it in runs, for example `= sine(1, 1 Hz)`; only the inputs of a component have nothing here";
                self.refuse(wrong("this input has no signal".to_owned(), help));
            }
            (kind, None) => {
                let help = match kind {
                    _ if self.component.is_none() => return false,
                    StatementKind::Const { .. } => "write `param`, or move it outside",
                    StatementKind::Index(_) | StatementKind::Function { .. } | StatementKind::Include(_) => {
                        "move it outside: it counts for the whole spec"
                    }
                    StatementKind::Output(_) => "outputs are named outside, for example `output soma.v`",
                    StatementKind::Model { .. }
                    | StatementKind::Solver(_)
                    | StatementKind::Step(..)
                    | StatementKind::Span(_)
                    | StatementKind::Units(_)
                    | StatementKind::Time(_) => "move it outside: it describes the whole model",
                    _ => return false,
                };
                self.refuse(wrong("this statement is not allowed in a component".to_owned(), help));
            }
            (_, Some(_)) => {
                self.fill_block();
                let help = "a block holds `state` statements and equations; move this one outside";
                self.refuse(wrong("this statement is not allowed in a block".to_owned(), help));
                if let StatementKind::Include(_) = statement.kind {
                    self.give_up();
                    return true;
                }
                return false;
            }
        }
        true
    }

    /// Takes a statement while an event is open: what it assigns, or its end.
    fn of_event(&mut self, statement: &Statement) -> bool {
        let Some(mut event) = self.event.take() else { return false };
        let StatementKind::When(when) = &mut event.kind else { return false };
        let wrong =
            |message: &str, help: &str| Diagnostic::error(codes::BAD_BLOCK, statement.span, message).with_help(help);
        match &statement.kind {
            StatementKind::End => {
                let is_empty = when.assignments.is_empty();
                let is_broken = matches!(when.trigger.kind, ExprKind::Number(_));
                if is_empty && !is_broken {
                    let help = "say what it assigns between the braces, for example `{ v = -65 }`";
                    self.refuse(
                        Diagnostic::error(codes::BAD_BLOCK, event.span, "the event assigns nothing").with_help(help),
                    );
                }
                if !is_empty && !is_broken {
                    match &mut self.component {
                        Some(component) => component.statements.push(event),
                        None => self.spec.statements.push(event),
                    }
                }
                return true;
            }
            StatementKind::Equation(equation) if equation.side == LeftSide::Algebraic => {
                let extra =
                    equation.unit.as_ref().map(|unit| unit.span).or(equation.within.as_ref().map(|range| range.span));
                let extra = extra.or(equation.ranges.first().map(|binder| binder.name.span));
                match extra.or(equation.condition.as_ref().map(|condition| condition.span)) {
                    None => {}
                    Some(_) => self.refuse(wrong(
                        "an assignment of an event is a name and a value",
                        "leave out unit, range and `where`; ranges of indices stand behind the condition: `when v[i] > 1 for i in 1..3 {`",
                    )),
                }
                when.assignments.push(equation.clone());
            }
            other => {
                when.trigger.kind = ExprKind::Number(0.0);
                self.refuse(wrong(
                    "this statement is not allowed in an event",
                    "an event holds assignments such as `v = -65`; close it with `}` before this statement",
                ));
                // What is no equation tells that the brace is missing, and counts.
                if !matches!(other, StatementKind::Equation(_)) {
                    return self.blocks(statement);
                }
            }
        }
        self.event = Some(event);
        true
    }

    fn open_block(&mut self, period: Option<Measure>, span: Span) {
        let blocks = self.block_list();
        let number = blocks.len();
        blocks.push(Block { period, span });
        self.block = Some(OpenBlock { number, empty: true });
    }

    /// The blocks of the component that is being read, or of the spec.
    fn block_list(&mut self) -> &mut Vec<Block> {
        match &mut self.component {
            Some(component) => &mut component.blocks,
            None => &mut self.spec.blocks,
        }
    }

    fn open_component(&mut self, name: Option<String>, parameters: Vec<Parameter>, span: Span) {
        let broken = name.is_none();
        let name = Name { text: name.unwrap_or_default(), span };
        let (statements, blocks) = (Vec::new(), Vec::new());
        self.component = Some(Component { name, parameters, statements, blocks, span, extent: span, broken });
    }

    /// Notes that the open block, if there is one, holds a statement.
    fn fill_block(&mut self) {
        if let Some(block) = &mut self.block {
            block.empty = false;
        }
    }

    /// Reads a data file, unless it has been read.
    fn data_file(&mut self, path: &Name, own_folder: &str) {
        let read = resolve(own_folder, path).map_err(Box::new).and_then(|resolved| {
            if let Some((_, file, table)) = self.data.iter().find(|(known, ..)| *known == resolved) {
                self.spec.files.push((path.span, *file));
                return Ok(*table);
            }
            let file = load(self.sources, self.loader, &resolved, path.span)?;
            self.spec.files.push((path.span, file));
            let table = Table::read(&self.sources.text()[..file.range().end], file, self.report);
            let number = table.is_some().then_some(self.spec.tables.len());
            self.spec.tables.extend(table.map(Arc::new));
            self.data.push((resolved, file, number));
            Ok(number)
        });
        match read {
            Ok(Some(number)) => _ = self.spec.table_at.insert(path.span, number),
            Ok(None) => self.spec.broken.push(Broken::default()),
            Err(problem) => {
                self.report.push(*problem);
                self.spec.broken.push(Broken::default());
            }
        }
    }

    fn include(&mut self, path: &Name, own_folder: &str) {
        let result = resolve(own_folder, path).map_err(Box::new).and_then(|resolved| {
            if self.repeated(&resolved, path.span)? {
                return Ok(());
            }
            let file = load(self.sources, self.loader, &resolved, path.span)?;
            self.spec.files.push((path.span, file));
            self.open.push(Included { path: resolved.clone(), named: path.span, file });
            self.file(file, folder(&resolved));
            self.done.extend(self.open.pop());
            Ok(())
        });
        if let Err(problem) = result {
            self.report.push(*problem);
            self.give_up();
        }
    }

    /// Whether a file has been included already; it joins the model once.
    fn repeated(&mut self, path: &str, named: Span) -> Result<bool, Box<Diagnostic>> {
        if let Some(first) = self.open.iter().position(|open| open.path == path) {
            let mut names: Vec<&str> = self.open[first..].iter().map(|open| open.path.as_str()).collect();
            names.push(path);
            let message = format!("`{}`", names.join("` includes `"));
            let error = Diagnostic::error(codes::INCLUDE_CYCLE, named, message);
            return Err(Box::new(error.with_label(self.open[first].named, "included first from here")));
        }
        if self.open.len() >= DEEPEST_INCLUDE {
            let message = format!("files include one another more than {DEEPEST_INCLUDE} levels deep");
            return Err(Box::new(Diagnostic::error(codes::TOO_DEEP, named, message)));
        }
        let Some(first) = self.done.iter().find(|done| done.path == path) else { return Ok(false) };
        self.spec.files.push((named, first.file));
        // Two files may well need the same third one; twice in one file is a slip.
        if self.sources.file_at(first.named.start).span() == self.sources.file_at(named.start).span() {
            let message = format!("`{path}` is included twice; it counts once");
            let warning = Diagnostic::error(codes::REPEATED_INCLUDE, named, message);
            self.report.push(warning.with_label(first.named, "included first from here").into_warning());
        }
        Ok(true)
    }

    fn misplaced(&mut self, section: &str, span: Span) {
        let message = format!("`{section}` belongs in the main file");
        let error = Diagnostic::error(codes::MISPLACED, span, message);
        let included = self.open.last().map(|open| open.named);
        self.report.push(match included {
            Some(named) => error.with_label(named, "this file is included from here"),
            None => error,
        });
    }

    /// Notes that statements are missing which may have been anything, so that nothing is concluded from their
    /// absence.
    fn give_up(&mut self) {
        let broken = SECTIONS.map(|section| Broken { section: section.to_owned(), names: Vec::new() });
        self.spec.broken.extend(broken);
        self.spec.names_missing = true;
    }
}

impl Statement {
    /// What stands for an event that cannot be understood, while its assignments are passed over.
    fn broken_event(span: Span) -> Statement {
        let trigger = Expr { span, kind: ExprKind::Number(0.0) };
        let when = When { trigger, ranges: Vec::new(), after: None, manners: Vec::new(), assignments: Vec::new() };
        Statement { kind: StatementKind::When(when), block: None, span, files: Vec::new() }
    }
}

/// The keyword of a statement that describes the whole model.
fn section(kind: &StatementKind) -> Option<&'static str> {
    Some(match kind {
        StatementKind::Model { .. } => MAIN_ONLY[0],
        StatementKind::Solver(_) => MAIN_ONLY[1],
        StatementKind::Step(..) => MAIN_ONLY[2],
        StatementKind::Span(_) => MAIN_ONLY[3],
        StatementKind::Units(_) => MAIN_ONLY[4],
        StatementKind::Time(_) => MAIN_ONLY[5],
        _ => return None,
    })
}

/// The statements that a statement stands for: a tunable parameter is a state whose derivative is zero.
fn written_out(statement: Statement) -> Vec<Statement> {
    let StatementKind::Tunable { declared, value, within } = statement.kind else { return vec![statement] };
    let name = &declared.name;
    let index = |binder: &Binder| {
        let reference = Reference { name: binder.name.clone(), subscripts: Vec::new(), span: binder.name.span };
        Expr { span: binder.name.span, kind: ExprKind::Reference(reference) }
    };
    let subscripts: Vec<Expr> = declared.dimensions.iter().map(index).collect();
    let own_range = |binder: &&Binder| binder.range.is_some();
    let equation = StatementKind::Equation(Equation {
        target: Reference { name: name.clone(), subscripts, span: name.span },
        side: LeftSide::Derivative,
        unit: None,
        value: Expr { span: name.span, kind: ExprKind::Number(0.0) },
        within: None,
        ranges: declared.dimensions.iter().filter(own_range).cloned().collect(),
        condition: None,
    });
    let equation = Statement { kind: equation, files: Vec::new(), ..statement };
    let kind = StatementKind::State { declared, initial: value, within: Some(within), sort: Sort::Tunable };
    vec![Statement { kind, files: statement.files, ..equation }, equation]
}
