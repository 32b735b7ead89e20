//! Changes made by a calibration, and the improvement on held-out frames.

use super::bundle::Uncertainty;
use super::clip::Tracked;
use super::options::CalibrateOptions;
use super::reference::Reference;
use super::select::{FrameId, Selection};
use crate::IkError;
use aloft_body::{JointKind, Subject};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// One joint: landmarks against calibration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointChange {
    /// Child link of the joint.
    pub link: String,
    /// Joint centre from landmarks, world frame of the static posture, m.
    pub landmark_m: Vector3<f64>,
    /// Calibrated joint centre, the same frame, m.
    pub calibrated_m: Vector3<f64>,
    /// Distance between the two, m.
    pub moved_m: f64,
    /// Standard deviation of the centre from landmarks along each axis, m; none in reports of
    /// earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub landmark_sd_m: Option<f64>,
    /// Standard deviation of the calibrated centre, root mean square over axes, m.
    pub sd_m: f64,
    /// Rotation of a hinge's axis, rad; `None` for other joints.
    pub axis_turned_rad: Option<f64>,
    /// Standard deviation of the calibrated axis, rad; none for other joints.
    pub axis_sd_rad: Option<f64>,
}

/// Distance from the landmarks, in their standard deviations, above which motion and landmarks
/// contradict each other: chance puts one centre in thirty there, and so one of all in every third
/// person.
const FAR_IN_SD: f64 = 3.0;

/// What to say of joint centres that motion and landmarks put at different places; none if they
/// agree.
pub fn contradiction(joints: &[JointChange]) -> Option<String> {
    let mut far: Vec<(&JointChange, f64)> = joints
        .iter()
        .filter_map(|j| Some((j, j.landmark_sd_m?)))
        .filter(|(j, sd_m)| j.moved_m > FAR_IN_SD * sd_m)
        .collect();
    far.sort_by(|a, b| b.0.moved_m.total_cmp(&a.0.moved_m));
    let each = |(j, sd_m): &(&JointChange, f64)| {
        format!("{} {:.0} mm (landmarks good to {:.0} mm)", j.link.replace('_', " "), 1e3 * j.moved_m, 1e3 * sd_m)
    };
    let named: Vec<String> = far.iter().map(each).collect();
    (!named.is_empty()).then(|| {
        format!(
            "calibration moved joint centres far from their landmarks: {}; check labels, the static trial and segments that bend: if the \
             landmarks are right, the masses of adjacent segments are biased (`calibrate: {{enabled: off}}` keeps the landmarks)",
            named.join(", ")
        )
    })
}

/// One marker, before and after.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MarkerChange {
    /// Label.
    pub label: String,
    /// Displacement of its position in the static posture, m.
    pub moved_m: f64,
    /// Root mean square distance before the calibration, over the frames used and held out, m.
    pub rms_before_m: f64,
    /// The same after, m.
    pub rms_after_m: f64,
}

/// One trial, before and after.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrialFit {
    /// Trial.
    pub trial: String,
    /// Frames used.
    pub frames_used: usize,
    /// Root mean square over markers before the calibration, over the frames used and held out, m.
    pub rms_before_m: f64,
    /// The same after, m.
    pub rms_after_m: f64,
}

/// Report of a calibration.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CalibrationReport {
    /// Moving frames used.
    pub frames_used: usize,
    /// Interleaved frames held out for the check.
    pub frames_held_out: usize,
    /// Steps of the estimation over all rounds.
    pub iterations: usize,
    /// Root mean square over markers of the used frames before the calibration, m.
    pub used_rms_before_m: f64,
    /// The same after, m.
    pub used_rms_after_m: f64,
    /// Root mean square over markers of the held-out frames before the calibration, m.
    pub held_out_rms_before_m: f64,
    /// The same after, m.
    pub held_out_rms_after_m: f64,
    /// Joints.
    pub joints: Vec<JointChange>,
    /// Markers.
    pub markers: Vec<MarkerChange>,
    /// Trials.
    pub trials: Vec<TrialFit>,
    /// Joint centres of the geometry in use that motion and landmarks put at different places
    /// ([`contradiction`]), in words; none if there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contradiction: Option<String>,
}

