//! The inertial prior: an anthropometric table applied to a person's own geometry.
//!
//! The table's segments are placed in the world of the static posture, between the joint centres
//! that the model has *there*, and then expressed in link frames. The same call therefore applies
//! to a model from landmarks and to one whose joint centres and link frames were changed by a
//! calibration: the prior is always computed from the present geometry.

use crate::anthropometry::{Anthropometry, LengthFrom, SegmentAxes, TableSegment};
use crate::geometry::{apply, axes_x_z, axes_y_z, pose, unit, x_of, y_of, z_of};
use crate::landmarks::{Landmarks, Side};
use crate::{ScaleError, ScaleWarning};
use aloft_body::subject::PriorSd;
use aloft_body::{LinkInertia, State, Subject};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Measurements from the static, kept to recompute the prior after the geometry has changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StaticAnatomy {
    /// Landmarks in the world of the static, m.
    pub landmarks: Landmarks,
    /// Axes of each link's segment in the world of the static (ISB: x forward, y proximal, z
    /// right), in model order.
    pub isb_axes: Vec<UnitQuaternion<f64>>,
    /// Stature, m.
    pub height_m: f64,
    /// Radius of the markers, m.
    pub marker_radius_m: f64,
    /// Segments of a person that have no link in the model, by name: proximal joint and axes.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub carried: BTreeMap<String, CarriedSegment>,
}

/// A segment without a link of its own, in the world of the static.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CarriedSegment {
    /// Proximal joint, m.
    pub origin_m: Vector3<f64>,
    /// Axes of the segment (ISB).
    pub isb_axes: UnitQuaternion<f64>,
}

/// Height of the sole under the ankle joint and depth of the foot's long axis under it, fractions
/// of stature (ankle height: Winter, figure 4.1; that the axis lies at 0.6 of it is an assumption
/// of this project).
const FOOT_AXIS_UNDER_ANKLE: f64 = 0.6 * 0.039;

/// Points that marker sets rarely mark, so that estimating them from stature causes no warning.
const SELDOM_MARKED: [&str; 3] = ["vertex", "ear", "toe_tip"];

struct Points<'a> {
    subject: &'a Subject,
    state: &'a State,
    anatomy: &'a StaticAnatomy,
    table: &'a Anthropometry,
}

impl Points<'_> {
    fn origin(&self, link: &str) -> Option<Vector3<f64>> {
        match self.subject.model.links.iter().position(|l| l.name == link) {
            Some(i) => Some(self.state.world_from_link[i].translation.vector),
            None => self.anatomy.carried.get(link).map(|c| c.origin_m),
        }
    }

    fn axes(&self, link: &str) -> Option<UnitQuaternion<f64>> {
        match self.subject.model.links.iter().position(|l| l.name == link) {
            Some(i) => self.anatomy.isb_axes.get(i).copied(),
            None => self.anatomy.carried.get(link).map(|c| c.isb_axes),
        }
    }

    fn joint(&self, stem: &str, side: Option<Side>) -> Option<Vector3<f64>> {
        self.origin(&format!("{stem}_{}", side?.suffix()))
    }

    /// An anatomical point in the world of the static; `None` if its position cannot be determined.
    fn get(&self, name: &str, side: Option<Side>) -> Option<Vector3<f64>> {
        let landmarks = &self.anatomy.landmarks;
        match name {
            "hip" => self.joint("thigh", side),
            "knee" => self.joint("shank", side),
            "ankle" => self.joint("foot", side),
            "shoulder" => self.joint("upper_arm", side),
            "elbow" => self.joint("forearm", side),
            "wrist" => self.joint("hand", side),
            "lumbar" => self.origin("torso"),
            "neck" => self.origin("head"),
            "mid_hip" => match (self.origin("thigh_r"), self.origin("thigh_l")) {
                (Some(r), Some(l)) => Some((r + l) / 2.0),
                _ => self.origin("pelvis"),
            },
            "vertex" => landmarks.get("vertex").map(|v| v - Vector3::z() * self.anatomy.marker_radius_m),
            "cervicale" => {
                // The height of C7 on the trunk's axis, because the marker itself is on the skin of
                // the back.
                let neck = self.get("neck", None)?;
                let base = self.get("mid_hip", None)?;
                let up = unit(&(neck - base))?;
                Some(landmarks.get("c7").map_or(neck, |c| base + up * up.dot(&(c - base))))
            }
            "suprasternale" | "xiphoid" => landmarks.get(name),
            "hand_distal" => landmarks.side(name, side?),
            "toe" => landmarks.middle("mt1", "mt5", side?).or_else(|| landmarks.side("toe", side?)),
            "heel" => {
                // On the foot's axis, below the ankle, as far back as the skin of the heel.
                let side = side?;
                let axes = self.axes(&format!("foot_{}", side.suffix()))?;
                let ankle = self.joint("foot", Some(side))?;
                let back = landmarks.side("heel", side).map_or(-0.03 * self.anatomy.height_m, |h| {
                    x_of(&axes).dot(&(h - ankle)) + self.anatomy.marker_radius_m
                });
                Some(ankle + axes * Vector3::new(back, -FOOT_AXIS_UNDER_ANKLE * self.anatomy.height_m, 0.0))
            }
            _ => {
                let derived = self.table.derived_points.iter().find(|d| d.name == name)?;
                let fraction = match self.subject.facts.sex {
                    Some(aloft_body::Sex::Female) => derived.fraction_female,
                    Some(aloft_body::Sex::Male) => derived.fraction_male,
                    None => (derived.fraction_female + derived.fraction_male) / 2.0,
                };
                // A derived point of a derived point could recurse endlessly if the file is wrong.
                if self.table.derived_points.iter().any(|d| d.name == derived.from || d.name == derived.to) {
                    return None;
                }
                let (a, b) = (self.get(&derived.from, side)?, self.get(&derived.to, side)?);
                Some(a + (b - a) * fraction)
            }
        }
    }
}

