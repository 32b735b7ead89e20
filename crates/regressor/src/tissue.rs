//! Soft tissue as a random effect: the errors of weak rows that repeat from flight to flight.
//!
//! Soft tissue slides over bone by an amount that depends on the joint angles, so the same posture
//! gives the same marker error in every flight, and no resampling of flights detects it. Here the
//! slide of each marker is a random linear function of the angles of its own joint and of the
//! nearest distal joint, `d = B (a(q) − ā)`, with independent normal entries in B. A number of
//! realisations of B, the same for all recordings of a model, is propagated through least-squares
//! inverse kinematics to first order, and through the rows of the prior body. The rows themselves
//! are not stored: identification needs only `Aᵀ D`, with the weighted rows A and the errors D of
//! the realisations.
//!
//! The size of the slides is estimated from the markers, not from the rows: each realisation
//! predicts a marker residual, which is scaled to the residuals of the recording after subtraction
//! of their white noise.

use crate::velocities::{CENTRAL, run_velocities, valid_runs};
use crate::weak_windows::WeakRows;
use crate::{RegressorError, Stretch};
use aloft_body::{Model, ModelMarker, Motion, Phi, State};
use faer::Mat;
use nalgebra::{DMatrix, Vector3};
use serde::{Deserialize, Serialize};
use std::ops::Range;

mod follow;

use follow::{FollowSolver, angles};

/// Inputs of the realisations.
#[derive(Debug, Clone, Copy)]
pub struct Tissue<'a> {
    /// Markers and the links that carry them; a marker with zero weight is left out.
    pub markers: &'a [ModelMarker],
    /// White noise of a marker coordinate, m.
    pub marker_sd_m: f64,
    /// Number of realisations.
    pub draws: usize,
}

impl<'a> Tissue<'a> {
    /// Number of realisations for which a standard error is known to 15 %.
    pub const DRAWS: usize = 24;

    /// Inputs with the default number of realisations.
    pub fn new(markers: &'a [ModelMarker], marker_sd_m: f64) -> Self {
        Self { markers, marker_sd_m, draws: Self::DRAWS }
    }
}

/// Effect of the soft tissue realisations on one stretch, for slides of 1 m/rad.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Slides {
    /// `[Y | −E]ᵀ D` over the weighted rows: one row per parameter and effect, one column per
    /// realisation.
    pub sums: DMatrix<f64>,
    /// Sum of squares of the marker residuals of a realisation, mean over realisations,
    /// (m/(m/rad))².
    pub predicted: f64,
    /// Sum of squares of the recording's marker residuals, less the part due to white noise, m².
    /// Zero if the motion has no residuals.
    pub observed: f64,
}

/// Largest number of frames used for the mean posture of a trial.
const POSTURES: usize = 200;
/// Coordinates that move the markers by less than this lever (m per rad) count as unobserved.
const UNSEEN_LEVER_M: f64 = 1e-3;

