//! Gaps in marker trajectories: short ones are filled and recorded, long ones stay missing.
//!
//! If three other markers of the same segment are visible, the missing marker is placed by their
//! rigid body. Its residual at both edges of the gap is interpolated in the segment's frame,
//! because soft tissue displaces the marker there and a fill without it would jump. Otherwise a
//! short gap is filled with a cubic. Gaps can also be filled later from the poses of a model
//! ([`fill_gaps_with_poses`]).

use crate::{Markers, Trial};
use aloft_body::rigid::fit_pose;
use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

/// Limits of gap filling.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GapOptions {
    /// Longest gap that a cubic may fill, s.
    pub cubic_limit_s: f64,
    /// Longest gap that other markers of the segment (or model poses) may fill, s.
    pub rigid_limit_s: f64,
    /// Minimum spread of the other markers about a line, m; below it they do not define a pose.
    pub min_spread_m: f64,
}

impl Default for GapOptions {
    fn default() -> Self {
        Self { cubic_limit_s: 0.05, rigid_limit_s: 0.5, min_spread_m: 0.012 }
    }
}

/// How a gap was filled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FillMethod {
    /// Cubic that matches the slopes at both edges.
    Cubic,
    /// Rigid body of this many other markers of the segment, residual interpolated.
    RigidBody {
        /// Number of markers used.
        mates: usize,
    },
    /// Pose of the model's link, residual interpolated.
    Model,
}

/// One filled gap.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct GapFill {
    /// Marker.
    pub marker: String,
    /// First filled frame (index from 0).
    pub first_frame: usize,
    /// Last filled frame.
    pub last_frame: usize,
    /// Method of filling.
    pub method: FillMethod,
}

/// Half-open frame range `[start, end)`.
type Range = (usize, usize);

/// Runs of missing frames of one trajectory.
pub(crate) fn missing_runs(track: &[Vector3<f64>]) -> Vec<Range> {
    let missing = |frame: usize| !track[frame].iter().all(|x| x.is_finite());
    aloft_signal::runs_where(track.len(), missing).into_iter().map(|r| (r.start, r.end)).collect()
}

/// Fills gaps within the limits. `segments` lists the labels on each rigid segment
/// ([`crate::MarkerSet::segments`]); if empty, only cubics are used. Only measured markers define a
/// rigid body, never filled ones, so the result does not depend on the order of markers.
pub fn fill_gaps(trial: &mut Trial, segments: &[Vec<String>], options: &GapOptions) -> Vec<GapFill> {
    let rate_hz = trial.markers.rate_hz;
    let limit = |seconds: f64| (seconds * rate_hz + 1e-9).max(0.0) as usize;
    let (cubic_limit, rigid_limit) = (limit(options.cubic_limit_s), limit(options.rigid_limit_s));
    let measured = trial.markers.clone();
    let mut fills = Vec::new();
    for marker in 0..measured.labels.len() {
        let label = &measured.labels[marker];
        let mates: Vec<usize> = segments
            .iter()
            .filter(|segment| segment.contains(label))
            .flatten()
            .filter(|mate| *mate != label)
            .filter_map(|mate| measured.index(mate))
            .collect();
        let gaps = missing_runs(&measured.trajectories[marker]);
        if gaps.first().is_some_and(|&(start, end)| end - start == measured.n_frames) {
            continue;
        }
        for gap in gaps {
            let frames = gap.1 - gap.0;
            let method = if frames <= rigid_limit
                && let Some(mates) =
                    rigid_fill(&mut trial.markers, &measured, marker, &mates, gap, options.min_spread_m)
            {
                FillMethod::RigidBody { mates }
            } else if frames <= cubic_limit && cubic_fill(&mut trial.markers.trajectories[marker], gap) {
                FillMethod::Cubic
            } else {
                continue;
            };
            fills.push(GapFill { marker: label.clone(), first_frame: gap.0, last_frame: gap.1 - 1, method });
        }
    }
    fills
}

