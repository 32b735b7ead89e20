//! What can be chosen in tracking; the defaults suit people and rigid objects alike.

use crate::IkError;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Options of [`crate::solve()`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct IkOptions {
    /// Standard deviation of a marker of weight 1, each axis, m. It weighs markers against the soft priors; reported
    /// covariances use the residuals' own scatter instead.
    pub marker_sd_m: f64,
    /// Standard deviation of the pull towards the static posture, rad (m for prismatic joints). Wide: it holds coordinates
    /// that no marker sees and does nothing to the others.
    pub posture_sd_rad: f64,
    /// How far a hinge with a known flexion side may go past straight before a soft limit pulls back, rad.
    pub overextension_rad: f64,
    /// How far it may flex from straight, rad.
    pub flexion_limit_rad: f64,
    /// Standard deviation of the excess over these limits, rad.
    pub limit_sd_rad: f64,
    /// Sense in which a hinge flexes about its axis (+1 or −1) by link name. Hinges that are not named have no limits and no
    /// preferred side. Filled for the forearms and shanks of the human model.
    pub flexion: BTreeMap<String, f64>,
    /// Coordinates held at the static posture, as indices into v.
    pub locked: Vec<usize>,
    /// Distance beyond which a marker's pull no longer grows (Huber's loss), m; none for plain least squares.
    pub huber_m: Option<f64>,
    /// Steps of one minimisation.
    pub max_iterations: usize,
    /// A minimisation has converged when the step is below this many standard deviations (of the estimate, at `marker_sd_m`).
    pub tolerance_sd: f64,
    /// A frame starts afresh when its marker RMS exceeds this multiple of the last one…
    pub restart_factor: f64,
    /// …plus this, m.
    pub restart_margin_m: f64,
    /// How much worse (relative χ²) the flexed side of an under-observed hinge may fit and still be preferred.
    pub flexed_tolerance: f64,
    /// A frame counts as unsolved when the root's position is known less well than this, m.
    pub root_sd_limit_m: f64,
    /// Longest gap of a marker across which its pull on the pose is carried, s; 0 for none.
    pub bridge_gaps_s: f64,
    /// Frames that are tracked in one sequence; longer trials are cut here, whatever the number of threads.
    pub chunk_frames: usize,
    /// Frames tracked ahead of each piece and thrown away.
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
    /// [`IkError::Option`] for the first one that cannot be used.
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
