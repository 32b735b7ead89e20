//! Judgement of an error by its ratio to the noise floor, and the words for both. Text, report and
//! JSON use these words; the limits are those of [`aloft_regressor`].

use crate::AgainstFloor;
use aloft_regressor::{FAIR_TIMES_FLOOR, POOR_TIMES_FLOOR};
use serde::{Deserialize, Serialize};

/// Judgement of a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Signal {
    /// No judgement: the floor is not known.
    Unknown,
    /// At the floor: within its interval and below three times its value.
    Good,
    /// Above the floor's interval, below three times the floor.
    Fair,
    /// Three times the floor or more, even within a wide interval.
    Poor,
}

impl Signal {
    /// From the ratio of error to floor and whether the error is within the floor's interval.
    pub fn of(times_floor: Option<f64>, at_floor: Option<bool>) -> Self {
        match (times_floor, at_floor) {
            (Some(times), _) if !times.is_finite() => Self::Unknown,
            (None, _) => Self::Unknown,
            (Some(times), _) if times >= POOR_TIMES_FLOOR => Self::Poor,
            (Some(_), Some(true)) => Self::Good,
            (Some(times), None) if times < FAIR_TIMES_FLOOR => Self::Good,
            _ => Self::Fair,
        }
    }

    /// The judgement of a result whose gate did not pass: at best fair.
    #[must_use]
    pub fn behind_gate(self, passed: bool) -> Self {
        if !passed && self == Self::Good { Self::Fair } else { self }
    }

    /// Judgement of an error in words, the same on every surface: `at the floor`, `fair`, `poor`,
    /// `not judged`.
    pub fn in_words(self, at_floor: Option<bool>) -> &'static str {
        match (self, at_floor) {
            (Self::Unknown, _) => "not judged",
            (Self::Good, Some(true)) => "at the floor",
            // only a gate that did not pass makes an error at the floor fair
            (Self::Fair, Some(true)) => "at the floor, from tables",
            (signal, _) => signal.word(),
        }
    }

    /// Word in tables.
    pub fn word(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Poor => "poor",
        }
    }
}

impl AgainstFloor {
    /// Judgement of the error, without the gate.
    pub fn signal(&self) -> Signal {
        Signal::of(self.times_floor, self.at_floor)
    }

    /// `4.4 times the noise floor of 0.0108 N (0.00916 to 0.0128)`, `at the noise floor of …`.
    pub fn ratio_in_words(&self) -> String {
        let Some(floor) = &self.floor else { return "the noise floor is not known".to_owned() };
        let floor_n = floor_in_words(floor.noise_floor, floor.ci95);
        match (self.times_floor, self.at_floor) {
            (_, Some(true)) => format!("at the noise floor of {floor_n}"),
            (Some(times), _) => format!("{} times the noise floor of {floor_n}", significant(times, 2)),
            _ => format!("noise floor {floor_n}"),
        }
    }
}

/// The noise floor with its interval: `0.0108 N (0.00916 to 0.0128)`.
pub fn floor_in_words(noise_floor: f64, ci95: Option<[f64; 2]>) -> String {
    if !noise_floor.is_finite() {
        return "unknown (no comparison was made)".to_owned();
    }
    let interval = ci95.map_or(String::new(), |[a, b]| format!(" ({} to {})", significant(a, 3), significant(b, 3)));
    format!("{} N{interval}", significant(noise_floor, 3))
}

/// A number with this many significant digits; a dash for a missing one.
pub fn significant(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    // rounding may raise the number to the next power of ten: 9.996 becomes 10.0, not 10.00
    let rounded: f64 = format!("{value:.*e}", digits.saturating_sub(1)).parse().unwrap_or(value);
    let magnitude = rounded.abs().log10().floor() as i32;
    if magnitude < -6 {
        return format!("{value:.*e}", digits.saturating_sub(1));
    }
    let decimals = (digits as i32 - 1 - magnitude).clamp(0, 12) as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_word_is_stronger_than_the_signal() {
        let gate_failed = Signal::of(Some(1.1), Some(true)).behind_gate(false);
        assert_eq!(gate_failed.in_words(Some(true)), "at the floor, from tables");
        assert_eq!(Signal::of(Some(1.1), Some(true)).in_words(Some(true)), "at the floor");
        assert_eq!(Signal::of(Some(3.5), Some(true)).in_words(Some(true)), "poor", "within a wide interval");
        assert_eq!(Signal::of(Some(1.6), Some(false)).in_words(Some(false)), "fair");
        assert_eq!(Signal::of(None, None).in_words(None), "not judged");
    }

    #[test]
    fn an_error_is_judged_by_its_floor_and_never_by_newtons() {
        for (times, at, signal) in [
            (None, None, Signal::Unknown),
            (Some(f64::INFINITY), Some(false), Signal::Unknown),
            (Some(1.2), Some(false), Signal::Fair),
            (Some(1.2), None, Signal::Good),
            (Some(1.6), Some(true), Signal::Good),
            (Some(1.6), Some(false), Signal::Fair),
            (Some(3.0), Some(false), Signal::Poor),
            (Some(116.0), None, Signal::Poor),
            (Some(4.0), Some(true), Signal::Poor),
        ] {
            assert_eq!(Signal::of(times, at), signal, "{times:?} {at:?}");
        }
        assert_eq!(Signal::Good.behind_gate(false), Signal::Fair);
        assert_eq!(Signal::Poor.behind_gate(false), Signal::Poor);
        assert_eq!(Signal::Good.behind_gate(true), Signal::Good);
    }

    #[test]
    fn numbers_have_the_digits_that_were_asked_for() {
        for (value, digits, text) in [
            (0.047_94, 3, "0.0479"),
            (29.24, 3, "29.2"),
            (9.996, 3, "10.0"),
            (0.099_96, 3, "0.100"),
            (1234.0, 3, "1234"),
            (0.0, 3, "0"),
            (f64::NAN, 3, "–"),
            (-2.5, 2, "-2.5"),
            (1.0e-9, 3, "1.00e-9"),
        ] {
            assert_eq!(significant(value, digits), text);
        }
    }
}
