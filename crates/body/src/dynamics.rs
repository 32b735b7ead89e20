//! Forces and inertia of the whole tree: recursive Newton-Euler, composite rigid bodies, centre of
//! mass.

use crate::inertia::{first_moment, inertia_about_origin, phi_from_parts};
use crate::rotation::skew;
use crate::state::{angular, linear, spatial};
use crate::{JointKind, Model, Phi, State};
use nalgebra::{DMatrix, Matrix3, Vector3, Vector6};

/// Spatial momentum of a link about its origin in its axes, for a twist in the same axes: `I v`.
fn momentum(phi: &Phi, lin: &Vector3<f64>, ang: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let h = first_moment(phi);
    (lin * phi[0] + ang.cross(&h), inertia_about_origin(phi) * ang + h.cross(lin))
}

/// Parameters of the same body in the parent's frame, from rotation and origin of the link in the
/// parent.
fn phi_in_parent(phi: &Phi, rotation: &Matrix3<f64>, origin: &Vector3<f64>) -> Phi {
    let (m, h) = (phi[0], rotation * first_moment(phi));
    // −[p]×[h]× − [h]×[p]× − m [p]×[p]×, about the parent's origin
    let (sp, sh) = (skew(origin), skew(&h));
    let shift = sp * sh;
    let inertia = rotation * inertia_about_origin(phi) * rotation.transpose() - shift - shift.transpose() - sp * sp * m;
    phi_from_parts(m, &(h + origin * m), &inertia)
}

/// Projects a wrench onto a joint's free directions; the result is written into `tau`.
fn project(kind: &JointKind, wrench: &Vector6<f64>, tau: &mut [f64]) {
    match kind {
        JointKind::Free => tau[..6].copy_from_slice(wrench.as_slice()),
        JointKind::Spherical => tau[..3].copy_from_slice(&wrench.as_slice()[3..]),
        JointKind::Revolute(axis) => tau[0] = angular(wrench).dot(axis),
        JointKind::Prismatic(axis) => tau[0] = linear(wrench).dot(axis),
        JointKind::Fixed => {}
    }
}

impl State {
    /// Generalised forces by recursive Newton-Euler: `tau` (length nv). The first six are the base
    /// wrench in root axes about the root origin, linear then angular. Gravity is included. Needs
    /// [`State::forward_acceleration`].
    ///
    /// # Panics
    /// If `phi` has fewer entries than the model has links, or `tau` is shorter than nv.
    pub fn inverse_dynamics(&mut self, model: &Model, phi: &[Phi], tau: &mut [f64]) {
        let n = model.n_links();
        for i in 0..n {
            let (v, a) = (&self.velocity[i], &self.acceleration[i]);
            let (lin, ang) = (linear(v), angular(v));
            let up = linear(a) - self.rotation[i].tr_mul(&model.gravity_mps2);
            let (mut force, mut moment) = momentum(&phi[i], &up, &angular(a));
            let (p, l) = momentum(&phi[i], &lin, &ang);
            force += ang.cross(&p);
            moment += ang.cross(&l) + lin.cross(&p);
            self.wrench[i] = spatial(&force, &moment);
        }
        for i in (0..n).rev() {
            let joint = &model.links[i].joint;
            let wrench = self.wrench[i];
            project(&joint.kind, &wrench, &mut tau[joint.v_offset..]);
            if let Some(parent) = model.links[i].parent {
                let carried = self.wrench_in_parent(i, &wrench);
                self.wrench[parent] += carried;
            }
        }
    }

    /// Transforms a wrench on link `i` (its axes, its origin) to the axes and origin of its parent.
    fn wrench_in_parent(&self, i: usize, wrench: &Vector6<f64>) -> Vector6<f64> {
        let r = &self.parent_from_link[i];
        let force = r * linear(wrench);
        let moment = r * angular(wrench) + self.origin_in_parent[i].cross(&force);
        spatial(&force, &moment)
    }

    /// Whole-body mass and centre of mass in the world. Needs poses.
    pub fn centre_of_mass(&self, phi: &[Phi]) -> (f64, Vector3<f64>) {
        let (mut mass, mut moment) = (0.0, Vector3::zeros());
        for (i, phi) in phi.iter().enumerate() {
            mass += phi[0];
            moment += self.world_from_link[i].translation.vector * phi[0] + self.rotation[i] * first_moment(phi);
        }
        (mass, moment / mass)
    }

    /// Velocity of the whole-body centre of mass in the world, m/s. Needs
    /// [`State::forward_velocity`].
    pub fn centre_of_mass_velocity(&self, phi: &[Phi]) -> Vector3<f64> {
        let (mut mass, mut total) = (0.0, Vector3::zeros());
        for (i, phi) in phi.iter().enumerate() {
            let v = &self.velocity[i];
            mass += phi[0];
            total += self.rotation[i] * (linear(v) * phi[0] + angular(v).cross(&first_moment(phi)));
        }
        total / mass
    }

    /// Joint-space inertia matrix, nv × nv (composite rigid bodies). Needs poses.
    ///
    /// # Panics
    /// If `phi` has fewer entries than the model has links, or `out` is not nv × nv.
    pub fn mass_matrix(&mut self, model: &Model, phi: &[Phi], out: &mut DMatrix<f64>) {
        assert_eq!(out.shape(), (model.nv, model.nv), "shape of the joint-space inertia matrix");
        out.fill(0.0);
        let n = model.n_links();
        self.composite.copy_from_slice(&phi[..n]);
        for i in (0..n).rev() {
            let composite = self.composite[i];
            let joint = &model.links[i].joint;
            for k in 0..joint.kind.nv() {
                let (lin, ang) = axis_of(&joint.kind, k);
                let (p, l) = momentum(&composite, &lin, &ang);
                let mut wrench = spatial(&p, &l);
                let column = joint.v_offset + k;
                let mut at = i;
                loop {
                    let row_joint = &model.links[at].joint;
                    let mut rows = [0.0; 6];
                    project(&row_joint.kind, &wrench, &mut rows);
                    for (r, value) in rows.iter().enumerate().take(row_joint.kind.nv()) {
                        out[(row_joint.v_offset + r, column)] = *value;
                        out[(column, row_joint.v_offset + r)] = *value;
                    }
                    let Some(parent) = model.links[at].parent else { break };
                    wrench = self.wrench_in_parent(at, &wrench);
                    at = parent;
                }
            }
            if let Some(parent) = model.links[i].parent {
                self.composite[parent] +=
                    phi_in_parent(&composite, &self.parent_from_link[i], &self.origin_in_parent[i]);
            }
        }
    }
}

/// Twist of a unit rate of one of a joint's velocities, in link axes: linear, angular.
pub(crate) fn axis_of(kind: &JointKind, k: usize) -> (Vector3<f64>, Vector3<f64>) {
    let unit = |k: usize| {
        let mut e = Vector3::zeros();
        e[k] = 1.0;
        e
    };
    match kind {
        JointKind::Free if k < 3 => (unit(k), Vector3::zeros()),
        JointKind::Free => (Vector3::zeros(), unit(k - 3)),
        JointKind::Spherical => (Vector3::zeros(), unit(k)),
        JointKind::Revolute(axis) => (Vector3::zeros(), axis.into_inner()),
        JointKind::Prismatic(axis) => (axis.into_inner(), Vector3::zeros()),
        JointKind::Fixed => (Vector3::zeros(), Vector3::zeros()),
    }
}
