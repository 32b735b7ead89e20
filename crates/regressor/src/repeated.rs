//! Errors of the rows that no number of flights averages out: the same posture is seen wrong by the
//! same amount in every flight.
//!
//! What the kinematics may have wrong is given as draws ([`SeenBody`]): the body as it may have
//! moved when the model was seen. A draw of the markers' errors is the model in other postures. A
//! draw of the geometry is another model, whose postures leave the same markers; its mass moves
//! with its bones ([`carried`]). A draw that moved these but not the mass would for the greater
//! part be another body, which is no error (on one person 62 % of its energy).
//!
//! The error of the rows is what the momenta of the model, with the parameters of the prior, have
//! beyond those of the draw. The rows themselves are not stored: identification needs only `Aᵀ D`,
//! with the weighted rows A and the errors D of the draws.

use crate::body_windows::moments;
use crate::velocities::{run_velocities, valid_runs};
use crate::weak_windows::WeakRows;
use aloft_body::inertia::phi_transform;
use aloft_body::{Model, ModelMarker, Motion, Phi, State};
use faer::Mat;
use nalgebra::{DMatrix, Isometry3, Matrix3, Matrix6, UnitQuaternion, Vector3, Vector6};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// A body as it may have moved when the model was seen.
#[derive(Debug, Clone)]
pub struct SeenBody {
    /// Its model.
    pub model: Model,
    /// Parameters of its links.
    pub phi: Vec<Phi>,
    /// Its motion in the same frames.
    pub motion: Motion,
}

/// Draws of what the kinematics may have wrong, alike in all recordings of a session.
#[derive(Debug, Clone, Copy, Default)]
pub struct Seen<'a> {
    /// Motions of the model with other errors of the markers.
    pub markers: &'a [Motion],
    /// Bodies with other joint centres, hinge axes and places of the markers.
    pub geometry: &'a [SeenBody],
}

/// What the draws do to the rows of one stretch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RepeatedErrors {
    /// `[Y | −E]ᵀ D` over the weighted rows for errors of the markers: one row per parameter and
    /// effect, one column per draw.
    pub markers: DMatrix<f64>,
    /// The same for each draw of the geometry; no columns without.
    pub geometry: DMatrix<f64>,
}

/// Errors D of unweighted rows: 6 windows × draws of the markers, then of the geometry.
pub(crate) fn error_rows(model: &Model, prior: &[Phi], motion: &Motion, rows: &WeakRows, seen: &Seen<'_>) -> Mat<f64> {
    let half = rows.test.half;
    let first = rows.centres.iter().min().map_or(0, |c| c - half - 1);
    let end = rows.centres.iter().max().map_or(0, |c| c + half + 2).min(motion.n_frames());
    let mut state = State::new(model);
    // a frame that is solved, as all of a window are
    let middle = rows.centres.get(rows.centres.len() / 2).copied().unwrap_or(first);
    state.forward_position(model, motion.q(middle));
    let fixed = state.centre_of_mass(prior).1;
    let changes = Changes::of(model, prior, motion, first..end, fixed, seen);
    let mut out = Mat::zeros(6 * rows.centres.len(), changes.draws);
    for (w, &centre) in rows.centres.iter().enumerate() {
        let sums = changes.window(rows, w, centre - half - first, &model.gravity_mps2, motion.rate_hz);
        for (axis, row) in sums.chunks_exact(changes.draws.max(1)).enumerate() {
            for (draw, value) in row.iter().enumerate() {
                out[(6 * w + axis, draw)] = *value;
            }
        }
    }
    out
}

/// `out += factor × values`.
fn add_scaled(out: &mut [f64], factor: f64, values: &[f64]) {
    for (o, v) in out.iter_mut().zip(values) {
        *o += factor * v;
    }
}

/// First moment, momentum and angular momentum about one fixed point of the model less those of
/// each draw, frame by frame.
struct Changes {
    /// Frame × (first moment, momentum, angular momentum) × axis × draw.
    series: Vec<f64>,
    fixed: Vector3<f64>,
    draws: usize,
}

