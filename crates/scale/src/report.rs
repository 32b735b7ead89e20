//! Report of scaling for people: methods, lengths, marker errors, and a closed list of warnings
//! with their values.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Source of a joint centre, best first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JointMethod {
    /// A derived point of the recording (given hip centres).
    Given,
    /// Midpoint of a medial and a lateral (or radial and ulnar) marker.
    Midpoint,
    /// Functional calibration.
    Functional,
    /// Published regression from markers.
    Regression,
    /// Placed by body proportions, because no marker determines it.
    Proportion,
}

/// Uncertainty of a joint: the priors of a calibration over dynamic trials.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointUncertainty {
    /// Child link of the joint.
    pub link: String,
    /// Index of that link in the model.
    pub link_index: usize,
    /// Source of the centre.
    pub method: JointMethod,
    /// Standard deviation of the joint centre, each axis, m.
    #[serde(alias = "center_sd_m")]
    pub centre_sd_m: f64,
    /// Standard deviation of a hinge's direction, rad; `None` for joints without an axis.
    pub axis_sd_rad: Option<f64>,
}

/// One marker of the model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MarkerReport {
    /// Label.
    pub label: String,
    /// Link that carries it.
    pub link: String,
    /// Root mean square distance from its own median over the static frames, m.
    pub spread_m: f64,
    /// Root mean square distance over the static frames from its position on the rigid link (pose
    /// fitted to the link's markers frame by frame), m; `None` on links with fewer than three
    /// markers.
    pub rigid_error_m: Option<f64>,
    /// Distance to the mirror image of the same marker on the other side, in link axes, m; `None`
    /// without such a marker.
    pub asymmetry_m: Option<f64>,
}

/// A segment on both sides.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SegmentLength {
    /// Segment: `upper_arm`, `forearm`, `thigh`, `shank`, `foot` …, or central: `pelvis_width`,
    /// `hip_width`, `trunk`.
    pub segment: String,
    /// Length on the right, or of a central segment, m; `None` if its ends are not marked.
    pub right_m: Option<f64>,
    /// Length on the left, m; `None` for central segments and if its ends are not marked.
    pub left_m: Option<f64>,
    /// Length predicted from stature, m (limbs: Winter, figure 4.1; pelvis, hips and trunk: rounded
    /// values of this project); `None` without a prediction.
    pub expected_m: Option<f64>,
}

/// Full report of one scaling.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ScaleReport {
    /// Trial used.
    pub trial: String,
    /// First and last static frame used (0-based), and how many.
    pub frames: (usize, usize, usize),
    /// Median over markers of their root mean square movement in these frames, m.
    pub typical_spread_m: f64,
    /// Stature used, m.
    pub height_m: f64,
    /// True when the laboratory stated the stature.
    pub height_stated: bool,
    /// Joints and the sources of their centres.
    pub joints: Vec<JointUncertainty>,
    /// Lengths.
    pub lengths: Vec<SegmentLength>,
    /// Markers.
    pub markers: Vec<MarkerReport>,
    /// Labels of the marker set that are missing in this trial.
    pub missing_markers: Vec<String>,
    /// Names of velocity coordinates that no marker determines.
    pub locked: Vec<String>,
    /// Warnings.
    pub warnings: Vec<ScaleWarning>,
}

