//! Plates that do not measure: stuck at one reading, or at the limit of their range.
//!
//! An amplifier that is overloaded, unplugged or at the end of its range repeats one value. Summed
//! with the other plates such a reading looks like a load of the body, so it is missing from here
//! on.

use crate::{Plate, Trial, Warning, WarningKind};
use nalgebra::Vector3;
use std::ops::Range;

/// Force below which a constant reading is the zero of an unloaded plate, N.
const ZERO_N: f64 = 20.0;
/// Force that nobody who stands still reaches, N.
const NOBODY_N: f64 = 2500.0;
/// Largest spread of a stuck reading, as a share of its size: a loaded plate shows at least its
/// noise.
const STUCK: f64 = 1e-6;
/// Extent of the median marker's path from which a body moves, m.
const MOVES_M: f64 = 0.1;
/// Fewest samples of a stuck reading, and fewest in a row at the limit of the range.
const SAMPLES: usize = 20;
const RUN: usize = 5;
/// Least force at which a limit is sought, N.
const LIMIT_N: f64 = 50.0;
/// A peak that is rounded by coarse digits falls by a few of these steps beside its top, one that
/// is cut falls on as it rose.
const STEPS: f64 = 10.0;
/// Least fall beside a cut peak, as a share of it.
const FALL: f64 = 0.03;

/// Leaves out plates whose reading does not change while it should, with a warning.
pub(crate) fn leave_out_stuck(trial: &mut Trial) {
    let moves = body_moves(trial);
    let mut warnings = Vec::new();
    trial.plates.retain(|plate| {
        let Some(force) = stuck_at(plate).filter(|f| f.norm() > NOBODY_N || moves) else { return true };
        let message = format!(
            "plate `{}` reads the same {:.0} N in all {} samples: it measures nothing and is left out",
            plate.name,
            force.norm(),
            plate.force_n.len()
        );
        warnings.push(Warning::new(WarningKind::Plates, message));
        false
    });
    trial.warnings.append(&mut warnings);
}

/// Makes samples at the limit of a plate's range missing, with a warning for each such plate.
pub fn limits_to_missing(trial: &mut Trial) -> Vec<Warning> {
    let mut warnings = Vec::new();
    for plate in &mut trial.plates {
        let runs = at_limit(plate);
        let Some(first) = runs.iter().map(|r| r.start).min() else { continue };
        let limit_n = plate.force_n.get(first).map_or(f64::NAN, Vector3::norm);
        let mut count = 0;
        for sample in runs.into_iter().flatten() {
            let Some(force) = plate.force_n.get_mut(sample) else { continue };
            count += usize::from(force.x.is_finite());
            force.fill(f64::NAN);
            if let Some(moment) = plate.moment_nm.get_mut(sample) {
                moment.fill(f64::NAN);
            }
        }
        warnings.push(Warning::new(
            WarningKind::Plates,
            format!(
                "plate `{}` is at the limit of its range (about {limit_n:.0} N) in {count} samples, first at {:.2} s: the load \
                 was higher and is missing there",
                plate.name,
                first as f64 / plate.rate_hz
            ),
        ));
    }
    warnings
}

/// The force that a plate repeats from the first sample to the last; `None` for a living or an
/// unloaded one.
fn stuck_at(plate: &Plate) -> Option<Vector3<f64>> {
    let (first, rest) = plate.force_n.split_first()?;
    let size = first.norm();
    let same = |f: &Vector3<f64>| (f - first).norm() <= STUCK * size;
    (rest.len() >= SAMPLES && size > ZERO_N && rest.iter().all(same)).then_some(*first)
}

/// True where the median marker's path is longer than a standing body's.
fn body_moves(trial: &Trial) -> bool {
    let mut extents: Vec<f64> = trial
        .markers
        .trajectories
        .iter()
        .filter_map(|track| {
            let seen = || track.iter().filter(|p| p.iter().all(|x| x.is_finite()));
            let low = seen().fold(Vector3::repeat(f64::INFINITY), |a, p| a.inf(p));
            let high = seen().fold(Vector3::repeat(f64::NEG_INFINITY), |a, p| a.sup(p));
            Some((high - low).norm()).filter(|x| x.is_finite())
        })
        .collect();
    aloft_signal::upper_median(&mut extents).is_some_and(|m| m > MOVES_M)
}

