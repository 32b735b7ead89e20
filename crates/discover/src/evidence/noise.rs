//! The covariance of the rows' errors, from the draws that the comparison made, and rows in its
//! units.
//!
//! Draws of the errors of markers, plates and geometry give each row its errors ([`crate::drawn`]).
//! For each kind of motion and axis one autoregression describes how they follow each other over
//! the windows of all stretches; the variance of a stretch is between its own and that of all. With
//! the inverse root L⁻¹ of that covariance the rows become `L⁻¹(Y φ − w)` with errors of unit
//! variance. What every recording of a person has alike is a few columns with a prior.

use super::autoregression::Pooled;
use super::priors::POOLED;
use crate::DiscoverError;
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

fn kind(block: &Block) -> usize {
    usize::from(block.kind == StretchKind::Contact)
}

/// Where each window of a block stands in steps from one window to the next; where windows were
/// left out, numbers are.
fn places(block: &Block) -> Vec<usize> {
    let apart: Vec<usize> = block.windows.centres.windows(2).map(|w| w[1].abs_diff(w[0])).collect();
    // window steps differ by a frame, where they are no whole number of frames
    let step = apart.iter().copied().filter(|d| *d > 0).min().unwrap_or(1);
    let steps = |frames: &usize| ((frames + step / 2) / step).max(1);
    let next = |at: &mut usize, frames: &usize| {
        *at += steps(frames);
        Some(*at)
    };
    std::iter::once(0).chain(apart.iter().scan(0, next)).take(block.windows.centres.len()).collect()
}

/// An axis of rows in windows that follow each other by one step: where others were left out
/// between them, another series begins.
fn runs(block: &Block, rows: &DVector<f64>, axis: usize) -> Vec<Vec<f64>> {
    let windows: Vec<(usize, usize)> = places(block).into_iter().enumerate().collect();
    let together = windows.chunk_by(|a, b| b.1 - a.1 == 1);
    together.map(|run| run.iter().map(|(w, _)| rows[6 * w + axis]).collect()).collect()
}

impl<'a> Session<'a> {
    /// The session with its rows in units of their noise; none if no draws of it exist for the
    /// flights, or without flights for contact. Contact without draws is left out.
    pub(super) fn in_noise_units(&self) -> Option<InNoiseUnits<'a>> {
        let draws = &self.drawn.rows;
        if draws.is_empty() {
            return None;
        }
        let pooled = self.pooled(draws);
        let known = |block: &Block| (0..6).all(|axis| pooled[6 * kind(block) + axis].is_some());
        let kept: Vec<bool> = self.blocks.iter().map(|b| b.y.nrows() > 0 && known(b)).collect();
        if !kept.contains(&true) {
            return None;
        }
        let mut session = self.with_rows_of(&kept);
        let mut draws = session.drawn.rows.clone();
        if session.prior.is_some() {
            let white = session.whites(&pooled, &draws)?;
            session.take_out_parameters(&white, &mut draws).ok()?; // none: rows without parameters
        }
        let pooled = session.pooled(&draws);
        let whites = session.whites(&pooled, &draws)?;
        let mut rows = 0;
        for (block, white) in session.blocks.iter_mut().zip(whites) {
            let Some(white) = white else { continue };
            block.y = white.times(&block.y);
            block.w = white.times(&column(&block.w)).column(0).into_owned();
            rows += block.y.nrows() - block.zero.as_ref().map_or(0, |z| z.ncols());
            block.white = Some(Arc::new(white));
        }
        let mut shared: Vec<DMatrix<f64>> = session.blocks.iter().map(|b| DMatrix::zeros(b.y.nrows(), 0)).collect();
        if session.prior.is_some() {
            session.usual_errors(&mut shared);
        }
        seen_directions(&mut shared);
        let errors = session.motion_errors()?;
        Some(InNoiseUnits { session, shared, rows, errors })
    }
}

