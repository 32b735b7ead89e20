//! First-order change of a body's momentum when its coordinates are displaced.

use crate::dynamics::axis_of;
use crate::inertia::{first_moment, inertia_about_origin, steiner};
use crate::state::{angular, linear, spatial};
use crate::{Model, Phi, State};
use nalgebra::{Matrix3, Vector3, Vector6};

/// Mass, first moment and inertia tensor about a fixed point, world axes.
#[derive(Clone, Copy)]
struct WorldInertia {
    mass: f64,
    first: Vector3<f64>,
    inertia: Matrix3<f64>,
}

impl WorldInertia {
    /// For a link with parameters `phi` about its origin, which is at `arm` from the fixed point.
    fn new(phi: &Phi, rotation: &Matrix3<f64>, arm: &Vector3<f64>) -> Self {
        let moved = rotation * first_moment(phi);
        let mixed = moved * arm.transpose();
        let inertia = rotation * inertia_about_origin(phi) * rotation.transpose()
            + steiner(arm) * phi[0]
            + Matrix3::from_diagonal_element(2.0 * arm.dot(&moved))
            - (mixed + mixed.transpose());
        Self { mass: phi[0], first: moved + arm * phi[0], inertia }
    }
    /// Momentum and angular momentum about the fixed point at a world twist about that point.
    fn momentum(&self, twist: &Vector6<f64>) -> Vector6<f64> {
        let (v, w) = (linear(twist), angular(twist));
        spatial(&(v * self.mass + w.cross(&self.first)), &(self.first.cross(&v) + self.inertia * w))
    }
}

/// `v × s` for twists: the rate of a twist `s` moving with velocity `v`.
fn motion_cross(v: &Vector6<f64>, s: &Vector6<f64>) -> Vector6<f64> {
    let (vl, va, sl, sa) = (linear(v), angular(v), linear(s), angular(s));
    spatial(&(va.cross(&sl) + vl.cross(&sa)), &va.cross(&sa))
}

/// `s ×* h`: the rate of a wrench or momentum `h` moving with velocity `s`.
fn force_cross(s: &Vector6<f64>, h: &Vector6<f64>) -> Vector6<f64> {
    let (sl, sa, hl, ha) = (linear(s), angular(s), linear(h), angular(h));
    spatial(&sa.cross(&hl), &(sa.cross(&ha) + sl.cross(&hl)))
}

impl State {
    /// World twist about the point `fixed` (linear m/s, then angular rad/s) of a unit rate of each
    /// velocity: nv entries. Needs poses.
    pub fn joint_twists(&self, model: &Model, fixed: &Vector3<f64>) -> Vec<Vector6<f64>> {
        let mut out = Vec::with_capacity(model.nv);
        for (i, link) in model.links.iter().enumerate() {
            let rotation = self.rotation(i);
            let arm = self.world_from_link[i].translation.vector - fixed;
            for k in 0..link.joint.kind.nv() {
                let (lin, ang) = axis_of(&link.joint.kind, k);
                let ang = rotation * ang;
                out.push(spatial(&(rotation * lin + arm.cross(&ang)), &ang));
            }
        }
        out
    }

    /// First-order change of the whole body's momentum about the point `fixed` (linear kg·m/s, then
    /// angular kg·m²/s, world axes) for small displacements of the coordinates:
    /// `(by_displacement, by_rate)`, nv entries each, so that
    /// `δh = Σ by_displacement δ_k + by_rate δ̇_k` for displacements in the sense of
    /// [`Model::integrate`]. The linear part of `by_rate` is also the change of the first moment of
    /// mass. With S a joint's world twist, V its link's and h, I the momentum and inertia of all
    /// that it carries, they are `I (V × S) + S ×* h` and `I S` (Featherstone, Rigid Body Dynamics
    /// Algorithms, 2008, chapters 2 and 6, differentiated). Needs [`State::forward_velocity`].
    pub fn momentum_change(
        &self,
        model: &Model,
        phi: &[Phi],
        fixed: &Vector3<f64>,
    ) -> (Vec<Vector6<f64>>, Vec<Vector6<f64>>) {
        let n = model.n_links();
        let mut twists = Vec::with_capacity(n);
        let mut carried = Vec::with_capacity(n);
        for i in 0..n {
            let rotation = self.rotation(i);
            let arm = self.world_from_link[i].translation.vector - fixed;
            let ang = rotation * angular(&self.velocity[i]);
            let twist = spatial(&(rotation * linear(&self.velocity[i]) + arm.cross(&ang)), &ang);
            let own = WorldInertia::new(&phi[i], rotation, &arm);
            twists.push(twist);
            carried.push((own, own.momentum(&twist)));
        }
        for i in (1..n).rev() {
            if let Some(parent) = model.links[i].parent {
                let (below, h) = carried[i];
                let (inertia, momentum) = &mut carried[parent];
                inertia.mass += below.mass;
                inertia.first += below.first;
                inertia.inertia += below.inertia;
                *momentum += h;
            }
        }
        let joints = self.joint_twists(model, fixed);
        let (mut by_displacement, mut by_rate) = (Vec::with_capacity(model.nv), Vec::with_capacity(model.nv));
        for (i, link) in model.links.iter().enumerate() {
            let (inertia, h) = &carried[i];
            for s in &joints[link.joint.v_offset..][..link.joint.kind.nv()] {
                by_displacement.push(inertia.momentum(&motion_cross(&twists[i], s)) + force_cross(s, h));
                by_rate.push(inertia.momentum(s));
            }
        }
        (by_displacement, by_rate)
    }
}
