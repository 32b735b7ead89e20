//! `parameters`: the identified values with their intervals and the prior values.

use crate::assess::{self, Assessment};
use crate::compare::nothing_identified;
use aloft_identify::Parameters;
pub use aloft_identify::half_of;
use aloft_pipeline::results::parameters_file;
use aloft_pipeline::stages::identify::NOTHING_IDENTIFIED;
use aloft_study::commands::command;
use aloft_study::config::Rows;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::disk::is_there;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::workspace::Workspace;
use serde::Serialize;

/// The parameters with a version of the structure.
#[derive(Debug, Clone, Serialize)]
pub struct ParametersView {
    /// Version of this structure.
    pub version: u32,
    /// Subject name.
    pub subject: String,
    /// Rows: `weak` or `paper`.
    pub rows_used: &'static str,
    /// The parameters.
    #[serde(flatten)]
    pub parameters: Parameters,
    /// Window lengths, errors in variables and recommended motions from `--assess` for these
    /// parameters; none if it was not run.
    pub assessment: Option<Assessment>,
}

/// Stages whose results the parameters are read from.
pub const READS: [&str; 2] = ["identify", "calibrate"];

/// Reads the results of `identify`; none if nothing was identified.
///
/// # Errors
/// They are there and cannot be read.
pub fn parameters_if_made(session: &SubjectSession) -> Result<Option<ParametersView>, PipelineError> {
    let rows = aloft_pipeline::made::as_made(session)?.config.regressor.rows;
    let place = Workspace::open(&session.workspace).place("identify", WHOLE_STUDY);
    if is_there(&place.join(parameters_file(rows)))? { parameters(session, Some(rows)).map(Some) } else { Ok(None) }
}

/// Reads the results of `identify`.
pub fn parameters(session: &SubjectSession, rows: Option<Rows>) -> Result<ParametersView, PipelineError> {
    let session = &aloft_pipeline::made::as_made(session)?;
    let rows = rows.unwrap_or(session.config.regressor.rows);
    let ws = Workspace::open(&session.workspace);
    let path = ws.place("identify", WHOLE_STUDY).join(parameters_file(rows));
    let Some(parameters) = read_json_if_there::<Parameters>(&path)? else {
        if is_there(&path.with_file_name(NOTHING_IDENTIFIED))? {
            return Err(PipelineError::request_hint(
                nothing_identified(&ws)?,
                format!("`{}` compares the body from tables with the plates", command(session, "compare", None)),
            ));
        }
        return Err(PipelineError::request_hint(
            format!("nothing was identified from {} rows in {}", rows.word(), session.workspace.display()),
            format!("run `{}` first", command(session, "run", None)),
        ));
    };
    Ok(ParametersView {
        version: 1,
        subject: session.facts.person.name.clone(),
        rows_used: rows.word(),
        parameters,
        assessment: assess::stored(session)?,
    })
}
