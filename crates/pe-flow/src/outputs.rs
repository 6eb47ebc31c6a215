//! Whether outputs are ports or words of memories: what takes less of the device.

use pe_ir::program::Program;
use pe_target::area::{self, Area, Family};

use crate::failure::Failure;
use crate::report::types::OutputsIn;

/// What is asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wanted {
    /// Whatever takes less, beyond a few outputs.
    #[default]
    Auto,
    /// Ports.
    Ports,
    /// Memories with a read port.
    Memory,
}

/// Outputs up to which ports stay: they need no reader.
pub const FEW: usize = 16;

/// Puts the outputs of a program into memories if that is asked for, or if it takes less. What is said of it in the report:
/// nothing of few outputs that nobody asked about.
///
/// # Errors
/// [`Failure::Usage`] if what is asked for is impossible; [`Failure::Internal`] if the outputs are not in their places then.
pub fn place(program: &mut Program, wanted: Wanted, family: Family) -> Result<Option<OutputsIn>, Failure> {
    let count = program.outputs.len();
    if program.output_memory().is_some() {
        // As a text that was read says.
        return match wanted {
            Wanted::Ports => Err(Failure::Usage("the program has its outputs in memories already".to_owned())),
            _ => Ok(Some(told("memory", "the program that was read has them there", None))),
        };
    }
    if wanted == Wanted::Auto && count <= FEW {
        return Ok(None);
    }
    let mut moved = program.clone();
    let possible = match count {
        0 => Err("there are no outputs".to_owned()),
        _ => pe_hls::outputs::to_memory(&mut moved),
    };
    if let Err(reason) = possible {
        return match wanted {
            Wanted::Memory => Err(Failure::Usage(format!("{reason}; use `--outputs ports`"))),
            _ => Ok(Some(told("ports", &reason, None))),
        };
    }
    let sizes = [area::estimate(program, family), area::estimate(&moved, family)];
    let [ports, memory] = sizes.map(|area| area.equivalent_luts());
    let (to_memory, reason) = match wanted {
        Wanted::Auto if memory < ports => (true, "takes less"),
        Wanted::Auto => (false, "takes less"),
        Wanted::Ports => (false, "asked for"),
        Wanted::Memory => (true, "asked for"),
    };
    if to_memory {
        moved.check_outputs().map_err(Failure::Internal)?;
        *program = moved;
    }
    Ok(Some(told(if to_memory { "memory" } else { "ports" }, reason, Some(&sizes))))
}

fn told(kind: &str, reason: &str, sizes: Option<&[Area; 2]>) -> OutputsIn {
    let lut = |at: usize| sizes.map(|sizes: &[Area; 2]| sizes[at].equivalent_luts().round());
    OutputsIn { kind: kind.to_owned(), reason: reason.to_owned(), ports_lut: lut(0), memory_lut: lut(1) }
}
