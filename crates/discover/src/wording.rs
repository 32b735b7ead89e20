//! The result of a discovery in words.

use crate::held_out::HeldOutResult;
use crate::laws::{OpenWorld, WHOLE_BODY};
use crate::problem::Domain;
use crate::result::{
    AgainstLaw, Candidate, Discovery, Estimate, FEWEST_CLUSTERS, Group, MANY_CLUSTERS, Round, Verdict,
};
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

/// What is said of effects that fit only as the limit of a simpler one.
fn as_limits(limits: &[&str]) -> String {
    let names = limits.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>();
    match &names[..] {
        [] => String::new(),
        [one] => format!(" ({one} would look the same from far away or at high speed)"),
        [most @ .., last] => {
            format!(" ({} and {last} would look the same from far away or at high speed)", most.join(", "))
        }
    }
}

/// Why nothing is named where there are too few clusters.
pub const TOO_FEW: &str = "fewer than six flights or trials are too few to name an effect";

pub(crate) fn round(
    verdict: Verdict,
    effects: &[String],
    limits: &[&str],
    candidates: &[Candidate],
    few: bool,
) -> String {
    let best = candidates.iter().find(|c| !c.placebo);
    let first = effects.first().and_then(|e| candidates.iter().find(|c| c.effect == *e));
    match (verdict, first, best) {
        (Verdict::Supported, Some(c), _) => format!(
            "{}: `{}` is missing: held-out error falls to {:.0} % ({:.0}-{:.0} %){}{}",
            if c.kind == EffectKind::Artefact { "artefact more likely than physics" } else { "supported" },
            c.key,
            100.0 * c.held_out_ratio,
            100.0 * c.ci95[0],
            100.0 * c.ci95[1],
            if c.class.is_empty() { String::new() } else { format!(" (cannot be told from: {})", c.class) },
            as_limits(limits),
        ),
        (Verdict::OneOf, Some(c), _) => format!(
            "one of {} is missing, which these recordings cannot tell apart; with `{}` held-out error falls to {:.0} %{}",
            list(effects),
            c.key,
            100.0 * c.held_out_ratio,
            as_limits(limits),
        ),
        (_, _, Some(b)) => format!(
            "{}: the best candidate, `{}`, leaves {:.1} % of the held-out error; {}",
            if verdict == Verdict::NotDetectable { "not detectable" } else { "nothing missing" },
            b.key,
            100.0 * b.held_out_ratio,
            if few {
                TOO_FEW.to_owned()
            } else {
                b.doubt(candidates.iter().filter(|c| c.placebo).map(|c| c.held_out_ratio).reduce(f64::min))
            },
        ),
        _ => "no effect could be tried".to_owned(),
    }
}

/// A round in which an effect was judged beside the others found.
pub(crate) fn beside(round: &Round) -> String {
    if round.model.is_empty() { round.words.clone() } else { format!("beside {} {}", list(&round.model), round.words) }
}

/// A round in which two effects together explain what one does not: `left` is the share of the
/// error that remains, in percent, `one` the best single effect, if there is one, and what it
/// leaves.
pub(crate) fn pair(pair: &[String; 2], left: f64, one: Option<(String, f64)>) -> String {
    let [a, b] = pair;
    let why = match one {
        Some((key, of_one)) => {
            format!("one alone explains less (the best of them, `{key}`, leaves {of_one:.0} %)")
        }
        None => "none explains it alone".to_owned(),
    };
    format!("two effects together, `{a}` and `{b}`, are missing: held-out error falls to {left:.0} %; {why}")
}

/// A round in which two effects together explain as much as those named; `joins` if the two join
/// the model, `left` the share of the error that remains with what joins.
pub(crate) fn or_pair(effects: &[String], pair: &[String; 2], joins: bool, left: f64) -> String {
    let [a, b] = pair;
    let single = effects.iter().map(|e| format!("`{e}`")).collect::<Vec<_>>().join(" or ");
    let with = if joins { format!("`{a}` and `{b}`") } else { single.clone() };
    format!(
        "{single}, or `{a}` and `{b}` together, is missing, which these recordings cannot tell apart; with {with} held-out error falls to {:.0} %",
        100.0 * left
    )
}

