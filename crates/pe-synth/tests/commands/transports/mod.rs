//! A host's program on every transport: the same integers, whatever the inputs.

mod faults;
mod hostile;

use std::fs;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use pe_host::{
    Bank, Bus, Design, Error, Flags, Host, Limits, Link, Mapped, Model, Native, Op, Remote, Settings, Transport,
    Wrapped,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::support::bench::Folder;
use crate::support::is_long_suite;
use crate::support::models::{TUNED, spec};
use faults::{IN_TIME, within};

/// Designs whose steps have everything that engines may treat differently: ticks of several rates, tables, a network
/// without inputs, swapped buffers, a deep pipeline, sums of operands that wrap, words that saturate, early steps,
/// interpolated inputs, outputs without a sample 0, parameters that are written.
const DESIGNS: [(&str, &str); 10] = [
    (TUNED, "--pes 2 --host states"),
    ("motor_pid", "--pes 2 --span 100ms"),
    ("pendulum", "--pes 2 --span 100ms"),
    ("wave6", "--pes 3"),
    ("spring_chain", "--pes 3 --loop on --pipeline deep --set n=12"),
    ("rc_ladder", "--pes 2 --span 10ms --multiplier 25x18 --storage 32 --proof off"),
    ("weibel5", "--pes 4 --span 20ms --multiplier 25x18 --loop on"),
    ("hodgkin_huxley", "--pes 2 --span 2ms"),
    ("pump_station", ""),
    ("rc_ladder", "--pes 2 --span 10ms --solver ros2 --early-steps 2us@40us,5us@100us"),
];

/// Compiles a shipped model, and builds its reference as a library.
fn compiled(folder: &Path, name: &str, options: &str) -> Settings {
    let mut compile = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    let own = folder.with_extension("spec");
    let path = if name.contains('\n') { fs::write(&own, name).map(|()| own).unwrap() } else { spec(name) };
    compile.arg("compile").arg(path).args(["-q", "--no-pictures", "-o"]).arg(folder);
    let output = compile.args(options.split_whitespace()).output().expect("it was just built");
    assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    let library = folder.join("network.so");
    Native::build(&Design::open(folder).unwrap(), &library).unwrap();
    // Tests run side by side, and simulations take what time they get.
    Settings { library: Some(library), timeout: Some(Duration::from_secs(5)) }
}

fn open(folder: &Path, transport: &str, settings: &Settings) -> Host {
    let transport: Transport = transport.parse().expect("a transport");
    Host::open(folder, &transport, settings).unwrap_or_else(|error| panic!("{transport:?}: {error}"))
}

/// What a program sees of a network: every word of every sample, states and flags.
fn program(host: &mut Host, steps: u64, seed: u64) -> Vec<(Vec<Option<i64>>, Flags)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let formats: Vec<_> = host.inputs().map(|input| (input.format.words(), input.words)).collect();
    let mut seen = vec![(host.read_words().unwrap(), host.flags().unwrap())];
    let mut middle = None;
    for step in 0..steps {
        // Numbers in range, then words of all sizes, then those at the ends.
        let word = |([least, most], [low, high]): ([i64; 2], [i64; 2]), rng: &mut ChaCha8Rng| match step * 3 / steps {
            0 => rng.random_range(low / 4..=high / 4),
            1 => rng.random_range(least..=most) >> rng.random_range(0..20),
            _ => [least, most, 0, -1, low, high][rng.random_range(0..6)],
        };
        let words: Vec<i64> = formats.iter().map(|format| word(*format, &mut rng)).collect();
        let outputs = host.exchange_words(&words, 1).unwrap().to_vec();
        seen.push((outputs, host.flags().unwrap()));
        if step % 97 == 50 {
            host.clear_flags().unwrap();
        }
        if step % 41 == 7 && !host.parameters().is_empty() {
            // They act together from the next step on, and the outputs stay.
            let word = |parameter: &pe_map::Parameter| {
                let [least, most] = parameter.range;
                host.map().states[parameter.state as usize].word(rng.random_range(least..=most)).unwrap().word
            };
            let parameters: Vec<i64> = host.parameters().iter().map(word).collect();
            host.write_parameter_words(&parameters).unwrap();
            let shown = host.read_words().unwrap();
            assert_eq!(Some(&shown), seen.last().map(|(words, _)| words), "outputs after new parameters");
        }
        if step == steps / 3 {
            middle = Some(host.snapshot().unwrap());
        }
        if step == steps * 2 / 3 {
            host.restore(middle.as_ref().unwrap()).unwrap();
            seen.push((host.read_words().unwrap(), host.flags().unwrap()));
        }
        if step > steps * 2 / 3 && step % 50 == 0 {
            // States that no run has: words saturate, and sums of operands wrap.
            let mut wild = middle.clone().unwrap();
            let limits: Vec<[i64; 2]> = host.map().states.iter().map(|state| state.format.words()).collect();
            for (word, [least, most]) in wild.state.iter_mut().zip(limits) {
                *word = [least, most, *word][rng.random_range(0..3)];
            }
            host.restore(&wild).unwrap();
            seen.push((host.read_words().unwrap(), host.flags().unwrap()));
        }
    }
    // Many steps in one call; the inputs of the last one stay.
    host.restore(middle.as_ref().unwrap()).unwrap();
    for frames in [1, steps / 5, 3] {
        let word = |words: [i64; 2], rng: &mut ChaCha8Rng| rng.random_range(words[0] / 2..=words[1] / 2);
        let count = usize::try_from(frames).unwrap();
        let inputs: Vec<i64> =
            (0..count).flat_map(|_| formats.clone()).map(|(_, words)| word(words, &mut rng)).collect();
        let (mut outputs, before) = (Vec::new(), host.sample());
        assert_eq!(host.run_frames_words(count, &inputs, &mut outputs).unwrap().steps, frames);
        assert_eq!(host.sample(), before + frames);
        let row = host.map().outputs.len();
        seen.extend(outputs.chunks(row).map(|row| (row.iter().copied().map(Some).collect(), Flags::default())));
        assert_eq!(host.read_words().unwrap(), seen.last().unwrap().0);
        host.run(1).unwrap();
        seen.push((host.read_words().unwrap(), host.flags().unwrap()));
    }
    host.reset().unwrap();
    assert_eq!((host.read_words().unwrap(), Flags::default()), seen[0], "the initial state after a reset");
    let ran = host.run(3).unwrap();
    assert_eq!((ran.steps, host.sample()), (3, 3));
    seen.push((host.read_words().unwrap(), host.flags().unwrap()));
    seen
}

