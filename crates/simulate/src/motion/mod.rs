//! Prescribed motion: smooth curves, rotation vectors, and the chart that converts them to a
//! model's `q, v, a`.

pub mod chart;
pub mod curve;
pub mod so3;

pub use chart::Chart;
pub use curve::{Jet, Piecewise, Quintic, Spline};