/// One placed segment, world axes.
struct Placed {
    link: usize,
    inertia: LinkInertia,
    sd: PriorSd,
}

/// The link of a model that carries a table's segment: its own, the one under which the model lists
/// it ([`aloft_body::ModelSpec::carries`]), or the nearest existing one towards the pelvis.
fn carrier(subject: &Subject, stem: &str, side: Option<Side>) -> Option<usize> {
    let own = side.map_or_else(|| stem.to_owned(), |s| format!("{stem}_{}", s.suffix()));
    if let Some(own) = subject.model.links.iter().position(|l| l.name == own) {
        return Some(own);
    }
    if let Some((on, _)) = subject.model.carries.iter().find(|(_, parts)| parts.iter().any(|p| p == stem)) {
        return subject.model.links.iter().position(|l| l.name == *on);
    }
    let chain: &[&str] = match stem {
        "head" => &["head", "torso", "pelvis"],
        "hand" => &["hand", "forearm", "upper_arm", "torso", "pelvis"],
        "forearm" => &["forearm", "upper_arm", "torso", "pelvis"],
        "upper_arm" => &["upper_arm", "torso", "pelvis"],
        "foot" => &["foot", "shank", "thigh", "pelvis"],
        "shank" => &["shank", "thigh", "pelvis"],
        "thigh" => &["thigh", "pelvis"],
        "torso" => &["torso", "pelvis"],
        "pelvis" => &["pelvis"],
        _ => return None,
    };
    chain.iter().find_map(|stem| {
        let sided = side.map(|s| format!("{stem}_{}", s.suffix()));
        subject.model.links.iter().position(|l| l.name == *stem || Some(&l.name) == sided.as_ref())
    })
}

