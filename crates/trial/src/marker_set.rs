//! Marker sets: link and anatomical landmark of each label. Stored as data in
//! `configs/markersets/`.

use serde::{Deserialize, Deserializer, Serialize};

/// A marker set as stored in its file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MarkerSet {
    /// Identifier, also the file's stem.
    pub name: String,
    /// One-line description.
    pub title: String,
    /// Name of the model in `configs/models/` whose links the markers name.
    pub model: String,
    /// Distance from skin to marker centre, m.
    #[serde(default)]
    pub marker_radius_m: f64,
    /// Where the points come from, if no marker was worn: software that finds them in videos.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub markerless: Option<Markerless>,
    /// The markers.
    pub markers: Vec<MarkerDefinition>,
}

/// Points that software finds in videos.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Markerless {
    /// The software, for messages.
    pub source: String,
    /// Standard deviation of its joint centres against those of the bones, each axis, m. The error
    /// is alike in every recording: no averaging reduces it.
    pub position_sd_m: f64,
}

/// One marker of a set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MarkerDefinition {
    /// Canonical label.
    pub label: String,
    /// Link that carries it.
    pub link: String,
    /// Anatomical landmark that it marks, if any (`asis_l`, `knee_medial_r`, `hip_centre_l` …).
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "landmark")]
    pub landmark: Option<String>,
    /// Other labels of the same marker.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub aliases: Vec<String>,
    /// Weight in inverse kinematics.
    #[serde(default = "one")]
    pub weight: f64,
    /// False for points that define geometry but are not tracked (derived joint centres).
    #[serde(default = "yes")]
    pub tracking: bool,
    /// True for markers worn in the static trial only.
    #[serde(default)]
    pub static_only: bool,
    /// True for markers that variants of the set leave out: they are used where present and never
    /// reported as missing.
    #[serde(default)]
    pub optional: bool,
}

impl MarkerDefinition {
    /// A tracked marker of weight 1 without landmark or other labels.
    pub fn new(label: impl Into<String>, link: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            link: link.into(),
            landmark: None,
            aliases: Vec::new(),
            weight: one(),
            tracking: yes(),
            static_only: false,
            optional: false,
        }
    }
}

/// Reads a landmark. The former spelling of joint centres (`hip_center_l`) means the same.
fn landmark<'de, D: Deserializer<'de>>(input: D) -> Result<Option<String>, D::Error> {
    let read = Option::<String>::deserialize(input)?;
    Ok(read.map(|name| name.replace("_center", "_centre")))
}

fn one() -> f64 {
    1.0
}

fn yes() -> bool {
    true
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    #[test]
    fn the_former_spelling_of_joint_centres_is_read() {
        let text = r#"{"label": "R", "link": "pelvis", "landmark": "hip_center_r"}"#;
        let marker: MarkerDefinition = serde_yaml::from_str(text).unwrap();
        assert_eq!(marker.landmark.as_deref(), Some("hip_centre_r"));
    }
}
