//! A pipeline bound to the recordings of one subject (one session): its recordings, their roles,
//! and the facts about the subject.

use crate::catalog;
use crate::config::{FlightConfig, IkConfig, ImportConfig, PipelineConfig, TrialsConfig};
use crate::data_set::DataSet;
use crate::effects::{ModelEffects, OwnEffect, check_formulas, for_body, own_effects};
use crate::facts::{FactPlaces, Facts, check_person_kg, find_facts};
use crate::inherit::{PipelineFile, TrialSettings, Whose};
use crate::osim::{OsimSetup, is_osim};
use crate::place::error_at_key;
use crate::possible;
use crate::quote;
use crate::recordings::{
    SessionId, base_beside, bids_beside, fold, globs, is_recording, log_stem, logs_below, markers_beside, may_hold,
    recordings_below, stem_of, trial_names,
};
use crate::robot::RobotSetup;
use aloft_body::ModelSpec;
use aloft_scale::ObjectSpec;
use aloft_trial::MarkerSet;
use aloft_workspace::error::PipelineError;
use aloft_workspace::input;
use aloft_workspace::manifest::WHOLE_STUDY;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Role of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Quiet standing.
    Static,
    /// Functional calibration motion.
    Calibration,
    /// Motion to identify from.
    Identify,
    /// Held out for comparison.
    Validate,
}

impl Role {
    /// Word shown to users.
    pub fn word(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Calibration => "calibration",
            Self::Identify => "identify",
            Self::Validate => "validate",
        }
    }
    /// True for trials whose motion is analysed.
    pub fn is_dynamic(self) -> bool {
        matches!(self, Self::Identify | Self::Validate)
    }
}

/// One recording of the study.
#[derive(Debug, Clone, PartialEq)]
pub struct TrialEntry {
    /// Name, unique in the study: the file's stem, with folders if stems repeat.
    pub name: String,
    /// Role.
    pub role: Role,
    /// C3D or TRC file.
    pub file: PathBuf,
    /// MOT file with forces, for TRC.
    pub forces: Option<PathBuf>,
    /// Group of recordings that it belongs to (`trials.groups`), if any.
    pub group: Option<String>,
    /// Files that belong to the recording: channels and metadata of BIDS-Motion, the base of a
    /// robot.
    pub beside: Vec<PathBuf>,
    /// Reason for its exclusion, if it is excluded.
    pub excluded: Option<String>,
    /// Its own settings, if they differ from the session's.
    pub settings: Option<TrialSettings>,
}

/// A pipeline bound to the recordings of one subject and session.
#[derive(Debug, Clone)]
pub struct SubjectSession {
    /// Subject and session, in a study of several.
    pub id: SessionId,
    /// The configuration.
    pub config: PipelineConfig,
    /// File it was read from.
    pub config_path: PathBuf,
    /// Its text, for messages.
    pub config_text: String,
    /// Folder of recordings.
    pub data: PathBuf,
    /// Folder of results.
    pub workspace: PathBuf,
    /// Recordings, sorted by name.
    pub trials: Vec<TrialEntry>,
    /// Recordings that match no pattern, relative to the data folder.
    pub unmatched: Vec<PathBuf>,
    /// Facts about the subject or object.
    pub facts: Facts,
    /// The model.
    pub model: ModelSpec,
    /// The marker set.
    pub marker_set: MarkerSet,
    /// The object description, for things that are not people.
    pub object: Option<ObjectSpec>,
    /// The robot, for robots.
    pub robot: Option<RobotSetup>,
    /// The OpenSim model, for bodies that one describes.
    pub osim: Option<OsimSetup>,
    /// Effects of the model's present revision.
    pub effects: Vec<crate::revision::ModelEffect>,
    /// Base parameters of the model without effects, from which columns of effects take the centre
    /// of mass; empty before they are known.
    pub plain_base: Vec<f64>,
    /// Effects that the pipeline defines or names in addition to the catalogue.
    pub own_effects: Vec<OwnEffect>,
    /// Effects of the folder beside the pipeline that act on a link which this body does not have,
    /// with that link.
    pub effects_of_other_bodies: Vec<(OwnEffect, String)>,
    /// The anthropometric tables (unused for objects).
    pub anthropometry: aloft_scale::Anthropometry,
    /// Sizes of the recordings' files, read when they are first asked for.
    pub sizes: FileSizes,
}

/// Indices of trials by the sizes of their files.
#[derive(Debug, Clone, Default)]
pub struct FileSizes(OnceLock<HashMap<u64, Vec<usize>>>);

