//! The verdict of a discovery in its documented words, for the terminal and the report.

use aloft_compare::significant;
use aloft_discover::{Discovery, Group, Verdict};
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
pub fn words(d: &Discovery) -> String {
    match &d.joints {
        Some(j) => format!("{}; in the torques of joints: {}", of_body(d), j.short()),
        None => of_body(d),
    }
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
            let below = d.candidates.iter().find(|c| !c.placebo).map_or(String::new(), |c| {
                let unit = c.coefficients.first().map_or("", |e| e.unit.as_str());
                format!(" (below {} {unit} of {})", significant(c.minimum_detectable, 2), c.key)
            });
            format!("not detectable{below}")
        }
    }
}
