//! The session: one loop over messages of the editor and results of the threads.
//!
//! A text belongs to the models that include it. A file that no known model includes is a model itself, unless it
//! looks like a part of one; then its model is looked for on disk. Findings of a file are those of all its models.

use crate::Ended;
use crate::capabilities::capabilities;
use crate::files::{Document, Texts, including, is_empty, is_main};
use crate::keys::Key;
use crate::requests::{complete, fixes, hover, layout, navigate, rename};
use crate::text::changed;
use crate::transport::{self, Incoming, Writer};
use crate::view::View;
use crate::worker::{Analysis, Job, Ranges, Worker};
use gen_lsp_types as lsp;
use lsp_server::{ErrorCode, Message, Notification, Request, RequestId, Response};
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::io::{BufRead, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::Duration;

/// A check of a fix elaborates the model; of models that take longer none are offered.
const PATIENCE: Duration = Duration::from_millis(300);

/// What the loop waits for.
enum Event {
    Incoming(Incoming),
    Analysed(Analysis),
    Ran(Ranges),
    Closed,
}

/// A model.
#[derive(Default)]
struct Root {
    /// The state of the texts that was asked to be looked at last.
    wanted: u64,
    /// Whether it is a file that belongs to no known model.
    part: bool,
    /// Files that it was read from, the main one not among them.
    files: Vec<Key>,
    analysis: Option<Analysis>,
    ranges: Option<Ranges>,
}

/// Where the session is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Phase {
    Begun,
    Initialized,
    Down,
}

/// An answer, or why there is none.
type Answer = Result<Value, (ErrorCode, String)>;

struct Server {
    writer: Writer,
    worker: Worker,
    phase: Phase,
    texts: Texts,
    /// Counts changes of texts.
    generation: u64,
    roots: BTreeMap<Key, Root>,
    /// When each text changed last.
    changes: BTreeMap<Key, u64>,
    /// Texts that changed since the models were looked at last.
    dirty: BTreeSet<Key>,
    /// Models as they are now.
    views: BTreeMap<Key, View>,
    /// Open texts that were a whole model; what is typed at the moment makes no part of it.
    mains: BTreeSet<Key>,
    /// Models on disk that include a file.
    including: BTreeMap<Key, Vec<Key>>,
    /// What the editor shows.
    published: BTreeMap<Key, Vec<lsp::Diagnostic>>,
    /// Requests that need the analysis of the present text.
    waiting: Vec<Request>,
    /// Whether the editor tells of changes on disk if it is asked to.
    watches: bool,
}

/// Runs a session.
pub(crate) fn run(mut input: impl BufRead + Send + 'static, output: impl Write + Send + 'static) -> Ended {
    let (sender, events) = channel();
    let (analysed, ran) = (sender.clone(), sender.clone());
    let worker = Worker::new(
        move |analysis| _ = analysed.send(Event::Analysed(analysis)),
        move |ranges| _ = ran.send(Event::Ran(ranges)),
    );
    thread::spawn(move || read_all(&mut input, &sender));
    let mut server = Server {
        writer: Writer::new(output),
        worker,
        phase: Phase::Begun,
        texts: Texts::default(),
        generation: 0,
        roots: BTreeMap::new(),
        changes: BTreeMap::new(),
        dirty: BTreeSet::new(),
        views: BTreeMap::new(),
        mains: BTreeSet::new(),
        including: BTreeMap::new(),
        published: BTreeMap::new(),
        waiting: Vec::new(),
        watches: false,
    };
    server.serve(&events);
    let orderly = server.phase == Phase::Down;
    server.writer.finish();
    if orderly { Ended::Orderly } else { Ended::Abruptly }
}

fn read_all(input: &mut impl BufRead, sender: &Sender<Event>) {
    while let Ok(Some(incoming)) = transport::read(input) {
        let exit = matches!(&incoming, Incoming::Message(Message::Notification(message)) if message.method == "exit");
        if sender.send(Event::Incoming(incoming)).is_err() || exit {
            return;
        }
    }
    let _ = sender.send(Event::Closed);
}

impl Server {
    fn serve(&mut self, events: &Receiver<Event>) {
        let mut queue: VecDeque<Event> = VecDeque::new();
        loop {
            match queue.pop_front() {
                Some(event) => {
                    if !self.event(event, &queue) {
                        return;
                    }
                    queue.extend(events.try_iter());
                }
                None => {
                    // All that was typed so far is one change.
                    self.settle();
                    let Ok(event) = events.recv() else { return };
                    queue.push_back(event);
                    queue.extend(events.try_iter());
                }
            }
        }
    }

