//! Soft tissue as a random effect: the errors of weak rows that repeat from flight to flight.
//!
//! Skin slides over bone by an amount that follows the joint angles, so the same posture gives the same marker error in every flight, and
//! no resampling of flights shows it. Here the slide of each marker is a random linear function of the angles of its own joint and of the
//! nearest joint further out, `d = B (a(q) − ā)`, with independent normal entries in B. A number of realisations of B, the same for all
//! recordings of a model, goes through least-squares inverse kinematics to first order, and through the rows of the prior body. The rows
//! themselves are not kept: identification needs `Aᵀ D` alone, with the weighted rows A and the errors D that the realisations make.
//!
//! The size of the slides comes from the markers, not from the rows: each realisation predicts a marker residual, and the residuals of the
//! recording, less their white noise, say by how much to scale it.

use crate::body_windows::moments;
use crate::weak::{WeakRows, run_velocities};
use crate::{RegressorError, Stretch};
use aloft_body::{JointKind, Model, ModelMarker, Motion, Phi, State};
use faer::Mat;
use nalgebra::{DMatrix, DVector, Quaternion, SMatrix, Vector3};
use serde::{Deserialize, Serialize};

/// What the realisations are made of.
#[derive(Debug, Clone, Copy)]
pub struct Tissue<'a> {
    /// Markers and the links that carry them; a weight of zero leaves one out.
    pub markers: &'a [ModelMarker],
    /// White noise of a marker coordinate, m.
    pub marker_sd_m: f64,
    /// Realisations.
    pub draws: usize,
}

impl<'a> Tissue<'a> {
    /// Realisations that bring the standard error of a standard error to 15 %.
    pub const DRAWS: usize = 24;

    /// The usual number of realisations.
    pub fn new(markers: &'a [ModelMarker], marker_sd_m: f64) -> Self {
        Self { markers, marker_sd_m, draws: Self::DRAWS }
    }
}

/// What realisations of soft tissue make of one stretch, for slides of 1 m/rad.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Slides {
    /// `[Y | −E]ᵀ D` over the weighted rows: a row for each parameter and effect, a column for each realisation.
    pub sums: DMatrix<f64>,
    /// Sum of squares of the marker residuals that a realisation leaves, mean over realisations, (m/(m/rad))².
    pub predicted: f64,
    /// Sum of squares of the recording's marker residuals, less what white noise leaves, m². Zero where the motion has no residuals.
    pub observed: f64,
}

/// A step that is small against a body and large against rounding, m/rad.
const STEP: f64 = 1e-3;
/// Frames that the mean posture of a trial is taken from.
const POSTURES: usize = 200;
/// Coordinates that move the markers by less than this lever (m per rad) count as not seen.
const UNSEEN_LEVER_M: f64 = 1e-3;

