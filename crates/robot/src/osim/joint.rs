//! Joints of a file as hinges and balls with fixed centres.

use super::model::{Axis, Joint, OsimMarker, OsimModel};
use aloft_body::JointSpec;
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Unit, UnitQuaternion, Vector3};

/// Farthest that a joint's centre may stray over its range, m.
const STRAY_M: f64 = 0.02;
/// Values at which a coordinate is tried where its joint's centre is sought.
const SAMPLES: usize = 21;
/// Angles tried without a range in the file, rad.
const RANGE_RAD: f64 = 1.6;
/// How a link follows the file's bodies.
#[derive(Debug, Clone)]
pub(super) enum Motion {
    /// Pose in the world.
    Free,
    /// Angle of one axis of the joint.
    Hinge(usize),
    /// Rotation in the parent link.
    Ball,
}

/// Joints beyond which there is a marker.
pub(super) fn marked(osim: &OsimModel, seen: Option<&[String]>) -> Vec<bool> {
    let mut out = vec![false; osim.joints.len()];
    let used = |m: &&OsimMarker| seen.is_none_or(|s| s.contains(&m.name));
    for marker in osim.markers.iter().filter(used) {
        osim.path(marker.joint).into_iter().for_each(|j| out[j] = true);
    }
    out
}

/// A coordinate that no marker sees, or that the file locks.
pub(super) fn is_held(osim: &OsimModel, coordinate: usize, marked: &[bool]) -> bool {
    let moves = |j: &Joint, c: usize| j.axes().any(|a| a.coordinate == Some(c) && !a.function.is_constant());
    let follows = |c: usize| osim.all[c].follows.as_ref().is_some_and(|f| f.0 == coordinate);
    let seen =
        osim.joints.iter().zip(marked).any(|(j, marked)| {
            *marked && (moves(j, coordinate) || (0..osim.all.len()).any(|c| follows(c) && moves(j, c)))
        });
    osim.all[coordinate].locked || !seen
}

/// The joint of a link that moves.
pub(super) struct Moves {
    pub spec: JointSpec,
    pub motion: Motion,
    /// The link's frame at zero in the parent body's frame.
    pub parent_from_link: Isometry3<f64>,
    /// The link's origin in the body's frame, m.
    pub centre: Vector3<f64>,
    pub stray_m: f64,
}

/// What becomes of a joint of the file.
pub(super) enum Kind {
    Rides { why: String, unseen: bool },
    Moves(Moves),
}

/// Decides about the joints of a file.
pub(super) struct Builder<'a> {
    pub osim: &'a OsimModel,
    pub held: &'a [bool],
    pub marked: &'a [bool],
    pub rest: &'a [f64],
    pub refused: Vec<String>,
}

impl Builder<'_> {
    /// The coordinate that decides about an axis, if it moves.
    fn moved_by(&self, axis: &Axis) -> Option<usize> {
        let own = axis.coordinate.filter(|_| !axis.function.is_constant())?;
        let by = self.osim.all[own].follows.as_ref().map_or(own, |f| f.0);
        (!self.held[by] && !self.osim.all[own].locked).then_some(by)
    }

    pub(super) fn kind(&mut self, index: usize) -> Kind {
        let joint = &self.osim.joints[index];
        if !self.marked[index] {
            let own = joint.axes().filter_map(|a| a.coordinate).collect::<Vec<_>>();
            let coupled = !own.is_empty() && own.iter().all(|c| self.osim.all[*c].follows.is_some());
            let (why, unseen) = if own.is_empty() {
                ("welded", false)
            } else if coupled {
                ("it follows another joint and carries no marker", false)
            } else {
                ("no marker is on it or beyond", true)
            };
            return Kind::Rides { why: why.to_owned(), unseen };
        }
        let turning: Vec<usize> =
            (0..joint.rotations.len()).filter(|a| self.moved_by(&joint.rotations[*a]).is_some()).collect();
        let sliding = joint.translations.iter().any(|a| self.moved_by(a).is_some());
        if turning.is_empty() && !sliding {
            let welded = joint.axes().all(|a| a.coordinate.is_none_or(|_| a.function.is_constant()));
            let why = if welded { "welded" } else { "its joint is locked in the file" };
            return Kind::Rides { why: why.to_owned(), unseen: false };
        }
        let at_rest = joint.body_in_parent(self.rest);
        let (in_parent, centre, stray_m) = if sliding {
            self.centre(index)
        } else {
            let centre = joint.body_from_joint.translation.vector;
            (at_rest.transform_point(&centre.into()).coords, centre, 0.0)
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
                let turn = |a: &Axis| {
                    UnitQuaternion::from_scaled_axis(
                        a.axis * a.function.value(a.coordinate.map_or(0.0, |c| self.rest[c])),
                    )
                };
                let all = |axes: &[Axis]| axes.iter().map(turn).fold(UnitQuaternion::identity(), |r, t| r * t);
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
                        centre,
                        stray_m,
                    },
                    None => self.ball(place(UnitQuaternion::identity()), centre, stray_m),
                }
            }
            _ => self.ball(place(UnitQuaternion::identity()), centre, stray_m),
        };
        Kind::Moves(moves)
    }

    fn ball(&self, parent_from_link: Isometry3<f64>, centre: Vector3<f64>, stray_m: f64) -> Moves {
        Moves { spec: JointSpec::Spherical, motion: Motion::Ball, parent_from_link, centre, stray_m }
    }

    /// The point of a sliding joint's body that stays nearest to one point of the parent over the
    /// range of its coordinates: in the parent's and in the body's frame, and how far it strays, m.
    fn centre(&self, index: usize) -> (Vector3<f64>, Vector3<f64>, f64) {
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
