//! Recordings that software for videos writes several times: raw, filtered and augmented versions
//! of one trial, and one file for each person.

use super::look::Determination;
use aloft_study::recordings::theia_pose;
use std::collections::BTreeMap;

/// How far a file was processed; the last of a trial is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Version {
    Raw,
    Filtered,
    /// With the markers that a network derives from keypoints.
    Augmented,
}

/// What a file's name says.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Name {
    /// The trial, without version and person.
    trial: String,
    version: Version,
    person: Option<String>,
}

/// Ending of Pose2Sim's augmented files, and the mark of its filtered ones.
const AUGMENTED: &str = "_lstm";
const FILTERED: &str = "_filt";

fn name_of(relative: &str, stem: &str) -> Name {
    let folder = relative.rsplit_once('/').map_or("", |(folder, _)| folder);
    if let Some((filtered, person)) = theia_pose(stem) {
        let version = if filtered { Version::Filtered } else { Version::Raw };
        return Name { trial: folder.to_owned(), version, person: Some(person.to_owned()) };
    }
    let lower = stem.to_lowercase();
    let (rest, version) = match (lower.strip_suffix(AUGMENTED), lower.rfind(FILTERED)) {
        (Some(rest), _) => (rest.split(FILTERED).next().unwrap_or(rest), Version::Augmented),
        (None, Some(at)) => (&lower[..at], Version::Filtered),
        (None, None) => (lower.as_str(), Version::Raw),
    };
    // `_P2_` is a person, `_0-526` the frames, which differ from person to person
    let number = |w: &str| !w.is_empty() && w.chars().all(|c| c.is_ascii_digit());
    let frames = |w: &str| w.split_once('-').is_some_and(|(a, b)| number(a) && number(b));
    let mut person = None;
    let words: Vec<&str> = rest
        .split('_')
        .filter(|w| !frames(w))
        .filter(|w| match w.strip_prefix('p').filter(|n| number(n)) {
            Some(n) => person.replace(n.to_owned()).is_some(),
            None => true,
        })
        .collect();
    Name { trial: format!("{folder}/{}", words.join("_")), version, person }
}

/// The last version of each trial, and the names of the others.
pub(super) fn last(seen: Vec<Determination>) -> (Vec<Determination>, Vec<String>) {
    let names: Vec<Name> = seen.iter().map(|s| name_of(&s.relative, &s.stem)).collect();
    let mut best: BTreeMap<(&str, Option<&str>), Version> = BTreeMap::new();
    for n in &names {
        let known = best.entry((&n.trial, n.person.as_deref())).or_insert(n.version);
        *known = (*known).max(n.version);
    }
    let keep: Vec<bool> =
        names.iter().map(|n| best.get(&(n.trial.as_str(), n.person.as_deref())) == Some(&n.version)).collect();
    let (own, other): (Vec<_>, Vec<_>) = seen.into_iter().zip(keep).partition(|(_, keep)| *keep);
    (own.into_iter().map(|(s, _)| s).collect(), other.into_iter().map(|(s, _)| s.relative).collect())
}

/// Names the subjects of trials that hold several persons by their numbers, where the files do not
/// name them.
pub(super) fn name_persons(seen: &mut [Determination]) {
    let names: Vec<Name> = seen.iter().map(|s| name_of(&s.relative, &s.stem)).collect();
    let mut persons: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for n in &names {
        let Some(person) = &n.person else { continue };
        let of = persons.entry(&n.trial).or_default();
        if !of.contains(&person.as_str()) {
            of.push(person);
        }
    }
    if persons.values().all(|p| p.len() < 2) {
        return;
    }
    for (s, n) in seen.iter_mut().zip(&names) {
        if s.stated.subject.is_none() {
            s.stated.subject = n.person.as_ref().map(|p| format!("person {p}"));
            s.stated.by_number = s.stated.subject.is_some();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::init::facts::StatedFacts;

    fn of(relative: &str) -> Determination {
        let stem = std::path::Path::new(relative).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Determination {
            relative: relative.to_owned(),
            stem,
            trial: aloft_trial::Trial::default(),
            unit: String::new(),
            stated: StatedFacts::default(),
        }
    }

    fn relatives(seen: &[Determination]) -> Vec<&str> {
        seen.iter().map(|s| s.relative.as_str()).collect()
    }

    #[test]
    fn of_each_trial_the_last_version_is_used() {
        let files = [
            "T1/pose-3d/T1_0-500.trc",
            "T1/pose-3d/T1_0-500_filt_butterworth.trc",
            "T1/pose-3d/T1_0-500_filt_butterworth_LSTM.trc",
            "T2/pose-3d/T2_0-90.trc",
            "walk1/pose_0.c3d",
            "walk1/pose_filt_0.c3d",
            "walk2/pose_filt_0.c3d",
            "walk2/pose_filt_1.c3d",
            "lab/S1_P2_jump.c3d",
            "lab/S1_jump.c3d",
        ];
        let (kept, left) = last(files.iter().map(|f| of(f)).collect());
        assert_eq!(left, [files[0], files[1], files[4]]);
        assert_eq!(kept.len(), 7);
    }

    #[test]
    fn persons_of_one_trial_are_told_apart() {
        let mut seen = [of("T1/T1_P1_0-5_filt_x.trc"), of("T1/T1_P2_0-4_filt_x.trc"), of("T2/T2_P1_0-5_filt_x.trc")];
        name_persons(&mut seen);
        let named: Vec<Option<&str>> = seen.iter().map(|s| s.stated.subject.as_deref()).collect();
        assert_eq!(named, [Some("person 1"), Some("person 2"), Some("person 1")]);
        // a code of a participant in every name is no second person
        let mut seen = [of("S_P1_jump1.c3d"), of("S_P1_jump2.c3d"), of("walk1/pose_filt_0.c3d")];
        name_persons(&mut seen);
        assert!(seen.iter().all(|s| s.stated.subject.is_none()), "{:?}", relatives(&seen));
    }
}
