//! The acceleration of free flight against the stated gravity: ratio, direction, uncertainty and
//! possible explanations.

use crate::explain::{self, Clues, Explanation, number};
use crate::{Flight, FlightOptions};
use aloft_signal::t975;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Smallest reported deviation of the ratio from one.
const LEAST_DIFFERENCE: f64 = 0.02;
/// The same for the direction, degrees.
const LEAST_TILT_DEG: f64 = 1.5;
/// Degrees of freedom assigned to the typical scatter of flights.
const PRIOR_FREEDOM: usize = 4;

/// Free-fall acceleration in the flights of a trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FreeFall {
    /// Flights whose acceleration is known.
    pub flights: usize,
    /// Mean acceleration of the centre of mass over these flights, m/s², world frame.
    pub acceleration_mps2: [f64; 3],
    /// Stated gravity, m/s².
    pub stated_mps2: f64,
    /// Magnitude of the acceleration over the stated gravity; `None` if the stated gravity is zero.
    pub ratio: Option<f64>,
    /// 95 % interval of the ratio: scatter of the flights (Student's t) and the error common to all
    /// flights ([`FlightOptions::ratio_sd`]).
    pub ratio_ci95: Option<[f64; 2]>,
    /// Angle between the acceleration and the stated vertical, degrees; `None` if the stated
    /// gravity is zero.
    pub tilt_deg: Option<f64>,
    /// Half width of its 95 % interval, degrees.
    pub tilt_half95_deg: Option<f64>,
    /// True if ratio or direction differ from the stated values beyond their intervals.
    pub differs: bool,
    /// Explanations of the difference: candidates that motion alone cannot distinguish, the most
    /// likely first; empty if nothing differs.
    pub explanations: Vec<Explanation>,
}

impl FreeFall {
    /// Computed from flights with known accelerations; `gravity_mps2` as stated. `None` without
    /// such flights.
    pub(crate) fn of(
        flights: &[Flight],
        gravity_mps2: &Vector3<f64>,
        rate_hz: f64,
        options: &FlightOptions,
        clues: &Clues,
    ) -> Option<Self> {
        let known: Vec<(Vector3<f64>, f64)> = flights
            .iter()
            .map(|f| (Vector3::from(f.mean_acceleration_mps2), f.n_frames() as f64))
            .filter(|(a, n)| a.iter().all(|x| x.is_finite()) && *n > 0.0)
            .collect();
        let frames: f64 = known.iter().map(|k| k.1).sum();
        if known.is_empty() {
            return None;
        }
        let mean = known.iter().map(|(a, n)| a * *n).sum::<Vector3<f64>>() / frames;
        let stated = gravity_mps2.norm();
        let mut out = Self {
            flights: known.len(),
            acceleration_mps2: mean.into(),
            stated_mps2: stated,
            ratio: None,
            ratio_ci95: None,
            tilt_deg: None,
            tilt_half95_deg: None,
            differs: false,
            explanations: Vec::new(),
        };
        if stated == 0.0 || mean.norm() == 0.0 {
            return Some(out);
        }
        let down = gravity_mps2 / stated;
        let size = mean.norm();
        // Half width of the interval for the mean of one quantity per flight, including the error
        // common to all flights. A trial has one to three flights, so their scatter is pooled with
        // the typical one, which counts as PRIOR_FREEDOM degrees of freedom.
        let half = |of: &dyn Fn(&Vector3<f64>) -> f64, usual: f64| {
            let n = known.len() as f64;
            let centre = known.iter().map(|(a, w)| of(a) * w).sum::<f64>() / frames;
            let square = n * known.iter().map(|(a, w)| w * (of(a) - centre).powi(2)).sum::<f64>() / frames;
            let freedom = PRIOR_FREEDOM + known.len() - 1;
            let variance = (PRIOR_FREEDOM as f64 * usual * usual + square) / freedom as f64;
            (t975(freedom as f64) * (variance / n).sqrt()).hypot(t975(f64::INFINITY) * usual)
        };
        let toward = mean / size;
        let ratio = size / stated;
        let along = half(&|a| a.dot(&toward) / stated, options.ratio_sd * ratio);
        let mut sideways = mean - down * mean.dot(&down);
        let tilt_deg = sideways.norm().atan2(mean.dot(&down)).to_degrees();
        if sideways.norm() > 0.0 {
            sideways /= sideways.norm();
        }
        let across = half(&|a| a.dot(&sideways) / size, options.ratio_sd);
        let tilt_half = across.min(1.0).asin().to_degrees();
        let ci95 = [(ratio - along).max(0.0), ratio + along];
        out.ratio = Some(ratio);
        out.ratio_ci95 = Some(ci95);
        out.tilt_deg = Some(tilt_deg);
        out.tilt_half95_deg = Some(tilt_half);
        if ratio_differs(ratio, ci95) {
            out.differs = true;
            out.explanations = explain::of_ratio(ratio, ci95, stated, rate_hz, clues);
        }
        if tilt_deg > LEAST_TILT_DEG.max(tilt_half) {
            out.differs = true;
            out.explanations.extend(explain::of_tilt(tilt_deg, &axis(&toward, tilt_deg, &sideways), ratio));
        }
        Some(out)
    }

