//! `status` and `explain`: how every stage of every trial stands, and why.

use crate::error::PipelineError;
use crate::graph::{self, Manifests, Stage, Standing};
use crate::runner::stage_index;
use crate::stages::STAGES;
use crate::study::{Study, TrialEntry};
use crate::workspace::{Manifest, WHOLE_STUDY, Workspace};
use serde::Serialize;

/// The grid of trials and stages.
#[derive(Debug, Clone, Serialize)]
pub struct Status {
    /// Version of this structure.
    pub version: u32,
    /// Stage names, in order.
    pub stages: Vec<&'static str>,
    /// One row a trial, and one for the whole study.
    pub rows: Vec<StatusRow>,
}

/// One row of the grid.
#[derive(Debug, Clone, Serialize)]
pub struct StatusRow {
    /// Trial, or [`WHOLE_STUDY`].
    pub trial: String,
    /// Its part.
    pub role: String,
    /// One word a stage: `ok`, `warning`, `stale`, `failed`, `blocked`, `missing`, `excluded`, or empty where the stage does not apply.
    pub cells: Vec<String>,
}

/// A task's standing with what lies behind it.
#[derive(Debug, Clone)]
pub struct Explanation {
    /// The standing.
    pub standing: Standing,
    /// The last result's manifest.
    pub manifest: Option<Manifest>,
}

fn stand(
    stage: &Stage,
    trial: Option<&TrialEntry>,
    study: &Study,
    ws: &Workspace,
    manifests: &Manifests,
) -> Result<Standing, PipelineError> {
    let name = trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
    let inputs = graph::inputs(stage, trial, study, ws, manifests)?;
    Ok(graph::standing(stage, trial, study, &inputs, manifests.get(stage.name, name)))
}

/// The grid. A stage below a stale one is stale, too.
pub fn status(study: &Study) -> Result<Status, PipelineError> {
    let ws = Workspace::open(&study.workspace);
    let manifests = Manifests::read(study, &ws, STAGES);
    let mut rows = Vec::new();
    for trial in &study.trials {
        let mut cells = Vec::new();
        let mut stale_above = false;
        for stage in STAGES {
            let applies = stage.tasks(study).iter().any(|t| t.is_some_and(|t| t.name == trial.name));
            cells.push(if trial.excluded.is_some() {
                "excluded".to_owned()
            } else if !applies {
                String::new()
            } else {
                let standing = stand(stage, Some(trial), study, &ws, &manifests)?;
                let word = if stale_above && standing.is_current() { "stale" } else { standing.word() };
                stale_above |= matches!(word, "stale" | "missing");
                word.to_owned()
            });
        }
        rows.push(StatusRow { trial: trial.name.clone(), role: trial.role.word().to_owned(), cells });
    }
    let mut cells = Vec::new();
    for stage in STAGES {
        let whole = stage.tasks(study).iter().any(Option::is_none);
        cells.push(if whole { stand(stage, None, study, &ws, &manifests)?.word().to_owned() } else { String::new() });
    }
    rows.push(StatusRow { trial: WHOLE_STUDY.to_owned(), role: "study".to_owned(), cells });
    Ok(Status { version: 1, stages: STAGES.iter().map(|s| s.name).collect(), rows })
}

/// Why one result stands as it does.
pub fn explain(study: &Study, trial: &str, stage: &str) -> Result<Explanation, PipelineError> {
    let stage = STAGES[stage_index(stage)?];
    let ws = Workspace::open(&study.workspace);
    let manifests = Manifests::read(study, &ws, STAGES);
    let task = stage.tasks(study).into_iter().find(|t| t.map_or(WHOLE_STUDY, |t| t.name.as_str()) == trial);
    let Some(task) = task else {
        let names: Vec<&str> =
            stage.tasks(study).into_iter().map(|t| t.map_or(WHOLE_STUDY, |t| t.name.as_str())).collect();
        return Err(PipelineError::request_hint(
            format!("stage {} does not run for `{trial}`", stage.name),
            format!("it runs for {}", names.join(", ")),
        ));
    };
    let standing = stand(stage, task, study, &ws, &manifests)?;
    Ok(Explanation { standing, manifest: manifests.get(stage.name, trial).cloned() })
}
