//! Options of the search for flights.

use serde::{Deserialize, Serialize};

/// Evidence to use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FlightMethod {
    /// Both if available, otherwise the one that is.
    #[default]
    Auto,
    /// Plates alone.
    Plates,
    /// Motion alone.
    Motion,
    /// Flights that are stated, from and to in seconds from the first frame
    /// ([`FlightOptions::stated_s`]); without any, the whole recording.
    Stated,
}

/// Thresholds of the search. Times are in seconds, so that they are valid at any rate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FlightOptions {
    /// Evidence.
    pub method: FlightMethod,
    /// Flights stated by hand, s from the first frame; for [`FlightMethod::Stated`].
    pub stated_s: Vec<[f64; 2]>,
    /// Magnitude of the stated gravity, m/s²; a search with a model uses that of the model.
    pub gravity_mps2: f64,
    /// A plate is loaded above this force, N (after tare).
    pub threshold_n: f64,
    /// Shortest flight, s.
    pub min_duration_s: f64,
    /// Longest flight, s. If the free acceleration is below standard gravity, the limit is longer
    /// by `√(9.81 m/s² / acceleration)`, the factor by which the same jump takes longer there.
    pub max_duration_s: f64,
    /// Low-pass on the centre of mass before its acceleration is taken, Hz (zero phase, second
    /// order).
    pub com_cutoff_hz: f64,
    /// Tolerated deviation of the centre of mass' acceleration from the free acceleration, as a
    /// fraction of it, along its direction.
    pub vertical_band_g: f64,
    /// The same, perpendicular to it.
    pub horizontal_band_g: f64,
    /// Minimum width of the band, m/s² (but never wide enough to reach two thirds of the way to
    /// rest): the error of the centre of mass does not decrease in weak gravity.
    pub least_band_mps2: f64,
    /// Tolerated acceleration of the centre of mass of a free body in zero gravity, m/s².
    pub rest_band_mps2: f64,
    /// Free accelerations below this fraction of the stated gravity are not considered (metres
    /// stated as millimetres give 0.001).
    pub least_free_g: f64,
    /// Shortest flight, without confirmation by plates, that may determine an acceleration other
    /// than the stated gravity, s.
    pub min_free_duration_s: f64,
    /// Interruptions of a flight up to this duration are treated as noise, s.
    pub merge_s: f64,
    /// Removed from the start of flights found by motion, s. The low-pass spreads contact over
    /// about ±10 ms, and a hand or foot releases gradually: without this guard, measured starts are
    /// 0 to 3 frames of 5 ms too early.
    pub takeoff_guard_s: f64,
    /// Removed from the end of flights found by motion, s; without it, measured ends are up to 2
    /// frames of 5 ms too late.
    pub landing_guard_s: f64,
    /// Removed from both ends of flights found by plates, s: the last newtons of a push disappear
    /// in the noise.
    pub plate_guard_s: f64,
    /// Fit the first moments of the links to the parabola of the centre of mass in the flights
    /// before the final search.
    pub refine: bool,
    /// Standard deviation of a link's prior centre of mass in that fit, m.
    pub com_prior_sd_m: f64,
    /// Stature of the person, m, if known; distinguishes a wrong unit of length from a wrong frame
    /// rate.
    pub stature_m: Option<f64>,
    /// Standard deviation of the error of the ratio between measured and stated free acceleration
    /// that is common to all flights of a subject (masses of the prior, joint centres, soft
    /// tissue); widens the interval of that ratio.
    pub ratio_sd: f64,
    /// Frames removed from both ends of every flight, to exclude filter edges (as for the paper's
    /// rows) or as a precaution.
    pub margin_frames: usize,
}

impl Default for FlightOptions {
    fn default() -> Self {
        Self {
            method: FlightMethod::Auto,
            stated_s: Vec::new(),
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