/// Errors D of unweighted rows (6 windows × realisations), with the predicted and observed
/// residuals.
pub(crate) fn slide_rows(
    model: &Model,
    prior: &[Phi],
    motion: &Motion,
    stretch: &Stretch,
    rows: &WeakRows,
    tissue: &Tissue<'_>,
) -> Result<(Mat<f64>, f64, f64), RegressorError> {
    let half = rows.test.half;
    let first = rows.centres.iter().min().map_or(0, |c| c - half - 1);
    let end = rows.centres.iter().max().map_or(0, |c| c + half + 2).min(motion.n_frames());
    let skin = Skin::new(model, motion, tissue);
    let draws = tissue.draws;
    let mut state = State::new(model);
    state.forward_position(model, motion.q((first + end) / 2));
    let fixed = state.centre_of_mass(prior).1;
    // response of each frame's coordinates to the slides (coordinate × realisation), and the
    // remaining residual
    let mut follows = vec![0.0; (end - first) * model.nv * draws];
    let (mut predicted, mut observed) = (0.0, 0.0);
    let mut solver = FollowSolver::new(model, &skin);
    for (frame, follow) in (first..end).zip(follows.chunks_exact_mut(model.nv * draws)) {
        if !motion.is_valid(frame) {
            continue;
        }
        state.forward_position(model, motion.q(frame));
        let left = solver.solve(model, &mut state, &skin, motion.q(frame), &fixed, follow).ok_or_else(|| {
            RegressorError::Numeric {
                trial: stretch.trial.clone(),
                stretch: stretch.index,
                problem: format!("frame {frame}: the markers leave the coordinates undetermined"),
            }
        })?;
        predicted += left / draws.max(1) as f64;
        let n = motion.marker_labels.len();
        let residuals = motion.residual_m.get(frame * n..(frame + 1) * n).unwrap_or_default();
        let seen = residuals.iter().filter(|r| r.is_finite()).count();
        if seen > 0 {
            let squares: f64 = residuals.iter().filter(|r| r.is_finite()).map(|r| r * r).sum();
            let white = tissue.marker_sd_m * tissue.marker_sd_m * (3.0 * seen as f64 - model.nv as f64).max(0.0);
            observed += squares - white;
        }
    }
    let changes = Changes::of(model, prior, motion, first..end, &follows, fixed, draws);
    let mut out = Mat::zeros(6 * rows.centres.len(), draws);
    for (w, &centre) in rows.centres.iter().enumerate() {
        let sums = changes.window(rows, w, centre - half - first, &model.gravity_mps2, motion.rate_hz);
        for (axis, row) in sums.chunks_exact(draws).enumerate() {
            for (draw, value) in row.iter().enumerate() {
                out[(6 * w + axis, draw)] = *value;
            }
        }
    }
    Ok((out, predicted, observed.max(0.0)))
}

/// The markers with the joint angles on which their slides depend.
struct Skin<'a> {
    markers: Vec<(&'a ModelMarker, Vec<usize>)>,
    /// Mean rotation vector of each link's joint over the trial, rad.
    mean: Vec<Vector3<f64>>,
    /// Entries of B by marker: angle × axis × realisation.
    entries: Vec<Vec<f64>>,
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
                // the joint at the distal end that also moves this skin: the nearest child
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
        let draws = tissue.draws;
        let entries = markers
            .iter()
            .map(|(_, joints)| {
                let mut entries = vec![0.0; 3 * joints.len() * 3 * draws];
                for of_angle in entries.chunks_exact_mut((3 * draws).max(1)) {
                    for draw in 0..draws {
                        for axis in 0..3 {
                            of_angle[axis * draws + draw] = normal.draw();
                        }
                    }
                }
                entries
            })
            .collect();
        Self { markers, mean, entries, draws }
    }

    /// Slides of one marker in its link's axes, axis × realisation, m for 1 m/rad.
    fn local(&self, marker: usize, angles: &[Vector3<f64>], out: &mut [f64]) {
        out.fill(0.0);
        let bent = self.markers[marker].1.iter().flat_map(|&l| (0..3).map(move |axis| (l, axis)));
        let entries = self.entries[marker].chunks_exact((3 * self.draws).max(1));
        for ((l, axis), of_angle) in bent.zip(entries) {
            add_scaled(out, angles[l][axis] - self.mean[l][axis], of_angle);
        }
    }
}

/// `out += factor × values`.
fn add_scaled(out: &mut [f64], factor: f64, values: &[f64]) {
    for (o, v) in out.iter_mut().zip(values) {
        *o += factor * v;
    }
}

/// Changes of the prior body's first moment, momentum and angular momentum about one fixed point,
/// frame by frame, for slides of 1 m/rad.
struct Changes {
    /// Frame × (first moment, momentum, angular momentum) × axis × realisation.
    series: Vec<f64>,
    fixed: Vector3<f64>,
    draws: usize,
}

