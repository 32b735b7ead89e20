//! A person or object: the model with its own geometry, marker positions and prior inertias.

use crate::{LinkInertia, Model, Phi};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Sex, as anthropometric tables distinguish it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Sex {
    /// Female.
    #[serde(rename = "F", alias = "female", alias = "f")]
    Female,
    /// Male.
    #[serde(rename = "M", alias = "male", alias = "m")]
    Male,
}

/// Known facts about a person or object without a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PersonFacts {
    /// Identifier.
    pub name: String,
    /// Sex, if known.
    pub sex: Option<Sex>,
    /// Stature, m.
    pub height_m: Option<f64>,
    /// Mass from a scale, kg.
    pub mass_kg: f64,
}

/// A marker in the frame of the link that carries it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelMarker {
    /// Label as in the (canonical) marker set.
    pub label: String,
    /// Index of the link.
    pub link: usize,
    /// Position in the link frame, m.
    pub position_m: Vector3<f64>,
    /// Weight in inverse kinematics (1 is usual, 0 means ignored).
    pub weight: f64,
}

/// All that is known about a body before its motion is used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Subject {
    /// Facts.
    pub facts: PersonFacts,
    /// The model with this body's joint positions.
    pub model: Model,
    /// Markers and their positions.
    pub markers: Vec<ModelMarker>,
    /// Prior inertia of each link (anthropometry, geometry), link frames; the masses add up to
    /// `facts.mass_kg`.
    pub prior: Vec<LinkInertia>,
    /// One standard deviation of the prior, relative, of each link's mass, centre of mass (in link
    /// lengths) and radii of gyration.
    pub prior_sd: Vec<PriorSd>,
    /// q of the static posture (length nq).
    pub static_q: Vec<f64>,
    /// Sources of the prior and the geometry, for the report.
    pub provenance: Vec<String>,
    /// What the markers are, if they are no measurements but estimates of software (markerless
    /// capture).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub estimated: Option<EstimatedPoints>,
    /// For each link the box that holds its mass, if one is known; empty if none is.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub boxes: Vec<Option<LinkBox>>,
}

/// A box along the axes of a link, inside which all mass of the link lies.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LinkBox {
    /// Lower corner, link frame, m.
    pub low_m: Vector3<f64>,
    /// Upper corner, link frame, m.
    pub high_m: Vector3<f64>,
}

impl LinkBox {
    /// Rows `r` with `r·φ = ∫ (x − low)(high − x) dm` along each axis, kg·m² (Wensing, Kim and
    /// Slotine 2017 for ellipsoids). Mass of positive density inside the box makes all three
    /// positive.
    pub fn moment_rows(&self) -> [Phi; 3] {
        std::array::from_fn(|axis| {
            let (low, high) = (self.low_m[axis], self.high_m[axis]);
            let mut row = Phi::zeros();
            row[0] = -low * high;
            row[1 + axis] = low + high;
            // ∫ x² dm is half the trace of the inertia less the moment about the axis
            for k in 0..3 {
                row[4 + k] = if k == axis { 0.5 } else { -0.5 };
            }
            row
        })
    }
    /// The smallest of the three moments of [`LinkBox::moment_rows`] over the link's mass and the
    /// squared half length of the box, without unit; negative for mass that cannot lie inside.
    pub fn room(&self, phi: &Phi) -> f64 {
        let half = 0.5 * (self.high_m - self.low_m);
        let moments = self.moment_rows().map(|row| row.dot(phi));
        (0..3).map(|k| moments[k] / (phi[0] * half[k] * half[k])).fold(f64::INFINITY, f64::min)
    }
    /// The box with its sides moved outwards by a margin, m.
    #[must_use]
    pub fn widened(&self, margin_m: f64) -> Self {
        let by = Vector3::repeat(margin_m);
        Self { low_m: self.low_m - by, high_m: self.high_m + by }
    }
}

/// Points that software estimates from videos.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EstimatedPoints {
    /// The software.
    pub source: String,
    /// Standard deviation of its joint centres, each axis, m; alike in every recording.
    pub position_sd_m: f64,
}

/// Uncertainty of a prior inertia.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PriorSd {
    /// Relative standard deviation of the mass.
    pub mass_rel: f64,
    /// Standard deviation of the centre of mass, each axis, m.
    pub com_m: f64,
    /// Relative standard deviation of the radii of gyration.
    pub radius_rel: f64,
    /// Correlation of the errors of the radii, within a link and between links: a description that
    /// has its links too large has all of them too large. 0 for tables of people.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub together: f64,
}

impl PriorSd {
    /// Correlation of the errors of radii in the description of an object or a robot: drawing, file
    /// or outline are about as wrong in size, which their makers' assumptions on density and on
    /// parts left out share, as they are in shape.
    pub const DESCRIBED: f64 = 0.5;
}

fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

impl Subject {
    /// True if the equations of the whole body can judge a model: every part has markers, and the
    /// markers are measurements.
    pub fn is_judged(&self) -> bool {
        self.model.is_whole() && self.estimated.is_none()
    }
    /// Prior as parameter vectors.
    pub fn prior_phi(&self) -> Vec<Phi> {
        self.prior.iter().map(LinkInertia::to_phi).collect()
    }
    /// Index of a marker by label.
    pub fn marker_index(&self, label: &str) -> Option<usize> {
        self.markers.iter().position(|m| m.label == label)
    }
}
