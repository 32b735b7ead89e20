//! `markerset check`: what in a marker-set file cannot be used, and what it leaves open.

use aloft_body::ModelSpec;
use aloft_scale::landmarks::{Side, is_landmark, landmark_names};
use aloft_study::nearest::nearest;
use aloft_study::possible::{MARKER_RADIUS_M, MARKER_WEIGHT};
use aloft_study::{catalog, place, ranges};
use aloft_trial::{MarkerDefinition, MarkerSet};
use aloft_workspace::error::PipelineError;
use aloft_workspace::input;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Something to correct or to know about.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SetFinding {
    /// Line of the file, from 1; none where it concerns the whole set.
    pub line: Option<usize>,
    /// What was found.
    pub problem: String,
    /// What to do about it.
    pub hint: Option<String>,
}

/// Result of the check.
#[derive(Debug, Clone, Serialize)]
pub struct MarkerSetCheck {
    /// Version of this structure.
    pub version: u32,
    /// The file.
    pub file: String,
    /// Name of the set.
    pub name: String,
    /// Its model.
    pub model: String,
    /// Number of markers.
    pub markers: usize,
    /// What makes the set unusable; empty if it can be used.
    pub errors: Vec<SetFinding>,
    /// What it leaves open: joints from body proportions, links with too few markers.
    pub remarks: Vec<SetFinding>,
}

/// Reads and checks a marker-set file.
///
/// # Errors
/// The file cannot be read, is not YAML, has keys that do not exist, or names a model that is not
/// there.
pub fn check(file: &Path) -> Result<MarkerSetCheck, PipelineError> {
    let text = input::text(file)?;
    let shown = file.display().to_string();
    let set: MarkerSet = ranges::parse_yaml(&shown, &text)?;
    let folder = file.parent().unwrap_or_else(|| Path::new(""));
    let model: ModelSpec = catalog::load("models", &set.model, folder).map_err(|e| match e {
        PipelineError::Request { problem, hint } => place::error_at_key(&shown, &text, "model", problem, hint),
        other => other,
    })?;
    let (errors, mut remarks) = findings(&set, &model, &|path| line_of(&text, path));
    if file.file_stem().is_some_and(|s| s.to_string_lossy() != set.name.as_str()) {
        remarks.push(SetFinding {
            line: line_of(&text, "name"),
            problem: format!("`name: {}` differs from the file's name", set.name),
            hint: Some("pipelines name a set by its file".to_owned()),
        });
    }
    Ok(MarkerSetCheck {
        version: 1,
        file: shown,
        name: set.name.clone(),
        model: set.model.clone(),
        markers: set.markers.len(),
        errors,
        remarks,
    })
}

fn line_of(text: &str, path: &str) -> Option<usize> {
    place::find(text, path).map(|at| 1 + text[..at.min(text.len())].matches('\n').count())
}

/// Errors and remarks of a set; `line` gives the line of a key such as `markers[3].link`.
fn findings(
    set: &MarkerSet,
    model: &ModelSpec,
    line: &dyn Fn(&str) -> Option<usize>,
) -> (Vec<SetFinding>, Vec<SetFinding>) {
    let (mut errors, mut remarks) = (Vec::new(), Vec::new());
    let whole = |problem: String, hint: Option<String>| SetFinding { line: None, problem, hint };
    if !(0.0..=MARKER_RADIUS_M).contains(&set.marker_radius_m) {
        errors.push(SetFinding {
            line: line("marker_radius_m"),
            problem: format!("`marker_radius_m: {}` (0 to {MARKER_RADIUS_M} are possible)", set.marker_radius_m),
            hint: Some("it is in metres: 14 mm markers have 0.007".to_owned()),
        });
    }
    if set.markers.is_empty() {
        errors.push(whole("the set has no markers".to_owned(), None));
    }
    let mut claimed: BTreeMap<&str, usize> = BTreeMap::new();
    for (i, marker) in set.markers.iter().enumerate() {
        for (k, label) in std::iter::once(&marker.label).chain(&marker.aliases).enumerate() {
            let key = if k == 0 { format!("markers[{i}].label") } else { format!("markers[{i}].aliases[{}]", k - 1) };
            match claimed.insert(label, i) {
                Some(other) if other != i => errors.push(SetFinding {
                    line: line(&key),
                    problem: format!(
                        "`{label}` names two markers: `{}` and `{}`",
                        set.markers[other].label, marker.label
                    ),
                    hint: Some("a label or alias belongs to one marker".to_owned()),
                }),
                _ => {}
            }
        }
        of_marker(marker, &format!("markers[{i}]"), model, line, &mut errors);
    }
    let person = model.links.iter().any(|l| l.name == "pelvis");
    if person {
        landmarks_missing(set, model, &mut errors, &mut remarks);
    }
    for link in &model.links {
        let tracked = set.markers.iter().filter(|m| m.link == link.name && m.tracking && !m.static_only).count();
        if tracked < 3 {
            let what = match tracked {
                0 if person => "no tracked marker: its joint is held as in the static posture".to_owned(),
                0 => "no tracked marker".to_owned(),
                n => format!(
                    "{n} tracked marker{}: its pose rests on the neighbouring links",
                    if n == 1 { "" } else { "s" }
                ),
            };
            remarks.push(whole(format!("link `{}` has {what}", link.name), None));
        }
    }
    (errors, remarks)
}

