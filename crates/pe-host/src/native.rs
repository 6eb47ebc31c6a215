//! The network in this process, by its own reference, built as a library: `docs/library.md`.
#![allow(unsafe_code)]

use std::ffi::{CStr, OsStr, c_char, c_void};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use libloading::Library;
use pe_map::Map;

use crate::design::{Design, States, count};
use crate::engine::{Engine, Flags, Ran, one_by_one};
use crate::error::Error;
use crate::scratch::{Scratch, run};

/// Version of the library's interface.
const INTERFACE: i32 = 1;

/// How the library computes; both give the same words and flags.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// What a step computes, without clocks.
    Fast = 0,
    /// Every register, clock by clock.
    Clocked = 1,
}

/// The functions of a library.
#[derive(Clone, Copy)]
struct Functions {
    free: unsafe extern "C" fn(*mut c_void),
    reset: unsafe extern "C" fn(*mut c_void) -> i32,
    set_inputs: unsafe extern "C" fn(*mut c_void, *const i64, usize) -> i32,
    step: unsafe extern "C" fn(*mut c_void, u64) -> i32,
    get_outputs: unsafe extern "C" fn(*mut c_void, *mut i64, usize) -> i32,
    get_state: unsafe extern "C" fn(*mut c_void, *mut i64, usize) -> i32,
    set_state: unsafe extern "C" fn(*mut c_void, *const i64, usize) -> i32,
    flags: unsafe extern "C" fn(*mut c_void, *mut u32) -> i32,
    clear_flags: unsafe extern "C" fn(*mut c_void) -> i32,
}

/// A network in a library.
pub struct Native {
    map: Arc<Map>,
    functions: Functions,
    network: *mut c_void,
    stepped: bool,
    outputs: Vec<i64>,
    /// Outputs of the sample that no step has made: those of the initial state, or while parameters were written.
    shown: Option<Vec<Option<i64>>>,
    /// Behind the functions and the network, which are gone before it.
    _library: Library,
}

// SAFETY: the library's networks are used by one thread at a time, which may be another one each time.
unsafe impl Send for Native {}

impl Native {
    /// Builds the reference of a folder and loads it. It takes some seconds: [`Native::build`] and [`Native::load`] do the
    /// two apart.
    ///
    /// # Errors
    /// [`Error::File`], [`Error::MissingTool`], [`Error::Tool`], [`Error::WrongHash`] or [`Error::Foreign`].
    pub fn open(design: &Design, form: Form) -> Result<Native, Error> {
        // What is loaded needs no file.
        let scratch = Scratch::new()?;
        let library = scratch.path().join("network.so");
        Native::build(design, &library)?;
        Native::load(design, &library, form)
    }

    /// Builds the reference of a folder as a library for this computer.
    ///
    /// # Errors
    /// [`Error::File`], [`Error::MissingTool`] or [`Error::Tool`].
    pub fn build(design: &Design, library: &Path) -> Result<(), Error> {
        let source = design.file("reference.rs");
        fs::metadata(&source).map_err(|error| Error::file("read", &source, error))?;
        let folder = library.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut build = Command::new("rustc");
        build.args(["--edition", "2021", "--crate-type", "cdylib", "-C", "opt-level=3", "-C", "target-cpu=native"]);
        build.arg("-o").arg(library.file_name().unwrap_or(OsStr::new("network.so")));
        // The compiler leaves parts where it runs until they are complete.
        build.arg(fs::canonicalize(&source).unwrap_or(source)).current_dir(folder);
        run(&mut build, "rustc", "install Rust from https://rustup.rs").map(drop)
    }

    /// Loads a library that [`Native::build`] or the commands in `docs/library.md` built.
    ///
    /// # Errors
    /// [`Error::File`] if it is no library of this design, [`Error::WrongHash`] or [`Error::Foreign`].
    pub fn load(design: &Design, library: &Path, form: Form) -> Result<Native, Error> {
        let map = design.shared_map();
        // A bare name would be looked for in the system's folders.
        let path: PathBuf = Path::new(".").join(library);
        // SAFETY: a library of ours does nothing when it is loaded; of another one the caller answers for that.
        let loaded = unsafe { Library::new(&path) }.map_err(|error| Error::file("load", library, error))?;
        let network = load(&loaded, &map, library, form)?;
        let (functions, network) = network;
        let outputs = vec![0; map.outputs.len()];
        let mut native = Native { functions, network, stepped: false, outputs, shown: None, map, _library: loaded };
        native.show_first();
        Ok(native)
    }

    fn show_first(&mut self) {
        let mut shown = vec![None; self.map.outputs.len()];
        self.map.first(&mut shown);
        self.shown = Some(shown);
    }

    fn check(&self, code: i32) -> Result<(), Error> {
        match code {
            0 | 1 => Ok(()),
            -3 => Err(Error::Range("an input or a state".to_owned())),
            _ => Err(Error::Lost(format!("the library of `{}` failed with code {code}", self.map.entity))),
        }
    }
}

/// A function of a library.
///
/// # Safety
/// `T` is the type of that function.
unsafe fn function<T: Copy>(library: &Library, map: &Map, name: &str, path: &Path) -> Result<T, Error> {
    let symbol = format!("{}_{name}", map.entity);
    // SAFETY: the caller's promise.
    let function = unsafe { library.get::<T>(symbol.as_bytes()) };
    function.map(|function| *function).map_err(|error| Error::file("use", path, error))
}

