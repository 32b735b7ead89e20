//! Tests whether the better of two effects would have the same advantage if the other were true.
//!
//! Kinematic errors that repeat from trial to trial favour the effect with more freedom, so neither
//! the order of two held-out errors nor its consistency over trials decides between them. The size
//! of this bias is estimated from the recordings: the worse effect `b` is subtracted from the rows
//! as it was fitted, added again in other directions (or, if it has no direction, with the signs of
//! the residuals flipped by trial), and both effects are fitted again. The advantage of the better
//! effect in these data, where `b` is true, is the reference for its advantage on the recordings.
//! The same test is made the other way round: a true richer effect would lead a simpler one by a
//! certain amount; if its lead is smaller, the simpler effect is kept.

use crate::candidate::{Scored, Variant, score, solve};
use crate::nonlinear::{FULL_STEPS, improve, score_fitted};
use crate::problem::{OVERLAP, Problem};
use crate::session::Session;
use crate::thin::thin;
use aloft_effects::ParameterKind;
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// Number of directions in which the rival is added again.
const DRAWS: usize = 7;
/// Most clusters in which advantages are formed: each draw fits both effects again in every fold,
/// a time that grows with the square of their number.
const MOST_CLUSTERS: usize = 30;
/// Number of standard deviations by which the advantage has to exceed those of the draws.
const BEYOND: f64 = 2.0;
/// The same for an advantage that is too small; stricter, so that a true effect is rarely rejected.
const BEYOND_FOR_LESS: f64 = 2.5;
/// From this number on the other effect is asked, too, and how much likelier it has to make the
/// advantage.
const LIKELY: f64 = 1.3;
const ODDS: f64 = 10.0;

/// Advantage of `a` over `b` (logarithm of the ratio of squared errors) if one of them is true,
/// over directions of the true one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Exchange {
    pub mean: f64,
    pub sd: f64,
    /// Standard deviation that the noise of one set of recordings causes: all draws have the same
    /// noise.
    by_noise: f64,
    least: f64,
    most: f64,
}

impl Exchange {
    /// True if an advantage is larger than the true effect would give.
    pub fn exceeded_by(&self, advantage: f64) -> bool {
        advantage > (self.mean + BEYOND * self.sd).max(self.most)
    }
    /// True if an advantage is smaller than the true effect would give, and likelier if the other
    /// effect is true (`other`); clearly likelier where it is not far too small.
    pub fn missed_by(&self, advantage: f64, other: impl FnOnce() -> Option<Self>) -> bool {
        let below = (self.mean - advantage) / self.spread();
        if advantage >= self.least || below < LIKELY {
            return false;
        }
        let far = below > BEYOND_FOR_LESS;
        let odds = if far { 1.0 } else { ODDS };
        other().map_or(far, |o| o.density(advantage) > odds * self.density(advantage))
    }
    fn spread(&self) -> f64 {
        self.sd.hypot(self.by_noise)
    }
    /// Density of an advantage, up to a factor: Student's t with the freedom of the draws.
    fn density(&self, advantage: f64) -> f64 {
        const FREEDOM: f64 = (DRAWS - 1) as f64;
        let z = (advantage - self.mean) / self.spread();
        (1.0 + z * z / FREEDOM).powf(-0.5 * (FREEDOM + 1.0)) / self.spread()
    }
}