impl Session<'_> {
    /// Variance and autocorrelation of draws by kind of motion and axis; none where no draw has an
    /// error.
    fn pooled(&self, draws: &[Vec<DVector<f64>>]) -> Vec<Option<Pooled>> {
        let mut series: [Vec<Vec<f64>>; 12] = Default::default();
        for (i, block) in self.blocks.iter().enumerate() {
            let with_errors = |rows: &&DVector<f64>| rows.len() == block.y.nrows() && rows.amax() > 0.0;
            for rows in draws.iter().map(|d| &d[i]).filter(with_errors) {
                (0..6).for_each(|axis| series[6 * kind(block) + axis].extend(runs(block, rows, axis)));
            }
        }
        let lags = self.blocks.iter().filter_map(|b| places(b).last().copied()).max().unwrap_or(0);
        series.par_iter().map(|of| Pooled::of(of, lags)).collect()
    }

    /// L⁻¹ of every block; none in a block without rows.
    fn whites(&self, pooled: &[Option<Pooled>], draws: &[Vec<DVector<f64>>]) -> Option<Vec<Option<White>>> {
        let of = |(i, block): (usize, &Block)| match block.y.nrows() {
            0 => Some(None),
            _ => Some(Some(inverse_root(block, pooled, draws.iter().map(|d| &d[i]))?)),
        };
        self.blocks.iter().enumerate().map(of).collect()
    }

    /// Takes out of draws what the parameters of the body would take of them in a fit: an error of
    /// the geometry is for the greater part a change of parameters, which no data could show.
    fn take_out_parameters(
        &self,
        white: &[Option<White>],
        draws: &mut [Vec<DVector<f64>>],
    ) -> Result<(), DiscoverError> {
        let p = self.blocks.first().map_or(0, |b| b.y.ncols());
        let (_, root) = given_mass(self, p)?;
        let own: Vec<DMatrix<f64>> = self.blocks.iter().map(|b| b.y.columns(1, p - 1) * &root).collect();
        let blocks: Vec<(usize, DMatrix<f64>, &White)> = own
            .iter()
            .zip(white)
            .enumerate()
            .filter_map(|(i, (own, white))| Some((i, white.as_ref()?.times(own), white.as_ref()?)))
            .collect();
        let mut gram = DMatrix::identity(p - 1, p - 1);
        blocks.iter().for_each(|(_, a, _)| gram += a.tr_mul(a));
        let cholesky = gram.cholesky().ok_or_else(|| DiscoverError::Numeric("the prior is not finite".to_owned()))?;
        draws.par_iter_mut().for_each(|draw| {
            let mut right = DVector::zeros(p - 1);
            for (i, a, white) in &blocks {
                right += a.tr_mul(&white.times(&column(&draw[*i])).column(0));
            }
            let z = cholesky.solve(&right);
            draw.iter_mut().zip(&own).filter(|(d, _)| !d.is_empty()).for_each(|(d, own)| *d -= own * &z);
        });
        Ok(())
    }

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
fn inverse_root<'d>(
    block: &Block,
    pooled: &[Option<Pooled>],
    draws: impl Iterator<Item = &'d DVector<f64>>,
) -> Option<White> {
    let n = block.y.nrows();
    let (mut own, mut count) = ([0.0; 6], 0);
    for rows in draws.filter(|rows| !rows.is_empty() && rows.amax() > 0.0) {
        rows.iter().enumerate().for_each(|(row, x)| own[row % 6] += x * x);
        count += n / 6;
    }
    let variance = |axis: usize| {
        let of_all = pooled[6 * kind(block) + axis].as_ref()?.variance;
        Some(if count > 0 { POOLED * of_all + (1.0 - POOLED) * own[axis] / count as f64 } else { of_all })
    };
    let variances: Option<Vec<f64>> = (0..6).map(variance).collect();
    let (variances, places) = (variances?, places(block));
    let windows = n / 6;
    let of_axis = |axis: usize| {
        DMatrix::from_fn(windows, windows, |a, b| {
            let correlation = |p: &Pooled| p.correlation(places[a].abs_diff(places[b]));
            let rounding = if a == b { f64::from(f32::EPSILON) } else { 0.0 };
            variances[axis] * (rounding + pooled[6 * kind(block) + axis].as_ref().map_or(0.0, correlation))
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
