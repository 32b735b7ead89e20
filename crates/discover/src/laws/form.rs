//! Whether a named effect has the form that its law states.
//!
//! An effect can stand in for another law: a resistance proportional to speed for one that grows
//! with its square root, a spring for a field. Its force then has the right place and direction and
//! the wrong strength. The force of the effect, as fitted, times a free curve of each variable is
//! added to the model that contains the effect; on a rigid body also times a straight line, of a
//! magnitude in its logarithm. If the best of these products lowers the held-out error by more than
//! random signs of the clusters do for the best of them, the strength depends on something in
//! another way than the law says.
//!
//! On a rigid body the effect's own strength is asked first, as a family of its own: the force
//! times the logarithm of its strength, the first change of a power, and times its square. It needs
//! no variable, knows the point at which the force acts, and has one or two columns.

use super::atlas::{PlaceFrames, SPLINES, carriers, columns, range_of, splines, stride};
use super::evidence::Evidence;
use super::kinematics::{Carrier, Variable};
use super::shape::Range;
use crate::candidate::Variant;
use crate::problem::Problem;
use crate::result::{Found, Misfit};
use crate::session::Session;
use aloft_effects::{Columns, ParameterKind, Target};
use nalgebra::Vector3;
use rayon::prelude::*;

/// Draws of random signs.
const DRAWS: usize = 499;
/// Probability by chance below which the form is in doubt.
const SIGNIFICANT: f64 = 0.01;
/// Share of the error that the product has to leave at most, on a rigid body. Of 39 effects that
/// act as their law says (chains of seed 11001, strength 2) none left less than 99.2 %.
const LEAVES: f64 = 0.99;
/// Squared error that the product has to remove at least, as a share of what the effects removed: a
/// right effect of great strength leaves up to 0.1 % by its own simplification.
const OF_REMOVED: f64 = 0.005;

/// A place and a variable, with the curves' values by trial.
struct CurveCandidate {
    carrier: Carrier,
    variable: Variable,
    anchor: Vector3<f64>,
}

/// What a product of an effect's force has to do before the form of the effect is in doubt.
pub(crate) struct FormLimits {
    /// Largest share of the error that it may leave on a person.
    pub person: f64,
    /// Products that leave less than this share of the error explain what no law can: one that
    /// grows with the acceleration can imitate the weight of the body.
    pub noise: f64,
    /// Squared error that the effects removed, over that which they leave.
    pub removed: f64,
}

