//! Registers behind a connection: asks a [server](crate::serve) for accesses.

use std::time::{Duration, Instant};

use crate::bus::{Bus, Op};
use crate::error::Error;
use crate::frames::{self, Answer, MOST_OPS, PROTOCOL, Request};
use crate::link::Link;

/// Times that a message is sent before the connection counts as damaged. A server carries out each message once.
const TRIES: u32 = 5;

/// Bytes of an answer beside its words.
const OVERHEAD: usize = 32;

/// Times that a server with a simulation has for an answer what others have.
const SIMULATED: u32 = 8;

/// A bus at the other end of a connection.
pub struct Remote {
    link: Link,
    number: u8,
    timeout: Duration,
    is_simulated: bool,
}

impl Remote {
    /// Asks who is at the other end.
    ///
    /// # Errors
    /// [`Error::Foreign`] if it is no server of these messages; [`Error::Late`], [`Error::Lost`], [`Error::Damaged`].
    pub fn open(link: Link, timeout: Duration) -> Result<Remote, Error> {
        let mut remote = Remote { link, number: 0, timeout, is_simulated: false };
        match remote.ask(&Request::Hello)? {
            Answer::Words(words) if words.first() == Some(&u32::from(PROTOCOL)) => {
                remote.is_simulated = words.get(1) == Some(&1);
                if remote.is_simulated {
                    remote.timeout *= SIMULATED;
                }
                Ok(remote)
            }
            _ => Err(Error::Foreign(format!("{} is no server of this version", remote.link.peer()))),
        }
    }

    fn something_else(&self) -> Error {
        Error::Damaged(format!("{} answers something else", self.link.peer()))
    }

    fn ask(&mut self, request: &Request) -> Result<Answer, Error> {
        self.number = self.number.wrapping_add(1);
        let message = frames::frame(&request.body(self.number));
        let asked = if let Request::Access(ops) = request { ops.len() } else { 0 };
        let line = self.link.time_of(message.len() + 4 * asked + OVERHEAD);
        let damaged = || Error::Damaged(format!("what {} sends is damaged", self.link.peer()));
        let mut fault = damaged();
        for _ in 0..TRIES {
            self.link.send(&message, self.timeout + line)?;
            match self.answer(self.timeout / TRIES + line) {
                Ok(Answer::Again) => {}
                Ok(answer) => return Ok(answer),
                // The line may have lost the message, or the answer.
                Err(Error::Late(what, _)) => fault = Error::Late(what, self.timeout),
                Err(error @ Error::Damaged(_)) => fault = error,
                Err(error) => return Err(error),
            }
        }
        Err(fault)
    }

    /// The answer to the message that was sent last, in a part of the time for all tries; those to earlier ones are late.
    fn answer(&mut self, time: Duration) -> Result<Answer, Error> {
        let end = Instant::now() + time;
        loop {
            let stuffed = self.link.receive(0, Some(end.saturating_duration_since(Instant::now())))?;
            let read = frames::body(&stuffed).and_then(|body| Answer::read(&body));
            match read {
                Some((number, answer)) if number == self.number || answer == Answer::Again => return Ok(answer),
                Some(_) => {}
                None => return Err(Error::Damaged(format!("what {} sends is damaged", self.link.peer()))),
            }
        }
    }
}

/// Whether these words are of accesses up to a wait without success; none if they are of no such accesses.
fn ended_at(ops: &[Op], read: &[u32]) -> Option<bool> {
    let mut words = read.iter();
    for op in ops {
        match *op {
            Op::Write(..) => {}
            Op::Read(_) => {
                words.next()?;
            }
            Op::Poll { mask, set, .. } => {
                if !Op::holds(mask, set, *words.next()?) {
                    return words.next().is_none().then_some(true);
                }
            }
        }
    }
    words.next().is_none().then_some(false)
}

impl Bus for Remote {
    fn transact(&mut self, ops: &[Op], words: &mut Vec<u32>) -> Result<(), Error> {
        for ops in ops.chunks(MOST_OPS) {
            match self.ask(&Request::Access(ops.to_vec()))? {
                Answer::Words(read) => {
                    let is_end = ended_at(ops, &read).ok_or_else(|| self.something_else())?;
                    words.extend(read);
                    if is_end {
                        return Ok(());
                    }
                }
                Answer::Again => return Err(self.something_else()),
                Answer::Refused(address) => return Err(Error::Refused(address)),
                Answer::Failed(what) => return Err(Error::Lost(format!("{}: {what}", self.link.peer()))),
            }
        }
        Ok(())
    }

    fn is_simulated(&self) -> bool {
        self.is_simulated
    }
}
