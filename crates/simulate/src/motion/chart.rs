//! Minimal coordinates for any model: one smooth number per degree of freedom, so that splines can
//! be fitted through them.
//!
//! Free joints use the world position of the link origin and the rotation vector from a fixed
//! reference orientation; spherical joints their rotation vector; revolute and prismatic joints
//! their coordinate. The length is `nv`.

use super::{Jet, so3};
use aloft_body::{JointKind, Model};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// The chart of one model.
#[derive(Debug, Clone)]
pub struct Chart {
    /// Orientation of the root in the world at which its rotation vector is zero.
    pub root_reference: UnitQuaternion<f64>,
}

fn pick(jets: &[Jet], f: impl Fn(&Jet) -> f64) -> Vector3<f64> {
    Vector3::new(f(&jets[0]), f(&jets[1]), f(&jets[2]))
}

fn put(out: &mut [Jet], x: &Vector3<f64>, v: &Vector3<f64>, a: &Vector3<f64>) {
    for i in 0..3 {
        out[i] = Jet { x: x[i], v: v[i], a: a[i] };
    }
}

fn write(q: &mut [f64], r: &UnitQuaternion<f64>) {
    q.copy_from_slice(r.coords.as_slice());
}

/// Reads a unit quaternion stored x, y, z, w.
pub(crate) fn read(q: &[f64]) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Quaternion::new(q[3], q[0], q[1], q[2]))
}

impl Chart {
    /// A chart whose root reference is the world axes.
    pub fn new() -> Self {
        Self { root_reference: UnitQuaternion::identity() }
    }

    /// Converts one link's coordinates (its slice of the chart) to its slices of `q`, `v`, `a`.
    pub fn lift_link(&self, model: &Model, link: usize, jets: &[Jet], q: &mut [f64], v: &mut [f64], a: &mut [f64]) {
        let joint = &model.links[link].joint;
        let (iq, iv) = (joint.q_offset, joint.v_offset);
        let jets = &jets[iv..iv + joint.kind.nv()];
        let angular = |jets: &[Jet]| so3::from_vector(&pick(jets, |j| j.x), &pick(jets, |j| j.v), &pick(jets, |j| j.a));
        match joint.kind {
            JointKind::Free => {
                let turn = angular(&jets[3..6]);
                let rotation = self.root_reference * turn.rotation;
                let position = pick(jets, |j| j.x);
                let velocity = rotation.inverse() * pick(jets, |j| j.v);
                let accel = rotation.inverse() * pick(jets, |j| j.a) - turn.omega.cross(&velocity);
                q[iq..iq + 3].copy_from_slice(position.as_slice());
                write(&mut q[iq + 3..iq + 7], &rotation);
                v[iv..iv + 3].copy_from_slice(velocity.as_slice());
                v[iv + 3..iv + 6].copy_from_slice(turn.omega.as_slice());
                a[iv..iv + 3].copy_from_slice(accel.as_slice());
                a[iv + 3..iv + 6].copy_from_slice(turn.alpha.as_slice());
            }
            JointKind::Spherical => {
                let turn = angular(jets);
                write(&mut q[iq..iq + 4], &turn.rotation);
                v[iv..iv + 3].copy_from_slice(turn.omega.as_slice());
                a[iv..iv + 3].copy_from_slice(turn.alpha.as_slice());
            }
            JointKind::Revolute(_) | JointKind::Prismatic(_) => {
                (q[iq], v[iv], a[iv]) = (jets[0].x, jets[0].v, jets[0].a);
            }
            JointKind::Fixed => {}
        }
    }

    /// Converts all coordinates. `jets` has length nv; `q` nq, `v` and `a` nv.
    pub fn lift(&self, model: &Model, jets: &[Jet], q: &mut [f64], v: &mut [f64], a: &mut [f64]) {
        for link in 0..model.n_links() {
            self.lift_link(model, link, jets, q, v, a);
        }
    }

    /// The coordinates of a motion: inverse of [`Chart::lift`] (rotations up to a half turn).
    pub fn lower(&self, model: &Model, q: &[f64], v: &[f64], a: &[f64], jets: &mut [Jet]) {
        for link in &model.links {
            let (iq, iv) = (link.joint.q_offset, link.joint.v_offset);
            let vector = |i: usize, s: &[f64]| Vector3::new(s[i], s[i + 1], s[i + 2]);
            match link.joint.kind {
                JointKind::Free => {
                    let rotation = read(&q[iq + 3..iq + 7]);
                    let (linear, omega) = (vector(iv, v), vector(iv + 3, v));
                    let accel = vector(iv, a) + omega.cross(&linear);
                    put(&mut jets[iv..], &vector(iq, q), &(rotation * linear), &(rotation * accel));
                    let turn = so3::Rotation {
                        rotation: self.root_reference.inverse() * rotation,
                        omega,
                        alpha: vector(iv + 3, a),
                    };
                    let (x, r, s) = so3::to_vector(&turn);
                    put(&mut jets[iv + 3..], &x, &r, &s);
                }
                JointKind::Spherical => {
                    let turn =
                        so3::Rotation { rotation: read(&q[iq..iq + 4]), omega: vector(iv, v), alpha: vector(iv, a) };
                    let (x, r, s) = so3::to_vector(&turn);
                    put(&mut jets[iv..], &x, &r, &s);
                }
                JointKind::Revolute(_) | JointKind::Prismatic(_) => jets[iv] = Jet { x: q[iq], v: v[iv], a: a[iv] },
                JointKind::Fixed => {}
            }
        }
    }
}

impl Default for Chart {
    fn default() -> Self {
        Self::new()
    }
}
