//! Matrices that make forces, momenta and first moments linear in the inertial parameters.
//!
//! Each link contributes a block of ten columns; with every vector expressed in one common frame
//! (root axes or world axes) a block depends on this link alone, so the tree needs no backward
//! pass.

use crate::base_parameters::KeptColumns;
use crate::rotation::{columns, times, transposed_times};
use crate::state::{angular, linear};
use crate::{BaseParameters, Model, State};
use nalgebra::{DMatrix, Vector3};

/// Columns of `I a` in the order of φ's inertia elements, in the axes of `a`.
fn inertia_columns(a: &Vector3<f64>) -> [Vector3<f64>; 6] {
    [
        Vector3::new(a.x, 0.0, 0.0),
        Vector3::new(0.0, a.y, 0.0),
        Vector3::new(0.0, 0.0, a.z),
        Vector3::new(0.0, a.z, a.y),
        Vector3::new(a.z, 0.0, a.x),
        Vector3::new(a.y, a.x, 0.0),
    ]
}

fn put(out: &mut [f64; 60], column: usize, upper: &Vector3<f64>, lower: &Vector3<f64>) {
    let c = &mut out[6 * column..6 * column + 6];
    c[..3].copy_from_slice(upper.as_slice());
    c[3..].copy_from_slice(lower.as_slice());
}

impl State {
    /// The ten columns of one link of the base-wrench regressor: acceleration of its origin minus
    /// gravity `a`, the matrix `[ω̇]× + [ω]×²` applied to first moments, and the inertia columns.
    fn wrench_block(&self, model: &Model, i: usize, out: &mut [f64; 60]) {
        let (root, r) = (&self.rotation[0], &self.rotation[i]);
        let e = columns(r).map(|column| transposed_times(root, &column));
        let to_root = |v: &Vector3<f64>| e[0] * v.x + e[1] * v.y + e[2] * v.z;
        let arm = self.world_from_link[i].translation.vector - self.world_from_link[0].translation.vector;
        let origin = transposed_times(root, &arm);
        let (lin, w) = (linear(&self.velocity[i]), angular(&self.velocity[i]));
        let (a_lin, dw) = (linear(&self.acceleration[i]), angular(&self.acceleration[i]));
        // All in link axes at first.
        let a = a_lin + w.cross(&lin) - transposed_times(r, &model.gravity_mps2);
        let a_root = to_root(&a);
        put(out, 0, &a_root, &origin.cross(&a_root));
        let (xx, yy, zz) = (w.x * w.x, w.y * w.y, w.z * w.z);
        let (xy, yz, zx) = (w.x * w.y, w.y * w.z, w.z * w.x);
        // Columns of [ω̇]× + [ω]×²
        let spin = [
            Vector3::new(-yy - zz, xy + dw.z, zx - dw.y),
            Vector3::new(xy - dw.z, -xx - zz, yz + dw.x),
            Vector3::new(zx + dw.y, yz - dw.x, -xx - yy),
        ];
        for k in 0..3 {
            let force = to_root(&spin[k]);
            put(out, 1 + k, &force, &(origin.cross(&force) - a_root.cross(&e[k])));
        }
        // I ω̇ + ω × (I ω)
        let inertial = [
            Vector3::new(dw.x, zx, -xy),
            Vector3::new(-yz, dw.y, xy),
            Vector3::new(yz, -zx, dw.z),
            Vector3::new(yy - zz, dw.z - xy, dw.y + zx),
            Vector3::new(dw.z + xy, zz - xx, dw.x - yz),
            Vector3::new(dw.y - zx, dw.x + yz, xx - yy),
        ];
        for (k, column) in inertial.iter().enumerate() {
            put(out, 4 + k, &Vector3::zeros(), &to_root(column));
        }
    }

