//! How large an error may be of which nothing is missing: noise, an uncertain geometry, and the
//! errors of parameters that few flights determine.

use crate::DiscoverError;
use crate::candidate::pseudo_solve;
use crate::draws::{ContactRows, Drawn, TrialDraws, mean_zeros};
use crate::problem::{Cluster, Domain, Fold, Problem, given_mass};
use crate::session::{Block, Session};
use aloft_regressor::StretchKind;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::sync::Arc;

/// Lever of the moments in the size of an error, m.
const LEVER_M: f64 = 0.1;

impl Session<'_> {
    /// Takes draws of the errors that a model with the true parameters would leave, and computes
    /// from them up to which error they account for the held-out error
    /// ([`HeldOutResult::by_parameters`](crate::HeldOutResult::by_parameters)). The parameters are
    /// fitted to the errors of the flights of the other recordings, as they are fitted to the data,
    /// and the prior is wrong by its own covariance. The result is the upper end of the
    /// prediction interval for one more draw; `spread` is the standard deviation by which the
    /// errors of single bodies differ besides (logarithm; 0 for objects, see
    /// `CompareOptions::floor_spread` of the comparison). `contact` are the rows of
    /// the windows in contact, for which it is computed, too; without them only for flights. Needs
    /// [`with_model_error`](Self::with_model_error) before; trials without draws change nothing.
    #[must_use]
    pub fn with_draws(mut self, draws: &[TrialDraws<'_>], contact: &[ContactRows<'_>], spread: f64) -> Self {
        self.drawn = Arc::new(Drawn { rows: self.drawn_rows(draws), zeros: mean_zeros(draws) });
        let by_parameters = self.by_parameters(draws, contact, spread).unwrap_or_default();
        for (result, by_parameters) in self.model_error.iter_mut().zip(by_parameters) {
            if let Some(result) = result {
                result.by_parameters = by_parameters;
            }
        }
        self
    }

    /// The same in flight and in contact.
    fn by_parameters(
        &self,
        draws: &[TrialDraws<'_>],
        contact: &[ContactRows<'_>],
        spread: f64,
    ) -> Option<[Option<f64>; 2]> {
        /// A recording is predicted from the others, as in the comparison.
        const FEWEST_TRIALS: usize = 2;
        // The prior weighs as in the fit to the data. An effect that the model lacks makes the rows
        // agree less with the fit, and would let the prior weigh more: no more than the floor does.
        let floor = (self.model_error[0]?.noise_floor / self.unit[0]).powi(2);
        let problem_with =
            |variance| self.or_named(Problem::with_variance(self, Domain::Flight, &[], FEWEST_TRIALS, 1.0, variance));
        let own = problem_with(None)?;
        let problem = if own.variance <= floor { own } else { problem_with(Some(floor))? };
        // rows to newtons, moments over the lever
        let newtons = |row: usize| if Block::is_force(row) { self.unit[0] } else { self.unit[1] / LEVER_M };
        let windows = problem.n_judged as f64 / 6.0;
        let prior = problem.prior_error(newtons);
        let rows = &self.drawn.rows;
        let flight: Vec<f64> = rows.iter().map(|r| (problem.refitted(r, newtons) + prior) / windows).collect();
        let in_contact = self.contact_squares(&problem, rows, draws, contact);
        Some([most_of(&flight, spread), most_of(&in_contact, spread)])
    }

    /// Mean square in contact of each draw, N².
    fn contact_squares(
        &self,
        problem: &Problem,
        flights: &[Vec<DVector<f64>>],
        draws: &[TrialDraws<'_>],
        contact: &[ContactRows<'_>],
    ) -> Vec<f64> {
        let refits: Vec<_> = flights.iter().map(|rows| problem.refits(rows)).collect();
        let newtons = |row: usize| if row % 6 < 3 { 1.0 } else { LEVER_M.recip() };
        let mut squares = vec![0.0; flights.len()];
        let mut count = 0;
        for its in contact {
            let Some(own) = draws.iter().find(|d| d.trial == its.trial) else { continue };
            let Some(trial) = self.trials.iter().position(|t| t == its.trial) else { continue };
            let windows: Vec<usize> = (0..own.centres.len()).filter(|&w| !own.in_flight[w]).collect();
            if 6 * windows.len() != its.rows.nrows() || windows.is_empty() {
                continue;
            }
            let Some(rows) = self.or_named(problem.scaled(self, its.rows)) else { continue };
            let prior = problem.prior_error_of(&rows, trial, newtons);
            for ((sum, refit), errors) in squares.iter_mut().zip(&refits).zip(own.errors) {
                let change = &rows * refit.without(trial);
                *sum += prior;
                for (i, &w) in windows.iter().enumerate() {
                    for axis in 0..6 {
                        let row = 6 * i + axis;
                        let error = errors.get(6 * w + axis).map_or(0.0, |e| f64::from(*e));
                        *sum += (newtons(row) * (error - change[row])).powi(2);
                    }
                }
            }
            count += windows.len();
        }
        if count == 0 { Vec::new() } else { squares.iter().map(|s| s / count as f64).collect() }
    }

    /// Errors of every draw in the rows of every block, in the weights of the rows. Stretches of
    /// contact without draws have none; without those of a flight there are none at all.
    fn drawn_rows(&self, draws: &[TrialDraws<'_>]) -> Vec<Vec<DVector<f64>>> {
        let n = draws.iter().filter(|d| !d.centres.is_empty()).map(|d| d.errors.len()).min().unwrap_or(0);
        let of_block = |block: &Block, draw: usize| match self.rows_of_draw(block, draws, draw) {
            None if block.kind == StretchKind::Contact => Some(DVector::zeros(block.y.nrows())),
            rows => rows,
        };
        let of_draw = |k: usize| self.blocks.iter().map(|block| of_block(block, k)).collect::<Option<Vec<_>>>();
        (0..n).map(of_draw).collect::<Option<_>>().unwrap_or_default()
    }

    /// Errors of one draw in the rows of a block; none where a window has no draw.
    fn rows_of_draw(&self, block: &Block, draws: &[TrialDraws<'_>], draw: usize) -> Option<DVector<f64>> {
        let mut rows = DVector::zeros(block.y.nrows());
        let own = draws.iter().find(|d| d.trial == self.trials[block.trial])?;
        let alike = |w: &usize| own.in_flight[*w] == (block.kind != StretchKind::Contact);
        for (w, centre) in block.windows.centres.iter().enumerate() {
            // windows of the comparison may lie a little beside those of the rows
            let beside = |at: usize| own.centres[at].abs_diff(*centre);
            let at = (0..own.centres.len()).filter(alike).min_by_key(|at| beside(*at))?;
            if 2 * beside(at) > block.windows.half {
                return None;
            }
            for axis in 0..6 {
                let error = f64::from(*own.errors[draw].get(6 * at + axis)?);
                rows[6 * w + axis] = error / if axis < 3 { self.unit[0] } else { self.unit[1] };
            }
        }
        if let Some(zero) = &block.zero {
            rows -= zero * zero.tr_mul(&rows);
        }
        Some(rows)
    }

    /// Standard deviations of the unknowns of `columns` (by cluster) over the draws: what noise of
    /// markers and plates and an uncertain geometry change in them, with the body's parameters
    /// refitted. `further` gives for each draw what the geometry changes in the rows besides
    /// (`None`: nothing). The mean of the changes is zero, so that there are as many degrees of
    /// freedom as draws. None without draws.
    pub(crate) fn drawn_deviations(
        &self,
        problem: &Problem,
        columns: &[DMatrix<f64>],
        further: &dyn Fn(usize) -> Option<Vec<DVector<f64>>>,
    ) -> Option<(Vec<f64>, f64)> {
        let n = self.drawn.rows.len() as f64;
        let change = |(draw, rows): (usize, &Vec<DVector<f64>>)| match further(draw) {
            Some(more) => problem.change(columns, &rows.iter().zip(&more).map(|(a, b)| a + b).collect::<Vec<_>>()),
            None => problem.change(columns, rows),
        };
        let changes: Vec<DVector<f64>> = self.drawn.rows.iter().enumerate().map(change).collect();
        let unknowns = changes.first()?.len();
        let of = |i: usize| (changes.iter().map(|c| c[i] * c[i]).sum::<f64>() / n).sqrt();
        Some(((0..unknowns).map(of).collect(), n))
    }
}

/// What noise changes in the scaled parameters.
pub(crate) struct Refits {
    /// Trial and change without it.
    without: Vec<(usize, DVector<f64>)>,
    all: DVector<f64>,
}

impl Refits {
    /// The change without a trial; with all trials if it has no flights.
    pub fn without(&self, trial: usize) -> &DVector<f64> {
        self.without.iter().find(|w| w.0 == trial).map_or(&self.all, |w| &w.1)
    }
}

impl Problem {
    /// Rows given by block, by cluster; blocks that have no rows here are left out.
    pub(crate) fn by_cluster(&self, rows: &[DVector<f64>]) -> Vec<DVector<f64>> {
        let gathered = |c: &Cluster| {
            let all: Vec<f64> = c.blocks.iter().flat_map(|&i| rows[i].iter().copied()).collect();
            DVector::from_vec(all)
        };
        self.clusters.iter().map(gathered).collect()
    }

    /// What noise of the rows, by block, changes in the unknowns of `columns`, by cluster, with the
    /// body's parameters refitted.
    fn change(&self, columns: &[DMatrix<f64>], noise: &[DVector<f64>]) -> DVector<f64> {
        let (ac, cc, _) = self.products(columns, None);
        let x = self.cholesky.solve(&ac);
        let mut right = DVector::zeros(cc.ncols());
        let mut of_body = DVector::zeros(self.right.len());
        for ((cluster, c), e) in self.clusters.iter().zip(columns).zip(self.by_cluster(noise)) {
            right.gemv_tr(1.0, c, &e, 1.0);
            of_body.gemv_tr(1.0, &cluster.a, &e, 1.0);
        }
        pseudo_solve(&(cc - ac.tr_mul(&x)), &(right - x.tr_mul(&of_body)))
    }

    /// Held-out sum of squares where the rows' measured side is noise alone, by block, and the
    /// parameters are fitted to the noise of the other clusters:
    /// `e_g − A_g M_g⁻¹ Σ_{h≠g} A_hᵀ e_h`. Rows are multiplied by `scale` before they are squared.
    pub fn refitted(&self, noise: &[DVector<f64>], scale: impl Fn(usize) -> f64) -> f64 {
        let errors = self.by_cluster(noise);
        let slopes: Vec<DVector<f64>> = self.clusters.iter().zip(&errors).map(|(c, e)| c.a.tr_mul(e)).collect();
        let all = slopes.iter().fold(DVector::zeros(self.right.len()), |s, x| s + x);
        let mut sum = 0.0;
        for (((c, fold), e), own) in self.clusters.iter().zip(&self.folds).zip(&errors).zip(&slopes) {
            let test = e - &c.a * fold.cholesky.solve(&(&all - own));
            sum += c.judged.iter().map(|&row| (scale(row) * test[row]).powi(2)).sum::<f64>();
        }
        sum
    }

    /// The change of the scaled parameters that noise causes, as in [`refitted`](Self::refitted):
    /// from all clusters and from all but those of each trial.
    pub fn refits(&self, noise: &[DVector<f64>]) -> Refits {
        let errors = self.by_cluster(noise);
        let slopes: Vec<DVector<f64>> = self.clusters.iter().zip(&errors).map(|(c, e)| c.a.tr_mul(e)).collect();
        let all = slopes.iter().fold(DVector::zeros(self.right.len()), |s, x| s + x);
        let own = |(g, (c, fold)): (usize, (&Cluster, &Fold))| (c.trial, fold.cholesky.solve(&(&all - &slopes[g])));
        Refits {
            without: self.clusters.iter().zip(&self.folds).enumerate().map(own).collect(),
            all: self.cholesky.solve(&all),
        }
    }

    /// Rows of base parameters (the mass first) as rows of the scaled parameters.
    pub fn scaled(&self, session: &Session<'_>, rows: &DMatrix<f64>) -> Result<DMatrix<f64>, DiscoverError> {
        let p = rows.ncols();
        let (_, root) = given_mass(session, p)?;
        Ok(rows.columns(1, p - 1) * root)
    }

    /// [`prior_error`](Self::prior_error) of other rows of scaled parameters, in a trial that is
    /// left out.
    pub fn prior_error_of(&self, rows: &DMatrix<f64>, trial: usize, scale: impl Fn(usize) -> f64) -> f64 {
        let fold = self.clusters.iter().position(|c| c.trial == trial).map(|g| &self.folds[g].cholesky);
        let to_rows = fold.unwrap_or(&self.cholesky).solve(&rows.transpose());
        let of_row = |row: usize| -> f64 {
            to_rows.column(row).iter().zip(&self.ridge).map(|(x, w)| (scale(row) * x * w).powi(2)).sum()
        };
        (0..rows.nrows()).map(of_row).sum()
    }

    /// Mean of the held-out sum of squares that a prior adds which is wrong by its own covariance:
    /// `‖A_g M_g⁻¹ w‖²` over the clusters, with w the weights of the prior's rows.
    pub fn prior_error(&self, scale: impl Fn(usize) -> f64 + Sync) -> f64 {
        let parts = self.clusters.par_iter().zip(&self.folds).map(|(c, fold)| -> f64 {
            let to_rows = fold.cholesky.solve(&c.a.transpose());
            let of_row = |row: usize| -> f64 {
                to_rows.column(row).iter().zip(&self.ridge).map(|(x, w)| (scale(row) * x * w).powi(2)).sum()
            };
            c.judged.iter().map(|&row| of_row(row)).sum()
        });
        parts.collect::<Vec<f64>>().iter().sum()
    }
}

/// From mean squares of draws: the upper end of the prediction interval of the root of one more.
/// `spread` is what one set of recordings differs from the draws by (logarithm).
fn most_of(squares: &[f64], spread: f64) -> Option<f64> {
    let logs: Vec<f64> = squares.iter().map(|s| 0.5 * s.ln()).collect();
    let (mean, reach) = aloft_signal::one_more(&logs, spread)?;
    Some((mean + reach).exp()).filter(|error| error.is_finite())
}
