//! Warnings of a search for flights: typed for programs, with a sentence for people.

use serde::{Deserialize, Serialize};
use std::ops::Range;

/// A warning of a search. Its [`Display`](std::fmt::Display) form is the sentence shown to people.
///
/// In JSON a warning is that sentence. Programs can obtain the same information from the other
/// fields of the report ([`crate::FlightReport::untared`]); a warning read back is
/// [`FlightWarning::Stored`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", from = "String")]
#[non_exhaustive]
pub enum FlightWarning {
    /// The zero of a plate is unknown because the subject never leaves the plate. Not a fault of
    /// the recording.
    NotTared {
        /// Name of the plate.
        plate: String,
    },
    /// The free acceleration differs from the stated gravity ([`crate::FreeFall::warning`]).
    FreeFall {
        /// Ratio, interval and explanations.
        words: String,
    },
    /// Motion and plates detect the same flight with different edges.
    EdgesDiffer {
        /// Edges after combination.
        joined: Range<usize>,
        /// Edges by motion.
        motion: Range<usize>,
        /// Edges by plates.
        plates: Range<usize>,
        /// Number of frames common to motion and plates.
        shared: usize,
    },
    /// Only the plates detect the flight: its motion is not solved.
    Unsolved {
        /// The flight.
        frames: Range<usize>,
        /// Frames in it without a solution.
        unsolved: usize,
    },
    /// Only the plates detect the flight: its motion is not steady.
    Unsteady {
        /// The flight.
        frames: Range<usize>,
    },
    /// A contact sensor says contact while the body falls freely.
    ContactInFlight {
        /// Name of the sensor.
        sensor: String,
        /// Number of flights in which it says so most of the time.
        wrong: usize,
        /// Number of flights.
        flights: usize,
    },
    /// Read from a stored report.
    Stored(String),
}

impl std::fmt::Display for FlightWarning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NotTared { plate } => write!(f, "plate `{plate}` is never unloaded: not tared"),
            Self::FreeFall { words } | Self::Stored(words) => f.write_str(words),
            Self::EdgesDiffer { joined, motion, plates, shared } => write!(
                f,
                "flight in frames {} to {}: motion gives {} to {}, plates {} to {} ({shared} frames in common)",
                joined.start, joined.end, motion.start, motion.end, plates.start, plates.end
            ),
            Self::Unsolved { frames, unsolved } => write!(
                f,
                "flight in frames {} to {}: determined from the plates alone, {unsolved} frames of the motion are not solved",
                frames.start, frames.end
            ),
            Self::ContactInFlight { sensor, wrong, flights } => write!(
                f,
                "`{sensor}` says contact in {wrong} of {flights} flights, in which the body falls freely: it is not used"
            ),
            Self::Unsteady { frames } => write!(
                f,
                "flight in frames {} to {}: determined from the plates alone, the motion is not steady in it",
                frames.start, frames.end
            ),
        }
    }
}

impl From<FlightWarning> for String {
    fn from(warning: FlightWarning) -> Self {
        warning.to_string()
    }
}

impl From<String> for FlightWarning {
    fn from(words: String) -> Self {
        Self::Stored(words)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use crate::{FlightReport, PlateTare, TareSource};

    #[test]
    fn unit_untared_plates_are_known_after_a_report_was_stored() {
        let tare = |name: &str, source| PlateTare {
            plate: name.into(),
            source,
            times_s: vec![0.0],
            force_n: vec![Default::default()],
            moment_nm: vec![Default::default()],
            noise_n: 0.0,
            samples: 0,
        };
        let tare = vec![tare("FP1", TareSource::None), tare("FP2", TareSource::OwnReadings)];
        let mut report = FlightReport { tare, ..FlightReport::default() };
        report.warnings = report.untared().collect();
        let stored = serde_yaml::to_string(&report).unwrap();
        assert!(stored.contains("warnings:\n- 'plate `FP1` is never unloaded: not tared'"), "{stored}");
        let back: FlightReport = serde_yaml::from_str(&stored).unwrap();
        assert_eq!(back.untared().collect::<Vec<_>>(), report.warnings);
        assert_eq!(back.warnings[0].to_string(), report.warnings[0].to_string());
    }
}
