//! The plant: the true body of one trial, with all hidden effects included.

use crate::error::SimulateError;
use crate::hidden::Hidden;
use crate::physics::forces::ForceField;
use aloft_body::inertia::phi_transform;
use aloft_body::{LinkInertia, Model, Phi};
use nalgebra::{Isometry3, Matrix3, Rotation3, Vector3};

/// The simulated system of one trial.
#[derive(Debug, Clone)]
pub struct Plant {
    /// The tree, with the true gravity.
    pub model: Model,
    /// Inertias used in the equations of motion (link frames).
    pub phi: Vec<Phi>,
    /// Forces missing from any model.
    pub forces: ForceField,
}

/// A body without hidden effects.
#[derive(Debug, Clone)]
pub struct Body {
    /// The tree, with the gravity stated by the laboratory.
    pub model: Model,
    /// True inertias.
    pub phi: Vec<Phi>,
    /// Relative drag area of each link, m² (only ratios matter).
    pub area_m2: Vec<f64>,
}

/// Parameters of a point mass at a position in the link frame.
pub(crate) fn point_mass(mass_kg: f64, at: &Vector3<f64>) -> Phi {
    let body = LinkInertia { mass_kg, com_m: Vector3::zeros(), inertia_com_kgm2: Matrix3::zeros() };
    phi_transform(&Isometry3::translation(at.x, at.y, at.z)) * body.to_phi()
}

impl Plant {
    /// Adds the hidden effects to `body` for the trial `trial`. Link names have been checked
    /// before.
    pub fn new(body: &Body, hidden: &[Hidden], trial: &str) -> Result<Self, SimulateError> {
        let mut model = body.model.clone();
        let mut phi = body.phi.clone();
        for effect in hidden {
            match effect {
                Hidden::GravityTilt { about_x_deg, about_y_deg } => {
                    let turn = Vector3::new(about_x_deg.to_radians(), about_y_deg.to_radians(), 0.0);
                    model.gravity_mps2 = Rotation3::from_scaled_axis(turn) * model.gravity_mps2;
                }
                Hidden::GravityScale { factor } => model.gravity_mps2 *= *factor,
                Hidden::Payload { link, point_m, mass_kg, trials }
                    if trials.is_empty() || trials.iter().any(|t| trial.starts_with(t.as_str())) =>
                {
                    phi[model.link_index(link)?] += point_mass(*mass_kg, &Vector3::from(*point_m));
                }
                Hidden::WobblingMass { link, point_m, mass_kg, .. } => {
                    phi[model.link_index(link)?] -= point_mass(*mass_kg, &Vector3::from(*point_m));
                }
                Hidden::AddedMass { link, point_m, mass_kg } => {
                    phi[model.link_index(link)?] += point_mass(*mass_kg, &Vector3::from(*point_m));
                }
                _ => {}
            }
        }
        let forces = ForceField::new(body, &model, &phi, hidden)?;
        Ok(Self { model, phi, forces })
    }
}
