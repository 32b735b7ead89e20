//! Kinematics and rows of eight frames at once, one in each SIMD lane.
//!
//! Equivalent to [`State`](crate::State) for each frame, with the same results up to rounding, in a
//! fraction of the time: all vectors of a frame are expressed in one common frame (root axes about
//! the root for forces, world axes about a fixed point for momenta), so that the recursion needs no
//! change of axes and each link's ten columns follow from its own pose, twist and acceleration.
//!
//! FrameBlock are independent and multiplications are not fused with additions: a frame gives the
//! same numbers in any lane, on every processor.

use crate::base_parameters::BaseParameters;
use crate::regressor::write_base;
use crate::{JointKind, Model, Phi};
use fearless_simd::{Level, Simd, SimdBase, dispatch, f64x8};
use nalgebra::{Matrix3, Vector3};

/// Number of frames in a batch.
pub const LANES: usize = 8;

/// One number per frame.
pub type FrameBlock = [f64; LANES];

/// Scratch memory for eight frames. Nothing allocates after [`FrameBatch::new`].
#[derive(Debug, Clone)]
pub struct FrameBatch {
    level: Level,
    links: Vec<LinkFrames>,
}

/// A link in eight frames, all vectors in common axes.
#[derive(Debug, Clone, Copy)]
struct LinkFrames {
    /// Columns of the rotation from link axes.
    axes: [[FrameBlock; 3]; 3],
    /// Origin of the link relative to the common origin, m.
    position: [FrameBlock; 3],
    /// Velocity of the origin, m/s.
    velocity: [FrameBlock; 3],
    /// Angular velocity, rad/s.
    omega: [FrameBlock; 3],
    /// Acceleration of the origin minus gravity, m/s².
    acceleration: [FrameBlock; 3],
    /// Angular acceleration, rad/s².
    alpha: [FrameBlock; 3],
}

const ZEROS: [FrameBlock; 3] = [[0.0; LANES]; 3];

impl FrameBatch {
    /// Scratch memory for a model with this number of links. It stores no data of the model.
    pub fn new(model: &Model) -> Self {
        let link = LinkFrames {
            axes: [ZEROS; 3],
            position: ZEROS,
            velocity: ZEROS,
            omega: ZEROS,
            acceleration: ZEROS,
            alpha: ZEROS,
        };
        Self { level: Level::new(), links: vec![link; model.n_links()] }
    }

    /// Poses, velocities and accelerations in root axes about the root, as
    /// [`FrameBatch::base_wrench_rows`] needs them.
    ///
    /// # Panics
    /// If a slice is shorter than `nq` or `nv`, or the model has more links than the one this
    /// scratch was made for.
    pub fn forward_acceleration(
        &mut self,
        model: &Model,
        q: &[&[f64]; LANES],
        v: &[&[f64]; LANES],
        a: &[&[f64]; LANES],
    ) {
        let links = &mut self.links[..model.n_links()];
        dispatch!(self.level, simd => forward::<_, true>(simd, model, links, q, v, a, &Vector3::zeros()));
    }

    /// Poses and velocities in world axes about `origin_in_world` (a fixed point), as
    /// [`FrameBatch::momentum_rows`] and [`FrameBatch::first_moment_rows`] need them.
    ///
    /// # Panics
    /// As [`FrameBatch::forward_acceleration`].
    pub fn forward_velocity(
        &mut self,
        model: &Model,
        q: &[&[f64]; LANES],
        v: &[&[f64]; LANES],
        origin_in_world: &Vector3<f64>,
    ) {
        let links = &mut self.links[..model.n_links()];
        dispatch!(self.level, simd => forward::<_, false>(simd, model, links, q, v, v, origin_in_world));
    }

    /// [`State::base_wrench_rows`](crate::State::base_wrench_rows) of every frame:
    /// `out[6 * column + row]`. Needs [`FrameBatch::forward_acceleration`].
    ///
    /// # Panics
    /// If `out` does not have 6 n_base entries.
    pub fn base_wrench_rows(&self, base: &BaseParameters, out: &mut [FrameBlock]) {
        assert_eq!(out.len(), 6 * base.len(), "length of the base-wrench rows");
        let links = self.links.as_slice();
        dispatch!(self.level, simd => write_base::<60, FrameBlock>(
            base,
            out,
            #[inline(always)]
            |i, block| wrench_block(simd, &links[i], block),
        ));
    }

