//! What may be the reason that the recordings differ from what was stated: corrections of the
//! recordings and effects, in one list, the likelier first.
//!
//! The session check uses no model, and `discover` no session check, so that both can name the same
//! cause: a wrong stated mass is a correction there and an effect here, and a gain of all plates
//! explains both. Such explanations exclude each other, and a user has to see them side by side.

use crate::corrections::Offer;
use crate::session_check::{LineStatus, SessionCheck};
use aloft_compare::significant;
use aloft_discover::{Candidate, Discovery, Verdict};
use aloft_effects::{About, ActsIn, EFFECTS, Family};
use aloft_study::subject_session::SubjectSession;
use serde::Serialize;

/// Line of the check, key of the correction that it offers, and the effect of the catalogue that
/// describes the same error.
const SAME: [(&str, &str, &str); 5] = [
    ("plate_delay", "plate_delay_s", "plate_time_offset"),
    ("impulse_mass", "mass_kg", "body_mass"),
    ("plate_zero", "plate_zero", "plate_tare"),
    ("vertical", "vertical_deg", "gravity_tilt"),
    ("free_fall", "rate_ratio", "gravity_scale"),
];

/// Ratio of what two explanations leave of the error, up to which they count as equal: a
/// correction, which needs no unknown in the model, then comes first.
const EQUAL: f64 = 1.02;

/// Kind of an explanation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// An effect that the model holds: the lines differ as it says.
    Held,
    /// A correction under `corrections` of the pipeline.
    Correction,
    /// An effect that `discover` names and the model does not hold.
    Found,
}

/// Something that explains lines of the session check that differ.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Explanation {
    /// What it is.
    pub reason: Reason,
    /// Key of the correction or of the effect.
    pub key: String,
    /// Identifiers of the lines.
    pub lines: Vec<&'static str>,
    /// Share of the held-out error that it leaves by itself, where `discover` ranked it.
    pub left: Option<f64>,
}

/// True if an effect changes what a line of the check measures. Mass from the impulse: forces and
/// masses, and what scales the plates; vertical and free fall: what acts in flight; time and zero
/// of the plates: the effects that are just that.
pub(crate) fn may_change(about: &About<'_>, line: &str) -> bool {
    let force = about.family == Family::Forces && about.acts != ActsIn::Joints;
    match line {
        "impulse_mass" => force || about.shows_in_free_fall,
        "vertical" | "free_fall" => about.acts.in_flight() && about.acts != ActsIn::Joints,
        _ => SAME.iter().any(|(id, _, effect)| *id == line && about.id == *effect),
    }
}

/// The same for an effect by its key; one of the user's own is a force.
pub(crate) fn key_may_change(key: &str, line: &str) -> bool {
    let id = key.split('[').next().unwrap_or(key);
    EFFECTS
        .iter()
        .find(|e| e.is_called(id))
        .map_or_else(|| may_change(&About::PLAIN, line), |e| may_change(&e.about(), line))
}

/// Lines that differ and that something may have been offered for.
fn differing(check: &SessionCheck) -> Vec<&'static str> {
    let differs = |id: &&str| check.lines.iter().any(|l| l.id == *id && l.status == LineStatus::Differs);
    SAME.iter().map(|s| s.0).filter(differs).collect()
}

/// Keys of the effects that an answer names, with their candidates.
fn named(d: &Discovery) -> Vec<(String, Option<&Candidate>)> {
    let of = |key: &str, id: &str| d.candidates.iter().find(|c| c.key == key || (c.effect == id));
    let mut out: Vec<(String, Option<&Candidate>)> = Vec::new();
    if matches!(d.verdict, Verdict::Supported | Verdict::OneOf) {
        out.extend(d.found.iter().map(|f| (f.key.clone(), of(&f.key, &f.effect))));
        let class = d.groups.iter().flat_map(|g| &g.effects).filter(|id| !d.found.iter().any(|f| f.effect == **id));
        out.extend(class.filter_map(|id| of(id, id).map(|c| (c.key.clone(), Some(c)))));
    } else {
        let laws = d.open.iter().filter(|o| o.complete).flat_map(|o| &o.laws);
        out.extend(laws.map(|l| (l.id.clone(), None)));
    }
    out
}

/// What explains the lines that differ: effects of the model, then corrections that are offered and
/// effects of the answer `d`, the likelier first.
pub fn explanations(
    session: &SubjectSession,
    check: &SessionCheck,
    offers: &[Offer],
    d: Option<&Discovery>,
) -> Vec<Explanation> {
    let lines = differing(check);
    let changed =
        |key: &str| -> Vec<&'static str> { lines.iter().copied().filter(|line| key_may_change(key, line)).collect() };
    let mut out: Vec<Explanation> = Vec::new();
    for held in &session.effects {
        let lines = changed(&held.key);
        if !lines.is_empty() {
            out.push(Explanation { reason: Reason::Held, key: held.key.clone(), lines, left: None });
        }
    }
    let twin = |key: &str| SAME.iter().find(|(_, correction, _)| *correction == key);
    let ranked = |id: &str| d?.candidates.iter().find(|c| c.effect == id).map(|c| c.held_out_ratio);
    let mut found: Vec<Explanation> = Vec::new();
    for (key, c) in d.map(named).unwrap_or_default() {
        let same = |o: &Offer| twin(o.key).is_some_and(|(_, _, effect)| key.split('[').next() == Some(*effect));
        let lines = changed(&key);
        let is_held = session.effects.iter().any(|e| e.key == key);
        if lines.is_empty() || is_held || offers.iter().any(same) {
            continue;
        }
        found.push(Explanation { reason: Reason::Found, key, lines, left: c.map(|c| c.held_out_ratio) });
    }
    found.sort_by(|a, b| a.left.unwrap_or(0.0).total_cmp(&b.left.unwrap_or(0.0)));
    for offer in offers {
        let Some((line, key, effect)) = twin(offer.key) else { continue };
        let left = ranked(effect);
        // what was measured without a model comes first unless an effect leaves clearly less
        let better = |e: &Explanation| e.left.zip(left).is_some_and(|(a, b)| a * EQUAL < b);
        let at = found.iter().take_while(|e| e.reason == Reason::Found && better(e)).count();
        let key = (*key).to_owned();
        found.insert(at, Explanation { reason: Reason::Correction, key, lines: vec![*line], left });
    }
    out.extend(found);
    out
}

