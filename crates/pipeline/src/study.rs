//! A pipeline bound to a folder: which recordings there are, what part each plays, and who moved.

use crate::catalog;
use crate::config::{PipelineConfig, error_at_key, parse_yaml};
use crate::effects::{OwnEffect, check_formulas, own_effects};
use crate::error::PipelineError;
use aloft_body::{ModelSpec, PersonFacts, Sex};
use aloft_scale::ObjectSpec;
use aloft_trial::MarkerSet;
use globset::{GlobBuilder, GlobSet, GlobSetBuilder};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The part that a recording plays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Standing still.
    Static,
    /// Functional calibration.
    Calibration,
    /// Motion to identify from.
    Identify,
    /// Held out for comparison.
    Validate,
}

impl Role {
    /// The word that users see.
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
    /// Name, unique in the study: the file's stem, with folders where stems repeat.
    pub name: String,
    /// Its part.
    pub role: Role,
    /// C3D or TRC file.
    pub file: PathBuf,
    /// MOT file with forces, for TRC.
    pub forces: Option<PathBuf>,
    /// Group of recordings that it belongs to (`trials.groups`), where one is named.
    pub group: Option<String>,
    /// Why it is left out, where it is.
    pub excluded: Option<String>,
}

/// Facts about the subject or object with the laboratory's gravity.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Facts {
    /// Name, sex, height, mass.
    pub person: PersonFacts,
    /// Magnitude of gravity, m/s².
    pub gravity_mps2: f64,
    /// Where each fact was found, for the report.
    pub sources: Vec<String>,
}

/// A pipeline bound to a folder of recordings.
#[derive(Debug, Clone)]
pub struct Study {
    /// The configuration.
    pub config: PipelineConfig,
    /// Where it was read from.
    pub config_path: PathBuf,
    /// Its text, for messages.
    pub config_text: String,
    /// Folder of recordings.
    pub data: PathBuf,
    /// Folder of results.
    pub workspace: PathBuf,
    /// Recordings, sorted by name.
    pub trials: Vec<TrialEntry>,
    /// Who moved.
    pub facts: Facts,
    /// The model.
    pub model: ModelSpec,
    /// The marker set.
    pub marker_set: MarkerSet,
    /// The object description, for things that are not people.
    pub object: Option<ObjectSpec>,
    /// Effects of the model's present revision.
    pub effects: Vec<crate::revision::ModelEffect>,
    /// Base parameters of the plain model, with which columns of effects place the centre of mass; empty before they are known.
    pub plain_base: Vec<f64>,
    /// Effects that the pipeline defines or names beside the catalogue.
    pub own_effects: Vec<OwnEffect>,
    /// The anthropometric tables (unused for objects).
    pub anthropometry: aloft_scale::Anthropometry,
}

/// What the command line may replace.
#[derive(Debug, Clone, Default)]
pub struct Overrides {
    /// `--data`.
    pub data: Option<PathBuf>,
    /// `--workspace`.
    pub workspace: Option<PathBuf>,
}

