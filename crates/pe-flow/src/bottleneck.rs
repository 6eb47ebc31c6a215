//! The PE that limits the cycles per step, and why.

use std::collections::BTreeMap;

use pe_ir::index::PeId;
use pe_ir::program::{LinkSource, PeProgram, Program};

use crate::pipeline::Design;
use crate::report::network::{Limiting, MainSource};

/// Equations that are named in the report.
const NAMED: usize = 5;

/// The PE with most issue slots in use; of several the first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Bottleneck {
    /// Its index.
    pub pe: PeId,
    /// Control words that read an operand.
    pub busy: u32,
    /// Control words that read none, while operands are under way or other PEs finish.
    pub idle: u32,
    /// Words that arrive in a step.
    pub arrivals: u32,
    /// Where most of them come from.
    pub main_source: Option<(LinkSource, u32)>,
}

impl Bottleneck {
    /// Finds it.
    pub fn of(design: &Design) -> Bottleneck {
        let program = &design.program;
        let busiest = |best, pe| if busy(&program.pes[pe]) > busy(&program.pes[best]) { pe } else { best };
        let pe = program.pes.ids().fold(PeId::new(0), busiest);
        let of_pe = &program.pes[pe];
        let mut sources: BTreeMap<LinkSource, u32> = BTreeMap::new();
        for (port, _) in of_pe.words.iter().filter_map(|word| word.receive) {
            *sources.entry(of_pe.ports[port]).or_default() += 1;
        }
        let busy = busy(of_pe);
        Bottleneck {
            pe,
            busy,
            idle: program.period - busy,
            arrivals: sources.values().sum(),
            // Of several the first: the order must not depend on anything else.
            main_source: sources.into_iter().rev().max_by_key(|(_, words)| *words),
        }
    }

    /// What limits this PE, in words.
    pub fn reason(&self) -> &'static str {
        // A twentieth of the step is lost wherever rounds begin and end.
        if self.idle * 20 <= self.busy { "its products fill the step" } else { "it waits for results" }
    }

    /// As the report has it.
    pub fn report(&self, program: &Program) -> Limiting {
        let equations = &program.pes[self.pe].equations;
        let main_source = self.main_source.map(|(source, words)| MainSource { from: name(program, source), words });
        Limiting {
            pe: self.pe.index(),
            equations: equations.len(),
            first_equations: equations.iter().take(NAMED).cloned().collect(),
            busy_cycles: self.busy,
            idle_cycles: self.idle,
            reason: self.reason().to_owned(),
            ports: program.pes[self.pe].ports.len(),
            arrivals: self.arrivals,
            main_source,
        }
    }
}

fn busy(pe: &PeProgram) -> u32 {
    pe.words.iter().filter(|word| word.own.is_some() || word.imported.is_some()).count() as u32
}

fn name(program: &Program, source: LinkSource) -> String {
    match source {
        LinkSource::Pe(pe) => format!("PE {pe}"),
        LinkSource::Input(input) => format!("input `{}`", program.inputs[input as usize].name),
    }
}
