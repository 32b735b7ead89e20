//! Simulates the cameras: true marker positions, soft tissue, distorted volumes, noise and gaps.

use crate::hidden::Hidden;
use crate::motion::chart::read;
use crate::object::TrueMarker;
use crate::physics::TrueMotion;
use crate::random::Stream;
use crate::scenario::CaptureSpec;
use aloft_body::{JointKind, Model, State};
use aloft_trial::Markers;
use nalgebra::{Matrix3, Vector3};

/// A gap of a marker: label, first and last frame (0-based, inclusive).
pub type Gap = (String, usize, usize);

/// Soft tissue over moving joints: each marker shifts in its link by a smooth function of joint
/// angles, zero in the posture in which it was attached.
#[derive(Debug, Clone, Default)]
pub struct SoftTissue {
    /// For each marker: joint, and the shift per sine of its angles (about the link axes).
    shifts: Vec<Vec<(usize, Matrix3<f64>)>>,
    /// Angles of every joint in the posture in which the markers were attached.
    rest: Vec<Vector3<f64>>,
}

/// Angles of a link's joint: the rotation vector, or the hinge angle about its axis.
fn angles(model: &Model, link: usize, q: &[f64]) -> Vector3<f64> {
    let joint = &model.links[link].joint;
    let i = joint.q_offset;
    match joint.kind {
        JointKind::Spherical => read(&q[i..i + 4]).scaled_axis(),
        JointKind::Revolute(axis) => axis.into_inner() * q[i],
        _ => Vector3::zeros(),
    }
}

/// Soft tissue mobility over a landmark, relative to the average.
fn mobility(label: &str) -> f64 {
    match label.get(1..).unwrap_or_default() {
        "THI" => 1.7,
        "KNE" | "KNM" | "SHO" | "ELB" | "ELM" => 1.3,
        "TIB" => 1.2,
        "ASI" | "PSI" => 1.0,
        "ANK" | "ANM" => 0.6,
        "WRA" | "WRB" | "FIN" => 0.6,
        "HEE" | "TOE" => 0.45,
        "FHD" | "BHD" => 0.35,
        _ => 0.9,
    }
}

impl SoftTissue {
    /// No soft tissue movement.
    pub fn none() -> Self {
        Self::default()
    }

    /// Draws the soft tissue of a person: `size_m` is the typical root mean square shift of a
    /// marker in motion; `q_rest` the posture in which the markers were attached. Hidden artefacts
    /// on single links are added.
    pub fn of_person(
        model: &Model,
        markers: &[TrueMarker],
        size_m: f64,
        q_rest: &[f64],
        hidden: &[Hidden],
        rng: &mut Stream,
    ) -> Self {
        let rest = (0..model.n_links()).map(|link| angles(model, link, q_rest)).collect();
        let shifts = markers
            .iter()
            .map(|marker| {
                let own = marker.link;
                // the joint at the distal end that also moves this skin: the nearest child
                let child = (0..model.n_links()).filter(|l| model.links[*l].parent == Some(own)).min_by(|a, b| {
                    let place = |l: usize| model.links[l].joint.parent_from_joint.translation.vector;
                    let far = |l: usize| (place(l) - marker.position_m).norm();
                    far(*a).total_cmp(&far(*b))
                });
                let joints: Vec<usize> = [Some(own), child].into_iter().flatten().filter(|l| *l != 0).collect();
                // sines of the angles are about 0.4 in motion, and the contributions of the joints
                // add in quadrature
                let size = size_m * mobility(&marker.label) / (0.4 * (3.0 * joints.len() as f64).sqrt() * 3f64.sqrt());
                let mut shifts: Vec<(usize, Matrix3<f64>)> = joints
                    .into_iter()
                    .map(|joint| {
                        (joint, Matrix3::from_columns(&[rng.vector(), rng.vector(), rng.vector()]) * size * 1.3)
                    })
                    .collect();
                for effect in hidden {
                    if let Hidden::SoftTissue { link, amplitude_m, along_bone } = effect
                        && model.links[own].name == *link
                    {
                        let direction = if *along_bone { Vector3::y() } else { Vector3::x() };
                        let shift = direction * (*amplitude_m / 0.5f64.sin());
                        shifts.push((own, Matrix3::from_columns(&[Vector3::zeros(), Vector3::zeros(), shift])));
                    }
                }
                shifts
            })
            .collect();
        Self { shifts, rest }
    }

