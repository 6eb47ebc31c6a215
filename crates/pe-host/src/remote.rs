//! Registers behind a connection: asks a [server](crate::serve) for accesses.

use std::time::Duration;

use crate::bus::{Bus, Op};
use crate::error::Error;
use crate::frames::{self, Answer, MOST_OPS, PROTOCOL, Request};
use crate::link::Link;

/// Times that a message is sent before the connection counts as damaged. A server carries out each message once.
const TRIES: u32 = 5;

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

    fn ask(&mut self, request: &Request) -> Result<Answer, Error> {
        self.number = self.number.wrapping_add(1);
        let message = frames::frame(&request.body(self.number));
        let damaged = || Error::Damaged(format!("what {} sends is damaged", self.link.peer()));
        let mut fault = damaged();
        for _ in 0..TRIES {
            self.link.send(&message, self.timeout)?;
            match self.answer() {
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

    /// The answer to the message that was sent last; those to earlier ones are late.
    fn answer(&mut self) -> Result<Answer, Error> {
        // All tries together have the time.
        let part = self.timeout / TRIES;
        loop {
            let stuffed = self.link.receive(0, Some(part))?;
            let read = frames::body(&stuffed).and_then(|body| Answer::read(&body));
            match read {
                Some((number, answer)) if number == self.number || answer == Answer::Again => return Ok(answer),
                Some(_) => {}
                None => return Err(Error::Damaged(format!("what {} sends is damaged", self.link.peer()))),
            }
        }
    }
}

impl Bus for Remote {
    fn transact(&mut self, ops: &[Op], words: &mut Vec<u32>) -> Result<(), Error> {
        for ops in ops.chunks(MOST_OPS) {
            let asked = ops.iter().filter(|op| !matches!(op, Op::Write(..))).count();
            match self.ask(&Request::Access(ops.to_vec()))? {
                Answer::Words(read) if read.len() == asked => words.extend(read),
                Answer::Words(_) | Answer::Again => {
                    return Err(Error::Damaged(format!("{} answers something else", self.link.peer())));
                }
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
