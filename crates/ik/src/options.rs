//! Options of tracking; the defaults are suitable for people and for rigid objects.

use crate::{IkError, JointRange};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Options of [`crate::solve()`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct IkOptions {
    /// Standard deviation of a marker of weight 1, each axis, m. It sets the weight of markers
    /// relative to the soft priors; reported covariances use the scatter of the residuals instead.
    pub marker_sd_m: f64,
    /// Standard deviation of the prior about the static posture, rad (m for prismatic joints).
    /// Wide: it fixes coordinates that no marker determines and has no effect on the others.
    pub posture_sd_rad: f64,
    /// How far a hinge with a known flexion side may extend past straight before a soft limit acts,
    /// rad.
    pub overextension_rad: f64,
    /// How far it may flex from straight, rad.
    pub flexion_limit_rad: f64,
    /// Standard deviation of the excess over these limits, rad.
    pub limit_sd_rad: f64,
    /// Direction in which a hinge flexes about its axis (+1 or −1) by link name. Hinges not listed
    /// have no limits and no preferred side. Filled in for the forearms and shanks of the human
    /// model.
    pub flexion: BTreeMap<String, f64>,
    /// Range of spherical joints by link name; a joint beyond it is drawn back softly and reported.
    /// Filled in for the links of a person.
    pub ranges: BTreeMap<String, JointRange>,
    /// Coordinates held at the static posture, as indices into v.
    pub locked: Vec<usize>,
    /// Distance at which the influence of a marker is limited (Huber's loss), m; `None` for plain
    /// least squares.
    pub huber_m: Option<f64>,
    /// Maximum number of steps of one minimisation.
    pub max_iterations: usize,
    /// A minimisation has converged when the step is below this many standard deviations (of the
    /// estimate, at `marker_sd_m`).
    pub tolerance_sd: f64,
    /// A frame is restarted when its marker RMS exceeds this multiple of the previous one…
    pub restart_factor: f64,
    /// …plus this, m.
    pub restart_margin_m: f64,
    /// Relative increase of χ² that is accepted for the flexed side of a poorly observed hinge.
    pub flexed_tolerance: f64,
    /// A frame counts as unsolved if the standard deviation of the root's position exceeds this, m.
    pub root_sd_limit_m: f64,
    /// Longest gap of a marker that is bridged, s; 0 for none.
    pub bridge_gaps_s: f64,
    /// Frames tracked in one sequence; longer trials are split here, whatever the number of
    /// threads.
    pub chunk_frames: usize,
    /// Frames tracked before each sequence and discarded.
    pub warm_up_frames: usize,
}

impl Default for IkOptions {
    fn default() -> Self {
        let flexion = [("forearm_r", 1.0), ("forearm_l", 1.0), ("shank_r", -1.0), ("shank_l", -1.0)];
        Self {
            marker_sd_m: 0.001,
            posture_sd_rad: 10.0,
            overextension_rad: 0.6,
            flexion_limit_rad: 2.8,
            limit_sd_rad: 0.1,
            flexion: flexion.into_iter().map(|(name, sense)| (name.to_owned(), sense)).collect(),
            ranges: crate::ranges::of_person().collect(),
            locked: Vec::new(),
            huber_m: None,
            max_iterations: 40,
            tolerance_sd: 1e-3,
            restart_factor: 2.0,
            restart_margin_m: 0.005,
            flexed_tolerance: 0.25,
            root_sd_limit_m: 0.05,
            bridge_gaps_s: 0.25,
            chunk_frames: 1000,
            warm_up_frames: 8,
        }
    }
}

impl IkOptions {
    /// Checks the numbers.
    ///
    /// # Errors
    /// [`IkError::Option`] for the first invalid value.
    pub fn check(&self) -> Result<(), IkError> {
        let positive = [
            ("marker_sd_m", self.marker_sd_m),
            ("posture_sd_rad", self.posture_sd_rad),
            ("limit_sd_rad", self.limit_sd_rad),
            ("flexion_limit_rad", self.flexion_limit_rad),
            ("overextension_rad", self.overextension_rad),
            ("tolerance_sd", self.tolerance_sd),
            ("restart_factor", self.restart_factor),
            ("restart_margin_m", self.restart_margin_m),
            ("root_sd_limit_m", self.root_sd_limit_m),
            ("huber_m", self.huber_m.unwrap_or(1.0)),
            ("max_iterations", self.max_iterations as f64),
            ("chunk_frames", self.chunk_frames as f64),
        ];
        for (option, found) in positive {
            if found.is_nan() || found <= 0.0 || found.is_infinite() {
                return Err(IkError::Option { option, found, expected: "positive and finite" });
            }
        }
        for (option, found) in [("flexed_tolerance", self.flexed_tolerance), ("bridge_gaps_s", self.bridge_gaps_s)] {
            if found.is_nan() || found < 0.0 {
                return Err(IkError::Option { option, found, expected: "not negative" });
            }
        }
        Ok(())
    }
}
