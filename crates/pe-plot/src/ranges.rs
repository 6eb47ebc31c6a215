//! Measured ranges of variables inside the ranges of their number formats.

use std::collections::HashMap;

use crate::axis::{Axis, Scale};
use crate::canvas::{Anchor, Canvas, picture};
use crate::chart::title;
use crate::style::{GRID, INK, LABEL, MARGIN, SMALL, SOFT, TITLE, Tone, fitted, text_width, wrapped};

/// Width of the picture.
const WIDTH: f64 = 900.0;

/// Rows at most that get a name each; more variables are drawn by quantity.
const NAMED_ROWS: usize = 40;

/// Quantities at most that are drawn: of more those with the least headroom.
const MOST_BANDS: usize = 200;

/// Height of a named row, and of a band of many.
const ROW: f64 = 17.0;
const BAND: (f64, f64) = (26.0, 150.0);

/// Tone of the bits that the measured range uses, and of those above.
const USED: Tone = (110, 140, 180);
const FREE: Tone = (222, 228, 236);

/// A variable.
#[derive(Clone, Debug, PartialEq)]
pub struct Variable {
    /// Its name.
    pub name: String,
    /// Name of the declared quantity that it is an element of.
    pub quantity: String,
    /// Largest magnitude measured.
    pub largest: f64,
    /// The format's step.
    pub step: f64,
    /// Largest magnitude that the format holds.
    pub limit: f64,
}

impl Variable {
    /// Bits between the largest magnitude and the limit.
    pub fn headroom(&self) -> f64 {
        libm::log2(self.limit / self.largest.max(self.step))
    }
}

/// Rows that stand together: variables of a quantity, or a single one.
struct Band<'a> {
    name: &'a str,
    variables: Vec<&'a Variable>,
    height: f64,
}

/// Draws the ranges.
pub fn draw(model: &str, variables: &[Variable]) -> String {
    let mut bands = bands(variables);
    let dropped = bands.len().saturating_sub(MOST_BANDS);
    bands.sort_by(|a, b| a.worst().headroom().total_cmp(&b.worst().headroom()));
    bands.truncate(MOST_BANDS);
    let left_out = match dropped {
        0 => String::new(),
        count => format!(" Of {} quantities those {MOST_BANDS} with the least headroom.", count + MOST_BANDS),
    };
    let caption = format!(
        "{} variables, those with the least headroom first.{left_out} A bar is what the variable's format can hold, from one step of the format (left end) to its \
         largest magnitude (right end); dark is what the runs used, pale on the right is headroom, a factor of two per \
         bit.",
        variables.len()
    );
    let caption = wrapped(&caption, SMALL, WIDTH - 2.0 * MARGIN);
    let top = MARGIN + TITLE + 8.0 + caption.len() as f64 * (SMALL + 4.0) + LABEL + 18.0;
    let height: f64 = bands.iter().map(|band| band.height).sum();
    let names = bands.iter().map(|band| text_width(band.name, SMALL)).fold(40.0, f64::max).min(230.0);
    let note = 176.0;
    let (left, right) = (MARGIN + names + 10.0, WIDTH - MARGIN - note);
    let numbers = variables.iter().flat_map(|variable| [variable.step, variable.limit]);
    let axis = Axis::new(Scale::Log, numbers, false, ((right - left) / 60.0) as usize);
    let x = |number: f64| left + axis.place(number).clamp(0.0, 1.0) * (right - left);
    let heading = format!("{model}: ranges and formats");
    picture(&heading, (WIDTH, (top + height + SMALL + LABEL + 34.0).ceil()), |canvas| {
        let y = title(canvas, &heading, &caption, WIDTH - 2.0 * MARGIN);
        legend(canvas, y + LABEL / 2.0, bands.iter().any(|band| band.variables.len() > 1));
        for tick in axis.ticks() {
            canvas.path(&[(x(*tick), top), (x(*tick), top + height + 4.0)], GRID, 0.8);
            let at = (x(*tick), top + height + 5.0 + SMALL / 2.0);
            canvas.text(&axis.label(*tick), at, SMALL, Anchor::Middle);
        }
        let mut y = top;
        for band in &bands {
            draw_band(canvas, band, y, &x);
            canvas.path(&[(left, y + band.height), (right, y + band.height)], GRID, 0.8);
            let middle = y + band.height / 2.0;
            canvas.text(&fitted(band.name, SMALL, names), (left - 6.0, middle), SMALL, Anchor::End);
            let worst = band.worst();
            let text = format!("{:.2} bits", worst.headroom());
            canvas.text(&text, (right + 8.0, middle), SMALL, Anchor::Start);
            if band.variables.len() > 1 {
                let name = fitted(&worst.name, SMALL, note - 14.0 - text_width(&text, SMALL));
                let at = (right + 14.0 + text_width(&text, SMALL), middle);
                canvas.toned(&name, at, SMALL, Anchor::Start, SOFT);
            }
            y += band.height;
        }
        canvas.frame((left, top), (right, top + height), SOFT, 1.0);
        canvas.toned("least headroom", (right + 8.0, top - 8.0), SMALL, Anchor::Start, SOFT);
        let foot = top + height + SMALL + 12.0 + LABEL / 2.0;
        canvas.text("magnitude", ((left + right) / 2.0, foot), LABEL, Anchor::Middle);
    })
}

