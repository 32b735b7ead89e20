//! Import options, and helpers shared by the readers of all formats.

use crate::fall::up_axis_from_fall;
use crate::force_columns::PlateNames;
use crate::rows::RATES_HZ;
use crate::world::{rotate, up_axis_from_body, up_axis_from_plates};
use crate::{Trial, TrialError, UpAxis, Warning, WarningKind};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What the times of a force file count.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ForceTimes {
    /// The same clock as the times of the markers.
    #[default]
    AsStated,
    /// A clock of their own: the first row belongs to the first frame.
    FromFirstFrame,
}

/// Import options.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImportOptions {
    /// Axis of the source that points up; if absent, determined from the plates, from falling
    /// markers, from feet and shoulders, otherwise by the convention of the format (C3D Z, TRC Y).
    pub up_axis: Option<UpAxis>,
    /// Remove the prefix `Subject:` from labels.
    pub strip_prefix: bool,
    /// Length unit of the source if it states none or a wrong one (`mm`, `cm`, `dm`, `m`, `in`,
    /// `ft`).
    pub point_unit: Option<String>,
    /// Rate of the markers, Hz, where the file states none or a wrong one. Plates of a C3D file
    /// keep their samples a frame; force files keep their own times.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate_hz: Option<f64>,
    /// Take full names from POINT:DESCRIPTIONS if labels were truncated to four characters.
    pub full_names: bool,
    /// In text formats: three exact zeros mean a missing marker (only in markers that are non-zero
    /// elsewhere).
    pub zero_is_missing: bool,
    /// Names by which the person may be called whose markers are used where a recording holds
    /// several people, the surest first.
    pub people: Vec<String>,
    /// Columns of each plate in force files; if empty, by the names of the columns.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub forces: BTreeMap<String, PlateNames>,
    /// What the times of force files count.
    pub force_times: ForceTimes,
}

impl Default for ImportOptions {
    fn default() -> Self {
        Self {
            up_axis: None,
            strip_prefix: true,
            point_unit: None,
            rate_hz: None,
            full_names: true,
            zero_is_missing: true,
            people: Vec::new(),
            forces: BTreeMap::new(),
            force_times: ForceTimes::AsStated,
        }
    }
}

/// Numbers repeated labels (`RKNE`, `RKNE#2`), with a warning. All are kept.
pub(crate) fn disambiguate(labels: &mut [String], warnings: &mut Vec<Warning>) {
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
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

/// Rotates the recording into the world frame. The vertical axis is, in this order, the one in the
/// options, the one found from the plates, the one from the feet to the shoulders, the axis that
/// the file declares (without its sign), or the convention of the format.
pub(crate) fn to_world(trial: &mut Trial, options: &ImportOptions, declared: Option<UpAxis>, habit: UpAxis) {
    let (plates, fall, body) = (up_axis_from_plates(trial), up_axis_from_fall(trial), up_axis_from_body(trial));
    let told = plates
        .or(fall.map(|up| (up, "falling markers")))
        .or(body.map(|up| (up, "shoulders above feet")))
        .or(declared.map(|up| (up.positive(), "the file's screen axes")));
    if options.up_axis.is_none() {
        // what falls does not say how the body is turned: in a somersault shoulders are below the
        // feet
        let body = if plates.is_none() && fall.is_some() { fall } else { body };
        match (plates, body, declared) {
            (Some((seen, by)), Some(body), _) if seen != body => trial.warn(
                WarningKind::Axes,
                format!("up axis {seen}, told by {by}, but shoulders are above feet along {body}; state `up_axis` if that is right"),
            ),
            // where plates are read, their reader says it
            (None, Some(body), Some(screen)) if screen != body => trial.warn(
                WarningKind::Axes,
                format!("POINT:Y_SCREEN says {screen}, but {} {body}, which is taken as up",
                    if fall.is_some() { "markers fall against" } else { "shoulders are above feet along" }),
            ),
            (None, None, Some(screen)) if screen != screen.positive() => trial.warn(
                WarningKind::Axes,
                format!(
                    "POINT:Y_SCREEN `{screen}` is not taken as the vertical, and nothing else tells it: {} is taken as up; state `up_axis` if that is wrong",
                    screen.positive()
                ),
            ),
            _ => {}
        }
    }
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

/// Checks that every imported recording must pass.
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
