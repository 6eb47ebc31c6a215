//! What a design is wanted to be: limits that it has to keep, and the figure that is to be small. Ranks the rows that keep
//! them, and says of the others what they would take.

use pe_target::devices::Device;

use super::goal::errors;
use crate::explore::row::Row;
use crate::report::Figures;

/// Figures this close count as equal; then another one decides.
const EQUAL: f64 = 1.02;

/// Total error that a design may have unless more or less is asked for.
pub const USUAL_ERROR: f64 = 0.01;

/// Points told that miss a limit.
const NEAREST: usize = 3;

/// A figure that is to be small.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Figure {
    /// Run time, then size.
    #[default]
    Time,
    /// Size, then run time.
    Area,
    /// Total error, then run time.
    Error,
}

impl Figure {
    /// All of them.
    pub const ALL: [Figure; 3] = [Figure::Area, Figure::Time, Figure::Error];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Figure::Time => "time",
            Figure::Area => "area",
            Figure::Error => "error",
        }
    }

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Figure::Time => "run time",
            Figure::Area => "size",
            Figure::Error => "error",
        }
    }

    /// What it is, in a line of help.
    pub fn title(self) -> &'static str {
        match self {
            Figure::Time => "Run time, then size",
            Figure::Area => "Size, then run time",
            Figure::Error => "Total error, then run time",
        }
    }

    fn of(self, figures: &Figures) -> (f64, f64) {
        let (time, size) = (figures.time_ms(), figures.equivalent_lut());
        match self {
            Figure::Time => (time, size),
            Figure::Area => (size, time),
            Figure::Error => (figures.total_error().unwrap_or(f64::INFINITY), time),
        }
    }
}

/// A limit of [`Goals`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// The total error.
    Error,
    /// Simulated time over run time.
    RealTime,
    /// The device's resources.
    Fit,
}

impl Limit {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Limit::Error => "the error",
            Limit::RealTime => "real time",
            Limit::Fit => "the device",
        }
    }
}

/// Limits that a design has to keep, and the figure that is to be small.
#[derive(Clone, Copy, Debug, Default)]
pub struct Goals {
    /// Largest total error.
    pub max_error: Option<f64>,
    /// Simulated time over run time, at least.
    pub realtime: Option<f64>,
    /// The device that has to be large enough.
    pub fit: Option<&'static Device>,
    /// What is to be small.
    pub minimise: Figure,
}

/// A row that misses limits, by the largest factor of all.
#[derive(Clone, Debug, PartialEq)]
pub struct Miss {
    /// Its place among the rows.
    pub row: usize,
    /// The limits that it misses, each with the factor.
    pub limits: Vec<(Limit, f64)>,
}

impl Goals {
    /// A total error alone, by the shortest run time.
    pub fn error(max_error: f64) -> Goals {
        Goals { max_error: Some(max_error), ..Goals::default() }
    }

    /// Whether more is asked for than a total error at the shortest run time: then the number of PEs counts.
    pub fn concern_size(&self) -> bool {
        self.realtime.is_some() || self.fit.is_some() || self.minimise == Figure::Area
    }

    /// Whether there are goals beside a total error at the shortest run time.
    pub fn concern_others(&self) -> bool {
        self.concern_size() || self.minimise != Figure::Time
    }

    /// The limits.
    pub fn limits(&self) -> impl Iterator<Item = Limit> + use<> {
        let given = [self.max_error.is_some(), self.realtime.is_some(), self.fit.is_some()];
        [Limit::Error, Limit::RealTime, Limit::Fit]
            .into_iter()
            .zip(given)
            .filter_map(|(limit, given)| given.then_some(limit))
    }

    /// The same without one of them.
    fn without(self, limit: Limit) -> Goals {
        match limit {
            Limit::Error => Goals { max_error: None, ..self },
            Limit::RealTime => Goals { realtime: None, ..self },
            Limit::Fit => Goals { fit: None, ..self },
        }
    }

    /// The factor by which a row misses a limit; at most 1 if it keeps it, infinite if that is not known.
    fn excess(&self, limit: Limit, row: &Row) -> f64 {
        let of = |excess: fn(&Goals, &Figures) -> Option<f64>| {
            row.figures().and_then(|figures| excess(self, figures)).unwrap_or(f64::INFINITY)
        };
        match limit {
            Limit::Error => {
                let error = errors(row).map(|(error, _)| error);
                error.zip(self.max_error).map_or(f64::INFINITY, |(error, limit)| error / limit)
            }
            Limit::RealTime => of(|goals, figures| Some(goals.realtime? * figures.time_ms() / 1e3)),
            Limit::Fit => of(|goals, figures| Some(fullest(goals.fit?, figures).1)),
        }
    }

