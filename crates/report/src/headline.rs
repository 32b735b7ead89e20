//! The first screen: how wrong the model is, where, what is missing, how sure, what to do next.

use super::place_errors::{self, PlaceError, answers, asked, effects, errors_by_place};
use super::session;
use super::story::Story;
use super::sureness::{how_sure, laws, missing, named, with_links};
use super::wording::{count, number};
use aloft_analysis::compare::ComparisonView;
use aloft_analysis::next_step::{Because, Begin, NextStep, rivals_of, step};
use aloft_analysis::parameters::ParametersView;
use aloft_compare::{Comparison, GroupedBy, Reserve, growth};
use aloft_discover::Verdict;
use aloft_page::{Fact, Headline};
use aloft_study::commands::command;

/// The headline.
pub fn headline(story: &Story<'_>) -> Headline {
    if let Some(view) = story.comparison.as_ref().filter(|v| !v.limits.is_empty()) {
        return unjudged(story, view);
    }
    let all = errors_by_place(story);
    let sentence = sentence(story, all.first(), all.get(1));
    let mut facts: Vec<Fact> = Vec::new();
    if let Some(first) = all.first() {
        facts.push(Fact::new("How wrong", how_wrong(first, all.get(1))));
        facts.extend(place(story, first).map(|text| Fact::new("Where", text)));
    }
    facts.push(Fact::new("Missing", missing(story)));
    facts.push(Fact::new("How sure", how_sure(story, all.first())));
    facts.extend(session::brief(story).map(|text| Fact::new("Recordings", text)));
    facts.push(next(story));
    let (light, word) = place_errors::standing(story);
    Headline { light, word, sentence, facts }
}

/// The first screen of a model that is not the whole body: nothing in it is a judgement.
fn unjudged(story: &Story<'_>, view: &ComparisonView) -> Headline {
    let sentence = match story.failures.first() {
        Some((stage, f)) => format!("`{stage}` failed: {}.", f.problem.trim_end_matches('.')),
        None if story.subject.as_ref().is_some_and(|s| s.estimated.is_some() && s.model.is_whole()) => {
            "Joint motion without markers; the masses are from tables, and nothing is identified or judged.".to_owned()
        }
        None => "Joint motion of a part of the body; its masses are from tables, and nothing is identified or judged."
            .to_owned(),
    };
    let mut facts: Vec<Fact> = ["Why", "What holds"]
        .iter()
        .zip(&view.limits)
        .map(|(name, text)| {
            let text = text.trim_start_matches("what holds: ");
            Fact::new(name, sentence_of(text))
        })
        .collect();
    let on_plates = view.errors.iter().find(|e| e.judged_on == "contact");
    if let Some(e) = on_plates.or(view.errors.first()) {
        let unseen = story.subject.as_ref().is_some_and(|s| !s.model.is_whole());
        let more = if unseen { "the motion of the unseen parts" } else { "the error of the joints' places" };
        let text = format!("{} N, {more} included.", number(e.held_out_error));
        let what = if on_plates.is_some() { "Difference from the plates" } else { "Difference from free fall" };
        facts.push(Fact::new(what, text));
    }
    let stale = !story.freshness.is_current() || !story.failures.is_empty();
    facts.push(if stale {
        Fact { command: command(story.session, "run", None), ..Fact::new("Next", "Bring the results up to date.") }
    } else {
        Fact::new("Next", "Record markers on the whole body, and jumps, where masses are to be identified.")
    });
    let (light, word) = place_errors::standing(story);
    Headline { light, word, sentence, facts }
}

fn held(story: &Story<'_>) -> String {
    let effects = effects(story);
    if effects.is_empty() { "The model".to_owned() } else { format!("With `{}` the model", effects.join("`, `")) }
}