/// Errors D of unweighted rows (6 windows × realisations), with the residuals predicted and observed.
pub(crate) fn slide_rows(
    model: &Model,
    prior: &[Phi],
    motion: &Motion,
    stretch: &Stretch,
    rows: &WeakRows,
    tissue: &Tissue<'_>,
) -> Result<(Mat<f64>, f64, f64), RegressorError> {
    let half = rows.test.half;
    let first = rows.centers.iter().min().map_or(0, |c| c - half - 1);
    let end = rows.centers.iter().max().map_or(0, |c| c + half + 2).min(motion.n_frames());
    let skin = Skin::new(model, motion, tissue);
    let n_markers = skin.markers.len();
    let nv = model.nv;
    let mut state = State::new(model);
    // how the coordinates of each frame follow the slides, and what residual stays
    let mut follows: Vec<DMatrix<f64>> = Vec::with_capacity(end - first);
    let (mut predicted, mut observed) = (0.0, 0.0);
    let mut jacobian = DMatrix::zeros(3, nv);
    let mut all = DMatrix::zeros(3 * n_markers, nv);
    for frame in first..end {
        if !motion.is_valid(frame) {
            follows.push(DMatrix::zeros(nv, tissue.draws));
            continue;
        }
        state.forward_position(model, motion.q(frame));
        for (i, (marker, _)) in skin.markers.iter().enumerate() {
            state.point_jacobian(model, marker.link, &marker.position_m, &mut jacobian);
            all.rows_mut(3 * i, 3).copy_from(&jacobian);
        }
        let shifts = skin.shifts(model, motion.q(frame), &state);
        let mut normal = all.tr_mul(&all);
        for i in 0..nv {
            normal[(i, i)] += UNSEEN_LEVER_M * UNSEEN_LEVER_M;
        }
        let factor = normal.cholesky().ok_or_else(|| RegressorError::Numeric {
            trial: stretch.trial.clone(),
            stretch: stretch.index,
            problem: format!("frame {frame}: the markers leave the coordinates undetermined"),
        })?;
        let follow = factor.solve(&all.tr_mul(&shifts));
        predicted += (&shifts - &all * &follow).norm_squared() / tissue.draws.max(1) as f64;
        follows.push(follow);
        let n = motion.marker_labels.len();
        let residuals = motion.residual_m.get(frame * n..(frame + 1) * n).unwrap_or_default();
        let seen = residuals.iter().filter(|r| r.is_finite()).count();
        if seen > 0 {
            let squares: f64 = residuals.iter().filter(|r| r.is_finite()).map(|r| r * r).sum();
            let white = tissue.marker_sd_m * tissue.marker_sd_m * (3.0 * seen as f64 - nv as f64).max(0.0);
            observed += squares - white;
        }
    }
    let mut out = Mat::zeros(6 * rows.centers.len(), tissue.draws);
    let plain = Momenta::of(model, prior, motion, first, end, None);
    for draw in 0..tissue.draws {
        let moved = Momenta::of(model, prior, motion, first, end, Some((&follows, draw))).less(&plain);
        for (w, &center) in rows.centers.iter().enumerate() {
            let sums = moved.window(rows, w, center - half - first, &model.gravity_mps2, motion.rate_hz);
            for axis in 0..6 {
                out[(6 * w + axis, draw)] = sums[axis] / STEP;
            }
        }
    }
    Ok((out, predicted, observed.max(0.0)))
}

/// The markers with the angles that their skin follows.
struct Skin<'a> {
    markers: Vec<(&'a ModelMarker, Vec<usize>)>,
    /// Mean rotation vector of each link's joint over the trial, rad.
    mean: Vec<Vector3<f64>>,
    /// Entries of B by marker: rows 3 × realisations, columns 3 × joints.
    entries: Vec<DMatrix<f64>>,
    draws: usize,
}

impl<'a> Skin<'a> {
    fn new(model: &Model, motion: &Motion, tissue: &Tissue<'a>) -> Self {
        let mut state = State::new(model);
        state.forward_position(model, &model.neutral());
        let markers: Vec<(&ModelMarker, Vec<usize>)> = tissue
            .markers
            .iter()
            .filter(|m| m.weight > 0.0 && m.link < model.n_links())
            .map(|m| {
                // the joint at the other end that pulls on this skin: the nearest child
                let place = state.point_in_world(m.link, &m.position_m);
                let far = |l: usize| (state.world_from_link[l].translation.vector - place).norm();
                let child = (0..model.n_links())
                    .filter(|l| model.links[*l].parent == Some(m.link))
                    .min_by(|a, b| far(*a).total_cmp(&far(*b)));
                (m, [Some(m.link), child].into_iter().flatten().filter(|l| *l != 0).collect())
            })
            .collect();
        let frames: Vec<usize> = (0..motion.n_frames()).filter(|f| motion.is_valid(*f)).collect();
        let used: Vec<usize> = frames.iter().copied().step_by(frames.len().div_ceil(POSTURES).max(1)).collect();
        let mean = (0..model.n_links())
            .map(|l| {
                used.iter().map(|f| angles(model, l, motion.q(*f))).sum::<Vector3<f64>>() / used.len().max(1) as f64
            })
            .collect();
        let mut normal = Normal(0x00a1_0f7d_5eed);
        let entries = markers
            .iter()
            .map(|(_, joints)| DMatrix::from_fn(3 * tissue.draws, 3 * joints.len(), |_, _| normal.draw()))
            .collect();
        Self { markers, mean, entries, draws: tissue.draws }
    }

    /// Slides of all markers in one posture, world: 3 markers × realisations, m for 1 m/rad.
    fn shifts(&self, model: &Model, q: &[f64], state: &State) -> DMatrix<f64> {
        let mut out = DMatrix::zeros(3 * self.markers.len(), self.draws);
        for (i, ((marker, joints), entries)) in self.markers.iter().zip(&self.entries).enumerate() {
            let bent: Vec<f64> = joints
                .iter()
                .flat_map(|&l| (angles(model, l, q) - self.mean[l]).iter().copied().collect::<Vec<_>>())
                .collect();
            let local = entries * DVector::from_vec(bent);
            let rotation = state.world_from_link[marker.link].rotation;
            for draw in 0..self.draws {
                let shift = rotation * Vector3::from(local.fixed_rows::<3>(3 * draw).into_owned());
                out.fixed_view_mut::<3, 1>(3 * i, draw).copy_from(&shift);
            }
        }
        out
    }
}

