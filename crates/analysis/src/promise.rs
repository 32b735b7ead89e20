//! What a change would give, before it is made: the stages that `run` and `effect add` run, on a
//! copy of the workspace, so that the promised number is the one that the ladder shows afterwards.

use crate::compare::compare;
use crate::discover::Volume;
use crate::effect::{of_found, of_law};
use crate::freshness::freshness;
use crate::held_out::HeldOutError;
use crate::history::with_reference;
use aloft_discover::{Found, FoundLaw};
use aloft_identify::{EffectEstimate, Parameters};
use aloft_pipeline::progress::{Progress, Silent};
use aloft_pipeline::ready_made::{self, FORECAST};
use aloft_pipeline::results::parameters_file;
use aloft_pipeline::runner::run_held;
use aloft_study::effects::OwnEffect;
use aloft_study::revision::{ModelEffect, ReachedCoefficient};
use aloft_study::settings::{ADJUSTABLE, Adjustable, number_at, with_numbers};
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::disk;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::unfinished::Unfinished;
use aloft_workspace::workspace::Workspace;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

/// A model before it is made.
pub(crate) struct Promised {
    /// Held-out error and floor, in flight and in contact.
    pub errors: Vec<HeldOutError>,
    /// Coefficients of its effects.
    pub coefficients: Vec<EffectEstimate>,
}

/// The model with all effects found added to it, or the laws that replace them;
/// none if none was found, or if the results are not up to date, so that more than the effect would
/// change.
pub(crate) fn promised(
    session: &SubjectSession,
    found: &[Found],
    laws: &[&FoundLaw],
    volume: Volume,
) -> Result<Option<Promised>, PipelineError> {
    if found.is_empty() && laws.is_empty() {
        return Ok(None);
    }
    let fresh = freshness(session)?;
    // results that were whole when the question was asked
    fresh.refuse_damaged(session, &[])?;
    if !fresh.is_current() {
        return Ok(None);
    }
    let with = with_reference(session)?;
    let mut effects = with.effects.clone();
    for mut effect in found.iter().map(of_found).chain(laws.iter().map(|l| of_law(l))) {
        effect.volume_m = Some((volume.middle_m, volume.reach_m));
        effects.push(effect);
    }
    let mut own_effects = session.own_effects.clone();
    for law in laws {
        own_effects.push(OwnEffect::described(&law.effect)?);
    }
    on_a_copy(SubjectSession { effects, own_effects, ..with }, &Silent, Keep::Forecast, |done| {
        let place = Workspace::open(&done.workspace).place("identify", WHOLE_STUDY);
        let file = place.join(parameters_file(done.config.regressor.rows));
        let coefficients = read_json_if_there::<Parameters>(&file)?.map_or(Vec::new(), |p| p.effects);
        Ok(Some(Promised { errors: compare(done)?.errors, coefficients }))
    })
}

/// What differs from the pipeline when a model is tried.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Changes {
    /// Numbers by their place in the pipeline file.
    pub settings: BTreeMap<String, f64>,
    /// Recordings to leave out.
    pub left_out: Vec<String>,
    /// Recordings that the pipeline excludes, to take in.
    pub taken_in: Vec<String>,
}

impl Changes {
    /// The study with these changes.
    ///
    /// # Errors
    /// A setting that does not exist or is out of range, a recording that does not exist.
    pub fn applied(&self, session: &SubjectSession) -> Result<SubjectSession, PipelineError> {
        let mut out = session.clone();
        out.config = with_numbers(&session.config, &self.settings)?;
        for name in self.left_out.iter().chain(&self.taken_in) {
            let names: Vec<&str> = session.trials.iter().map(|t| t.name.as_str()).collect();
            let Some(at) = out.trials.iter_mut().find(|t| t.name == *name) else {
                let hint = aloft_study::nearest::hint(name, &names, "there are");
                return Err(PipelineError::request_hint(format!("there is no recording `{name}`"), hint));
            };
            at.excluded = self.left_out.contains(name).then(|| "left out to see what changes".to_owned());
        }
        Ok(out)
    }
}

/// A setting that can be tried, with its present value.
#[derive(Debug, Clone, Serialize)]
pub struct Setting {
    /// Place in the pipeline file.
    pub path: String,
    /// Title.
    pub title: String,
    /// Unit; empty for none.
    pub unit: String,
    /// What the value means.
    pub note: String,
    /// Value in the pipeline.
    pub value: f64,
}

/// Settings that can be tried, weights of single markers last.
pub fn settings(session: &SubjectSession) -> Vec<Setting> {
    let of = |a: &Adjustable| {
        let value = number_at(&session.config, a.path)?;
        let text = |s: &str| s.to_owned();
        Some(Setting { path: text(a.path), title: text(a.title), unit: text(a.unit), note: text(a.note), value })
    };
    let of_marker = |m: &aloft_trial::MarkerDefinition| Setting {
        path: format!("ik.weights.{}", m.label),
        title: format!("Marker weight {}", m.label),
        unit: String::new(),
        note: String::new(),
        value: session.config.ik.weights.get(&m.label).copied().unwrap_or(m.weight),
    };
    let markers: Vec<Setting> = session.marker_set.markers.iter().map(of_marker).collect();
    ADJUSTABLE.iter().filter_map(of).chain(markers).collect()
}