fn place(
    points: &Points<'_>,
    segment: &TableSegment,
    reference_height_m: f64,
    weight: f64,
    side: Option<Side>,
    warnings: &mut Vec<ScaleWarning>,
) -> Result<Placed, ScaleError> {
    let table_error = |problem: String| ScaleError::Table { table: points.table.name.clone(), problem };
    let full_name = side.map_or_else(|| segment.name.clone(), |s| format!("{}_{}", segment.name, s.suffix()));
    let link = carrier(points.subject, &segment.link, side).ok_or_else(|| {
        table_error(format!("segment `{full_name}` rides on `{}`, which the model does not have", segment.link))
    })?;
    let own_name = side.map_or_else(|| segment.link.clone(), |s| format!("{}_{}", segment.link, s.suffix()));
    let isb = points
        .axes(&own_name)
        .or_else(|| points.anatomy.isb_axes.get(link).copied())
        .ok_or_else(|| table_error(format!("no segment axes for link `{own_name}`")))?;
    let scaled = segment.reference_length_m * points.anatomy.height_m / reference_height_m;
    let (from, to) = (points.get(&segment.from, side), points.get(&segment.to, side));
    let along = match segment.axes {
        SegmentAxes::Down => -y_of(&isb),
        SegmentAxes::Up | SegmentAxes::Link => y_of(&isb),
        SegmentAxes::Forward => x_of(&isb),
    };
    let open = [(&segment.from, from), (&segment.to, to)];
    if segment.length == LengthFrom::Measured
        && open.iter().any(|(name, p)| p.is_none() && !SELDOM_MARKED.contains(&name.as_str()))
    {
        warnings.push(ScaleWarning::LengthFromStature { segment: full_name.clone(), length_m: scaled });
    }
    let (from, to) = match (from, to) {
        (Some(a), Some(b)) => (a, b),
        (Some(a), None) => (a, a + along * scaled),
        (None, Some(b)) => (b - along * scaled, b),
        (None, None) => {
            return Err(table_error(format!(
                "segment `{full_name}`: neither `{}` nor `{}` is known on this model",
                segment.from, segment.to
            )));
        }
    };
    let axes = match segment.axes {
        SegmentAxes::Down => axes_y_z(&(from - to), &z_of(&isb)),
        SegmentAxes::Up => axes_y_z(&(to - from), &z_of(&isb)),
        SegmentAxes::Forward => axes_x_z(&(to - from), &z_of(&isb)),
        SegmentAxes::Link => Some(isb),
    }
    .unwrap_or(isb);
    let length = match segment.length {
        LengthFrom::Measured => (to - from).norm(),
        LengthFrom::Stature => scaled,
    };
    let mirror = side.map_or(1.0, Side::sign);
    let mass = weight * segment.mass * points.subject.facts.mass_kg;
    let com = Vector3::new(segment.com[0], segment.com[1], mirror * segment.com[2]) * length;
    let r = segment.radii.map(|r| r.signum() * (r * length).powi(2) * mass);
    let (xz, yz) = (mirror * r[4], mirror * r[5]);
    let local = Matrix3::new(r[0], r[3], xz, r[3], r[1], yz, xz, yz, r[2]);
    let rotation = axes.to_rotation_matrix().into_inner();
    Ok(Placed {
        link,
        inertia: LinkInertia {
            mass_kg: mass,
            com_m: apply(&pose(&from, &axes), &com),
            inertia_com_kgm2: rotation * local * rotation.transpose(),
        },
        sd: PriorSd {
            mass_rel: segment.sd.mass,
            com_m: segment.sd.com * length,
            radius_rel: segment.sd.radius,
            together: 0.0,
        },
    })
}

/// Merges two bodies into one, both in the same axes.
fn merge(a: &LinkInertia, b: &LinkInertia) -> LinkInertia {
    let mass = a.mass_kg + b.mass_kg;
    let com = (a.com_m * a.mass_kg + b.com_m * b.mass_kg) / mass;
    let shifted = |part: &LinkInertia| {
        let d = part.com_m - com;
        part.inertia_com_kgm2 + (Matrix3::identity() * d.norm_squared() - d * d.transpose()) * part.mass_kg
    };
    LinkInertia { mass_kg: mass, com_m: com, inertia_com_kgm2: shifted(a) + shifted(b) }
}