impl CalibrationReport {
    /// Values before the calibration.
    pub(crate) fn start(selection: &Selection, tracked: &[Tracked]) -> Self {
        Self {
            frames_used: selection.used.len(),
            frames_held_out: selection.held_out.len(),
            used_rms_before_m: rms_of(&selection.used, tracked),
            held_out_rms_before_m: rms_of(&selection.held_out, tracked),
            markers: marker_rms(tracked)
                .into_iter()
                .map(|(label, rms)| MarkerChange { label, moved_m: f64::NAN, rms_before_m: rms, rms_after_m: f64::NAN })
                .collect(),
            trials: tracked
                .iter()
                .enumerate()
                .map(|(t, tracked)| TrialFit {
                    trial: tracked.trial.name.clone(),
                    frames_used: selection.used.iter().filter(|id| id.trial == t).count(),
                    rms_before_m: tracked.result.report.rms_m,
                    rms_after_m: f64::NAN,
                })
                .collect(),
            ..Self::default()
        }
    }

    /// Values after the calibration.
    pub(crate) fn finish(
        &mut self,
        calibrated: &Subject,
        landmarks: &Reference,
        uncertainty: &Uncertainty,
        options: &CalibrateOptions,
        selection: &Selection,
        tracked: &[Tracked],
    ) -> Result<(), IkError> {
        self.used_rms_after_m = rms_of(&selection.used, tracked);
        self.held_out_rms_after_m = rms_of(&selection.held_out, tracked);
        for (fit, tracked) in self.trials.iter_mut().zip(tracked) {
            fit.rms_after_m = tracked.result.report.rms_m;
        }
        // A trial without used frames has no figures.
        self.trials.retain(|fit| fit.rms_before_m.is_finite() && fit.rms_after_m.is_finite());
        let now = Reference::of(calibrated)?;
        for (label, rms) in marker_rms(tracked) {
            let Some(change) = self.markers.iter_mut().find(|m| m.label == label) else { continue };
            change.rms_after_m = rms;
            if let Some(m) = calibrated.marker_index(&label) {
                change.moved_m = (now.marker[m] - landmarks.marker[m]).norm();
            }
        }
        self.joints = calibrated
            .model
            .links
            .iter()
            .enumerate()
            .filter(|(_, link)| link.parent.is_some() && link.joint.kind.nv() > 0)
            .map(|(i, link)| {
                let hinge = matches!(link.joint.kind, JointKind::Revolute(_));
                let turned = now.axis[i].angle(&landmarks.axis[i]);
                JointChange {
                    link: link.name.clone(),
                    landmark_m: landmarks.centre[i],
                    calibrated_m: now.centre[i],
                    moved_m: (now.centre[i] - landmarks.centre[i]).norm(),
                    landmark_sd_m: Some(options.joint_sd(&link.name)),
                    sd_m: uncertainty.centre_m[i],
                    axis_turned_rad: hinge.then_some(turned),
                    axis_sd_rad: hinge.then_some(uncertainty.axis_rad[i]),
                }
            })
            .collect();
        Ok(())
    }
}

/// Root mean square over markers of some frames, m.
fn rms_of(frames: &[FrameId], tracked: &[Tracked]) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    for id in frames {
        let motion = &tracked[id.trial].result.motion;
        let n = motion.marker_labels.len();
        for r in motion.residual_m[id.frame * n..(id.frame + 1) * n].iter().filter(|r| r.is_finite()) {
            sum += r * r;
            count += 1;
        }
    }
    (sum / count as f64).sqrt()
}

/// Root mean square of each marker over the frames of all trials, m, in order of first appearance.
fn marker_rms(tracked: &[Tracked]) -> Vec<(String, f64)> {
    let mut sums: Vec<(String, f64, usize)> = Vec::new();
    for fit in tracked.iter().flat_map(|t| &t.result.report.markers).filter(|fit| fit.n_used > 0) {
        let square = fit.rms_m * fit.rms_m * fit.n_used as f64;
        match sums.iter_mut().find(|(label, ..)| *label == fit.label) {
            Some((_, sum, count)) => {
                *sum += square;
                *count += fit.n_used;
            }
            None => sums.push((fit.label.clone(), square, fit.n_used)),
        }
    }
    sums.into_iter().map(|(label, sum, count)| (label, (sum / count as f64).sqrt())).collect()
}
