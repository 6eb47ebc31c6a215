//! Grids of cells whose neighbours have equal coefficients, for tests.

use std::fmt::Write;

use pe_ir::graph::{FixedPoint, StepGraph};
use pe_ir::text::{self, Stage};

use super::problem::Problem;
use crate::pairs;

/// A mapped step of two stages.
pub(super) struct Grid {
    pub(super) graph: StepGraph,
    pub(super) fixed: FixedPoint,
}

impl Grid {
    pub(super) fn problem(&self) -> Problem {
        let optimistic = pairs::optimistic(&self.graph, &self.fixed).expect("neighbours are in pairs");
        Problem::with_pairs(&self.graph, &self.fixed, &optimistic)
    }

    pub(super) fn without_pairs(&self) -> Problem {
        Problem::of(&self.graph)
    }
}

/// A box of cells `v` that read the neighbours at some offsets and their opposites, those at the ends of the list with
/// another coefficient, where they are inside; each has a `w` that no pair needs.
pub(super) fn grid(sides: &[usize], offsets: &[&[i32]]) -> Grid {
    let cells: usize = sides.iter().product();
    let neighbour = |cell: usize, offset: &[i32], sign: i32| {
        let (mut rest, mut stride, mut there) = (cell, 1, 0);
        for (side, step) in sides.iter().zip(offset) {
            let at = (rest % side) as i32 + sign * step;
            if at < 0 || at >= *side as i32 {
                return None;
            }
            rest /= side;
            there += at as usize * stride;
            stride *= side;
        }
        Some(there)
    };
    let (mut states, mut equations, mut values) = (String::new(), String::new(), String::new());
    let (mut chains, mut numbers, mut products) = (String::new(), String::new(), String::new());
    for name in ["v", "w"] {
        for cell in 0..cells {
            let state = format!("{name}[{cell}]");
            _ = writeln!(states, "state {state} initial 1 start {state} end {state}.next");
            _ = writeln!(equations, "equation {state}");
            _ = writeln!(values, "value {state} state {state} in {state}");
            _ = writeln!(values, "value {state}.next next {state} in {state}");
            _ = writeln!(values, "value {state}.stage2 stage {state} 2 in {state}");
            for value in ["", ".next", ".stage2"] {
                _ = writeln!(numbers, "value {state}{value} exponent -37 half-scale");
            }
        }
    }
    for (from, to) in [("", ".stage2"), (".stage2", ".next")] {
        for cell in 0..cells {
            let (mut sum, mut coefficients) =
                (format!("-0.001*v[{cell}]{from} + 0.0004*w[{cell}]{from}"), String::new());
            for (index, offset) in offsets.iter().enumerate() {
                let (text, word) = if index < 3 { ("0.0005", 68_719_477) } else { ("0.00025", 34_359_738) };
                for near in [-1, 1].into_iter().filter_map(|sign| neighbour(cell, offset, sign)) {
                    _ = write!(sum, " + {text}*v[{near}]{from}");
                    _ = write!(coefficients, " {word}");
                }
            }
            _ = writeln!(chains, "chain v[{cell}]{to} = v[{cell}] + ({sum})");
            _ = writeln!(
                products,
                "chain v[{cell}]{to} product -66 shifts 29 0 0 accumulator 64 coefficients -137438953 54975581{coefficients}"
            );
        }
        for cell in 0..cells {
            _ = writeln!(chains, "chain w[{cell}]{to} = w[{cell}] + (0.001*v[{cell}]{from} - 0.0015*w[{cell}]{from})");
            _ = writeln!(
                products,
                "chain w[{cell}]{to} product -66 shifts 29 0 0 accumulator 64 coefficients 137438953 -206158430"
            );
        }
    }
    let text = format!(
        "pe-synth step 1\nstep 0.01 form increments stages 2\nconsidered increments stages 2 products 12 largest 3 ports 0 cycles 12\n\
         pre_adder\n{states}output v[0] value v[0].next\n{equations}{values}{chains}\
         pe-synth fixed 1\nformat storage 32 guard 8 data 32 coefficient 32\n{numbers}{products}"
    );
    let sections = text::sections(&text).expect("two texts");
    let section = |stage| sections.iter().find(|section| section.stage == stage).expect("one of the two");
    let graph = text::step::read(section(Stage::Step)).unwrap_or_else(|error| panic!("{error:?}"));
    let fixed = text::fixed::read(section(Stage::Fixed), &graph).unwrap_or_else(|error| panic!("{error:?}"));
    Grid { graph, fixed }
}
