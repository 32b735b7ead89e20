//! Velocities of a motion by central differences on the manifold, over runs of frames without gaps.

use aloft_body::{FrameDifferences, JointKind, LANES, Model, Motion};
use nalgebra::Vector3;
use std::array::from_fn;

/// Runs of frames from `first` to before `end` for which `good` holds, as half-open ranges.
pub(crate) fn valid_runs(first: usize, end: usize, good: impl Fn(usize) -> bool) -> Vec<(usize, usize)> {
    let runs = aloft_signal::runs_where(end.saturating_sub(first), |i| good(first + i));
    runs.into_iter().map(|r| (first + r.start, first + r.end)).collect()
}

/// Velocities of every frame of the run `start .. end` by central differences on the manifold, nv a
/// frame: sixth order inside, lower near the ends, zero at the first and last frame.
// each difference of two frames is used for both, with opposite signs
pub fn run_velocities(model: &Model, motion: &Motion, start: usize, end: usize) -> Vec<f64> {
    let (n, nv, most) = (end - start, model.nv, CENTRAL.len() - 1);
    let mut ahead = vec![0.0; n * most * nv];
    let differences = FrameDifferences::default();
    let mut lanes = vec![[0.0; LANES]; nv];
    for k in 1..=most.min(n.saturating_sub(1)) {
        for first in (0..n - k).step_by(LANES) {
            // the last pair of frames fills the unused lanes
            let of = |lane: usize| start + (first + lane).min(n - k - 1);
            let (from, to) = (from_fn(|lane| motion.q(of(lane))), from_fn(|lane| motion.q(of(lane) + k)));
            differences.between(model, &from, &to, &mut lanes);
            for lane in 0..LANES.min(n - k - first) {
                let step = &mut ahead[((first + lane) * most + k - 1) * nv..][..nv];
                step.iter_mut().zip(&lanes).for_each(|(s, all)| *s = all[lane]);
            }
        }
    }
    let mut out = vec![0.0; n * nv];
    let root = FreeRoot::of(model);
    for (i, v) in out.chunks_exact_mut(nv).enumerate() {
        let reach = i.min(n - 1 - i).min(most);
        for (k, weight) in CENTRAL[reach].iter().enumerate() {
            let c = weight * motion.rate_hz;
            let forth = &ahead[(i * most + k) * nv..][..nv];
            let back = &ahead[((i - k - 1) * most + k) * nv..][..nv];
            for ((v, f), b) in v.iter_mut().zip(forth).zip(back) {
                *v += c * (f + b);
            }
        }
        if root.is_some() {
            FreeRoot::set(v, motion, start + i, reach);
        }
    }
    out
}

/// The root's path is differentiated in the world, where a ballistic one is a polynomial.
struct FreeRoot;

impl FreeRoot {
    fn of(model: &Model) -> Option<Self> {
        model.links.first().is_some_and(|l| l.joint.kind == JointKind::Free).then_some(Self)
    }
    /// Writes the root's velocity at a frame, in its own axes, to `v`.
    fn set(v: &mut [f64], motion: &Motion, frame: usize, reach: usize) {
        let here = motion.q(frame);
        let mut world_velocity = Vector3::zeros();
        for (k, weight) in CENTRAL[reach].iter().enumerate() {
            let (before, after) = (motion.q(frame - k - 1), motion.q(frame + k + 1));
            for axis in 0..3 {
                world_velocity[axis] += weight * motion.rate_hz * (after[axis] - before[axis]);
            }
        }
        let q = nalgebra::Quaternion::new(here[6], here[3], here[4], here[5]);
        let body = nalgebra::UnitQuaternion::from_quaternion(q).inverse() * world_velocity;
        v[..3].copy_from_slice(body.as_slice());
    }
}

/// Velocities by central differences on the manifold: sixth order inside a run, fourth and second
/// near its ends.
pub(crate) struct Velocity {
    difference: Vec<f64>,
    v: Vec<f64>,
    free_root: bool,
}

/// Weights of q(t + k dt) − q(t − k dt), k = 1…, over dt.
pub(crate) const CENTRAL: [&[f64]; 4] =
    [&[], &[1.0 / 2.0], &[2.0 / 3.0, -1.0 / 12.0], &[3.0 / 4.0, -3.0 / 20.0, 1.0 / 60.0]];

impl Velocity {
    pub(crate) fn new(model: &Model) -> Self {
        Self { difference: vec![0.0; model.nv], v: vec![0.0; model.nv], free_root: FreeRoot::of(model).is_some() }
    }
    /// Velocity at a frame of the run `start .. end`; zero at its first and last frame, which no
    /// window uses.
    pub(crate) fn at(&mut self, model: &Model, motion: &Motion, start: usize, end: usize, frame: usize) -> &[f64] {
        let reach = (frame - start).min(end - 1 - frame).min(3);
        self.v.fill(0.0);
        let here = motion.q(frame);
        for (k, weight) in CENTRAL[reach].iter().enumerate() {
            for (sign, other) in [(1.0, frame + k + 1), (-1.0, frame - k - 1)] {
                let c = sign * weight * motion.rate_hz;
                model.difference(here, motion.q(other), &mut self.difference);
                for (v, d) in self.v.iter_mut().zip(&self.difference) {
                    *v += c * d;
                }
            }
        }
        if self.free_root {
            FreeRoot::set(&mut self.v, motion, frame, reach);
        }
        &self.v
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::four_joints::four_joints;

    #[test]
    fn velocities_of_a_run_are_those_of_its_frames() {
        let model = four_joints();
        let mut q = Vec::new();
        for i in 0..30 {
            let dv: Vec<f64> = (0..model.nv).map(|k| (0.21 * i as f64 + 1.3 * k as f64).sin()).collect();
            let mut frame = model.neutral();
            model.integrate(&model.neutral(), &dv, &mut frame);
            q.extend(frame);
        }
        let motion = Motion { rate_hz: 100.0, nq: model.nq, nv: model.nv, q, ..Motion::default() };
        for (start, end) in [(0, 30), (3, 19), (4, 9), (5, 7), (6, 7)] {
            let all = run_velocities(&model, &motion, start, end);
            let mut one = Velocity::new(&model);
            for (frame, found) in (start..end).zip(all.chunks_exact(model.nv)) {
                let expected = one.at(&model, &motion, start, end, frame);
                for (f, e) in found.iter().zip(expected) {
                    assert!((f - e).abs() < 1e-11, "frame {frame} of {start}..{end}: {f} {e}");
                }
            }
        }
    }
}
