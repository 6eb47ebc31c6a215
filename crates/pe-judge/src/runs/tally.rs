//! Events counted: what a model is judged by whose trajectories part, as those of networks of spiking neurons do.
//!
//! States that have a name but for their indices are a family. A run is held against another one by the numbers of jumps
//! in each family, over the span and in windows of it, and by the mean and the deviation of all states of a family: what no
//! event depends on has to be right as well. When events fall is told, and does not decide.

use pe_ir::codes;
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;

/// Part of its jumps by which the number of a family over the span may differ, and part from which on that is told.
const REFUSED: f64 = 0.1;
const WARNED: f64 = 0.02;

/// Part of the mean number in a window by which that in a window may differ: three and a half standard deviations of what two
/// numbers of independent events differ by in the smallest windows.
const WINDOW_REFUSED: f64 = 0.5;

/// Windows of a span, at most, and jumps that they have in the mean at least.
const WINDOWS: u64 = 10;
const FILLED: u64 = 100;

/// States with one name but for their indices.
#[derive(Clone, Debug, PartialEq)]
pub struct Family {
    /// The name.
    pub name: String,
    /// The states.
    pub states: Vec<StateId>,
    /// Largest magnitude of them.
    scale: f64,
}

/// What is kept of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Record {
    /// Number of the step, beginning with 1, and state of every jump.
    jumps: Vec<(u64, StateId)>,
    /// Of each family mean and standard deviation of its states at all steps; empty where these are not known.
    levels: Vec<(f64, f64)>,
}

/// How far a run is from another one.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// Time in seconds of the first jump that falls in another step or is missing; none if there is no such.
    pub apart: Option<f64>,
    /// Largest difference of the numbers of jumps over the span, as a part of the first run's.
    pub total: Part,
    /// The same of the numbers in a window, as a part of the mean number in windows; and where that begins and ends in
    /// seconds.
    pub window: (Part, f64, f64),
    /// The state whose numbers of jumps differ most, and these numbers.
    pub single: Option<(StateId, u64, u64)>,
    /// Largest difference of mean or deviation, as a part of the largest magnitude; none where these are not known.
    pub level: Option<Part>,
}

/// A difference, and the family that has it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Part {
    /// The difference.
    pub part: f64,
    /// Number of the family.
    pub family: usize,
    /// What it is made of: that of the first run, and that of the other.
    pub of: (f64, f64),
}

/// The runs of a design, counted.
#[derive(Clone, Debug)]
pub struct Tally {
    /// All families.
    pub families: Vec<Family>,
    /// Family of each state; none of states that stand for signals and of angles.
    of_state: Vec<Option<usize>>,
    /// Times of the ends of steps in seconds, that of the beginning first.
    ends: Vec<f64>,
    /// The step in double precision.
    pub double: Record,
    /// The step in fixed point.
    pub fixed: Record,
    /// Half the step in double precision.
    pub halved: Record,
    /// The step in double precision, with all initial values changed by one bit of the stored words.
    pub disturbed: Record,
}

/// What is to be said of a difference.
struct Told {
    message: String,
    /// Whether it is too large.
    refused: bool,
    /// Whether it is one of numbers of events, and not of means.
    numbers: bool,
}

/// The name of a state without its indices.
fn family_name(name: &str) -> String {
    let (mut depth, mut family) = (0, String::new());
    for letter in name.chars() {
        match letter {
            '[' => depth += 1,
            ']' => depth -= 1,
            _ if depth == 0 => family.push(letter),
            _ => {}
        }
    }
    family
}

/// Families of a model whose states have such largest magnitudes, and that of each state.
pub(super) fn families(model: &Model, scales: &[f64]) -> (Vec<Family>, Vec<Option<usize>>) {
    let mut families: Vec<Family> = Vec::new();
    let mut of_state = Vec::new();
    let mut known = std::collections::BTreeMap::new();
    for (id, state) in model.states.numbered() {
        if state.motion.is_some() || state.angle {
            of_state.push(None);
            continue;
        }
        let name = family_name(&state.name);
        let number = *known.entry(name.clone()).or_insert_with(|| {
            families.push(Family { name, states: Vec::new(), scale: 0.0 });
            families.len() - 1
        });
        let family = &mut families[number];
        family.states.push(id);
        family.scale = family.scale.max(scales[id.index()]);
        of_state.push(Some(number));
    }
    (families, of_state)
}

