//! Times of the recordings in a session: stated in the files, or estimated from order and
//! durations.
//!
//! Drift between the clocks of plates and cameras grows over the session; estimating it requires
//! the times of the recordings.

use crate::RecordedAt;
use serde::{Deserialize, Serialize};

/// One recording of a session.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SessionRecording {
    /// Name.
    pub name: String,
    /// When it was made, if its file states it.
    pub recorded: Option<RecordedAt>,
    /// Time of its first frame by the frame numbers or times of its file, s.
    pub start_s: f64,
    /// Length, s.
    pub duration_s: f64,
    /// Whether its time is needed; other recordings (a static trial) only mark the start of the
    /// session.
    pub needed: bool,
}

/// Source of the session times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SessionSource {
    /// Dates and times of day in the files.
    Dates,
    /// Frame numbers or times of the files that run on from recording to recording.
    RunningClock,
    /// Order and durations of the recordings, as if each began at the end of the previous one.
    OrderAndLengths,
}

/// The times of a session.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionTimes {
    /// Start of each recording since the start of the first, s; NaN where unknown and not needed.
    pub start_s: Vec<f64>,
    /// Source of the times.
    pub source: SessionSource,
    /// Description of the source, with the reason why better sources were not used.
    pub words: String,
}

/// Coarsest resolution that separates recordings, s.
const RESOLUTION_S: f64 = 60.0;
/// Tolerance by which two time stamps may be closer than the duration of the recording, s.
const SLACK_S: f64 = 1.0;

/// Times of the recordings of a session, given in the order to assume if no times are stated.
pub fn session_times(recordings: &[SessionRecording]) -> SessionTimes {
    let reason = match by_dates(recordings) {
        Ok(times) => return times,
        Err(reason) => reason,
    };
    if let Some(times) = by_clock(recordings) {
        return times;
    }
    let mut at = 0.0;
    let start_s = recordings
        .iter()
        .map(|r| {
            let start = at;
            at += r.duration_s;
            start
        })
        .collect();
    let words = format!(
        "order and lengths of the recordings ({reason}); pauses between them are not counted, so a drift per second comes out too large \
         in proportion"
    );
    SessionTimes { start_s, source: SessionSource::OrderAndLengths, words }
}

/// Times from dates, or the reason why dates cannot be used.
fn by_dates(recordings: &[SessionRecording]) -> Result<SessionTimes, String> {
    let needed = || recordings.iter().filter(|r| r.needed);
    let dated: Vec<(&SessionRecording, &RecordedAt)> =
        recordings.iter().filter_map(|r| Some((r, r.recorded.as_ref()?))).collect();
    let Some((_, example)) = dated.first() else { return Err("no file states when it was recorded".to_owned()) };
    let without = needed().filter(|r| r.recorded.is_none()).count();
    if without > 0 {
        return Err(format!("{without} of {} recordings do not state when they were made", needed().count()));
    }
    if let Some((r, at)) = dated.iter().find(|(r, at)| r.needed && at.resolution_s > RESOLUTION_S) {
        return Err(format!("{} of `{}` has a date without time of day", at.place, r.name));
    }
    let mut order: Vec<(f64, f64, f64, &str)> = dated
        .iter()
        .filter(|(_, at)| at.resolution_s <= RESOLUTION_S)
        .map(|(r, at)| (at.clock_s, r.duration_s, at.resolution_s, r.name.as_str()))
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    for pair in order.windows(2) {
        let (gap, resolution) = (pair[1].0 - pair[0].0, pair[0].2.max(pair[1].2));
        // A stamp may mark the start or the end of a recording.
        if gap + resolution + SLACK_S < pair[0].1.min(pair[1].1) {
            return Err(format!(
                "{} states {gap:.0} s between `{}` and `{}`, less than they are long: times of an export, not of recording",
                example.place, pair[0].3, pair[1].3
            ));
        }
    }
    let first = order.first().map_or(0.0, |o| o.0);
    let resolution = order.iter().map(|o| o.2).fold(0.0, f64::max);
    let span = order.last().map_or(0.0, |o| o.0) - first;
    if order.len() > 1 && span < 3.0 * resolution {
        return Err(format!("{} is stated to {resolution:.0} s only, in a session of {span:.0} s", example.place));
    }
    let time = |r: &SessionRecording| {
        r.recorded.as_ref().filter(|at| at.resolution_s <= RESOLUTION_S).map_or(f64::NAN, |at| at.clock_s - first)
    };
    Ok(SessionTimes {
        start_s: recordings.iter().map(time).collect(),
        source: SessionSource::Dates,
        words: format!("dates and times in the files ({}, to {resolution:.0} s)", example.place),
    })
}

