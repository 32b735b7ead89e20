//! A parabola fitted to positions: the mean acceleration of a stretch without differentiation.

use nalgebra::{Matrix3, Vector3};
use std::ops::Range;

/// `p(t) = c0 + c1 t + c2 t²`, t in seconds from the middle of the stretch.
pub(crate) struct Parabola {
    coefficients: [Vector3<f64>; 3],
}

impl Parabola {
    /// Least squares on the solved frames of a range; `None` with fewer than six.
    pub(crate) fn fit(position_m: &[Vector3<f64>], frames: Range<usize>, rate_hz: f64) -> Option<Self> {
        let centre_frame = 0.5 * (frames.start + frames.end) as f64;
        let mut normal = Matrix3::zeros();
        let mut right = Matrix3::zeros();
        let mut used = 0;
        for frame in frames {
            let p = position_m[frame];
            if !p.iter().all(|x| x.is_finite()) {
                continue;
            }
            let t = (frame as f64 - centre_frame) / rate_hz;
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
        Some(Self { coefficients })
    }

    /// Position at a time from the middle of the stretch, m.
    pub(crate) fn at(&self, t: f64) -> Vector3<f64> {
        self.coefficients[0] + self.coefficients[1] * t + self.coefficients[2] * (t * t)
    }

    /// Constant acceleration, m/s².
    pub(crate) fn acceleration_mps2(&self) -> Vector3<f64> {
        self.coefficients[2] * 2.0
    }
}
