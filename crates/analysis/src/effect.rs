//! `effect list | show | add | remove`: the effects that a model can hold, and the revisions that
//! add or remove them.

use crate::answers::to_add_from;
use crate::compare::compare;
use crate::discover::{Volume, looked_at};
pub use crate::history::{History, HistoryCoefficient, HistoryRow, history, reached};
use crate::joint_laws::{joint_errors, refuse_without_torques};
use crate::scene::scene;
use crate::unknowns::{self, Examples};
use crate::visible::refuse_invisible;
use aloft_discover::{Discovery, Estimate, Found, FoundLaw, Group};
use aloft_effects::{ActsIn, EFFECTS, EffectInstance, EffectKind, Family, FormulaEffect, Scene};
use aloft_pipeline::ready_made::Replacing;
use aloft_pipeline::runner::{Ended, Progress, RunReport, TaskReport, run_held};
use aloft_study::catalog;
use aloft_study::commands::command;
use aloft_study::config::PipelineConfig;
use aloft_study::effects::{KnownEffects, OwnEffect, own_effects};
use aloft_study::nearest;
use aloft_study::ranges::parse_yaml;
use aloft_study::revision::{ModelEffect, Revision, Revisions};
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::input;
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::seal;
use aloft_workspace::workspace::Workspace;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// One effect of the list.
#[derive(Debug, Clone, Serialize)]
pub struct EffectLine {
    /// Identifier.
    pub id: String,
    /// Short title.
    pub title: String,
    /// Physics or artefact.
    pub kind: EffectKind,
    /// Family: `forces`, `kinematics` or `plates`; `own` for effects written as formulas.
    pub family: &'static str,
    /// Where it acts.
    pub acts: ActsIn,
    /// `catalogue`, the file of a user-defined effect, or `example`: a built-in file that a
    /// pipeline can name.
    pub from: String,
}

/// Lists the catalogue, plus the effects that a pipeline defines or names; without a pipeline, plus
/// the built-in examples.
pub fn list(pipeline: Option<&Path>) -> Result<Vec<EffectLine>, PipelineError> {
    let mut out: Vec<EffectLine> = EFFECTS
        .iter()
        .map(|e| EffectLine {
            id: e.id().to_owned(),
            title: e.title().to_owned(),
            kind: e.kind(),
            family: family(e.about().family),
            acts: e.acts(),
            from: "catalogue".to_owned(),
        })
        .collect();
    let line = |f: &FormulaEffect, from: String| EffectLine {
        id: f.id.clone(),
        title: f.title.clone(),
        kind: f.kind,
        family: "own",
        acts: f.acts,
        from,
    };
    match pipeline {
        Some(path) => out.extend(own_of(path)?.iter().map(|o| line(&o.spec, o.origin.clone()))),
        None => {
            for name in catalog::names("effects") {
                out.push(line(
                    &OwnEffect::read(&name, Path::new(""))?.spec,
                    format!("example: effects.files: [{name}]"),
                ));
            }
        }
    }
    Ok(out)
}

/// Word for a family.
fn family(family: Family) -> &'static str {
    match family {
        Family::Forces => "forces",
        Family::Kinematics => "kinematics",
        Family::Plates => "plates",
        Family::Joints => "joints",
    }
}

fn own_of(path: &Path) -> Result<Vec<OwnEffect>, PipelineError> {
    let text = input::text(path)?;
    let file = path.display().to_string();
    let config: PipelineConfig = parse_yaml(&file, &text)?;
    own_effects(&config, &file, &text, path.parent().unwrap_or(Path::new("")))
}

/// One effect's documentation, as Markdown.
#[derive(Debug, Clone, Serialize)]
pub struct EffectPage {
    /// Identifier.
    pub id: String,
    /// Short title.
    pub title: String,
    /// Markdown.
    pub documentation: String,
}

impl EffectPage {
    /// The whole page as Markdown, headed by title and identifier.
    pub fn markdown(&self) -> String {
        let Self { id, title, documentation } = self;
        let heading = if title.is_empty() { id.clone() } else { format!("{title} ({id})") };
        format!("# {heading}\n\n{documentation}")
    }
}

