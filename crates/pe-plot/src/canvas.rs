//! A sheet to draw on, in points of the finished picture.
//!
//! The SVG writer of `plotters` knows whole numbers only, so it draws on a sheet of [`FINENESS`] units per point; the
//! head of the file says how large that is shown.

use std::cell::RefCell;
use std::fmt::Write;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::style::{INK, Look, Marker, PAPER, Tone};

/// Units of the file per point.
pub const FINENESS: f64 = 10.0;

/// Ratio of `plotters`' font sizes to those of SVG.
const FONT_RATIO: f64 = 1.24;

/// Writing to a text does not fail.
pub(crate) const INFALLIBLE: &str = "a drawing into memory";

/// Where text stands relative to its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// To the right of it.
    Start,
    /// Centred on it.
    Middle,
    /// To the left of it.
    End,
}

/// A sheet under work.
pub struct Canvas<'a> {
    pub(crate) area: DrawingArea<SVGBackend<'a>, Shift>,
    patterns: RefCell<String>,
}

/// Draws a picture of `width` x `height` points and returns the text of its SVG file; `title` is what readers call it.
pub fn picture(title: &str, (width, height): (f64, f64), draw: impl FnOnce(&Canvas)) -> String {
    let (columns, rows) = (units(width), units(height));
    let mut svg = String::new();
    let patterns = {
        let area = SVGBackend::with_string(&mut svg, (columns as u32, rows as u32)).into_drawing_area();
        area.fill(&rgb(PAPER)).expect(INFALLIBLE);
        let canvas = Canvas { area, patterns: RefCell::default() };
        draw(&canvas);
        canvas.area.present().expect(INFALLIBLE);
        canvas.patterns.take()
    };
    let head = format!("<svg width=\"{width}\" height=\"{height}\"");
    let written = format!("<svg width=\"{columns}\" height=\"{rows}\"");
    let body = svg.strip_prefix(&written).and_then(|body| body.trim_end().strip_suffix("</svg>"));
    let (attributes, body) = body.and_then(|body| body.split_once('>')).expect("the frame of an SVG file");
    format!("{head}{attributes}>\n<title>{}</title>{body}{patterns}</svg>\n", escaped(title))
}

/// Text as XML takes it.
fn escaped(text: &str) -> String {
    crate::style::fitted(text, 1.0, f64::INFINITY)
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
        .replace('\'', "&#39;")
}

/// Points as units of the file.
pub(crate) fn units(points: f64) -> i32 {
    (points * FINENESS).round() as i32
}

pub(crate) fn rgb(tone: Tone) -> RGBColor {
    RGBColor(tone.0, tone.1, tone.2)
}

pub(crate) fn stroke(tone: Tone, width: f64) -> ShapeStyle {
    rgb(tone).stroke_width(units(width) as u32)
}

/// A font of the pictures.
pub(crate) fn font(size: f64, tone: Tone, bold: bool) -> TextStyle<'static> {
    let style = if bold { FontStyle::Bold } else { FontStyle::Normal };
    ("sans-serif", size * FINENESS * FONT_RATIO, style).into_font().color(&rgb(tone))
}

fn unit_pair((x, y): (f64, f64)) -> (i32, i32) {
    (units(x), units(y))
}

