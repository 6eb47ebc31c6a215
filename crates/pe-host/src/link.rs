//! Bytes to and from somebody who may be slow, or gone: every wait has an end.

use std::io::PipeReader;
use std::net::TcpStream;
use std::os::fd::{AsFd, OwnedFd};
use std::path::Path;
use std::process::ChildStdin;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::{Errno, ioctl_fionbio, read, write};
use rustix::termios::{ControlModes, OptionalActions, tcgetattr, tcsetattr};

use crate::error::Error;

/// More than any message has.
const MOST: usize = 1 << 20;

/// A connection.
pub struct Link {
    input: OwnedFd,
    output: OwnedFd,
    /// Received and not yet taken.
    bytes: Vec<u8>,
    /// Who is at the other end, in messages.
    peer: String,
    /// Bits per second, of a serial line.
    baud: Option<u32>,
}

impl Link {
    fn new(input: OwnedFd, output: OwnedFd, peer: String) -> Result<Link, Error> {
        for file in [&input, &output] {
            ioctl_fionbio(file, true).map_err(|error| Error::Lost(format!("{peer}: {error}")))?;
        }
        Ok(Link { input, output, bytes: Vec::new(), peer, baud: None })
    }

    /// Over a socket.
    ///
    /// # Errors
    /// [`Error::Lost`].
    pub fn tcp(stream: TcpStream) -> Result<Link, Error> {
        let peer = stream.peer_addr().map_or_else(|_| "the other end".to_owned(), |address| address.to_string());
        let lost = |error: std::io::Error| Error::Lost(format!("{peer}: {error}"));
        stream.set_nodelay(true).map_err(lost)?;
        // A computer that is gone without a word is noticed after half a minute.
        let alive = rustix::net::sockopt::set_socket_keepalive(&stream, true)
            .and_then(|()| rustix::net::sockopt::set_tcp_keepidle(&stream, Duration::from_secs(10)))
            .and_then(|()| rustix::net::sockopt::set_tcp_keepintvl(&stream, Duration::from_secs(5)))
            .and_then(|()| rustix::net::sockopt::set_tcp_keepcnt(&stream, 4));
        alive.map_err(|error| lost(error.into()))?;
        let output = stream.try_clone().map_err(lost)?;
        Link::new(stream.into(), output.into(), peer)
    }

    /// Over the pipes of a program.
    ///
    /// # Errors
    /// [`Error::Lost`].
    pub(crate) fn pipes(input: PipeReader, output: ChildStdin, peer: &str) -> Result<Link, Error> {
        Link::new(input.into(), output.into(), peer.to_owned())
    }

    /// Over a file that is read and written, such as the other end of a pseudo terminal.
    ///
    /// # Errors
    /// [`Error::Lost`].
    pub fn file(file: OwnedFd, peer: &str) -> Result<Link, Error> {
        let output = file.try_clone().map_err(|error| Error::Lost(format!("{peer}: {error}")))?;
        Link::new(file, output, peer.to_owned())
    }

    /// Over a serial line: 8 bits, no parity, one stop bit, no flow control.
    ///
    /// # Errors
    /// [`Error::File`] if the device cannot be opened or has no such rate.
    pub fn serial(device: &Path, baud: u32) -> Result<Link, Error> {
        let open = std::fs::OpenOptions::new().read(true).write(true).open(device);
        let file = open.map_err(|error| Error::file("open", device, error))?;
        let refused = |error: Errno| Error::file("set up", device, error);
        let mut line = tcgetattr(&file).map_err(refused)?;
        line.make_raw();
        line.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
        line.control_modes &= !(ControlModes::CSTOPB | ControlModes::CRTSCTS);
        line.set_speed(baud).map_err(refused)?;
        tcsetattr(&file, OptionalActions::Flush, &line).map_err(refused)?;
        let link = Link::file(file.into(), &device.display().to_string())?;
        Ok(Link { baud: Some(baud), ..link })
    }

    /// Time that so many bytes take on a serial line, with their start and stop bits.
    pub(crate) fn time_of(&self, bytes: usize) -> Duration {
        let seconds = |baud: u32| 10.0 * bytes as f64 / f64::from(baud.max(1));
        self.baud.map_or(Duration::ZERO, |baud| Duration::from_secs_f64(seconds(baud)))
    }

    /// Who is at the other end, in messages.
    pub(crate) fn peer(&self) -> &str {
        &self.peer
    }

    fn lost(&self, what: impl std::fmt::Display) -> Error {
        Error::Lost(format!("the connection to {} is lost: {what}", self.peer))
    }

    /// Waits until a file is ready; without an end if there is no deadline.
    fn wait(&self, file: &OwnedFd, flags: PollFlags, deadline: Option<(Instant, Duration)>) -> Result<(), Error> {
        loop {
            let left = deadline.map(|(end, _)| end.saturating_duration_since(Instant::now()));
            let time = left.map(|left| Timespec::try_from(left).unwrap_or(Timespec { tv_sec: 1, tv_nsec: 0 }));
            let fd = file.as_fd();
            match poll(&mut [PollFd::new(&fd, flags)], time.as_ref()) {
                Ok(0) => {
                    let (_, all) = deadline.unwrap_or((Instant::now(), Duration::ZERO));
                    return Err(Error::Late(format!("{} does not answer", self.peer), all));
                }
                Ok(_) => return Ok(()),
                Err(Errno::INTR) => {}
                Err(error) => return Err(self.lost(error)),
            }
        }
    }

    /// Sends bytes, within this time.
    ///
    /// # Errors
    /// [`Error::Late`] or [`Error::Lost`].
    pub(crate) fn send(&mut self, mut bytes: &[u8], timeout: Duration) -> Result<(), Error> {
        let deadline = Some((Instant::now() + timeout, timeout));
        while !bytes.is_empty() {
            match write(&self.output, bytes) {
                Ok(sent) => bytes = &bytes[sent..],
                Err(Errno::AGAIN) => self.wait(&self.output, PollFlags::OUT, deadline)?,
                Err(Errno::INTR) => {}
                Err(error) => return Err(self.lost(error)),
            }
        }
        Ok(())
    }

    /// Receives bytes up to `end`, which is taken and left out, within this time; without an end if there is none.
    ///
    /// # Errors
    /// [`Error::Late`], [`Error::Lost`] or, if there is no end for long, [`Error::Damaged`].
    pub(crate) fn receive(&mut self, end: u8, timeout: Option<Duration>) -> Result<Vec<u8>, Error> {
        let deadline = timeout.map(|timeout| (Instant::now() + timeout, timeout));
        let mut searched = 0;
        loop {
            if let Some(found) = self.bytes[searched..].iter().position(|byte| *byte == end) {
                let rest = self.bytes.split_off(searched + found + 1);
                let mut message = std::mem::replace(&mut self.bytes, rest);
                message.pop();
                return Ok(message);
            }
            searched = self.bytes.len();
            if searched > MOST {
                self.bytes.clear();
                return Err(Error::Damaged(format!("{} sends more than any message has", self.peer)));
            }
            let mut room = [0; 4096];
            match read(&self.input, &mut room) {
                Ok(0) => return Err(self.lost("it was closed")),
                Ok(count) => self.bytes.extend_from_slice(&room[..count]),
                Err(Errno::AGAIN) => self.wait(&self.input, PollFlags::IN, deadline)?,
                Err(Errno::INTR) => {}
                Err(error) => return Err(self.lost(error)),
            }
        }
    }
}
