//! Times of a study's recordings within the session, for effects that grow over it.

use crate::subject_session::{Role, SubjectSession};
use aloft_trial::{SessionRecording, SessionSource, session_times};
use aloft_workspace::artifact::session_recording;
use aloft_workspace::disk::is_there;
use aloft_workspace::error::PipelineError;
use aloft_workspace::workspace::Workspace;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Times of a study's recordings.
#[derive(Debug, Clone)]
pub struct Calendar {
    /// Start of each recording relative to the first one of the session, s.
    start_s: BTreeMap<String, f64>,
    /// Recordings with plates: only what plates measure depends on the time.
    with_plates: BTreeSet<String>,
    /// Where the times come from.
    pub source: SessionSource,
    /// The source in words.
    pub words: String,
}

impl Calendar {
    /// Computed from the imports of all recordings of a study; see [`Calendar::from_order`].
    ///
    /// # Errors
    /// An import is there and cannot be read: the times would rest on less than what is there.
    pub fn of(session: &SubjectSession, workspace: &Workspace) -> Result<Self, PipelineError> {
        let trials: Vec<(String, Role)> = session.included().map(|t| (t.name.clone(), t.role)).collect();
        Self::from_order(&session.facts.recordings, &trials, workspace)
    }

    /// Computed from the imports of the recordings; recordings that could not be imported are left
    /// out.
    ///
    /// If no file states a time, the order is that of the laboratory's list beside the recordings.
    /// Without a list it is that of a usual session: static, calibration, then the others by name,
    /// with numbers in names compared by value.
    ///
    /// # Errors
    /// Those of [`Calendar::of`].
    pub fn from_order(
        listed: &[String],
        trials: &[(String, Role)],
        workspace: &Workspace,
    ) -> Result<Self, PipelineError> {
        let mut trials: Vec<&(String, Role)> = trials.iter().collect();
        let mut places: HashMap<&str, usize> = HashMap::new();
        for (i, name) in listed.iter().enumerate() {
            places.entry(name).or_insert(i);
        }
        trials.sort_by_cached_key(|(name, role)| {
            let place = places.get(name.as_str()).copied().unwrap_or(usize::MAX);
            let part = match role {
                Role::Static => 0,
                Role::Calibration => 1,
                _ => 2,
            };
            (place, part, natural(name))
        });
        let mut with_plates = BTreeSet::new();
        let mut recordings: Vec<SessionRecording> = Vec::new();
        for (name, role) in trials {
            let needed = matches!(role, Role::Identify | Role::Validate);
            // what could not be imported has no place in the session
            let place = workspace.place("import", name);
            if !is_there(&place.join("trial.json"))? {
                continue;
            }
            let (recording, plates) = session_recording(&place, needed)?;
            if plates > 0 {
                with_plates.insert(recording.name.clone());
            }
            recordings.push(recording);
        }
        let times = session_times(&recordings);
        let order = match times.source {
            SessionSource::OrderAndLengths if listed.is_empty() => "; the order is that of the names",
            SessionSource::OrderAndLengths => "; the order is that of the list beside the recordings",
            _ => "",
        };
        Ok(Self {
            start_s: recordings.into_iter().map(|r| r.name).zip(times.start_s).collect(),
            with_plates,
            source: times.source,
            words: times.words + order,
        })
    }

    /// The same for one recording alone; none for one without plates, where nothing depends on the
    /// time.
    pub fn only(&self, trial: &str) -> Option<Self> {
        let name = self.with_plates.get(trial)?.clone();
        let start_s = self.start_s.get(trial).map(|t| (name.clone(), *t)).into_iter().collect();
        Some(Self { start_s, with_plates: [name].into(), source: self.source, words: self.words.clone() })
    }

    /// Seconds from the start of the session to the first frame of a recording; 0 where unknown.
    pub fn start_s(&self, trial: &str) -> f64 {
        self.start_s.get(trial).copied().filter(|t| t.is_finite()).unwrap_or(0.0)
    }
}

/// Splits a name so that its numbers are compared by value: `jump2` comes before `jump10`.
fn natural(name: &str) -> Vec<(u64, String)> {
    let mut parts: Vec<(u64, String)> = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let digits = rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len());
        let (number, after) = rest.split_at(digits);
        let letters = after.find(|c: char| c.is_ascii_digit()).unwrap_or(after.len());
        let (word, remaining) = after.split_at(letters);
        parts.push((number.parse().unwrap_or(0), word.to_owned()));
        rest = remaining;
    }
    parts
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::{Calendar, natural};
    use crate::subject_session::Role;
    use aloft_workspace::workspace::Workspace;

    /// A damaged import was left out, and the session began with the next recording.
    #[test]
    fn regress_times_of_a_session_need_every_import_that_is_there() {
        let dir = tempfile::tempdir().unwrap();
        let ws = Workspace::open(dir.path());
        let trials = [("jump01".to_owned(), Role::Identify)];
        assert_eq!(Calendar::from_order(&[], &trials, &ws).unwrap().start_s("jump01"), 0.0, "nothing was imported");
        let place = ws.place("import", "jump01");
        std::fs::create_dir_all(&place).unwrap();
        std::fs::write(place.join("trial.json"), "{").unwrap();
        let error = Calendar::from_order(&[], &trials, &ws).unwrap_err().to_string();
        assert!(error.contains("trial.json"), "{error}");
    }

    #[test]
    fn numbers_sort_by_value() {
        let mut names = ["jump10", "jump2", "jump1", "exercise01", "10", "9", "a"];
        names.sort_by_key(|n| natural(n));
        assert_eq!(names, ["a", "exercise01", "jump1", "jump2", "jump10", "9", "10"]);
    }
}
