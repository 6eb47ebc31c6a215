//! The pictures and the page of a design: which there are, whether their text can be read, and whether the page tells what the
//! program does.

use crate::support::models::{Compiled, compile};
use pe_flow::variables::variables;
use pe_ir::program::LinkSource;
use pe_plot::style::text_width;
use pe_synth::page::{self, About, Shown};
use pe_synth::pictures;
use serde_json::Value;

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
    let title = root.children().find(|node| node.has_tag_name("title")).and_then(|title| title.text());
    assert!(title.is_some_and(|title| title.len() > 5), "a title: {title:?}");
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
    let variables = variables(&loaded.model, &design.graph, &design.judged);
    pictures::draw(&Shown::of(&loaded.model, design, &variables))
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

/// The page of a design, and its data.
fn page(Compiled { loaded, design, .. }: &Compiled) -> (String, Value) {
    let variables = variables(&loaded.model, &design.graph, &design.judged);
    let about = About { command: "pe-synth compile </script>", rows: vec![("size", "small".to_owned())] };
    let text = page::draw(&Shown::of(&loaded.model, design, &variables), &about, &["a.svg"]);
    let data = text.split_once("id=\"data\">").and_then(|(_, rest)| rest.split_once("</script>")).expect("data").0;
    let data = serde_json::from_str(data).expect("JSON");
    (text, data)
}

fn numbers(list: &Value) -> Vec<usize> {
    list.as_array().expect("a list").iter().map(|number| number.as_u64().expect("a number") as usize).collect()
}

#[test]
fn the_page_tells_what_every_pe_does() {
    for (model, options) in [
        ("weibel5", ["--pes", "8", "--span", "50ms"]),
        ("hodgkin_huxley", ["--pes", "2", "--span", "20ms"]),
        ("lutchen_breathing", ["--pes", "40", "--span", "20ms"]),
        ("van_der_pol", ["--pes", "1", "--span", "1s"]),
    ] {
        let compiled = compile(model, &options);
        let (text, data) = page(&compiled);
        assert!(page(&compiled).0 == text, "{model}: other bytes for the same design");
        assert!(text.len() < 1 << 20, "{model}: {} bytes", text.len());
        let program = &compiled.design.program;
        let names: Vec<&str> =
            data["occupancy"]["names"].as_array().unwrap().iter().map(|n| n.as_str().unwrap()).collect();
        for (pe, words) in program.pes.numbered() {
            let work = &data["occupancy"]["pes"][pe.index()];
            // Every cycle with its value, once, and no other one.
            let told = |lane: &str| {
                let mut cycles = vec![None; words.words.len()];
                for run in numbers(&work[lane]).chunks(3) {
                    for cycle in &mut cycles[run[0]..run[0] + run[1]] {
                        assert!(cycle.replace(names[run[2]]).is_none(), "{model}: a cycle of {run:?} twice");
                    }
                }
                cycles
            };
            let [products, writes, receives] = ["products", "writes", "receives"].map(told);
            for (cycle, (word, note)) in words.words.iter().zip(&words.notes).enumerate() {
                assert_eq!(
                    products[cycle].is_some(),
                    word.own.is_some() || word.imported.is_some(),
                    "{model}: {pe} {cycle}"
                );
                assert_eq!(writes[cycle].is_some(), word.write.is_some() || word.send, "{model}: {pe} {cycle}");
                assert_eq!(receives[cycle].is_some(), word.receive.is_some(), "{model}: {pe} {cycle}");
                let name = program.name(note.write);
                if let (Some(written), false) = (writes[cycle], name.contains(['(', '/', '*'])) {
                    assert_eq!(written, name, "{model}: {pe} {cycle}");
                }
            }
        }
        let sent: usize = data["network"]["links"].as_array().unwrap().iter().map(|link| numbers(link)[2]).sum();
        let from_others = program.pes.numbered().flat_map(|(to, pe)| {
            let ports = pe.words.iter().filter_map(|word| word.receive).map(|(port, _)| pe.ports[port]);
            ports.filter(move |source| matches!(source, LinkSource::Pe(from) if *from != to))
        });
        assert_eq!(sent, from_others.count(), "{model}");
        assert!(names.iter().all(|name| name.len() <= 40), "{model}: {names:?}");
    }
}

#[test]
fn arrays_are_maps_and_the_rest_are_curves_with_scalars_first() {
    let (_, data) = page(&compile("dense42", &["--pes", "4", "--span", "20ms"]));
    let names =
        |list: &str| -> Vec<Value> { data[list].as_array().unwrap().iter().map(|one| one["name"].clone()).collect() };
    assert_eq!(names("curves"), ["c"]);
    assert_eq!((names("arrays"), &data["arrays"][0]["shape"][0]), (vec!["x".into()], &42.into()));
    // Probes of an array are no array.
    let (_, data) = page(&compile("gray_scott", &["--pes", "4", "--span", "2s"]));
    assert_eq!(data["arrays"], serde_json::json!([]));
    assert_eq!(data["curves"].as_array().unwrap().len(), 3);
    let error = data["curves"][0]["error"].as_array().unwrap();
    assert_eq!(error.len(), data["times"].as_array().unwrap().len());
    assert!(error.iter().any(|error| error.as_f64().unwrap() > 0.0), "a curve without errors tells nothing");
}