    /// Handles an event; `false` at the end. What follows in the queue may cancel it.
    fn event(&mut self, event: Event, queue: &VecDeque<Event>) -> bool {
        match event {
            Event::Closed => return false,
            Event::Incoming(Incoming::Refused(answer)) => self.writer.send_value(answer),
            Event::Incoming(Incoming::Message(Message::Response(_))) => {}
            Event::Incoming(Incoming::Message(Message::Notification(message))) => {
                if message.method == "exit" {
                    return false;
                }
                self.notified(message);
            }
            Event::Incoming(Incoming::Message(Message::Request(request))) => {
                if queue.iter().any(|event| cancels(event, &request.id)) {
                    self.refuse(request.id, ErrorCode::RequestCanceled, "cancelled");
                } else {
                    self.asked(request);
                }
            }
            Event::Analysed(analysis) => self.analysed(analysis),
            Event::Ran(ranges) => {
                if let Some(root) = self.roots.get_mut(&ranges.root) {
                    root.ranges = Some(ranges);
                }
            }
        }
        true
    }

    fn refuse(&self, id: RequestId, code: ErrorCode, message: &str) {
        self.writer.send(&Response::new_err(id, code as i32, message.to_owned()).into());
    }

    fn asked(&mut self, request: Request) {
        match (self.phase, request.method.as_str()) {
            (Phase::Begun, "initialize") => {
                let watches = "/capabilities/workspace/didChangeWatchedFiles/dynamicRegistration";
                self.watches = request.params.pointer(watches).and_then(Value::as_bool).unwrap_or(false);
                self.phase = Phase::Initialized;
                self.writer.send(&Response::new_ok(request.id, capabilities()).into());
            }
            (Phase::Begun, _) => self.refuse(request.id, ErrorCode::ServerNotInitialized, "`initialize` comes first"),
            (Phase::Initialized, "shutdown") => {
                self.phase = Phase::Down;
                self.writer.send(&Response::new_ok(request.id, ()).into());
            }
            (Phase::Initialized, "initialize") | (Phase::Down, _) => {
                self.refuse(request.id, ErrorCode::InvalidRequest, "not at this time");
            }
            (Phase::Initialized, _) => {
                self.settle();
                self.answer(request);
            }
        }
    }

    /// Answers a request, or lets it wait for the analysis that it needs.
    fn answer(&mut self, request: Request) {
        let needs_analysis = matches!(request.method.as_str(), "textDocument/hover" | "textDocument/codeAction");
        if needs_analysis && self.main_model(&request).is_some_and(|root| !self.is_current(&root)) {
            self.waiting.push(request);
            return;
        }
        let id = request.id.clone();
        let answer = catch_unwind(AssertUnwindSafe(|| self.answered(request)));
        let failed = (ErrorCode::InternalError, "internal error; please report it".to_owned());
        match answer.unwrap_or(Err(failed)) {
            Ok(value) => self.writer.send(&Response::new_ok(id, value).into()),
            Err((code, message)) => self.refuse(id, code, &message),
        }
    }

    /// The model in which a request is answered.
    fn main_model(&mut self, request: &Request) -> Option<Key> {
        let uri = request.params.pointer("/textDocument/uri")?.as_str()?.to_owned();
        self.models_of(&Key::of(&uri)).into_iter().next()
    }

    fn is_current(&self, root: &Key) -> bool {
        let Some(root) = self.roots.get(root) else { return true };
        root.analysis.as_ref().is_some_and(|analysis| analysis.generation == root.wanted)
    }

