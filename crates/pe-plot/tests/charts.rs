//! Charts: ticks, hostile names, points that cannot be shown.

use pe_plot::axis::{Axis, Scale};
use pe_plot::chart::{AxisPlan, Chart, Point, Series};
use pe_plot::style::{Look, fitted, text_width};

fn labels(scale: Scale, low: f64, high: f64) -> Vec<String> {
    let axis = Axis::new(scale, [low, high].into_iter(), true, 8);
    axis.ticks().iter().map(|tick| axis.label(*tick)).collect()
}

fn chart(name: &str, points: Vec<Point>, scale: Scale) -> String {
    let series = vec![Series { name: name.to_owned(), points, look: Look::joined(1) }];
    let (x, y) = (AxisPlan::new(name, scale), AxisPlan::new(name, scale));
    Chart { title: name.to_owned(), x, y, series, field: None, height: 200.0 }.draw(name, 500.0)
}

#[test]
fn ticks_are_round_and_inside_the_axis() {
    assert_eq!(labels(Scale::Linear, 0.0, 10.0), ["0", "2", "4", "6", "8", "10"]);
    assert_eq!(labels(Scale::Linear, -0.3, 0.31), ["-0.3", "-0.2", "-0.1", "0.0", "0.1", "0.2", "0.3"]);
    assert_eq!(labels(Scale::Linear, 0.0, 3e-9), ["0", "5e-10", "1e-9", "1.5e-9", "2e-9", "2.5e-9", "3e-9"]);
    assert_eq!(labels(Scale::Log, 0.01, 100.0), ["0.01", "0.1", "1", "10", "100"]);
    assert_eq!(labels(Scale::Log, 1e-9, 1e-7), ["1e-9", "2e-9", "5e-9", "1e-8", "2e-8", "5e-8", "1e-7"]);
    assert_eq!(labels(Scale::Log, 1e-300, 1e300).len(), 7);
    for scale in [Scale::Linear, Scale::Log] {
        for (low, high) in [(5.0, 5.0), (1e-300, 1e-299), (f64::MIN_POSITIVE, f64::MAX), (1.0, 1.0 + 1e-15)] {
            let axis = Axis::new(scale, [low, high].into_iter(), false, 6);
            assert!(!axis.ticks().is_empty(), "{scale:?} {low} {high}");
            assert!(axis.ticks().iter().all(|tick| (-1e-6..=1.0 + 1e-6).contains(&axis.place(*tick))));
        }
    }
}

#[test]
fn hostile_names_stay_text() {
    let name = "</text><script>alert('1')</script>&\"\u{0}\u{1b}\u{ffff} ";
    let svg = chart(name, vec![Point { x: 1.0, y: 1.0, label: Some(name.to_owned()) }], Scale::Linear);
    assert!(!svg.contains("<script") && !svg.contains("'1'"));
    assert!(svg.chars().all(|c| c == '\n' || (!c.is_control() && c != '\u{ffff}')));
    assert_eq!(svg.matches("<text").count(), svg.matches("</text>").count());
}

#[test]
fn points_that_an_axis_cannot_show_are_counted_below_it() {
    let points = [(1.0, 2.0), (0.0, 1.0), (f64::NAN, 1.0), (-3.0, 1.0), (10.0, 20.0), (1.0, f64::INFINITY)];
    let points: Vec<Point> = points.into_iter().map(Point::from).collect();
    assert!(chart("x", points.clone(), Scale::Log).contains("4 points are not shown"));
    let svg = chart("x", points, Scale::Linear);
    assert!(svg.contains("2 points are not shown") && !svg.contains("NaN") && !svg.contains("inf"));
    assert!(chart("none", Vec::new(), Scale::Log).ends_with("</svg>\n"));
}

#[test]
fn long_names_lose_their_middle() {
    let text = fitted("generation.of.the.airway.tree[1023]", 10.0, 120.0);
    assert!(text.starts_with("genera") && text.contains('…') && text.ends_with("[1023]"), "{text}");
    assert!(text_width(&text, 10.0) <= 120.0);
    assert_eq!(fitted("short", 10.0, 120.0), "short");
}
