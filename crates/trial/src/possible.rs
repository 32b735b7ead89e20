//! Numbers that no recording holds: where there are any, the file is damaged.
//!
//! Bytes that were overwritten or shifted read as arbitrary floating-point numbers, of which almost
//! half are beyond every length and force of a laboratory. The motion around them cannot be
//! trusted either, so the recording is refused.

use crate::{Plate, Trial, TrialError};
use nalgebra::Vector3;

/// Largest coordinate, m, also where a unit is stated wrongly.
const FARTHEST_M: f64 = 1e5;
/// Largest force, N, and moment, N·m, also where a scale is stated wrongly.
const STRONGEST: f64 = 1e8;
/// What cameras of Northern Digital write in place of a marker that they do not see.
const NOT_SEEN: f32 = -3.697_314e28;

/// True for the number that stands for a missing marker, whatever unit the file states.
pub(crate) fn is_not_seen(p: &[f32; 3]) -> bool {
    p.iter().any(|x| (x / NOT_SEEN - 1.0).abs() < 1e-3)
}

/// Refuses a recording with a marker or a plate reading that is not possible.
///
/// # Errors
/// The first marker with such a coordinate, else the first plate.
pub(crate) fn require_possible(trial: &Trial) -> Result<(), TrialError> {
    let error = |place: String, found: String, expected: &'static str, others: usize| TrialError::Impossible {
        trial: trial.name.clone(),
        place,
        found,
        expected,
        others: others.saturating_sub(1),
    };
    let far = |p: &Vector3<f64>| p.amax() > FARTHEST_M;
    let markers = &trial.markers;
    let beyond = |track: &Vec<Vector3<f64>>| track.iter().filter(|p| far(p)).count();
    let count: usize = markers.trajectories.iter().map(beyond).sum();
    let first = markers.trajectories.iter().zip(&markers.labels).find_map(|(track, label)| {
        let frame = track.iter().position(far)?;
        Some((label, frame, track[frame].amax()))
    });
    if let Some((label, frame, size)) = first {
        let place = format!("marker `{label}` in frame {}", i64::from(markers.first_frame) + frame as i64);
        return Err(error(place, format!("{size:.1e} m"), "less than 100 km from the origin", count));
    }
    let strong = |p: &Vector3<f64>| p.amax() > STRONGEST;
    let readings = |plate: &Plate| plate.force_n.iter().chain(&plate.moment_nm).filter(|p| strong(p)).count();
    let count: usize = trial.plates.iter().map(readings).sum();
    let of_plate = |plate: &Plate| {
        let pairs = plate.force_n.iter().zip(&plate.moment_nm);
        let (sample, size) = pairs.map(|(f, m)| f.amax().max(m.amax())).enumerate().find(|(_, x)| *x > STRONGEST)?;
        Some((format!("plate `{}` in sample {}", plate.name, sample + 1), size))
    };
    if let Some((place, size)) = trial.plates.iter().find_map(of_plate) {
        return Err(error(place, format!("{size:.1e} N or N·m"), "less than 100 MN", count));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Markers;

    fn recording(x: f64) -> Trial {
        let mut track = vec![Vector3::new(0.1, 0.2, 1.0); 4];
        track[2].x = x;
        let markers = Markers {
            rate_hz: 100.0,
            first_frame: 11,
            n_frames: 4,
            labels: vec!["LASI".to_owned()],
            trajectories: vec![track],
        };
        Trial { name: "jump".to_owned(), markers, ..Trial::default() }
    }

    #[test]
    fn a_marker_beyond_every_laboratory_is_told_with_its_frame() {
        let text = require_possible(&recording(3.6e35)).unwrap_err().to_string();
        assert!(text.starts_with("jump: marker `LASI` in frame 13: found 3.6e35 m"), "{text}");
        for possible in [1234.0, f64::NAN] {
            require_possible(&recording(possible)).unwrap();
        }
    }

    #[test]
    fn a_reading_beyond_every_plate_is_told_with_its_sample() {
        let mut trial = recording(0.0);
        let plate = Plate {
            name: "FP1".to_owned(),
            rate_hz: 1000.0,
            corners_m: Vec::new(),
            force_n: vec![Vector3::new(0.0, 0.0, 700.0), Vector3::new(0.0, 0.0, 700.0)],
            moment_nm: vec![Vector3::zeros(), Vector3::new(0.0, -2e12, 0.0)],
        };
        trial.plates.push(plate);
        let text = require_possible(&trial).unwrap_err().to_string();
        assert!(text.starts_with("jump: plate `FP1` in sample 2: found 2.0e12 N or N·m"), "{text}");
    }

    #[test]
    fn a_marker_that_was_not_seen_is_known_by_its_number() {
        assert!(is_not_seen(&[NOT_SEEN, NOT_SEEN, NOT_SEEN]));
        assert!(!is_not_seen(&[100.0, 0.0, -3.6e28]));
    }
}
