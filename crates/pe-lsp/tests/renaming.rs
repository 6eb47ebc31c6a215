//! Every name of every shipped model is renamed: the model stays the same but for names, and renaming it back gives the
//! text that it was.

mod common;

use common::{Editor, apply, models, specs};
use pe_frontend::symbols::Symbols;
use pe_frontend::{Loader, Overrides, compile, main_file, parse};
use pe_lsp::Ended;
use serde_json::json;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// Names that are renamed of each model.
const MOST: usize = 3;

struct Files(BTreeMap<String, String>, std::path::PathBuf);

impl Loader for Files {
    fn load(&self, path: &str) -> Result<Vec<u8>, pe_frontend::LoadError> {
        match self.0.get(path) {
            Some(text) => Ok(text.clone().into_bytes()),
            None => fs::read(self.1.join(path)).map_err(|_| pe_frontend::LoadError::Missing),
        }
    }
}

/// The flat model as text, a name given another one; none if the spec has errors.
fn meaning(main: &Path, texts: &BTreeMap<String, String>, (old, new): (&str, &str)) -> Option<String> {
    let folder = main.parent()?;
    let text = texts.get(&*main.file_name()?.to_string_lossy())?;
    let (mut sources, _) = main_file("m.spec", text.as_bytes());
    let (model, _) = compile(&mut sources, &Files(texts.clone(), folder.to_owned()), &Overrides::default()).ok()?;
    let text = model.to_string();
    // Whole words only.
    let mut renamed = String::new();
    let mut rest = text.as_str();
    while let Some(start) = rest.find(|c: char| c.is_ascii_alphanumeric() || c == '_') {
        let end =
            rest[start..].find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).map_or(rest.len(), |at| start + at);
        renamed += &rest[..start];
        renamed += if &rest[start..end] == old { new } else { &rest[start..end] };
        rest = &rest[end..];
    }
    Some(renamed + rest)
}

#[test]
fn renaming_changes_names_alone_and_back_gives_the_text() {
    let mut editor = Editor::new();
    let (mut renamed, mut refused) = (0, Vec::new());
    for path in specs(&models()) {
        let shown = path.display().to_string();
        let text = fs::read_to_string(&path).unwrap();
        let (mut sources, _) = main_file("m.spec", text.as_bytes());
        let folder = path.parent().unwrap().to_owned();
        let (spec, _) = parse(&mut sources, &Files(BTreeMap::new(), folder.clone()));
        let uri = common::uri(&path);
        editor.open(&uri, &text);
        let symbols = Symbols::of(&spec);
        let main = sources.main().span();
        let stride = symbols.all.len().div_ceil(MOST).max(1);
        for symbol in symbols.all.iter().step_by(stride).filter(|symbol| symbol.place.end <= main.end) {
            let before = &text[..symbol.place.range().start];
            let start = before.rfind('\n').map_or(0, |at| at + 1);
            let at = (before.matches('\n').count() as u32, before[start..].encode_utf16().count() as u32);
            let new = "renamed_here";
            let answer = editor.at("rename", &uri, at, json!({"newName": new}));
            let Some(changes) = answer["result"]["changes"].as_object() else {
                refused.push(format!("{shown}: {}: {}", symbol.name, answer["error"]["message"]));
                continue;
            };
            let mut texts = BTreeMap::new();
            for (file, edits) in changes {
                let file = Path::new(file.strip_prefix("file://").unwrap());
                let old = fs::read_to_string(file).unwrap();
                let changed = apply(&old, edits.as_array().unwrap());
                // Back again, by hand: the name was not there before.
                assert_eq!(changed.replace(new, &symbol.name), old, "{shown}: {}", symbol.name);
                texts.insert(file.strip_prefix(&folder).unwrap().to_string_lossy().into_owned(), changed);
            }
            let mut old = BTreeMap::new();
            old.insert(path.file_name().unwrap().to_string_lossy().into_owned(), text.clone());
            let (before, after) =
                (meaning(&path, &old, (&symbol.name, new)), meaning(&path, &texts, (&symbol.name, new)));
            assert!(before.is_some(), "{shown} has errors");
            assert_eq!(before, after, "{shown}: {}", symbol.name);
            renamed += 1;
        }
        editor.tell("textDocument/didClose", json!({"textDocument": {"uri": uri}}));
    }
    // Indices by which the rows of a table are found cannot be renamed in the spec alone.
    assert!(refused.len() <= 4 && renamed > 200, "{renamed} renamed, {refused:#?}");
    assert_eq!(editor.quit(), Ended::Orderly);
}
