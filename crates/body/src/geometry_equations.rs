//! Normal equations of a body's geometry over many frames, the posture of each frame eliminated.
//!
//! Marker coordinates, joint positions and axes are estimated together with the posture of every
//! frame. Each posture is the one that fits its frame best for the present geometry (variable
//! projection: Golub and Pereyra, *SIAM J. Numer. Anal.* 10, 1973), so that its block of the normal
//! equations can be eliminated and only the geometry remains, however many frames there are:
//!
//! ```text
//! H = Σ ( H_gg − H_gq H_qq⁻¹ H_qg )        gradient = Σ ( Jᵀ_g W r − H_gq H_qq⁻¹ Jᵀ_q W r )
//! ```
//!
//! The last term is zero where the posture is settled; with it, both move in one Gauss-Newton step.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Vector3};

/// A factor of the posture's block of one frame, `H_qq = Lᵀ D L` or `L D Lᵀ`.
pub trait PostureFactor {
    /// Replaces x (length nv) by y such that `Σ_k inverse_pivot(k) y_k z_k = xᵀ H_qq⁻¹ w`, z from w
    /// likewise.
    fn half_solve(&self, x: &mut [f64]);
    /// 1 / D_kk.
    fn inverse_pivot(&self, k: usize) -> f64;
}

impl PostureFactor for Cholesky<f64, Dyn> {
    fn half_solve(&self, x: &mut [f64]) {
        let l = self.l_dirty();
        for k in 0..x.len() {
            let value = x[k] / l[(k, k)];
            x[k] = value;
            if value != 0.0 {
                for i in k + 1..x.len() {
                    x[i] -= l[(i, k)] * value;
                }
            }
        }
    }
    fn inverse_pivot(&self, _: usize) -> f64 {
        1.0
    }
}

/// Sums over frames.
#[derive(Debug, Clone)]
pub struct GeometryEquations {
    /// n × n, its lower triangle while frames are added.
    matrix: DMatrix<f64>,
    gradient: DVector<f64>,
    /// nv × n, of the present frame.
    cross: DMatrix<f64>,
    row: Vec<f64>,
}

impl GeometryEquations {
    /// For `unknowns` of the geometry and `nv` coordinates of a posture.
    pub fn new(unknowns: usize, nv: usize) -> Self {
        Self {
            matrix: DMatrix::zeros(unknowns, unknowns),
            gradient: DVector::zeros(unknowns),
            cross: DMatrix::zeros(nv, unknowns),
            row: vec![0.0; unknowns],
        }
    }

    /// Adds a measured point of the present frame. `residual` is its predicted minus its measured
    /// position, m; `geometry` and `posture` are the derivatives of the predicted position with
    /// respect to the unknowns with these indices.
    pub fn add_point(
        &mut self,
        weight: f64,
        residual: &Vector3<f64>,
        geometry: &[(usize, Vector3<f64>)],
        posture: &[(usize, Vector3<f64>)],
    ) {
        for (a, &(i, column)) in geometry.iter().enumerate() {
            let weighted = column * weight;
            self.gradient[i] += weighted.dot(residual);
            for &(j, other) in &geometry[..=a] {
                let (row, col) = if i >= j { (i, j) } else { (j, i) };
                self.matrix[(row, col)] += weighted.dot(&other);
            }
            for &(c, motion) in posture {
                self.cross[(c, i)] += weighted.dot(&motion);
            }
        }
    }

    /// Ends the present frame: subtracts the Schur complement of its posture. `posture_gradient` is
    /// `Jᵀ_q W r` (length nv); `None` for a settled posture, where it is zero.
    pub fn eliminate_posture(&mut self, factor: &impl PostureFactor, posture_gradient: Option<&mut [f64]>) {
        self.eliminate_posture_with(factor, posture_gradient, &mut []);
    }

