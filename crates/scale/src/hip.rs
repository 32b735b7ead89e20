//! The pelvis from its markers, and the hip joint centre by published regressions.
//!
//! Pelvis axes: origin midway between the ASIS, z to the right along them, x forward in the plane
//! of ASIS and PSIS, y up.

use crate::ScaleError;
use crate::geometry::{axes_z_x, axes_z_y, reject, unit};
use crate::landmarks::{Landmarks, Side};
use aloft_body::Sex;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Method for hip joint centres if the recording contains no derived ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HipMethod {
    /// Harrington, Zavatsky, Lawson, Yuan, Theologis, *J Biomech* 40 (2007) 595: pelvis depth,
    /// width and leg length; its own single-predictor form (width) where no leg length is known.
    /// Leave-one-out error 5.2, 3.6, 3.2 mm.
    #[default]
    Harrington,
    /// Bell, Pedersen, Brand, *J Biomech* 23 (1990) 617: pelvis width. Published error 19 mm.
    Bell,
    /// Hara, McGinley, Briggs, Baker, Sangeux, *Sci Rep* 6 (2016) 37707: leg length. Leave-one-out
    /// error 5.2, 4.4, 3.8 mm.
    Hara,
    /// Davis, Õunpuu, Tyburski, Gage, *Hum Mov Sci* 10 (1991) 575: leg length and width; the
    /// ASIS-trochanter distance by the usual regression 0.1288 LL − 48.56 mm.
    Davis,
}

/// The pelvis from its four (or three) markers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PelvisMarkers {
    /// Pelvis axes in the world, origin midway between the ASIS.
    pub world_from_pelvis: Isometry3<f64>,
    /// Distance of the ASIS, m.
    pub width_m: f64,
    /// Distance from mid-ASIS to mid-PSIS, m.
    pub depth_m: f64,
}

impl PelvisMarkers {
    /// From ASIS and PSIS; the sacrum replaces the middle of the PSIS, and a single PSIS is
    /// mirrored.
    ///
    /// Where neither ASIS is marked, the pelvis follows from given hip centres and a point above
    /// it.
    ///
    /// # Errors
    /// [`ScaleError::MissingLandmarks`] without both ASIS and anything behind them;
    /// [`ScaleError::Degenerate`] when they lie on a line.
    pub(crate) fn from_landmarks(landmarks: &Landmarks, trial: &str) -> Result<Self, ScaleError> {
        let marked = |side| landmarks.side("asis", side).is_some();
        if !marked(Side::Right)
            && !marked(Side::Left)
            && let Some(pelvis) = Self::from_hip_centres(landmarks)
        {
            return Ok(pelvis);
        }
        let missing = || ScaleError::MissingLandmarks {
            trial: trial.into(),
            what: "the pelvis".into(),
            need: "asis_l, asis_r and psis_l, psis_r or sacrum".into(),
            found: landmarks.names(),
        };
        let degenerate = || ScaleError::Degenerate {
            trial: trial.into(),
            what: "the pelvis".into(),
            problem: "ASIS and PSIS lie on one line".into(),
        };
        let right = landmarks.side("asis", Side::Right).ok_or_else(missing)?;
        let left = landmarks.side("asis", Side::Left).ok_or_else(missing)?;
        let middle = (right + left) / 2.0;
        let z = unit(&(right - left)).ok_or_else(degenerate)?;
        let one_sided = || {
            // With one PSIS only the component in the sagittal plane is used.
            let p = landmarks.side("psis", Side::Right).or_else(|| landmarks.side("psis", Side::Left))?;
            Some(middle + reject(&(p - middle), &z))
        };
        let back =
            landmarks.across("psis").or_else(|| landmarks.get("sacrum")).or_else(one_sided).ok_or_else(missing)?;
        let axes = axes_z_x(&z, &(middle - back)).ok_or_else(degenerate)?;
        Ok(Self {
            world_from_pelvis: Isometry3::from_parts(middle.into(), axes),
            width_m: (right - left).norm(),
            depth_m: (middle - back).norm(),
        })
    }