    fn momentum_block(&self, i: usize, origin_in_world: &Vector3<f64>, out: &mut [f64; 60]) {
        let r = &self.rotation[i];
        let arm = self.world_from_link[i].translation.vector - origin_in_world;
        let v = times(r, &linear(&self.velocity[i]));
        let w_link = angular(&self.velocity[i]);
        let w = times(r, &w_link);
        put(out, 0, &v, &arm.cross(&v));
        let e = columns(r);
        for k in 0..3 {
            let p = w.cross(&e[k]);
            put(out, 1 + k, &p, &(arm.cross(&p) + e[k].cross(&v)));
        }
        for (k, column) in inertia_columns(&w_link).iter().enumerate() {
            put(out, 4 + k, &Vector3::zeros(), &times(r, column));
        }
    }

    fn first_moment_block(&self, i: usize, origin_in_world: &Vector3<f64>, out: &mut [f64; 30]) {
        let arm = self.world_from_link[i].translation.vector - origin_in_world;
        out[..3].copy_from_slice(arm.as_slice());
        out[3..12].copy_from_slice(self.rotation[i].as_slice());
        out[12..30].fill(0.0);
    }

    /// 6 × 10n regressor of the base wrench (the paper's Y_O): root axes about the root origin,
    /// linear then angular, `Y φ = F_ext` with gravity on the left. Needs
    /// [`State::forward_acceleration`].
    ///
    /// # Panics
    /// If `out` is not 6 × 10n.
    pub fn base_wrench_regressor(&self, model: &Model, out: &mut DMatrix<f64>) {
        assert_eq!(out.shape(), (6, 10 * model.n_links()), "shape of the base-wrench regressor");
        for (i, block) in out.as_mut_slice().as_chunks_mut::<60>().0.iter_mut().enumerate() {
            self.wrench_block(model, i, block);
        }
    }

    /// 6 × 10n regressor of the spatial momentum in world axes about `origin_in_world` (a fixed
    /// point): rows 0-2 linear momentum, rows 3-5 angular momentum. Needs
    /// [`State::forward_velocity`].
    ///
    /// # Panics
    /// If `out` is not 6 × 10n.
    pub fn momentum_regressor(&self, model: &Model, origin_in_world: &Vector3<f64>, out: &mut DMatrix<f64>) {
        assert_eq!(out.shape(), (6, 10 * model.n_links()), "shape of the momentum regressor");
        for (i, block) in out.as_mut_slice().as_chunks_mut::<60>().0.iter_mut().enumerate() {
            self.momentum_block(i, origin_in_world, block);
        }
    }

    /// 3 × 10n regressor of the first moment of mass Σ m (p − origin) in world axes. Needs poses.
    ///
    /// # Panics
    /// If `out` is not 3 × 10n.
    pub fn first_moment_regressor(&self, model: &Model, origin_in_world: &Vector3<f64>, out: &mut DMatrix<f64>) {
        assert_eq!(out.shape(), (3, 10 * model.n_links()), "shape of the first-moment regressor");
        for (i, block) in out.as_mut_slice().as_chunks_mut::<30>().0.iter_mut().enumerate() {
            self.first_moment_block(i, origin_in_world, block);
        }
    }

    /// The base columns of [`State::base_wrench_regressor`], 6 × n_base, without the full matrix:
    /// `Y_B = Y K`.
    ///
    /// # Panics
    /// If `out` is not 6 × n_base, or `base` belongs to a larger model.
    pub fn base_wrench_rows(&self, model: &Model, base: &BaseParameters, out: &mut DMatrix<f64>) {
        assert_eq!(out.shape(), (6, base.len()), "shape of the base-wrench rows");
        write_base::<60, f64>(base, out.as_mut_slice(), |i, block| self.wrench_block(model, i, block));
    }