    /// As [`eliminate_posture`](Self::eliminate_posture), with further gradients over the same
    /// frames: pairs of `Jᵀ_q W e` (nv, lost) and the sum of `Jᵀ_γ W e` (n), less the posture's
    /// share at the end.
    pub fn eliminate_posture_with(
        &mut self,
        factor: &impl PostureFactor,
        posture_gradient: Option<&mut [f64]>,
        further: &mut [(DVector<f64>, &mut DVector<f64>)],
    ) {
        for mut column in self.cross.column_iter_mut() {
            factor.half_solve(column.as_mut_slice());
        }
        if let Some(half) = posture_gradient {
            factor.half_solve(half);
            for (c, x) in half.iter().enumerate() {
                let share = x * factor.inverse_pivot(c);
                for (g, cross) in self.gradient.iter_mut().zip(self.cross.row(c).iter()) {
                    *g -= share * cross;
                }
            }
        }
        for (half, gradient) in further {
            factor.half_solve(half.as_mut_slice());
            for (c, x) in half.iter().enumerate() {
                let share = x * factor.inverse_pivot(c);
                for (g, cross) in gradient.iter_mut().zip(self.cross.row(c).iter()) {
                    *g -= share * cross;
                }
            }
        }
        let n = self.gradient.len();
        for c in 0..self.cross.nrows() {
            let inverse = factor.inverse_pivot(c);
            for (i, x) in self.row.iter_mut().enumerate() {
                *x = self.cross[(c, i)];
            }
            for j in 0..n {
                let share = self.row[j] * inverse;
                if share != 0.0 {
                    let target = &mut self.matrix.as_mut_slice()[j * n + j..(j + 1) * n];
                    for (t, r) in target.iter_mut().zip(&self.row[j..]) {
                        *t -= share * r;
                    }
                }
            }
        }
        self.cross.fill(0.0);
    }

    /// Adds the sums over other frames.
    pub fn merge(&mut self, other: &Self) {
        self.matrix += &other.matrix;
        self.gradient += &other.gradient;
    }

    /// The matrix (symmetric, n × n) and the gradient (n). The geometry changes by
    /// `−H⁻¹ gradient`.
    pub fn finish(self) -> (DMatrix<f64>, DVector<f64>) {
        let Self { mut matrix, gradient, .. } = self;
        matrix.fill_upper_triangle_with_lower_triangle();
        (matrix, gradient)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The eliminated equations give the same step as the whole ones.
        #[test]
        fn prop_elimination_equals_the_whole_system(values in proptest::collection::vec(-1.0_f64..1.0, 2 * 5 * 3 * 8)) {
            let (n, nv) = (4, 3);
            let mut made = GeometryEquations::new(n, nv);
            // two frames of five points: unknowns of the geometry, then of each posture
            let mut whole = DMatrix::zeros(n + 2 * nv, n + 2 * nv);
            let mut right = DVector::zeros(n + 2 * nv);
            for frame in 0..2 {
                let of = |point: usize, column: usize| {
                    Vector3::from_fn(|k, _| values[((frame * 5 + point) * 3 + k) * 8 + column])
                };
                let jacobian = DMatrix::from_fn(15, nv, |i, c| of(i / 3, n + c)[i % 3]);
                let block = jacobian.tr_mul(&jacobian) + DMatrix::identity(nv, nv) * 0.1;
                let residuals = DVector::from_fn(15, |i, _| of(i / 3, 7)[i % 3]);
                for point in 0..5 {
                    let geometry: Vec<_> = (0..n).map(|i| (i, of(point, i))).collect();
                    let posture: Vec<_> = (0..nv).map(|c| (c, of(point, n + c))).collect();
                    let residual = Vector3::from_fn(|k, _| residuals[3 * point + k]);
                    made.add_point(2.0, &residual, &geometry, &posture);
                    let all: Vec<(usize, Vector3<f64>)> = geometry
                        .iter()
                        .copied()
                        .chain(posture.iter().map(|(c, v)| (n + frame * nv + c, *v)))
                        .collect();
                    for (i, a) in &all {
                        right[*i] += 2.0 * a.dot(&residual);
                        for (j, b) in &all {
                            whole[(*i, *j)] += 2.0 * a.dot(b);
                        }
                    }
                }
                let at = n + frame * nv;
                for c in 0..nv {
                    whole[(at + c, at + c)] += 0.2;
                }
                let factor = (block * 2.0).cholesky();
                prop_assert!(factor.is_some());
                if let Some(factor) = factor {
                    let mut gradient = jacobian.tr_mul(&residuals) * 2.0;
                    made.eliminate_posture(&factor, Some(gradient.as_mut_slice()));
                }
            }
            let (mut matrix, gradient) = made.finish();
            for i in 0..n {
                matrix[(i, i)] += 1.0;
                whole[(i, i)] += 1.0;
            }
            let one = matrix.cholesky().map(|c| c.solve(&gradient));
            let other = whole.cholesky().map(|c| c.solve(&right));
            prop_assert!(one.is_some() && other.is_some());
            if let (Some(one), Some(other)) = (one, other) {
                prop_assert!((one - other.rows(0, n)).amax() < 1e-9);
            }
        }
    }
}