    /// Adds movements that all markers of a segment have in common: a shift and a turn about their
    /// middle, each of about `size_m` (root mean square) in motion, with the angles of the
    /// segment's own joint and of those that hang on it.
    pub fn move_clusters(&mut self, model: &Model, markers: &[TrueMarker], size_m: f64, rng: &mut Stream) {
        for link in 0..model.n_links() {
            let own: Vec<usize> = (0..markers.len()).filter(|m| markers[*m].link == link).collect();
            let middle = own.iter().map(|m| markers[*m].position_m).sum::<Vector3<f64>>() / own.len().max(1) as f64;
            let far = own.iter().map(|m| (markers[*m].position_m - middle).norm_squared()).sum::<f64>();
            let lever_m = (far / own.len().max(1) as f64).sqrt();
            let joints: Vec<usize> =
                (1..model.n_links()).filter(|l| *l == link || model.links[*l].parent == Some(link)).collect();
            // sines of the angles are about 0.4 in motion
            let size = size_m / (0.4 * (3.0 * joints.len().max(1) as f64).sqrt() * 3f64.sqrt());
            for joint in joints {
                let mut draw = || Matrix3::from_columns(&[rng.vector(), rng.vector(), rng.vector()]) * size;
                // a turn moves places across its axis only: two thirds of the square of their
                // distance
                let (shift, turn) = (draw(), draw() * (1.5_f64.sqrt() / lever_m.max(f64::EPSILON)));
                for &m in &own {
                    let by_turn = (markers[m].position_m - middle).cross_matrix() * turn;
                    self.shifts[m].push((joint, if lever_m > 0.0 { shift - by_turn } else { shift }));
                }
            }
        }
    }

    fn shift(&self, marker: usize, model: &Model, q: &[f64]) -> Vector3<f64> {
        let Some(shifts) = self.shifts.get(marker) else { return Vector3::zeros() };
        shifts
            .iter()
            .map(|(joint, matrix)| {
                let bent = angles(model, *joint, q).map(f64::sin) - self.rest[*joint].map(f64::sin);
                matrix * bent
            })
            .sum()
    }
}

/// Records the markers `worn` at every `ticks_per_frame`-th tick.
pub fn record(
    model: &Model,
    markers: &[TrueMarker],
    worn: usize,
    motion: &TrueMotion,
    ticks_per_frame: usize,
    tissue: &SoftTissue,
    capture: &CaptureSpec,
    hidden: &[Hidden],
    rng: &mut Stream,
) -> Markers {
    let n_frames = motion.n_ticks() / ticks_per_frame;
    let mut state = State::new(model);
    let mut trajectories = vec![Vec::with_capacity(n_frames); worn];
    for frame in 0..n_frames {
        let q = motion.q(frame * ticks_per_frame);
        state.forward_position(model, q);
        for (i, marker) in markers.iter().enumerate().take(worn) {
            let mut place = marker.position_m;
            place += tissue.shift(i, model, q);
            let mut seen = state.point_in_world(marker.link, &place);
            for effect in hidden {
                match effect {
                    Hidden::LengthScale { factor } => seen *= *factor,
                    Hidden::CameraWarp { amplitude_m } => seen += warp(&seen) * *amplitude_m,
                    _ => {}
                }
            }
            trajectories[i].push(seen + rng.noise() * capture.marker_noise_m);
        }
    }
    let labels = markers.iter().take(worn).map(|m| m.label.clone()).collect();
    Markers { rate_hz: capture.point_rate_hz, first_frame: 1, n_frames, labels, trajectories }
}

/// A smooth distortion of the volume around its middle, 1 m above the floor; about 1 at 1 m
/// distance.
fn warp(p: &Vector3<f64>) -> Vector3<f64> {
    let d = p - Vector3::z();
    Vector3::new(
        0.8 * d.x * d.z + 0.3 * d.y * d.y,
        0.5 * d.y * d.z - 0.4 * d.x * d.x,
        0.7 * d.z * d.z + 0.5 * d.x * d.x,
    )
}

/// Removes stretches of marker data. Returns the gaps, sorted by marker and frame.
pub fn lose(markers: &mut Markers, capture: &CaptureSpec, rng: &mut Stream) -> Vec<Gap> {
    let (short, long) = (capture.gap_frames[0].max(1), capture.gap_frames[1].max(capture.gap_frames[0].max(1)));
    let mean = 0.5 * (short + long) as f64;
    let total = capture.gap_fraction * (markers.n_frames * markers.labels.len()) as f64;
    let count = (total / mean + rng.between(0.0, 1.0)).floor() as usize;
    let mut gaps: Vec<(usize, usize, usize)> = Vec::new();
    if markers.n_frames <= long + 2 || markers.labels.is_empty() {
        return Vec::new();
    }
    for _ in 0..count {
        let marker = rng.whole(0, markers.labels.len() - 1);
        let length = rng.whole(short, long);
        let first = rng.whole(1, markers.n_frames - length - 1);
        let last = first + length - 1;
        // gaps of one marker do not touch, so that they keep the requested lengths
        if gaps.iter().any(|(m, a, b)| *m == marker && first <= b + 2 && *a <= last + 2) {
            continue;
        }
        markers.trajectories[marker][first..=last].fill(Vector3::repeat(f64::NAN));
        gaps.push((marker, first, last));
    }
    gaps.sort_unstable();
    gaps.into_iter().map(|(m, a, b)| (markers.labels[m].clone(), a, b)).collect()
}
