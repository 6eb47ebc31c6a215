//! `pe-synth serve`: a network for hosts on other computers.

use std::net::TcpListener;
use std::path::PathBuf;

use pe_host::{Design, Error, Link, Settings, Transport, Wrapped, serve, serve_tcp};

use crate::console;
use crate::messages::MessageFormat;
use pe_flow::failure::Failure;

/// Serves a network to a host on another computer
///
/// Runs on the computer that has the network: a board with Linux, or any computer that simulates it. A host reaches it with
/// the transport `tcp:HOST:PORT` or `uart:DEVICE`. One host at a time; until it is interrupted. Nobody is asked for a
/// password: serve an address other than that of the computer itself only in a network that you trust.
#[derive(clap::Args, Debug)]
#[command(after_help = "\
Examples:
  pe-synth serve out/motor_pid --transport mmap:/dev/uio0 --tcp 0.0.0.0:5025
  pe-synth serve out/motor_pid --transport model
  pe-synth serve out/motor_pid --transport fast --uart /dev/ttyS1")]
pub struct Serve {
    /// Folder that `compile` wrote
    folder: PathBuf,
    /// How this computer reaches the network
    #[arg(long, value_name = "TRANSPORT", default_value = "model")]
    transport: Transport,
    /// Address and port to wait at; port 0 takes one that is free
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:5025", conflicts_with = "uart")]
    tcp: String,
    /// Serial line to wait at
    #[arg(long, value_name = "DEVICE")]
    uart: Option<PathBuf>,
    /// Bits per second of the serial line
    #[arg(long, value_name = "N", default_value_t = 115_200, requires = "uart")]
    baud: u32,
    /// Format of errors on standard error
    #[arg(long, value_enum, default_value_t, help_heading = "Diagnostics")]
    message_format: MessageFormat,
}

impl Serve {
    /// Form of messages.
    pub fn message_format(&self) -> MessageFormat {
        self.message_format
    }

    /// Runs the command, until the line is lost or it is interrupted.
    pub fn run(&self) -> Result<(), Failure> {
        let design = Design::open(&self.folder).map_err(failure)?;
        let settings = Settings::default();
        let bus = self.transport.bus(&design, &settings).map_err(failure)?;
        // A network that does not answer, or another one, is told here and not to each host.
        let wrapped = Wrapped::open(&design, bus, self.transport.timeout(&settings)).map_err(failure)?;
        let mut bus = wrapped.into_bus();
        let (entity, transport) = (&design.map().entity, &self.transport);
        if let Some(device) = &self.uart {
            let mut link = Link::serial(device, self.baud).map_err(failure)?;
            console::out(&format!("serving {entity} through {transport} at {}\n", device.display()))?;
            return serve(&mut *bus, &mut link).map_err(failure);
        }
        let taken = |error: std::io::Error| Failure::File(format!("cannot wait at {}: {error}", self.tcp));
        let listener = TcpListener::bind(&self.tcp).map_err(taken)?;
        let address = listener.local_addr().map_err(taken)?;
        console::out(&format!("serving {entity} through {transport} at {address}\n"))?;
        serve_tcp(bus, &listener).map_err(failure)
    }
}

/// What a failed host means for a command.
pub fn failure(error: Error) -> Failure {
    let text = error.to_string();
    match error {
        Error::File(_) => Failure::File(text),
        Error::Transport(_) | Error::Lacks(_) => Failure::Usage(text),
        Error::MissingTool(_) => Failure::MissingTool(text),
        _ => Failure::Mismatch(text),
    }
}
