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