/// Fills gaps up to `rigid_limit_s` from known link poses: each entry names a marker and gives
/// `world_from_link` for every frame (translation NaN where the pose is unknown). The marker's
/// position in the link frame is interpolated between the edges of the gap.
pub fn fill_gaps_with_poses(
    trial: &mut Trial,
    carriers: &[(String, &[Isometry3<f64>])],
    options: &GapOptions,
) -> Vec<GapFill> {
    let limit = (options.rigid_limit_s * trial.markers.rate_hz + 1e-9).max(0.0) as usize;
    let mut fills = Vec::new();
    for (label, poses) in carriers {
        let Some(marker) = trial.markers.index(label) else { continue };
        let track = &mut trial.markers.trajectories[marker];
        for gap in missing_runs(track) {
            if gap.1 - gap.0 > limit || poses.len() != track.len() {
                continue;
            }
            let known =
                |frame: usize| Some(poses[frame]).filter(|p| p.translation.vector.iter().all(|x| x.is_finite()));
            if fill_in_moving_frame(track, gap, known) {
                let (first_frame, last_frame) = (gap.0, gap.1 - 1);
                fills.push(GapFill { marker: label.clone(), first_frame, last_frame, method: FillMethod::Model });
            }
        }
    }
    fills
}

/// Frames at each edge over which the marker's position in the segment is averaged.
const EDGE_FRAMES: usize = 4;
/// Frames on each side that define the relative positions of the other markers.
const SHAPE_FRAMES: usize = 25;

/// Fills a gap from the other markers of the segment; returns their number, or `None` if they do
/// not suffice.
fn rigid_fill(
    filled: &mut Markers,
    measured: &Markers,
    marker: usize,
    mates: &[usize],
    gap: Range,
    min_spread_m: f64,
) -> Option<usize> {
    // Other markers visible in the whole gap and at its edges.
    let from = gap.0.saturating_sub(EDGE_FRAMES);
    let to = (gap.1 + EDGE_FRAMES).min(measured.n_frames);
    let mates: Vec<usize> = mates
        .iter()
        .copied()
        .filter(|&mate| (from..to).all(|frame| measured.position(mate, frame).is_some()))
        .collect();
    if mates.len() < 3 {
        return None;
    }
    let cloud = |frame: usize| -> Option<Vec<Vector3<f64>>> {
        mates.iter().map(|&mate| measured.position(mate, frame)).collect()
    };
    // Relative positions: mean of the other markers around the gap, each frame fitted to the first.
    let around: Vec<usize> =
        (gap.0.saturating_sub(SHAPE_FRAMES)..(gap.1 + SHAPE_FRAMES).min(measured.n_frames)).collect();
    let reference = cloud(gap.0)?;
    let mut shape = vec![Vector3::zeros(); mates.len()];
    let mut weight = 0.0;
    for &frame in &around {
        let Some(points) = cloud(frame) else { continue };
        let Some(reference_from_frame) = fit_pose(&points, &reference, min_spread_m) else { continue };
        for (sum, p) in shape.iter_mut().zip(&points) {
            *sum += reference_from_frame.transform_point(&(*p).into()).coords;
        }
        weight += 1.0;
    }
    if weight == 0.0 {
        return None;
    }
    for p in &mut shape {
        *p /= weight;
    }
    let pose = |frame: usize| cloud(frame).and_then(|points| fit_pose(&shape, &points, min_spread_m));
    fill_in_moving_frame(&mut filled.trajectories[marker], gap, pose).then_some(mates.len())
}

