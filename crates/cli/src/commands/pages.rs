//! Pages and files made from results: `aloft report`, `studio` and `export`.

use crate::args::{AnglesArg, ExportArgs, PipelineArgs, StrictArgs};
use crate::each::{broken, each_result, fail, notice};
use crate::open::{open_all, openers};
use crate::render::{note, out};
use crate::stop::Stop;
use crate::{Success, show_export};
use aloft_analysis::export::{self, ExportOptions};
use aloft_analysis::freshness::freshness;
use aloft_study::config::Angles;
use aloft_study::data_set::DataSet;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use std::cell::Cell;
use std::path::Path;

impl From<AnglesArg> for Angles {
    fn from(angles: AnglesArg) -> Self {
        match angles {
            AnglesArg::Model => Self::Model,
            AnglesArg::Isb => Self::Isb,
        }
    }
}

/// A page that was written.
#[derive(serde::Serialize)]
struct Written {
    path: std::path::PathBuf,
}

/// Writes the report of a study, or of each subject and session of several.
pub fn report(args: &PipelineArgs, strict: StrictArgs, target: Option<&Path>) -> Result<Success, Stop> {
    let set = open_all(args)?;
    // write the page over the whole study only if the whole study was selected
    if set.several && target.is_none() && args.subject.is_empty() && args.session.is_empty() {
        return report_on_all(&set, strict);
    }
    let n = set.members.len();
    if n > 1 && target.is_some() {
        return Err(PipelineError::request_hint(
            format!("--out names one file, and there are {n} subjects or sessions"),
            "choose one with --subject and --session, or omit --out: each page is then written to its workspace",
        )
        .into());
    }
    let write = |session: &SubjectSession| aloft_report::write(session, target).map(|path| Written { path });
    each_result(args, strict, false, &[], write, |done| out(done.path.display()))
}

/// Writes the page over a whole study and those of its subjects and sessions.
fn report_on_all(set: &DataSet, strict: StrictArgs) -> Result<Success, Stop> {
    let done = aloft_report::write_set(set)?;
    for page in &done.pages {
        out(page.display())?;
    }
    let trouble = broken(set) || !done.failed.is_empty();
    for (id, error) in done.failed {
        fail(&id, &error.into());
    }
    let mut late = false;
    for session in &set.members {
        let fresh = freshness(session)?;
        notice(session, &fresh);
        late = late || !fresh.is_current();
    }
    Ok(strict.judge(if trouble { Success::Partial } else { Success::Full }, late))
}

/// Writes files for other programs.
pub fn export(args: ExportArgs) -> Result<Success, Stop> {
    let ExportArgs { pipeline, strict, to, format, trial, angles } = args;
    let angles = angles.map(Angles::from);
    let ask = |session: &SubjectSession| {
        // in a study of several, each subject and session gets its own folder
        let to = to.as_ref().map(|to| export::place_of(to, &session.id));
        let options = ExportOptions { to, formats: format.clone(), trials: trial.clone(), angles };
        export::export(session, &options)
    };
    let trouble = Cell::new(false);
    let done = each_result(&pipeline, strict, false, &[], ask, |done| {
        trouble.set(trouble.get() || !done.failures.is_empty());
        show_export::exported(done)
    })?;
    Ok(if trouble.get() { Success::Partial } else { done })
}

/// Serves the live page until the process ends.
pub fn studio(pipeline: &PipelineArgs, port: u16, no_open: bool) -> Result<Success, Stop> {
    let (open, open_set) = openers(pipeline)?;
    let server = aloft_studio::Server::bind(open, open_set, port)?;
    let address = server.address();
    out(&address)?;
    note("the page is for this machine only; Ctrl-C ends it");
    if !no_open && let Err(e) = open::that_detached(&address) {
        note(format!("no browser could be opened ({e}); open the address above"));
    }
    server.run()?;
    Ok(Success::Full)
}
