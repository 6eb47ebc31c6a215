//! A design's folder, as a host sees it.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use pe_ir::program::Program;
use pe_map::{Map, Output, Parameter};

use crate::error::Error;

/// A design's folder, with its map.
#[derive(Clone, Debug)]
pub struct Design {
    folder: PathBuf,
    map: Arc<Map>,
}

impl Design {
    /// Reads the map of a folder that `compile` wrote.
    ///
    /// # Errors
    /// [`Error::File`] if there is none, or several, or it is damaged.
    pub fn open(folder: &Path) -> Result<Design, Error> {
        let entries = fs::read_dir(folder).map_err(|error| Error::file("read", folder, error))?;
        let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        let maps: Vec<String> = names.filter(|name| name.ends_with("_map.json")).collect();
        let [name] = &maps[..] else {
            let what = format!("it holds {} files `*_map.json`, not one: run `pe-synth compile` first", maps.len());
            return Err(Error::file("use", folder, what));
        };
        let path = folder.join(name);
        let text = fs::read_to_string(&path).map_err(|error| Error::file("read", &path, error))?;
        let map = Map::read(&text).map_err(|fault| Error::file("read", &path, fault))?;
        Ok(Design { folder: folder.to_owned(), map: Arc::new(map) })
    }

    /// A design of which nothing but the map is needed.
    pub fn of(map: Map) -> Design {
        Design { folder: PathBuf::new(), map: Arc::new(map) }
    }

    /// The map.
    pub fn map(&self) -> &Map {
        &self.map
    }

    /// The map, shared.
    pub(crate) fn shared_map(&self) -> Arc<Map> {
        Arc::clone(&self.map)
    }

    /// Path of `NAME_kind`.
    pub fn file(&self, kind: &str) -> PathBuf {
        self.folder.join(format!("{}_{kind}", self.map.entity))
    }

    /// The program.
    ///
    /// # Errors
    /// [`Error::File`], or [`Error::WrongHash`] if it is not the map's.
    pub fn program(&self) -> Result<Program, Error> {
        let path = self.file("program.txt");
        let text = fs::read_to_string(&path).map_err(|error| Error::file("read", &path, error))?;
        let found = pe_map::sha256(format!("{}\n{text}", self.map.generator).as_bytes());
        if found != self.map.hash {
            return Err(Error::WrongHash { expected: self.map.hash.clone(), found });
        }
        text.parse().map_err(|error| Error::file("read", &path, error))
    }
}

/// What a map says of state words.
pub(crate) trait States {
    /// Number of state words.
    fn state_words(&self) -> usize;

    /// The state words of the initial state.
    fn initial_state(&self) -> Vec<i64>;

    /// That words are state words.
    fn check_state(&self, words: &[i64]) -> Result<(), Error>;

    /// Words of the outputs that show a state, with these state words.
    fn shown(&self, words: &[i64], outputs: &mut [Option<i64>]);

    /// Words of the outputs in the initial state.
    fn first(&self, outputs: &mut [Option<i64>]);

    /// That words are stored words of the parameters.
    fn check_parameters(&self, words: &[i64]) -> Result<(), Error>;

    /// Stored words of the parameters among these state words.
    fn parameters_of(&self, state: &[i64]) -> Vec<i64>;

    /// Puts them there.
    fn put_parameters(&self, words: &[i64], state: &mut [i64]);
}

/// Place of a parameter among the state words.
fn place(parameter: &Parameter) -> usize {
    usize::try_from(parameter.state).unwrap_or(usize::MAX)
}

impl States for Map {
    fn state_words(&self) -> usize {
        self.states.len() + self.ticks.len()
    }

    fn initial_state(&self) -> Vec<i64> {
        let states = self.states.iter().map(|state| state.initial);
        states.chain(self.ticks.iter().map(|tick| i64::from(tick.done % tick.steps))).collect()
    }

    fn check_state(&self, words: &[i64]) -> Result<(), Error> {
        count(self.state_words(), words.len())?;
        let (states, ticks) = words.split_at(self.states.len());
        for (state, word) in self.states.iter().zip(states) {
            let [least, most] = state.format.words();
            if !(least..=most).contains(word) {
                return Err(Error::Range(state.name.clone()));
            }
        }
        match self.ticks.iter().zip(ticks).find(|(tick, word)| !(0..i64::from(tick.steps)).contains(word)) {
            Some((tick, _)) => Err(Error::Range(tick.name.clone())),
            None => Ok(()),
        }
    }

    fn shown(&self, words: &[i64], outputs: &mut [Option<i64>]) {
        let word = |output: &Output| {
            let state = usize::try_from(output.state?).ok()?;
            Some(output.shown(self.states.get(state)?, words[state]))
        };
        outputs.iter_mut().zip(&self.outputs).for_each(|(shown, output)| *shown = word(output));
    }

    fn first(&self, outputs: &mut [Option<i64>]) {
        outputs.iter_mut().zip(&self.outputs).for_each(|(shown, output)| *shown = self.sample_0(output));
    }

    fn check_parameters(&self, words: &[i64]) -> Result<(), Error> {
        if self.parameters.is_empty() && !words.is_empty() {
            return Err(Error::Lacks("parameters that are written at run time"));
        }
        count(self.parameters.len(), words.len())?;
        let fits = |parameter: &Parameter, word: &i64| {
            self.states.get(place(parameter)).is_some_and(|state| {
                let [least, most] = state.format.words();
                (least..=most).contains(word)
            })
        };
        match self.parameters.iter().zip(words).find(|(parameter, word)| !fits(parameter, word)) {
            Some((parameter, _)) => Err(Error::Range(parameter.name.clone())),
            None => Ok(()),
        }
    }

    fn parameters_of(&self, state: &[i64]) -> Vec<i64> {
        self.parameters.iter().map(|parameter| state.get(place(parameter)).copied().unwrap_or(0)).collect()
    }

    fn put_parameters(&self, words: &[i64], state: &mut [i64]) {
        for (parameter, word) in self.parameters.iter().zip(words) {
            if let Some(own) = state.get_mut(place(parameter)) {
                *own = *word;
            }
        }
    }
}

/// That as many are given as needed.
pub(crate) fn count(needed: usize, given: usize) -> Result<(), Error> {
    if needed == given { Ok(()) } else { Err(Error::Count { needed, given }) }
}
