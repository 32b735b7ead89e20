//! A model of a person from one static trial: landmarks → skeleton → model, marker coordinates,
//! prior inertias, report.

use crate::ScaleError;
use crate::anthropometry::Anthropometry;
use crate::error::SPAN_M;
use crate::geometry::{apply_inverse, x_of, y_of, z_of};
use crate::hip::HipMethod;
use crate::landmarks::{Landmarks, Side};
use crate::observe::unobserved;
use crate::plausibility;
use crate::prior::{CarriedSegment, StaticAnatomy, attach_prior};
use crate::report::{JointMethod, JointUncertainty, PlausibilityLimits, ScaleReport, ScaleWarning};
use crate::skeleton::{Builder, PlacedLink, Skeleton};
use crate::statics::{QuietOptions, StaticPose};
use aloft_body::{EstimatedPoints, JointKind, Model, ModelMarker, ModelSpec, PersonFacts, Subject};
use aloft_trial::{MarkerSet, Trial};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;

/// Input for scaling a person.
#[derive(Debug, Clone)]
pub struct PersonInput<'a> {
    /// The subject's name, sex, stature and mass.
    pub facts: &'a PersonFacts,
    /// The model to scale; links named as in `configs/models/human34.yaml` (a model may omit distal
    /// links).
    pub model_spec: &'a ModelSpec,
    /// Link and landmark of each marker.
    pub marker_set: &'a MarkerSet,
    /// The static trial, labels already canonical, Z up.
    pub static_trial: &'a Trial,
    /// Frames of that trial (0-based) to use as the static, for laboratories without a static
    /// trial; `None` selects the quiet ones.
    pub frames: Option<Range<usize>>,
}

/// Options of person scaling.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ScaleOptions {
    /// Hip regression if the recording contains no hip centres.
    pub hip: HipMethod,
    /// Options for finding quiet frames.
    pub quiet: QuietOptions,
    /// Thresholds of the warnings.
    pub limits: PlausibilityLimits,
}

/// A scaled person.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scaled {
    /// The model with this person's geometry, markers and prior.
    pub subject: Subject,
    /// Data with which [`attach_prior`] can recompute the prior after a calibration.
    pub anatomy: StaticAnatomy,
    /// Velocity indices that no marker determines and that inverse kinematics should lock
    /// ([`crate::observe`]).
    pub locked: Vec<usize>,
    /// Report for people, including the uncertainty of every joint for a calibration.
    pub report: ScaleReport,
}

/// Checks that the markers in a frame span what a person's markers span.
///
/// # Errors
/// [`ScaleError::Span`] if they do not: the unit is probably wrong.
pub fn check_span(trial: &Trial, frame: usize) -> Result<(), ScaleError> {
    let seen: Vec<Vector3<f64>> = trial
        .markers
        .trajectories
        .iter()
        .filter_map(|t| t.get(frame).copied())
        .filter(|p| p.iter().all(|x| x.is_finite()))
        .collect();
    // some markers may be far away: the middle half of them on each axis
    let span = |axis: usize| {
        let mut x: Vec<f64> = seen.iter().map(|p| p[axis]).collect();
        x.sort_by(f64::total_cmp);
        let out = x.len() / 4;
        x.get(x.len().saturating_sub(out + 1)).zip(x.get(out)).map_or(0.0, |(b, a)| b - a)
    };
    let span_m = (0..3).map(|k| span(k).powi(2)).sum::<f64>().sqrt();
    if seen.len() >= FEWEST_SEEN && !(SPAN_M[0]..=SPAN_M[1]).contains(&span_m) {
        return Err(ScaleError::Span { trial: trial.name.clone(), span_m });
    }
    Ok(())
}

/// Fewest markers from whose span the unit is judged.
const FEWEST_SEEN: usize = 8;

