//! Any other model as a thrown object.

use super::{ThrownObject, TrueMarker};
use crate::error::SimulateError;
use crate::physics::Body;
use crate::scenario::{CustomLab, Scenario};
use aloft_body::{JointKind, Model};
use nalgebra::Vector3;

/// Builds the object of a scenario. The root joint must be free and every link must have its
/// inertia.
pub fn custom(scenario: &Scenario, lab: &CustomLab) -> Result<ThrownObject, SimulateError> {
    let mut model = Model::from_spec(&lab.model)?;
    model.gravity_mps2 = Vector3::new(0.0, 0.0, -scenario.capture.gravity_mps2);
    if model.links.first().is_none_or(|l| l.joint.kind != JointKind::Free) {
        return Err(scenario.value_error("body.model", "a model with a fixed root", "a root with a free joint"));
    }
    let mut phi = Vec::new();
    let mut area = Vec::new();
    for link in &lab.model.links {
        let field = format!("body.model.links[{}].inertia", link.name);
        let Some(inertia) = &link.inertia else {
            return Err(scenario.value_error(&field, "missing", "mass, centre of mass and inertia of every link"));
        };
        scenario.expect(&field, inertia.mass_kg, 1e-9..=1e9, "a positive mass")?;
        phi.push(inertia.to_phi());
        // the diameter of a body with radius of gyration r is about 4 r
        let radius = (inertia.inertia_com_kgm2.trace() / (2.0 * inertia.mass_kg)).abs().sqrt();
        area.push(16.0 * radius * radius);
    }
    let mut markers = Vec::new();
    for (label, marker) in &lab.markers {
        let link = model.link_index(&marker.link)?;
        markers.push(TrueMarker { label: label.clone(), link, position_m: marker.position_m.into() });
    }
    let body = Body { model, phi, area_m2: area };
    Ok(ThrownObject { body, markers, damping: lab.joint_damping, friction: lab.joint_friction })
}
