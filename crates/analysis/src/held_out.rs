//! The error of a model as every surface states it: one error, one floor, one ratio for each kind
//! of motion. `run`, `compare`, `discover`, `history`, the report, exports and all JSON take it
//! from here.

use crate::to_correct::ToCorrect;
use aloft_compare::{AgainstFloor, Grade, Graded, ModelComparison, Reserve, Signal};
use aloft_regressor::limits;
use aloft_regressor::weak_windows::force_scale_n;
use aloft_study::revision::Judged;
use aloft_study::subject_session::SubjectSession;
use serde::{Deserialize, Serialize};

/// Held-out error over weak windows of one kind of motion, beside the noise floor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(from = "Numbers")]
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
    /// Grade of the error beside its floor.
    pub grade: Grade,
    /// Why the grade is worse than the ratio to the floor alone; none if it is not.
    pub because: Option<Reserve>,
    /// The grade in words, as every surface shows it: `at the floor`, `fair: from tables`.
    pub judged: String,
    /// Colour of the grade: `good` for green, `fair` for yellow, `poor` for red.
    pub signal: Signal,
}

/// The numbers of an error, as they are computed and as they are stored. The ratio to the floor and
/// the grade follow from them, so that a stored grade cannot contradict them.
#[derive(Deserialize)]
struct Numbers {
    judged_on: String,
    held_out_error: f64,
    held_out_error_of_weight: Option<f64>,
    held_out_force_n: Option<f64>,
    held_out_moment_nm: Option<f64>,
    tables_error: Option<f64>,
    windows: usize,
    noise_floor: Option<f64>,
    noise_floor_ci95: Option<[f64; 2]>,
    /// The grade that was stored, where something made it worse than the numbers.
    #[serde(default)]
    grade: Option<Grade>,
    #[serde(default)]
    because: Option<Reserve>,
}

impl From<Numbers> for HeldOutError {
    fn from(n: Numbers) -> Self {
        let (error, ci95) = (n.held_out_error, n.noise_floor_ci95);
        let plain = Grade::of(error, n.noise_floor, ci95).plain();
        let worse = n.because.zip(n.grade).filter(|(_, grade)| *grade > plain.grade);
        let mut out = Self {
            judged_on: n.judged_on,
            held_out_error: error,
            held_out_error_of_weight: n.held_out_error_of_weight,
            held_out_force_n: n.held_out_force_n,
            held_out_moment_nm: n.held_out_moment_nm,
            tables_error: n.tables_error,
            windows: n.windows,
            noise_floor: n.noise_floor,
            noise_floor_ci95: ci95,
            times_floor: n.noise_floor.and_then(|f| limits::times_floor(error, f, ci95)),
            at_floor: n.noise_floor.and_then(|f| limits::at_floor(error, f, ci95)),
            grade: plain.grade,
            because: None,
            judged: String::new(),
            signal: plain.signal(),
        };
        out.graded_as(worse.map_or(plain, |(because, grade)| Graded { grade, because: Some(because) }));
        out
    }
}

impl HeldOutError {
    /// From a comparison.
    pub(crate) fn of(a: &AgainstFloor, beside: &[ModelComparison], weight_n: f64) -> Self {
        let tables = beside.iter().find(|m| m.model == "prior").map(|m| match a.judged_on.as_str() {
            "contact" => &m.held_out_weak,
            _ => &m.flight_weak,
        });
        Self::from(Numbers {
            judged_on: a.judged_on.clone(),
            held_out_error: a.held_out_error,
            held_out_error_of_weight: share(a.held_out_error, weight_n),
            held_out_force_n: a.held_out_force_n,
            held_out_moment_nm: a.held_out_moment_nm,
            tables_error: tables.filter(|w| w.windows > 0).map(|w| w.size()),
            windows: a.windows,
            noise_floor: a.floor.map(|f| f.noise_floor),
            noise_floor_ci95: a.floor.and_then(|f| f.ci95),
            grade: None,
            because: None,
        })
    }

