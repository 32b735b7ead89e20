//! The rigid tree of a model: hinges and balls with fixed centres, which the stages of a pipeline use.
//!
//! Frames of links are those of the file's bodies, moved to the joint's centre. A joint that turns
//! about one axis is a hinge, others are balls. Where a joint also slides as it turns (a knee of
//! OpenSim), the centre is the point that stays nearest to itself over the joint's range, and how
//! far it strays is stated. Bodies that cannot move on their own ride on others: welds, locked
//! joints, joints beyond which there is no marker, a patella.

use super::exact::link_spec;
use super::{Joint, OsimModel};
use crate::RobotError;
use crate::subject::PriorSpread;
use aloft_body::inertia::pseudo_inertia;
use aloft_body::subject::PriorSd;
use aloft_body::{JointSpec, LinkInertia, Model, ModelMarker, ModelSpec, PersonFacts, Phi, Subject};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, SymmetricEigen, Unit, UnitQuaternion, Vector3};

/// Farthest that a joint's centre may stray over its range, m.
const STRAY_M: f64 = 0.02;
/// Values at which a coordinate is tried where its joint's centre is sought.
const SAMPLES: usize = 21;
/// Angles tried without a range in the file, rad.
const RANGE_RAD: f64 = 1.6;
/// Smallest second moment of a link as a share of its largest.
const LEAST_SHARE: f64 = 1e-3;
/// Mass that a moving body without mass is given, kg.
const LEAST_MASS_KG: f64 = 1e-3;

/// A body that rides on a link.
#[derive(Debug, Clone, PartialEq)]
pub struct MergedBody {
    /// Name of the body in the file.
    pub body: String,
    /// The link on which it rides.
    pub link: String,
    /// Why, in words.
    pub why: String,
}

