//! How a host reaches a network.

use std::fmt;
use std::net::{TcpStream, ToSocketAddrs};
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use pe_map::wrap;

use crate::bank::Bank;
use crate::bus::Bus;
use crate::design::Design;
use crate::engine::Engine;
use crate::error::Error;
use crate::link::Link;
use crate::mapped::Mapped;
use crate::model::Model;
use crate::native::{Form, Native};
use crate::remote::Remote;
use crate::simulation::Simulator;
use crate::wrapped::Wrapped;

/// What all transports have in common.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// Time within which everything that hangs is an error: an answer, or the next step of a run. None takes what the
    /// transport needs; see [`Transport::timeout`].
    pub timeout: Option<Duration>,
    /// The reference as a library that was built before, by [`Native::build`] or the commands in `docs/library.md`; for
    /// [`Transport::Reference`].
    pub library: Option<PathBuf>,
}

/// Time to wait on this computer: registers that are mapped, a server at the loopback.
const NEAR: Duration = Duration::from_millis(100);

/// Time to wait for a simulation that works for its answers, on a computer that does other work as well.
const SIMULATED: Duration = Duration::from_secs(1);

/// Time to wait for another computer.
const FAR: Duration = Duration::from_millis(500);

/// Bits per second of a serial line, where nothing is said.
const BAUD: u32 = 115_200;

/// How a host reaches a network. Texts are those of [`Transport::FORMS`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Transport {
    /// In this process, the compiler's cycle-accurate simulator.
    Model,
    /// In this process, the reference that was generated for the design, built with `rustc`.
    Reference(Form),
    /// A simulation of the wrapped network that is started here.
    Simulation(Simulator),
    /// A server at this address.
    Tcp(String),
    /// A server at the other end of a serial line.
    Uart {
        /// Device.
        device: PathBuf,
        /// Bits per second.
        baud: u32,
    },
    /// Registers mapped to memory.
    Mmap {
        /// A UIO device, or a file in its place.
        device: PathBuf,
        /// Offset in bytes.
        offset: u64,
    },
}

impl Transport {
    /// All transports as texts, with what they are.
    pub const FORMS: [(&'static str, &'static str); 8] = [
        ("model", "in this process, the cycle-accurate simulator"),
        ("fast", "in this process, the generated reference, step by step"),
        ("clocked", "in this process, the generated reference, clock by clock"),
        ("ghdl", "the wrapped network in GHDL, which is started"),
        ("verilator", "the netlist of the wrapped network in Verilator, which is built and started"),
        ("tcp:HOST:PORT", "a computer on which `pe-synth serve` runs"),
        ("uart:DEVICE[@BAUD]", "a computer at the other end of a serial line; 115200 bits per second"),
        ("mmap:DEVICE[@OFFSET]", "registers of this computer, by a UIO device"),
    ];

    /// Opens a network of a design, in its initial state.
    ///
    /// # Errors
    /// [`Error::WrongHash`] if what answers is another design; those of the transport.
    pub fn open(&self, design: &Design, settings: &Settings) -> Result<Box<dyn Engine>, Error> {
        if let (Some(foreign), Transport::Model | Transport::Reference(_)) = (&design.map().foreign, self) {
            return Err(Error::Transport(format!(
                "`{}` is a VHDL entity of which there is no model: transport `{self}` cannot run it; use `ghdl`, \
                 `verilator`, or one that reaches hardware",
                foreign.entity
            )));
        }
        Ok(match self {
            Transport::Model => Box::new(Model::open(design)?),
            Transport::Reference(form) => Box::new(match &settings.library {
                Some(library) => Native::load(design, library, *form)?,
                None => Native::open(design, *form)?,
            }),
            _ => Box::new(Wrapped::open(design, self.bus(design, settings)?, self.timeout(settings))?),
        })
    }

    /// Time within which everything that hangs is an error: what was set, or else 0.1 s on this computer, 1 s for a
    /// simulation, and 0.5 s for another computer. A server with a simulation has 8 times as long.
    pub fn timeout(&self, settings: &Settings) -> Duration {
        settings.timeout.unwrap_or_else(|| match self {
            Transport::Model | Transport::Reference(_) | Transport::Mmap { .. } => NEAR,
            Transport::Simulation(_) => SIMULATED,
            Transport::Tcp(address) if is_near(address) => NEAR,
            Transport::Tcp(_) | Transport::Uart { .. } => FAR,
        })
    }

