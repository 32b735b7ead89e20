//! Quality of tracking, by marker and by frame.

use crate::BeyondRange;
use serde::{Deserialize, Serialize};

/// Fit of one marker over a trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MarkerFit {
    /// Label.
    pub label: String,
    /// Root mean square distance of measured and model marker, m (NaN when it was never seen).
    pub rms_m: f64,
    /// Largest distance, m (NaN when it was never seen).
    pub max_m: f64,
    /// Frame of the largest distance, counted from zero.
    pub max_frame: usize,
    /// Frames in which the marker took part.
    pub n_used: usize,
    /// Frames in which it was missing.
    pub n_missing: usize,
}

/// Fit of one trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct IkReport {
    /// Trial.
    pub trial: String,
    /// Frames in the trial.
    pub n_frames: usize,
    /// Frames that could not be solved (NaN in the motion): too few markers to place the root.
    pub n_unsolved: usize,
    /// Frames in which the minimisation stopped before it converged; they are kept.
    pub n_unconverged: usize,
    /// Frames that were restarted.
    pub n_restarts: usize,
    /// Frames in which a hinge was moved back to its flexed side.
    pub n_branch_changes: usize,
    /// Frames in which a gap of a marker was bridged.
    pub n_bridged: usize,
    /// Frames in which a segment was turned to the pose that its own markers show, because the
    /// posture had gone to a wrong branch.
    #[serde(default)]
    pub n_turned: usize,
    /// Joints beyond their ranges, the farthest first.
    #[serde(default)]
    pub beyond_range: Vec<BeyondRange>,
    /// Mean number of minimisation steps per frame.
    pub mean_iterations: f64,
    /// Root mean square over markers and frames, m.
    pub rms_m: f64,
    /// Largest distance of all, m.
    pub max_m: f64,
    /// Every marker that was used.
    pub markers: Vec<MarkerFit>,
    /// Root mean square of each frame, m; NaN where unsolved.
    pub frame_rms_m: Vec<f64>,
    /// Largest distance of each frame, m; NaN where unsolved.
    pub frame_max_m: Vec<f64>,
    /// Markers of the subject that the trial does not have.
    pub missing_labels: Vec<String>,
    /// Markers of the trial that the subject does not have.
    pub unused_labels: Vec<String>,
}

impl IkReport {
    /// The worst markers (up to `n`), largest root mean square first.
    pub fn worst(&self, n: usize) -> Vec<&MarkerFit> {
        let mut all: Vec<&MarkerFit> = self.markers.iter().filter(|m| m.rms_m.is_finite()).collect();
        all.sort_by(|a, b| b.rms_m.total_cmp(&a.rms_m));
        all.truncate(n);
        all
    }

    /// The report of a motion that other code solved, from its residuals; `n_unconverged` frames
    /// stopped before the minimisation converged.
    pub fn of_motion(motion: &aloft_body::Motion, n_unconverged: usize) -> Self {
        let solved: Vec<bool> = (0..motion.n_frames()).map(|f| motion.is_valid(f)).collect();
        let gathered = Self::gather(&motion.trial, &motion.marker_labels, &motion.residual_m, &solved);
        Self { n_unconverged, ..gathered }
    }

    /// Computes the figures from distances `residual_m[frame * n_markers + marker]` (NaN where
    /// missing).
    pub(crate) fn gather(trial: &str, labels: &[String], residual_m: &[f64], solved: &[bool]) -> Self {
        let n = labels.len();
        let n_frames = solved.len();
        let mut markers: Vec<MarkerFit> = labels
            .iter()
            .map(|label| MarkerFit {
                label: label.clone(),
                rms_m: 0.0,
                max_m: f64::NAN,
                max_frame: 0,
                n_used: 0,
                n_missing: 0,
            })
            .collect();
        let mut frame_rms_m = Vec::with_capacity(n_frames);
        let mut frame_max_m = Vec::with_capacity(n_frames);
        let (mut total, mut count) = (0.0, 0usize);
        for frame in 0..n_frames {
            let (mut sum, mut used, mut largest) = (0.0, 0usize, f64::NAN);
            for (fit, &r) in markers.iter_mut().zip(&residual_m[frame * n..(frame + 1) * n]) {
                if !r.is_finite() {
                    fit.n_missing += 1;
                    continue;
                }
                fit.n_used += 1;
                fit.rms_m += r * r;
                if fit.max_m.is_nan() || r > fit.max_m {
                    fit.max_m = r;
                    fit.max_frame = frame;
                }
                sum += r * r;
                used += 1;
                largest = f64::max(largest, r);
            }
            total += sum;
            count += used;
            frame_rms_m.push(if used == 0 { f64::NAN } else { (sum / used as f64).sqrt() });
            frame_max_m.push(largest);
        }
        for fit in &mut markers {
            fit.rms_m = if fit.n_used == 0 { f64::NAN } else { (fit.rms_m / fit.n_used as f64).sqrt() };
        }
        Self {
            trial: trial.to_owned(),
            n_frames,
            n_unsolved: solved.iter().filter(|s| !**s).count(),
            n_unconverged: 0,
            n_restarts: 0,
            n_branch_changes: 0,
            n_bridged: 0,
            n_turned: 0,
            beyond_range: Vec::new(),
            mean_iterations: 0.0,
            rms_m: if count == 0 { f64::NAN } else { (total / count as f64).sqrt() },
            max_m: markers.iter().map(|m| m.max_m).fold(f64::NAN, f64::max),
            markers,
            frame_rms_m,
            frame_max_m,
            missing_labels: Vec::new(),
            unused_labels: Vec::new(),
        }
    }
}