/// Keeps a record while a run goes on.
pub(super) struct Recorder<'a> {
    of_state: &'a [Option<usize>],
    jumps: Vec<(u64, StateId)>,
    /// Of each family the first number, which others are counted from, the sum of all and that of their squares.
    sums: Vec<Option<(f64, f64, f64)>>,
    steps: u64,
}

impl<'a> Recorder<'a> {
    pub fn new(families: usize, of_state: &'a [Option<usize>]) -> Recorder<'a> {
        Recorder { of_state, jumps: Vec::new(), sums: vec![None; families], steps: 0 }
    }

    /// Jumps in a step; those of states without a family do not count.
    pub fn jumped(&mut self, step: u64, jumped: impl Iterator<Item = StateId>) {
        let of_state = self.of_state;
        self.jumps.extend(jumped.filter(|state| of_state[state.index()].is_some()).map(|state| (step, state)));
    }

    /// States at the end of a step.
    pub fn ended(&mut self, states: impl Iterator<Item = f64>) {
        self.steps += 1;
        for (number, family) in states.zip(self.of_state) {
            let Some(family) = family else { continue };
            let (first, sum, squares) = self.sums[*family].get_or_insert((number, 0.0, 0.0));
            let number = number - *first;
            (*sum, *squares) = (*sum + number, *squares + number * number);
        }
    }

    pub fn record(self, families: &[Family]) -> Record {
        let level = |(sums, family): (Option<(f64, f64, f64)>, &Family)| {
            let count = (self.steps * family.states.len() as u64).max(1) as f64;
            let (first, sum, squares) = sums.unwrap_or_default();
            let mean = sum / count;
            (first + mean, libm::sqrt((squares / count - mean * mean).max(0.0)))
        };
        let levels = self.sums.into_iter().zip(families).map(level).collect();
        Record { jumps: self.jumps, levels }
    }
}

impl Tally {
    pub(super) fn new(
        (families, of_state): (Vec<Family>, Vec<Option<usize>>),
        model: &Model,
        [double, fixed, halved, disturbed]: [Record; 4],
    ) -> Tally {
        let ends = (0..=model.steps()).map(|step| model.time(step, 0.0)).collect();
        Tally { families, of_state, ends, double, fixed, halved, disturbed }
    }

    /// The record of a solution whose states jump at such times: they fall in the steps that end there or behind.
    pub fn of_solution(&self, jumps: &[(f64, StateId)]) -> Record {
        let slack = |end: f64| 1e-9 * end.abs().max(self.ends[1]);
        let step = |time: f64| self.ends.partition_point(|end| end + slack(*end) < time) as u64;
        let counts = |state: &StateId| self.of_state[state.index()].is_some();
        let jumps = jumps.iter().filter(|(_, state)| counts(state)).map(|(time, state)| (step(*time), *state));
        Record { jumps: jumps.collect(), levels: Vec::new() }
    }

    /// Families that jump in a run.
    fn jumping(&self, record: &Record) -> Vec<bool> {
        let mut jumping = vec![false; self.families.len()];
        record.jumps.iter().filter_map(|(_, state)| self.of_state[state.index()]).for_each(|of| jumping[of] = true);
        jumping
    }

    /// Jumps of a family in a run.
    pub fn count(&self, record: &Record, family: usize) -> u64 {
        record.jumps.iter().filter(|(_, state)| self.of_state[state.index()] == Some(family)).count() as u64
    }

