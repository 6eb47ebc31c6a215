//! What there is to run.

use std::path::Path;

/// A script that a person may call.
pub struct Task {
    /// File, in the folder of the crate.
    pub script: &'static str,
    /// What it makes or prints.
    pub makes: &'static str,
    /// Files of `docs` that it writes, or that show what it prints.
    pub shown: &'static [&'static str],
    /// What must be installed beside cargo and bash.
    pub needs: &'static str,
    /// Time on two idle cores, with a warm build.
    pub takes: &'static str,
}

impl Task {
    /// The name of the script without its ending.
    pub fn name(&self) -> &'static str {
        Path::new(self.script).file_stem().and_then(|name| name.to_str()).unwrap_or(self.script)
    }
}

const fn task(
    script: &'static str,
    makes: &'static str,
    shown: &'static [&'static str],
    needs: &'static str,
    takes: &'static str,
) -> Task {
    Task { script, makes, shown, needs, takes }
}

/// All tasks.
pub const TASKS: &[Task] = &[
    task("pages/baseline.sh", "native programs against plain C", &["baseline.md"], "gcc, python3", "5 minutes"),
    task("pages/benchmarks.py", "times of the stages of a compilation", &["benchmarks.md"], "python3", "some minutes"),
    task(
        "pages/sweeps.py",
        "how long sweeps take, and how well that is told",
        &["decisions/0083-time-of-sweeps.md"],
        "python3",
        "20 minutes",
    ),
    task(
        "pages/check-cost.py",
        "processor time of `check` against that of `compile`",
        &["decisions/0027-check.md"],
        "python3",
        "1 hour",
    ),
    task(
        "pages/fit-area.sh",
        "measures single PEs and fits the area model",
        &["area-model.md", "silicon.md"],
        "ghdl, iverilog, python3, yosys",
        "2 hours",
    ),
    task("pages/goals.py", "designs for stated errors", &["goals.md"], "python3", "2 hours"),
    task(
        "pages/house.py",
        "counts long functions, circles of modules, repeated places, casts",
        &["contributing.md"],
        "python3",
        "20 seconds",
    ),
    task("pages/leave-out.sh", "what leaving out outputs saves", &["leave-out.md"], "ghdl, jq, yosys", "some minutes"),
    task(
        "pages/loop-speed.py",
        "steps per second in closed loop, of the reference as a library and through a host",
        &["library.md", "host.md"],
        "python3",
        "a minute",
    ),
    task(
        "pages/measure.sh",
        "tables and figures of the paper",
        &["results.md"],
        "ghdl, python3, yosys",
        "2 to 3 hours",
    ),
    task("pages/mechanics.py", "cycles and errors of mechanisms", &["mechanics.md"], "python3", "30 minutes"),
    task(
        "pages/networks.sh",
        "cells of whole networks beside estimates",
        &["silicon.md"],
        "ghdl, python3, yosys",
        "20 minutes",
    ),
    task(
        "pages/orders.py",
        "the compiler's order of elimination beside others",
        &["decisions/0067-linear-systems.md"],
        "python3 with scipy",
        "2 hours",
    ),
    task(
        "pages/partitions.py",
        "the mapper against METIS",
        &["decisions/0018-mapping.md"],
        "pymetis of PyPI",
        "some minutes",
    ),
    task(
        "pages/printed.py",
        "what commands print, in README and pages; `--check` compares it",
        &["contributing.md"],
        "ghdl, python3",
        "15 seconds; `--long` minutes",
    ),
    task(
        "pages/ranges.py",
        "proofs of ranges of affine models",
        &["decisions/0045-proof-of-ranges.md"],
        "python3",
        "some minutes",
    ),
    task(
        "pages/saturation-box.py",
        "how many states of an affine model a box proves free of overflow",
        &["decisions/0013-saturation-stays.md"],
        "python3",
        "seconds",
    ),
    task("pages/scaling.py", "what compiling takes as models grow", &["scaling.md"], "python3", "1 hour"),
    task("pages/timing.sh", "timing diagrams; `--check` compares them", &["hardware.md"], "ghdl", "5 seconds"),
    task(
        "pages/validation.sh",
        "errors of the validation set, stated and true",
        &["validation.md"],
        "",
        "a few minutes",
    ),
    task(
        "pages/walkthrough.sh",
        "what a new user types and sees; `--quick` leaves the tests out",
        &["walkthrough.md"],
        "what testbenches/test-all.sh installs",
        "20 minutes",
    ),
    task(
        "pages/words.py",
        "what `check` says about short and long words",
        &["decisions/0032-judgement.md"],
        "python3",
        "15 minutes",
    ),
    task(
        "synthesis/measure-area.sh",
        "area of every PE shape of a design, its netlist simulated",
        &["guide.md", "silicon.md"],
        "ghdl, iverilog, python3, yosys",
        "half a minute a shape",
    ),
    task(
        "synthesis/measure-clock.sh",
        "clock of a network on a Lattice ECP5 after place and route",
        &["silicon.md"],
        "ghdl, nextpnr-ecp5, python3, yosys",
        "minutes",
    ),
    task(
        "synthesis/measure-network.sh",
        "cells of whole networks beside the report's estimates",
        &["guide.md", "hardware.md", "silicon.md"],
        "ghdl, python3, yosys",
        "a minute a network",
    ),
    task(
        "synthesis/measure-parts.sh",
        "cells of what a network has beside PEs, for the area model",
        &["decisions/0040-synthesis-as-estimated.md"],
        "ghdl, yosys",
        "5 minutes",
    ),
    task(
        "synthesis/measure-wrapper.sh",
        "cells of wrappers without what they wrap",
        &["wrapper.md"],
        "ghdl, yosys",
        "two minutes a wrapper",
    ),
    task(
        "synthesis/pack-registers.py",
        "moves flip-flops of an ECP5 netlist into blocks",
        &["silicon.md"],
        "python3",
        "seconds",
    ),
    task(
        "synthesis/single_pes.py",
        "a folder of single PEs for measure-area",
        &["decisions/0017-pre-adder.md"],
        "python3",
        "seconds",
    ),
    task(
        "packages/deb.sh",
        "a Debian package of a built binary",
        &["contributing.md"],
        "binutils, dpkg, git",
        "seconds",
    ),
    task(
        "synthesis/to-verilog.sh",
        "prints a network as Verilog for yosys",
        &["guide.md", "hardware.md"],
        "ghdl",
        "seconds",
    ),
];

/// Scripts that others call.
#[cfg(test)]
pub const PARTS: &[&str] = &[
    "common.sh",
    "pages/baseline.py",
    "pages/common.py",
    "pages/results.py",
    "synthesis/analyse.sh",
    "synthesis/cells-sim.sh",
    "synthesis/count-cells.awk",
    "synthesis/count-pairs.py",
    "synthesis/styles.awk",
    "synthesis/wrapper-to-verilog.sh",
];
