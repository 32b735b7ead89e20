//! First guess of an object's geometry: rigid clouds from the static, poses by fitting them, joints
//! by SARA and SCoRE.

use super::links::{Links, error};
use super::{ObjectInput, ObjectOptions};
use crate::ScaleError;
use crate::bundle::{Bundle, BundleFrame, BundleMarker};
use crate::functional::{sara, score};
use crate::geometry::{apply_inverse, axes_z_x, pose};
use crate::object_spec::ObjectJoint;
use crate::statics::StaticPose;
use aloft_body::rigid::fit_pose_of_seen;
use aloft_body::{JointSpec, LinkSpec, Model, ModelSpec};
use aloft_trial::Trial;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// Mean position of every marker in the static (the mean, not the median: the noise is white, and
/// an object on a table does not sway).
pub(super) fn static_markers(
    links: &Links<'_>,
    trial: &Trial,
    statics: &StaticPose,
) -> Result<Vec<Vector3<f64>>, ScaleError> {
    links
        .markers
        .iter()
        .map(|&(link, label)| {
            let missing = || {
                error(links.spec, &links.spec.links[link].name, format!("marker `{label}` is not in {}", trial.name))
            };
            let index = trial.markers.index(label).ok_or_else(missing)?;
            let centre = statics.positions[index].ok_or_else(missing)?;
            let (mut sum, mut n) = (Vector3::zeros(), 0usize);
            for &f in &statics.frames {
                if let Some(p) = trial.markers.position(index, f).filter(|p| (p - centre).norm() < 0.01) {
                    sum += p;
                    n += 1;
                }
            }
            Ok(if n == 0 { centre } else { sum / n as f64 })
        })
        .collect()
}

/// Each link's markers as a cloud: centred, in world axes of the static.
pub(super) struct Clouds {
    /// Indices of the markers of each link.
    own: Vec<Vec<usize>>,
    centre: Vec<Vector3<f64>>,
    local: Vec<Vec<Vector3<f64>>>,
}

impl Clouds {
    pub(super) fn new(links: &Links<'_>, at_rest: &[Vector3<f64>]) -> Self {
        let n = links.parents.len();
        let own: Vec<Vec<usize>> =
            (0..n).map(|l| (0..at_rest.len()).filter(|&k| links.markers[k].0 == l).collect()).collect();
        let centre: Vec<Vector3<f64>> =
            own.iter().map(|o| o.iter().map(|&k| at_rest[k]).sum::<Vector3<f64>>() / o.len() as f64).collect();
        let local = own.iter().zip(&centre).map(|(o, c)| o.iter().map(|&k| at_rest[k] - c).collect()).collect();
        Self { own, centre, local }
    }
}

/// Frames of motion.
#[derive(Default)]
pub(super) struct Motion {
    /// Markers of each frame, m, world; NaN where missing.
    pub measured: Vec<Vec<Vector3<f64>>>,
    /// Pose of each link's cloud in each frame.
    pub poses: Vec<Vec<Isometry3<f64>>>,
}

/// Frames of the motion trials in which every link shows three markers, thinned to the wanted
/// number, and each link's pose.
pub(super) fn motion_frames(
    links: &Links<'_>,
    clouds: &Clouds,
    input: &ObjectInput<'_>,
    options: &ObjectOptions,
) -> Result<Motion, ScaleError> {
    let total: usize = input.motion_trials.iter().map(|t| t.markers.n_frames).sum();
    let stride = total.div_ceil(options.max_frames.max(1)).max(1);
    let mut motion = Motion::default();
    for trial in input.motion_trials {
        let index: Vec<usize> = links
            .markers
            .iter()
            .map(|&(link, label)| {
                trial.markers.index(label).ok_or_else(|| {
                    error(
                        links.spec,
                        &links.spec.links[link].name,
                        format!("marker `{label}` is not in {}", trial.name),
                    )
                })
            })
            .collect::<Result<_, _>>()?;
        for frame in (0..trial.markers.n_frames).step_by(stride) {
            let seen: Vec<Vector3<f64>> = index
                .iter()
                .map(|&i| trial.markers.position(i, frame).unwrap_or_else(|| Vector3::repeat(f64::NAN)))
                .collect();
            let poses: Option<Vec<Isometry3<f64>>> = (0..clouds.own.len())
                .map(|l| {
                    let measured: Vec<Vector3<f64>> = clouds.own[l].iter().map(|&k| seen[k]).collect();
                    fit_pose_of_seen(&clouds.local[l], &measured).map(|(pose, _)| pose)
                })
                .collect();
            if let Some(poses) = poses {
                motion.measured.push(seen);
                motion.poses.push(poses);
            }
        }
    }
    if links.parents.len() > 1 && motion.poses.len() < 10 {
        return Err(ScaleError::Functional {
            problem: format!(
                "{} of {total} frames show three markers on every link; at least ten are needed",
                motion.poses.len()
            ),
        });
    }
    Ok(motion)
}