    fn answered(&mut self, request: Request) -> Answer {
        match request.method.as_str() {
            "textDocument/hover" => self.about(&request.params, |server, view, file, position| {
                let root = server.roots.get(&view.root);
                let analysis = root.and_then(|root| root.analysis.as_ref());
                let results = hover::Results { analysis, ranges: root.and_then(|root| root.ranges.as_ref()) };
                answer_of(hover::hover(view, file, position, &results))
            }),
            "textDocument/definition" => self.about(&request.params, |_, view, file, position| {
                answer_of(navigate::definition(view, file, position))
            }),
            "textDocument/references" => {
                let declaration = request.params.pointer("/context/includeDeclaration").and_then(Value::as_bool);
                self.about(&request.params, |_, view, file, position| {
                    answer_of(navigate::references(view, file, position, declaration.unwrap_or(true)))
                })
            }
            "textDocument/documentHighlight" => self.about(&request.params, |_, view, file, position| {
                answer_of(navigate::highlights(view, file, position))
            }),
            "textDocument/completion" => {
                self.about(&request.params, |_, view, file, position| answer_of(complete::items(view, file, position)))
            }
            "textDocument/prepareRename" => {
                self.about(&request.params, |_, view, file, position| match rename::place(view, file, position) {
                    Ok((range, placeholder)) => Ok(json!({"range": range, "placeholder": placeholder})),
                    Err(reason) => Err((ErrorCode::RequestFailed, reason)),
                })
            }
            "textDocument/rename" => self.renamed(request.params),
            "textDocument/documentSymbol" => {
                let params: lsp::DocumentSymbolParams = understood(request.params)?;
                let key = Key::of(&params.text_document.uri.0);
                let found = self.located(&key).map(|(view, file)| navigate::symbols(view, file));
                answer_of(found.unwrap_or_default())
            }
            "textDocument/formatting" => {
                let params: lsp::DocumentFormattingParams = understood(request.params)?;
                let key = Key::of(&params.text_document.uri.0);
                answer_of(self.texts.get(&key).and_then(|document| layout::edits(&key, &document.text)))
            }
            "textDocument/codeAction" => {
                let params: lsp::CodeActionParams = understood(request.params)?;
                answer_of(self.fixes(&Key::of(&params.text_document.uri.0), params.range))
            }
            other => Err((ErrorCode::MethodNotFound, format!("`{other:.100}` is not supported"))),
        }
    }

    /// Answers about a position, in the first model that its file belongs to.
    fn about(&mut self, params: &Value, answer: impl Fn(&Server, &View, usize, lsp::Position) -> Answer) -> Answer {
        let at: lsp::TextDocumentPositionParams = understood(params.clone())?;
        let key = Key::of(&at.text_document.uri.0);
        let Some(root) = self.models_of(&key).into_iter().next() else { return Ok(Value::Null) };
        let Some(view) = self.views.get(&root) else { return Ok(Value::Null) };
        match view.file(&key) {
            Some(file) => answer(self, view, file, at.position),
            None => Ok(Value::Null),
        }
    }

    fn located(&mut self, key: &Key) -> Option<(&View, usize)> {
        let root = self.models_of(key).into_iter().next()?;
        let view = self.views.get(&root)?;
        Some((view, view.file(key)?))
    }

    fn fixes(&mut self, key: &Key, range: lsp::Range) -> Vec<lsp::CodeAction> {
        let Some(root) = self.models_of(key).into_iter().next() else { return Vec::new() };
        let (Some(view), Some(Root { analysis: Some(analysis), part: false, .. })) =
            (self.views.get(&root), self.roots.get(&root))
        else {
            return Vec::new();
        };
        match view.file(key) {
            Some(file) if analysis.took <= PATIENCE => fixes::fixes(view, &analysis.findings, file, range),
            _ => Vec::new(),
        }
    }

    fn renamed(&mut self, params: Value) -> Answer {
        let params: lsp::RenameParams = understood(params)?;
        let at = &params.text_document_position_params;
        let key = Key::of(&at.text_document.uri.0);
        let Some((root, file)) = self.located(&key).map(|(view, file)| (view.root.clone(), file)) else {
            return Ok(Value::Null);
        };
        let Some(view) = self.views.get(&root) else { return Ok(Value::Null) };
        let texts = &self.texts;
        let known: Vec<Key> = self.roots.keys().cloned().collect();
        let mut models = |key: &Key| {
            let on_disk = key.path().map(|path| including(path, texts)).unwrap_or_default();
            let roots: BTreeSet<Key> = known.iter().cloned().chain(on_disk).collect();
            let views = roots.iter().filter_map(|root| View::read(root, texts));
            views.filter(|view| view.file(key).is_some()).collect()
        };
        match rename::rename(view, (file, at.position), &params.new_name, &mut models) {
            Ok(edit) => answer_of(edit),
            Err(reason) => Err((ErrorCode::RequestFailed, reason)),
        }
    }

    /// The models that a file is part of, its own first; they are read where they have changed.
    fn models_of(&mut self, key: &Key) -> Vec<Key> {
        let mut models = Vec::new();
        for root in self.roots.keys().cloned().collect::<Vec<_>>() {
            if !self.views.contains_key(&root) {
                let view = View::read(&root, &self.texts);
                view.into_iter().for_each(|view| _ = self.views.insert(root.clone(), view));
            }
            if self.views.get(&root).is_some_and(|view| view.file(key).is_some()) {
                models.push(root);
            }
        }
        models.sort_by_key(|root| root != key);
        models
    }

