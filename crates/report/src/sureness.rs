//! What is missing from the model, and how sure that is, for the first screen.

use super::headline::sentence_of;
use super::lights::times;
use super::place_errors::{PlaceError, asked, effects};
use super::story::Story;
use super::wording::{count, number, plus_minus, unit};
use aloft_analysis::compare::ParametersBrief;
use aloft_analysis::verdict;
use aloft_discover::{Candidate, Discovery, OpenWorld, Verdict};

/// Laws that explain the error where no effect of the catalogue does.
pub(crate) fn laws(d: &Discovery) -> Option<&OpenWorld> {
    d.open.as_ref().filter(|o| o.complete && !o.laws.is_empty())
}

/// What is missing where the recordings cannot tell all of it apart, the sure ones first.
fn one_of(d: &Discovery) -> String {
    let list = |effects: &[String], word: &str| {
        effects.iter().map(|e| format!("`{e}`")).collect::<Vec<_>>().join(&format!(" {word} "))
    };
    let sure = d.groups.iter().filter(|g| g.is_sure()).map(|g| list(&g.effects, "and"));
    let unsure = d.groups.iter().filter(|g| !g.is_sure()).map(|g| match g.missing {
        1 => format!("one of {}", list(&g.effects, "or")),
        n => format!("{n} of {}", list(&g.effects, "and")),
    });
    let each: Vec<String> = sure.chain(unsure).collect();
    match each.as_slice() {
        [] | [_] => format!("One of {}; these recordings cannot tell which.", list(&d.effects, "or")),
        all => format!("{}; these recordings cannot tell more.", all.join(", and ")),
    }
}

/// Keys of what the verdict names, or else the identifiers.
pub(crate) fn named(d: &Discovery) -> Vec<String> {
    let keys: Vec<String> = d.found.iter().filter(|f| d.effects.contains(&f.effect)).map(|f| f.key.clone()).collect();
    if keys.is_empty() { d.effects.clone() } else { keys }
}

/// A key with the other links on which the effect may act.
pub(crate) fn with_links(key: &str, d: &Discovery) -> String {
    let others = d.found.iter().find(|f| f.key == key).map_or(&[][..], |f| &f.also_on);
    if others.is_empty() { format!("`{key}`") } else { format!("`{key}` (or on `{}`)", others.join("` or `")) }
}

/// What a candidate is, with its coefficients.
fn described(key: &str, d: &Discovery) -> String {
    let of = |c: &aloft_discover::Estimate| {
        format!("{} {} {}", c.name.replace('_', " "), plus_minus(c.value, c.ci95), unit(&c.unit))
    };
    let its = d.found.iter().find(|f| f.key == key);
    let coefficients: Vec<String> = its.map_or(Vec::new(), |f| f.coefficients.iter().take(2).map(of).collect());
    let links = its.and_then(aloft_discover::Found::other_links).map_or(String::new(), |words| format!(" ({words})"));
    if coefficients.is_empty() {
        format!("`{key}`{links}")
    } else {
        format!("`{key}`: {}{links}", coefficients.join(", ").trim_end())
    }
}

/// What is missing, in a sentence.
pub(crate) fn missing(story: &Story<'_>) -> String {
    let own = effects(story);
    let Some(d) = asked(story) else {
        return if story.comparison.as_ref().is_some_and(|v| v.too_few_to_ask()) {
            "Not asked: that takes at least two flights or two recordings with contact.".to_owned()
        } else if own.is_empty() {
            "Not asked: `discover` looks for the effect that the model is missing.".to_owned()
        } else {
            format!("`{}` is in the model; `discover` has not been run since.", own.join("`, `"))
        };
    };
    match d.verdict {
        Verdict::Supported => {
            let sure = named(d).iter().map(|k| described(k, d)).collect::<Vec<_>>();
            let unsure =
                d.groups.iter().filter(|g| !g.is_sure()).map(|g| format!("and one of `{}`", g.effects.join("`, `")));
            let all: Vec<String> = sure.into_iter().chain(unsure).collect();
            format!("{}.", all.join("; "))
        }
        Verdict::OneOf => one_of(d),
        Verdict::NothingMissing => verdict::not_excluded(d).map_or_else(
            || "None that these recordings can detect.".to_owned(),
            |sizes| format!("None that these recordings can detect. Not excluded: {sizes}."),
        ),
        Verdict::Unexplained => match (laws(d), d.open.as_ref().and_then(|o| o.diagnosis.as_ref())) {
            (Some(open), _) => {
                let each: Vec<String> = open.laws.iter().map(|l| format!("`{}`: {}", l.id, l.text)).collect();
                format!("{}.", each.join("; and "))
            }
            (None, Some(found)) => format!("No law was found; the nearest is {}.", found.text),
            (None, None) if !d.found.is_empty() => {
                let keys: Vec<&str> = d.found.iter().map(|f| f.key.as_str()).collect();
                format!("Unknown. `{}` reduces the error, but is not established as the cause.", keys.join("` with `"))
            }
            (None, None) => "Unknown: no effect of the catalogue explains the error.".to_owned(),
        },
        Verdict::NotDetectable => "The recordings are too few or too noisy to tell.".to_owned(),
    }
}