impl Study {
    /// Reads the pipeline file, finds the recordings and the subject's facts.
    pub fn open(path: &Path, overrides: &Overrides) -> Result<Self, PipelineError> {
        let text = std::fs::read_to_string(path).map_err(PipelineError::io("read", path))?;
        let file = path.display().to_string();
        let config: PipelineConfig = parse_yaml(&file, &text)?;
        let dir = path.parent().map(Path::to_path_buf).unwrap_or_default();
        let data = match (&overrides.data, &config.data) {
            (Some(d), _) => d.clone(),
            (None, Some(d)) => dir.join(d),
            (None, None) => {
                return Err(PipelineError::request_hint(
                    format!("{file}: no folder of recordings"),
                    "add `data: FOLDER` to the pipeline, or give --data FOLDER",
                ));
            }
        };
        if !data.is_dir() {
            return Err(error_at_key(
                &file,
                &text,
                "data",
                format!("{} is not a folder", data.display()),
                Some("give the folder that holds the recordings, relative to the pipeline file, or --data".to_owned()),
            ));
        }
        let workspace = match (&overrides.workspace, &config.workspace) {
            (Some(w), _) => w.clone(),
            (None, Some(w)) => dir.join(w),
            (None, None) => {
                let name =
                    data.canonicalize().ok().and_then(|p| p.file_name().map(|n| n.to_string_lossy().into_owned()));
                PathBuf::from("workspaces").join(format!(
                    "{}-{}",
                    config.name,
                    name.unwrap_or_else(|| "data".to_owned())
                ))
            }
        };
        let at = |key: &str, e: PipelineError| match e {
            PipelineError::Request { problem, hint } => error_at_key(&file, &text, key, problem, hint),
            other => other,
        };
        let model = load_model(&config.model, &dir).map_err(|e| at("model", e))?;
        let marker_set: MarkerSet =
            catalog::load("markersets", &config.marker_set, &dir).map_err(|e| at("marker_set", e))?;
        let object = match &config.object {
            Some(name) => Some(catalog::load("objects", name, &dir).map_err(|e| at("object", e))?),
            None => None,
        };
        let anthropometry =
            catalog::load("anthropometry", &config.scale.anthropometry, &dir).map_err(|e| at("anthropometry", e))?;
        let trials = find_trials(&config, &data, &file, &text)?;
        let facts = find_facts(&config, &data, &file, &text)?;
        let own_effects = own_effects(&config, &file, &text, &dir)?;
        check_formulas(&own_effects, &model)?;
        let revisions = crate::revision::Revisions::load(&workspace)?;
        let (effects, plain_base) = (revisions.effects(), revisions.plain_base());
        Ok(Self {
            effects,
            plain_base,
            own_effects,
            config,
            config_path: path.to_path_buf(),
            config_text: text,
            data,
            workspace,
            trials,
            facts,
            model,
            marker_set,
            object,
            anthropometry,
        })
    }

    /// What the columns of the model's effects are made from, for the stages that make them.
    pub fn effects_parameters(&self) -> serde_json::Value {
        if self.effects.is_empty() {
            return serde_json::Value::Array(Vec::new());
        }
        let own: Vec<&aloft_effects::FormulaEffect> = self
            .own_effects
            .iter()
            .filter(|o| self.effects.iter().any(|e| e.id() == o.spec.id))
            .map(|o| &o.spec)
            .collect();
        let bytes: Vec<u8> = self.plain_base.iter().flat_map(|x| x.to_le_bytes()).collect();
        serde_json::json!({"model": self.effects, "own": own, "about": blake3::hash(&bytes).to_hex().to_string()})
    }

    /// A trial by name.
    pub fn trial(&self, name: &str) -> Option<&TrialEntry> {
        self.trials.iter().find(|t| t.name == name)
    }

    /// Trials that are not excluded.
    pub fn included(&self) -> impl Iterator<Item = &TrialEntry> {
        self.trials.iter().filter(|t| t.excluded.is_none())
    }

    /// Gravity in the world frame, m/s².
    pub fn gravity(&self) -> nalgebra::Vector3<f64> {
        nalgebra::Vector3::new(0.0, 0.0, -self.facts.gravity_mps2)
    }
}

fn load_model(name: &str, dir: &Path) -> Result<ModelSpec, PipelineError> {
    if name.to_ascii_lowercase().ends_with(".urdf") {
        let path = dir.join(name);
        let text = std::fs::read_to_string(&path).map_err(PipelineError::io("read", &path))?;
        return ModelSpec::from_urdf(&text).map_err(|e| PipelineError::request(format!("{}: {e}", path.display())));
    }
    catalog::load("models", name, dir)
}

