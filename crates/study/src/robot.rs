//! A robot as its description and its model file state it.

use crate::config::{InertiaLimit, RobotConfig};
use crate::keys::{self, refuse_unknown};
use crate::place::error_at_key;
use crate::ranges::parse_yaml;
use aloft_robot::{PriorSpread, RobotDescription, RobotModel};
use aloft_trial::MarkerSet;
use aloft_workspace::error::PipelineError;
use aloft_workspace::input;
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
    /// Rows of a log up to this far apart are interpolated, s.
    #[serde(default)]
    pub fill_gaps_s: f64,
    /// Model files, as paths; the first is the one that `model` was read from. No part of a cache
    /// key.
    #[serde(skip)]
    pub files: Vec<PathBuf>,
}

/// Refuses a stated direction of gravity other than that of the world frame: base poses are given
/// with z up.
fn gravity_is_down(file: &str, text: &str, all: &serde_yaml::Value) -> Result<(), PipelineError> {
    let Some(stated) = all.get("gravity_direction") else { return Ok(()) };
    let numbers: Option<Vec<f64>> =
        stated.as_sequence().map(|list| list.iter().filter_map(serde_yaml::Value::as_f64).collect());
    match numbers.as_deref() {
        Some([x, y, z]) if *x == 0.0 && *y == 0.0 && *z < 0.0 => Ok(()),
        _ => Err(error_at_key(
            file,
            text,
            "gravity_direction",
            "`gravity_direction` is not [0, 0, -1]: the base's poses are read in a world frame whose z points upward",
            Some("turn the poses of the base into such a frame, or leave the key out if they are in one".to_owned()),
        )),
    }
}

impl RobotSetup {
    /// Reads the description beside the recordings (or in the study's folder), and the model that
    /// it names.
    ///
    /// # Errors
    /// A file that is missing or cannot be used, with what was expected.
    pub fn load(config: &RobotConfig, data: &Path, root: &Path) -> Result<Self, PipelineError> {
        let places = [data.join(&config.description), root.join(&config.description)];
        let Some(path) = places.iter().find(|p| input::is_there(p)) else {
            return Err(PipelineError::request_hint(
                format!("{}: there is no such file", places[0].display()),
                "a robot is described beside its recordings: total_mass_kg, model: {urdf: …}, imu, noise",
            ));
        };
        let text = input::text(path)?;
        let name = path.display().to_string();
        let all: serde_yaml::Value = parse_yaml(&name, &text)?;
        refuse_unknown(&keys::ROBOT, &name, &text, &all)?;
        gravity_is_down(&name, &text, &all)?;
        let description: RobotDescription = parse_yaml(&name, &text)?;
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
        let mut model =
            RobotModel::parse(&shown, &input::text(first)?).map_err(|e| PipelineError::request(e.to_string()))?;
        // URDF has no reflected inertia: take it from the MJCF of the same robot
        if let [_, second] = files.as_slice() {
            let named = second.strip_prefix(folder).unwrap_or(second).display().to_string();
            let other =
                RobotModel::parse(&named, &input::text(second)?).map_err(|e| PipelineError::request(e.to_string()))?;
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
        Ok(Self { description, model, spread, limits_margin_m, fill_gaps_s: config.fill_gaps_s, files })
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
