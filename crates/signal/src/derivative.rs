//! Finite-difference derivatives.

/// First and second derivative by fourth-order central differences (one-sided of the same order at the ends of every NaN-free run).
pub fn derivatives(_signal: &[f64], _rate_hz: f64) -> (Vec<f64>, Vec<f64>) {
    todo!()
}
