//! Time of the plates against the cameras, from the impulse between two flights.
//!
//! With y = z + g t²/2 the centre of mass moves on a straight line in the air, `y = a + b t`. A
//! contact between two flights bends that line: `∫ F dt / m = b₂ − b₁` and `∫ t F dt / m = a₁ −
//! a₂`. The centroid in time of the vertical force is therefore the time at which both lines cross,
//! `(a₁ − a₂) / (b₂ − b₁)`, whatever happened in between: no impact, filter or derivative takes
//! part, and the mass drops out. The difference between the plates' centroid and the crossing is
//! the delay of the plates. An error of the centre of mass that differs by δ between the two
//! flights moves the crossing by δ / (b₂ − b₁).

use crate::centre_of_mass::CentreOfMass;
use crate::{Flight, FlightError, FrameWrench};
use aloft_body::{Model, Motion, Phi};
use serde::{Deserialize, Serialize};

/// Excluded at both ends of a flight, s: smoothing of the joints spreads contact that far.
const MARGIN_S: f64 = 0.04;
/// Minimum number of inner frames of a flight.
const FEWEST: usize = 6;
/// Least change of velocity over the contact, m/s.
const LEAST_CHANGE_MPS: f64 = 1.0;
/// Standard deviation of the difference of the centre of mass' error between two flights, m:
/// segment masses of a table and soft tissue, in postures that differ.
pub const POSTURE_SD_M: f64 = 0.010;

/// Delay of the plates at one contact between two flights.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PlateDelay {
    /// Index of the flight before the contact.
    pub flight: usize,
    /// Plates minus cameras, s: positive where the plates are late.
    pub delay_s: f64,
    /// Change of the centre of mass' vertical velocity over the contact, with gravity removed, m/s.
    pub velocity_change_mps: f64,
    /// Standard deviation from the scatter about the two lines, s.
    pub scatter_s: f64,
    /// Standard deviation from postures that differ between the flights ([`POSTURE_SD_M`]), s.
    pub posture_s: f64,
}

/// Delay at every contact between two flights of a trial. `total` is the sum of all plates, tared,
/// at the frames of the motion. Contacts with missing samples, or in which `covered` marks a loaded
/// frame as incompletely measured, are omitted, and flights with too few solved frames, too.
///
/// # Errors
/// [`FlightError::Mismatch`] when model, inertias and motion do not belong together.
pub fn plate_delays(
    model: &Model,
    phi: &[Phi],
    motion: &Motion,
    flights: &[Flight],
    total: &FrameWrench,
    covered: impl Fn(usize) -> bool,
) -> Result<Vec<PlateDelay>, FlightError> {
    let path = CentreOfMass::new(model, phi, motion)?;
    let heights: Vec<f64> = path.position_m.iter().map(|p| p.z).collect();
    let (g, rate_hz) = (model.gravity_mps2.norm(), motion.rate_hz);
    let mut out = Vec::new();
    for (i, pair) in flights.windows(2).enumerate() {
        let (from, to) = (pair[0].end, pair[1].start);
        let Some(loads) = total.force_n.get(from..to) else { continue };
        let unknown = |f: usize, z: f64| !z.is_finite() || (z > 20.0 && !covered(f));
        if from >= to || loads.iter().enumerate().any(|(k, f)| unknown(from + k, f.z)) {
            continue;
        }
        // time from the middle of the contact, which keeps the numbers small
        let origin = 0.5 * (from + to) as f64 / rate_hz;
        let line = |flight: &Flight| Line::of(&heights, flight, rate_hz, g, origin);
        let (Some(before), Some(after)) = (line(&pair[0]), line(&pair[1])) else { continue };
        let change = after.slope - before.slope;
        let impulse: f64 = loads.iter().map(|f| f.z).sum();
        if change < LEAST_CHANGE_MPS || impulse <= 0.0 {
            continue;
        }
        let crossing = (before.start - after.start) / change;
        let time = |k: usize| (from + k) as f64 / rate_hz - origin;
        let centroid = loads.iter().enumerate().map(|(k, f)| time(k) * f.z).sum::<f64>() / impulse;
        let scatter = before.sd_at(crossing).hypot(after.sd_at(crossing)) / change;
        out.push(PlateDelay {
            flight: i,
            delay_s: centroid - crossing,
            velocity_change_mps: change,
            scatter_s: scatter,
            posture_s: POSTURE_SD_M / change,
        });
    }
    Ok(out)
}

/// A straight line through a flight, with its uncertainty.
struct Line {
    /// Value at time zero.
    start: f64,
    slope: f64,
    mean_t: f64,
    /// Variance of one point, m², their number, and Σ (t − mean)², s².
    variance: f64,
    n: f64,
    square: f64,
}

