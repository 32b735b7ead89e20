//! Where the present model stands: its held-out error against the noise floor. Every signal of the
//! page about the model comes from here.

use super::lights;
use super::story::Story;
use aloft_analysis::compare::JudgedOn;
use aloft_analysis::held_out::HeldOutError;
use aloft_analysis::history::HistoryRow;
use aloft_compare::AgainstFloor;
use aloft_discover::{Discovery, Verdict};
use aloft_page::Light;

/// The error of the present model on one kind of motion.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaceError {
    /// `flight` or `contact`.
    pub place: String,
    /// Held-out error, N.
    pub error_n: f64,
    /// Noise floor, N.
    pub floor_n: Option<f64>,
    /// 95 % interval of the noise floor, N.
    pub interval_n: Option<[f64; 2]>,
    /// Error over floor.
    pub ratio: Option<f64>,
    /// True if a perfect model could have left as much.
    pub at_floor: bool,
}

impl PlaceError {
    fn of(a: &AgainstFloor) -> Self {
        Self {
            place: a.judged_on.clone(),
            error_n: a.held_out_error,
            floor_n: a.floor.map(|f| f.noise_floor),
            interval_n: a.floor.and_then(|f| f.ci95),
            ratio: a.times_floor,
            at_floor: a.at_floor == Some(true),
        }
    }
    /// Judgement from the ratio to the floor alone.
    pub fn light(&self) -> Light {
        lights::against_floor(self.ratio, Some(self.at_floor))
    }
    /// `2.4 times the floor`, with what is said of an error at the floor.
    pub fn ratio_words(&self) -> String {
        match self.ratio {
            Some(r) if self.at_floor => format!("{} × noise floor (within its interval)", lights::times(r)),
            Some(r) => format!("{} × floor", lights::times(r)),
            None => "floor unknown".to_owned(),
        }
    }
}

/// Errors on both kinds of motion, the one on which the model is judged first: where the effect of
/// its last revision acts, where `discover` found something, or else where the error is farthest
/// above its floor.
pub fn standings(story: &Story<'_>) -> Vec<PlaceError> {
    let Some(view) = &story.comparison else { return Vec::new() };
    let mut all: Vec<PlaceError> = view.comparison.against_floor.iter().map(PlaceError::of).collect();
    let place = stated_place(asked(story), story.history.revisions.last());
    all.sort_by(|a, b| {
        let first = |s: &PlaceError| place.as_ref() == Some(&s.place);
        first(b).cmp(&first(a)).then(b.ratio.unwrap_or(0.0).total_cmp(&a.ratio.unwrap_or(0.0)))
    });
    all
}

/// Where the effect of the last revision acts or where `discover` found something; none if neither
/// says.
fn stated_place(asked: Option<&Discovery>, last: Option<&HistoryRow>) -> Option<String> {
    let found_in = asked.filter(|d| matches!(d.verdict, Verdict::Supported | Verdict::OneOf)).and_then(|d| {
        d.ladder.first().map(|a| a.judged_on.clone()).or_else(|| d.rounds.first().map(|r| r.judged_on.clone()))
    });
    let last = last.filter(|r| r.revision > 0).and_then(|r| r.judged_on);
    let changed_in = last.map(|j| {
        match j {
            JudgedOn::Flight => "flight",
            JudgedOn::Contact => "contact",
        }
        .to_owned()
    });
    found_in.or(changed_in)
}

/// The kind of motion on which the first screen judges the model, for the panel of switches.
pub fn judged_place(asked: Option<&Discovery>, last: Option<&HistoryRow>) -> Option<String> {
    let worst = || {
        let ratio = |e: &&HeldOutError| e.times_floor.unwrap_or(0.0);
        let first = last?.errors.iter().rev().max_by(|a, b| ratio(a).total_cmp(&ratio(b)))?;
        Some(first.judged_on.clone())
    };
    stated_place(asked, last).or_else(worst)
}

/// The latest answer of `discover`, if it was asked of the present model and of these results.
pub fn asked<'s>(story: &'s Story<'_>) -> Option<&'s Discovery> {
    let (revision, kept) = story.discoveries.last()?;
    let present = story.history.revisions.last().map_or(0, |r| r.revision);
    (*revision == present && kept.made_from == story.looked_at).then_some(&kept.answer)
}

/// Effects of the present model.
pub fn effects<'s>(story: &'s Story<'_>) -> &'s [String] {
    story.history.revisions.last().map_or(&[], |r| &r.effects)
}

/// Judgement of the model: the worst of its errors against their floors and of the gate. Without a
/// floor nothing is good.
pub fn light(story: &Story<'_>) -> Light {
    let errors = standings(story).iter().map(PlaceError::light).max().unwrap_or(Light::Neutral);
    let unjudged = story.comparison.as_ref().is_some_and(|v| !v.limits.is_empty());
    let gate = match &story.found {
        Some(found) if !found.parameters.gate.passed => Light::Poor,
        Some(_) => Light::Neutral,
        None if unjudged => Light::Neutral,
        None => Light::Poor,
    };
    let lost = if story.trials.iter().any(|t| !t.failures.is_empty()) { Light::Fair } else { Light::Neutral };
    let stale = if story.freshness.is_current() { Light::Neutral } else { Light::Poor };
    let void = story.history.revisions.last().is_some_and(|r| r.void.is_some());
    let failed = if story.failures.is_empty() && !void { Light::Neutral } else { Light::Poor };
    [errors, gate, lost, stale, failed].into_iter().max().unwrap_or_default()
}
