//! XML elements that can be changed, and written again.

use pe_ir::source::Span;
use roxmltree::Node;

use crate::xml;

/// An element. Attributes of the package `comp` have its prefix, others none.
#[derive(Clone, Debug)]
pub(super) struct Element {
    pub name: String,
    pub attributes: Vec<(String, String)>,
    pub children: Vec<Element>,
    /// Text in front of its children, and behind it.
    pub text: String,
    tail: String,
    pub span: Span,
}

impl Element {
    /// What is in a document, without notes and annotations.
    pub fn of(node: Node) -> Element {
        let attributes = node.attributes().map(|attribute| {
            let prefix = if attribute.namespace().is_some_and(is_comp) { "comp:" } else { "" };
            (format!("{prefix}{}", attribute.name()), attribute.value().to_owned())
        });
        let texts = |from: Option<Node>| {
            let following = std::iter::successors(from, Node::next_sibling).take_while(|node| !node.is_element());
            following.filter_map(|node| node.text().filter(|_| node.is_text())).collect::<String>().trim().to_owned()
        };
        let kept = |child: &Node| !["notes", "annotation"].contains(&child.tag_name().name());
        Element {
            name: node.tag_name().name().to_owned(),
            attributes: attributes.collect(),
            children: xml::elements(node).filter(kept).map(Element::of).collect(),
            text: texts(node.first_child()),
            tail: texts(node.next_sibling()),
            span: xml::span(node),
        }
    }

    /// A new one at the place of another.
    pub fn new(name: &str, text: &str, children: Vec<Element>, span: Span) -> Element {
        Element {
            name: name.to_owned(),
            attributes: Vec::new(),
            children,
            text: text.to_owned(),
            tail: String::new(),
            span,
        }
    }

    pub fn get(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    pub fn child(&self, name: &str) -> Option<&Element> {
        self.children.iter().find(|child| child.name == name)
    }

    /// The children of its lists of this name.
    pub fn listed<'e>(&'e self, list: &'e str) -> impl Iterator<Item = &'e Element> {
        self.children.iter().filter(move |child| child.name == list).flat_map(|list| &list.children)
    }

    /// Number of elements.
    pub fn size(&self) -> usize {
        1 + self.children.iter().map(Element::size).sum::<usize>()
    }

    /// Calls `visit` for itself and all below.
    pub fn each(&self, visit: &mut dyn FnMut(&Element)) {
        visit(self);
        self.children.iter().for_each(|child| child.each(visit));
    }

    /// Calls `visit` for itself and all below, from the leaves on.
    pub fn each_mut(&mut self, visit: &mut dyn FnMut(&mut Element)) {
        self.children.iter_mut().for_each(|child| child.each_mut(visit));
        visit(self);
    }

    /// Removes elements below it; whether there were any.
    pub fn remove(&mut self, is_it: &dyn Fn(&Element) -> bool) -> bool {
        let before = self.children.len();
        self.children.retain(|child| !is_it(child));
        let mut removed = self.children.len() < before;
        self.children.iter_mut().for_each(|child| removed |= child.remove(is_it));
        removed
    }

    /// Writes it; `places` get the range of each element in the text, and where it comes from.
    pub fn write(&self, text: &mut String, places: &mut Vec<(usize, usize, Span)>) {
        let (start, index) = (text.len(), places.len());
        places.push((start, start, self.span));
        text.push('<');
        text.push_str(&self.name);
        for (name, value) in self.attributes.iter().filter(|(name, _)| !name.starts_with("comp:")) {
            text.push_str(&format!(" {name}=\"{}\"", escaped(value)));
        }
        text.push('>');
        text.push_str(&escaped(&self.text));
        for child in &self.children {
            child.write(text, places);
            // A number with an exponent has a separator between two texts.
            text.push_str(&escaped(&child.tail));
        }
        text.push_str(&format!("</{}>", self.name));
        places[index].1 = text.len();
    }
}

/// Whether a namespace is that of the package.
pub(super) fn is_comp(url: &str) -> bool {
    url.contains("/comp/")
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
