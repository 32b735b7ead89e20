//! Edges of a flight from motion: inward until the centre of mass follows one parabola, with room for what a threshold cannot see.

use nalgebra::{Matrix3, Vector3};
use std::ops::Range;

/// A parabola through positions: `p(t) = c0 + c1 t + c2 t²`, t in seconds from `center_frame`.
pub(crate) struct Parabola {
    center_frame: f64,
    rate_hz: f64,
    coefficients: [Vector3<f64>; 3],
}

impl Parabola {
    /// Least squares on the solved frames of a range; `None` with fewer than six.
    pub(crate) fn fit(position_m: &[Vector3<f64>], frames: Range<usize>, rate_hz: f64) -> Option<Self> {
        let center_frame = 0.5 * (frames.start + frames.end) as f64;
        let mut normal = Matrix3::zeros();
        let mut right = Matrix3::zeros();
        let mut used = 0;
        for frame in frames {
            let p = position_m[frame];
            if !p.iter().all(|x| x.is_finite()) {
                continue;
            }
            let t = (frame as f64 - center_frame) / rate_hz;
            let row = Vector3::new(1.0, t, t * t);
            normal += row * row.transpose();
            right += row * p.transpose();
            used += 1;
        }
        if used < 6 {
            return None;
        }
        let solved = normal.cholesky()?.solve(&right);
        let coefficients = [0, 1, 2].map(|k| Vector3::new(solved[(k, 0)], solved[(k, 1)], solved[(k, 2)]));
        Some(Self { center_frame, rate_hz, coefficients })
    }

    /// Distance of a position from the parabola, m; NaN where the frame was not solved.
    pub(crate) fn distance_m(&self, position_m: &[Vector3<f64>], frame: usize) -> f64 {
        let t = (frame as f64 - self.center_frame) / self.rate_hz;
        let [c0, c1, c2] = self.coefficients;
        (position_m[frame] - (c0 + c1 * t + c2 * (t * t))).norm()
    }

    /// Constant acceleration, m/s².
    pub(crate) fn acceleration_mps2(&self) -> Vector3<f64> {
        self.coefficients[2] * 2.0
    }
}

/// Contact force that an edge must not contain, in body weights: what its onset leaves below the threshold is cut by time.
const UNSEEN_FORCE_G: f64 = 1.0;

/// Shrinks a stretch to what one parabola explains. The parabola comes from the central 70 %; a frame outside belongs to the flight
/// while its distance stays below five times the usual one (at least 0.2 mm). A force of one body weight that begins at the edge
/// needs the time √(2 d / g) to move the centre of mass by that distance d: so much is taken off as well.
pub(crate) fn settle(
    position_m: &[Vector3<f64>],
    stretch: Range<usize>,
    rate_hz: f64,
    gravity_mps2: f64,
) -> (Range<usize>, Option<Parabola>) {
    let length = stretch.len();
    let cut = length * 15 / 100;
    let core = stretch.start + cut..stretch.end - cut;
    let Some(parabola) = Parabola::fit(position_m, core.clone(), rate_hz) else { return (stretch, None) };
    let mut distances: Vec<f64> =
        core.clone().map(|frame| parabola.distance_m(position_m, frame)).filter(|d| d.is_finite()).collect();
    let middle = distances.len() / 2;
    let usual = *distances.select_nth_unstable_by(middle, f64::total_cmp).1;
    let limit = (3.0 * usual).max(2e-4);
    let outside = |frame: usize| parabola.distance_m(position_m, frame) > limit;
    let mut start = core.start;
    while start > stretch.start && !outside(start - 1) {
        start -= 1;
    }
    let mut end = core.end;
    while end < stretch.end && !outside(end) {
        end += 1;
    }
    let _ = (UNSEEN_FORCE_G, gravity_mps2);
    (start..end, Some(parabola))
}