/// Scales a model to a person.
///
/// Missing landmarks reduce accuracy but do not cause failure, except at the pelvis: joints fall
/// back to regressions and then to body proportions, each with a warning. The model at `static_q`
/// reproduces the static: joints are where the landmarks put them and every marker is where it was
/// measured.
///
/// # Errors
/// [`ScaleError`] for an unusable static, a pelvis without landmarks, impossible facts, or a marker
/// set, model or table that does not match.
pub fn scale_person(
    input: &PersonInput<'_>,
    tables: &Anthropometry,
    options: &ScaleOptions,
) -> Result<Scaled, ScaleError> {
    let trial = input.static_trial;
    check_facts(input.facts)?;
    let mut warnings = Vec::new();
    let pose = StaticPose::find(trial, input.frames.as_ref(), &options.quiet)?;
    if let Some(middle) = pose.frames.get(pose.frames.len() / 2) {
        check_span(trial, *middle)?;
    }
    let landmarks = Landmarks::read(trial, input.marker_set, &pose, &mut warnings);
    let skeleton = Builder {
        landmarks: &landmarks,
        trial: &trial.name,
        sex: input.facts.sex,
        stated_height_m: input.facts.height_m,
        marker_radius_m: input.marker_set.marker_radius_m,
        hip_method: options.hip,
        given_sd_m: input.marker_set.markerless.as_ref().map(|m| m.position_sd_m),
    }
    .build()?;
    let (model, static_q, placed) = assemble(input.model_spec, &skeleton)?;
    let (markers, missing_markers) = place_markers(input, &model, &placed, &pose)?;
    for marker in &missing_markers {
        warnings.push(ScaleWarning::MarkerUnseen { marker: marker.clone() });
    }
    let mut facts = input.facts.clone();
    facts.height_m = Some(skeleton.height_m);
    let joints = joint_uncertainties(&model, &placed, &mut warnings);
    let anatomy = StaticAnatomy {
        landmarks,
        isb_axes: placed.iter().map(|p| p.isb_axes).collect(),
        height_m: skeleton.height_m,
        marker_radius_m: input.marker_set.marker_radius_m,
        carried: carried(&skeleton, &model),
    };
    let estimated = input
        .marker_set
        .markerless
        .as_ref()
        .map(|m| EstimatedPoints { source: m.source.clone(), position_sd_m: m.position_sd_m });
    let mut subject = Subject {
        estimated,
        boxes: Vec::new(),
        facts,
        model,
        markers,
        prior: Vec::new(),
        prior_sd: Vec::new(),
        static_q,
        provenance: vec![
            format!("geometry: landmarks of {} ({} frames)", trial.name, pose.frames.len()),
            format!("prior: {}", tables.title),
        ],
    };
    warnings.extend(attach_prior(&mut subject, tables, &anatomy)?);
    let locked = unobserved(&subject)?;
    mark_unseen_limbs(&mut subject);
    warn_unobserved(&subject.model, &locked, &mut warnings);
    let velocity_names = subject.model.velocity_names();
    let mut report = ScaleReport {
        trial: trial.name.clone(),
        frames: (
            pose.frames.first().copied().unwrap_or(0),
            pose.frames.last().copied().unwrap_or(0),
            pose.frames.len(),
        ),
        typical_spread_m: pose.typical_spread_m(),
        height_m: skeleton.height_m,
        height_stated: input.facts.height_m.is_some(),
        joints,
        lengths: plausibility::lengths(&skeleton, &anatomy.landmarks),
        markers: plausibility::marker_errors(trial, input.marker_set, &subject, &pose),
        missing_markers,
        locked: locked.iter().filter_map(|&k| velocity_names.get(k).cloned()).collect(),
        warnings,
    };
    let landmarks = (&anatomy.landmarks, input.marker_set);
    plausibility::check(&mut report, input.facts, &skeleton, landmarks, &subject, &options.limits);
    Ok(Scaled { subject, anatomy, locked, report })
}

fn check_facts(facts: &PersonFacts) -> Result<(), ScaleError> {
    let fail = |problem: String| Err(ScaleError::Facts { subject: facts.name.clone(), problem });
    if !(facts.mass_kg > 1.0 && facts.mass_kg < 500.0) {
        return fail(format!("a body mass of {} kg (1 to 500 are possible)", facts.mass_kg));
    }
    match facts.height_m {
        Some(h) if !(h > 0.3 && h < 2.8) => fail(format!("a stature of {h} m (0.3 to 2.8 are possible; metres?)")),
        _ => Ok(()),
    }
}