/// What a model is called here: its name, or that of a spec.
fn label(name: &str) -> &str {
    name.split_whitespace().nth(1).unwrap_or(name)
}

fn assert_same(
    name: &str,
    [first, second]: [&str; 2],
    a: &[(Vec<Option<i64>>, Flags)],
    b: &[(Vec<Option<i64>>, Flags)],
) {
    assert_eq!(a.len(), b.len());
    let differing = a.iter().zip(b).filter(|(a, b)| a != b).count();
    let at = a.iter().zip(b).position(|(a, b)| a != b);
    assert_eq!(
        differing,
        0,
        "{name}: {first} and {second} differ first at {at:?}: {:?}",
        at.map(|at| (&a[at], &b[at]))
    );
}

#[test]
fn engines_in_process_give_the_same_integers() {
    let mut flags = Flags::default();
    for (number, (name, options)) in DESIGNS.iter().enumerate() {
        let folder = Folder::new(&format!("transports_{}_{number}", label(name)));
        let settings = compiled(&folder.0, name, options);
        let mut expected = None;
        for transport in ["clocked", "fast", "model"] {
            let seen = program(&mut open(&folder.0, transport, &settings), 1000, 7);
            let expected = expected.get_or_insert_with(|| seen.clone());
            assert_same(name, ["clocked", transport], expected, &seen);
            let moving = seen.windows(2).filter(|pair| pair[0].0 != pair[1].0).count();
            assert!(moving > 300, "{name}: outputs move {moving} times only");
            flags = seen.iter().fold(flags, |all, (_, flags)| all | *flags);
        }
    }
    let shown: Vec<&str> = flags.names().collect();
    assert_eq!(shown, ["input_clamped", "saturated", "operand_too_large", "proof_broken"]);
}

