//! Sessions as an editor has them, over real pipes.

mod common;

use common::{Editor, apply, folder, place, places, uri};
use pe_lsp::Ended;
use serde_json::{Value, json};
use std::fs;

/// Two files: the main one, and one that defines `gain` and a function.
const MAIN: &str = "model m \"\u{3a9} and \u{1d465}\"\nsolver rk4\nstep   1 ms\nspan   1 s\n\
                    include \"lib.spec\"\nindex i in 1..3\nstate x[i] [V] = 0.5*i\n\
                    x[i]' = -gain*x[i] + half(gain)*x[i] /* */\noutput x\n";
const LIB: &str = "param gain [1/s] = 2\nfunction half(a) = a/2\n";

fn main_text() -> String {
    MAIN.replace(" /* */", "")
}

#[test]
fn a_finding_is_at_its_utf16_range_and_goes_when_it_is_mended() {
    let mut editor = Editor::new();
    // After characters of one and of two units, a tab, and with line ends of two characters.
    let text = main_text().replace("include \"lib.spec\"\n", "param gain [1/s] = 2\n").replace("half(gain)", "gain/2");
    let text = text.replace('\n', "\r\n");
    let uri = "untitled:Untitled-1";
    editor.open(uri, &text);
    assert_eq!(editor.findings(uri, 1), Vec::<Value>::new());

    // Behind `"Ω and 𝑥"`, which has 9 units.
    editor.change(uri, 2, [0, 18, 0, 18], "\t\u{1d465}\u{1d465} // \u{e9}");
    let found = editor.findings(uri, 2);
    assert_eq!(places(&found)[0], "E0102 0:19-0:23", "{found:?}");
    assert_eq!(found[0]["severity"], 1);
    assert_eq!(found[0]["source"], "pe-synth");
    assert!(found[0]["message"].as_str().unwrap().contains("\nhelp: "), "{found:?}");

    editor.change(uri, 3, [0, 18, 0, 28], "");
    assert_eq!(editor.findings(uri, 3), Vec::<Value>::new());

    // A slip in a name has a related place or a fix.
    editor.change(uri, 4, [7, 9, 7, 13], "gian");
    let found = editor.findings(uri, 4);
    assert!(places(&found).contains(&"E0201 7:9-7:13".to_owned()), "{found:?}");
    let context = json!({"diagnostics": []});
    let slip = found.iter().find(|finding| finding["code"] == "E0201").unwrap();
    let range = slip["range"].clone();
    let params = json!({"textDocument": {"uri": uri}, "range": range, "context": context});
    let fixes = editor.ask("textDocument/codeAction", params);
    assert_eq!(fixes["result"][0]["title"], "Write `gain`", "{fixes}");
    let edit = &fixes["result"][0]["edit"]["changes"][uri][0];
    assert_eq!((place(&edit["range"]).as_str(), &edit["newText"]), ("7:9-7:13", &json!("gain")));
    assert_eq!(editor.quit(), Ended::Orderly);
}

