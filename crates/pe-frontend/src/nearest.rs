//! The nearest known name, for "did you mean" hints.

use crate::report::as_written;
use std::borrow::Cow;

/// Longer names are not compared: the distance takes the product of both lengths.
const LONGEST: usize = 64;

/// Names told of a part; more would hide the finding.
const MOST_TOLD: usize = 12;

/// How much two words differ, if that is little enough to be a likely slip.
fn slip(word: &str, other: &str) -> Option<usize> {
    // One slip per three letters: `n` suggests nothing but a change of case, `pmouth` suggests `p_mouth`.
    let allowed = word.len().div_ceil(3);
    let longest = word.len().max(other.len());
    if longest > LONGEST || word.len().abs_diff(other.len()) > allowed {
        return None;
    }
    let distance = if word.eq_ignore_ascii_case(other) { 0 } else { strsim::osa_distance(word, other) };
    (distance <= allowed && distance < longest).then_some(distance)
}

/// How much two names differ. Of names with points each word is to be a likely slip.
fn difference(name: &str, candidate: &str) -> Option<usize> {
    let (mut words, mut others) = (name.split('.'), candidate.split('.'));
    let mut sum = 0;
    loop {
        match (words.next(), others.next()) {
            (Some(word), Some(other)) if word == other => {}
            (Some(word), Some(other)) => sum += slip(word, other)?,
            (None, None) => return Some(sum),
            _ => return None,
        }
    }
}

/// The candidate that differs least from `name`, if it is near enough to be a likely slip; the first among equals.
pub(crate) fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let differing = candidates.into_iter().filter_map(|candidate| Some((difference(name, candidate)?, candidate)));
    differing.min_by_key(|(difference, _)| *difference).map(|(_, candidate)| candidate)
}

/// The help text for an unknown name, if a known one is near; else, if it begins with a part of the model, what that has.
pub(crate) fn suggestion<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<String> {
    let name = as_written(name);
    let known: Vec<Cow<str>> = candidates.into_iter().map(as_written).collect();
    if let Some(candidate) = nearest(&name, known.iter().map(Cow::as_ref)) {
        return Some(format!("did you mean `{candidate}`?"));
    }
    let mut part = name.as_ref();
    while let Some((shorter, _)) = part.rsplit_once('.') {
        part = shorter;
        let mut told = Vec::new();
        for own in known.iter().filter_map(|known| known.strip_prefix(part)?.strip_prefix('.')) {
            let word = own.split('.').next().unwrap_or(own);
            if !told.contains(&word) {
                told.push(word);
            }
            if told.len() > MOST_TOLD {
                break;
            }
        }
        if !told.is_empty() {
            let more = if told.len() > MOST_TOLD { " and more" } else { "" };
            told.truncate(MOST_TOLD);
            let told: Vec<String> = told.iter().map(|word| format!("`{word}`")).collect();
            return Some(format!("`{part}` has {}{more}", told.join(", ")));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::{nearest, suggestion};

    #[test]
    fn slips_are_recognised() {
        let known = ["p_mouth", "pressure", "V", "output"];
        assert_eq!(nearest("pmouth", known), Some("p_mouth"));
        assert_eq!(nearest("presusre", known), Some("pressure"));
        assert_eq!(nearest("v", known), Some("V"));
        assert_eq!(nearest("ouput", known), Some("output"));
    }

    #[test]
    fn unrelated_names_are_not_suggested() {
        assert_eq!(nearest("x", ["V", "flow"]), None);
        assert_eq!(nearest("conductance", ["capacity"]), None);
        assert_eq!(nearest(&"a".repeat(1_000_000), ["a"]), None);
    }

    #[test]
    fn names_of_parts_are_compared_word_by_word() {
        let known = ["axis[].motor.speed", "axis[].motor.w", "grid[,].cell[].w", "i", "axis[].current"];
        let meant = |name| suggestion(name, known);
        let proposed = |name: &str| Some(format!("did you mean `{name}`?"));
        assert_eq!(meant("axis[].motr.speed"), proposed("axis.motor.speed"));
        assert_eq!(meant("axis.motr.spede"), proposed("axis.motor.speed"));
        assert_eq!(meant("axs.motor.w"), proposed("axis.motor.w"));
        assert_eq!(meant("grd[,].cell[].w"), proposed("grid.cell.w"));
        assert_eq!(meant("grid[,].cels[].w"), proposed("grid.cell.w"));
        assert_eq!(meant("axis.motor.heat").as_deref(), Some("`axis.motor` has `speed`, `w`"));
        assert_eq!(meant("axis.w").as_deref(), Some("`axis` has `motor`, `current`"));
        assert_eq!(meant("axis.drive.w").as_deref(), Some("`axis` has `motor`, `current`"));
        assert_eq!(meant("wheel.w"), None);
    }
}
