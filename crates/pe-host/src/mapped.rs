//! Registers mapped to memory: a UIO device of Linux, or a file in its place.
#![allow(unsafe_code)]

use std::fs::OpenOptions;
use std::path::Path;

use memmap2::{MmapOptions, MmapRaw};

use crate::bus::{Access, Bus, Op};
use crate::error::Error;

/// Registers mapped to memory. There is no error of the bus: hardware that answers by one ends the process, so addresses
/// are checked here.
pub struct Mapped {
    memory: MmapRaw,
}

impl Mapped {
    /// Maps so many bytes of a device. UIO counts its maps by pages: map N begins at N times the size of a page.
    ///
    /// # Errors
    /// [`Error::File`] if there is no such device, or not so much of it.
    pub fn open(device: &Path, offset: u64, bytes: usize) -> Result<Mapped, Error> {
        let file = OpenOptions::new().read(true).write(true).open(device);
        let file = file.map_err(|error| Error::file("open", device, error))?;
        let length = file.metadata().map_err(|error| Error::file("open", device, error))?;
        if length.is_file() && length.len() < offset + bytes as u64 {
            let what = format!("it has {} bytes, {} are needed", length.len(), offset + bytes as u64);
            return Err(Error::file("map", device, what));
        }
        let memory = MmapOptions::new().offset(offset).len(bytes).map_raw(&file);
        Ok(Mapped { memory: memory.map_err(|error| Error::file("map", device, error))? })
    }

    fn place(&self, address: u32) -> Result<*mut u32, Error> {
        let at = usize::try_from(address).unwrap_or(usize::MAX);
        if !address.is_multiple_of(4) || at >= self.memory.len() {
            return Err(Error::Refused(address));
        }
        Ok(self.memory.as_mut_ptr().wrapping_add(at).cast())
    }
}

impl Access for Mapped {
    fn read(&mut self, address: u32) -> Result<u32, Error> {
        let place = self.place(address)?;
        // SAFETY: `place` is a word within the map, which lives as long as `self`; others may change it at any time.
        Ok(u32::from_le(unsafe { place.read_volatile() }))
    }

    fn write(&mut self, address: u32, word: u32) -> Result<(), Error> {
        let place = self.place(address)?;
        // SAFETY: see `read`.
        unsafe { place.write_volatile(word.to_le()) };
        Ok(())
    }
}

impl Bus for Mapped {
    fn transact(&mut self, ops: &[Op], words: &mut Vec<u32>) -> Result<(), Error> {
        self.carry_out(ops, words)
    }
}