/// What is wrong with one marker by itself.
fn of_marker(
    marker: &MarkerDefinition,
    at: &str,
    model: &ModelSpec,
    line: &dyn Fn(&str) -> Option<usize>,
    errors: &mut Vec<SetFinding>,
) {
    let label = &marker.label;
    let mut error = |key: &str, problem: String, hint: Option<String>| {
        errors.push(SetFinding { line: line(&format!("{at}.{key}")), problem, hint });
    };
    let links: Vec<&str> = model.links.iter().map(|l| l.name.as_str()).collect();
    if !links.contains(&marker.link.as_str()) {
        // none: only a hint
        let of_whole = catalog::load::<ModelSpec>("models", "human34", Path::new("")).ok();
        let hint = if of_whole.is_some_and(|m| m.links.iter().any(|l| l.name == marker.link)) {
            format!("`model: human34` has it; `{}` has {}", model.name, links.join(", "))
        } else {
            suggestion(&marker.link, &links)
        };
        error("link", format!("`{label}`: model `{}` has no link `{}`", model.name, marker.link), Some(hint));
    }
    if !(0.0..=MARKER_WEIGHT).contains(&marker.weight) {
        let hint = Some("1 is usual; 0 leaves the marker out".to_owned());
        error("weight", format!("`{label}`: weight {} (0 to {MARKER_WEIGHT} are possible)", marker.weight), hint);
    }
    if let Some(landmark) = &marker.landmark {
        let names = landmark_names();
        let known: Vec<&str> = names.iter().map(String::as_str).collect();
        if !is_landmark(landmark) {
            error("landmark", format!("`{label}`: unknown landmark `{landmark}`"), Some(suggestion(landmark, &known)));
        } else if let (Some(a), Some(b)) = (Side::of(landmark), Side::of(&marker.link))
            && a != b
        {
            let hint = "landmark and link of a marker are on the same side".to_owned();
            error("landmark", format!("`{label}`: landmark `{landmark}` on link `{}`", marker.link), Some(hint));
        }
    }
    if !(marker.weight.is_finite() && marker.weight >= 0.0) {
        error("weight", format!("`{label}`: weight {}", marker.weight), Some("0 or more; 1 is usual".to_owned()));
    }
}

/// `did you mean `knee_lateral_r`?`, or the list of all names.
fn suggestion(word: &str, known: &[&str]) -> String {
    let near: Vec<String> = nearest(word, known).iter().map(|n| format!("`{n}`")).collect();
    if near.is_empty() {
        format!("known are {}", known.join(", "))
    } else {
        format!("did you mean {}?", near.join(" or "))
    }
}