/// The advantage of `a` over `b` when `truth` (one of them) is added to the recordings in other
/// directions; `None` where that cannot be done.
pub(crate) fn exchange(
    session: &Session<'_>,
    problem: &Problem,
    a: &Scored<'_>,
    b: &Scored<'_>,
    truth: &Scored<'_>,
    seed: u64,
) -> Option<Exchange> {
    let mut fitted = truth.variant.columns(session, problem)?;
    let mut signal: Vec<DVector<f64>> = fitted.iter().map(|c| c * &truth.theta).collect();
    // alike among the clusters in which the effect acts and the others; the advantages of fewer
    // recordings scatter more, so that fewer rivals are told apart
    let (acting, others): (Vec<usize>, Vec<usize>) =
        (0..signal.len()).partition(|&g| signal[g].iter().any(|x| *x != 0.0));
    let thinned = thin(session, problem, signal.len().div_ceil(MOST_CLUSTERS), &[acting, others]);
    let (session, problem) = match &thinned {
        Some((session, problem, kept)) => {
            fitted = kept.iter().map(|&g| std::mem::take(&mut fitted[g])).collect();
            signal = kept.iter().map(|&g| std::mem::take(&mut signal[g])).collect();
            (session, problem)
        }
        None => (session, problem),
    };
    let without = problem.shifted(&signal.iter().map(|s| -s).collect::<Vec<_>>());
    let share = true_share(&without, energy(problem, &fitted, &truth.theta), truth.variant.unknowns());
    let residual: Vec<DVector<f64>> = (0..signal.len()).map(|g| without.residual(g)).collect();
    let (starts_a, starts_b) = (starts(session, problem, &a.variant), starts(session, problem, &b.variant));
    let draws: Vec<f64> = (0..DRAWS)
        .into_par_iter()
        .filter_map(|draw| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(draw as u64);
            let delta: Vec<DVector<f64>> = match turned(session, truth, draw) {
                // repeating errors of a person stay as they are; an effect without a direction is
                // added in other sizes
                None if session.prior.is_some() => {
                    let size = other_size(truth, draw);
                    signal.iter().map(|s| s * (size * share.sqrt() - 1.0)).collect()
                }
                Some((variant, theta)) => {
                    let columns = variant.columns(session, problem)?;
                    let k = share * energy(problem, &fitted, &truth.theta) / energy(problem, &columns, &theta);
                    if !(k.is_finite() && k > 0.0) {
                        return None;
                    }
                    columns.iter().zip(&signal).map(|(c, s)| c * (&theta * k.sqrt()) - s).collect()
                }
                None => residual
                    .iter()
                    .map(|r| if rng.random_bool(0.5) { r * -2.0 } else { DVector::zeros(r.len()) })
                    .collect(),
            };
            let moved = problem.shifted(&delta);
            let of = |s: &Scored<'_>, starts: &[Start]| {
                error(session, &moved, &s.variant, turned(session, s, draw).map(|t| t.0.nonlinear), starts)
            };
            let (ea, eb) = (of(a, &starts_a)?, of(b, &starts_b)?);
            Some((eb / ea).ln())
        })
        .collect();
    if draws.len() < 3 {
        return None;
    }
    let n = draws.len() as f64;
    let mean = draws.iter().sum::<f64>() / n;
    let sd = (draws.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>() / (n - 1.0)).sqrt();
    let least = draws.iter().copied().fold(f64::INFINITY, f64::min);
    let most = draws.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    // With N independent rows of variance σ² and a part d of the true effect that the other leaves,
    // the advantage is ‖d‖²/Nσ², and what noise adds along d varies by 2σ‖d‖/Nσ².
    let independent = problem.clusters.iter().map(|c| c.n_rows as f64).sum::<f64>() / OVERLAP;
    // Errors of rigid bodies do not repeat, so that draws in other directions hold it.
    let by_noise = if session.prior.is_some() { (4.0 * mean.max(0.0) / independent).sqrt() } else { 0.0 };
    Some(Exchange { mean, sd, by_noise, least, most })
}

/// Multiple of its size at which an effect without a direction is added in a draw; of either sign
/// if its coefficients may have both.
fn other_size(truth: &Scored<'_>, draw: usize) -> f64 {
    const SIGNED: [f64; DRAWS] = [-1.4, -1.2, -1.0, -0.8, 0.8, 1.2, 1.4];
    const ONE_SIGN: [f64; DRAWS] = [0.6, 0.7, 0.8, 0.9, 1.1, 1.25, 1.4];
    let signed = truth.variant.coefficients.iter().all(|c| c.lower < 0.0 && c.upper > 0.0);
    if signed { SIGNED[draw] } else { ONE_SIGN[draw] }
}

/// Share of the sum of squares of a fitted signal that is not noise: each unknown also fits what
/// one independent observation scatters, and an effect added with that part would be found too
/// well. `without` is the problem after the signal was subtracted.
fn true_share(without: &Problem, energy: f64, unknowns: usize) -> f64 {
    /// Least share, for an effect that is hardly there.
    const LEAST: f64 = 0.25;
    let rows: f64 = without.clusters.iter().map(|c| c.n_rows as f64).sum();
    let of_noise = unknowns as f64 * OVERLAP * without.rss / rows;
    if energy > 0.0 { (1.0 - of_noise / energy).max(LEAST) } else { 1.0 }
}

/// Sum of squares of a signal with the parameters projected out.
fn energy(problem: &Problem, columns: &[DMatrix<f64>], theta: &DVector<f64>) -> f64 {
    let (s, _) = problem.reduce_all(columns);
    theta.dot(&(s * theta))
}

