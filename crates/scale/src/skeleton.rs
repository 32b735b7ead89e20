//! Joint centres and segment axes of a standing person, in the world of the static trial.
//!
//! Link axes follow the ISB: x forward, y up (towards the proximal end), z to the right on both
//! sides; origins at the proximal joint, that of the pelvis between the hips. Every centre is found
//! by the best method that the landmarks allow (given point, midpoint, regression, body
//! proportions), and the method is stored with it.

use crate::ScaleError;
use crate::geometry::{apply, axes_x_z, axes_y_z, axes_z_y, pose, reject, unit, x_of, y_of, z_of};
use crate::hip::{HipMethod, PelvisMarkers, hip_centre, lumbar_centre};
use crate::landmarks::{Landmarks, Side};
use crate::report::JointMethod;
use aloft_body::Sex;
use nalgebra::{Isometry3, Rotation3, Unit, UnitQuaternion, Vector3};
use std::collections::BTreeMap;

/// A joint centre in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Centre {
    pub point: Vector3<f64>,
    pub method: JointMethod,
    pub sd_m: f64,
}

/// A link's pose in the static and its proximal joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PlacedLink {
    /// Link frame: links on hinges have z along their axis.
    pub world_from_link: Isometry3<f64>,
    /// Axes with y exactly along the segment, for the inertial prior.
    pub isb_axes: UnitQuaternion<f64>,
    pub method: JointMethod,
    pub centre_sd_m: f64,
    pub axis_sd_rad: Option<f64>,
}

/// The standing skeleton, by link name.
#[derive(Debug, Clone)]
pub(crate) struct Skeleton {
    pub links: BTreeMap<String, PlacedLink>,
    pub pelvis: PelvisMarkers,
    pub height_m: f64,
    pub estimated_height_m: Option<f64>,
}

/// Lengths as fractions of stature, used if markers are missing. Limbs: Winter, *Biomechanics and
/// Motor Control*, figure 4.1. The others are rounded values of this project, not of a publication;
/// quantities based on them have a large standard deviation.
mod proportion {
    pub const UPPER_ARM: f64 = 0.186;
    pub const FOREARM: f64 = 0.146;
    pub const THIGH: f64 = 0.245;
    pub const SHANK: f64 = 0.246;
    pub const SHOULDER_HALF_WIDTH: f64 = 0.10;
    pub const TRUNK: f64 = 0.27;
    /// ASIS to malleolus: ASIS at 0.57 of stature, malleolus at 0.04.
    pub const ASIS_TO_ANKLE: f64 = 0.53;
    /// ASIS to acromion: acromion at 0.82 of stature.
    pub const ASIS_TO_ACROMION: f64 = 0.25;
    /// Distance of C7 and suprasternale: fraction of stature in adults.
    pub const THORAX_DEPTH: f64 = 0.09;
}

/// Standard deviations of joint centres, m, and hinge axes, rad.
mod sd {
    pub const HIP: f64 = 0.006;
    pub const HINGE: f64 = 0.004;
    pub const HINGE_REGRESSION: f64 = 0.010;
    pub const ANKLE: f64 = 0.004;
    pub const WRIST: f64 = 0.005;
    pub const WRIST_SINGLE: f64 = 0.012;
    pub const SHOULDER: f64 = 0.020;
    pub const NECK: f64 = 0.020;
    pub const LUMBAR: f64 = 0.030;
    pub const PROPORTION: f64 = 0.050;
    pub const AXIS: f64 = 0.1;
    pub const AXIS_ASSUMED: f64 = 0.3;
}

/// Cosine of the angle between the pelvis' long axis and the vertical up to which a person stands.
const UPRIGHT_COSINE: f64 = 0.7;

pub(crate) struct Builder<'a> {
    pub landmarks: &'a Landmarks,
    pub trial: &'a str,
    pub sex: Option<Sex>,
    pub stated_height_m: Option<f64>,
    pub marker_radius_m: f64,
    pub hip_method: HipMethod,
    /// Standard deviation of joint centres that the recording gives, m; those of markers if none.
    pub given_sd_m: Option<f64>,
}