    fn notified(&mut self, message: Notification) {
        if self.phase != Phase::Initialized {
            return;
        }
        let method = message.method.clone();
        match method.as_str() {
            "initialized" => self.watch_files(),
            "textDocument/didOpen" => {
                let Ok(params) = understood::<lsp::DidOpenTextDocumentParams>(message.params) else { return };
                let item = params.text_document;
                let (uri, version) = (item.uri.0, item.version);
                let key = Key::of(&uri);
                self.texts.set(key.clone(), Document { uri, version, text: item.text.into() });
                self.including.clear();
                self.change(key);
            }
            "textDocument/didChange" => {
                let Ok(params) = understood::<lsp::DidChangeTextDocumentParams>(message.params) else { return };
                let key = Key::of(&params.text_document.text_document_identifier.uri.0);
                let Some(document) = self.texts.get(&key).cloned() else { return };
                let text = params.content_changes.into_iter().fold(None, |text: Option<String>, change| {
                    Some(changed(text.as_deref().unwrap_or(&document.text), change))
                });
                let text = text.map_or(document.text, Into::into);
                self.texts.set(key.clone(), Document { version: params.text_document.version, text, ..document });
                self.change(key);
            }
            "textDocument/didClose" => {
                let Ok(params) = understood::<lsp::DidCloseTextDocumentParams>(message.params) else { return };
                let key = Key::of(&params.text_document.uri.0);
                self.texts.remove(&key);
                self.mains.remove(&key);
                self.including.clear();
                self.change(key);
            }
            "textDocument/didSave" => {
                let Ok(params) = understood::<lsp::DidSaveTextDocumentParams>(message.params) else { return };
                self.including.clear();
                let key = Key::of(&params.text_document.uri.0);
                self.mains.remove(&key);
                self.change(key);
            }
            "workspace/didChangeWatchedFiles" => {
                let Ok(params) = understood::<lsp::DidChangeWatchedFilesParams>(message.params) else { return };
                self.including.clear();
                params.changes.iter().for_each(|change| self.change(Key::of(&change.uri.0)));
            }
            "$/cancelRequest" => {
                let id = message.params.get("id").cloned().unwrap_or_default();
                if let Ok(id) = serde_json::from_value::<RequestId>(id)
                    && let Some(at) = self.waiting.iter().position(|request| request.id == id)
                {
                    self.waiting.remove(at);
                    self.refuse(id, ErrorCode::RequestCanceled, "cancelled");
                }
            }
            _ => {}
        }
    }

    /// Asks the editor to tell of specs and data files that change on disk.
    fn watch_files(&self) {
        if self.watches {
            let watchers = json!([{"globPattern": "**/*.{spec,inc,csv}"}]);
            let method = "workspace/didChangeWatchedFiles";
            let registration = json!({"id": "files", "method": method, "registerOptions": {"watchers": watchers}});
            let params = json!({"registrations": [registration]});
            let id = RequestId::from("files".to_owned());
            self.writer.send(&Request::new(id, "client/registerCapability".to_owned(), params).into());
        }
    }

    /// Notes that a text is another one.
    fn change(&mut self, key: Key) {
        self.generation += 1;
        let holds = |root: &Key, view: &View| *root == key || view.asked.contains(&key);
        // The others are what they were, but for what is open in the editor.
        self.views.retain(|root, view| !holds(root, view));
        self.changes.insert(key.clone(), self.generation);
        self.dirty.insert(key);
    }

    /// Finds out which models there are, and lets those be looked at that have changed.
    fn settle(&mut self) {
        let dirty = std::mem::take(&mut self.dirty);
        if dirty.is_empty() {
            return;
        }
        let wanted = self.wanted_roots();
        let gone: Vec<Key> = self.roots.keys().filter(|root| !wanted.contains_key(root)).cloned().collect();
        for root in gone {
            self.worker.forget(&root);
            self.roots.remove(&root);
            self.views.remove(&root);
        }
        for (key, part) in wanted {
            let new = !self.roots.contains_key(&key);
            let root = self.roots.entry(key.clone()).or_default();
            let changed = dirty.contains(&key) || root.files.iter().any(|file| dirty.contains(file));
            if new || changed || root.part != part {
                (root.wanted, root.part) = (self.generation, part);
                self.worker.analyse(Job { root: key, generation: self.generation, texts: self.texts.clone(), part });
            }
        }
        self.publish();
        self.release();
    }

