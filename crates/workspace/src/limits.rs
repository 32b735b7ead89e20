//! Limits of quality beyond which results are flagged, in one place for summary, warnings and
//! report.

/// Marker error of inverse kinematics (RMS), mm: good below the first, poor above the second, which
/// is the usual limit (best practices of OpenSim).
pub const MARKER_RMS_MM: [f64; 2] = [10.0, 20.0];
/// Deviation of markers of the static trial from their rigid segments (RMS), mm.
pub const SCALING_MM: f64 = 10.0;
/// Deviation of the acceleration in flight from g, percent: table inertias alone reach one or two.
pub const FREE_FALL_PERCENT: [f64; 2] = [3.0, 10.0];
/// Share of marker samples that were never measured, percent.
pub const MISSING_PERCENT: [f64; 2] = [5.0, 20.0];
/// Ratio of the two smallest singular values: below the first the parameters are not determined,
/// from the second they are clearly.
pub const SIGMA_RATIO: [f64; 2] = [3.0, 20.0];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::qc::QcReason;

    /// The explanations of warnings state these limits.
    #[test]
    fn explanations_state_the_limits() {
        let states = |r: QcReason, mm: f64| assert!(r.meaning().contains(&format!("{mm} mm")), "{}", r.meaning());
        states(QcReason::IkErrorLarge, MARKER_RMS_MM[1]);
        states(QcReason::ScalingErrorLarge, SCALING_MM);
    }
}
