//! A page to work with in a browser: one file that needs nothing from elsewhere.
//!
//! What a page shows is data in JSON, which the scripts of `templates/page` draw; they put names into the page as text only.

use askama::Template;

/// Scripts in the order in which they need each other, the library for charts first.
const SCRIPTS: [&str; 9] = [
    include_str!("../templates/page/uplot/uPlot.iife.min.js"),
    include_str!("../templates/page/core.js"),
    include_str!("../templates/page/table.js"),
    include_str!("../templates/page/plot.js"),
    include_str!("../templates/page/sweep.js"),
    include_str!("../templates/page/network.js"),
    include_str!("../templates/page/outputs.js"),
    include_str!("../templates/page/design.js"),
    include_str!("../templates/page/start.js"),
];

const STYLES: [&str; 2] =
    [include_str!("../templates/page/uplot/uPlot.min.css"), include_str!("../templates/page/page.css")];

/// What is on a page. All of it is text and appears as such.
pub struct Page {
    /// Title.
    pub title: String,
    /// Paragraphs below it.
    pub paragraphs: Vec<String>,
    /// Files in the same folder, each with what it is.
    pub files: Vec<(String, String)>,
    /// What the scripts draw: JSON.
    pub data: String,
    /// The last line.
    pub footer: String,
}

#[derive(Template)]
#[template(path = "page/page.html")]
struct Whole<'a> {
    title: &'a str,
    paragraphs: &'a [String],
    files: &'a [(String, String)],
    data: String,
    footer: &'a str,
    style: String,
    script: String,
}

impl Page {
    /// The text of the page.
    ///
    /// # Panics
    /// Never: writing into memory does not fail.
    pub fn render(&self) -> String {
        let Page { title, paragraphs, files, data, footer } = self;
        // Every script is a block of its own; the first one is the library, which says itself that it is strict.
        let [library, own @ ..] = &SCRIPTS;
        let script = format!("{library}\n(() => {{\n'use strict';\n{}}})();\n", own.concat());
        let (data, style) = (island(data), STYLES.join("\n"));
        let (title, footer) = (&readable(title), &readable(footer));
        let paragraphs = &paragraphs.iter().map(|text| readable(text)).collect::<Vec<_>>();
        let files = &files.iter().map(|(file, what)| (readable(file), readable(what))).collect::<Vec<_>>();
        let mut text =
            Whole { title, paragraphs, files, data, footer, style, script }.render().expect("memory takes the page");
        text.push('\n');
        text
    }
}

/// JSON that no browser takes for the end of its element, whatever strings it holds: only they can hold a `<`, or letters
/// that change the direction of what follows.
fn island(json: &str) -> String {
    let mut text = String::with_capacity(json.len());
    for letter in json.chars() {
        if letter == '<' || turns(letter) {
            text += &format!("\\u{:04x}", u32::from(letter));
        } else {
            text.push(letter);
        }
    }
    text
}

/// Whether a letter changes the direction of the text behind it, so that it would not be read as it is.
fn turns(letter: char) -> bool {
    matches!(letter, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Text that is read as it is.
fn readable(text: &str) -> String {
    text.replace(turns, "\u{fffd}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_text_leaves_its_place() {
        let hostile = "</script><script>alert(1)</script><!-- &amp; \"' \u{202e}";
        let page = Page {
            title: hostile.to_owned(),
            paragraphs: vec![hostile.to_owned()],
            files: vec![(hostile.to_owned(), hostile.to_owned())],
            data: format!("{{\"name\":\"{hostile}\"}}"),
            footer: hostile.to_owned(),
        };
        let text = page.render();
        assert!(!text.contains("alert(1)</script>") && !text.contains("<!--") && !text.contains('\u{202e}'), "{text}");
        assert_eq!(text.matches("</script").count(), 2, "data and scripts");
    }

    #[test]
    fn nothing_comes_from_elsewhere_and_no_script_ends_early() {
        let page = Page {
            title: String::new(),
            paragraphs: Vec::new(),
            files: Vec::new(),
            data: "{}".to_owned(),
            footer: String::new(),
        };
        let text = page.render();
        for foreign in ["src=", "href=", "url(", "@import", "innerHTML", "eval("] {
            let found =
                text.match_indices(foreign).map(|(at, _)| &text[at.saturating_sub(60)..(at + 60).min(text.len())]);
            assert_eq!(found.collect::<Vec<_>>(), [""; 0], "{foreign}");
        }
        assert!(SCRIPTS.iter().chain(&STYLES).all(|text| !text.contains("</s") && !text.contains("<!--")));
    }
}