    /// Whether a row keeps all limits.
    pub fn kept_by(&self, row: &Row) -> bool {
        row.figures().is_some() && self.limits().all(|limit| self.excess(limit, row) <= 1.0)
    }

    /// The rows that keep all limits: the best first, then the others by the figure that is to be small. Of those within
    /// two percent of the smallest the second figure decides.
    pub fn ranked(&self, rows: &[Row]) -> Vec<usize> {
        let key = |index: &usize| self.minimise.of(rows[*index].figures().expect("filtered"));
        let mut met: Vec<usize> = (0..rows.len()).filter(|index| self.kept_by(&rows[*index])).collect();
        met.sort_by(|a, b| {
            let (a, b) = (key(a), key(b));
            a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        let Some(first) = met.first() else { return met };
        let most = EQUAL * key(first).0;
        let equal = met.iter().enumerate().take_while(|(_, index)| key(index).0 <= most);
        let best = equal.min_by(|(_, a), (_, b)| key(a).1.total_cmp(&key(b).1)).map_or(0, |(place, _)| place);
        let best = met.remove(best);
        met.insert(0, best);
        met
    }

    /// The limit that costs the most, with the factor by which the figure that is to be small would be smaller without it;
    /// none if none costs anything.
    pub fn binding(&self, rows: &[Row]) -> Option<(Limit, f64)> {
        let figure = |goals: Goals| {
            let best = *goals.ranked(rows).first()?;
            Some(self.minimise.of(rows[best].figures()?).0)
        };
        let own = figure(*self)?;
        let gains = self.limits().filter_map(|limit| Some((limit, own / figure(self.without(limit))?)));
        gains.filter(|(_, gain)| *gain > EQUAL).max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The rows that are better in the figure that is to be small than the best one and miss limits, the nearest first; of
    /// all rows if none keeps the limits.
    pub fn misses(&self, rows: &[Row]) -> Vec<Miss> {
        let figure = |row: &Row| row.figures().map(|figures| self.minimise.of(figures).0);
        let best = self.ranked(rows).first().and_then(|best| figure(&rows[*best]));
        let better = |row: &Row| best.is_none_or(|best| figure(row).is_some_and(|figure| EQUAL * figure < best));
        let mut misses: Vec<Miss> = Vec::new();
        for (index, row) in rows.iter().enumerate().filter(|(_, row)| better(row)) {
            let factors = self.limits().map(|limit| (limit, self.excess(limit, row)));
            let limits: Vec<(Limit, f64)> = factors.filter(|(_, factor)| *factor > 1.0).collect();
            if !limits.is_empty() && limits.iter().all(|(_, factor)| factor.is_finite()) {
                misses.push(Miss { row: index, limits });
            }
        }
        let far = |miss: &Miss| miss.limits.iter().map(|(_, factor)| *factor).fold(0.0, f64::max);
        misses.sort_by(|a, b| far(a).total_cmp(&far(b)));
        // What differs in its word alone misses by the same.
        misses.dedup_by(|next, miss| next.limits == miss.limits);
        misses.truncate(NEAREST);
        misses
    }

    /// The limits that no row keeps, whatever it makes of the others, each with the smallest factor.
    pub fn out_of_reach(&self, rows: &[Row]) -> Vec<(Limit, f64)> {
        let least = |limit| rows.iter().map(|row| self.excess(limit, row)).fold(f64::INFINITY, f64::min);
        self.limits().map(|limit| (limit, least(limit))).filter(|(_, factor)| *factor > 1.0).collect()
    }

    /// The limits in words.
    pub fn words(&self) -> String {
        let mut words: Vec<String> = Vec::new();
        words.extend(self.max_error.map(|limit| format!("a total error of at most {limit:e}")));
        words.extend(self.realtime.map(|factor| format!("at least {factor} times real time")));
        words.extend(self.fit.map(|device| format!("fits {}", device.name)));
        words.join(", ")
    }

    /// What a row would take to keep a limit that it misses by a factor.
    pub fn taken(&self, (limit, factor): (Limit, f64), row: &Row) -> String {
        match limit {
            Limit::Error => {
                let error = self.max_error.unwrap_or(f64::NAN) * factor;
                format!("{factor:.2} times the error ({error:.1e})")
            }
            Limit::RealTime => {
                let reached = self.realtime.unwrap_or(f64::NAN) / factor;
                format!("a clock {factor:.2} times as fast ({} times real time)", digits(reached))
            }
            Limit::Fit => {
                let fullest = row.figures().zip(self.fit).map_or("", |(figures, device)| fullest(device, figures).0);
                format!("{factor:.2} times the {fullest} of the device")
            }
        }
    }

    /// Why no row keeps the limits, and what those would take that come nearest.
    pub fn refusal(&self, rows: &[Row], described: impl Fn(&Row) -> String) -> (String, String) {
        let alone = self.out_of_reach(rows);
        let alone: Vec<String> = alone
            .iter()
            .map(|(limit, factor)| match factor.is_finite() {
                true => format!("{} is out of reach by a factor of {factor:.2}", limit.name()),
                false => format!("{} is out of reach", limit.name()),
            })
            .collect();
        let why = match alone.is_empty() {
            true => "each limit is kept by some point, but not all of them together".to_owned(),
            false => alone.join(", "),
        };
        let misses = self.misses(rows).into_iter().map(|miss| {
            let row = &rows[miss.row];
            let taken: Vec<String> = miss.limits.iter().map(|limit| self.taken(*limit, row)).collect();
            format!("{} would take {}", described(row), taken.join(" and "))
        });
        let misses: Vec<String> = misses.collect();
        let nearest = if misses.is_empty() { "ask for less".to_owned() } else { misses.join("; ") };
        (format!("none of {} points meets the goals ({}): {why}", rows.len(), self.words()), nearest)
    }
}

/// A number as short as three digits allow.
fn digits(number: f64) -> String {
    let rounded: f64 = format!("{number:.2e}").parse().unwrap_or(number);
    rounded.to_string()
}

/// The resource of which a design needs the largest part of what a device has, and that part.
fn fullest(device: &Device, figures: &Figures) -> (&'static str, f64) {
    let cells = &figures.area.cells;
    let needed = [
        ("LUTs", cells.lut.round(), device.luts),
        ("flip-flops", cells.ff.round(), device.ffs),
        ("DSP blocks", f64::from(cells.dsp), device.dsps),
        ("block RAMs", f64::from(cells.bram18), device.bram18s),
    ];
    let parts = needed.map(|(name, used, available)| (name, used / f64::from(available)));
    parts.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).expect("four")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(time: f64, lut: f64, error: f64) -> Row {
        Row::compiled(lut, time, Some(error))
    }

    /// Brute force over a grid of rows and goals: what is ranked first keeps all limits, and nothing that keeps them is
    /// better by more than two percent.
    #[test]
    fn the_best_row_keeps_all_limits_and_none_that_does_is_better() {
        let mut rows = Vec::new();
        for (index, time) in [1.0, 2.0, 5.0, 20.0].into_iter().enumerate() {
            for lut in [100.0, 300.0, 60_000.0] {
                rows.push(row(time * (1.0 + lut / 1e6), lut, 1e-6 * libm::pow(30.0, index as f64)));
            }
        }
        let device = pe_target::devices::named("XC7Z020");
        for minimise in Figure::ALL {
            for max_error in [None, Some(1e-3), Some(1e-9)] {
                for realtime in [None, Some(100.0), Some(1e5)] {
                    for fit in [None, device] {
                        let goals = Goals { max_error, realtime, fit, minimise };
                        let keeps = |row: &&Row| {
                            let figures = row.figures().expect("a figure");
                            max_error.is_none_or(|limit| figures.total_error().expect("an error") <= limit)
                                && realtime.is_none_or(|factor| 1e3 / figures.time_ms() >= factor)
                                && fit.is_none_or(|device| figures.area.cells.lut <= f64::from(device.luts))
                        };
                        let figure = |row: &Row| minimise.of(row.figures().expect("a figure")).0;
                        let least = rows.iter().filter(keeps).map(figure).fold(f64::INFINITY, f64::min);
                        match goals.ranked(&rows).first() {
                            Some(best) => {
                                assert!(keeps(&&rows[*best]) && figure(&rows[*best]) <= EQUAL * least);
                                for miss in goals.misses(&rows) {
                                    assert!(!keeps(&&rows[miss.row]) && figure(&rows[miss.row]) < least * EQUAL);
                                }
                            }
                            None => {
                                assert!(least.is_infinite(), "{goals:?}");
                                let (text, _) = goals.refusal(&rows, |_| "it".to_owned());
                                assert!(text.contains("out of reach") || text.contains("together"), "{text}");
                            }
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn the_binding_limit_is_the_one_that_costs_the_most() {
        let rows = [row(1.0, 1000.0, 1e-6), row(4.0, 400.0, 1e-6), row(4.0, 300.0, 1e-3)];
        let goals = Goals { max_error: Some(1e-5), realtime: Some(500.0), minimise: Figure::Area, ..Goals::default() };
        assert_eq!(goals.ranked(&rows), [0]);
        let (limit, gain) = goals.binding(&rows).expect("real time costs something");
        assert!(limit == Limit::RealTime && (gain - 2.5).abs() < 1e-9, "{limit:?} {gain}");
        let nearest = &goals.misses(&rows)[0];
        assert_eq!((nearest.row, nearest.limits.as_slice()), (1, &[(Limit::RealTime, 2.0)][..]));
        assert!(Goals::error(1e-5).binding(&rows[..2]).is_none());
    }
}