/// Documentation of one effect with its coefficients, units and bounds. The effect is one of the
/// catalogue, of the pipeline, or a built-in example.
pub fn show(id: &str, pipeline: Option<&Path>) -> Result<EffectPage, PipelineError> {
    if let Some(e) = EFFECTS.iter().copied().find(|e| e.is_called(id)) {
        let table = unknowns::table(e, &Examples::built_in()?);
        let documentation = format!("{}\n\n{}", e.about().documentation.trim(), table.trim_end());
        return Ok(EffectPage { id: e.id().to_owned(), title: e.title().to_owned(), documentation });
    }
    let own = match pipeline {
        Some(path) => own_of(path)?,
        None => {
            let names = catalog::names("effects");
            names.iter().map(|n| OwnEffect::read(n, Path::new(""))).collect::<Result<_, _>>()?
        }
    };
    own.iter().find(|o| o.spec.id == id).map(|o| page(&o.spec, &o.origin)).ok_or_else(|| {
        let known: Vec<&str> = EFFECTS.iter().map(|e| e.id()).chain(own.iter().map(|o| o.spec.id.as_str())).collect();
        let hint = nearest::hint(id, &known, "there are");
        PipelineError::request_hint(
            format!("there is no effect `{id}`"),
            match pipeline {
                Some(_) => hint,
                None => format!(
                    "{hint}; effects that a pipeline defines need the pipeline: `aloft effect show P.yaml {id}`"
                ),
            },
        )
    })
}

fn page(f: &FormulaEffect, origin: &str) -> EffectPage {
    let mut lines = vec![f.documentation.trim().to_owned(), String::new(), format!("## As written in {origin}")];
    let mut law = |place: &str, link: &str, force: &Option<[String; 3]>, moment: &Option<[String; 3]>| {
        for (what, unit, of) in [("force", "N", force), ("moment", "N·m", moment)] {
            if let Some(of) = of {
                lines.push(format!("{place}{what} on `{link}`, {unit}: ({})", of.join(",  ")));
            }
        }
    };
    if let Some(point) = &f.point {
        law("", &point.link, &f.force, &f.moment);
    }
    for (i, p) in f.parts.iter().enumerate() {
        law(&format!("part {}: ", i + 1), &p.point.link, &p.force, &p.moment);
    }
    for c in &f.coefficients {
        let bound = |b: Option<f64>| b.map_or("–".to_owned(), |x| x.to_string());
        lines.push(format!("coefficient `{}`, {}, from {} to {}", c.name, c.unit, bound(c.lower), bound(c.upper)));
    }
    for p in &f.parameters {
        lines.push(format!("parameter `{}`, {}, from {} to {}", p.name, p.unit, p.lower, p.upper));
    }
    for c in &f.constants {
        lines.push(format!("constant `{}` = {} {}", c.name, c.value, c.unit));
    }
    lines.extend(f.definitions.iter().map(|d| format!("`{}` = {}", d.name, d.formula)));
    EffectPage { id: f.id.clone(), title: f.title.clone(), documentation: lines.join("\n").trim().to_owned() }
}