fn globs(patterns: &[String], key: &str, file: &str, text: &str) -> Result<GlobSet, PipelineError> {
    let mut builder = GlobSetBuilder::new();
    let wrong = |p: &str, e: globset::Error| {
        error_at_key(
            file,
            text,
            key,
            format!("`{p}` is not a file pattern: {}", e.kind()),
            Some("use *, ? and ** as in a shell".to_owned()),
        )
    };
    for p in patterns {
        builder.add(GlobBuilder::new(p).literal_separator(true).build().map_err(|e| wrong(p, e))?);
    }
    builder.build().map_err(|e| wrong("", e))
}

fn is_recording(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("c3d") || e.eq_ignore_ascii_case("trc"))
}

fn find_trials(config: &PipelineConfig, data: &Path, file: &str, text: &str) -> Result<Vec<TrialEntry>, PipelineError> {
    let t = &config.trials;
    let roles = [
        (Role::Static, globs(&t.r#static, "static", file, text)?),
        (Role::Calibration, globs(&t.calibration, "calibration", file, text)?),
        (Role::Validate, globs(&t.validate, "validate", file, text)?),
        (Role::Identify, globs(&t.identify, "identify", file, text)?),
    ];
    let mut found: Vec<(PathBuf, Role)> = Vec::new();
    for entry in walkdir::WalkDir::new(data).sort_by_file_name() {
        let entry = entry.map_err(|e| PipelineError::Io {
            action: "list",
            path: data.to_path_buf(),
            source: e.into_io_error().unwrap_or_else(|| std::io::Error::other("a loop of links")),
        })?;
        if !entry.file_type().is_file() || !is_recording(entry.path()) {
            continue;
        }
        let relative = entry.path().strip_prefix(data).unwrap_or(entry.path());
        if let Some((role, _)) = roles.iter().find(|(_, set)| set.is_match(relative)) {
            found.push((relative.to_path_buf(), *role));
        }
    }
    let stem = |p: &Path| p.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let mut trials = Vec::new();
    for (relative, role) in &found {
        let short = stem(relative);
        let unique = found.iter().filter(|(other, _)| stem(other) == short).count() == 1;
        let name = if unique {
            short
        } else {
            relative.components().map(|c| c.as_os_str().to_string_lossy().into_owned()).collect::<Vec<_>>().join("-")
        };
        let path = data.join(relative);
        let forces = if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("trc")) {
            let folder = path.parent().unwrap_or(data);
            t.forces.iter().map(|f| folder.join(f.replace("{trial}", &stem(relative)))).find(|p| p.is_file())
        } else {
            None
        };
        trials.push(TrialEntry { name, role: *role, file: path, forces, group: None, excluded: None });
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
            "expected .c3d or .trc files; see `trials` in the pipeline",
        ));
    }
    trials.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(trials)
}

/// What `subject.yaml` or `object.yaml` beside the recordings may say; other keys are the laboratory's own business.
#[derive(Debug, Default, Deserialize)]
struct FactsFile {
    name: Option<String>,
    sex: Option<String>,
    height_m: Option<f64>,
    mass_kg: Option<f64>,
    total_mass_kg: Option<f64>,
    gravity_m_s2: Option<f64>,
    lab: Option<LabFacts>,
}

#[derive(Debug, Default, Deserialize)]
struct LabFacts {
    gravity: Option<serde_yaml::Value>,
}

