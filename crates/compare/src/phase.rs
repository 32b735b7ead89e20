//! Selects the frames that are used and assigns them a phase.

use crate::CompareOptions;
use aloft_signal::runs_where;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Phase of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// In contact, far from any flight.
    Contact,
    /// In contact shortly before a flight.
    TakeOff,
    /// In contact shortly after a flight.
    Landing,
    /// In flight.
    Flight,
}

impl Phase {
    /// All phases, in the order of reports.
    pub const ALL: [Self; 4] = [Self::Contact, Self::TakeOff, Self::Landing, Self::Flight];

    /// True in the three phases in which the plates give the measurement.
    pub fn is_contact(self) -> bool {
        self != Self::Flight
    }
    /// Name used in reports.
    pub fn word(self) -> &'static str {
        match self {
            Self::Contact => "contact",
            Self::TakeOff => "take-off",
            Self::Landing => "landing",
            Self::Flight => "flight",
        }
    }
}

/// Phase of a frame, and its position in the flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Place {
    pub phase: Phase,
    /// Index of the flight, for frames in flight.
    pub flight: Option<usize>,
    /// 0 at its first frame, 1 at its last.
    pub fraction: f64,
}

/// Place of every frame; `None` for frames that are not used: not solved, within the filter's end
/// margins, near a transition between flight and contact, or in contact that is not measured.
pub(crate) fn places(
    n_frames: usize,
    rate_hz: f64,
    flights: &[Range<usize>],
    solved: impl Fn(usize) -> bool,
    measured: impl Fn(usize) -> bool,
    options: &CompareOptions,
) -> Vec<Option<Place>> {
    let mut places = vec![None; n_frames];
    let frames = |seconds: f64| (seconds.max(0.0) * rate_hz).round() as usize;
    let (edge, margin, transition) =
        (frames(options.edge_s), frames(options.flight_margin_s), frames(options.transition_s));
    for run in runs_where(n_frames, solved) {
        let trimmed = run.start + options.end_margin_frames..run.end.saturating_sub(options.end_margin_frames);
        for f in trimmed {
            let inside = flights.iter().position(|flight| flight.contains(&f));
            places[f] = match inside {
                Some(i) => {
                    let flight = &flights[i];
                    let counts = f >= flight.start + margin && f + margin < flight.end;
                    let fraction = (f - flight.start) as f64 / (flight.len() - 1).max(1) as f64;
                    counts.then_some(Place { phase: Phase::Flight, flight: Some(i), fraction })
                }
                None => {
                    let to_next = flights.iter().filter(|g| g.start > f).map(|g| g.start - f).min();
                    let since_last = flights.iter().filter(|g| g.end <= f).map(|g| f + 1 - g.end).min();
                    let (to_next, since_last) = (to_next.unwrap_or(usize::MAX), since_last.unwrap_or(usize::MAX));
                    let phase = if to_next.min(since_last) > transition {
                        Phase::Contact
                    } else if to_next <= since_last {
                        Phase::TakeOff
                    } else {
                        Phase::Landing
                    };
                    let counts = to_next.min(since_last) > edge && measured(f);
                    counts.then_some(Place { phase, flight: None, fraction: f64::NAN })
                }
            };
        }
    }
    places
}

/// Runs of frames for weak windows: measured contact away from flights, and whole flights. These
/// are not filtered and need no end margins.
pub(crate) fn weak_stretches(
    n_frames: usize,
    rate_hz: f64,
    flights: &[Range<usize>],
    solved: impl Fn(usize) -> bool,
    measured: impl Fn(usize) -> bool,
    options: &CompareOptions,
) -> (Vec<Range<usize>>, Vec<Range<usize>>) {
    let edge = (options.edge_s.max(0.0) * rate_hz).round() as usize;
    let near_flight = |f: usize| flights.iter().any(|g| f + edge >= g.start && f < g.end + edge);
    let contact = runs_where(n_frames, |f| solved(f) && measured(f) && !near_flight(f));
    let flying = flights.iter().filter(|g| g.start < g.end && g.end <= n_frames).cloned().collect();
    (contact, flying)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_edges_and_gaps() {
        let options = CompareOptions {
            edge_s: 0.05,
            flight_margin_s: 0.1,
            end_margin_frames: 3,
            transition_s: 0.2,
            ..CompareOptions::default()
        };
        let p = places(120, 100.0, std::slice::from_ref(&(50..80)), |f| f != 10, |f| f != 20, &options);
        let phase = |f: usize| p[f].map(|p: Place| p.phase);
        assert!([0, 2, 7, 10, 13, 20, 45, 49, 50, 59, 70, 79, 84, 117].iter().all(|&f| phase(f).is_none()));
        assert!([3, 6, 14, 19, 29].iter().all(|&f| phase(f) == Some(Phase::Contact)));
        assert!([30, 44].iter().all(|&f| phase(f) == Some(Phase::TakeOff)));
        assert!([60, 69].iter().all(|&f| phase(f) == Some(Phase::Flight)));
        assert!([85, 99].iter().all(|&f| phase(f) == Some(Phase::Landing)));
        assert!([100, 116].iter().all(|&f| phase(f) == Some(Phase::Contact)));
        let (contact, flying) =
            weak_stretches(120, 100.0, std::slice::from_ref(&(50..80)), |f| f != 10, |f| f != 20, &options);
        assert_eq!(contact, vec![0..10, 11..20, 21..45, 85..120]);
        assert_eq!(flying.len(), 1);
    }
}
