//! The rigid tree of a model: hinges and balls with fixed centres, which the stages of a pipeline
//! use.
//!
//! Frames of links are those of the file's bodies, moved to the joint's centre. A joint that turns
//! about one axis is a hinge, others are balls. Where a joint also slides as it turns (a knee of
//! OpenSim), the centre is the point that stays nearest to itself over the joint's range, and how
//! far it strays is stated. Bodies that cannot move on their own ride on others: welds, locked
//! joints, joints beyond which there is no marker, a patella.

use super::exact::link_spec;
use super::joint::{Builder, Kind, Motion, is_held, marked};
use super::model::{OsimMarker, OsimModel};
use super::solid::made_solid;
use crate::RobotError;
use crate::subject::PriorSpread;
use aloft_body::inertia::pseudo_inertia;
use aloft_body::subject::PriorSd;
use aloft_body::{JointSpec, LinkInertia, Model, ModelMarker, ModelSpec, PersonFacts, Phi, Subject};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// A body that rides on a link.
#[derive(Debug, Clone, PartialEq)]
pub struct MergedBody {
    /// Name of the body in the file.
    pub body: String,
    /// The link on which it rides.
    pub link: String,
    /// Why, in words.
    pub why: String,
    /// True if it could move, but no marker is on it or beyond.
    pub unseen: bool,
}

/// A link of the rigid tree.
#[derive(Debug, Clone)]
struct RigidLink {
    joint: usize,
    motion: Motion,
    q_offset: usize,
}

/// A model as the stages of a pipeline use it.
#[derive(Debug, Clone)]
pub struct RigidTree {
    /// Specification, with inertias.
    pub spec: ModelSpec,
    /// The tree.
    pub model: Model,
    /// Bodies that ride on others.
    pub merged: Vec<MergedBody>,
    /// Remarks on what was changed or approximated.
    pub remarks: Vec<String>,
    /// Coordinates that inverse kinematics holds at their default.
    pub held: Vec<bool>,
    links: Vec<RigidLink>,
    /// By joint of the file: link and place of the body's frame in the link's.
    home: Vec<(usize, Isometry3<f64>)>,
    /// Inertia of each link as the file says, in the link's frame; made a body's where it is none.
    inertias: Vec<LinkInertia>,
}

impl RigidTree {
    /// Makes the tree for recordings with these markers (all of the file's, if none are given).
    ///
    /// # Errors
    /// [`RobotError::Model`] for joints that slide by more than 20 mm; the message names them all.
    pub fn of(osim: &OsimModel, seen: Option<&[String]>) -> Result<Self, RobotError> {
        let marked = marked(osim, seen);
        let held: Vec<bool> = (0..osim.all.len()).map(|c| is_held(osim, c, &marked)).collect();
        let rest: Vec<f64> = osim.values(&Default::default());
        let mut tree = Builder { osim, held: &held, marked: &marked, rest: &rest, refused: Vec::new() };
        let mut specs = Vec::new();
        let mut links: Vec<RigidLink> = Vec::new();
        let mut home: Vec<(usize, Isometry3<f64>)> = Vec::new();
        let mut sums: Vec<Phi> = Vec::new();
        let (mut merged, mut remarks) = (Vec::new(), Vec::new());
        for (index, joint) in osim.joints.iter().enumerate() {
            let Some(parent) = joint.parent else {
                specs.push(link_spec(joint.child.clone(), None, JointSpec::Free, &Isometry3::identity()));
                links.push(RigidLink { joint: index, motion: Motion::Free, q_offset: 0 });
                home.push((0, Isometry3::identity()));
                sums.push(joint.inertia.to_phi());
                continue;
            };
            let (carrier, link_from_parent) = home[parent];
            match tree.kind(index) {
                Kind::Rides { why, unseen } => {
                    let place = link_from_parent * joint.body_in_parent(&rest);
                    sums[carrier] += joint.inertia.transformed(&place).to_phi();
                    home.push((carrier, place));
                    let link = specs.get(carrier).map_or(String::new(), |s: &aloft_body::LinkSpec| s.name.clone());
                    merged.push(MergedBody { body: joint.child.clone(), link, why, unseen });
                }
                Kind::Moves(moves) => {
                    let at = link_from_parent * moves.parent_from_link;
                    let name = specs.get(carrier).map(|s: &aloft_body::LinkSpec| s.name.clone());
                    specs.push(link_spec(joint.child.clone(), name, moves.spec, &at));
                    links.push(RigidLink { joint: index, motion: moves.motion, q_offset: 0 });
                    let link_from_body = Isometry3::translation(-moves.centre.x, -moves.centre.y, -moves.centre.z);
                    sums.push(joint.inertia.transformed(&link_from_body).to_phi());
                    home.push((specs.len() - 1, link_from_body));
                    if moves.stray_m > 1e-4 {
                        remarks.push(format!(
                            "joint `{}` also slides: its centre is held where it strays least, by {:.1} mm at most",
                            joint.name,
                            1e3 * moves.stray_m
                        ));
                    }
                }
            }
        }
        if !tree.refused.is_empty() {
            let parts = tree.refused.join("; ");
            return Err(RobotError::model(&osim.file, format!("parts that a pipeline cannot use: {parts}")));
        }
        let mut inertias = Vec::new();
        for (spec, sum) in specs.iter_mut().zip(&sums) {
            let (inertia, changed) = made_solid(sum);
            remarks.extend(changed.map(|what| format!("body `{}`: {what}", spec.name)));
            spec.inertia = Some(inertia);
            inertias.push(inertia);
        }
        let spec = ModelSpec::new(osim.name.clone(), specs);
        let model = Model::from_spec(&spec).map_err(|e| RobotError::model(&osim.file, e.to_string()))?;
        for (link, of) in links.iter_mut().zip(&model.links) {
            link.q_offset = of.joint.q_offset;
        }
        if !osim.unplaced_markers.is_empty() {
            let names = osim.unplaced_markers.join(", ");
            remarks.push(format!("markers on frames that are no bodies are not used: {names}"));
        }
        Ok(Self { spec, model, merged, remarks, held, links, home, inertias })
    }