    /// Main files of models, and whether each is a part whose model is not known.
    fn wanted_roots(&mut self) -> BTreeMap<Key, bool> {
        let texts = self.texts.clone();
        // Data files are no specs.
        let specs = |key: &Key| key.path().is_none_or(|path| path.extension().is_none_or(|end| end != "csv"));
        let (mains, parts): (Vec<_>, Vec<_>) =
            texts.all().filter(|(key, _)| specs(key)).partition(|(_, document)| is_main(&document.text));
        let mut wanted: BTreeMap<Key, bool> = mains.into_iter().map(|(key, _)| (key.clone(), false)).collect();
        let mut found = Vec::new();
        for (key, document) in parts {
            let held = wanted.keys().any(|main| self.roots.get(main).is_some_and(|root| root.files.contains(key)));
            if held {
                continue;
            }
            if self.mains.contains(key) || is_empty(&document.text) {
                found.push((key.clone(), false));
                continue;
            }
            let models = self
                .including
                .entry(key.clone())
                .or_insert_with(|| key.path().map(|path| including(path, &texts)).unwrap_or_default());
            found.extend(models.iter().map(|main| (main.clone(), false)));
            if models.is_empty() {
                found.push((key.clone(), true));
            }
        }
        wanted.extend(found);
        self.mains.extend(wanted.iter().filter(|(_, part)| !**part).map(|(key, _)| key.clone()));
        wanted
    }

    fn analysed(&mut self, analysis: Analysis) {
        let Some(root) = self.roots.get_mut(&analysis.root).filter(|root| root.wanted == analysis.generation) else {
            return;
        };
        if root.files != analysis.asked {
            root.files.clone_from(&analysis.asked);
            // A part that is open may belong to it, and may have changed before this was known.
            let changed = |key: &&Key| self.changes.get(key).is_some_and(|at| *at > analysis.generation);
            let late = analysis.asked.iter().find(changed).cloned();
            self.dirty.insert(late.unwrap_or(Key::Other(String::new())));
        }
        root.analysis = Some(analysis);
        self.publish();
        self.release();
    }

    /// Answers requests whose analysis is there.
    fn release(&mut self) {
        for request in std::mem::take(&mut self.waiting) {
            self.answer(request);
        }
    }

    /// Whether all models that a file is part of have been looked at as they are.
    fn shows(&self, key: &Key) -> bool {
        let mut models = self.roots.iter().filter(|(root, state)| *root == key || state.files.contains(key));
        models.all(|(root, _)| self.is_current(root))
    }

    /// Shows the findings of all models, those files first that come first by name. A finding of several models is shown
    /// once.
    fn publish(&mut self) {
        let mut shown: BTreeMap<Key, Vec<lsp::Diagnostic>> = BTreeMap::new();
        for analysis in self.roots.values().filter_map(|root| root.analysis.as_ref()) {
            for (key, findings) in &analysis.shown {
                let known = shown.entry(key.clone()).or_default();
                for finding in findings {
                    if !known.contains(finding) {
                        known.push(finding.clone());
                    }
                }
            }
        }
        let open = self.texts.all().map(|(key, _)| key);
        let keys: BTreeSet<Key> = shown.keys().chain(self.published.keys()).chain(open).cloned().collect();
        for key in keys {
            // What is typed at the moment keeps its old findings until the new ones are there.
            if !self.shows(&key) {
                continue;
            }
            let findings = shown.remove(&key).unwrap_or_default();
            if self.published.get(&key) != Some(&findings) {
                let uri = self.texts.uri(&key);
                let mut params = json!({"uri": uri, "diagnostics": findings});
                if let Some(document) = self.texts.get(&key) {
                    params["version"] = document.version.into();
                }
                let method = "textDocument/publishDiagnostics".to_owned();
                self.writer.send(&Notification { method, params }.into());
                match findings.is_empty() && self.texts.get(&key).is_none() {
                    true => _ = self.published.remove(&key),
                    false => _ = self.published.insert(key, findings),
                }
            }
        }
    }
}

fn cancels(event: &Event, id: &RequestId) -> bool {
    let Event::Incoming(Incoming::Message(Message::Notification(message))) = event else { return false };
    let cancelled = || serde_json::from_value::<RequestId>(message.params.get("id")?.clone()).ok();
    message.method == "$/cancelRequest" && cancelled().is_some_and(|cancelled| cancelled == *id)
}

fn understood<P: DeserializeOwned>(params: Value) -> Result<P, (ErrorCode, String)> {
    serde_json::from_value(params).map_err(|error| (ErrorCode::InvalidParams, error.to_string()))
}

fn answer_of(value: impl serde::Serialize) -> Answer {
    serde_json::to_value(value).map_err(|error| (ErrorCode::InternalError, error.to_string()))
}
