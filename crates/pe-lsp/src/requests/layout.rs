//! The layout of a file, the same as `pe-synth fmt` writes.

use crate::keys::Key;
use crate::text::Lines;
use gen_lsp_types::TextEdit;
use pe_ir::source::Sources;

/// Changes that lay out a file, line by line so that the cursor stays where it is; `None` for a file with syntax errors,
/// which the findings tell.
pub(crate) fn edits(key: &Key, text: &str) -> Option<Vec<TextEdit>> {
    let laid_out = pe_frontend::format(&Sources::new(key.name(), text)).ok()?;
    let lines = Lines::of(text);
    let edit = |range, new: &str| TextEdit { range: lines.range(text, range), new_text: new.to_owned() };
    let (old, new): (Vec<&str>, Vec<&str>) =
        (text.split_inclusive('\n').collect(), laid_out.split_inclusive('\n').collect());
    if old.len() != new.len() {
        return Some(if text == laid_out { Vec::new() } else { vec![edit(0..text.len(), &laid_out)] });
    }
    let mut start = 0;
    let mut edits = Vec::new();
    for (old, new) in old.iter().zip(new) {
        let end = start + old.len();
        if *old != new {
            // Without the line end where that stays: between `\r` and `\n` there is no position.
            let kept =
                ["\r\n", "\n"].into_iter().find(|mark| old.ends_with(mark) && new.ends_with(mark)).map_or(0, str::len);
            edits.push(edit(start..end - kept, &new[..new.len() - kept]));
        }
        start = end;
    }
    Some(edits)
}