/// Adds an effect as a new revision and brings the results that depend on it up to date. The
/// workspace is locked throughout; `wait` waits for another process that holds the lock.
pub fn add(
    session: &SubjectSession,
    key: &str,
    set: &[(String, f64)],
    wait: bool,
    progress: &dyn Progress,
) -> Result<(RunReport, History), PipelineError> {
    let written = write_law(session, key)?;
    let read_again;
    let session = match &written {
        Some(_) => {
            read_again = session.with_own_effects_read_again()?;
            &read_again
        }
        None => session,
    };
    let done = change(session, wait, progress, |session, all, notes| {
        if let Some(path) = &written {
            notes.push(format!("the law is an effect of your own now: {}", path.display()));
        }
        let mut effects = all.effects();
        let asked = Asked::read(session)?;
        if asked.names(key) && !asked.is_of(session)? {
            notes.push(format!("the values of {key} come from a `discover` of other results; run `discover` again"));
        }
        let scene = asked.scene(session)?;
        let known = KnownEffects::of(&session.own_effects, &scene)?;
        let held = all.held_last(key).filter(|_| !asked.names(key) && set.is_empty());
        let (chosen, choice) = match held {
            Some((number, held)) => {
                notes.push(format!("`{}` has the values that it had in revision {number}", held.key));
                let choice = known.choice(&scene, &held)?;
                (held, choice)
            }
            None => {
                let (chosen, choice) = asked.chosen(&known, &scene, key, set)?;
                notes.extend(asked.unfitted(&choice, &scene, key, set));
                (chosen, choice)
            }
        };
        if effects.iter().any(|e| e.key == chosen.key) {
            return Err(PipelineError::request_hint(
                format!("the model holds `{}` already", chosen.key),
                "see `aloft history`; remove it first to change it",
            ));
        }
        if let Some(held) = effects.iter().find(|e| key == e.id() && e.key != chosen.key) {
            return Err(PipelineError::request_hint(
                format!("the model holds `{}` already", held.key),
                format!("for a second one name its place: `{}`; or remove the other first", chosen.key),
            ));
        }
        crate::discover::refuse_without_numbers(session, &chosen)?;
        let action = format!("add {}", chosen.key);
        let key = chosen.key.clone();
        let doubt = asked.not_named(session, &chosen)?;
        // the class of an effect that is added again is the one that it had
        let as_well =
            asked.as_well(&chosen).or_else(|| all.revisions.iter().rev().find_map(|r| r.confusable.get(&key).cloned()));
        effects.push(chosen);
        if choice.effect.acts().in_joints() {
            refuse_without_torques(session, &choice.key(&scene))?;
        } else {
            refuse_invisible(session, &effects, &choice, &scene)?;
        }
        let mut next = all.next(action, effects);
        next.doubted.extend(doubt.map(|why| (key.clone(), why)));
        next.confusable.extend(as_well.filter(|others| !others.is_empty()).map(|others| (key, others)));
        Ok(next)
    });
    // none: the error itself is returned below
    if let (Err(_), Some(path)) = (&done, &written) {
        // a law that is not added leaves no file of its own; why it was not is the message
        aloft_workspace::disk::remove_file(path).ok();
    }
    done
}

/// The discovery of a workspace from which effects take the values of their nonlinear parameters:
/// that for the present model, otherwise the last one.
#[derive(Debug, Default)]
pub struct Asked {
    /// The answer; none if nothing was asked.
    pub found: Option<Discovery>,
    /// Hash of the results that it was computed from.
    made_from: Option<String>,
    volume: Option<Volume>,
}

impl Asked {
    /// Reads what is stored in the workspace.
    pub fn read(session: &SubjectSession) -> Result<Self, PipelineError> {
        let (found, made_from) = to_add_from(session)?.map(|k| (k.answer, k.made_from)).unzip();
        let volume = seal::read_if_there(&session.workspace.join("discovery_volume.json"))?;
        Ok(Self { found, made_from, volume })
    }

    /// True if it was computed from the present results.
    ///
    /// # Errors
    /// A manifest is there and cannot be read.
    pub fn is_of(&self, session: &SubjectSession) -> Result<bool, PipelineError> {
        let Some(from) = &self.made_from else { return Ok(false) };
        Ok(*from == looked_at(session)?)
    }

    /// True if it holds values for an effect.
    fn names(&self, key: &str) -> bool {
        self.found.as_ref().is_some_and(|d| suggestion(d, key).is_some())
    }

    /// What explains the recordings as well as an effect that the discovery named: the others of
    /// its class, and the same effect on other links. None if the discovery did not name it.
    fn as_well(&self, effect: &ModelEffect) -> Option<Vec<String>> {
        let d = self.found.as_ref()?;
        let group = d.groups.iter().find(|g| g.effects.iter().any(|e| e == effect.id()))?;
        let rivals = group.effects.iter().filter(|e| !group.is_sure() && *e != effect.id()).cloned();
        let links = d.found.iter().filter(|f| f.key == effect.key).flat_map(|f| &f.also_on);
        Some(rivals.chain(links.map(|link| format!("{}[{link}]", effect.id()))).collect())
    }

