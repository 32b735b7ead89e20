//! A robot as its description and its model file state it.

use crate::config::{InertiaLimit, RobotConfig};
use crate::ranges::parse_yaml;
use aloft_robot::{PriorSpread, RobotDescription, RobotModel, SensorNoise};
use aloft_trial::MarkerSet;
use aloft_workspace::error::PipelineError;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A robot: its description, its model, and the files that identified inertias are written into.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RobotSetup {
    /// What the laboratory wrote down.
    pub description: RobotDescription,
    /// The model.
    pub model: RobotModel,
    /// Spread of the model's inertias.
    pub spread: PriorSpread,
    /// Margin about the collision geometry inside which inertias are held, m; none if they are not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits_margin_m: Option<f64>,
    /// Model files, as paths; the first is the one that `model` was read from. No part of a cache
    /// key.
    #[serde(skip)]
    pub files: Vec<PathBuf>,
}

/// Keys of a description; others are the laboratory's own business.
const KEYS: [&str; 11] = [
    "name",
    "total_mass_kg",
    "mass_kg",
    "gravity_m_s2",
    "base_link",
    "joints",
    "model",
    "imu",
    "noise",
    "topics",
    "markers",
];

/// An error for a key that is one or two letters off one that is read: it would count as not given.
fn refuse_slips(file: &str, text: &str) -> Result<(), PipelineError> {
    let all: serde_yaml::Value = parse_yaml(file, text)?;
    let noise = serde_yaml::to_value(SensorNoise::default()).unwrap_or_default();
    let of_noise: Vec<&str> = noise.as_mapping().into_iter().flatten().filter_map(|(k, _)| k.as_str()).collect();
    for (place, known) in
        [(None, &KEYS[..]), (Some("noise"), &of_noise), (Some("imu"), &["link", "position_m", "rpy_rad"])]
    {
        let keys = place.map_or(Some(&all), |p| all.get(p)).and_then(serde_yaml::Value::as_mapping);
        for key in keys.into_iter().flatten().filter_map(|(k, _)| k.as_str()).filter(|k| !known.contains(k)) {
            if let Some(meant) = known.iter().find(|k| k.len() > 3 && strsim::damerau_levenshtein(key, k) <= 2) {
                let within = place.map_or(String::new(), |p| format!(" in `{p}`"));
                return Err(PipelineError::request_hint(
                    format!("{file}: unknown key `{key}`{within}"),
                    format!("did you mean `{meant}`?"),
                ));
            }
        }
    }
    Ok(())
}

impl RobotSetup {
    /// Reads the description beside the recordings (or in the study's folder), and the model that
    /// it names.
    ///
    /// # Errors
    /// A file that is missing or cannot be used, with what was expected.
    pub fn load(config: &RobotConfig, data: &Path, root: &Path) -> Result<Self, PipelineError> {
        let places = [data.join(&config.description), root.join(&config.description)];
        let Some(path) = places.iter().find(|p| p.is_file()) else {
            return Err(PipelineError::request_hint(
                format!("{}: there is no such file", places[0].display()),
                "a robot is described beside its recordings: total_mass_kg, model: {urdf: …}, imu, noise",
            ));
        };
        let read = |p: &Path| std::fs::read_to_string(p).map_err(PipelineError::io("read", p));
        let text = read(path)?;
        let description: RobotDescription = parse_yaml(&path.display().to_string(), &text)?;
        refuse_slips(&path.display().to_string(), &text)?;
        let folder = path.parent().unwrap_or(data);
        let named = [&description.model.urdf, &description.model.mjcf];
        let files: Vec<PathBuf> = named.into_iter().flatten().map(|name| folder.join(name)).collect();
        let Some(first) = files.first() else {
            return Err(PipelineError::request_hint(
                format!("{}: it names no model", path.display()),
                "add `model: {urdf: model.urdf}` or `model: {mjcf: model.xml}`, a path relative to the description",
            ));
        };
        let shown = first.strip_prefix(folder).unwrap_or(first).display().to_string();
        let mut model = RobotModel::parse(&shown, &read(first)?).map_err(|e| PipelineError::request(e.to_string()))?;
        // URDF has no reflected inertia: take it from the MJCF of the same robot
        if let [_, second] = files.as_slice()
            && let Ok(other) = RobotModel::parse(&second.display().to_string(), &read(second)?)
        {
            for joint in &mut model.joints {
                if let Some(twin) = other.joint(&joint.name).filter(|_| joint.armature == 0.0) {
                    joint.armature = twin.armature;
                }
            }
        }
        if let Some(listed) = &description.joints {
            let unknown: Vec<&String> = listed.iter().filter(|j| model.joint(j).is_none()).collect();
            if let Some(first) = unknown.first() {
                return Err(PipelineError::request_hint(
                    format!("{}: the joint `{first}` is not in the model {shown}", path.display()),
                    "`joints` lists the joints of the model that move, by their names there",
                ));
            }
        }
        let spread = PriorSpread { mass_rel: config.mass_rel, com_m: config.com_m, radius_rel: config.radius_rel };
        let limits_margin_m = match config.inertia_limits {
            InertiaLimit::None => None,
            InertiaLimit::Collision => Some(config.limits_margin_m),
        };
        Ok(Self { description, model, spread, limits_margin_m, files })
    }

    /// How the motion was measured, in words, for method sections.
    pub fn kinematics_in_words(&self) -> String {
        format!(
            "Joint coordinates are the encoders' values in the robot's log ({} joints of {}). The base's pose, measured by its own clock, was smoothed \
             with the gyroscope and accelerometer of the inertial unit; the offset of the clocks and the sensors' biases were estimated in each recording.",
            self.model.joints.len(),
            self.model.file
        )
    }

    /// A marker set without markers, for stages that ask for one.
    pub fn no_markers(&self) -> MarkerSet {
        MarkerSet {
            name: "none".to_owned(),
            title: "a robot's joints are logged".to_owned(),
            model: self.model.spec.name.clone(),
            marker_radius_m: 0.0,
            markerless: None,
            markers: Vec::new(),
        }
    }
}