/// Warnings of scaling. Lengths in m, angles in degrees (for display).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
#[allow(missing_docs, reason = "the field names say it, with the sentence of each variant beside them in Display")]
#[non_exhaustive]
pub enum ScaleWarning {
    /// The marker set names a landmark outside the vocabulary.
    UnknownLandmark { marker: String, landmark: String },
    /// The marker of a landmark was not seen.
    LandmarkUnseen { marker: String, landmark: String },
    /// A tracked marker of the set is not in the static.
    MarkerUnseen { marker: String },
    /// A joint centre was placed by proportions.
    JointByProportion {
        joint: String,
        #[serde(alias = "center_sd_m")]
        centre_sd_m: f64,
    },
    /// A hinge axis without its medial marker.
    AxisAssumed { joint: String, axis_sd_rad: f64 },
    /// Right and left differ.
    Asymmetry { segment: String, right_m: f64, left_m: f64, limit_m: f64 },
    /// A length that differs strongly from the prediction by stature.
    Length { segment: String, found_m: f64, expected_m: f64, limit_ratio: f64 },
    /// A joint that is strongly bent in the static.
    Bent { joint: String, angle_deg: f64, limit_deg: f64 },
    /// A hinge axis far from perpendicular to its segment.
    Skewed { joint: String, angle_deg: f64, limit_deg: f64 },
    /// A foot that points backwards: right and left, or heel and toe, are exchanged.
    BackToFront { link: String, cosine: f64 },
    /// The lateral malleolus behind and below the heel: their labels look exchanged in the static.
    AnkleBehindHeel { ankle: String, heel: String, behind_m: f64, below_m: f64 },
    /// Landmarks of the right side are on the left.
    SidesExchanged { what: String, lateral_m: f64 },
    /// The body moved during the static.
    Moving { spread_m: f64, limit_m: f64 },
    /// Few static frames.
    FewFrames { frames: usize, limit: usize },
    /// A marker that does not keep its position on its link.
    MarkerLoose { marker: String, rigid_error_m: f64, limit_m: f64 },
    /// A pair of markers that are not mirror images.
    MarkerAsymmetry { right: String, left: String, distance_m: f64, limit_m: f64 },
    /// Stature estimated from segment lengths.
    HeightEstimated { height_m: f64 },
    /// The stated stature does not fit the markers.
    HeightDoubtful { stated_m: f64, estimated_m: f64, limit_ratio: f64 },
    /// Mass and stature are inconsistent.
    BodyMassIndex { value: f64, low: f64, high: f64 },
    /// The sex is not stated: the mean of both tables is used.
    SexUnknown,
    /// A link's prior inertia was not physically consistent.
    InertiaProjected { link: String, smallest_eigenvalue: f64 },
    /// A link without markers that determine its motion.
    Unobserved { link: String, coordinates: usize },
    /// A segment of the prior whose end points are unknown and whose length is taken from stature.
    LengthFromStature { segment: String, length_m: f64 },
}

