//! Reading of an unloaded plate.
//!
//! Two methods: from the plate's own quiet and low readings ([`unloaded_tare`], before flights are
//! known), and from the flights ([`tare`], more accurate: no plate is loaded there, and several
//! flights show the drift between them).

use crate::Flight;
use aloft_signal::{median_and_deviation, quantile_of_sorted};
use aloft_trial::{Plate, Trial};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Least time without load from which a plate is tared by its own readings, s.
const LEAST_UNLOADED_S: f64 = 0.25;

/// Largest spread of the readings of an unloaded plate from stretch to stretch: this multiple of
/// the noise within a stretch, and drift within a recording, N.
const WANDER: f64 = 0.7;
const SLOW_N: f64 = 0.3;

/// Source of a tare.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TareSource {
    /// Quiet, low readings of the plate itself.
    OwnReadings,
    /// Flights.
    Flights,
    /// No tare could be determined; zero.
    None,
}

/// Reading of an unloaded plate, world frame, moment about the world origin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlateTare {
    /// Name of the plate.
    pub plate: String,
    /// Source.
    pub source: TareSource,
    /// Times of the readings, s from the first sample: one (any time), or several, between which
    /// the tare is interpolated.
    pub times_s: Vec<f64>,
    /// Force at those times, N.
    pub force_n: Vec<Vector3<f64>>,
    /// Moment at those times, N·m.
    pub moment_nm: Vec<Vector3<f64>>,
    /// Standard deviation of the vertical force when unloaded, N.
    pub noise_n: f64,
    /// Samples used.
    pub samples: usize,
}

impl PlateTare {
    /// Force and moment at a time, linearly interpolated between the readings, constant outside.
    pub fn at(&self, time_s: f64) -> (Vector3<f64>, Vector3<f64>) {
        let last = self.times_s.len().saturating_sub(1);
        let Some(next) = self.times_s.iter().position(|&t| t >= time_s) else {
            return match (self.force_n.get(last), self.moment_nm.get(last)) {
                (Some(force), Some(moment)) => (*force, *moment),
                _ => (Vector3::zeros(), Vector3::zeros()),
            };
        };
        if next == 0 {
            return (self.force_n[0], self.moment_nm[0]);
        }
        let (t0, t1) = (self.times_s[next - 1], self.times_s[next]);
        let along = (time_s - t0) / (t1 - t0);
        (
            self.force_n[next - 1].lerp(&self.force_n[next], along),
            self.moment_nm[next - 1].lerp(&self.moment_nm[next], along),
        )
    }

    fn none(plate: &Plate) -> Self {
        Self {
            plate: plate.name.clone(),
            source: TareSource::None,
            times_s: vec![0.0],
            force_n: vec![Vector3::zeros()],
            moment_nm: vec![Vector3::zeros()],
            noise_n: 0.0,
            samples: 0,
        }
    }
}

/// Median and spread (1.4826 × median absolute deviation) of finite values.
fn median_and_spread(values: &mut Vec<f64>) -> Option<(f64, f64)> {
    median_and_deviation(values).map(|(centre, deviation)| (centre, 1.4826 * deviation))
}

/// Values (time, value) less the straight line through them, by least squares.
fn without_trend(points: &[(f64, f64)]) -> Vec<f64> {
    let n = points.len().max(1) as f64;
    let (t0, x0) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let (mut tt, mut tx) = (0.0, 0.0);
    for (t, x) in points {
        tt += (t - t0) * (t - t0);
        tx += (t - t0) * (x - x0);
    }
    let slope = if tt > 0.0 { tx / tt } else { 0.0 };
    points.iter().map(|(t, x)| x - x0 - slope * (t - t0)).collect()
}

/// Component-wise median of some samples.
fn median_vector(samples: &[Vector3<f64>], chosen: &[usize]) -> Option<Vector3<f64>> {
    let mut out = Vector3::zeros();
    let mut values = Vec::with_capacity(chosen.len());
    for axis in 0..3 {
        values.clear();
        values.extend(chosen.iter().map(|&i| samples[i][axis]));
        out[axis] = median_and_spread(&mut values)?.0;
    }
    Some(out)
}

