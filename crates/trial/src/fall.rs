//! The vertical as falling markers tell it.

use crate::{Trial, UpAxis};
use nalgebra::{Matrix3, Vector3};

/// Length of the windows over which a fall is sought, s.
const WINDOW_S: f64 = 0.2;
/// Accelerations that count as free fall, m/s²: in a body that turns, the middle of the markers
/// circles about the centre of mass.
const FALL_MPS2: std::ops::Range<f64> = 7.5..12.5;
/// Root mean square distance from a parabola within which a window is a fall, m.
const PARABOLA_M: f64 = 0.003;
/// Noise that is always there, m.
const NOISE_M: f64 = 1e-4;
/// Fewest markers, and fewest windows.
const MARKERS: usize = 4;
const WINDOWS: usize = 3;
/// Share of the acceleration along one axis.
const UPRIGHT: f64 = 0.75;
/// Share of the windows that agree on the axis, and surplus of the weights that agree on its sign.
const AGREE: f64 = 0.9;
const SURPLUS: f64 = 0.5;

/// Vertical axis told by free fall: the middle of the markers follows a parabola with the
/// acceleration of gravity, downward. `None` without a fall, or where windows contradict each
/// other.
///
/// Pushing off, the middle of the markers can accelerate upward as much, but not as evenly: windows
/// count by how well a parabola fits them.
pub(crate) fn up_axis_from_fall(trial: &Trial) -> Option<UpAxis> {
    let rate_hz = trial.markers.rate_hz;
    if !(rate_hz.is_finite() && rate_hz > 0.0) {
        return None;
    }
    let n = (WINDOW_S * rate_hz).round() as usize;
    if n < 6 {
        return None;
    }
    let mut votes: Vec<Vote> = Vec::new();
    let mut start = 0;
    while start + n <= trial.markers.n_frames {
        votes.extend(window(trial, start, n, rate_hz));
        start += (n / 2).max(1);
    }
    let of = |axis: usize| votes.iter().filter(move |v| v.axis == axis);
    let axis = (0..3).max_by_key(|a| of(*a).count())?;
    if votes.len() < WINDOWS || (of(axis).count() as f64) < AGREE * votes.len() as f64 {
        return None;
    }
    let (up, all) = of(axis).fold((0.0, 0.0), |(up, all), v| (up + v.weight * v.sign, all + v.weight));
    (up.abs() > SURPLUS * all).then(|| UpAxis::from_index(axis, up > 0.0))
}

/// True where the middle of the markers falls freely for a while, along the vertical of the world
/// frame: a jump, or a throw.
pub fn falls(trial: &Trial) -> bool {
    let rate_hz = trial.markers.rate_hz;
    let n = if rate_hz.is_finite() { (WINDOW_S * rate_hz).round() as usize } else { 0 };
    let last = trial.markers.n_frames.checked_sub(n);
    n >= 6
        && last.is_some_and(|last| {
            let mut starts = (0..=last).step_by((n / 8).max(1));
            starts.any(|start| window(trial, start, n, rate_hz).is_some_and(|v| v.axis == 2 && v.sign > 0.0))
        })
}

/// What one window says.
struct Vote {
    axis: usize,
    /// +1 where the axis points up.
    sign: f64,
    weight: f64,
}