/// Designs with ports for a host; the last two with outputs in memories, one of them with parameters.
const HOSTED: [(&str, &str); 5] = [
    ("motor_pid", "--pes 2 --span 100ms --host restart,states,flags"),
    ("rc_ladder", "--pes 2 --span 10ms --multiplier 25x18 --storage 32 --proof off --host restart,states,flags"),
    ("pump_station", "--storage 40 --host restart,states,flags"),
    (TUNED, "--pes 2 --storage 40 --multiplier 35x35 --outputs memory --host restart,states,flags"),
    ("spring_chain", "--pes 3 --loop on --pipeline deep --set n=12 --outputs memory --host restart,states,flags"),
];

/// Without the flag that hardware does not have.
fn without_proof(seen: Vec<(Vec<Option<i64>>, Flags)>) -> Vec<(Vec<Option<i64>>, Flags)> {
    let known = Flags::INPUT_CLAMPED | Flags::SATURATED | Flags::OPERAND_TOO_LARGE;
    seen.into_iter().map(|(words, flags)| (words, flags & known)).collect()
}

const TIMEOUT: Duration = Duration::from_millis(500);

fn model(folder: &Path) -> Host {
    open(folder, "model", &Settings::default())
}

/// The register bank of a wrapper, in software.
fn bank(design: &Design) -> Box<dyn Bus> {
    Box::new(Bank::over(design, Box::new(Model::open(design).unwrap())).unwrap())
}

fn over(design: &Design, bus: Box<dyn Bus>) -> Result<Host, Error> {
    Host::over(design.clone(), Box::new(Wrapped::open(design, bus, TIMEOUT)?))
}

/// A server on the loopback; its address.
fn served(bus: Box<dyn Bus>) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    std::thread::spawn(move || pe_host::serve_tcp(bus, &listener));
    address
}

/// A file in place of a device: every word that a host writes goes through one map of the file to a bank that has another,
/// and every word that it reads back.
struct FileDevice {
    host: Mapped,
    device: Mapped,
    bank: Box<dyn Bus>,
}

impl FileDevice {
    fn new(design: &Design, folder: &Path) -> FileDevice {
        let (path, bytes) = (folder.join("device"), 0x1000);
        fs::write(&path, vec![0; 3 * bytes]).unwrap();
        let map = || Mapped::open(&path, 0x1000, bytes).unwrap();
        FileDevice { host: map(), device: map(), bank: bank(design) }
    }

    fn one(&mut self, op: Op, words: &mut Vec<u32>) -> Result<(), Error> {
        match op {
            Op::Write(address, _) => {
                self.host.transact(&[op], words)?;
                let mut written = Vec::new();
                self.device.transact(&[Op::Read(address)], &mut written)?;
                self.bank.transact(&[Op::Write(address, written[0])], words)
            }
            Op::Read(address) | Op::Poll { address, .. } => {
                let mut read = Vec::new();
                self.bank.transact(&[Op::Read(address)], &mut read)?;
                self.device.transact(&[Op::Write(address, read[0])], words)?;
                self.host.transact(&[op], words)
            }
        }
    }
}

impl Bus for FileDevice {
    fn transact(&mut self, ops: &[Op], words: &mut Vec<u32>) -> Result<(), Error> {
        ops.iter().try_for_each(|op| self.one(*op, words))
    }
}

/// A serial line whose other end a server has.
fn serial(bus: Box<dyn Bus>) -> String {
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&master).and_then(|()| unlockpt(&master)).unwrap();
    let device = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
    let mut bus = bus;
    std::thread::spawn(move || pe_host::serve(&mut *bus, &mut Link::file(master, "a host").unwrap()));
    device
}

