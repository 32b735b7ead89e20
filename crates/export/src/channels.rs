//! Every series of a recording with a unique name and unit, as written by the data formats
//! (Parquet, CSV, BIDS).

use crate::coordinates::Quantity;
use crate::loads::{LOADED_N, centre_of_pressure};
use crate::{SubjectExport, TrialExport};
use aloft_body::State;
use nalgebra::{Vector3, Vector6};

/// One series over the frames of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Quantity: `marker`, `joint_centre`, `centre_of_mass`, `orientation`, `coordinate` (joint
    /// angles as solved), `coordinate_filtered`, `coordinate_rate`, `coordinate_acceleration`,
    /// `ground_force`, `ground_moment`, `centre_of_pressure`, `generalised_force`,
    /// `residual_force`, `residual_moment`, `marker_error`.
    pub quantity: &'static str,
    /// Name of the marker, joint, coordinate or plate.
    pub name: String,
    /// `x`, `y`, `z` (and `w`), or empty.
    pub axis: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// One value per frame; NaN where missing.
    pub values: Vec<f64>,
}

impl Channel {
    /// Heading of a wide table: `coordinate hip_flexion_r [deg]`, `marker LASI x [m]`.
    pub fn heading(&self) -> String {
        let words = [self.quantity, &self.name, self.axis];
        let words: Vec<&str> = words.into_iter().filter(|w| !w.is_empty()).collect();
        format!("{} [{}]", words.join(" "), self.unit)
    }
}

const AXES: [&str; 3] = ["x", "y", "z"];

fn push(
    out: &mut Vec<Channel>,
    quantity: &'static str,
    name: &str,
    unit: &'static str,
    series: impl Iterator<Item = Vector3<f64>> + Clone,
) {
    for (k, axis) in AXES.into_iter().enumerate() {
        let values = series.clone().map(|v| v[k]).collect();
        out.push(Channel { quantity, name: name.to_owned(), axis, unit, values });
    }
}

fn scalar(quantity: &'static str, name: &str, unit: &'static str, values: Vec<f64>) -> Channel {
    Channel { quantity, name: name.to_owned(), axis: "", unit, values }
}

/// Names of joint centres: `RHJC`, `LKJC` …, as usual in gait laboratories, `<link>_JC` for other
/// models, `PELO` and so on for the root.
pub(crate) fn joint_centre_name(link: &str, is_root: bool) -> String {
    let (stem, side) = match link.rsplit_once('_') {
        Some((stem, "r")) => (stem, "R"),
        Some((stem, "l")) => (stem, "L"),
        _ => (link, ""),
    };
    let short = match stem {
        "thigh" => "HJC",
        "shank" => "KJC",
        "foot" => "AJC",
        "upper_arm" => "SJC",
        "forearm" => "EJC",
        "hand" => "WJC",
        "torso" => "LUMB",
        "head" => "NECK",
        "pelvis" if is_root => "PELO",
        _ if is_root => return format!("{link}_O"),
        _ => return format!("{link}_JC"),
    };
    format!("{side}{short}")
}

/// Joint centres (link origins) of a trial's motion (as solved if available), world, m: one series
/// per link.
pub fn joint_centres(subject: &SubjectExport, trial: &TrialExport) -> Vec<(String, Vec<Vector3<f64>>)> {
    let Some(motion) = trial.motion.as_ref().or(trial.filtered.as_ref()) else { return Vec::new() };
    let model = &subject.subject.model;
    let mut state = State::new(model);
    let mut out: Vec<(String, Vec<Vector3<f64>>)> = model
        .links
        .iter()
        .map(|l| (joint_centre_name(&l.name, l.parent.is_none()), vec![Vector3::repeat(f64::NAN); motion.n_frames()]))
        .collect();
    for f in (0..motion.n_frames()).filter(|&f| motion.is_valid(f)) {
        state.forward_position(model, motion.q(f));
        for (series, pose) in out.iter_mut().zip(&state.world_from_link) {
            series.1[f] = pose.translation.vector;
        }
    }
    out
}