    /// How far a run is from another one. Of a solution only families count that jump in it: what a refined event corrects
    /// jumps in runs alone.
    pub fn difference(&self, own: &Record, other: &Record) -> Difference {
        let jumping = self.jumping(own);
        let counts =
            |state: StateId| self.of_state[state.index()].filter(|family| jumping[*family] || !own.levels.is_empty());
        let sorted = |record: &Record| {
            let mut jumps = record.jumps.clone();
            jumps.retain(|(_, state)| counts(*state).is_some());
            jumps.sort_unstable();
            jumps
        };
        let (first, second) = (sorted(own), sorted(other));
        let same = first.iter().zip(&second).take_while(|(one, other)| one == other).count();
        let apart = [&first, &second].into_iter().filter_map(|jumps| jumps.get(same)).map(|(step, _)| *step).min();
        let mut difference = Difference {
            apart: apart.map(|step| self.end(step)),
            total: Part::default(),
            window: (Part::default(), 0.0, self.end(u64::MAX)),
            single: None,
            level: None,
        };
        let mut by_state = vec![(0u64, 0u64); self.of_state.len()];
        first.iter().for_each(|(_, state)| by_state[state.index()].0 += 1);
        second.iter().for_each(|(_, state)| by_state[state.index()].1 += 1);
        let single =
            by_state.iter().enumerate().max_by_key(|(index, (one, other))| (one.abs_diff(*other), usize::MAX - index));
        difference.single = single.map(|(index, (one, other))| (StateId::at(index), *one, *other));
        let steps = self.ends.len() as u64 - 1;
        for family in 0..self.families.len() {
            let of = |jumps: &[(u64, StateId)]| -> Vec<u64> {
                jumps.iter().filter(|(_, state)| counts(*state) == Some(family)).map(|(step, _)| *step).collect()
            };
            let (one, other) = (of(&first), of(&second));
            difference.total.include(family, (one.len() as f64, other.len() as f64), one.len() as f64);
            let windows = (one.len() as u64 / FILLED).clamp(1, WINDOWS);
            let window = |step: &u64| (step.saturating_sub(1) * windows / steps.max(1)).min(windows - 1);
            for number in 0..windows {
                let within = |jumps: &[u64]| jumps.iter().filter(|step| window(step) == number).count() as f64;
                let counted = (within(&one), within(&other));
                if difference.window.0.include(family, counted, one.len() as f64 / windows as f64) {
                    let bound = |number: u64| self.end((number * steps).div_ceil(windows));
                    (difference.window.1, difference.window.2) = (bound(number), bound(number + 1));
                }
            }
        }
        let levels = own.levels.iter().zip(&other.levels).zip(&self.families).enumerate();
        for (family, (((mean, deviation), (other_mean, other_deviation)), Family { scale, .. })) in levels {
            let level = difference.level.get_or_insert_with(Part::default);
            level.include(family, (*mean, *other_mean), *scale);
            level.include(family, (*deviation, *other_deviation), *scale);
        }
        difference
    }

    fn end(&self, step: u64) -> f64 {
        let last = self.ends.len() - 1;
        self.ends[usize::try_from(step).map_or(last, |step| step.min(last))]
    }

    /// Differences of the runs from the step in double precision: in fixed point, with half the step, with initial values that
    /// are changed.
    pub fn differences(&self) -> [Difference; 3] {
        [&self.fixed, &self.halved, &self.disturbed].map(|other| self.difference(&self.double, other))
    }

    /// What is to be said.
    ///
    /// # Errors
    /// `E0931` no events, `E0932` other numbers of them.
    pub(super) fn findings(&self, model: &Model) -> (Vec<Diagnostic>, Vec<Diagnostic>) {
        if self.double.jumps.is_empty() {
            let message = format!("there is nothing to count: no event comes within the span of {} s", model.span);
            let help = "leave `--judge events` out, or take a longer `--span`";
            return (vec![Diagnostic::global(codes::NO_EVENTS, message).with_help(help)], Vec::new());
        }
        let (mut refusals, mut warnings) = (Vec::new(), Vec::new());
        let [fixed, halved, disturbed] = &self.differences();
        let chance = "the numbers of events over this span are chance: take a longer `--span`";
        let step = format!("try `--step {:.3e}`", model.step / 2.0);
        let told = [
            (disturbed, "with initial values that differ by one bit", chance),
            (halved, "with half the step", &*step),
            (fixed, "in fixed point", "try more `--storage` bits or a wider `--multiplier`"),
        ];
        for (difference, how, help) in told {
            let Some(Told { message, refused, numbers }) = self.tell(difference, how) else { continue };
            let help = if numbers {
                help
            } else {
                "narrow stated ranges, or take more `--storage` bits or a wider `--multiplier`"
            };
            let finding = Diagnostic::global(codes::EVENTS_DIFFER, message).with_help(help);
            // Where chance decides the numbers nothing else can be told by them.
            if refused {
                refusals.push(finding);
                break;
            }
            warnings.push(Diagnostic { code: codes::EVENTS_APART, ..finding.into_warning() });
        }
        warnings.extend(self.parted([fixed, halved, disturbed]));
        (refusals, warnings)
    }

