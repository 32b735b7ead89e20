//! Hints for names that do not exist: the nearest ones that do, then all of them.

/// Most names that a hint lists after a suggestion.
const LISTED: usize = 40;

/// The existing names nearest to a word, best first: same letters in another case, a slip of one
/// letter in three, or one contained in the other. At most three; none for a pattern.
pub fn nearest<'a>(word: &str, known: &[&'a str]) -> Vec<&'a str> {
    let wanted = word.to_lowercase();
    if wanted.is_empty() || wanted.contains(['*', '?', '[', '{']) {
        return Vec::new();
    }
    let slips = wanted.chars().count().div_ceil(3);
    let mut found: Vec<(usize, &str)> = known
        .iter()
        .filter_map(|name| {
            let lower = name.to_lowercase();
            let distance = strsim::damerau_levenshtein(&wanted, &lower);
            let inside = wanted.chars().count() >= 3 && (lower.contains(&wanted) || wanted.contains(&lower));
            (distance <= slips || (inside && !lower.is_empty())).then_some((distance, *name))
        })
        .collect();
    found.sort();
    let best = found.first().map_or(0, |f| f.0);
    // beside a near name, one that only shares some letters is no help
    found.retain(|f| f.0 <= best + 1 || best > slips);
    found.dedup_by_key(|f| f.1);
    found.into_iter().take(3).map(|f| f.1).collect()
}

/// A hint for a name that does not exist: `did you mean `jump01`? the trials are …`.
pub fn hint(word: &str, known: &[&str], all: &str) -> String {
    let near: Vec<String> = nearest(word, known).iter().map(|n| format!("`{n}`")).collect();
    let mut listed = known.to_vec();
    listed.sort_unstable();
    listed.dedup();
    let more = listed.len().saturating_sub(LISTED);
    listed.truncate(LISTED);
    let mut list = if listed.is_empty() { format!("{all} none") } else { format!("{all} {}", listed.join(", ")) };
    if more > 0 {
        list.push_str(&format!(" and {more} more"));
    }
    if near.is_empty() { list } else { format!("did you mean {}? {list}", near.join(" or ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_find_the_name_that_was_meant() {
        let effects = ["tether", "quadratic_drag", "linear_drag", "wind", "gravity_tilt", "gravity_scale"];
        for (typed, meant) in [
            ("tehter", vec!["tether"]),
            ("Tether", vec!["tether"]),
            ("quadratic-drag", vec!["quadratic_drag"]),
            ("drag", vec!["linear_drag"]),
            ("winds", vec!["wind"]),
            ("gravity_tit", vec!["gravity_tilt"]),
            ("zebra", vec![]),
            ("tet*", vec![]),
            ("", vec![]),
        ] {
            assert_eq!(&nearest(typed, &effects)[..meant.len()], meant, "{typed}");
            assert!(!meant.is_empty() || nearest(typed, &effects).is_empty(), "{typed}");
        }
    }

    #[test]
    fn a_hint_suggests_and_lists() {
        assert_eq!(
            hint("jmp01", &["jump02", "jump01"], "the trials are"),
            "did you mean `jump01` or `jump02`? the trials are jump01, jump02"
        );
        assert_eq!(hint("x", &["jump01"], "the trials are"), "the trials are jump01");
    }
}
