//! What goes wrong is told in time.

use std::fs;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::net::UnixStream;
use std::process::Command;
use std::time::{Duration, Instant};

use pe_host::{Bus, Design, Error, Host, Limits, Link, Native, Op, Pipe, Remote, Settings, Transport};
use pe_map::registers::register;

use super::{FileDevice, HOSTED, TIMEOUT, assert_same, bank, compiled, model, open, over, program, serial, served};
use crate::support::bench::Folder;

/// What a call gives, which must not take longer than it may.
pub fn within<T>(most: Duration, what: &str, call: impl FnOnce() -> Result<T, Error>) -> Error {
    let begin = Instant::now();
    let error = call().err().unwrap_or_else(|| panic!("{what} is no error"));
    assert!(begin.elapsed() < most, "{what}: {error} after {:?}", begin.elapsed());
    println!("{what}: {} after {:?}: {error}", error.kind(), begin.elapsed());
    error
}

/// Most that is permitted; what is noticed at once takes milliseconds, as the tests print.
const AT_ONCE: Duration = Duration::from_secs(1);
pub const IN_TIME: Duration = Duration::from_secs(1);

/// A bus that answers reads of one register by another word.
struct Lying(Box<dyn Bus>, &'static str, Lie);

type Lie = fn(u32) -> u32;

impl Bus for Lying {
    fn transact(&mut self, ops: &[Op], words: &mut Vec<u32>) -> Result<(), Error> {
        let place = register(self.1).unwrap().address;
        for op in ops {
            self.0.transact(&[*op], words)?;
            match (op, words.last_mut()) {
                (Op::Read(address) | Op::Poll { address, .. }, Some(word)) if *address == place => {
                    *word = self.2(*word);
                }
                _ => {}
            }
        }
        Ok(())
    }
}

#[test]
fn another_design_is_refused_on_every_transport() {
    let folder = Folder::new("transports_hash");
    let settings = compiled(&folder.0, "motor_pid", HOSTED[0].1);
    let design = Design::open(&folder.0).unwrap();
    let mut other = design.map().clone();
    other.hash = pe_map::sha256(b"another design");
    let other = Design::of(other);
    let tcp = format!("tcp:{}", served(bank(&design)));
    let uart = format!("uart:{}", serial(bank(&design)));
    for transport in [tcp, uart] {
        let transport: Transport = transport.parse().unwrap();
        let error = within(AT_ONCE, "another design", || transport.open(&other, &settings));
        assert_eq!(error.kind(), "wrong-hash", "{transport}: {error}");
    }
    let file = FileDevice::new(&design, &folder.0);
    assert_eq!(within(AT_ONCE, "another design, mapped", || over(&other, Box::new(file))).kind(), "wrong-hash");
    let library = settings.library.unwrap();
    let loaded = within(AT_ONCE, "another library", || Native::load(&other, &library, pe_host::Form::Fast));
    assert_eq!(loaded.kind(), "wrong-hash");
    // A map that was changed, and a program that was.
    let map = folder.0.join("motor_pid_map.json");
    let text = fs::read_to_string(&map).unwrap();
    fs::write(&map, text.replacen(&design.map().hash, &other.map().hash, 1)).unwrap();
    for transport in ["model", "fast"] {
        let transport: Transport = transport.parse().unwrap();
        let error = Host::open(&folder.0, &transport, &Settings::default()).err().unwrap();
        assert_eq!(error.kind(), "wrong-hash", "{transport}: {error}");
    }
    // A device that is something else, or of another version.
    let lies: [(&str, Lie, &str); 3] =
        [("ID", |_| 0, "foreign"), ("VERSION", |word| word + 1, "foreign"), ("HASH_3", |word| word ^ 1, "wrong-hash")];
    for (register, lie, kind) in lies {
        let error = within(AT_ONCE, register, || over(&design, Box::new(Lying(bank(&design), register, lie))));
        assert_eq!(error.kind(), kind, "{error}");
    }
}

#[test]
fn what_is_lost_or_late_is_told_in_time() {
    let folder = Folder::new("transports_lost");
    compiled(&folder.0, "motor_pid", HOSTED[0].1);
    let design = Design::open(&folder.0).unwrap();
    let exchange = |host: &mut Host| host.exchange(&[0.1, 0.0], 1, &mut [0.0; 3]).map(|_| ());
    // Nobody is there; somebody who says nothing; somebody who leaves.
    let nobody = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let error = within(IN_TIME, "nobody", || Transport::Tcp(nobody).open(&design, &Settings::default()));
    assert_eq!(error.kind(), "lost");
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = silent.local_addr().unwrap().to_string();
    let error = within(IN_TIME, "silence", || Transport::Tcp(address).open(&design, &Settings::default()));
    assert!(error.kind() == "late" && error.to_string().ends_with("within 100 ms"), "{error}");
    let (near, far) = UnixStream::pair().unwrap();
    let mut bus = bank(&design);
    let server = far.try_clone().unwrap();
    std::thread::spawn(move || pe_host::serve(&mut *bus, &mut Link::file(server.into(), "a host").unwrap()));
    let remote = Remote::open(Link::file(near.into(), "the board").unwrap(), TIMEOUT).unwrap();
    let mut host = over(&design, Box::new(remote)).unwrap();
    exchange(&mut host).unwrap();
    far.shutdown(std::net::Shutdown::Both).unwrap();
    assert_eq!(within(AT_ONCE, "a lost connection", || exchange(&mut host)).kind(), "lost");
    // A second host is told that there is one.
    let address = served(bank(&design));
    let first = Transport::Tcp(address.clone()).open(&design, &Settings::default()).unwrap();
    let error =
        within(IN_TIME, "a second host", || Transport::Tcp(address.clone()).open(&design, &Settings::default()));
    assert!(error.kind() == "lost" && error.to_string().contains("another host"), "{error}");
    drop(first);
    // Frames that are short, long or noise; then the server still serves.
    let mut stream = TcpStream::connect(&address).unwrap();
    for noise in [&b"\x05\x01\x02\0"[..], b"\0\0\0", b"\xFF\xFE\xFD\0", b"short"] {
        stream.write_all(noise).unwrap();
    }
    drop(stream);
    std::thread::sleep(Duration::from_millis(50));
    over(&design, Box::new(remote_to(&address))).unwrap();
    // Answers that are cut short.
    let (near, mut far) = UnixStream::pair().unwrap();
    std::thread::spawn(move || {
        let mut bytes = [0; 64];
        while let Ok(1..) = far.read(&mut bytes) {
            let _ = far.write_all(b"\x03\x01\0");
        }
    });
    let link = Link::file(near.into(), "the board").unwrap();
    assert_eq!(within(IN_TIME, "short frames", || Remote::open(link, TIMEOUT)).kind(), "damaged");
}

fn remote_to(address: &str) -> Remote {
    Remote::open(Link::tcp(TcpStream::connect(address).unwrap()).unwrap(), TIMEOUT).unwrap()
}

#[test]
fn steps_that_are_late_or_too_long_are_told_in_time() {
    let folder = Folder::new("transports_late");
    compiled(&folder.0, "motor_pid", HOSTED[0].1);
    let design = Design::open(&folder.0).unwrap();
    let exchange = |host: &mut Host| host.exchange(&[0.1, 0.0], 1, &mut [0.0; 3]).map(|_| ());
    // A step that never ends.
    let ends = |word: u32| word & !register("STATUS").unwrap().field("DONE").unwrap().mask();
    let mut host = over(&design, Box::new(Lying(bank(&design), "STATUS", ends))).unwrap();
    assert_eq!(within(IN_TIME, "a step that does not end", || exchange(&mut host)).kind(), "late");
    assert_eq!(within(IN_TIME, "a run that does not end", || host.run(5)).kind(), "late");
    // Longer than the budget, and than the pace, over every line.
    let clocks = design.map().clocks_per_step;
    let lines: [Box<dyn Bus>; 2] = [bank(&design), Box::new(remote_to(&served(bank(&design))))];
    for bus in lines {
        let mut host = over(&design, bus).unwrap();
        let limit = |clock_budget, pace_period, go_on| Limits { clock_budget, pace_period, go_on };
        host.limit(&limit(clocks, clocks, false)).unwrap();
        exchange(&mut host).unwrap();
        assert_eq!(host.counters().unwrap().least_slack, Some(0));
        host.limit(&limit(clocks - 1, 0, false)).unwrap();
        assert_eq!(within(AT_ONCE, "a step above the budget", || exchange(&mut host)).kind(), "time-exceeded");
        assert_eq!(within(AT_ONCE, "a run above the budget", || host.run(2)).kind(), "time-exceeded");
        host.limit(&limit(0, clocks - 1, false)).unwrap();
        assert_eq!(within(AT_ONCE, "a late step", || exchange(&mut host)).kind(), "overrun");
        host.limit(&limit(0, clocks - 1, true)).unwrap();
        assert_eq!(host.run(3).unwrap().overruns, 3);
    }
    let mut host = model(&folder.0);
    assert_eq!(host.limit(&Limits { clock_budget: 1, ..Limits::default() }).unwrap_err().kind(), "lacks");
}

/// A simulation by a shell, which answers as a script says.
fn simulated(script: &'static str) -> Result<Pipe, Error> {
    let shell = move || {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        command
    };
    Pipe::open("sh", Box::new(shell), Duration::from_millis(300))
}

#[test]
fn a_simulation_that_hangs_or_dies_is_told_in_time() {
    let read = |pipe: &mut Pipe| {
        let mut words = Vec::new();
        pipe.transact(&[Op::Read(0), Op::Write(4, 1), Op::Read(8)], &mut words).map(|()| words)
    };
    let answering = "echo hello; while read -r kind rest; do case $kind in r) echo pe: 0000002a;; q) exit;; *) echo pe: ok;; esac; done";
    let mut pipe = simulated(answering).unwrap();
    assert_eq!(read(&mut pipe), Ok(vec![42, 42]));
    let poll = Op::Poll { address: 0, mask: 1, set: false, clocks: 500 };
    let mut words = Vec::new();
    pipe.transact(&[poll, Op::Read(0)], &mut words).unwrap();
    assert_eq!(words, [42, 42]);
    let faults = [
        ("killed", "read -r line; echo pe: 00000001; echo bound check failure; kill -9 $$", "lost"),
        ("ended", "exit 3", "lost"),
        ("hanging", "read -r line; echo pe: 00000001; sleep 5", "late"),
        ("short", "while read -r line; do echo pe: 12; done", "damaged"),
        ("refusing", "while read -r line; do echo pe: slverr; done", "refused"),
    ];
    for (name, script, kind) in faults {
        let mut pipe = simulated(script).unwrap();
        let error = within(IN_TIME, name, || read(&mut pipe));
        assert_eq!(error.kind(), kind, "{name}: {error}");
        if name == "killed" {
            assert!(error.to_string().contains("bound check failure"), "{error}");
        }
    }
    let missing = Pipe::open("nothing", Box::new(|| Command::new("no-such-simulator")), TIMEOUT);
    assert_eq!(missing.err().map(|error| error.kind()), Some("missing-tool"));
}

#[test]
fn a_server_serves_one_host_after_the_other() {
    let folder = Folder::new("transports_serve");
    let settings = compiled(&folder.0, "motor_pid", HOSTED[0].1);
    let mut serve = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    serve.arg("serve").arg(&folder.0).args(["--transport", "model", "--tcp", "127.0.0.1:0"]);
    let mut server = serve.stdout(std::process::Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    std::io::BufRead::read_line(&mut std::io::BufReader::new(server.stdout.take().unwrap()), &mut line).unwrap();
    let address = line.trim().strip_prefix("serving motor_pid through model at ").unwrap_or_else(|| panic!("{line}"));
    let expected = program(&mut model(&folder.0), 100, 5);
    for _ in 0..3 {
        let seen = program(&mut open(&folder.0, &format!("tcp:{address}"), &settings), 100, 5);
        assert_same("motor_pid", ["model", "a server"], &expected, &seen);
        // It notices that the host is gone.
        std::thread::sleep(Duration::from_millis(20));
    }
    let mut host = open(&folder.0, &format!("tcp:{address}"), &settings);
    server.kill().unwrap();
    server.wait().unwrap();
    assert_eq!(within(AT_ONCE, "a server that was killed", || host.run(1)).kind(), "lost");
}
