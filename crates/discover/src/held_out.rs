//! Held-out error and noise floor from a comparison, and the limits of their ratio.

use aloft_regressor::limits::is_undecided;
use aloft_regressor::{FAIR_TIMES_FLOOR, POOR_TIMES_FLOOR};

/// Ratio of error to floor that counts as at the floor where the interval of the floor is narrower.
const NEAR_TIMES_FLOOR: f64 = 1.1;
/// Ratio from which the search beyond the catalogue begins.
const WORTH_A_SEARCH: f64 = 1.2;
/// Share of the error above the floor (mean squares) that effects may leave and still count as its
/// cause. On sets for development, effects of the catalogue leave none on chains (44 sets at 1.5 to
/// 8 times the error of the true model) and up to 0.7 % where the body is a person or the drag acts
/// on whole surfaces; laws of another form that were named after an effect leave 0.6 to 8 %.
pub(crate) const LACK_OF_FIT: f64 = 0.01;

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

    /// Share of the error above the floor, mean square, that `after` leaves of this error; zero
    /// where `after` is within the floor's interval, or this error too near it to tell. The upper
    /// end of that interval counts as the floor, so that the share is a lower limit.
    pub(crate) fn share_left(&self, after: &Self) -> f64 {
        let most = self.most(f64::INFINITY).max(NEAR_TIMES_FLOOR * self.noise_floor);
        let above = |error: f64| error * error - most * most;
        if self.noise_floor > 0.0 && self.held_out_error > FAIR_TIMES_FLOOR * most {
            (above(after.held_out_error) / above(self.held_out_error)).max(0.0)
        } else {
            0.0
        }
    }

    /// True if the error is beyond the floor's interval and more than 1.2 times the floor: enough
    /// for a search beyond the catalogue.
    pub(crate) fn may_hold_more(&self) -> bool {
        self.noise_floor > 0.0 && !self.reached_by(self.held_out_error) && self.times_floor() > WORTH_A_SEARCH
    }

    /// True if the error is within the floor's interval and more than 1.2 times the floor: where
    /// the interval is wide, a law may be hidden there.
    pub(crate) fn may_hide_more(&self) -> bool {
        self.reached_by(self.held_out_error) && self.times_floor() > WORTH_A_SEARCH
    }

    /// True if the error is beyond the floor's interval and 1.1 times the floor, but not by enough
    /// that something must be missing ([`is_above`](Self::is_above)): a small effect or the errors
    /// of the parameters may be the reason.
    pub(crate) fn is_between(&self) -> bool {
        let beyond = self.noise_floor_ci95.is_some_and(|ci| self.held_out_error > ci[1]);
        beyond && self.times_floor() > NEAR_TIMES_FLOOR && !self.is_above()
    }

    /// True if the error exceeds 1.2 times the floor, the upper end of the floor's interval, and
    /// what the errors of the parameters account for, by more than 1 % (mean squares) of what
    /// effects removed of the error `before`, N.
    pub(crate) fn is_not_reached_from(&self, before: f64) -> bool {
        let most = self.most(f64::INFINITY).max(WORTH_A_SEARCH * self.noise_floor);
        let [left, removed] = [(self.held_out_error, most), (before, self.held_out_error)].map(|(a, b)| a * a - b * b);
        self.noise_floor > 0.0 && left > LACK_OF_FIT * removed.max(0.0)
    }

    /// True if the error exceeds 1.5 times the floor, the upper end of the floor's interval, and
    /// what the errors of the parameters account for: too much for a body of which nothing is
    /// missing (0.7 to 1.3 times the floor in simulations).
    pub fn is_above(&self) -> bool {
        let most = self.most(f64::INFINITY).max(FAIR_TIMES_FLOOR * self.noise_floor);
        self.noise_floor > 0.0 && self.held_out_error > most
    }

    /// True if the error exceeds three times the floor, the upper end of the floor's interval, and
    /// what the errors of the parameters account for.
    pub(crate) fn is_far(&self) -> bool {
        let most = self.most(0.0).max(POOR_TIMES_FLOOR * self.noise_floor);
        self.noise_floor > 0.0 && most.is_finite() && self.held_out_error > most
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Effects on a rigid body reach the floor's interval, 1.2 floors, or what the errors of the
    /// parameters account for.
    #[test]
    fn a_floor_is_reached_within_its_interval_and_what_parameters_leave() {
        let of = |held_out_error, ci, by_parameters| {
            let noise_floor_ci95 = Some([0.8, ci]);
            HeldOutResult { held_out_error, noise_floor: 1.0, noise_floor_ci95, by_parameters }.is_not_reached_from(2.0)
        };
        assert!(of(1.25, 1.15, None));
        assert!(!of(1.18, 1.15, None));
        assert!(!of(1.25, 1.3, None));
        assert!(!of(1.25, 1.15, Some(1.4)) && of(1.45, 1.15, Some(1.4)));
        let unknown =
            HeldOutResult { held_out_error: 9.0, noise_floor: 1.0, noise_floor_ci95: None, by_parameters: None };
        assert!(!unknown.is_not_reached_from(20.0));
        // of an effect that raises the error to 44 times the floor, 2.2 floors are little
        let strong = HeldOutResult { held_out_error: 2.2, noise_floor_ci95: Some([0.8, 1.2]), ..unknown };
        assert!(!strong.is_not_reached_from(44.0) && strong.is_not_reached_from(10.0));
    }
}