/// Times from frame numbers or time columns, if these continue through the session: no two
/// recordings overlap, and at most one begins at zero. Two recordings can meet this by chance (both
/// trimmed), so at least three are required.
fn by_clock(recordings: &[SessionRecording]) -> Option<SessionTimes> {
    let mut order: Vec<&SessionRecording> = recordings.iter().filter(|r| r.needed).collect();
    order.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
    let runs_on = order.windows(2).all(|pair| pair[1].start_s >= pair[0].start_s + pair[0].duration_s);
    if order.len() < 3 || !runs_on {
        return None;
    }
    let first = order[0].start_s;
    Some(SessionTimes {
        start_s: recordings.iter().map(|r| if r.needed { r.start_s - first } else { f64::NAN }).collect(),
        source: SessionSource::RunningClock,
        words: "frame numbers or times of the files, which run on from recording to recording".to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recorded_at;

    fn session(n: usize, stamp: impl Fn(usize) -> Option<String>) -> Vec<SessionRecording> {
        (0..n)
            .map(|k| SessionRecording {
                name: format!("trial{k}"),
                recorded: stamp(k).and_then(|text| recorded_at(&text, "TRIAL:CREATION_DATE")),
                duration_s: 5.0,
                needed: k > 0,
                ..SessionRecording::default()
            })
            .collect()
    }

    #[test]
    fn dates_are_used_where_they_can_be_of_recordings() {
        // One recording per minute, past midnight.
        for (first_h, n) in [(9, 8), (23, 90)] {
            let stamp = |k: usize| {
                let minute = first_h * 60 + k;
                Some(format!("2024-03-{:02} {:02}:{:02}:07", 9 + minute / 1440, minute / 60 % 24, minute % 60))
            };
            let times = session_times(&session(n, stamp));
            assert_eq!(times.source, SessionSource::Dates, "{}", times.words);
            for (k, start) in times.start_s.iter().enumerate() {
                assert!((start - 60.0 * k as f64).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn other_dates_are_refused_with_the_reason() {
        let lengths = |recordings: &[SessionRecording], reason: &str| {
            let times = session_times(recordings);
            assert_eq!(times.source, SessionSource::OrderAndLengths, "{}", times.words);
            assert!(times.words.contains(reason), "{}", times.words);
            for (k, start) in times.start_s.iter().enumerate() {
                assert!((start - 5.0 * k as f64).abs() < 1e-9);
            }
        };
        lengths(&session(6, |_| None), "no file states");
        lengths(&session(6, |_| Some("2024-03-09".to_owned())), "without time of day");
        lengths(&session(6, |k| (k != 3).then(|| format!("2024-03-09 10:{k:02}:00"))), "1 of 5 recordings");
        // A batch export writes one file per second.
        lengths(&session(6, |k| Some(format!("2024-03-09 10:00:{k:02}"))), "times of an export");
        lengths(&session(6, |_| Some("2024-03-09 10:00:00".to_owned())), "times of an export");
    }

    #[test]
    fn a_clock_that_runs_on_is_used() {
        let mut recordings = session(5, |_| None);
        for (k, r) in recordings.iter_mut().enumerate() {
            r.start_s = 12.0 + 31.5 * k as f64;
        }
        let times = session_times(&recordings);
        assert_eq!(times.source, SessionSource::RunningClock);
        assert!((times.start_s[4] - 3.0 * 31.5).abs() < 1e-9 && times.start_s[0].is_nan());
        // Each counted from its own first frame, or trimmed arbitrarily.
        for r in &mut recordings {
            r.start_s = 0.4;
        }
        assert_eq!(session_times(&recordings).source, SessionSource::OrderAndLengths);
    }
}
