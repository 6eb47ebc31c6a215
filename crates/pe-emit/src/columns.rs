//! Alignment of rendered text: tabs in templates are elastic column stops.

/// Replaces tabs by blanks so that the cells of neighbouring lines with tabs start in the same column, and ends the
/// text with one newline. Cells never get narrower than their text, and a line's last cell is not padded.
pub fn aligned(mut text: String) -> String {
    // The largest files are laid out already.
    if !text.contains('\t') && !text.contains(" \n") {
        text.truncate(text.trim_end_matches('\n').len());
        text.push('\n');
        return text;
    }
    let mut result = String::new();
    let lines: Vec<&str> = text.trim_end_matches('\n').split('\n').collect();
    let groups = lines.chunk_by(|a, b| a.contains('\t') && b.contains('\t'));
    for group in groups {
        let rows: Vec<Vec<&str>> = group.iter().map(|line| line.split('\t').collect()).collect();
        let mut widths: Vec<usize> = Vec::new();
        for row in &rows {
            // The last cell of a row has no stop behind it.
            for (column, cell) in row[..row.len() - 1].iter().enumerate() {
                if column == widths.len() {
                    widths.push(0);
                }
                widths[column] = widths[column].max(cell.len());
            }
        }
        for row in &rows {
            let mut line = String::new();
            let mut start = 0;
            for (column, cell) in row.iter().enumerate() {
                line.push_str(&" ".repeat(start - line.len()));
                line.push_str(cell);
                start += widths.get(column).map_or(0, |width| width + 1);
            }
            result.push_str(line.trim_end());
            result.push('\n');
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::aligned;

    #[test]
    fn cells_of_neighbouring_lines_line_up() {
        let text = "a\t: b;\t-- c\nlong\t: d\nx\ny\t<= z\n\n".to_owned();
        assert_eq!(aligned(text), "a    : b; -- c\nlong : d\nx\ny <= z\n");
        assert_eq!(aligned("a \nb\n\n".to_owned()), "a\nb\n");
        assert_eq!(aligned("a\nb".to_owned()), "a\nb\n");
    }
}
