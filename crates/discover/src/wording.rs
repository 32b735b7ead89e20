//! The result of a discovery in words.

use crate::held_out::HeldOutResult;
use crate::laws::{OpenWorld, WHOLE_BODY};
use crate::problem::Domain;
use crate::result::{Candidate, Discovery, Estimate, FEWEST_CLUSTERS, MANY_CLUSTERS, Round, Verdict};
use aloft_effects::{About, Effect, EffectKind};
use aloft_identify::half_of;

pub(crate) fn domain(domain: Domain) -> &'static str {
    match domain {
        Domain::Flight => "flight",
        Domain::Contact => "contact",
        Domain::Both => "flight and contact",
    }
}

fn list(names: &[String]) -> String {
    names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ")
}

fn estimate(coefficients: &[Estimate]) -> String {
    coefficients
        .iter()
        .map(|e| {
            let half = half_of(e.ci95).unwrap_or(f64::NAN);
            let digits = decimals(half);
            let unit = if e.unit == "1" { String::new() } else { format!(" {}", e.unit) };
            match e.ci95 {
                Some(_) => format!("{} {:.digits$} ± {half:.digits$}{unit} (95 %)", e.name, e.value),
                None if e.at_bound => format!("{} {:.digits$}{unit}, at its bound", e.name, e.value),
                None => format!("{} {:.digits$}{unit}", e.name, e.value),
            }
        })
        .collect::<Vec<_>>()
        .join(", ")
}

/// A positive number with this many significant digits, as the comparison shows it.
pub(crate) fn digits(value: f64, n: i32) -> String {
    let decimals = if value > 0.0 { n - 1 - value.log10().floor() as i32 } else { n - 1 };
    format!("{value:.*}", decimals.clamp(0, 12) as usize)
}

/// Number of decimals that show two digits of the half-width of an interval.
pub(crate) fn decimals(half: f64) -> usize {
    if half.is_finite() && half > 0.0 { (1.0 - half.log10().floor()).clamp(0.0, 9.0) as usize } else { 4 }
}

/// Why nothing is named where there are too few clusters.
pub const TOO_FEW: &str = "fewer than six flights or trials are too few to name an effect";

/// What the catalogue says before the search beyond it, with the error in flight of the model.
pub(crate) fn so_far(now: Option<HeldOutResult>) -> String {
    let left = now.map_or(String::new(), |left| {
        format!(
            "; the error in flight is {} N, {} times the noise floor",
            digits(left.held_out_error, 3),
            digits(left.times_floor(), 2)
        )
    });
    format!(
        "no effect of the catalogue explains the error{left}. Now searching beyond the catalogue, which may change the answer"
    )
}

/// A ratio of odds in words: `1.3e27 to 1`.
pub fn odds(ln_odds: f64) -> String {
    /// Natural-log units of a factor of ten thousand.
    const MANY: f64 = 9.21;
    let tens = ln_odds / std::f64::consts::LN_10;
    if !ln_odds.is_finite() {
        "no odds".to_owned()
    } else if ln_odds < 0.0 {
        format!("1 to {}", if -ln_odds < MANY { digits((-ln_odds).exp(), 2) } else { format!("10^{:.0}", -tens) })
    } else {
        format!("{} to 1", if ln_odds < MANY { digits(ln_odds.exp(), 2) } else { format!("10^{tens:.0}") })
    }
}

/// What a question said that was asked of a model with effects.
pub(crate) fn beside(model: &[String], words: &str) -> String {
    if model.is_empty() { words.to_owned() } else { format!("beside {} {words}", list(model)) }
}

/// The conclusion of one question by evidence, in words.
pub(crate) fn by_evidence(verdict: Verdict, effects: &[String], candidates: &[Candidate], few: bool) -> String {
    let first = candidates.first();
    let with = |c: &Candidate| c.evidence.map_or(f64::NAN, |e| e.sure());
    let by_rows = |c: &Candidate| c.evidence.map_or(f64::NAN, |e| e.ln_odds);
    let behind = |c: &Candidate| {
        let next = candidates.iter().find(|o| !effects.contains(&o.effect));
        next.map_or(String::new(), |n| {
            format!("; by the rows alone {} before the next, `{}`", odds(by_rows(c) - by_rows(n)), n.key)
        })
    };
    match (verdict, first) {
        (Verdict::Supported, Some(c)) => format!(
            "{}: `{}` is missing: odds of {} against nothing{}",
            if c.kind == EffectKind::Artefact { "artefact more likely than physics" } else { "supported" },
            c.key,
            odds(with(c)),
            behind(c)
        ),
        (Verdict::OneOf, Some(c)) => format!(
            "one of {} is missing, which these recordings cannot tell apart: `{}` has odds of {} against nothing{}",
            list(effects),
            c.key,
            odds(with(c)),
            behind(c)
        ),
        (_, Some(c)) => {
            let why = if few { TOO_FEW.to_owned() } else { c.not_shown_by_recordings() };
            let begins = if verdict == Verdict::NotDetectable { "not detectable" } else { "nothing missing" };
            format!("{begins}: the best candidate, `{}`, has odds of {}; {why}", c.key, odds(with(c)))
        }
        (_, None) => "no effect could be tried".to_owned(),
    }
}

