//! Configuration inherited from the study by the subject, the session and the trial.
//!
//! For each key, the setting nearest to the trial applies. The layers are, from the most general:
//! the pipeline's sections; its `overrides` for the subject; `overrides.yaml` in the subject's
//! folder; its `overrides` for the session; `overrides.yaml` in the session's folder; its
//! `overrides` for the trial. Every layer is checked separately where it is written, so that an
//! error points at its own line.

use crate::config::{FlightConfig, IkConfig, ImportConfig, Override, PipelineConfig, Sections, TrialsConfig};
use crate::old_names;
use crate::place::error_at_item;
use crate::place::{error_at, find};
use crate::ranges;
use crate::ranges::parse_yaml;
use crate::recordings::pattern;
use aloft_workspace::error::PipelineError;
use aloft_workspace::input;
use serde_yaml::Value;
use std::path::{Path, PathBuf};

/// Name of the file that holds a subject's or session's own settings beside the recordings.
pub const OVERRIDES_FILE: &str = "overrides.yaml";

/// Settings that can differ between trials.
#[derive(Debug, Clone, PartialEq)]
pub struct TrialSettings {
    /// Settings for reading recordings.
    pub import: ImportConfig,
    /// Settings of inverse kinematics.
    pub ik: IkConfig,
    /// Settings for the detection of flights.
    pub flight: FlightConfig,
}

/// A parsed and checked pipeline file, with its text for messages.
#[derive(Debug, Clone)]
pub struct PipelineFile {
    /// Path it was read from.
    pub path: PathBuf,
    /// Its text.
    pub text: String,
    /// The configuration as written, before any override.
    pub config: PipelineConfig,
    /// Former names of settings that it contains, one sentence each.
    pub old_names: Vec<String>,
    base: Value,
    sets: Vec<Value>,
}

/// Subject, session and folders for which settings are wanted.
#[derive(Debug, Clone, Copy, Default)]
pub struct Whose<'a> {
    /// Subject; none in a study of one subject.
    pub subject: Option<&'a str>,
    /// Session, if there are any.
    pub session: Option<&'a str>,
    /// The subject's folder.
    pub subject_folder: Option<&'a Path>,
    /// The session's folder.
    pub session_folder: Option<&'a Path>,
}

impl PipelineFile {
    /// Reads and checks a pipeline file.
    pub fn read(path: &Path) -> Result<Self, PipelineError> {
        if path.is_dir() {
            let folder = crate::quote::path(path);
            return Err(PipelineError::request_hint(
                format!("{} is a folder, expected a pipeline file", path.display()),
                format!("for a folder of recordings write one with `aloft init {folder}`"),
            ));
        }
        let text = input::text(path)?;
        let name = path.display().to_string();
        let config: PipelineConfig = ranges::parse(&name, &text)?;
        let mut base: Value = parse_yaml(&name, &text)?;
        let old_names = old_names::replace(&mut base);
        let overrides = base.as_mapping_mut().and_then(|m| m.remove("overrides"));
        let sets = match overrides {
            Some(Value::Sequence(list)) => {
                list.into_iter().map(|o| o.get("set").cloned().unwrap_or(Value::Null)).collect()
            }
            _ => Vec::new(),
        };
        for (i, over) in config.overrides.iter().enumerate() {
            over.check().map_err(|problem| error_at_item(&name, &text, "overrides", i, problem, None))?;
            for p in [&over.subject, &over.session, &over.trial].into_iter().flatten() {
                pattern(p, "overrides", &name, &text)?;
            }
        }
        in_order(Some(&config.trials), &name, &text, "")?;
        for (i, over) in config.overrides.iter().enumerate() {
            in_order(over.set.trials.as_ref(), &name, &text, &format!("overrides[{i}].set."))?;
        }
        Ok(Self { path: path.to_path_buf(), text, config, old_names, base, sets })
    }

    /// Name of the file for messages.
    pub fn name(&self) -> String {
        self.path.display().to_string()
    }

    /// The folder that relative paths in the file refer to.
    pub fn folder(&self) -> PathBuf {
        self.path.parent().map(Path::to_path_buf).unwrap_or_default()
    }

    /// The settings of a subject's session.
    pub fn session_config(&self, whose: Whose<'_>) -> Result<PipelineConfig, PipelineError> {
        let mut value = self.base.clone();
        self.apply(&mut value, whose, |o| o.trial.is_none() && o.session.is_none());
        layer_from(whose.subject_folder, &mut value)?;
        self.apply(&mut value, whose, |o| o.trial.is_none() && o.session.is_some());
        if whose.session_folder != whose.subject_folder {
            layer_from(whose.session_folder, &mut value)?;
        }
        let mut config = self.typed(value)?;
        config.overrides = self.config.overrides.clone();
        Ok(config)
    }

    /// The settings of one trial of that session; none if they do not differ.
    pub fn trial_settings(
        &self,
        session: &PipelineConfig,
        whose: Whose<'_>,
        trial: &str,
    ) -> Result<Option<TrialSettings>, PipelineError> {
        let matching = |o: &Override| o.trial.as_deref().is_some_and(|t| fits(Some(t), Some(trial)));
        if !self.config.overrides.iter().any(|o| matching(o) && applies(o, whose)) {
            return Ok(None);
        }
        let mut plain = session.clone();
        plain.overrides.clear();
        let mut value = serde_yaml::to_value(&plain).map_err(|e| PipelineError::request(e.to_string()))?;
        self.apply(&mut value, whose, matching);
        let config = self.typed(value)?;
        Ok(Some(TrialSettings { import: config.import, ik: config.ik, flight: config.flight }))
    }