/// Model with joint positions, the coordinates of the static posture, and each link's placement.
fn assemble(spec: &ModelSpec, skeleton: &Skeleton) -> Result<(Model, Vec<f64>, Vec<PlacedLink>), ScaleError> {
    let mut model = Model::from_spec(spec)?;
    let mut q = model.neutral();
    let mut placed: Vec<PlacedLink> = Vec::with_capacity(model.links.len());
    for i in 0..model.links.len() {
        let link = &mut model.links[i];
        let fail = |problem: String| ScaleError::Model { model: spec.name.clone(), link: link.name.clone(), problem };
        let mut own = *skeleton
            .links
            .get(&link.name)
            .ok_or_else(|| fail(format!("not a link of a person; these are {}", names(skeleton))))?;
        let at = link.joint.q_offset;
        match (link.joint.kind, link.parent) {
            (JointKind::Free, None) => {
                link.joint.parent_from_joint = Isometry3::identity();
                let t = own.world_from_link.translation.vector;
                q[at..at + 3].copy_from_slice(t.as_slice());
                write_quaternion(&own.world_from_link.rotation, &mut q[at + 3..at + 7]);
            }
            (JointKind::Spherical, Some(p)) => {
                let parent_from_link = placed[p].world_from_link.inverse() * own.world_from_link;
                link.joint.parent_from_joint =
                    Isometry3::from_parts(parent_from_link.translation, UnitQuaternion::identity());
                write_quaternion(&parent_from_link.rotation, &mut q[at..at + 4]);
            }
            (JointKind::Revolute(axis), Some(p)) => {
                if (axis.into_inner() - Vector3::z()).norm() > 1e-9 {
                    return Err(fail("a hinge of a person turns about z".into()));
                }
                if own.axis_sd_rad.is_none() {
                    // A hinge at a joint that is a ball joint in people: its link takes the
                    // segment's axes.
                    own.axis_sd_rad = Some(0.3);
                }
                let parent_from_link = placed[p].world_from_link.inverse() * own.world_from_link;
                let (zero, angle) = straight_zero(&parent_from_link.rotation).ok_or_else(|| {
                    fail(
                        "its hinge axis is parallel to its parent's long axis; check the medial and lateral markers"
                            .into(),
                    )
                })?;
                link.joint.parent_from_joint = Isometry3::from_parts(parent_from_link.translation, zero);
                q[at] = angle;
            }
            (JointKind::Fixed, Some(p)) => {
                link.joint.parent_from_joint = placed[p].world_from_link.inverse() * own.world_from_link;
            }
            (kind, _) => return Err(fail(format!("a person has no joint of the kind {kind:?} there"))),
        }
        placed.push(own);
    }
    Ok((model, q, placed))
}

/// The segments of the skeleton for which the model has no link.
fn carried(skeleton: &Skeleton, model: &Model) -> BTreeMap<String, CarriedSegment> {
    let is_link = |name: &String| model.links.iter().any(|l| l.name == *name);
    let of = |place: &PlacedLink| CarriedSegment {
        origin_m: place.world_from_link.translation.vector,
        isb_axes: place.isb_axes,
    };
    skeleton.links.iter().filter(|(name, _)| !is_link(name)).map(|(name, place)| (name.clone(), of(place))).collect()
}

/// Limbs that the model has and no marker shows move unseen, as if it had no links for them. A head
/// without markers is not counted: it moves little against the torso.
fn mark_unseen_limbs(subject: &mut Subject) {
    // large segments that a model leaves out without saying so
    for part in ["torso", "upper_arm", "forearm", "thigh", "shank"] {
        let model = &subject.model;
        let has = model.links.iter().any(|l| l.name == part || l.name.strip_suffix("_r") == Some(part));
        if !has && !model.carries.values().flatten().any(|p| p == part) {
            let root = model.links[0].name.clone();
            subject.model.carries.entry(root).or_default().push(part.to_owned());
        }
    }
    for (limb, parts) in [("upper_arm", ["upper_arm", "forearm", "hand"]), ("thigh", ["thigh", "shank", "foot"])] {
        for side in Side::BOTH {
            let name = |part: &str| format!("{part}_{}", side.suffix());
            let model = &subject.model;
            // none: a model of a part of the body has no such link
            let Ok(first) = model.link_index(&name(limb)) else { continue };
            // none: as above
            let own: Vec<usize> = parts.iter().filter_map(|p| model.link_index(&name(p)).ok()).collect();
            if subject.markers.iter().any(|m| own.contains(&m.link) && m.weight > 0.0) {
                continue;
            }
            let Some(parent) = model.links[first].parent.map(|p| model.links[p].name.clone()) else { continue };
            let list = subject.model.carries.entry(parent).or_default();
            list.extend(parts.iter().map(|p| (*p).to_owned()));
            list.sort();
            list.dedup();
        }
    }
}

