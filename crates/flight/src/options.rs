//! How flights are found.

use serde::{Deserialize, Serialize};

/// Which evidence counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FlightMethod {
    /// Both where both exist, else what there is.
    #[default]
    Auto,
    /// Plates alone.
    Plates,
    /// Motion alone.
    Motion,
}

/// Thresholds of the search. Times in seconds, so that they hold at any rate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FlightOptions {
    /// Evidence.
    pub method: FlightMethod,
    /// Size of the stated gravity, m/s²; a search with a model takes the model's.
    pub gravity_mps2: f64,
    /// A plate is loaded above this force, N (after tare).
    pub threshold_n: f64,
    /// Shortest flight, s.
    pub min_duration_s: f64,
    /// Longest flight, s: beyond it nobody falls. Where the free acceleration is below standard gravity, the limit is longer by
    /// `√(9.81 m/s² / acceleration)`, the factor by which the same jump takes longer there.
    pub max_duration_s: f64,
    /// Low-pass on the centre of mass before its acceleration is taken, Hz (zero phase, second order).
    pub com_cutoff_hz: f64,
    /// Acceleration of the centre of mass may differ from the free acceleration by this share of it, along it.
    pub vertical_band_g: f64,
    /// The same, across it.
    pub horizontal_band_g: f64,
    /// The band is at least this wide, m/s² (but never wide enough to reach two thirds of the way to rest): where gravity is weak, the
    /// error of the centre of mass does not become smaller with it.
    pub least_band_mps2: f64,
    /// In zero gravity the centre of mass of a free body may accelerate by this, m/s².
    pub rest_band_mps2: f64,
    /// Free accelerations below this share of the stated gravity are not sought (metres stated as millimetres give 0.001).
    pub least_free_g: f64,
    /// Shortest flight that an acceleration other than the stated gravity is taken from where no plate confirms it, s.
    pub min_free_duration_s: f64,
    /// Interruptions up to this long inside a flight are noise, s.
    pub merge_s: f64,
    /// Taken off the start of what motion tells, s. The low-pass smears contact over about ±10 ms, and a hand or foot lets go
    /// gradually: without this, measured starts lie 0 to 3 frames of 5 ms before the true one.
    pub takeoff_guard_s: f64,
    /// Taken off the end of what motion tells, s; without it, measured ends lie up to 2 frames of 5 ms behind the true one.
    pub landing_guard_s: f64,
    /// Taken off both ends of what plates tell, s: the last newtons of a push are lost in their noise.
    pub plate_guard_s: f64,
    /// Fit the first moments of the links to the parabola of the centre of mass in the flights before the final search.
    pub refine: bool,
    /// Standard deviation of a link's prior centre of mass in that fit, m.
    pub com_prior_sd_m: f64,
    /// Stature of the person, m, where it is known; tells a false unit of length from a false frame rate.
    pub stature_m: Option<f64>,
    /// Standard deviation of the ratio between measured and stated free acceleration that all flights of a subject share (masses of the
    /// prior, joint centres, soft tissue); widens the interval of that ratio.
    pub ratio_sd: f64,
    /// Frames taken off both ends of every flight, for filter edges (the paper's rows) or caution.
    pub margin_frames: usize,
}

impl Default for FlightOptions {
    fn default() -> Self {
        Self {
            method: FlightMethod::Auto,
            gravity_mps2: aloft_body::STANDARD_GRAVITY_MPS2,
            threshold_n: 20.0,
            min_duration_s: 0.12,
            max_duration_s: 2.0,
            com_cutoff_hz: 15.0,
            vertical_band_g: 0.3,
            horizontal_band_g: 0.3,
            least_band_mps2: 1.0,
            rest_band_mps2: 0.5,
            least_free_g: 5e-4,
            min_free_duration_s: 0.2,
            merge_s: 0.05,
            takeoff_guard_s: 0.015,
            landing_guard_s: 0.010,
            plate_guard_s: 0.005,
            refine: true,
            com_prior_sd_m: 0.02,
            stature_m: None,
            ratio_sd: 0.01,
            margin_frames: 0,
        }
    }
}
