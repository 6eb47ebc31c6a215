//! What all pictures have in common: sizes, tones, markers, dashes, and how wide text is.

use pe_ir::model::Solver;

/// A tone: red, green, blue.
pub type Tone = (u8, u8, u8);

/// Text, axes and whatever matters most.
pub const INK: Tone = (26, 26, 26);
/// Text and lines of second rank.
pub const SOFT: Tone = (90, 90, 90);
/// Grid lines.
pub const GRID: Tone = (222, 222, 222);
/// Grid lines between labelled ones.
pub const FINE_GRID: Tone = (241, 241, 241);
/// Background.
pub const PAPER: Tone = (255, 255, 255);

/// Text height of the title of a picture, of names of axes and panels, and of everything else.
pub const TITLE: f64 = 15.0;
/// See [`TITLE`].
pub const LABEL: f64 = 12.0;
/// See [`TITLE`].
pub const SMALL: f64 = 11.0;

/// Space around a picture and between its parts.
pub const MARGIN: f64 = 12.0;

/// Shape of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Marker {
    /// Filled disc.
    Disc,
    /// Empty square.
    Square,
    /// Filled triangle.
    Triangle,
    /// Empty diamond.
    Diamond,
    /// Two crossed diagonals.
    Cross,
    /// Empty circle.
    Circle,
    /// Large empty circle around another marker.
    Ring,
}

/// Tone, dash and shape of a series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Tone.
    pub tone: Tone,
    /// Lengths of dashes and gaps in turn, empty for a solid line; none if the points are not joined.
    pub line: Option<&'static [f64]>,
    /// Line width.
    pub width: f64,
    /// Shape of the points, if they are shown.
    pub marker: Option<Marker>,
}

/// Tones, dashes and shapes of the first series; they differ in all three, and in lightness.
pub const LOOKS: [(Tone, &[f64], Marker); 6] = [
    (INK, &[], Marker::Disc),
    ((200, 90, 20), &[7.0, 3.0], Marker::Square),
    ((70, 120, 190), &[2.0, 2.5], Marker::Triangle),
    ((120, 40, 120), &[9.0, 3.0, 2.0, 3.0], Marker::Diamond),
    ((120, 165, 60), &[13.0, 4.0], Marker::Cross),
    ((150, 150, 150), &[4.0, 5.0], Marker::Circle),
];

/// Families of numerical methods.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// Explicit Runge-Kutta methods.
    RungeKutta,
    /// Methods that solve linear systems.
    Implicit,
    /// Methods that use slopes of former steps.
    AdamsBashforth,
    /// Explicit methods with many stages for stiff models.
    Stabilised,
    /// Methods that keep an oscillation's energy.
    Symplectic,
    /// Methods with exponentials.
    Exponential,
}

impl Family {
    /// The family of a solver, and its number in it.
    pub fn of(solver: Solver) -> (Family, usize) {
        match solver {
            Solver::Euler => (Family::RungeKutta, 0),
            Solver::Heun => (Family::RungeKutta, 1),
            Solver::Heun3 => (Family::RungeKutta, 2),
            Solver::Rk4 => (Family::RungeKutta, 3),
            Solver::ImplicitEuler => (Family::Implicit, 0),
            Solver::Trapezoidal => (Family::Implicit, 1),
            Solver::Ros2 => (Family::Implicit, 2),
            Solver::Rodas3 => (Family::Implicit, 3),
            Solver::Ab2 => (Family::AdamsBashforth, 0),
            Solver::Ab3 => (Family::AdamsBashforth, 1),
            Solver::Ab4 => (Family::AdamsBashforth, 2),
            Solver::Rkc5 => (Family::Stabilised, 0),
            Solver::Rkc10 => (Family::Stabilised, 1),
            Solver::SymplecticEuler => (Family::Symplectic, 0),
            Solver::Leapfrog => (Family::Symplectic, 1),
            Solver::RushLarsen => (Family::Exponential, 0),
            Solver::Exact => (Family::Exponential, 1),
        }
    }
}

impl Look {
    fn of(index: usize) -> (Tone, &'static [f64], Marker) {
        let (tone, dash, _) = LOOKS[index % LOOKS.len()];
        // Tones repeat after six, with other markers.
        (tone, dash, LOOKS[(index + index / LOOKS.len()) % LOOKS.len()].2)
    }

