//! The first screen of a study of several subjects: how many models are at their floor, what is
//! missing, and the error of each in multiples of its floor.

use super::group::Row;
use super::lights;
use super::wording::count;
use aloft_compare::{Grade, Graded, Signal};
use aloft_discover::Verdict;
use aloft_page::{Dots, Fact, Figure, Headline, Light, Line, Words};
use std::collections::BTreeMap;

/// How many models are at their floor, what is missing, what to do next.
pub(super) fn headline(rows: &[Row], (light, word): (Light, &str), next: &str) -> Headline {
    let known: Vec<f64> = rows.iter().filter_map(|r| r.times_floor).collect();
    let good = rows.iter().filter(|r| r.graded.is_some_and(Graded::is_at_floor)).count();
    let sentence = if known.is_empty() {
        format!("Of {} no noise floor is known, so no error can be judged.", count(rows.len(), "subject"))
    } else {
        format!("{good} of {} are at the noise floor of their recordings.", count(rows.len(), "model"))
    };
    let mut facts = Vec::new();
    if !known.is_empty() {
        let (low, high) = known.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), v| (l.min(*v), h.max(*v)));
        let median = aloft_signal::median(&mut known.clone());
        let text = format!(
            "{} to {} times the floor, median {}.",
            lights::times(low),
            lights::times(high),
            lights::times(median)
        );
        facts.push(Fact::new("How wrong", text));
    }
    let worst = rows
        .iter()
        .filter(|r| r.times_floor.is_some())
        .max_by(|a, b| a.times_floor.unwrap_or(0.0).total_cmp(&b.times_floor.unwrap_or(0.0)));
    facts.extend(
        worst
            .into_iter()
            .filter_map(|w| Some((w, w.graded.filter(|g| !g.is_at_floor())?)))
            .map(|(w, g)| Fact::new("Where", format!("Most for {}: {}, {}.", w.name, w.worst_error, g.words()))),
    );
    let mut named: BTreeMap<String, usize> = BTreeMap::new();
    for (verdict, effects) in rows.iter().filter_map(|r| r.verdict.as_ref()) {
        if matches!(verdict, Verdict::Supported | Verdict::OneOf) {
            let text = if *verdict == Verdict::OneOf { effects.clone() } else { format!("`{effects}`") };
            *named.entry(text).or_default() += 1;
        }
    }
    let asked = rows.iter().filter(|r| r.verdict.is_some()).count();
    let missing = if asked == 0 {
        "Not asked.".to_owned()
    } else if named.is_empty() {
        format!("No effect was named for the {} analysed.", count(asked, "subject"))
    } else {
        let all: Vec<String> = named.iter().map(|(k, n)| format!("{k} for {n} of {}", rows.len())).collect();
        format!("{}.", all.join("; "))
    };
    facts.push(Fact::new("Missing", missing));
    let trusted = rows.iter().filter(|r| r.trusted == Some(true)).count();
    let lost = rows.iter().filter(|r| r.failure.is_some()).count();
    let mut sure = format!("Motion determines the parameters of {trusted} of {}.", count(rows.len(), "subject"));
    if lost > 0 {
        sure.push_str(&format!(" {} without results.", count(lost, "subject")));
    }
    let failed: usize = rows.iter().map(|r| r.lost).sum();
    if failed > 0 {
        sure.push_str(&format!(" {} failed and are excluded.", count(failed, "recording")));
    }
    facts.push(Fact::new("How sure", sure));
    if asked < rows.len() - lost {
        let text = if asked == 0 { "Run `discover`." } else { "Run `discover` for the others." };
        facts.push(Fact { command: next.to_owned(), ..Fact::new("Next", text) });
    }
    Headline { light, word: word.to_owned(), sentence, facts }
}

/// Error of each subject's model in multiples of its floor.
pub(super) fn floors(rows: &[Row]) -> Option<Figure> {
    let known: Vec<&Row> = rows.iter().filter(|r| r.times_floor.is_some()).collect();
    if known.is_empty() {
        return None;
    }
    let names: Vec<String> = known.iter().map(|r| r.name.clone()).collect();
    // one kind of dot for each colour, named by its grades
    let of = |signal: Signal| {
        let its = |r: &&&Row| r.graded.map_or(Signal::Unknown, Graded::signal) == signal;
        let words: Vec<&str> = Grade::ALL
            .into_iter()
            .filter(|g| known.iter().filter(its).any(|r| r.graded.is_some_and(|own| own.grade == *g)))
            .map(Grade::word)
            .collect();
        let values = known.iter().map(|r| if its(&r) { r.times_floor.unwrap_or(f64::NAN) } else { f64::NAN });
        Dots::new(words.join(", "), values.collect())
    };
    let kinds = [Signal::Unknown, Signal::Poor, Signal::Good, Signal::Fair].map(of);
    let line = |at: f64, label: &str| Line { at, upright: true, label: label.to_owned() };
    let poor = Grade::LIMITS.poor;
    let lines = [line(1.0, "floor"), line(poor, &format!("{poor} ×"))];
    let words = Words::new(
        "Error in multiples of the noise floor",
        "Held-out error of each subject's model, in flight or in contact, where it is worse; 1 is the error of a perfect model on these recordings.",
    );
    Some(Figure::dots(words, "error / noise floor", &names, &kinds, &lines))
}
