//! The pictures of a design: which there are, and whether their text can be read.

use crate::support::models::{Compiled, compile};
use pe_flow::variables::variables;
use pe_plot::style::text_width;
use pe_synth::pictures;

/// A text of a picture: what it says, and the box it fills.
struct Written {
    text: String,
    area: [f64; 4],
}

/// Texts of a picture in points, by a font that is as wide as any; the picture must be well-formed.
fn texts(svg: &str) -> ((f64, f64), Vec<Written>) {
    let document = roxmltree::Document::parse(svg).expect("well-formed XML");
    let root = document.root_element();
    let number = |node: roxmltree::Node, name: &str| node.attribute(name).and_then(|text| text.parse::<f64>().ok());
    let side = |name| number(root, name).expect("a size");
    let written = document.descendants().filter(|node| node.has_tag_name("text")).map(|node| {
        let [x, y, size] = ["x", "y", "font-size"].map(|name| number(node, name).expect("a number") / 10.0);
        let text = node.text().unwrap_or("").trim().to_owned();
        let width = text_width(&text, size);
        let from = match node.attribute("text-anchor") {
            Some("middle") => -width / 2.0,
            Some("end") => -width,
            _ => 0.0,
        };
        let half = size * 0.4;
        let area = if node.attribute("transform").is_some() {
            [x - half, y - from - width, x + half, y - from]
        } else {
            [x + from, y - half, x + from + width, y + half]
        };
        Written { text, area }
    });
    ((side("width"), side("height")), written.collect())
}

fn check_legible(name: &str, svg: &str) {
    let ((width, height), texts) = texts(svg);
    assert!(texts.len() > 3, "{name}");
    for (index, Written { text, area }) in texts.iter().enumerate() {
        let inside = area[0] >= 0.0 && area[1] >= 0.0 && area[2] <= width && area[3] <= height;
        assert!(inside, "{name}: `{text}` leaves the picture: {area:?}");
        for other in &texts[..index] {
            let o = other.area;
            let apart = area[2] <= o[0] || area[0] >= o[2] || area[3] <= o[1] || area[1] >= o[3];
            assert!(apart, "{name}: `{text}` covers `{}`: {area:?} {o:?}", other.text);
        }
    }
}

fn draw(Compiled { loaded, design, .. }: &Compiled) -> Vec<(String, String)> {
    pictures::draw(&loaded.model, design, &variables(&loaded.model, &design.graph, &design.judged))
}

#[test]
fn text_of_every_picture_is_inside_it_and_covers_no_other() {
    for (model, options) in [
        ("lorenz", ["--pes", "3", "--span", "1s"]),
        ("weibel5", ["--pes", "8", "--span", "50ms"]),
        ("wave6", ["--pes", "5", "--span", "1ms"]),
        ("atrial3", ["--pes", "13", "--span", "10ms"]),
        ("lutchen_breathing", ["--pes", "40", "--span", "20ms"]),
    ] {
        let compiled = compile(model, &options);
        let drawn = draw(&compiled);
        assert_eq!(drawn.len(), 4, "{model}");
        for (name, svg) in &drawn {
            check_legible(name, svg);
            assert!(svg.len() < 1 << 20, "{name} has {} bytes", svg.len());
        }
        let again = draw(&compiled);
        assert!(again == drawn, "{model}: other bytes for the same design");
    }
}

#[test]
fn a_single_pe_has_no_picture_of_its_network() {
    let compiled = compile("van_der_pol", &["--pes", "1", "--span", "1s"]);
    let drawn = draw(&compiled);
    let names: Vec<&str> = drawn.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["van_der_pol_ranges.svg", "van_der_pol_outputs.svg", "van_der_pol_occupancy.svg"]);
}
