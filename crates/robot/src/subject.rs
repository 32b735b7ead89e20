//! A robot's model as the [`Subject`] that all later stages use.

use crate::{RobotDescription, RobotError, RobotModel};
use aloft_body::subject::{LinkBox, PriorSd};
use aloft_body::{LinkInertia, Model, ModelMarker, PersonFacts, Subject};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// How far the model's inertias may be from the truth: one standard deviation, the same for every
/// link.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PriorSpread {
    /// Masses, as a share.
    pub mass_rel: f64,
    /// Centres of mass, each axis, m.
    pub com_m: f64,
    /// Radii of gyration, as a share (half of the share of the inertia).
    pub radius_rel: f64,
}

/// The subject of a robot. Its prior is the model file's inertias, masses scaled to the mass from
/// the scale.
///
/// # Errors
/// [`RobotError::Model`] if the description names another base link than the model's root or a
/// marker on an unknown link.
pub fn subject(
    robot: &RobotModel,
    description: &RobotDescription,
    facts: PersonFacts,
    gravity_mps2: Vector3<f64>,
    spread: PriorSpread,
) -> Result<Subject, RobotError> {
    let mut model = Model::from_spec(&robot.spec).map_err(|e| RobotError::model(&robot.file, e.to_string()))?;
    model.gravity_mps2 = gravity_mps2;
    model.encoders = true;
    model.joint_names = robot.joints.iter().map(|j| (j.link.clone(), j.name.clone())).collect();
    let root = &model.links[0].name;
    if let Some(base) = description.base_link.as_ref().filter(|b| *b != root) {
        return Err(RobotError::model(
            &robot.file,
            format!("its root is the link `{root}`, and the description names `{base}` as base: they must be the same"),
        ));
    }
    if let Some(link) = description.imu.as_ref().and_then(|i| i.link.as_ref())
        && !model.links.iter().any(|l| l.name == *link)
    {
        return Err(RobotError::model(
            &robot.file,
            format!(
                "the inertial unit is on the link `{link}`, which is not in the model (`imu: {{link: …}}` in the description)"
            ),
        ));
    }
    let scale = facts.mass_kg / robot.mass_kg();
    let prior: Vec<LinkInertia> = robot
        .spec
        .links
        .iter()
        .filter_map(|l| l.inertia)
        .map(|i| LinkInertia { mass_kg: i.mass_kg * scale, inertia_com_kgm2: i.inertia_com_kgm2 * scale, ..i })
        .collect();
    let sd = PriorSd {
        mass_rel: spread.mass_rel,
        com_m: spread.com_m,
        radius_rel: spread.radius_rel,
        together: PriorSd::DESCRIBED,
    };
    let markers = description
        .markers
        .iter()
        .map(|(label, place)| {
            let link = model.links.iter().position(|l| l.name == place.link).ok_or_else(|| {
                RobotError::model(&robot.file, format!("the marker `{label}` is on the unknown link `{}`", place.link))
            })?;
            Ok(ModelMarker { label: label.clone(), link, position_m: Vector3::from(place.position_m), weight: 1.0 })
        })
        .collect::<Result<Vec<_>, RobotError>>()?;
    Ok(Subject {
        static_q: model.neutral(),
        prior_sd: vec![sd; prior.len()],
        prior,
        markers,
        provenance: vec![format!(
            "geometry: {}; prior inertias: the same file, masses times {scale:.4} to add up to the mass from the scale",
            robot.file
        )],
        facts,
        model,
        estimated: None,
        boxes: Vec::new(),
    })
}

/// Boxes about the collision geometry of a robot's links, wider by a margin (m) on every side, as
/// limits for their inertias.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InertiaLimits {
    /// In the order of the model's links; none for links without collision geometry, with a mesh,
    /// or whose inertia in the model file does not fit.
    pub boxes: Vec<Option<LinkBox>>,
    /// Links whose inertia in the model file does not fit into their box.
    pub do_not_fit: Vec<String>,
}

impl InertiaLimits {
    /// For the links of a subject made by [`subject`] from the same model.
    pub fn of(robot: &RobotModel, subject: &Subject, margin_m: f64) -> Self {
        let mut out = Self::default();
        for (link, inertia) in subject.model.links.iter().zip(&subject.prior) {
            let own = robot.boxes.iter().find(|b| b.0 == link.name).map(|b| b.1.widened(margin_m));
            let fits = own.filter(|b| b.room(&inertia.to_phi()) > LEAST_ROOM);
            if own.is_some() && fits.is_none() {
                out.do_not_fit.push(link.name.clone());
            }
            out.boxes.push(fits);
        }
        out
    }
}

/// Least room ([`LinkBox::room`]) of an inertia that fits: a hundredth of that of a point mass in
/// the middle.
const LEAST_ROOM: f64 = 0.01;
