//! Data files: tables of numbers under a header, as CSV.

use crate::report::Report;
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

/// A data file as it was read. Cells are numbers where they look like one; only what the spec asks for has to be.
#[derive(Debug)]
pub struct Table {
    /// Cells of the header.
    pub(crate) columns: Vec<Column>,
    /// Cells of all rows, row by row, as many in each as there are columns.
    pub(crate) cells: Vec<Cell>,
}

/// A column.
#[derive(Debug)]
pub(crate) struct Column {
    pub(crate) name: String,
    /// Text in brackets after the name, as in `p [cmH2O]`.
    pub(crate) unit: Option<String>,
    pub(crate) place: Span,
}

/// A cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cell {
    /// NaN if the cell holds no finite number.
    pub(crate) value: f64,
    pub(crate) place: Span,
}

impl Table {
    /// Cells of a column.
    pub(crate) fn column(&self, number: usize) -> impl Iterator<Item = Cell> + '_ {
        self.cells.iter().skip(number).step_by(self.columns.len().max(1)).copied()
    }

    /// The column of this name.
    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column.name == name)
    }

    /// Reads the table in `text` at the place `file`; `text` holds all files up to the end of this one. Rows that do
    /// not fit the header are reported, and there is no table then.
    pub(crate) fn read(text: &str, file: Span, report: &mut Report) -> Option<Table> {
        let content = &text[file.range()];
        let content = content.strip_prefix('\u{FEFF}').unwrap_or(content);
        let start = file.range().end - content.len();
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .comment(Some(b'#'))
            .trim(csv::Trim::All)
            .from_reader(content.as_bytes());
        let mut table = Table { columns: Vec::new(), cells: Vec::new() };
        let mut complete = true;
        let mut record = csv::StringRecord::new();
        let mut places = Vec::new();
        // The content is text and rows may have any length, so there is nothing that could fail.
        while reader.read_record(&mut record).unwrap_or(false) {
            let byte = record.position().map_or(0, csv::Position::byte);
            let byte = usize::try_from(byte).unwrap_or(usize::MAX);
            let line = find_places(content, byte, &mut places);
            let global = |(from, to): (usize, usize)| Span::of(start + from, start + to);
            let place = |at: usize| global(places.get(at).copied().unwrap_or(line));
            if table.columns.is_empty() {
                if let Some(mark) = other_separator(&record) {
                    let message = format!("the cells look parted by {mark}: the first row has no comma");
                    let help = "part cells by commas and write decimals with a point: `t,p` and `0.5,1.25`";
                    report.push(Diagnostic::error(codes::BAD_TABLE, global(line), message).with_help(help));
                    return None;
                }
                table.columns.extend(record.iter().enumerate().map(|(at, name)| header(name, place(at))));
            } else if record.len() == table.columns.len() {
                let value = |text: &str| {
                    unquoted(text).parse().ok().filter(|number: &f64| number.is_finite()).unwrap_or(f64::NAN)
                };
                table
                    .cells
                    .extend(record.iter().enumerate().map(|(at, text)| Cell { value: value(text), place: place(at) }));
            } else {
                complete = false;
                let message = format!("this row has {} cells, the header {}", record.len(), table.columns.len());
                report.push(Diagnostic::error(codes::BAD_TABLE, global(line), message));
            }
        }
        if table.columns.is_empty() {
            let message = "the file holds no table: its first row has to name the columns";
            report.push(Diagnostic::error(codes::BAD_TABLE, Span { end: file.start, ..file }, message));
        }
        (complete && !table.columns.is_empty()).then_some(table)
    }
}

/// What parts the names of a header that is a single cell, if it is not a comma.
fn other_separator(header: &csv::StringRecord) -> Option<&'static str> {
    let mut cells = header.iter();
    let (only, None) = (cells.next()?, cells.next()) else { return None };
    [(";", "`;`"), ("\t", "tabs"), ("|", "`|`")].into_iter().find(|(mark, _)| only.contains(mark)).map(|(_, name)| name)
}

/// A cell without the quotes that a blank before them made part of the text.
fn unquoted(text: &str) -> &str {
    text.strip_prefix('"').and_then(|text| text.strip_suffix('"')).map_or(text, str::trim)
}