    /// Why the discovery on the present results did not name an effect that it ranked; none if it
    /// named it, or says nothing of it.
    fn not_named(&self, session: &SubjectSession, effect: &ModelEffect) -> Result<Option<String>, PipelineError> {
        let Some(d) = self.found.as_ref() else { return Ok(None) };
        if !self.is_of(session)? {
            return Ok(None);
        }
        let id = effect.id();
        let named = d.groups.iter().any(|g| g.effects.iter().any(|e| e == id)) || d.effects.iter().any(|e| e == id);
        let c = d.candidates.iter().find(|c| c.effect == id).filter(|_| !named);
        Ok(c.map(|c| {
            let left = aloft_compare::significant(100.0 * c.held_out_ratio, 2);
            format!("it left {left} % of the error in {}, and {}", c.judged_on, crate::verdict::decided(c, d))
        }))
    }

    /// What the model does not know of an effect that the discovery did not fit, in words.
    fn unfitted(&self, choice: &EffectInstance<'_>, scene: &Scene, key: &str, set: &[(String, f64)]) -> Option<String> {
        if self.names(key) || choice.effect.acts().in_joints() {
            return None;
        }
        let parameters = choice.effect.nonlinear(scene, choice.target);
        let names = parameters.iter().map(|p| p.name.as_str());
        let start: Vec<&str> = names.filter(|n| !set.iter().any(|(given, _)| given == n)).collect();
        let key = choice.key(scene);
        Some(match start.as_slice() {
            [] => format!(
                "the interval of `{key}` leaves out errors of the body's geometry; `aloft discover`, run first, includes them"
            ),
            [..] => format!(
                "{} of `{key}` are starting values that were not fitted, and its interval takes them for exact; `aloft discover`, \
                 run first, fits them",
                start.join(", ")
            ),
        })
    }

    /// The scene in which its columns were formed.
    pub fn scene(&self, session: &SubjectSession) -> Result<Scene, PipelineError> {
        let mut scene = scene(session)?;
        if let Some(v) = &self.volume {
            (scene.volume_centre_m, scene.volume_reach_m) = (v.middle_m.into(), v.reach_m);
        }
        Ok(scene)
    }

    /// An effect as `effect add` stores it in a model, with values from the discovery and those of
    /// the user.
    pub fn chosen<'k>(
        &self,
        known: &'k KnownEffects,
        scene: &Scene,
        key: &str,
        set: &[(String, f64)],
    ) -> Result<(ModelEffect, EffectInstance<'k>), PipelineError> {
        let suggestion = self.found.as_ref().and_then(|d| suggestion(d, key));
        let mut chosen = suggestion.unwrap_or_else(|| ModelEffect { key: key.to_owned(), ..ModelEffect::default() });
        chosen.volume_m = self.volume.map(|v| (v.middle_m, v.reach_m));
        chosen.nonlinear.extend(set.iter().cloned());
        if !set.is_empty() {
            // parameters stated by the user are not fitted
            chosen.widening.clear();
        }
        let choice = known.choice(scene, &chosen)?;
        chosen.key = choice.key(scene);
        Ok((chosen, choice))
    }
}

/// Writes a law that the last discovery found as a file in the folder `effects` beside the
/// pipeline, so that it is an effect of the user's own. `None` if `key` names no such law, or an
/// effect that exists already.
fn write_law(session: &SubjectSession, key: &str) -> Result<Option<PathBuf>, PipelineError> {
    if let Some((other, link)) = session.effects_of_other_bodies.iter().find(|(o, _)| o.spec.id == key) {
        return Err(PipelineError::request_hint(
            format!("`{key}` acts on the link `{link}`, which this body does not have"),
            format!("its file is {}", other.origin),
        ));
    }
    let own = session.own_effects.iter().find(|o| o.spec.id == key);
    let known = own.is_some() || EFFECTS.iter().any(|e| e.is_called(key));
    let law = to_add_from(session)?.and_then(|d| d.answer.open).and_then(|o| o.laws.into_iter().find(|l| l.id == key));
    if let (Some(law), Some(own)) = (&law, own)
        && !law.effect.is_same_law(&own.spec)
    {
        return Err(PipelineError::request_hint(
            format!("`{key}` in {} is not the law that `discover` found on these recordings", own.origin),
            format!(
                "run `{}` again: it will give its law an unused name, and rank the law in the file as well",
                command(session, "discover", None)
            ),
        ));
    }
    if law.is_none() && !known && key.starts_with("law_") {
        return Err(PipelineError::request_hint(
            format!("`discover` has found no law `{key}` on these recordings"),
            format!("`{}` searches for laws and prints their names", command(session, "discover", None)),
        ));
    }
    let Some(law) = law.filter(|_| !known) else { return Ok(None) };
    let folder = session.effects_folder();
    let path = folder.join(format!("{key}.yaml"));
    if path.symlink_metadata().is_ok() {
        return Err(PipelineError::request_hint(
            format!("{} exists already, and holds another effect", path.display()),
            "move or rename it, then add the law again",
        ));
    }
    let text = OwnEffect::text_of(&law.effect)?;
    aloft_workspace::disk::create_dir_all(&folder)?;
    let text = format!("# Found by `aloft discover`: {}\n{text}", law.text);
    aloft_workspace::theirs::write_new(&path, text.as_bytes())?;
    Ok(Some(path))
}