impl Candidate {
    /// Why evidence does not name the best candidate.
    fn not_shown_by_recordings(&self) -> String {
        let Some(e) = &self.evidence else { return String::new() };
        match e.ln_odds_by_recording {
            _ if e.ln_odds < 3.0 => "to be named it needs 20 to 1".to_owned(),
            Some(of) => format!("over recordings left out one by one {}, and it needs 20 to 1 there, too", odds(of)),
            None => "recordings left out one by one are not predicted better".to_owned(),
        }
    }

    /// Why it is not named.
    pub fn doubt(&self) -> String {
        let Some(e) = &self.evidence else { return "no evidence is stored for it".to_owned() };
        let recordings = match e.ln_odds_by_recording {
            Some(of) => format!(", {} by recordings left out", odds(of)),
            None => String::new(),
        };
        let bound = if self.plausible { "" } else { "; at a physical limit, or zero" };
        format!("odds by rows alone {}{recordings}{bound}", odds(e.ln_odds))
    }
}

/// The result where the error is below what a perfect model leaves.
pub(crate) fn below(model_error: &HeldOutResult) -> String {
    let [low, high] = model_error.noise_floor_ci95.unwrap_or([f64::NAN; 2]).map(|n| digits(n, 3));
    format!(
        "not detectable: the held-out error of {} N is below the interval of the noise floor ({low} to {high} N), so recordings repeat each other or the floor is too high: nothing can be named",
        digits(model_error.held_out_error, 3)
    )
}

/// The result where no effect convinces and the floor is known too roughly to say that nothing is
/// missing.
pub(crate) fn undecided(d: &Discovery, model_error: &HeldOutResult) -> String {
    let [low, high] = model_error.noise_floor_ci95.unwrap_or([f64::NAN; 2]).map(|n| digits(n, 3));
    let best = d.candidates.first().map_or(String::new(), |c| {
        format!("; the best candidate, `{}`, leaves {:.1} % of the held-out error", c.key, 100.0 * c.held_out_ratio)
    });
    format!(
        "not detectable: the noise floor of these recordings is known only between {low} and {high} N, too roughly to say that nothing is missing{best}"
    )
}

/// The result where no effect convinces, and the error is above the interval of its floor, but not
/// far enough to show that something is missing. The errors of the parameters or of the geometry
/// may be the reason, or a small effect.
pub(crate) fn between(d: &Discovery, place: Domain, model_error: &HeldOutResult) -> String {
    let place = domain(place);
    let best = d.candidates.first().map_or(String::new(), |c| {
        format!("; the best candidate, `{}`, leaves {:.1} % of the held-out error", c.key, 100.0 * c.held_out_ratio)
    });
    let (error, times) = (digits(model_error.held_out_error, 2), digits(model_error.times_floor(), 2));
    match model_error.by_parameters.filter(|most| model_error.held_out_error <= *most) {
        Some(most) => format!(
            "not detectable: these recordings determine the body only roughly, and that alone can leave up to {} N in {place} of a recording that is left out; \
             the error there is {error} N{best}",
            digits(most, 2)
        ),
        None => format!(
            "not detectable: the held-out error in {place} is {error} N, {times} times the noise floor; a complete model would leave more than {} N in only 2.5 % of sessions like this one; \
             a small effect may be missing, but the recordings do not show which{best}",
            digits(model_error.noise_floor_ci95.map_or(f64::NAN, |ci| ci[1]), 2)
        ),
    }
}

/// An error that no effect explains, in words; `place` is where it stands farthest above its floor.
pub(crate) fn unexplained(d: &Discovery, place: &str, model_error: &HeldOutResult) -> String {
    let left: String = d.not_tried.iter().map(|n| format!("; {n}")).collect();
    let part: Vec<String> = d.found.iter().map(|f| f.key.clone()).collect();
    let remains = format!(
        "{} N, {} times the noise floor of {} N",
        digits(model_error.held_out_error, 3),
        digits(model_error.times_floor(), 2),
        digits(model_error.noise_floor, 3)
    );
    if !part.is_empty() {
        return format!(
            "unexplained: with {} in the model the held-out error in {place} is still {remains}; it removes part of the error and is not established as the cause{left}",
            list(&part),
        );
    }
    let nearest = d.candidates.first().map_or(String::new(), |c| {
        format!("; the best candidate, `{}`, leaves {:.1} % of the error", c.key, 100.0 * c.held_out_ratio)
    });
    let few = d.rounds.iter().any(Round::has_too_few);
    let why = if few {
        "there are too few flights or trials to name an effect"
    } else {
        "no effect of the catalogue explains it"
    };
    format!("unexplained: the held-out error in {place} is {remains}, and {why}{nearest}{left}")
}

