//! The one step that a study proposes next: every command and the report ask here, so that they
//! propose the same.

use crate::compare::{ComparisonView, compare_if_made};
use crate::corrections::{Offer, offers};
use crate::discover::{earlier, latest};
use crate::explanations::{Explanation, explanations, instead_of};
use crate::history::not_shown;
use crate::joint_laws::joint_errors;
use crate::session_check::{SessionCheck, session_check};
use aloft_discover::{Discovery, Verdict};
use aloft_pipeline::made::as_made;
use aloft_regressor::limits::at_floor;
use aloft_study::revision::JointReached;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;

/// What to do next.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NextStep {
    /// Bring the results up to date.
    Run,
    /// Correct what the sentence says, and run again: nothing else can be trusted before.
    Correct {
        /// What to correct.
        what: String,
        /// Where that begins.
        begin: Begin,
    },
    /// Record what the sentence says; nothing can be asked of these recordings.
    Record(String),
    /// Ask which effect is missing.
    Discover {
        /// What to record as well, where the motion determines too little of the body.
        record: Option<String>,
    },
    /// Add an effect or a law that the last answer of `discover` names.
    Add {
        /// Key of the effect, or identifier of the law.
        key: String,
        /// Why this one.
        because: Because,
    },
    /// Remove an effect that the recordings do not show.
    Remove {
        /// Key of the effect.
        key: String,
    },
    /// Nothing was found to add: what the answer of `discover` advises.
    Advised(String),
    /// The model is at its floor, or nothing is missing.
    Use,
    /// The error is above its floor, and nothing explains it: see where it sits.
    Look,
}

/// Where a correction begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Begin {
    /// `aloft check` offers it.
    Check,
    /// The report shows what it is about, by recording and marker; the pipeline or the recordings
    /// have to change before another run.
    Report,
    /// The sentence names the setting.
    Setting,
}

/// Why an effect is proposed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Because {
    /// The evidence names it.
    Named,
    /// The recordings cannot tell it from others; it is the simplest.
    OneOf,
    /// A law outside the catalogue that explains the error.
    Law,
}

/// Answers of `discover` on the present results.
#[derive(Debug, Clone, Copy, Default)]
pub struct Answers<'a> {
    /// That for the present model.
    pub present: Option<&'a Discovery>,
    /// The last one for an earlier model, with the keys of the effects that it held.
    pub earlier: Option<(&'a Discovery, &'a [String])>,
    /// Key of an effect of the model that the recordings do not show
    /// ([`crate::history::HistoryRow::not_shown`]).
    pub not_shown: Option<&'a str>,
    /// What explains measurements that differ from what was stated, where the present answer cannot
    /// tell an effect from others ([`rivals`]).
    pub explanations: &'a [Explanation],
    /// True if the torque of some joint is above its floor.
    pub joint_above: bool,
}

/// True if some error is not at its floor.
pub fn is_above(view: &ComparisonView) -> bool {
    view.errors.iter().any(|e| e.at_floor == Some(false))
}

/// True if the torque of some joint of a robot is above its floor.
///
/// # Errors
/// A result is there and cannot be read.
pub fn is_joint_above(session: &SubjectSession) -> Result<bool, PipelineError> {
    let above = |j: &JointReached| {
        j.noise_floor.and_then(|floor| at_floor(j.held_out_error, floor, j.noise_floor_ci95)) == Some(false)
    };
    Ok(joint_errors(session)?.iter().any(above))
}

/// The next step for results that are `current`, or are not.
///
/// # Errors
/// A stored answer, the model or a result is damaged or cannot be read.
pub fn next_step(session: &SubjectSession, view: &ComparisonView, current: bool) -> Result<NextStep, PipelineError> {
    if !current {
        return Ok(NextStep::Run);
    }
    if !view.limits.is_empty() {
        return Ok(NextStep::Record("record markers on the whole body, and jumps, to identify masses".to_owned()));
    }
    let held: Vec<&str> = session.effects.iter().map(|e| e.key.as_str()).collect();
    let present = latest(session)?;
    let before = if present.is_none() { earlier(session)? } else { None };
    let not_shown = not_shown(session)?;
    let explanations = rivals(session, present.as_ref())?;
    let answers = Answers {
        present: present.as_ref(),
        earlier: before.as_ref().map(|(d, keys)| (d, &keys[..])),
        not_shown: not_shown.as_deref(),
        explanations: &explanations,
        joint_above: present.is_none() && is_joint_above(session)?,
    };
    Ok(step(view, answers, &held))
}

/// The next step of a study that may not have been compared yet: then it is a run.
///
/// # Errors
/// Those of [`next_step`], and a comparison that is damaged.
pub fn next_step_of(session: &SubjectSession, current: bool) -> Result<NextStep, PipelineError> {
    if !current {
        return Ok(NextStep::Run);
    }
    compare_if_made(session)?.map_or(Ok(NextStep::Run), |view| next_step(session, &view, current))
}

/// What explains measurements that differ from what was stated, corrections among it; nothing
/// unless the answer cannot tell an effect from others, of which a correction may be one.
///
/// # Errors
/// A result is there and cannot be read.
pub fn rivals(session: &SubjectSession, answer: Option<&Discovery>) -> Result<Vec<Explanation>, PipelineError> {
    if answer.is_none_or(|d| d.verdict != Verdict::OneOf) {
        return Ok(Vec::new());
    }
    let made = as_made(session)?;
    let checked = session_check(&made)?;
    Ok(rivals_of(&made, answer, &checked, &offers(&made, &checked)?))
}

