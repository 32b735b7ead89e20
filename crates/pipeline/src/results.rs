//! Reads the results of stages from a workspace: for later stages, limited to the inputs that they
//! declare, and for commands.

use aloft_body::{Motion, Subject};
use aloft_flight::{Coverage, FlightReport, PlateTare, apply_tare};
use aloft_identify::Parameters;
use aloft_ik::{LabelExchange, exchange_labels, label_exchanges};
use aloft_study::config::Rows;
use aloft_trial::Trial;
use aloft_workspace::artifact::{load_markers, load_motion, load_trial, load_trial_without_points};
use aloft_workspace::error::StageFailure;
use aloft_workspace::json::{read_json, read_json_if_there};
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::workspace::Workspace;
use std::collections::{HashMap, HashSet};
use std::path::PathBuf;

/// The results that a task may read.
#[derive(Debug, Clone, Default)]
pub struct Ready {
    /// `(stage, trial)`, in the order in which the stage names them.
    all: Vec<(String, String)>,
    /// The same by stage.
    by_stage: HashMap<String, HashSet<String>>,
}

impl Ready {
    /// Adds a result.
    pub fn push(&mut self, stage: &str, trial: &str) {
        self.all.push((stage.to_owned(), trial.to_owned()));
        self.by_stage.entry(stage.to_owned()).or_default().insert(trial.to_owned());
    }

    /// True if a result is among them.
    pub fn has(&self, stage: &str, trial: &str) -> bool {
        self.by_stage.get(stage).is_some_and(|trials| trials.contains(trial))
    }

    /// All, `(stage, trial)`, in the order in which the stage names them.
    pub fn all(&self) -> &[(String, String)] {
        &self.all
    }
}

/// Results in a workspace.
#[derive(Debug, Clone, Copy)]
pub struct Results<'a> {
    workspace: &'a Workspace,
    /// The results that may be read; none means all.
    allowed: Option<&'a Ready>,
}

impl<'a> Results<'a> {
    /// All results of a workspace, for commands.
    pub fn of(workspace: &'a Workspace) -> Self {
        Self { workspace, allowed: None }
    }

    /// The results that are inputs of one task.
    pub(crate) fn limited(workspace: &'a Workspace, allowed: &'a Ready) -> Self {
        Self { workspace, allowed: Some(allowed) }
    }

    /// The folder of a result.
    ///
    /// # Errors
    /// A stage tries to read a result that it does not declare as an input; its own results would
    /// not become stale with that input.
    pub fn place(&self, stage: &str, trial: &str) -> Result<PathBuf, StageFailure> {
        if self.allowed.is_some_and(|all| !all.has(stage, trial)) {
            return Err(StageFailure::with_hint(
                format!("the result of `{stage}` for {trial} is not among the inputs of this stage"),
                "this is a defect of aloft, not of your data; please report it with this line",
            ));
        }
        Ok(self.workspace.place(stage, trial))
    }

    /// Hash of the files of a result; empty if there is no such result.
    ///
    /// # Errors
    /// That of [`Results::place`]; its manifest cannot be read.
    pub fn output(&self, stage: &str, trial: &str) -> Result<String, StageFailure> {
        self.place(stage, trial)?;
        Ok(self.workspace.output(stage, trial)?)
    }

    /// The workspace itself, for files that are not results of a stage.
    pub(crate) fn workspace(&self) -> &'a Workspace {
        self.workspace
    }

    /// The imported recording of a trial.
    pub fn load_trial(&self, trial: &str) -> Result<Trial, StageFailure> {
        Ok(load_trial(&self.place("import", trial)?)?)
    }

    /// The same without plates and computed points.
    pub fn load_markers(&self, trial: &str) -> Result<Trial, StageFailure> {
        Ok(load_markers(&self.place("import", trial)?)?)
    }

    /// The same with labels on the markers that have them in the static trial, and the exchanges
    /// that this took.
    pub fn load_labelled_markers(&self, trial: &str) -> Result<(Trial, Vec<LabelExchange>), StageFailure> {
        let subject = self.load_subject("scale")?;
        let mut recording = self.load_markers(trial)?;
        let exchanges = label_exchanges(&subject, &recording);
        exchange_labels(&mut recording, &exchanges);
        Ok((recording, exchanges))
    }

    /// The imported recording without its trajectories, with tared plates.
    pub fn load_tared_plates(&self, trial: &str) -> Result<Trial, StageFailure> {
        let mut recording = load_trial_without_points(&self.place("import", trial)?)?;
        apply_tare(&mut recording, &self.load_tares(trial)?);
        Ok(recording)
    }

    /// Readings of a trial's plates when nothing stands on them.
    pub fn load_tares(&self, trial: &str) -> Result<Vec<PlateTare>, StageFailure> {
        Ok(read_json(&self.place("flight", trial)?.join("tare.json"))?)
    }

    /// The same; none if they are not among the inputs of the stage.
    pub fn load_tares_if_any(&self, trial: &str) -> Result<Option<Vec<PlateTare>>, StageFailure> {
        // none: what a stage does not declare as an input is as if it were not there
        let Ok(place) = self.place("flight", trial) else { return Ok(None) };
        Ok(read_json_if_there(&place.join("tare.json"))?)
    }

    /// The contact of a trial that its plates measure completely.
    pub fn load_coverage(&self, trial: &str) -> Result<Coverage, StageFailure> {
        Ok(read_json(&self.place("flight", trial)?.join("coverage.json"))?)
    }

    /// The motion of a trial as written by a stage.
    pub fn load_motion(&self, stage: &str, trial: &str) -> Result<Motion, StageFailure> {
        Ok(load_motion(&self.place(stage, trial)?)?)
    }

    /// The subject as written by `scale` or `calibrate`.
    pub fn load_subject(&self, stage: &str) -> Result<Subject, StageFailure> {
        Ok(read_json(&self.place(stage, WHOLE_STUDY)?.join("subject.json"))?)
    }

    /// Velocity indices that no marker observes.
    pub fn load_locked(&self) -> Result<Vec<usize>, StageFailure> {
        Ok(read_json(&self.place("scale", WHOLE_STUDY)?.join("locked.json"))?)
    }

    /// The flights of a trial.
    pub fn load_flights(&self, trial: &str) -> Result<FlightReport, StageFailure> {
        Ok(read_json(&self.place("flight", trial)?.join("flights.json"))?)
    }

    /// Parameters identified from one kind of rows; none if they were not identified.
    pub fn load_parameters(&self, rows: Rows) -> Result<Option<Parameters>, StageFailure> {
        let path = self.place("identify", WHOLE_STUDY)?.join(parameters_file(rows));
        Ok(read_json_if_there(&path)?)
    }
}

/// Where the parameters from one kind of rows lie.
pub fn parameters_file(rows: Rows) -> String {
    format!("parameters_{}.json", rows.word())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_cannot_read_a_result_that_it_does_not_name() {
        let dir = tempfile::tempdir().unwrap();
        let workspace = Workspace::open(dir.path());
        let mut named = Ready::default();
        named.push("ik", "jump01");
        let results = Results::limited(&workspace, &named);
        assert!(results.place("ik", "jump01").is_ok());
        for (stage, trial) in [("ik", "jump02"), ("filter", "jump01"), ("identify", WHOLE_STUDY)] {
            let failure = results.place(stage, trial).unwrap_err();
            assert!(failure.problem.contains("not among the inputs"), "{}", failure.problem);
        }
        assert!(Results::of(&workspace).place("filter", "jump01").is_ok());
    }
}
