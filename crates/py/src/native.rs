//! A pipeline with its folders, and the commands that take one. Every call reads the pipeline
//! again, as the command line does, so that a change of the file or of the model counts at once.

use crate::errors::raise;
use crate::places;
use crate::run::{Opened, RunAnswer};
use crate::work::{Reporter, work};
use aloft_analysis::freshness::{WithStale, with_stale};
use aloft_analysis::{
    assess, check, compare, discover, effect, estimators, export, history, parameters, standing, summary, verify,
};
use aloft_pipeline::runner::{Selection, run_all};
use aloft_study::config::{Angles, Rows};
use aloft_study::data_set::DataSet;
use aloft_study::quote;
use aloft_study::subject_session::{Overrides, SubjectSession};
use aloft_workspace::error::PipelineError;
use pyo3::prelude::*;
use serde::Serialize;
use std::path::PathBuf;

/// What `progress` arguments are.
type Callback<'py> = Option<Bound<'py, PyAny>>;

/// A pipeline and what replaces its folders and its choice of subjects.
#[pyclass(frozen, module = "aloft._aloft")]
pub struct Native {
    pipeline: PathBuf,
    overrides: Overrides,
}

/// An answer as the command line prints it with `--json`.
pub fn text<T: Serialize>(answer: &T) -> Result<String, PipelineError> {
    serde_json::to_string_pretty(answer).map_err(|e| PipelineError::request(format!("cannot write JSON: {e}")))
}

/// The value of one of a few words.
fn word<T: Copy>(what: &str, found: &str, known: &[(&str, T)]) -> Result<T, PipelineError> {
    known.iter().find(|(name, _)| *name == found).map(|(_, value)| *value).ok_or_else(|| {
        let names: Vec<&str> = known.iter().map(|(name, _)| *name).collect();
        PipelineError::request_hint(
            format!("there is no {what} `{found}`"),
            aloft_study::nearest::hint(found, &names, "there are"),
        )
    })
}

impl Native {
    /// The answer about the one subject and session.
    fn ask<T: Serialize>(
        &self,
        py: Python<'_>,
        progress: Callback<'_>,
        ask: impl FnOnce(&SubjectSession, &Reporter) -> Result<T, PipelineError> + Send + 'static,
    ) -> PyResult<String> {
        let (pipeline, overrides) = (self.pipeline.clone(), self.overrides.clone());
        work(py, progress, move |reporter| text(&ask(&SubjectSession::open(&pipeline, &overrides)?, reporter)?))
    }

    /// The same from results: with those that are not up to date.
    fn ask_results<T: Serialize>(
        &self,
        py: Python<'_>,
        progress: Callback<'_>,
        reads: &'static [&'static str],
        ask: impl FnOnce(&SubjectSession, &Reporter) -> Result<T, PipelineError> + Send + 'static,
    ) -> PyResult<String> {
        self.ask(py, progress, move |session, reporter| with_stale(session, reads, |session| ask(session, reporter)))
    }

    fn change(
        &self,
        py: Python<'_>,
        progress: Callback<'_>,
        change: impl FnOnce(
            &SubjectSession,
            &Reporter,
        ) -> Result<(aloft_pipeline::runner::RunReport, effect::History), PipelineError>
        + Send
        + 'static,
    ) -> PyResult<String> {
        self.ask(py, progress, move |session, reporter| {
            let (report, _) = change(session, reporter)?;
            let history = with_stale(&session.refreshed()?, &history::READS, effect::history)?;
            Ok(Changed { run: RunAnswer::of_one(&session.id, &report), history })
        })
    }
}

/// A change of the model: what ran, and the ladder as `history --json` shows it.
#[derive(Serialize)]
struct Changed {
    run: RunAnswer,
    history: WithStale<effect::History>,
}

