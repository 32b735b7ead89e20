//! Intervals of a law's constants: wider by what the spread between recordings does not show.

use super::fit::Fitted;
use super::kinematics::{Action, Carrier};
use super::law::{Law, PointIs};
use crate::candidate::Variant;
use crate::nonlinear::widening_at;
use crate::options::DiscoverOptions;
use crate::problem::{Domain, Problem};
use crate::repeating::widen;
use crate::result::Estimate;
use crate::session::Session;
use aloft_effects::Target;
use nalgebra::DMatrix;

/// Widens the intervals of a law, coefficients and nonlinear parameters, by the errors that repeat
/// in all recordings, and by a point that was simplified to the link's centre of mass: there it is
/// unknown, too. `others` are the columns of the rest of the model, `whole` those of all of it.
pub(super) fn widened(
    session: &Session<'_>,
    domain: Domain,
    others: &[Vec<DMatrix<f64>>],
    whole: &[Vec<DMatrix<f64>>],
    fitted: &Fitted,
    (coefficients, nonlinear): (&mut [Estimate], &mut [Estimate]),
    options: &DiscoverOptions,
) {
    let (law, theta) = (&fitted.law, &fitted.theta);
    let with_point = with_free_point(law);
    let known = if with_point.is_some() { 3 } else { 0 };
    let law = with_point.as_ref().unwrap_or(law);
    let at: Vec<f64> = law.point.iter().take(known).chain(&fitted.nonlinear).copied().collect();
    let variant = Variant::new(session, law, Target::Body, at);
    let unknown = |_| Estimate { se: f64::NAN, ci95: None, ..coefficients[0].clone() };
    let mut all: Vec<Estimate> = (0..known).map(unknown).chain(nonlinear.iter().cloned()).collect();
    // a draw of the geometry moves the zeros of joints on which the law depends
    let columns = |law: &Law| session.columns(law, Target::Body, &variant.nonlinear, domain);
    let further = |draw: usize| {
        let moved = law.with_zeros(&session.scene.model, session.drawn.zeros.get(draw)?)?;
        let (there, here) = (columns(&moved)?, columns(law)?);
        Some(there.iter().zip(&here).map(|(a, b)| (a - b) * theta).collect())
    };
    // the model identifies the coefficients with the parameters held
    let problem = Problem::if_possible(session, domain, others, options);
    let by = problem.and_then(|problem| widening_at(session, &problem, &variant, theta)).unwrap_or_default();
    for (coefficient, by) in coefficients.iter_mut().zip(by) {
        coefficient.widening = by;
    }
    widen(session, domain, others, whole, &variant, (coefficients, &mut all), &further, options);
    nonlinear.clone_from_slice(&all[known..]);
}

/// The law with an unknown point, if it is a force at a given point of a link.
fn with_free_point(law: &Law) -> Option<Law> {
    let at_link = law.action == Action::Force && law.carrier != Carrier::Body && law.point_is == PointIs::Given;
    at_link.then(|| Law { point_is: PointIs::Free, ..law.clone() })
}