    /// Opens the registers of a design's wrapper; those of engines in this process are a [`Bank`].
    ///
    /// # Errors
    /// Those of the transport. Nobody has looked at the hash.
    pub fn bus(&self, design: &Design, settings: &Settings) -> Result<Box<dyn Bus>, Error> {
        Ok(match self {
            Transport::Model | Transport::Reference(_) => Box::new(Bank::over(design, self.open(design, settings)?)?),
            Transport::Simulation(simulator) => Box::new(simulator.open(design, self.timeout(settings))?),
            Transport::Tcp(address) => {
                let timeout = self.timeout(settings);
                Box::new(Remote::open(connected(address, timeout)?, timeout)?)
            }
            Transport::Uart { device, baud } => {
                Box::new(Remote::open(Link::serial(device, *baud)?, self.timeout(settings))?)
            }
            Transport::Mmap { device, offset } => {
                let bytes = 1 << wrap::windows(design.map()).address_bits;
                Box::new(Mapped::open(device, *offset, bytes)?)
            }
        })
    }
}

/// Whether this computer itself is at an address.
fn is_near(address: &str) -> bool {
    address.to_socket_addrs().is_ok_and(|mut places| places.all(|place| place.ip().is_loopback()))
}

fn connected(address: &str, timeout: Duration) -> Result<Link, Error> {
    let unknown = |error: &dyn fmt::Display| Error::Lost(format!("cannot connect to {address}: {error}"));
    let addresses = address.to_socket_addrs().map_err(|error| unknown(&error))?;
    let mut fault = unknown(&"there is no such computer");
    for place in addresses {
        match TcpStream::connect_timeout(&place, timeout) {
            Ok(stream) => return Link::tcp(stream),
            Err(error) if error.kind() == std::io::ErrorKind::TimedOut => {
                fault = Error::Late(format!("{address} does not answer"), timeout);
            }
            Err(error) => fault = unknown(&error),
        }
    }
    Err(fault)
}

impl FromStr for Transport {
    type Err = Error;

    fn from_str(text: &str) -> Result<Transport, Error> {
        let forms = Transport::FORMS.map(|(form, _)| format!("`{form}`")).join(", ");
        let refused = || Error::Transport(format!("there is no transport `{text}`: write one of {forms}"));
        let (kind, place) = text.split_once(':').unwrap_or((text, ""));
        let (device, number) = place.rsplit_once('@').map_or((place, None), |(device, number)| (device, Some(number)));
        match (kind, place) {
            ("model", "") => Ok(Transport::Model),
            ("fast", "") => Ok(Transport::Reference(Form::Fast)),
            ("clocked", "") => Ok(Transport::Reference(Form::Clocked)),
            ("ghdl", "") => Ok(Transport::Simulation(Simulator::Ghdl)),
            ("verilator", "") => Ok(Transport::Simulation(Simulator::Verilator)),
            ("tcp", address) if address.contains(':') => Ok(Transport::Tcp(address.to_owned())),
            ("uart", _) if !device.is_empty() => {
                let baud = number.map_or(Ok(BAUD), str::parse).map_err(|_| refused())?;
                Ok(Transport::Uart { device: device.into(), baud })
            }
            ("mmap", _) if !device.is_empty() => {
                let offset = number.map_or(Some(0), number_of).ok_or_else(refused)?;
                Ok(Transport::Mmap { device: device.into(), offset })
            }
            _ => Err(refused()),
        }
    }
}

/// A number, decimal or, behind `0x`, hexadecimal.
fn number_of(text: &str) -> Option<u64> {
    text.strip_prefix("0x").map_or_else(|| text.parse().ok(), |digits| u64::from_str_radix(digits, 16).ok())
}

impl fmt::Display for Transport {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Transport::Model => write!(f, "model"),
            Transport::Reference(Form::Fast) => write!(f, "fast"),
            Transport::Reference(Form::Clocked) => write!(f, "clocked"),
            Transport::Simulation(Simulator::Ghdl) => write!(f, "ghdl"),
            Transport::Simulation(Simulator::Verilator) => write!(f, "verilator"),
            Transport::Tcp(address) => write!(f, "tcp:{address}"),
            Transport::Uart { device, baud } => write!(f, "uart:{}@{baud}", device.display()),
            Transport::Mmap { device, offset } => write!(f, "mmap:{}@{offset:#x}", device.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transports_are_read_as_they_are_printed() {
        for text in [
            "model",
            "fast",
            "clocked",
            "ghdl",
            "verilator",
            "tcp:board:5000",
            "uart:/dev/ttyUSB0@921600",
            "mmap:/dev/uio0@0x1000",
        ] {
            assert_eq!(text.parse::<Transport>().unwrap().to_string(), text);
        }
        assert_eq!("uart:/dev/ttyS0".parse::<Transport>().unwrap().to_string(), "uart:/dev/ttyS0@115200");
        for text in ["", "models", "model:1", "tcp:", "tcp:board", "uart:", "uart:@9600", "uart:a@b", "mmap:a@0x"] {
            assert!(matches!(text.parse::<Transport>(), Err(Error::Transport(_))), "{text}");
        }
    }
}