/// Name and unit of a header cell.
fn header(text: &str, place: Span) -> Column {
    let text = unquoted(text);
    let bracket = text.strip_suffix(']').and_then(|text| text.split_once('['));
    let (name, unit) = bracket.map_or((text, None), |(name, unit)| (name.trim_end(), Some(unit.trim().to_owned())));
    Column { name: name.to_owned(), unit, place }
}

/// Finds the cells of the record that begins at or after an offset; gives the place of the whole record.
fn find_places(content: &str, from: usize, places: &mut Vec<(usize, usize)>) -> (usize, usize) {
    places.clear();
    let bytes = content.as_bytes();
    let mut start = from.min(bytes.len());
    // Blank lines and remarks before the record count as part of it.
    while start < bytes.len() && matches!(bytes[start], b'\n' | b'\r' | b'#') {
        let remark = bytes[start] == b'#';
        start += if remark { content[start..].find('\n').unwrap_or(bytes.len() - start) } else { 1 };
    }
    let (mut at, mut cell, mut quoted) = (start, start, false);
    loop {
        let byte = bytes.get(at).copied();
        if matches!(byte, None | Some(b'\n' | b'\r')) && (!quoted || byte.is_none()) || (byte == Some(b',') && !quoted)
        {
            let text = &content[cell..at];
            let from = at - text.trim_start().len();
            places.push((from.min(at), from.min(at) + text.trim().len()));
            if byte != Some(b',') {
                return (start, at);
            }
            cell = at + 1;
        }
        // As the reader has it: a quote after a blank is part of the text.
        quoted ^= byte == Some(b'"') && (quoted || at == cell);
        at += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> (Option<Table>, Vec<Diagnostic>) {
        let mut report = Report::default();
        let before = "state x = 0\n";
        let all = format!("{before}{text}");
        let file = Span { start: before.len() as u32, end: all.len() as u32 };
        let table = Table::read(&all, file, &mut report);
        let findings = report.finish();
        // Every cell is where its text is.
        if let Some(table) = &table {
            for cell in table.cells.iter().filter(|cell| cell.value.is_finite()) {
                let text = &all[cell.place.start as usize..cell.place.end as usize];
                assert_eq!(text.trim_matches('"').trim().parse(), Ok(cell.value), "{text}");
            }
        }
        (table, findings)
    }

    #[test]
    fn cells_are_found_where_they_stand() {
        let (table, findings) = read(
            "\u{FEFF}# remark, with comma\n\n b , \"R [cmH2O*s/L]\",\u{e4}\r\n1, 2.5 ,x\r\n\r\n# end\n \"3\",-4e-1,",
        );
        let table = table.expect("a table");
        assert_eq!(findings, []);
        let names: Vec<_> = table.columns.iter().map(|column| (column.name.as_str(), column.unit.as_deref())).collect();
        assert_eq!(names, [("b", None), ("R", Some("cmH2O*s/L")), ("\u{e4}", None)]);
        assert_eq!(table.column(1).map(|cell| cell.value).collect::<Vec<_>>(), [2.5, -0.4]);
        assert!(table.column(2).all(|cell| cell.value.is_nan()));
    }

    #[test]
    fn rows_that_do_not_fit_are_reported() {
        let (table, findings) = read("a,b\n1,2\n3\n4,5,6\n");
        assert!(table.is_none());
        assert_eq!(
            findings.iter().map(|finding| finding.span.map(|span| span.start)).collect::<Vec<_>>(),
            [Some(20), Some(22)]
        );
        for (other, mark) in [("t;p\n0;1\n", "`;`"), ("t\tp\n0\t1\n", "tabs"), ("t [s];p [Pa]\n0,5;1\n", "`;`")] {
            let (table, findings) = read(other);
            assert!(table.is_none() && findings.len() == 1 && findings[0].message.contains(mark), "{findings:?}");
        }
        for empty in ["", "\n\n", "# nothing\n"] {
            assert_eq!(read(empty).1.len(), 1, "{empty:?}");
        }
        assert!(read("\"a").0.is_some_and(|table| table.cells.is_empty()));
    }
}