/// Settings that the command line can replace.
#[derive(Debug, Clone, Default)]
pub struct Overrides {
    /// `--data`.
    pub data: Option<PathBuf>,
    /// `--workspace`.
    pub workspace: Option<PathBuf>,
    /// `--subject`: names or patterns; all if empty.
    pub subjects: Vec<String>,
    /// `--session`: names or patterns; all if empty.
    pub sessions: Vec<String>,
}

/// Folders of one study of a set.
#[derive(Debug)]
pub(crate) struct Place<'a> {
    pub id: SessionId,
    /// Folder of its recordings.
    pub data: PathBuf,
    /// Folder of its results.
    pub workspace: PathBuf,
    /// The subject's folder, in a study of several subjects.
    pub subject_folder: Option<PathBuf>,
    /// The whole study's folder of recordings.
    pub root: &'a Path,
}

impl SubjectSession {
    /// Reads the pipeline file and finds the recordings and the subject's facts. For a study of
    /// several subjects this is an error unless the overrides select exactly one; see
    /// [`DataSet::open`].
    pub fn open(path: &Path, overrides: &Overrides) -> Result<Self, PipelineError> {
        DataSet::open(path, overrides)?.only()
    }

    /// Binds a checked pipeline to one set of folders.
    pub(crate) fn bind(pipeline: &PipelineFile, place: Place<'_>) -> Result<Self, PipelineError> {
        let (file, text, dir) = (pipeline.name(), &pipeline.text, pipeline.folder());
        let whose = Whose {
            subject: place.id.subject.as_deref(),
            session: place.id.session.as_deref(),
            subject_folder: place.subject_folder.as_deref().or(Some(&place.data)),
            session_folder: Some(&place.data),
        };
        let config = pipeline.session_config(whose)?;
        let at = |key: &str, e: PipelineError| match e {
            PipelineError::Request { problem, hint } => error_at_key(&file, text, key, problem, hint),
            other => other,
        };
        let robot = match &config.robot {
            Some(robot) => Some(RobotSetup::load(robot, &place.data, place.root).map_err(|e| at("robot", e))?),
            None => None,
        };
        let named = |key: &str, value: &str| {
            if value.is_empty() {
                let hint = "name it, or describe a robot under `robot: {description: robot.yaml}`".to_owned();
                return Err(error_at_key(&file, text, "name", format!("`{key}` is missing"), Some(hint)));
            }
            Ok(())
        };
        let osim = match &config.model {
            name if is_osim(name) => {
                for (key, other) in [
                    ("robot", config.robot.is_some()),
                    ("object", config.object.is_some()),
                    ("marker_set", !config.marker_set.is_empty()),
                ] {
                    if other {
                        let problem = format!("`{key}` beside the OpenSim model `{name}`");
                        let hint = format!("leave `{key}` out: bodies and markers come from the model file");
                        return Err(error_at_key(&file, text, key, problem, Some(hint)));
                    }
                }
                Some(OsimSetup::load(name, &dir, &place.data, place.root).map_err(|e| at("model", e))?)
            }
            _ => None,
        };
        let (model, marker_set): (ModelSpec, MarkerSet) = match (&robot, &osim) {
            (Some(robot), _) => (robot.model.spec.clone(), robot.no_markers()),
            (None, Some(osim)) => (osim.tree.spec.clone(), osim.marker_set()),
            (None, None) => {
                named("model", &config.model)?;
                named("marker_set", &config.marker_set)?;
                let model = load_model(&config.model, &dir).map_err(|e| at("model", e))?;
                let mut set: MarkerSet =
                    possible::load_marker_set(&config.marker_set, &dir).map_err(|e| at("marker_set", e))?;
                if !model.carries.is_empty() {
                    // a part of a body uses its part of the set
                    set.markers.retain(|m| model.links.iter().any(|l| l.name == m.link));
                }
                (model, set)
            }
        };
        if let Some(unknown) = config.ik.weights.keys().find(|k| !marker_set.markers.iter().any(|m| m.label == **k)) {
            let problem = format!("`ik.weights` names the marker `{unknown}`, which the marker set does not have");
            return Err(error_at_key(
                &file,
                text,
                "weights",
                problem,
                Some("see `aloft inspect FILE` for labels".to_owned()),
            ));
        }
        let object = match &config.object {
            Some(name) => Some(catalog::load("objects", name, &dir).map_err(|e| at("object", e))?),
            None => None,
        };
        let anthropometry =
            catalog::load("anthropometry", &config.scale.anthropometry, &dir).map_err(|e| at("anthropometry", e))?;
        let (mut trials, unmatched) = find_trials(&config, &place.data, &file, text)?;
        for trial in &mut trials {
            trial.settings = pipeline.trial_settings(&config, whose, &trial.name)?;
        }
        let mut facts = find_facts(
            &config,
            &FactPlaces {
                data: &place.data,
                subject_folder: place.subject_folder.as_deref(),
                root: place.root,
                id: &place.id,
                model: osim.as_ref().map(|o| (o.name.as_str(), o.tree.mass_kg())),
                object: object.as_ref().map(|o: &ObjectSpec| (o.name.as_str(), o.total_mass_kg)),
            },
            &file,
            text,
        )?;
        if let Some(osim) = &osim {
            osim.check_mass(facts.person.mass_kg).map_err(|e| at("subject", e))?;
        }
        if object.is_none() && osim.is_none() && robot.is_none() {
            check_person_kg(facts.person.mass_kg).map_err(|e| at("subject", e))?;
            let corrected = config.corrections.mass_kg.map_or(Ok(()), check_person_kg);
            corrected.map_err(|e| at("corrections", e))?;
        }
        if let Some(mass_kg) = config.corrections.mass_kg {
            facts.stated_mass_kg = Some(std::mem::replace(&mut facts.person.mass_kg, mass_kg));
        }
        let (own_effects, effects_of_other_bodies) = for_body(own_effects(&config, &file, text, &dir)?, &model);
        check_formulas(&own_effects, &model)?;
        aloft_workspace::format::refuse_other_format(&place.workspace)?;
        let revisions = crate::revision::Revisions::load(&place.workspace)?;
        let (effects, plain_base) = (revisions.effects(), revisions.plain_base());
        Ok(Self {
            id: place.id,
            effects,
            plain_base,
            own_effects,
            effects_of_other_bodies,
            sizes: FileSizes::default(),
            config,
            config_path: pipeline.path.clone(),
            config_text: text.clone(),
            data: place.data,
            workspace: place.workspace,
            trials,
            unmatched,
            facts,
            model,
            marker_set,
            object,
            robot,
            osim,
            anthropometry,
        })
    }

