//! Constant offset of the plates in recordings in which they are never unloaded.
//!
//! Plates drift between recordings by about a newton and a fraction of a newton metre. A flight
//! reveals the offset; a trial whose plates were loaded from the first frame to the last does not,
//! and the constant would be mistaken for an error of the model. For such trials
//! ([`TrialInput::untared`]) one constant wrench is subtracted from the measurement, in world axes
//! about the world origin: plates do not move, so the offsets of all of them add up to one such
//! wrench, wherever the subject goes. Each recording has six numbers, estimated from its own
//! contact frames, and separately for each model, so that none is favoured.
//!
//! Over a recording the mean of the wrench about a fixed point hardly depends on the model's
//! details: momentum ends as it began, and the remaining mean is the weight at the mean position of
//! the centre of mass. Horizontal force and vertical moment of the offset therefore follow from the
//! momentum balance alone; vertical force needs the mass, and horizontal moments the mean position
//! of the centre of mass. The mass should come from a scale
//! ([`CompareOptions::mass_kg`](crate::CompareOptions::mass_kg)): then each model is scaled to that
//! mass while the offset is estimated, and a model with a wrong mass keeps its error. For the
//! centre of mass there is no such reference: a constant error of the horizontal moments is hidden,
//! up to the size of the offset. The errors as measured are therefore reported as well.
//!
//! A constant that the plates do not show elsewhere in the session is no offset: a body heavier
//! than stated, a gain, a foot beside the plates leave a constant, too. Where other recordings of
//! the session show the plates unloaded, the constant is limited to the range of their readings
//! ([`OffsetRange`]), and what exceeds it counts as error of the model. Horizontal moments may
//! exceed it by the weight times 3 mm, because the mean place of the centre of mass is not known
//! better.
//!
//! Means are Huber's M-estimates, about the mean position of the root (where the moments of noise
//! in the force are small), axis by axis.

use crate::TrialInput;
use crate::errors::{halves, joined, nullable};
use crate::measured::median_scale;
use nalgebra::{Vector3, Vector6};
use serde::{Deserialize, Serialize};

/// Constant part of the measured wrench that one model does not predict; it is subtracted from the
/// measurement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RecordingOffset {
    /// Force in world axes, N: measured − true.
    #[serde(with = "nullable")]
    pub force_n: [f64; 3],
    /// Moment about the world origin in world axes, N·m.
    #[serde(with = "nullable")]
    pub moment_nm: [f64; 3],
    /// Number of frames used.
    pub frames: usize,
    /// Part of the constant beyond the range of the plates' readings in other recordings, which was
    /// not subtracted: force (N), then moment (N·m). None if there is no such part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beyond: Option<[f64; 6]>,
}

impl RecordingOffset {
    /// Force, then moment about the world origin.
    pub(crate) fn wrench(&self) -> Vector6<f64> {
        joined(&self.force_n.into(), &self.moment_nm.into())
    }
}

/// Range in which the constant of a recording lies by the readings of the same plates, unloaded, in
/// other recordings of the session: the interval for one further reading (99.9 %, Student's t), at
/// least 1 N and 0.3 N·m on both sides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffsetRange {
    low: Vector6<f64>,
    high: Vector6<f64>,
}

impl OffsetRange {
    /// From one reading of each other recording: the sum over the plates, force (N) and moment
    /// about the world origin (N·m), world axes. `None` with fewer than three recordings.
    pub fn of(readings: &[Vector6<f64>]) -> Option<Self> {
        let n = readings.len() as f64;
        if readings.len() < 3 {
            return None;
        }
        let mean = readings.iter().sum::<Vector6<f64>>() / n;
        let variance = readings.iter().map(|r| (r - mean).component_mul(&(r - mean))).sum::<Vector6<f64>>() / (n - 1.0);
        let reach = aloft_signal::t9995(n - 1.0) * (1.0 + 1.0 / n).sqrt();
        let half = Vector6::from_fn(|i, _| (reach * variance[i].sqrt()).max(if i < 3 { 1.0 } else { 0.3 }));
        Some(Self { low: mean - half, high: mean + half })
    }
    /// True if a reading lies within the range.
    pub fn contains(&self, reading: &Vector6<f64>) -> bool {
        self.limit(reading, 0.0) == *reading
    }
    fn limit(&self, found: &Vector6<f64>, weight_n: f64) -> Vector6<f64> {
        // the mean place of the centre of mass is known to some millimetres only
        let more = |i: usize| if i == 3 || i == 4 { CENTRE_M * weight_n } else { 0.0 };
        Vector6::from_fn(|i, _| found[i].clamp(self.low[i] - more(i), self.high[i] + more(i)))
    }
}

