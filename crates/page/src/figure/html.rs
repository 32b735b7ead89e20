//! Pieces of HTML that figures without a script are made of.

/// Text that is safe inside an element or an attribute.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;").replace('\'', "&#39;")
}

/// A number with three significant digits; empty if it is missing.
pub(crate) fn short(v: f64) -> String {
    let a = v.abs();
    if !v.is_finite() {
        String::new()
    } else if a >= 100.0 {
        format!("{v:.0}")
    } else if a >= 10.0 {
        format!("{v:.1}")
    } else if a >= 1.0 || a == 0.0 {
        format!("{v:.2}")
    } else if a >= 0.001 {
        format!("{:.*}", 2 + (-a.log10()).floor() as usize + usize::from(a < 0.1), v)
    } else {
        format!("{v:.1e}")
    }
}

/// Round numbers from `low` to `high`, at most `most` of them.
pub(crate) fn ticks(low: f64, high: f64, most: usize) -> Vec<f64> {
    if low.partial_cmp(&high) != Some(std::cmp::Ordering::Less) || most < 2 {
        return vec![low];
    }
    let raw = (high - low) / (most as f64 - 1.0);
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|s| s * power).find(|s| *s >= raw * 0.999).unwrap_or(10.0 * power);
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    (first..=last).map(|k| k as f64 * step).collect()
}

/// A round number without superfluous zeros.
pub(crate) fn tick(v: f64) -> String {
    let text = format!("{v:.6}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if v != 0.0 && v.abs() < 1e-4 {
        format!("{v:.0e}")
    } else if text == "-0" {
        "0".to_owned()
    } else {
        text.to_owned()
    }
}

/// Percent with two decimals, for positions in styles.
pub(crate) fn percent(share: f64) -> String {
    format!("{:.2}%", 100.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks(0.0, 1.07, 6), vec![0.0, 0.5, 1.0]);
        assert_eq!(ticks(-3.0, 12.0, 6), vec![0.0, 5.0, 10.0]);
        assert_eq!(ticks(0.2, 0.2, 6), vec![0.2]);
        assert_eq!([tick(0.5), tick(20.0), tick(-0.0), tick(2e-5)], ["0.5", "20", "0", "2e-5"]);
    }

    #[test]
    fn numbers_keep_three_digits() {
        assert_eq!([short(0.0123), short(0.5), short(12.34), short(456.7)], ["0.0123", "0.50", "12.3", "457"]);
        assert_eq!(escape("<a href=\"x\">&'"), "&lt;a href=&quot;x&quot;&gt;&amp;&#39;");
    }
}
