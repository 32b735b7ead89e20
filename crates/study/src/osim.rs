//! An OpenSim model as the body of a study: its geometry, markers and inertias as the file has
//! them.

use aloft_robot::PriorSpread;
use aloft_robot::osim::{OsimModel, RigidTree};
use aloft_trial::{MarkerDefinition, MarkerSet};
use aloft_workspace::error::PipelineError;
use aloft_workspace::input;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// How far the inertias of a person's model may be from the truth: those of tables of body
/// proportions, from which such models are scaled.
const SPREAD: PriorSpread = PriorSpread { mass_rel: 0.12, com_m: 0.02, radius_rel: 0.15 };

/// Largest factor between the masses of model and body: beyond it, parts are missing or the file is
/// of somebody else.
const MASS_FACTOR: f64 = 1.6;

/// An OpenSim model. Its name and the hash of its text stand for it in cache keys.
#[derive(Debug, Clone, Serialize)]
pub struct OsimSetup {
    /// File name.
    pub name: String,
    /// Hash of the text.
    pub hash: String,
    /// Spread of the inertias.
    pub spread: PriorSpread,
    /// The model.
    #[serde(skip)]
    pub model: OsimModel,
    /// The model with hinges and balls, for all of the file's markers.
    #[serde(skip)]
    pub tree: RigidTree,
    /// The file.
    #[serde(skip)]
    pub path: PathBuf,
}

/// True for the name of an OpenSim model.
pub fn is_osim(name: &str) -> bool {
    name.to_ascii_lowercase().ends_with(".osim")
}

impl OsimSetup {
    /// Reads the model: a path relative to the pipeline, or to the recordings.
    ///
    /// # Errors
    /// A file that is missing, is no model of OpenSim 4, has parts that are not supported, or
    /// carries no markers.
    pub fn load(name: &str, folder: &Path, data: &Path, root: &Path) -> Result<Self, PipelineError> {
        let places = [folder.join(name), data.join(name), root.join(name)];
        let Some(path) = places.iter().find(|p| input::is_there(p)) else {
            return Err(PipelineError::request_hint(
                format!("{}: there is no such file", places[0].display()),
                "give a path relative to the pipeline file or to the recordings",
            ));
        };
        let bytes = input::bytes(path)?;
        let shown = path.file_name().map_or_else(|| name.to_owned(), |n| n.to_string_lossy().into_owned());
        let wrong = |e: aloft_robot::RobotError| {
            PipelineError::request_hint(
                e.to_string(),
                "models of OpenSim 4 with pins, balls, welds and custom joints are used; `model: human34` needs no model file",
            )
        };
        let model = OsimModel::parse(&shown, &String::from_utf8_lossy(&bytes)).map_err(wrong)?;
        let tree = RigidTree::of(&model, None).map_err(wrong)?;
        if model.markers.len() < 4 {
            return Err(PipelineError::request_hint(
                format!("{shown}: {} markers on its bodies, expected at least 4", model.markers.len()),
                "the recordings are fitted to the file's own markers: add them in OpenSim, or use `model: human34` with a marker set",
            ));
        }
        let hash = blake3::hash(&bytes).to_hex().to_string();
        Ok(Self { name: shown, hash, spread: SPREAD, model, tree, path: path.clone() })
    }

    /// The file's markers as a set.
    pub fn marker_set(&self) -> MarkerSet {
        let markers = self.model.markers.iter().map(|m| MarkerDefinition::new(&m.name, self.tree.link_of(m)));
        MarkerSet {
            name: self.name.clone(),
            title: format!("the markers of {}", self.name),
            model: self.model.name.clone(),
            marker_radius_m: 0.0,
            markerless: None,
            markers: markers.collect(),
        }
    }

    /// Refuses a body mass that the model cannot be of.
    ///
    /// # Errors
    /// A mass more than 1.6 times that of the model's bodies, or less than that share of it.
    pub fn check_mass(&self, mass_kg: f64) -> Result<(), PipelineError> {
        let ratio = mass_kg / self.tree.mass_kg();
        if (1.0 / MASS_FACTOR..MASS_FACTOR).contains(&ratio) {
            return Ok(());
        }
        Err(PipelineError::request_hint(
            format!(
                "{}: its bodies weigh {:.1} kg, and the subject weighs {mass_kg:.1} kg",
                self.name,
                self.tree.mass_kg()
            ),
            "use the model that was scaled to this subject, with all parts of the body (the equations of flight hold for a whole body only)",
        ))
    }

    /// How the motion was measured, in words, for method sections.
    pub fn kinematics_in_words(&self) -> String {
        let riding = self.tree.merged.len();
        format!(
            "Joint coordinates are those of the OpenSim model {} ({} bodies, {} coordinates, {} markers), taken as it is: scaling, joint centres, ranges \
             and marker places are the file's, and so is the prior of the inertias. Inverse kinematics fitted the file's own coordinates to the markers \
             frame by frame. Dynamics used {} links; {riding} bodies that cannot move on their own or carry no markers ride on others. ",
            self.name,
            self.model.joint_count(),
            self.model.coordinates.len(),
            self.model.markers.len(),
            self.tree.model.n_links(),
        )
    }
}