impl Changes {
    fn of(
        model: &Model,
        prior: &[Phi],
        motion: &Motion,
        frames: Range<usize>,
        fixed: Vector3<f64>,
        seen: &Seen<'_>,
    ) -> Self {
        let draws = seen.markers.len() + seen.geometry.len();
        let mut series = vec![0.0; frames.len() * 9 * draws];
        let mut add = |model: &Model, phi: &[Phi], moved: &Motion, sign: f64, of: Range<usize>| {
            let mut state = State::new(model);
            for (start, stop) in valid_runs(frames.start, frames.end, |f| motion.is_valid(f)) {
                let velocities = run_velocities(model, moved, start, stop);
                for (frame, v) in (start..stop).zip(velocities.chunks_exact(model.nv)) {
                    state.forward_velocity(model, moved.q(frame), v);
                    let own = moments(&state, phi, &fixed);
                    let out = &mut series[(frame - frames.start) * 9 * draws..][..9 * draws];
                    for (row, value) in out.chunks_exact_mut(draws).zip(own.iter()) {
                        row[of.clone()].iter_mut().for_each(|x| *x += sign * value);
                    }
                }
            }
        };
        if draws > 0 {
            add(model, prior, motion, 1.0, 0..draws);
        }
        for (draw, moved) in seen.markers.iter().enumerate() {
            add(model, prior, moved, -1.0, draw..draw + 1);
        }
        for (draw, other) in (seen.markers.len()..).zip(seen.geometry) {
            add(&other.model, &other.phi, &other.motion, -1.0, draw..draw + 1);
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

/// Places that a link carries, in its axes: markers, its joint centre and those of the links that
/// hang on it.
fn places<'a>(
    model: &'a Model,
    markers: &'a [ModelMarker],
    link: usize,
) -> impl Iterator<Item = Vector3<f64>> + use<'a> {
    let own = model.links[link].parent.map(|_| Vector3::zeros());
    let children = model.links.iter().filter(move |c| c.parent == Some(link));
    let joints = children.map(|c| c.joint.parent_from_joint.translation.vector);
    let seen = markers.iter().filter(move |m| m.weight > 0.0 && m.link == link).map(|m| m.position_m);
    own.into_iter().chain(joints).chain(seen)
}

/// Turns that move the places of a link by less than this lever (m per rad) are not shown by them.
const UNSEEN_LEVER_M: f64 = 1e-3;

/// The small motion that lays places over others, with least squares; turns that these do not show
/// are left out.
fn laid_over(from: impl Iterator<Item = Vector3<f64>>, to: impl Iterator<Item = Vector3<f64>>) -> Isometry3<f64> {
    let mut normal = Matrix6::zeros();
    let mut right = Vector6::zeros();
    for (from, to) in from.zip(to) {
        let by = to - from;
        // to − from = shift + turn × from
        let lever = from.cross_matrix();
        let mut add = |at: (usize, usize), block: Matrix3<f64>| {
            let mut view = normal.fixed_view_mut::<3, 3>(at.0, at.1);
            view += block;
        };
        add((0, 0), Matrix3::identity());
        add((0, 3), -lever);
        add((3, 0), lever);
        add((3, 3), lever.transpose() * lever);
        right += Vector6::from_iterator(by.iter().chain(from.cross(&by).iter()).copied());
    }
    for k in 0..6 {
        normal[(k, k)] += UNSEEN_LEVER_M * UNSEEN_LEVER_M;
    }
    // none: the matrix is positive definite
    let x = normal.cholesky().map_or_else(Vector6::zeros, |c| c.solve(&right));
    let turn = UnitQuaternion::from_scaled_axis(x.fixed_rows::<3>(3).into_owned());
    Isometry3::from_parts(x.fixed_rows::<3>(0).into_owned().into(), turn)
}

/// For each link the small motion that lays it over that of another geometry of the same body, by
/// its markers and joint centres. Models with their markers, in the same order.
pub fn overlays(from: (&Model, &[ModelMarker]), to: (&Model, &[ModelMarker])) -> Vec<Isometry3<f64>> {
    (0..from.0.n_links()).map(|l| laid_over(places(from.0, from.1, l), places(to.0, to.1, l))).collect()
}

/// The links' parameters in the frames of another geometry: each link carries its mass along.
pub fn carried(overlays: &[Isometry3<f64>], phi: &[Phi]) -> Vec<Phi> {
    overlays.iter().zip(phi).map(|(over, phi)| phi_transform(over) * phi).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::four_joints::four_joints;
    use aloft_body::{JointKind, LinkInertia};

    fn body() -> (Model, Vec<Phi>, Vec<ModelMarker>) {
        let model = four_joints();
        let of = |l: f64| LinkInertia {
            mass_kg: 4.0 - l,
            com_m: Vector3::new(0.05, 0.02 * l, -0.1),
            inertia_com_kgm2: Matrix3::from_diagonal(&Vector3::new(0.05, 0.04, 0.03)),
        };
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
        (model, (0..4).map(|l| of(f64::from(l)).to_phi()).collect(), markers)
    }

    /// A link whose frame is turned about a ball joint with all that it carries keeps its mass
    /// where it was among them.
    #[test]
    fn mass_is_carried_with_markers_and_joints() {
        let (model, phi, markers) = body();
        let ball = |l: &usize| matches!(model.links[*l].joint.kind, JointKind::Spherical);
        let link = (1..model.n_links()).find(ball).unwrap();
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(2e-3, -1e-3, 1e-3));
        let (mut turned, mut places) = (model.clone(), markers.clone());
        places.iter_mut().filter(|m| m.link == link).for_each(|m| m.position_m = turn * m.position_m);
        for child in turned.links.iter_mut().filter(|c| c.parent == Some(link)) {
            child.joint.parent_from_joint = turn * child.joint.parent_from_joint;
        }
        let found = carried(&overlays((&model, &markers), (&turned, &places)), &phi);
        for (l, (found, phi)) in found.iter().zip(&phi).enumerate() {
            let (found, own) = (LinkInertia::from_phi(found), LinkInertia::from_phi(phi));
            let expected = if l == link { turn * own.com_m } else { own.com_m };
            assert!((found.com_m - expected).norm() < 0.02 * (turn * own.com_m - own.com_m).norm(), "link {l}");
            assert!((found.mass_kg - own.mass_kg).abs() < 1e-12);
        }
    }

