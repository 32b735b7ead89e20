//! Sizes of effects from flights and contact together.
//!
//! The rounds fit effects that act in flight to flights alone. Errors that repeat in every jump
//! (soft tissue, geometry) then become part of their sizes and directions. A force that always
//! acts also shows in contact, where the plates measure it with less noise and in other postures.
//! The effects found are therefore fitted once more to flights and contact together, and their
//! model is computed by all stages with contact in the identification. It replaces the model from
//! flights if it predicts recordings that were left out as well or better, in flight and in
//! contact. Where contact has errors of its own (a wrong mass, plates that are wrong), it does not,
//! and the sizes from flights stay.

use crate::by_stages::Staged;
use crate::candidate::Variant;
use crate::conclude::widen_one;
use crate::held_out::HeldOutResult;
use crate::ladder::{as_found, extra_columns, sharpened};
use crate::nonlinear::{fitted, improve, score_fitted};
use crate::options::DiscoverOptions;
use crate::problem::{Domain, Problem};
use crate::result::{Estimate, Found};
use crate::session::Session;
use aloft_effects::EffectInstance;

/// Steps of the nonlinear unknowns from their values in flight.
const STEPS: usize = 6;
/// Product of the ratios of error in flight and in contact, sizes from both over sizes from
/// flights, above which those from both are not taken.
const AS_GOOD: f64 = 1.02;
/// Ratio of the errors in flight or in contact alone above which they are not taken, unless the
/// error stays at its floor.
const LOST: f64 = 1.05;

/// Factor of the standard errors for errors of contact that repeat in every recording and that no
/// draw holds, such as skin that moves the same way in every stance. Set on 16 coefficients of
/// known size, whose errors were 1.4 times what their standard errors without it account for.
const NOT_DRAWN: f64 = 1.5;

/// An estimate whose error also holds these.
fn with_errors_of_contact(e: &Estimate) -> Estimate {
    Estimate { widening: NOT_DRAWN * e.widening, ..e.clone().with_error(NOT_DRAWN * e.se, e.freedom) }
}

/// The effects with sizes from flights and contact, and their model.
pub(crate) struct SizedByBoth<'a> {
    pub kept: Vec<Variant<'a>>,
    pub found: Vec<Found>,
    pub staged: Staged,
}

/// True for an effect that acts in flight and in contact.
fn always_acts(variant: &Variant<'_>) -> bool {
    variant.effect.acts().in_flight() && variant.effect.acts().in_contact()
}

/// The effects found with sizes from flights and contact, if this model predicts as well as
/// `from_flights`; none otherwise.
pub(crate) fn by_both<'a>(
    session: &Session<'_>,
    accepted: &[EffectInstance<'_>],
    kept: &[Variant<'a>],
    found: &[Found],
    from_flights: &Staged,
    options: &DiscoverOptions,
) -> Option<SizedByBoth<'a>> {
    from_flights.errors[1]?;
    let always: Vec<usize> = (0..kept.len()).filter(|i| always_acts(&kept[*i])).collect();
    if always.is_empty() {
        return None;
    }
    let beside_others = |kept: &[Variant<'_>], i: usize| {
        let mut others = kept.to_vec();
        others.remove(i);
        let of = |v: &[Variant<'_>]| extra_columns(session, Domain::Both, accepted, v, &[]);
        let (rest, whole) = (of(&others), of(kept));
        let problem = Problem::if_possible(session, Domain::Both, &rest, options)?;
        session.or_named(sharpened(session, &problem, &rest, &whole, options))
    };
    let mut out = SizedByBoth { kept: kept.to_vec(), found: found.to_vec(), staged: Staged::default() };
    for &i in &always {
        if !found[i].nonlinear.is_empty() {
            let problem = beside_others(&out.kept, i)?;
            out.kept[i] = improve(session, &problem, &kept[i], STEPS)?.0;
        }
    }
    for &i in &always {
        let problem = beside_others(&out.kept, i)?;
        let scored = if found[i].nonlinear.is_empty() {
            fitted(session, &problem, &out.kept[i])?
        } else {
            score_fitted(session, &problem, out.kept[i].clone())?
        };
        let also_on = std::mem::take(&mut out.found[i].also_on);
        out.found[i] = Found { also_on, sized_with_contact: true, ..as_found(session, &scored) };
        widen_one(session, Domain::Both, accepted, &out.kept, i, &mut out.found[i], options);
        let its = &mut out.found[i];
        its.coefficients.iter_mut().chain(&mut its.nonlinear).for_each(|e| *e = with_errors_of_contact(e));
    }
    out.staged = session.by_stages.with(&out.found)?;
    predicts_as_well(from_flights.errors, out.staged.errors).then_some(out)
}

/// True if a model with sizes from flights and contact predicts recordings that were left out as
/// well as one with sizes from flights; errors in flight and in contact.
pub(crate) fn predicts_as_well(flights: [Option<HeldOutResult>; 2], both: [Option<HeldOutResult>; 2]) -> bool {
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
