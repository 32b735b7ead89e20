//! Ratios of a held-out error to its noise floor at which it is judged. Text, report, JSON and the
//! verdicts of a discovery use these.

/// Ratio of error to floor from which an error is no longer good where the floor has no interval.
/// Simulated bodies with nothing hidden reach 0.7 to 1.3.
pub const FAIR_TIMES_FLOOR: f64 = 1.5;
/// Ratio from which it is poor: above three times the floor an error is unexplained.
pub const POOR_TIMES_FLOOR: f64 = 3.0;
