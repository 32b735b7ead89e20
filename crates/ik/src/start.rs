//! Starting postures that do not depend on the preceding frame: closed forms from the root
//! outwards.

use crate::frame::Solver;
use crate::problem::{Hinge, best_rotation};
use crate::tree::{NONE, Pose, Tree, axis_angle_matrix};
use aloft_body::JointKind;
use nalgebra::{Matrix3, Vector3};

/// Weight of a marker farther out on the branch, which gives a direction only, relative to one on
/// the link itself.
const BEYOND: f64 = 0.05;
/// A segment is far from its markers above this root mean square distance, m …
const FAR_M: f64 = 0.02;
/// … and on a wrong branch if a rigid fit leaves less than this share of it …
const RIGID: f64 = 0.5;
/// … and is turned by more than 40° from it.
const TURNED_COSINE: f64 = 0.766;
/// Lever arm of the attraction to the resting posture, m, at one nominal marker weight.
const REST_ARM_M: f64 = 0.02;

impl Solver<'_> {
    /// Pose of a rigid set of points given by `point` at the visible markers that `belongs`
    /// selects.
    fn rigid_fit(
        &self,
        belongs: impl Fn(usize) -> bool,
        point: impl Fn(usize) -> Vector3<f64>,
    ) -> Option<(Matrix3<f64>, Vector3<f64>)> {
        let (mut mass, mut count) = (0.0, 0);
        let (mut mean_a, mut mean_b) = (Vector3::zeros(), Vector3::zeros());
        for &i in self.visible.iter().filter(|&&i| belongs(i)) {
            let w = self.problem.markers[i].weight;
            mass += w;
            count += 1;
            mean_a += point(i) * w;
            mean_b += self.targets[i] * w;
        }
        if count < 3 {
            return None;
        }
        mean_a /= mass;
        mean_b /= mass;
        let (mut cross, mut spread) = (Matrix3::zeros(), Matrix3::zeros());
        for &i in self.visible.iter().filter(|&&i| belongs(i)) {
            let w = self.problem.markers[i].weight / mass;
            let a = point(i) - mean_a;
            cross += (self.targets[i] - mean_b) * a.transpose() * w;
            spread += a * a.transpose() * w;
        }
        let mut widths = spread.symmetric_eigenvalues();
        widths.as_mut_slice().sort_by(f64::total_cmp);
        if widths[1] < 1e-4 * widths[2] || widths[2] <= 0.0 {
            return None;
        }
        let rotation = best_rotation(&cross)?;
        Some((rotation, mean_b - rotation * mean_a))
    }

    /// Resting posture with the root placed by its own markers, or by all markers as one rigid
    /// body. False if neither is possible.
    pub fn start_at_rest(&mut self, q: &mut [f64], by_root: bool) -> bool {
        let problem = self.problem;
        let tree = &problem.tree;
        q.copy_from_slice(&problem.rest_q);
        if tree.links[0].kind != JointKind::Free || problem.locked_link[0] {
            return true;
        }
        let placed = if by_root {
            self.rigid_fit(|i| problem.markers[i].link == 0, |i| problem.markers[i].position)
        } else {
            // All markers in the root's frame at the resting posture.
            let (root_rotation, root_origin) = (problem.rest_pose.rotation[0], problem.rest_pose.origin[0]);
            self.rigid_fit(
                |_| true,
                |i| {
                    let marker = &problem.markers[i];
                    let rest = &problem.rest_pose;
                    let world = rest.origin[marker.link] + rest.rotation[marker.link] * marker.position;
                    root_rotation.transpose() * (world - root_origin)
                },
            )
        };
        let Some((rotation, origin)) = placed else { return false };
        let root = &tree.links[0];
        let local = root.rotation.transpose() * (origin - root.translation);
        q[root.q_offset..root.q_offset + 3].copy_from_slice(local.as_slice());
        tree.set_rotation(0, &rotation, &self.pose, q);
        true
    }

    /// Rotates every joint beyond the root to the best fit of the markers on its branch, one joint
    /// after the other.
    pub fn descend(&mut self, q: &mut [f64]) {
        self.descend_below(None, q);
    }

    /// The same for the joints beyond one link.
    fn descend_below(&mut self, above: Option<usize>, q: &mut [f64]) {
        let problem = self.problem;
        let tree = &problem.tree;
        let rest = &problem.rest_pose;
        for (index, link) in tree.links.iter().enumerate() {
            tree.forward_link(index, link, q, &mut self.pose);
            let beyond = above.is_none_or(|a| a != index && tree.is_beyond(index, a));
            if index == 0 || problem.locked_link[index] || !beyond {
                continue;
            }
            let origin = self.pose.origin[index];
            let start = tree.joint_rotation(index, &self.pose);
            match link.kind {
                JointKind::Spherical => {
                    let mut cross = Matrix3::zeros();
                    for &i in &self.visible {
                        let Some((arm, weight)) = self.arm_on_branch(index, i, rest) else { continue };
                        cross += (self.targets[i] - origin) * arm.transpose() * weight;
                    }
                    let pull = self.mean_weight() * REST_ARM_M * REST_ARM_M;
                    let local = rest_local(tree, rest, index);
                    cross += start * local * pull;
                    if let Some(rotation) = best_rotation(&cross) {
                        tree.set_rotation(index, &rotation, &self.pose, q);
                    }
                }
                JointKind::Revolute(axis) => {
                    let rest_angle = problem.rest_q[link.q_offset];
                    let pull = self.mean_weight() * REST_ARM_M * REST_ARM_M;
                    let (mut a, mut b) = (pull * rest_angle.cos(), pull * rest_angle.sin());
                    for &i in &self.visible {
                        let Some((arm, weight)) = self.arm_on_branch(index, i, rest) else { continue };
                        let seen = start.transpose() * (self.targets[i] - origin);
                        let flat = arm - axis.into_inner() * axis.dot(&arm);
                        a += weight * seen.dot(&flat);
                        b += weight * seen.dot(&axis.cross(&flat));
                    }
                    if a != 0.0 || b != 0.0 {
                        // Stay within half a turn of the resting angle.
                        let angle = b.atan2(a);
                        let turns = ((angle - rest_angle) / std::f64::consts::TAU).round();
                        q[link.q_offset] = angle - turns * std::f64::consts::TAU;
                    }
                }
                JointKind::Free | JointKind::Prismatic(_) | JointKind::Fixed => {}
            }
            tree.forward_link(index, link, q, &mut self.pose);
        }
    }

    /// A segment whose visible markers keep their shape but lie far from the model at the last
    /// evaluation, the farthest one, with the rotation that they show.
    pub fn turned_segment(&self) -> Option<(usize, Matrix3<f64>)> {
        let problem = self.problem;
        let mut worst: Option<(usize, f64)> = None;
        for (index, link) in problem.tree.links.iter().enumerate() {
            if link.kind != JointKind::Spherical || problem.locked_link[index] {
                continue;
            }
            let (mut sum, mut n) = (0.0, 0);
            for &i in self.visible.iter().filter(|&&i| problem.markers[i].link == index) {
                sum += self.residual[i].norm_squared();
                n += 1;
            }
            let rms_m = (sum / f64::max(1.0, n as f64)).sqrt();
            if n >= 3 && rms_m > FAR_M && worst.is_none_or(|(_, w)| rms_m > w) {
                worst = Some((index, rms_m));
            }
        }
        let (index, rms_m) = worst?;
        let own = |i: usize| problem.markers[i].link == index;
        let (rotation, origin) = self.rigid_fit(own, |i| problem.markers[i].position)?;
        let (mut sum, mut n) = (0.0, 0.0);
        for &i in self.visible.iter().filter(|&&i| own(i)) {
            sum += (origin + rotation * problem.markers[i].position - self.targets[i]).norm_squared();
            n += 1.0;
        }
        let rigid_m = f64::sqrt(sum / f64::max(1.0, n));
        let turned = (rotation.transpose() * self.pose.rotation[index]).trace();
        // cos of the angle from the trace
        (rigid_m < RIGID * rms_m && 0.5 * (turned - 1.0) < TURNED_COSINE).then_some((index, rotation))
    }

    /// Gives a link the rotation of its markers, and fits the joints beyond it to theirs.
    pub fn start_turned(&mut self, turned: usize, rotation: &Matrix3<f64>, q: &mut [f64]) {
        let tree = &self.problem.tree;
        tree.forward(q, &mut self.pose);
        tree.set_rotation(turned, rotation, &self.pose, q);
        tree.forward(q, &mut self.pose);
        self.descend_below(Some(turned), q);
    }

    /// A marker in a link's frame with its weight there: full on the link, small farther out (at
    /// its place in the resting posture).
    fn arm_on_branch(&self, link: usize, marker: usize, rest: &Pose) -> Option<(Vector3<f64>, f64)> {
        let marker = &self.problem.markers[marker];
        if marker.link == link {
            return Some((marker.position, marker.weight));
        }
        let mut at = marker.link;
        while at != link {
            at = self.problem.tree.links[at].parent;
            if at == NONE {
                return None;
            }
        }
        let world = rest.origin[marker.link] + rest.rotation[marker.link] * marker.position;
        Some((rest.rotation[link].transpose() * (world - rest.origin[link]), BEYOND * marker.weight))
    }

    fn mean_weight(&self) -> f64 {
        let n = self.problem.markers.len();
        self.problem.markers.iter().map(|m| m.weight).sum::<f64>() / n.max(1) as f64
    }

    /// Puts a hinge on its flexed side: the angle from the distance between the two ends, the link
    /// above the hinge rotated about its origin to fit the far end and its own markers, the link at
    /// the far end rotated to fit its markers. Starts from the pose of `q`.
    pub fn start_flexed(&mut self, hinge: &Hinge, q: &mut [f64]) -> bool {
        let problem = self.problem;
        let tree = &problem.tree;
        if hinge.end == NONE || [hinge.parent, hinge.link, hinge.end].iter().any(|&l| problem.locked_link[l]) {
            return false;
        }
        tree.forward(q, &mut self.pose);
        let pivot = self.pose.origin[hinge.parent];
        let (end_rotation, end_origin) = self
            .rigid_fit(|i| problem.markers[i].link == hinge.end, |i| problem.markers[i].position)
            .unwrap_or((self.pose.rotation[hinge.end], self.pose.origin[hinge.end]));
        let to_end = end_origin - pivot;
        let cosine = (to_end.norm_squared() - hinge.reach) / (2.0 * hinge.swing);
        let bend = cosine.clamp(-1.0, 1.0).acos().max(0.02);
        let angle = hinge.straight + hinge.sense * bend;
        let turns = ((angle - problem.rest_q[hinge.q_index]) / std::f64::consts::TAU).round();
        q[hinge.q_index] = angle - turns * std::f64::consts::TAU;
        let end_in_parent =
            hinge.to_hinge + tree.links[hinge.link].rotation * (axis_angle_matrix(&hinge.axis, angle) * hinge.to_end);
        let weight = self.mean_weight();
        let mut cross = to_end * end_in_parent.transpose() * (3.0 * weight);
        for &i in self.visible.iter().filter(|&&i| problem.markers[i].link == hinge.parent) {
            let marker = &problem.markers[i];
            cross += (self.targets[i] - pivot) * marker.position.transpose() * marker.weight;
        }
        cross += self.pose.rotation[hinge.parent] * (weight * 1e-6);
        let Some(rotation) = best_rotation(&cross) else { return false };
        tree.set_rotation(hinge.parent, &rotation, &self.pose, q);
        for index in [hinge.parent, hinge.link] {
            tree.forward_link(index, &tree.links[index], q, &mut self.pose);
        }
        tree.set_rotation(hinge.end, &end_rotation, &self.pose, q);
        true
    }
}

/// Rotation of a joint at rest, in the joint's own frame.
fn rest_local(tree: &Tree, rest: &Pose, index: usize) -> Matrix3<f64> {
    tree.joint_rotation(index, rest).transpose() * rest.rotation[index]
}