/// Runs of samples in which a component of the force repeats its largest size, and beside which it
/// falls faster than beside the rounded top of a peak.
fn at_limit(plate: &Plate) -> Vec<Range<usize>> {
    let mut out = Vec::new();
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let value = |i: usize| plate.force_n.get(i).map_or(f64::NAN, |f| sign * f[axis]);
            let n = plate.force_n.len();
            let top = (0..n).map(value).filter(|x| x.is_finite()).fold(f64::NEG_INFINITY, f64::max);
            if top < LIMIT_N {
                continue;
            }
            let step = (1..n)
                .map(|i| (value(i) - value(i - 1)).abs())
                .filter(|d| *d > STUCK * top)
                .fold(f64::INFINITY, f64::min);
            let runs = aloft_signal::runs_where(n, |i| value(i) >= top * (1.0 - STUCK));
            let cut = |run: &Range<usize>| {
                let reach = (run.len() / 2).max(3);
                let fall = |i: Option<usize>| i.map_or(0.0, |i| top - value(i)).max(0.0);
                let before = fall(run.start.checked_sub(reach));
                let after = fall(Some(run.end + reach - 1).filter(|i| *i < n));
                before.max(after) > (STEPS * step).max(FALL * top)
            };
            out.extend(runs.into_iter().filter(|r| r.len() >= RUN).filter(cut));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Markers;

    fn plate(n: usize, z: impl Fn(usize) -> f64) -> Plate {
        Plate {
            name: "FP1".to_owned(),
            rate_hz: 1000.0,
            corners_m: Vec::new(),
            force_n: (0..n).map(|i| Vector3::new(0.0, 0.0, z(i))).collect(),
            moment_nm: vec![Vector3::zeros(); n],
        }
    }

    fn trial(plate: Plate, amplitude_m: f64) -> Trial {
        let track = (0..100).map(|f| Vector3::x() * amplitude_m * (0.1 * f64::from(f)).sin()).collect();
        let markers = Markers {
            rate_hz: 100.0,
            first_frame: 1,
            n_frames: 100,
            labels: vec!["A".to_owned()],
            trajectories: vec![track],
        };
        Trial { markers, plates: vec![plate], ..Trial::default() }
    }

    /// A jump's push: half a sine of 1500 N, in steps of an amplifier's digits.
    fn push(i: usize, step_n: f64) -> f64 {
        let force = if (200..600).contains(&i) {
            1500.0 * (std::f64::consts::PI * (i - 200) as f64 / 400.0).sin()
        } else {
            0.0
        };
        (force / step_n).round() * step_n
    }

    #[test]
    fn a_stuck_plate_is_left_out_and_a_standing_body_is_not() {
        let kept = |plate: Plate, amplitude_m: f64| {
            let mut trial = trial(plate, amplitude_m);
            leave_out_stuck(&mut trial);
            assert_eq!(trial.plates.len() + trial.warnings.len(), 1, "{:?}", trial.warnings);
            trial.plates.len() == 1
        };
        assert!(!kept(plate(1000, |_| -10_000.0), 0.0));
        assert!(!kept(plate(1000, |_| 480.0), 1.0));
        assert!(kept(plate(1000, |_| 480.0), 0.001), "a simulated body that stands still");
        assert!(kept(plate(1000, |_| 0.0), 1.0), "nobody on it");
        assert!(kept(plate(1000, |i| push(i, 0.1)), 1.0));
        assert!(kept(plate(0, |_| 0.0), 1.0));
    }

    #[test]
    fn a_cut_peak_is_missing_and_a_rounded_one_is_not() {
        let missing = |plate: Plate| {
            let mut trial = trial(plate, 1.0);
            let warnings = limits_to_missing(&mut trial);
            let gone = trial.plates[0].force_n.iter().filter(|f| f.z.is_nan()).count();
            assert_eq!(warnings.is_empty(), gone == 0, "{warnings:?}");
            gone
        };
        for step_n in [0.01, 1.0, 5.0, 20.0] {
            assert_eq!(missing(plate(1000, |i| push(i, step_n))), 0, "{step_n}");
            let cut = plate(1000, |i| push(i, step_n).min(1000.0));
            let beyond = (0..1000).filter(|i| push(*i, step_n) >= 1000.0).count();
            assert_eq!(missing(cut), beyond, "{step_n}");
        }
        // a load that is put on and stays the same
        assert_eq!(missing(plate(1000, |i| if i < 500 { 0.0 } else { 300.0 + f64::from(u8::from(i % 2 == 0)) })), 0);
    }
}