#[pymethods]
impl Native {
    #[new]
    fn new(
        pipeline: PathBuf,
        data: Option<PathBuf>,
        workspace: Option<PathBuf>,
        subjects: Vec<String>,
        sessions: Vec<String>,
    ) -> Self {
        Self { pipeline, overrides: Overrides { data, workspace, subjects, sessions } }
    }

    /// What the pipeline is bound to: subjects, sessions, recordings, folders, remarks.
    fn look(&self, py: Python<'_>) -> PyResult<String> {
        let (pipeline, overrides) = (self.pipeline.clone(), self.overrides.clone());
        work(py, None, move |_| text(&Opened::of(&DataSet::open(&pipeline, &overrides)?)))
    }

    /// Runs the stages of all subjects and sessions, and writes the summary beside the results.
    #[pyo3(signature = (from_, only, until, trials, force, dry_run, wait, progress))]
    fn run(
        &self,
        py: Python<'_>,
        from_: Option<String>,
        only: Option<String>,
        until: Option<String>,
        trials: Vec<String>,
        force: bool,
        dry_run: bool,
        wait: bool,
        progress: Callback<'_>,
    ) -> PyResult<String> {
        let (pipeline, overrides) = (self.pipeline.clone(), self.overrides.clone());
        let selection = Selection { from: from_, only, until, trials, force, dry_run, shared: false, wait };
        work(py, progress, move |reporter| {
            let set = DataSet::open(&pipeline, &overrides)?;
            let done = run_all(&set, &selection, reporter)?;
            if !dry_run {
                let words = quote::pipeline(&pipeline, overrides.data.as_deref(), overrides.workspace.as_deref());
                summary::summary(&set, &words)?.write(&set)?;
            }
            let answer = RunAnswer::of(&set, &done);
            // no run could begin: the reason of the first is the error
            if done.runs.iter().all(|r| r.report.is_err())
                && let Some(Err(error)) = done.runs.into_iter().next().map(|r| r.report)
            {
                return Err(error);
            }
            text(&answer)
        })
    }

    /// As `aloft compare --json`.
    fn compare(&self, py: Python<'_>) -> PyResult<String> {
        self.ask_results(py, None, &compare::READS, |session, _| compare::compare(session))
    }

    /// As `aloft compare --estimators --json`.
    fn estimators(&self, py: Python<'_>) -> PyResult<String> {
        self.ask_results(py, None, &[], |session, _| estimators::estimators(session))
    }

    /// As `aloft compare --leave-one-out --json`.
    fn leave_one_out(&self, py: Python<'_>) -> PyResult<String> {
        self.ask_results(py, None, &[], |session, _| estimators::leave_one_out(session))
    }

    /// As `aloft parameters --json`.
    fn parameters(&self, py: Python<'_>, rows: Option<String>, assessed: bool) -> PyResult<String> {
        self.ask_results(py, None, &parameters::READS, move |session, _| {
            let known = [("weak", Rows::Weak), ("acceleration", Rows::Acceleration)];
            let rows = rows.as_deref().map(|r| word("kind of rows", r, &known)).transpose()?;
            if assessed {
                assess::assess(session)?;
            }
            parameters::parameters(session, rows)
        })
    }

    /// As `aloft discover --json`.
    fn discover(
        &self,
        py: Python<'_>,
        only: Vec<String>,
        without: Vec<String>,
        closed: bool,
        budget_s: Option<f64>,
        progress: Callback<'_>,
    ) -> PyResult<String> {
        let options = discover::options(only, without, closed, budget_s);
        self.ask_results(py, progress, &[], move |session, reporter| {
            discover::discover(session, &options, &reporter.discovery())
        })
    }

    /// As `aloft discover --self-test --json`.
    fn self_test(
        &self,
        py: Python<'_>,
        only: Vec<String>,
        without: Vec<String>,
        progress: Callback<'_>,
    ) -> PyResult<String> {
        let options = discover::options(only, without, true, None);
        self.ask_results(py, progress, &[], move |session, reporter| {
            discover::self_test(session, &options, &reporter.counted("self-test"))
        })
    }