    /// The base columns of [`State::momentum_regressor`], 6 × n_base.
    ///
    /// # Panics
    /// If `out` is not 6 × n_base, or `base` belongs to a larger model.
    pub fn momentum_rows(&self, base: &BaseParameters, origin_in_world: &Vector3<f64>, out: &mut DMatrix<f64>) {
        assert_eq!(out.shape(), (6, base.len()), "shape of the momentum rows");
        write_base::<60, f64>(base, out.as_mut_slice(), |i, block| self.momentum_block(i, origin_in_world, block));
    }

    /// The base columns of [`State::first_moment_regressor`], 3 × n_base.
    ///
    /// # Panics
    /// If `out` is not 3 × n_base, or `base` belongs to a larger model.
    pub fn first_moment_rows(&self, base: &BaseParameters, origin_in_world: &Vector3<f64>, out: &mut DMatrix<f64>) {
        assert_eq!(out.shape(), (3, base.len()), "shape of the first-moment rows");
        write_base::<30, f64>(base, out.as_mut_slice(), |i, block| self.first_moment_block(i, origin_in_world, block));
    }
}

/// One number, or one number for each of several frames.
pub(crate) trait Entry: Copy {
    const ZERO: Self;
    /// `self += x factor`.
    fn add(&mut self, x: &Self, factor: f64);
}

impl Entry for f64 {
    const ZERO: Self = 0.0;
    #[inline(always)]
    fn add(&mut self, x: &Self, factor: f64) {
        *self += x * factor;
    }
}

impl<const LANES: usize> Entry for [f64; LANES] {
    const ZERO: Self = [0.0; LANES];
    #[inline(always)]
    fn add(&mut self, x: &Self, factor: f64) {
        for (to, from) in self.iter_mut().zip(x) {
            *to += from * factor;
        }
    }
}

/// Writes base columns link by link; `block` fills the ten columns of one link. `LENGTH` is ten
/// times the number of rows.
#[inline(always)]
pub(crate) fn write_base<const LENGTH: usize, T: Entry>(
    base: &BaseParameters,
    out: &mut [T],
    block: impl Fn(usize, &mut [T; LENGTH]),
) {
    let rows = LENGTH / 10;
    let mut full = [T::ZERO; LENGTH];
    // From the last link to the first: a link that keeps all but its first columns writes its whole
    // block in place, overlapping the end of its predecessor's block, which is written afterwards.
    for (i, kept) in base.kept.iter().enumerate().rev() {
        let start = rows * kept.first;
        let mut place = None;
        match &kept.columns {
            KeptColumns::Run(_, 0) => continue,
            KeptColumns::Run(first, number) if first + number == 10 && *first <= kept.first => {
                place = out[start - rows * first..].first_chunk_mut();
            }
            _ => {}
        }
        if let Some(place) = place {
            block(i, place);
            continue;
        }
        block(i, &mut full);
        match &kept.columns {
            KeptColumns::Run(first, number) => {
                out[start..start + rows * number].copy_from_slice(&full[rows * first..rows * (first + number)]);
            }
            KeptColumns::Some(columns) => {
                for (to, from) in out[start..].chunks_exact_mut(rows).zip(columns) {
                    to.copy_from_slice(&full[rows * from..rows * (from + 1)]);
                }
            }
            KeptColumns::Mixed(matrix) => {
                for (to, column) in out[start..].chunks_exact_mut(rows).zip(matrix.column_iter()) {
                    to.fill(T::ZERO);
                    for (from, factor) in full.chunks_exact(rows).zip(column.iter()) {
                        for (t, f) in to.iter_mut().zip(from) {
                            t.add(f, *factor);
                        }
                    }
                }
            }
        }
    }
    // Masses on prismatic joints are also counted in the parent.
    let mut link = usize::MAX;
    for (column, from, factor) in &base.crossing {
        if link != from / 10 {
            link = from / 10;
            block(link, &mut full);
        }
        let from = rows * (from % 10);
        for (t, f) in out[rows * column..rows * (column + 1)].iter_mut().zip(&full[from..from + rows]) {
            t.add(f, *factor);
        }
    }
}