impl Canvas<'_> {
    /// A filled rectangle from one corner to the other.
    pub fn fill(&self, from: (f64, f64), to: (f64, f64), tone: Tone) {
        let shape = Rectangle::new([unit_pair(from), unit_pair(to)], rgb(tone).filled());
        self.area.draw(&shape).expect(INFALLIBLE);
    }

    /// A rectangle's outline.
    pub fn frame(&self, from: (f64, f64), to: (f64, f64), tone: Tone, width: f64) {
        let corners = [from, (to.0, from.1), to, (from.0, to.1), from];
        self.path(&corners, tone, width);
    }

    /// A line through points.
    pub fn path(&self, points: &[(f64, f64)], tone: Tone, width: f64) {
        let points: Vec<(i32, i32)> = points.iter().map(|point| unit_pair(*point)).collect();
        self.area.draw(&PathElement::new(points, stroke(tone, width))).expect(INFALLIBLE);
    }

    /// A filled polygon.
    pub fn polygon(&self, points: &[(f64, f64)], tone: Tone) {
        let points: Vec<(i32, i32)> = points.iter().map(|point| unit_pair(*point)).collect();
        self.area.draw(&Polygon::new(points, rgb(tone))).expect(INFALLIBLE);
    }

    /// A disc with an outline.
    pub fn disc(&self, centre: (f64, f64), radius: f64, fill: Tone, outline: Tone) {
        let centre = unit_pair(centre);
        self.area.draw(&Circle::new(centre, units(radius), rgb(fill).filled())).expect(INFALLIBLE);
        self.area.draw(&Circle::new(centre, units(radius), stroke(outline, 1.0))).expect(INFALLIBLE);
    }

    /// A line through points in the dash and width of a look.
    pub fn dashed(&self, points: &[(f64, f64)], look: Look) {
        match look.line {
            None => {}
            Some([]) => self.path(points, look.tone, look.width),
            Some(pattern) => {
                for dash in dashes(points, pattern) {
                    self.path(&dash, look.tone, look.width);
                }
            }
        }
    }

    /// A marker.
    pub fn marker(&self, (x, y): (f64, f64), marker: Marker, tone: Tone) {
        let r = 3.4;
        let outline = |points: &[(f64, f64)]| self.path(points, tone, 1.3);
        match marker {
            Marker::Disc => self.disc((x, y), r, tone, tone),
            Marker::Circle => self.disc((x, y), r, PAPER, tone),
            Marker::Square => {
                let corners = [(x - r, y - r), (x + r, y - r), (x + r, y + r), (x - r, y + r), (x - r, y - r)];
                self.polygon(&corners, PAPER);
                outline(&corners);
            }
            Marker::Triangle => self.polygon(&[(x - 1.2 * r, y + r), (x + 1.2 * r, y + r), (x, y - 1.2 * r)], tone),
            Marker::Diamond => {
                let r = 1.35 * r;
                let corners = [(x - r, y), (x, y - r), (x + r, y), (x, y + r), (x - r, y)];
                self.polygon(&corners, PAPER);
                outline(&corners);
            }
            Marker::Ring => {
                let corner = |index: u32| {
                    let angle = f64::from(index) * std::f64::consts::TAU / 48.0;
                    (x + 8.0 * libm::cos(angle), y + 8.0 * libm::sin(angle))
                };
                outline(&(0..=48).map(corner).collect::<Vec<_>>());
            }
            Marker::Cross => {
                outline(&[(x - r, y - r), (x + r, y + r)]);
                outline(&[(x - r, y + r), (x + r, y - r)]);
            }
        }
    }

    /// Text; `y` is the middle of its height.
    pub fn text(&self, text: &str, (x, y): (f64, f64), size: f64, anchor: Anchor) {
        self.styled(text, (x, y), font(size, INK, false), anchor);
    }

    /// Text in a tone.
    pub fn toned(&self, text: &str, at: (f64, f64), size: f64, anchor: Anchor, tone: Tone) {
        self.styled(text, at, font(size, tone, false), anchor);
    }

    /// Bold text.
    pub fn bold(&self, text: &str, at: (f64, f64), size: f64, anchor: Anchor) {
        self.styled(text, at, font(size, INK, true), anchor);
    }

    /// Text that is read from below.
    pub fn upright(&self, text: &str, at: (f64, f64), size: f64, anchor: Anchor) {
        let style = font(size, INK, false).transform(FontTransform::Rotate270);
        self.styled(text, at, style, anchor);
    }

    fn styled(&self, text: &str, at: (f64, f64), style: TextStyle, anchor: Anchor) {
        let horizontal = match anchor {
            Anchor::Start => HPos::Left,
            Anchor::Middle => HPos::Center,
            Anchor::End => HPos::Right,
        };
        let style = style.pos(Pos::new(horizontal, VPos::Center));
        let text = crate::style::fitted(text, 1.0, f64::INFINITY);
        self.area.draw(&Text::new(text, unit_pair(at), style)).expect(INFALLIBLE);
    }

    /// Many equal horizontal strokes in few bytes: `(x, y, length)` each. They lie above everything else.
    pub fn strokes(&self, strokes: impl Iterator<Item = (f64, f64, f64)>, tone: Tone, width: f64) {
        let mut path = String::new();
        let mut at = (0, 0);
        for (x, y, length) in strokes {
            let (x, y, length) = (units(x), units(y), units(length));
            if path.is_empty() {
                let _ = write!(path, "M{x} {y}h{length}");
            } else {
                let _ = write!(path, "m{} {}h{length}", x - at.0, y - at.1);
            }
            at = (x + length, y);
        }
        if !path.is_empty() {
            let (r, g, b) = tone;
            let width = units(width);
            let mut patterns = self.patterns.borrow_mut();
            let _ = writeln!(
                patterns,
                "<path fill=\"none\" stroke=\"#{r:02X}{g:02X}{b:02X}\" stroke-width=\"{width}\" d=\"{path}\"/>"
            );
        }
    }
}

/// Cuts a line into dashes; `pattern` are the lengths of dashes and gaps in turn.
fn dashes(points: &[(f64, f64)], pattern: &[f64]) -> Vec<Vec<(f64, f64)>> {
    let mut result = Vec::new();
    let Some(first) = points.first() else { return result };
    let mut dash = vec![*first];
    let (mut part, mut left) = (0, pattern[0]);
    for pair in points.windows(2) {
        let (mut from, to) = (pair[0], pair[1]);
        loop {
            let (dx, dy) = (to.0 - from.0, to.1 - from.1);
            let length = (dx * dx + dy * dy).sqrt();
            let drawn = part % 2 == 0;
            if length < left {
                left -= length;
                if drawn {
                    dash.push(to);
                }
                break;
            }
            let share = left / length;
            from = (from.0 + dx * share, from.1 + dy * share);
            if drawn {
                dash.push(from);
                result.push(std::mem::take(&mut dash));
            } else {
                dash.push(from);
            }
            part = (part + 1) % pattern.len();
            left = pattern[part];
        }
    }
    if dash.len() > 1 {
        result.push(dash);
    }
    result
}
