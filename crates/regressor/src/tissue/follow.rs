//! How the body's coordinates follow slides of the markers: inverse kinematics to first order.

use super::{Skin, UNSEEN_LEVER_M, add_scaled};
use aloft_body::inertia::steiner;
use aloft_body::{JointKind, Model, Phi, State};
use nalgebra::{DMatrix, Quaternion, Vector3};

/// Least-squares inverse kinematics to first order, for all realisations at once: `(JᵀJ + ε) f = Jᵀ
/// s`.
///
/// A marker counts as a unit mass for `JᵀJ`, which is then the joint-space inertia matrix, and as a
/// force on its link for `Jᵀ s`. Both are computed along the tree, without the Jacobian of each
/// marker.
pub(super) struct FollowSolver {
    draws: usize,
    /// Unit masses at the markers of each link, link axes.
    masses: Vec<Phi>,
    normal: DMatrix<f64>,
    /// Sum of forces at the markers of each link and its descendants, with their moment: (force,
    /// moment) × axis × realisation.
    wrenches: Vec<Vec<f64>>,
    local: Vec<f64>,
    world: Vec<f64>,
    angles: Vec<Vector3<f64>>,
}

impl FollowSolver {
    pub(super) fn new(model: &Model, skin: &Skin<'_>) -> Self {
        let mut masses = vec![Phi::zeros(); model.n_links()];
        for (marker, _) in &skin.markers {
            let place = marker.position_m;
            masses[marker.link] += aloft_body::inertia::phi_from_parts(1.0, &place, &steiner(&place));
        }
        Self {
            draws: skin.draws,
            masses,
            normal: DMatrix::zeros(model.nv, model.nv),
            wrenches: vec![vec![0.0; 6 * skin.draws]; model.n_links()],
            local: vec![0.0; 3 * skin.draws],
            world: vec![0.0; 3 * skin.draws],
            angles: vec![Vector3::zeros(); model.n_links()],
        }
    }

    /// Fills `follow` (coordinate × realisation, for slides of 1 m/rad) and returns the sum of
    /// squares of the remaining residuals. None if the markers leave a coordinate undetermined.
    /// Needs poses in `state`.
    pub(super) fn solve(
        &mut self,
        model: &Model,
        state: &mut State,
        skin: &Skin<'_>,
        q: &[f64],
        fixed: &Vector3<f64>,
        follow: &mut [f64],
    ) -> Option<f64> {
        let draws = self.draws;
        for (l, angle) in self.angles.iter_mut().enumerate() {
            *angle = angles(model, l, q);
        }
        self.wrenches.iter_mut().for_each(|w| w.fill(0.0));
        let mut slides = 0.0;
        for (i, (marker, _)) in skin.markers.iter().enumerate() {
            skin.local(i, &self.angles, &mut self.local);
            slides += self.local.iter().map(|x| x * x).sum::<f64>();
            let rotation = state.rotation(marker.link);
            let arm = state.point_in_world(marker.link, &marker.position_m) - fixed;
            self.world.fill(0.0);
            let wrench = &mut self.wrenches[marker.link];
            for axis in 0..3 {
                let world = &mut self.world[axis * draws..][..draws];
                for from in 0..3 {
                    add_scaled(world, rotation[(axis, from)], &self.local[from * draws..][..draws]);
                }
                add_scaled(&mut wrench[axis * draws..][..draws], 1.0, world);
            }
            for axis in 0..3 {
                let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
                let moment = &mut wrench[(3 + axis) * draws..][..draws];
                add_scaled(moment, arm[next], &self.world[last * draws..][..draws]);
                add_scaled(moment, -arm[last], &self.world[next * draws..][..draws]);
            }
        }
        for l in (1..model.n_links()).rev() {
            let Some(parent) = model.links[l].parent else { continue };
            let (before, rest) = self.wrenches.split_at_mut(l);
            add_scaled(&mut before[parent], 1.0, &rest[0]);
        }
        let twists = state.joint_twists(model, fixed);
        for (l, link) in model.links.iter().enumerate() {
            for k in link.joint.v_offset..link.joint.v_offset + link.joint.kind.nv() {
                let row = &mut follow[k * draws..][..draws];
                row.fill(0.0);
                for (component, of_wrench) in twists[k].iter().zip(self.wrenches[l].chunks_exact(draws.max(1))) {
                    add_scaled(row, *component, of_wrench);
                }
            }
        }
        state.mass_matrix(model, &self.masses, &mut self.normal);
        for k in 0..model.nv {
            self.normal[(k, k)] += UNSEEN_LEVER_M * UNSEEN_LEVER_M;
        }
        let right = follow.to_vec();
        solve_tree(&mut self.normal, follow, draws)?;
        // |s − J f|² with the normal equations substituted
        let explained: f64 = follow.iter().zip(&right).map(|(f, g)| f * g).sum();
        let ridge: f64 = follow.iter().map(|f| f * f).sum::<f64>() * UNSEEN_LEVER_M * UNSEEN_LEVER_M;
        Some((slides - explained - ridge).max(0.0))
    }
}

/// Solves `H x = g` in place for `draws` right-hand sides (coordinate × realisation). H is factored
/// as `LᵀL` from the leaves of the tree to its root, which preserves the zeros between branches
/// (Featherstone 2008, section 6.5). None if H is not positive definite.
fn solve_tree(h: &mut DMatrix<f64>, g: &mut [f64], draws: usize) -> Option<()> {
    let n = h.nrows();
    for k in (0..n).rev() {
        let pivot = h[(k, k)];
        if !(pivot > 0.0 && pivot.is_finite()) {
            return None;
        }
        let root = pivot.sqrt();
        h[(k, k)] = root;
        let before: Vec<(usize, f64)> = (0..k).filter(|i| h[(k, *i)] != 0.0).map(|i| (i, h[(k, i)] / root)).collect();
        for (at, (i, left)) in before.iter().enumerate() {
            h[(k, *i)] = *left;
            for (j, right) in &before[..=at] {
                h[(*i, *j)] -= left * right;
            }
        }
        let (above, own) = g.split_at_mut(k * draws);
        let own = &mut own[..draws];
        own.iter_mut().for_each(|x| *x /= root);
        for (i, left) in before {
            add_scaled(&mut above[i * draws..][..draws], -left, own);
        }
    }
    for k in 0..n {
        let (above, own) = g.split_at_mut(k * draws);
        let own = &mut own[..draws];
        for i in (0..k).filter(|i| h[(k, *i)] != 0.0) {
            add_scaled(own, -h[(k, i)], &above[i * draws..][..draws]);
        }
        let root = h[(k, k)];
        own.iter_mut().for_each(|x| *x /= root);
    }
    Some(())
}

/// Rotation vector of a link's joint, rad; zero for joints without rotation.
pub(super) fn angles(model: &Model, link: usize, q: &[f64]) -> Vector3<f64> {
    let joint = &model.links[link].joint;
    let at = joint.q_offset;
    match joint.kind {
        JointKind::Spherical => {
            let turn = Quaternion::new(q[at + 3], q[at], q[at + 1], q[at + 2]);
            aloft_body::rotation::quaternion_log(&if turn.w < 0.0 { -turn } else { turn })
        }
        JointKind::Revolute(axis) => axis.into_inner() * q[at],
        _ => Vector3::zeros(),
    }
}
