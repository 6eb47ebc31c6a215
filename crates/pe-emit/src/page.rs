//! A page to read in a browser: text, pictures, tables; one file, no scripts, nothing from elsewhere.

use askama::Template;

/// What is on a page. All of it is text and appears as such, but for the pictures.
#[derive(Template)]
#[template(path = "page.html")]
pub struct Page {
    /// Title.
    pub title: String,
    /// Paragraphs below it.
    pub paragraphs: Vec<String>,
    /// SVG files, which become part of the page.
    pub pictures: Vec<String>,
    /// Tables below the pictures.
    pub tables: Vec<Table>,
    /// The last line.
    pub footer: String,
}

/// A table of a page.
pub struct Table {
    /// Title.
    pub title: String,
    /// Names of the columns.
    pub head: Vec<String>,
    /// Rows.
    pub rows: Vec<TableRow>,
}

/// A row of a table.
pub struct TableRow {
    /// One cell per column.
    pub cells: Vec<String>,
    /// Whether it stands out.
    pub marked: bool,
}

impl Page {
    /// The text of the page.
    ///
    /// # Panics
    /// Never: writing into memory does not fail.
    pub fn render(&self) -> String {
        let mut text = Template::render(self).expect("memory takes the page");
        text.push('\n');
        text
    }
}
