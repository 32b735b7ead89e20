//! The error of a model as every surface states it: one error, one floor, one ratio for each kind
//! of motion. `run`, `compare`, `discover`, `history`, the report, exports and all JSON take it
//! from here.

use aloft_compare::{AgainstFloor, ModelComparison, POOR_TIMES_FLOOR, Signal};
use aloft_regressor::weak_windows::force_scale_n;
use aloft_study::revision::Judged;
use aloft_study::subject_session::SubjectSession;
use serde::{Deserialize, Serialize};

/// Judgement of an error near its floor that is not trusted: the plates weigh the body at another
/// mass than the stated one, and every error in newtons scales with the mass.
const DISTRUSTED: &str = "poor: correct first";

/// Held-out error over weak windows of one kind of motion, beside the noise floor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeldOutError {
    /// `flight` or `contact`.
    pub judged_on: String,
    /// Held-out error over weak windows, N: root mean square of the force, with the moment over a
    /// lever of 0.1 m.
    pub held_out_error: f64,
    /// The same as a share of the body's weight.
    pub held_out_error_of_weight: Option<f64>,
    /// The force alone, N.
    pub held_out_force_n: Option<f64>,
    /// The moment alone, N·m.
    pub held_out_moment_nm: Option<f64>,
    /// Held-out error that the table's body (the prior) leaves in the same windows, N.
    pub tables_error: Option<f64>,
    /// Number of windows.
    pub windows: usize,
    /// Noise floor, N: the held-out error that a perfect model would leave.
    pub noise_floor: Option<f64>,
    /// 95 % interval of the noise floor, N: the range in which the error of a perfect model falls.
    pub noise_floor_ci95: Option<[f64; 2]>,
    /// Held-out error divided by the noise floor.
    pub times_floor: Option<f64>,
    /// True if the held-out error is not above the interval of the noise floor.
    pub at_floor: Option<bool>,
    /// Judgement by the ratio to the floor; at best `fair` where the gate did not pass.
    pub signal: Signal,
}

impl HeldOutError {
    /// From a comparison; `gate` tells whether the parameters passed their gate.
    pub(crate) fn of(a: &AgainstFloor, beside: &[ModelComparison], weight_n: f64, gate: bool) -> Self {
        let tables = beside.iter().find(|m| m.model == "prior").map(|m| match a.judged_on.as_str() {
            "contact" => &m.held_out_weak,
            _ => &m.flight_weak,
        });
        Self {
            judged_on: a.judged_on.clone(),
            held_out_error: a.held_out_error,
            held_out_error_of_weight: share(a.held_out_error, weight_n),
            held_out_force_n: a.held_out_force_n,
            held_out_moment_nm: a.held_out_moment_nm,
            tables_error: tables.filter(|w| w.windows > 0).map(|w| w.size()),
            windows: a.windows,
            noise_floor: a.floor.map(|f| f.noise_floor),
            noise_floor_ci95: a.floor.and_then(|f| f.ci95),
            times_floor: a.times_floor,
            at_floor: a.at_floor,
            signal: a.signal().behind_gate(gate),
        }
    }

    /// The judgement in words, as every surface prints it: `at the floor`, `fair`, `poor`. An error
    /// that is poor only because of what it rests on says so; so does one that a perfect model
    /// would hardly reach.
    pub fn judged(&self) -> &'static str {
        if self.signal == Signal::Good && self.noise_floor_ci95.is_some_and(|ci| self.held_out_error < ci[0]) {
            return "below the floor";
        }
        let near = self.times_floor.is_some_and(|times| times < POOR_TIMES_FLOOR);
        if near && self.signal == Signal::Poor { DISTRUSTED } else { self.signal.in_words(self.at_floor) }
    }

    /// Judges the error as poor: something that it rests on is known to be wrong.
    pub(crate) fn distrust(&mut self) {
        self.signal = Signal::Poor;
        self.at_floor = self.at_floor.map(|_| false);
    }

    /// From what a revision of the model reached.
    pub(crate) fn of_revision(judged_on: &str, j: &Judged, weight_n: f64) -> Self {
        Self {
            judged_on: judged_on.to_owned(),
            held_out_error: j.error_n,
            held_out_error_of_weight: share(j.error_n, weight_n),
            held_out_force_n: j.force_n,
            held_out_moment_nm: j.moment_nm,
            tables_error: None,
            windows: j.windows,
            noise_floor: j.noise_n,
            noise_floor_ci95: j.noise_ci95,
            times_floor: j.times_floor(),
            at_floor: j.at_floor(),
            signal: Signal::of(j.times_floor(), j.at_floor()).behind_gate(j.gate_passed.unwrap_or(true)),
        }
    }
}

fn share(error_n: f64, weight_n: f64) -> Option<f64> {
    Some(error_n / weight_n).filter(|s| s.is_finite())
}

/// The body's weight, N, to which errors are related.
pub fn weight_n(session: &SubjectSession) -> f64 {
    force_scale_n(session.facts.person.mass_kg, session.facts.gravity_mps2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_near_its_floor_that_is_not_trusted_says_why() {
        let mut error = HeldOutError {
            judged_on: "flight".to_owned(),
            held_out_error: 5.8,
            held_out_error_of_weight: None,
            held_out_force_n: None,
            held_out_moment_nm: None,
            tables_error: None,
            windows: 20,
            noise_floor: Some(5.7),
            noise_floor_ci95: Some([4.5, 7.3]),
            times_floor: Some(1.0),
            at_floor: Some(true),
            signal: Signal::Good,
        };
        assert_eq!(error.judged(), "at the floor");
        error.distrust();
        assert_eq!(error.judged(), "poor: correct first");
        error.times_floor = Some(96.0);
        assert_eq!(error.judged(), "poor");
    }
}
