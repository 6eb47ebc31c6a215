//! Registers of a simulation that this program starts: a simulated bus master, one line a request and one an answer.

use std::collections::VecDeque;
use std::fmt::Write;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::bus::{Bus, Frames, Op};
use crate::error::Error;
use crate::link::Link;

/// What answers begin with; other lines are messages of the simulator.
const MARK: &str = "pe:";

/// Messages of the simulator that are kept.
const KEPT: usize = 8;

/// Time that a request for clocks should take: long enough to be worth it, short enough to notice what hangs.
const STRETCH: Duration = Duration::from_millis(20);

/// Time for which a wait for a register goes on after the clocks that it takes.
const PATIENCE: Duration = Duration::from_millis(20);

/// Most clocks that a wait lets pass at first.
const MOST_CLOCKS: u32 = 1 << 16;

/// Requests that are sent before answers are read; all answers fit the pipe.
const AHEAD: usize = 256;

/// A simulation behind its standard input and output.
pub struct Pipe {
    start: Box<dyn Fn() -> Command + Send>,
    name: String,
    timeout: Duration,
    running: Running,
}

struct Running {
    child: Child,
    link: Link,
    messages: VecDeque<String>,
    /// Clocks that take about [`STRETCH`].
    clocks: u32,
    first: bool,
}

/// Time in which a simulation has to answer for the first time: it has to be elaborated.
const STARTING: Duration = Duration::from_secs(60);

impl Pipe {
    /// Starts a simulation.
    ///
    /// # Errors
    /// [`Error::MissingTool`] or [`Error::Tool`] if it cannot be started.
    pub fn open(name: &str, start: Box<dyn Fn() -> Command + Send>, timeout: Duration) -> Result<Pipe, Error> {
        let running = Running::start(name, start())?;
        Ok(Pipe { start, name: name.to_owned(), timeout, running })
    }
}

impl Running {
    fn start(name: &str, mut command: Command) -> Result<Running, Error> {
        let failed = |error: std::io::Error| match error.kind() {
            std::io::ErrorKind::NotFound => Error::MissingTool(format!("`{name}` is not installed")),
            _ => Error::Tool(format!("cannot start {name}: {error}")),
        };
        // What a simulator has to say comes between its answers.
        let (output, end) = std::io::pipe().map_err(failed)?;
        let other = end.try_clone().map_err(failed)?;
        let mut child = command.stdin(Stdio::piped()).stdout(end).stderr(other).spawn().map_err(failed)?;
        // Its ends of the pipe, so that it is noticed when the simulation closes its own.
        drop(command);
        let input = child.stdin.take().ok_or_else(|| Error::Tool(format!("{name} has no input")))?;
        let link = Link::pipes(output, input, name)?;
        Ok(Running { child, link, messages: VecDeque::new(), clocks: 64, first: true })
    }

    fn send(&mut self, lines: &str, timeout: Duration) -> Result<(), Error> {
        let sent = self.link.send(lines.as_bytes(), timeout);
        sent.map_err(|error| self.explained(error, timeout))
    }

