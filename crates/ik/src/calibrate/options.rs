//! Options of a calibration.

use crate::{IkError, IkOptions};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Options of [`crate::calibrate()`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CalibrateOptions {
    /// Frames to use, over all trials.
    pub frames: usize,
    /// Minimum standard deviation of a marker, each axis, m: noise and soft tissue together. If the
    /// median residual at the start of a round is larger, that is used.
    pub marker_noise_m: f64,
    /// Weight of one frame. Small, because soft-tissue errors are similar in neighbouring frames
    /// and in every jump.
    pub frame_weight: f64,
    /// Weight of the static posture.
    pub static_weight: f64,
    /// Standard deviation of the marker placement, each axis, m.
    pub marker_sd_m: f64,
    /// Standard deviation of the joint centres from landmarks, each axis, m, by child link.
    pub joint_sd_m: BTreeMap<String, f64>,
    /// The same for joints not listed.
    pub other_joint_sd_m: f64,
    /// Standard deviation of the hinge axes from landmarks, rad, by child link.
    pub axis_sd_rad: BTreeMap<String, f64>,
    /// The same for hinges not listed.
    pub other_axis_sd_rad: f64,
    /// Multiple of the median distance at which the influence of a marker is limited (Huber's loss,
    /// against soft tissue).
    pub huber_factor: f64,
    /// Maximum number of steps per round.
    pub max_iterations: usize,
    /// Rounds: after each one the frames are tracked again with the new geometry.
    pub rounds: usize,
    /// Options of tracking.
    pub ik: IkOptions,
}

impl Default for CalibrateOptions {
    fn default() -> Self {
        let sides = |names: &[&str], sd: f64| -> Vec<(String, f64)> {
            names.iter().flat_map(|n| [(format!("{n}_r"), sd), (format!("{n}_l"), sd)]).collect()
        };
        let mut joint_sd_m: BTreeMap<String, f64> =
            [("torso".to_owned(), 0.030), ("head".to_owned(), 0.020)].into_iter().collect();
        joint_sd_m.extend(sides(&["upper_arm"], 0.020));
        joint_sd_m.extend(sides(&["thigh"], 0.006));
        joint_sd_m.extend(sides(&["forearm", "shank", "foot"], 0.004));
        joint_sd_m.extend(sides(&["hand"], 0.005));
        Self {
            frames: 300,
            marker_noise_m: 0.0014,
            frame_weight: 0.05,
            static_weight: 1.0,
            marker_sd_m: 0.010,
            joint_sd_m,
            other_joint_sd_m: 0.010,
            axis_sd_rad: BTreeMap::new(),
            other_axis_sd_rad: 0.1,
            huber_factor: 3.0,
            max_iterations: 12,
            rounds: 2,
            ik: IkOptions::default(),
        }
    }
}

impl CalibrateOptions {
    /// Standard deviation of a joint centre, m.
    pub fn joint_sd(&self, link: &str) -> f64 {
        self.joint_sd_m.get(link).copied().unwrap_or(self.other_joint_sd_m)
    }

    /// Standard deviation of a hinge axis, rad.
    pub fn axis_sd(&self, link: &str) -> f64 {
        self.axis_sd_rad.get(link).copied().unwrap_or(self.other_axis_sd_rad)
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// [`IkError::Option`] for the first invalid value.
    pub fn check(&self) -> Result<(), IkError> {
        self.ik.check()?;
        let named = |option, map: &BTreeMap<String, f64>| map.values().map(|v| (option, *v)).collect::<Vec<_>>();
        let mut positive = vec![
            ("frames", self.frames as f64),
            ("marker_noise_m", self.marker_noise_m),
            ("frame_weight", self.frame_weight),
            ("static_weight", self.static_weight),
            ("marker_sd_m", self.marker_sd_m),
            ("other_joint_sd_m", self.other_joint_sd_m),
            ("other_axis_sd_rad", self.other_axis_sd_rad),
            ("huber_factor", self.huber_factor),
            ("max_iterations", self.max_iterations as f64),
            ("rounds", self.rounds as f64),
        ];
        positive.extend(named("joint_sd_m", &self.joint_sd_m));
        positive.extend(named("axis_sd_rad", &self.axis_sd_rad));
        for (option, found) in positive {
            if found.is_nan() || found <= 0.0 || found.is_infinite() {
                return Err(IkError::Option { option, found, expected: "positive and finite" });
            }
        }
        Ok(())
    }
}
