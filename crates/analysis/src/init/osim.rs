//! The OpenSim model beside the recordings that fits them best.

use super::look::Determination;
use aloft_body::PersonFacts;
use aloft_robot::PriorSpread;
use aloft_robot::osim::{OsimIk, OsimModel, RigidTree};
use aloft_trial::{MarkerDefinition, MarkerSet, Trial, apply_marker_set};
use aloft_workspace::input;
use nalgebra::Vector3;
use std::path::{Path, PathBuf};

/// Depth of folders in which models are looked for.
const DEPTH: usize = 4;
/// Most models that are tried.
const TRIED: usize = 12;
/// Frames on which models are compared.
const FRAMES: usize = 12;
/// Least share of a model's markers that the recordings have.
const LEAST_SHARE: f64 = 0.5;
/// Markers of a scaled model come nearer than this to the recorded ones (OpenSim's own guide asks
/// for 20 mm root mean square), mm; a model that does not was not scaled to this body.
const SCALED_MM: f64 = 40.0;

/// A model that fits.
pub(super) struct Proposed {
    /// Path relative to the folder.
    pub path: String,
    /// Markers in the recordings, of all of the file's.
    pub markers: (usize, usize),
    /// Root mean square distance of the markers, mm.
    pub rms_mm: f64,
    /// Mass of its bodies, kg.
    pub mass_kg: f64,
    /// Number of other models that fit less well.
    pub others: usize,
}

/// What was found: the best model, and those that cannot be used with the reason.
pub(super) struct Found {
    pub best: Option<Proposed>,
    pub refused: Vec<String>,
}

fn models_below(folder: &Path, depth: usize, out: &mut Vec<PathBuf>) {
    // none: the listing of the recordings names it
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let mut paths: Vec<PathBuf> = entries.filter_map(|e| e.ok().map(|e| e.path())).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            if depth > 0 {
                models_below(&path, depth - 1, out);
            }
        } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("osim")) && out.len() < TRIED {
            out.push(path);
        }
    }
}

/// Tries every model of the folder on some frames of its longest recording.
pub(super) fn find(folder: &Path, seen: &[Determination]) -> Found {
    let mut paths = Vec::new();
    models_below(folder, DEPTH, &mut paths);
    let mut refused = Vec::new();
    let mut fits: Vec<Proposed> = Vec::new();
    let longest = seen.iter().max_by_key(|s| s.trial.markers.n_frames);
    for path in &paths {
        let shown = path.strip_prefix(folder).unwrap_or(path).display().to_string().replace('\\', "/");
        let text = match input::lossy(path) {
            Ok(text) => text,
            Err(e) => {
                refused.push(e.to_string());
                continue;
            }
        };
        let made = OsimModel::parse(&shown, &text).and_then(|m| RigidTree::of(&m, None).map(|_| m));
        let model = match made {
            Ok(model) => model,
            Err(e) => {
                refused.push(e.to_string());
                continue;
            }
        };
        if let Some(fit) = longest.and_then(|l| fit(&shown, &model, &l.trial)) {
            fits.push(fit);
        }
    }
    fits.retain(|f| {
        let fits = f.rms_mm <= SCALED_MM;
        if !fits {
            refused.push(format!(
                "{}: its markers fit the recordings to {:.0} mm (RMS): scale it to this body first",
                f.path, f.rms_mm
            ));
        }
        fits
    });
    fits.sort_by(|a, b| a.rms_mm.total_cmp(&b.rms_mm).then_with(|| a.path.cmp(&b.path)));
    let others = fits.len().saturating_sub(1);
    let best = fits.into_iter().next().map(|p| Proposed { others, ..p });
    Found { best, refused }
}

fn fit(shown: &str, model: &OsimModel, trial: &Trial) -> Option<Proposed> {
    let mut trial = trial.clone();
    let definition = |label: &str| MarkerDefinition::new(label, "");
    let set = MarkerSet {
        name: shown.to_owned(),
        title: String::new(),
        model: model.name.clone(),
        marker_radius_m: 0.0,
        markerless: None,
        markers: model.markers.iter().map(|m| definition(&m.name)).collect(),
    };
    let present = apply_marker_set(&mut trial, &set, &Default::default()).present;
    let share = present.len() as f64 / model.markers.len().max(1) as f64;
    if present.len() < 4 || share < LEAST_SHARE {
        return None;
    }
    // none: a model that these markers do not fit is not proposed
    let tree = RigidTree::of(model, Some(&present)).ok()?;
    let facts = PersonFacts { name: String::new(), sex: None, height_m: None, mass_kg: tree.mass_kg() };
    let spread = PriorSpread { mass_rel: 0.1, com_m: 0.01, radius_rel: 0.1 };
    let mut subject = tree.subject(model, facts, Vector3::zeros(), spread);
    subject.markers.retain(|m| present.contains(&m.label));
    let solver = OsimIk::new(model, &tree, &subject.markers, 0.002);
    let places: Vec<Option<usize>> = solver.labels().iter().map(|l| trial.markers.index(l)).collect();
    let n = trial.markers.n_frames;
    let tried = FRAMES.min(n);
    let frame = |k: usize| k * n.saturating_sub(1) / tried.saturating_sub(1).max(1);
    let found = solver
        .track("", trial.markers.rate_hz, tried, &|m, k| places[m].and_then(|i| trial.markers.position(i, frame(k))));
    (found.unsolved < tried).then(|| Proposed {
        path: shown.to_owned(),
        markers: (present.len(), model.markers.len()),
        rms_mm: 1e3 * found.rms_m,
        mass_kg: tree.mass_kg(),
        others: 0,
    })
}
