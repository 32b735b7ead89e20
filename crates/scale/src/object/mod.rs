//! An object of rigid links: frames from markers, joints from motion, a rough prior from size.
//!
//! Poses of each link's marker cloud → SCoRE or SARA for a first guess of every joint → `bundle`:
//! one least-squares problem over static and calibration trials (and throws, where given) → frames
//! as the specification defines them.

mod frames;
mod guess;
mod links;
mod size;

use crate::ScaleError;
use crate::bundle::{Bundle, BundleOutcome};
use crate::geometry::z_of;
use crate::object_spec::{ObjectJoint, ObjectSpec};
use crate::statics::{QuietOptions, StaticPose};
use aloft_body::{State, Subject};
use aloft_trial::Trial;
use frames::name_frames;
use guess::{Clouds, first_guess, motion_frames, static_markers};
use links::{Links, read_links};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Input for scaling an object.
#[derive(Debug, Clone, Copy)]
pub struct ObjectInput<'a> {
    /// Specification by the laboratory.
    pub spec: &'a ObjectSpec,
    /// The trial in which the object lies still with all angles zero.
    pub static_trial: &'a Trial,
    /// Trials in which the joints move. More trials (including the throws) improve the geometry.
    pub motion_trials: &'a [&'a Trial],
}

/// Options of object scaling.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ObjectOptions {
    /// How quiet frames are found in the static trial.
    pub quiet: QuietOptions,
    /// Number of frames used from all motion trials together, evenly spaced.
    pub max_frames: usize,
    /// Maximum number of iterations of the refinement.
    pub max_iterations: usize,
    /// A joint is rejected if its two segments disagree by more than this after the first guess, m.
    pub joint_limit_m: f64,
}

impl Default for ObjectOptions {
    fn default() -> Self {
        Self { quiet: QuietOptions::default(), max_frames: 40_000, max_iterations: 20, joint_limit_m: 0.05 }
    }
}

/// One estimated joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ObjectJointReport {
    /// Child link.
    pub link: String,
    /// Joint centre (hinge: origin of the link) in the parent's frame, m.
    #[serde(alias = "center_in_parent_m")]
    pub centre_in_parent_m: Vector3<f64>,
    /// Direction of a hinge in the parent's frame, unit; none for a ball joint.
    pub axis_in_parent: Option<Vector3<f64>>,
    /// Root mean square disagreement of the two segments in the first guess (SARA, SCoRE), m.
    pub first_guess_rms_m: f64,
    /// Range of a hinge's angle, or of the rotation angle of a ball joint, over the frames used,
    /// rad.
    pub range_rad: (f64, f64),
}

/// Results of object scaling.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ObjectReport {
    /// Frames used for the refinement.
    pub frames: usize,
    /// Iterations of the refinement.
    pub iterations: usize,
    /// Remaining marker noise per coordinate, m: the camera noise if the object is rigid and its
    /// joints are as specified.
    pub noise_m: f64,
    /// Observations left out as outliers.
    pub outliers: usize,
    /// Root mean square residual of each marker, m, in the order of the subject's markers; `None`
    /// for a marker never seen in motion.
    pub marker_rms_m: Vec<(String, Option<f64>)>,
    /// Joints.
    pub joints: Vec<ObjectJointReport>,
    /// Warnings in words.
    pub warnings: Vec<String>,
}

/// A scaled object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScaledObject {
    /// Model, markers, prior.
    pub subject: Subject,
    /// Results of the estimation.
    pub report: ObjectReport,
}

/// Builds an object's model from a static trial and trials in which it moves.
///
/// # Errors
/// [`ScaleError::Object`] for a contradictory specification or a marker missing in the trials;
/// [`ScaleError::Functional`] if the motion does not determine the joints;
/// [`ScaleError::NoFrames`].
pub fn scale_object(input: &ObjectInput<'_>, options: &ObjectOptions) -> Result<ScaledObject, ScaleError> {
    let links = read_links(input.spec)?;
    let statics = StaticPose::find(input.static_trial, None, &options.quiet)?;
    let at_rest = static_markers(&links, input.static_trial, &statics)?;
    let clouds = Clouds::new(&links, &at_rest);
    let motion = motion_frames(&links, &clouds, input, options)?;
    let mut warnings = Vec::new();
    let (mut bundle, guesses) = first_guess(&links, &clouds, &at_rest, statics.frames.len(), motion, options)?;
    let used = bundle.frames.len();
    let outcome = bundle.refine(options.max_iterations)?;
    if outcome.iterations == options.max_iterations {
        warnings.push(format!("the geometry still moved after {} iterations", outcome.iterations));
    }
    let subject = name_frames(&links, &bundle, input)?;
    let report = report(&links, &bundle, &subject, &guesses, outcome, used, warnings);
    Ok(ScaledObject { subject, report })
}

fn report(
    links: &Links<'_>,
    bundle: &Bundle,
    subject: &Subject,
    guesses: &[f64],
    outcome: BundleOutcome,
    frames: usize,
    mut warnings: Vec<String>,
) -> ObjectReport {
    let mut sums = vec![(0.0, 0usize); bundle.markers.len()];
    let mut ranges = vec![(f64::INFINITY, f64::NEG_INFINITY); links.parents.len()];
    let mut state = State::new(&bundle.model);
    for frame in bundle.frames.iter().skip(1) {
        state.forward_position(&bundle.model, &frame.q);
        for (k, (m, p)) in bundle.markers.iter().zip(&frame.measured).enumerate() {
            if p.x.is_finite() {
                sums[k].0 += (p - state.point_in_world(m.link, &m.position_m)).norm_squared();
                sums[k].1 += 1;
            }
        }
        for (l, range) in ranges.iter_mut().enumerate() {
            if let Some(p) = links.parents[l] {
                let rest = bundle.model.links[l].joint.parent_from_joint.rotation;
                let turn =
                    rest.inverse() * state.world_from_link[p].rotation.inverse() * state.world_from_link[l].rotation;
                let x = turn * Vector3::x();
                let hinge = matches!(links.spec.links[l].joint, Some(ObjectJoint::Hinge { .. }));
                let angle = if hinge { x.y.atan2(x.x) } else { turn.angle() };
                *range = (range.0.min(angle), range.1.max(angle));
            }
        }
    }
    let joints = (0..links.parents.len())
        .filter(|&l| links.parents[l].is_some())
        .map(|l| {
            let place = &subject.model.links[l].joint.parent_from_joint;
            let hinge = matches!(links.spec.links[l].joint, Some(ObjectJoint::Hinge { .. }));
            if ranges[l].1 - ranges[l].0 < 0.3 {
                warnings.push(format!(
                    "{}: the joint moved by {:.0}° only; its place is poorly seen",
                    links.spec.links[l].name,
                    (ranges[l].1 - ranges[l].0).to_degrees()
                ));
            }
            ObjectJointReport {
                link: links.spec.links[l].name.clone(),
                centre_in_parent_m: place.translation.vector,
                axis_in_parent: hinge.then(|| z_of(&place.rotation)),
                first_guess_rms_m: guesses[l],
                range_rad: ranges[l],
            }
        })
        .collect();
    ObjectReport {
        frames,
        iterations: outcome.iterations,
        noise_m: outcome.noise_m,
        outliers: outcome.outliers,
        marker_rms_m: links
            .markers
            .iter()
            .zip(&sums)
            .map(|((_, label), (s, n))| ((*label).to_owned(), (*n > 0).then(|| (s / *n as f64).sqrt())))
            .collect(),
        joints,
        warnings,
    }
}
