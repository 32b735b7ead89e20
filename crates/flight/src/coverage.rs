//! What the plates measure of the contact outside the flights.
//!
//! A loaded plate does not measure everything that the body touches: the other foot may stand
//! beside it, a chair, a box or a helper may carry a part. Two observations decide, frame by frame.
//! *Feet*: a foot that is down (low and slow) lies on a plate, or the centre of pressure of a
//! loaded plate lies under it. *Load*: over 0.3 s the mean vertical force equals `m (Δv / T + g)`,
//! with v the velocity of the centre of mass. The mean removes impacts and soft tissue, which do
//! not change the momentum over such a window; what then differs by a fifth of body weight is
//! contact that no plate measures. Frames that fail either test take no part in contact rows and in
//! the comparison, and [`Coverage::sentence`] says how many and why.

use crate::centre_of_mass::CentreOfMass;
use crate::feet::Feet;
use crate::{Flight, FlightError, plate_wrench_at_marker_rate, total_wrench};
use aloft_body::{Motion, Subject};
use aloft_signal::{runs_where, upper_median};
use aloft_trial::Trial;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Length of the window over which load and momentum are compared, s.
const WINDOW_S: f64 = 0.3;
/// Shortest such window, where contact is shorter, s.
const SHORTEST_S: f64 = 0.12;
/// Half of the stretch over which a velocity is fitted, s.
const SLOPE_S: f64 = 0.03;
/// Share of body weight by which load and momentum differ where contact is not measured.
const MISSING: f64 = 0.2;
/// The same in a stretch with a foot that may stand beside the plates.
const BESIDE: f64 = 0.06;
/// Limits of the gain that is taken for one of the whole recording (a wrong mass, a wrong gain).
const GAIN: Range<f64> = 0.75..1.33;
/// Least time in contact from which that gain is computed, s.
const GAIN_S: f64 = 0.5;
/// Loss in loaded frames that deserves a warning, s.
const WORTH_SAYING_S: f64 = 0.1;

/// Why contact is not completely measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Unmeasured {
    /// No plate is loaded, and the body does not fly.
    NoLoad,
    /// A plate has no reading: cut off, or at the limit of its range.
    NoReading,
    /// A foot stands beside the plates.
    FootBeside,
    /// The plates carry less than the body's momentum requires.
    LoadMissing,
    /// The plates carry more than the body's momentum requires.
    LoadExcess,
}

impl Unmeasured {
    /// Reason in words.
    pub fn describe(self) -> &'static str {
        match self {
            Self::NoLoad => "no plate loaded",
            Self::NoReading => "a plate without reading (at the limit of its range, or cut off)",
            Self::FootBeside => "a foot beside the plates",
            Self::LoadMissing => "less load on the plates than the motion requires (a hold, a chair, a helper)",
            Self::LoadExcess => "more load on the plates than the motion requires (another person, an object)",
        }
    }
    const ALL: [Self; 5] = [Self::NoLoad, Self::NoReading, Self::FootBeside, Self::LoadMissing, Self::LoadExcess];
}

/// Frames `start..end` whose contact the plates do not measure completely.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeftOut {
    /// First frame.
    pub start: usize,
    /// One past the last frame.
    pub end: usize,
    /// Reason.
    pub reason: Unmeasured,
}

/// Contact of one recording: what the plates measure completely and what they do not.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Coverage {
    /// Marker rate, Hz.
    pub rate_hz: f64,
    /// Number of frames of the recording.
    pub n_frames: usize,
    /// Frames in contact (`start`, `end`, end not included) that the plates measure completely.
    pub complete: Vec<(usize, usize)>,
    /// Frames that they do not measure completely, in order.
    pub left_out: Vec<LeftOut>,
    /// Mean load of the plates over the load that the motion requires with the stated mass, in
    /// contact (median of windows); none where contact is too short.
    pub load_ratio: Option<f64>,
}

impl Coverage {
    /// True for every frame in contact that is measured completely.
    pub fn mask(&self) -> Vec<bool> {
        let mut mask = vec![false; self.n_frames];
        for (start, end) in &self.complete {
            mask[*start..*end].fill(true);
        }
        mask
    }
    /// Time in contact that is measured completely, s.
    pub fn complete_s(&self) -> f64 {
        self.complete.iter().map(|(start, end)| end - start).sum::<usize>() as f64 / self.rate_hz
    }
    /// Time left out for a reason, s.
    pub fn left_out_s(&self, reason: Unmeasured) -> f64 {
        let frames: usize = self.left_out.iter().filter(|l| l.reason == reason).map(|l| l.end - l.start).sum();
        frames as f64 / self.rate_hz
    }
    /// Time with loaded plates that is left out, s.
    pub fn lost_s(&self) -> f64 {
        Unmeasured::ALL.iter().filter(|r| **r != Unmeasured::NoLoad).map(|r| self.left_out_s(*r)).sum()
    }
    /// A sentence on loaded frames that are left out; none below 0.1 s.
    pub fn sentence(&self) -> Option<String> {
        let lost = self.lost_s();
        if lost < WORTH_SAYING_S {
            return None;
        }
        let of = lost + self.complete_s();
        let parts: Vec<String> = Unmeasured::ALL
            .iter()
            .filter(|r| **r != Unmeasured::NoLoad && self.left_out_s(**r) > 0.0)
            .map(|r| {
                let first =
                    self.left_out.iter().find(|l| l.reason == *r).map_or(0.0, |l| l.start as f64 / self.rate_hz);
                format!("{} {:.2} s, first at {first:.2} s", r.describe(), self.left_out_s(*r))
            })
            .collect();
        Some(format!(
            "the plates do not measure all contact in {lost:.2} of {of:.2} s under load; left out: {}",
            parts.join("; ")
        ))
    }
}