    /// [`State::momentum_rows`](crate::State::momentum_rows) of every frame: `out[6 * column +
    /// row]`. Needs [`FrameBatch::forward_velocity`].
    ///
    /// # Panics
    /// If `out` does not have 6 n_base entries.
    pub fn momentum_rows(&self, base: &BaseParameters, out: &mut [FrameBlock]) {
        assert_eq!(out.len(), 6 * base.len(), "length of the momentum rows");
        let links = self.links.as_slice();
        dispatch!(self.level, simd => write_base::<60, FrameBlock>(
            base,
            out,
            #[inline(always)]
            |i, block| momentum_block(simd, &links[i], block),
        ));
    }

    /// [`State::first_moment_rows`](crate::State::first_moment_rows) of every frame: `out[3 *
    /// column + row]`. Needs [`FrameBatch::forward_velocity`].
    ///
    /// # Panics
    /// If `out` does not have 3 n_base entries.
    pub fn first_moment_rows(&self, base: &BaseParameters, out: &mut [FrameBlock]) {
        assert_eq!(out.len(), 3 * base.len(), "length of the first-moment rows");
        let links = self.links.as_slice();
        write_base::<30, FrameBlock>(base, out, |i, block| first_moment_block(&links[i], block));
    }

    /// Centre of mass of every frame relative to the common origin, common axes, m.
    pub fn centre_of_mass(&self, phi: &[Phi]) -> [Vector3<f64>; LANES] {
        let mass: f64 = phi.iter().map(|phi| phi[0]).sum();
        let mut moment = [Vector3::zeros(); LANES];
        for (link, phi) in self.links.iter().zip(phi) {
            for (lane, sum) in moment.iter_mut().enumerate() {
                for axis in 0..3 {
                    sum[axis] += phi[0] * link.position[axis][lane]
                        + phi[1] * link.axes[0][axis][lane]
                        + phi[2] * link.axes[1][axis][lane]
                        + phi[3] * link.axes[2][axis][lane];
                }
            }
        }
        moment.map(|m| m / mass)
    }
}

/// A vector in eight frames.
#[derive(Clone, Copy)]
struct V<S: Simd> {
    x: f64x8<S>,
    y: f64x8<S>,
    z: f64x8<S>,
}

impl<S: Simd> V<S> {
    #[inline(always)]
    fn load(simd: S, from: &[FrameBlock; 3]) -> Self {
        Self {
            x: f64x8::load_array_ref(simd, &from[0]),
            y: f64x8::load_array_ref(simd, &from[1]),
            z: f64x8::load_array_ref(simd, &from[2]),
        }
    }
    #[inline(always)]
    fn store(self, to: &mut [FrameBlock; 3]) {
        self.x.store_array(&mut to[0]);
        self.y.store_array(&mut to[1]);
        self.z.store_array(&mut to[2]);
    }
    #[inline(always)]
    fn constant(simd: S, v: &Vector3<f64>) -> Self {
        Self { x: f64x8::splat(simd, v.x), y: f64x8::splat(simd, v.y), z: f64x8::splat(simd, v.z) }
    }
    #[inline(always)]
    fn gather(simd: S, frames: &[&[f64]; LANES], first: usize) -> Self {
        Self { x: gather(simd, frames, first), y: gather(simd, frames, first + 1), z: gather(simd, frames, first + 2) }
    }
    #[inline(always)]
    fn plus(self, o: Self) -> Self {
        Self { x: self.x + o.x, y: self.y + o.y, z: self.z + o.z }
    }
    #[inline(always)]
    fn minus(self, o: Self) -> Self {
        Self { x: self.x - o.x, y: self.y - o.y, z: self.z - o.z }
    }
    #[inline(always)]
    fn scale(self, k: f64x8<S>) -> Self {
        Self { x: self.x * k, y: self.y * k, z: self.z * k }
    }
    #[inline(always)]
    fn cross(self, o: Self) -> Self {
        Self { x: self.y * o.z - self.z * o.y, y: self.z * o.x - self.x * o.z, z: self.x * o.y - self.y * o.x }
    }
    #[inline(always)]
    fn dot(self, o: Self) -> f64x8<S> {
        self.x * o.x + self.y * o.y + self.z * o.z
    }
}

#[inline(always)]
fn gather<S: Simd>(simd: S, frames: &[&[f64]; LANES], index: usize) -> f64x8<S> {
    f64x8::from_fn(simd, |lane| frames[lane][index])
}

/// Columns of a rotation.
type Axes<S> = [V<S>; 3];

