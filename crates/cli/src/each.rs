//! Runs one command over all subjects and sessions: with a heading before each, or one JSON
//! document for all.

use crate::Success;
use crate::args::{PipelineArgs, StrictArgs};
use crate::open::open_all;
use crate::render::json;
use crate::render::{note, out};
use crate::stop::Stop;
use aloft_analysis::freshness::{Freshness, WithStale, with_stale};
use aloft_study::data_set::DataSet;
use aloft_study::quote::visible;
use aloft_study::recordings::SessionId;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use serde::Serialize;
use std::cell::Cell;

/// JSON output of a command for a study of several.
#[derive(Debug, Serialize)]
struct Several<T> {
    version: u32,
    studies: Vec<One<T>>,
}

#[derive(Debug, Serialize)]
struct One<T> {
    #[serde(flatten)]
    id: SessionId,
    #[serde(skip_serializing_if = "Option::is_none")]
    result: Option<T>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

/// Computes and shows the answer for every study. For a study of one subject the answer is shown
/// without a heading, and an error is the command's error; for several, one that fails does not
/// stop the others.
pub fn each<T: Serialize>(
    args: &PipelineArgs,
    as_json: bool,
    ask: impl Fn(&SubjectSession) -> Result<T, PipelineError>,
    show: impl Fn(&T) -> Result<(), Stop>,
) -> Result<Success, Stop> {
    each_member(&open_all(args)?, as_json, ask, show)
}

/// The same for a study that is open.
pub fn each_member<T: Serialize>(
    set: &DataSet,
    as_json: bool,
    ask: impl Fn(&SubjectSession) -> Result<T, PipelineError>,
    show: impl Fn(&T) -> Result<(), Stop>,
) -> Result<Success, Stop> {
    each_of(set, as_json, ask, |_, found| show(found))
}

/// The same for a command that shows an answer together with what it knows of the study.
fn each_of<T: Serialize>(
    set: &DataSet,
    as_json: bool,
    ask: impl Fn(&SubjectSession) -> Result<T, PipelineError>,
    show: impl Fn(&SubjectSession, &T) -> Result<(), Stop>,
) -> Result<Success, Stop> {
    if !set.several {
        for session in &set.members {
            let found = ask(session)?;
            if as_json { json(&found)? } else { show(session, &found)? }
        }
        return Ok(Success::Full);
    }
    let mut all = Several { version: 1, studies: Vec::new() };
    let mut trouble = false;
    for session in &set.members {
        let answer = ask(session);
        if as_json {
            let (result, error) = match answer {
                Ok(found) => (Some(found), None),
                Err(e) => (None, Some(e.to_string())),
            };
            trouble |= error.is_some();
            all.studies.push(One { id: session.id.clone(), result, error });
            continue;
        }
        heading(&session.id)?;
        match answer {
            Ok(found) => show(session, &found)?,
            Err(e) => {
                trouble = true;
                fail(&session.id, &e.into());
            }
        }
        out("")?;
    }
    trouble |= broken(set);
    if as_json {
        all.studies.extend(set.broken.iter().map(|b| One {
            id: b.id.clone(),
            result: None,
            error: Some(b.failure.problem.clone()),
        }));
        json(&all)?;
    }
    Ok(if trouble { Success::Partial } else { Success::Full })
}

/// The same for a command that shows results: it reports which are not up to date, and refuses to
/// show damaged results of the stages that it `reads` (of all stages if none is named).
pub fn each_result<T: Serialize>(
    args: &PipelineArgs,
    strict: StrictArgs,
    as_json: bool,
    reads: &[&str],
    ask: impl Fn(&SubjectSession) -> Result<T, PipelineError>,
    show: impl Fn(&T) -> Result<(), Stop>,
) -> Result<Success, Stop> {
    each_step(args, strict, as_json, reads, ask, |_, _, found| show(found))
}

/// The same for a command that ends with the next step: `show` receives the study as well, and
/// whether all results are up to date.
pub fn each_step<T: Serialize>(
    args: &PipelineArgs,
    strict: StrictArgs,
    as_json: bool,
    reads: &[&str],
    ask: impl Fn(&SubjectSession) -> Result<T, PipelineError>,
    show: impl Fn(&SubjectSession, bool, &T) -> Result<(), Stop>,
) -> Result<Success, Stop> {
    let late = Cell::new(false);
    let asked = |session: &SubjectSession| {
        let found = with_stale(session, reads, &ask)?;
        let fresh = Freshness { stale: found.stale.clone() };
        late.set(late.get() || !fresh.is_current());
        notice(session, &fresh);
        Ok(found)
    };
    let shown = |session: &SubjectSession, found: &WithStale<T>| show(session, found.stale.is_empty(), &found.answer);
    let done = each_of(&open_all(args)?, as_json, asked, shown)?;
    Ok(strict.judge(done, late.get()))
}

/// What a message begins with where there may be several sessions.
pub fn whose(session: &SubjectSession) -> String {
    if session.id.subject.is_some() { format!("{}: ", session.id) } else { String::new() }
}

/// Reports on stderr which results are not up to date.
pub fn notice(session: &SubjectSession, fresh: &Freshness) {
    if fresh.is_current() {
        return;
    }
    let whose = whose(session);
    for line in fresh.describe() {
        note(format!("{whose}{line}"));
    }
    note(format!("  hint: `{}` brings results up to date", aloft_study::commands::command(session, "run", None)));
}

impl StrictArgs {
    /// Outcome of a command, depending on whether some results are not up to date.
    pub fn judge(self, done: Success, late: bool) -> Success {
        if self.strict && late { Success::Partial } else { done }
    }
}

/// The heading of a study.
pub fn heading(id: &SessionId) -> Result<(), Stop> {
    out(format!("== {}", visible(&id.to_string())))
}

/// Reports every member that cannot be processed and why; true if there is one.
pub fn broken(set: &DataSet) -> bool {
    for b in &set.broken {
        fail(&b.id, &b.failure);
    }
    !set.broken.is_empty()
}

/// Reports which subject or session failed, and what to do about it.
pub fn fail(id: &SessionId, failure: &aloft_workspace::error::StageFailure) {
    note(format!("failed: {id}: {}", failure.problem));
    if let Some(hint) = &failure.hint {
        note(format!("  hint: {hint}"));
    }
}