fn names(skeleton: &Skeleton) -> String {
    skeleton.links.keys().cloned().collect::<Vec<_>>().join(", ")
}

fn write_quaternion(r: &UnitQuaternion<f64>, out: &mut [f64]) {
    // Of the two equivalent quaternions, the one with a rotation below half a turn.
    let s = if r.w < 0.0 { -1.0 } else { 1.0 };
    out.copy_from_slice(&[s * r.i, s * r.j, s * r.k, s * r.w]);
}

/// Splits a hinge's static orientation in its parent into the zero orientation, in which the limb
/// is as straight as a rotation about the hinge (z) can make it, and the angle from there.
pub(crate) fn straight_zero(parent_from_link: &UnitQuaternion<f64>) -> Option<(UnitQuaternion<f64>, f64)> {
    let zero = crate::geometry::axes_z_y(&z_of(parent_from_link), &Vector3::y())?;
    let (x, y) = (x_of(parent_from_link), y_of(&zero));
    let angle = x.dot(&y).atan2(x.dot(&x_of(&zero)));
    Some((zero, angle))
}

fn place_markers(
    input: &PersonInput<'_>,
    model: &Model,
    placed: &[PlacedLink],
    pose: &StaticPose,
) -> Result<(Vec<ModelMarker>, Vec<String>), ScaleError> {
    let mut markers = Vec::new();
    let mut missing = Vec::new();
    for m in input.marker_set.markers.iter().filter(|m| m.tracking && !m.static_only) {
        // none: a marker on a part that this model does not have
        let Ok(link) = model.link_index(&m.link) else {
            return Err(ScaleError::MarkerLink {
                marker_set: input.marker_set.name.clone(),
                marker: m.label.clone(),
                link: m.link.clone(),
                model: model.name.clone(),
            });
        };
        match input.static_trial.markers.index(&m.label).and_then(|i| pose.positions[i]) {
            Some(p) => markers.push(ModelMarker {
                label: m.label.clone(),
                link,
                position_m: apply_inverse(&placed[link].world_from_link, &p),
                weight: m.weight,
            }),
            None => missing.push(m.label.clone()),
        }
    }
    Ok((markers, missing))
}

fn joint_uncertainties(
    model: &Model,
    placed: &[PlacedLink],
    warnings: &mut Vec<ScaleWarning>,
) -> Vec<JointUncertainty> {
    let mut joints = Vec::with_capacity(placed.len());
    for (i, (link, place)) in model.links.iter().zip(placed).enumerate() {
        if link.parent.is_none() {
            continue;
        }
        let joint = format!("joint of {}", link.name);
        let hinge = matches!(link.joint.kind, JointKind::Revolute(_));
        if place.method == JointMethod::Proportion {
            warnings.push(ScaleWarning::JointByProportion { joint, centre_sd_m: place.centre_sd_m });
        } else if let Some(axis_sd_rad) = place.axis_sd_rad.filter(|&sd| hinge && sd > 0.2) {
            warnings.push(ScaleWarning::AxisAssumed { joint, axis_sd_rad });
        }
        joints.push(JointUncertainty {
            link: link.name.clone(),
            link_index: i,
            method: place.method,
            centre_sd_m: place.centre_sd_m,
            axis_sd_rad: place.axis_sd_rad.filter(|_| hinge),
        });
    }
    joints
}

fn warn_unobserved(model: &Model, locked: &[usize], warnings: &mut Vec<ScaleWarning>) {
    for link in &model.links {
        let range = link.joint.v_offset..link.joint.v_offset + link.joint.kind.nv();
        let coordinates = locked.iter().filter(|k| range.contains(k)).count();
        if coordinates > 0 {
            warnings.push(ScaleWarning::Unobserved { link: link.name.clone(), coordinates });
        }
    }
}

/// Mirror of a point in link axes.
pub(crate) fn mirrored(p: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(p.x, p.y, -p.z)
}

/// Name of a link or landmark on the other side.
pub(crate) fn other_side(name: &str) -> Option<String> {
    let side = Side::of(name)?;
    let stem = &name[..name.len() - 1];
    Some(format!("{stem}{}", if side == Side::Right { "l" } else { "r" }))
}
