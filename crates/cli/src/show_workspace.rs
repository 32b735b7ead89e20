//! The state of a workspace: what is damaged, what is up to date, and how a result was made.

use crate::Success;
use crate::args::PipelineArgs;
use crate::each::heading;
use crate::open::open_all;
use crate::render::{note, out, table};
use crate::screen::labelled;
use crate::stop::Stop;
use aloft_analysis::freshness::{Freshness, NotCurrent};
use aloft_analysis::{forget, status, verify};
use aloft_pipeline::graph::TaskState;
use aloft_study::quote::visible;
use aloft_workspace::error::PipelineError;

/// Which results are damaged, and what makes them again.
pub fn verified(found: &verify::Verified) -> Result<(), Stop> {
    if !found.damaged.is_empty() {
        let mut t = table(&["damaged", "what is wrong", "what makes it again"]).left(&[2]).wrapped(1);
        for d in &found.damaged {
            t.add_row([d.place.clone(), d.problems.join("; "), d.mend.clone()]);
        }
        out(t)?;
    }
    for unused in &found.unused {
        note(format!("not used: {unused} (the study has no such recording or stage)"));
    }
    for line in (Freshness { stale: found.stale.clone() }).describe() {
        note(line);
    }
    let damaged = match found.damaged.len() {
        0 => "nothing is damaged".to_owned(),
        n => format!("{n} damaged"),
    };
    let megabytes = found.bytes as f64 / 1e6;
    out(format!("{} results, {} files, {megabytes:.1} MB: {damaged}", found.results, found.files))
}

/// What was removed, and what was not touched.
pub fn forgotten(found: &forget::Forgotten) -> Result<(), Stop> {
    let head = if found.done { "removed" } else { "would be removed" };
    let mut t = table(&[head, "files", "MB", "because"]).left(&[3]).wrapped(3);
    for r in &found.removed {
        let megabytes = format!("{:.1}", r.bytes as f64 / 1e6);
        t.add_row([visible(&r.place), r.files.to_string(), megabytes, r.because.clone()]);
    }
    out(t)?;
    for kept in &found.kept {
        out(labelled("not touched: ", kept))?;
    }
    Ok(())
}

/// State of every stage of every trial.
pub fn status(found: &status::Status) -> Result<(), Stop> {
    let mut header = vec!["trial", "role"];
    header.extend(found.stages.iter().copied());
    let mut t = table(&header);
    for row in &found.rows {
        t.add_row([visible(&row.trial), row.role.clone()].into_iter().chain(row.cells.iter().cloned()));
    }
    out(t)?;
    found.files.iter().for_each(file);
    Ok(())
}

/// A table, report or export that is not what the results give now.
pub fn file(one: &NotCurrent) {
    note(format!("{}: {}: {}", one.state, one.trial, one.because));
}

/// How one result was made; without trial and stage, everything that is not up to date.
pub fn explain(args: &PipelineArgs, trial: Option<&str>, stage: Option<&str>) -> Result<Success, Stop> {
    let set = open_all(args)?;
    let mut shown = 0;
    let mut last: Option<PipelineError> = None;
    for session in &set.members {
        match (trial, stage) {
            (Some(trial), Some(stage)) => match status::explain(session, trial, stage) {
                Ok(found) => {
                    shown += 1;
                    if set.several {
                        heading(&session.id)?;
                    }
                    show_explanation(&found, trial, stage, true)?;
                }
                Err(error) => last = Some(error),
            },
            _ => {
                let found = status::explain_all(session, trial)?;
                shown += 1;
                if set.several && !found.is_empty() {
                    heading(&session.id)?;
                }
                for (stage, trial, explanation) in &found {
                    show_explanation(explanation, trial, stage, false)?;
                }
                if found.is_empty() && !set.several {
                    out("everything is up to date")?;
                }
            }
        }
    }
    match (shown, last) {
        (0, Some(error)) => Err(error.into()),
        _ => Ok(Success::Full),
    }
}

fn show_explanation(found: &status::Explanation, trial: &str, stage: &str, whole: bool) -> Result<(), Stop> {
    out(format!("{stage} of {}: {}", visible(trial), found.state.word()))?;
    match &found.state {
        TaskState::Stale(changes) => {
            for change in changes {
                out(labelled("  ", change))?;
            }
        }
        TaskState::Failed(failure) => {
            out(labelled("  ", &failure.problem))?;
            if let Some(hint) = &failure.hint {
                out(labelled("  hint: ", hint))?;
            }
        }
        TaskState::Blocked(reason) => out(labelled("  ", reason))?,
        TaskState::Damaged(problems) => {
            for problem in problems {
                out(labelled("  ", problem))?;
            }
        }
        _ => {}
    }
    for before in &found.before {
        out(labelled("  ", &format!("will be recomputed: {before}")))?;
    }
    let Some(m) = found.manifest.as_ref().filter(|_| whole) else { return Ok(()) };
    for warning in &m.warnings {
        out(labelled("  warning: ", &warning.to_string()))?;
    }
    for (key, value) in &m.summary {
        out(labelled(&format!("  {key}: "), &value.to_string()))?;
    }
    out(format!("  made by aloft {} in {:.2} s from", m.program, m.seconds))?;
    for (name, hash) in &m.inputs {
        out(format!("    {name} {}", hash.get(..12).unwrap_or(hash)))?;
    }
    Ok(())
}
