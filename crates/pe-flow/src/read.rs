//! Reads files of unknown size, within a limit.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::Path;

use pe_frontend::LoadError;

/// The content of a file, pipe or device, unless it has more than so many bytes.
///
/// # Errors
/// [`LoadError::TooLarge`] as soon as that is known; otherwise why it cannot be read.
pub fn at_most(path: &Path, most: u64) -> Result<Vec<u8>, LoadError> {
    let file = File::open(path).map_err(unreadable)?;
    let data = file.metadata().map_err(unreadable)?;
    if data.len() > most {
        return Err(LoadError::TooLarge(data.len()));
    }
    // Pipes and devices have no size beforehand.
    stream_at_most(&mut &file, most)
}

/// What a stream gives up to its end, unless that is more than so many bytes.
///
/// # Errors
/// As of [`at_most`].
pub fn stream_at_most(stream: &mut dyn Read, most: u64) -> Result<Vec<u8>, LoadError> {
    let mut bytes = Vec::new();
    stream.take(most + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > most {
        return Err(LoadError::TooLarge(bytes.len() as u64));
    }
    Ok(bytes)
}

/// Why a file cannot be read.
pub fn unreadable(error: std::io::Error) -> LoadError {
    match error.kind() {
        ErrorKind::NotFound => LoadError::Missing,
        _ => LoadError::Unreadable(error.to_string()),
    }
}