#[test]
fn findings_are_shown_in_the_file_that_they_are_about() {
    let folder = folder("lsp_included");
    let (main, lib) = (folder.join("m.spec"), folder.join("lib.spec"));
    fs::write(&main, main_text()).unwrap();
    fs::write(&lib, LIB).unwrap();
    let (main_uri, lib_uri) = (uri(&main), uri(&lib));
    let mut editor = Editor::new();
    // The part alone: its model is found on disk.
    editor.open(&lib_uri, LIB);
    assert_eq!(editor.findings(&lib_uri, 1), Vec::<Value>::new());
    // What is open in the editor counts, not what is on disk.
    editor.change(&lib_uri, 2, [0, 6, 0, 10], "other");
    editor.wait(|editor| editor.shown.get(&main_uri).is_some_and(|found| !found.is_empty()));
    let found = editor.shown[&main_uri].clone();
    assert!(places(&found).contains(&"E0201 7:9-7:13".to_owned()), "{found:?}");
    editor.change(&lib_uri, 3, [1, 19, 1, 22], "a/(2");
    editor.wait(|editor| editor.shown.get(&lib_uri).is_some_and(|found| !found.is_empty()));
    assert_eq!(places(&editor.shown[&lib_uri])[0], "E0103 1:21-1:22", "{:?}", editor.shown);
    // Closed without being saved: the disk counts again.
    editor.tell("textDocument/didClose", json!({"textDocument": {"uri": lib_uri}}));
    editor.wait(|editor| editor.shown.values().all(Vec::is_empty));

    // The file is deleted under its model.
    editor.open(&main_uri, &main_text());
    assert_eq!(editor.findings(&main_uri, 1), Vec::<Value>::new());
    fs::remove_file(&lib).unwrap();
    editor.tell("workspace/didChangeWatchedFiles", json!({"changes": [{"uri": lib_uri, "type": 3}]}));
    editor.wait(|editor| !editor.shown[&main_uri].is_empty());
    let missing = editor.shown[&main_uri].clone();
    assert_eq!(places(&missing)[0], "E0111 4:8-4:18", "{missing:?}");
    // A part without a model says so.
    let lonely = uri(&folder.join("lonely.spec"));
    editor.open(&lonely, LIB);
    let found = editor.findings(&lonely, 1);
    assert!(found[0]["message"].as_str().unwrap().starts_with("no model was found"), "{found:?}");
    assert_eq!(found[0]["severity"], 3);
    assert_eq!(editor.quit(), Ended::Orderly);
}

