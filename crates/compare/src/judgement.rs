//! Words for an error beside its noise floor, and the digits of numbers.

use crate::{AgainstFloor, Grade};

impl AgainstFloor {
    /// Grade of the error by its floor alone.
    pub fn grade(&self) -> Grade {
        Grade::of(self.held_out_error, self.floor.map(|f| f.noise_floor), self.floor.and_then(|f| f.ci95))
    }

    /// `4.4 times the noise floor of 0.0108 N (0.00916 to 0.0128)`; within the interval it says so.
    pub fn ratio_in_words(&self) -> String {
        let Some(floor) = &self.floor else { return "the noise floor is not known".to_owned() };
        let floor_n = floor_in_words(floor.noise_floor, floor.ci95);
        let within = if self.grade() == Grade::AtFloor { ", within its interval" } else { "" };
        match self.times_floor {
            Some(times) => format!("{} times the noise floor of {floor_n}{within}", significant(times, 2)),
            None => format!("noise floor {floor_n}"),
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