/// The axis that points up in one window, if the markers fall in it.
fn window(trial: &Trial, start: usize, n: usize, rate_hz: f64) -> Option<Vote> {
    let whole = |track: &&Vec<Vector3<f64>>| {
        track.get(start..start + n).is_some_and(|w| w.iter().all(|p| p.iter().all(|x| x.is_finite())))
    };
    let tracks: Vec<&Vec<Vector3<f64>>> = trial.markers.trajectories.iter().filter(whole).collect();
    if tracks.len() < MARKERS {
        return None;
    }
    let middle: Vec<Vector3<f64>> =
        (start..start + n).map(|f| tracks.iter().map(|t| t[f]).sum::<Vector3<f64>>() / tracks.len() as f64).collect();
    // p = a + b t + c t², with t from the middle of the window
    let time = |i: usize| (i as f64 - 0.5 * (n - 1) as f64) / rate_hz;
    let mut normal = Matrix3::zeros();
    let mut right = Matrix3::zeros();
    for (i, p) in middle.iter().enumerate() {
        let row = Vector3::new(1.0, time(i), time(i) * time(i));
        normal += row * row.transpose();
        right += row * p.transpose();
    }
    let fit = normal.try_inverse()? * right;
    let at = |i: usize| (fit.transpose() * Vector3::new(1.0, time(i), time(i) * time(i))) - middle[i];
    let rms_m = ((0..n).map(|i| at(i).norm_squared()).sum::<f64>() / n as f64).sqrt();
    let acceleration = 2.0 * fit.row(2).transpose();
    let axis = acceleration.iamax();
    let falls = FALL_MPS2.contains(&acceleration.norm()) && rms_m < PARABOLA_M;
    (falls && acceleration[axis].abs() > UPRIGHT * acceleration.norm()).then(|| Vote {
        axis,
        sign: -acceleration[axis].signum(),
        weight: 1.0 / (rms_m * rms_m + NOISE_M * NOISE_M),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Markers;

    fn trial(frames: usize, path: impl Fn(f64) -> Vector3<f64>) -> Trial {
        let corners = [Vector3::x() * 0.2, Vector3::y() * 0.3, Vector3::z() * 0.4, Vector3::repeat(-0.3)];
        let spin = |t: f64| nalgebra::Rotation3::from_scaled_axis(Vector3::new(3.0, 1.0, -2.0) * t);
        let track = |c: &Vector3<f64>| -> Vec<Vector3<f64>> {
            (0..frames).map(|f| path(f as f64 / 100.0) + spin(f as f64 / 100.0) * c).collect()
        };
        Trial {
            markers: Markers {
                rate_hz: 100.0,
                first_frame: 1,
                n_frames: frames,
                labels: (0..4).map(|i| format!("M{i}")).collect(),
                trajectories: corners.iter().map(track).collect(),
            },
            ..Trial::default()
        }
    }

    #[test]
    fn a_tumbling_body_falls_along_the_vertical_of_any_axis() {
        for (axis, sign) in [(0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0)] {
            let mut up = Vector3::zeros();
            up[axis] = sign;
            let found =
                up_axis_from_fall(&trial(60, |t| Vector3::new(0.5 * t, 0.2, t) + up * (3.0 * t - 4.905 * t * t)));
            assert_eq!(found, Some(UpAxis::from_index(axis, sign > 0.0)));
        }
    }

    #[test]
    fn a_jump_falls_along_the_vertical_and_a_step_does_not() {
        let jump = |t: f64| Vector3::z() * if t < 0.3 { 2.0 * t - 4.905 * t * t } else { 0.16 };
        assert!(falls(&trial(100, jump)));
        assert!(!falls(&trial(100, |t| Vector3::x() * (2.0 * t - 4.905 * t * t))));
        assert!(!falls(&trial(100, |t| Vector3::new(1.3 * t, 0.0, 0.03 * (12.0 * t).sin()))));
        assert!(!falls(&trial(3, jump)));
    }

    #[test]
    fn standing_walking_and_a_weak_pull_tell_nothing() {
        assert_eq!(up_axis_from_fall(&trial(100, |_| Vector3::zeros())), None);
        assert_eq!(up_axis_from_fall(&trial(100, |t| Vector3::new(1.3 * t, 0.0, 0.03 * (12.0 * t).sin()))), None);
        assert_eq!(up_axis_from_fall(&trial(100, |t| Vector3::z() * (-2.5 * t * t))), None);
        assert_eq!(up_axis_from_fall(&trial(4, |t| Vector3::z() * (-4.9 * t * t))), None);
        // down for half of the time, up for the other half
        let bounce = |t: f64| Vector3::z() * if t < 0.5 { -4.9 * t * t } else { 4.9 * (t - 1.0).powi(2) - 2.45 };
        assert_eq!(up_axis_from_fall(&trial(100, bounce)), None);
    }
}