/// The effect in another direction: places and vectors of the world turned about the vertical
/// (places about that through the middle of the volume), vectors of a link about its z axis; `None`
/// for an effect that has no direction.
fn turned<'a>(session: &Session<'_>, b: &Scored<'a>, draw: usize) -> Option<(Variant<'a>, DVector<f64>)> {
    let mut variant = b.variant.clone();
    let mut theta = b.theta.clone();
    let (sin, cos) = (std::f64::consts::TAU * (draw + 1) as f64 / (DRAWS + 1) as f64).sin_cos();
    let turn = |x: f64, y: f64| (cos * x - sin * y, sin * x + cos * y);
    /// A place nearer than this to the vertical through the middle is the same when turned, m.
    const ON_AXIS_M: f64 = 1e-3;
    let mut changed = false;
    let centre = session.scene.volume_centre_m;
    for (i, parameter) in variant.effect.nonlinear(session.scene, variant.target).iter().enumerate() {
        let (cx, cy) = match parameter.kind {
            ParameterKind::PointInWorld(0) => (centre.x, centre.y),
            ParameterKind::VectorInWorld(0) => (0.0, 0.0),
            _ => continue,
        };
        let (from_x, from_y) = (variant.nonlinear[i] - cx, variant.nonlinear[i + 1] - cy);
        let (x, y) = turn(from_x, from_y);
        (variant.nonlinear[i], variant.nonlinear[i + 1]) = (x + cx, y + cy);
        changed |= from_x.hypot(from_y) > ON_AXIS_M;
    }
    for (i, coefficient) in variant.coefficients.iter().enumerate() {
        if coefficient.kind.begins_vector(variant.coefficients.get(i + 1).map(|next| next.kind)) {
            (theta[i], theta[i + 1]) = turn(theta[i], theta[i + 1]);
            changed = true;
        }
    }
    changed.then_some((variant, theta))
}

/// Values of the nonlinear parameters from which an effect is fitted, and its columns there.
struct Start {
    nonlinear: Vec<f64>,
    columns: Vec<DMatrix<f64>>,
}

/// The starts of an effect on its target; none if nothing of it was fitted but coefficients.
fn starts(session: &Session<'_>, problem: &Problem, variant: &Variant<'_>) -> Vec<Start> {
    if variant.fitted == 0 {
        return Vec::new();
    }
    let of = |nonlinear: Vec<f64>| {
        let columns = variant.columns_at(session, problem, &nonlinear)?;
        Some(Start { nonlinear, columns })
    };
    variant.effect.starts(session.scene, variant.target).into_par_iter().filter_map(of).collect()
}

/// Held-out error of an effect on its target, fitted from its own starts and, so that it is fitted
/// as well as it was to the recordings, from its fit there turned like the true effect.
fn error(
    session: &Session<'_>,
    problem: &Problem,
    variant: &Variant<'_>,
    turned: Option<Vec<f64>>,
    starts: &[Start],
) -> Option<f64> {
    let sum = |s: &Scored<'_>| s.fold_error.iter().sum::<f64>();
    let at = |nonlinear: Vec<f64>| Variant { nonlinear, fitted: 0, ..variant.clone() };
    if variant.fitted == 0 {
        let columns = variant.columns(session, problem)?;
        return Some(sum(&score(problem, variant.clone(), &problem.reduce(&columns))));
    }
    let gain = |start: &Start| {
        let (s, c) = problem.reduce_all(&start.columns);
        solve(&s, &c, &variant.coefficients).1
    };
    let mut ranked: Vec<(f64, &Start)> = starts.iter().map(|s| (gain(s), s)).collect();
    ranked.sort_by(|x, y| y.0.total_cmp(&x.0));
    let mut best: Option<(Variant<'_>, f64)> = None;
    for p in turned.into_iter().chain(ranked.into_iter().take(2).map(|(_, s)| s.nonlinear.clone())) {
        if let Some(found) = improve(session, problem, &at(p), 8)
            && best.as_ref().is_none_or(|b| found.1 > b.1)
        {
            best = Some(found);
        }
    }
    let (variant, _) = improve(session, problem, &best?.0, FULL_STEPS)?;
    score_fitted(session, problem, variant).map(|s| sum(&s))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn draws(mean: f64, sd: f64, by_noise: f64) -> Exchange {
        Exchange { mean, sd, by_noise, least: mean - 1.5 * sd, most: mean + 1.5 * sd }
    }

    /// Far below what the true effect would give it is missed; a little below only if the other
    /// effect makes it much likelier, and the noise of the recordings counts.
    #[test]
    fn a_richer_effect_is_missed_where_the_simpler_one_makes_its_advantage_likelier() {
        let (true_one, no_other) = (draws(0.3, 0.04, 0.0), || None);
        assert!(true_one.missed_by(0.1, no_other));
        assert!(!draws(0.3, 0.04, 0.08).missed_by(0.12, no_other));
        let at_zero = || Some(draws(0.0, 0.03, 0.0));
        assert!(draws(0.2, 0.06, 0.06).missed_by(0.02, at_zero));
        // as likely with either of them
        assert!(!draws(0.2, 0.06, 0.06).missed_by(0.07, || Some(draws(0.1, 0.1, 0.0))));
        // within the draws
        assert!(!true_one.missed_by(0.25, at_zero));
    }
}