#[test]
fn registers_give_the_same_integers_over_every_line() {
    for (name, options) in HOSTED {
        let folder = Folder::new(&format!("transports_registers_{}", label(name)));
        let settings = compiled(&folder.0, name, options);
        let design = Design::open(&folder.0).unwrap();
        let expected = without_proof(program(&mut model(&folder.0), 1000, 11));
        let tcp = format!("tcp:{}", served(bank(&design)));
        let fast = Transport::Tcp(served("fast".parse::<Transport>().unwrap().bus(&design, &settings).unwrap()));
        let uart = format!("uart:{}@115200", serial(bank(&design)));
        let hosts = [
            ("registers", over(&design, bank(&design)).unwrap()),
            ("tcp", open(&folder.0, &tcp, &settings)),
            ("tcp, fast", Host::open(&folder.0, &fast, &settings).unwrap()),
            ("uart", open(&folder.0, &uart, &settings)),
            ("mmap", over(&design, Box::new(FileDevice::new(&design, &folder.0))).unwrap()),
        ];
        for (transport, mut host) in hosts {
            assert_same(name, ["model", transport], &expected, &without_proof(program(&mut host, 1000, 11)));
        }
    }
}

#[test]
fn flags_of_a_bank_are_cleared_one_by_one() {
    let folder = Folder::new("transports_flags");
    let (name, options) = HOSTED[1];
    compiled(&folder.0, name, options);
    let design = Design::open(&folder.0).unwrap();
    let mut bus = bank(&design);
    let register = |name| pe_map::registers::register(name).unwrap();
    let bit = |field| register("STATUS").field(field).unwrap().mask();
    let (status, all) = (register("STATUS").address, bit("SATURATED") | bit("OPERAND") | bit("INPUT"));
    let read = |bus: &mut dyn Bus| {
        let mut words = Vec::new();
        bus.transact(&[Op::Read(status)], &mut words).unwrap();
        words[0] & (all | bit("OVERFLOW"))
    };
    let places = pe_map::wrap::windows(design.map()).inputs;
    let mut seen = 0;
    bus.transact(&[Op::Write(register("RUN_STEPS").address, 100)], &mut Vec::new()).unwrap();
    for number in 0..200 {
        // Far beyond all ranges for long, to either side.
        let word = if number / 40 % 2 == 0 { i32::MAX } else { i32::MIN };
        let mut ops: Vec<Op> = places.iter().map(|place| Op::Write(place.address, word as u32)).collect();
        ops.push(Op::Write(register("COMMAND").address, 1));
        bus.transact(&ops, &mut Vec::new()).unwrap();
        let before = read(&mut *bus);
        let cleared = [bit("SATURATED"), bit("OPERAND"), bit("INPUT"), 0][number % 4];
        bus.transact(&[Op::Write(status, cleared)], &mut Vec::new()).unwrap();
        let left = before & all & !cleared;
        assert_eq!(read(&mut *bus), left | if left == 0 { 0 } else { bit("OVERFLOW") });
        seen |= before & all;
    }
    assert!(seen.count_ones() > 1, "several flags are up: {seen:x}");
}

/// Passes bytes on, of which some are lost or changed on the way.
fn noisy(from: UnixStream, to: UnixStream, seed: u64) {
    std::thread::spawn(move || {
        let (mut from, mut to, mut rng) = (from, to, ChaCha8Rng::seed_from_u64(seed));
        let mut bytes = [0; 256];
        while let Ok(count @ 1..) = from.read(&mut bytes) {
            let mut passed = bytes[..count].to_vec();
            if rng.random_bool(0.005) {
                let at = rng.random_range(0..count);
                if rng.random_bool(0.5) {
                    passed.remove(at);
                } else {
                    passed[at] ^= 1 << rng.random_range(0..8);
                }
            }
            if to.write_all(&passed).is_err() {
                return;
            }
        }
    });
}

