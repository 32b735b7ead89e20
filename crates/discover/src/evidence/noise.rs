//! The covariance of the rows' errors, from the draws that the comparison made, and rows in its
//! units.
//!
//! Draws of the errors of markers, plates and geometry give each row its errors ([`crate::drawn`]).
//! For each kind of motion and axis their autocorrelation over neighbouring windows is pooled over
//! all stretches, tapered (Bartlett) and divided by one count for all lags, so that it is positive
//! definite; the variance of a stretch is between its own and that of all. With the inverse root
//! L⁻¹ of that covariance the rows become `L⁻¹(Y φ − w)` with errors of unit variance. What all
//! recordings have alike is a sum of the draws with random coefficients: a few columns with a
//! prior.

use super::priors::{LINKED, OWN, POOLED, SHARED};
use crate::problem::{Domain, given_mass};
use crate::session::{Block, Session, White};
use aloft_effects::{EFFECTS, Effect, Target};
use aloft_regressor::StretchKind;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::sync::Arc;

/// A session in units of its noise.
pub(super) struct InNoiseUnits<'a> {
    pub session: Session<'a>,
    /// Columns of the errors that all recordings share, by block, for coefficients of unit
    /// variance.
    pub shared: Vec<DMatrix<f64>>,
    /// Number of rows that carry information.
    pub rows: usize,
    /// What drawn errors of the motion change in the rows, by draw and block; empty where no motion
    /// is drawn.
    pub errors: Vec<Vec<MotionError>>,
}

/// What drawn errors of the motion change in the rows of a block, in units of the noise.
pub(super) struct MotionError {
    /// Rows of the scaled parameters.
    pub rows: DMatrix<f64>,
    /// Measured side, less what the mass and the prior's mean account for.
    pub measured: DVector<f64>,
}

/// Variance and autocorrelation of one axis in one kind of motion.
#[derive(Clone, Default)]
struct Pooled {
    /// Sums of products by lag, and the number of squares.
    products: [f64; LINKED + 1],
    count: usize,
}

impl Pooled {
    fn variance(&self) -> Option<f64> {
        (self.count > 0 && self.products[0] > 0.0).then(|| self.products[0] / self.count as f64)
    }

    fn correlation(&self, lag: usize) -> f64 {
        let taper = 1.0 - lag as f64 / (LINKED + 1) as f64;
        self.products.get(lag).map_or(0.0, |p| taper * p / self.products[0])
    }
}

fn kind(block: &Block) -> usize {
    usize::from(block.kind == StretchKind::Contact)
}

/// Number of window steps between windows `a` and `b` of a block.
fn lag(block: &Block, step: usize, a: usize, b: usize) -> usize {
    let centres = &block.windows.centres;
    (centres[a].abs_diff(centres[b]) + step / 2) / step
}

/// Frames between neighbouring windows.
fn step(block: &Block) -> usize {
    let apart = block.windows.centres.windows(2).map(|w| w[0].abs_diff(w[1]));
    apart.filter(|d| *d > 0).min().unwrap_or(1)
}

impl<'a> Session<'a> {
    /// The session with its rows in units of their noise; none if no draws of it exist for the
    /// flights, or without flights for contact. Contact without draws is left out.
    pub(super) fn in_noise_units(&self) -> Option<InNoiseUnits<'a>> {
        let draws = &self.drawn.rows;
        if draws.is_empty() {
            return None;
        }
        let mut pooled = vec![Pooled::default(); 12];
        for (i, block) in self.blocks.iter().enumerate() {
            let step = step(block);
            let windows = block.windows.centres.len();
            for rows in draws.iter().map(|d| &d[i]).filter(|rows| rows.len() == 6 * windows && rows.amax() > 0.0) {
                for axis in 0..6 {
                    let of = &mut pooled[6 * kind(block) + axis];
                    of.count += windows;
                    for a in 0..windows {
                        for b in a..windows.min(a + LINKED + 1) {
                            if let Some(sum) = of.products.get_mut(lag(block, step, a, b)) {
                                *sum += rows[6 * a + axis] * rows[6 * b + axis];
                            }
                        }
                    }
                }
            }
        }
        let known = |block: &Block| (0..6).all(|axis| pooled[6 * kind(block) + axis].variance().is_some());
        let kept: Vec<bool> = self.blocks.iter().map(|b| b.y.nrows() > 0 && known(b)).collect();
        if !kept.contains(&true) {
            return None;
        }
        let mut session = self.with_rows_of(&kept);
        let mut shared = Vec::with_capacity(session.blocks.len());
        let mut rows = 0;
        let share = (SHARED / draws.len() as f64).sqrt();
        for (i, block) in session.blocks.iter_mut().enumerate() {
            let n = block.y.nrows();
            let mut columns = DMatrix::from_fn(n, draws.len(), |r, d| share * session.drawn.rows[d][i][r]);
            if n > 0 {
                let white = inverse_root(block, &pooled, draws.iter().map(|d| &d[i]))?;
                block.y = white.times(&block.y);
                block.w = white.times(&column(&block.w)).column(0).into_owned();
                columns = white.times(&columns);
                rows += n - block.zero.as_ref().map_or(0, |z| z.ncols());
                block.white = Some(Arc::new(white));
            }
            shared.push(columns);
        }
        if session.prior.is_some() {
            session.usual_errors(&mut shared);
        }
        seen_directions(&mut shared);
        let errors = session.motion_errors()?;
        Some(InNoiseUnits { session, shared, rows, errors })
    }
}

