//! Whether the recordings of a session name one person.

use aloft_pipeline::recording::abridged;
use aloft_study::subject_session::SubjectSession;
use aloft_trial::person_key;
use aloft_workspace::error::PipelineError;
use aloft_workspace::workspace::Workspace;
use std::collections::BTreeMap;

/// A person, and the recordings that name them.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedPerson {
    /// The name as the first of these recordings states it.
    pub name: String,
    /// The recordings.
    pub trials: Vec<String>,
}

/// The persons named in the imported recordings of a session (SUBJECTS:NAMES of C3D files).
///
/// # Errors
/// A manifest is there and cannot be read.
pub fn persons(session: &SubjectSession) -> Result<Vec<NamedPerson>, PipelineError> {
    let ws = Workspace::open(&session.workspace);
    let mut named: BTreeMap<String, NamedPerson> = BTreeMap::new();
    for trial in session.included() {
        let manifest = ws.usable("import", &trial.name)?;
        let Some(name) = manifest.as_ref().and_then(|m| m.summary.get("person")?.as_str()) else { continue };
        let of = || NamedPerson { name: name.to_owned(), trials: Vec::new() };
        named.entry(person_key(name)).or_insert_with(of).trials.push(trial.name.clone());
    }
    Ok(named.into_values().collect())
}

/// Whose markers were used in recordings that hold several people, in words; none without such
/// recordings.
///
/// # Errors
/// A manifest is there and cannot be read.
pub fn chosen_person(session: &SubjectSession) -> Result<Option<String>, PipelineError> {
    let ws = Workspace::open(&session.workspace);
    let mut chosen: BTreeMap<(String, Vec<String>), usize> = BTreeMap::new();
    for trial in session.included() {
        let Some(manifest) = ws.usable("import", &trial.name)? else { continue };
        let word = |v: &serde_json::Value| v.as_str().map(str::to_owned);
        let Some(person) = manifest.summary.get("person").and_then(word) else { continue };
        let Some(people) = manifest.summary.get("people").and_then(|p| p.as_array()) else { continue };
        let others = people.iter().filter_map(word).filter(|p| *p != person).collect();
        *chosen.entry((person, others)).or_default() += 1;
    }
    let each: Vec<String> = chosen
        .iter()
        .map(|((person, others), n)| {
            let of = if *n == 1 { "1 recording that also holds" } else { "recordings that also hold" };
            let count = if *n == 1 { String::new() } else { format!("{n} ") };
            format!("the markers of `{person}` were used, in {count}{of} {}", abridged(others))
        })
        .collect();
    Ok((!each.is_empty()).then(|| each.join("; ")))
}

/// What to say where the recordings name several persons; none for one or none.
pub fn several_persons(persons: &[NamedPerson]) -> Option<String> {
    let each: Vec<String> = persons.iter().map(|p| format!("`{}` in {}", p.name, abridged(&p.trials))).collect();
    (persons.len() > 1).then(|| {
        format!(
            "the recordings name {} persons: {}; all of them were used for one body. Unless these are names of one person, exclude the others \
             (`trials: {{exclude: …}}`)",
            persons.len(),
            each.join(", ")
        )
    })
}
