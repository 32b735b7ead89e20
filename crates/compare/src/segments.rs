//! Projects the error on each link's own columns, to show which link's parameters could cause it.
//!
//! For each link alone: the least-squares change of its ten parameters that explains most of the
//! error and the share of the mean square that it explains, and the same with one quadratic-drag
//! force at its centre of mass. Shares of different links overlap and do not add up: a large one
//! shows where to look, not what is wrong.

use crate::errors::MOMENT_LEVER_M;
use aloft_body::{Model, Phi, State};
use nalgebra::{DMatrix, SMatrix, SVector, Vector3, Vector6};
use serde::{Deserialize, Serialize};

type Square = SMatrix<f64, 10, 10>;
type Ten = SVector<f64, 10>;

/// Share of the error that one link could explain.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SegmentShare {
    /// Name of the link.
    pub link: String,
    /// Share of the mean square error (moments over a lever of 0.1 m) that a change of this link's
    /// parameters explains, 0 to 1.
    #[serde(with = "crate::errors::nullable::one")]
    pub inertia_share: f64,
    /// That change, in the order and units of [`aloft_body::PHI_NAMES`]; the smallest one if
    /// several explain the same.
    pub inertia_change: Vec<f64>,
    /// Share that a drag force −c |v| v at the link's centre of mass (from the prior) explains.
    #[serde(with = "crate::errors::nullable::one")]
    pub drag_share: f64,
    /// Its coefficient c, N s²/m².
    #[serde(with = "crate::errors::nullable::one")]
    pub drag_coefficient: f64,
}

/// Normal equations of every link.
#[derive(Debug, Clone)]
pub(crate) struct SegmentSums {
    links: Vec<LinkSums>,
    /// Weighted square of the error, for each model.
    square: Vec<f64>,
}

#[derive(Debug, Clone)]
struct LinkSums {
    normal: Square,
    right: Vec<Ten>,
    drag: f64,
    drag_right: Vec<f64>,
}

fn weighted(w: Vector6<f64>) -> Vector6<f64> {
    let mut w = w;
    for i in 3..6 {
        w[i] /= MOMENT_LEVER_M;
    }
    w
}

impl SegmentSums {
    pub fn new(links: usize, models: usize) -> Self {
        let link = LinkSums {
            normal: Square::zeros(),
            right: vec![Ten::zeros(); models],
            drag: 0.0,
            drag_right: vec![0.0; models],
        };
        Self { links: vec![link; links], square: vec![0.0; models] }
    }

    /// Adds a frame: the full regressor (6 × 10n, root axes) and the error of each model.
    pub fn add(&mut self, state: &State, regressor: &DMatrix<f64>, prior: &[Phi], residual: &[Vector6<f64>]) {
        let weighted_residual: Vec<Vector6<f64>> = residual.iter().map(|e| weighted(*e)).collect();
        for (s, e) in self.square.iter_mut().zip(&weighted_residual) {
            *s += e.norm_squared();
        }
        let root = state.world_from_link[0];
        for (j, link) in self.links.iter_mut().enumerate() {
            let mut columns: SMatrix<f64, 6, 10> = regressor.fixed_view::<6, 10>(0, 10 * j).into();
            for mut row in columns.row_iter_mut().skip(3) {
                row /= MOMENT_LEVER_M;
            }
            link.normal += columns.tr_mul(&columns);
            // |v| v at the link's centre of mass, in root axes
            let mass = prior[j][0];
            let place =
                if mass > 0.0 { Vector3::new(prior[j][1], prior[j][2], prior[j][3]) / mass } else { Vector3::zeros() };
            let v = state.point_velocity_in_world(j, &place);
            let force: Vector3<f64> = root.rotation.inverse() * (v * v.norm());
            let arm = root.rotation.inverse() * (state.point_in_world(j, &place) - root.translation.vector);
            let drag = weighted(crate::errors::joined(&force, &arm.cross(&force)));
            link.drag += drag.norm_squared();
            for ((right, drag_right), e) in link.right.iter_mut().zip(&mut link.drag_right).zip(&weighted_residual) {
                *right += columns.tr_mul(e);
                *drag_right += drag.dot(e);
            }
        }
    }

    pub fn merge(&mut self, other: &Self) {
        for (a, b) in self.square.iter_mut().zip(&other.square) {
            *a += b;
        }
        for (a, b) in self.links.iter_mut().zip(&other.links) {
            a.normal += b.normal;
            a.drag += b.drag;
            for (x, y) in a.right.iter_mut().zip(&b.right) {
                *x += y;
            }
            for (x, y) in a.drag_right.iter_mut().zip(&b.drag_right) {
                *x += y;
            }
        }
    }

    /// Shares for one model, the largest first.
    pub fn shares(&self, model: &Model, which: usize) -> Vec<SegmentShare> {
        let square = self.square[which];
        let mut shares: Vec<SegmentShare> = self
            .links
            .iter()
            .zip(&model.links)
            .map(|(sums, link)| {
                // error = predicted − measured, so the change that removes it has the opposite sign
                let change = -solve(&sums.normal, &sums.right[which]);
                let explained = -change.dot(&sums.right[which]);
                let (drag, right) = (sums.drag, sums.drag_right[which]);
                // drag missing from the model leaves the error −c |v| v
                let coefficient = if drag > 0.0 { -right / drag } else { 0.0 };
                SegmentShare {
                    link: link.name.clone(),
                    inertia_share: (explained / square).clamp(0.0, 1.0),
                    inertia_change: change.iter().copied().collect(),
                    drag_share: if drag > 0.0 { (right * right / drag / square).clamp(0.0, 1.0) } else { 0.0 },
                    drag_coefficient: coefficient,
                }
            })
            .collect();
        shares.sort_by(|a, b| b.inertia_share.total_cmp(&a.inertia_share));
        shares
    }
}

/// Minimum-norm solution of nearly singular normal equations, with columns scaled first.
fn solve(normal: &Square, right: &Ten) -> Ten {
    let scale = Ten::from_fn(|i, _| {
        let d = normal[(i, i)];
        if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 }
    });
    let scaled = Square::from_fn(|i, j| normal[(i, j)] * scale[i] * scale[j]);
    let eigen = scaled.symmetric_eigen();
    let top = eigen.eigenvalues.max();
    let target = right.component_mul(&scale);
    let mut x = Ten::zeros();
    for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *value > 1e-9 * top && top > 0.0 {
            x += vector * (vector.dot(&target) / value);
        }
    }
    x.component_mul(&scale)
}