/// Projects an inertia tensor about the centre of mass onto the cone of bodies with positive
/// density: the second moments `½ tr(I) 1 − I` keep their axes, and each becomes at least `floor`
/// of their sum. Returns the smallest one before the change, kg·m², if a change was necessary.
pub(crate) fn make_consistent(inertia: &mut LinkInertia, floor: f64) -> Option<f64> {
    let i = (inertia.inertia_com_kgm2 + inertia.inertia_com_kgm2.transpose()) / 2.0;
    let second = Matrix3::identity() * (0.5 * i.trace()) - i;
    let eigen = second.symmetric_eigen();
    let least = floor * eigen.eigenvalues.iter().map(|x| x.max(0.0)).sum::<f64>();
    let smallest = eigen.eigenvalues.min();
    if smallest >= least {
        inertia.inertia_com_kgm2 = i;
        return None;
    }
    let raised = eigen.eigenvalues.map(|x| x.max(least));
    let second = eigen.eigenvectors * Matrix3::from_diagonal(&raised) * eigen.eigenvectors.transpose();
    inertia.inertia_com_kgm2 = Matrix3::identity() * second.trace() - second;
    Some(smallest)
}

/// Computes the prior inertia of every link from a table and the subject's present geometry: joint
/// centres by forward kinematics at `subject.static_q`, landmarks and segment axes from the static.
/// Replaces `prior` and `prior_sd`; the masses add up to `facts.mass_kg`, and every link is
/// physically consistent.
///
/// Call it again after a calibration has changed joint places, link frames or `static_q`.
///
/// # Errors
/// [`ScaleError::Facts`] for a mass that is not positive; [`ScaleError::Table`] for a table that
/// does not fit the model.
pub fn attach_prior(
    subject: &mut Subject,
    tables: &Anthropometry,
    anatomy: &StaticAnatomy,
) -> Result<Vec<ScaleWarning>, ScaleError> {
    let mass_kg = subject.facts.mass_kg;
    let facts_error = |problem: String| ScaleError::Facts { subject: subject.facts.name.clone(), problem };
    if !(mass_kg > 0.0 && mass_kg < 1000.0) {
        return Err(facts_error(format!("a body mass of {mass_kg} kg")));
    }
    if subject.static_q.len() != subject.model.nq || anatomy.isb_axes.len() != subject.model.n_links() {
        return Err(facts_error("the static posture does not belong to this model".into()));
    }
    tables.validate()?;
    let mut warnings = Vec::new();
    let mut state = State::new(&subject.model);
    state.forward_position(&subject.model, &subject.static_q);
    let points = Points { subject, state: &state, anatomy, table: tables };
    let n = subject.model.n_links();
    let mut links: Vec<Option<(LinkInertia, PriorSd)>> = vec![None; n];
    for (body, weight) in tables.bodies_for(subject.facts.sex)? {
        for segment in &body.segments {
            let sides: &[Option<Side>] =
                if segment.is_limb() { &[Some(Side::Right), Some(Side::Left)] } else { &[None] };
            for &side in sides {
                let part = place(&points, segment, body.reference_height_m, weight, side, &mut warnings)?;
                links[part.link] = Some(match links[part.link].take() {
                    None => (part.inertia, part.sd),
                    Some((inertia, sd)) => {
                        let share = part.inertia.mass_kg / (part.inertia.mass_kg + inertia.mass_kg);
                        let mix = |a: f64, b: f64| a + share * (b - a);
                        let sd = PriorSd {
                            mass_rel: mix(sd.mass_rel, part.sd.mass_rel),
                            com_m: mix(sd.com_m, part.sd.com_m),
                            radius_rel: mix(sd.radius_rel, part.sd.radius_rel),
                            together: 0.0,
                        };
                        (merge(&inertia, &part.inertia), sd)
                    }
                });
            }
        }
    }
    let total: f64 = links.iter().flatten().map(|(i, _)| i.mass_kg).sum();
    let factor = mass_kg / total;
    let mut prior = Vec::with_capacity(n);
    let mut prior_sd = Vec::with_capacity(n);
    for (i, entry) in links.into_iter().enumerate() {
        let Some((mut inertia, sd)) = entry else {
            return Err(ScaleError::Table {
                table: tables.name.clone(),
                problem: format!("no segment for link `{}`", subject.model.links[i].name),
            });
        };
        inertia.mass_kg *= factor;
        inertia.inertia_com_kgm2 *= factor;
        if let Some(smallest_eigenvalue) = make_consistent(&mut inertia, 1e-3) {
            warnings.push(ScaleWarning::InertiaProjected {
                link: subject.model.links[i].name.clone(),
                smallest_eigenvalue,
            });
        }
        prior.push(inertia.transformed(&state.world_from_link[i].inverse()));
        prior_sd.push(sd);
    }
    share_rounding(&mut prior, mass_kg);
    subject.prior = prior;
    subject.prior_sd = prior_sd;
    Ok(warnings)
}