    /// From what a revision of the model reached.
    pub(crate) fn of_revision(judged_on: &str, j: &Judged, weight_n: f64) -> Self {
        Self::from(Numbers {
            judged_on: judged_on.to_owned(),
            held_out_error: j.error_n,
            held_out_error_of_weight: share(j.error_n, weight_n),
            held_out_force_n: j.force_n,
            held_out_moment_nm: j.moment_nm,
            tables_error: None,
            windows: j.windows,
            noise_floor: j.noise_n,
            noise_floor_ci95: j.noise_ci95,
            grade: None,
            because: None,
        })
        .at_best(&best_grades(j.gate_passed.unwrap_or(true), None))
    }

    /// Grade, and why it is worse than the ratio alone.
    pub fn graded(&self) -> Graded {
        Graded { grade: self.grade, because: self.because }
    }

    fn graded_as(&mut self, graded: Graded) {
        self.grade = graded.grade;
        self.because = graded.because;
        self.judged = graded.words();
        self.signal = graded.signal();
        // an error that rests on something wrong is at no floor
        self.at_floor = self.at_floor.map(|at| at && graded != Graded::VOID);
    }

    /// The error with a grade no better than these.
    pub(crate) fn at_best(mut self, best: &[Graded]) -> Self {
        self.graded_as(best.iter().fold(self.graded(), |now, best| now.at_best(*best)));
        self
    }
}

/// The best grades that errors may have: behind the gate of the identification, and where something
/// is to be corrected before.
pub(crate) fn best_grades(gate_passed: bool, to_correct: Option<&ToCorrect>) -> Vec<Graded> {
    let gate = (!gate_passed).then_some(Graded::FROM_TABLES);
    let correct = to_correct.and_then(|c| match (c.void, c.first) {
        (true, _) => Some(Graded::VOID),
        (false, true) => Some(Graded::CORRECT_FIRST),
        (false, false) => None,
    });
    gate.into_iter().chain(correct).collect()
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

    fn near_its_floor(held_out_error: f64) -> HeldOutError {
        HeldOutError::from(Numbers {
            judged_on: "flight".to_owned(),
            held_out_error,
            held_out_error_of_weight: None,
            held_out_force_n: None,
            held_out_moment_nm: None,
            tables_error: None,
            windows: 20,
            noise_floor: Some(5.7),
            noise_floor_ci95: Some([4.5, 7.3]),
            grade: None,
            because: None,
        })
    }

    #[test]
    fn an_error_near_its_floor_that_is_not_trusted_says_why() {
        let judged = |error: f64, gate, first, void| {
            let c = ToCorrect { words: String::new(), first, void, offered: false };
            let e = near_its_floor(error).at_best(&best_grades(gate, Some(&c)));
            (e.judged, e.at_floor)
        };
        assert_eq!(judged(5.8, true, false, false), ("at the floor".to_owned(), Some(true)));
        assert_eq!(judged(5.8, false, false, false), ("fair: from tables".to_owned(), Some(true)));
        assert_eq!(judged(5.8, true, true, false), ("fair: correct first".to_owned(), Some(true)));
        assert_eq!(judged(5.8, true, true, true), ("poor: correct first".to_owned(), Some(false)));
        assert_eq!(judged(5.8, false, true, true), ("poor: correct first".to_owned(), Some(false)));
        assert_eq!(judged(580.0, false, true, true), ("poor".to_owned(), Some(false)));
    }

    /// Answers of `discover` keep errors: also those that an older program wrote, without a grade.
    #[test]
    fn a_stored_error_has_the_grade_of_its_numbers() {
        for error in [3.0, 5.8, 8.0, 12.0, 40.0] {
            for best in [&[][..], &[Graded::FROM_TABLES], &[Graded::CORRECT_FIRST], &[Graded::VOID]] {
                let own = near_its_floor(error).at_best(best);
                let mut stored = serde_json::to_value(&own).unwrap();
                assert_eq!(serde_json::from_value::<HeldOutError>(stored.clone()).unwrap(), own);
                for key in ["grade", "because", "judged", "signal"] {
                    stored.as_object_mut().unwrap().remove(key);
                }
                assert_eq!(serde_json::from_value::<HeldOutError>(stored).unwrap(), near_its_floor(error));
            }
        }
    }
}