fn bands<'a>(variables: &'a [Variable]) -> Vec<Band<'a>> {
    if variables.len() <= NAMED_ROWS {
        let single = |variable: &'a Variable| Band { name: &variable.name, variables: vec![variable], height: ROW };
        return variables.iter().map(single).collect();
    }
    let mut bands: Vec<Band> = Vec::new();
    let mut places: HashMap<&str, usize> = HashMap::new();
    for variable in variables {
        let place = *places.entry(&variable.quantity).or_insert(bands.len());
        if place == bands.len() {
            bands.push(Band { name: &variable.quantity, variables: Vec::new(), height: ROW });
        }
        bands[place].variables.push(variable);
    }
    for band in bands.iter_mut().filter(|band| band.variables.len() > 1) {
        band.height = (band.variables.len() as f64 * 3.0).clamp(BAND.0, BAND.1);
    }
    bands
}

impl<'a> Band<'a> {
    fn worst(&self) -> &'a Variable {
        worst(&self.variables)
    }
}

/// The variable with least headroom, the first of them.
fn worst<'a>(variables: &[&'a Variable]) -> &'a Variable {
    let first = variables[0];
    variables
        .iter()
        .fold(first, |worst, variable| if variable.headroom() < worst.headroom() { variable } else { worst })
}

fn legend(canvas: &Canvas, y: f64, grouped: bool) {
    let mut x = MARGIN;
    for (tone, text) in [(USED, "measured range"), (FREE, "headroom")] {
        canvas.fill((x, y - 5.0), (x + 22.0, y + 5.0), tone);
        canvas.text(text, (x + 28.0, y), SMALL, Anchor::Start);
        x += 52.0 + text_width(text, SMALL);
    }
    if grouped {
        canvas.toned("elements of a quantity from top to bottom", (x, y), SMALL, Anchor::Start, SOFT);
    }
}

/// Draws the variables of a band below each other; where they are too many for their lines, the one with least
/// headroom stands for those that share a line.
fn draw_band(canvas: &Canvas, band: &Band, top: f64, x: &impl Fn(f64) -> f64) {
    let inset = if band.variables.len() == 1 { 3.0 } else { 2.0 };
    let inner = band.height - 2.0 * inset;
    let lines = band.variables.len().min(inner as usize).max(1);
    let line = inner / lines as f64;
    for index in 0..lines {
        let from = index * band.variables.len() / lines;
        let to = ((index + 1) * band.variables.len() / lines).max(from + 1);
        let variable = worst(&band.variables[from..to]);
        let (upper, lower) = (top + inset + index as f64 * line, top + inset + (index + 1) as f64 * line);
        let reach = x(variable.largest.max(variable.step));
        canvas.fill((x(variable.step), upper), (reach, lower), USED);
        canvas.fill((reach, upper), (x(variable.limit), lower), FREE);
        canvas.path(&[(reach, upper), (reach, lower)], INK, 1.2);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_very_many_quantities_those_with_the_least_headroom_are_drawn() {
        let variable = |index: u32| {
            let name = format!("x{index}");
            Variable { quantity: name.clone(), name, largest: f64::from(index + 1), step: 1e-6, limit: 1e6 }
        };
        let variables: Vec<Variable> = (0..1000).map(variable).collect();
        let text = draw("many", &variables);
        assert!(text.contains("Of 1000 quantities those 200"));
        assert!(text.contains("\nx999\n") && text.contains("\nx800\n") && !text.contains("\nx799\n"), "{text}");
    }
}