    /// The next answer, without its mark. What the simulator says meanwhile does not count as one.
    fn answer(&mut self, timeout: Duration) -> Result<String, Error> {
        let timeout = if self.first { STARTING.max(timeout) } else { timeout };
        let end = Instant::now() + timeout;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let line = self.link.receive(b'\n', Some(left)).map_err(|error| self.explained(error, timeout))?;
            let line = String::from_utf8_lossy(&line).trim_end().to_owned();
            if let Some(answer) = line.strip_prefix(MARK) {
                self.first = false;
                return Ok(answer.trim_start().to_owned());
            }
            self.messages.push_back(line);
            if self.messages.len() > KEPT {
                self.messages.pop_front();
            }
        }
    }

    /// What is known of a simulation that does not answer in this time.
    fn explained(&mut self, error: Error, timeout: Duration) -> Error {
        match error {
            Error::Lost(_) => {}
            Error::Late(what, _) => return Error::Late(what, timeout),
            error => return error,
        }
        let ended = match self.child.try_wait() {
            Ok(Some(status)) => format!("{} ended ({status})", self.link.peer()),
            _ => format!("{} closed its output", self.link.peer()),
        };
        let last = self.messages.iter().rev().find(|line| !line.is_empty());
        Error::Lost(last.map_or(ended.clone(), |line| format!("{ended}; its last message: {line}")))
    }

    fn damaged(&self, answer: &str) -> Error {
        Error::Damaged(format!("{} answers `{answer}`", self.link.peer()))
    }

    fn word(&self, answer: &str, address: u32) -> Result<u32, Error> {
        if answer == "slverr" {
            return Err(Error::Refused(address));
        }
        let word = u32::from_str_radix(answer, 16).ok().filter(|_| answer.len() == 8);
        word.ok_or_else(|| self.damaged(answer))
    }

    fn done(&self, answer: &str, address: u32) -> Result<(), Error> {
        match answer {
            "ok" => Ok(()),
            "slverr" => Err(Error::Refused(address)),
            _ => Err(self.damaged(answer)),
        }
    }

    /// Accesses without waits. All are sent, so all answers are read, and the first error counts.
    fn access(&mut self, ops: &[Op], words: &mut Vec<u32>, timeout: Duration) -> Result<(), Error> {
        let mut lines = String::new();
        for op in ops {
            let written = match *op {
                Op::Read(address) => writeln!(lines, "r {address:04x}"),
                Op::Write(address, word) => writeln!(lines, "w {address:04x} {word:08x} f"),
                Op::Poll { .. } => Ok(()),
            };
            written.map_err(|_| Error::Damaged("no memory for a request".to_owned()))?;
        }
        self.send(&lines, timeout)?;
        let mut result = Ok(());
        for op in ops {
            let answer = self.answer(timeout)?;
            let answered = match *op {
                Op::Read(address) => self.word(&answer, address).map(|word| words.push(word)),
                Op::Write(address, _) => self.done(&answer, address),
                Op::Poll { .. } => Ok(()),
            };
            result = result.and(answered);
        }
        result
    }

    /// Lets clocks pass, as many as go in a while.
    fn pass(&mut self, clocks: u32, timeout: Duration) -> Result<u32, Error> {
        let clocks = clocks.min(self.clocks);
        let begin = Instant::now();
        self.send(&format!("c {clocks:x}\n"), timeout)?;
        let answer = self.answer(timeout)?;
        self.done(&answer, 0)?;
        if clocks == self.clocks {
            let faster = begin.elapsed() < STRETCH / 2;
            self.clocks = if faster { clocks.saturating_mul(2).min(1 << 20) } else { clocks };
        }
        if begin.elapsed() > 2 * STRETCH {
            self.clocks = (clocks / 2).max(1);
        }
        Ok(clocks)
    }

    /// Waits for a register: first the clocks that it takes, then step by step.
    fn poll(&mut self, poll: &Op, timeout: Duration) -> Result<u32, Error> {
        let Op::Poll { address, mask, set, clocks } = *poll else { return Ok(0) };
        let begin = Instant::now();
        let mut left = clocks.min(MOST_CLOCKS);
        loop {
            while left > 0 {
                left -= self.pass(left, timeout)?;
            }
            let mut words = Vec::new();
            self.access(&[Op::Read(address)], &mut words, timeout)?;
            let word = words.first().copied().unwrap_or(0);
            if Op::holds(mask, set, word) || begin.elapsed() > PATIENCE {
                return Ok(word);
            }
            left = clocks.min(MOST_CLOCKS) / 8 + 1;
        }
    }
}

impl Bus for Pipe {
    fn transact(&mut self, ops: &[Op], words: &mut Vec<u32>) -> Result<(), Error> {
        for group in ops.chunk_by(|a, b| !matches!(a, Op::Poll { .. }) && !matches!(b, Op::Poll { .. })) {
            match group {
                [poll @ Op::Poll { mask, set, .. }] => {
                    let word = self.running.poll(poll, self.timeout)?;
                    words.push(word);
                    if !Op::holds(*mask, *set, word) {
                        return Ok(());
                    }
                }
                _ => group.chunks(AHEAD).try_for_each(|ops| self.running.access(ops, words, self.timeout))?,
            }
        }
        Ok(())
    }

    fn is_simulated(&self) -> bool {
        true
    }

    fn has_streams(&self) -> bool {
        true
    }

    fn stream(&mut self, frames: &Frames, words: &mut Vec<u32>) -> Result<(), Error> {
        let Frames { inputs, words_in, words_out, patience } = *frames;
        let mut request = format!("s {words_out:x} {words_in:x} {patience:x}");
        inputs.iter().for_each(|word| request += &format!(" {word:x}"));
        request.push('\n');
        self.running.send(&request, self.timeout)?;
        let answer = self.running.answer(self.timeout)?;
        let before = words.len();
        for word in answer.split_ascii_whitespace() {
            words.push(self.running.word(word, 0)?);
        }
        if words.len() - before > words_out { Err(self.running.damaged(&answer)) } else { Ok(()) }
    }

    fn renew(&mut self) -> Result<bool, Error> {
        self.running = Running::start(&self.name, (self.start)())?;
        Ok(true)
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // A simulation that can still listen ends by itself, and leaves its files in order.
        let asked = self.link.send(b"q\n", Duration::from_millis(20)).is_ok();
        let begin = Instant::now();
        while asked && begin.elapsed() < Duration::from_millis(200) {
            if matches!(self.child.try_wait(), Ok(Some(_))) {
                return;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