    /// That trajectories part, and what was judged in their place.
    fn parted(&self, differences: [&Difference; 3]) -> Option<Diagnostic> {
        if differences.iter().all(|difference| difference.apart.is_none()) {
            return None;
        }
        let until = differences.map(|difference| match difference.apart {
            Some(time) => format!("until t = {time:.3e} s"),
            None => "over the whole span".to_owned(),
        });
        let [fixed, halved, disturbed] = differences.map(|difference| 100.0 * difference.total.part);
        let message = format!(
            "judged by events: they fall in the same steps as in double precision {} in fixed point, {} with half the step and {} \
             with initial values that differ by one bit; their numbers over the span differ by {fixed:.2} %, {halved:.2} % and \
             {disturbed:.2} %",
            until[0], until[1], until[2]
        );
        let help = "trust single events up to then, and behind it averages alone";
        Some(Diagnostic::global(codes::BY_EVENTS, message).with_help(help).into_warning())
    }

    /// A difference that is worth a word.
    fn tell(&self, difference: &Difference, how: &str) -> Option<Told> {
        let Difference { total, window: (window, from, to), level, .. } = difference;
        let level = level.clone().unwrap_or_default();
        let name = |part: &Part| &self.families[part.family].name;
        let all = [
            (total.part, REFUSED, WARNED),
            (window.part, WINDOW_REFUSED, WINDOW_REFUSED),
            (level.part, REFUSED, WARNED),
        ];
        let parts = all.map(|(part, refused, _)| part / refused);
        let worst = (0..parts.len()).max_by(|a, b| parts[*a].total_cmp(&parts[*b]).then(b.cmp(a)))?;
        let refused = parts[worst] > 1.0;
        let warned = if refused { worst } else { (0..parts.len()).find(|part| all[*part].0 > all[*part].2)? };
        let message = match warned {
            0 => format!(
                "`{}` jumps {} times in double precision and {} times {how}",
                name(total),
                total.of.0,
                total.of.1
            ),
            1 => format!(
                "from t = {from:.3e} s to {to:.3e} s `{}` jumps {} times in double precision and {} times {how}",
                name(window),
                window.of.0,
                window.of.1
            ),
            _ => format!(
                "mean or deviation of `{}` over the span is {:.3e} in double precision and {:.3e} {how}, {:.1} % of its largest magnitude \
                 apart",
                name(&level),
                level.of.0,
                level.of.1,
                100.0 * level.part
            ),
        };
        Some(Told { message, refused, numbers: warned < 2 })
    }
}

impl Part {
    /// Takes a difference in if it is larger; `whole` is what it is a part of.
    fn include(&mut self, family: usize, of: (f64, f64), whole: f64) -> bool {
        let difference = (of.0 - of.1).abs();
        // What is none in one run is all in the other. What is not finite is as wrong as can be.
        let part = if difference == 0.0 { 0.0 } else { difference / whole };
        let part = if part.is_nan() { f64::INFINITY } else { part };
        // Where nothing differs, that of which there is most is told.
        let larger = part > self.part || (part == self.part && of.0 > self.of.0);
        if larger {
            *self = Part { part, family, of };
        }
        larger
    }
}

#[cfg(test)]
mod tests {
    use pe_ir::model::Solver;

    use super::*;

    /// Two families of two states, `v` and `w`, and 1,000 steps of 1 ms.
    fn tally(double: Record, fixed: Record) -> Tally {
        let family = |name: &str, first: usize| Family {
            name: name.to_owned(),
            states: vec![StateId::at(first), StateId::at(first + 1)],
            scale: 10.0,
        };
        Tally {
            families: vec![family("v", 0), family("w", 2)],
            of_state: vec![Some(0), Some(0), Some(1), Some(1)],
            ends: (0..=1000).map(|step| f64::from(step) * 1e-3).collect(),
            halved: double.clone(),
            disturbed: double.clone(),
            double,
            fixed,
        }
    }