#[test]
fn names_are_explained_found_completed_and_renamed_across_files() {
    let folder = folder("lsp_names");
    let (main, lib) = (folder.join("m.spec"), folder.join("lib.spec"));
    fs::write(&main, main_text()).unwrap();
    fs::write(&lib, LIB).unwrap();
    let (main_uri, lib_uri) = (uri(&main), uri(&lib));
    let mut editor = Editor::new();
    editor.open(&main_uri, &main_text());

    let hover = |editor: &mut Editor, at| {
        let answer = editor.at("hover", &main_uri, at, Value::Null);
        answer["result"]["contents"]["value"].as_str().unwrap_or_default().to_owned()
    };
    let text = hover(&mut editor, (7, 10));
    assert!(text.contains("param gain [1/s] = 2") && text.contains("value: **2** 1/s"), "{text}");
    let text = hover(&mut editor, (6, 6));
    assert!(text.contains("state variable [i] in V, 1..3\n\nat time zero: **0.5 to 1.5** V"), "{text}");
    assert!(text.contains("x[i]' = -gain*x[i]"), "{text}");
    let mut text = String::new();
    for _ in 0..100 {
        text = hover(&mut editor, (6, 6));
        if text.contains("number format") && !text.contains("not measured yet") {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(100));
    }
    assert!(text.contains("measured over the span of 1 s with default options"), "{text}");
    assert!(text.contains("bits of headroom"), "{text}");

    // The function and the parameter are in the other file, and so is what the path stands for.
    for (at, wanted) in [((7, 22), "1:9-1:13"), ((7, 27), "0:6-0:10"), ((4, 12), "0:0-0:0")] {
        let answer = editor.at("definition", &main_uri, at, Value::Null);
        assert_eq!(answer["result"]["uri"], lib_uri, "{answer}");
        assert_eq!(place(&answer["result"]["range"]), wanted, "{answer}");
    }
    let answer = editor.at("definition", &main_uri, (7, 2), Value::Null);
    assert_eq!(place(&answer["result"]["range"]), "5:6-5:7", "{answer}");
    let answer = editor.at("references", &main_uri, (7, 10), json!({"context": {"includeDeclaration": true}}));
    assert_eq!(answer["result"].as_array().unwrap().len(), 3, "{answer}");

    let labels = |answer: &Value| -> Vec<String> {
        let items = answer["result"].as_array().unwrap();
        items.iter().map(|item| item["label"].as_str().unwrap().to_owned()).collect()
    };
    let expression = editor.at("completion", &main_uri, (7, 10), Value::Null);
    for label in ["gain", "half", "x", "i", "sin", "sine", "time", "if", "where"] {
        assert!(labels(&expression).contains(&label.to_owned()), "{label}: {expression}");
    }
    assert!(expression.to_string().contains("sine(amplitude, frequency[, offset][, phase])"), "{expression}");
    let solvers = editor.at("completion", &main_uri, (1, 8), Value::Null);
    assert!(labels(&solvers).contains(&"rk4".to_owned()) && !labels(&solvers).contains(&"x".to_owned()), "{solvers}");
    let units = editor.at("completion", &main_uri, (6, 12), Value::Null);
    assert!(labels(&units).contains(&"cmH2O".to_owned()), "{units}");

    let symbols = editor.ask("textDocument/documentSymbol", json!({"textDocument": {"uri": main_uri}}));
    let names: Vec<&str> =
        symbols["result"].as_array().unwrap().iter().map(|symbol| symbol["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["m", "i", "x"]);

    let renamed = editor.at("rename", &main_uri, (7, 10), json!({"newName": "g"}));
    let changes = &renamed["result"]["changes"];
    let new_main = apply(&main_text(), changes[&main_uri].as_array().unwrap());
    let new_lib = apply(LIB, changes[&lib_uri].as_array().unwrap());
    assert_eq!(new_main, main_text().replace("gain", "g"));
    assert_eq!(new_lib, LIB.replace("gain", "g"));
    for (new, reason) in [
        ("x", "is taken"),
        ("half", "is taken"),
        ("state", "keyword"),
        ("sin", "word of the language"),
        ("2x", "letters"),
        ("a", "hide"),
    ] {
        // `a` is the argument of the function, which reads nothing else: it may be taken by a parameter.
        let answer = editor.at("rename", &main_uri, (7, 10), json!({"newName": new}));
        let told = answer["error"]["message"].as_str().unwrap_or_default();
        assert!(new == "a" || told.contains(reason), "{new}: {answer}");
    }
    let answer = editor.at("prepareRename", &main_uri, (7, 10), Value::Null);
    assert_eq!(answer["result"]["placeholder"], "gain", "{answer}");
    assert_eq!(editor.quit(), Ended::Orderly);
}

#[test]
fn names_are_not_hidden_by_a_rename() {
    let mut editor = Editor::new();
    let uri = "untitled:hidden";
    let text = "model m\nsolver rk4\nstep 1 ms\nspan 1 s\nparam a = 1\nparam b = 2\nfunction f(x) = a*x\n\
                state y = 1\ny' = -f(y) - b - sum(k in 1..2: b*k)\noutput y\n";
    editor.open(uri, text);
    assert_eq!(editor.findings(uri, 1), Vec::<Value>::new());
    for (at, new) in [((4, 6), "x"), ((5, 6), "k"), ((8, 21), "b"), ((6, 11), "a")] {
        let answer = editor.at("rename", uri, at, json!({"newName": new}));
        let told = answer["error"]["message"].as_str().unwrap_or_default();
        assert!(told.contains("hide") || told.contains("taken"), "{new}: {answer}");
    }
    // An index of a sum may have the name of another argument elsewhere.
    let answer = editor.at("rename", uri, (8, 21), json!({"newName": "x"}));
    assert_eq!(answer["result"]["changes"][uri].as_array().map(Vec::len), Some(2), "{answer}");
    // Nothing is renamed while a statement is not understood.
    editor.change(uri, 2, [9, 8, 9, 8], " +");
    let answer = editor.at("rename", uri, (4, 6), json!({"newName": "c"}));
    assert!(answer["error"]["message"].as_str().unwrap().contains("not understood"), "{answer}");
    assert_eq!(editor.quit(), Ended::Orderly);
}

#[test]
fn the_layout_is_that_of_the_command() {
    let mut editor = Editor::new();
    let uri = "untitled:layout";
    for text in ["model  m\r\nstep 1 ms\r\nparam   a=1 // \u{1d465}\r\n", "model m\nstate x=1", ""] {
        editor.open(uri, text);
        let options = json!({"tabSize": 4, "insertSpaces": true});
        let answer = editor.ask("textDocument/formatting", json!({"textDocument": {"uri": uri}, "options": options}));
        let wanted = pe_frontend::format(&pe_ir::source::Sources::new("m", text)).unwrap();
        assert_eq!(apply(text, answer["result"].as_array().unwrap()), wanted);
        editor.tell("textDocument/didClose", json!({"textDocument": {"uri": uri}}));
    }
    assert_eq!(editor.quit(), Ended::Orderly);
}

#[test]
fn cancelled_requests_and_those_out_of_order_are_told_so() {
    let mut editor = Editor::silent();
    assert_eq!(editor.ask("textDocument/hover", json!({}))["error"]["code"], -32002);
    assert!(editor.ask("initialize", json!({}))["result"].is_object());
    assert_eq!(editor.ask("initialize", json!({}))["error"]["code"], -32600);
    assert_eq!(editor.ask("textDocument/nothing", json!({}))["error"]["code"], -32601);
    assert_eq!(editor.ask("textDocument/hover", json!({"textDocument": 3}))["error"]["code"], -32602);
    assert_eq!(editor.at("hover", "untitled:none", (0, 0), Value::Null)["result"], Value::Null);

    // Elaborated long enough to be cancelled.
    let slow = "model m\nsolver rk4\nstep 1 ms\nspan 1 s\nstate x = 1\n\
                x' = -x + sum(i in 1..3000: sum(j in 1..3000: i*j))*0\noutput x\n";
    editor.open("untitled:slow", slow);
    let position = json!({"line": 4, "character": 6});
    let params = json!({"textDocument": {"uri": "untitled:slow"}, "position": position});
    let id = editor.request("textDocument/hover", params);
    editor.tell("$/cancelRequest", json!({"id": id}));
    let answer = editor.answer(id.into());
    assert!(answer["error"]["code"] == -32800 || answer["result"].is_object(), "{answer}");
    editor.tell("$/cancelRequest", json!({"id": 12345}));
    editor.tell("$/unknown", json!(null));
    editor.replace("untitled:slow", 2, "model");
    assert!(!editor.findings("untitled:slow", 2).is_empty());

    let shutdown = editor.ask("shutdown", Value::Null);
    assert!(shutdown["error"].is_null(), "{shutdown}");
    assert_eq!(editor.ask("textDocument/hover", json!({}))["error"]["code"], -32600);
    editor.tell("exit", Value::Null);
    assert_eq!(editor.ended(), Ended::Orderly);
}

#[test]
fn what_is_no_message_ends_nothing() {
    let mut editor = Editor::new();
    editor.send(b"Content-Length: 9\r\n\r\n{\"id\": 1,");
    assert_eq!(editor.answer(Value::Null)["error"]["code"], -32700);
    editor.send(b"nonsense\r\n\r\nContent-Length: x\r\n\r\nContent-Length: 2\r\nContent-Type: y\r\n\r\n[]");
    assert_eq!(editor.answer(Value::Null)["error"]["code"], -32600);
    editor.open("untitled:a", "model a");
    // Ranges that no text has.
    for range in [[5, 5, 1, 1], [0, 99, 99, 0], [u32::MAX, u32::MAX, 0, 0]] {
        editor.change("untitled:a", 2, range, "\u{0}x\r");
    }
    editor.tell(
        "textDocument/didChange",
        json!({"textDocument": {"uri": "untitled:none", "version": 1}, "contentChanges": []}),
    );
    editor.tell("textDocument/didChange", json!({"contentChanges": 7}));
    assert!(editor.findings("untitled:a", 2).iter().all(|finding| finding["range"].is_object()));
    assert_eq!(editor.vanish(), Ended::Abruptly);

    let mut editor = Editor::new();
    editor.tell("exit", Value::Null);
    assert_eq!(editor.ended(), Ended::Abruptly);
}
