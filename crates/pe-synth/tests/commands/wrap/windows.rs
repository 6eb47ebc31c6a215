//! Windows of parameters, and of outputs that the network keeps in memories.

use super::*;
use crate::support::kept;
use crate::support::models::TUNED;

impl Pair<'_> {
    /// Writes random words of the parameters into their window, about the range for which the design was judged.
    fn other_parameters(&mut self) -> Result<Vec<i64>, String> {
        let (map, places) = (self.device.map.clone(), self.device.wrap.parameters.clone());
        let mut words = Vec::new();
        for (parameter, place) in map.parameters.iter().zip(&places) {
            let [least, most] = parameter.range;
            let number = self.random.random_range(least..=most);
            let word = map.states[parameter.state as usize].word(number).unwrap().word;
            for half in 0..place.words {
                let written = self.device.write_at(place.address + 4 * half, (word >> (32 * half)) as u32, 15)?;
                same("a write of a parameter", written, true)?;
            }
            words.push(word);
        }
        Ok(words)
    }

    fn parameters(&mut self) -> Result<Vec<Option<i64>>, String> {
        self.device.wrap.parameters.clone().iter().map(|place| self.device.value(place)).collect()
    }

    /// The simulator goes on with other words of the parameters.
    fn tune(&mut self, words: &[i64]) {
        let mut program = self.program.clone();
        let states: Vec<(StateId, i64)> = program.states.ids().map(|id| (id, self.machine.state(id))).collect();
        let number = |id: StateId| states.iter().position(|(other, _)| *other == id);
        for (id, word) in states.clone() {
            let own = |parameter: &pe_map::Parameter| Some(parameter.state as usize) == number(id);
            let word = self.device.map.parameters.iter().position(own).map_or(word, |parameter| words[parameter]);
            program.states[id].clone().set(&mut program.pes, &program.format, word);
        }
        for tick in program.inputs.iter_mut().filter_map(|input| input.tick.as_mut()) {
            tick.done = (tick.done + self.done) % tick.steps;
        }
        self.machine = Machine::new(Arc::new(program));
    }

    /// Parameters act when they are taken, together, between two steps; outputs stay until the next one.
    pub(super) fn tuning(&mut self) -> Checked {
        self.fresh()?;
        let initial = |parameter: &pe_map::Parameter| Some(self.device.map.states[parameter.state as usize].initial);
        let initial: Vec<Option<i64>> = self.device.map.parameters.iter().map(initial).collect();
        same("parameters at first", self.parameters()?, initial.clone())?;
        let words = self.other_parameters()?;
        same("the window", self.parameters()?, words.iter().copied().map(Some).collect())?;
        self.steps(2)?;
        let before = self.device.outputs()?;
        self.device.command(&["PARAMETERS"])?;
        same("a second time", self.device.try_command(&["PARAMETERS"])?, false)?;
        same("TUNING", self.device.is("TUNING")?, true)?;
        let first = self.device.wrap.parameters[0].address;
        same("a write while they are taken", self.device.write_at(first, 1, 15)?, false)?;
        self.device.await_bit("TUNING", false)?;
        same("outputs stay", self.device.outputs()?, before)?;
        self.tune(&words);
        self.steps(3)?;
        // With the start of a run, in front of its first step; with a limit of clocks, which they do not count against.
        let latency = self.device.read("CLOCKS_LAST")?;
        self.device.write("CLOCK_BUDGET", latency)?;
        let words = self.other_parameters()?;
        self.change()?;
        self.device.write("RUN_STEPS", 2)?;
        self.device.command(&["START", "PARAMETERS"])?;
        self.device.await_bit("BUSY", false)?;
        self.tune(&words);
        self.follow()?;
        same("TIME_EXCEEDED", self.device.is("TIME_EXCEEDED")?, false)?;
        self.device.write("CLOCK_BUDGET", 0)?;
        // In free run, between two of the steps.
        let words = self.other_parameters()?;
        self.change()?;
        self.device.mode(&["FREE_RUN"])?;
        self.device.command(&["START"])?;
        self.device.clocks(self.random.random_range(1..2 * self.program.period))?;
        self.device.command(&["PARAMETERS"])?;
        self.device.await_bit("TUNING", false)?;
        self.device.clocks(2 * self.program.period)?;
        self.device.command(&["ABORT"])?;
        self.device.await_bit("BUSY", false)?;
        self.device.mode(&[])?;
        let (steps, shown) = (self.device.read("STEP_COUNT_LOW")?, self.device.outputs()?);
        let (from, inputs) = (self.done, self.inputs.clone());
        let states: Vec<i64> = self.program.states.ids().map(|id| self.machine.state(id)).collect();
        let mut found = false;
        for boundary in from..steps {
            (self.done, self.inputs) = (from, inputs.clone());
            self.set_states(&states);
            for step in from..steps {
                if step == boundary {
                    self.done = step;
                    self.tune(&words);
                }
                self.machine.step(&self.inputs, &mut |_| {});
            }
            found = self.machine.outputs().iter().copied().map(Some).eq(shown.iter().copied());
            if found {
                break;
            }
        }
        self.done = steps;
        same("parameters act together in free run", found, true)?;
        // Not while a host has the states; and a restart ends what has begun.
        self.device.mode(&["ACCESS"])?;
        self.device.await_bit("ACCESS", true)?;
        same("with access", self.device.try_command(&["PARAMETERS"])?, false)?;
        self.device.mode(&[])?;
        for clocks in [1, 9, 40, 90] {
            self.other_parameters()?;
            self.device.command(&["PARAMETERS"])?;
            self.device.clocks(clocks)?;
            self.device.command(&["RESTART"])?;
            self.device.await_bit("BUSY", false)?;
            same("TUNING after a restart", self.device.is("TUNING")?, false)?;
            same("parameters after a restart", self.parameters()?, initial.clone())?;
            self.renewed();
            self.steps(2)?;
        }
        Ok(())
    }

    fn set_states(&mut self, words: &[i64]) {
        let mut program = self.program.clone();
        let ids: Vec<StateId> = program.states.ids().collect();
        for (id, word) in ids.into_iter().zip(words) {
            program.states[id].clone().set(&mut program.pes, &program.format, *word);
        }
        for tick in program.inputs.iter_mut().filter_map(|input| input.tick.as_mut()) {
            tick.done = (tick.done + self.done) % tick.steps;
        }
        self.machine = Machine::new(Arc::new(program));
    }

    /// Outputs that are held while steps run, and read in free run: each time all are of one step.
    fn samples_of_one_step(&mut self) -> Checked {
        self.fresh()?;
        self.change()?;
        self.device.mode(&["FREE_RUN"])?;
        self.device.command(&["START"])?;
        for _ in 0..6 {
            self.device.mode(&["FREE_RUN", "HOLD"])?;
            let sample = self.device.read("OUTPUT_STEP_LOW")?;
            let shown = self.device.outputs()?;
            same("a held sample", self.device.read("OUTPUT_STEP_LOW")?, sample)?;
            (self.done..sample).for_each(|_| self.step());
            self.done = self.done.max(sample);
            same("its step", self.done, sample)?;
            let expected: Vec<Option<i64>> = self.machine.outputs().iter().copied().map(Some).collect();
            if sample > 0 {
                same(&format!("outputs of step {sample}"), shown, expected)?;
            }
            self.device.mode(&["FREE_RUN"])?;
            self.device.clocks(self.random.random_range(1..3 * self.program.period))?;
        }
        self.device.command(&["ABORT"])?;
        self.device.await_bit("BUSY", false)?;
        self.device.mode(&[])?;
        self.follow()
    }
}

