//! Welch's method compared with scipy's reference values (`tests/peers/signal_scipy.py`).
#![allow(clippy::unwrap_used, reason = "a golden that cannot be read fails the test")]

use aloft_signal::welch;

fn numbers(v: &serde_json::Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

#[test]
fn validate_welch_equals_scipy() {
    let path = format!("{}/../../fixtures/goldens/signal_welch.json", env!("CARGO_MANIFEST_DIR"));
    let golden: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    for case in golden["cases"].as_array().unwrap() {
        let x = numbers(&case["x"]);
        let spectrum = welch(&x, case["rate_hz"].as_f64().unwrap(), case["segment"].as_u64().unwrap() as usize);
        let density = numbers(&case["density"]);
        assert_eq!(spectrum.density.len(), density.len());
        let top = density.iter().fold(0.0f64, |m, d| m.max(*d));
        for (i, (found, want)) in spectrum.density.iter().zip(&density).enumerate() {
            assert!((found - want).abs() < 1e-12 * top, "bin {i}: {found} {want}");
        }
        for (found, want) in spectrum.frequency_hz.iter().zip(numbers(&case["frequency_hz"])) {
            assert!((found - want).abs() < 1e-12);
        }
    }
}
