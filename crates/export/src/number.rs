//! Formats numbers as text: no negative zero, `NaN` for missing values.

/// With the given number of decimals, trailing zeros removed.
pub(crate) fn fixed(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return "NaN".to_owned();
    }
    let mut text = format!("{value:.decimals$}");
    if text.contains('.') {
        text.truncate(text.trim_end_matches('0').trim_end_matches('.').len());
    }
    if text == "-0" { "0".to_owned() } else { text }
}

/// A value and the half-width of its 95 % interval with the digits that the half-width warrants:
/// two of it, and the same decimals of the value. Three digits, and no half-width, where there is
/// none.
pub fn with_half(value: f64, half: Option<f64>) -> String {
    let decimals = |x: f64, digits: i32| (digits - 1 - x.abs().log10().floor() as i32).clamp(0, 9) as usize;
    match half.filter(|h| h.is_finite() && *h > 0.0) {
        Some(h) => {
            // rounding may raise the half-width to the next power of ten
            let rounded: f64 = format!("{h:.1e}").parse().unwrap_or(h);
            let decimals = decimals(rounded, 2);
            let text = format!("{value:.decimals$} ± {h:.decimals$}");
            // no negative zero
            let zero = format!("-{:.decimals$} ", 0.0);
            if text.starts_with(&zero) { text.trim_start_matches('-').to_owned() } else { text }
        }
        None if value.is_finite() && value != 0.0 => format!("{value:.*}", decimals(value, 3)),
        None => fixed(value, 0),
    }
}

/// With enough digits to read back the same number.
pub(crate) fn exact(value: f64) -> String {
    if !value.is_finite() {
        return "NaN".to_owned();
    }
    // avoid "-0", which looks like a defect
    format!("{}", value + 0.0)
}

/// Several numbers separated by blanks.
pub(crate) fn joined(values: &[f64]) -> String {
    values.iter().map(|v| exact(*v)).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_has_the_digits_that_its_interval_warrants() {
        for (value, half, text) in [
            (7.423_456, Some(0.1834), "7.42 ± 0.18"),
            (7.423_456, Some(1.8), "7.4 ± 1.8"),
            (74.2, Some(18.3), "74 ± 18"),
            (0.012_341, Some(0.000_99), "0.01234 ± 0.00099"),
            (-0.000_2, Some(0.014), "0.000 ± 0.014"),
            (-0.02, Some(0.014), "-0.020 ± 0.014"),
            (1.0, Some(0.0996), "1.00 ± 0.10"),
            (7.423_456, None, "7.42"),
            (-0.012_341, None, "-0.0123"),
            (0.0, None, "0"),
            (1.5, Some(f64::NAN), "1.50"),
        ] {
            assert_eq!(with_half(value, half), text);
        }
    }

    #[test]
    fn regress_text_of_odd_numbers() {
        assert_eq!(fixed(-0.000_000_1, 3), "0");
        assert_eq!(fixed(120.0, 0), "120");
        assert_eq!(fixed(1.250, 4), "1.25");
        assert_eq!(fixed(f64::NAN, 2), "NaN");
        assert_eq!(exact(-0.0), "0");
        assert_eq!(joined(&[0.1, -2.0]), "0.1 -2");
    }
}