#[inline(always)]
fn rotate<S: Simd>(r: &Axes<S>, v: V<S>) -> V<S> {
    r[0].scale(v.x).plus(r[1].scale(v.y)).plus(r[2].scale(v.z))
}

#[inline(always)]
fn rotate_back<S: Simd>(r: &Axes<S>, v: V<S>) -> V<S> {
    V { x: r[0].dot(v), y: r[1].dot(v), z: r[2].dot(v) }
}

/// The rotation of quaternions of any length, preceded by the fixed rotation `base`.
#[inline(always)]
fn rotation<S: Simd>(base: &Matrix3<f64>, x: f64x8<S>, y: f64x8<S>, z: f64x8<S>, w: f64x8<S>, simd: S) -> Axes<S> {
    let one = f64x8::splat(simd, 1.0);
    let two = one + one;
    let scale = two / (x * x + y * y + z * z + w * w);
    let (xs, ys, zs) = (x * scale, y * scale, z * scale);
    let (wx, wy, wz) = (w * xs, w * ys, w * zs);
    let (xx, xy, xz) = (x * xs, x * ys, x * zs);
    let (yy, yz, zz) = (y * ys, y * zs, z * zs);
    let turn = [
        V { x: one - (yy + zz), y: xy + wz, z: xz - wy },
        V { x: xy - wz, y: one - (xx + zz), z: yz + wx },
        V { x: xz + wy, y: yz - wx, z: one - (xx + yy) },
    ];
    if *base == Matrix3::identity() {
        return turn;
    }
    let base: Axes<S> = std::array::from_fn(|k| V::constant(simd, &base.column(k).into_owned()));
    [rotate(&base, turn[0]), rotate(&base, turn[1]), rotate(&base, turn[2])]
}