/// Decides for every frame outside the flights whether the plates measure all that the body
/// touches. `trial` holds markers and tared plates, `motion` the unfiltered motion; a plate counts
/// as loaded above `threshold_n`.
///
/// # Errors
/// [`FlightError::Mismatch`] when subject and motion do not belong together.
pub fn coverage(
    trial: &Trial,
    subject: &Subject,
    motion: &Motion,
    flights: &[Flight],
    threshold_n: f64,
) -> Result<Coverage, FlightError> {
    let (n, rate_hz) = (motion.n_frames(), motion.rate_hz);
    let mut out = Coverage { rate_hz, n_frames: n, ..Coverage::default() };
    if trial.plates.is_empty() {
        return Ok(out);
    }
    let each = plate_wrench_at_marker_rate(trial, None)?;
    let total = total_wrench(&each);
    let load: Vec<f64> = (0..n).map(|f| total.force_n.get(f).map_or(f64::NAN, |w| w.z)).collect();
    let in_flight = |f: usize| flights.iter().any(|x| x.frames().contains(&f));
    let path = CentreOfMass::new(&subject.model, &subject.prior_phi(), motion)?;
    let heights: Vec<f64> = path.position_m.iter().map(|p| p.z).collect();
    let mass_kg: f64 = subject.prior.iter().map(|l| l.mass_kg).sum();
    let weight_n = mass_kg * subject.model.gravity_mps2.norm();
    // the load is known where a plate is loaded, and in flight, where it is zero
    let known = runs_where(n, |f| load[f] > threshold_n || in_flight(f));
    let balance = if subject.model.is_whole() {
        Balance::of(&heights, &load, &known, rate_hz, mass_kg, weight_n)
    } else {
        // the momentum of the body is not known: only the feet decide
        Balance { deficit: vec![f64::NAN; n], gain: None }
    };
    out.load_ratio = balance.gain;
    let mut reasons: Vec<Option<Unmeasured>> = load
        .iter()
        .map(|z| match z {
            z if !z.is_finite() => Some(Unmeasured::NoReading),
            z => (*z <= threshold_n).then_some(Unmeasured::NoLoad),
        })
        .collect();
    let reach = (0.25 * WINDOW_S * rate_hz).round() as usize;
    let loaded = |reasons: &[Option<Unmeasured>], f: usize| {
        !matches!(reasons[f], Some(Unmeasured::NoLoad | Unmeasured::NoReading)) && !in_flight(f)
    };
    for (reason, sign) in [(Unmeasured::LoadMissing, 1.0), (Unmeasured::LoadExcess, -1.0)] {
        for whole in &known {
            for run in runs_where(whole.len(), |f| sign * balance.deficit[whole.start + f] > MISSING) {
                let from = (whole.start + run.start).saturating_sub(reach).max(whole.start);
                for f in from..(whole.start + run.end + reach).min(whole.end) {
                    if loaded(&reasons, f) {
                        reasons[f] = Some(reason);
                    }
                }
            }
        }
    }
    let feet = Feet::of(trial, subject);
    for foot in 0..feet.len() {
        for run in feet.beside(foot, &each, threshold_n) {
            // a foot that clearly stands beside counts at once, one that may lie on an edge only
            // where the plates carry too little
            let short = run.frames.clone().any(|f| balance.deficit[f] > BESIDE);
            for f in run.frames.clone().filter(|_| run.clear || short) {
                if loaded(&reasons, f) {
                    reasons[f] = Some(Unmeasured::FootBeside);
                }
            }
        }
    }
    let mut at = 0;
    while at < n {
        let of = |f: usize| if in_flight(f) || !motion.is_valid(f) { None } else { Some(reasons[f]) };
        let end = (at + 1..n).find(|&f| of(f) != of(at)).unwrap_or(n);
        match of(at) {
            None => {}
            Some(None) => out.complete.push((at, end)),
            Some(Some(reason)) => out.left_out.push(LeftOut { start: at, end, reason }),
        }
        at = end;
    }
    Ok(out)
}