/// The same for a session as its results were made, with its measurements and what they offer.
pub fn rivals_of(
    made: &SubjectSession,
    answer: Option<&Discovery>,
    checked: &SessionCheck,
    offers: &[Offer],
) -> Vec<Explanation> {
    let Some(d) = answer.filter(|d| d.verdict == Verdict::OneOf) else { return Vec::new() };
    explanations(made, checked, offers, Some(d))
}

/// The first effect or law that an answer names and the model does not hold. What is not shown to
/// be the cause is not proposed.
fn to_add(d: &Discovery, held: &[&str]) -> Option<NextStep> {
    let because = match d.verdict {
        Verdict::Supported => Because::Named,
        Verdict::OneOf => Because::OneOf,
        Verdict::Unexplained => Because::Law,
        Verdict::NothingMissing | Verdict::NotDetectable => return None,
    };
    let key = named_by(d).into_iter().find(|k| !held.contains(k))?;
    Some(NextStep::Add { key: key.to_owned(), because })
}

/// Keys of the effects, or identifiers of the laws, that an answer says to add.
fn named_by(d: &Discovery) -> Vec<&str> {
    match d.verdict {
        Verdict::Supported | Verdict::OneOf => d.found.iter().map(|f| f.key.as_str()).collect(),
        Verdict::Unexplained => {
            d.open.iter().filter(|o| o.complete).flat_map(|o| &o.laws).map(|l| l.id.as_str()).collect()
        }
        Verdict::NothingMissing | Verdict::NotDetectable => Vec::new(),
    }
}

/// What an answer for an earlier model, which held `then`, named and the present model lacks: if
/// all that was added since is of that answer, there is no need to ask again.
fn still_to_add(d: &Discovery, then: &[String], held: &[&str]) -> Option<NextStep> {
    let named = named_by(d);
    let grown = held.len() > then.len() && then.iter().all(|k| held.contains(&k.as_str()));
    let own = held.iter().all(|k| then.iter().any(|t| t == k) || named.contains(k));
    to_add(d, held).filter(|_| grown && own)
}

/// The next step, given what `discover` answered on the present results and the keys of the effects
/// that the model holds.
pub fn step(view: &ComparisonView, answers: Answers<'_>, held: &[&str]) -> NextStep {
    let answer = answers.present;
    let known = view.to_correct.as_ref();
    let what = match answer {
        Some(d) => d.to_correct.clone(),
        None => known.filter(|c| c.void || c.first).map(|c| c.words.clone()),
    };
    if let Some(what) = what {
        let begin = if known.is_some_and(|c| c.offered) { Begin::Check } else { Begin::Report };
        return NextStep::Correct { what, begin };
    }
    let record = view.parameters.to_do.clone();
    if let (true, Some(prior)) = (view.parameters.held_by_prior, &record) {
        return NextStep::Correct { what: prior.clone(), begin: Begin::Setting };
    }
    if let Some(key) = answers.not_shown {
        return NextStep::Remove { key: key.to_owned() };
    }
    let Some(d) = answer else {
        let rest = answers.earlier.filter(|_| is_above(view)).and_then(|(d, then)| still_to_add(d, then, held));
        if let Some(rest) = rest {
            return rest;
        }
        return match (is_above(view), view.too_few_to_ask()) {
            (_, true) => NextStep::Record(record.unwrap_or_else(|| "record more flights".to_owned())),
            (true, false) => NextStep::Discover { record },
            (false, false) if answers.joint_above => NextStep::Discover { record },
            (false, false) => record.map_or(NextStep::Use, NextStep::Record),
        };
    };
    match to_add(d, held) {
        Some(NextStep::Add { key, because: Because::OneOf }) => {
            return match instead_of(answers.explanations, &key) {
                Some(correction) => NextStep::Correct {
                    what: format!(
                        "the correction `{}` explains the same as `{key}`: `aloft check` lists both, the likelier first",
                        correction.key
                    ),
                    begin: Begin::Check,
                },
                None => NextStep::Add { key, because: Because::OneOf },
            };
        }
        Some(next) => return next,
        None => {}
    }
    let joint = d.joints.as_ref().and_then(|j| {
        let key = j.found.iter().map(|f| &f.key).find(|k| !held.contains(&k.as_str()))?;
        let finding = j.joints.iter().find(|f| key.ends_with(&format!("[{}]", f.joint)))?;
        let because = if finding.verdict == Verdict::OneOf { Because::OneOf } else { Because::Named };
        Some(NextStep::Add { key: key.clone(), because })
    });
    match d.verdict {
        Verdict::NothingMissing | Verdict::NotDetectable
            if joint.is_some() && d.found.iter().all(|f| held.contains(&f.key.as_str())) =>
        {
            joint.unwrap_or(NextStep::Look)
        }
        Verdict::NothingMissing if !is_above(view) => record.map_or(NextStep::Use, NextStep::Record),
        _ => match (d.advice.first(), record) {
            (Some(advice), _) => NextStep::Advised(advice.clone()),
            (None, Some(record)) => NextStep::Record(record),
            (None, None) if is_above(view) => NextStep::Look,
            (None, None) => NextStep::Use,
        },
    }
}
