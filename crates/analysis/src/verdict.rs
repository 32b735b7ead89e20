//! The verdict of a discovery in its documented words, for the terminal and the report.

use crate::wording::unit;
use aloft_compare::significant;
use aloft_discover::{Candidate, Discovery, Estimate, Group, TOO_FEW, Verdict, odds};
use aloft_effects::EffectKind;

fn group(g: &Group) -> String {
    let all = g.effects.join(", ");
    match (g.is_sure(), g.missing) {
        (true, _) => all,
        (_, 1) => format!("one of {{{all}}}"),
        (_, n) => format!("{n} of {{{all}}}"),
    }
}

/// What is missing beside the supported effects, of which the recordings cannot tell which it is.
fn and_one_of(d: &Discovery) -> String {
    d.groups.iter().filter(|g| !g.is_sure()).map(|g| format!(", and {}", group(g))).collect()
}

/// What is missing, group by group: `one of {wind, tilt}, and flywheel`.
pub fn groups(d: &Discovery) -> String {
    let each: Vec<String> = d.groups.iter().map(group).collect();
    // results of an earlier version have no groups
    if each.is_empty() { format!("one of {{{}}}", d.effects.join(", ")) } else { each.join(", and ") }
}

/// The verdict in a few words: `supported: tether`, `one of {wind, tilt}`, `nothing missing` …, and
/// that on the torques of joints where they were logged.
pub fn sentence(d: &Discovery) -> String {
    match &d.joints {
        Some(j) => format!("{}; in the torques of joints: {}", of_body(d), j.short()),
        None => of_body(d),
    }
}

/// Coefficients in the unit of the first one, which is that of the minimum detectable size.
fn of_first_unit(c: &Candidate) -> impl Iterator<Item = &Estimate> {
    c.coefficients.iter().filter(|e| c.coefficients.first().is_some_and(|first| first.unit == e.unit))
}

/// What tables say of the coefficient that they show.
pub const SHOWN: &str =
    "coefficient: of several, the one farthest from zero; its interval does not allow for that choice";

/// The coefficient of a candidate that a table shows beside its minimum detectable size: of those
/// of that unit, the one farthest from zero in its intervals.
pub fn shown_coefficient(c: &Candidate) -> Option<&Estimate> {
    let size = |e: &Estimate| match e.ci95 {
        Some([low, high]) if high > low => e.value.abs() / (high - low),
        _ => 0.0,
    };
    let largest = of_first_unit(c).map(size).fold(0.0, f64::max);
    of_first_unit(c).find(|e| size(e) >= largest)
}

/// An upper bound of a probability in words: rounded up to three decimals.
pub fn at_most(p: f64) -> String {
    format!("{:.3}", (1000.0 * p).ceil() / 1000.0)
}

/// Odds of a candidate against "nothing missing" by the rows alone, in words.
pub fn odds_of(c: &Candidate) -> String {
    c.evidence.map_or("–".to_owned(), |e| odds(e.ln_odds))
}

/// Probability that a candidate is what is missing, in words; none where the answer names nothing:
/// the best of candidates that are all wrong would hold all of it.
pub fn probability_of(c: &Candidate, d: &Discovery) -> String {
    let names = matches!(d.verdict, Verdict::Supported | Verdict::OneOf);
    match c.evidence.map(|e| e.probability).filter(|_| names) {
        Some(p) if p >= 5e-4 => significant(p, 2),
        Some(_) => "<0.001".to_owned(),
        None => "–".to_owned(),
    }
}

/// How a candidate was decided: `named`, or why it is not.
pub fn decided(c: &Candidate, d: &Discovery) -> String {
    if d.effects.contains(&c.effect) && c.believed {
        return "named".to_owned();
    }
    if d.rounds.iter().any(|r| r.judged_on == c.judged_on && r.has_too_few()) {
        return TOO_FEW.to_owned();
    }
    if c.believed { "others are likelier, or contain it".to_owned() } else { c.doubt() }
}