    /// The model's effects with everything that their columns are computed from.
    pub fn model_effects(&self) -> ModelEffects {
        let used = |id: &str| self.effects.iter().any(|e| e.id() == id);
        ModelEffects {
            own: self.own_effects.iter().filter(|o| used(&o.spec.id)).cloned().collect(),
            about: self.plain_base.clone(),
            recordings: (self.effects.iter().any(|e| crate::effects::asks_session_time(e.id())))
                .then(|| self.facts.recordings.clone()),
            model: self.effects.clone(),
        }
    }

    /// Whether contact takes part in identification: as the pipeline states; where it does not,
    /// only if an effect of the model shows in contact alone, or has its size from contact, too.
    pub fn identifies_from_contact(&self) -> bool {
        let on_plates_only = |e: &crate::revision::ModelEffect| {
            let own = self.own_effects.iter().find(|o| o.spec.id == e.id()).map(|o| o.spec.acts);
            // none: a law that was deleted, which opening the study refuses
            own.or_else(|| aloft_effects::effect(e.id()).ok().map(|known| known.acts()))
                .is_some_and(|acts| acts == aloft_effects::ActsIn::Contact)
        };
        self.config
            .identify
            .contact
            .unwrap_or_else(|| self.effects.iter().any(|e| e.sized_with_contact || on_plates_only(e)))
    }

    /// The same study with the effects of the model's latest revision.
    pub fn refreshed(&self) -> Result<Self, PipelineError> {
        let revisions = crate::revision::Revisions::load(&self.workspace)?;
        Ok(Self { effects: revisions.effects(), plain_base: revisions.plain_base(), ..self.clone() })
    }

    /// The folder beside the pipeline file whose files each hold one effect of the user's own.
    pub fn effects_folder(&self) -> PathBuf {
        self.config_path.parent().unwrap_or(Path::new("")).join(crate::effects::EFFECTS_FOLDER)
    }

    /// The same study with the effects that the pipeline and its folder define now.
    pub fn with_own_effects_read_again(&self) -> Result<Self, PipelineError> {
        let file = self.config_path.display().to_string();
        let dir = self.config_path.parent().unwrap_or(Path::new(""));
        let all = own_effects(&self.config, &file, &self.config_text, dir)?;
        let (own_effects, effects_of_other_bodies) = for_body(all, &self.model);
        check_formulas(&own_effects, &self.model)?;
        Ok(Self { own_effects, effects_of_other_bodies, ..self.clone() })
    }

