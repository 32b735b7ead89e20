//! Held-out error and noise floor from a comparison, and the limits of their ratio.

use aloft_regressor::FAIR_TIMES_FLOOR;
use aloft_regressor::limits::is_undecided;

/// Ratio of error to floor that counts as at the floor where the interval of the floor is narrower.
const NEAR_TIMES_FLOOR: f64 = 1.1;

/// Result of a comparison of the present model over the windows of one kind of motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeldOutResult {
    /// Held-out error of the model, N: force, and moment over a lever of 0.1 m.
    pub held_out_error: f64,
    /// Error that a perfect model would leave, N.
    pub noise_floor: f64,
    /// 95 % interval of the floor, N.
    pub noise_floor_ci95: Option<[f64; 2]>,
    /// Error up to which noise, the geometry that the markers leave open, and the errors of
    /// parameters that are fitted to the other recordings account for it (97.5 %), N;
    /// [`Session::with_draws`](crate::Session::with_draws) computes it.
    pub by_parameters: Option<f64>,
}

impl HeldOutResult {
    /// Held-out error divided by the noise floor.
    pub(crate) fn times_floor(&self) -> f64 {
        self.held_out_error / self.noise_floor
    }

    /// The largest error that noise and the errors of the parameters account for, N; at least
    /// `otherwise` where the floor has no interval.
    fn most(&self, otherwise: f64) -> f64 {
        self.noise_floor_ci95.map_or(otherwise, |ci| ci[1]).max(self.by_parameters.unwrap_or(0.0))
    }

    /// True if an error is not above what a perfect model could leave: the upper end of the floor's
    /// interval.
    pub(crate) fn reached_by(&self, error_n: f64) -> bool {
        self.noise_floor > 0.0 && self.noise_floor_ci95.is_some_and(|ci| error_n <= ci[1])
    }

    /// True if the error is below what a perfect model leaves in 97.5 of 100 sets of recordings
    /// like these: recordings that repeat each other, or a floor that is too high.
    pub(crate) fn is_below(&self) -> bool {
        self.noise_floor_ci95.is_some_and(|ci| self.held_out_error < ci[0])
    }

    /// True if what the recordings leave open of the parameters can be the whole error.
    pub(crate) fn may_be_of_parameters(&self) -> bool {
        self.by_parameters.is_some_and(|most| self.held_out_error <= most)
    }

    /// True if the floor is known too roughly to say whether the error is at it.
    pub(crate) fn is_undecided(&self) -> bool {
        is_undecided(self.held_out_error, self.noise_floor, self.noise_floor_ci95)
    }

    /// True if the error is beyond the floor's interval and 1.1 times the floor, but not by enough
    /// that something must be missing ([`is_above`](Self::is_above)): a small effect or the errors
    /// of the parameters may be the reason.
    pub(crate) fn is_between(&self) -> bool {
        let beyond = self.noise_floor_ci95.is_some_and(|ci| self.held_out_error > ci[1]);
        beyond && self.times_floor() > NEAR_TIMES_FLOOR && !self.is_above()
    }

    /// True if the error exceeds 1.5 times the floor, the upper end of the floor's interval, and
    /// what the errors of the parameters account for: too much for a body of which nothing is
    /// missing (0.7 to 1.3 times the floor in simulations).
    pub fn is_above(&self) -> bool {
        let most = self.most(f64::INFINITY).max(FAIR_TIMES_FLOOR * self.noise_floor);
        self.noise_floor > 0.0 && self.held_out_error > most
    }
}
