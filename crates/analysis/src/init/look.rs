//! Reads the recordings of a folder, and what each of them states.

use super::facts::StatedFacts;
use aloft_pipeline::recording::{abridged, read_file};
use aloft_study::facts::stated_name;
use aloft_study::quote;
use aloft_study::recordings::{bids_beside, is_bids, stem_of};
use aloft_trial::{ImportOptions, Trial};
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::input;
use aloft_workspace::qc::QcReason;
use nalgebra::Vector3;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Number of recordings to read; the others are assumed to be alike.
const LOOKED_AT: usize = 60;

/// A recording that was read.
pub(super) struct Determination {
    pub relative: String,
    /// The file's stem; once it is known which recordings are used, the trial's name in the
    /// session.
    pub stem: String,
    pub trial: Trial,
    /// Length unit that the file states.
    pub unit: String,
    /// Body facts that the file states.
    pub stated: StatedFacts,
}

/// A recording that cannot be read.
#[derive(Debug)]
pub(super) struct Unread {
    pub relative: String,
    pub failure: StageFailure,
    /// Everybody whose markers it holds, if it is of several people and none was chosen.
    pub people: Vec<String>,
}

/// Everybody whose markers a file holds, if these are several people; nobody for a file that cannot
/// be read.
fn people_in(file: &Path) -> Vec<String> {
    let (name, options) = ("", ImportOptions::default());
    // none: `init` names recordings that cannot be read
    let Ok(bytes) = input::bytes(file) else { return Vec::new() };
    let trial = match file.extension().is_some_and(|e| e.eq_ignore_ascii_case("trc")) {
        true => Trial::contents_of_trc_mot(name, &String::from_utf8_lossy(&bytes), None, &options).ok(),
        // none: as above
        false => aloft_c3d::C3dFile::from_bytes(&bytes)
            .ok()
            .and_then(|c3d| Trial::contents_of_c3d(name, &c3d, &options).ok()),
    };
    trial.map(|t| t.people).unwrap_or_default()
}

/// Names by which the person may be called.
fn names(folder: &Path, wanted: Option<&str>) -> Vec<String> {
    if let Some(wanted) = wanted {
        return vec![wanted.to_owned()];
    }
    let own = folder.canonicalize().ok().and_then(|p| p.file_name().map(|n| n.to_string_lossy().into_owned()));
    stated_name(folder).into_iter().chain(own).collect()
}

/// Refuses a folder whose recordings hold several people, none of whom is chosen.
pub(super) fn one_person(
    folder: &Path,
    unread: &[Unread],
    all: usize,
    wanted: Option<&str>,
) -> Result<(), PipelineError> {
    let several: Vec<&Unread> = unread.iter().filter(|u| !u.people.is_empty()).collect();
    let people: BTreeSet<&String> = several.iter().flat_map(|u| &u.people).collect();
    let Some(first) = people.first() else { return Ok(()) };
    let listed = abridged(&people.iter().map(|p| (*p).clone()).collect::<Vec<_>>());
    let whom = wanted.map_or_else(|| "the subject is none of them".to_owned(), |w| format!("`{w}` is none of them"));
    let one = quote::line(quote::option("subject", first));
    Err(PipelineError::request_hint(
        format!(
            "{}: {} of {all} recordings hold markers of several people ({listed}), and {whom}",
            folder.display(),
            several.len()
        ),
        format!(
            "for one of them: `aloft init {} {one}`; or give that `name` in subject.yaml beside the recordings",
            quote::path(folder)
        ),
    ))
}

/// What to say on screen about recordings that cannot be read, of `all` that were tried; none where
/// there are none.
pub(super) fn unread_words(unread: &[Unread], all: usize) -> Option<String> {
    let first = unread.first()?;
    let (of, verb) = match unread.len() {
        1 => (format!("1 of {all} recordings"), "is"),
        n => (format!("{n} of {all} recordings"), "are"),
    };
    let names: Vec<String> = unread.iter().map(|u| quote::visible(&u.relative)).collect();
    let reason = quote::visible(&first.failure.problem);
    Some(match names.as_slice() {
        [_] => format!("{of} cannot be read and {verb} not used: {reason}"),
        many => format!("{of} cannot be read and {verb} not used: {}; the first: {reason}", abridged(many)),
    })
}

