//! An editor for tests: real pipes, a script of messages, and no patience.

// Each test binary uses a part of this.
#![allow(dead_code)]

use pe_frontend::vocabulary::{WordKind, words};
use pe_lsp::Ended;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader, PipeWriter, Write, pipe};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// A server that takes longer hangs.
const PATIENCE: Duration = Duration::from_secs(30);

/// An editor with a server behind it.
pub struct Editor {
    to: Option<PipeWriter>,
    from: Receiver<Value>,
    server: JoinHandle<Ended>,
    next: i32,
    /// Findings of each file as shown at present.
    pub shown: BTreeMap<String, Vec<Value>>,
    /// Version of the text that the findings are about.
    pub versions: BTreeMap<String, i64>,
    /// Answers that nobody has asked for yet.
    answers: Vec<Value>,
}

impl Editor {
    /// A session that has not begun.
    pub fn silent() -> Editor {
        let (input, to) = pipe().expect("a pipe");
        let (output, from) = pipe().map(|(reader, writer)| (writer, reader)).expect("a pipe");
        let server = thread::spawn(move || pe_lsp::serve(BufReader::new(input), output));
        let (sender, received) = channel();
        thread::spawn(move || {
            let mut from = BufReader::new(from);
            while let Some(message) = read(&mut from) {
                if sender.send(message).is_err() {
                    return;
                }
            }
        });
        Editor {
            to: Some(to),
            from: received,
            server,
            next: 0,
            shown: BTreeMap::new(),
            versions: BTreeMap::new(),
            answers: Vec::new(),
        }
    }

    /// A session that has begun.
    pub fn new() -> Editor {
        let mut editor = Editor::silent();
        let answer = editor.ask("initialize", json!({"processId": null, "rootUri": null, "capabilities": {}}));
        assert_eq!(answer["result"]["capabilities"]["positionEncoding"], "utf-16", "{answer}");
        editor.tell("initialized", json!({}));
        editor
    }

    /// Sends bytes, whatever they are.
    pub fn send(&mut self, bytes: &[u8]) {
        let to = self.to.as_mut().expect("the stream is open");
        to.write_all(bytes).and_then(|()| to.flush()).expect("the server reads");
    }

    pub fn message(&mut self, message: &Value) {
        let text = message.to_string();
        self.send(format!("Content-Length: {}\r\n\r\n{text}", text.len()).as_bytes());
    }

    /// Sends a notification.
    pub fn tell(&mut self, method: &str, params: Value) {
        self.message(&json!({"jsonrpc": "2.0", "method": method, "params": params}));
    }

    /// Sends a request and gives its number.
    pub fn request(&mut self, method: &str, params: Value) -> i32 {
        self.next += 1;
        let id = self.next;
        self.message(&json!({"jsonrpc": "2.0", "id": id, "method": method, "params": params}));
        id
    }

    /// The answer to a request.
    pub fn ask(&mut self, method: &str, params: Value) -> Value {
        let id = self.request(method, params);
        self.answer(id.into())
    }

    /// The answer with this number.
    pub fn answer(&mut self, id: Value) -> Value {
        let until = Instant::now() + PATIENCE;
        loop {
            if let Some(at) = self.answers.iter().position(|answer| answer["id"] == id) {
                return self.answers.remove(at);
            }
            self.receive(until);
        }
    }

    /// Waits until a text has just these findings.
    pub fn expect(&mut self, uri: &str, wanted: &[String]) {
        let until = Instant::now() + PATIENCE;
        while self.shown.get(uri).is_none_or(|found| places(found) != wanted) {
            assert!(
                self.try_receive(until),
                "{uri}: {:?} and not {wanted:?}",
                self.shown.get(uri).map(|found| places(found))
            );
        }
    }

    /// The findings of a text once those of a version are there.
    pub fn findings(&mut self, uri: &str, version: i64) -> Vec<Value> {
        let until = Instant::now() + PATIENCE;
        while self.versions.get(uri).is_none_or(|known| *known < version) {
            self.receive(until);
        }
        self.shown[uri].clone()
    }

    /// Takes in messages until something holds of what is shown.
    pub fn wait(&mut self, holds: impl Fn(&Editor) -> bool) {
        let until = Instant::now() + PATIENCE;
        while !holds(self) {
            self.receive(until);
        }
    }

    fn receive(&mut self, until: Instant) {
        assert!(self.try_receive(until), "the server is silent; shown: {:?}", self.shown);
    }

    /// Takes in a message, unless none comes.
    fn try_receive(&mut self, until: Instant) -> bool {
        let left = until.saturating_duration_since(Instant::now());
        let Ok(message) = self.from.recv_timeout(left) else { return false };
        if message["method"] == "textDocument/publishDiagnostics" {
            let params = &message["params"];
            let uri = params["uri"].as_str().expect("an address").to_owned();
            self.versions.insert(uri.clone(), params["version"].as_i64().unwrap_or(0));
            self.shown.insert(uri, params["diagnostics"].as_array().expect("a list").clone());
        } else {
            self.answers.push(message);
        }
        true
    }

    /// Opens a text.
    pub fn open(&mut self, uri: &str, text: &str) {
        let item = json!({"uri": uri, "languageId": "ode", "version": 1, "text": text});
        self.tell("textDocument/didOpen", json!({"textDocument": item}));
    }

