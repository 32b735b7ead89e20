//! Results that exist already outside their places: those that `discover` computed on a copy of the
//! workspace to state what an effect would give, and those that the last change of the model
//! replaced. A task whose version, parameters and inputs are the same takes such a result instead
//! of computing it again, bit for bit.
//!
//! `WORKSPACE/forecast` and `WORKSPACE/replaced` hold one result a task, laid out as a workspace.
//! They are caches: where one is missing, damaged or made from something else, the stage runs.
//! Their files are links to those in place, where the file system has links: results are replaced
//! as a whole and never changed in place.

use crate::graph::{Need, Stage};
use crate::run_report::{Ended, TaskReport};
use crate::stages::STAGES;
use crate::task::Task;
use aloft_study::subject_session::{SubjectSession, TrialEntry};
use aloft_workspace::disk;
use aloft_workspace::manifest::{Manifest, WHOLE_STUDY};
use aloft_workspace::workspace::{Complete, Workspace};
use std::path::Path;
use std::time::Instant;

/// Results that a discovery computed for the effects that it found.
pub const FORECAST: &str = "forecast";
/// Results that the last change of the model replaced.
const REPLACED: &str = "replaced";

/// Results that a change of the model is about to replace, while it runs.
const REPLACING: &str = "replacing";

/// True if two manifests describe the same result.
fn same(a: &Manifest, b: &Manifest) -> bool {
    a.version == b.version && a.parameters == b.parameters && a.inputs == b.inputs && a.output == b.output
}

/// Puts a result into a cache, in place of the one that is there. Nothing waits for the disk: what
/// a crash leaves incomplete does not fit its hashes and is not used.
fn store(from: &Path, into: &Workspace, stage: &str, trial: &str) -> Option<()> {
    // none: what cannot be kept is computed again when it is asked for
    let scratch = into.scratch(stage, trial).ok()?;
    for file in std::fs::read_dir(from).ok()? {
        let file = file.ok()?;
        disk::link(&file.path(), &scratch.join(file.file_name())).ok()?;
    }
    let place = into.place(stage, trial);
    // none: as above
    disk::create_dir_all(place.parent()?).ok()?;
    if place.exists() {
        disk::remove_dir_all(&place).ok()?;
    }
    // none: as above
    disk::rename(&scratch, &place).ok()
}

/// Keeps the results of a study that depend on the effects of its model in a cache of a workspace;
/// `made` is where they are. Those that stand in the workspace already are not kept, unless they
/// are about to be replaced. A cache that cannot be written is none.
pub fn keep(session: &SubjectSession, made: &Workspace, workspace: &Workspace, cache: &str) {
    let into = Workspace::open(&workspace.root().join(cache));
    let _ = into.clear_abandoned();
    let own = made.root() == workspace.root();
    let follow = follow_effects(session);
    for stage in STAGES.iter().filter(|s| follow.contains(&s.name)) {
        for trial in stage.tasks(session) {
            let name = trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
            // none: a result that cannot be read is not kept
            let Ok(Some(manifest)) = made.usable(stage.name, name) else { continue };
            if !own && workspace.manifest(stage.name, name).is_ok_and(|m| m.is_some_and(|m| same(&m, &manifest))) {
                continue;
            }
            // where a cache lacks a result, the stage runs
            let _ = store(&made.place(stage.name, name), &into, stage.name, name);
        }
    }
}

/// Results of a model that is about to change, linked aside before they are replaced.
#[derive(Debug)]
pub struct Replacing<'a>(&'a Workspace);

impl<'a> Replacing<'a> {
    /// Links the results of the present model aside.
    pub fn begin(session: &SubjectSession, workspace: &'a Workspace) -> Self {
        keep(session, workspace, workspace, REPLACING);
        Self(workspace)
    }

    /// The change was made: what it replaced is kept, in place of what the change before replaced.
    pub fn done(self) {
        let of = |name| self.0.root().join(name);
        // caches: what cannot be moved is computed again when it is needed
        let _ = disk::remove_dir_all(&of(REPLACED));
        let _ = disk::rename(&of(REPLACING), &of(REPLACED));
    }
}

/// Stages whose results depend on the effects of the model: those whose parameters hold them, and
/// those that read a result of such a stage.
fn follow_effects(session: &SubjectSession) -> Vec<&'static str> {
    let mut out: Vec<&'static str> = Vec::new();
    // a stage stands after those that it reads
    for stage in STAGES {
        let holds = |t: &Option<&TrialEntry>| (stage.parameters)(session, *t).get("effects").is_some();
        let reads = stage.needs.iter().filter_map(Need::stage).any(|name| out.contains(&name));
        if reads || stage.tasks(session).iter().any(holds) {
            out.push(stage.name);
        }
    }
    out
}

/// A task's result from a cache; none if no cache holds the one that the stage would compute.
pub(crate) fn take(
    stage: &'static Stage,
    task: &Task<'_>,
    session: &SubjectSession,
    workspace: &Workspace,
) -> Option<(Complete, TaskReport)> {
    let started = Instant::now();
    let name = task.trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
    let parameters = (stage.parameters)(session, task.trial);
    [FORECAST, REPLACED].iter().find_map(|cache| {
        let store = Workspace::open(&workspace.root().join(cache));
        // none: a cache that cannot be read is none
        let found = store.usable(stage.name, name).ok()??;
        let fits = found.program == env!("CARGO_PKG_VERSION")
            && found.differences(stage.version, &parameters, &task.inputs.hashes).is_empty();
        // none: as above
        if !fits || !store.damage(stage.name, name).is_ok_and(|found| found.is_empty()) {
            return None;
        }
        // none: what cannot be taken over is computed
        let scratch = workspace.scratch(stage.name, name).ok()?;
        let from = store.place(stage.name, name);
        found.files.keys().try_for_each(|file| disk::link(&from.join(file), &scratch.join(file))).ok()?;
        let report = TaskReport {
            stage: stage.name,
            trial: name.to_owned(),
            ended: Ended::Ran,
            warnings: found.warnings.clone(),
            seconds: started.elapsed().as_secs_f64(),
        };
        // none: as above
        Some((workspace.complete(scratch, found).ok()?, report))
    })
}
