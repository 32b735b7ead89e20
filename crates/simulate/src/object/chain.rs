//! The two-link chain: a bar with five markers and an arm with four, on one passive hinge.
//!
//! Link frames are those that a laboratory can determine from markers and a functional calibration:
//! the bar's origin is `L0_1`, y points to `L0_2`, `L0_3` lies in the +z half of the y-z plane; the
//! arm's z is the hinge axis, its origin the point of the axis closest to `L0_1`, and `L1_1` lies
//! in its x-z plane on the −x side.

use super::{ThrownObject, TrueMarker};
use crate::error::SimulateError;
use crate::physics::Body;
use crate::random::Stream;
use crate::scenario::{ChainSpec, Scenario};
use aloft_body::{JointSpec, LinkInertia, LinkSpec, Model, ModelSpec};
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

struct Design {
    mass: f64,
    com: [f64; 3],
    /// Radii of gyration about the centre of mass, m.
    radii: [f64; 3],
}
const BAR: Design = Design { mass: 0.614, com: [-0.005, 0.122, 0.002], radii: [0.077, 0.033, 0.075] };
const ARM: Design = Design { mass: 0.386, com: [-0.094, -0.007, 0.008], radii: [0.034, 0.074, 0.080] };
const BAR_MARKERS: [[f64; 3]; 5] =
    [[0.0, 0.0, 0.0], [0.0, 0.235, 0.0], [0.0, 0.105, 0.055], [0.048, 0.17, 0.02], [-0.045, 0.06, -0.018]];
const ARM_MARKERS: [[f64; 3]; 4] =
    [[-0.205, 0.0, 0.022], [-0.12, 0.05, 0.01], [-0.065, -0.04, 0.03], [-0.15, -0.045, -0.02]];

/// An individual inertia near a design: mass, centre of mass, radii and axes vary a little, and the
/// result remains physically consistent.
pub(crate) fn individual(
    mass: f64,
    com: Vector3<f64>,
    radii: [f64; 3],
    spread: [f64; 3],
    rng: &mut Stream,
) -> LinkInertia {
    let [com_m, radius, tilt] = spread;
    let com = com + rng.vector() * com_m;
    let squared = radii.map(|k| (k * (1.0 + radius * rng.moderate())).powi(2));
    // second moments of mass along the axes stay positive, as for any real body
    let half = 0.5 * (squared[0] + squared[1] + squared[2]);
    let along = squared.map(|k2| (half - k2).max(0.02 * half));
    let sum: f64 = along.iter().sum();
    let principal = Matrix3::from_diagonal(&Vector3::from(along.map(|s| mass * (sum - s))));
    let turn = Rotation3::from_scaled_axis(rng.vector() * tilt);
    LinkInertia { mass_kg: mass, com_m: com, inertia_com_kgm2: turn * principal * turn.inverse() }
}

/// Builds the chain of a scenario.
pub fn chain(scenario: &Scenario, spec: &ChainSpec) -> Result<ThrownObject, SimulateError> {
    scenario.expect("body.object.mass_kg", spec.mass_kg, 0.05..=50.0, "0.05 to 50 kg")?;
    scenario.expect("body.object.variation", spec.variation, 0.0..=3.0, "0 to 3")?;
    let rng = &mut Stream::new(scenario.seed, "chain");
    let s = spec.variation;
    let axis = (Vector3::x() + rng.vector() * (0.02 * s)).normalize();
    let near = Vector3::new(0.0, -0.03, 0.012) + rng.vector() * (0.003 * s);
    let at = near - axis * axis.dot(&near);
    let x = (Vector3::y() - axis * axis.y).normalize();
    let frame = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, axis.cross(&x), axis]));
    let frame = frame * Rotation3::from_axis_angle(&Vector3::z_axis(), 0.04 * s * rng.moderate());

    let bar_share = BAR.mass * (1.0 + 0.03 * s * rng.moderate());
    let masses = [bar_share, ARM.mass * (1.0 + 0.03 * s * rng.moderate())];
    let scale = spec.mass_kg / (masses[0] + masses[1]);
    let mut phi = Vec::new();
    for (design, mass) in [&BAR, &ARM].into_iter().zip(masses) {
        let spread = [0.003 * s, 0.03 * s, 0.03 * s];
        phi.push(individual(mass * scale, design.com.into(), design.radii, spread, rng).to_phi());
    }

    let link = |name: &str, parent: Option<&str>, joint| LinkSpec {
        name: name.to_owned(),
        parent: parent.map(str::to_owned),
        joint,
        position_m: [0.0; 3],
        rpy_rad: [0.0; 3],
        inertia: None,
    };
    let spec_of = ModelSpec {
        name: "two_link".to_owned(),
        links: vec![link("link0", None, JointSpec::Free), link("link1", Some("link0"), JointSpec::RevoluteZ)],
        carries: Default::default(),
    };
    let mut model = Model::from_spec(&spec_of)?;
    model.gravity_mps2 = Vector3::new(0.0, 0.0, -scenario.capture.gravity_mps2);
    let turn = UnitQuaternion::from_rotation_matrix(&frame);
    model.links[1].joint.parent_from_joint = Isometry3::from_parts(at.into(), turn);

    let mut markers = Vec::new();
    for (link, places) in [&BAR_MARKERS[..], &ARM_MARKERS[..]].into_iter().enumerate() {
        for (i, place) in places.iter().enumerate() {
            let mut position = Vector3::from(*place);
            let shift = rng.vector() * (0.004 * s);
            // markers that define the frames keep the coordinates given by the definition
            match (link, i) {
                (0, 0) => {}
                (0, 1) => position.y += shift.y,
                (0, 2) => position += Vector3::new(0.0, shift.y, shift.z),
                (1, 0) => position += Vector3::new(shift.x, 0.0, shift.z),
                _ => position += shift,
            }
            markers.push(TrueMarker { label: format!("L{link}_{}", i + 1), link, position_m: position });
        }
    }
    let body = Body { model, phi, area_m2: vec![0.014, 0.009] };
    Ok(ThrownObject { body, markers, damping: spec.hinge_damping_nmsprad, friction: spec.hinge_friction_nm })
}