/// How sure the answers are: what the best effect leaves, and how much of the body the flights
/// determine.
pub(crate) fn how_sure(story: &Story<'_>, first: Option<&PlaceError>) -> String {
    let mut parts: Vec<String> = asked(story).and_then(|d| evidence(story, d, first)).into_iter().collect();
    // of the effects in the model
    parts.extend(story.history.revisions.last().iter().flat_map(|r| &r.cautions).map(|words| sentence_of(words)));
    if let Some(found) = &story.found {
        let p = &found.parameters;
        let flights = p.stretches();
        let brief = story.comparison.as_ref().map(|v| &v.parameters).filter(|b| b.in_all > 0);
        parts.push(match (p.gate.passed, p.gate.reasons.first(), brief) {
            (true, _, Some(ParametersBrief { reservation: Some(words), .. })) => {
                format!("{flights} determine the parameters, but {words}.")
            }
            (true, None, _) => format!("{flights} determine the parameters."),
            (true, Some(reason), _) => format!("{flights}: {}.", reason.trim_end_matches('.')),
            (false, ..) if p.gate.misfit.is_some() => {
                "The parameters are those of a model whose joints or markers are elsewhere.".to_owned()
            }
            (false, _, Some(b)) => {
                let verb = if p.n_flights() == 1 { "is too little" } else { "are too few" };
                let (seen, all) = (b.from_motion, b.in_all);
                format!("{flights} {verb} to determine the body: {seen} of {all} parameters are from motion, the rest from tables.")
            }
            (false, ..) => format!("{flights}, too little to determine the parameters."),
        });
    }
    let lost = story.trials.iter().filter(|t| !t.failures.is_empty()).count();
    if lost > 0 {
        parts.push(format!("{} failed and is excluded from these numbers.", count(lost, "recording")));
    }
    let nothing = || {
        let why = story.comparison.as_ref().and_then(|v| v.parameters.nothing.clone());
        sentence_of(why.as_deref().unwrap_or("nothing was identified"))
    };
    if parts.is_empty() { nothing() } else { parts.join(" ") }
}

/// What the discovery rests on, in a sentence.
fn evidence(story: &Story<'_>, d: &Discovery, first: Option<&PlaceError>) -> Option<String> {
    if let Some((open, after, p)) = laws(d).and_then(|o| Some((o, o.times_floor_after?, o.laws.first()?.family_wise_p)))
    {
        return Some(format!(
            "With it the held-out error falls to {} times the floor; with random signs the best of {} combinations does as well with a \
             probability of about {}.",
            times(after),
            open.entries,
            verdict::at_most(p)
        ));
    }
    if let Some(words) = verdict::how_sure(d) {
        return Some(sentence_of(&words));
    }
    if let Some(found) = d.found.first() {
        let first = first?;
        let (error, ratio) = after_all(story, first)?;
        let still = ratio.map_or(String::new(), |r| format!(", {} times the floor", times(r)));
        return Some(format!(
            "With `{}` the error in {} would still be {} N{still}.",
            found.key,
            first.place,
            number(error)
        ));
    }
    // candidates of flights and of contact leave shares of different errors
    let place = first.map(|f| f.place.as_str());
    let of = |c: &&Candidate| c.held_out_ratio.is_finite() && Some(c.judged_on.as_str()) == place;
    let best = d.candidates.iter().filter(of).min_by(|a, b| a.held_out_ratio.total_cmp(&b.held_out_ratio))?;
    let percent = |x: f64| format!("{:.0}", 100.0 * x);
    let falls =
        format!("{} % ({} to {} %)", percent(best.held_out_ratio), percent(best.ci95[0]), percent(best.ci95[1]));
    let odds = best.evidence.map_or(String::new(), |e| {
        format!("; its odds are {}, and to be named it needs 20 to 1", aloft_discover::odds(e.sure()))
    });
    Some(format!("The best effect, `{}`, leaves {falls} of the error in {}{odds}.", best.key, best.judged_on))
}

/// Error that the stages found with all effects of the last discovery in the model, where the model
/// is judged, N, and its ratio to the floor; none where it was not computed.
pub(crate) fn after_all(story: &Story<'_>, first: &PlaceError) -> Option<(f64, Option<f64>)> {
    let d = asked(story)?;
    let kept = story.discoveries.last().map(|(_, kept)| kept)?;
    if let Some(e) = kept.errors_after.iter().find(|e| e.judged_on == first.place) {
        return Some((e.held_out_error, e.times_floor));
    }
    // the ranking's own estimate holds where its first round was judged
    let same = d.rounds.first().is_some_and(|r| r.judged_on == first.place);
    let error = Some(d.held_out_error_after).filter(|e| same && e.is_finite())?;
    Some((error, first.floor_n.map(|floor| error / floor)))
}