    /// The look of a solver: methods of a family have tone and dash in common, and each of them its marker.
    pub fn of_solver(solver: Solver) -> Look {
        let (family, member) = Family::of(solver);
        let (tone, dash, _) = LOOKS[family as usize];
        let marker = LOOKS[(member + family as usize) % LOOKS.len()].2;
        Look { tone, line: Some(dash), width: 1.4, marker: Some(marker) }
    }

    /// The same, so pale that it stays behind others.
    pub fn pale(self) -> Look {
        let mix = |tone: u8| tone / 3 + 150;
        let (r, g, b) = self.tone;
        Look { tone: (mix(r), mix(g), mix(b)), width: 1.0, ..self }
    }

    /// A line without markers; tone and dash repeat after six, tone and marker together after 36.
    pub fn line(index: usize) -> Look {
        let (tone, dash, _) = Look::of(index);
        Look { tone, line: Some(dash), width: 1.4, marker: None }
    }

    /// Markers that are not joined.
    pub fn markers(index: usize) -> Look {
        let (tone, _, marker) = Look::of(index);
        Look { tone, line: None, width: 1.4, marker: Some(marker) }
    }

    /// Joined markers.
    pub fn joined(index: usize) -> Look {
        Look { marker: Some(Look::of(index).2), ..Look::line(index) }
    }

    /// A thin line for a limit.
    pub fn limit() -> Look {
        Look { tone: SOFT, line: Some(&[4.0, 4.0]), width: 1.0, marker: None }
    }

    /// Rings around points of other series.
    pub fn ring() -> Look {
        Look { tone: INK, line: None, width: 1.4, marker: Some(Marker::Ring) }
    }

    /// A wide pale line behind the others, for a front or a reference.
    pub fn broad() -> Look {
        Look { tone: (190, 190, 190), line: Some(&[]), width: 5.0, marker: None }
    }
}

/// A shade from nearly white to dark blue for a share from 0 to 1; in grey, too, it becomes darker.
pub fn shaded(share: f64) -> Tone {
    let mix = |from: f64, to: f64| (from + (to - from) * share.clamp(0.0, 1.0)).round() as u8;
    (mix(250.0, 20.0), mix(250.0, 60.0), mix(250.0, 120.0))
}

/// So many of something: `1 PE`, `2 PEs`.
pub fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// Width of a line of text. The font of the reader is not known, so this is that of a wide one (DejaVu Sans).
pub fn text_width(text: &str, size: f64) -> f64 {
    let em = |c: char| match c {
        'i' | 'j' | 'l' | '\'' | '|' | '.' | ',' | ':' | ';' | '!' | ' ' | 'I' => 0.33,
        'f' | 't' | 'r' | '(' | ')' | '[' | ']' | '/' | '-' | '"' => 0.41,
        'm' | 'w' | 'M' | 'W' | '%' | '@' | '…' => 0.97,
        'A'..='Z' | '=' | '+' | '<' | '>' | '~' | '^' | '#' => 0.76,
        c if c.is_ascii() => 0.63,
        _ => 1.0,
    };
    text.chars().map(em).sum::<f64>() * size
}

/// Text that fits into `width`, without characters that XML does not allow; the middle of a long name is left out,
/// for the ends of names differ.
pub fn fitted(text: &str, size: f64, width: f64) -> String {
    let plain = |c: char| if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') { '\u{fffd}' } else { c };
    let text: String = text.chars().map(plain).collect();
    if text_width(&text, size) <= width {
        return text;
    }
    let letters: Vec<char> = text.chars().collect();
    let mut kept = letters.len().min(1000);
    while kept > 1 {
        kept -= 1;
        let (head, tail) = (kept.div_ceil(2), kept / 2);
        let head: String = letters[..head].iter().collect();
        let tail: String = letters[letters.len() - tail..].iter().collect();
        let shortened = format!("{head}…{tail}");
        if text_width(&shortened, size) <= width {
            return shortened;
        }
    }
    "…".to_owned()
}

/// Breaks text into lines of at most `width`, at spaces; a word that is too long is shortened.
pub fn wrapped(text: &str, size: f64, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        let word = fitted(word, size, width);
        match lines.last_mut() {
            Some(line) if text_width(line, size) + text_width(" ", size) + text_width(&word, size) <= width => {
                line.push(' ');
                line.push_str(&word);
            }
            _ => lines.push(word),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_solvers_look_alike_in_grey() {
        let looks = Solver::ALL.map(Look::of_solver);
        for (at, look) in looks.iter().enumerate() {
            for other in &looks[..at] {
                assert!((look.line, look.marker) != (other.line, other.marker), "{look:?}");
            }
        }
    }
}