/// Tare from the plate's own readings: the median over stretches of 40 ms that are low (below 15 %
/// of the strongest load, at least 30 N) and as quiet as the quietest ones. Zero where the plate is
/// never unloaded.
pub fn unloaded_tare(plate: &Plate) -> PlateTare {
    let window = ((0.04 * plate.rate_hz).round() as usize).max(4);
    let mut loads: Vec<f64> = plate.force_n.iter().map(|f| f.z.abs()).filter(|x| x.is_finite()).collect();
    if loads.len() < window {
        return PlateTare::none(plate);
    }
    loads.sort_by(f64::total_cmp);
    let Some(strong) = quantile_of_sorted(&loads, 98, 100) else { return PlateTare::none(plate) };
    // The readings of a plate that was never loaded are all tare.
    let low = (0.15 * strong).max(30.0);
    let mut stretches: Vec<(usize, f64, f64)> = Vec::new();
    for (index, chunk) in plate.force_n.chunks_exact(window).enumerate() {
        let mean = chunk.iter().map(|f| f.z).sum::<f64>() / window as f64;
        let deviation = (chunk.iter().map(|f| (f.z - mean).powi(2)).sum::<f64>() / window as f64).sqrt();
        if mean.is_finite() && deviation.is_finite() && mean.abs() < low {
            stretches.push((index, deviation, mean));
        }
    }
    if stretches.is_empty() {
        return PlateTare::none(plate);
    }
    let mut deviations: Vec<f64> = stretches.iter().map(|s| s.1).collect();
    deviations.sort_by(f64::total_cmp);
    let Some(quarter) = quantile_of_sorted(&deviations, 1, 4) else { return PlateTare::none(plate) };
    let quiet = (2.0 * quarter).max(0.2).min(5.0_f64.max(deviations[0] * 1.5));
    stretches.retain(|s| s.1 <= quiet);
    // an unloaded plate reads the same in all of them, or drifts steadily; under the light touch of
    // a foot the readings wander by more than the noise within a stretch
    let points: Vec<(f64, f64)> = stretches.iter().map(|s| (s.0 as f64, s.2)).collect();
    let mut plain: Vec<f64> = points.iter().map(|p| p.1).collect();
    let mut straight = without_trend(&points);
    let spread = |values: &mut Vec<f64>| median_and_spread(values).map_or(f64::INFINITY, |m| m.1);
    let wander = spread(&mut plain).min(spread(&mut straight));
    let mut within: Vec<f64> = stretches.iter().map(|s| s.1).collect();
    match median_and_spread(&mut within) {
        Some((noise, _)) if wander <= WANDER * noise + SLOW_N => {}
        _ => return PlateTare::none(plate),
    }
    let chosen: Vec<usize> = stretches.iter().flat_map(|s| s.0 * window..(s.0 + 1) * window).collect();
    let mut vertical: Vec<f64> = chosen.iter().map(|&i| plate.force_n[i].z).collect();
    let Some((_, noise_n)) = median_and_spread(&mut vertical) else { return PlateTare::none(plate) };
    let (Some(force), Some(moment)) =
        (median_vector(&plate.force_n, &chosen), median_vector(&plate.moment_nm, &chosen))
    else {
        return PlateTare::none(plate);
    };
    PlateTare {
        plate: plate.name.clone(),
        source: TareSource::OwnReadings,
        times_s: vec![0.0],
        force_n: vec![force],
        moment_nm: vec![moment],
        noise_n,
        samples: chosen.len(),
    }
}

/// Tares every plate from the flights of this trial and returns the values subtracted. With several
/// flights the tare is interpolated linearly from flight to flight, because amplifiers drift.
/// Without flights, every stretch in which a plate is unloaded counts (for at least 0.25 s in all);
/// a plate that is loaded all the time keeps its readings, and the source is `None`.
///
/// `frame_rate_hz` is the trial's marker rate; 10 ms at both ends of each flight are omitted.
pub fn tare(trial: &mut Trial, flights: &[Flight]) -> Vec<PlateTare> {
    let frame_rate_hz = trial.markers.rate_hz;
    let tares: Vec<PlateTare> = trial
        .plates
        .iter()
        .map(|plate| {
            let mut out =
                PlateTare { times_s: Vec::new(), force_n: Vec::new(), moment_nm: Vec::new(), ..PlateTare::none(plate) };
            let mut noise = Vec::new();
            for flight in flights.iter().filter(|f| f.n_frames() > 0) {
                let from_s = flight.start as f64 / frame_rate_hz + 0.01;
                let to_s = (flight.end - 1) as f64 / frame_rate_hz - 0.01;
                if to_s <= from_s {
                    continue;
                }
                let from = (from_s * plate.rate_hz).ceil() as usize;
                let to = ((to_s * plate.rate_hz).floor() as usize + 1).min(plate.force_n.len());
                let chosen: Vec<usize> = (from..to).collect();
                let mut vertical: Vec<f64> = chosen.iter().map(|&i| plate.force_n[i].z).collect();
                let (Some(force), Some(moment), Some((_, spread))) = (
                    median_vector(&plate.force_n, &chosen),
                    median_vector(&plate.moment_nm, &chosen),
                    median_and_spread(&mut vertical),
                ) else {
                    continue;
                };
                out.times_s.push(0.5 * (from_s + to_s));
                out.force_n.push(force);
                out.moment_nm.push(moment);
                out.samples += chosen.len();
                noise.push(spread);
            }
            if out.times_s.is_empty() {
                return own_tare(plate);
            }
            out.noise_n = noise.iter().sum::<f64>() / noise.len() as f64;
            out.source = TareSource::Flights;
            out
        })
        .collect();
    apply_tare(trial, &tares);
    tares
}

/// Tare from the plate's own unloaded stretches, if they last long enough.
fn own_tare(plate: &Plate) -> PlateTare {
    let own = unloaded_tare(plate);
    if own.samples as f64 >= LEAST_UNLOADED_S * plate.rate_hz { own } else { PlateTare::none(plate) }
}

/// Subtracts tares from the plates of the same names (for a trial without flights: tares of another
/// trial of the session).
pub fn apply_tare(trial: &mut Trial, tares: &[PlateTare]) {
    for plate in &mut trial.plates {
        let Some(tare) = tares.iter().find(|t| t.plate == plate.name && t.source != TareSource::None) else { continue };
        for sample in 0..plate.force_n.len() {
            let (force, moment) = tare.at(sample as f64 / plate.rate_hz);
            plate.force_n[sample] -= force;
            plate.moment_nm[sample] -= moment;
        }
    }
}