/// What the evidence for the named effects is: what the first of them leaves of the error, and its
/// odds; none where none is named.
pub fn how_sure(d: &Discovery) -> Option<String> {
    if !matches!(d.verdict, Verdict::Supported | Verdict::OneOf) {
        return None;
    }
    let round = d.rounds.iter().find(|r| matches!(r.verdict, Verdict::Supported | Verdict::OneOf))?;
    let here = |c: &&Candidate| round.effects.contains(&c.effect);
    let best = round.candidates.iter().filter(here).min_by(|a, b| a.held_out_ratio.total_cmp(&b.held_out_ratio))?;
    let unit = if best.judged_on == "contact" { "stretches of contact" } else { "flights or trials" };
    let percent = |x: f64| format!("{:.0}", 100.0 * x);
    let several = d.found.len() > 1;
    // a pair may join although the best single candidate is neither of the two
    let subject = if !d.found.iter().any(|f| f.key == best.key) && several {
        format!("the best single candidate, `{}`,", best.key)
    } else if several {
        format!("`{}`, fitted alone,", best.key)
    } else {
        "it".to_owned()
    };
    let then = if several { beside_others(d, best) } else { in_the_ladder(d, best) }.unwrap_or_default();
    let odds =
        best.evidence.map_or(String::new(), |e| format!("; its odds against nothing missing are {}", odds(e.sure())));
    Some(format!(
        "{subject} leaves {} % ({} to {} %) of the error in {unit} that were left out{then}{odds}",
        percent(best.held_out_ratio),
        percent(best.ci95[0]),
        percent(best.ci95[1]),
    ))
}

/// Most effects whose smallest detectable size is stated.
const STATED: usize = 4;

/// What an answer that names nothing does not exclude: the sizes from which the likeliest physical
/// effects would be found; none where something is named, or where no size is known.
pub fn not_excluded(d: &Discovery) -> Option<String> {
    // recordings that have to be corrected first have not shown anything
    if d.to_correct.is_some() || !matches!(d.verdict, Verdict::NothingMissing | Verdict::NotDetectable) {
        return None;
    }
    let place = d.rounds.first().map(|r| r.judged_on.as_str())?;
    let possible = |c: &&Candidate| {
        // a limit only where the estimate itself is below it
        c.kind == EffectKind::Physics
            && c.judged_on == place
            && c.minimum_detectable.is_finite()
            && of_first_unit(c).all(|e| e.value.abs() < c.minimum_detectable)
    };
    let sizes: Vec<String> = d
        .candidates
        .iter()
        .filter(possible)
        .take(STATED)
        .filter_map(|c| {
            let first = c.coefficients.first()?;
            Some(format!("{} below {} {}", c.key, significant(c.minimum_detectable, 2), unit(&first.unit)))
        })
        .collect();
    (!sizes.is_empty()).then(|| {
        format!("{}; larger ones would be found in about four of five sessions like this one", sizes.join(", "))
    })
}

/// What the effect leaves where all stages compute it, as the table of errors and the ladder show,
/// where that differs from the ranking, whose folds and windows are its own.
fn in_the_ladder(d: &Discovery, best: &Candidate) -> Option<String> {
    let step = d.ladder.first().filter(|s| s.key == best.key && s.judged_on == best.judged_on)?;
    let left = significant(100.0 * step.left_of_error?, 2);
    (left != significant(100.0 * best.held_out_ratio, 2)).then(|| {
        format!("; added to the model, it leaves {left} % in {}, as the table and the ladder show", best.judged_on)
    })
}

/// What the ladder will show of several effects found: the first of them, where that differs from
/// what it leaves in the ranking (there it has its own best values and other held-out motion), and
/// all of them together.
/// None where they were judged on other motion than the first.
fn beside_others(d: &Discovery, best: &Candidate) -> Option<String> {
    let percent = |x: f64| format!("{:.0}", 100.0 * x);
    let (first, last) = (d.ladder.first()?, d.ladder.last()?);
    if d.ladder.iter().any(|step| step.judged_on != best.judged_on) {
        return None;
    }
    // the two errors of the answer are those of the motion of the first round
    let stated = d.rounds.first().is_some_and(|r| r.judged_on == best.judged_on) && d.held_out_error > 0.0;
    let together = last.left_of_error.or(stated.then(|| d.held_out_error_after / d.held_out_error)).map(percent)?;
    let added =
        first.left_of_error.map(percent).filter(|p| first.key == best.key && *p != percent(best.held_out_ratio));
    let added = added.map_or(String::new(), |p| format!("; in the ladder it leaves {p} % alone"));
    Some(format!("{added}; the {} effects found leave {together} % together", d.found.len()))
}

