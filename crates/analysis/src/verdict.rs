//! The verdict of a discovery in its documented words, for the terminal and the report.

use aloft_compare::significant;
use aloft_discover::{Candidate, Discovery, Estimate, Group, Verdict};
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

/// What the evidence for the named effects is: what the first of them leaves of the error, and what
/// chance alone would; none where none is named.
pub fn how_sure(d: &Discovery) -> Option<String> {
    if !matches!(d.verdict, Verdict::Supported | Verdict::OneOf) {
        return None;
    }
    let round = d.rounds.iter().find(|r| matches!(r.verdict, Verdict::Supported | Verdict::OneOf))?;
    let here = |c: &&Candidate| !c.placebo && round.effects.contains(&c.effect);
    let best = round.candidates.iter().filter(here).min_by(|a, b| a.held_out_ratio.total_cmp(&b.held_out_ratio))?;
    let (share, chance) = round.by_chance();
    let unit = if best.judged_on == "contact" { "stretches of contact" } else { "flights or trials" };
    let percent = |x: f64| format!("{:.0}", 100.0 * x);
    let subject = if d.found.len() > 1 { format!("`{}` alone", best.key) } else { "it".to_owned() };
    // the error after all of them is that of the motion on which the first was judged
    let same_place = d.rounds.iter().filter(|r| !r.joined.is_empty()).all(|r| r.judged_on == best.judged_on);
    let all = if d.found.len() > 1 && same_place && d.held_out_error > 0.0 {
        let left = percent(d.held_out_error_after / d.held_out_error);
        format!("; the {} effects found leave {left} % together", d.found.len())
    } else {
        String::new()
    };
    Some(format!(
        "{subject} leaves {} % ({} to {} %) of the error in {unit} that were left out{all}; by chance the best of all candidates leaves less \
         than {} % in {} of 100 cases",
        percent(best.held_out_ratio),
        percent(best.ci95[0]),
        percent(best.ci95[1]),
        percent(chance),
        percent(share)
    ))
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
        Verdict::NotDetectable => {
            // a limit only where the estimate itself is below it
            let small = |c: &&Candidate| of_first_unit(c).all(|e| e.value.abs() < c.minimum_detectable);
            let below = d.candidates.iter().find(|c| !c.placebo).filter(small).map_or(String::new(), |c| {
                let unit = c.coefficients.first().map_or("", |e| e.unit.as_str());
                format!(" (below {} {unit} of {})", significant(c.minimum_detectable, 2), c.key)
            });
            format!("not detectable{below}")
        }
    }
}
