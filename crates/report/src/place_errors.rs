//! Held-out error of the present model against the noise floor, by kind of motion. Every signal of
//! the page about the model comes from here.

use super::lights;
use super::story::Story;
use aloft_analysis::compare::JudgedOn;
use aloft_analysis::explanations::Explanation;
use aloft_analysis::held_out::HeldOutError;
use aloft_analysis::history::HistoryRow;
use aloft_analysis::next_step::Answers;
use aloft_compare::{Grade, Graded};
use aloft_discover::{Discovery, Verdict};
use aloft_page::Light;

/// The error of the present model on one kind of motion.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaceError {
    /// `flight` or `contact`.
    pub place: String,
    /// Held-out error, N.
    pub error_n: f64,
    /// Its force, N, and its moment, N·m; none in results of older programs.
    pub force_and_moment: Option<(f64, f64)>,
    /// Noise floor, N.
    pub floor_n: Option<f64>,
    /// 95 % interval of the noise floor, N.
    pub interval_n: Option<[f64; 2]>,
    /// Error over floor.
    pub ratio: Option<f64>,
    /// True if a perfect model could have left as much.
    pub at_floor: bool,
    /// Its grade.
    pub graded: Graded,
}

impl PlaceError {
    pub(super) fn of(e: &HeldOutError) -> Self {
        Self {
            place: e.judged_on.clone(),
            error_n: e.held_out_error,
            force_and_moment: e.held_out_force_n.zip(e.held_out_moment_nm),
            floor_n: e.noise_floor,
            interval_n: e.noise_floor_ci95,
            ratio: e.times_floor,
            at_floor: e.at_floor == Some(true),
            graded: e.graded(),
        }
    }
    /// The colour of its grade.
    pub fn light(&self) -> Light {
        lights::of(self.graded.signal())
    }
    /// `2.4 × floor`.
    pub fn times_floor(&self) -> String {
        let unknown = if self.floor_n.is_some() { "floor known too roughly" } else { "floor unknown" };
        self.ratio.map_or_else(|| unknown.to_owned(), |r| format!("{} × floor", lights::times(r)))
    }
    /// `2.4 × floor, fair`.
    pub fn ratio_words(&self) -> String {
        format!("{}, {}", self.times_floor(), self.graded.words())
    }
}

/// Errors on both kinds of motion, the one on which the model is judged first: where the effect of
/// its last revision acts, where `discover` found something, or else where the error is farthest
/// above its floor.
pub fn errors_by_place(story: &Story<'_>) -> Vec<PlaceError> {
    let Some(view) = &story.comparison else { return Vec::new() };
    let mut all: Vec<PlaceError> = view.errors.iter().map(PlaceError::of).collect();
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

/// The answers of `discover` on these results, for the present model and for an earlier one.
pub fn answers<'s>(story: &'s Story<'_>, explanations: &'s [Explanation]) -> Answers<'s> {
    let revisions = &story.history.revisions;
    let present = revisions.last().map_or(0, |r| r.revision);
    let earlier = story.discoveries.iter().rev().find(|(n, d)| *n < present && d.made_from == story.looked_at);
    let held = |n: usize| revisions.iter().find(|r| r.revision == n).map(|r| &r.effects[..]);
    Answers {
        present: asked(story),
        earlier: earlier.and_then(|(n, d)| Some((&d.answer, held(*n)?))),
        not_shown: revisions.last().and_then(|r| r.not_shown.as_deref()),
        explanations,
        joint_above: story.joint_above,
    }
}

/// Effects of the present model.
pub fn effects<'s>(story: &'s Story<'_>) -> &'s [String] {
    story.history.revisions.last().map_or(&[], |r| &r.effects)
}

/// What the first screen says of the model, as a light and in words: the worst grade of its errors,
/// as every command prints it; or why there is no grade of the present model.
pub fn standing(story: &Story<'_>) -> (Light, String) {
    let unjudged = story.comparison.as_ref().is_some_and(|v| !v.limits.is_empty());
    let void = story.history.revisions.last().is_some_and(|r| r.void.is_some());
    if !story.failures.is_empty() {
        return (Light::Poor, "failed".to_owned());
    }
    if !story.freshness.is_current() {
        return (Light::Poor, "not up to date".to_owned());
    }
    if void {
        return (Light::Poor, "void".to_owned());
    }
    if story.comparison.is_none() {
        return (Light::Poor, "not compared".to_owned());
    }
    let worst = errors_by_place(story).iter().map(|e| e.graded).max_by_key(|g| g.grade);
    match worst.filter(|_| !unjudged) {
        Some(graded) => (lights::of(graded.signal()), graded.words()),
        None => (Light::Neutral, Grade::NotJudged.word().to_owned()),
    }
}
