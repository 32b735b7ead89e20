//! Formats numbers and names as text.

pub use aloft_analysis::wording::unit;
use aloft_compare::significant;
use aloft_identify::half_of;
use aloft_page::{Card, Light};

/// A number with a sensible number of digits; a dash if it is missing.
pub fn number(x: f64) -> String {
    if !x.is_finite() {
        return "–".to_owned();
    }
    let a = x.abs();
    if a >= 100.0 {
        format!("{x:.0}")
    } else if a >= 10.0 {
        format!("{x:.1}")
    } else if a >= 0.1 {
        format!("{x:.2}")
    } else if a >= 0.001 {
        format!("{x:.4}")
    } else if a == 0.0 {
        "0".to_owned()
    } else if a >= 1e-6 {
        significant(x, 3)
    } else {
        format!("{x:.2e}")
    }
}

/// The number, or a dash if it is missing.
pub fn maybe(x: Option<f64>) -> String {
    x.map_or_else(|| "–".to_owned(), number)
}

/// Three components as text.
pub fn three(v: &[f64; 3]) -> String {
    v.iter().map(|x| number(*x)).collect::<Vec<_>>().join("  ")
}

/// Value and half-width of its 95 % interval, if it has one.
pub fn plus_minus(value: f64, ci95: Option<[f64; 2]>) -> String {
    half_of(ci95).map_or_else(|| number(value), |half| with_half(value, half))
}

/// Value and half-width of an interval about it, both to the second digit of the half-width. One at
/// rounding level is shown as zero.
pub fn with_half(value: f64, half: f64) -> String {
    if !value.is_finite() || !half.is_finite() || half.abs() < 1e-9 * value.abs() {
        return format!("{} ± {}", number(value), if half.is_finite() { "0" } else { "–" });
    }
    let decimals = if half > 0.0 { (1.0 - half.log10().floor()).clamp(0.0, 9.0) as usize } else { 4 };
    format!("{value:.decimals$} ± {half:.decimals$}")
}

/// `1 flight`, `2 flights`.
pub fn count(n: usize, one: &str) -> String {
    if n == 1 { format!("1 {one}") } else { format!("{n} {one}s") }
}

/// An identifier that is valid in a link: letters, digits and hyphens.
pub fn anchor(prefix: &str, name: &str) -> String {
    let clean: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
    format!("{prefix}-{clean}")
}

/// A name short enough for a heading: up to the first comma or bracket, and at most one line long.
pub fn short(name: &str) -> String {
    let head = name.split([',', '(', ';']).next().unwrap_or(name).trim();
    if head.chars().count() <= 48 {
        head.to_owned()
    } else {
        format!("{}…", head.chars().take(47).collect::<String>())
    }
}

/// A text of at most `most` characters, cut between words.
pub fn at_words(text: &str, most: usize) -> String {
    let Some((end, _)) = text.char_indices().nth(most) else { return text.to_owned() };
    let head = text[..end].rsplit_once(' ').map_or(&text[..end], |(head, _)| head);
    format!("{}…", head.trim_end_matches([',', ';', ':']))
}

/// A card with one figure of merit.
pub fn card(label: &str, value: String, note: impl Into<String>, light: Light) -> Card {
    Card { label: label.to_owned(), value, note: note.into(), light, word: String::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_are_short_and_anchors_are_clean() {
        assert_eq!(short("two-link chain, one hinge with bearings"), "two-link chain");
        assert_eq!(short(&"x".repeat(80)).chars().count(), 48);
        assert_eq!(anchor("trial", "s01/jump 1"), "trial-s01-jump-1");
    }

    #[test]
    fn long_texts_end_between_words() {
        assert_eq!(at_words("no longer than this", 19), "no longer than this");
        assert_eq!(at_words("the static trial, and more", 19), "the static trial…");
        assert_eq!(at_words("ünïcödé", 3), "ünï…");
    }

    #[test]
    fn units_are_written_as_people_write_them() {
        assert_eq!([unit("N*s^2/m"), unit("1")], ["N·s²/m", ""]);
    }

    #[test]
    fn missing_numbers_are_dashes() {
        assert_eq!(number(f64::NAN), "–");
        assert_eq!(plus_minus(1.0, None), "1.00");
        assert_eq!(plus_minus(1.0, Some([0.9, 1.1])), "1.00 ± 0.10");
        assert_eq!(with_half(0.018_312, 0.000_862), "0.01831 ± 0.00086");
        assert_eq!(with_half(51.8, 18.6), "52 ± 19");
        assert_eq!(with_half(2.0, 1e-12), "2.00 ± 0");
    }
}