/// A model computed by all stages.
#[derive(Debug, Clone, Serialize)]
pub struct Tried {
    /// Keys of its effects.
    pub effects: Vec<String>,
    /// Held-out error, noise floor and their ratio, in flight and in held-out contact.
    pub errors: Vec<HeldOutError>,
    /// Coefficients of its effects.
    pub coefficients: Vec<ReachedCoefficient>,
    /// Base parameters: name, value, 95 % interval, unit.
    pub base: Vec<(String, f64, Option<[f64; 2]>, String)>,
    /// Number of recordings in the comparison.
    pub trials: usize,
}

/// A model with these effects and changes, computed by the stages that `run` and `effect add` run,
/// on a copy of the workspace.
///
/// # Errors
/// Changes that cannot be made; stages that fail with them.
pub fn tried(
    session: &SubjectSession,
    effects: Vec<ModelEffect>,
    changes: &Changes,
    progress: &dyn Progress,
) -> Result<Tried, PipelineError> {
    let with = changes.applied(&with_reference(session)?)?;
    let keep = if *changes == Changes::default() { Keep::Forecast } else { Keep::Nothing };
    on_a_copy(SubjectSession { effects: effects.clone(), ..with }, progress, keep, |done| {
        let view = compare(done)?;
        let parameters = crate::parameters::parameters(done, None)?.parameters;
        let base = parameters.base.iter().map(|b| (b.name.clone(), b.value, b.ci95, b.unit.clone()));
        let of = |e: &EffectEstimate| ReachedCoefficient {
            name: e.name.clone(),
            value: e.value,
            se: e.se,
            ci95: e.ci95,
            unit: String::new(),
            range: None,
        };
        Ok(Tried {
            effects: effects.iter().map(|e| e.key.clone()).collect(),
            trials: view.comparison.first.trials.len(),
            errors: view.errors,
            coefficients: parameters.effects.iter().filter(|e| e.not_determined.is_none()).map(of).collect(),
            base: base.collect(),
        })
    })
}

/// What of a copy outlives it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Keep {
    /// Nothing.
    Nothing,
    /// The results that depend on the model's effects, so that `effect add` need not compute them
    /// again.
    Forecast,
}

/// Brings a changed study up to date on a copy of its workspace, and reads the copy. The workspace
/// itself stays as it is; results that the change does not concern are not computed again.
pub(crate) fn on_a_copy<T>(
    changed: SubjectSession,
    progress: &dyn Progress,
    keep: Keep,
    read: impl FnOnce(&SubjectSession) -> Result<T, PipelineError>,
) -> Result<T, PipelineError> {
    let copy = folder_for_copy(&changed.workspace)?;
    link_all(&changed.workspace, copy.path())?;
    let original = Workspace::open(&changed.workspace);
    let with = SubjectSession { workspace: copy.path().to_path_buf(), ..changed };
    let lock = Workspace::open(copy.path()).lock(Duration::ZERO)?;
    let report = run_held(&with, &lock, progress)?;
    // a stage that failed has left the results of the model before; a trial that failed here and
    // not in the workspace would be left out of the numbers
    let mut failed = Vec::new();
    for (task, failure) in report.failures() {
        if original.usable(task.stage, &task.trial)?.is_some() {
            failed.push(failure.problem.clone());
        }
    }
    let after = freshness(&with)?;
    if failed.is_empty() {
        after.refuse_damaged(&with, &[])?;
    }
    if !failed.is_empty() || !after.is_current() {
        return Err(PipelineError::request(format!("it could not be computed: {}", failed.join("; "))));
    }
    let out = read(&with);
    if keep == Keep::Forecast && out.is_ok() {
        ready_made::keep(&with, &Workspace::open(copy.path()), &original, FORECAST);
    }
    drop(lock);
    out
}

/// A new folder for a copy of a workspace: beside it, where files can be linked; inside it, where
/// the folder around it takes none; otherwise among the temporary files of the system.
fn folder_for_copy(workspace: &Path) -> Result<Unfinished, PipelineError> {
    let beside = workspace.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let elsewhere = std::env::temp_dir();
    let mut first = None;
    for folder in [beside, workspace, &elsewhere] {
        match Unfinished::new_in(folder) {
            Ok(copy) => return Ok(copy),
            Err(e) => first = first.or(Some(e)),
        }
    }
    Err(first.unwrap_or_else(|| PipelineError::request("there is no folder for a copy of the workspace")))
}

/// Files beside the stages' folders that the copy needs: the layout of the workspace, and the
/// hashes of recordings that were read before.
const ALSO: [&str; 2] = [aloft_workspace::format::MARKER, "inputs.json"];

/// The stages' results below another folder: links to the same files where the file system has
/// them, copies elsewhere. Results are replaced as a whole and never changed in place, so that a
/// link is as good as a copy.
fn link_all(from: &Path, to: &Path) -> Result<(), PipelineError> {
    // hidden files belong to runs, and copies may stand inside
    let shown = |e: &walkdir::DirEntry| e.depth() == 0 || !e.file_name().to_string_lossy().starts_with('.');
    for entry in walkdir::WalkDir::new(from).min_depth(1).into_iter().filter_entry(shown) {
        let entry = entry.map_err(|e| PipelineError::request(format!("{}: {e}", from.display())))?;
        let Ok(relative) = entry.path().strip_prefix(from) else { continue };
        let target = to.join(relative);
        if entry.file_type().is_dir() {
            disk::create_dir_all(&target)?;
        } else if relative.components().count() > 2 || ALSO.iter().any(|name| relative == Path::new(name)) {
            // files that are changed in place are copied
            if relative.components().count() > 2 {
                disk::link(entry.path(), &target)?;
            } else {
                disk::copy(entry.path(), &target)?;
            }
        }
    }
    Ok(())
}