/// The functions of a library of this design, and a new network.
fn load(library: &Library, map: &Map, path: &Path, form: Form) -> Result<(Functions, *mut c_void), Error> {
    // SAFETY: the types are those of the header, `NAME.h`, in the version that is checked first; the hash is a constant
    // that ends with a zero.
    unsafe {
        let interface: extern "C" fn() -> i32 = function(library, map, "interface", path)?;
        if interface() != INTERFACE {
            let version = interface();
            return Err(Error::Foreign(format!("the library has interface {version}, this program needs {INTERFACE}")));
        }
        let hash: extern "C" fn() -> *const c_char = function(library, map, "hash", path)?;
        let found = CStr::from_ptr(hash()).to_string_lossy().into_owned();
        if found != map.hash {
            return Err(Error::WrongHash { expected: map.hash.clone(), found });
        }
        let functions = Functions {
            free: function(library, map, "free", path)?,
            reset: function(library, map, "reset", path)?,
            set_inputs: function(library, map, "set_inputs", path)?,
            step: function(library, map, "step", path)?,
            get_outputs: function(library, map, "get_outputs", path)?,
            get_state: function(library, map, "get_state", path)?,
            set_state: function(library, map, "set_state", path)?,
            flags: function(library, map, "flags", path)?,
            clear_flags: function(library, map, "clear_flags", path)?,
        };
        let new: extern "C" fn(i32) -> *mut c_void = function(library, map, "new", path)?;
        let network = new(form as i32);
        if network.is_null() {
            return Err(Error::Lacks("fast form"));
        }
        Ok((functions, network))
    }
}

impl Drop for Native {
    fn drop(&mut self) {
        // SAFETY: the network comes from the same library, and nobody else has it.
        unsafe { (self.functions.free)(self.network) }
    }
}

impl Engine for Native {
    fn reset(&mut self) -> Result<(), Error> {
        self.stepped = false;
        self.show_first();
        // SAFETY: as below: the network is alive, and slices are as long as they say.
        self.check(unsafe { (self.functions.reset)(self.network) })
    }

    fn write(&mut self, words: &[i64]) -> Result<(), Error> {
        count(self.map.inputs.len(), words.len())?;
        // SAFETY: see `reset`.
        self.check(unsafe { (self.functions.set_inputs)(self.network, words.as_ptr(), words.len()) })
    }

    fn run(&mut self, steps: u64) -> Result<Ran, Error> {
        if steps > 0 {
            (self.stepped, self.shown) = (true, None);
        }
        // SAFETY: see `reset`.
        self.check(unsafe { (self.functions.step)(self.network, steps) })?;
        Ok(Ran { steps, overruns: 0 })
    }

    fn read(&mut self, words: &mut [Option<i64>]) -> Result<(), Error> {
        count(self.map.outputs.len(), words.len())?;
        if let Some(shown) = &self.shown {
            words.copy_from_slice(shown);
            return Ok(());
        }
        // SAFETY: see `reset`.
        let code = unsafe { (self.functions.get_outputs)(self.network, self.outputs.as_mut_ptr(), self.outputs.len()) };
        self.check(code)?;
        let has_sample = |output: &pe_map::Output| self.stepped || output.state.is_some();
        for ((word, new), output) in words.iter_mut().zip(&self.outputs).zip(&self.map.outputs) {
            *word = has_sample(output).then_some(*new);
        }
        Ok(())
    }

    fn run_frames(&mut self, frames: usize, inputs: &[i64], outputs: &mut Vec<i64>) -> Result<Ran, Error> {
        let (ports, shown) = (self.map.inputs.len(), self.map.outputs.len());
        one_by_one(self, ports, shown, (frames, inputs, outputs))
    }

    fn state(&mut self, words: &mut [i64]) -> Result<(), Error> {
        count(self.map.state_words(), words.len())?;
        // SAFETY: see `reset`.
        self.check(unsafe { (self.functions.get_state)(self.network, words.as_mut_ptr(), words.len()) })
    }

    fn set_state(&mut self, words: &[i64]) -> Result<(), Error> {
        self.map.check_state(words)?;
        (self.stepped, self.shown) = (false, None);
        // SAFETY: see `reset`.
        self.check(unsafe { (self.functions.set_state)(self.network, words.as_ptr(), words.len()) })
    }

    fn set_parameters(&mut self, words: &[i64]) -> Result<(), Error> {
        self.map.check_parameters(words)?;
        let (mut shown, mut state) = (vec![None; self.map.outputs.len()], vec![0; self.map.state_words()]);
        self.read(&mut shown)?;
        self.state(&mut state)?;
        self.map.put_parameters(words, &mut state);
        self.set_state(&state)?;
        self.shown = Some(shown);
        Ok(())
    }

    fn flags(&mut self) -> Result<Flags, Error> {
        let mut bits = 0;
        // SAFETY: see `reset`.
        self.check(unsafe { (self.functions.flags)(self.network, &raw mut bits) })?;
        Ok(Flags::of_bits(bits))
    }

    fn clear_flags(&mut self) -> Result<(), Error> {
        // SAFETY: see `reset`.
        self.check(unsafe { (self.functions.clear_flags)(self.network) })
    }
}
