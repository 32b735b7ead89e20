//! An object of rigid links: frames from markers, joints from motion, a rough prior from size.
//!
//! Poses of each link's marker cloud → SCoRE or SARA for a first guess of every joint → `bundle`: one least-squares problem over static and
//! calibration trials (and throws, where given) → frames as the specification defines them.

use crate::bundle::{Bundle, BundleFrame, BundleMarker, BundleOutcome};
use crate::functional::{fit_pose, sara, score};
use crate::geometry::{apply_inverse, axes_y_z, axes_z_x, pose, reject, z_of};
use crate::object_spec::{HalfPlane, ObjectFrame, ObjectJoint, ObjectLink, ObjectSpec};
use crate::prior::make_consistent;
use crate::statics::{QuietOptions, StaticPose};
use crate::ScaleError;
use aloft_body::subject::PriorSd;
use aloft_body::{JointSpec, LinkInertia, LinkSpec, Model, ModelMarker, ModelSpec, PersonFacts, State, Subject};
use aloft_trial::Trial;
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// What scaling of an object needs.
#[derive(Debug, Clone, Copy)]
pub struct ObjectInput<'a> {
    /// What the laboratory says about it.
    pub spec: &'a ObjectSpec,
    /// The trial in which it lies still with all angles zero.
    pub static_trial: &'a Trial,
    /// Trials in which the joints move. More trials (the throws themselves) make the geometry better still.
    pub motion_trials: &'a [&'a Trial],
}

/// Choices of an object's scaling.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ObjectOptions {
    /// How quiet frames are found in the static trial.
    pub quiet: QuietOptions,
    /// Frames of all motion trials together that take part, evenly spaced.
    pub max_frames: usize,
    /// Iterations of the refinement.
    pub max_iterations: usize,
    /// A joint whose two segments disagree by more than this after the first guess is no such joint, m.
    pub joint_limit_m: f64,
}

impl Default for ObjectOptions {
    fn default() -> Self {
        Self { quiet: QuietOptions::default(), max_frames: 6000, max_iterations: 20, joint_limit_m: 0.05 }
    }
}

/// A joint that was found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ObjectJointReport {
    /// Child link.
    pub link: String,
    /// Joint centre (hinge: origin of the link) in the parent's frame, m.
    pub centre_in_parent_m: Vector3<f64>,
    /// Direction of a hinge in the parent's frame, unit; NaN for a ball joint.
    pub axis_in_parent: Vector3<f64>,
    /// Root mean square disagreement of the two segments in the first guess (SARA, SCoRE), m.
    pub first_guess_rms_m: f64,
    /// Range of a hinge's angle, or of the rotation angle of a ball joint, over the frames used, rad.
    pub range_rad: (f64, f64),
}

/// What scaling of an object found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ObjectReport {
    /// Frames used for the refinement.
    pub frames: usize,
    /// Iterations it took.
    pub iterations: usize,
    /// Marker noise per coordinate that remains, m: the cameras' noise when the object is rigid and its joints are what they are said to be.
    pub noise_m: f64,
    /// Observations left out as outliers.
    pub outliers: usize,
    /// Root mean square residual of each marker, m, in the order of the subject's markers.
    pub marker_rms_m: Vec<(String, f64)>,
    /// Joints.
    pub joints: Vec<ObjectJointReport>,
    /// Oddities in words.
    pub warnings: Vec<String>,
}

/// A scaled object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScaledObject {
    /// Model, markers, prior.
    pub subject: Subject,
    /// What was found.
    pub report: ObjectReport,
}

struct Links<'a> {
    spec: &'a ObjectSpec,
    parents: Vec<Option<usize>>,
    /// Markers as (link, label), in order.
    markers: Vec<(usize, &'a str)>,
}

fn error(spec: &ObjectSpec, link: &str, problem: impl Into<String>) -> ScaleError {
    ScaleError::Object { object: spec.name.clone(), link: link.into(), problem: problem.into() }
}

