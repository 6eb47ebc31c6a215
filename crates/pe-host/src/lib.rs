//! Drives a network from a program: numbers go in, steps run, numbers come out, and every transport gives the same ones.
//!
//! [`Host`] is the interface in numbers. It needs the folder that `compile` wrote, for its map, and a [`Transport`]. Below
//! it an [`Engine`] runs the network in words. The order of events is the same everywhere, `docs/host.md`: the outputs of
//! sample k are read, and the inputs that are written then act in step k + 1, which leads to sample k + 1.
//!
//! ```no_run
//! use pe_host::{Host, Settings, Transport};
//!
//! fn main() -> Result<(), pe_host::Error> {
//!     let transport: Transport = "fast".parse()?;
//!     let mut motor = Host::open("out/motor".as_ref(), &transport, &Settings::default())?;
//!     let mut outputs = [0.0; 2];
//!     motor.read(&mut outputs)?;
//!     for _ in 0..1000 {
//!         let voltage = 2.0 * (1.0 - outputs[0]);
//!         let exchanged = motor.exchange(&[voltage], 1, &mut outputs)?;
//!         assert!(exchanged.written.clamped.is_empty());
//!     }
//!     Ok(())
//! }
//! ```

//!
//! Engines in this process are [`Model`] and [`Native`]. Others are reached by the registers of their wrapper: [`Wrapped`]
//! is an engine over any [`Bus`], which is [`Mapped`] memory, a [`Pipe`] to a simulation, or [`Remote`], at the other end of
//! a [`Link`] to a computer that [serves](serve) another bus. [`Bank`] is the register bank in software.

mod bank;
mod bus;
mod design;
mod engine;
mod error;
pub mod faults;
mod frames;
mod host;
mod link;
mod mapped;
mod model;
mod native;
mod pipe;
mod places;
pub mod rates;
mod remote;
mod scratch;
mod server;
mod simulation;
mod transport;
mod wrapped;

pub use bank::Bank;
pub use bus::{Bus, Frames, Op};
pub use design::Design;
pub use engine::{Counters, Engine, Flags, Limits, Ran};
pub use error::Error;
pub use host::{Exchanged, Host, Snapshot, Written};
pub use link::Link;
pub use mapped::Mapped;
pub use model::Model;
pub use native::{Form, Native};
pub use pipe::Pipe;
pub use remote::Remote;
pub use server::{serve, serve_tcp};
pub use simulation::Simulator;
pub use transport::{Settings, Transport};
pub use wrapped::Wrapped;