/// All series of a recording, Z-up world, SI with degrees.
pub fn channels(subject: &SubjectExport, trial: &TrialExport) -> Vec<Channel> {
    let mut out = Vec::new();
    let markers = &trial.trial.markers;
    for (label, path) in markers.labels.iter().zip(&markers.trajectories) {
        push(&mut out, "marker", label, "m", path.iter().copied());
    }
    for (name, path) in joint_centres(subject, trial) {
        push(&mut out, "joint_centre", &name, "m", path.iter().copied());
    }
    kinematics(subject, trial, &mut out);
    for plate in &trial.plates {
        let forces = plate.wrench.iter().map(|w| Vector3::new(w[0], w[1], w[2]));
        push(&mut out, "ground_force", &plate.name, "N", forces);
        let moments = plate.wrench.iter().map(|w| Vector3::new(w[3], w[4], w[5]));
        push(&mut out, "ground_moment", &plate.name, "N.m", moments);
        let cop = |w: &Vector6<f64>| if w[2] > LOADED_N { centre_of_pressure(w) } else { Vector3::repeat(f64::NAN) };
        push(&mut out, "centre_of_pressure", &plate.name, "m", plate.wrench.iter().map(cop));
    }
    if let Some(forces) = &trial.forces {
        push(&mut out, "centre_of_mass", "whole_body", "m", forces.centre_of_mass_m.iter().copied());
        let n = subject.coordinates.len();
        for (k, c) in subject.coordinates.list.iter().enumerate() {
            let values = forces.generalised.iter().skip(k).step_by(n.max(1)).copied().collect();
            let unit = if c.quantity == Quantity::Angle { "N.m" } else { "N" };
            out.push(scalar("generalised_force", &c.name, unit, values));
        }
        let root = &subject.subject.model.links[0].name;
        push(&mut out, "residual_force", root, "N", forces.residual.iter().map(|w| Vector3::new(w[0], w[1], w[2])));
        push(&mut out, "residual_moment", root, "N.m", forces.residual.iter().map(|w| Vector3::new(w[3], w[4], w[5])));
    }
    if let Some(motion) = &trial.motion {
        let n = motion.marker_labels.len();
        for (k, label) in motion.marker_labels.iter().enumerate() {
            let values = motion.residual_m.iter().skip(k).step_by(n.max(1)).copied().collect();
            out.push(scalar("marker_error", label, "m", values));
        }
    }
    out
}

fn kinematics(subject: &SubjectExport, trial: &TrialExport, out: &mut Vec<Channel>) {
    let list = &subject.coordinates.list;
    let n = list.len();
    let column = |values: &[f64], k: usize, scale: f64| -> Vec<f64> {
        values.iter().skip(k).step_by(n.max(1)).map(|v| v * scale).collect()
    };
    let degrees = |q: Quantity| if q == Quantity::Angle { 1.0_f64.to_degrees() } else { 1.0 };
    if let Some(solved) = &trial.solved {
        for (k, c) in list.iter().enumerate() {
            let unit = if c.quantity == Quantity::Angle { "deg" } else { "m" };
            out.push(scalar("coordinate", &c.name, unit, column(&solved.values, k, degrees(c.quantity))));
        }
    }
    if let Some(smooth) = &trial.smooth {
        for (quantity, values, units) in [
            ("coordinate_filtered", &smooth.values, ["deg", "m"]),
            ("coordinate_rate", &smooth.rates, ["deg/s", "m/s"]),
            ("coordinate_acceleration", &smooth.accelerations, ["deg/s^2", "m/s^2"]),
        ] {
            if values.is_empty() {
                continue;
            }
            for (k, c) in list.iter().enumerate() {
                let unit = units[usize::from(c.quantity == Quantity::Length)];
                out.push(scalar(quantity, &c.name, unit, column(values, k, degrees(c.quantity))));
            }
        }
    }
    if let Some(motion) = &trial.motion {
        for (link, joint) in subject.subject.model.links.iter().map(|l| (&l.name, &l.joint)) {
            let Some(at) = joint.quaternion_offset() else { continue };
            for (k, axis) in ["x", "y", "z", "w"].into_iter().enumerate() {
                let values = motion.q.iter().skip(at + k).step_by(motion.nq).copied().collect();
                out.push(Channel { quantity: "orientation", name: link.clone(), axis, unit: "1", values });
            }
        }
    }
}