    /// From given hip centres, which markerless software states, and a point above them: of the
    /// pelvis itself, or the neck or the shoulders of a person who stands, or else the vertical.
    /// Width and place of the ASIS are those for which Harrington's regression gives these hip
    /// centres; their plane is tilted forwards against the vertical of the pelvis as in standing.
    fn from_hip_centres(landmarks: &Landmarks) -> Option<Self> {
        let (right, left) = (landmarks.side("hip_centre", Side::Right)?, landmarks.side("hip_centre", Side::Left)?);
        let middle = (right + left) / 2.0;
        let above = landmarks
            .get("pelvis_up")
            .or_else(|| landmarks.get("neck_centre"))
            .or_else(|| landmarks.across("shoulder_centre"))
            .or_else(|| landmarks.across("acromion"))
            .unwrap_or_else(|| middle + Vector3::z());
        let upright = axes_z_y(&(right - left), &(above - middle))?;
        let axes = upright * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -STANDING_TILT_RAD);
        let width_m = ((right - left).norm() / 2.0 - 0.0073) / 0.33;
        if width_m < LEAST_WIDTH_M {
            return None;
        }
        let depth_m = DEPTH_OF_WIDTH * width_m;
        let hips = Vector3::new(-0.24 * depth_m - 0.0099, -0.30 * width_m - 0.0109, 0.0);
        let origin = middle - axes * hips;
        Some(Self { world_from_pelvis: Isometry3::from_parts(origin.into(), axes), width_m, depth_m })
    }
}

/// Forward tilt of the plane of ASIS and PSIS in standing: about 10° in adults.
const STANDING_TILT_RAD: f64 = 0.175;
/// Depth of the pelvis (ASIS to PSIS) as a share of its width in adults, rounded.
const DEPTH_OF_WIDTH: f64 = 0.6;
/// Smallest width that a pelvis can have, m.
const LEAST_WIDTH_M: f64 = 0.08;

/// Hip joint centre in pelvis axes, m. `leg_length_m` runs from the ASIS to the medial malleolus;
/// `marker_radius_m` enters Davis only.
///
/// Returns `None` for [`HipMethod::Hara`] and [`HipMethod::Davis`] without a leg length.
pub fn hip_centre(
    method: HipMethod,
    pelvis: &PelvisMarkers,
    leg_length_m: Option<f64>,
    marker_radius_m: f64,
    side: Side,
) -> Option<Vector3<f64>> {
    let (width, depth) = (pelvis.width_m, pelvis.depth_m);
    let right = match method {
        HipMethod::Harrington => match leg_length_m {
            Some(leg) => Vector3::new(
                -0.24 * depth - 0.0099,
                -0.16 * width - 0.04 * leg - 0.0071,
                0.28 * depth + 0.16 * width + 0.0079,
            ),
            None => Vector3::new(-0.24 * depth - 0.0099, -0.30 * width - 0.0109, 0.33 * width + 0.0073),
        },
        HipMethod::Bell => Vector3::new(-0.19 * width, -0.30 * width, 0.36 * width),
        HipMethod::Hara => {
            let leg = leg_length_m?;
            Vector3::new(0.011 - 0.063 * leg, -0.009 - 0.078 * leg, 0.008 + 0.086 * leg)
        }
        HipMethod::Davis => {
            let leg = leg_length_m?;
            let c = 0.115 * leg - 0.0153;
            let (sin_theta, cos_theta) = 28.4_f64.to_radians().sin_cos();
            let (sin_beta, cos_beta) = 18.0_f64.to_radians().sin_cos();
            let back = -(0.1288 * leg - 0.04856) - marker_radius_m;
            Vector3::new(
                back * cos_beta + c * cos_theta * sin_beta,
                back * sin_beta - c * cos_theta * cos_beta,
                width / 2.0 - c * sin_theta,
            )
        }
    };
    Some(Vector3::new(right.x, right.y, side.sign() * right.z))
}

