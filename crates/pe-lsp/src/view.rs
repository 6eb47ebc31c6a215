//! A model as its syntax tree has it: enough for most requests, and there at once.

use crate::files::{Files, Texts};
use crate::keys::Key;
use crate::text::Lines;
use gen_lsp_types::{Location, Position, Range, Uri};
use pe_frontend::Spec;
use pe_frontend::symbols::{Occurrence, Symbol, Symbols};
use pe_ir::index::{at, number};
use pe_ir::source::{Diagnostic, Sources, Span};
use std::cell::OnceCell;

/// A model, from its main file.
pub(crate) struct View {
    /// The main file.
    pub(crate) root: Key,
    /// All its files.
    pub(crate) sources: Sources,
    /// What they say.
    pub(crate) spec: Spec,
    /// What is wrong with their syntax.
    pub(crate) findings: Vec<Diagnostic>,
    /// Files that were asked for, whether they exist or not.
    pub(crate) asked: Vec<Key>,
    /// The texts of the editor that it was read from.
    pub(crate) texts: Texts,
    symbols: OnceCell<Symbols>,
    lines: Vec<OnceCell<Lines>>,
}

impl View {
    /// Reads a model; `None` if its main file is gone.
    pub(crate) fn read(root: &Key, texts: &Texts) -> Option<View> {
        let (mut sources, problem) = texts.main_file(root)?;
        let files = Files::of(root, texts);
        let (spec, mut findings) = pe_frontend::parse(&mut sources, &files);
        findings.extend(problem);
        let lines = sources.files().iter().map(|_| OnceCell::new()).collect();
        let asked = files.asked();
        let (root, texts) = (root.clone(), texts.clone());
        Some(View { root, sources, spec, findings, asked, texts, symbols: OnceCell::new(), lines })
    }

    /// Its names.
    pub(crate) fn symbols(&self) -> &Symbols {
        self.symbols.get_or_init(|| Symbols::of(&self.spec))
    }

    /// The file with this number.
    pub(crate) fn key(&self, file: usize) -> Key {
        match &self.root {
            Key::File(_) if file > 0 => Key::File(self.sources.files()[file].name().into()),
            root => root.clone(),
        }
    }

    /// Number of the file that holds an offset.
    pub(crate) fn file_at(&self, offset: u32) -> usize {
        let next = self.sources.files().partition_point(|file| file.span().start <= offset);
        next.saturating_sub(1)
    }

    /// The text of a file.
    pub(crate) fn text(&self, file: usize) -> &str {
        &self.sources.text()[self.sources.files()[file].span().range()]
    }

    fn lines(&self, file: usize) -> &Lines {
        self.lines[file].get_or_init(|| Lines::of(self.text(file)))
    }

    /// The file and the range there of a span; one that leaves its file ends with it.
    pub(crate) fn range(&self, span: Span) -> (usize, Range) {
        let file = self.file_at(span.start);
        let base = self.sources.files()[file].span().range().start;
        let from = span.range().start.saturating_sub(base);
        let to = at(span.end.max(span.start)).saturating_sub(base);
        (file, self.lines(file).range(self.text(file), from..to))
    }

    /// A span as the editor finds it.
    pub(crate) fn location(&self, span: Span) -> Location {
        let (file, range) = self.range(span);
        Location { uri: Uri(self.texts.uri(&self.key(file))), range }
    }

    /// The number of a file among those of the model.
    pub(crate) fn file(&self, key: &Key) -> Option<usize> {
        (0..self.sources.files().len()).find(|file| self.key(*file) == *key)
    }

    /// The offset of a position in a file.
    pub(crate) fn offset(&self, file: usize, position: Position) -> u32 {
        let within = self.lines(file).offset(self.text(file), position);
        self.sources.files()[file].span().start + number(within)
    }

    /// The name at a position.
    pub(crate) fn name_at(&self, file: usize, position: Position) -> Option<(&Occurrence, &Symbol)> {
        let occurrence = self.symbols().at(self.offset(file, position))?;
        Some((occurrence, &self.symbols().all[occurrence.symbol]))
    }

    /// What the spec says in a span.
    pub(crate) fn words(&self, span: Span) -> &str {
        self.sources.text().get(span.range()).unwrap_or_default()
    }
}
