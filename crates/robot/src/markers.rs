//! Markers on a robot's links: the base's pose from those on the base, and whether the others are
//! where the encoders put their links.
//!
//! The pose of each frame is a rigid fit (Horn 1987, Arun et al. 1987; [`fit_pose_of_seen`]). Its
//! noise follows from what the fits leave, less what stays the same in every frame (a marker that
//! is not quite where the description says).

use crate::description::{MarkerPlace, SensorNoise};
use crate::log::BaseLog;
use crate::{RobotDescription, RobotError};
use aloft_body::rigid::fit_pose_of_seen;
use aloft_body::{Model, Motion, State};
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Markers of a recording, in a world with z up.
#[derive(Debug, Clone, Copy)]
pub struct MarkerRecording<'a> {
    /// File, for messages.
    pub file: &'a str,
    /// Rate, Hz.
    pub rate_hz: f64,
    /// Time of the first frame by any clock, s.
    pub start_s: f64,
    /// Labels.
    pub labels: &'a [String],
    /// `[marker][frame]`, m; NaN where missing.
    pub trajectories: &'a [Vec<Vector3<f64>>],
}

/// The base by its markers.
#[derive(Debug, Clone, PartialEq)]
pub struct BaseFromMarkers {
    /// Poses by the clock of the recording.
    pub base: BaseLog,
    /// Noise of a pose.
    pub noise: PoseNoise,
    /// Markers on other links that the recording has.
    pub others: Vec<LinkMarker>,
    /// Remarks.
    pub remarks: Vec<String>,
}

/// Noise of poses from markers, one standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PoseNoise {
    /// A marker, each axis, m.
    pub marker_m: f64,
    /// Position of the base link's origin, each axis, m.
    pub position_m: f64,
    /// Orientation, each axis, degrees.
    pub orientation_deg: f64,
}

impl PoseNoise {
    /// The sensors' noise with that of these poses.
    pub fn of(self, sensors: SensorNoise) -> SensorNoise {
        SensorNoise { position_m: self.position_m, orientation_deg: self.orientation_deg, ..sensors }
    }
}

/// A marker on a link that is not the base.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LinkMarker {
    /// Label.
    pub label: String,
    /// Where it is on its link.
    pub place: MarkerPlace,
    /// Its path, m, world; none where missing.
    pub path: Vec<Option<Vector3<f64>>>,
}

/// How far a marker is from where the encoders and the base put it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MarkerMiss {
    /// Label.
    pub label: String,
    /// Link.
    pub link: String,
    /// Median difference in the link's axes, m.
    pub miss_m: [f64; 3],
    /// Root mean square of what differs from that median, m.
    pub rest_m: f64,
}

/// Fewest markers on the base, and fewest frames with a pose.
const LEAST_MARKERS: usize = 3;
const LEAST_FRAMES: usize = 20;
/// Distances of a marker from its described place above which it is named, and above which it is
/// left out, m.
const NAMED_M: f64 = 0.003;
const LEFT_OUT_M: f64 = 0.02;
/// Smallest noise of a marker that is believed, m.
const LEAST_NOISE_M: f64 = 2e-5;

