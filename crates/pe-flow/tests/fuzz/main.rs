//! Fuzz targets: spec text, stage texts, and program text.
//!
//! Each target begins with a corpus and damages it again and again. A text that is accepted, or refused for a reason
//! not seen before, joins the pool that is damaged further. Nothing depends on time or threads: a seed and a number of
//! texts give the same texts on every machine.
//!
//! `PE_FUZZ_COUNT` is the number of texts of a target, `PE_FUZZ_SEED` the seed. A text that fails is kept in
//! `target/tmp/fuzz`; once mended, it belongs into `tests/fuzz/corpus`.

mod damage;
mod targets;

use std::collections::HashSet;
use std::fmt::Debug;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use self::damage::Damage;

/// What a target says about a text: the reason why it was refused, or none if it was accepted.
type Verdict = Option<String>;

/// Processor time that one text may take, even unoptimised.
const LONGEST: Duration = Duration::from_secs(2);

/// After this wall time without a new text, a target hangs.
const HANGS: Duration = Duration::from_secs(120);

/// Address space of the process: far more than any text here needs.
#[cfg(target_os = "linux")]
const LARGEST_MEMORY: u64 = 4 << 30;

/// Texts of a pool, at most. Later ones take the places of earlier ones that are not of the corpus.
const POOL: usize = 3000;

/// Bytes of a text, at most.
const LARGEST_TEXT: usize = 20_000;

#[test]
fn spec_text() {
    let corpus = ["tests/fuzz/corpus/spec", "../pe-frontend/tests/passes", "../../models"];
    fuzz("spec", &corpus.map(|folder| (folder, "spec")), 12_000, |text, _| targets::spec(text));
}

#[test]
fn stage_texts() {
    let corpus = ["tests/fuzz/corpus/stages", "../pe-hls/tests/passes"];
    fuzz("stages", &corpus.map(|folder| (folder, "txt")), 20_000, targets::stages);
}

#[test]
fn program_text() {
    let (fold, assemble) = ("../pe-hls/tests/passes/fold", "../pe-hls/tests/passes/assemble");
    let corpus = [("tests/fuzz/corpus/program", "txt"), (fold, "txt"), (assemble, "expect")];
    fuzz("program", &corpus, 50_000, |text, _| targets::program(text));
}

/// All files below a folder of this crate with that extension, in the order of their paths.
fn files(folder: &str, extension: &str) -> Vec<String> {
    let mut waiting = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)];
    let mut found: Vec<PathBuf> = Vec::new();
    while let Some(next) = waiting.pop() {
        for entry in fs::read_dir(&next).unwrap_or_else(|error| panic!("{}: {error}", next.display())) {
            let path = entry.unwrap().path();
            if path.is_dir() {
                waiting.push(path);
            } else if path.extension().is_some_and(|found| found == extension) {
                found.push(path);
            }
        }
    }
    found.sort();
    let texts = found.iter().map(|path| fs::read_to_string(path).unwrap());
    texts.filter(|text| text.len() <= LARGEST_TEXT).collect()
}

fn setting<T: FromStr<Err: Debug>>(name: &str, default: T) -> T {
    std::env::var(name).map_or(default, |text| text.parse().unwrap_or_else(|error| panic!("{name}={text}: {error:?}")))
}

