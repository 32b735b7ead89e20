//! Force plates of type 2: converts true wrenches to channels in plate axes, with noise, drift and
//! hidden errors.

use crate::hidden::Hidden;
use crate::physics::Wrench;
use crate::random::Stream;
use crate::scenario::CaptureSpec;
use aloft_trial::Plate;
use nalgebra::{Matrix3, Rotation3, Vector3};

/// Depth of the sensor's origin under the surface, m.
const DEPTH_M: f64 = 0.04;

/// Position of a plate as known to the laboratory.
#[derive(Debug, Clone, PartialEq)]
pub struct PlateGeometry {
    /// Corners in the order of C3D, world, m.
    pub corners_m: [Vector3<f64>; 4],
    /// From the sensor's origin to the middle of the surface in plate axes, m.
    pub origin_m: Vector3<f64>,
}

/// Recording of one plate.
#[derive(Debug, Clone, PartialEq)]
pub struct PlateChannels {
    /// Position as known to the laboratory.
    pub geometry: PlateGeometry,
    /// Fx, Fy, Fz (N), Mx, My, Mz (N·m) about the sensor's origin in plate axes: reaction on the
    /// subject.
    pub channels: [Vec<f64>; 6],
}

impl PlateGeometry {
    /// The plates under left (first) and right foot: 400 × 600 mm each, 10 mm apart.
    pub fn pair() -> [Self; 2] {
        let plate = |inner: f64, outer: f64| {
            let (high, low) = if inner > 0.0 { (outer, inner) } else { (inner, outer) };
            let corner = |x: f64, y: f64| Vector3::new(x, y, 0.0);
            Self {
                corners_m: [corner(0.3, high), corner(0.3, low), corner(-0.3, low), corner(-0.3, high)],
                origin_m: Vector3::new(0.0, 0.0, -DEPTH_M),
            }
        };
        [plate(0.005, 0.405), plate(-0.005, -0.405)]
    }

    /// Middle of the surface.
    pub fn centre(&self) -> Vector3<f64> {
        self.corners_m.iter().sum::<Vector3<f64>>() / 4.0
    }

    /// The plate's axes in the world as columns, from the corners as C3D defines them.
    pub fn world_from_plate(&self) -> Matrix3<f64> {
        let c = &self.corners_m;
        let x = (c[0] + c[3] - c[1] - c[2]).normalize();
        let y = (c[0] + c[1] - c[2] - c[3]).normalize();
        Matrix3::from_columns(&[x, y, x.cross(&y)])
    }
}

/// Records the wrench on the subject (about the world origin, at every tick) with plate `index`
/// (0-based).
pub fn record(
    index: usize,
    geometry: &PlateGeometry,
    wrenches: &[Wrench],
    capture: &CaptureSpec,
    hidden: &[Hidden],
    clock: &dyn Fn(f64) -> f64,
    rng: &mut Stream,
) -> PlateChannels {
    let mut centre = geometry.centre();
    let mut axes = geometry.world_from_plate();
    let mut gain = [1.0; 6];
    let mut tare = [0.0; 6];
    for effect in hidden.iter().filter(|e| e.plate() == Some(index + 1)) {
        match effect {
            Hidden::PlateOrigin { shift_m, .. } => centre += Vector3::from(*shift_m),
            Hidden::PlateRotation { turn_deg, .. } => {
                axes = Rotation3::from_scaled_axis(Vector3::from(*turn_deg).map(f64::to_radians)) * axes;
            }
            Hidden::PlateGain { gain: g, .. } => (0..6).for_each(|i| gain[i] *= g[i]),
            Hidden::PlateTare { force_n, moment_nm, .. } => {
                for i in 0..3 {
                    tare[i] += force_n[i];
                    tare[3 + i] += moment_nm[i];
                }
            }
            _ => {}
        }
    }
    let sensor = centre - axes * geometry.origin_m;
    let n = wrenches.len();
    let mut true_channels: [Vec<f64>; 6] = std::array::from_fn(|_| Vec::with_capacity(n));
    for w in wrenches {
        let force = axes.tr_mul(&w.force_n);
        let moment = axes.tr_mul(&(w.moment_nm - sensor.cross(&w.force_n)));
        for i in 0..3 {
            true_channels[i].push(force[i]);
            true_channels[3 + i].push(moment[i]);
        }
    }
    let channels = std::array::from_fn(|i| {
        let (noise, drift) = if i < 3 { (1.0, 1.0) } else { (0.3, 0.12) };
        let size = drift * capture.plate_drift_n;
        let (offset, slope, wave) = (0.5 * rng.moderate(), 0.4 * rng.moderate(), 0.25 * rng.moderate());
        let (turns, phase) = (rng.between(0.3, 0.9), rng.phase());
        (0..n)
            .map(|k| {
                let s = k as f64 / n.max(2) as f64;
                let wander = offset + slope * (s - 0.5) + wave * (std::f64::consts::TAU * turns * s + phase).sin();
                let value = at(&true_channels[i], clock(k as f64));
                gain[i] * value + tare[i] + size * wander + noise * capture.plate_noise_n * rng.normal()
            })
            .collect()
    });
    PlateChannels { geometry: geometry.clone(), channels }
}