/// The strongest dependence of a named effect's strength on a variable that its law does not
/// describe; none if there is none beyond chance. `problem` contains the effects.
pub(crate) fn misfit(
    session: &Session<'_>,
    problem: &Problem,
    kept: &[Variant<'_>],
    found: &[Found],
    limits: &FormLimits,
    seed: u64,
) -> Option<Misfit> {
    if session.series.is_empty() {
        return None;
    }
    let session = &session.in_flight();
    let evidence = Evidence::new(problem, DRAWS, seed)?;
    let in_flight = kept.iter().zip(found).filter(|(v, _)| v.effect.acts().in_flight() && v.effect.has_wrench());
    if session.prior.is_none() {
        let own = in_flight.clone().filter_map(|(v, f)| own_misfit(session, problem, &evidence, v, f, limits));
        if let Some(strongest) = own.min_by(|a, b| a.held_out_ratio.total_cmp(&b.held_out_ratio)) {
            return Some(strongest);
        }
    }
    let stride = stride(session);
    // where small gains count, one column shows a smooth change more clearly than a curve
    let slopes = session.prior.is_none();
    let mut null = vec![1.0_f64; DRAWS];
    let mut best: Option<(f64, String, Carrier, Variable)> = None;
    for (variant, found) in in_flight {
        let unit = force_of(session, variant, found);
        let score = |choice: &CurveCandidate, weight: Vec<Vec<f64>>, nb: usize| {
            let made = columns(session, problem, &unit, &weight, nb, stride);
            if !made.iter().all(|c| c.iter().all(|x| x.is_finite())) {
                return None;
            }
            let all: Vec<usize> = (0..nb).collect();
            let score = evidence.score(&evidence.prepare(&made, nb), &all)?;
            Some((score.ratio, score.null, choice.carrier, choice.variable))
        };
        let of = |choice: CurveCandidate| {
            let frames = PlaceFrames::new(session, choice.carrier, &point(session, choice.carrier));
            let values = frames.values(choice.variable, &choice.anchor);
            let range = range_of(&values)?;
            let curve = values.iter().map(|x| splines(x, range)).collect();
            let slope = slopes.then(|| values.iter().map(|x| slope(x, range, choice.variable)).collect());
            let slope = slope.and_then(|weight| score(&choice, weight, 1));
            Some([score(&choice, curve, SPLINES), slope])
        };
        let scored: Vec<(f64, Vec<f64>, Carrier, Variable)> = choices(session, variant)
            .into_par_iter()
            .filter_map(of)
            .collect::<Vec<_>>()
            .into_iter()
            .flatten()
            .flatten()
            .collect();
        for (ratio, by_chance, carrier, variable) in scored {
            for (least, x) in null.iter_mut().zip(by_chance) {
                *least = least.min(x);
            }
            if ratio.sqrt() > limits.noise && best.as_ref().is_none_or(|b| ratio < b.0) {
                best = Some((ratio, found.key.clone(), carrier, variable));
            }
        }
    }
    let (ratio, effect, carrier, variable) = best?;
    let limit = if session.prior.is_some() { limits.person } else { LEAVES };
    let p = limits.refutes(ratio, &null).filter(|_| ratio.sqrt() < limit)?;
    let place = carrier.name(session.scene);
    Some(Misfit {
        text: super::wording::misfit(session.scene, &effect, &place, variable, p),
        effect,
        carrier: place,
        variable: variable.formula(session.scene),
        held_out_ratio: ratio.sqrt(),
        family_wise_p: p,
        of_all_named: false,
    })
}

impl FormLimits {
    /// The probability by chance of a product that leaves the share `ratio` of the squared error,
    /// where `null` are the shares under random signs; none if it is no reason for doubt.
    fn refutes(&self, ratio: f64, null: &[f64]) -> Option<f64> {
        let as_good = null.iter().filter(|x| **x <= ratio).count();
        let p = (as_good + 1) as f64 / (null.len() + 1) as f64;
        let is_small = 1.0 - ratio < OF_REMOVED * self.removed;
        (p < SIGNIFICANT && !is_small).then_some(p)
    }
}

/// Doubt that the strength of an effect grows as its law says, from its own strength.
fn own_misfit(
    session: &Session<'_>,
    problem: &Problem,
    evidence: &Evidence,
    variant: &Variant<'_>,
    found: &Found,
    limits: &FormLimits,
) -> Option<Misfit> {
    let unit = force_of(session, variant, found);
    let own = logarithm(&unit)?;
    let score = |weight: &[Vec<f64>], nb: usize| {
        let made = columns(session, problem, &unit, weight, nb, stride(session));
        let usable = made.iter().all(|c| c.iter().all(|x| x.is_finite()));
        let all: Vec<usize> = (0..nb).collect();
        usable.then(|| evidence.score(&evidence.prepare(&made, nb), &all)).flatten()
    };
    let with_square: Vec<Vec<f64>> = own.iter().map(|t| t.iter().flat_map(|x| [*x, x * x]).collect()).collect();
    let [power, bent] = [score(&own, 1)?, score(&with_square, 2)?];
    let null: Vec<f64> = power.null.iter().zip(&bent.null).map(|(a, b)| a.min(*b)).collect();
    let ratio = power.ratio.min(bent.ratio);
    let p = limits.refutes(ratio, &null).filter(|_| ratio.sqrt() > limits.noise)?;
    let carrier = match variant.target {
        Target::Link(i) => Carrier::Link(i),
        _ => Carrier::Body,
    };
    Some(Misfit {
        text: super::wording::own_misfit(&found.key, p),
        effect: found.key.clone(),
        carrier: carrier.name(session.scene),
        variable: "strength".to_owned(),
        held_out_ratio: ratio.sqrt(),
        family_wise_p: p,
        of_all_named: false,
    })
}

/// Logarithm of the strength of a force, of a couple without force, over its largest value, by
/// series; none of a force that is zero everywhere.
fn logarithm(unit: &[Vec<Vec<[f64; 6]>>]) -> Option<Vec<Vec<f64>>> {
    /// Share of the largest strength below which the logarithm stays the same.
    const LEAST: f64 = 0.02;
    let norm = |w: &[f64]| w.iter().map(|x| x * x).sum::<f64>().sqrt();
    let largest =
        |of: &std::ops::Range<usize>| unit.iter().flat_map(|t| &t[0]).map(|w| norm(&w[of.clone()])).fold(0.0, f64::max);
    let of = [0..3, 3..6].into_iter().find(|of| largest(of) > 0.0)?;
    let most = largest(&of);
    let log = |w: &[f64; 6]| (norm(&w[of.clone()]) / most).max(LEAST).ln();
    Some(unit.iter().map(|t| t[0].iter().map(log).collect()).collect())
}

/// A straight line in a variable that takes both signs, else in its logarithm: the first change of
/// a power.
fn slope(values: &[f64], range: Range, variable: Variable) -> Vec<f64> {
    let (middle, half) = (0.5 * (range.low + range.high), 0.5 * range.width());
    if variable.is_signed() {
        return values.iter().map(|x| (x - middle) / half).collect();
    }
    let least = range.low.max(0.05 * range.reach());
    values.iter().map(|x| (x.max(least) / range.reach()).ln()).collect()
}

/// Force and moment about the world origin of an effect in every frame, one column, by series.
fn force_of(session: &Session<'_>, variant: &Variant<'_>, found: &Found) -> Vec<Vec<Vec<[f64; 6]>>> {
    let k = variant.coefficients.len();
    session
        .series
        .iter()
        .flatten()
        .enumerate()
        .map(|(of, series)| {
            let mut out = Columns::zeros(series.len(), k);
            if variant.group.is_empty() || variant.group[of / 2] {
                variant.effect.evaluate(series, variant.target, &variant.nonlinear, &mut out);
            }
            let frame = |f: usize| {
                let mut sum = [0.0; 6];
                for (c, estimate) in found.coefficients.iter().enumerate() {
                    for (s, x) in sum.iter_mut().zip(out.wrench(f, c)) {
                        *s += estimate.value * x;
                    }
                }
                sum
            };
            vec![(0..series.len()).map(frame).collect()]
        })
        .collect()
}

/// The link's centre of mass; the origin for the whole body.
fn point(session: &Session<'_>, carrier: Carrier) -> Vector3<f64> {
    match carrier {
        Carrier::Body => Vector3::zeros(),
        Carrier::Link(i) => session.scene.link_com_m[i],
    }
}

/// What the strength could depend on: variables of the effect's link, or of the whole body and, on
/// bodies of few links, of each of them; the distance from the effect's own point of the room.
fn choices(session: &Session<'_>, variant: &Variant<'_>) -> Vec<CurveCandidate> {
    let scene = session.scene;
    let none = Vector3::zeros();
    let places: Vec<Carrier> = match variant.target {
        Target::Link(i) => vec![Carrier::Link(i)],
        _ if scene.model.n_links() <= FEW_LINKS => carriers(scene),
        _ => vec![Carrier::Body],
    };
    let mut anchor: [Option<f64>; 3] = [None; 3];
    for (q, value) in variant.effect.nonlinear(scene, variant.target).iter().zip(&variant.nonlinear) {
        if let ParameterKind::PointInWorld(axis) = q.kind {
            anchor[axis] = Some(*value);
        }
    }
    let of_place = |carrier: Carrier| {
        let mut out: Vec<CurveCandidate> = Variable::of(scene)
            .into_iter()
            .filter(|v| *v != Variable::None)
            .map(|variable| CurveCandidate { carrier, variable, anchor: none })
            .collect();
        if let [Some(x), Some(y), Some(z)] = anchor {
            out.push(CurveCandidate { carrier, variable: Variable::Distance, anchor: Vector3::new(x, y, z) });
        }
        out
    };
    places.into_iter().flat_map(of_place).collect()
}

/// On bodies with more links an effect on the whole body is compared with the motion of the whole
/// body only.
const FEW_LINKS: usize = 4;
