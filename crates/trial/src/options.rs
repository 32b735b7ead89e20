//! Choices of import that a pipeline may state, and the little reading helpers that all formats share.

use crate::rows::RATES_HZ;
use crate::world::{rotate, up_axis_from_plates};
use crate::{Trial, TrialError, UpAxis, Warning, WarningKind};
use serde::{Deserialize, Serialize};

/// How a recording is read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImportOptions {
    /// Axis of the source that points up; none: told by the plates, else by the format's habit (C3D Z, TRC Y).
    pub up_axis: Option<UpAxis>,
    /// Cut `Subject:` from labels.
    pub strip_prefix: bool,
    /// Length unit of the source where it states none or a wrong one (`mm`, `cm`, `dm`, `m`, `in`, `ft`).
    pub point_unit: Option<String>,
    /// Take full names from POINT:DESCRIPTIONS where labels were cut to four characters.
    pub full_names: bool,
    /// In text formats: three exact zeros mean that the marker was not seen (only in markers that are elsewhere non-zero).
    pub zero_is_missing: bool,
}

impl Default for ImportOptions {
    fn default() -> Self {
        Self { up_axis: None, strip_prefix: true, point_unit: None, full_names: true, zero_is_missing: true }
    }
}

/// Gives repeated labels a number (`RKNE`, `RKNE#2`) and says so. Both stay.
pub(crate) fn disambiguate(labels: &mut [String], warnings: &mut Vec<Warning>) {
    let mut seen: std::collections::BTreeMap<String, usize> = std::collections::BTreeMap::new();
    let taken: std::collections::BTreeSet<String> = labels.iter().cloned().collect();
    for label in labels.iter_mut() {
        let count = seen.entry(label.clone()).or_insert(0);
        *count += 1;
        if *count > 1 {
            let mut number = *count;
            let mut unique = format!("{label}#{number}");
            while taken.contains(&unique) {
                number += 1;
                unique = format!("{label}#{number}");
            }
            *label = unique;
        }
    }
    let repeated: Vec<String> =
        seen.iter().filter(|(_, count)| **count > 1).map(|(label, count)| format!("`{label}` ({count})")).collect();
    if let Some(first) = repeated.first() {
        let more = if repeated.len() > 1 { format!(" and {} other labels", repeated.len() - 1) } else { String::new() };
        let message = format!("label {first}{more} repeated; all are kept, the later ones as `…#2`, `…#3`");
        warnings.push(Warning::new(WarningKind::Labels, message));
    }
}

/// Turns the recording into the world frame: the stated axis, else what the plates tell, else what the file `declares`, else the
/// format's habit.
pub(crate) fn to_world(trial: &mut Trial, options: &ImportOptions, declared: Option<UpAxis>, habit: UpAxis) {
    let told = up_axis_from_plates(trial).or(declared.map(|up| (up, "the file's screen axes")));
    let up = match (options.up_axis, told) {
        (Some(stated), Some((seen, by))) if stated != seen => {
            trial.warn(
                WarningKind::Axes,
                format!("up axis stated as {stated}, but {by} say {seen}; the stated one is used"),
            );
            stated
        }
        (Some(stated), _) => stated,
        (None, Some((seen, by))) => {
            if seen != habit {
                trial.warn(WarningKind::Axes, format!("up axis {seen}, told by {by}"));
            }
            seen
        }
        (None, None) => habit,
    };
    rotate(trial, up);
}

/// The checks that every source must pass to become a trial.
pub(crate) fn require_content(trial: &Trial, found: impl FnOnce() -> String) -> Result<(), TrialError> {
    if trial.markers.labels.is_empty() {
        return Err(TrialError::NoMarkers { trial: trial.name.clone(), found: found() });
    }
    if trial.markers.n_frames == 0 {
        return Err(TrialError::NoFrames { trial: trial.name.clone() });
    }
    if !RATES_HZ.contains(&trial.markers.rate_hz) {
        return Err(TrialError::Rate { trial: trial.name.clone(), place: "markers", found: trial.markers.rate_hz });
    }
    Ok(())
}