#[test]
fn a_noisy_line_changes_no_number() {
    let folder = Folder::new("transports_noise");
    compiled(&folder.0, "motor_pid", HOSTED[0].1);
    let design = Design::open(&folder.0).unwrap();
    let expected = program(&mut model(&folder.0), 1000, 3);
    let (host, line) = UnixStream::pair().unwrap();
    let (other, server) = UnixStream::pair().unwrap();
    noisy(line.try_clone().unwrap(), other.try_clone().unwrap(), 1);
    noisy(other, line, 2);
    let mut bus = bank(&design);
    std::thread::spawn(move || pe_host::serve(&mut *bus, &mut Link::file(server.into(), "a host").unwrap()));
    let settings = Duration::from_millis(150);
    let remote = Remote::open(Link::file(host.into(), "the line").unwrap(), settings).unwrap();
    let mut host = over(&design, Box::new(remote)).unwrap();
    assert_same("motor_pid", ["model", "noise"], &expected, &program(&mut host, 1000, 3));
}

#[test]
fn numbers_are_converted_clamped_and_told() {
    let folder = Folder::new("transports_numbers");
    compiled(&folder.0, "motor_pid", "--pes 2 --span 100ms");
    let mut host = model(&folder.0);
    let names: Vec<String> = host.inputs().map(|input| input.name.clone()).collect();
    assert_eq!(names, ["target", "load"]);
    let limits: Vec<[f64; 2]> = host.inputs().map(|input| input.limits).collect();
    assert!(host.write(&limits.iter().map(|limit| limit[1]).collect::<Vec<_>>()).unwrap().clamped.is_empty());
    assert_eq!(host.write(&[3.0, f64::NEG_INFINITY]).unwrap().clamped, [0, 1]);
    assert_eq!(host.write(&[1.0, f64::NAN]).unwrap_err().kind(), "not-a-number");
    assert_eq!(host.write(&[1.0]).unwrap_err().kind(), "count");
    assert_eq!(host.write_words(&[1 << 40, 0]).unwrap_err().kind(), "range");
    host.reset().unwrap();
    let mut outputs = [0.0; 3];
    host.read(&mut outputs).unwrap();
    assert_eq!((outputs, host.sample(), host.time()), ([0.0; 3], 0, 0.0));
    // In closed loop: what is read at sample k acts in step k + 1.
    for _ in 0..1000 {
        let exchanged = host.exchange(&[0.5 + 0.1 * outputs[0], 0.0], 1, &mut outputs).unwrap();
        assert!(exchanged.written.clamped.is_empty());
    }
    assert!((host.time() - 0.1).abs() < 1e-12 && outputs[0] > 0.1, "{outputs:?}");
    let snapshot = host.snapshot().unwrap();
    let mut wrong = snapshot.clone();
    wrong.hash.replace_range(..1, "x");
    assert_eq!(host.restore(&wrong).unwrap_err().kind(), "wrong-hash");
    wrong = snapshot.clone();
    wrong.state.pop();
    assert_eq!(host.restore(&wrong).unwrap_err().kind(), "count");
    wrong.state.push(i64::MAX);
    assert_eq!(host.restore(&wrong).unwrap_err().kind(), "range");
    host.restore(&snapshot).unwrap();
    assert_eq!(host.sample(), 1000);
}

#[test]
fn rates_are_predicted_from_the_times_that_are_measured() {
    let folder = Folder::new("transports_rates");
    compiled(&folder.0, "motor_pid", HOSTED[0].1);
    let mut rates = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    rates.arg("rates").arg(&folder.0).args(["--transport", "model", "--message-format", "json"]);
    let output = rates.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let rows: Vec<serde_json::Value> = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(rows.len(), 5);
    for row in &rows {
        let number = |key: &str| row[key].as_f64().unwrap();
        let sum = number("write_s") + number("run_s") + number("read_s");
        assert!((number("predicted_samples_per_s") * sum - 1.0).abs() < 1e-9, "{row}");
    }
    // The exchange is the three calls in one.
    let [predicted, measured] =
        ["predicted_samples_per_s", "measured_samples_per_s"].map(|key| rows[0][key].as_f64().unwrap());
    assert!(measured > 0.2 * predicted && measured < 20.0 * predicted, "{predicted} {measured}");
    // 2 inputs and 3 outputs of 32 bits: a message of 2 + 7 + 8 + 7 + 4 + 7 + 4 + 13 + 7 bytes and an answer of 2 + 16, each
    // with a checksum, a byte of stuffing and one at the end; and a step of 47 clocks.
    let bytes = f64::from(59 + 18 + 2 * 6);
    let uart = rows[4]["predicted_samples_per_s"].as_f64().unwrap();
    assert!((uart * (10.0 * bytes / 115_200.0) - 1.0).abs() < 0.02, "{uart}");
}