/// Reads recordings of a folder: all of one subject, the first of each kind for several subjects.
/// Also returns those that cannot be read.
/// `wanted` is the person to look for where a recording holds several people; if absent, their name
/// is sought in the folder's facts and in its own name.
pub(super) fn look(
    folder: &Path,
    subjects: &[String],
    files: &[PathBuf],
    wanted: Option<&str>,
) -> (Vec<Determination>, Vec<Unread>) {
    // of many subjects, read the first recordings of each kind and subject
    let share = if subjects.is_empty() { usize::MAX } else { LOOKED_AT.div_ceil(subjects.len()).max(12) };
    let mut taken: BTreeMap<String, usize> = BTreeMap::new();
    let mut chosen: Vec<&PathBuf> = Vec::new();
    for file in files {
        let group = file.components().next().map(|c| c.as_os_str().to_string_lossy().into_owned()).unwrap_or_default();
        // two recordings are enough for names that differ only by a number
        let kind = name_pattern(&stem_of(file));
        let n = taken.entry(format!("{group}/{kind}")).or_default();
        *n += 1;
        if subjects.is_empty() || (*n <= 2 && chosen.len() < share * subjects.len()) {
            chosen.push(file);
        }
    }
    let looked: Vec<Result<Determination, Unread>> = chosen
        .par_iter()
        .map(|relative| {
            let path = folder.join(relative);
            let stem = stem_of(&path);
            let parts: Vec<_> = relative.components().map(|c| c.as_os_str().to_string_lossy()).collect();
            let relative = parts.join("/");
            let own = match subjects.iter().find(|s| parts.first().is_some_and(|first| first == *s)) {
                Some(subject) => folder.join(subject),
                None => folder.to_path_buf(),
            };
            let options = ImportOptions { people: names(&own, wanted), ..ImportOptions::default() };
            let trial = match read_file(&stem, &path, None, &options) {
                Ok(trial) => trial,
                Err(failure) => {
                    let several = failure.reason == Some(QcReason::SeveralPeople);
                    let people = if several { people_in(&path) } else { Vec::new() };
                    return Err(Unread { relative, failure, people });
                }
            };
            let unit = match stated_unit(&path) {
                Ok(unit) => unit,
                Err(failure) => return Err(Unread { relative, failure: failure.into(), people: Vec::new() }),
            };
            let mut stated = StatedFacts::of(&path);
            if stated.subject.is_none() {
                stated.subject.clone_from(&trial.person);
            }
            Ok(Determination { relative, stem, unit, stated, trial })
        })
        .collect();
    let mut seen = Vec::new();
    let mut broken = Vec::new();
    for one in looked {
        match one {
            Ok(s) => seen.push(s),
            Err(unread) => broken.push(unread),
        }
    }
    (seen, broken)
}

/// Length unit that a file states: POINT:UNITS of C3D, `Units` of TRC; empty if it states none.
fn stated_unit(path: &Path) -> Result<String, PipelineError> {
    if is_bids(path) {
        let channels = bids_beside(path).into_iter().find(|p| p.to_string_lossy().ends_with("_channels.tsv"));
        let Some(channels) = channels else { return Ok(String::new()) };
        let text = input::text(&channels)?;
        let at = text.lines().next().and_then(|h| h.split('\t').position(|c| c.trim() == "units"));
        let position = text.lines().find(|l| l.split('\t').any(|c| c.trim() == "POS"));
        let unit = position.zip(at).and_then(|(l, i)| l.split('\t').nth(i));
        return Ok(unit.map(|u| u.trim().to_owned()).unwrap_or_default());
    }
    let bytes = input::bytes(path)?;
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("c3d")) {
        // none: the reader before has said what is damaged
        let file = aloft_c3d::C3dFile::from_bytes(&bytes).ok();
        return Ok(file.map(|f| f.point_unit.trim().to_owned()).unwrap_or_default());
    }
    let text = String::from_utf8_lossy(&bytes);
    let mut lines = text.lines().skip(1);
    let (keys, values) = (lines.next().unwrap_or_default(), lines.next().unwrap_or_default());
    let place = keys.split('\t').position(|k| k.trim() == "Units");
    Ok(place.and_then(|i| values.split('\t').nth(i)).map(|u| u.trim().to_owned()).unwrap_or_default())
}

/// True for quiet standing: the median marker moves less than 2 cm about its mean.
pub(super) fn is_still(trial: &Trial) -> bool {
    let mut spreads: Vec<f64> = trial
        .markers
        .trajectories
        .iter()
        .filter_map(|t| {
            let valid: Vec<&Vector3<f64>> = t.iter().filter(|p| p.x.is_finite()).collect();
            let n = valid.len() as f64;
            (n > 10.0).then(|| {
                let mean = valid.iter().fold(Vector3::zeros(), |a, p| a + **p) / n;
                (valid.iter().map(|p| (**p - mean).norm_squared()).sum::<f64>() / n).sqrt()
            })
        })
        .collect();
    aloft_signal::upper_median(&mut spreads).is_some_and(|s| s < 0.02)
}

/// Pattern for all recordings named like this one: its BIDS task, or its name without the number at
/// the end.
pub(super) fn name_pattern(stem: &str) -> String {
    if let Some(task) = stem.split('_').find(|p| p.starts_with("task-")) {
        return format!("**/*{}*", quote::pattern(task));
    }
    let base = stem.trim_end_matches(|c: char| c.is_ascii_digit());
    format!("**/{}*", quote::pattern(if base.is_empty() { stem } else { base }))
}
