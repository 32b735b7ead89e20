//! Effects whose columns depend on further unknowns: variable projection over all rows, then again
//! in every fold.
//!
//! Starts are screened by the gain of their linear fit; the best are improved by damped
//! Gauss-Newton steps on columns and derivatives together (Kaufman's form), within bounds. In a
//! fold the parameters take one step from the common optimum with the derivatives there, so that a
//! cluster's own rows do not help to predict it. With many clusters this step is taken on the
//! linear model alone.

use crate::candidate::{Scored, Variant, fold_freedom, is_determined, pseudo_inverse, pseudo_solve, solve};
use crate::problem::{Problem, ReducedFold};
use crate::session::Session;
use crate::statistics::jackknife_se;
use aloft_effects::NonlinearParameter;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

struct Point {
    p: Vec<f64>,
    theta: DVector<f64>,
    gain: f64,
    columns: Vec<DMatrix<f64>>,
}

fn evaluate(session: &Session<'_>, problem: &Problem, variant: &Variant<'_>, p: Vec<f64>) -> Option<Point> {
    let columns = variant.columns_at(session, problem, &p)?;
    let (s, c) = problem.reduce_all(&columns);
    let (theta, gain) = solve(&s, &c, &variant.coefficients);
    Some(Point { p, theta, gain, columns })
}

/// Columns `[C | ∂(Cθ)/∂p]` at a point.
fn with_derivatives(
    session: &Session<'_>,
    problem: &Problem,
    variant: &Variant<'_>,
    parameters: &[NonlinearParameter],
    at: &Point,
) -> Option<Vec<DMatrix<f64>>> {
    let k = at.theta.len();
    let mut out: Vec<DMatrix<f64>> = at
        .columns
        .iter()
        .map(|c| {
            let mut wide = DMatrix::zeros(c.nrows(), k + parameters.len());
            wide.columns_mut(0, k).copy_from(c);
            wide
        })
        .collect();
    let slope = |(j, parameter): (usize, &NonlinearParameter)| -> Option<Vec<DVector<f64>>> {
        let mut p = at.p.clone();
        let mut h = 0.02 * parameter.scale;
        if p[j] + h > parameter.upper {
            h = -h;
        }
        p[j] += h;
        let moved = variant.columns_at(session, problem, &p)?;
        Some(moved.iter().zip(&at.columns).map(|(a, b)| (a - b) * &at.theta / h).collect())
    };
    let slopes: Vec<Option<Vec<DVector<f64>>>> = parameters.par_iter().enumerate().map(slope).collect();
    for (j, slopes) in slopes.into_iter().enumerate() {
        for (wide, slope) in out.iter_mut().zip(slopes?) {
            wide.set_column(k + j, &slope);
        }
    }
    Some(out)
}

/// Damped step of the nonlinear parameters from Gram and right side of `[C | J]`. A parameter at a
/// bound that the step would leave stays there, and the others move without it.
fn step(
    s: &DMatrix<f64>,
    c: &DVector<f64>,
    parameters: &[NonlinearParameter],
    p: &[f64],
    damping: f64,
    reach: f64,
) -> Vec<f64> {
    let k = c.len() - parameters.len();
    let mut damped = s.clone();
    for j in 0..parameters.len() {
        let d = s[(k + j, k + j)];
        damped[(k + j, k + j)] += damping * d.max(1e-300);
    }
    let mut moving: Vec<usize> = (0..c.len()).collect();
    loop {
        let gram = DMatrix::from_fn(moving.len(), moving.len(), |i, j| damped[(moving[i], moving[j])]);
        let x = pseudo_solve(&gram, &DVector::from_fn(moving.len(), |i, _| c[moving[i]]));
        let mut to = p.to_vec();
        let mut stay = Vec::new();
        for (&i, x) in moving.iter().zip(x.iter()).filter(|(i, _)| **i >= k) {
            let (q, from) = (&parameters[i - k], p[i - k]);
            if (from <= q.lower && *x < 0.0) || (from >= q.upper && *x > 0.0) {
                stay.push(i);
            }
            to[i - k] = (from + x.clamp(-reach * q.scale, reach * q.scale)).clamp(q.lower, q.upper);
        }
        if stay.is_empty() {
            return to;
        }
        moving.retain(|i| !stay.contains(i));
    }
}

