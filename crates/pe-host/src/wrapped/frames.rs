//! Many steps at once, with inputs of their own: by registers or through streams.

use std::time::{Duration, Instant};

use pe_map::registers::Windows;

use super::{SPARE_CLOCKS, Wrapped, add_read};
use crate::bus::{Frames, Op};
use crate::engine::Engine;
use crate::error::Error;
use crate::places::{address, halves, mask, whole};

/// Accesses that are given to the bus at once where frames go through registers.
const BATCH: usize = 1 << 12;

/// Frames that are given to a stream at once: at first, and time that they should take.
const FIRST_FRAMES: usize = 16;
const FRAMES_TIME: Duration = Duration::from_millis(60);

/// Most words of the frames that are given to a stream at once.
const STREAM_WORDS: usize = 1 << 10;

impl Wrapped {
    /// Runs frames by registers: writes, start and reads of many of them in a message.
    pub(super) fn batches(&mut self, frames: usize, inputs: &[i64], outputs: &mut Vec<i64>) -> Result<(), Error> {
        let (ports, shown) = (self.windows.inputs.len(), self.windows.outputs.len());
        let words: u32 = Windows::total(&self.windows.inputs) + Windows::total(&self.windows.outputs);
        let at_once = (BATCH / (usize::try_from(words).unwrap_or(BATCH) + 4)).max(1);
        let (mut from, mut row) = (0, vec![None; shown]);
        while from < frames {
            let until = frames.min(from + at_once);
            self.ops.clear();
            for frame in from..until {
                self.add_inputs(&inputs[frame * ports..(frame + 1) * ports])?;
                self.add_start(1);
                self.run_steps = 1;
                self.windows.outputs.iter().for_each(|span| add_read(&mut self.ops, span));
            }
            let ops = std::mem::take(&mut self.ops);
            self.run_steps = 0;
            let done = self.transact(&ops);
            self.ops = ops;
            done?;
            (self.run_steps, self.stepped, self.set) = (1, true, None);
            let read = std::mem::take(&mut self.words);
            let size = 1 + usize::try_from(Windows::total(&self.windows.outputs)).unwrap_or(0);
            for frame in read.chunks(size) {
                let status = frame.first().copied().unwrap_or(0);
                self.ended(status)?;
                if frame.len() == size {
                    self.take_outputs(&frame[1..], &mut row, |_| true);
                } else {
                    // Its step took longer than a wait does.
                    let (awaited, clocks) = (self.awaited(), self.expected(1));
                    let status = self.await_status(awaited, true, clocks, "does not finish a step")?;
                    self.ended(status)?;
                    self.read(&mut row)?;
                }
                outputs.extend(row.iter().map(|word| word.unwrap_or(0)));
                from += 1;
            }
            if read.is_empty() {
                return Err(Error::Damaged("the bus gives another number of words".to_owned()));
            }
        }
        Ok(())
    }

    /// Runs frames through the streams of a wrapper.
    pub(super) fn stream(&mut self, frames: usize, inputs: &[i64], outputs: &mut Vec<i64>) -> Result<(), Error> {
        let ports = self.windows.inputs.len();
        let [words_in, words_out] = [&self.windows.inputs, &self.windows.outputs].map(|spans| Windows::total(spans));
        let [words_in, words_out] = [words_in, words_out].map(|words| usize::try_from(words).unwrap_or(0));
        let patience = u64::from(self.expected(4)) + 4 * (words_in + words_out) as u64 + SPARE_CLOCKS;
        let patience = u32::try_from(patience).unwrap_or(u32::MAX);
        let most = (STREAM_WORDS / words_in.max(words_out).max(1)).max(1);
        let (mut from, mut at_once) = (0, FIRST_FRAMES.min(most));
        let mode = self.mode();
        while from < frames {
            let count = at_once.min(frames - from);
            let begin = Instant::now();
            self.run_steps = u32::try_from(count).unwrap_or(u32::MAX);
            self.transact(&[
                Op::Write(self.places.status, self.places.ends | mask("STATUS", "FRAME")),
                Op::Write(address("MODE"), mode | mask("MODE", "STREAM")),
                Op::Write(self.places.run_steps, self.run_steps),
                Op::Write(self.places.command, self.places.start),
            ])?;
            (self.stepped, self.set) = (true, None);
            let mut sent = Vec::with_capacity(count * words_in);
            for word in inputs[from * ports..(from + count) * ports].iter().zip(self.windows.inputs.iter().cycle()) {
                sent.extend(halves(*word.0).into_iter().take(usize::try_from(word.1.words).unwrap_or(0)));
            }
            self.words.clear();
            let frames = Frames { inputs: &sent, words_in, words_out: count * words_out, patience };
            self.bus.stream(&frames, &mut self.words)?;
            let received = std::mem::take(&mut self.words);
            let (awaited, clocks) = (self.awaited(), self.expected(1));
            let status = self.await_status(awaited, true, clocks, "does not finish the steps of frames")?;
            self.ended(status)?;
            if received.len() != count * words_out {
                return Err(Error::Late("the network does not send its outputs".to_owned(), begin.elapsed()));
            }
            let mut rest = &received[..];
            for span in self.windows.outputs.iter().cycle().take(count * self.windows.outputs.len()) {
                let (own, behind) = rest.split_at(usize::try_from(span.words).unwrap_or(0).min(rest.len()));
                outputs.push(whole(own));
                rest = behind;
            }
            from += count;
            if begin.elapsed() < FRAMES_TIME / 2 {
                at_once = (2 * at_once).min(most);
            } else if begin.elapsed() > 2 * FRAMES_TIME {
                at_once = (at_once / 2).max(1);
            }
        }
        // Inputs of the last frame act until others are written.
        self.ops.clear();
        self.ops.push(Op::Write(address("MODE"), mode));
        self.add_inputs(&inputs[(frames - 1) * ports..])?;
        let ops = std::mem::take(&mut self.ops);
        let done = self.transact(&ops);
        self.ops = ops;
        done
    }
}