fn sentence(story: &Story<'_>, first: Option<&PlaceError>, other: Option<&PlaceError>) -> String {
    if let Some((stage, f)) = story.failures.first() {
        return format!("`{stage}` failed: {}.", f.problem.trim_end_matches('.'));
    }
    let wrong = story.comparison.as_ref().and_then(|v| v.impulse_mass.as_ref()).filter(|m| m.wrong.is_some());
    if let Some(mass) = wrong {
        let (weighed, stated) = (number(mass.mass_kg), number(mass.stated_kg));
        return format!(
            "The force plates give a body mass of {weighed} kg and {stated} kg is stated: correct the mass before any error here is used."
        );
    }
    let void = story.comparison.as_ref().and_then(|v| v.to_correct.as_ref()).filter(|c| c.void);
    if let Some(c) = void {
        return sentence_of(&c.words);
    }
    let Some(first) = first else {
        if !story.freshness.is_current() {
            return "Nothing is compared yet: the run has not ended, or was interrupted.".to_owned();
        }
        return "Nothing was compared: there is no flight, and no contact that plates measure as a whole.".to_owned();
    };
    let place = &first.place;
    let Some(ratio) = first.ratio else {
        let known = first.interval_n.map_or_else(
            || "is not known".to_owned(),
            |[a, b]| format!("is known only between {} and {} N, too roughly to judge it", number(a), number(b)),
        );
        return format!("{} errs by {} N in {place}; its noise floor {known}.", held(story), number(first.error_n));
    };
    // the other kind of motion is told of where the model is worse there
    let worse = other.filter(|o| o.graded.grade > first.graded.grade).and_then(|o| Some((o.place.clone(), o.ratio?)));
    if first.at_floor {
        let no_more = format!("{} errs no more in {place} than a perfect model could", held(story));
        return match (worse, first.graded.because) {
            (Some((place, ratio)), _) => {
                format!("{no_more}, but {} times its noise floor in {place}.", super::lights::times(ratio))
            }
            (None, Some(Reserve::CorrectFirst)) => {
                format!("{no_more}, but the recordings have to be corrected first.")
            }
            (None, Some(Reserve::FromTables)) => format!("{no_more}, but {}.", from_tables(story)),
            (None, None) => {
                format!("{} is at its noise floor in {place}: a perfect model could err as much.", held(story))
            }
        };
    }
    let times = super::lights::times;
    let also = worse.map_or(String::new(), |(place, ratio)| format!(" and {} times in {place}", times(ratio)));
    let wrong = format!("{} errs by {} times its noise floor in {place}{also}", held(story), times(ratio));
    match asked(story) {
        None if story.comparison.as_ref().is_some_and(|v| v.too_few_to_ask()) => format!("{wrong}."),
        None => format!("{wrong}. `discover` has not been run."),
        Some(d) => match d.verdict {
            Verdict::Supported => {
                let keys: Vec<String> = named(d).iter().map(|key| with_links(key, d)).collect();
                format!("{wrong}, and {} {} missing.", keys.join(" and "), if keys.len() == 1 { "is" } else { "are" })
            }
            Verdict::OneOf => match d.groups.len() {
                0 | 1 => format!("{wrong}: one of {} effects is missing.", d.effects.len()),
                n => format!("{wrong}: {n} effects are missing, of which not all can be told from others."),
            },
            Verdict::Unexplained if laws(d).is_some() => {
                format!("{wrong}, and a law outside the catalogue describes it.")
            }
            Verdict::Unexplained => format!("{wrong}, and no effect of the catalogue explains it."),
            Verdict::NothingMissing => format!("{wrong}; no missing effect was found."),
            Verdict::NotDetectable => format!("{wrong}; the recordings cannot tell what is missing."),
        },
    }
}

/// Why the body is that of the tables.
fn from_tables(story: &Story<'_>) -> String {
    match story.found.as_ref().map_or(0, |found| found.parameters.n_flights()) {
        0 => "nothing was identified from motion".to_owned(),
        1 => "1 flight is too little to determine the body".to_owned(),
        n => format!("{} are too few to determine the body", count(n, "flight")),
    }
}

fn how_wrong(first: &PlaceError, other: Option<&PlaceError>) -> String {
    let of = |(force, moment)| format!(" (force {} N, moment {} N·m)", number(force), number(moment));
    let parts = first.force_and_moment.map_or(String::new(), of);
    let mut text = format!("{} N{parts} on held-out {}", number(first.error_n), first.place);
    if let Some(floor) = first.floor_n {
        text.push_str(&format!("; a perfect model would leave {} N", number(floor)));
        if let Some([low, high]) = first.interval_n {
            text.push_str(&format!(" ({} to {})", number(low), number(high)));
        }
    }
    if let Some(other) = other {
        text.push_str(&format!(". In {}: {} N, {}", other.place, number(other.error_n), other.ratio_words()));
    }
    text.push('.');
    text
}

/// Ratio between groups from which a trend is told.
const TREND: f64 = 1.5;

fn place(story: &Story<'_>, first: &PlaceError) -> Option<String> {
    let c = &story.comparison.as_ref()?.comparison;
    let mut parts = Vec::new();
    if let Some((axis, ratio)) = times_floor_by_axis(c, &first.place)
        .into_iter()
        .filter(|(_, r)| r.is_finite())
        .max_by(|a, b| a.1.total_cmp(&b.1))
    {
        parts.push(format!("most in {axis} ({} × its floor)", super::lights::times(ratio)));
    }
    if !first.at_floor {
        parts.extend(trend(c));
        let segments = if first.place == "flight" && !c.first.segments_in_flight.is_empty() {
            &c.first.segments_in_flight
        } else {
            &c.first.segments
        };
        if let Some(s) = segments.first().filter(|s| s.inertia_share > 0.3 && segments.len() > 2) {
            parts.push(format!("{:.0} % of it could originate in `{}`", 100.0 * s.inertia_share, s.link));
        }
    }
    (!parts.is_empty()).then(|| sentence_of(&parts.join("; ")))
}

