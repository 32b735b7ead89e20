//! The verdict of a discovery in its documented words, for the terminal and the report.

use aloft_compare::significant;
use aloft_discover::{Discovery, Verdict};
use aloft_effects::EffectKind;

/// What is missing, group by group: `one of {wind, tilt}, and flywheel`.
pub fn groups(d: &Discovery) -> String {
    let each: Vec<String> = d
        .groups
        .iter()
        .map(|g| match (g.is_sure(), g.missing) {
            (true, _) => g.effects.join(", "),
            (_, 1) => format!("one of {{{}}}", g.effects.join(", ")),
            (_, n) => format!("{n} of {{{}}}", g.effects.join(", ")),
        })
        .collect();
    // results of an earlier version have no groups
    if each.is_empty() { format!("one of {{{}}}", d.effects.join(", ")) } else { each.join(", and ") }
}

/// The verdict in a few words: `supported: tether`, `one of {wind, tilt}`, `nothing missing` …
pub fn words(d: &Discovery) -> String {
    let kind = |id: &String| d.candidates.iter().find(|c| c.effect == *id).map(|c| c.kind);
    let artefact = !d.effects.is_empty() && d.effects.iter().all(|e| kind(e) == Some(EffectKind::Artefact));
    let names = || d.effects.join(", ");
    match d.verdict {
        Verdict::Supported if artefact => format!("artefact more likely: {}", names()),
        Verdict::Supported => format!("supported: {}", names()),
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
