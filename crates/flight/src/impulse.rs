//! Body mass from the plates' impulse between two flights.
//!
//! From the middle of one flight to the middle of the next, the vertical impulse of the plates is
//! `∫F dt = M (Δv + g T)`, where Δv is the change of the centre of mass' vertical velocity between
//! two instants in the air. In the air the path is a parabola, so the velocity is known without
//! differentiating through a landing: neither impacts nor filters have an effect. A static trial
//! weighs the body from the plate readings at rest; if the two disagree, a tare, a gain or the
//! stated mass is wrong. Valid if all contact between the flights was on plates.

use crate::centre_of_mass::CentreOfMass;
use crate::{Flight, FlightError, FrameWrench};
use aloft_body::{Model, Motion, Phi};
use serde::{Deserialize, Serialize};

/// One contact between two flights.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ImpulseMass {
    /// Index of the flight before it.
    pub flight: usize,
    /// Mass, kg.
    pub mass_kg: f64,
    /// Vertical impulse of the plates, N·s.
    pub impulse_ns: f64,
    /// Change of the centre of mass' vertical velocity, m/s.
    pub velocity_change_mps: f64,
    /// Time from middle to middle, s.
    pub duration_s: f64,
}

/// Excluded at both ends of a flight, s: smoothing of the joints spreads contact that far.
const MARGIN_S: f64 = 0.04;
/// Minimum number of inner frames of a flight.
const FEWEST: usize = 6;

/// Mass from every contact between two flights of a trial. `total` is the sum of all plates, tared,
/// at the frames of the motion. Contacts with missing plate samples, and flights with too few
/// solved frames, are omitted.
///
/// # Errors
/// [`FlightError::Mismatch`] when model, inertias and motion do not belong together.
pub fn impulse_masses(
    model: &Model,
    phi: &[Phi],
    motion: &Motion,
    flights: &[Flight],
    total: &FrameWrench,
) -> Result<Vec<ImpulseMass>, FlightError> {
    let path = CentreOfMass::new(model, phi, motion)?;
    let g = model.gravity_mps2.norm();
    let heights: Vec<f64> = path.position_m.iter().map(|p| p.z).collect();
    let middles: Vec<Option<(usize, f64)>> =
        flights.iter().map(|f| middle_velocity(&heights, f, motion.rate_hz, g)).collect();
    let mut out = Vec::new();
    for (i, pair) in middles.windows(2).enumerate() {
        let [Some((from, before)), Some((to, after))] = pair else { continue };
        let Some(forces) = total.force_n.get(*from..=*to) else { continue };
        if forces.iter().any(|f| !f.z.is_finite()) {
            continue;
        }
        // Trapezoidal rule: the plates read zero at both ends.
        let inner: f64 = forces.iter().map(|f| f.z).sum();
        let ends = 0.5 * (forces[0].z + forces[forces.len() - 1].z);
        let impulse_ns = (inner - ends) / motion.rate_hz;
        let duration_s = (to - from) as f64 / motion.rate_hz;
        let velocity_change_mps = after - before;
        let mass_kg = impulse_ns / (velocity_change_mps + g * duration_s);
        if mass_kg.is_finite() && mass_kg > 0.0 {
            out.push(ImpulseMass { flight: i, mass_kg, impulse_ns, velocity_change_mps, duration_s });
        }
    }
    Ok(out)
}

/// Middle frame of a flight and the vertical velocity there, from a line through the heights with
/// gravity removed.
fn middle_velocity(heights: &[f64], flight: &Flight, rate_hz: f64, g: f64) -> Option<(usize, f64)> {
    let margin = (MARGIN_S * rate_hz).round() as usize;
    let (start, end) = (flight.start + margin, flight.end.saturating_sub(margin));
    let middle = (flight.start + flight.end) / 2;
    let points: Vec<(f64, f64)> = (start..end)
        .filter(|f| heights.get(*f).is_some_and(|h| h.is_finite()))
        .map(|f| {
            let t = (f as f64 - middle as f64) / rate_hz;
            (t, heights[f] + 0.5 * g * t * t)
        })
        .collect();
    if points.len() < FEWEST {
        return None;
    }
    let n = points.len() as f64;
    let (mean_t, mean_h) = points.iter().fold((0.0, 0.0), |s, p| (s.0 + p.0 / n, s.1 + p.1 / n));
    let (cross, square) = points.iter().fold((0.0, 0.0), |s, p| {
        let d = p.0 - mean_t;
        (s.0 + d * (p.1 - mean_h), s.1 + d * d)
    });
    (square > 0.0).then(|| (middle, cross / square))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{EdgeSource, FlightSource};

    #[test]
    fn a_parabola_gives_its_velocity_whatever_its_height() {
        let (rate, g) = (200.0, 9.81);
        let flight = Flight {
            start: 20,
            end: 120,
            source: FlightSource::Plates,
            takeoff_source: EdgeSource::Plates,
            landing_source: EdgeSource::Plates,
            mean_acceleration_mps2: [f64::NAN; 3],
        };
        let mut heights: Vec<f64> = (0..140)
            .map(|f| {
                let t = (f as f64 - 70.0) / rate;
                1.3 + 0.4 * t - 0.5 * g * t * t
            })
            .collect();
        heights[60] = f64::NAN;
        let (middle, v) = middle_velocity(&heights, &flight, rate, g).unwrap_or((0, f64::NAN));
        assert_eq!(middle, 70);
        assert!((v - 0.4).abs() < 1e-9, "{v}");
        assert!(middle_velocity(&heights, &Flight { end: 38, ..flight }, rate, g).is_none());
    }
}