/// A model with the joints of SARA and SCoRE, marker coordinates from the static, and coordinates
/// of every frame.
pub(super) fn first_guess(
    links: &Links<'_>,
    clouds: &Clouds,
    at_rest: &[Vector3<f64>],
    static_frames: usize,
    motion: Motion,
    options: &ObjectOptions,
) -> Result<(Bundle, Vec<f64>), ScaleError> {
    let spec = links.spec;
    let n = links.parents.len();
    let mut model = Model::from_spec(&ModelSpec {
        name: spec.name.clone(),
        links: spec
            .links
            .iter()
            .map(|l| LinkSpec {
                name: l.name.clone(),
                parent: l.parent.clone(),
                joint: match l.joint {
                    None => JointSpec::Free,
                    Some(ObjectJoint::Hinge { .. }) => JointSpec::RevoluteZ,
                    Some(ObjectJoint::Ball) => JointSpec::Spherical,
                },
                position_m: [0.0; 3],
                rpy_rad: [0.0; 3],
                inertia: None,
            })
            .collect(),
        carries: Default::default(),
    })?;
    if let Some(g) = spec.gravity_mps2 {
        model.gravity_mps2 = Vector3::new(0.0, 0.0, -g);
    }
    // Working frame of each link relative to its cloud, and its pose in the world of the static.
    let mut cloud_from_link: Vec<Isometry3<f64>> = vec![Isometry3::identity(); n];
    let at_rest_pose = |l: usize, cloud_from_link: &[Isometry3<f64>]| {
        pose(&clouds.centre[l], &UnitQuaternion::identity()) * cloud_from_link[l]
    };
    let mut guesses = vec![f64::NAN; n];
    for l in 0..n {
        let Some(p) = links.parents[l] else { continue };
        let column = |k: usize| motion.poses.iter().map(|f| f[k]).collect::<Vec<_>>();
        let (parents, children) = (column(p), column(l));
        let named = |e: ScaleError| match e {
            ScaleError::Functional { problem } => {
                ScaleError::Functional { problem: format!("{} `{}`: {problem}", spec.name, spec.links[l].name) }
            }
            other => other,
        };
        cloud_from_link[l] = match spec.links[l].joint {
            Some(ObjectJoint::Ball) => {
                let c = score(&parents, &children).map_err(named)?;
                guesses[l] = c.residual_rms_m;
                pose(&c.in_child, &UnitQuaternion::identity())
            }
            _ => {
                let a = sara(&parents, &children).map_err(named)?;
                guesses[l] = a.residual_rms_m;
                let least = [Vector3::x(), Vector3::y(), Vector3::z()]
                    .into_iter()
                    .min_by(|u, v| u.dot(&a.direction_in_child).abs().total_cmp(&v.dot(&a.direction_in_child).abs()))
                    .unwrap_or_else(Vector3::x);
                let axes = axes_z_x(&a.direction_in_child, &least)
                    .ok_or_else(|| error(spec, &spec.links[l].name, "its axis has no direction"))?;
                pose(&a.point_in_child, &axes)
            }
        };
        if guesses[l] > options.joint_limit_m {
            return Err(error(
                spec,
                &spec.links[l].name,
                format!("the motion does not turn about one joint: its sides are {:.0} mm apart", 1000.0 * guesses[l]),
            ));
        }
    }
    for l in 0..n {
        if let Some(p) = links.parents[l] {
            let in_parent = at_rest_pose(p, &cloud_from_link).inverse() * at_rest_pose(l, &cloud_from_link);
            model.links[l].joint.parent_from_joint = match spec.links[l].joint {
                Some(ObjectJoint::Ball) => Isometry3::from_parts(in_parent.translation, UnitQuaternion::identity()),
                _ => in_parent,
            };
        }
    }
    let markers = links
        .markers
        .iter()
        .zip(at_rest)
        .map(|(&(l, _), p)| BundleMarker { link: l, position_m: apply_inverse(&at_rest_pose(l, &cloud_from_link), p) })
        .collect();
    let coordinates = |world_from_link: &[Isometry3<f64>]| {
        let mut q = model.neutral();
        for (l, link) in model.links.iter().enumerate() {
            let at = link.joint.q_offset;
            match links.parents[l] {
                None => {
                    q[at..at + 3].copy_from_slice(world_from_link[l].translation.vector.as_slice());
                    q[at + 3..at + 7].copy_from_slice(world_from_link[l].rotation.coords.as_slice());
                }
                Some(p) => {
                    let turn = (world_from_link[p] * link.joint.parent_from_joint).rotation.inverse()
                        * world_from_link[l].rotation;
                    match spec.links[l].joint {
                        Some(ObjectJoint::Ball) => q[at..at + 4].copy_from_slice(turn.coords.as_slice()),
                        _ => {
                            let x = turn * Vector3::x();
                            q[at] = x.y.atan2(x.x);
                        }
                    }
                }
            }
        }
        q
    };
    let rest: Vec<Isometry3<f64>> = (0..n).map(|l| at_rest_pose(l, &cloud_from_link)).collect();
    // First frame: the static. It has the weight of many frames, but not so many that a slow drift
    // in it would dominate.
    let mut all = vec![BundleFrame {
        measured: at_rest.to_vec(),
        weight: static_frames.clamp(1, 200) as f64,
        q: coordinates(&rest),
    }];
    for (measured, clouds_in_world) in motion.measured.into_iter().zip(&motion.poses) {
        let world: Vec<Isometry3<f64>> = clouds_in_world.iter().zip(&cloud_from_link).map(|(w, c)| w * c).collect();
        all.push(BundleFrame { measured, weight: 1.0, q: coordinates(&world) });
    }
    Ok((Bundle { model, markers, frames: all }, guesses))
}