/// The correction that explains the same as an effect, and comes before it.
pub(crate) fn instead_of<'e>(all: &'e [Explanation], key: &str) -> Option<&'e Explanation> {
    let at = all.iter().position(|e| e.reason == Reason::Found && e.key == key);
    let lines = match at {
        Some(at) => all[at].lines.clone(),
        // the same error as a correction that is offered
        None => {
            let id = key.split('[').next().unwrap_or(key);
            SAME.iter().filter(|(_, _, effect)| *effect == id).map(|s| s.0).collect()
        }
    };
    let before = &all[..at.unwrap_or(all.len())];
    before.iter().find(|e| e.reason == Reason::Correction && e.lines.iter().any(|l| lines.contains(l)))
}

/// What the explanations mean for the lines that differ, in a sentence; none where a correction
/// alone explains them, or nothing does.
pub fn in_words(all: &[Explanation]) -> Option<String> {
    let keys = |reason: Reason| -> Vec<String> {
        all.iter().filter(|e| e.reason == reason).map(|e| format!("`{}`", e.key)).collect()
    };
    let (held, found, corrections) = (keys(Reason::Held), keys(Reason::Found), keys(Reason::Correction));
    let mut out = Vec::new();
    if !held.is_empty() {
        let (verb, says, beside) =
            if held.len() == 1 { ("changes", "it says", "it") } else { ("change", "they say", "them") };
        out.push(format!(
            "{} of the model {verb} what is measured here: lines that differ may be what {says}, and need no correction \
             beside {beside}",
            held.join(", ")
        ));
    }
    if !found.is_empty() && corrections.is_empty() {
        let verb = if found.len() == 1 { "changes" } else { "each change" };
        out.push(format!(
            "{}, which `discover` names, {verb} what is measured here: add the effect first, then check again",
            found.join(", ")
        ));
    }
    if !found.is_empty() && !corrections.is_empty() {
        let each = all.iter().filter(|e| e.reason != Reason::Held).map(|e| {
            let left =
                e.left.map_or(String::new(), |x| format!(" (leaves {} % of the error)", significant(100.0 * x, 2)));
            match e.reason {
                Reason::Correction => format!("the correction `{}`{left}", e.key),
                _ => format!("the effect `{}`{left}", e.key),
            }
        });
        out.push(format!(
            "one of these explains the same, the likelier first: {}; take one, and check again",
            each.collect::<Vec<_>>().join(", ")
        ));
    }
    (!out.is_empty()).then(|| out.join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_effect_explains_only_the_lines_that_it_changes() {
        let of = |key: &str| {
            let lines = ["impulse_mass", "vertical", "free_fall", "plate_delay", "plate_zero"];
            lines.into_iter().filter(|line| key_may_change(key, line)).collect::<Vec<_>>()
        };
        assert_eq!(of("plate_gain[plate1]"), ["impulse_mass"]);
        assert_eq!(of("body_mass"), ["impulse_mass"]);
        assert_eq!(of("tether[hand_r]"), ["impulse_mass", "vertical", "free_fall"]);
        assert_eq!(of("law_of_my_own"), ["impulse_mass", "vertical", "free_fall"]);
        assert_eq!(of("plate_time_offset"), ["plate_delay"]);
        for nothing in ["plate_origin[plate1]", "stribeck[elbow]", "plate_rotation[plate2]"] {
            assert!(of(nothing).is_empty(), "{nothing}: {:?}", of(nothing));
        }
    }

    #[test]
    fn corrections_and_effects_stand_in_one_list() {
        let of =
            |reason, key: &str, left| Explanation { reason, key: key.to_owned(), lines: vec!["impulse_mass"], left };
        let correction = of(Reason::Correction, "mass_kg", Some(0.31));
        let gain = of(Reason::Found, "plate_gain[plates]", Some(0.308));
        let all = [correction.clone(), gain.clone()];
        assert_eq!(
            in_words(&all).unwrap(),
            "one of these explains the same, the likelier first: the correction `mass_kg` (leaves 31 % of the error), the \
             effect `plate_gain[plates]` (leaves 31 % of the error); take one, and check again"
        );
        assert_eq!(instead_of(&all, "plate_gain[plates]"), Some(&correction));
        // the effect that says the same as the correction, and one that has nothing to do with it
        assert_eq!(instead_of(&all, "body_mass"), Some(&correction));
        assert_eq!(instead_of(&all, "tether[hand_r]"), None);
        // an effect that is likelier is proposed itself
        assert_eq!(instead_of(&[gain, correction.clone()], "plate_gain[plates]"), None);
        assert_eq!(in_words(&[correction]), None);
        let held = in_words(&[of(Reason::Held, "plate_gain[plates]", None)]).unwrap();
        assert!(held.starts_with("`plate_gain[plates]` of the model changes what is measured here"), "{held}");
    }
}