    /// The changes of the rows are those of the momenta: about another point and with the path of
    /// the moment origin, a shift of the whole body that a window cannot see leaves nothing.
    #[test]
    fn a_body_that_stands_elsewhere_has_the_same_rows() {
        use crate::weak_windows::weak_rows;
        use crate::{Acting, Stretch, WeakOptions};
        use aloft_body::BaseParameters;
        let (model, phi, _) = body();
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
        let (base, stretch) = (BaseParameters::of(&model), Stretch::flight("t", 0, 0, motion.n_frames()));
        let rows =
            weak_rows(&model, &base, &phi, &motion, &stretch, Acting::default(), &WeakOptions::default()).unwrap();
        let moved = |by: f64, turn: f64| {
            let mut out = motion.clone();
            for frame in out.q.chunks_exact_mut(model.nq) {
                frame[0] += by;
                frame[model.nq - 1] += turn;
            }
            out
        };
        let seen = [moved(1e-3, 0.0), moved(0.0, 1e-3), motion.clone()];
        let errors = error_rows(&model, &phi, &motion, &rows, &Seen { markers: &seen, geometry: &[] });
        let size = |draw: usize, axes: [usize; 3]| {
            let of = |w: usize| axes.iter().map(|a| errors[(6 * w + a, draw)].powi(2)).sum::<f64>();
            (0..rows.centres.len()).map(of).sum::<f64>().sqrt()
        };
        assert!(size(0, [0, 1, 2]) < 1e-9 * size(1, [0, 1, 2]), "a shift has no force");
        assert!(size(2, [0, 1, 2]) + size(2, [3, 4, 5]) == 0.0);
        assert!(size(1, [3, 4, 5]) > 0.0);
    }
}