/// Uncertainty of the mean place of a body's centre of mass, from soft tissue and joint centres, m.
const CENTRE_M: f64 = 0.003;

/// Shortest contact from which an offset is estimated, s: over a shorter time a movement of the
/// body cannot be distinguished from a constant.
const SHORTEST_S: f64 = 2.0;
/// Huber's constant in standard deviations: 99 % efficient for normal noise.
const HUBER: f64 = 2.0;
const ITERATIONS: usize = 50;

/// True if an offset is to be estimated. A flight unloads all plates, so a trial with a flight can
/// be tared and needs no offset.
pub(crate) fn sought(input: &TrialInput<'_>) -> bool {
    input.untared && input.measured.is_some() && input.flights.is_empty()
}

/// Factor that scales the wrench of a model with mass `model_kg` while its offset is estimated;
/// none if it has no mass to scale.
pub(crate) fn mass_ratio(known_kg: Option<f64>, model_kg: f64) -> Option<f64> {
    match known_kg {
        None => Some(1.0),
        Some(known) => Some(known / model_kg).filter(|r| r.is_finite() && *r > 0.0),
    }
}

/// Measured wrench less the prediction of each model, frame by frame.
pub(crate) struct OffsetSamples {
    /// Position of the root in the world, m.
    root: Vec<Vector3<f64>>,
    /// Measured − predicted, `[model][frame]`: world axes, about the root origin.
    excess: Vec<Vec<Vector6<f64>>>,
}

impl OffsetSamples {
    pub fn new(models: usize) -> Self {
        Self { root: Vec::new(), excess: vec![Vec::new(); models] }
    }

    pub fn add(&mut self, root: Vector3<f64>, excess: impl Iterator<Item = Vector6<f64>>) {
        self.root.push(root);
        self.excess.iter_mut().zip(excess).for_each(|(all, e)| all.push(e));
    }

    /// Offset for each model, limited to `range` for a body of this weight; none where too few
    /// frames have a value.
    pub fn offsets(&self, rate_hz: f64, range: Option<&OffsetRange>, weight_n: f64) -> Vec<Option<RecordingOffset>> {
        let within = |whole: &Vector6<f64>| range.map_or(*whole, |r| r.limit(whole, weight_n));
        self.excess.iter().map(|excess| self.offset(excess, rate_hz, within)).collect()
    }

    fn offset(
        &self,
        excess: &[Vector6<f64>],
        rate_hz: f64,
        within: impl Fn(&Vector6<f64>) -> Vector6<f64>,
    ) -> Option<RecordingOffset> {
        let finite: Vec<(&Vector3<f64>, &Vector6<f64>)> =
            self.root.iter().zip(excess).filter(|(p, e)| p.iter().chain(e.iter()).all(|x| x.is_finite())).collect();
        let n = finite.len();
        if n == 0 || (n as f64) < SHORTEST_S * rate_hz {
            return None;
        }
        let centre: Vector3<f64> = finite.iter().map(|(p, _)| *p).sum::<Vector3<f64>>() / n as f64;
        let about_centre: Vec<Vector6<f64>> = finite
            .iter()
            .map(|(p, e)| {
                let (force, moment) = halves(e);
                joined(&force, &(moment + (*p - centre).cross(&force)))
            })
            .collect();
        let mean = Vector6::from_fn(|axis, _| huber_mean(about_centre.iter().map(|e| e[axis]).collect()));
        let (force, moment) = halves(&mean);
        let whole = joined(&force, &(moment + centre.cross(&force)));
        let taken = within(&whole);
        let (force, moment) = halves(&taken);
        mean.iter().all(|x| x.is_finite()).then_some(RecordingOffset {
            force_n: force.into(),
            moment_nm: moment.into(),
            frames: n,
            beyond: (taken != whole).then(|| (whole - taken).into()),
        })
    }
}

