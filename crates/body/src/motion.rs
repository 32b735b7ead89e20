//! Joint motion of one trial. Missing frames hold NaN.

use serde::{Deserialize, Serialize};

/// Joint coordinates over time and, after filtering, their velocities and accelerations.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Motion {
    /// Name of the trial.
    pub trial: String,
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Number of coordinates per frame.
    pub nq: usize,
    /// Number of velocities per frame.
    pub nv: usize,
    /// Coordinates, frame by frame: `q[frame * nq + i]`; a frame that could not be solved is NaN.
    pub q: Vec<f64>,
    /// Velocities, `v[frame * nv + i]`; empty before filtering.
    pub v: Vec<f64>,
    /// Accelerations, `a[frame * nv + i]`; empty before filtering.
    pub a: Vec<f64>,
    /// Labels of the markers used.
    pub marker_labels: Vec<String>,
    /// Distance between measured and model marker, m: `residual_m[frame * n_markers + i]`, NaN if
    /// the marker was missing.
    pub residual_m: Vec<f64>,
    /// Standard deviation of each velocity-space coordinate from the inverse kinematics'
    /// covariance, `q_sd[frame * nv + i]`; may be empty.
    pub q_sd: Vec<f64>,
}

impl Motion {
    /// Number of frames.
    pub fn n_frames(&self) -> usize {
        self.q.len().checked_div(self.nq).unwrap_or(0)
    }
    /// Coordinates of a frame.
    pub fn q(&self, frame: usize) -> &[f64] {
        &self.q[frame * self.nq..(frame + 1) * self.nq]
    }
    /// Coordinates of a frame in whole thousandths (mm, mrad): what seeds of drawn errors are made
    /// from, so that they are the same under other names and in formats that round elsewhere.
    pub fn thousandths(&self, frame: usize) -> impl Iterator<Item = i64> {
        self.q(frame).iter().map(|q| (1e3 * q).round() as i64)
    }
    /// Velocities of a frame.
    pub fn v(&self, frame: usize) -> &[f64] {
        &self.v[frame * self.nv..(frame + 1) * self.nv]
    }
    /// Accelerations of a frame.
    pub fn a(&self, frame: usize) -> &[f64] {
        &self.a[frame * self.nv..(frame + 1) * self.nv]
    }
    /// True when the frame was solved.
    pub fn is_valid(&self, frame: usize) -> bool {
        self.q(frame).iter().all(|x| x.is_finite())
    }
    /// Root mean square of the marker residuals of a frame, m (NaN without markers).
    pub fn frame_rms_m(&self, frame: usize) -> f64 {
        let n = self.marker_labels.len();
        rms(self.residual_m[frame * n..(frame + 1) * n].iter())
    }
    /// Root mean square over markers and frames, m.
    pub fn rms_m(&self) -> f64 {
        rms(self.residual_m.iter())
    }
}

fn rms<'a>(values: impl Iterator<Item = &'a f64>) -> f64 {
    let (sum, n) = values.filter(|r| r.is_finite()).fold((0.0, 0usize), |(s, n), r| (s + r * r, n + 1));
    if n == 0 { f64::NAN } else { (sum / n as f64).sqrt() }
}
