//! The other end of a connection: carries out accesses for a host.

use std::net::TcpListener;
use std::sync::{Arc, Mutex, TryLockError};
use std::time::Duration;

use crate::bus::Bus;
use crate::error::Error;
use crate::frames::{self, Answer, PROTOCOL, Request};
use crate::link::Link;

/// Time that a host has to take an answer.
const SENDING: Duration = Duration::from_secs(1);

/// Carries out accesses for a host until it is gone.
///
/// A message that comes again, because the host missed the answer, is answered again and not carried out again.
///
/// # Errors
/// [`Error::Lost`] when the host is gone.
pub fn serve(bus: &mut dyn Bus, link: &mut Link) -> Result<(), Error> {
    let mut last: Option<(u8, Vec<u8>)> = None;
    loop {
        let stuffed = match link.receive(0, None) {
            Err(Error::Damaged(_)) => continue,
            received => received?,
        };
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
    let bus = Arc::new(Mutex::new(bus));
    loop {
        let (stream, _) = listener.accept().map_err(|error| Error::Lost(format!("nobody can connect: {error}")))?;
        // A host that is gone before it was served is no matter.
        let Ok(mut link) = Link::tcp(stream) else { continue };
        let bus = Arc::clone(&bus);
        std::thread::spawn(move || {
            let mut bus = match bus.try_lock() {
                Ok(bus) => bus,
                Err(TryLockError::Poisoned(bus)) => bus.into_inner(),
                Err(TryLockError::WouldBlock) => {
                    let _ = serve(&mut Taken, &mut link);
                    return;
                }
            };
            // It ends with the host.
            let _ = serve(&mut **bus, &mut link);
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
