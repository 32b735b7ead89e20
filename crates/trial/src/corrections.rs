//! Corrections of a session's recordings: what a measurement of the recordings themselves showed
//! and the user confirmed. Part of import, before labels and gaps.

use crate::Trial;
use nalgebra::{Rotation3, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Corrections of a recording.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Corrections {
    /// Delay of the plates against the cameras, s: positive where plates are late.
    #[serde(skip_serializing_if = "is_zero")]
    pub plate_delay_s: f64,
    /// Force and moment that each plate reads with nothing on it, by name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub plate_zero: BTreeMap<String, PlateZero>,
    /// Direction in which bodies fall, against −z of the recording, degrees about x and y of the
    /// world.
    #[serde(skip_serializing_if = "no_tilt")]
    pub vertical_deg: [f64; 2],
    /// True rate over stated rate, of cameras and plates together.
    #[serde(skip_serializing_if = "is_one")]
    pub rate_ratio: f64,
}

/// Reading of an unloaded plate.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlateZero {
    /// Force, N, world axes.
    pub force_n: [f64; 3],
    /// Moment about the world origin, N·m.
    pub moment_nm: [f64; 3],
}

fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

fn no_tilt(x: &[f64; 2]) -> bool {
    *x == [0.0; 2]
}

/// Zero is the default of the number, and means no correction.
fn is_one(x: &f64) -> bool {
    *x == 1.0 || *x == 0.0
}

impl Corrections {
    /// True if nothing is corrected.
    pub fn is_empty(&self) -> bool {
        is_zero(&self.plate_delay_s)
            && self.plate_zero.is_empty()
            && no_tilt(&self.vertical_deg)
            && is_one(&self.rate_ratio)
    }

    /// Corrects a recording; returns what it did, in words. Names of plates that the recording does
    /// not have are ignored, since recordings of a session may have different plates.
    pub fn apply(&self, trial: &mut Trial) -> Vec<String> {
        let mut done = Vec::new();
        for plate in &mut trial.plates {
            let Some(zero) = self.plate_zero.get(&plate.name) else { continue };
            let (force, moment) = (Vector3::from(zero.force_n), Vector3::from(zero.moment_nm));
            plate.force_n.iter_mut().for_each(|f| *f -= force);
            plate.moment_nm.iter_mut().for_each(|m| *m -= moment);
            done.push(format!("{:.1} N taken off plate {}", force.norm(), plate.name));
        }
        if !is_zero(&self.plate_delay_s) && !trial.plates.is_empty() {
            for plate in &mut trial.plates {
                let samples = self.plate_delay_s * plate.rate_hz;
                plate.force_n = earlier(&plate.force_n, samples);
                plate.moment_nm = earlier(&plate.moment_nm, samples);
            }
            done.push(format!("plates moved by {:+.1} ms", -1e3 * self.plate_delay_s));
        }
        if let Some(turn) = self.turn() {
            Self::upright(turn, trial);
            done.push(self.turned());
        }
        if let Some(ratio) = self.rate() {
            trial.markers.rate_hz *= ratio;
            trial.plates.iter_mut().for_each(|p| p.rate_hz *= ratio);
            trial.events.iter_mut().for_each(|e| e.time_s /= ratio);
            done.push(format!("rate {:.3} Hz", trial.markers.rate_hz));
        }
        done
    }

    /// What a turn did, in words.
    pub fn turned(&self) -> String {
        let [x, y] = self.vertical_deg;
        format!("turned by {:.2}° to the vertical of free fall", x.hypot(y))
    }

    /// Turn about the world origin that makes the stated direction of fall −z; none if nothing is
    /// turned.
    pub fn turn(&self) -> Option<Rotation3<f64>> {
        (!no_tilt(&self.vertical_deg)).then(|| fall_direction(self.vertical_deg).inverse())
    }

    /// True rate over stated rate; none if it is not corrected.
    pub fn rate(&self) -> Option<f64> {
        (!is_one(&self.rate_ratio)).then_some(self.rate_ratio)
    }

    /// Turns the recording about the world origin.
    fn upright(turn: Rotation3<f64>, trial: &mut Trial) {
        let point = |p: &mut Vector3<f64>| *p = turn * *p;
        trial.markers.trajectories.iter_mut().flatten().for_each(point);
        for plate in &mut trial.plates {
            plate.corners_m.iter_mut().chain(&mut plate.force_n).chain(&mut plate.moment_nm).for_each(point);
        }
        trial.world_from_source = turn * trial.world_from_source;
    }
}

