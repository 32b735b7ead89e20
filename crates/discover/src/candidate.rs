//! Columns of one effect on one target, and its coefficients within their bounds.

use crate::problem::{Problem, Reduced};
use crate::session::Session;
use aloft_effects::{Coefficient, Effect, Target};
use nalgebra::{DMatrix, DVector};

/// An effect on a target at values of its nonlinear parameters.
#[derive(Clone)]
pub(crate) struct Variant<'a> {
    pub effect: &'a dyn Effect,
    pub target: Target,
    pub nonlinear: Vec<f64>,
    pub coefficients: Vec<Coefficient>,
    /// Trials on which a group effect acts (all where empty).
    pub group: Vec<bool>,
}

impl<'a> Variant<'a> {
    pub fn new(session: &Session<'_>, effect: &'a dyn Effect, target: Target, nonlinear: Vec<f64>) -> Self {
        let coefficients = effect.coefficients(session.scene, target);
        Self { effect, target, nonlinear, coefficients, group: Vec::new() }
    }
    /// Columns by block at these or other values of the nonlinear parameters; `None` if they cannot
    /// be computed or are not finite.
    pub fn blocks_at(&self, session: &Session<'_>, problem: &Problem, nonlinear: &[f64]) -> Option<Vec<DMatrix<f64>>> {
        let mut blocks = session.columns(self.effect, self.target, nonlinear, problem.domain)?;
        if !self.group.is_empty() {
            for (block, columns) in session.blocks.iter().zip(&mut blocks) {
                if !self.group[block.trial] {
                    columns.fill(0.0);
                }
            }
        }
        blocks.iter().all(|b| b.iter().all(|x| is_usable(*x))).then_some(blocks)
    }
    /// Columns by cluster.
    pub fn columns_at(&self, session: &Session<'_>, problem: &Problem, nonlinear: &[f64]) -> Option<Vec<DMatrix<f64>>> {
        Some(problem.gather(&self.blocks_at(session, problem, nonlinear)?))
    }
    pub fn columns(&self, session: &Session<'_>, problem: &Problem) -> Option<Vec<DMatrix<f64>>> {
        self.columns_at(session, problem, &self.nonlinear)
    }
}

/// True if `x` is small enough that sums of its square do not overflow.
pub(crate) fn is_usable(x: f64) -> bool {
    x.abs() < 1e100
}

/// Coefficients that minimise `θᵀSθ − 2cᵀθ` within bounds, and the gain `2cᵀθ − θᵀSθ`. Directions
/// that the rows do not determine stay zero.
pub(crate) fn solve(s: &DMatrix<f64>, c: &DVector<f64>, coefficients: &[Coefficient]) -> (DVector<f64>, f64) {
    let k = c.len();
    let mut fixed: Vec<Option<f64>> = vec![None; k];
    for _ in 0..=k {
        let free: Vec<usize> = (0..k).filter(|&i| fixed[i].is_none()).collect();
        let mut theta = DVector::from_fn(k, |i, _| fixed[i].unwrap_or(0.0));
        if !free.is_empty() {
            let right = DVector::from_fn(free.len(), |i, _| {
                c[free[i]] - (0..k).map(|j| s[(free[i], j)] * theta[j]).sum::<f64>()
            });
            let gram = DMatrix::from_fn(free.len(), free.len(), |i, j| s[(free[i], free[j])]);
            for (i, x) in pseudo_solve(&gram, &right).iter().enumerate() {
                theta[free[i]] = *x;
            }
        }
        let worst = free
            .iter()
            .filter_map(|&i| {
                let bound = coefficients.get(i).and_then(|b| {
                    (theta[i] < b.lower).then_some(b.lower).or((theta[i] > b.upper).then_some(b.upper))
                })?;
                Some((i, bound, (theta[i] - bound).abs() * s[(i, i)].max(0.0).sqrt()))
            })
            .max_by(|a, b| a.2.total_cmp(&b.2));
        match worst {
            Some((i, bound, _)) => fixed[i] = Some(bound),
            None => {
                let gain = 2.0 * c.dot(&theta) - theta.dot(&(s * &theta));
                return (theta, gain);
            }
        }
    }
    (DVector::zeros(k), 0.0)
}

/// Least-norm solution with columns scaled to unit length; directions below 1e-9 of the largest are
/// left out.
pub(crate) fn pseudo_solve(s: &DMatrix<f64>, c: &DVector<f64>) -> DVector<f64> {
    let inverse = pseudo_inverse(s);
    inverse * c
}