/// Adds the rounding error of the masses to the heaviest link, so that their sum is the mass from
/// the scale.
fn share_rounding(prior: &mut [LinkInertia], mass_kg: f64) {
    let heaviest = (0..prior.len()).max_by(|&a, &b| prior[a].mass_kg.total_cmp(&prior[b].mass_kg));
    let Some(h) = heaviest else { return };
    for _ in 0..4 {
        let sum: f64 = prior.iter().map(|p| p.mass_kg).sum();
        if sum == mass_kg {
            return;
        }
        prior[h].mass_kg += mass_kg - sum;
    }
}

/// Differences between several tables for this person: for each link the standard deviation over
/// tables of mass (relative), centre of mass (per axis, m) and radii of gyration (relative). A
/// lower bound for the uncertainty of a single table.
///
/// # Errors
/// As [`attach_prior`]; [`ScaleError::Facts`] with fewer than two tables.
pub fn prior_spread(
    subject: &Subject,
    tables: &[&Anthropometry],
    anatomy: &StaticAnatomy,
) -> Result<Vec<PriorSd>, ScaleError> {
    if tables.len() < 2 {
        return Err(ScaleError::Facts {
            subject: subject.facts.name.clone(),
            problem: "a spread between tables needs at least two".into(),
        });
    }
    let mut priors = Vec::with_capacity(tables.len());
    let mut work = subject.clone();
    for table in tables {
        attach_prior(&mut work, table, anatomy)?;
        priors.push(work.prior.clone());
    }
    let k = priors.len() as f64;
    let sd = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / k;
        (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (k - 1.0)).sqrt()
    };
    Ok((0..subject.model.n_links())
        .map(|i| {
            let masses: Vec<f64> = priors.iter().map(|p| p[i].mass_kg).collect();
            let radius = |p: &LinkInertia| (p.inertia_com_kgm2.trace() / p.mass_kg).sqrt();
            let radii: Vec<f64> = priors.iter().map(|p| radius(&p[i])).collect();
            let com2: f64 = (0..3).map(|a| sd(&priors.iter().map(|p| p[i].com_m[a]).collect::<Vec<_>>()).powi(2)).sum();
            PriorSd {
                mass_rel: sd(&masses) / (masses.iter().sum::<f64>() / k),
                com_m: (com2 / 3.0).sqrt(),
                radius_rel: sd(&radii) / (radii.iter().sum::<f64>() / k),
                together: 0.0,
            }
        })
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn merging_two_halves_of_a_bar_gives_the_bar() {
        let half = |x: f64| LinkInertia {
            mass_kg: 1.0,
            com_m: Vector3::new(x, 0.0, 0.0),
            inertia_com_kgm2: Matrix3::from_diagonal(&Vector3::new(0.0, 1.0 / 12.0, 1.0 / 12.0)),
        };
        let bar = merge(&half(-0.5), &half(0.5));
        assert!(bar.com_m.norm() < 1e-15);
        assert!((bar.inertia_com_kgm2[(1, 1)] - 2.0 * 4.0 / 12.0).abs() < 1e-12);
    }

    #[test]
    fn projection_is_idempotent_and_consistent() {
        let mut bad = LinkInertia {
            mass_kg: 1.0,
            com_m: Vector3::zeros(),
            inertia_com_kgm2: Matrix3::new(1.0, 0.3, 0.0, 0.3, 1.0, 0.1, 0.0, 0.1, 3.0),
        };
        assert!(make_consistent(&mut bad, 1e-3).is_some_and(|e| e < 0.0));
        assert!(make_consistent(&mut bad, 0.999e-3).is_none());
        let j = aloft_body::inertia::pseudo_inertia(&bad.to_phi());
        assert!(j.symmetric_eigenvalues().min() > 0.0);
    }
}
