//! What every PE does in every cycle of a step: products, writes and receives, each in its own lane.

use pe_ir::index::PeId;
use pe_ir::program::{ControlWord, PeProgram, Program};

use crate::axis::{Axis, Scale};
use crate::canvas::{Anchor, picture};
use crate::chart::title;
use crate::network::load;
use crate::style::{GRID, LABEL, MARGIN, PAPER, SMALL, SOFT, TITLE, Tone, text_width, wrapped};

/// Width of the picture.
const WIDTH: f64 = 980.0;

/// Columns at most; a column of a longer step stands for several cycles.
const COLUMNS: usize = 800;

/// Shades of a column that stands for several cycles.
const LEVELS: usize = 4;

/// A kind of work with its place in the row of a PE.
struct Lane {
    name: &'static str,
    happens: fn(&ControlWord) -> bool,
    tone: Tone,
    /// Upper end and height as parts of the row.
    top: f64,
    height: f64,
}

const LANES: [Lane; 3] = [
    Lane {
        name: "product",
        happens: |word| word.own.is_some() || word.imported.is_some(),
        tone: (140, 175, 215),
        top: 0.06,
        height: 0.46,
    },
    Lane {
        name: "write of a result",
        happens: |word| word.write.is_some() || word.send,
        tone: (26, 26, 26),
        top: 0.52,
        height: 0.2,
    },
    Lane {
        name: "receive from another PE or an input",
        happens: |word| word.receive.is_some(),
        tone: (200, 90, 20),
        top: 0.74,
        height: 0.2,
    },
];

/// Draws the occupancy.
pub fn draw(program: &Program) -> String {
    let (pes, period) = (program.pes.len().max(1), program.period.max(1) as usize);
    let row = (1100.0 / pes as f64).clamp(2.7, 26.0);
    let height = row * pes as f64;
    let busiest = program
        .pes
        .ids()
        .fold(PeId::new(0), |best, pe| if load(&program.pes[pe], 1) > load(&program.pes[best], 1) { pe } else { best });
    let per_column = period.div_ceil(COLUMNS);
    let several = if per_column == 1 {
        String::new()
    } else {
        format!(" A column stands for {per_column} cycles; the fainter it is, the fewer of them are used.")
    };
    let caption = format!(
        "One row per PE with three lanes, one column per cycle; white is idle. PE {busiest} has most products.{several}"
    );
    let caption = wrapped(&caption, SMALL, WIDTH - 2.0 * MARGIN);
    let top = MARGIN + TITLE + 8.0 + caption.len() as f64 * (SMALL + 4.0) + LABEL + 14.0;
    let (left, right) = (MARGIN + 62.0, WIDTH - MARGIN - 64.0);
    let column = (right - left) / period as f64;
    let cycles = Axis::new(Scale::Linear, [0.0, period as f64].into_iter(), true, 12);
    let rows = Axis::new(Scale::Linear, [0.0, (pes - 1).max(1) as f64].into_iter(), true, 20);
    let heading = format!("{}: occupancy of the PEs", program.model);
    picture(&heading, (WIDTH, (top + height + SMALL + LABEL + 34.0).ceil()), |canvas| {
        let y = title(canvas, &heading, &caption, WIDTH - 2.0 * MARGIN);
        let mut x = MARGIN;
        for lane in &LANES {
            let y = y + LABEL / 2.0;
            canvas.fill((x, y - 5.0), (x + 22.0, y + 5.0), lane.tone);
            canvas.text(lane.name, (x + 28.0, y), SMALL, Anchor::Start);
            x += 50.0 + text_width(lane.name, SMALL);
        }
        for tick in cycles.ticks() {
            let x = left + tick * column;
            canvas.path(&[(x, top), (x, top + height + 4.0)], GRID, 0.8);
            canvas.text(&cycles.label(*tick), (x, top + height + 5.0 + SMALL / 2.0), SMALL, Anchor::Middle);
        }
        if row >= 7.0 {
            for pe in 1..pes {
                let y = top + pe as f64 * row;
                canvas.path(&[(left, y), (right, y)], GRID, 0.6);
            }
        }
        let named: Vec<usize> = match row >= SMALL + 1.0 {
            true => (0..pes).collect(),
            false => rows.ticks().iter().filter(|tick| tick.fract() == 0.0).map(|tick| *tick as usize).collect(),
        };
        for pe in named {
            let y = top + (pe as f64 + 0.5) * row;
            canvas.text(&pe.to_string(), (left - 6.0, y), SMALL, Anchor::End);
            canvas.path(&[(left - 4.0, y), (left, y)], SOFT, 0.8);
            if let Some(program_of_pe) = program.pes.get(pe) {
                let text = format!("{:.0} %", load(program_of_pe, program.period) * 100.0);
                canvas.toned(&text, (right + 8.0, y), SMALL, Anchor::Start, SOFT);
            }
        }
        for lane in &LANES {
            for level in 1..=LEVELS {
                let strokes = program.pes.iter().enumerate().flat_map(|(pe, words)| {
                    let y = top + (pe as f64 + lane.top + lane.height / 2.0) * row;
                    runs(words, lane, per_column, level).into_iter().map(move |(from, to)| {
                        let from = left + (from * per_column) as f64 * column;
                        let to = left + ((to * per_column).min(period)) as f64 * column;
                        (from, y, to - from)
                    })
                });
                canvas.strokes(strokes, faint(lane.tone, level), lane.height * row);
            }
        }
        canvas.frame((left, top), (right, top + height), SOFT, 1.0);
        let foot = top + height + SMALL + 12.0 + LABEL / 2.0;
        canvas.text("cycle of the step", ((left + right) / 2.0, foot), LABEL, Anchor::Middle);
        canvas.upright("PE", (MARGIN + LABEL / 2.0, top + height / 2.0), LABEL, Anchor::Middle);
        canvas.toned("products", (right + 4.0, top - 11.0), SMALL, Anchor::Start, SOFT);
    })
}

/// Stretches of columns in which a lane is used to a level.
fn runs(pe: &PeProgram, lane: &Lane, per_column: usize, level: usize) -> Vec<(usize, usize)> {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for (column, words) in pe.words.chunks(per_column).enumerate() {
        let used = words.iter().filter(|word| (lane.happens)(word)).count();
        if used > 0 && (used * LEVELS).div_ceil(words.len()) == level {
            match runs.last_mut() {
                Some(run) if run.1 == column => run.1 += 1,
                _ => runs.push((column, column + 1)),
            }
        }
    }
    runs
}

/// A tone at a level, mixed with paper.
fn faint((r, g, b): Tone, level: usize) -> Tone {
    let mix = |tone: u8, paper: u8| {
        let (tone, paper) = (f64::from(tone), f64::from(paper));
        (paper + (tone - paper) * level as f64 / LEVELS as f64).round() as u8
    };
    (mix(r, PAPER.0), mix(g, PAPER.1), mix(b, PAPER.2))
}
