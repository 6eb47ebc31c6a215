//! How long findings take after a key press: `cargo bench -p pe-lsp`, with models after `--` in place of
//! the default ones, and `PE_EDITS` edits of each.
//!
//! A key press is an edit of a real session over pipes, at a random word: a character that no spec may hold, and then its
//! removal, after which the whole model is elaborated. The time ends when the editor has the findings of that text.

#[path = "../tests/common/mod.rs"]
mod common;

use common::{models, uri};

fn main() {
    let asked: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    let names = if asked.is_empty() { vec!["weibel11".to_owned(), "lutchen4000".to_owned()] } else { asked };
    let edits = std::env::var("PE_EDITS").ok().and_then(|text| text.parse().ok()).unwrap_or(200);
    println!("{:<14} {:>6} {:>10} {:>10}  milliseconds after a key press", "model", "edits", "median", "worst");
    for name in names {
        let path = models().join(&name).join(format!("{name}.spec"));
        let text = std::fs::read_to_string(&path).expect("a model");
        let mut times = common::key_presses(&uri(&path), &text, edits);
        times.sort_by(f64::total_cmp);
        println!("{name:<14} {edits:>6} {:>10.1} {:>10.1}", times[times.len() / 2], times[times.len() - 1]);
    }
}
