//! Programs that engines run as: until they end, until they print what they should not, or until the time is over.

use std::io::{BufRead, BufReader, Read};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant};

use pe_flow::failure::Failure;
use pe_sim::trace::TraceLine;

/// Time between two looks at the clock while a program prints nothing.
const LOOK: Duration = Duration::from_millis(100);

/// Lines between two times that a listener hears of them, and lines that wait to be read.
const HEARD: u64 = 4096;
const WAITING: usize = 1024;

/// What programs keep to, and who hears how far they are.
#[derive(Clone, Copy, Default)]
pub struct Children<'a> {
    /// When a program is ended that still runs.
    pub until: Option<Instant>,
    /// Hears of lines that a program has printed so far.
    pub heard: Option<&'a dyn Fn(u64)>,
    /// Hears when what is built once for all runs is there.
    pub built: Option<&'a dyn Fn()>,
}

/// Runs a program to its end and returns what it printed.
pub fn execute(command: &mut Command, tool: &str, install: &str) -> Result<String, Failure> {
    Children::default().run(command, tool, install)
}

impl Children<'_> {
    /// What is built once for all runs is there.
    pub fn have_built(&self) {
        self.built.into_iter().for_each(|built| built());
    }

    /// Runs a program and returns what it printed.
    ///
    /// # Errors
    /// [`Failure::Interrupted`] if the time is over; others if the program is missing or fails.
    pub fn run(&self, command: &mut Command, tool: &str, install: &str) -> Result<String, Failure> {
        self.run_until_difference(command, tool, install, None)
    }

    /// The same up to the first memory write that is not the expected one.
    pub fn run_until_difference(
        &self,
        command: &mut Command,
        tool: &str,
        install: &str,
        expected: Option<&[TraceLine]>,
    ) -> Result<String, Failure> {
        let cannot = |error: std::io::Error| match error.kind() {
            std::io::ErrorKind::NotFound => Failure::MissingTool(format!("`{tool}` is not installed: {install}")),
            _ => Failure::File(format!("cannot run {tool}: {error}")),
        };
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(cannot)?;
        // A pipe that nobody reads would hold the program up.
        let mut errors = child.stderr.take();
        let errors = std::thread::spawn(move || {
            let mut text = Vec::new();
            errors.as_mut().map(|errors| errors.read_to_end(&mut text));
            String::from_utf8_lossy(&text).into_owned()
        });
        let lines = child.stdout.take().map(lines_of);
        let (mut text, mut left) = (String::new(), expected.map(<[TraceLine]>::iter));
        let mut printed = 0u64;
        loop {
            match lines.as_ref().map_or(Err(RecvTimeoutError::Disconnected), |lines| lines.recv_timeout(LOOK)) {
                Ok(line) => {
                    let line = String::from_utf8_lossy(&line);
                    text.push_str(&line);
                    printed += 1;
                    let write = line.trim_end().strip_prefix("t ").map(TraceLine::parse);
                    if let (Some(left), Some(write)) = (&mut left, write)
                        && write.as_ref() != left.next()
                    {
                        end(&mut child);
                        return Ok(text);
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            if printed.is_multiple_of(HEARD) || printed == 1 {
                self.heard.iter().for_each(|heard| heard(printed));
            }
            if self.until.is_some_and(|until| Instant::now() >= until) {
                end(&mut child);
                return Err(Failure::Interrupted(format!("{tool} was ended: its time was over")));
            }
        }
        let status = child.wait().map_err(cannot)?;
        let errors = errors.join().unwrap_or_default();
        if status.success() {
            return Ok(text);
        }
        let first: Vec<&str> = errors.lines().chain(text.lines()).take(6).collect();
        Err(Failure::Mismatch(format!("{tool} failed ({status}):\n{}", first.join("\n"))))
    }
}

/// Ends a program. What it has started itself ends as its files disappear.
fn end(child: &mut Child) {
    let _ = child.kill();
    let _ = child.wait();
}

/// The lines that a program prints, read in a thread of their own.
fn lines_of(out: ChildStdout) -> Receiver<Vec<u8>> {
    let (sender, lines) = sync_channel(WAITING);
    std::thread::spawn(move || {
        let mut out = BufReader::new(out);
        let mut line = Vec::new();
        while out.read_until(b'\n', &mut line).is_ok_and(|read| read > 0) {
            if sender.send(std::mem::take(&mut line)).is_err() {
                break;
            }
        }
    });
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_ends_with_its_time() {
        let begun = Instant::now();
        let children = Children { until: Some(begun + Duration::from_millis(300)), ..Children::default() };
        let ended = children.run(Command::new("sleep").arg("60"), "sleep", "");
        assert!(matches!(ended, Err(Failure::Interrupted(_))), "{ended:?}");
        assert!(begun.elapsed() < Duration::from_secs(20));
    }

    #[test]
    fn a_program_ends_at_the_first_difference_and_is_heard() {
        let expected = [TraceLine::parse("1 0 0 5").unwrap()];
        let heard = std::cell::Cell::new(0);
        let note = |lines| heard.set(lines);
        let children = Children { heard: Some(&note), ..Children::default() };
        let mut print = Command::new("sh");
        print.args(["-c", "echo t 1 0 0 5; echo t 2 0 0 6; sleep 60"]);
        let text = children.run_until_difference(&mut print, "sh", "", Some(&expected)).unwrap();
        assert_eq!(text, "t 1 0 0 5\nt 2 0 0 6\n");
        assert!(heard.get() > 0);
    }
}
