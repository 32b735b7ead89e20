//! Segment lengths, marker errors and the checks for the warnings of person scaling.

use crate::geometry::{apply, x_of, y_of, z_of};
use crate::landmarks::{Landmarks, Side};
use crate::person::{mirrored, other_side};
use crate::report::{MarkerReport, PlausibilityLimits, ScaleReport, ScaleWarning, SegmentLength};
use crate::skeleton::Skeleton;
use crate::statics::StaticPose;
use aloft_body::{JointKind, PersonFacts, Subject};
use aloft_trial::{MarkerSet, Trial};
use nalgebra::Vector3;

/// Number of frames used for rigid errors: sufficient for a root mean square.
const RIGID_FRAMES: usize = 100;

/// Segment lengths of both sides, with the lengths predicted from stature (limbs: Winter, figure
/// 4.1; the rest: rounded values of this project).
pub(crate) fn lengths(skeleton: &Skeleton, landmarks: &Landmarks) -> Vec<SegmentLength> {
    let origin = |name: &str| skeleton.links.get(name).map(|l| l.world_from_link.translation.vector);
    let between = |a: Option<Vector3<f64>>, b: Option<Vector3<f64>>| match (a, b) {
        (Some(a), Some(b)) => Some((a - b).norm()),
        _ => None,
    };
    let joints = |a: &str, b: &str, side: Side| {
        let s = side.suffix();
        between(origin(&format!("{a}_{s}")), origin(&format!("{b}_{s}")))
    };
    let mut out = Vec::new();
    let expected = |fraction: f64| Some(fraction * skeleton.height_m);
    for (segment, a, b, fraction) in [
        ("upper_arm", "upper_arm", "forearm", 0.186),
        ("forearm", "forearm", "hand", 0.146),
        ("thigh", "thigh", "shank", 0.245),
        ("shank", "shank", "foot", 0.246),
    ] {
        out.push(SegmentLength {
            segment: segment.into(),
            right_m: joints(a, b, Side::Right),
            left_m: joints(a, b, Side::Left),
            expected_m: expected(fraction),
        });
    }
    let foot = |s: Side| between(landmarks.side("heel", s), landmarks.side("toe", s));
    out.push(SegmentLength {
        segment: "foot_markers".into(),
        right_m: foot(Side::Right),
        left_m: foot(Side::Left),
        expected_m: None,
    });
    for (segment, length, expected_m) in [
        ("pelvis_width", Some(skeleton.pelvis.width_m), expected(0.146)),
        ("pelvis_depth", Some(skeleton.pelvis.depth_m), None),
        ("hip_width", between(origin("thigh_r"), origin("thigh_l")), expected(0.107)),
        ("trunk", between(origin("torso"), origin("head")), expected(0.27)),
    ] {
        out.push(SegmentLength { segment: segment.into(), right_m: length, left_m: None, expected_m });
    }
    out
}

/// Spread, rigid error and mirror error of every marker of the model.
pub(crate) fn marker_errors(trial: &Trial, set: &MarkerSet, subject: &Subject, pose: &StaticPose) -> Vec<MarkerReport> {
    let index: Vec<Option<usize>> = subject.markers.iter().map(|m| trial.markers.index(&m.label)).collect();
    let step = pose.frames.len().div_ceil(RIGID_FRAMES).max(1);
    let mut squares = vec![(0.0, 0usize); subject.markers.len()];
    for link in 0..subject.model.n_links() {
        let own: Vec<usize> = (0..subject.markers.len()).filter(|&k| subject.markers[k].link == link).collect();
        if own.len() < 3 {
            continue;
        }
        let local: Vec<Vector3<f64>> = own.iter().map(|&k| subject.markers[k].position_m).collect();
        for &frame in pose.frames.iter().step_by(step) {
            let seen: Vec<Vector3<f64>> = own
                .iter()
                .map(|&k| {
                    index[k].and_then(|i| trial.markers.position(i, frame)).unwrap_or_else(|| Vector3::repeat(f64::NAN))
                })
                .collect();
            let Some((fitted, _)) = aloft_body::rigid::fit_pose_of_seen(&local, &seen) else { continue };
            for ((&k, p), m) in own.iter().zip(&local).zip(&seen) {
                let d = (apply(&fitted, p) - m).norm_squared();
                if d.is_finite() {
                    squares[k].0 += d;
                    squares[k].1 += 1;
                }
            }
        }
    }
    let landmark = |label: &str| set.markers.iter().find(|m| m.label == label).and_then(|m| m.landmark.as_deref());
    let mirror = |k: usize| {
        let m = &subject.markers[k];
        let own = landmark(&m.label)?;
        let mate_name = other_side(own)?;
        let mate = subject.markers.iter().find(|o| landmark(&o.label) == Some(mate_name.as_str()))?;
        let (a, b) = (&subject.model.links[m.link].name, &subject.model.links[mate.link].name);
        let same_link = a == b || other_side(a).as_ref() == Some(b);
        same_link.then(|| (mirrored(&mate.position_m) - m.position_m).norm())
    };
    subject
        .markers
        .iter()
        .enumerate()
        .map(|(k, m)| MarkerReport {
            label: m.label.clone(),
            link: subject.model.links[m.link].name.clone(),
            spread_m: index[k].map_or(f64::NAN, |i| pose.spread_m[i]),
            rigid_error_m: (squares[k].1 > 0).then(|| (squares[k].0 / squares[k].1 as f64).sqrt()),
            asymmetry_m: mirror(k),
        })
        .collect()
}

