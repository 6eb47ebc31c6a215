//! The nearest known name, for "did you mean" hints.

/// Longer names are not compared: the distance takes the product of both lengths.
const LONGEST: usize = 64;

/// The candidate that differs least from `name`, if it is near enough to be a likely slip; the first among equals.
pub(crate) fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // One slip per three letters: `n` suggests nothing but a change of case, `pmouth` suggests `p_mouth`.
    let allowed = name.len().div_ceil(3);
    let mut best: Option<(usize, &str)> = None;
    for candidate in candidates {
        if name.len().max(candidate.len()) > LONGEST || name.len().abs_diff(candidate.len()) > allowed {
            continue;
        }
        let distance = if name.eq_ignore_ascii_case(candidate) { 0 } else { strsim::osa_distance(name, candidate) };
        let replaces_all = distance >= candidate.len().max(name.len());
        if distance <= allowed && !replaces_all && best.is_none_or(|(least, _)| distance < least) {
            best = Some((distance, candidate));
        }
    }
    best.map(|(_, candidate)| candidate)
}

/// The help text for an unknown name, if a known one is near.
pub(crate) fn suggestion<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<String> {
    nearest(name, candidates).map(|candidate| format!("did you mean `{candidate}`?"))
}

#[cfg(test)]
mod tests {
    use super::nearest;

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
}