    fn typed(&self, value: Value) -> Result<PipelineConfig, PipelineError> {
        serde_yaml::from_value(value)
            .map_err(|e| PipelineError::request(format!("{}: with its overrides: {e}", self.name())))
    }

    fn apply(&self, value: &mut Value, whose: Whose<'_>, which: impl Fn(&Override) -> bool) {
        for (over, set) in self.config.overrides.iter().zip(&self.sets) {
            if which(over) && applies(over, whose) {
                merge(value, set);
            }
        }
    }
}

/// Checks that the last frame of a range does not precede its first.
fn in_order(trials: Option<&TrialsConfig>, file: &str, text: &str, before: &str) -> Result<(), PipelineError> {
    let Some(frames) = trials.and_then(|t| t.static_frames.as_ref()).filter(|f| f.last < f.first) else {
        return Ok(());
    };
    let path = format!("{before}trials.static_frames.last");
    let problem = format!("`{path}` is {}, expected {} (its `first`) or more", frames.last, frames.first);
    Err(error_at(file, text, find(text, &path).map(|at| (at, 1)), &problem, None))
}

fn applies(over: &Override, whose: Whose<'_>) -> bool {
    fits(over.subject.as_deref(), whose.subject) && fits(over.session.as_deref(), whose.session)
}

/// True if there is no pattern, or if it matches the name.
pub fn fits(wanted: Option<&str>, name: Option<&str>) -> bool {
    match (wanted, name) {
        (None, _) => true,
        (Some(_), None) => false,
        // none: opening the pipeline refuses a pattern that cannot be read
        (Some(p), Some(n)) => globset::Glob::new(p).is_ok_and(|g| g.compile_matcher().is_match(n)),
    }
}

fn layer_from(folder: Option<&Path>, value: &mut Value) -> Result<(), PipelineError> {
    let Some(path) = folder.map(|f| f.join(OVERRIDES_FILE)).filter(|p| input::is_there(p)) else { return Ok(()) };
    let text = input::text(&path)?;
    let name = path.display().to_string();
    if text.lines().all(|l| l.trim().is_empty() || l.trim_start().starts_with('#')) {
        return Ok(());
    }
    let sections: Sections = ranges::parse(&name, &text)?;
    in_order(sections.trials.as_ref(), &name, &text, "")?;
    let mut layer: Value = parse_yaml(&name, &text)?;
    old_names::replace(&mut layer);
    merge(value, &layer);
    Ok(())
}

/// Merges mappings key by key; replaces all other values.
fn merge(into: &mut Value, from: &Value) {
    match (into, from) {
        (Value::Mapping(a), Value::Mapping(b)) => {
            for (key, value) in b {
                match a.get_mut(key) {
                    Some(old) => merge(old, value),
                    None => {
                        a.insert(key.clone(), value.clone());
                    }
                }
            }
        }
        (a, b) => *a = b.clone(),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    #[test]
    fn unit_the_nearer_layer_wins_key_by_key() {
        let dir = tempfile::tempdir().unwrap();
        let (subject, session) = (dir.path().join("sub-01"), dir.path().join("sub-01/ses-02"));
        std::fs::create_dir_all(&session).unwrap();
        let file = dir.path().join("p.yaml");
        std::fs::write(
            &file,
            "name: x\nmodel: human34\nmarker_set: plug-in-gait-35\nfilter: {order: 2, cutoff_hz: 12.0}\noverrides:\n\
             - {subject: sub-01, set: {filter: {cutoff_hz: 11.0}, flight: {threshold_n: 30.0}}}\n\
             - {subject: sub-01, session: ses-02, set: {flight: {threshold_n: 50.0}}}\n\
             - {subject: sub-01, trial: 'jump*', set: {flight: {threshold_n: 70.0}}}\n\
             - {subject: sub-09, set: {filter: {cutoff_hz: 1.0}}}\n",
        )
        .unwrap();
        std::fs::write(subject.join(OVERRIDES_FILE), "filter: {cutoff_hz: 10.0}\nflight: {threshold_n: 40.0}\n")
            .unwrap();
        std::fs::write(session.join(OVERRIDES_FILE), "# nothing yet\n").unwrap();
        let pipeline = PipelineFile::read(&file).unwrap();
        let whose = Whose {
            subject: Some("sub-01"),
            session: Some("ses-02"),
            subject_folder: Some(&subject),
            session_folder: Some(&session),
        };
        let config = pipeline.session_config(whose).unwrap();
        assert_eq!((config.filter.order, config.filter.cutoff_hz, config.flight.threshold_n), (2, 10.0, 50.0));
        let trial = pipeline.trial_settings(&config, whose, "jump03").unwrap().unwrap();
        assert_eq!(trial.flight.threshold_n, 70.0);
        assert!(pipeline.trial_settings(&config, whose, "static").unwrap().is_none());
        let other = pipeline.session_config(Whose { subject: Some("sub-02"), ..Whose::default() }).unwrap();
        assert_eq!((other.filter.cutoff_hz, other.flight.threshold_n), (12.0, 20.0));
    }
}