/// Lumbar joint (L5/S1) in pelvis axes, m: fractions of pelvis width after Reed 1999 in the
/// ASIS-PSIS frame, as given by Dumas and Wojtusch 2018; the mean of both for an unknown sex.
pub(crate) fn lumbar_centre(pelvis: &PelvisMarkers, sex: Option<Sex>) -> Vector3<f64> {
    let female = Vector3::new(-0.340, 0.049, 0.0);
    let male = Vector3::new(-0.335, -0.032, 0.0);
    pelvis.width_m
        * match sex {
            Some(Sex::Female) => female,
            Some(Sex::Male) => male,
            None => (female + male) / 2.0,
        }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn landmarks() -> Landmarks {
        let mut l = Landmarks::default();
        for (name, p) in [
            ("asis_r", [0.0, -0.12, 1.0]),
            ("asis_l", [0.0, 0.12, 1.0]),
            ("psis_r", [-0.15, -0.05, 1.0]),
            ("psis_l", [-0.15, 0.05, 1.0]),
        ] {
            l.positions.insert(name.into(), Vector3::from(p));
        }
        l
    }

    #[test]
    fn pelvis_axes_point_forward_up_and_right() {
        let p = PelvisMarkers::from_landmarks(&landmarks(), "made").unwrap();
        let r = p.world_from_pelvis.rotation.to_rotation_matrix().into_inner();
        assert!((r.column(0) - Vector3::x()).norm() < 1e-12);
        assert!((r.column(1) - Vector3::z()).norm() < 1e-12);
        assert!((r.column(2) + Vector3::y()).norm() < 1e-12);
        assert!((p.width_m - 0.24).abs() < 1e-12 && (p.depth_m - 0.15).abs() < 1e-12);
    }

    #[test]
    fn one_psis_or_a_sacrum_gives_the_same_axes() {
        let full = PelvisMarkers::from_landmarks(&landmarks(), "made").unwrap();
        let mut l = landmarks();
        l.positions.remove("psis_l");
        assert!((PelvisMarkers::from_landmarks(&l, "made").unwrap().depth_m - full.depth_m).abs() < 1e-12);
        l.positions.remove("psis_r");
        assert!(matches!(PelvisMarkers::from_landmarks(&l, "made"), Err(ScaleError::MissingLandmarks { .. })));
        l.positions.insert("sacrum".into(), Vector3::new(-0.15, 0.0, 1.0));
        assert_eq!(PelvisMarkers::from_landmarks(&l, "made").unwrap().depth_m, full.depth_m);
    }

    /// Calculated by hand from the published equations in mm: PW 240, PD 150, LL 900, marker radius
    /// 7.
    #[test]
    fn validate_regressions_against_hand_computed_values() {
        let p = PelvisMarkers::from_landmarks(&landmarks(), "made").unwrap();
        let at = |m, leg| hip_centre(m, &p, leg, 0.007, Side::Right).unwrap() * 1000.0;
        let close = |a: Vector3<f64>, b: [f64; 3]| assert!((a - Vector3::from(b)).norm() < 0.02, "{a:?} {b:?}");
        close(at(HipMethod::Harrington, Some(0.9)), [-45.9, -81.5, 88.3]);
        close(at(HipMethod::Harrington, None), [-45.9, -82.9, 86.5]);
        close(at(HipMethod::Bell, None), [-45.6, -72.0, 86.4]);
        close(at(HipMethod::Hara, Some(0.9)), [-45.7, -79.2, 85.4]);
        close(at(HipMethod::Davis, Some(0.9)), [-46.75, -96.77, 78.05]);
        let left = hip_centre(HipMethod::Bell, &p, None, 0.007, Side::Left).unwrap();
        assert!(left.z < 0.0);
        assert!(hip_centre(HipMethod::Hara, &p, None, 0.007, Side::Left).is_none());
    }
}
