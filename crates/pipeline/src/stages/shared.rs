//! What several stages do.

use crate::graph::StageInputs;
use crate::results::Results;
use aloft_body::Subject;
use aloft_ik::IkOptions;
use aloft_study::config::IkConfig;
use aloft_workspace::error::StageFailure;
use aloft_workspace::json::write_json;

/// Writes `subject.json`.
pub fn save_subject(inputs: &StageInputs<'_>, subject: &Subject) -> Result<(), StageFailure> {
    Ok(write_json(&inputs.out.join("subject.json"), subject)?)
}

/// Settings for fitting the markers of a trial; marker weights stated in the pipeline are written
/// into the subject.
pub fn fit_options(config: &IkConfig, results: Results<'_>, subject: &mut Subject) -> Result<IkOptions, StageFailure> {
    for (label, weight) in &config.weights {
        match subject.markers.iter_mut().find(|m| &m.label == label) {
            Some(marker) => marker.weight = *weight,
            None => {
                return Err(StageFailure::with_hint(
                    format!("ik.weights names the marker `{label}`, which the subject does not have"),
                    "use the canonical labels of the marker set",
                ));
            }
        }
    }
    Ok(IkOptions { marker_sd_m: config.marker_sd_m, locked: results.load_locked()?, ..IkOptions::default() })
}
