//! A wrapped design in a simulation, by its bus master.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use pe_map::Map;
use pe_map::wrap::{Place, Wrap};

/// Polls of a register until something must have happened.
const PATIENCE: usize = 20_000;

/// Runs a program that must succeed.
fn run(command: &mut Command) {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// Builds the bus master of a wrapped design in GHDL, in a folder of its own: what to run, and there.
pub fn ghdl(design: &Path, scratch: &Path) -> Vec<String> {
    let name = entity(design);
    analyse(design, scratch, &name);
    let words = ["ghdl", "-r", "--std=08", &format!("{name}_bus"), "--ieee-asserts=disable-at-0"];
    words.map(str::to_owned).to_vec()
}

/// The same of GHDL's synthesised netlist in Verilator.
pub fn verilator(design: &Path, scratch: &Path) -> Vec<String> {
    let name = entity(design);
    analyse(design, scratch, &name);
    let top = format!("{name}_axi");
    let netlist = scratch.join(format!("{top}.v"));
    let mut synth = Command::new("ghdl");
    synth.args(["--synth", "--std=08", "--out=verilog", &top]).current_dir(scratch);
    let output = synth.output().expect("ghdl starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    fs::write(&netlist, output.stdout).unwrap();
    let mut build = Command::new("verilator");
    build.args(["--cc", "--exe", "--build", "-O3", "-Wno-fatal", "-Wno-lint", "--Mdir", "obj", "--top-module", &top]);
    run(build.arg(&netlist).arg(design.join(format!("{name}_bus.cpp"))).current_dir(scratch));
    vec![scratch.join("obj").join(format!("V{top}")).display().to_string()]
}

fn analyse(design: &Path, scratch: &Path, name: &str) {
    let list = fs::read_to_string(design.join(format!("{name}_axi.f"))).unwrap();
    for (library, file) in list.lines().filter_map(|line| line.split_once(' ')) {
        let mut analysis = Command::new("ghdl");
        analysis.args(["-a", "--std=08", &format!("--work={library}")]).arg(design.join(file));
        run(analysis.current_dir(scratch));
    }
}

/// Name of the wrapped design in a folder.
fn entity(design: &Path) -> String {
    let names = fs::read_dir(design).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names.filter_map(|name| Some(name.strip_suffix("_wrap.json")?.to_owned())).next().expect("it is wrapped")
}

/// A wrapper that is simulated.
pub struct Device {
    child: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    /// What it is.
    pub wrap: Wrap,
    /// The map beside it.
    pub map: Map,
    registers: BTreeMap<String, u32>,
    fields: BTreeMap<(String, String), u32>,
    /// Clocks that went by in accesses.
    pub accesses: usize,
}

impl Drop for Device {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Device {
    /// Starts a simulation.
    pub fn start(command: &[String], design: &Path, scratch: &Path) -> Device {
        let mut start = Command::new(&command[0]);
        start.args(&command[1..]).current_dir(scratch).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = start.stderr(Stdio::null()).spawn().expect("it was just built");
        let (to, from) = (child.stdin.take().unwrap(), BufReader::new(child.stdout.take().unwrap()));
        let name = entity(design);
        let read = |kind: &str| fs::read_to_string(design.join(format!("{name}_{kind}.json"))).unwrap();
        let (wrap, map) = (Wrap::read(&read("wrap")).unwrap(), Map::read(&read("map")).unwrap());
        let registers = wrap.registers.iter().map(|register| (register.name.clone(), register.address)).collect();
        let fields = wrap.registers.iter().flat_map(|register| {
            register.fields.iter().map(|field| ((register.name.clone(), field.name.clone()), 1 << field.low))
        });
        let fields = fields.collect();
        Device { child, to, from, wrap, map, registers, fields, accesses: 0 }
    }

    /// A request and its answer; what the simulator says on its own is passed over.
    pub fn ask(&mut self, request: &str) -> Result<String, String> {
        let dead = |_| format!("the simulation ended before `{request}`");
        writeln!(self.to, "{request}").and_then(|()| self.to.flush()).map_err(dead)?;
        loop {
            let mut line = String::new();
            match self.from.read_line(&mut line) {
                Ok(1..) => {}
                _ => return Err(format!("the simulation ended at `{request}`")),
            }
            if let Some(answer) = line.strip_prefix("pe: ") {
                return Ok(answer.trim().to_owned());
            }
        }
    }

    /// A word; none if reading it is an error.
    pub fn read_at(&mut self, address: u32) -> Result<Option<u32>, String> {
        self.accesses += 1;
        let answer = self.ask(&format!("r {address:x}"))?;
        if answer == "slverr" {
            return Ok(None);
        }
        u32::from_str_radix(&answer, 16).map(Some).map_err(|_| format!("{address:03x} reads `{answer}`"))
    }

    /// Writes the bytes of a word whose strobes are 1; whether that was possible.
    pub fn write_at(&mut self, address: u32, word: u32, strobes: u8) -> Result<bool, String> {
        self.accesses += 1;
        Ok(self.ask(&format!("w {address:x} {word:x} {strobes:x}"))? == "ok")
    }

    pub fn address(&self, name: &str) -> u32 {
        *self.registers.get(name).unwrap_or_else(|| panic!("no register {name}"))
    }

    pub fn read(&mut self, name: &str) -> Result<u32, String> {
        let address = self.address(name);
        self.read_at(address)?.ok_or_else(|| format!("{name} cannot be read"))
    }

    pub fn try_write(&mut self, name: &str, word: u32) -> Result<bool, String> {
        self.write_at(self.address(name), word, 15)
    }

    pub fn write(&mut self, name: &str, word: u32) -> Result<(), String> {
        if self.try_write(name, word)? { Ok(()) } else { Err(format!("{name} cannot be written with {word:x}")) }
    }

    /// Bits of fields of a register.
    pub fn bits(&self, register: &str, names: &[&str]) -> u32 {
        let bit = |name: &&str| self.fields[&(register.to_owned(), (*name).to_owned())];
        names.iter().map(bit).sum()
    }

    pub fn try_command(&mut self, names: &[&str]) -> Result<bool, String> {
        self.try_write("COMMAND", self.bits("COMMAND", names))
    }

    pub fn command(&mut self, names: &[&str]) -> Result<(), String> {
        if self.try_command(names)? { Ok(()) } else { Err(format!("{names:?} is refused")) }
    }

    pub fn mode(&mut self, names: &[&str]) -> Result<(), String> {
        self.write("MODE", self.bits("MODE", names))
    }

    /// Whether bits of `STATUS` are 1.
    pub fn is(&mut self, name: &str) -> Result<bool, String> {
        Ok(self.read("STATUS")? & self.bits("STATUS", &[name]) != 0)
    }

    pub fn await_bit(&mut self, name: &str, value: bool) -> Result<(), String> {
        for _ in 0..PATIENCE {
            if self.is(name)? == value {
                return Ok(());
            }
        }
        Err(format!("{name} does not become {value}"))
    }

    pub fn clocks(&mut self, count: u32) -> Result<(), String> {
        self.ask(&format!("c {count:x}")).map(drop)
    }

    /// Writes words of all inputs.
    pub fn give(&mut self, words: &[i64]) -> Result<(), String> {
        for (place, word) in self.wrap.inputs.clone().iter().zip(words) {
            for half in 0..place.words {
                if !self.write_at(place.address + 4 * half, (word >> (32 * half)) as u32, 15)? {
                    return Err(format!("{} cannot be written", place.name));
                }
            }
        }
        Ok(())
    }

    /// A value in the windows; none if there is none.
    pub fn value(&mut self, place: &Place) -> Result<Option<i64>, String> {
        let mut value = 0_u64;
        for half in 0..place.words {
            match self.read_at(place.address + 4 * half)? {
                Some(word) => value |= u64::from(word) << (32 * half),
                None => return Ok(None),
            }
        }
        let unused = 64 - 32 * place.words;
        Ok(Some((value << unused) as i64 >> unused))
    }

    /// All outputs; none where there is none.
    pub fn outputs(&mut self) -> Result<Vec<Option<i64>>, String> {
        self.wrap.outputs.clone().iter().map(|place| self.value(place)).collect()
    }

    /// Runs so many steps.
    pub fn run(&mut self, steps: u32) -> Result<(), String> {
        self.write("RUN_STEPS", steps)?;
        self.command(&["START"])?;
        self.await_bit("BUSY", false)
    }

    fn open(&mut self) -> Result<(), String> {
        let mode = self.read("MODE")? | self.bits("MODE", &["ACCESS"]);
        self.write("MODE", mode)?;
        self.await_bit("ACCESS", true)
    }

    fn close(&mut self) -> Result<(), String> {
        let mode = self.read("MODE")? & !self.bits("MODE", &["ACCESS"]);
        self.write("MODE", mode)
    }

    /// Stored words of states and ticks in the order of the map, and the steps before them.
    pub fn snapshot(&mut self) -> Result<(u32, Vec<i64>), String> {
        self.open()?;
        let order = self.map.host.clone().and_then(|host| host.access).expect("states").order;
        let mut words = vec![0; order.len()];
        for place in &order {
            self.write("STATE_ADDRESS", place.address as u32)?;
            let low = u64::from(self.read("STATE_LOW")?);
            let at = self.place(place);
            words[at] = (low | u64::from(self.read("STATE_HIGH")?) << 32) as i64;
        }
        let steps = self.read("STEP_COUNT_LOW")?;
        self.close()?;
        Ok((steps, words))
    }

    fn place(&self, place: &pe_map::Place) -> usize {
        let tick = place.tick.map_or(0, |tick| self.map.states.len() + tick as usize);
        place.state.map_or(tick, |state| state as usize)
    }

    /// Replaces the words of all states and ticks.
    pub fn restore(&mut self, words: &[i64]) -> Result<(), String> {
        self.open()?;
        for place in self.map.host.clone().and_then(|host| host.access).expect("states").order {
            let word = words[self.place(&place)];
            self.write("STATE_HIGH", (word >> 32) as u32)?;
            self.await_bit("STATE_READY", true)?;
            self.write("STATE_LOW", word as u32)?;
        }
        self.await_bit("ACCESS", true)?;
        self.close()
    }
}
