//! Samples per second of a closed loop: predicted from the times to write, run and read, and measured.
//!
//! With hardware in the loop a sample takes the time to write the inputs, to run the step and to read the outputs, so
//! there are `1/(write + run + read)` samples per second.

use std::time::{Duration, Instant};

use pe_map::{Map, registers::Windows, wrap};

use crate::bus::Op;
use crate::error::Error;
use crate::frames::{Answer, Request, frame};
use crate::host::Host;
use crate::places::address;

/// Seconds of the parts of a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Times {
    /// To write all inputs.
    pub write: f64,
    /// To run a step, from its start until the host knows that it has ended.
    pub run: f64,
    /// To read all outputs.
    pub read: f64,
}

impl Times {
    /// Samples per second.
    pub fn rate(&self) -> f64 {
        1.0 / (self.write + self.run + self.read)
    }
}

/// What connects a host to hardware.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Line {
    /// Registers mapped to memory: seconds of an access.
    Mmap(f64),
    /// A server on a board: seconds of a message and its answer, and of an access of the server.
    Tcp(f64, f64),
    /// The same on a serial line: bits per second; the access of the server.
    Uart(u32, f64),
}

impl Line {
    /// Lines with numbers that are usual: a processor beside the logic, which needs some twenty clocks of 100 MHz for an
    /// access; a local network; a serial line at two rates.
    pub const USUAL: [(&'static str, Line); 4] = [
        ("mmap", Line::Mmap(2e-7)),
        ("tcp", Line::Tcp(1e-4, 2e-7)),
        ("uart at 921600 bits/s", Line::Uart(921_600, 2e-7)),
        ("uart at 115200 bits/s", Line::Uart(115_200, 2e-7)),
    ];
}

/// Accesses of an exchange, in its three parts.
fn exchange(map: &Map) -> [Vec<Op>; 3] {
    let windows = wrap::windows(map);
    let words = |spans: &[pe_map::registers::Span]| -> Vec<u32> {
        let begin = spans.first().map_or(0, |span| span.address);
        (0..Windows::total(spans)).map(|word| begin + 4 * word).collect()
    };
    let status = address("STATUS");
    let write = words(&windows.inputs).into_iter().map(|place| Op::Write(place, 0)).collect();
    let poll = Op::Poll { address: status, mask: 1, set: true, clocks: map.clocks_per_step };
    let run = vec![Op::Write(status, 0), Op::Write(address("COMMAND"), 0), poll];
    [write, run, words(&windows.outputs).into_iter().map(Op::Read).collect()]
}

/// Times of a design in hardware with a clock of so many hertz, of which none is given to the host program itself.
pub fn predicted(map: &Map, line: Line, clock: f64) -> Times {
    let step = f64::from(map.clocks_per_step) / clock;
    let parts = exchange(map);
    let [write, run, read] = &parts;
    let accesses = |seconds: f64| Times {
        write: seconds * write.len() as f64,
        run: seconds * run.len() as f64 + step,
        read: seconds * read.len() as f64,
    };
    match line {
        Line::Mmap(access) => accesses(access),
        Line::Tcp(message, access) => {
            let times = accesses(access);
            Times { run: times.run + message, ..times }
        }
        Line::Uart(baud, access) => {
            // Eight bits, with a start and a stop bit. All parts are one message.
            let seconds = |bytes: usize| 10.0 * bytes as f64 / f64::from(baud);
            let sent = |ops: Vec<Op>| frame(&Request::Access(ops).body(1)).len();
            let answered = |words: usize| frame(&Answer::Words(vec![0; words]).body(1)).len();
            let times = accesses(access);
            let (begun, with_run) = (sent(run.clone()), sent([&write[..], run].concat()));
            let all = sent([&write[..], run, read].concat());
            let outputs = answered(read.len() + 1) - answered(1);
            Times {
                write: times.write + seconds(with_run - begun),
                run: times.run + seconds(begun + answered(1)),
                read: times.read + seconds(all - with_run + outputs),
            }
        }
    }
}

/// Times of an engine, and the samples per second of a closed loop over it, all measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Times of single calls.
    pub times: Times,
    /// Samples per second of [`Host::exchange`], with inputs that follow the outputs.
    pub rate: f64,
}

/// Measures for about so long. The network goes on from where it is.
///
/// # Errors
/// Those of the transport.
pub fn measured(host: &mut Host, time: Duration) -> Result<Measured, Error> {
    let part = time / 4;
    let limits: Vec<[f64; 2]> = host.inputs().map(|input| input.limits).collect();
    let mut inputs = vec![0.0; limits.len()];
    let mut outputs = vec![0.0; host.map().outputs.len()];
    host.run(1)?;
    let write = seconds(part, |_| host.write(&inputs).map(drop))?;
    let run = seconds(part, |_| host.run(1).map(drop))?;
    let read = seconds(part, |_| host.read(&mut outputs))?;
    let sample = seconds(part, |sample| {
        for (input, [least, most]) in inputs.iter_mut().zip(&limits) {
            // Inputs that change in every step and follow the outputs, far within their limits.
            let fed = outputs.first().copied().unwrap_or(0.0) * 1e-3 + f64::from(sample % 7) * 1e-2;
            *input = 1e-3 * fed.clamp(-1.0, 1.0) * most.abs().min(least.abs());
        }
        host.exchange(&inputs, 1, &mut outputs).map(drop)
    })?;
    Ok(Measured { times: Times { write, run, read }, rate: 1.0 / sample })
}

/// Stretches of which the fastest counts: other work on the computer only ever adds.
const STRETCHES: u32 = 20;

/// Seconds of a call that is made again and again: the mean of the fastest stretch.
fn seconds(time: Duration, mut call: impl FnMut(u32) -> Result<(), Error>) -> Result<f64, Error> {
    let (begin, mut calls, mut at_once, mut least) = (Instant::now(), 0_u32, 1_u32, f64::INFINITY);
    while begin.elapsed() < time || least.is_infinite() {
        let stretch = Instant::now();
        for _ in 0..at_once {
            call(calls)?;
            calls = calls.wrapping_add(1);
        }
        let elapsed = stretch.elapsed();
        least = least.min(elapsed.as_secs_f64() / f64::from(at_once));
        // Short stretches would measure the clock.
        if elapsed < time / STRETCHES {
            at_once = at_once.saturating_mul(2);
        }
    }
    Ok(least)
}