/// Kinematics of all links. With `ACCELERATION`: root axes about the root, accelerations minus
/// gravity; without: world axes about `origin`, no accelerations.
#[inline(always)]
fn forward<S: Simd, const ACCELERATION: bool>(
    simd: S,
    model: &Model,
    links: &mut [LinkFrames],
    q: &[&[f64]; LANES],
    v: &[&[f64]; LANES],
    a: &[&[f64]; LANES],
    origin: &Vector3<f64>,
) {
    let zero = V::constant(simd, &Vector3::zeros());
    for i in 0..links.len() {
        let link = &model.links[i];
        let (iq, iv) = (link.joint.q_offset, link.joint.v_offset);
        let place = &link.joint.parent_from_joint;
        let base = place.rotation.to_rotation_matrix().into_inner();
        let fixed =
            |r: &Matrix3<f64>| -> Axes<S> { std::array::from_fn(|k| V::constant(simd, &r.column(k).into_owned())) };
        // Pose in the parent.
        let mut offset = V::constant(simd, &place.translation.vector);
        let local = match &link.joint.kind {
            JointKind::Free => {
                offset = offset.plus(rotate(&fixed(&base), V::gather(simd, q, iq)));
                let p = V::gather(simd, q, iq + 3);
                rotation(&base, p.x, p.y, p.z, gather(simd, q, iq + 6), simd)
            }
            JointKind::Spherical => {
                let p = V::gather(simd, q, iq);
                rotation(&base, p.x, p.y, p.z, gather(simd, q, iq + 3), simd)
            }
            JointKind::Revolute(axis) => {
                let mut sine = [0.0; LANES];
                let mut cosine = [0.0; LANES];
                for lane in 0..LANES {
                    (sine[lane], cosine[lane]) = (0.5 * q[lane][iq]).sin_cos();
                }
                let s = V::constant(simd, axis).scale(f64x8::load_array(simd, sine));
                rotation(&base, s.x, s.y, s.z, f64x8::load_array(simd, cosine), simd)
            }
            JointKind::Prismatic(axis) => {
                let along = base * axis.into_inner();
                offset = offset.plus(V::constant(simd, &along).scale(gather(simd, q, iq)));
                fixed(&base)
            }
            JointKind::Fixed => fixed(&base),
        };
        // Contribution of the joint to velocity and acceleration, link axes.
        let part = |values: &[&[f64]; LANES]| -> (V<S>, V<S>) {
            match &link.joint.kind {
                JointKind::Free => (V::gather(simd, values, iv), V::gather(simd, values, iv + 3)),
                JointKind::Spherical => (zero, V::gather(simd, values, iv)),
                JointKind::Revolute(axis) => (zero, V::constant(simd, axis).scale(gather(simd, values, iv))),
                JointKind::Prismatic(axis) => (V::constant(simd, axis).scale(gather(simd, values, iv)), zero),
                JointKind::Fixed => (zero, zero),
            }
        };
        let (joint_lin, joint_ang) = part(v);
        let linear = matches!(link.joint.kind, JointKind::Free | JointKind::Prismatic(_));
        let turning = !matches!(link.joint.kind, JointKind::Fixed | JointKind::Prismatic(_));
        let Some(parent) = link.parent else {
            let out = &mut links[i];
            if ACCELERATION {
                let (a_lin, a_ang) = part(a);
                let gravity = rotate_back(&local, V::constant(simd, &model.gravity_mps2));
                for (k, column) in fixed(&Matrix3::identity()).into_iter().enumerate() {
                    column.store(&mut out.axes[k]);
                }
                zero.store(&mut out.position);
                joint_lin.store(&mut out.velocity);
                joint_ang.store(&mut out.omega);
                // From the derivative of components in moving axes to the acceleration.
                a_lin.plus(joint_ang.cross(joint_lin)).minus(gravity).store(&mut out.acceleration);
                a_ang.store(&mut out.alpha);
            } else {
                for k in 0..3 {
                    local[k].store(&mut out.axes[k]);
                }
                offset.minus(V::constant(simd, origin)).store(&mut out.position);
                rotate(&local, joint_lin).store(&mut out.velocity);
                rotate(&local, joint_ang).store(&mut out.omega);
            }
            continue;
        };
        let up = links[parent];
        let out = &mut links[i];
        let parent_axes: Axes<S> = std::array::from_fn(|k| V::load(simd, &up.axes[k]));
        let axes: Axes<S> =
            [rotate(&parent_axes, local[0]), rotate(&parent_axes, local[1]), rotate(&parent_axes, local[2])];
        let arm = rotate(&parent_axes, offset);
        for k in 0..3 {
            axes[k].store(&mut out.axes[k]);
        }
        V::load(simd, &up.position).plus(arm).store(&mut out.position);
        let parent_omega = V::load(simd, &up.omega);
        let sweep = parent_omega.cross(arm);
        let mut velocity = V::load(simd, &up.velocity).plus(sweep);
        let mut omega = parent_omega;
        let (mut slide, mut spin) = (zero, zero);
        if linear {
            slide = rotate(&axes, joint_lin);
            velocity = velocity.plus(slide);
        }
        if turning {
            spin = rotate(&axes, joint_ang);
            omega = omega.plus(spin);
        }
        velocity.store(&mut out.velocity);
        omega.store(&mut out.omega);
        if ACCELERATION {
            let (a_lin, a_ang) = part(a);
            let parent_alpha = V::load(simd, &up.alpha);
            let mut acceleration =
                V::load(simd, &up.acceleration).plus(parent_alpha.cross(arm)).plus(parent_omega.cross(sweep));
            let mut alpha = parent_alpha;
            if linear {
                let turned = parent_omega.cross(slide);
                acceleration = acceleration.plus(turned.plus(turned)).plus(rotate(&axes, a_lin));
            }
            if turning {
                alpha = alpha.plus(parent_omega.cross(spin)).plus(rotate(&axes, a_ang));
            }
            acceleration.store(&mut out.acceleration);
            alpha.store(&mut out.alpha);
        }
    }
}

#[inline(always)]
fn put<S: Simd>(out: &mut [FrameBlock; 60], column: usize, upper: V<S>, lower: V<S>) {
    let to = &mut out[6 * column..6 * column + 6];
    upper.x.store_array(&mut to[0]);
    upper.y.store_array(&mut to[1]);
    upper.z.store_array(&mut to[2]);
    lower.x.store_array(&mut to[3]);
    lower.y.store_array(&mut to[4]);
    lower.z.store_array(&mut to[5]);
}

/// Pairs of axes of the inertia elements Iyz, Izx, Ixy.
const PRODUCTS: [(usize, usize); 3] = [(1, 2), (2, 0), (0, 1)];