/// More outputs than a step has clocks.
const MANY: &str = "\
model many
solver euler
step 1 ms
span 20 ms
index i in 1..40
input drive = sine(1, 20 Hz)
state x[i] = i/40
x[i]' = drive - i*x[i]
output x[i]
";

/// Outputs in memories: words of 40 bits, parameters, and an output that has no sample 0; a deep pipeline with swapped
/// buffers; more outputs than clocks, with streams and without; netlists of both.
const DESIGNS: [(&str, &str, bool, Build); 5] = [
    (TUNED, "--pes 2 --storage 40 --multiplier 35x35 --host restart,states,flags", true, bus::ghdl),
    (MANY, "--pes 8 --outputs memory --host restart,states", true, bus::verilator),
    (
        "spring_chain/spring_chain",
        "--pes 3 --loop on --pipeline deep --set n=12 --outputs memory --host restart,states,flags",
        true,
        bus::ghdl,
    ),
    (TUNED, "--pes 2 --host restart,states,flags --outputs memory --pipeline deep", false, bus::verilator),
    (MANY, "--pes 8 --outputs memory --pipeline deep", false, bus::ghdl),
];

#[test]
fn parameters_and_outputs_in_memories_do_what_the_page_says() {
    for (number, (model, options, stream, build)) in kept(DESIGNS, 3).enumerate() {
        let folder = Folder::new(&format!("wrap_windows_{number}"));
        let design = wrapped(&folder.0, model, options, if stream { &["--stream"] } else { &[] });
        let scratch = folder.sub("scratch");
        let command = build(&design, &scratch);
        let program = DesignFolder::open(&design).unwrap().program;
        let start = || Device::start(&command, &design, &scratch);
        let checked = Pair::new(start(), &program)
            .exercise(start)
            .and_then(|()| Pair::new(start(), &program).samples_of_one_step());
        checked.unwrap_or_else(|what| panic!("{number} {options}: {what}"));
    }
}