/// Cubic interpolation at a fractional sample; constant beyond the ends.
fn at(values: &[f64], sample: f64) -> f64 {
    let n = values.len();
    if n == 0 {
        return f64::NAN;
    }
    let nearest = sample.round();
    if (sample - nearest).abs() < 1e-9 {
        return values[(nearest.max(0.0) as usize).min(n - 1)];
    }
    let k = sample.floor();
    let s = sample - k;
    let v = |i: f64| values[((k + i).max(0.0) as usize).min(n - 1)];
    let (a, b, c, d) = (v(-1.0), v(0.0), v(1.0), v(2.0));
    // four-point Lagrange
    b + s * ((c - b) + (s - 1.0) * (0.5 * (a - 2.0 * b + c) + (s + 1.0) / 6.0 * (d - 3.0 * c + 3.0 * b - a)))
}

impl PlateChannels {
    /// The recorded reaction in the world, about the world origin, as computed by the laboratory's
    /// software.
    pub fn plate(&self, name: &str, rate_hz: f64) -> Plate {
        let axes = self.geometry.world_from_plate();
        let sensor = self.geometry.centre() - axes * self.geometry.origin_m;
        let c = &self.channels;
        let n = c[0].len();
        let (mut force_n, mut moment_nm) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for k in 0..n {
            let force = axes * Vector3::new(c[0][k], c[1][k], c[2][k]);
            force_n.push(force);
            moment_nm.push(axes * Vector3::new(c[3][k], c[4][k], c[5][k]) + sensor.cross(&force));
        }
        Plate { name: name.to_owned(), rate_hz, corners_m: self.geometry.corners_m.to_vec(), force_n, moment_nm }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolation_is_exact_for_cubics() {
        let f = |x: f64| 1.0 + 2.0 * x - 0.3 * x * x + 0.05 * x * x * x;
        let values: Vec<f64> = (0..20).map(|k| f(f64::from(k))).collect();
        for x in [3.0, 4.25, 7.5, 9.9] {
            assert!((at(&values, x) - f(x)).abs() < 1e-10, "{x}: {} {}", at(&values, x), f(x));
        }
    }

    #[test]
    fn plates_point_down_and_see_their_load() {
        let [left, right] = PlateGeometry::pair();
        for (plate, y) in [(&left, 0.205), (&right, -0.205)] {
            assert!((plate.centre() - Vector3::new(0.0, y, 0.0)).norm() < 1e-12);
            let axes = plate.world_from_plate();
            assert!((axes - Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0)).norm() < 1e-12);
            let mut w = Wrench::default();
            w.push(&Vector3::new(10.0, -20.0, 700.0), &Vector3::new(0.05, y + 0.02, 0.0));
            let quiet = CaptureSpec { plate_noise_n: 0.0, plate_drift_n: 0.0, ..CaptureSpec::default() };
            let got = record(0, plate, &[w; 3], &quiet, &[], &|k| k, &mut Stream::new(1, "t"));
            assert!(got.channels[2][0] < 0.0, "the reaction is negative along a z that points down");
            let back = got.plate("FP1", 1000.0);
            assert!((back.force_n[1] - w.force_n).norm() < 1e-12 && (back.moment_nm[1] - w.moment_nm).norm() < 1e-12);
        }
    }
}