#[inline(always)]
fn wrench_block<S: Simd>(simd: S, link: &LinkFrames, out: &mut [FrameBlock; 60]) {
    let zero = V::constant(simd, &Vector3::zeros());
    let e: Axes<S> = std::array::from_fn(|k| V::load(simd, &link.axes[k]));
    let arm = V::load(simd, &link.position);
    let a = V::load(simd, &link.acceleration);
    let w = V::load(simd, &link.omega);
    let dw = V::load(simd, &link.alpha);
    put(out, 0, a, arm.cross(a));
    // u = ω × e: rate of an axis; force of a first moment along it: ω̇ × e + ω × u.
    let u: Axes<S> = [w.cross(e[0]), w.cross(e[1]), w.cross(e[2])];
    for k in 0..3 {
        let force = dw.cross(e[k]).plus(w.cross(u[k]));
        put(out, 1 + k, force, arm.cross(force).plus(e[k].cross(a)));
    }
    // I ω̇ + ω × I ω with I = e eᵀ, and I = e fᵀ + f eᵀ
    let (wl, dl) = (rotate_back(&e, w), rotate_back(&e, dw));
    let (wl, dl) = ([wl.x, wl.y, wl.z], [dl.x, dl.y, dl.z]);
    for k in 0..3 {
        put(out, 4 + k, zero, e[k].scale(dl[k]).plus(u[k].scale(wl[k])));
    }
    for (k, (i, j)) in PRODUCTS.into_iter().enumerate() {
        let moment = e[i].scale(dl[j]).plus(e[j].scale(dl[i])).plus(u[i].scale(wl[j])).plus(u[j].scale(wl[i]));
        put(out, 7 + k, zero, moment);
    }
}

#[inline(always)]
fn momentum_block<S: Simd>(simd: S, link: &LinkFrames, out: &mut [FrameBlock; 60]) {
    let zero = V::constant(simd, &Vector3::zeros());
    let e: Axes<S> = std::array::from_fn(|k| V::load(simd, &link.axes[k]));
    let arm = V::load(simd, &link.position);
    let v = V::load(simd, &link.velocity);
    let w = V::load(simd, &link.omega);
    put(out, 0, v, arm.cross(v));
    for k in 0..3 {
        let p = w.cross(e[k]);
        put(out, 1 + k, p, arm.cross(p).plus(e[k].cross(v)));
    }
    let wl = rotate_back(&e, w);
    let wl = [wl.x, wl.y, wl.z];
    for k in 0..3 {
        put(out, 4 + k, zero, e[k].scale(wl[k]));
    }
    for (k, (i, j)) in PRODUCTS.into_iter().enumerate() {
        put(out, 7 + k, zero, e[i].scale(wl[j]).plus(e[j].scale(wl[i])));
    }
}

fn first_moment_block(link: &LinkFrames, out: &mut [FrameBlock; 30]) {
    out[..3].copy_from_slice(&link.position);
    for k in 0..3 {
        out[3 + 3 * k..6 + 3 * k].copy_from_slice(&link.axes[k]);
    }
    out[12..].fill([0.0; LANES]);
}

#[cfg(test)]
#[cfg(target_arch = "x86_64")]
mod tests {
    use super::*;
    use crate::ModelSpec;

    #[test]
    fn every_instruction_set_gives_the_same_numbers() {
        let spec: ModelSpec = serde_yaml::from_str(include_str!("../../../configs/models/human34.yaml")).unwrap();
        let mut model = Model::from_spec(&spec).unwrap();
        for (i, link) in model.links.iter_mut().enumerate().skip(1) {
            link.joint.parent_from_joint.translation.vector = Vector3::new(0.1, -0.3, 0.02 * i as f64);
        }
        let base = BaseParameters::of(&model);
        let series = |n: usize, k: usize| (0..n).map(|i| (0.7 * i as f64 + k as f64).sin()).collect::<Vec<f64>>();
        let frames: Vec<[Vec<f64>; 3]> =
            (0..LANES).map(|k| [series(model.nq, k), series(model.nv, k + 9), series(model.nv, k + 21)]).collect();
        let part = |p: usize| -> [&[f64]; LANES] { std::array::from_fn(|k| frames[k][p].as_slice()) };
        let best = Level::new();
        let levels = [best.as_avx2().map(Level::Avx2), best.as_sse4_2().map(Level::Sse4_2), Some(Level::baseline())];
        let rows = |level: Level| {
            let mut batch = FrameBatch { level, ..FrameBatch::new(&model) };
            let mut wrench = vec![[0.0; LANES]; 6 * base.len()];
            let mut momentum = wrench.clone();
            batch.forward_acceleration(&model, &part(0), &part(1), &part(2));
            batch.base_wrench_rows(&base, &mut wrench);
            batch.forward_velocity(&model, &part(0), &part(1), &Vector3::new(0.1, 0.2, 0.3));
            batch.momentum_rows(&base, &mut momentum);
            [wrench, momentum]
        };
        let expected = rows(best);
        for level in levels.into_iter().flatten() {
            assert!(rows(level) == expected, "{level:?}");
        }
    }
}