/// The verdict on the rows of the body.
fn of_body(d: &Discovery) -> String {
    let kind = |id: &String| d.candidates.iter().find(|c| c.effect == *id).map(|c| c.kind);
    let artefact = !d.effects.is_empty() && d.effects.iter().all(|e| kind(e) == Some(EffectKind::Artefact));
    let names = || d.effects.join(", ");
    match d.verdict {
        Verdict::Supported if artefact => format!("artefact more likely: {}{}", names(), and_one_of(d)),
        Verdict::Supported => format!("supported: {}{}", names(), and_one_of(d)),
        Verdict::OneOf => groups(d),
        Verdict::NothingMissing if !d.not_tried.is_empty() => {
            let left: Vec<&str> = d.not_tried.iter().map(|n| n.effect.as_str()).collect();
            format!("nothing missing among what could be tried (not tried: {})", left.join(", "))
        }
        Verdict::NothingMissing => "nothing missing".to_owned(),
        Verdict::Unexplained => "unexplained".to_owned(),
        Verdict::NotDetectable => "not detectable".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// A discovery of two effects in contact, after a first round in flight that found nothing.
    fn two_of_plates(left: [Option<f64>; 2]) -> Discovery {
        let candidate = |key: &str, ratio: f64| {
            json!({"effect": key, "key": key, "target": "body", "kind": "artefact", "class": "", "judged_on": "contact",
                "held_out_ratio": ratio, "ci95": [ratio - 0.05, ratio + 0.05], 
                "coefficients": [], "nonlinear": [], "trials": [], "minimum_detectable": 0.001,
                "plausible": true, "believed": true, "alternatives": []})
        };
        let round = |place: &str, effect: Option<&str>, ratio: f64| {
            let named: Vec<&str> = effect.into_iter().collect();
            json!({"judged_on": place, "model": [], "held_out_error": 1.0, "clusters": 7, "effects": named, "words": "",
                "verdict": if effect.is_some() { "supported" } else { "nothing_missing" },
                "candidates": effect.map(|e| candidate(e, ratio)).into_iter().collect::<Vec<_>>()})
        };
        let found = |key: &str| json!({"effect": key, "key": key, "target": "body", "nonlinear": [], "coefficients": [], "trials": []});
        let step = |key: &str, left: Option<f64>| {
            json!({"key": key, "judged_on": "contact", "held_out_error_before": 1.0, "held_out_error": 0.5, "ratio": 0.5,
                "ci95": [0.4, 0.6], "coefficients": [], "trials": [], "left_of_error": left})
        };
        let answer = json!({"schema": 1, "verdict": "supported", "effects": ["a", "b"], "words": "", "noise_floor": 10.8,
            "held_out_error": 12.5, "held_out_error_after": 13.5, "held_out_error_of_weight": 0.01, "candidates": [],
            "rounds": [round("flight", None, 1.0), round("contact", Some("a"), 0.23), round("contact", Some("b"), 0.65)],
            "found": [found("a"), found("b")], "ladder": [step("a", left[0]), step("b", left[1])], "advice": [], "warnings": []});
        serde_json::from_value(answer).unwrap()
    }

    #[test]
    fn what_effects_leave_is_that_of_the_motion_on_which_they_were_judged() {
        let words = how_sure(&two_of_plates([Some(0.23), Some(0.24)])).unwrap();
        assert!(words.contains("`a`, fitted alone, leaves 23 % (18 to 28 %)"), "{words}");
        assert!(
            words.contains("the 2 effects found leave 24 % together") && !words.contains("in the ladder"),
            "{words}"
        );
        // without that of the stages nothing is said: the errors of the answer are those in flight
        let words = how_sure(&two_of_plates([None, None])).unwrap();
        assert!(!words.contains("together") && !words.contains("108"), "{words}");
    }

    #[test]
    fn the_first_effect_leaves_what_the_ladder_will_show() {
        let words = how_sure(&two_of_plates([Some(0.62), Some(0.36)])).unwrap();
        assert!(
            words.contains("in the ladder it leaves 62 % alone; the 2 effects found leave 36 % together"),
            "{words}"
        );
    }
}
