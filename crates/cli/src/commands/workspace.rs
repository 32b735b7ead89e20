//! What is in a workspace: `aloft status`, `verify`, `summary` and `explain`.

use crate::args::{PipelineArgs, StrictArgs};
use crate::each::{each, notice};
use crate::open::{description_of, open_all};
use crate::render::{json, out};
use crate::stop::Stop;
use crate::{Success, show as tables, show_workspace};
use aloft_analysis::freshness::freshness;
use aloft_analysis::{status, summary, verify};
use aloft_study::subject_session::SubjectSession;
use std::cell::Cell;

/// Shows the grid of trials and stages.
pub fn status(args: &PipelineArgs, strict: StrictArgs, as_json: bool) -> Result<Success, Stop> {
    let late = Cell::new(false);
    let ask = |session: &SubjectSession| {
        late.set(late.get() || !freshness(session)?.is_current());
        status::status(session)
    };
    Ok(strict.judge(each(args, as_json, ask, show_workspace::status)?, late.get()))
}

/// Compares files with their hashes.
pub fn verify(args: &PipelineArgs, strict: StrictArgs, as_json: bool) -> Result<Success, Stop> {
    let (damaged, late) = (Cell::new(false), Cell::new(false));
    let ask = |session: &SubjectSession| {
        let found = verify::verify(session)?;
        damaged.set(damaged.get() || !found.damaged.is_empty());
        late.set(late.get() || !found.stale.is_empty());
        Ok(found)
    };
    let done = each(args, as_json, ask, show_workspace::verified)?;
    Ok(if damaged.get() { Success::Partial } else { strict.judge(done, late.get()) })
}

/// Shows one row a trial.
pub fn summary(args: &PipelineArgs, strict: StrictArgs, as_json: bool) -> Result<Success, Stop> {
    let set = open_all(args)?;
    let found = summary::summary(&set, &description_of(args))?;
    for session in &set.members {
        notice(session, &freshness(session)?);
    }
    if as_json {
        json(&found)?
    } else {
        out(tables::summary(&found))?
    }
    Ok(strict.judge(Success::Full, !found.stale.is_empty()))
}

/// Says why results are not up to date.
pub fn explain(
    args: &PipelineArgs,
    strict: StrictArgs,
    trial: Option<&str>,
    stage: Option<&str>,
) -> Result<Success, Stop> {
    let done = show_workspace::explain(args, trial, stage)?;
    let mut late = false;
    for session in &open_all(args)?.members {
        late = late || !freshness(session)?.is_current();
    }
    Ok(strict.judge(done, late))
}