impl Session<'_> {
    /// Adds to `shared` the errors that ordinary recordings of a person have: skin that slides.
    fn usual_errors(&self, shared: &mut [DMatrix<f64>]) {
        let usual = EFFECTS.iter().filter(|e| e.about().usual_sd > 0.0);
        let all: Vec<(&dyn Effect, Target)> =
            usual.flat_map(|e| e.targets(self.scene).into_iter().map(|target| (*e, target))).collect();
        let columns = |(effect, target): (&dyn Effect, Target)| {
            let sd = effect.about().usual_sd;
            let of = self.columns(effect, target, &[], Domain::Both)?;
            Some(of.into_iter().map(|c| c * sd).collect::<Vec<_>>())
        };
        let all: Vec<Vec<DMatrix<f64>>> = all.into_par_iter().filter_map(columns).collect();
        for (i, block) in shared.iter_mut().enumerate() {
            let width = all.iter().map(|c| c[i].ncols()).sum::<usize>();
            let mut at = block.ncols();
            *block = std::mem::take(block).resize_horizontally(at + width, 0.0);
            for columns in all.iter().map(|c| &c[i]) {
                block.columns_mut(at, columns.ncols()).copy_from(columns);
                at += columns.ncols();
            }
        }
    }

    /// What drawn errors of the motion change in the rows, by draw and block.
    fn motion_errors(&self) -> Option<Vec<Vec<MotionError>>> {
        let p = self.blocks.first()?.y.ncols();
        let (mean, root) = given_mass(self, p).ok()?; // none: a body without parameters has no rows
        let of_block = |block: &Block, ahead: &Block, behind: &Block| {
            let (y, w) = ((&ahead.y - &behind.y) * 0.5, (&ahead.w - &behind.w) * 0.5);
            let (y, w) = match &block.white {
                Some(white) => (white.times(&y), white.times(&column(&w)).column(0).into_owned()),
                None => (DMatrix::zeros(0, p), DVector::zeros(0)),
            };
            let own = y.columns(1, p - 1);
            MotionError { rows: own * &root, measured: w - y.column(0) * self.mass_kg - own * &mean }
        };
        let of_pair = |[ahead, behind]: &[Session<'_>; 2]| {
            let blocks = self.blocks.iter().zip(&ahead.blocks).zip(&behind.blocks);
            blocks.map(|((block, ahead), behind)| of_block(block, ahead, behind)).collect()
        };
        Some(self.disturbed.iter().map(of_pair).collect())
    }
}

/// Turns columns with coefficients of unit variance to their principal directions, and leaves out
/// those that change all rows together by less than the noise of one of them.
fn seen_directions(columns: &mut [DMatrix<f64>]) {
    let Some(width) = columns.first().map(DMatrix::ncols).filter(|w| *w > 0) else { return };
    let gram = columns.iter().fold(DMatrix::zeros(width, width), |sum, c| sum + c.tr_mul(c));
    let eigen = gram.symmetric_eigen();
    let seen: Vec<_> = (0..width).filter(|&i| eigen.eigenvalues[i] > 1.0).collect();
    let turned = eigen.eigenvectors.select_columns(&seen);
    columns.par_iter_mut().for_each(|c| *c = &*c * &turned);
}

/// L⁻¹ of the covariance of a block's rows.
fn inverse_root<'d>(block: &Block, pooled: &[Pooled], draws: impl Iterator<Item = &'d DVector<f64>>) -> Option<White> {
    let n = block.y.nrows();
    let (mut own, mut count) = ([0.0; 6], 0);
    for rows in draws.filter(|rows| rows.amax() > 0.0) {
        rows.iter().enumerate().for_each(|(row, x)| own[row % 6] += x * x);
        count += n / 6;
    }
    let variance = |axis: usize| {
        let of_all = pooled[6 * kind(block) + axis].variance()?;
        Some(if count > 0 { POOLED * of_all + (1.0 - POOLED) * own[axis] / count as f64 } else { of_all })
    };
    let variances: Option<Vec<f64>> = (0..6).map(variance).collect();
    let (variances, step) = (variances?, step(block));
    let windows = n / 6;
    let of_axis = |axis: usize| {
        DMatrix::from_fn(windows, windows, |a, b| {
            let own = if a == b { OWN } else { 0.0 };
            variances[axis] * (pooled[6 * kind(block) + axis].correlation(lag(block, step, a, b)) + own)
        })
    };
    let Some(zero) = &block.zero else {
        let roots: Option<Vec<DMatrix<f64>>> = (0..6).map(|axis| inverse(of_axis(axis))).collect();
        return Some(White::ByAxis(roots?.try_into().ok()?)); // none: there are six
    };
    let axes: Vec<DMatrix<f64>> = (0..6).map(of_axis).collect();
    let at = |i: usize, j: usize| if i % 6 == j % 6 { axes[i % 6][(i / 6, j / 6)] } else { 0.0 };
    let mut covariance = DMatrix::from_fn(n, n, at);
    // the rows have nothing along the plates' zero: any variance does there
    let scale = covariance.trace() / n as f64;
    covariance -= zero * zero.tr_mul(&covariance);
    covariance -= (&covariance * zero) * zero.transpose();
    covariance.gemm(scale, zero, &zero.transpose(), 1.0);
    inverse(covariance).map(White::Whole)
}

/// Inverse of the Cholesky factor.
fn inverse(covariance: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = covariance.nrows();
    covariance.cholesky()?.unpack().solve_lower_triangular(&DMatrix::identity(n, n))
}

fn column(rows: &DVector<f64>) -> DMatrix<f64> {
    DMatrix::from_column_slice(rows.len(), 1, rows.as_slice())
}
