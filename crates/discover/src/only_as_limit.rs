//! Rivals that fit only as the limit of a simpler effect.
//!
//! A rope to a distant pulley, or a strong wind on a small area, is a constant force: a richer
//! effect reproduces a simpler one by moving a place or a speed to the edge of its range. Both
//! leave the same error then, whichever is true, and no ratio of errors separates them. The
//! recordings still say whether a place or speed that a laboratory has would do: the richer effect
//! is fitted again within the nearer half of the range. If that is worse by more than chance, what
//! remains of the richer effect is the simpler one under another name. That the recordings do not
//! show its place is no reason: of a true crane they may show as little.

use crate::candidate::{Scored, Variant};
use crate::ladder::is_at_bound;
use crate::limits::SAME;
use crate::nonlinear::{FULL_STEPS, best_starts, improve, score_fitted};
use crate::options::DiscoverOptions;
use crate::problem::Problem;
use crate::result::Estimate;
use crate::rivals::Rival;
use crate::session::Session;
use crate::statistics::sign_flip_p;
use aloft_body::Phi;
use aloft_effects::{About, Coefficient, Columns, Effect, NonlinearParameter, ParameterKind, Scene, Series, Target};
use nalgebra::Vector3;

/// Number of starts that are fitted, besides that of the fit in the whole range.
const STARTS: usize = 3;

/// An effect whose places and vectors in the world keep to the nearer half of their range.
struct Nearer<'a>(&'a dyn Effect);

impl Effect for Nearer<'_> {
    fn about(&self) -> About<'_> {
        self.0.about()
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        self.0.targets(scene)
    }
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient> {
        self.0.coefficients(scene, target)
    }
    fn nonlinear(&self, scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
        let mut out = self.0.nonlinear(scene, target);
        for p in out.iter_mut().filter(|p| is_far(p)) {
            let (middle, half) = (0.5 * (p.lower + p.upper), 0.25 * (p.upper - p.lower));
            (p.lower, p.upper) = (middle - half, middle + half);
        }
        out
    }
    fn has_wrench(&self) -> bool {
        self.0.has_wrench()
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, nonlinear: &[f64], out: &mut Columns) {
        self.0.evaluate(series, target, nonlinear, out);
    }
    fn inertia(&self, scene: &Scene, target: Target, nonlinear: &[f64]) -> Option<Vec<Vec<Phi>>> {
        self.0.inertia(scene, target, nonlinear)
    }
}

/// True for an unknown that may go far away: a place or a vector in the world.
fn is_far(p: &NonlinearParameter) -> bool {
    matches!(p.kind, ParameterKind::PointInWorld(_) | ParameterKind::VectorInWorld(_))
}

/// True if a place or a vector in the world was fitted at the edge of its range: no place or speed
/// that a laboratory has fits.
pub(crate) fn is_at_far_edge(session: &Session<'_>, variant: &Variant<'_>) -> bool {
    let bounds = variant.effect.nonlinear(session.scene, variant.target);
    let fitted = variant.fitted > 0;
    fitted && variant.nonlinear.iter().zip(&bounds).any(|(x, b)| is_far(b) && is_at_bound(*x, [b.lower, b.upper]))
}

/// True if a place or a vector in the world was fitted beyond the nearer half of its range: there
/// are few such places in a laboratory, and a law of another form may be what acts.
pub(crate) fn is_far_away(session: &Session<'_>, variant: &Variant<'_>) -> bool {
    let bounds = variant.effect.nonlinear(session.scene, variant.target);
    let beyond = |x: &f64, b: &NonlinearParameter| {
        let (middle, half) = (0.5 * (b.lower + b.upper), 0.25 * (b.upper - b.lower));
        (x - middle).abs() > half
    };
    variant.fitted > 0 && variant.nonlinear.iter().zip(&bounds).any(|(x, b)| is_far(b) && beyond(x, b))
}

/// The delay, s, at which a resistance in still air looks like the velocity of the world that was
/// fitted, a wind, in free flight; none if the wind is nearer to level than to straight down. The
/// velocity of a moment ago differs from that of now by the acceleration of the fall.
fn as_delay(session: &Session<'_>, variant: &Variant<'_>) -> Option<f64> {
    let mut velocity = Vector3::zeros();
    let bounds = variant.effect.nonlinear(session.scene, variant.target);
    for (x, b) in variant.nonlinear.iter().zip(&bounds) {
        if let (ParameterKind::VectorInWorld(axis), "m/s") = (b.kind, b.unit.as_str()) {
            velocity[axis] = *x;
        }
    }
    let gravity = session.scene.model.gravity_mps2;
    let down = velocity.dot(&gravity) / gravity.norm();
    let is_steep = variant.fitted > 0 && down > 0.0 && 2.0 * down * down > velocity.norm_squared();
    is_steep.then(|| down / gravity.norm())
}

