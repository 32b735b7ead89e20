//! What files state about their subject, and where their force files are.

use super::look::Determination;
use aloft_study::recordings::stem_of;
use aloft_trial::person_of;
use aloft_workspace::input;
use std::path::{Path, PathBuf};

/// Body facts that a file states.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct StatedFacts {
    /// Body mass, kg.
    pub mass_kg: Option<f64>,
    /// Stature, m.
    pub height_m: Option<f64>,
    /// Name of the subject.
    pub subject: Option<String>,
    /// True where the name is a number in the file's name instead.
    pub by_number: bool,
}

const GROUPS: [&str; 6] = ["PROCESSING", "SUBJECTS", "SUBJECT", "PATIENT", "ANTHROPOMETRY", "INFO"];
const MASSES: [&str; 6] = ["Bodymass", "BODY_MASS", "MASS", "WEIGHT", "BODYWEIGHT", "BODY_WEIGHT"];
const HEIGHTS: [&str; 3] = ["Height", "STATURE", "BODY_HEIGHT"];

impl StatedFacts {
    /// From the parameters of a C3D file; nothing for other formats.
    pub fn of(path: &Path) -> Self {
        if !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("c3d")) {
            return Self::default();
        }
        // none: `init` names recordings that cannot be read
        let Some(file) = input::bytes(path).ok().and_then(|b| aloft_c3d::C3dFile::from_bytes(&b).ok()) else {
            return Self::default();
        };
        let number = |names: &[&str], read: fn(f64) -> Option<f64>| {
            let all = GROUPS.iter().flat_map(|g| names.iter().map(move |n| (*g, *n)));
            all.filter_map(|(g, n)| file.groups.get(g, n).and_then(|p| p.number())).find_map(read)
        };
        Self {
            mass_kg: number(&MASSES, kilograms),
            height_m: number(&HEIGHTS, metres),
            subject: person_of(&file),
            by_number: false,
        }
    }
}

/// A mass that a person can have; no file states newtons.
fn kilograms(value: f64) -> Option<f64> {
    (5.0..300.0).contains(&value).then_some(value)
}

/// A stature in metres, centimetres or millimetres.
fn metres(value: f64) -> Option<f64> {
    [1.0, 0.01, 0.001].into_iter().map(|unit| value * unit).find(|m| (0.5..2.5).contains(m))
}

/// The value that the files agree on within 2 %, the first one; none where they differ.
pub(super) fn agreed(values: impl Iterator<Item = f64>) -> Option<f64> {
    let values: Vec<f64> = values.collect();
    let first = *values.first()?;
    values.iter().all(|v| (v / first - 1.0).abs() < 0.02).then_some(first)
}

/// Patterns of force files that the default ones do not find: `{trial}_grf.mot` and the like in a
/// sister folder of the marker files, or `grf.mot` where each trial has a folder of its own.
pub(super) fn force_patterns(folder: &Path, seen: &[Determination]) -> Option<Vec<String>> {
    let texts: Vec<&Determination> = seen.iter().filter(|s| s.relative.to_lowercase().ends_with(".trc")).collect();
    if texts.is_empty() || texts.iter().any(|s| !s.trial.plates.is_empty()) {
        return None;
    }
    let mut files: Vec<PathBuf> = Vec::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(at) = open.pop() {
        // none: the listing of the recordings names it
        let Ok(entries) = std::fs::read_dir(&at) else { continue };
        let mut inside: Vec<PathBuf> = entries.filter_map(|e| e.ok().map(|e| e.path())).collect();
        inside.sort();
        for path in inside {
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mot") || e.eq_ignore_ascii_case("sto")) {
                files.push(path);
            }
        }
    }
    let mut patterns: Vec<(String, usize)> = Vec::new();
    for file in files.iter().filter(|f| holds_forces(f)) {
        let Some(name) = file.file_name().map(|n| n.to_string_lossy().into_owned()) else { continue };
        // the longest stem that the name begins with
        let stem = |s: &Determination| stem_of(Path::new(&s.relative));
        let here = |s: &&&Determination| folder.join(&s.relative).parent() == file.parent();
        // the longest stem that the name begins with, that of a neighbour first
        let begins = texts.iter().filter(|s| name.starts_with(&stem(s)));
        let pattern = if let Some(own) = begins.max_by_key(|s| (here(s), stem(s).len())) {
            let markers = folder.join(&own.relative);
            let (Some(from), Some(to)) = (markers.parent(), file.parent()) else { continue };
            format!("{}{{trial}}{}", between(from, to), &name[stem(own).len()..])
        } else if texts.len() > 1 && texts.iter().filter(here).count() == 1 {
            name
        } else {
            continue;
        };
        match patterns.iter_mut().find(|p| p.0 == pattern) {
            Some(known) => known.1 += 1,
            None => patterns.push((pattern, 1)),
        }
    }
    patterns.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
    (!patterns.is_empty()).then(|| patterns.into_iter().map(|p| p.0).collect())
}

/// True if the columns of a MOT or STO file are ground reactions.
fn holds_forces(file: &Path) -> bool {
    // none: `check` names a force file that cannot be read
    let Ok(bytes) = input::bytes(file) else { return false };
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(20_000)]).to_lowercase();
    let columns = text.lines().find(|l| l.trim_start().starts_with("time")).unwrap_or_default();
    columns.contains("ground_force") || (columns.contains("force") && columns.contains("_vy"))
}

/// The way from one folder to another, with a slash at its end; empty for the same folder.
fn between(from: &Path, to: &Path) -> String {
    let (a, b): (Vec<_>, Vec<_>) = (from.components().collect(), to.components().collect());
    let same = a.iter().zip(&b).take_while(|(x, y)| x == y).count();
    let mut out = "../".repeat(a.len() - same);
    for part in &b[same..] {
        out.push_str(&part.as_os_str().to_string_lossy());
        out.push('/');
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_of_statures_are_told_apart_and_impossible_values_left_out() {
        assert_eq!(metres(1.68), Some(1.68));
        assert!(metres(168.0).is_some_and(|m| (m - 1.68).abs() < 1e-12));
        assert!(metres(1680.0).is_some_and(|m| (m - 1.68).abs() < 1e-12));
        assert_eq!((metres(0.0), kilograms(0.0), kilograms(785.0)), (None, None, None));
        assert_eq!(agreed([60.0, 60.5].into_iter()), Some(60.0));
        assert_eq!(agreed([60.0, 75.0].into_iter()), None);
    }

    #[test]
    fn the_way_to_a_sister_folder() {
        assert_eq!(between(Path::new("/s/MarkerData"), Path::new("/s/ID")), "../ID/");
        assert_eq!(between(Path::new("/s"), Path::new("/s")), "");
    }
}