fn read_links(spec: &ObjectSpec) -> Result<Links<'_>, ScaleError> {
    let mut parents = Vec::with_capacity(spec.links.len());
    let mut markers: Vec<(usize, &str)> = Vec::new();
    if spec.links.is_empty() {
        return Err(error(spec, "-", "the object has no links"));
    }
    for (i, link) in spec.links.iter().enumerate() {
        let fail = |problem: String| error(spec, &link.name, problem);
        if spec.links[..i].iter().any(|l| l.name == link.name) {
            return Err(fail("the name stands twice".into()));
        }
        let parent = match (&link.parent, i) {
            (None, 0) => None,
            (None, _) => return Err(fail("every link but the first needs a parent".into())),
            (Some(p), _) => Some(
                spec.links[..i]
                    .iter()
                    .position(|l| l.name == *p)
                    .ok_or_else(|| fail(format!("its parent `{p}` does not stand before it")))?,
            ),
        };
        match (parent, &link.joint, &link.frame) {
            (None, None, ObjectFrame::Markers { origin: Some(_), .. })
            | (Some(_), Some(ObjectJoint::Hinge { .. }), ObjectFrame::Hinge { .. })
            | (Some(_), Some(ObjectJoint::Ball), ObjectFrame::Markers { origin: None, .. }) => {}
            (None, Some(_), _) => return Err(fail("the first link has no joint".into())),
            (None, ..) => return Err(fail("the first link's frame is defined by markers, with an origin".into())),
            (Some(_), None, _) => return Err(fail("a joint to its parent is missing".into())),
            (Some(_), Some(ObjectJoint::Hinge { .. }), _) => {
                return Err(fail("a link on a hinge has a frame `by: hinge`".into()));
            }
            (Some(_), Some(ObjectJoint::Ball), _) => {
                return Err(fail("a link on a ball joint has a frame `by: markers` without an origin".into()));
            }
        }
        if link.markers.len() < 3 {
            return Err(fail(format!("{} markers; at least three are needed", link.markers.len())));
        }
        for label in &link.markers {
            if markers.iter().any(|(_, l)| l == label) {
                return Err(fail(format!("marker `{label}` stands twice")));
            }
            markers.push((i, label));
        }
        let known = |label: &String| {
            if link.markers.contains(label) { Ok(()) } else { Err(fail(format!("its frame names `{label}`, which is not its marker"))) }
        };
        match &link.frame {
            ObjectFrame::Markers { origin, y_axis, z_side } => {
                origin.iter().chain(y_axis).chain([z_side]).try_for_each(known)?;
            }
            ObjectFrame::Hinge { x_plane, .. } => known(x_plane)?,
        }
        parents.push(parent);
    }
    if !(spec.total_mass_kg > 0.0 && spec.total_mass_kg.is_finite()) {
        return Err(error(spec, "-", format!("a total mass of {} kg", spec.total_mass_kg)));
    }
    Ok(Links { spec, parents, markers })
}

/// Builds an object's model from a static trial and trials in which it moves.
///
/// # Errors
/// [`ScaleError::Object`] for a specification that contradicts itself or a marker that the trials do not have;
/// [`ScaleError::Functional`] when the motion does not show the joints; [`ScaleError::NoFrames`].
pub fn scale_object(input: &ObjectInput<'_>, options: &ObjectOptions) -> Result<ScaledObject, ScaleError> {
    let links = read_links(input.spec)?;
    let statics = StaticPose::find(input.static_trial, None, &options.quiet)?;
    let at_rest = static_markers(&links, input.static_trial, &statics)?;
    let clouds = Clouds::new(&links, &at_rest);
    let (frames, relative) = motion_frames(&links, &clouds, input, options)?;
    let mut warnings = Vec::new();
    let (mut bundle, guesses) = first_guess(&links, &clouds, &at_rest, statics.frames.len(), frames, &relative, options)?;
    let used = bundle.frames.len();
    let outcome = bundle.refine(options.max_iterations)?;
    if outcome.iterations == options.max_iterations {
        warnings.push(format!("the geometry still moved after {} iterations", outcome.iterations));
    }
    let subject = name_frames(&links, &bundle, input)?;
    let report = report(&links, &bundle, &subject, &guesses, outcome, used, warnings);
    Ok(ScaledObject { subject, report })
}