/// An effect as the model stores it, from what a discovery estimated.
fn stored(key: &str, nonlinear: BTreeMap<String, f64>, coefficients: &[Estimate], trials: &[String]) -> ModelEffect {
    ModelEffect {
        key: key.to_owned(),
        nonlinear,
        trials: trials.to_vec(),
        widening: coefficients.iter().filter(|e| e.widening > 1.0).map(|e| (e.name.clone(), e.widening)).collect(),
        ..ModelEffect::default()
    }
}

fn values(estimates: &[Estimate]) -> BTreeMap<String, f64> {
    estimates.iter().map(|e| (e.name.clone(), e.value)).collect()
}

/// An effect that a discovery found, as the model stores it.
pub(crate) fn of_found(f: &Found) -> ModelEffect {
    let effect = stored(&f.key, values(&f.nonlinear), &f.coefficients, &f.trials);
    ModelEffect { sized_with_contact: f.sized_with_contact, ..effect }
}

/// A law that a discovery found, as the model stores it.
pub(crate) fn of_law(law: &FoundLaw) -> ModelEffect {
    let effect = stored(&law.id, values(&law.parameters), &law.coefficients, &[]);
    ModelEffect { sized_with_contact: law.sized_with_contact, ..effect }
}

/// What the last discovery found for an effect: its key with target, its nonlinear parameters and
/// its trials. A key with a target selects that target, and only what was found for it is used.
pub(crate) fn suggestion(d: &Discovery, key: &str) -> Option<ModelEffect> {
    let candidate = || {
        let c = d.candidates.iter().find(|c| c.key == key || c.effect == key)?;
        // one of a class is sized from the same recordings as the effect that was found
        let in_class = |g: &&Group| g.effects.contains(&c.effect);
        let class = d.groups.iter().find(in_class).map_or(&[][..], |g| &g.effects);
        let sized_with_contact = d.found.iter().any(|f| f.sized_with_contact && class.contains(&f.effect));
        let effect = stored(&c.key, values(&c.nonlinear), &c.coefficients, &c.trials);
        Some(ModelEffect { sized_with_contact, ..effect })
    };
    let found = d.found.iter().find(|f| f.key == key || f.effect == key).map(of_found);
    let joint = || {
        let j = d.joints.as_ref()?;
        let named = j.found.iter().find(|f| f.key == key).map(of_found);
        named.or_else(|| {
            let c = j.joints.iter().flat_map(|j| &j.candidates).find(|c| c.key == key)?;
            Some(stored(&c.key, values(&c.nonlinear), &c.coefficients, &[]))
        })
    };
    found.or_else(candidate).or_else(joint).or_else(|| d.open.as_ref()?.laws.iter().find(|l| l.id == key).map(of_law))
}

/// Removes an effect: a new revision without it.
pub fn remove(
    session: &SubjectSession,
    key: &str,
    wait: bool,
    progress: &dyn Progress,
) -> Result<(RunReport, History), PipelineError> {
    change(session, wait, progress, |_, all, _| {
        let mut effects = all.effects();
        let before = effects.len();
        effects.retain(|e| e.key != key && e.id() != key);
        if effects.len() == before {
            let held: Vec<&str> = effects.iter().map(|e| e.key.as_str()).collect();
            return Err(PipelineError::request_hint(
                format!("the model holds no `{key}`"),
                if held.is_empty() { "it holds no effect".to_owned() } else { nearest::hint(key, &held, "it holds") },
            ));
        }
        Ok(all.next(format!("remove {key}"), effects))
    })
}

