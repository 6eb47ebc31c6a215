//! What accesses registers.

use std::time::{Duration, Instant};

use crate::error::Error;

/// Time for which a bus itself waits for a register, where time is real.
const PATIENCE: Duration = Duration::from_millis(20);

/// An access to a register of 32 bits, by its address in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Op {
    /// Reads a word.
    Read(u32),
    /// Writes a word.
    Write(u32, u32),
    /// Reads until the condition holds, or for a while. If it does not hold then, the accesses behind are not carried out:
    /// the caller finds less words than it asked for, and tries again.
    Poll {
        /// Address.
        address: u32,
        /// Bits of the word.
        mask: u32,
        /// Whether to wait until one of them is 1; else, until all are 0.
        set: bool,
        /// Clocks that this takes, as far as the caller knows. In a simulation as many pass at least, unless it ends before.
        clocks: u32,
    },
}

impl Op {
    /// Whether a word ends the wait.
    pub(crate) fn holds(mask: u32, set: bool, word: u32) -> bool {
        (word & mask != 0) == set
    }
}

/// Frames for the streams of a wrapper.
#[derive(Clone, Copy, Debug)]
pub struct Frames<'a> {
    /// Words of all frames in, and of one.
    pub inputs: &'a [u32],
    /// Words of a frame in; 0 without inputs.
    pub words_in: usize,
    /// Words of all frames out.
    pub words_out: usize,
    /// Clocks without a word after which nothing more is expected.
    pub patience: u32,
}

/// Something that accesses registers: a mapped device, a simulation, or a connection to another computer.
pub trait Bus: Send {
    /// Carries out accesses in order, up to an [`Op::Poll`] whose condition does not hold in the end. Appends a word for each
    /// [`Op::Read`], and the last one for each [`Op::Poll`].
    ///
    /// # Errors
    /// [`Error::Refused`] with the address at which it ended; those of the connection.
    fn transact(&mut self, ops: &[Op], words: &mut Vec<u32>) -> Result<(), Error>;

    /// Whether nothing happens in the hardware but while a transaction is under way: time is counted in its clocks.
    fn is_simulated(&self) -> bool {
        false
    }

    /// Whether frames can go through the streams of the wrapper.
    fn has_streams(&self) -> bool {
        false
    }

    /// Sends frames of inputs, and appends the words of as many frames of outputs; less if nothing comes for so many clocks.
    ///
    /// # Errors
    /// [`Error::Lacks`] without streams; those of the connection.
    fn stream(&mut self, _frames: &Frames, _words: &mut Vec<u32>) -> Result<(), Error> {
        Err(Error::Lacks("streams"))
    }

    /// Configures the hardware anew; whether it can.
    ///
    /// # Errors
    /// Those of the connection.
    fn renew(&mut self) -> Result<bool, Error> {
        Ok(false)
    }
}

/// Single accesses, of which a bus is made.
pub(crate) trait Access {
    /// Reads a word.
    fn read(&mut self, address: u32) -> Result<u32, Error>;

    /// Writes a word.
    fn write(&mut self, address: u32, word: u32) -> Result<(), Error>;

    /// Accesses one after the other, in real time.
    fn carry_out(&mut self, ops: &[Op], words: &mut Vec<u32>) -> Result<(), Error> {
        for op in ops {
            match *op {
                Op::Read(address) => words.push(self.read(address)?),
                Op::Write(address, word) => self.write(address, word)?,
                Op::Poll { address, mask, set, .. } => {
                    let mut word = self.read(address)?;
                    let begin = Instant::now();
                    while !Op::holds(mask, set, word) && begin.elapsed() < PATIENCE {
                        word = self.read(address)?;
                    }
                    words.push(word);
                    if !Op::holds(mask, set, word) {
                        return Ok(());
                    }
                }
            }
        }
        Ok(())
    }
}