    /// The link that carries a marker.
    pub fn link_of(&self, marker: &OsimMarker) -> &str {
        &self.model.links[self.home[marker.joint].0].name
    }

    /// Mass of all links, kg.
    pub fn mass_kg(&self) -> f64 {
        self.inertias.iter().map(|i| i.mass_kg).sum()
    }

    /// Inertia of each link as the file says, in the link's frame.
    pub fn inertias(&self) -> &[LinkInertia] {
        &self.inertias
    }

    /// The subject: the file's geometry, markers and inertias as they are, masses scaled to the
    /// mass from the scale.
    pub fn subject(
        &self,
        osim: &OsimModel,
        facts: PersonFacts,
        gravity_mps2: Vector3<f64>,
        spread: PriorSpread,
    ) -> Subject {
        let mut model = self.model.clone();
        model.gravity_mps2 = gravity_mps2;
        let scale = facts.mass_kg / self.mass_kg();
        let scaled = |i: &LinkInertia| LinkInertia {
            mass_kg: i.mass_kg * scale,
            inertia_com_kgm2: i.inertia_com_kgm2 * scale,
            ..*i
        };
        let sd =
            PriorSd { mass_rel: spread.mass_rel, com_m: spread.com_m, radius_rel: spread.radius_rel, together: 0.0 };
        let markers = osim.markers.iter().map(|m| {
            let (link, place) = self.home[m.joint];
            let position_m = place.transform_point(&m.on_body_m.into()).coords;
            ModelMarker { label: m.name.clone(), link, position_m, weight: 1.0 }
        });
        let upright = world_from_ground();
        Subject {
            static_q: self.posture(osim, &osim.values(&Default::default()), &upright),
            prior_sd: vec![sd; self.inertias.len()],
            prior: self.inertias.iter().map(scaled).collect(),
            markers: markers.collect(),
            provenance: vec![format!(
                "geometry and marker places: {} as they are; prior inertias: the same file, masses times {scale:.4} to add up to the body mass",
                osim.file
            )],
            facts,
            model,
            estimated: None,
            boxes: Vec::new(),
        }
    }

    /// `q` for values of all of the file's coordinates.
    pub fn posture(&self, osim: &OsimModel, values: &[f64], world_from_ground: &UnitQuaternion<f64>) -> Vec<f64> {
        let poses = osim.poses(values);
        let mut q = self.model.neutral();
        for link in &self.links {
            let at = link.q_offset;
            match (&link.motion, osim.joints[link.joint].parent) {
                (Motion::Hinge(axis), _) => {
                    let axis = &osim.joints[link.joint].rotations[*axis];
                    q[at] = axis.function.value(axis.coordinate.map_or(0.0, |c| values[c]));
                }
                (Motion::Ball, Some(parent)) => {
                    let turned = poses[parent].rotation.inverse() * poses[link.joint].rotation;
                    q[at..at + 4].copy_from_slice(turned.coords.as_slice());
                }
                _ => {
                    let pose = world_from_ground * poses[link.joint];
                    q[..3].copy_from_slice(pose.translation.vector.as_slice());
                    q[3..7].copy_from_slice(pose.rotation.coords.as_slice());
                }
            }
        }
        q
    }

    /// Inertias of the file's bodies, in their own frames, from those of the links: a body with
    /// others on it gets the rest, these stay as they are in the file times `scale`; where that
    /// leaves no body, they are reduced in proportion.
    pub(super) fn of_bodies(
        &self,
        osim: &OsimModel,
        links: &[LinkInertia],
        scale: f64,
    ) -> Result<Vec<(String, LinkInertia)>, String> {
        let mut out: Vec<(String, LinkInertia)> = Vec::new();
        for (index, (link, total)) in self.links.iter().zip(links).enumerate() {
            let riding: Vec<usize> =
                (0..osim.joints.len()).filter(|j| *j != link.joint && self.home[*j].0 == index).collect();
            let times = |j: usize, share: f64| {
                let i = &osim.joints[j].inertia;
                LinkInertia { mass_kg: i.mass_kg * share, inertia_com_kgm2: i.inertia_com_kgm2 * share, ..*i }
            };
            let sum: Phi = riding.iter().map(|j| times(*j, scale).transformed(&self.home[*j].1).to_phi()).sum();
            let share = [1.0, 0.75, 0.5, 0.25, 0.0]
                .into_iter()
                .find(|share| pseudo_inertia(&(total.to_phi() - sum * *share)).cholesky().is_some());
            let name = &osim.joints[link.joint].child;
            let share = share.ok_or_else(|| format!("the inertia for `{name}` is not that of any body"))?;
            let rest = LinkInertia::from_phi(&(total.to_phi() - sum * share));
            out.push((name.clone(), rest.transformed(&self.home[link.joint].1.inverse())));
            out.extend(riding.iter().map(|j| (osim.joints[*j].child.clone(), times(*j, scale * share))));
        }
        Ok(out)
    }
}

/// The world (Z up) from OpenSim's ground (Y up): `(x, y, z) → (x, −z, y)`.
pub(super) fn world_from_ground() -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2)
}