    /// As `aloft history --json`.
    fn history(&self, py: Python<'_>) -> PyResult<String> {
        self.ask_results(py, None, &history::READS, |session, _| effect::history(session))
    }

    /// As `aloft effect add`; the answer holds `run` and `history`.
    fn add(
        &self,
        py: Python<'_>,
        name: String,
        values: Vec<(String, f64)>,
        wait: bool,
        progress: Callback<'_>,
    ) -> PyResult<String> {
        self.change(py, progress, move |session, reporter| effect::add(session, &name, &values, wait, reporter))
    }

    /// As `aloft effect remove`; the answer holds `run` and `history`.
    fn remove(&self, py: Python<'_>, name: String, wait: bool, progress: Callback<'_>) -> PyResult<String> {
        self.change(py, progress, move |session, reporter| effect::remove(session, &name, wait, reporter))
    }

    /// As `aloft check --json`.
    fn check(&self, py: Python<'_>) -> PyResult<String> {
        self.ask(py, None, |session, _| check::check(session))
    }

    /// As `aloft status --json`.
    fn status(&self, py: Python<'_>) -> PyResult<String> {
        self.ask(py, None, |session, _| standing::status(session))
    }

    /// As `aloft verify --json`.
    fn verify(&self, py: Python<'_>) -> PyResult<String> {
        self.ask(py, None, |session, _| verify::verify(session))
    }

    /// As `aloft summary --json`: all subjects and sessions.
    fn summary(&self, py: Python<'_>) -> PyResult<String> {
        let (pipeline, overrides) = (self.pipeline.clone(), self.overrides.clone());
        work(py, None, move |_| {
            let words = quote::pipeline(&pipeline, overrides.data.as_deref(), overrides.workspace.as_deref());
            text(&summary::summary(&DataSet::open(&pipeline, &overrides)?, &words)?)
        })
    }

    /// Writes files for other programs, as `aloft export`.
    fn export(
        &self,
        py: Python<'_>,
        to: Option<PathBuf>,
        formats: Vec<String>,
        trials: Vec<String>,
        angles: Option<String>,
    ) -> PyResult<String> {
        self.ask(py, None, move |session, _| {
            let known = [("model", Angles::Model), ("isb", Angles::Isb)];
            let angles = angles.as_deref().map(|a| word("convention of joint angles", a, &known)).transpose()?;
            let to = to.map(|to| export::place_of(&to, &session.id));
            export::export(session, &export::ExportOptions { to, formats, trials, angles })
        })
    }

    /// Writes the report page of one subject and session; returns its path.
    fn report(&self, py: Python<'_>, out: Option<PathBuf>) -> PyResult<PathBuf> {
        let (pipeline, overrides) = (self.pipeline.clone(), self.overrides.clone());
        work(py, None, move |_| {
            let session = SubjectSession::open(&pipeline, &overrides)?;
            Ok(with_stale(&session, &[], |session| aloft_report::write(session, out.as_deref()))?.answer)
        })
    }

    /// The path of one file of a result, and why the result is not up to date, if it is not.
    fn result(
        &self,
        py: Python<'_>,
        stage: String,
        trial: Option<String>,
        file: String,
    ) -> PyResult<(PathBuf, Option<String>)> {
        let session = self.one(py)?;
        py.detach(|| places::result(&session, &stage, trial.as_deref(), &file)).map_err(|e| raise(py, &e))
    }

    /// All tables of the results: stage, trial (none for the whole study) and file.
    fn tables(&self, py: Python<'_>) -> PyResult<Vec<(String, Option<String>, String)>> {
        let session = self.one(py)?;
        py.detach(|| places::tables(&session)).map_err(|e| raise(py, &e))
    }
}

impl Native {
    fn one(&self, py: Python<'_>) -> PyResult<SubjectSession> {
        py.detach(|| SubjectSession::open(&self.pipeline, &self.overrides)).map_err(|e| raise(py, &e))
    }
}