impl Line {
    fn of(heights: &[f64], flight: &Flight, rate_hz: f64, g: f64, origin: f64) -> Option<Self> {
        let margin = (MARGIN_S * rate_hz).round() as usize;
        let points: Vec<(f64, f64)> = (flight.start + margin..flight.end.saturating_sub(margin))
            .filter(|f| heights.get(*f).is_some_and(|h| h.is_finite()))
            .map(|f| {
                let t = f as f64 / rate_hz - origin;
                (t, heights[f] + 0.5 * g * t * t)
            })
            .collect();
        if points.len() < FEWEST {
            return None;
        }
        let n = points.len() as f64;
        let (mean_t, mean_y) = points.iter().fold((0.0, 0.0), |s, p| (s.0 + p.0 / n, s.1 + p.1 / n));
        let square: f64 = points.iter().map(|p| (p.0 - mean_t).powi(2)).sum();
        let slope = points.iter().map(|p| (p.0 - mean_t) * (p.1 - mean_y)).sum::<f64>() / square;
        let rest: f64 = points.iter().map(|p| (p.1 - mean_y - slope * (p.0 - mean_t)).powi(2)).sum();
        (square > 0.0).then(|| Self {
            start: mean_y - slope * mean_t,
            slope,
            mean_t,
            variance: rest / (n - 2.0),
            n,
            square,
        })
    }

    /// Standard deviation of the line at a time, m.
    fn sd_at(&self, t: f64) -> f64 {
        (self.variance * (1.0 / self.n + (t - self.mean_t).powi(2) / self.square)).sqrt()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;
    use crate::{EdgeSource, FlightSource};
    use aloft_body::{JointSpec, LinkInertia, LinkSpec, ModelSpec};
    use nalgebra::{Matrix3, Vector3};

    /// A body that falls, bounces on a plate with an uneven force, and flies again; the plate is
    /// recorded late.
    #[test]
    fn the_delay_of_a_bounce_is_found_whatever_the_force() {
        let (rate, g, m): (f64, f64, f64) = (200.0, 9.80665, 60.0);
        // integrated in steps of 0.1 ms: contact from 0.4 s to 0.75 s
        let force = |t: f64| {
            let x = (t - 0.4) / 0.35;
            if (0.0..1.0).contains(&x) {
                60.0 * 54.0 * x * (1.0 - x).powi(3) * (1.0 + 0.5 * (40.0 * x).sin().abs())
            } else {
                0.0
            }
        };
        let (dt, n) = (1e-4, 240);
        let impulse: f64 = (0..10_000).map(|k| force(k as f64 * dt) * dt).sum();
        let scale = m * (g * 0.35 + 4.0) / impulse;
        let (mut z, mut v) = (1.5, 0.0);
        let (mut heights, mut loads) = (Vec::new(), Vec::new());
        let late = 0.0065;
        for k in 0..(n as f64 / rate / dt) as usize {
            let t = k as f64 * dt;
            if k % 50 == 0 {
                heights.push(z);
                // mean over one frame, as plates are brought to frames
                let mean = (0..50).map(|s| force(t - late + (s as f64 - 24.5) * dt)).sum::<f64>() / 50.0;
                loads.push(Vector3::new(0.0, 0.0, scale * mean));
            }
            let a = scale * force(t) / m - g;
            z += v * dt + 0.5 * a * dt * dt;
            v += a * dt;
        }
        let spec = ModelSpec {
            name: "point".into(),
            links: vec![LinkSpec {
                name: "body".into(),
                parent: None,
                joint: JointSpec::Free,
                position_m: [0.0; 3],
                rpy_rad: [0.0; 3],
                inertia: None,
            }],
            carries: Default::default(),
        };
        let model = Model::from_spec(&spec).unwrap();
        let inertia = LinkInertia { mass_kg: m, com_m: Vector3::zeros(), inertia_com_kgm2: Matrix3::identity() };
        let q = heights.iter().flat_map(|z| [0.0, 0.0, *z, 0.0, 0.0, 0.0, 1.0]).collect();
        let motion = Motion { rate_hz: rate, nq: 7, nv: 6, q, ..Motion::default() };
        let flight = |start, end| Flight {
            start,
            end,
            source: FlightSource::Plates,
            takeoff_source: EdgeSource::Plates,
            landing_source: EdgeSource::Plates,
            mean_acceleration_mps2: [f64::NAN; 3],
        };
        let total = FrameWrench { plate: "total".into(), moment_nm: vec![Vector3::zeros(); n], force_n: loads };
        let flights = [flight(0, 80), flight(153, 240)];
        let found = plate_delays(&model, &[inertia.to_phi()], &motion, &flights, &total, |_| true).unwrap();
        assert_eq!(found.len(), 1);
        assert!((found[0].delay_s - late).abs() < 2e-4, "{found:?}");
        assert!(found[0].posture_s > 5e-4 && found[0].posture_s < 5e-3);
        // contact that is not completely measured says nothing
        assert!(plate_delays(&model, &[inertia.to_phi()], &motion, &flights, &total, |f| f != 100).unwrap().is_empty());
    }
}
