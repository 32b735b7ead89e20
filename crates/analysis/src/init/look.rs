//! Reads the recordings of a folder, and what each of them states.

use super::facts::StatedFacts;
use aloft_pipeline::recording::read_file;
use aloft_study::quote;
use aloft_study::recordings::{bids_beside, is_bids, stem_of};
use aloft_trial::{ImportOptions, Trial};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::collections::BTreeMap;
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

/// Reads recordings of a folder: all of one subject, the first of each kind for several subjects.
/// Also returns what is wrong with those that cannot be read.
pub(super) fn look(folder: &Path, subjects: &[String], files: &[PathBuf]) -> (Vec<Determination>, Vec<String>) {
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
    let looked: Vec<Result<Determination, String>> = chosen
        .par_iter()
        .map(|relative| {
            let path = folder.join(relative);
            let stem = stem_of(&path);
            let trial = read_file(&stem, &path, None, &ImportOptions::default()).map_err(|f| f.problem)?;
            let parts: Vec<_> = relative.components().map(|c| c.as_os_str().to_string_lossy()).collect();
            let stated = StatedFacts::of(&path);
            Ok(Determination { relative: parts.join("/"), stem, unit: stated_unit(&path), stated, trial })
        })
        .collect();
    let mut seen = Vec::new();
    let mut broken = Vec::new();
    for one in looked {
        match one {
            Ok(s) => seen.push(s),
            Err(problem) => broken.push(problem),
        }
    }
    (seen, broken)
}

/// Length unit that a file states: POINT:UNITS of C3D, `Units` of TRC.
fn stated_unit(path: &Path) -> String {
    if is_bids(path) {
        let channels = bids_beside(path).into_iter().find(|p| p.to_string_lossy().ends_with("_channels.tsv"));
        let text = channels.and_then(|p| std::fs::read_to_string(p).ok()).unwrap_or_default();
        let at = text.lines().next().and_then(|h| h.split('\t').position(|c| c.trim() == "units"));
        let position = text.lines().find(|l| l.split('\t').any(|c| c.trim() == "POS"));
        return position
            .zip(at)
            .and_then(|(l, i)| l.split('\t').nth(i))
            .map(|u| u.trim().to_owned())
            .unwrap_or_default();
    }
    let Ok(bytes) = std::fs::read(path) else { return String::new() };
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("c3d")) {
        return aloft_c3d::C3dFile::from_bytes(&bytes).map(|f| f.point_unit.trim().to_owned()).unwrap_or_default();
    }
    let text = String::from_utf8_lossy(&bytes);
    let mut lines = text.lines().skip(1);
    let (keys, values) = (lines.next().unwrap_or_default(), lines.next().unwrap_or_default());
    let place = keys.split('\t').position(|k| k.trim() == "Units");
    place.and_then(|i| values.split('\t').nth(i)).map(|u| u.trim().to_owned()).unwrap_or_default()
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