/// What the questions by evidence said, in words.
pub(crate) fn answer(d: &Discovery) -> String {
    let named = |r: &&Round| matches!(r.verdict, Verdict::Supported | Verdict::OneOf);
    let said: Vec<&str> = d.rounds.iter().filter(named).map(|r| r.words.as_str()).collect();
    let mut text = if said.is_empty() {
        d.rounds.first().map(|r| r.words.clone()).unwrap_or_default()
    } else {
        said.join("; then ")
    };
    if matches!(d.verdict, Verdict::Supported | Verdict::OneOf) {
        for f in &d.found {
            let links = f.other_links().map_or(String::new(), |words| format!("; {words}"));
            let from = if f.sized_with_contact { ", from flights and contact" } else { "" };
            text.push_str(&format!("; `{}`: {}{from}{links}", f.key, estimate(&f.coefficients)));
        }
    }
    if let Some(e) = &d.evidence {
        let after = match d.found.is_empty() {
            true => String::new(),
            false => format!(", {} with what was found", digits(e.residual_after, 2)),
        };
        text.push_str(&format!("; the model leaves {} times the noise{after}", digits(e.residual_before, 2)));
    }
    for left in &d.not_tried {
        text.push_str(&format!("; {left}"));
    }
    text
}

/// The answer where the strength of an effect found does not follow its law.
pub(crate) fn of_another_form(d: &Discovery) -> String {
    let Some(m) = &d.misfit else { return String::new() };
    format!("unexplained: `{}` lowers the error, but its strength {}: odds of {}", m.effect, m.words, odds(m.ln_odds))
}

/// The result with that of the search beyond the catalogue.
pub(crate) fn with_open(d: &Discovery, open: &OpenWorld) -> String {
    if !open.complete {
        return format!("{}; {}", d.words, open.words);
    }
    let best = d.candidates.first().map_or(String::new(), |c| {
        format!(": the best effect of the catalogue, `{}`, leaves {:.1} % of it", c.key, 100.0 * c.held_out_ratio)
    });
    format!(
        "the catalogue does not explain the held-out error of {:.3} N, {:.1} times the noise floor{best}; {}",
        d.held_out_error,
        d.held_out_error / d.noise_floor,
        open.words
    )
}

/// Recording that would distinguish two of the ranked effects.
fn told_apart_by(effects: &[&dyn Effect], a: &str, b: &str) -> String {
    let about = |id: &str| effects.iter().find(|e| e.id() == id).map_or(About::PLAIN, |e| e.about());
    about(a).told_apart_by(&about(b)).to_owned()
}

pub(crate) fn advice(d: &Discovery, effects: &[&dyn Effect]) -> Vec<String> {
    let mut out = Vec::new();
    match d.verdict {
        Verdict::OneOf => {
            let classes = d.groups.iter().filter(|g| !g.is_sure());
            for (members, i, a) in classes.flat_map(|g| g.effects.iter().enumerate().map(|(i, a)| (&g.effects, i, a))) {
                // effects that the same recording tells from this one stand in one sentence
                let mut by: Vec<(String, Vec<String>)> = Vec::new();
                for b in &members[i + 1..] {
                    let recording = told_apart_by(effects, a, b);
                    match by.iter_mut().find(|(r, _)| *r == recording) {
                        Some((_, names)) => names.push(b.clone()),
                        None => by.push((recording, vec![b.clone()])),
                    }
                }
                out.extend(by.into_iter().map(|(recording, names)| match names.as_slice() {
                    [b] => format!("`{a}` and `{b}` are told apart by {recording}"),
                    _ => format!("`{a}` is told from {} by {recording}", list(&names)),
                }));
            }
        }
        Verdict::NotDetectable if d.candidates.is_empty() => {}
        Verdict::NotDetectable => {
            out.push(record_more(d).unwrap_or_else(|| "record more flights, better in more trials".to_owned()));
        }
        Verdict::Unexplained if d.open.as_ref().is_some_and(|o| o.complete) => {
            out.push(
                "a law found on these motions need not hold for others: record at other places, speeds and headings, and rank it again there"
                    .to_owned(),
            );
            if d.open.iter().flat_map(|o| &o.laws).any(|l| l.carrier == WHOLE_BODY) {
                out.push(
                    "camera errors that affect all markers alike (a distorted capture volume, a wrong scale or frame rate) look like a force on the whole body: \
                     before accepting a force, record the same motion elsewhere in the volume, and check the camera calibration against a known length"
                        .to_owned(),
                );
            }
            if let Some(n) = d.open.as_ref().and_then(|o| o.next.as_ref()) {
                out.push(format!(
                    "the next best law ({}) leaves {:.1} times its error; the same flights {} would tell the two apart best: they differ by {:.3} N \
                     there, by {:.3} N here",
                    n.rival, n.rival_error_ratio, n.change, n.differ_there_n, n.differ_here_n
                ));
            }
        }
        Verdict::Unexplained => {
            out.extend(record_more(d));
            out.push(
                "an effect of your own (`effects: {define: …}`) can be ranked beside the catalogue; wrong joint centres, a wrong prior of a link, or soft \
                 tissue of a person that moves all markers of a segment together leave such an error, too"
                    .to_owned(),
            );
        }
        Verdict::NothingMissing => {}
        Verdict::Supported => {}
    }
    out
}

