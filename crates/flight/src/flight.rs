//! A flight, and the result of a search for flights.

use crate::{FlightWarning, FreeFall, PlateTare, TareSource};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Evidence for an edge of a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EdgeSource {
    /// A plate was loaded beyond the edge.
    Plates,
    /// The acceleration of the centre of mass.
    Motion,
    /// A contact sensor of the log.
    Contact,
    /// The recording (or the solved part of it) ends there.
    Recording,
    /// The user.
    Stated,
}

/// Evidence for the flight as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FlightSource {
    /// Plates alone.
    Plates,
    /// Motion alone.
    Motion,
    /// Both agree.
    Both,
    /// Stated by the user.
    Stated,
}

/// Frames without external contact: marker frames `start..end`, `end` not included.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Flight {
    /// First frame in the air (index from 0).
    pub start: usize,
    /// First frame after the flight.
    pub end: usize,
    /// Evidence for the flight.
    pub source: FlightSource,
    /// Evidence for its start.
    pub takeoff_source: EdgeSource,
    /// Evidence for its end.
    pub landing_source: EdgeSource,
    /// Mean acceleration of the centre of mass in it, m/s², world frame; NaN (in JSON: null) where
    /// no motion was given.
    #[serde(deserialize_with = "null_is_nan")]
    pub mean_acceleration_mps2: [f64; 3],
}

/// JSON has no NaN: null is read as NaN.
fn null_is_nan<'de, D: serde::Deserializer<'de>>(from: D) -> Result<[f64; 3], D::Error> {
    let values = <[Option<f64>; 3]>::deserialize(from)?;
    Ok(values.map(|x| x.unwrap_or(f64::NAN)))
}

impl Flight {
    /// Number of frames.
    pub fn n_frames(&self) -> usize {
        self.end.saturating_sub(self.start)
    }
    /// The frames.
    pub fn frames(&self) -> Range<usize> {
        self.start..self.end
    }
    /// The frames without `margin` frames at both ends; empty if nothing remains.
    pub fn frames_within(&self, margin: usize) -> Range<usize> {
        let start = self.start + margin;
        start..self.end.saturating_sub(margin).max(start)
    }
    /// Duration, s.
    pub fn duration_s(&self, rate_hz: f64) -> f64 {
        self.n_frames() as f64 / rate_hz
    }
}

/// Why a candidate stretch is not a flight.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "reason", rename_all = "snake_case")]
pub enum RejectionReason {
    /// Shorter than the minimum duration of a flight.
    TooShort,
    /// Longer than the maximum duration of a flight.
    TooLong,
    /// The body does not fall freely: it stands or moves beside the plates, or touches something in
    /// between.
    NotFalling {
        /// Vertical acceleration, m/s².
        vertical_mps2: f64,
    },
    /// The acceleration is that of the other flights, but it comes and goes gradually, as in the
    /// dip before a jump.
    Gradual,
    /// No plate is loaded from the start or to the end of the recording, and no motion shows when
    /// the fall begins or ends.
    NotBounded,
    /// The motion looks like falling, but a plate is loaded.
    PlateLoaded {
        /// Mean force, N.
        force_n: f64,
    },
}

impl std::fmt::Display for RejectionReason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::TooShort => write!(f, "shorter than the shortest flight"),
            Self::TooLong => write!(f, "longer than the longest flight"),
            Self::NotFalling { vertical_mps2 } => {
                write!(f, "the body is not in steady free fall (vertical acceleration {vertical_mps2:.1} m/s²)")
            }
            Self::Gradual => write!(f, "the acceleration comes and goes gradually, as in a movement on the ground"),
            Self::NotBounded => write!(f, "no plate is loaded up to an end of the recording; needs a solved motion"),
            Self::PlateLoaded { force_n } => write!(f, "it looks like falling, but plates carry {force_n:.0} N"),
        }
    }
}

/// A stretch that is not a flight, with the reason.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rejected {
    /// First frame.
    pub start: usize,
    /// Frame after the last.
    pub end: usize,
    /// Reason.
    pub reason: RejectionReason,
}

/// Result of a search.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FlightReport {
    /// Name of the trial.
    pub trial: String,
    /// Rate of the frames, Hz.
    pub rate_hz: f64,
    /// The flights, in order.
    pub flights: Vec<Flight>,
    /// Candidate stretches that were rejected.
    pub rejected: Vec<Rejected>,
    /// Reading of each plate when unloaded (subtracted for the search only).
    pub tare: Vec<PlateTare>,
    /// The acceleration of free flight against the stated gravity; `None` without flights of known
    /// acceleration.
    #[serde(default)]
    pub free_fall: Option<FreeFall>,
    /// Warnings.
    pub warnings: Vec<FlightWarning>,
}

impl FlightReport {
    /// Warnings for the plates whose zero is unknown because they are never unloaded.
    pub fn untared(&self) -> impl Iterator<Item = FlightWarning> + '_ {
        let unknown = self.tare.iter().filter(|t| t.source == TareSource::None);
        unknown.map(|t| FlightWarning::NotTared { plate: t.plate.clone() })
    }

    /// Frames in the air, in total.
    pub fn flight_frames(&self) -> usize {
        self.flights.iter().map(Flight::n_frames).sum()
    }

    /// Removes the margin from both ends of every flight; flights that become too short are
    /// rejected.
    pub(crate) fn apply_margin(&mut self, margin_frames: usize, shortest_frames: usize) {
        if margin_frames == 0 {
            return;
        }
        let mut kept = Vec::with_capacity(self.flights.len());
        for mut flight in self.flights.drain(..) {
            let frames = flight.frames_within(margin_frames);
            if frames.len() < shortest_frames {
                let (start, end) = (flight.start, flight.end);
                self.rejected.push(Rejected { start, end, reason: RejectionReason::TooShort });
            } else {
                (flight.start, flight.end) = (frames.start, frames.end);
                kept.push(flight);
            }
        }
        self.flights = kept;
        self.rejected.sort_by_key(|r| r.start);
    }
}