/// Improves a variant from its values of the nonlinear parameters by at most `steps` steps; returns
/// it with its gain, `None` if there is no improvement.
pub(crate) fn improve<'a>(
    session: &Session<'_>,
    problem: &Problem,
    variant: &Variant<'a>,
    steps: usize,
) -> Option<(Variant<'a>, f64)> {
    let parameters = variant.effect.nonlinear(session.scene, variant.target);
    let mut at = evaluate(session, problem, variant, variant.nonlinear.clone())?;
    let mut damping = 0.03;
    for _ in 0..steps {
        if at.gain <= 0.0 {
            return None;
        }
        let wide = with_derivatives(session, problem, variant, &parameters, &at)?;
        let (s, c) = problem.reduce_all(&wide);
        let mut better = None;
        for _ in 0..5 {
            let p = step(&s, &c, &parameters, &at.p, damping, 8.0);
            match evaluate(session, problem, variant, p) {
                Some(next) if next.gain > at.gain => {
                    better = Some(next);
                    damping = (damping * 0.2).max(1e-6);
                    break;
                }
                _ => damping = (damping * 6.0).min(1e6),
            }
        }
        let Some(next) = better else { break };
        let enough = next.gain - at.gain < 1e-4 * (problem.rss - next.gain).max(1e-12 * problem.rss);
        at = next;
        if enough {
            break;
        }
    }
    Some((Variant { nonlinear: at.p, ..variant.clone() }, at.gain))
}

/// Standard errors of coefficients and nonlinear parameters estimated jointly, from the columns `[C
/// | ∂(Cθ)/∂p]`: the jackknife over clusters of their joint linear fit. Its steps are not damped,
/// so it follows directions in which unknowns compensate each other, and the spread among clusters
/// counts along each unknown by itself: the variance of single rows is no measure of it, because
/// windows overlap. If the rows leave a direction undetermined, the standard errors are those of
/// [`Problem::covariance`], very large along it.
fn joint_se(
    problem: &Problem,
    parameters: &[NonlinearParameter],
    wide: &[DMatrix<f64>],
    folds: &[ReducedFold],
    theta: &DVector<f64>,
) -> Vec<f64> {
    let variances: Vec<f64> = if is_determined(&problem.reduce_all(wide).0) {
        let left_out: Vec<DVector<f64>> = folds.par_iter().map(|fold| pseudo_solve(&fold.s, &fold.c)).collect();
        let of = |i| jackknife_se(&left_out.iter().map(|x| x[i]).collect::<Vec<_>>()).powi(2);
        (0..wide[0].ncols()).map(of).collect()
    } else {
        problem.covariance(wide, theta).diagonal().iter().copied().collect()
    };
    let se = |(i, v): (usize, &f64)| match i.checked_sub(theta.len()).map(|j| &parameters[j]) {
        // at most the standard deviation of a uniform distribution between the bounds
        Some(q) if (q.upper - q.lower).is_finite() => v.sqrt().min((q.upper - q.lower) / 12f64.sqrt()),
        _ => v.sqrt(),
    };
    variances.iter().enumerate().map(se).collect()
}

/// Number of clusters from which on the step of a fold is linear: leaving out one of so many
/// changes the unknowns by little, and columns computed anew for every fold would make the time
/// grow with the square of the number of recordings.
const MANY_CLUSTERS: usize = 60;

fn is_linear_in_folds(problem: &Problem) -> bool {
    problem.folds.len() >= MANY_CLUSTERS
}