/// Names of the axes and the error over windows along each, in multiples of the floor of the same
/// axis: force, then moment, world axes.
pub fn times_floor_by_axis(c: &Comparison, place: &str) -> Vec<(String, f64)> {
    let Some(floor) = &c.noise_floor else { return Vec::new() };
    let (own, floor) = if place == "flight" {
        (&c.first.flight_weak, &floor.flight_weak)
    } else {
        (&c.first.held_out_weak, &floor.contact_weak)
    };
    let of = |what: &str, own: &[f64; 3], floor: &[f64; 3]| {
        ["x", "y", "z"]
            .iter()
            .enumerate()
            .map(|(i, axis)| (format!("{what} {axis}"), own[i] / floor[i]))
            .collect::<Vec<_>>()
    };
    let mut out = of("force", &own.force_n.rmse, &floor.force_n.rmse);
    out.extend(of("moment", &own.moment_nm.rmse, &floor.moment_nm.rmse));
    out
}

/// The quantity with which the error grows most, if it grows by more than [`TREND`].
fn trend(c: &Comparison) -> Option<String> {
    let kinds = [
        (GroupedBy::Speed, "the speed of the centre of mass"),
        (GroupedBy::Turning, "angular velocity of the root"),
        (GroupedBy::TimeInFlight, "the time in flight"),
        (GroupedBy::Acceleration, "the acceleration of the centre of mass"),
    ];
    let grown = kinds
        .iter()
        .filter_map(|(by, what)| Some((growth(&c.first.breakdown, *by)?, what)))
        .max_by(|a, b| a.0.total_cmp(&b.0))?;
    (grown.0 > TREND).then(|| format!("grows {} times with {}", super::lights::times(grown.0), grown.1))
}

fn next(story: &Story<'_>) -> Fact {
    let s = story.session;
    let with = |text: &str, command: String| Fact { command, ..Fact::new("Next", text) };
    if !story.freshness.is_current() || !story.failures.is_empty() {
        return with("Bring the results up to date.", command(s, "run", None));
    }
    let Some(found) = &story.found else {
        let compared = story.comparison.as_ref().is_some_and(|v| v.parameters.nothing.is_some());
        return if compared {
            Fact::new("Next", "Record flights: jumps from and onto the plates.")
        } else {
            with("Search for missing effects.", command(s, "status", None))
        };
    };
    let Some(view) = &story.comparison else {
        return with("Search for missing effects.", command(s, "status", None));
    };
    let held: Vec<&str> = effects(story).iter().map(String::as_str).collect();
    let explanations = rivals_of(story.session, asked(story), &story.checked, &story.offered);
    match step(view, answers(story, &explanations), &held) {
        NextStep::Run => with("Bring the results up to date.", command(s, "run", None)),
        NextStep::Correct { what, begin } => {
            // this is the report; what it shows changes the pipeline, and then the results
            let verb = if begin == Begin::Check { "check" } else { "run" };
            with(&sentence_of(&what), command(s, verb, None))
        }
        NextStep::Discover { record: None } => with("Run `discover`.", command(s, "discover", None)),
        NextStep::Discover { record: Some(_) } => with(
            &format!("Record more flights: {}. Then ask what is missing; these can be asked already.", motion(found)),
            command(s, "discover", None),
        ),
        NextStep::Record(_) if !found.parameters.gate.passed => {
            Fact::new("Next", format!("Record more flights: {}.", motion(found)))
        }
        NextStep::Record(what) => Fact::new("Next", sentence_of(&what)),
        NextStep::Add { key, because } => {
            let text = match because {
                Because::Named => "Add it.",
                Because::OneOf => "Record what tells them apart, or add the simplest.",
                Because::Law => "Add it, and rank it again on other motions.",
            };
            with(text, command(s, "effect add", Some(&key)))
        }
        NextStep::Remove { key } => with(
            &format!("Remove `{key}`, which these recordings do not show."),
            command(s, "effect remove", Some(&key)),
        ),
        NextStep::Advised(advice) => Fact::new("Next", sentence_of(&advice)),
        NextStep::Use => with("Use the model.", command(s, "parameters", None)),
        NextStep::Look => with("Locate the error.", command(s, "compare", None)),
    }
}

/// The motion that would determine most of what the recordings do not.
fn motion(found: &ParametersView) -> &str {
    found.parameters.gate.next_motion.as_deref().unwrap_or("with faster motion of all limbs")
}

/// A clause as a sentence: a capital letter at its begin, a full stop at its end.
pub(crate) fn sentence_of(clause: &str) -> String {
    let mut text = clause.trim_end_matches('.').to_owned();
    if let Some(first) = text.chars().next() {
        text.replace_range(..first.len_utf8(), &first.to_uppercase().to_string());
    }
    text + "."
}

/// Text below the ladder: the floor in words.
pub fn floor_words(first: &PlaceError) -> String {
    match (first.floor_n, first.interval_n) {
        (Some(floor), Some([low, high])) => {
            format!(
                "noise floor {} N ({} to {} N, shaded): the error of a perfect model on these recordings",
                number(floor),
                number(low),
                number(high)
            )
        }
        (Some(floor), None) => {
            format!("noise floor {} N: the error of a perfect model on these recordings", number(floor))
        }
        _ => "the noise floor is not known".to_owned(),
    }
}
