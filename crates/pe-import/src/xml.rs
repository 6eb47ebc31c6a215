//! XML files of strangers.

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};
use roxmltree::{Document, Node, ParsingOptions};

/// Deepest nesting of elements.
const DEEPEST: usize = 200;

/// Most nodes of a document.
const MOST_NODES: u32 = 4_000_000;

/// Reads a document; entities, and document types that could define some, are refused.
pub(crate) fn read(text: &str) -> Result<Document<'_>, Diagnostic> {
    let options = ParsingOptions { allow_dtd: false, nodes_limit: MOST_NODES, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, options).map_err(|error| {
        let span = offset(text, error.pos().row as usize, error.pos().col as usize);
        match error {
            roxmltree::Error::DtdDetected => {
                Diagnostic::error(codes::IMPORT_SYNTAX, Span::of(0, 0), "the file has a document type declaration")
                    .with_help("delete the `<!DOCTYPE ..>`: no format of models needs one")
            }
            roxmltree::Error::NodesLimitReached => {
                let message = format!("the file has more than {MOST_NODES} nodes");
                Diagnostic::error(codes::IMPORT_LIMIT, span, message)
            }
            error => Diagnostic::error(codes::IMPORT_SYNTAX, span, format!("the file is no XML: {error}")),
        }
    })?;
    match too_deep(&document) {
        Some(node) => {
            let message = format!("elements are nested more than {DEEPEST} deep");
            Err(Diagnostic::error(codes::IMPORT_LIMIT, span(node), message))
        }
        None => Ok(document),
    }
}

/// An element that is too deep; walks without recursion.
fn too_deep<'a>(document: &'a Document<'a>) -> Option<Node<'a, 'a>> {
    let mut depth = 0;
    let mut node = document.root();
    loop {
        if let Some(child) = node.first_child() {
            node = child;
            depth += 1;
            if depth > DEEPEST {
                return Some(node);
            }
            continue;
        }
        loop {
            if let Some(next) = node.next_sibling() {
                node = next;
                break;
            }
            node = node.parent()?;
            depth -= 1;
        }
    }
}

/// Byte offset of a row and a column, both from 1 on; columns are characters.
fn offset(text: &str, row: usize, column: usize) -> Span {
    let line = text.split_inclusive('\n').take(row.saturating_sub(1)).map(str::len).sum::<usize>();
    let rest = text[line..].lines().next().unwrap_or("");
    let at = line + rest.char_indices().nth(column.saturating_sub(1)).map_or(rest.len(), |(at, _)| at);
    Span::of(at, at)
}

/// The first tag of an element.
pub(crate) fn span(node: Node) -> Span {
    let range = node.range();
    let text = &node.document().input_text()[range.clone()];
    let end = node.first_child().map_or(range.end, |child| child.range().start);
    let line = text.find(['\n', '\r']).map_or(end, |at| range.start + at);
    Span::of(range.start, end.min(line).max(range.start + 1).min(range.end))
}

/// Child elements.
pub(crate) fn elements<'a, 'i>(node: Node<'a, 'i>) -> impl Iterator<Item = Node<'a, 'i>> {
    node.children().filter(Node::is_element)
}

/// The first child element of this name.
pub(crate) fn child<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    elements(node).find(|child| child.tag_name().name() == name)
}

/// The children of the first child of this name, as in `listOf`.
pub(crate) fn listed<'a, 'i>(node: Node<'a, 'i>, list: &str) -> Vec<Node<'a, 'i>> {
    elements(node).filter(|child| child.tag_name().name() == list).flat_map(elements).collect()
}

/// The text of an element without its child elements.
pub(crate) fn text(node: Node) -> String {
    node.children().filter(Node::is_text).filter_map(|child| child.text()).collect::<String>().trim().to_owned()
}
