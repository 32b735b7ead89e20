//! Numbers and cards as text.

use aloft_report::{Card, Light};

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
    } else {
        format!("{x:.2e}")
    }
}

pub fn three(v: &[f64; 3]) -> String {
    v.iter().map(|x| number(*x)).collect::<Vec<_>>().join("  ")
}

pub fn card(label: &str, value: String, note: String, light: Light) -> Card {
    Card { label: label.to_owned(), value, note, light }
}