/// Poses of the base link `root` from the markers on it.
///
/// # Errors
/// [`RobotError::Log`] for a description without markers on the base, a recording with fewer than
/// three of them, markers on a line, and markers that are not where the description says.
pub fn base_from_markers(
    recording: &MarkerRecording<'_>,
    description: &RobotDescription,
    root: &str,
) -> Result<BaseFromMarkers, RobotError> {
    let on_base: Vec<(&String, &MarkerPlace)> = description.markers.iter().filter(|m| m.1.link == root).collect();
    if on_base.len() < LEAST_MARKERS {
        return Err(RobotError::log(
            recording.file,
            format!("the description places {} markers on the base `{root}`, expected 3 at least", on_base.len()),
            "add `markers: {LABEL: {link: …, position_m: [x, y, z]}}` to the description, or put <recording>_base.csv beside the log",
        ));
    }
    let find = |label: &str| recording.labels.iter().position(|l| l == label);
    let mut remarks = Vec::new();
    let mut missing: Vec<&str> = Vec::new();
    let mut used: Vec<Used<'_>> = Vec::new();
    for (label, place) in &on_base {
        match find(label) {
            Some(at) => used.push((label, Vector3::from(place.position_m), &recording.trajectories[at])),
            None => missing.push(label),
        }
    }
    let unknown: Vec<&str> =
        recording.labels.iter().filter(|l| !description.markers.contains_key(*l)).map(String::as_str).collect();
    if used.len() < LEAST_MARKERS {
        return Err(RobotError::log(
            recording.file,
            format!(
                "{} of the {} markers on the base `{root}` are in the recording, expected 3 at least: `{}` is missing; it has {}",
                used.len(),
                on_base.len(),
                missing[0],
                few(&recording.labels.iter().map(String::as_str).collect::<Vec<_>>())
            ),
            "labels must be those under `markers` in the description",
        ));
    }
    missing
        .extend(description.markers.iter().filter(|(l, p)| p.link != root && find(l).is_none()).map(|m| m.0.as_str()));
    if !missing.is_empty() {
        remarks.push(format!("{}: no marker {}", recording.file, few(&missing)));
    }
    if !unknown.is_empty() {
        remarks.push(format!("{}: markers that the description does not place: {}", recording.file, few(&unknown)));
    }
    let n = used.iter().map(|u| u.2.len()).min().unwrap_or(0);
    let mut fits = fit(&used, n);
    // a marker on another place (or exchanged with another one) draws the pose: leave out the worst
    // while enough are left
    loop {
        let misses = mean_misses(&used, &fits);
        let worst = (0..used.len()).max_by(|a, b| misses[*a].norm().total_cmp(&misses[*b].norm()));
        let Some(worst) = worst.filter(|w| misses[*w].norm() > LEFT_OUT_M) else { break };
        let (label, miss) = (used[worst].0.to_owned(), misses[worst].norm());
        if used.len() <= LEAST_MARKERS + 1 {
            return Err(RobotError::log(
                recording.file,
                format!(
                    "the markers on `{root}` are not where the description says: `{label}` is {:.0} mm away",
                    1e3 * miss
                ),
                "correct `position_m` of the markers, in metres in the link's axes, or their labels",
            ));
        }
        remarks.push(format!(
            "{}: `{label}` is {:.0} mm from its place on `{root}` and is left out",
            recording.file,
            1e3 * miss
        ));
        used.remove(worst);
        fits = fit(&used, n);
    }
    let solved = fits.iter().flatten().count();
    if solved < LEAST_FRAMES {
        return Err(RobotError::log(
            recording.file,
            format!(
                "{solved} of {n} frames show three markers of the base `{root}` that are not on a line, expected 20 at least"
            ),
            "put four markers or more on the base, far from each other",
        ));
    }
    for (u, miss) in used.iter().zip(mean_misses(&used, &fits)) {
        if miss.norm() > NAMED_M {
            remarks.push(format!(
                "{}: `{}` is {:.1} mm from its place on `{root}`",
                recording.file,
                u.0,
                1e3 * miss.norm()
            ));
        }
    }
    let noise = noise_of(&used, &fits);
    let nowhere = Vector3::repeat(f64::NAN);
    let base = BaseLog {
        file: recording.file.to_owned(),
        time_s: (0..n).map(|i| recording.start_s + i as f64 / recording.rate_hz).collect(),
        position_m: fits.iter().map(|f| f.map_or(nowhere, |p| p.translation.vector)).collect(),
        rotation: fits.iter().map(|f| f.map_or_else(UnitQuaternion::identity, |p| p.rotation)).collect(),
    };
    let others = description
        .markers
        .iter()
        .filter(|(_, place)| place.link != root)
        .filter_map(|(label, place)| {
            let seen = |p: &Vector3<f64>| p.iter().all(|x| x.is_finite()).then_some(*p);
            let path = recording.trajectories[find(label)?].iter().map(seen).collect();
            Some(LinkMarker { label: label.clone(), place: place.clone(), path })
        })
        .collect();
    Ok(BaseFromMarkers { base, noise, others, remarks })
}

/// A marker that takes part: label, place on the base (m), path.
type Used<'a> = (&'a str, Vector3<f64>, &'a [Vector3<f64>]);

fn few(names: &[&str]) -> String {
    let shown = names.iter().take(6).map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ");
    if names.len() > 6 { format!("{shown} … ({} in all)", names.len()) } else { shown }
}

