//! Flights from plates: stretches in which no plate is loaded.

use crate::free_acceleration::longest_frames;
use crate::parabola::Parabola;
use crate::tare::unloaded_tare;
use crate::{EdgeSource, Flight, FlightOptions, FlightReport, FlightSource, PlateTare, Rejected, RejectionReason};
use aloft_trial::{Plate, Trial};

/// A stretch in which no plate is loaded, s; a bound that is not caused by a plate is open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Unloaded {
    pub from_s: f64,
    pub to_s: f64,
    pub loaded_before: bool,
    pub loaded_after: bool,
}

/// Finds the flights between take-off and landing on plates, in `n_frames` frames at `rate_hz`.
///
/// Each plate is tared by its own unloaded readings, a threshold separates loaded from unloaded,
/// and edges are moved inwards to where the force disappears in the noise. Unloaded plates do not
/// imply a flight: a subject may stand on a box or beside the plates. A stretch must therefore have
/// a loaded plate before and after it. Where markers are seen, their centroid must also fall
/// freely: with an acceleration of roughly the stated gravity, or along a parabola of any other
/// (frame rate, unit of length or support may be unknown).
pub fn from_plates(trial: &Trial, n_frames: usize, rate_hz: f64, options: &FlightOptions) -> FlightReport {
    let (stretches, tare) = unloaded_stretches(trial, options);
    let mut report = FlightReport { trial: trial.name.clone(), rate_hz, tare, ..FlightReport::default() };
    let shortest = ((options.min_duration_s * rate_hz).round() as usize).max(6);
    report.warnings = report.untared().collect();
    for stretch in stretches {
        let frames = frames_in(stretch.from_s, stretch.to_s, n_frames, rate_hz);
        if frames.len() < shortest {
            continue;
        }
        let (start, end) = (frames.start, frames.end);
        let mut reject = |reason| report.rejected.push(Rejected { start, end, reason });
        if !(stretch.loaded_before && stretch.loaded_after) {
            reject(RejectionReason::NotBounded);
            continue;
        }
        let centroid = centroid_fall(trial, start, end);
        let free_mps2 = centroid.as_ref().map_or(options.gravity_mps2, |c| c.acceleration_mps2.norm());
        if options.gravity_mps2 > 0.0 && frames.len() > longest_frames(free_mps2, rate_hz, options) {
            reject(RejectionReason::TooLong);
        } else if let Some(centroid) = centroid.filter(|c| !c.is_free(options)) {
            reject(RejectionReason::NotFalling { vertical_mps2: centroid.acceleration_mps2.z });
        } else {
            report.flights.push(Flight {
                start,
                end,
                source: FlightSource::Plates,
                takeoff_source: EdgeSource::Plates,
                landing_source: EdgeSource::Plates,
                mean_acceleration_mps2: [f64::NAN; 3],
            });
        }
    }
    report.apply_margin(options.margin_frames, shortest);
    report
}

/// Frames whose times lie inside.
pub(crate) fn frames_in(from_s: f64, to_s: f64, n_frames: usize, rate_hz: f64) -> std::ops::Range<usize> {
    let start = (from_s * rate_hz - 1e-9).ceil().max(0.0) as usize;
    let end = ((to_s * rate_hz + 1e-9).floor().max(-1.0) + 1.0) as usize;
    let end = end.min(n_frames);
    start.min(end)..end
}

/// Stretches without load on any plate, with the tare of each plate.
pub(crate) fn unloaded_stretches(trial: &Trial, options: &FlightOptions) -> (Vec<Unloaded>, Vec<PlateTare>) {
    let tares: Vec<PlateTare> = trial.plates.iter().map(unloaded_tare).collect();
    let mut common: Option<Vec<Unloaded>> = None;
    for (plate, tare) in trial.plates.iter().zip(&tares) {
        let own = unloaded_of_plate(plate, tare, options);
        common = Some(match common {
            None => own,
            Some(others) => intersect(&others, &own),
        });
    }
    (common.unwrap_or_default(), tares)
}