/// Landmarks without which scaling stops, and those whose joint then comes from body proportions.
fn landmarks_missing(set: &MarkerSet, model: &ModelSpec, errors: &mut Vec<SetFinding>, remarks: &mut Vec<SetFinding>) {
    let has = |name: &str| set.markers.iter().any(|m| m.landmark.as_deref() == Some(name));
    let both = |stem: &str| has(&format!("{stem}_r")) && has(&format!("{stem}_l"));
    let any = |stem: &str| has(&format!("{stem}_r")) || has(&format!("{stem}_l"));
    let finding = |problem: String, hint: &str| SetFinding { line: None, problem, hint: Some(hint.to_owned()) };
    let marked = any("asis");
    if !(both("asis") && (any("psis") || has("sacrum"))) && (marked || !both("hip_centre")) {
        errors.push(finding(
            "the pelvis needs the landmarks asis_l, asis_r and one of psis_l, psis_r, sacrum, or hip_centre_l and hip_centre_r alone"
                .to_owned(),
            "name them at the markers that sit there; hip joints are found from them",
        ));
    }
    let links = |stem: &str| model.links.iter().any(|l| l.name == format!("{stem}_r"));
    for (link, joint, stems) in [
        ("shank", "knee", &["knee_lateral", "knee_medial", "knee_centre"][..]),
        ("foot", "ankle", &["ankle_lateral", "ankle_medial", "ankle_centre"]),
        ("upper_arm", "shoulder", &["acromion", "shoulder_centre"]),
        ("forearm", "elbow", &["elbow_lateral", "elbow_medial", "elbow_centre"]),
        ("hand", "wrist", &["wrist", "wrist_radial", "wrist_ulnar", "wrist_centre"]),
    ] {
        if !links(link) {
            continue;
        }
        for side in Side::BOTH {
            if !stems.iter().any(|s| has(&format!("{s}_{}", side.suffix()))) {
                let names: Vec<String> = stems.iter().map(|s| format!("{s}_{}", side.suffix())).collect();
                remarks.push(finding(
                    format!("no landmark at the {joint}: its centre comes from body proportions (± 50 mm)"),
                    &format!("one of {}", names.join(", ")),
                ));
            }
        }
    }
    remarks.dedup();
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    fn checked(text: &str) -> MarkerSetCheck {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("lab.yaml");
        std::fs::write(&file, text).unwrap();
        check(&file).unwrap()
    }

    #[test]
    fn every_built_in_set_is_sound() {
        for name in catalog::names("markersets") {
            let source = catalog::find("markersets", &name, Path::new("")).unwrap();
            let dir = tempfile::tempdir().unwrap();
            let file = dir.path().join(format!("{name}.yaml"));
            std::fs::write(&file, source.text).unwrap();
            let found = check(&file).unwrap();
            assert!(found.errors.is_empty(), "{name}: {:?}", found.errors);
        }
    }

    #[test]
    fn unknown_names_are_refused_with_their_line_and_a_suggestion() {
        let found = checked(
            "name: lab\ntitle: x\nmodel: human34\nmarkers:\n  - {label: A, link: pelvis, landmark: asis_r}\n  \
             - {label: B, link: pelviss, landmark: asis_l}\n  - {label: C, link: pelvis, landmark: sacrm}\n  \
             - {label: A, link: thigh_l, landmark: knee_lateral_r}\n",
        );
        let of = |line: usize| found.errors.iter().filter(|e| e.line == Some(line)).collect::<Vec<_>>();
        assert!(of(6)[0].problem.contains("no link `pelviss`") && of(6)[0].hint.as_ref().unwrap().contains("`pelvis`"));
        assert!(of(7)[0].problem.contains("sacrm") && of(7)[0].hint.as_ref().unwrap().contains("`sacrum`"));
        assert!(of(8).iter().any(|e| e.problem.contains("names two markers")), "{:?}", found.errors);
        assert!(of(8).iter().any(|e| e.problem.contains("on link `thigh_l`")));
        assert!(found.errors.iter().any(|e| e.problem.contains("the pelvis needs")));
    }

    #[test]
    fn a_model_that_is_not_there_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("lab.yaml");
        std::fs::write(&file, "name: lab\ntitle: x\nmodel: human43\nmarkers: []\n").unwrap();
        assert!(check(&file).unwrap_err().to_string().contains("human43"));
    }
}