/// What to record where so few flights or trials count as evidence that no effect could be named,
/// or only a large one; none where there are many.
fn record_more(d: &Discovery) -> Option<String> {
    let place = &d.rounds.first()?.judged_on;
    let of = |place: &str| d.rounds.iter().filter(|r| r.judged_on == place).map(|r| r.clusters).min();
    let contact = domain(Domain::Contact);
    let fewer_than = |most: usize, place: &str| of(place).filter(|n| *n < most);
    if let Some(n) = fewer_than(FEWEST_CLUSTERS, place).filter(|_| place != contact) {
        return Some(format!(
            "record more flights, at least {FEWEST_CLUSTERS}, better in {FEWEST_CLUSTERS} trials: {n} count now, too few to name any effect"
        ));
    }
    if let Some(n) = fewer_than(FEWEST_CLUSTERS, contact) {
        return Some(format!(
            "record more contact on the plates, at least {FEWEST_CLUSTERS} stretches, better in {FEWEST_CLUSTERS} trials: {n} count now, too few \
             to name any effect there"
        ));
    }
    let n = fewer_than(MANY_CLUSTERS, place)?;
    let what = if place == contact { "contact on the plates" } else { "flights" };
    Some(format!(
        "record more {what}: {n} flights or trials count now, and from {MANY_CLUSTERS} on smaller effects can be named"
    ))
}

/// What a session without flights cannot show.
pub(crate) fn no_flights(untried: usize) -> String {
    format!(
        "no recording has a flight: only errors of the plates and of the stated mass can be judged; {untried} effects that act in the air, \
         too, were not tried, because on the plates they cannot be told from these errors (record jumps)"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn unexplained(verdict: &str, clusters: usize) -> Discovery {
        let round = json!({"judged_on": "flight", "model": [], "held_out_error": 39.9, "held_out_parts": [null, null],
            "threshold": 0.7, "null_quantiles": [0.3, 0.9, 0.95], "clusters": clusters, "effects": [], "words": "",
            "verdict": verdict, "candidates": []});
        let candidate = json!({"effect": "a", "key": "a", "target": "body", "kind": "physics", "class": "", "judged_on": "flight",
            "held_out_ratio": 0.98, "ci95": [0.9, 1.1], "chosen_share": 1.0, "family_wise_p": 0.5, "coefficients": [],
            "nonlinear": [], "trials": [], "confused_with": [], "minimum_detectable": 0.001, "plausible": true,
            "believed": false, "placebo": false, "alternatives": []});
        let answer = json!({"schema": 1, "verdict": verdict, "effects": [], "words": "", "noise_floor": 9.3,
            "held_out_error": 39.9, "held_out_error_after": 39.9, "held_out_error_of_weight": 0.06,
            "candidates": [candidate], "rounds": [round], "found": [], "advice": [], "warnings": []});
        serde_json::from_value(answer).unwrap()
    }

    #[test]
    fn few_flights_are_the_first_thing_that_the_advice_names() {
        let has = |lines: &[String], words: &str| lines[0].contains(words);
        for verdict in ["unexplained", "not_detectable"] {
            let few = advice(&unexplained(verdict, 2), &[]);
            assert!(has(&few, "record more flights, at least 6") && has(&few, "2 count now"), "{few:?}");
            let more = advice(&unexplained(verdict, 8), &[]);
            assert!(has(&more, "record more flights: 8 flights or trials"), "{more:?}");
        }
        let many = advice(&unexplained("unexplained", 20), &[]);
        assert!(many.len() == 1 && has(&many, "an effect of your own"), "{many:?}");
    }
}