/// Load of the plates against the momentum of the body.
struct Balance {
    /// Load that is missing on the plates, relative to body weight, mean over the window in the
    /// same run of known load that is centred nearest to each frame; NaN where unknown.
    deficit: Vec<f64>,
    /// Load of the plates over the load required, median over windows in contact.
    gain: Option<f64>,
}

impl Balance {
    fn of(heights: &[f64], load: &[f64], known: &[Range<usize>], rate_hz: f64, mass_kg: f64, weight_n: f64) -> Self {
        let n = heights.len();
        let longest = ((0.5 * WINDOW_S * rate_hz).round() as usize).max(1);
        let shortest = ((0.5 * SHORTEST_S * rate_hz).round() as usize).max(1);
        let margin = slope_frames(rate_hz);
        let velocity = slopes(heights, rate_hz);
        let (mut needed, mut carried) = (vec![f64::NAN; n], vec![f64::NAN; n]);
        for run in known {
            let half = longest.min(run.len().saturating_sub(1) / 2);
            // velocities need some frames on both sides
            let (first, last) = (run.start.max(margin) + half, run.end.min(n.saturating_sub(margin)));
            let last = last.saturating_sub(half + 1);
            if half < shortest || first > last {
                continue;
            }
            for f in run.clone() {
                let centre = f.clamp(first, last);
                let window = &load[centre - half..=centre + half];
                let ends = 0.5 * (window[0] + window[2 * half]);
                carried[f] = (window.iter().sum::<f64>() - ends) / (2 * half) as f64;
                let duration_s = (2 * half) as f64 / rate_hz;
                needed[f] = mass_kg * (velocity[centre + half] - velocity[centre - half]) / duration_s + weight_n;
            }
        }
        let mut ratios: Vec<f64> = (0..n)
            .filter(|&f| carried[f] > 0.5 * weight_n && needed[f] > 0.5 * weight_n)
            .map(|f| carried[f] / needed[f])
            .collect();
        let gain = if ratios.len() as f64 > GAIN_S * rate_hz { upper_median(&mut ratios) } else { None };
        let applied = gain.map_or(1.0, |g| g.clamp(GAIN.start, GAIN.end));
        let deficit = needed.iter().zip(&carried).map(|(n, c)| (n - c / applied) / weight_n).collect();
        Self { deficit, gain }
    }
}

fn slope_frames(rate_hz: f64) -> usize {
    ((SLOPE_S * rate_hz).round() as usize).max(2)
}

/// Derivative by a line through the frames within [`SLOPE_S`]; NaN where a frame is missing.
fn slopes(values: &[f64], rate_hz: f64) -> Vec<f64> {
    let half = slope_frames(rate_hz);
    let squares: f64 = (1..=half).map(|k| 2.0 * (k * k) as f64).sum();
    (0..values.len())
        .map(|f| {
            if f < half || f + half >= values.len() {
                return f64::NAN;
            }
            (1..=half).map(|k| k as f64 * (values[f + k] - values[f - k])).sum::<f64>() / squares * rate_hz
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bouncing_body_balances_and_a_held_one_does_not() {
        // 60 kg moving as 5 cm · sin(2π 1.5 t), with the force that this requires
        let (rate, m, g, w) = (100.0, 60.0, 9.81, std::f64::consts::TAU * 1.5);
        let heights: Vec<f64> = (0..400).map(|f| 1.0 + 0.05 * (w * f as f64 / rate).sin()).collect();
        let force = |f: usize| m * (g - 0.05 * w * w * (w * f as f64 / rate).sin());
        let full: Vec<f64> = (0..400).map(force).collect();
        let all = std::slice::from_ref(&(0..400));
        let balance = Balance::of(&heights, &full, all, rate, m, m * g);
        assert!((balance.gain.unwrap_or(0.0) - 1.0).abs() < 0.01);
        assert!((30..370).all(|f| balance.deficit[f].abs() < 0.02), "{:?}", &balance.deficit[30..60]);
        // a helper carries 40 % for one second
        let held: Vec<f64> = (0..400).map(|f| force(f) * if (200..300).contains(&f) { 0.6 } else { 1.0 }).collect();
        let balance = Balance::of(&heights, &held, all, rate, m, m * g);
        assert!((220..280).all(|f| (balance.deficit[f] - 0.4).abs() < 0.15));
        assert!((30..180).all(|f| balance.deficit[f].abs() < 0.03));
        // a mass that is 15 % too high is a gain of the recording, not missing contact
        let balance = Balance::of(&heights, &full, all, rate, 1.15 * m, 1.15 * m * g);
        assert!((balance.gain.unwrap_or(0.0) - 1.0 / 1.15).abs() < 0.01);
        assert!((30..370).all(|f| balance.deficit[f].abs() < 0.02));
    }
}