impl Changes {
    /// Changes in the given frames, whose coordinates respond to the slides by `follows` (frame ×
    /// coordinate × realisation).
    fn of(
        model: &Model,
        prior: &[Phi],
        motion: &Motion,
        frames: Range<usize>,
        follows: &[f64],
        fixed: Vector3<f64>,
        draws: usize,
    ) -> Self {
        let n = frames.len();
        let size = model.nv * draws;
        let mut series = vec![0.0; n * 9 * draws];
        let mut state = State::new(model);
        let mut rates = vec![0.0; size];
        for (start, stop) in valid_runs(frames.start, frames.end, |f| motion.is_valid(f)) {
            let velocities = run_velocities(model, motion, start, stop);
            for (frame, v) in (start..stop).zip(velocities.chunks_exact(model.nv)) {
                let at = frame - frames.start;
                let reach = (frame - start).min(stop - 1 - frame).min(CENTRAL.len() - 1);
                rates.fill(0.0);
                for (k, weight) in CENTRAL[reach].iter().enumerate() {
                    let c = weight * motion.rate_hz;
                    add_scaled(&mut rates, c, &follows[(at + k + 1) * size..][..size]);
                    add_scaled(&mut rates, -c, &follows[(at - k - 1) * size..][..size]);
                }
                state.forward_velocity(model, motion.q(frame), v);
                let (by_displacement, by_rate) = state.momentum_change(model, prior, &fixed);
                let out = &mut series[at * 9 * draws..][..9 * draws];
                for k in 0..model.nv {
                    let follow = &follows[at * size + k * draws..][..draws];
                    let rate = &rates[k * draws..][..draws];
                    for axis in 0..3 {
                        add_scaled(&mut out[axis * draws..][..draws], by_rate[k][axis], follow);
                    }
                    for axis in 0..6 {
                        let out = &mut out[(3 + axis) * draws..][..draws];
                        let (own, moving) = (by_displacement[k][axis], by_rate[k][axis]);
                        for ((o, f), r) in out.iter_mut().zip(follow).zip(rate) {
                            *o += own * f + moving * r;
                        }
                    }
                }
            }
        }
        Self { series, fixed, draws }
    }

    /// The six sums (× realisation) of a window that begins at frame `begin` of the series (see
    /// `weak_windows::window_weights`).
    fn window(&self, rows: &WeakRows, w: usize, begin: usize, gravity: &Vector3<f64>, rate_hz: f64) -> Vec<f64> {
        let draws = self.draws;
        let mut out = vec![0.0; 6 * draws];
        let path = &rows.origin[w];
        for (i, origin) in path.iter().enumerate() {
            let at = &self.series[(begin + i) * 9 * draws..][..9 * draws];
            let part = |k: usize| &at[k * draws..][..draws];
            let d = origin.position - self.fixed;
            let (psi, psi_dot, psi_ddot) = (rows.test.psi[i], rows.test.psi_dot[i], rows.test.psi_ddot[i]);
            // the path is a polynomial of at most third degree, for which the second difference is
            // exact; at its ends ψ is zero
            let inside = i.checked_sub(1).and_then(|j| Some((path.get(j)?, path.get(i + 1)?)));
            let fall = inside.map_or_else(Vector3::zeros, |(a, b)| {
                (gravity - (a.position - origin.position * 2.0 + b.position) * (rate_hz * rate_hz)) * psi
            });
            // turn × first moment − ψ̇ (angular − d × momentum + velocity × first moment)
            let turn = fall - origin.velocity * psi_dot;
            let lever = d * psi_dot;
            for axis in 0..3 {
                let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
                add_scaled(&mut out[axis * draws..][..draws], psi_ddot, part(axis));
                let moment = &mut out[(3 + axis) * draws..][..draws];
                add_scaled(moment, turn[next], part(last));
                add_scaled(moment, -turn[last], part(next));
                add_scaled(moment, lever[next], part(3 + last));
                add_scaled(moment, -lever[last], part(3 + next));
                add_scaled(moment, -psi_dot, part(6 + axis));
            }
        }
        out
    }
}