/// Unloaded stretches of one plate: below the threshold, then moved inwards (up to 40 ms) to three
/// consecutive samples within the noise.
fn unloaded_of_plate(plate: &Plate, tare: &PlateTare, options: &FlightOptions) -> Vec<Unloaded> {
    let n = plate.force_n.len();
    let load = |sample: usize| (plate.force_n[sample] - tare.force_n[0]).norm();
    let quiet_n = (5.0 * tare.noise_n).clamp(1.0, options.threshold_n.max(1.0));
    let reach = (0.04 * plate.rate_hz) as usize;
    let runs = aloft_signal::runs_where(n, |sample| load(sample) < options.threshold_n);
    let mut stretches = Vec::with_capacity(runs.len());
    for run in runs {
        let (loaded_before, loaded_after) = (run.start > 0, run.end < n);
        let (mut start, mut end) = (run.start, run.end);
        let quiet = |from: usize| (from..(from + 3).min(run.end)).all(|sample| load(sample) <= quiet_n);
        if loaded_before {
            while start < run.end && start < run.start + reach && !quiet(start) {
                start += 1;
            }
        }
        if loaded_after {
            while end > start + 3 && end + reach > run.end && !quiet(end - 3) {
                end -= 1;
            }
        }
        if end > start {
            // The last newtons of a push disappear in the noise.
            let guard = |loaded: bool| if loaded { options.plate_guard_s } else { 0.0 };
            let from_s = start as f64 / plate.rate_hz + guard(loaded_before);
            let to_s = (end - 1) as f64 / plate.rate_hz - guard(loaded_after);
            if to_s < from_s {
                continue;
            }
            stretches.push(Unloaded { from_s, to_s, loaded_before, loaded_after });
        }
    }
    stretches
}

/// Intersection of two lists of unloaded stretches; each edge keeps its evidence.
fn intersect(a: &[Unloaded], b: &[Unloaded]) -> Vec<Unloaded> {
    let mut out = Vec::new();
    for x in a {
        for y in b {
            let from_s = x.from_s.max(y.from_s);
            let to_s = x.to_s.min(y.to_s);
            if to_s <= from_s {
                continue;
            }
            let near = |p: f64, q: f64| (p - q).abs() < 1e-9;
            let loaded_before =
                (near(x.from_s, from_s) && x.loaded_before) || (near(y.from_s, from_s) && y.loaded_before);
            let loaded_after = (near(x.to_s, to_s) && x.loaded_after) || (near(y.to_s, to_s) && y.loaded_after);
            out.push(Unloaded { from_s, to_s, loaded_before, loaded_after });
        }
    }
    out
}

/// Motion of the centroid of the markers in a stretch.
pub(crate) struct CentroidFall {
    /// Mean acceleration, m/s².
    pub acceleration_mps2: nalgebra::Vector3<f64>,
    /// Root mean square distance from the fitted parabola, relative to the height of its arc.
    pub unsteadiness: f64,
}

impl CentroidFall {
    /// Whether this can be free fall. The centroid differs from the centre of mass (limbs move by
    /// some centimetres relative to it), so this is a coarse test: near the stated gravity any path
    /// is accepted, otherwise it must be a parabola.
    fn is_free(&self, options: &FlightOptions) -> bool {
        let g = options.gravity_mps2;
        let share = self.acceleration_mps2.norm() / g;
        g == 0.0
            || (0.4..1.65).contains(&(-self.acceleration_mps2.z / g))
            || (share > options.least_free_g && self.unsteadiness < 0.12)
    }
}

/// The centroid of the markers that are seen in all these frames; `None` with fewer than five.
pub(crate) fn centroid_fall(trial: &Trial, start: usize, end: usize) -> Option<CentroidFall> {
    let n = end.min(trial.markers.n_frames).checked_sub(start)?;
    let mut path = vec![nalgebra::Vector3::zeros(); n];
    let mut seen = 0.0;
    for track in &trial.markers.trajectories {
        let part = track.get(start..start + n)?;
        if part.iter().all(|p| p.iter().all(|x| x.is_finite())) {
            for (sum, p) in path.iter_mut().zip(part) {
                *sum += p;
            }
            seen += 1.0;
        }
    }
    if seen < 5.0 {
        return None;
    }
    for sum in &mut path {
        *sum /= seen;
    }
    let rate_hz = trial.markers.rate_hz;
    let parabola = Parabola::fit(&path, 0..n, rate_hz)?;
    let acceleration_mps2 = parabola.acceleration_mps2();
    let off = |(frame, p): (usize, &nalgebra::Vector3<f64>)| {
        (p - parabola.at((frame as f64 - 0.5 * n as f64) / rate_hz)).norm_squared()
    };
    let rms = (path.iter().enumerate().map(off).sum::<f64>() / n as f64).sqrt();
    let arc = acceleration_mps2.norm() * (n as f64 / rate_hz).powi(2) / 8.0;
    Some(CentroidFall { acceleration_mps2, unsteadiness: if arc > 0.0 { rms / arc } else { f64::INFINITY } })
}