    /// Import settings of a trial (or of the session, for none).
    pub fn import_of<'s>(&'s self, trial: Option<&'s TrialEntry>) -> &'s ImportConfig {
        trial.and_then(|t| t.settings.as_ref()).map_or(&self.config.import, |s| &s.import)
    }

    /// Names by which the person may be called where a recording holds several people, the surest
    /// first: the one that the pipeline states, or else the subject's and those of the folders.
    pub fn names_of_person(&self, trial: Option<&TrialEntry>) -> Vec<String> {
        if let Some(stated) = &self.import_of(trial).person {
            return vec![stated.clone()];
        }
        let folder = self.data.file_name().map(|n| n.to_string_lossy().into_owned());
        let mut names = vec![self.facts.person.name.clone()];
        names.extend(self.id.subject.iter().cloned().chain(folder));
        names.dedup();
        names
    }

    /// Settings of inverse kinematics for a trial.
    pub fn ik_of<'s>(&'s self, trial: Option<&'s TrialEntry>) -> &'s IkConfig {
        trial.and_then(|t| t.settings.as_ref()).map_or(&self.config.ik, |s| &s.ik)
    }

    /// Settings of flight detection for a trial.
    pub fn flight_of<'s>(&'s self, trial: Option<&'s TrialEntry>) -> &'s FlightConfig {
        trial.and_then(|t| t.settings.as_ref()).map_or(&self.config.flight, |s| &s.flight)
    }

    /// True for bodies of rigid links, objects and robots: they have no soft tissue.
    pub fn is_rigid(&self) -> bool {
        self.object.is_some() || self.robot.is_some()
    }

    /// A trial by name.
    pub fn trial(&self, name: &str) -> Option<&TrialEntry> {
        self.trials.iter().find(|t| t.name == name)
    }

    /// Trials that are not excluded.
    pub fn included(&self) -> impl Iterator<Item = &TrialEntry> {
        self.trials.iter().filter(|t| t.excluded.is_none())
    }

    /// The size of a trial's file, and the included trials whose files have it, in order. Sizes of
    /// other files are those of the first call; an empty or unreadable file has none.
    pub fn of_same_size(&self, trial: &TrialEntry) -> Option<(u64, Vec<&TrialEntry>)> {
        // none: its import says why it cannot be read
        let size = |t: &TrialEntry| std::fs::metadata(&t.file).ok().map(|m| m.len()).filter(|n| *n > 0);
        let by_size = self.sizes.0.get_or_init(|| {
            let mut out: HashMap<u64, Vec<usize>> = HashMap::new();
            for (i, t) in self.trials.iter().enumerate().filter(|(_, t)| t.excluded.is_none()) {
                if let Some(size) = size(t) {
                    out.entry(size).or_default().push(i);
                }
            }
            out
        });
        let size = size(trial)?;
        Some((size, by_size.get(&size)?.iter().map(|i| &self.trials[*i]).collect()))
    }

    /// Gravity in the world frame, m/s².
    pub fn gravity(&self) -> nalgebra::Vector3<f64> {
        self.facts.gravity()
    }
}

fn load_model(name: &str, dir: &Path) -> Result<ModelSpec, PipelineError> {
    if name.to_ascii_lowercase().ends_with(".urdf") {
        let path = dir.join(name);
        let text = input::text(&path)?;
        return ModelSpec::from_urdf(&text).map_err(|e| PipelineError::request(format!("{}: {e}", path.display())));
    }
    possible::load_model(name, dir)
}