    /// Replaces a range of a text, `[line, character, line, character]`.
    pub fn change(&mut self, uri: &str, version: i64, [line, from, end, to]: [u32; 4], new: &str) {
        let range = json!({"start": {"line": line, "character": from}, "end": {"line": end, "character": to}});
        let params = json!({"textDocument": {"uri": uri, "version": version},
                            "contentChanges": [{"range": range, "text": new}]});
        self.tell("textDocument/didChange", params);
    }

    /// Replaces a text as a whole.
    pub fn replace(&mut self, uri: &str, version: i64, new: &str) {
        let params = json!({"textDocument": {"uri": uri, "version": version}, "contentChanges": [{"text": new}]});
        self.tell("textDocument/didChange", params);
    }

    /// Asks about a position.
    pub fn at(&mut self, method: &str, uri: &str, (line, character): (u32, u32), more: Value) -> Value {
        let mut params = json!({"textDocument": {"uri": uri}, "position": {"line": line, "character": character}});
        if let (Value::Object(all), Value::Object(more)) = (&mut params, more) {
            all.extend(more);
        }
        self.ask(&format!("textDocument/{method}"), params)
    }

    /// Ends the session as an editor does.
    pub fn quit(mut self) -> Ended {
        assert_eq!(self.ask("shutdown", Value::Null)["result"], Value::Null);
        self.tell("exit", Value::Null);
        self.server.join().expect("no panic")
    }

    /// Closes the stream.
    pub fn vanish(mut self) -> Ended {
        self.to = None;
        self.server.join().expect("no panic")
    }

    /// Waits for the end of the server.
    pub fn ended(self) -> Ended {
        self.server.join().expect("no panic")
    }
}

fn read(from: &mut impl BufRead) -> Option<Value> {
    let mut size = None;
    loop {
        let mut line = String::new();
        if from.read_line(&mut line).ok()? == 0 {
            return None;
        }
        match line.trim().split_once(": ") {
            Some(("Content-Length", number)) => size = number.parse().ok(),
            _ => break,
        }
    }
    let mut body = vec![0; size.expect("a size")];
    from.read_exact(&mut body).ok()?;
    Some(serde_json::from_slice(&body).expect("an answer is JSON"))
}

/// A folder of a test, empty at first.
pub fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a folder");
    folder.canonicalize().expect("a folder")
}

/// The address of a file.
pub fn uri(path: &Path) -> String {
    format!("file://{}", path.display())
}

/// Codes of findings with their ranges, `E0201 1:4-1:7`, lines and characters from 0 on.
pub fn places(findings: &[Value]) -> Vec<String> {
    findings
        .iter()
        .map(|finding| format!("{} {}", finding["code"].as_str().unwrap_or("-"), place(&finding["range"])))
        .collect()
}

/// A range as text.
pub fn place(range: &Value) -> String {
    let point = |at: &Value| format!("{}:{}", at["line"], at["character"]);
    format!("{}-{}", point(&range["start"]), point(&range["end"]))
}

/// All specs below a folder, sorted.
pub fn specs(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            found.extend(specs(&path));
        } else if path.extension().is_some_and(|extension| extension == "spec") {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// The shipped models.
pub fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models").canonicalize().expect("the models")
}

/// Applies changes of an answer to a text.
pub fn apply(text: &str, edits: &[Value]) -> String {
    let mut starts = vec![0];
    starts.extend(text.match_indices('\n').map(|(at, _)| at + 1));
    let offset = |at: &Value| {
        let start = starts[at["line"].as_u64().expect("a line") as usize];
        let mut units = at["character"].as_u64().expect("a character") as usize;
        let mut end = start;
        for letter in text[start..].chars() {
            if units == 0 {
                break;
            }
            units -= letter.len_utf16();
            end += letter.len_utf8();
        }
        end
    };
    let mut parts: Vec<(usize, usize, &str)> = edits
        .iter()
        .map(|edit| {
            let range = &edit["range"];
            (offset(&range["start"]), offset(&range["end"]), edit["newText"].as_str().expect("a text"))
        })
        .collect();
    parts.sort_unstable();
    let mut new = text.to_owned();
    for (from, to, part) in parts.into_iter().rev() {
        new.replace_range(from..to, part);
    }
    new
}

/// Milliseconds from a key press to its findings, of this many edits at random words of a text: a sign that no spec may
/// hold, and its removal.
pub fn key_presses(uri: &str, text: &str, edits: usize) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let words: Vec<usize> = words(text)
        .iter()
        .filter(|word| matches!(word.kind, WordKind::Name | WordKind::Number))
        .map(|word| word.span.range().start)
        .collect();
    let mut editor = Editor::new();
    editor.open(uri, text);
    editor.findings(uri, 1);
    let mut times = Vec::new();
    for version in (2..).step_by(2).take(edits.div_ceil(2)) {
        let before = &text[..words[random.random_range(0..words.len())]];
        let line = before.matches('\n').count() as u32;
        let start = before.rfind('\n').map_or(0, |at| at + 1);
        let character = before[start..].encode_utf16().count() as u32;
        for (version, range, new) in [
            (version, [line, character, line, character], "$"),
            (version + 1, [line, character, line, character + 1], ""),
        ] {
            let pressed = Instant::now();
            editor.change(uri, version, range, new);
            let found = editor.findings(uri, version);
            times.push(pressed.elapsed().as_secs_f64() * 1e3);
            assert_eq!(found.iter().any(|finding| finding["code"] == "E0102"), new == "$", "{found:?}");
        }
    }
    assert_eq!(editor.quit(), Ended::Orderly);
    times
}
