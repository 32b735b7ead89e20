//! Information of recorded flights, and what flights that were not recorded would add to it.
//!
//! In coordinates in which the prior's covariance (given the mass) is the identity, rows A of
//! standard deviation s leave the covariance `(1 + Lᵀ AᵀA L / s²)⁻¹`, with the root L of the
//! prior's covariance. Its trace divided by its size is the share of the prior's variance that is
//! left: the criterion by which flights are planned (A-optimality; Pukelsheim, *Optimal Design of
//! Experiments*, 1993, ch. 6). It weighs directions that are badly seen most.

use crate::{IdentifyError, Prior};
use aloft_regressor::Factor;
use nalgebra::{DMatrix, DVector};

/// Information on base parameters, given the mass.
#[derive(Debug, Clone)]
pub struct Design {
    /// Root of the prior's covariance of all base parameters but the mass.
    root: DMatrix<f64>,
    /// `1 + Lᵀ AᵀA L / s²`.
    information: DMatrix<f64>,
    row_sd: f64,
}

impl Design {
    /// Information of the prior alone; `row_sd` is [`crate::Parameters::row_sd`] of the same rows.
    ///
    /// # Errors
    /// [`IdentifyError::Option`] for a deviation that is not positive, [`IdentifyError::Numeric`]
    /// for a covariance without a root.
    pub fn of_prior(prior: &Prior, mass_kg: f64, row_sd: f64) -> Result<Self, IdentifyError> {
        if !(row_sd > 0.0 && row_sd.is_finite()) {
            return Err(IdentifyError::Option { option: "row_sd", problem: format!("{row_sd}") });
        }
        let root = prior.prepared(mass_kg)?.root;
        let n = root.ncols();
        Ok(Self { root, information: DMatrix::identity(n, n), row_sd })
    }

    /// Adds rows, `times` over. Their columns of effects are ignored.
    ///
    /// # Errors
    /// [`IdentifyError::Length`] for rows of another model.
    pub fn add(&mut self, factor: &Factor, times: f64) -> Result<(), IdentifyError> {
        self.information += self.of_rows(factor)? * times;
        Ok(())
    }

    /// Share of the prior's variance that is left after adding rows `times` over: 1 without
    /// information, 0 with all.
    ///
    /// # Errors
    /// As [`Design::add`], and [`IdentifyError::Numeric`] for rows that are not finite.
    pub fn left_with(&self, factor: &Factor, times: f64) -> Result<f64, IdentifyError> {
        share(&(&self.information + self.of_rows(factor)? * times))
    }

    /// Share of the prior's variance that is left.
    ///
    /// # Errors
    /// [`IdentifyError::Numeric`] for rows that are not finite.
    pub fn left(&self) -> Result<f64, IdentifyError> {
        share(&self.information)
    }

    /// Expected standard errors of all base parameters; zero for the mass, which is first.
    ///
    /// # Errors
    /// [`IdentifyError::Numeric`] for rows that are not finite.
    pub fn sd(&self) -> Result<DVector<f64>, IdentifyError> {
        let inverse = self.information.clone().cholesky().ok_or_else(not_finite)?.l();
        // L M⁻¹ Lᵀ with M = C Cᵀ: the squared columns of C⁻¹ Lᵀ
        let scaled = inverse.solve_lower_triangular(&self.root.transpose()).ok_or_else(not_finite)?;
        let n = self.root.nrows();
        Ok(DVector::from_fn(n + 1, |i, _| if i == 0 { 0.0 } else { scaled.column(i - 1).norm() }))
    }

    fn of_rows(&self, factor: &Factor) -> Result<DMatrix<f64>, IdentifyError> {
        let n = self.root.nrows();
        if factor.n_parameters() != n + 1 {
            return Err(IdentifyError::Length {
                what: "base parameters of the rows",
                expected: n + 1,
                found: factor.n_parameters(),
            });
        }
        let dense = factor.dense();
        // rows of the triangle below the parameters' block hold the measured column only
        let height = dense.nrows().min(n + 1);
        let scaled = dense.view((0, 1), (height, n)) * &self.root / self.row_sd;
        Ok(scaled.tr_mul(&scaled))
    }
}

fn not_finite() -> IdentifyError {
    IdentifyError::Numeric("the information of the rows is not finite".to_owned())
}

fn share(information: &DMatrix<f64>) -> Result<f64, IdentifyError> {
    let n = information.nrows();
    let lower = information.clone().cholesky().ok_or_else(not_finite)?.l();
    let inverse = lower.solve_lower_triangular(&DMatrix::identity(n, n)).ok_or_else(not_finite)?;
    Ok(inverse.norm_squared() / n as f64)
}