/// Rotation vector of a link's joint, rad; zero for joints that do not turn.
fn angles(model: &Model, link: usize, q: &[f64]) -> Vector3<f64> {
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

/// First moment, momentum and angular momentum of the prior body about one fixed point, frame by frame.
struct Momenta {
    series: Vec<SMatrix<f64, 9, 1>>,
    fixed: Vector3<f64>,
}

impl Momenta {
    /// Of the frames `first .. end`, every coordinate moved as it follows a realisation.
    fn of(
        model: &Model,
        prior: &[Phi],
        motion: &Motion,
        first: usize,
        end: usize,
        slide: Option<(&[DMatrix<f64>], usize)>,
    ) -> Self {
        let mut state = State::new(model);
        state.forward_position(model, motion.q((first + end) / 2));
        let fixed = state.center_of_mass(prior).1;
        let mut q = motion.q[first * model.nq..end * model.nq].to_vec();
        if let Some((follows, draw)) = slide {
            for (i, (to, follow)) in q.chunks_exact_mut(model.nq).zip(follows).enumerate() {
                let step: Vec<f64> = follow.column(draw).iter().map(|x| STEP * x).collect();
                model.integrate(motion.q(first + i), &step, to);
            }
        }
        let own = Motion {
            trial: String::new(),
            rate_hz: motion.rate_hz,
            nq: model.nq,
            nv: model.nv,
            q,
            ..Motion::default()
        };
        let n = end - first;
        let mut series = vec![SMatrix::zeros(); n];
        let mut start = 0;
        for i in 0..=n {
            if i < n && motion.is_valid(first + i) {
                continue;
            }
            if i > start {
                let velocities = run_velocities(model, &own, start, i);
                for (v, f) in velocities.chunks_exact(model.nv).zip(start..i) {
                    state.forward_velocity(model, own.q(f), v);
                    series[f] = moments(&state, prior, &fixed);
                }
            }
            start = i + 1;
        }
        Self { series, fixed }
    }

    fn less(&self, other: &Self) -> Self {
        Self { series: self.series.iter().zip(&other.series).map(|(a, b)| a - b).collect(), fixed: self.fixed }
    }

    /// The six sums of a window that begins at frame `begin` of the series (see `weak::window_weights`).
    fn window(
        &self,
        rows: &WeakRows,
        w: usize,
        begin: usize,
        gravity: &Vector3<f64>,
        rate_hz: f64,
    ) -> SMatrix<f64, 6, 1> {
        let mut out = SMatrix::zeros();
        let path = &rows.origin[w];
        for (i, origin) in path.iter().enumerate() {
            let at = &self.series[begin + i];
            let (first, linear, angular): (Vector3<f64>, Vector3<f64>, Vector3<f64>) =
                (at.fixed_rows::<3>(0).into(), at.fixed_rows::<3>(3).into(), at.fixed_rows::<3>(6).into());
            let d = origin.position - self.fixed;
            let (psi_dot, psi_ddot) = (rows.test.psi_dot[i], rows.test.psi_ddot[i]);
            let about = angular - d.cross(&linear) + origin.velocity.cross(&first);
            // the path is a polynomial of third degree at most, whose second difference is exact; at its ends ψ is zero
            let inside = i.checked_sub(1).and_then(|j| Some((path.get(j)?, path.get(i + 1)?)));
            let turn = inside.map_or_else(Vector3::zeros, |(a, b)| {
                let fall = gravity - (a.position - origin.position * 2.0 + b.position) * (rate_hz * rate_hz);
                fall.cross(&first) * rows.test.psi[i]
            });
            for axis in 0..3 {
                out[axis] += psi_ddot * first[axis];
                out[3 + axis] += turn[axis] - psi_dot * about[axis];
            }
        }
        out
    }
}

/// Standard normal numbers that depend on the seed alone (SplitMix64 and the method of Box and Muller).
struct Normal(u64);

impl Normal {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
    fn draw(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}