impl Builder<'_> {
    fn degenerate(&self, what: &str) -> ScaleError {
        ScaleError::Degenerate {
            trial: self.trial.into(),
            what: what.into(),
            problem: "its landmarks lie on one point or line".into(),
        }
    }

    pub fn build(&self) -> Result<Skeleton, ScaleError> {
        let pelvis = PelvisMarkers::from_landmarks(self.landmarks, self.trial)?;
        let right = z_of(&pelvis.world_from_pelvis.rotation);
        let legs_rough: Vec<f64> = Side::BOTH.iter().filter_map(|&s| self.rough_leg_length(s)).collect();
        let leg = (!legs_rough.is_empty()).then(|| legs_rough.iter().sum::<f64>() / legs_rough.len() as f64);
        let estimated_height_m = leg.map(|leg| {
            let trunk =
                self.landmarks.across("acromion").map(|a| (a - pelvis.world_from_pelvis.translation.vector).norm());
            match trunk {
                Some(trunk) => (leg + trunk) / (proportion::ASIS_TO_ANKLE + proportion::ASIS_TO_ACROMION),
                None => leg / proportion::ASIS_TO_ANKLE,
            }
        });
        let estimated_height_m = estimated_height_m.or_else(|| self.height_of_legs());
        let height_m = self.stated_height_m.or(estimated_height_m).unwrap_or(1.70);
        let hips = Side::BOTH.map(|s| self.hip(&pelvis, s, leg));
        let mut links = BTreeMap::new();
        let middle = (hips[0].point + hips[1].point) / 2.0;
        let pelvis_axes = pelvis.world_from_pelvis.rotation;
        links.insert(
            "pelvis".to_owned(),
            PlacedLink {
                world_from_link: pose(&middle, &pelvis_axes),
                isb_axes: pelvis_axes,
                method: hips[0].method,
                centre_sd_m: hips[0].sd_m,
                axis_sd_rad: None,
            },
        );
        for (side, hip) in Side::BOTH.into_iter().zip(hips) {
            self.leg(&mut links, side, &hip, &right, &pelvis_axes, height_m)?;
        }
        self.trunk(&mut links, &pelvis, height_m)?;
        let torso_axes = links["torso"].isb_axes;
        let neck = links["head"].world_from_link.translation.vector;
        for side in Side::BOTH {
            self.arm(&mut links, side, &torso_axes, &neck, height_m)?;
        }
        Ok(Skeleton { links, pelvis, height_m, estimated_height_m })
    }

    /// ASIS to malleolus, via the knee if it is known (a knee is not quite straight in the static).
    fn rough_leg_length(&self, side: Side) -> Option<f64> {
        let l = self.landmarks;
        let asis = l.side("asis", side)?;
        let ankle = l.side("ankle_medial", side).or_else(|| l.side("ankle_lateral", side))?;
        let knee = l.middle("knee_lateral", "knee_medial", side).or_else(|| l.side("knee_lateral", side));
        Some(knee.map_or((ankle - asis).norm(), |k| (k - asis).norm() + (ankle - k).norm()))
    }

    /// Stature from given joint centres of the legs.
    fn height_of_legs(&self) -> Option<f64> {
        let l = self.landmarks;
        let legs: Vec<f64> = Side::BOTH
            .iter()
            .filter_map(|&s| {
                let (hip, knee, ankle) =
                    (l.side("hip_centre", s)?, l.side("knee_centre", s)?, l.side("ankle_centre", s)?);
                Some((hip - knee).norm() + (knee - ankle).norm())
            })
            .collect();
        let n = legs.len() as f64;
        (n > 0.0).then(|| legs.iter().sum::<f64>() / n / (proportion::THIGH + proportion::SHANK))
    }

    /// A joint centre that the recording gives.
    fn given(&self, name: &str, side: Side) -> Option<Centre> {
        let sd_m = self.given_sd_m.unwrap_or(sd::HINGE);
        self.landmarks.side(name, side).map(|point| Centre { point, method: JointMethod::Given, sd_m })
    }

    /// Direction to the right along the line through a lateral and a medial landmark, or through
    /// the centre and one of them.
    fn across_joint(&self, lateral: &str, medial: &str, centre: &Vector3<f64>, side: Side) -> Option<Vector3<f64>> {
        let l = self.landmarks;
        let outwards = match (l.side(lateral, side), l.side(medial, side)) {
            (Some(a), Some(b)) => a - b,
            (Some(a), None) => a - centre,
            (None, Some(b)) => centre - b,
            (None, None) => return None,
        };
        unit(&(outwards * side.sign()))
    }

    fn hip(&self, pelvis: &PelvisMarkers, side: Side, leg: Option<f64>) -> Centre {
        if let Some(point) = self.landmarks.side("hip_centre", side) {
            return Centre { point, method: JointMethod::Given, sd_m: self.given_sd_m.unwrap_or(sd::HIP) };
        }
        let local = hip_centre(self.hip_method, pelvis, leg, self.marker_radius_m, side)
            .or_else(|| hip_centre(HipMethod::Harrington, pelvis, leg, self.marker_radius_m, side))
            .unwrap_or_default();
        Centre { point: apply(&pelvis.world_from_pelvis, &local), method: JointMethod::Regression, sd_m: sd::HIP }
    }

    /// Centre and right-pointing axis of a hinge: a given centre, or from a lateral and, if
    /// available, a medial marker.
    ///
    /// `offset` is the depth of the joint below the lateral marker (Reed 1999), `assumed` the axis
    /// if none is marked.
    fn hinge(
        &self,
        centre: &str,
        lateral: &str,
        medial: &str,
        side: Side,
        offset: Option<f64>,
        assumed: &Vector3<f64>,
    ) -> Option<(Centre, Vector3<f64>, f64)> {
        let l = self.landmarks;
        if let Some(centre) = self.given(centre, side) {
            return Some(match self.across_joint(lateral, medial, &centre.point, side) {
                Some(axis) => (centre, axis, sd::AXIS),
                None => (centre, *assumed, sd::AXIS_ASSUMED),
            });
        }
        match (l.side(lateral, side), l.side(medial, side)) {
            (Some(a), Some(b)) => {
                let axis = unit(&((a - b) * side.sign()))?;
                Some((Centre { point: (a + b) / 2.0, method: JointMethod::Midpoint, sd_m: sd::HINGE }, axis, sd::AXIS))
            }
            (Some(a), None) | (None, Some(a)) => {
                let inwards = if l.side(lateral, side).is_some() { -side.sign() } else { side.sign() };
                let depth = offset.unwrap_or(0.045) + self.marker_radius_m;
                let point = a + assumed * (inwards * depth);
                Some((
                    Centre { point, method: JointMethod::Regression, sd_m: sd::HINGE_REGRESSION },
                    *assumed,
                    sd::AXIS_ASSUMED,
                ))
            }
            (None, None) => None,
        }
    }

    fn leg(
        &self,
        links: &mut BTreeMap<String, PlacedLink>,
        side: Side,
        hip: &Centre,
        right: &Vector3<f64>,
        pelvis_axes: &UnitQuaternion<f64>,
        height_m: f64,
    ) -> Result<(), ScaleError> {
        let l = self.landmarks;
        let name = |stem: &str| format!("{stem}_{}", side.suffix());
        let down = -y_of(pelvis_axes);
        let first = |names: &[&str]| names.iter().find_map(|name| l.side(name, side));
        let knee_mark = first(&["knee_centre", "knee_lateral", "knee_medial"]);
        let ankle_mark = first(&["ankle_centre", "ankle_lateral", "ankle_medial", "heel"]);
        // Without a medial knee marker: to the right, perpendicular to the line from hip to ankle.
        let along = unit(&(ankle_mark.or(knee_mark).unwrap_or(hip.point + down) - hip.point)).unwrap_or(down);
        let assumed = unit(&reject(right, &along)).unwrap_or(*right);
        let shank_mark = match (l.side("knee_lateral", side), l.side("ankle_lateral", side)) {
            (Some(k), Some(a)) => Some((k - a).norm()),
            _ => None,
        };
        let (knee, axis, axis_sd) = self
            .hinge("knee_centre", "knee_lateral", "knee_medial", side, shank_mark.map(|d| 0.118 * d), &assumed)
            .unwrap_or_else(|| {
                let point = hip.point + along * (proportion::THIGH * height_m);
                (Centre { point, method: JointMethod::Proportion, sd_m: sd::PROPORTION }, assumed, sd::AXIS_ASSUMED)
            });
        let (ankle, malleoli, _) = self
            .hinge("ankle_centre", "ankle_lateral", "ankle_medial", side, shank_mark.map(|d| 0.085 * d), &axis)
            .unwrap_or_else(|| {
                let point = knee.point + along * (proportion::SHANK * height_m);
                (Centre { point, method: JointMethod::Proportion, sd_m: sd::PROPORTION }, axis, sd::AXIS_ASSUMED)
            });
        let thigh_axes = axes_y_z(&(hip.point - knee.point), &axis).ok_or_else(|| self.degenerate(&name("thigh")))?;
        let shank_axes = axes_z_y(&axis, &(knee.point - ankle.point)).ok_or_else(|| self.degenerate(&name("shank")))?;
        let shank_isb = axes_y_z(&(knee.point - ankle.point), &axis).ok_or_else(|| self.degenerate(&name("shank")))?;
        links.insert(name("thigh"), placed(hip, &thigh_axes, &thigh_axes, None));
        links.insert(name("shank"), placed(&knee, &shank_axes, &shank_isb, Some(axis_sd)));
        // Foot: along its own axis where that is given, else heel to toe; the malleoli define the
        // direction to the right.
        let ahead = l.side("foot_forward", side).map(|p| p - ankle.point);
        let heel = l.side("heel", side);
        let toe = l
            .side("toe", side)
            .or_else(|| l.middle("mt1", "mt5", side))
            .or_else(|| l.side("mt5", side))
            .or_else(|| l.side("mt1", side));
        let forward = match (heel, toe) {
            (Some(h), Some(t)) => t - h,
            (None, Some(t)) => reject(&(t - ankle.point), &y_of(&shank_isb)),
            _ => reject(&x_of(&shank_isb), &Vector3::z()),
        };
        let forward = ahead.unwrap_or(forward);
        let foot_axes = axes_x_z(&forward, &malleoli).ok_or_else(|| self.degenerate(&name("foot")))?;
        let mut foot = placed(&ankle, &foot_axes, &foot_axes, None);
        if foot.method == JointMethod::Midpoint {
            foot.centre_sd_m = sd::ANKLE;
        }
        links.insert(name("foot"), foot);
        Ok(())
    }

    fn trunk(
        &self,
        links: &mut BTreeMap<String, PlacedLink>,
        pelvis: &PelvisMarkers,
        height_m: f64,
    ) -> Result<(), ScaleError> {
        let l = self.landmarks;
        let frame = &pelvis.world_from_pelvis;
        let right = z_of(&frame.rotation);
        let lumbar = apply(frame, &lumbar_centre(pelvis, self.sex));
        let (c7, front) = (l.get("c7"), l.get("suprasternale"));
        let pair = |name: &str| Some((l.side(name, Side::Right)?, l.side(name, Side::Left)?));
        let shoulders = pair("acromion").or_else(|| pair("shoulder_centre"));
        let across = shoulders.map_or(right, |(r, l)| r - l);
        // Neck (C7/T1): from C7 towards the suprasternale, turned up (Reed 1999 via Dumas and
        // Wojtusch 2018).
        let (turn_up_deg, fraction) = match self.sex {
            Some(Sex::Female) => (14.0, 0.53),
            Some(Sex::Male) => (8.0, 0.55),
            None => (11.0, 0.54),
        };
        let given = l.get("neck_centre").map(|point| {
            let sd_m = self.given_sd_m.unwrap_or(sd::NECK);
            Centre { point, method: JointMethod::Given, sd_m }
        });
        let marked = match (c7, front, shoulders) {
            (Some(c), Some(f), _) => {
                let direction =
                    turn_down(&(f - c), &across, -turn_up_deg).ok_or_else(|| self.degenerate("the neck"))?;
                Centre {
                    point: c + direction * (fraction * (f - c).norm()),
                    method: JointMethod::Regression,
                    sd_m: sd::NECK,
                }
            }
            (Some(c), None, _) => {
                let forward = unit(&across.cross(&(lumbar - c))).unwrap_or_else(|| x_of(&frame.rotation));
                let point = c + forward * (fraction * proportion::THORAX_DEPTH * height_m);
                Centre { point, method: JointMethod::Regression, sd_m: 1.5 * sd::NECK }
            }
            (None, _, Some((r, l))) => {
                let middle = (r + l) / 2.0;
                let up = unit(&(middle - lumbar)).ok_or_else(|| self.degenerate("the torso"))?;
                Centre { point: middle + up * (0.02 * height_m), method: JointMethod::Regression, sd_m: 1.5 * sd::NECK }
            }
            (None, Some(f), None) => {
                let up = unit(&(f - lumbar)).ok_or_else(|| self.degenerate("the torso"))?;
                let back = unit(&up.cross(&right)).unwrap_or_else(|| -x_of(&frame.rotation));
                let point = f + back * (0.5 * proportion::THORAX_DEPTH * height_m) + up * (0.02 * height_m);
                Centre { point, method: JointMethod::Regression, sd_m: 2.0 * sd::NECK }
            }
            (None, None, None) => {
                // the pelvis of a standing person is tilted forwards, the trunk is upright
                let upright = y_of(&frame.rotation).z > UPRIGHT_COSINE;
                let up = if upright { Vector3::z() } else { y_of(&frame.rotation) };
                let point = lumbar + up * (proportion::TRUNK * height_m);
                Centre { point, method: JointMethod::Proportion, sd_m: sd::PROPORTION }
            }
        };
        let neck = given.unwrap_or(marked);
        let torso_axes = axes_y_z(&(neck.point - lumbar), &across).ok_or_else(|| self.degenerate("the torso"))?;
        let lumbar = Centre { point: lumbar, method: JointMethod::Regression, sd_m: sd::LUMBAR };
        links.insert("torso".into(), placed(&lumbar, &torso_axes, &torso_axes, None));
        // Head: along its four markers if present, otherwise upright as the torso.
        let head_axes = match (l.across("head_front"), l.across("head_back")) {
            (Some(front), Some(back)) => {
                let pair = |stem: &str| Some(l.side(stem, Side::Right)? - l.side(stem, Side::Left)?);
                let across = pair("head_front").unwrap_or_default() + pair("head_back").unwrap_or_default();
                axes_x_z(&(front - back), &across).ok_or_else(|| self.degenerate("the head"))?
            }
            _ => match l.get("vertex").and_then(|v| axes_y_z(&(v - neck.point), &z_of(&torso_axes))) {
                Some(axes) => axes,
                None => torso_axes,
            },
        };
        links.insert("head".into(), placed(&neck, &head_axes, &head_axes, None));
        Ok(())
    }

    fn shoulder(&self, side: Side, torso: &UnitQuaternion<f64>, neck: &Vector3<f64>, height_m: f64) -> Centre {
        let l = self.landmarks;
        if let Some(centre) = self.given("shoulder_centre", side) {
            return centre;
        }
        let Some(acromion) = l.side("acromion", side) else {
            let lateral = z_of(torso) * (side.sign() * proportion::SHOULDER_HALF_WIDTH * height_m);
            let point = neck + lateral - y_of(torso) * (0.03 * height_m);
            return Centre { point, method: JointMethod::Proportion, sd_m: sd::PROPORTION };
        };
        // Reed 1999: from the acromion along C7 → suprasternale turned down by 67°, 0.42 of their
        // distance.
        let (direction, depth, sd_m) = match (l.get("c7"), l.get("suprasternale")) {
            (Some(c), Some(f)) => (turn_down(&(f - c), &z_of(torso), 67.0), (f - c).norm(), sd::SHOULDER),
            _ => (None, proportion::THORAX_DEPTH * height_m, 1.5 * sd::SHOULDER),
        };
        let direction = direction.unwrap_or_else(|| -y_of(torso));
        let point = acromion + direction * (0.42 * depth);
        Centre { point, method: JointMethod::Regression, sd_m }
    }

    fn arm(
        &self,
        links: &mut BTreeMap<String, PlacedLink>,
        side: Side,
        torso: &UnitQuaternion<f64>,
        neck: &Vector3<f64>,
        height_m: f64,
    ) -> Result<(), ScaleError> {
        let l = self.landmarks;
        let name = |stem: &str| format!("{stem}_{}", side.suffix());
        let shoulder = self.shoulder(side, torso, neck, height_m);
        let marked_wrist = self.given("wrist_centre", side).or_else(|| {
            match (l.side("wrist_radial", side), l.side("wrist_ulnar", side)) {
                (Some(a), Some(b)) => {
                    Some(Centre { point: (a + b) / 2.0, method: JointMethod::Midpoint, sd_m: sd::WRIST })
                }
                (Some(a), None) | (None, Some(a)) => {
                    Some(Centre { point: a, method: JointMethod::Regression, sd_m: sd::WRIST_SINGLE })
                }
                (None, None) => {
                    let single = l.side("wrist", side);
                    single.map(|point| Centre { point, method: JointMethod::Regression, sd_m: sd::WRIST_SINGLE })
                }
            }
        });
        let first = |names: &[&str]| names.iter().find_map(|name| l.side(name, side));
        let elbow_mark = first(&["elbow_centre", "elbow_lateral", "elbow_medial"]);
        // Without a medial elbow marker: normal to the plane of upper arm and forearm if the elbow
        // is bent, otherwise to the right.
        let upper = elbow_mark.map(|e| e - shoulder.point);
        let assumed = upper
            .and_then(|u| {
                let f = marked_wrist?.point - elbow_mark?;
                let normal = u.cross(&f);
                (normal.norm() > 15.0_f64.to_radians().sin() * u.norm() * f.norm()).then(|| unit(&normal)).flatten()
            })
            .or_else(|| unit(&reject(&z_of(torso), &unit(&upper.unwrap_or(-y_of(torso)))?)))
            .or_else(|| unit(&reject(&x_of(torso), &unit(&upper?)?)))
            .unwrap_or_else(|| z_of(torso));
        let forearm_mark = l.side("elbow_lateral", side).zip(marked_wrist).map(|(e, w)| (e - w.point).norm());
        let (elbow, axis, axis_sd) = self
            .hinge("elbow_centre", "elbow_lateral", "elbow_medial", side, forearm_mark.map(|d| 0.155 * d), &assumed)
            .unwrap_or_else(|| {
                let point = shoulder.point - y_of(torso) * (proportion::UPPER_ARM * height_m);
                (Centre { point, method: JointMethod::Proportion, sd_m: sd::PROPORTION }, assumed, sd::AXIS_ASSUMED)
            });
        let upper_axes =
            axes_y_z(&(shoulder.point - elbow.point), &axis).ok_or_else(|| self.degenerate(&name("upper_arm")))?;
        let wrist = marked_wrist.unwrap_or_else(|| Centre {
            point: elbow.point - y_of(&upper_axes) * (proportion::FOREARM * height_m),
            method: JointMethod::Proportion,
            sd_m: sd::PROPORTION,
        });
        let forearm_axes =
            axes_z_y(&axis, &(elbow.point - wrist.point)).ok_or_else(|| self.degenerate(&name("forearm")))?;
        let forearm_isb =
            axes_y_z(&(elbow.point - wrist.point), &axis).ok_or_else(|| self.degenerate(&name("forearm")))?;
        links.insert(name("upper_arm"), placed(&shoulder, &upper_axes, &upper_axes, None));
        links.insert(name("forearm"), placed(&elbow, &forearm_axes, &forearm_isb, Some(axis_sd)));
        // Thumb side out: to the right on the right hand.
        let both = l.side("wrist_radial", side).is_some() && l.side("wrist_ulnar", side).is_some();
        let styloids = if both || wrist.method == JointMethod::Given {
            self.across_joint("wrist_radial", "wrist_ulnar", &wrist.point, side).unwrap_or(axis)
        } else {
            axis
        };
        let up = l.side("hand_distal", side).map_or(elbow.point - wrist.point, |h| wrist.point - h);
        let hand_axes = axes_y_z(&up, &styloids).or_else(|| axes_y_z(&up, &axis)).unwrap_or(forearm_isb);
        links.insert(name("hand"), placed(&wrist, &hand_axes, &hand_axes, None));
        Ok(())
    }
}

fn placed(
    centre: &Centre,
    axes: &UnitQuaternion<f64>,
    isb: &UnitQuaternion<f64>,
    axis_sd_rad: Option<f64>,
) -> PlacedLink {
    PlacedLink {
        world_from_link: pose(&centre.point, axes),
        isb_axes: *isb,
        method: centre.method,
        centre_sd_m: centre.sd_m,
        axis_sd_rad,
    }
}

/// A forward direction of the sagittal plane (perpendicular to `right`) turned down by an angle.
fn turn_down(forward: &Vector3<f64>, right: &Vector3<f64>, angle_deg: f64) -> Option<Vector3<f64>> {
    let right = Unit::new_normalize(unit(right)?);
    let forward = unit(&reject(forward, &right))?;
    // A positive rotation about the axis to the right takes x (forward) to y (up).
    Some(Rotation3::from_axis_angle(&right, -angle_deg.to_radians()) * forward)
}