/// The reduced columns for every fold.
fn folds_of(problem: &Problem, wide: &[DMatrix<f64>]) -> Vec<ReducedFold> {
    if is_linear_in_folds(problem) {
        return problem.reduce(wide).folds;
    }
    (0..problem.folds.len()).into_par_iter().map(|g| problem.reduce_fold(g, wide)).collect()
}

/// The first `k` unknowns, refitted in a fold after the nonlinear parameters moved from `from` to
/// `to`, and below them this move: the unknowns of the columns `[C | ∂(Cθ)/∂p]`.
fn along(fold: &ReducedFold, variant: &Variant<'_>, from: &[f64], to: &[f64], k: usize) -> DVector<f64> {
    let moved = DVector::from_iterator(to.len(), to.iter().zip(from).map(|(a, b)| a - b));
    let right = fold.c.rows(0, k) - fold.s.view((0, k), (k, to.len())) * &moved;
    let (theta, _) = solve(&fold.s.view((0, 0), (k, k)).into_owned(), &right, &variant.coefficients);
    DVector::from_iterator(k + to.len(), theta.iter().chain(moved.iter()).copied())
}

/// Fit of an effect with nonlinear parameters without the rows of one fold.
struct FittedFold {
    theta: DVector<f64>,
    nonlinear: Vec<f64>,
    error: f64,
    /// Gram matrix of the columns and their derivatives, with the body's parameters projected out.
    s: DMatrix<f64>,
}

/// Factors by which the standard errors of the first `k` unknowns grow because the others are
/// unknown too, from the joint Gram matrix.
fn widening(joint: &DMatrix<f64>, k: usize) -> Vec<f64> {
    /// Factor for a coefficient that the others compensate completely.
    const MOST: f64 = 1e3;
    let (whole, alone) = (pseudo_inverse(joint), pseudo_inverse(&joint.view((0, 0), (k, k)).into_owned()));
    let of = |i: usize| (whole[(i, i)] / alone[(i, i)]).sqrt();
    (0..k).map(|i| if of(i) > 1.0 { of(i).min(MOST) } else { 1.0 }).collect()
}

/// The same for an effect at given values of its nonlinear parameters, which are taken as fitted
/// earlier; empty where it has none.
pub(crate) fn joint_se_at(session: &Session<'_>, problem: &Problem, variant: &Variant<'_>) -> Vec<f64> {
    let parameters = variant.effect.nonlinear(session.scene, variant.target);
    if parameters.is_empty() {
        return Vec::new();
    }
    evaluate(session, problem, variant, variant.nonlinear.clone())
        .and_then(|at| {
            let wide = with_derivatives(session, problem, variant, &parameters, &at)?;
            Some(joint_se(problem, &parameters, &wide, &folds_of(problem, &wide), &at.theta))
        })
        .unwrap_or_default()
}

/// Columns `[C | ∂(Cθ)/∂p]` of an effect at its present parameter values.
pub(crate) fn columns_and_slopes(
    session: &Session<'_>,
    problem: &Problem,
    variant: &Variant<'_>,
    theta: &DVector<f64>,
) -> Option<Vec<DMatrix<f64>>> {
    let parameters = variant.effect.nonlinear(session.scene, variant.target);
    let p = variant.nonlinear.clone();
    let columns = variant.columns_at(session, problem, &p)?;
    with_derivatives(session, problem, variant, &parameters, &Point { p, theta: theta.clone(), gain: 0.0, columns })
}

/// Factors by which the standard errors of the coefficients `theta` of a variant grow because its
/// nonlinear parameters, at their present values, are unknown too.
pub(crate) fn widening_at(
    session: &Session<'_>,
    problem: &Problem,
    variant: &Variant<'_>,
    theta: &DVector<f64>,
) -> Option<Vec<f64>> {
    let wide = columns_and_slopes(session, problem, variant, theta)?;
    Some(widening(&problem.reduce_all(&wide).0, theta.len()))
}

