//! [`Model::difference`] of eight pairs of frames at once, one in each SIMD lane: the same
//! operations in the same order, hence the same numbers.

use crate::batch::{FrameBlock, LANES};
use crate::rotation::{left_jacobian_inverse, quaternion_log};
use crate::{JointKind, Model};
use fearless_simd::{Level, Select, Simd, SimdBase, SimdFloat, SimdMask, dispatch, f64x8};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Coordinates of eight frames.
type Frames<'a> = [&'a [f64]; LANES];

/// Differences of eight pairs of frames at once.
#[derive(Debug, Clone)]
pub struct FrameDifferences {
    level: Level,
}

impl Default for FrameDifferences {
    fn default() -> Self {
        Self { level: Level::new() }
    }
}

impl FrameDifferences {
    /// [`Model::difference`] from each frame of `from` to the one of `to`: nv numbers a lane.
    ///
    /// # Panics
    /// If a slice is shorter than `nq` or `nv`.
    pub fn between(&self, model: &Model, from: &Frames<'_>, to: &Frames<'_>, dv_out: &mut [FrameBlock]) {
        dispatch!(self.level, simd => between(simd, model, from, to, dv_out));
    }
}

#[inline(always)]
fn between<S: Simd>(simd: S, model: &Model, from: &Frames<'_>, to: &Frames<'_>, dv_out: &mut [FrameBlock]) {
    for joint in model.links.iter().map(|link| &link.joint) {
        let (iq, iv) = (joint.q_offset, joint.v_offset);
        match joint.kind {
            JointKind::Free => {
                turns(simd, from, to, iq + 3, &mut dv_out[iv + 3..iv + 6]);
                for lane in 0..LANES {
                    let at = |q: &[f64]| Vector3::new(q[iq], q[iq + 1], q[iq + 2]);
                    let omega = Vector3::from_fn(|i, _| dv_out[iv + 3 + i][lane]);
                    let start = quaternion(from[lane], iq + 3);
                    let shift = start.inverse_transform_vector(&(at(to[lane]) - at(from[lane])));
                    let linear = left_jacobian_inverse(&omega) * shift;
                    (0..3).for_each(|i| dv_out[iv + i][lane] = linear[i]);
                }
            }
            JointKind::Spherical => turns(simd, from, to, iq, &mut dv_out[iv..iv + 3]),
            JointKind::Revolute(_) | JointKind::Prismatic(_) => {
                (0..LANES).for_each(|lane| dv_out[iv][lane] = to[lane][iq] - from[lane][iq]);
            }
            JointKind::Fixed => {}
        }
    }
}

fn quaternion(q: &[f64], at: usize) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Quaternion::new(q[at + 3], q[at], q[at + 1], q[at + 2]))
}

/// Quaternions `[x y z w]` at an index, of unit length.
#[inline(always)]
fn quaternions<S: Simd>(simd: S, frames: &Frames<'_>, at: usize) -> [f64x8<S>; 4] {
    let [x, y, z, w] = [0, 1, 2, 3].map(|i| f64x8::from_fn(simd, |lane| frames[lane][at + i]));
    // in the order in which nalgebra adds
    let length = ((x * x + z * z) + (y * y + w * w)).sqrt();
    [x / length, y / length, z / length, w / length]
}

/// Rotation vectors of [`quaternion_log`] between the quaternions at an index.
#[inline(always)]
fn turns<S: Simd>(simd: S, from: &Frames<'_>, to: &Frames<'_>, at: usize, out: &mut [FrameBlock]) {
    let splat = |x: f64| f64x8::splat(simd, x);
    let [a, b, c, d] = quaternions(simd, from, at);
    // the inverse of a unit quaternion
    let (a, b, c) = (-a, -b, -c);
    let [x, y, z, w] = quaternions(simd, to, at);
    let scalar = d * w - a * x - b * y - c * z;
    let i = d * x + a * w + b * z - c * y;
    let j = d * y - a * z + b * w + c * x;
    let k = d * z + a * y - b * x + c * w;
    // one hemisphere: the shorter rotation
    let behind = scalar.simd_lt(splat(0.0));
    let ahead = |value: f64x8<S>| behind.select(-value, value);
    let (w, i, j, k) = (ahead(scalar), ahead(i), ahead(j), ahead(k));
    let sine = (i * i + j * j + k * k).sqrt();
    let is_small = sine.simd_lt(splat(0.1) * w);
    let t2 = (sine / w) * (sine / w);
    let mut sum = splat(0.0);
    for order in (0..9).rev() {
        sum = splat(1.0 / f64::from(2 * order + 1)) - t2 * sum;
    }
    let scale = splat(2.0) / w * sum;
    (i * scale).store_array(&mut out[0]);
    (j * scale).store_array(&mut out[1]);
    (k * scale).store_array(&mut out[2]);
    if !is_small.all_true() {
        for lane in 0..LANES {
            let turn = quaternion(from[lane], at).inverse() * quaternion(to[lane], at);
            let omega = quaternion_log(&turn);
            (0..3).for_each(|axis| out[axis][lane] = omega[axis]);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;
    use crate::{JointSpec, LinkSpec, ModelSpec};

    #[test]
    fn eight_differences_are_those_one_by_one() {
        let kinds = [
            ("root", None, JointSpec::Free),
            ("a", Some("root"), JointSpec::Spherical),
            ("b", Some("a"), JointSpec::Revolute([0.0, 0.6, 0.8])),
            ("c", Some("b"), JointSpec::Fixed),
            ("d", Some("c"), JointSpec::Prismatic([1.0, 0.0, 0.0])),
            ("e", Some("d"), JointSpec::Spherical),
        ];
        let links = kinds.iter().map(|(name, parent, joint)| LinkSpec {
            name: (*name).to_owned(),
            parent: parent.map(str::to_owned),
            joint: *joint,
            position_m: [0.1, 0.2, -0.05],
            rpy_rad: [0.1, -0.3, 0.2],
            inertia: None,
        });
        let model = Model::from_spec(&ModelSpec::new("all".to_owned(), links.collect())).unwrap();
        let at = |size: f64, k: usize| {
            let dv: Vec<f64> = (0..model.nv).map(|i| size * (1.7 * i as f64 + 0.9 * k as f64).sin()).collect();
            let mut q = model.neutral();
            model.integrate(&model.neutral(), &dv, &mut q);
            // neither the sign nor the length of a quaternion matters
            if k.is_multiple_of(3) {
                q[3..7].iter_mut().for_each(|x| *x *= -1.001);
            }
            q
        };
        let differences = FrameDifferences::default();
        // small rotations, large ones, both, and half turns
        for size in [1e-9, 1e-3, 0.05, 0.3, 3.1] {
            let (from, to): (Vec<_>, Vec<_>) = (0..LANES).map(|k| (at(size, k), at(size, k + 50))).unzip();
            let mut lanes = vec![[f64::NAN; LANES]; model.nv];
            let first: Frames<'_> = std::array::from_fn(|lane| from[lane].as_slice());
            let second: Frames<'_> = std::array::from_fn(|lane| to[lane].as_slice());
            differences.between(&model, &first, &second, &mut lanes);

            let mut one = vec![0.0; model.nv];
            for lane in 0..LANES {
                model.difference(&from[lane], &to[lane], &mut one);
                let found: Vec<u64> = lanes.iter().map(|l| l[lane].to_bits()).collect();
                assert_eq!(found, one.iter().map(|x| x.to_bits()).collect::<Vec<_>>(), "{size}, lane {lane}");
            }
        }
    }
}