/// What the catalogue says before the search beyond it, with the error in flight of the model
/// (`now`), or `with` the effects that it names.
pub(crate) fn so_far(d: &Discovery, now: Option<HeldOutResult>, with: Option<HeldOutResult>) -> String {
    let group = |g: &Group| match &g.effects[..] {
        [one] => format!("`{one}`"),
        several => format!("one of {}", list(several)),
    };
    let named = matches!(d.verdict, Verdict::Supported | Verdict::OneOf) && !d.groups.is_empty();
    let groups: Vec<String> = d.groups.iter().map(group).collect();
    let (says, left, of, begins) = match &groups[..] {
        groups if named => {
            let it = if groups.len() > 1 { "them" } else { "it" };
            (
                format!("the catalogue names {} as missing", groups.join(", and ")),
                with,
                format!("with {it} "),
                format!("comparing {it} with laws"),
            )
        }
        _ => ("no effect of the catalogue explains the error".to_owned(), now, String::new(), "searching".to_owned()),
    };
    let left = left.map_or(String::new(), |left| {
        format!(
            "; {of}the error in flight is {} N, {} times the noise floor",
            digits(left.held_out_error, 3),
            digits(left.times_floor(), 2)
        )
    });
    format!("{says}{left}. Now {begins} beyond the catalogue, which may change the answer")
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

    /// Why it is not accepted; `placebo` is the smallest ratio that a placebo leaves.
    pub fn doubt(&self, placebo: Option<f64>) -> String {
        if let Some(e) = &self.evidence {
            let probability = match e.probability {
                p if p >= 1e-3 => digits(p, 2),
                p if p > 0.0 => format!("10^{:.0}", p.log10()),
                _ => "0".to_owned(),
            };
            return format!("odds of {} against nothing, probability {probability}", odds(e.ln_odds));
        }
        if self.accepted_below <= 0.0 {
            "every recording contains some of it, so it is not named after another effect was found".to_owned()
        } else if self.held_out_ratio >= self.accepted_below {
            format!("it would have to leave less than {:.0} %", 100.0 * self.accepted_below)
        } else if !self.plausible {
            "its size is zero, or at a physical limit".to_owned()
        } else if self.ci95[1] >= 1.0 {
            format!("the interval reaches {:.0} %", 100.0 * self.ci95[1])
        } else if placebo.is_some_and(|p| p <= self.held_out_ratio) {
            "a placebo effect fits equally well".to_owned()
        } else {
            "its gain comes from replacing part of the body weight".to_owned()
        }
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
    let best = d.candidates.iter().find(|c| !c.placebo).map_or(String::new(), |c| {
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
    let here = |c: &&Candidate| !c.placebo && c.judged_on == place;
    let best = d.candidates.iter().find(here).map_or(String::new(), |c| {
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

/// What is said of an effect whose size the recordings tell only together with its other unknowns.
pub(crate) fn with_its_unknowns(key: &str, coefficient: &str) -> String {
    format!(
        "; the recordings determine the {coefficient} of `{key}` only together with its other unknowns: its interval contains zero, and with the effect the error is at its floor"
    )
}

/// The result in words; `far` is the domain in which the error is farthest above the noise floor,
/// if any.
pub(crate) fn answer(d: &Discovery, far: Option<(&str, HeldOutResult)>) -> String {
    if let (Verdict::Unexplained, Some((place, model_error))) = (d.verdict, far) {
        let left: String = d.not_tried.iter().map(|n| format!("; {n}")).collect();
        let found_here = |id: &String| d.rounds.iter().any(|r| r.judged_on == place && r.effects.contains(id));
        let part: Vec<String> = d.found.iter().filter(|f| found_here(&f.effect)).map(|f| f.key.clone()).collect();
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
        let nearest = d.candidates.iter().find(|c| !c.placebo && c.judged_on == place).map_or(String::new(), |c| {
            format!("; the best candidate, `{}`, leaves {:.1} % of the error", c.key, 100.0 * c.held_out_ratio)
        });
        let few = d.rounds.iter().any(|r| r.judged_on == place && r.clusters < FEWEST_CLUSTERS);
        let why = if few {
            "there are too few flights or trials to name an effect"
        } else {
            "no effect of the catalogue explains it"
        };
        return format!("unexplained: the held-out error in {place} is {remains}, and {why}{nearest}{left}");
    }
    let said: Vec<&str> = d
        .rounds
        .iter()
        .filter(|r| !r.superseded && matches!(r.verdict, Verdict::Supported | Verdict::OneOf))
        .map(|r| r.words.as_str())
        .collect();
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
    if let Some(misfit) = &d.misfit {
        text.push_str(&format!("; but {}", misfit.text));
    }
    for left in &d.not_tried {
        text.push_str(&format!("; {left}"));
    }
    text
}

/// The answer where the strength of the one effect found does not follow its law.
pub(crate) fn of_another_form(d: &Discovery, left: Option<HeldOutResult>) -> String {
    let why = d.misfit.as_ref().map_or("", |m| m.text.as_str());
    format!("unexplained: {}, but {why}", lowered(d, left))
}

/// The answer where a wind straight down is as likely as a resistance that acts `delay_s` late.
pub(crate) fn wind_or_late(d: &Discovery, left: Option<HeldOutResult>, delay_s: f64) -> String {
    format!(
        "unexplained: {}, but the stream of air points straight down: a resistance that acts {:.0} ms late looks the same in free \
         flight; throws in which the body turns faster may tell the two apart",
        lowered(d, left),
        1e3 * delay_s
    )
}

/// "`wind[links]` lowers the held-out error in flight to 1.1 times its floor".
fn lowered(d: &Discovery, left: Option<HeldOutResult>) -> String {
    let times = left.map_or(String::new(), |s| format!(" to {} times its floor", digits(s.times_floor(), 2)));
    let found: Vec<String> = d.found.iter().map(|f| f.key.clone()).collect();
    let lower = if found.len() > 1 { "together lower" } else { "lowers" };
    format!("{} {lower} the held-out error in flight{times}", list(&found))
}

/// The result with that of the search beyond the catalogue; `far` if the words say already that the
/// error is unexplained.
pub(crate) fn with_open(d: &Discovery, open: &OpenWorld, far: bool) -> String {
    if !open.complete {
        let in_doubt = d.against.as_ref().is_some_and(AgainstLaw::is_against_the_effect);
        let above = format!(
            "the held-out error in flight is {:.3} N, {:.1} times the noise floor, and {}",
            d.held_out_error,
            d.held_out_error / d.noise_floor,
            if in_doubt { "no effect is named" } else { "no effect of the catalogue explains it" }
        );
        // a verdict below three times the floor comes from the search
        let lead = if d.verdict == Verdict::Unexplained && !far { above } else { d.words.clone() };
        return format!("{lead}; {}", open.words);
    }
    let best = d.candidates.iter().find(|c| !c.placebo).map_or(String::new(), |c| {
        format!(": the best effect of the catalogue, `{}`, leaves {:.1} % of it", c.key, 100.0 * c.held_out_ratio)
    });
    format!(
        "the catalogue does not explain the held-out error of {:.3} N, {:.1} times the noise floor{best}; {}",
        d.held_out_error,
        d.held_out_error / d.noise_floor,
        open.words
    )
}

/// What is said of a named effect if a law does a little better.
pub(crate) fn of_another_law(a: &AgainstLaw) -> String {
    format!(
        "; in {} a law beyond the catalogue leaves {:.2} times the error of `{}` (p = {}): the force may follow another law",
        a.judged_on,
        a.error_ratio,
        a.effect,
        digits(a.p_value, 1)
    )
}

/// Why an effect is not named although it lowers the error.
pub(crate) fn refuted(a: &AgainstLaw) -> String {
    format!(
        "; `{}` is not named, because in {} a law beyond the catalogue leaves {:.2} times as much error (p = {})",
        a.effect,
        a.judged_on,
        a.error_ratio,
        digits(a.p_value, 1)
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
        Verdict::NotDetectable if d.candidates.iter().all(|c| c.placebo) => {}
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
