//! Scratch of one frame, and the algorithms that fill it. Nothing here allocates after [`State::new`].

use crate::{Model, Phi};
use nalgebra::{DMatrix, Isometry3, Vector3, Vector6};

/// Poses, velocities and accelerations of every link at one instant.
#[derive(Debug, Clone)]
pub struct State {
    /// Pose of each link in the world.
    pub world_from_link: Vec<Isometry3<f64>>,
    /// Spatial velocity of each link at its origin in its own axes: linear m/s, angular rad/s.
    pub velocity: Vec<Vector6<f64>>,
    /// Spatial acceleration (without gravity), as Pinocchio's `data.a`: linear part is d/dt of the body-fixed linear velocity components.
    pub acceleration: Vec<Vector6<f64>>,
}

impl State {
    /// Scratch for one model.
    pub fn new(_model: &Model) -> Self {
        todo!()
    }

    /// Poses only.
    pub fn forward_position(&mut self, _model: &Model, _q: &[f64]) {
        todo!()
    }
    /// Poses and velocities.
    pub fn forward_velocity(&mut self, _model: &Model, _q: &[f64], _v: &[f64]) {
        todo!()
    }
    /// Poses, velocities and accelerations.
    pub fn forward_acceleration(&mut self, _model: &Model, _q: &[f64], _v: &[f64], _a: &[f64]) {
        todo!()
    }

    /// World position of a point of a link.
    pub fn point_in_world(&self, link: usize, point_in_link: &Vector3<f64>) -> Vector3<f64> {
        self.world_from_link[link].transform_point(&(*point_in_link).into()).coords
    }
    /// World velocity of a point of a link, m/s. Needs [`State::forward_velocity`].
    pub fn point_velocity_in_world(&self, _link: usize, _point_in_link: &Vector3<f64>) -> Vector3<f64> {
        todo!()
    }
    /// World acceleration (classical, without gravity) of a point of a link, m/s². Needs [`State::forward_acceleration`].
    pub fn point_acceleration_in_world(&self, _link: usize, _point_in_link: &Vector3<f64>) -> Vector3<f64> {
        todo!()
    }

    /// 3 × nv Jacobian of a point's world position by `v`, written into `out` (columns of joints that do not move the point are zero). Needs poses.
    pub fn point_jacobian(&self, _model: &Model, _link: usize, _point_in_link: &Vector3<f64>, _out: &mut DMatrix<f64>) {
        todo!()
    }

    /// Generalised forces by recursive Newton-Euler: `tau` (length nv). The first six are the base wrench in root axes
    /// about the root origin, linear then angular. Needs [`State::forward_acceleration`].
    pub fn inverse_dynamics(&mut self, _model: &Model, _phi: &[Phi], _tau: &mut [f64]) {
        todo!()
    }

    /// 6 × 10n regressor of the base wrench (the paper's Y_O): root axes about the root origin, linear then angular,
    /// `Y φ = F_ext` with gravity on the left. Needs [`State::forward_acceleration`].
    pub fn base_wrench_regressor(&self, _model: &Model, _out: &mut DMatrix<f64>) {
        todo!()
    }

    /// 6 × 10n regressor of the spatial momentum in world axes about `origin_in_world` (a fixed point):
    /// rows 0-2 linear momentum, rows 3-5 angular momentum. Needs [`State::forward_velocity`].
    pub fn momentum_regressor(&self, _model: &Model, _origin_in_world: &Vector3<f64>, _out: &mut DMatrix<f64>) {
        todo!()
    }

    /// 3 × 10n regressor of the first moment of mass Σ m (p − origin) in world axes. Needs poses.
    pub fn first_moment_regressor(&self, _model: &Model, _origin_in_world: &Vector3<f64>, _out: &mut DMatrix<f64>) {
        todo!()
    }

    /// Whole-body mass and centre of mass in the world. Needs poses.
    pub fn center_of_mass(&self, _phi: &[Phi]) -> (f64, Vector3<f64>) {
        todo!()
    }

    /// Joint-space inertia matrix, nv × nv (composite rigid bodies). Needs poses.
    pub fn mass_matrix(&mut self, _model: &Model, _phi: &[Phi], _out: &mut DMatrix<f64>) {
        todo!()
    }
}