/// Damages of the windows: file, what is there, what takes its place.
const DAMAGES: [Damage; 12] = [
    // Outputs change in spite of `HOLD`.
    ("hdl/pe_output_window.vhd", "show   <= not hold_i and", "show   <="),
    // The bank that is shown is written.
    ("hdl/pe_output_window.vhd", "write_address <= not bank", "write_address <= bank"),
    // Steps end before the outputs of the one before were read.
    ("hdl/pe_output_window.vhd", "stepping_i = '0' and asked >= OUTPUT_WORDS - ROOM", "true"),
    // A run ends before its outputs are there.
    ("hdl/pe_output_window.vhd", "stored = OUTPUT_WORDS and capture_i = '0'", "true"),
    // Halves of wide words.
    ("hdl/pe_output_window.vhd", "HALVES = 2 and stored(0) = '1'", "stored(0) = '1'"),
    // Outputs without a sample 0.
    ("hdl/pe_output_window.vhd", "(was_first and first_word(32))", "was_first"),
    // A frame is overwritten while it is sent.
    ("hdl/pe_stream.vhd", "write_address <= not bank & place_i;", "write_address <= bank & place_i;"),
    // Words of a frame that nobody took.
    ("hdl/pe_stream.vhd", "place + 1 when taken_out = '1' else", "place + 1 when offered = '1' else"),
    // Parameters that are written while they are taken.
    ("hdl/pe_registers.vhd", "is_param_i and not (write_i and tuning_i)", "is_param_i"),
    // Parameters of the last run after a restart.
    ("hdl/pe_parameters.vhd", "(renew_i = '1' or fresh = '1')", "(fresh = '1')"),
    // States that are no parameters are not kept.
    ("hdl/pe_parameters.vhd", "keep    <= settled_i when", "keep    <= '0' when"),
    // Parameters are taken while a step runs, and outputs with them.
    ("NAME_axi.vhd", "port_begins and not tuning", "port_begins"),
];

#[test]
fn broken_windows_are_caught() {
    let folder = Folder::new("wrap_windows_broken");
    let options = "--outputs memory --host restart,states";
    let many = wrapped(&folder.sub("many"), MANY, &format!("{options} --pes 8"), &["--stream"]);
    let tuned = wrapped(&folder.sub("tuned"), TUNED, &format!("{options} --pes 2"), &["--stream"]);
    let designs = [&tuned, &many].map(std::path::PathBuf::as_path);
    let missed = missed(&designs, &folder.0, &DAMAGES, |broken, scratch| judged(broken, scratch, bus::ghdl).is_err());
    assert_eq!(missed, Vec::<&str>::new(), "not caught");
}