/// Mean place of every marker in the static (the mean, not the median: white noise, and a thing on a table does not sway).
fn static_markers(links: &Links<'_>, trial: &Trial, statics: &StaticPose) -> Result<Vec<Vector3<f64>>, ScaleError> {
    links
        .markers
        .iter()
        .map(|&(link, label)| {
            let missing = || error(links.spec, &links.spec.links[link].name, format!("marker `{label}` is not in {}", trial.name));
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
struct Clouds {
    /// Indices of the markers of each link.
    own: Vec<Vec<usize>>,
    centre: Vec<Vector3<f64>>,
    local: Vec<Vec<Vector3<f64>>>,
}

impl Clouds {
    fn new(links: &Links<'_>, at_rest: &[Vector3<f64>]) -> Self {
        let n = links.parents.len();
        let own: Vec<Vec<usize>> =
            (0..n).map(|l| (0..at_rest.len()).filter(|&k| links.markers[k].0 == l).collect()).collect();
        let centre: Vec<Vector3<f64>> =
            own.iter().map(|o| o.iter().map(|&k| at_rest[k]).sum::<Vector3<f64>>() / o.len() as f64).collect();
        let local = own.iter().zip(&centre).map(|(o, c)| o.iter().map(|&k| at_rest[k] - c).collect()).collect();
        Self { own, centre, local }
    }
}

/// A frame's markers and the pose of each link's cloud.
type Posed = (Vec<Vector3<f64>>, Vec<Isometry3<f64>>);

/// Frames of the motion trials in which every link shows three markers, thinned to the wanted number, and each link's pose.
fn motion_frames(
    links: &Links<'_>,
    clouds: &Clouds,
    input: &ObjectInput<'_>,
    options: &ObjectOptions,
) -> Result<(Vec<Vec<Vector3<f64>>>, Vec<Vec<Isometry3<f64>>>), ScaleError> {
    let total: usize = input.motion_trials.iter().map(|t| t.markers.n_frames).sum();
    let stride = total.div_ceil(options.max_frames.max(1)).max(1);
    let mut posed: Vec<Posed> = Vec::new();
    for trial in input.motion_trials {
        let index: Vec<usize> = links
            .markers
            .iter()
            .map(|&(link, label)| {
                trial.markers.index(label).ok_or_else(|| {
                    error(links.spec, &links.spec.links[link].name, format!("marker `{label}` is not in {}", trial.name))
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
                    fit_pose(&clouds.local[l], &measured).map(|(pose, _)| pose)
                })
                .collect();
            if let Some(poses) = poses {
                posed.push((seen, poses));
            }
        }
    }
    if links.parents.len() > 1 && posed.len() < 10 {
        return Err(ScaleError::Functional {
            problem: format!("{} of {total} frames show three markers on every link; at least ten are needed", posed.len()),
        });
    }
    Ok(posed.into_iter().unzip())
}

/// A model with the joints of SARA and SCoRE, marker coordinates from the static, and coordinates of every frame.
fn first_guess(
    links: &Links<'_>,
    clouds: &Clouds,
    at_rest: &[Vector3<f64>],
    static_frames: usize,
    frames: Vec<Vec<Vector3<f64>>>,
    poses: &[Vec<Isometry3<f64>>],
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
    })?;
    if let Some(g) = spec.gravity_mps2 {
        model.gravity_mps2 = Vector3::new(0.0, 0.0, -g);
    }
    // Working frame of each link against its cloud, and its pose in the world of the static.
    let mut cloud_from_link: Vec<Isometry3<f64>> = vec![Isometry3::identity(); n];
    let at_rest_pose = |l: usize, cloud_from_link: &[Isometry3<f64>]| {
        pose(&clouds.centre[l], &UnitQuaternion::identity()) * cloud_from_link[l]
    };
    let mut guesses = vec![f64::NAN; n];
    for l in 0..n {
        let Some(p) = links.parents[l] else { continue };
        let column = |k: usize| poses.iter().map(|f| f[k]).collect::<Vec<_>>();
        let (parents, children) = (column(p), column(l));
        let named = |e: ScaleError| match e {
            ScaleError::Functional { problem } => ScaleError::Functional { problem: format!("{} `{}`: {problem}", spec.name, spec.links[l].name) },
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
                    let turn = (world_from_link[p] * link.joint.parent_from_joint).rotation.inverse() * world_from_link[l].rotation;
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
    // First frame: the static. It counts as many frames, but not so many that a slow drift of it would rule.
    let mut all = vec![BundleFrame {
        measured: at_rest.to_vec(),
        weight: static_frames.clamp(1, 200) as f64,
        q: coordinates(&rest),
    }];
    for (measured, clouds_in_world) in frames.into_iter().zip(poses) {
        let world: Vec<Isometry3<f64>> = clouds_in_world.iter().zip(&cloud_from_link).map(|(w, c)| w * c).collect();
        all.push(BundleFrame { measured, weight: 1.0, q: coordinates(&world) });
    }
    Ok((Bundle { model, markers, frames: all }, guesses))
}

fn local(links: &Links<'_>, bundle: &Bundle, label: &str) -> Option<Vector3<f64>> {
    links.markers.iter().position(|(_, l)| *l == label).map(|k| bundle.markers[k].position_m)
}

/// Where the specification wants a link's frame, in the bundle's working frame of that link.
///
/// `parent_origin` is the parent's final origin in this link's working frame at rest, `positive` the sense of a hinge there.
fn wanted_frame(
    links: &Links<'_>,
    bundle: &Bundle,
    link: &ObjectLink,
    parent_origin: &Vector3<f64>,
    positive: &Vector3<f64>,
) -> Result<Isometry3<f64>, ScaleError> {
    let at = |label: &String| {
        local(links, bundle, label).ok_or_else(|| error(links.spec, &link.name, format!("marker `{label}` is not known")))
    };
    let flat = || error(links.spec, &link.name, "the markers that define its frame lie on a line");
    match &link.frame {
        ObjectFrame::Markers { origin, y_axis, z_side } => {
            let (a, b) = (at(&y_axis[0])?, at(&y_axis[1])?);
            let axes = axes_y_z(&(b - a), &(at(z_side)? - a)).ok_or_else(flat)?;
            // A ball joint's own centre is the origin of the working frame.
            let origin = origin.as_ref().map_or(Ok(Vector3::zeros()), at)?;
            Ok(pose(&origin, &axes))
        }
        ObjectFrame::Hinge { x_plane, side } => {
            let z = if positive.z < 0.0 { -Vector3::z() } else { Vector3::z() };
            let marker = reject(&at(x_plane)?, &z);
            let x = if *side == HalfPlane::Positive { marker } else { -marker };
            let axes = axes_z_x(&z, &x).ok_or_else(flat)?;
            Ok(pose(&(z * z.dot(parent_origin)), &axes))
        }
    }
}

/// The bundle in the frames of the specification.
fn name_frames(links: &Links<'_>, bundle: &Bundle, input: &ObjectInput<'_>) -> Result<Subject, ScaleError> {
    let spec = links.spec;
    let rest = bundle.frames.first().ok_or_else(|| error(spec, "-", "the static was lost as an outlier"))?;
    let mut state = State::new(&bundle.model);
    state.forward_position(&bundle.model, &rest.q);
    let mut model = bundle.model.clone();
    let mut q = model.neutral();
    let mut old_from_new: Vec<Isometry3<f64>> = Vec::with_capacity(spec.links.len());
    let mut world: Vec<Isometry3<f64>> = Vec::with_capacity(spec.links.len());
    for (l, link) in spec.links.iter().enumerate() {
        let own = state.world_from_link[l];
        let (parent_origin, positive) = match (links.parents[l], &link.joint) {
            (Some(p), Some(ObjectJoint::Hinge { positive_along_parent })) => {
                let along = Vector3::from(*positive_along_parent);
                let direction = own.rotation.inverse() * (world[p].rotation * along);
                if direction.z.abs() < 1e-3 * along.norm() {
                    return Err(error(spec, &link.name, "its hinge is perpendicular to the direction that tells its sense"));
                }
                (apply_inverse(&own, &world[p].translation.vector), direction)
            }
            _ => (Vector3::zeros(), Vector3::z()),
        };
        let change = wanted_frame(links, bundle, link, &parent_origin, &positive)?;
        let here = own * change;
        let joint = &mut model.links[l].joint;
        let at = joint.q_offset;
        match links.parents[l] {
            None => {
                q[at..at + 3].copy_from_slice(here.translation.vector.as_slice());
                q[at + 3..at + 7].copy_from_slice(here.rotation.coords.as_slice());
            }
            Some(p) => {
                let in_parent = world[p].inverse() * here;
                if matches!(link.joint, Some(ObjectJoint::Ball)) {
                    joint.parent_from_joint = Isometry3::from_parts(in_parent.translation, UnitQuaternion::identity());
                    q[at..at + 4].copy_from_slice(in_parent.rotation.coords.as_slice());
                } else {
                    joint.parent_from_joint = in_parent;
                    q[at] = 0.0;
                }
            }
        }
        old_from_new.push(change);
        world.push(here);
    }
    model.normalize(&mut q);
    let markers: Vec<ModelMarker> = links
        .markers
        .iter()
        .zip(&bundle.markers)
        .map(|(&(link, label), m)| ModelMarker {
            label: label.into(),
            link,
            position_m: apply_inverse(&old_from_new[link], &m.position_m),
            weight: 1.0,
        })
        .collect();
    let (prior, prior_sd) = size_prior(links, &model, &markers);
    Ok(Subject {
        facts: PersonFacts { name: spec.name.clone(), sex: None, height_m: None, mass_kg: spec.total_mass_kg },
        model,
        markers,
        prior,
        prior_sd,
        static_q: q,
        provenance: vec![
            format!("geometry: {} and {} motion trials", input.static_trial.name, input.motion_trials.len()),
            "prior: size of each link's markers and joints".into(),
        ],
    })
}

/// Least half-thickness of a link for its prior, m.
const THICKNESS_M: f64 = 0.01;

/// Uniform ellipsoids around markers and joints: rough, but enough to find flights.
fn size_prior(links: &Links<'_>, model: &Model, markers: &[ModelMarker]) -> (Vec<LinkInertia>, Vec<PriorSd>) {
    let n = model.n_links();
    let mut shapes = Vec::with_capacity(n);
    for l in 0..n {
        let mut points: Vec<Vector3<f64>> = markers.iter().filter(|m| m.link == l).map(|m| m.position_m).collect();
        if links.parents[l].is_some() {
            points.push(Vector3::zeros());
        }
        for (c, p) in links.parents.iter().enumerate() {
            if *p == Some(l) {
                points.push(model.links[c].joint.parent_from_joint.translation.vector);
            }
        }
        let count = points.len() as f64;
        let centre = points.iter().sum::<Vector3<f64>>() / count;
        let scatter = points.iter().map(|p| (p - centre) * (p - centre).transpose()).sum::<Matrix3<f64>>() / count;
        let thick = scatter + Matrix3::identity() * THICKNESS_M.powi(2);
        shapes.push((centre, thick, thick.determinant().max(0.0).sqrt()));
    }
    let stated: f64 = links.spec.links.iter().filter_map(|l| l.mass_fraction).sum();
    let open: f64 =
        shapes.iter().zip(&links.spec.links).filter(|(_, l)| l.mass_fraction.is_none()).map(|(s, _)| s.2).sum();
    let total = links.spec.total_mass_kg;
    let mut prior: Vec<LinkInertia> = shapes
        .iter()
        .zip(&links.spec.links)
        .map(|((centre, scatter, volume), link)| {
            let share = link.mass_fraction.unwrap_or_else(|| (1.0 - stated).max(0.0) * volume / open.max(1e-30));
            let mass_kg = (share * total).max(1e-6 * total);
            // Markers sit on the surface: a solid's second moment is about half of theirs.
            let second = scatter * (0.5 * mass_kg);
            let mut inertia = LinkInertia {
                mass_kg,
                com_m: *centre,
                inertia_com_kgm2: Matrix3::identity() * second.trace() - second,
            };
            make_consistent(&mut inertia, 1e-3);
            inertia
        })
        .collect();
    let sum: f64 = prior.iter().map(|p| p.mass_kg).sum();
    for p in &mut prior {
        p.mass_kg *= total / sum;
        p.inertia_com_kgm2 *= total / sum;
    }
    let sd = shapes
        .iter()
        .map(|(_, scatter, _)| PriorSd { mass_rel: 0.5, com_m: scatter.trace().sqrt() / 2.0, radius_rel: 0.5 })
        .collect();
    (prior, sd)
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
                let turn = rest.inverse() * state.world_from_link[p].rotation.inverse() * state.world_from_link[l].rotation;
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
                axis_in_parent: if hinge { z_of(&place.rotation) } else { Vector3::repeat(f64::NAN) },
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
            .map(|((_, label), (s, n))| ((*label).to_owned(), if *n == 0 { f64::NAN } else { (s / *n as f64).sqrt() }))
            .collect(),
        joints,
        warnings,
    }
}