    /// True if the magnitude differs from the stated gravity beyond its interval; false where only
    /// the direction does.
    pub fn size_differs(&self) -> bool {
        self.ratio.zip(self.ratio_ci95).is_some_and(|(ratio, ci95)| ratio_differs(ratio, ci95))
    }

    /// The difference and its explanations in words; `None` if nothing differs.
    pub fn warning(&self) -> Option<String> {
        let (ratio, ci95, tilt, half) = (self.ratio?, self.ratio_ci95?, self.tilt_deg?, self.tilt_half95_deg?);
        if !self.differs {
            return None;
        }
        let leaning = if tilt > LEAST_TILT_DEG.max(half) {
            let but = if self.size_differs() { "and" } else { "but" };
            format!(", {but} {tilt:.1}° ± {half:.1}° off the stated vertical")
        } else {
            String::new()
        };
        let against = |e: &&Explanation| e.evidence.as_ref().is_some_and(|e| !e.supports);
        let fitting: Vec<&str> = self.explanations.iter().filter(|e| !against(e)).map(|e| e.words.as_str()).collect();
        let mut unlikely = String::new();
        let mut reasons: Vec<&str> = Vec::new();
        for e in self.explanations.iter().filter(against) {
            unlikely += if unlikely.is_empty() { "; unlikely: " } else { ", " };
            unlikely += e.cause.describe();
            reasons.extend(e.evidence.as_ref().map(|e| e.words.as_str()).filter(|w| !reasons.contains(w)));
        }
        if !reasons.is_empty() {
            unlikely += &format!(" ({})", reasons.join("; "));
        }
        let size = if self.size_differs() {
            let [value, low, high] = [ratio, ci95[0], ci95[1]].map(|x| number(x, 3));
            format!("with {value} times the stated gravity ({low} to {high}, 95 %)")
        } else {
            "with the stated gravity".to_owned()
        };
        Some(format!(
            "in flight the centre of mass falls {size}{leaning}; what would explain it: {}{unlikely}",
            if fitting.is_empty() { "nothing usual".to_owned() } else { fitting.join(", or ") }
        ))
    }
}

/// True if a ratio to the stated gravity differs from one beyond its interval.
fn ratio_differs(ratio: f64, ci95: [f64; 2]) -> bool {
    (ratio - 1.0).abs() > LEAST_DIFFERENCE && !(ci95[0]..=ci95[1]).contains(&1.0)
}

/// The axis of the world along which the body falls (or toward which the fall is tilted, if it is
/// nearly vertical), with its sign.
fn axis(toward: &Vector3<f64>, tilt_deg: f64, sideways: &Vector3<f64>) -> String {
    let v = if tilt_deg > 45.0 { toward } else { sideways };
    let k = v.iamax();
    format!("{}{}", if v[k] < 0.0 { "−" } else { "+" }, ["X", "Y", "Z"][k])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_warning_states_what_differs() {
        let fall = |ratio: f64, tilt_deg: f64| FreeFall {
            flights: 2,
            acceleration_mps2: [0.0, 0.0, -9.81 * ratio],
            stated_mps2: 9.81,
            ratio: Some(ratio),
            ratio_ci95: Some([ratio - 0.01, ratio + 0.01]),
            tilt_deg: Some(tilt_deg),
            tilt_half95_deg: Some(0.4),
            differs: true,
            explanations: Vec::new(),
        };
        let tilted = fall(1.001, 5.7).warning().unwrap();
        assert!(tilted.contains("falls with the stated gravity, but 5.7° ± 0.4° off the stated vertical"), "{tilted}");
        let weaker = fall(0.907, 0.1).warning().unwrap();
        assert!(weaker.contains("falls with 0.907 times the stated gravity (0.897 to 0.917, 95 %);"), "{weaker}");
        let both = fall(0.907, 5.7).warning().unwrap();
        assert!(both.contains("times the stated gravity") && both.contains(", and 5.7°"), "{both}");
    }
}