/// Takes the last revision back: a new revision with the effects of the one before it.
pub fn undo(
    session: &SubjectSession,
    wait: bool,
    progress: &dyn Progress,
) -> Result<(RunReport, History), PipelineError> {
    change(session, wait, progress, |_, all, _| {
        let before = all.revisions.iter().rev().nth(1).map(|r| r.effects.clone());
        match (before, all.revisions.last()) {
            (Some(before), Some(last)) => Ok(all.next(format!("undo {}", last.action), before)),
            _ => Err(PipelineError::request_hint("there is nothing to undo", "the model has no effect yet")),
        }
    })
}

/// One transaction over the model, its results and its history, recorded in `model.json`. The new
/// revision is stored there as pending while its results are computed; the single write that ends
/// the transaction makes it the current model, together with what it reached. If the process is
/// interrupted before that write, the earlier model stays in force, and results already computed
/// for the new one are stale by their manifests.
fn change(
    session: &SubjectSession,
    wait: bool,
    progress: &dyn Progress,
    decide: impl Fn(&SubjectSession, &Revisions, &mut Vec<String>) -> Result<Revision, PipelineError>,
) -> Result<(RunReport, History), PipelineError> {
    let ws = Workspace::open(&session.workspace);
    let lock = ws.lock(if wait { Duration::MAX } else { Duration::ZERO })?;
    let mut notes = Vec::new();
    // reload the model now that the lock keeps others from changing it
    let mut all = Revisions::load(&session.workspace)?;
    if let Some(cut) = all.pending.take() {
        notes.push(format!("`effect {}` was interrupted; the model is the one before it", cut.action));
    }
    let present = session.refreshed()?;
    let before = run_held(&present, &lock, progress)?;
    notes.extend(before.notes.iter().cloned());
    if before.ran() > 0 {
        notes.push(format!("the present model's results were not up to date: {} were made again first", before.ran()));
    }
    if let Some(problem) = no_comparison(&before) {
        all.save(&session.workspace)?;
        return Err(problem);
    }
    let mut now = reached(&present, &compare(&present)?)?;
    // the torques' errors of the present model, as long as its results are in place
    now.joints = joint_errors(&present)?;
    if let Some(last) = all.revisions.last_mut() {
        last.reached = Some(now);
    }
    let decided = decide(&present, &all, &mut notes);
    if decided.is_err() {
        all.save(&session.workspace)?;
    }
    let mut next = decided?;
    all.pending = Some(next.clone());
    all.save(&session.workspace)?;
    let with = SubjectSession { effects: next.effects.clone(), plain_base: all.plain_base(), ..present.clone() };
    // the change can be taken back without computing the present results again
    let replacing = Replacing::begin(&present, &ws);
    let done = run_held(&with, &lock, progress).and_then(|report| match no_comparison(&report) {
        None => Ok(report),
        Some(problem) => Err(problem),
    });
    all.pending = None;
    let mut report = match done {
        Ok(report) => report,
        Err(error) => {
            all.save(&session.workspace)?;
            run_held(&present, &lock, progress)?;
            return Err(error);
        }
    };
    let mut then = reached(&with, &compare(&with)?)?;
    then.joints = joint_errors(&with)?;
    next.reached = Some(then);
    all.revisions.push(next);
    all.save(&session.workspace)?;
    replacing.done();
    report.notes.splice(0..0, notes);
    drop(lock);
    Ok((report, history(&session.refreshed()?)?))
}

/// Reason why a model has no comparison after a run; none if it has one.
fn no_comparison(report: &RunReport) -> Option<PipelineError> {
    let bad = |t: &&TaskReport| matches!(t.ended, Ended::Failed(_) | Ended::Blocked(_));
    report.tasks.iter().filter(|t| t.stage == "compare").find(bad)?;
    let whole = |t: &&TaskReport| t.trial == WHOLE_STUDY;
    let failed = report.failures().find(|(t, _)| whole(t)).or_else(|| report.failures().next());
    let (what, hint) = failed.map_or_else(
        || ("there is nothing to compare".to_owned(), None),
        |(t, f)| (format!("{} failed: {}", t.stage, f.problem), f.hint.clone()),
    );
    Some(PipelineError::Request { problem: format!("the model is unchanged: {what}"), hint })
}