/// Huber's estimate of location, with the scale from the median absolute deviation; values must be
/// finite.
fn huber_mean(mut values: Vec<f64>) -> f64 {
    let Some(median) = aloft_signal::upper_median(&mut values) else { return f64::NAN };
    let mut deviations: Vec<f64> = values.iter().map(|x| (x - median).abs()).collect();
    let limit = HUBER * median_scale(&mut deviations);
    if limit <= 0.0 || !limit.is_finite() {
        return median;
    }
    let mut mean = median;
    for _ in 0..ITERATIONS {
        // a step with clipped deviations; those within the limit have full weight
        let step = values.iter().map(|x| (x - mean).clamp(-limit, limit)).sum::<f64>() / values.len() as f64;
        mean += step;
        if step.abs() <= 1e-9 * limit {
            break;
        }
    }
    mean
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn the_mean_follows_a_shift_and_ignores_outliers() {
        let values: Vec<f64> = (0..1000).map(|i| (f64::from(i) * 0.7).sin()).collect();
        let plain = huber_mean(values.clone());
        let shifted = huber_mean(values.iter().map(|x| x + 5.0).collect());
        assert!(plain.abs() < 5e-3 && (shifted - plain - 5.0).abs() < 1e-8, "{plain} {shifted}");
        let mut spoilt = values;
        spoilt[..20].fill(1e6);
        assert!(huber_mean(spoilt).abs() < 0.1);
        assert!(huber_mean(vec![3.0; 7]) == 3.0 && huber_mean(Vec::new()).is_nan());
    }

    #[test]
    fn a_constant_beyond_the_session_counts_as_error() {
        let readings: Vec<Vector6<f64>> =
            (0..8).map(|i| Vector6::new(0.1, 0.2, 1.0 + 0.2 * f64::from(i % 3), 0.0, 0.0, 0.0)).collect();
        let range = OffsetRange::of(&readings).unwrap();
        let mut samples = OffsetSamples::new(2);
        for f in 0..400 {
            let moved = Vector3::new(0.001 * f64::from(f), 0.0, 1.0);
            let plain = joined(&Vector3::new(0.0, 0.0, 1.1), &-moved.cross(&Vector3::new(0.0, 0.0, 1.1)));
            let heavy = joined(&Vector3::new(0.0, 0.0, 25.0), &-moved.cross(&Vector3::new(0.0, 0.0, 25.0)));
            samples.add(moved, [plain, heavy].into_iter());
        }
        let found = samples.offsets(100.0, Some(&range), 0.0);
        let (plain, heavy) = (found[0].unwrap(), found[1].unwrap());
        assert!((plain.force_n[2] - 1.1).abs() < 1e-6 && plain.beyond.is_none(), "{plain:?}");
        let beyond = heavy.beyond.unwrap();
        assert!(heavy.force_n[2] < 3.0 && (heavy.force_n[2] + beyond[2] - 25.0).abs() < 1e-6, "{heavy:?}");
        assert!((samples.offsets(100.0, None, 0.0)[1].unwrap().force_n[2] - 25.0).abs() < 1e-6);
        assert!(OffsetRange::of(&readings[..2]).is_none());
    }

    #[test]
    fn the_mass_of_a_scale_is_used_where_there_is_one() {
        assert_eq!(mass_ratio(None, f64::NAN), Some(1.0));
        assert_eq!(mass_ratio(Some(60.0), 50.0), Some(1.2));
        for mass in [0.0, -3.0, f64::NAN] {
            assert_eq!(mass_ratio(Some(60.0), mass), None);
        }
    }
}
