//! Plate wrenches at the marker rate, filtered by the same zero-phase filter as the kinematics;
//! used by the comparison and by contact rows.

use crate::FlightError;
use aloft_signal::LowPass;
use aloft_signal::filter_and_resample;
use aloft_trial::{Plate, Trial};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Force and moment on the subject at the marker frames, world frame, moment about the world
/// origin.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameWrench {
    /// Name of the plate, or `total`.
    pub plate: String,
    /// Force, N, frame by frame; NaN where unknown.
    pub force_n: Vec<Vector3<f64>>,
    /// Moment about the world origin, N·m.
    pub moment_nm: Vec<Vector3<f64>>,
}

/// Each plate at the marker frames: filtered forward and backward at its own rate with `filter`,
/// then interpolated at the frame times (without a filter: block means over one frame, which alias
/// little). Frame k lies at sample k · plate rate / marker rate.
///
/// # Errors
/// The cut-off is not valid at the plate's rate.
pub fn plate_wrench_at_marker_rate(trial: &Trial, filter: Option<LowPass>) -> Result<Vec<FrameWrench>, FlightError> {
    trial.plates.iter().map(|plate| at_marker_rate(trial, plate, filter)).collect()
}

fn at_marker_rate(trial: &Trial, plate: &Plate, filter: Option<LowPass>) -> Result<FrameWrench, FlightError> {
    let n = trial.markers.n_frames;
    let times: Vec<f64> = (0..n).map(|frame| frame as f64 / trial.markers.rate_hz).collect();
    let mut out = FrameWrench {
        plate: plate.name.clone(),
        force_n: vec![Vector3::repeat(f64::NAN); n],
        moment_nm: vec![Vector3::repeat(f64::NAN); n],
    };
    let mut channel = Vec::with_capacity(plate.force_n.len());
    for axis in 0..3 {
        for (source, target) in [(&plate.force_n, &mut out.force_n), (&plate.moment_nm, &mut out.moment_nm)] {
            channel.clear();
            channel.extend(source.iter().map(|v| v[axis]));
            let values = match filter {
                Some(filter) => filter_and_resample(&channel, plate.rate_hz, 0.0, &times, filter).map_err(|e| {
                    FlightError::Filter { trial: trial.name.clone(), what: "plates", problem: e.to_string() }
                })?,
                None => frame_means(&channel, plate.rate_hz, &times, trial.markers.rate_hz),
            };
            for (vector, value) in target.iter_mut().zip(values) {
                vector[axis] = value;
            }
        }
    }
    Ok(out)
}

/// Means over one frame interval around each time; a single sample if the plate is not faster than
/// the markers.
fn frame_means(channel: &[f64], rate_hz: f64, times_s: &[f64], frame_rate_hz: f64) -> Vec<f64> {
    let half = (0.5 * rate_hz / frame_rate_hz - 0.5).max(0.0).floor() as usize;
    times_s
        .iter()
        .map(|time_s| {
            let centre = (time_s * rate_hz).round() as usize;
            if centre >= channel.len() {
                return f64::NAN;
            }
            let block = &channel[centre.saturating_sub(half)..(centre + half + 1).min(channel.len())];
            if block.iter().all(|x| x.is_finite()) { block.iter().sum::<f64>() / block.len() as f64 } else { f64::NAN }
        })
        .collect()
}

/// Sum over plates.
pub fn total_wrench(plates: &[FrameWrench]) -> FrameWrench {
    let n = plates.iter().map(|p| p.force_n.len()).max().unwrap_or(0);
    let mut total = FrameWrench {
        plate: "total".to_owned(),
        force_n: vec![Vector3::zeros(); n],
        moment_nm: vec![Vector3::zeros(); n],
    };
    for plate in plates {
        for frame in 0..n {
            let unknown = Vector3::repeat(f64::NAN);
            total.force_n[frame] += plate.force_n.get(frame).copied().unwrap_or(unknown);
            total.moment_nm[frame] += plate.moment_nm.get(frame).copied().unwrap_or(unknown);
        }
    }
    total
}
