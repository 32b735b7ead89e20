//! Errors of import. Each message is one line: trial, place, value found, value expected, and a
//! hint.

/// Errors of this crate; every variant names the trial.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrialError {
    /// The C3D file cannot be read.
    #[error("{trial}: {problem}")]
    Unreadable {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        problem: String,
    },
    /// The source has no bytes.
    #[error("{trial}: the file is empty (0 bytes); hint: export the trial again")]
    EmptyFile {
        #[doc(hidden)]
        trial: String,
    },
    /// The source has no frames.
    #[error("{trial}: no frames: found 0, expected at least 1; hint: export the trial again or exclude it")]
    NoFrames {
        #[doc(hidden)]
        trial: String,
    },
    /// The source has no markers.
    #[error(
        "{trial}: no labelled marker: found {found}; expected at least 1; hint: label the trial before exporting it"
    )]
    NoMarkers {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        found: String,
    },
    /// The sampling rate is out of range.
    #[error(
        "{trial}: {place}: sampling rate {found} Hz; expected 0.001 to 1000000 Hz (`import: {{rate_hz: …}}` states it)"
    )]
    Rate {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        place: &'static str,
        #[doc(hidden)]
        found: f64,
    },
    /// Malformed line in a text file (TRC, MOT, STO).
    #[error("{trial}: {format} line {line}: found {found}, expected {expected}")]
    Text {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        format: &'static str,
        #[doc(hidden)]
        line: usize,
        #[doc(hidden)]
        found: String,
        #[doc(hidden)]
        expected: String,
    },
    /// A column of forces that the pipeline names and the table does not have.
    #[error("{trial}: `import: {{forces: …}}` names `{column}` for the plate `{plate}`; the force file has {found}")]
    ForceColumn {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        plate: String,
        #[doc(hidden)]
        column: String,
        #[doc(hidden)]
        found: String,
    },
    /// Forces and markers that have no time in common.
    #[error(
        "{trial}: forces from {:.3} to {:.3} s and markers from {:.3} to {:.3} s have no time in common",
        .forces_s[0], .forces_s[1], .markers_s[0], .markers_s[1]
    )]
    NoCommonTime {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        forces_s: [f64; 2],
        #[doc(hidden)]
        markers_s: [f64; 2],
    },
    /// Markers of several people, none of whom has the name of the subject.
    #[error("{trial}: markers of several people ({people}), and none has the subject's name")]
    SeveralPeople {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        people: String,
    },
    /// A unit that is not a length.
    #[error(
        "{trial}: {place}: unit `{found}`; expected mm, cm, dm, m, in or ft; hint: state the unit with `point_unit`"
    )]
    Unit {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        place: &'static str,
        #[doc(hidden)]
        found: String,
    },
    /// A coordinate, force or moment that no recording holds.
    #[error("{trial}: {place}: found {found}, expected {expected} ({others} more such values): the file is damaged")]
    Impossible {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        place: String,
        #[doc(hidden)]
        found: String,
        #[doc(hidden)]
        expected: &'static str,
        #[doc(hidden)]
        others: usize,
    },
}