/// True if a wind was fitted that blows down more than along the ground: a law that acts late may
/// be what acts.
pub(crate) fn may_be_late(session: &Session<'_>, variant: &Variant<'_>) -> bool {
    as_delay(session, variant).is_some()
}

/// The delay, s, of a resistance that flights hardly tell from a wind straight down: one whose
/// level components may be zero, and whose other one may not. `nonlinear` are the estimates of the
/// effect's nonlinear unknowns.
pub(crate) fn delay_or_wind(session: &Session<'_>, variant: &Variant<'_>, nonlinear: &[Estimate]) -> Option<f64> {
    /// Share of gravity along an axis above which the axis is not level.
    const LEVEL: f64 = 0.1;
    let delay = as_delay(session, variant)?;
    let down = session.scene.model.gravity_mps2.normalize();
    let bounds = variant.effect.nonlinear(session.scene, variant.target);
    let straight = bounds.iter().zip(nonlinear).all(|(b, e)| match (b.kind, b.unit.as_str()) {
        (ParameterKind::VectorInWorld(axis), "m/s") => {
            let may_be_zero = e.ci95.is_none_or(|[low, high]| low <= 0.0 && 0.0 <= high);
            may_be_zero == (down[axis].abs() < LEVEL)
        }
        _ => true,
    });
    straight.then_some(delay)
}

/// True if the interval of a place in the world reaches beyond the range in which it is sought: the
/// recordings do not show where it is, and a law of another form may be what acts. `nonlinear` are
/// the estimates of the effect's nonlinear unknowns.
pub(crate) fn has_unknown_place(session: &Session<'_>, variant: &Variant<'_>, nonlinear: &[Estimate]) -> bool {
    let bounds = variant.effect.nonlinear(session.scene, variant.target);
    let beyond =
        |b: &NonlinearParameter, e: &Estimate| e.ci95.is_none_or(|[low, high]| low < b.lower || high > b.upper);
    let place = |b: &NonlinearParameter| matches!(b.kind, ParameterKind::PointInWorld(_));
    bounds.iter().zip(nonlinear).any(|(b, e)| place(b) && beyond(b, e))
}

/// True if `rival` becomes `simple` in its limit, and within the nearer half of its range it is
/// worse by more than chance and repeating errors explain.
pub(crate) fn is_only_a_limit(
    session: &Session<'_>,
    problem: &Problem,
    simple: &Rival<'_>,
    rival: &Rival<'_>,
    options: &DiscoverOptions,
) -> bool {
    let becomes = rival.scored.variant.effect.about().becomes;
    if !becomes.contains(&simple.id()) || rival.scored.variant.unknowns() <= simple.scored.variant.unknowns() {
        return false;
    }
    let Some(near) = fitted_nearer(session, problem, &rival.scored.variant) else { return false };
    let ratio = (simple.error() / near.iter().sum::<f64>()).sqrt();
    // on a person errors repeat from trial to trial, and a small lead is no evidence
    let most = if session.prior.is_some() { SAME[1] } else { 1.0 };
    ratio < most && sign_flip_p(&simple.fold_error, &near, 2000, options.seed ^ 0x11a7) < options.significance
}

/// Squared error by fold of an effect fitted within the nearer half of its range, from the place of
/// the fit in the whole range and from the best of its own starts.
fn fitted_nearer(session: &Session<'_>, problem: &Problem, variant: &Variant<'_>) -> Option<Vec<f64>> {
    let nearer = Nearer(variant.effect);
    let bounds = nearer.nonlinear(session.scene, variant.target);
    let inside = |p: &[f64]| -> Vec<f64> { p.iter().zip(&bounds).map(|(x, b)| x.clamp(b.lower, b.upper)).collect() };
    // a place keeps its direction
    let scaled: Vec<f64> = variant
        .nonlinear
        .iter()
        .zip(&bounds)
        .map(|(x, b)| {
            let middle = 0.5 * (b.lower + b.upper);
            if is_far(b) { middle + 0.5 * (x - middle) } else { *x }
        })
        .collect();
    let at = |p: &[f64]| Variant { effect: &nearer, nonlinear: inside(p), fitted: 0, ..variant.clone() };
    let own: Vec<Variant<'_>> = variant.effect.starts(session.scene, variant.target).iter().map(|p| at(p)).collect();
    let own = best_starts(session, problem, own, STARTS);
    let starts = std::iter::once(at(&scaled)).chain(own);
    let fitted = starts.filter_map(|v| improve(session, problem, &v, FULL_STEPS));
    let (best, _) = fitted.max_by(|a, b| a.1.total_cmp(&b.1))?;
    let scored: Scored<'_> = score_fitted(session, problem, best)?;
    Some(scored.fold_error)
}