/// Scores a fitted variant, with its nonlinear parameters refitted in every fold.
pub(crate) fn score_fitted<'a>(session: &Session<'_>, problem: &Problem, variant: Variant<'a>) -> Option<Scored<'a>> {
    let parameters = variant.effect.nonlinear(session.scene, variant.target);
    let at = evaluate(session, problem, &variant, variant.nonlinear.clone())?;
    let (s, _) = problem.reduce_all(&at.columns);
    let wide = with_derivatives(session, problem, &variant, &parameters, &at)?;
    let k = at.theta.len();
    let reduced = folds_of(problem, &wide);
    let joint_se = joint_se(problem, &parameters, &wide, &reduced, &at.theta);
    let (joint, _) = problem.reduce_all(&wide);
    let widening = widening(&joint, k);
    let linear = is_linear_in_folds(problem);
    let folds: Vec<FittedFold> = reduced
        .into_par_iter()
        .enumerate()
        .map(|(g, common)| {
            let (cs, cc) = (common.s.view((0, 0), (k, k)).into_owned(), common.c.rows(0, k).into_owned());
            let (mut theta, gain) = solve(&cs, &cc, &variant.coefficients);
            let mut test = common.test.columns(0, k).into_owned();
            let mut p = at.p.clone();
            let moved = step(&common.s, &common.c, &parameters, &at.p, 1e-3, 2.0);
            if linear {
                let x = along(&common, &variant, &at.p, &moved, k);
                let y = 2.0 * common.c.dot(&x) - x.dot(&(&common.s * &x));
                let better = y > gain;
                let rest = if better { &common.test * &x } else { test * &theta };
                let (theta, nonlinear) = if better { (x.rows(0, k).into_owned(), moved) } else { (theta, p) };
                let error = (&problem.folds[g].test - rest).norm_squared();
                return FittedFold { theta, nonlinear, error, s: common.s };
            }
            if let Some(columns) = variant.columns_at(session, problem, &moved) {
                let own = problem.reduce_fold(g, &columns);
                let (t, y) = solve(&own.s, &own.c, &variant.coefficients);
                if y > gain {
                    (theta, test, p) = (t, own.test, moved);
                }
            }
            let error = (&problem.folds[g].test - test * &theta).norm_squared();
            FittedFold { theta, nonlinear: p, error, s: common.s }
        })
        .collect();
    let mut out = Scored {
        theta: at.theta,
        fold_theta: Vec::new(),
        fold_nonlinear: Vec::new(),
        fold_error: Vec::new(),
        joint_se,
        freedom: fold_freedom(&joint, folds.iter().map(|f| &f.s)),
        widening,
        s,
        variant,
    };
    for fold in folds {
        out.fold_theta.push(fold.theta);
        out.fold_nonlinear.push(fold.nonlinear);
        out.fold_error.push(fold.error);
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A joint step that leaves a bound moves the other parameter too far; without the first one it
    /// reaches the best value beside the bound.
    #[test]
    fn a_parameter_at_its_bound_does_not_carry_the_others_along() {
        let parameters = ["a", "b"].map(|name| NonlinearParameter::new(name, "1", 0.0, 8.0, 1.0));
        let s = DMatrix::from_row_slice(3, 3, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.9, 0.0, 0.9, 1.0]);
        let c = DVector::from_row_slice(&[0.5, -1.0, 0.2]);
        let at = |p: [f64; 2]| step(&s, &c, &parameters, &p, 0.0, 8.0);
        let bound = at([0.0, 1.0]);
        assert!(bound[0] == 0.0 && (bound[1] - 1.2).abs() < 1e-12, "{bound:?}");
        // inside its range it moves, up to the bound
        let inside = at([1.0, 1.0]);
        assert!(inside[0] == 0.0 && inside[1] > 6.0, "{inside:?}");
    }
}