fn wrapped(folder: &Path, name: &str, options: &str, more: &[&str]) -> Settings {
    let settings = compiled(folder, name, options);
    let mut wrap = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    let output = wrap.arg("wrap").arg(folder).arg("-q").args(more).output().unwrap();
    assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    settings
}

#[test]
fn simulations_of_the_hardware_give_the_same_integers() {
    // The second one has as many PEs as a number of one bit tells apart, and no ticks; the others have streams.
    let plain: &[&str] = &[];
    let streams: &[&str] = &["--stream"];
    for ((name, options), steps, more) in
        [(HOSTED[0], 1000, plain), (HOSTED[1], 200, plain), (HOSTED[3], 200, streams), (HOSTED[4], 90, streams)]
    {
        let steps = if is_long_suite() { steps } else { steps / 3 };
        let folder = Folder::new(&format!("transports_simulated_{}", label(name)));
        let settings = wrapped(&folder.0, name, options, more);
        let expected = without_proof(program(&mut model(&folder.0), steps, 13));
        // A netlist of its own for each takes minutes.
        let transports = if is_long_suite() || name == HOSTED[4].0 { 2 } else { 1 };
        for transport in ["ghdl", "verilator"].into_iter().take(transports) {
            let seen = without_proof(program(&mut open(&folder.0, transport, &settings), steps, 13));
            assert_same(name, ["model", transport], &expected, &seen);
        }
    }
}

#[test]
fn a_simulation_without_a_restart_begins_anew() {
    let folder = Folder::new("transports_renewed");
    let settings = wrapped(&folder.0, "motor_pid", "--pes 2 --span 100ms", &[]);
    let mut expected = model(&folder.0);
    let mut host = open(&folder.0, "ghdl", &settings);
    for _ in 0..2 {
        for step in 0..30 {
            let words = [step << 24, -step << 20];
            assert_eq!(host.exchange_words(&words, 2).unwrap(), expected.exchange_words(&words, 2).unwrap());
        }
        assert_eq!(host.snapshot().unwrap_err().kind(), "lacks");
        host.reset().unwrap();
        expected.reset().unwrap();
        assert_eq!(host.read_words().unwrap(), expected.read_words().unwrap());
    }
    // What hardware watches over.
    let clocks = host.map().clocks_per_step;
    host.limit(&Limits { pace_period: clocks + 9, ..Limits::default() }).unwrap();
    host.run(5).unwrap();
    let counters = host.counters().unwrap();
    assert!(counters.least_slack.is_some_and(|slack| slack > 0) && counters.overruns == 0, "{counters:?}");
    host.limit(&Limits { pace_period: clocks / 2, ..Limits::default() }).unwrap();
    assert_eq!(within(IN_TIME, "a late step in GHDL", || host.run(5)).kind(), "overrun");
    host.limit(&Limits { clock_budget: clocks / 2, ..Limits::default() }).unwrap();
    assert_eq!(within(IN_TIME, "a step above the budget in GHDL", || host.run(5)).kind(), "time-exceeded");
    // A step that was stopped in the middle leaves nothing behind.
    host.limit(&Limits::default()).unwrap();
    host.reset().unwrap();
    expected.reset().unwrap();
    assert_eq!(host.exchange_words(&[5 << 24, 9], 3).unwrap(), expected.exchange_words(&[5 << 24, 9], 3).unwrap());
    // A folder without a wrapper, and one of another design.
    let plain = Folder::new("transports_unwrapped");
    compiled(&plain.0, "motor_pid", "--pes 2 --span 100ms");
    let ghdl: Transport = "ghdl".parse().unwrap();
    let error = Host::open(&plain.0, &ghdl, &settings).err().unwrap();
    assert!(error.kind() == "file" && error.to_string().contains("pe-synth wrap"), "{error}");
}
