//! Laws that act late: a force that follows the motion as it was a delay earlier, as that of a
//! controller, a hose or a flow that has to build up.
//!
//! A law is tried as it is and with a free curve of its variable at several delays. Where one of
//! them leaves clearly less than no delay does, the shapes of a law are fitted with the delay free.

use super::atlas::{ENDS, PlaceFrames};
use super::fit::{self, Fitted, STEPS};
use super::kinematics::Variable;
use super::law::{Factor, Law};
use super::shape::Shape;
use crate::problem::Problem;
use crate::progress::Until;
use crate::session::Session;
use rayon::prelude::*;

/// Delays that are tried, s.
const DELAYS_S: [f64; 7] = [0.02, 0.04, 0.06, 0.09, 0.13, 0.18, 0.24];
/// A delay has to leave less than this share of the squared error of the law and of what is tried,
/// the law as it is or a curve, without a delay.
const WORTH: f64 = 0.85;
/// Shapes that are fitted with the delay free.
const SHAPES: usize = 4;

/// Steps of [`delayed`] that are counted: the most that one law takes where no delay is worth more.
/// What goes beyond is added as it is done.
pub(super) const LATE_STEPS: usize = 3 * DELAYS_S.len();

/// True for a law of one variable of the motion that follows it at once.
pub(super) fn may_be_late(law: &Fitted) -> bool {
    let of_motion =
        |v: Variable| !matches!(v, Variable::None | Variable::Clock | Variable::SinceTakeOff | Variable::Distance);
    let law = &law.law;
    !law.delayed && !law.has_anchor() && matches!(&law.factors[..], [only] if of_motion(only.variable))
}

/// Laws of the place and direction of `law` with a delay, best first; none if it may not be late,
/// or a delay explains little more. The variable is that of `law`, or the magnitude of what its
/// direction follows: without the delay another variable can describe the force better.
pub(super) fn delayed(session: &Session<'_>, problem: &Problem, law: &Fitted, until: &Until) -> Vec<Fitted> {
    let [factor] = &law.law.factors[..] else { return Vec::new() };
    let magnitude = law.law.direction.magnitude().filter(|m| *m != factor.variable).and_then(|variable| {
        let (point, anchor, _) = law.law.divided(&law.nonlinear);
        let range = PlaceFrames::new(session, law.law.carrier, &point).range(variable, &anchor, ENDS)?;
        Some(Factor { variable, range, ..factor.clone() })
    });
    let each =
        std::iter::once(factor.clone()).chain(magnitude).flat_map(|f| of_variable(session, problem, law, &f, until));
    let mut out: Vec<Fitted> = each.collect();
    out.sort_by(|a, b| a.error().total_cmp(&b.error()));
    out
}

/// Laws with a delay of the place and direction of `law` and the variable of `factor`.
fn of_variable(session: &Session<'_>, problem: &Problem, law: &Fitted, factor: &Factor, until: &Until) -> Vec<Fitted> {
    let place = &law.nonlinear[..law.law.point_is.unknowns()];
    let start = |shape: Shape, parameters: &[f64], delay: f64| {
        let factors = vec![Factor { shape, fixed: None, ..factor.clone() }];
        let with = Law { factors, delayed: true, ..law.law.clone() };
        (with, [place, parameters, &[delay]].concat())
    };
    let fitted = |(law, start): (Law, Vec<f64>), steps| {
        if until.is_over() { None } else { fit::fit(session, problem, &law, start, steps) }
    };
    // the delay at which the law as it is, or a free curve, leaves the least
    let (_, _, parts) = law.law.divided(&law.nonlinear);
    let own = law.law.parameters_of(&parts)[0];
    let as_it_is = (factor.variable == law.law.factors[0].variable).then_some((factor.shape, own));
    let least = |(shape, parameters): (Shape, &[f64])| {
        let error = |delay: f64| {
            let made = fitted(start(shape, parameters, delay), 0).map(|f| (delay, f.error()));
            session.counter.one();
            made
        };
        let each: Vec<(f64, f64)> = DELAYS_S.into_par_iter().filter_map(error).collect();
        let plain = Law { delayed: false, ..start(shape, parameters, 0.0).0 };
        let at_once = fitted((plain, [place, parameters].concat()), 0).map_or(f64::INFINITY, |f| f.error());
        let at_once = at_once.min(law.error());
        each.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, e)| *e < WORTH * at_once)
    };
    let best = as_it_is.into_iter().chain([(Shape::Curve, &[][..])]).filter_map(least);
    let Some((delay, _)) = best.min_by(|a, b| a.1.total_cmp(&b.1)) else { return Vec::new() };
    let shapes = Shape::of(factor.variable.is_signed(), false, false);
    let best_start = |shape: Shape| {
        session.counter.one();
        let starts = shape.starts(factor.range, false);
        let each = starts.iter().filter_map(|p| fitted(start(shape, p, delay), 0));
        each.min_by(|a, b| a.error().total_cmp(&b.error()))
    };
    let plain = shapes.into_par_iter().filter(|s| !matches!(s, Shape::Sine | Shape::Wave));
    let mut screened: Vec<Fitted> = plain.filter_map(best_start).collect();
    screened.sort_by(|a, b| a.error().total_cmp(&b.error()));
    screened.truncate(SHAPES);
    let fitted_free = |s: Fitted| {
        let made = fitted((s.law, s.nonlinear), STEPS);
        session.counter.one();
        made
    };
    screened.into_par_iter().filter_map(fitted_free).collect()
}