/// Role of the recordings that a folder may hold; none if no pattern reaches into it.
fn of_folder(trials: &TrialsConfig, folder: &Path) -> Option<Role> {
    let patterns = [
        (Role::Static, &trials.r#static),
        (Role::Calibration, &trials.calibration),
        (Role::Validate, &trials.validate),
        (Role::Identify, &trials.identify),
    ];
    patterns.into_iter().find(|(_, of)| of.iter().any(|p| may_hold(folder, p))).map(|(role, _)| role)
}

fn find_trials(
    config: &PipelineConfig,
    data: &Path,
    file: &str,
    text: &str,
) -> Result<(Vec<TrialEntry>, Vec<PathBuf>), PipelineError> {
    let t = &config.trials;
    let roles = [
        (Role::Static, globs(&t.r#static, "static", file, text)?),
        (Role::Calibration, globs(&t.calibration, "calibration", file, text)?),
        (Role::Validate, globs(&t.validate, "validate", file, text)?),
        (Role::Identify, globs(&t.identify, "identify", file, text)?),
    ];
    let mut found: Vec<(PathBuf, Role)> = Vec::new();
    let mut unmatched = Vec::new();
    let is_robot = config.robot.is_some();
    for relative in if is_robot { logs_below(data)? } else { recordings_below(data)? } {
        let named = if is_robot { log_stem(&relative).is_some() } else { is_recording(&relative) };
        let role = if named {
            roles.iter().find(|(_, set)| set.is_match(&relative)).map(|r| r.0)
        } else {
            // a folder that may not be listed fails in place of the recordings that it may hold
            of_folder(t, &relative)
        };
        match role {
            Some(role) => found.push((relative, role)),
            None if named => unmatched.push(relative),
            None => {}
        }
    }
    let names = trial_names(&found.iter().map(|(relative, _)| relative.as_path()).collect::<Vec<_>>());
    let mut trials = Vec::new();
    for ((relative, role), name) in found.iter().zip(names) {
        let path = data.join(relative);
        let forces = if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("trc")) {
            let folder = path.parent().unwrap_or(data);
            t.forces.iter().map(|f| folder.join(f.replace("{trial}", &stem_of(relative)))).find(|p| input::is_there(p))
        } else {
            None
        };
        let beside = if is_robot {
            base_beside(&path).or_else(|| markers_beside(&path)).into_iter().collect()
        } else {
            bids_beside(&path)
        };
        trials.push(TrialEntry {
            name,
            role: *role,
            file: path,
            forces,
            group: None,
            beside,
            excluded: None,
            settings: None,
        });
    }
    for exclusion in &t.exclude {
        let set = globs(std::slice::from_ref(&exclusion.trial), "exclude", file, text)?;
        for trial in trials.iter_mut().filter(|t| set.is_match(&t.name)) {
            trial.excluded = Some(exclusion.reason.clone());
        }
    }
    for (group, patterns) in &t.groups {
        let set = globs(patterns, "groups", file, text)?;
        for (trial, (relative, _)) in trials.iter_mut().zip(&found) {
            if !set.is_match(relative) && !set.is_match(&trial.name) {
                continue;
            }
            if let Some(other) = &trial.group {
                let problem = format!("{} is in the groups `{other}` and `{group}`", trial.name);
                return Err(error_at_key(file, text, group, problem, Some("a recording has one group".to_owned())));
            }
            trial.group = Some(group.clone());
        }
        if !found.is_empty() && !trials.iter().any(|t| t.group.as_ref() == Some(group)) {
            let problem = format!("no recording is in the group `{group}`");
            return Err(error_at_key(
                file,
                text,
                group,
                problem,
                Some(format!("its patterns are {}", patterns.join(", "))),
            ));
        }
    }
    if trials.is_empty() {
        return Err(PipelineError::request_hint(
            format!("{}: no recording matches the pipeline's `trials`", data.display()),
            if is_robot {
                "expected logs such as jump_01_robot.csv.gz; see `trials` in the pipeline"
            } else {
                "expected .c3d or .trc files; see `trials` in the pipeline"
            },
        ));
    }
    trials.sort_by(|a, b| a.name.cmp(&b.name));
    names_are_usable(&trials, data)?;
    Ok((trials, unmatched))
}

/// Checks the names of all recordings that are not excluded, before anything is read or written.
/// Each recording has its own results and exported files, so its name must be valid as a folder
/// name and differ from all others, also on file systems that ignore case.
fn names_are_usable(trials: &[TrialEntry], data: &Path) -> Result<(), PipelineError> {
    let shown = |t: &TrialEntry| quote::visible(&t.file.strip_prefix(data).unwrap_or(&t.file).display().to_string());
    let mut seen: BTreeMap<String, &TrialEntry> = BTreeMap::new();
    for trial in trials.iter().filter(|t| t.excluded.is_none()) {
        if matches!(trial.name.as_str(), "" | "." | ".." | WHOLE_STUDY) || trial.name.contains(['/', '\0']) {
            return Err(PipelineError::request_hint(
                format!("{}: `{}` cannot name a recording's results", shown(trial), quote::visible(&trial.name)),
                "rename the file, or leave it out with the patterns under `trials`",
            ));
        }
        if let Some(other) = seen.insert(fold(&trial.name), trial) {
            let (a, b) = (quote::visible(&other.name), quote::visible(&trial.name));
            let both = if a == b { format!("are both called `{a}`") } else { format!("are called `{a}` and `{b}`") };
            return Err(PipelineError::request_hint(
                format!("{} and {} {both}: results of one would replace the other's", shown(other), shown(trial)),
                "rename one of the files or folders (upper and lower case count as the same), or leave one out with the patterns under `trials`",
            ));
        }
    }
    Ok(())
}
