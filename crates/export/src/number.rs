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
    fn regress_text_of_odd_numbers() {
        assert_eq!(fixed(-0.000_000_1, 3), "0");
        assert_eq!(fixed(120.0, 0), "120");
        assert_eq!(fixed(1.250, 4), "1.25");
        assert_eq!(fixed(f64::NAN, 2), "NaN");
        assert_eq!(exact(-0.0), "0");
        assert_eq!(joined(&[0.1, -2.0]), "0.1 -2");
    }
}