/// Smallest eigenvalue of a Gram matrix of unit columns that counts as determined.
const LEAST: f64 = 1e-9;

/// Pseudo-inverse of a Gram matrix with columns scaled to unit length.
pub(crate) fn pseudo_inverse(s: &DMatrix<f64>) -> DMatrix<f64> {
    let k = s.nrows();
    let scale = DVector::from_fn(k, |i, _| if s[(i, i)] > 0.0 { s[(i, i)].sqrt().recip() } else { 0.0 });
    if k == 1 {
        return DMatrix::from_element(1, 1, scale[0] * scale[0]);
    }
    let unit = DMatrix::from_fn(k, k, |i, j| s[(i, j)] * scale[i] * scale[j]);
    let eigen = unit.symmetric_eigen();
    let kept = eigen.eigenvalues.map(|l| if l > LEAST { l.recip() } else { 0.0 });
    let inner = &eigen.eigenvectors * DMatrix::from_diagonal(&kept) * eigen.eigenvectors.transpose();
    DMatrix::from_fn(k, k, |i, j| inner[(i, j)] * scale[i] * scale[j])
}

/// True if a Gram matrix determines every direction, by the limit of [`pseudo_inverse`].
pub(crate) fn is_determined(s: &DMatrix<f64>) -> bool {
    if (0..s.nrows()).any(|i| !(s[(i, i)] > 0.0 && s[(i, i)].is_finite())) {
        return false;
    }
    let unit = DMatrix::from_fn(s.nrows(), s.nrows(), |i, j| s[(i, j)] / (s[(i, i)] * s[(j, j)]).sqrt());
    unit.symmetric_eigenvalues().iter().all(|l| *l > LEAST)
}

/// Held-out score of one variant.
#[derive(Clone)]
pub(crate) struct Scored<'a> {
    pub variant: Variant<'a>,
    pub theta: DVector<f64>,
    /// By fold: coefficients, squared error on the cluster left out.
    pub fold_theta: Vec<DVector<f64>>,
    pub fold_nonlinear: Vec<Vec<f64>>,
    pub fold_error: Vec<f64>,
    /// Standard errors of coefficients and nonlinear parameters estimated jointly (jackknife of the
    /// Gauss-Newton step);
    /// empty where no parameter was fitted.
    pub joint_se: Vec<f64>,
    /// Degrees of freedom of the jackknife: coefficients first, then the fitted nonlinear
    /// parameters.
    pub freedom: Vec<f64>,
    /// Factor by which each coefficient's standard error grows because nonlinear parameters were
    /// fitted; empty where none was.
    pub widening: Vec<f64>,
    /// Gram matrix of the columns with the parameters projected out.
    pub s: DMatrix<f64>,
}

/// Degrees of freedom of a jackknife over folds, from the share of each column's sum of squares
/// that every fold leaves out.
pub(crate) fn fold_freedom<'m>(s: &DMatrix<f64>, folds: impl Iterator<Item = &'m DMatrix<f64>>) -> Vec<f64> {
    let folds: Vec<&DMatrix<f64>> = folds.collect();
    (0..s.nrows())
        .map(|k| {
            let shares: Vec<f64> = folds.iter().map(|f| (1.0 - f[(k, k)] / s[(k, k)]).clamp(0.0, 1.0)).collect();
            aloft_identify::jackknife_freedom(&shares)
        })
        .collect()
}

/// Scores columns that do not depend on the fold.
pub(crate) fn score<'a>(problem: &Problem, variant: Variant<'a>, reduced: &Reduced) -> Scored<'a> {
    let theta = solve(&reduced.s, &reduced.c, &variant.coefficients).0;
    let n = problem.folds.len();
    let mut out = Scored {
        fold_nonlinear: vec![variant.nonlinear.clone(); n],
        theta,
        fold_theta: Vec::with_capacity(n),
        fold_error: Vec::with_capacity(n),
        joint_se: Vec::new(),
        freedom: fold_freedom(&reduced.s, reduced.folds.iter().map(|f| &f.s)),
        widening: Vec::new(),
        s: reduced.s.clone(),
        variant,
    };
    for (fold, r) in problem.folds.iter().zip(&reduced.folds) {
        let theta = solve(&r.s, &r.c, &out.variant.coefficients).0;
        out.fold_error.push((&fold.test - &r.test * &theta).norm_squared());
        out.fold_theta.push(theta);
    }
    out
}
