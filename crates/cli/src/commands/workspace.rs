//! What is in a workspace: `aloft status`, `verify`, `summary` and `explain`.

use crate::args::{PipelineArgs, StrictArgs};
use crate::each::{each_member, notice};
use crate::open::{description_of, open_all, overrides};
use crate::render::{json, out};
use crate::stop::Stop;
use crate::{Success, show as tables, show_workspace};
use aloft_analysis::freshness::{NotCurrent, freshness};
use aloft_analysis::outputs::{self, Look};
use aloft_analysis::{forget, standing, summary, verify};
use aloft_study::data_set::DataSet;
use aloft_study::subject_session::SubjectSession;
use std::cell::Cell;

/// Shows the grid of trials and stages.
pub fn status(args: &PipelineArgs, strict: StrictArgs, as_json: bool) -> Result<Success, Stop> {
    let late = Cell::new(false);
    let ask = |session: &SubjectSession| {
        let found = standing::status(session)?;
        late.set(late.get() || !found.files.is_empty() || !freshness(session)?.is_current());
        Ok(found)
    };
    let set = open_all(args)?;
    let done = each_member(&set, as_json, ask, show_workspace::status)?;
    let files = files_of_study(&set, args, Look::Quick)?;
    Ok(strict.judge(done, late.get() || !files.is_empty()))
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
    let set = open_all(args)?;
    let done = each_member(&set, as_json, ask, show_workspace::verified)?;
    for file in files_of_study(&set, args, Look::Whole)? {
        damaged.set(damaged.get() || file.state == "damaged");
        late.set(true);
    }
    Ok(if damaged.get() { Success::Partial } else { strict.judge(done, late.get()) })
}

/// Files of a whole study of several that are not what its results give now; each is named.
fn files_of_study(set: &DataSet, args: &PipelineArgs, look: Look) -> Result<Vec<NotCurrent>, Stop> {
    // what was made of all of them is not compared with some
    if !args.subject.is_empty() || !args.session.is_empty() {
        return Ok(Vec::new());
    }
    let files = outputs::of_set(set, look)?;
    files.iter().for_each(show_workspace::file);
    Ok(files)
}

/// Removes what the workspace holds about one subject.
pub fn forget(args: &PipelineArgs, name: &str, only_list: bool, as_json: bool) -> Result<Success, Stop> {
    let found = forget::forget(&args.pipeline, &overrides(args), name, only_list)?;
    if as_json {
        json(&found)?
    } else {
        show_workspace::forgotten(&found)?
    }
    Ok(Success::Full)
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