/// How a link follows the file's bodies.
#[derive(Debug, Clone)]
enum Motion {
    /// Pose in the world.
    Free,
    /// Angle of one axis of the joint.
    Hinge(usize),
    /// Rotation in the parent link.
    Ball,
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
                Kind::Rides(why) => {
                    let place = link_from_parent * joint.body_in_parent(&rest);
                    sums[carrier] += joint.inertia.transformed(&place).to_phi();
                    home.push((carrier, place));
                    let link = specs.get(carrier).map_or(String::new(), |s: &aloft_body::LinkSpec| s.name.clone());
                    merged.push(MergedBody { body: joint.child.clone(), link, why });
                }
                Kind::Moves(moves) => {
                    let at = link_from_parent * moves.parent_from_link;
                    let name = specs.get(carrier).map(|s: &aloft_body::LinkSpec| s.name.clone());
                    specs.push(link_spec(joint.child.clone(), name, moves.spec, &at));
                    links.push(RigidLink { joint: index, motion: moves.motion, q_offset: 0 });
                    let link_from_body = Isometry3::translation(-moves.center.x, -moves.center.y, -moves.center.z);
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
    pub fn link_of(&self, marker: &super::OsimMarker) -> &str {
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

    /// The subject: the file's geometry, markers and inertias as they are, masses scaled to the mass
    /// from the scale.
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
        let sd = PriorSd { mass_rel: spread.mass_rel, com_m: spread.com_m, radius_rel: spread.radius_rel };
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

/// Joints beyond which there is a marker.
fn marked(osim: &OsimModel, seen: Option<&[String]>) -> Vec<bool> {
    let mut out = vec![false; osim.joints.len()];
    let used = |m: &&super::OsimMarker| seen.is_none_or(|s| s.contains(&m.name));
    for marker in osim.markers.iter().filter(used) {
        osim.path(marker.joint).into_iter().for_each(|j| out[j] = true);
    }
    out
}

/// A coordinate that no marker sees, or that the file locks.
fn is_held(osim: &OsimModel, coordinate: usize, marked: &[bool]) -> bool {
    let moves = |j: &Joint, c: usize| j.axes().any(|a| a.coordinate == Some(c) && !a.function.is_constant());
    let follows = |c: usize| osim.all[c].follows.as_ref().is_some_and(|f| f.0 == coordinate);
    let seen =
        osim.joints.iter().zip(marked).any(|(j, marked)| {
            *marked && (moves(j, coordinate) || (0..osim.all.len()).any(|c| follows(c) && moves(j, c)))
        });
    osim.all[coordinate].locked || !seen
}

/// The joint of a link that moves.
struct Moves {
    spec: JointSpec,
    motion: Motion,
    /// The link's frame at zero in the parent body's frame.
    parent_from_link: Isometry3<f64>,
    /// The link's origin in the body's frame, m.
    center: Vector3<f64>,
    stray_m: f64,
}

enum Kind {
    Rides(String),
    Moves(Moves),
}

struct Builder<'a> {
    osim: &'a OsimModel,
    held: &'a [bool],
    marked: &'a [bool],
    rest: &'a [f64],
    refused: Vec<String>,
}

impl Builder<'_> {
    /// The coordinate that decides about an axis, if it moves.
    fn moved_by(&self, axis: &super::Axis) -> Option<usize> {
        let own = axis.coordinate.filter(|_| !axis.function.is_constant())?;
        let by = self.osim.all[own].follows.as_ref().map_or(own, |f| f.0);
        (!self.held[by] && !self.osim.all[own].locked).then_some(by)
    }

    fn kind(&mut self, index: usize) -> Kind {
        let joint = &self.osim.joints[index];
        if !self.marked[index] {
            let own = joint.axes().filter_map(|a| a.coordinate).collect::<Vec<_>>();
            let coupled = !own.is_empty() && own.iter().all(|c| self.osim.all[*c].follows.is_some());
            return Kind::Rides(if own.is_empty() {
                "welded".to_owned()
            } else if coupled {
                "it follows another joint and carries no marker".to_owned()
            } else {
                "no marker is on it or beyond".to_owned()
            });
        }
        let turning: Vec<usize> =
            (0..joint.rotations.len()).filter(|a| self.moved_by(&joint.rotations[*a]).is_some()).collect();
        let sliding = joint.translations.iter().any(|a| self.moved_by(a).is_some());
        if turning.is_empty() && !sliding {
            let welded = joint.axes().all(|a| a.coordinate.is_none_or(|_| a.function.is_constant()));
            return Kind::Rides(if welded { "welded" } else { "its joint is locked in the file" }.to_owned());
        }
        let at_rest = joint.body_in_parent(self.rest);
        let (in_parent, center, stray_m) = if sliding {
            self.center(index)
        } else {
            let center = joint.body_from_joint.translation.vector;
            (at_rest.transform_point(&center.into()).coords, center, 0.0)
        };
        if turning.is_empty() || stray_m > STRAY_M {
            self.refused.push(if turning.is_empty() {
                format!("the joint `{}`, which slides without turning", joint.name)
            } else {
                format!("the joint `{}`, which slides by {:.0} mm over its range", joint.name, 1e3 * stray_m)
            });
        }
        let place = |rotation| Isometry3::from_parts(in_parent.into(), rotation);
        let moves = match turning.as_slice() {
            [one] => {
                let turn = |a: &super::Axis| {
                    UnitQuaternion::from_scaled_axis(
                        a.axis * a.function.value(a.coordinate.map_or(0.0, |c| self.rest[c])),
                    )
                };
                let all = |axes: &[super::Axis]| axes.iter().map(turn).fold(UnitQuaternion::identity(), |r, t| r * t);
                let (before, after) = (all(&joint.rotations[..*one]), all(&joint.rotations[one + 1..]));
                let to_body = joint.body_from_joint.rotation * after.inverse();
                let zero = joint.parent_from_joint.rotation * before * to_body.inverse();
                let own = joint.rotations[*one].axis;
                // an axis whose length is not one turns by a multiple of its function
                match Unit::try_new_and_get(own, 1e-9).filter(|(_, length)| (length - 1.0).abs() < 1e-6) {
                    Some((axis, _)) => Moves {
                        spec: JointSpec::Revolute((to_body * axis.into_inner()).into()),
                        motion: Motion::Hinge(*one),
                        parent_from_link: place(zero),
                        center,
                        stray_m,
                    },
                    None => self.ball(place(UnitQuaternion::identity()), center, stray_m),
                }
            }
            _ => self.ball(place(UnitQuaternion::identity()), center, stray_m),
        };
        Kind::Moves(moves)
    }

    fn ball(&self, parent_from_link: Isometry3<f64>, center: Vector3<f64>, stray_m: f64) -> Moves {
        Moves { spec: JointSpec::Spherical, motion: Motion::Ball, parent_from_link, center, stray_m }
    }

    /// The point of a sliding joint's body that stays nearest to one point of the parent over the
    /// range of its coordinates: in the parent's and in the body's frame, and how far it strays, m.
    fn center(&self, index: usize) -> (Vector3<f64>, Vector3<f64>, f64) {
        let joint = &self.osim.joints[index];
        let mut by: Vec<usize> = joint.axes().filter_map(|a| self.moved_by(a)).collect();
        by.sort_unstable();
        by.dedup();
        let mut poses = Vec::new();
        for coordinate in by {
            let c = &self.osim.all[coordinate];
            let reach = if c.is_angle { RANGE_RAD } else { 0.1 };
            let [low, high] = c.range.unwrap_or([c.default - reach, c.default + reach]);
            let (low, high) = (low.max(c.default - reach), high.min(c.default + reach));
            for k in 0..SAMPLES {
                let mut values = self.rest.to_vec();
                values[coordinate] = low + (high - low) * k as f64 / (SAMPLES - 1) as f64;
                self.osim.couple(&mut values);
                poses.push(joint.body_in_parent(&values));
            }
        }
        // a − X c = 0 over all poses X, with a weak pull towards the joint's own origins
        let pull = 1e-3;
        let mut normal = DMatrix::zeros(6, 6);
        let mut right = DVector::zeros(6);
        let own = joint.body_from_joint.translation.vector;
        let theirs = joint.body_in_parent(self.rest).transform_point(&own.into()).coords;
        for k in 0..3 {
            normal[(k, k)] += pull;
            normal[(3 + k, 3 + k)] += pull;
            right[k] += pull * theirs[k];
            right[3 + k] += pull * own[k];
        }
        for pose in &poses {
            let r: Matrix3<f64> = pose.rotation.to_rotation_matrix().into_inner();
            let t = pose.translation.vector;
            let mut row = DMatrix::zeros(3, 6);
            row.view_mut((0, 0), (3, 3)).copy_from(&Matrix3::identity());
            row.view_mut((0, 3), (3, 3)).copy_from(&-r);
            normal += row.transpose() * &row;
            right += row.transpose() * DVector::from_column_slice(t.as_slice());
        }
        let Some(found) = normal.cholesky().map(|c| c.solve(&right)) else { return (theirs, own, f64::INFINITY) };
        let (a, c) = (Vector3::new(found[0], found[1], found[2]), Vector3::new(found[3], found[4], found[5]));
        let stray = poses.iter().map(|x| (x.transform_point(&c.into()).coords - a).norm()).fold(0.0, f64::max);
        (a, c, stray)
    }
}

/// The inertia as that of a body with positive density, and what was changed, in words.
fn made_solid(sum: &Phi) -> (LinkInertia, Option<String>) {
    let mut inertia = LinkInertia::from_phi(sum);
    let mut changed = None;
    if inertia.mass_kg < LEAST_MASS_KG {
        changed = Some(format!("it moves and has no mass: taken as {} g", 1e3 * LEAST_MASS_KG));
        inertia.mass_kg = LEAST_MASS_KG;
        inertia.com_m = Vector3::zeros();
        inertia.inertia_com_kgm2 = Matrix3::from_diagonal_element(LEAST_MASS_KG * 1e-4);
    }
    let second = Matrix3::from_diagonal_element(0.5 * inertia.inertia_com_kgm2.trace()) - inertia.inertia_com_kgm2;
    let eigen = SymmetricEigen::new(second);
    let least = (LEAST_SHARE * eigen.eigenvalues.max()).max(1e-9);
    if eigen.eigenvalues.min() < least {
        let raised = eigen.eigenvalues.map(|v| v.max(least));
        if eigen.eigenvalues.min() <= 0.0 {
            changed = changed.or_else(|| {
                Some("no body of positive density has its inertia: the nearest one is the prior".to_owned())
            });
        }
        let second = eigen.eigenvectors * Matrix3::from_diagonal(&raised) * eigen.eigenvectors.transpose();
        inertia.inertia_com_kgm2 = Matrix3::from_diagonal_element(second.trace()) - second;
    }
    (inertia, changed)
}