    /// `v[1]` jumps at every step that `jumps` says.
    fn record(jumps: impl Fn(u64) -> bool) -> Record {
        let jumps = (1..=1000).filter(|step| jumps(*step)).map(|step| (step, StateId::at(0))).collect();
        Record { jumps, levels: vec![(1.0, 2.0), (3.0, 0.0)] }
    }

    fn codes(tally: &Tally) -> Vec<&'static str> {
        let (refused, warned) = tally.findings(&Model::new("counted", Solver::Euler, 1e-3, 1.0));
        refused.into_iter().chain(warned).map(|finding| finding.code).collect()
    }

    #[test]
    fn names_lose_their_indices() {
        assert_eq!(["v[3]", "cell[3].v", "a[1][i[2]].b", "u"].map(family_name), ["v", "cell.v", "a.b", "u"]);
    }

    #[test]
    fn what_is_the_same_gives_no_finding_and_what_shifts_is_told() {
        let every = |phase: u64| record(move |step| step % 2 == phase);
        assert!(codes(&tally(every(0), every(0))).is_empty());
        let shifted = tally(every(0), every(1));
        assert_eq!(codes(&shifted), [codes::BY_EVENTS]);
        let difference = &shifted.differences()[0];
        assert_eq!((difference.apart, difference.total.part, difference.total.of), (Some(1e-3), 0.0, (500.0, 500.0)));
    }

    #[test]
    fn another_number_of_events_is_refused() {
        let own = record(|step| step % 2 == 0);
        let few = |missing: u64| record(move |step| step % 2 == 0 && step > 2 * missing);
        assert_eq!(codes(&tally(own.clone(), few(5))), [codes::BY_EVENTS]);
        assert_eq!(codes(&tally(own.clone(), few(20))), [codes::EVENTS_APART, codes::BY_EVENTS]);
        assert_eq!(codes(&tally(own.clone(), few(60)))[0], codes::EVENTS_DIFFER);
        assert_eq!(codes(&tally(own.clone(), few(500)))[0], codes::EVENTS_DIFFER);
        assert_eq!(codes(&tally(few(500), own))[0], codes::NO_EVENTS);
    }

    #[test]
    fn the_same_number_at_other_times_is_refused() {
        let early = record(|step| step % 4 == 0 || (step < 500 && step % 4 == 2));
        let late = record(|step| step % 4 == 0 || (step >= 500 && step % 4 == 2));
        assert_eq!(early.jumps.len(), late.jumps.len());
        let found = tally(early, late);
        let (part, from, _) = &found.differences()[0].window;
        assert!(part.part > WINDOW_REFUSED && *from < 0.5, "{part:?}");
        assert_eq!(codes(&found)[0], codes::EVENTS_DIFFER);
    }

    #[test]
    fn events_of_a_family_that_has_none_are_refused() {
        let own = record(|step| step % 2 == 0);
        let mut more = own.clone();
        more.jumps.push((1000, StateId::at(3)));
        assert_eq!(codes(&tally(own, more))[0], codes::EVENTS_DIFFER);
    }

    #[test]
    fn states_that_no_event_depends_on_have_to_be_right() {
        let own = record(|step| step % 2 == 0);
        let other = |levels: [(f64, f64); 2]| Record { levels: levels.to_vec(), ..own.clone() };
        assert_eq!(codes(&tally(own.clone(), other([(1.0, 2.1), (3.0, 0.1)]))), [""; 0]);
        assert_eq!(codes(&tally(own.clone(), other([(1.0, 2.0), (3.5, 0.0)]))), [codes::EVENTS_APART]);
        assert_eq!(codes(&tally(own.clone(), other([(1.0, 0.5), (3.0, 0.0)]))), [codes::EVENTS_DIFFER]);
        assert_eq!(codes(&tally(own.clone(), other([(f64::NAN, 2.0), (3.0, 0.0)]))), [codes::EVENTS_DIFFER]);
    }

    #[test]
    fn chance_is_told_before_all_else() {
        let own = record(|step| step % 2 == 0);
        let wrong = record(|step| step % 4 == 0);
        let tally = Tally { disturbed: wrong.clone(), ..tally(own, wrong) };
        let (refused, _) = tally.findings(&Model::new("counted", Solver::Euler, 1e-3, 1.0));
        assert!(refused.len() == 1 && refused[0].message.contains("one bit"), "{refused:?}");
    }
}