impl fmt::Display for ScaleWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mm = |x: &f64| 1000.0 * x;
        match self {
            Self::UnknownLandmark { marker, landmark } => {
                write!(f, "marker `{marker}`: the landmark `{landmark}` is not in the vocabulary; ignored")
            }
            Self::LandmarkUnseen { marker, landmark } => {
                write!(f, "landmark `{landmark}` (marker `{marker}`) is not seen")
            }
            Self::MarkerUnseen { marker } => {
                write!(f, "marker `{marker}` is not seen in the static and will not be tracked")
            }
            Self::JointByProportion { joint, centre_sd_m } => {
                write!(
                    f,
                    "{joint}: no marker tells where it is; placed by body proportions (±{:.0} mm)",
                    mm(centre_sd_m)
                )
            }
            Self::AxisAssumed { joint, axis_sd_rad } => {
                write!(f, "{joint}: no medial marker; its axis is assumed (±{:.0}°)", axis_sd_rad.to_degrees())
            }
            Self::Asymmetry { segment, right_m, left_m, limit_m } => write!(
                f,
                "{segment}: right {:.0} mm, left {:.0} mm; more than {:.0} mm apart",
                mm(right_m),
                mm(left_m),
                mm(limit_m)
            ),
            Self::Length { segment, found_m, expected_m, limit_ratio } => write!(
                f,
                "{segment}: {:.0} mm where stature predicts {:.0} mm; more than {:.0} % off",
                mm(found_m),
                mm(expected_m),
                100.0 * limit_ratio
            ),
            Self::Bent { joint, angle_deg, limit_deg } => {
                write!(f, "{joint}: bent by {angle_deg:.0}° in the static (limit {limit_deg:.0}°)")
            }
            Self::Skewed { joint, angle_deg, limit_deg } => write!(
                f,
                "{joint}: its axis is {angle_deg:.0}° off the perpendicular of its segment (limit {limit_deg:.0}°); check the medial and lateral markers"
            ),
            Self::BackToFront { link, cosine } => {
                write!(
                    f,
                    "{link}: points backwards (cosine {cosine:.2}); heel and toe, or right and left, look exchanged"
                )
            }
            Self::AnkleBehindHeel { ankle, heel, behind_m, below_m } => write!(
                f,
                "in the static, `{ankle}` on the malleolus lies {:.0} mm behind and {:.0} mm below `{heel}` on the heel: their labels look exchanged; the ankle's centre comes from them",
                mm(behind_m),
                mm(below_m)
            ),
            Self::SidesExchanged { what, lateral_m } => {
                write!(f, "{what}: the right one lies {:.0} mm to the left of the left one", mm(lateral_m))
            }
            Self::Moving { spread_m, limit_m } => {
                write!(
                    f,
                    "the body moved in the static: markers by {:.1} mm (limit {:.0} mm)",
                    mm(spread_m),
                    mm(limit_m)
                )
            }
            Self::FewFrames { frames, limit } => write!(f, "only {frames} static frames (at least {limit} are better)"),
            Self::MarkerLoose { marker, rigid_error_m, limit_m } => write!(
                f,
                "marker `{marker}`: {:.1} mm off its link in the static (limit {:.0} mm)",
                mm(rigid_error_m),
                mm(limit_m)
            ),
            Self::MarkerAsymmetry { right, left, distance_m, limit_m } => write!(
                f,
                "markers `{right}`, `{left}`: {:.0} mm from mirror images (limit {:.0} mm)",
                mm(distance_m),
                mm(limit_m)
            ),
            Self::HeightEstimated { height_m } => write!(f, "stature is not stated; estimated as {height_m:.2} m"),
            Self::HeightDoubtful { stated_m, estimated_m, limit_ratio } => write!(
                f,
                "stature is stated as {stated_m:.2} m, the legs suggest {estimated_m:.2} m (more than {:.0} % apart)",
                100.0 * limit_ratio
            ),
            Self::BodyMassIndex { value, low, high } => {
                write!(f, "body mass index {value:.1} kg/m² lies outside {low:.0}-{high:.0}: check mass and stature")
            }
            Self::SexUnknown => write!(f, "sex is not stated: the mean of both sexes' tables is used"),
            Self::InertiaProjected { link, smallest_eigenvalue } => write!(
                f,
                "{link}: the inertia from tables is not physically consistent (smallest eigenvalue {smallest_eigenvalue:.2e} kg·m²); projected"
            ),
            Self::Unobserved { link, coordinates } => {
                write!(f, "{link}: {coordinates} of its coordinates are seen by no marker and are held")
            }
            Self::LengthFromStature { segment, length_m } => {
                write!(f, "prior of {segment}: end points unknown, length {:.0} mm from stature", mm(length_m))
            }
        }
    }
}

/// Thresholds of the warnings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlausibilityLimits {
    /// Right-left difference of a segment: the larger of this, m …
    pub asymmetry_m: f64,
    /// … and this fraction of its length.
    pub asymmetry_ratio: f64,
    /// Length relative to the prediction, relative difference.
    pub length_ratio: f64,
    /// Bend of knees and elbows in the static, degrees.
    pub bent_deg: f64,
    /// Hinge axis off the perpendicular, degrees.
    pub skewed_deg: f64,
    /// Movement during the static, m.
    pub moving_m: f64,
    /// Minimum number of static frames.
    pub frames: usize,
    /// Distance of a marker from its position on the rigid link, m.
    pub loose_m: f64,
    /// Distance of mirror images, m, for markers that mark landmarks.
    pub mirror_m: f64,
    /// Stated against estimated stature, relative.
    pub height_ratio: f64,
    /// Body mass index, lowest and highest.
    pub body_mass_index: (f64, f64),
}

impl Default for PlausibilityLimits {
    fn default() -> Self {
        Self {
            asymmetry_m: 0.015,
            asymmetry_ratio: 0.05,
            length_ratio: 0.20,
            bent_deg: 40.0,
            skewed_deg: 20.0,
            moving_m: 0.005,
            frames: 20,
            loose_m: 0.005,
            mirror_m: 0.03,
            height_ratio: 0.10,
            body_mass_index: (14.0, 45.0),
        }
    }
}
