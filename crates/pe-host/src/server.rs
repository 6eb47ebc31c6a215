//! The other end of a connection: carries out accesses for a host.

use std::net::TcpListener;
use std::sync::{Arc, Mutex, TryLockError};
use std::time::Duration;

use crate::bus::Bus;
use crate::error::Error;
use crate::frames::{self, Answer, PROTOCOL, Request};
use crate::link::Link;

/// Time in which somebody who connects has to say something; others wait for it.
const GREETING: Duration = Duration::from_secs(2);

/// Hosts that are told at once that they have to wait; more are not answered.
const MOST_WAITING: usize = 16;

/// Time that a host has to take an answer.
const SENDING: Duration = Duration::from_secs(1);

/// Carries out accesses for a host until it is gone.
///
/// A message that comes again, because the host missed the answer, is answered again and not carried out again.
///
/// # Errors
/// [`Error::Lost`] when the host is gone.
pub fn serve(bus: &mut dyn Bus, link: &mut Link) -> Result<(), Error> {
    serve_from(bus, link, None)
}

/// The same, if the host says something within this time.
fn serve_from(bus: &mut dyn Bus, link: &mut Link, mut time: Option<Duration>) -> Result<(), Error> {
    let mut last: Option<(u8, Vec<u8>)> = None;
    loop {
        let stuffed = match link.receive(0, time) {
            Err(Error::Damaged(_)) => continue,
            received => received?,
        };
        time = None;
        let request = frames::body(&stuffed).and_then(|body| Request::read(&body));
        let message = match (request, last.take()) {
            (None, before) => {
                last = before;
                frames::frame(&Answer::Again.body(0))
            }
            (Some((number, request)), Some((before, message))) if number == before && request != Request::Hello => {
                last = Some((before, message.clone()));
                message
            }
            (Some((number, request)), _) => {
                let message = frames::frame(&answer(bus, &request).body(number));
                last = Some((number, message.clone()));
                message
            }
        };
        link.send(&message, SENDING)?;
    }
}

fn answer(bus: &mut dyn Bus, request: &Request) -> Answer {
    let Request::Access(ops) = request else {
        return Answer::Words(vec![u32::from(PROTOCOL), u32::from(bus.is_simulated())]);
    };
    let mut words = Vec::new();
    match bus.transact(ops, &mut words) {
        Ok(()) => Answer::Words(words),
        Err(Error::Refused(address)) => Answer::Refused(address),
        Err(error) => Answer::Failed(error.to_string()),
    }
}

/// Serves hosts that connect to an address, one after the other; one that comes meanwhile is told so. Does not end by
/// itself.
///
/// # Errors
/// [`Error::Lost`] if nobody can connect any more.
pub fn serve_tcp(bus: Box<dyn Bus>, listener: &TcpListener) -> Result<(), Error> {
    let (bus, connected) = (Arc::new(Mutex::new(bus)), Arc::new(()));
    loop {
        let (stream, _) = listener.accept().map_err(|error| Error::Lost(format!("nobody can connect: {error}")))?;
        if Arc::strong_count(&connected) > MOST_WAITING {
            continue;
        }
        // A host that is gone before it was served is no matter.
        let Ok(mut link) = Link::tcp(stream) else { continue };
        let (bus, connected) = (Arc::clone(&bus), Arc::clone(&connected));
        std::thread::spawn(move || {
            let mut bus = match bus.try_lock() {
                Ok(bus) => bus,
                Err(TryLockError::Poisoned(bus)) => bus.into_inner(),
                Err(TryLockError::WouldBlock) => {
                    let _ = serve_from(&mut Taken, &mut link, Some(GREETING));
                    drop(connected);
                    return;
                }
            };
            // It ends with the host.
            let _ = serve_from(&mut **bus, &mut link, Some(GREETING));
            drop(connected);
        });
    }
}

/// Stands for a bus that another host has.
struct Taken;

impl Bus for Taken {
    fn transact(&mut self, _: &[crate::bus::Op], _: &mut Vec<u32>) -> Result<(), Error> {
        Err(Error::Lost("another host is connected".to_owned()))
    }
}