/// Rotation that takes −z to the direction of fall stated by two small angles.
fn fall_direction([about_x, about_y]: [f64; 2]) -> Rotation3<f64> {
    Rotation3::from_scaled_axis(Vector3::new(about_x.to_radians(), about_y.to_radians(), 0.0))
}

/// Angles about x and y, degrees, of a direction of fall (any length) against −z: the inverse of
/// what [`Corrections::vertical_deg`] corrects.
pub fn vertical_of_fall(fall: &Vector3<f64>) -> Option<[f64; 2]> {
    let turn = Rotation3::rotation_between(&-Vector3::z(), fall)?.scaled_axis();
    Some([turn.x.to_degrees(), turn.y.to_degrees()])
}

/// Values taken `samples` later, linearly between samples; NaN beyond the recording.
fn earlier(values: &[Vector3<f64>], samples: f64) -> Vec<Vector3<f64>> {
    let whole = samples.floor();
    let share = samples - whole;
    // none: before the first sample there is none
    let at = |i: isize| usize::try_from(i).ok().and_then(|i| values.get(i)).copied();
    (0..values.len() as isize)
        .map(|i| {
            let from = i + whole as isize;
            match (at(from), at(from + 1)) {
                (Some(a), _) if share == 0.0 => a,
                (Some(a), Some(b)) => a * (1.0 - share) + b * share,
                _ => Vector3::repeat(f64::NAN),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Markers, Plate};

    fn trial() -> Trial {
        let force = |i: usize| Vector3::new(0.0, 3.0, 100.0 + 10.0 * i as f64);
        let plate = Plate {
            name: "FP1".into(),
            rate_hz: 1000.0,
            corners_m: vec![Vector3::x()],
            force_n: (0..50).map(force).collect(),
            moment_nm: vec![Vector3::y(); 50],
        };
        let markers = Markers {
            rate_hz: 100.0,
            first_frame: 1,
            n_frames: 1,
            labels: vec!["A".into()],
            trajectories: vec![vec![Vector3::z()]],
        };
        Trial { markers, plates: vec![plate], ..Trial::default() }
    }

    #[test]
    fn plates_that_are_late_come_earlier_and_nothing_is_invented_at_the_end() {
        let mut t = trial();
        Corrections { plate_delay_s: 0.0065, ..Corrections::default() }.apply(&mut t);
        let z: Vec<f64> = t.plates[0].force_n.iter().map(|f| f.z).collect();
        assert!((z[0] - 165.0).abs() < 1e-9 && (z[42] - 585.0).abs() < 1e-9);
        assert!(z[44..].iter().all(|z| z.is_nan()));
    }

    #[test]
    fn the_fall_points_down_after_the_correction() {
        let fall = Vector3::new(0.2, -0.1, -9.7);
        let corrections =
            Corrections { vertical_deg: vertical_of_fall(&fall).unwrap_or_default(), ..Corrections::default() };
        let mut t = trial();
        t.markers.trajectories[0][0] = fall;
        corrections.apply(&mut t);
        assert!((t.markers.trajectories[0][0] - Vector3::new(0.0, 0.0, -fall.norm())).norm() < 1e-12);
    }

    #[test]
    fn zeros_and_rates() {
        let mut t = trial();
        let zero = PlateZero { force_n: [0.0, 3.0, 100.0], moment_nm: [0.0, 1.0, 0.0] };
        let plate_zero = [("FP1".to_owned(), zero), ("FP9".to_owned(), zero)].into_iter().collect();
        let corrections = Corrections { plate_zero, rate_ratio: 1.01, ..Corrections::default() };
        let done = corrections.apply(&mut t);
        assert_eq!((t.plates[0].force_n[0], t.plates[0].moment_nm[0]), (Vector3::zeros(), Vector3::zeros()));
        assert!((t.markers.rate_hz - 101.0).abs() < 1e-12 && (t.plates[0].rate_hz - 1010.0).abs() < 1e-9);
        assert_eq!(done.len(), 2);
        assert!(Corrections::default().is_empty() && !corrections.is_empty());
    }
}
