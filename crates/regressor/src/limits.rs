//! Ratios of a held-out error to its noise floor at which it is judged. Text, report, JSON and the
//! verdicts of a discovery use these.

/// Ratio of error to floor from which an error is no longer good where the floor has no interval.
/// Simulated bodies with nothing hidden reach 0.7 to 1.3.
pub const FAIR_TIMES_FLOOR: f64 = 1.5;
/// Ratio from which it is poor: above three times the floor an error is unexplained.
pub const POOR_TIMES_FLOOR: f64 = 3.0;
/// Upper end of the floor's interval over the floor up to which the floor is known well enough to
/// call an error good: beyond it, an error within the interval could as well be poor.
pub const FLOOR_KNOWN_WITHIN: f64 = POOR_TIMES_FLOOR;

/// True if an error lies within the interval of a floor that is known too roughly to judge it.
pub fn is_undecided(error: f64, floor: f64, ci95: Option<[f64; 2]>) -> bool {
    ci95.is_some_and(|[_, most]| error <= most && most > FLOOR_KNOWN_WITHIN * floor)
}

/// Error over floor; none where the floor is known too roughly to judge the error.
pub fn times_floor(error: f64, floor: f64, ci95: Option<[f64; 2]>) -> Option<f64> {
    Some(error / floor).filter(|t| t.is_finite() && !is_undecided(error, floor, ci95))
}

/// True if the error is not above the floor's interval, so that a perfect model could have left it;
/// none without interval, or where the floor is known too roughly to judge the error.
pub fn at_floor(error: f64, floor: f64, ci95: Option<[f64; 2]>) -> Option<bool> {
    ci95.filter(|_| !is_undecided(error, floor, ci95)).map(|[_, most]| error <= most)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_floor_that_is_hardly_known_judges_only_what_is_beyond_it() {
        let (sharp, vague) = (Some([0.8, 1.3]), Some([0.2, 5.0]));
        assert_eq!((times_floor(1.2, 1.0, sharp), at_floor(1.2, 1.0, sharp)), (Some(1.2), Some(true)));
        assert_eq!((times_floor(4.0, 1.0, sharp), at_floor(4.0, 1.0, sharp)), (Some(4.0), Some(false)));
        assert_eq!((times_floor(1.2, 1.0, vague), at_floor(1.2, 1.0, vague)), (None, None));
        assert_eq!((times_floor(4.9, 1.0, vague), at_floor(4.9, 1.0, vague)), (None, None));
        assert_eq!((times_floor(6.0, 1.0, vague), at_floor(6.0, 1.0, vague)), (Some(6.0), Some(false)));
        assert_eq!((times_floor(1.2, 1.0, None), at_floor(1.2, 1.0, None)), (Some(1.2), None));
    }
}