fn fit(used: &[Used<'_>], n: usize) -> Vec<Option<Isometry3<f64>>> {
    let local: Vec<Vector3<f64>> = used.iter().map(|u| u.1).collect();
    (0..n)
        .map(|i| {
            let seen: Vec<Vector3<f64>> = used.iter().map(|u| u.2[i]).collect();
            fit_pose_of_seen(&local, &seen).map(|f| f.0)
        })
        .collect()
}

fn miss(u: &Used<'_>, frame: usize, pose: &Isometry3<f64>) -> Option<Vector3<f64>> {
    let seen = u.2[frame];
    seen.iter().all(|x| x.is_finite()).then(|| pose.inverse_transform_point(&seen.into()).coords - u.1)
}

/// Mean difference of each marker from its place, base axes, m.
fn mean_misses(used: &[Used<'_>], fits: &[Option<Isometry3<f64>>]) -> Vec<Vector3<f64>> {
    used.iter()
        .map(|u| {
            let (mut sum, mut count) = (Vector3::zeros(), 0.0);
            for (i, pose) in fits.iter().enumerate() {
                if let Some(d) = pose.as_ref().and_then(|p| miss(u, i, p)) {
                    sum += d;
                    count += 1.0;
                }
            }
            if count > 0.0 { sum / count } else { Vector3::zeros() }
        })
        .collect()
}

/// Noise of a marker from what the fits leave (3 n − 6 free numbers a frame), and of the poses by
/// propagation.
fn noise_of(used: &[Used<'_>], fits: &[Option<Isometry3<f64>>]) -> PoseNoise {
    let means = mean_misses(used, fits);
    let (mut square, mut free) = (0.0, 0.0);
    for (i, pose) in fits.iter().enumerate() {
        let Some(pose) = pose else { continue };
        let (mut sum, mut count) = (0.0, 0.0);
        for (u, mean) in used.iter().zip(&means) {
            if let Some(d) = miss(u, i, pose) {
                sum += (d - mean).norm_squared();
                count += 1.0;
            }
        }
        square += sum;
        free += 3.0 * count - 6.0;
    }
    let marker_m = if free > 0.0 { (square / free).sqrt() } else { 0.0 }.max(LEAST_NOISE_M);
    let n = used.len() as f64;
    let centre = used.iter().map(|u| u.1).sum::<Vector3<f64>>() / n;
    let spread: Matrix3<f64> =
        used.iter().map(|u| u.1 - centre).map(|d| Matrix3::identity() * d.norm_squared() - d * d.transpose()).sum();
    let turn = spread.try_inverse().unwrap_or_else(Matrix3::zeros) * marker_m.powi(2);
    // the origin is away from the markers' centre, so that a wrong orientation moves it
    let arm = centre.cross_matrix();
    let place = Matrix3::identity() * (marker_m.powi(2) / n) + arm * turn * arm.transpose();
    let axis = |m: &Matrix3<f64>| (m.trace() / 3.0).sqrt();
    PoseNoise { marker_m, position_m: axis(&place), orientation_deg: axis(&turn).to_degrees() }
}

/// Compares markers on other links with where the motion puts them; returns what was found, and a
/// remark for every link whose markers are further away than noise explains. The motion starts at
/// `start_s` of the log's clock, from which the clock of the poses and markers in `base` differs by
/// `offset_s`.
pub fn compare_links(
    model: &Model,
    motion: &Motion,
    start_s: f64,
    base: &BaseLog,
    offset_s: f64,
    others: &[LinkMarker],
    noise: &PoseNoise,
) -> (Vec<MarkerMiss>, Vec<String>) {
    let mut state = State::new(model);
    let mut misses: Vec<Vec<Vector3<f64>>> = vec![Vec::new(); others.len()];
    // none: a marker on a link that the model does not have is compared with nothing
    let links: Vec<Option<usize>> = others.iter().map(|m| model.link_index(&m.place.link).ok()).collect();
    for (frame, time_s) in base.time_s.iter().enumerate() {
        let at = (time_s - offset_s - start_s) * motion.rate_hz;
        if !(at >= 0.0 && at < motion.n_frames().saturating_sub(1) as f64) {
            continue;
        }
        let (step, share) = (at as usize, at - at.floor());
        let next = step + 1;
        if !motion.is_valid(step) || !motion.is_valid(next) {
            continue;
        }
        let mut places = [vec![Vector3::zeros(); others.len()], vec![Vector3::zeros(); others.len()]];
        let mut turns = vec![UnitQuaternion::identity(); others.len()];
        for (places, at) in places.iter_mut().zip([step, next]) {
            state.forward_position(model, motion.q(at));
            for (k, (marker, link)) in others.iter().zip(&links).enumerate() {
                let Some(link) = link else { continue };
                places[k] = state.point_in_world(*link, &Vector3::from(marker.place.position_m));
                turns[k] = state.world_from_link[*link].rotation;
            }
        }
        for (k, marker) in others.iter().enumerate() {
            let Some(seen) = marker.path.get(frame).copied().flatten() else { continue };
            let place = places[0][k].lerp(&places[1][k], share);
            misses[k].push(turns[k].inverse() * (seen - place));
        }
    }
    let mut found = Vec::new();
    let mut remarks: Vec<String> = Vec::new();
    for (marker, misses) in others.iter().zip(&misses) {
        if misses.is_empty() {
            continue;
        }
        let axis = |k: usize| aloft_signal::median(&mut misses.iter().map(|m| m[k]).collect::<Vec<_>>());
        let middle = Vector3::new(axis(0), axis(1), axis(2));
        let rest = misses.iter().map(|m| (m - middle).norm_squared()).sum::<f64>() / misses.len() as f64;
        let limit = NAMED_M.max(3.0 * noise.marker_m);
        if middle.norm() > limit && !remarks.iter().any(|r| r.contains(&format!("`{}`", marker.place.link))) {
            remarks.push(format!(
                "the marker `{}` on `{}` is {:.0} mm from where the encoders put it: check the zeros of the joints up to \
                 that link, the lengths of the links, and the marker's place",
                marker.label,
                marker.place.link,
                1e3 * middle.norm()
            ));
        }
        found.push(MarkerMiss {
            label: marker.label.clone(),
            link: marker.place.link.clone(),
            miss_m: middle.into(),
            rest_m: rest.sqrt(),
        });
    }
    (found, remarks)
}