fn find_facts(config: &PipelineConfig, data: &Path, file: &str, text: &str) -> Result<Facts, PipelineError> {
    let mut facts = FactsFile::default();
    let mut sources = Vec::new();
    for name in ["subject.yaml", "subject.yml", "object.yaml", "object.yml"] {
        let path = data.join(name);
        if path.is_file() {
            let text = std::fs::read_to_string(&path).map_err(PipelineError::io("read", &path))?;
            facts = parse_yaml(&path.display().to_string(), &text)?;
            sources.push(name.to_owned());
            break;
        }
    }
    if sources.is_empty()
        && let Some(row) = participants(data)?
    {
        facts = row;
        sources.push("participants.tsv".to_owned());
    }
    let s = &config.subject;
    if s != &crate::config::SubjectConfig::default() {
        sources.push("the pipeline".to_owned());
    }
    let gravity_in_lab = facts.lab.as_ref().and_then(|l| l.gravity.as_ref()).and_then(|g| match g {
        serde_yaml::Value::Sequence(v) => {
            let sum: f64 = v.iter().filter_map(serde_yaml::Value::as_f64).map(|x| x * x).sum();
            (sum > 0.0).then(|| sum.sqrt())
        }
        other => other.as_f64().map(f64::abs),
    });
    let mass_kg = s.mass_kg.or(facts.mass_kg).or(facts.total_mass_kg).ok_or_else(|| {
        error_at_key(
            file,
            text,
            "subject",
            "the body mass is not known: neither the pipeline nor a file beside the recordings states it",
            Some(
                "add `subject: {mass_kg: …}` to the pipeline, or put a subject.yaml with mass_kg beside the recordings"
                    .to_owned(),
            ),
        )
    })?;
    if !(mass_kg.is_finite() && mass_kg > 0.0) {
        return Err(error_at_key(
            file,
            text,
            "mass_kg",
            format!("mass_kg is {mass_kg}, expected a positive number of kilograms"),
            None,
        ));
    }
    let sex = match s.sex.clone().or(facts.sex).as_deref().map(str::to_ascii_lowercase).as_deref() {
        Some("f" | "female") => Some(Sex::Female),
        Some("m" | "male") => Some(Sex::Male),
        Some("" | "n/a") | None => None,
        Some(other) => {
            return Err(error_at_key(file, text, "sex", format!("sex is `{other}`, expected F or M"), None));
        }
    };
    Ok(Facts {
        person: PersonFacts {
            name: s.name.clone().or(facts.name).unwrap_or_else(|| config.name.clone()),
            sex,
            height_m: s.height_m.or(facts.height_m),
            mass_kg,
        },
        gravity_mps2: s
            .gravity_mps2
            .or(facts.gravity_m_s2)
            .or(gravity_in_lab)
            .unwrap_or(aloft_body::STANDARD_GRAVITY_MPS2),
        sources,
    })
}

/// The row of `participants.tsv` (BIDS) for this folder: the one whose `participant_id` names the folder, or the only one.
fn participants(data: &Path) -> Result<Option<FactsFile>, PipelineError> {
    let path = data.join("participants.tsv");
    if !path.is_file() {
        return Ok(None);
    }
    let text = std::fs::read_to_string(&path).map_err(PipelineError::io("read", &path))?;
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split('\t').map(str::trim).collect();
    let rows: Vec<Vec<&str>> =
        lines.filter(|l| !l.trim().is_empty()).map(|l| l.split('\t').map(str::trim).collect()).collect();
    let folder = data.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let id = header.iter().position(|h| *h == "participant_id");
    let row = rows
        .iter()
        .find(|r| id.and_then(|i| r.get(i)).is_some_and(|v| *v == folder || v.strip_prefix("sub-") == Some(&folder)))
        .or(if rows.len() == 1 { rows.first() } else { None });
    let Some(row) = row else {
        return Err(PipelineError::request_hint(
            format!("{}: {} participants and none is called `{folder}`", path.display(), rows.len()),
            "name the subject in the pipeline, or keep each participant's recordings in a folder of that name",
        ));
    };
    let get = |names: &[&str]| {
        header
            .iter()
            .position(|h| names.contains(h))
            .and_then(|i| row.get(i))
            .filter(|v| **v != "n/a" && !v.is_empty())
            .copied()
    };
    let number = |names: &[&str]| get(names).and_then(|v| v.parse::<f64>().ok());
    let height = number(&["height", "height_m"]).map(|h| if h > 3.0 { h / 100.0 } else { h });
    Ok(Some(FactsFile {
        name: get(&["participant_id"]).map(str::to_owned),
        sex: get(&["sex"]).map(str::to_owned),
        height_m: height,
        mass_kg: number(&["mass", "mass_kg", "weight"]),
        ..FactsFile::default()
    }))
}