/// Runs all checks; findings go to `report.warnings`.
pub(crate) fn check(
    report: &mut ScaleReport,
    facts: &PersonFacts,
    skeleton: &Skeleton,
    (landmarks, set): (&Landmarks, &MarkerSet),
    subject: &Subject,
    limits: &PlausibilityLimits,
) {
    let mut found = Vec::new();
    // software has the same lengths in every frame
    if subject.estimated.is_none() && report.frames.2 < limits.frames {
        found.push(ScaleWarning::FewFrames { frames: report.frames.2, limit: limits.frames });
    }
    if report.typical_spread_m > limits.moving_m {
        found.push(ScaleWarning::Moving { spread_m: report.typical_spread_m, limit_m: limits.moving_m });
    }
    if facts.sex.is_none() {
        found.push(ScaleWarning::SexUnknown);
    }
    check_height(&mut found, facts, skeleton, limits);
    check_lengths(&mut found, &report.lengths, limits);
    check_sides(&mut found, skeleton, landmarks);
    check_feet(&mut found, skeleton, landmarks, set);
    check_hinges(&mut found, skeleton, subject, limits);
    for m in &report.markers {
        if let Some(rigid_error_m) = m.rigid_error_m.filter(|&e| e > limits.loose_m) {
            found.push(ScaleWarning::MarkerLoose { marker: m.label.clone(), rigid_error_m, limit_m: limits.loose_m });
        }
    }
    check_mirrors(&mut found, report, limits);
    report.warnings.extend(found);
}

fn check_height(found: &mut Vec<ScaleWarning>, facts: &PersonFacts, skeleton: &Skeleton, limits: &PlausibilityLimits) {
    match (facts.height_m, skeleton.estimated_height_m) {
        (Some(stated_m), Some(estimated_m)) if (estimated_m / stated_m - 1.0).abs() > limits.height_ratio => {
            found.push(ScaleWarning::HeightDoubtful { stated_m, estimated_m, limit_ratio: limits.height_ratio });
        }
        (None, _) => found.push(ScaleWarning::HeightEstimated { height_m: skeleton.height_m }),
        _ => {}
    }
    let value = facts.mass_kg / skeleton.height_m.powi(2);
    let (low, high) = limits.body_mass_index;
    if !(low..=high).contains(&value) {
        found.push(ScaleWarning::BodyMassIndex { value, low, high });
    }
}

fn check_lengths(found: &mut Vec<ScaleWarning>, lengths: &[SegmentLength], limits: &PlausibilityLimits) {
    for l in lengths {
        let Some(right_m) = l.right_m else { continue };
        if let Some(left_m) = l.left_m {
            let limit_m = limits.asymmetry_m.max(limits.asymmetry_ratio * right_m.max(left_m));
            if (right_m - left_m).abs() > limit_m {
                found.push(ScaleWarning::Asymmetry { segment: l.segment.clone(), right_m, left_m, limit_m });
            }
        }
        let found_m = l.left_m.map_or(right_m, |left_m| (right_m + left_m) / 2.0);
        if let Some(expected_m) = l.expected_m.filter(|e| (found_m / e - 1.0).abs() > limits.length_ratio) {
            found.push(ScaleWarning::Length {
                segment: l.segment.clone(),
                found_m,
                expected_m,
                limit_ratio: limits.length_ratio,
            });
        }
    }
}