/// Standard normal numbers that depend only on the seed (SplitMix64 and the Box-Muller method).
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body_windows::moments;
    use crate::four_joints::four_joints;
    use crate::weak_windows::weak_rows;
    use crate::{Acting, WeakOptions};
    use aloft_body::{BaseParameters, LinkInertia};
    use nalgebra::{Matrix3, SMatrix};

    const STEP: f64 = 1e-5;

    fn body() -> (Model, Vec<Phi>, Vec<ModelMarker>, Motion) {
        let model = four_joints();
        let phi = (0..4)
            .map(|l| {
                let l = f64::from(l);
                LinkInertia {
                    mass_kg: 4.0 - l,
                    com_m: Vector3::new(0.05, 0.02 * l, -0.1),
                    inertia_com_kgm2: Matrix3::from_diagonal(&Vector3::new(0.05, 0.04, 0.03)),
                }
                .to_phi()
            })
            .collect();
        let markers = (0..16)
            .map(|i| {
                let at = i as f64;
                ModelMarker {
                    label: format!("m{i}"),
                    link: i / 4,
                    position_m: Vector3::new(0.2 * (1.7 * at).sin(), 0.2 * (2.9 * at).cos(), 0.2 * (0.8 * at).sin()),
                    weight: 1.0,
                }
            })
            .collect();
        let mut q = Vec::new();
        for i in 0..120 {
            let t = f64::from(i) / 200.0;
            let dv: Vec<f64> =
                (0..model.nv).map(|k| 0.4 * ((3.0 + 0.4 * k as f64) * t + 1.3 * k as f64).sin()).collect();
            let mut frame = model.neutral();
            model.integrate(&model.neutral(), &dv, &mut frame);
            q.extend(frame);
        }
        let motion = Motion { rate_hz: 200.0, nq: model.nq, nv: model.nv, q, ..Motion::default() };
        (model, phi, markers, motion)
    }

    /// Momenta of the body about `fixed`, with every coordinate moved by `shift` (frame ×
    /// coordinate).
    fn series(
        model: &Model,
        phi: &[Phi],
        motion: &Motion,
        fixed: &Vector3<f64>,
        shift: &[f64],
    ) -> Vec<SMatrix<f64, 9, 1>> {
        let mut moved = motion.clone();
        for (frame, to) in moved.q.chunks_exact_mut(model.nq).enumerate() {
            model.integrate(motion.q(frame), &shift[frame * model.nv..][..model.nv], to);
        }
        let velocities = run_velocities(model, &moved, 0, motion.n_frames());
        let mut state = State::new(model);
        (0..motion.n_frames())
            .map(|frame| {
                state.forward_velocity(model, moved.q(frame), &velocities[frame * model.nv..][..model.nv]);
                moments(&state, phi, fixed)
            })
            .collect()
    }

    #[test]
    fn slides_of_the_rows_are_the_limit_of_finite_differences() {
        let (model, phi, markers, motion) = body();
        let base = BaseParameters::of(&model);
        let n = motion.n_frames();
        let stretch = Stretch::flight("t", 0, 0, n);
        let rows =
            weak_rows(&model, &base, &phi, &motion, &stretch, Acting::default(), &WeakOptions::default()).unwrap();
        let tissue = Tissue { markers: &markers, marker_sd_m: 5e-4, draws: 3 };
        let (found, predicted, _) = slide_rows(&model, &phi, &motion, &stretch, &rows, &tissue).unwrap();
        let skin = Skin::new(&model, &motion, &tissue);
        let mut state = State::new(&model);
        let mut expected_residual = 0.0;
        let mut follows = vec![vec![0.0; n * model.nv]; tissue.draws];
        let half = rows.test.half;
        let first = rows.centres.iter().min().unwrap() - half - 1;
        let end = (rows.centres.iter().max().unwrap() + half + 2).min(n);
        for frame in 0..n {
            let q = motion.q(frame);
            state.forward_position(&model, q);
            let bent: Vec<Vector3<f64>> = (0..model.n_links()).map(|l| angles(&model, l, q)).collect();
            let mut all = DMatrix::zeros(3 * markers.len(), model.nv);
            let mut shifts = DMatrix::zeros(3 * markers.len(), tissue.draws);
            let mut jacobian = DMatrix::zeros(3, model.nv);
            let mut local = vec![0.0; 3 * tissue.draws];
            for (i, marker) in markers.iter().enumerate() {
                state.point_jacobian(&model, marker.link, &marker.position_m, &mut jacobian);
                all.rows_mut(3 * i, 3).copy_from(&jacobian);
                skin.local(i, &bent, &mut local);
                for draw in 0..tissue.draws {
                    let slide = Vector3::from_fn(|axis, _| local[axis * tissue.draws + draw]);
                    shifts.fixed_view_mut::<3, 1>(3 * i, draw).copy_from(&(state.rotation(marker.link) * slide));
                }
            }
            let mut normal = all.tr_mul(&all);
            (0..model.nv).for_each(|i| normal[(i, i)] += UNSEEN_LEVER_M * UNSEEN_LEVER_M);
            let follow = normal.cholesky().unwrap().solve(&all.tr_mul(&shifts));
            if (first..end).contains(&frame) {
                expected_residual += (&shifts - &all * &follow).norm_squared() / tissue.draws as f64;
            }
            for (draw, f) in follows.iter_mut().enumerate() {
                f[frame * model.nv..][..model.nv].copy_from_slice(follow.column(draw).as_slice());
            }
        }
        assert!((predicted / expected_residual - 1.0).abs() < 1e-6, "{predicted} {expected_residual}");
        state.forward_position(&model, motion.q((first + end) / 2));
        let fixed = state.centre_of_mass(&phi).1;
        for (draw, follow) in follows.iter().enumerate() {
            let side = |sign: f64| {
                let shift: Vec<f64> = follow.iter().map(|x| sign * STEP * x).collect();
                series(&model, &phi, &motion, &fixed, &shift)
            };
            let changes: Vec<_> = side(1.0).iter().zip(side(-1.0)).map(|(a, b)| (a - b) / (2.0 * STEP)).collect();
            for (w, centre) in rows.centres.iter().enumerate() {
                let path = &rows.origin[w];
                let mut sums = [0.0; 6];
                for (i, origin) in path.iter().enumerate() {
                    let at = &changes[centre - half + i];
                    let part = |k: usize| Vector3::new(at[3 * k], at[3 * k + 1], at[3 * k + 2]);
                    let about = part(2) - (origin.position - fixed).cross(&part(1)) + origin.velocity.cross(&part(0));
                    let inside = i.checked_sub(1).and_then(|j| Some((path.get(j)?, path.get(i + 1)?)));
                    let fall = inside.map_or_else(Vector3::zeros, |(a, b)| {
                        model.gravity_mps2
                            - (a.position - origin.position * 2.0 + b.position) * motion.rate_hz * motion.rate_hz
                    });
                    let moment = fall.cross(&part(0)) * rows.test.psi[i] - about * rows.test.psi_dot[i];
                    for axis in 0..3 {
                        sums[axis] += rows.test.psi_ddot[i] * part(0)[axis];
                        sums[3 + axis] += moment[axis];
                    }
                }
                let scale = sums.iter().fold(0.0_f64, |a, x| a.max(x.abs()));
                for (axis, expected) in sums.iter().enumerate() {
                    let got = found[(6 * w + axis, draw)];
                    assert!((got - expected).abs() < 1e-4 * scale, "window {w} axis {axis}: {got} {expected}");
                }
            }
        }
    }
}
