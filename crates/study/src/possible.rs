//! Values of model and marker-set files that no body has: refused at their place before anything is
//! computed from them.

use crate::catalog;
use crate::place::{error_at, find};
use aloft_body::ModelSpec;
use aloft_trial::MarkerSet;
use aloft_workspace::error::PipelineError;
use std::path::Path;

/// Farthest that a joint may be from its parent's origin, m.
const FAR_M: f64 = 10.0;
/// Heaviest link, kg.
const HEAVY_KG: f64 = 10_000.0;
/// Largest angle of a joint's placement, rad: more than a full turn is degrees.
const TURN_RAD: f64 = std::f64::consts::TAU;
/// Largest distance from skin to a marker's centre, m.
pub const MARKER_RADIUS_M: f64 = 0.03;
/// Largest weight of a marker, as in the pipeline's `ik: {weights: …}`.
pub const MARKER_WEIGHT: f64 = 1000.0;

/// A wrong value: its path, what was found and expected, and a hint.
type Wrong = (String, String, &'static str);

/// Reads a model file and refuses impossible values.
///
/// # Errors
/// As [`catalog::load`], and at the first impossible value.
pub fn load_model(name: &str, folder: &Path) -> Result<ModelSpec, PipelineError> {
    let source = catalog::find("models", name, folder)?;
    let spec: ModelSpec = crate::ranges::parse_yaml(&source.origin, &source.text)?;
    refuse(&source, wrong_in_model(&spec))?;
    Ok(spec)
}

/// Reads a marker-set file and refuses impossible values.
///
/// # Errors
/// As [`catalog::load`], and at the first impossible value.
pub fn load_marker_set(name: &str, folder: &Path) -> Result<MarkerSet, PipelineError> {
    let source = catalog::find("markersets", name, folder)?;
    let set: MarkerSet = crate::ranges::parse_yaml(&source.origin, &source.text)?;
    refuse(&source, wrong_in_set(&set))?;
    Ok(set)
}

fn refuse(source: &catalog::Source, wrong: Option<Wrong>) -> Result<(), PipelineError> {
    let Some((path, problem, hint)) = wrong else { return Ok(()) };
    let at = find(&source.text, &path).map(|byte| (byte, 1));
    Err(error_at(&source.origin, &source.text, at, &problem, Some(hint.to_owned())))
}

fn wrong_in_set(set: &MarkerSet) -> Option<Wrong> {
    if !(0.0..=MARKER_RADIUS_M).contains(&set.marker_radius_m) {
        return Some((
            "marker_radius_m".to_owned(),
            format!("`marker_radius_m` is {}, expected 0 to {MARKER_RADIUS_M}", set.marker_radius_m),
            "it is in metres: 14 mm markers have 0.007",
        ));
    }
    let heavy = |m: &aloft_trial::MarkerDefinition| !(0.0..=MARKER_WEIGHT).contains(&m.weight);
    let (i, marker) = set.markers.iter().enumerate().find(|(_, m)| heavy(m))?;
    Some((
        format!("markers[{i}].weight"),
        format!("the weight of `{}` is {}, expected 0 to {MARKER_WEIGHT}", marker.label, marker.weight),
        "1 is usual; 0 leaves the marker out",
    ))
}

fn wrong_in_model(spec: &ModelSpec) -> Option<Wrong> {
    for (i, link) in spec.links.iter().enumerate() {
        let at = |key: &str| format!("links[{i}].{key}");
        let name = &link.name;
        if let Some(x) = link.position_m.iter().find(|x| x.abs() > FAR_M) {
            let problem = format!("`{name}`: `position_m` has {x}, expected −{FAR_M} to {FAR_M}");
            return Some((at("position_m"), problem, "lengths are in metres"));
        }
        if let Some(x) = link.rpy_rad.iter().find(|x| x.abs() > TURN_RAD + 1e-9) {
            let problem = format!("`{name}`: `rpy_rad` has {x}, expected at most one turn (6.28)");
            return Some((at("rpy_rad"), problem, "angles are in radians"));
        }
        let Some(inertia) = &link.inertia else { continue };
        if !(0.0..=HEAVY_KG).contains(&inertia.mass_kg) {
            let problem = format!("`{name}`: `mass_kg` is {}, expected 0 to {HEAVY_KG}", inertia.mass_kg);
            return Some((at("inertia.mass_kg"), problem, "masses are in kg"));
        }
        if let Some(x) = inertia.com_m.iter().find(|x| x.abs() > FAR_M) {
            let problem = format!("`{name}`: `com_m` has {x}, expected −{FAR_M} to {FAR_M}");
            return Some((at("inertia.com_m"), problem, "lengths are in metres"));
        }
        let second = 0.5 * inertia.inertia_com_kgm2.trace();
        let least = inertia.inertia_com_kgm2.map_with_location(|r, c, v| if r == c { second - v } else { -v });
        let least = least.symmetric_eigenvalues().min();
        if least < -1e-9 * second.abs().max(1e-12) || second < 0.0 {
            let problem = format!(
                "`{name}`: no body has this `inertia_com_kgm2` (a principal moment is larger than the other two together, or negative)"
            );
            return Some((at("inertia.inertia_com_kgm2"), problem, "moments about the centre of mass, in kg·m²"));
        }
    }
    None
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    fn said(kind: &str, text: &str) -> String {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("own.yaml"), text).unwrap();
        let error = match kind {
            "model" => load_model("own.yaml", dir.path()).map(|_| ()),
            _ => load_marker_set("own.yaml", dir.path()).map(|_| ()),
        };
        error.map_or_else(|e| e.to_string(), |()| "accepted".to_owned())
    }

    #[test]
    fn impossible_values_are_refused_with_their_line() {
        let model = |joint: &str, inertia: &str| {
            format!(
                "name: own\nlinks:\n  - name: a\n    joint: free\n  - name: b\n    parent: a\n    joint: revolute_z\n    {joint}\n    inertia: {inertia}\n"
            )
        };
        let good = "{mass_kg: 1.0, com_m: [0, 0, 0.1], inertia_com_kgm2: [0.02, 0, 0, 0, 0.02, 0, 0, 0, 0.01]}";
        assert_eq!(said("model", &model("position_m: [0, 0, 0.4]", good)), "accepted");
        let refused = [
            (model("position_m: [0, 0, 400]", good), "line 8: `b`: `position_m` has 400"),
            (model("rpy_rad: [0, 90, 0]", good), "line 8: `b`: `rpy_rad` has 90"),
            (
                model("position_m: [0, 0, 0]", &good.replace("mass_kg: 1.0", "mass_kg: -1.0")),
                "line 9: `b`: `mass_kg` is -1",
            ),
            (model("position_m: [0, 0, 0]", &good.replace("mass_kg: 1.0", "mass_kg: 1e9")), "`mass_kg` is 1000000000"),
            (model("position_m: [0, 0, 0]", &good.replace("0.01]", "0.1]")), "line 9: `b`: no body has this"),
            (model("position_m: [0, 0, 0]", &good.replace("0.1]", "-30]")), "`com_m` has -30"),
            (model("position_m: [0, .nan, 0]", good), "line 8"),
        ];
        for (text, expected) in refused {
            let found = said("model", &text);
            assert!(found.contains(expected), "{found}\nexpected {expected}");
        }
        let set = |radius: &str, weight: &str| {
            format!(
                "name: own\ntitle: t\nmodel: human34\nmarker_radius_m: {radius}\nmarkers:\n  - {{label: A, link: pelvis, weight: {weight}}}\n"
            )
        };
        assert_eq!(said("set", &set("0.007", "1")), "accepted");
        for (text, expected) in [
            (set("7", "1"), "line 4: `marker_radius_m` is 7"),
            (set("-0.007", "1"), "line 4: `marker_radius_m` is -0.007"),
            (set("0.007", "-1"), "line 6: the weight of `A` is -1"),
            (set("0.007", ".inf"), "line 6"),
        ] {
            let found = said("set", &text);
            assert!(found.contains(expected), "{found}\nexpected {expected}");
        }
    }

    #[test]
    fn built_in_files_are_possible() {
        for name in catalog::names("models") {
            let _ = load_model(&name, Path::new("")).unwrap();
        }
        for name in catalog::names("markersets") {
            let _ = load_marker_set(&name, Path::new("")).unwrap();
        }
    }
}