fn check_sides(found: &mut Vec<ScaleWarning>, skeleton: &Skeleton, landmarks: &Landmarks) {
    let pelvis = skeleton.pelvis.world_from_pelvis.rotation;
    let (forward, right) = (x_of(&pelvis), z_of(&pelvis));
    // Exchanged ASIS turn the pelvis upside down, because forward is defined by the PSIS.
    if y_of(&pelvis).z < 0.0 {
        found.push(ScaleWarning::SidesExchanged { what: "asis".into(), lateral_m: skeleton.pelvis.width_m });
        return;
    }
    for what in ["acromion", "elbow_lateral", "knee_lateral", "ankle_lateral", "heel", "toe", "psis"] {
        if let (Some(r), Some(l)) = (landmarks.side(what, Side::Right), landmarks.side(what, Side::Left)) {
            let lateral_m = (l - r).dot(&right);
            if lateral_m > 0.0 {
                found.push(ScaleWarning::SidesExchanged { what: what.into(), lateral_m });
            }
        }
    }
    for side in Side::BOTH {
        let link = format!("foot_{}", side.suffix());
        if let Some(foot) = skeleton.links.get(&link) {
            let cosine = x_of(&foot.isb_axes).dot(&forward);
            if cosine < 0.0 {
                found.push(ScaleWarning::BackToFront { link, cosine });
            }
        }
    }
}

/// In front of the heel and above it lies the malleolus of a person who stands.
fn check_feet(found: &mut Vec<ScaleWarning>, skeleton: &Skeleton, landmarks: &Landmarks, set: &MarkerSet) {
    let forward = x_of(&skeleton.pelvis.world_from_pelvis.rotation);
    for side in Side::BOTH {
        let (Some(ankle), Some(heel)) = (landmarks.side("ankle_lateral", side), landmarks.side("heel", side)) else {
            continue;
        };
        let (behind_m, below_m) = ((heel - ankle).dot(&forward), heel.z - ankle.z);
        let label = |what: &str| {
            let name = format!("{what}_{}", side.suffix());
            set.markers.iter().find(|m| m.landmark.as_deref() == Some(&name)).map(|m| m.label.clone())
        };
        if let (true, Some(ankle), Some(heel)) =
            (behind_m > 0.0 && below_m > 0.0, label("ankle_lateral"), label("heel"))
        {
            found.push(ScaleWarning::AnkleBehindHeel { ankle, heel, behind_m, below_m });
        }
    }
}

fn check_hinges(found: &mut Vec<ScaleWarning>, skeleton: &Skeleton, subject: &Subject, limits: &PlausibilityLimits) {
    for link in &subject.model.links {
        let (JointKind::Revolute(_), Some(parent)) = (link.joint.kind, link.parent) else { continue };
        let angle = subject.static_q[link.joint.q_offset].to_degrees();
        if link.name.starts_with("shank") && angle.abs() > limits.bent_deg {
            found.push(ScaleWarning::Bent {
                joint: format!("joint of {}", link.name),
                angle_deg: angle.abs(),
                limit_deg: limits.bent_deg,
            });
        }
        let own = skeleton.links.get(&link.name);
        let up = skeleton.links.get(&subject.model.links[parent].name);
        if let (Some(own), Some(up)) = (own, up) {
            let axis = z_of(&own.world_from_link.rotation);
            let skew = |axes| y_of(axes).dot(&axis).abs().min(1.0).asin().to_degrees();
            let angle_deg = skew(&own.isb_axes).max(skew(&up.isb_axes));
            if angle_deg > limits.skewed_deg {
                found.push(ScaleWarning::Skewed {
                    joint: format!("joint of {}", link.name),
                    angle_deg,
                    limit_deg: limits.skewed_deg,
                });
            }
        }
    }
}

fn check_mirrors(found: &mut Vec<ScaleWarning>, report: &ScaleReport, limits: &PlausibilityLimits) {
    let far: Vec<(&MarkerReport, f64)> =
        report.markers.iter().filter_map(|m| Some((m, m.asymmetry_m.filter(|&d| d > limits.mirror_m)?))).collect();
    for (i, (m, distance_m)) in far.iter().enumerate() {
        // Both markers of a pair have the same distance: report them once.
        let mate = far[i + 1..].iter().find(|(_, d)| (d - distance_m).abs() < 1e-12);
        if let Some((mate, _)) = mate {
            let (right, left) = if Side::of(&m.link) == Some(Side::Left) { (mate, m) } else { (m, mate) };
            found.push(ScaleWarning::MarkerAsymmetry {
                right: right.label.clone(),
                left: left.label.clone(),
                distance_m: *distance_m,
                limit_m: limits.mirror_m,
            });
        }
    }
}