/// Fills one gap from the marker's position in a moving frame at the edges, interpolated linearly
/// (constant if only one edge exists). Returns false, with nothing changed, if a pose or both edges
/// are missing.
fn fill_in_moving_frame(
    track: &mut [Vector3<f64>],
    gap: Range,
    pose: impl Fn(usize) -> Option<Isometry3<f64>>,
) -> bool {
    let local_at = |frames: &mut dyn Iterator<Item = usize>| {
        let mut sum = Vector3::zeros();
        let mut count = 0.0;
        for frame in frames {
            let point = track[frame];
            if !point.iter().all(|x| x.is_finite()) {
                break;
            }
            let Some(world_from_segment) = pose(frame) else { break };
            sum += world_from_segment.inverse_transform_point(&point.into()).coords;
            count += 1.0;
        }
        (count > 0.0).then(|| sum / count)
    };
    let before = local_at(&mut (gap.0.saturating_sub(EDGE_FRAMES)..gap.0).rev());
    let after = local_at(&mut (gap.1..(gap.1 + EDGE_FRAMES).min(track.len())));
    let (before, after) = match (before, after) {
        (Some(before), Some(after)) => (before, after),
        (Some(one), None) | (None, Some(one)) => (one, one),
        (None, None) => return false,
    };
    let span = (gap.1 - gap.0 + 1) as f64;
    let mut points = Vec::with_capacity(gap.1 - gap.0);
    for frame in gap.0..gap.1 {
        let Some(world_from_segment) = pose(frame) else { return false };
        let along = (frame - gap.0 + 1) as f64 / span;
        points.push(world_from_segment.transform_point(&before.lerp(&after, along).into()).coords);
    }
    track[gap.0..gap.1].copy_from_slice(&points);
    true
}

/// Fills a gap with a cubic between both edges; slopes from a parabola through up to five frames on
/// each side. Returns false at the ends of a recording.
fn cubic_fill(track: &mut [Vector3<f64>], gap: Range) -> bool {
    if gap.0 == 0 || gap.1 >= track.len() {
        return false;
    }
    let side = |frames: &mut dyn Iterator<Item = usize>| {
        let mut points: Vec<Vector3<f64>> = Vec::with_capacity(5);
        for frame in frames.take(5) {
            if !track[frame].iter().all(|x| x.is_finite()) {
                break;
            }
            points.push(track[frame]);
        }
        points
    };
    let before = side(&mut (0..gap.0).rev());
    let after = side(&mut (gap.1..track.len()));
    let (x0, x1) = (before[0], after[0]);
    let span = (gap.1 - gap.0 + 1) as f64;
    let chord = (x1 - x0) / span;
    let slope0 = edge_slope(&before).map_or(chord, |slope| -slope);
    let slope1 = edge_slope(&after).unwrap_or(chord);
    for frame in gap.0..gap.1 {
        let t = (frame + 1 - gap.0) as f64 / span;
        let (t2, t3) = (t * t, t * t * t);
        track[frame] = x0 * (2.0 * t3 - 3.0 * t2 + 1.0)
            + slope0 * (span * (t3 - 2.0 * t2 + t))
            + x1 * (3.0 * t2 - 2.0 * t3)
            + slope1 * (span * (t3 - t2));
    }
    true
}

/// Slope per frame at the first of up to five consecutive points, counted away from the gap:
/// least-squares parabola (line for two or three points); `None` for one point.
fn edge_slope(points: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    // Rows of the pseudo-inverse for the linear coefficient of a parabola at the first point.
    const FIVE: [f64; 5] = [-54.0 / 70.0, 13.0 / 70.0, 40.0 / 70.0, 27.0 / 70.0, -26.0 / 70.0];
    const FOUR: [f64; 4] = [-1.05, 0.65, 0.85, -0.45];
    match points {
        [] | [_] => None,
        [a, b] => Some(b - a),
        [a, _, c] => Some((c - a) * 0.5),
        four @ [_, _, _, _] => Some(four.iter().zip(FOUR).map(|(p, w)| p * w).sum()),
        many => Some(many.iter().zip(FIVE).map(|(p, w)| p * w).sum()),
    }
}
