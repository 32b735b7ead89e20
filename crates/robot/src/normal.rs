//! Normal equations of linear rows.

use aloft_regressor::Factor;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Information and right-hand side.
#[derive(Debug, Clone)]
pub(crate) struct Normal {
    pub matrix: DMatrix<f64>,
    pub right: DVector<f64>,
}

impl Normal {
    /// No information about `n` unknowns.
    pub fn zeros(n: usize) -> Self {
        Self { matrix: DMatrix::zeros(n, n), right: DVector::zeros(n) }
    }
    /// Adds the rows of a factor; its columns are the first ones.
    pub fn add(&mut self, factor: &Factor, weight: f64) {
        self.add_rows(&factor.dense(), weight);
    }
    /// Adds rows `[columns | measured]`; their columns are the first ones.
    pub fn add_rows(&mut self, r: &DMatrix<f64>, weight: f64) {
        let n = r.ncols() - 1;
        let product = r.transpose() * r * weight;
        let mut view = self.matrix.view_mut((0, 0), (n, n));
        view += product.view((0, 0), (n, n));
        let mut right = self.right.rows_mut(0, n);
        right += product.view((0, n), (n, 1)).column(0);
    }
    /// The sum with another one, weighted.
    pub fn plus(&self, other: &Self, weight: f64) -> Self {
        Self { matrix: &self.matrix + &other.matrix * weight, right: &self.right + &other.right * weight }
    }
    /// Solution alone.
    pub fn solution(&self) -> Option<DVector<f64>> {
        let right = DMatrix::from_column_slice(self.right.len(), 1, self.right.as_slice());
        Some(Solver::of(&self.matrix)?.solve(&right).column(0).into_owned())
    }
    /// Solution and covariance.
    pub fn solve(&self) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let n = self.right.len();
        let scale = self.matrix.diagonal().map(|d| d.max(f64::MIN_POSITIVE).sqrt().recip());
        let scaled = DMatrix::from_fn(n, n, |i, j| self.matrix[(i, j)] * scale[i] * scale[j]);
        let inverse = scaled.cholesky()?.inverse();
        let covariance = DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] * scale[i] * scale[j]);
        Some((&covariance * &self.right, covariance))
    }
}

/// Solves with the same matrix many times, its columns scaled to one size.
#[derive(Debug, Clone)]
pub(crate) struct Solver {
    factor: Cholesky<f64, Dyn>,
    scale: DVector<f64>,
}

impl Solver {
    /// None for a matrix that is not positive definite.
    pub fn of(matrix: &DMatrix<f64>) -> Option<Self> {
        let n = matrix.nrows();
        let scale = matrix.diagonal().map(|d| d.max(f64::MIN_POSITIVE).sqrt().recip());
        let scaled = DMatrix::from_fn(n, n, |i, j| matrix[(i, j)] * scale[i] * scale[j]);
        Some(Self { factor: scaled.cholesky()?, scale })
    }

    /// Solution for each column of `right`.
    pub fn solve(&self, right: &DMatrix<f64>) -> DMatrix<f64> {
        let mut out = right.clone();
        for mut column in out.column_iter_mut() {
            column.component_mul_assign(&self.scale);
        }
        self.factor.solve_mut(&mut out);
        for mut column in out.column_iter_mut() {
            column.component_mul_assign(&self.scale);
        }
        out
    }
}
