//! Whether sizes from flights and contact together replace those from flights.
//!
//! Errors that repeat in every jump (soft tissue, geometry) become part of sizes from flights. What
//! always acts also shows in contact, where the plates measure it with less noise and in other
//! postures. Where contact has errors of its own (a wrong mass, plates that are wrong), sizes from
//! both predict worse, and those from flights stay.

use crate::held_out::HeldOutResult;

/// Product of the ratios of error in flight and in contact, sizes from both over sizes from
/// flights, above which those from both are not taken.
const AS_GOOD: f64 = 1.02;
/// Ratio of the errors in flight or in contact alone above which they are not taken, unless the
/// error stays at its floor.
const LOST: f64 = 1.05;

/// True if a model with sizes from flights and contact predicts recordings that were left out as
/// well as one with sizes from flights; errors in flight and in contact.
pub(super) fn predicts_as_well(flights: [Option<HeldOutResult>; 2], both: [Option<HeldOutResult>; 2]) -> bool {
    let ([Some(a), Some(b)], [Some(c), Some(d)]) = (flights, both) else { return false };
    let ratio = |before: &HeldOutResult, after: &HeldOutResult| after.held_out_error / before.held_out_error;
    let kept = |before, after: &HeldOutResult| ratio(before, after) <= LOST || after.reached_by(after.held_out_error);
    kept(&a, &c) && kept(&b, &d) && ratio(&a, &c) * ratio(&b, &d) <= AS_GOOD
}

#[cfg(test)]
mod tests {
    use super::*;

    fn errors(flight: f64, contact: f64) -> [Option<HeldOutResult>; 2] {
        [(flight, 10.0), (contact, 4.0)].map(|(held_out_error, noise_floor)| {
            Some(HeldOutResult {
                held_out_error,
                noise_floor,
                noise_floor_ci95: Some([0.7 * noise_floor, 1.4 * noise_floor]),
                by_parameters: None,
            })
        })
    }

    #[test]
    fn sizes_from_both_have_to_predict_as_well() {
        // contact becomes much better, flights stay at their floor
        assert!(predicts_as_well(errors(11.9, 13.3), errors(12.8, 4.5)));
        // nothing changes: the sizes are from more recordings
        assert!(predicts_as_well(errors(20.0, 9.0), errors(20.1, 9.0)));
        // contact becomes better at the cost of flights
        assert!(!predicts_as_well(errors(20.0, 13.3), errors(30.0, 12.0)));
        assert!(!predicts_as_well(errors(20.0, 13.3), errors(22.0, 6.0)));
        // flights become better at the cost of contact
        assert!(!predicts_as_well(errors(20.0, 9.0), errors(15.0, 9.9)));
        // both become a little worse
        assert!(!predicts_as_well(errors(11.0, 4.0), errors(11.3, 4.1)));
        assert!(!predicts_as_well(errors(11.0, 4.0), errors(f64::NAN, 3.0)));
    }
}