/// Runs a target on its corpus, folders with the extensions of their files, then on as many damaged texts.
fn fuzz(
    target: &'static str,
    corpus: &[(&str, &str)],
    count: usize,
    check: impl Fn(&str, &Path) -> Verdict + Send + 'static,
) {
    limit_memory();
    let corpus: Vec<String> = corpus.iter().flat_map(|(folder, extension)| files(folder, extension)).collect();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("fuzz");
    fs::create_dir_all(&folder).unwrap();
    let (count, seed) = (setting("PE_FUZZ_COUNT", count), setting("PE_FUZZ_SEED", 1));
    let running = folder.join(format!("{target}-running.txt"));
    assert!(!corpus.is_empty(), "no corpus for {target}");
    let done = Arc::new(AtomicUsize::new(0));
    let beats = Arc::clone(&done);
    let path = running.clone();
    let worker = std::thread::spawn(move || {
        let mut campaign = Campaign { target, folder, path, check, reasons: HashSet::new(), accepted: 0 };
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        let damage = Damage::of(&corpus);
        for text in &corpus {
            campaign.run(text);
            beats.fetch_add(1, Ordering::Relaxed);
        }
        let whole = campaign.accepted;
        let (kept, mut pool) = (corpus.len(), corpus);
        for number in 0..count {
            let from = &pool[generator.random_range(0..pool.len())];
            let mut text = from.clone();
            for _ in 0..[1, 1, 1, 1, 2, 2, 3, 5][number % 8] {
                text = damage.once(&text, &mut generator);
            }
            if text.len() <= LARGEST_TEXT && campaign.run(&text) {
                if pool.len() < POOL {
                    pool.push(text);
                } else {
                    pool[generator.random_range(kept..POOL)] = text;
                }
            }
            beats.fetch_add(1, Ordering::Relaxed);
        }
        let Campaign { accepted, reasons, .. } = campaign;
        println!(
            "{target}: {kept} texts of the corpus, {whole} accepted; {count} damaged, {} accepted, {} reasons",
            accepted - whole,
            reasons.len()
        );
    });
    let (mut last, mut since) = (0, Instant::now());
    while !worker.is_finished() {
        std::thread::sleep(Duration::from_millis(100));
        let now = done.load(Ordering::Relaxed);
        if now != last {
            (last, since) = (now, Instant::now());
        }
        assert!(since.elapsed() < HANGS, "text {now} takes more than {HANGS:?}: {}", running.display());
    }
    worker.join().unwrap_or_else(|_| panic!("{target}: see above"));
    fs::remove_file(running).unwrap();
}

struct Campaign<C> {
    target: &'static str,
    folder: PathBuf,
    /// The text that is being checked: it stays if the process is ended.
    path: PathBuf,
    check: C,
    reasons: HashSet<String>,
    accepted: usize,
}

impl<C: Fn(&str, &Path) -> Verdict> Campaign<C> {
    /// Checks a text; gives whether it is worth to be damaged further.
    fn run(&mut self, text: &str) -> bool {
        fs::write(&self.path, text).unwrap();
        let begin = processor_time();
        let verdict = catch_unwind(AssertUnwindSafe(|| (self.check)(text, &self.path)));
        let taken = processor_time().saturating_sub(begin);
        let Ok(verdict) = verdict else { self.fail(text, "see above") };
        if taken > LONGEST {
            self.fail(text, &format!("it takes {taken:?}"));
        }
        match verdict {
            None => {
                self.accepted += 1;
                true
            }
            Some(reason) => self.reasons.insert(shape(&reason)),
        }
    }

    fn fail(&self, text: &str, why: &str) -> ! {
        let path = self.folder.join(format!("{}-failed.txt", self.target));
        fs::write(&path, text).unwrap();
        panic!("{}: {why}", path.display());
    }
}

/// A message without the names and numbers that it quotes.
fn shape(message: &str) -> String {
    let kept = message.split('`').step_by(2).collect::<Vec<_>>().join("`");
    kept.chars().filter(|c| !c.is_ascii_digit()).collect()
}

/// Processor time of this thread.
#[cfg(target_os = "linux")]
fn processor_time() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::new(u64::try_from(time.tv_sec).unwrap(), u32::try_from(time.tv_nsec).unwrap())
}

/// Without a clock of the thread, only hanging is noticed.
#[cfg(not(target_os = "linux"))]
fn processor_time() -> Duration {
    Duration::ZERO
}

/// Memory beyond the limit ends the process; what asked for it stays in its file.
#[cfg(target_os = "linux")]
fn limit_memory() {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let Rlimit { maximum, .. } = getrlimit(Resource::As);
    let current = Some(maximum.map_or(LARGEST_MEMORY, |maximum| maximum.min(LARGEST_MEMORY)));
    setrlimit(Resource::As, Rlimit { current, maximum }).unwrap();
}

#[cfg(not(target_os = "linux"))]
fn limit_memory() {}
