//! A robot's log and the recording of its base: columns to joints, sensors and poses in SI units.

use crate::{Columns, RobotError, RobotModel};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Angle by which a joint's column is recognised when names follow no listed pattern.
const POSITION: [&str; 8] = ["q_{}_rad", "q_{}_m", "q_{}", "{}_q", "{}.position", "position.{}", "{}_pos", "{}"];
const DEGREES: [&str; 4] = ["q_{}_deg", "{}_deg", "{}.position_deg", "position.{}_deg"];
const RATE: [&str; 8] = ["dq_{}_rad_s", "dq_{}_m_s", "dq_{}", "{}_dq", "{}.velocity", "velocity.{}", "{}_vel", "qd_{}"];
const RATE_DEGREES: [&str; 2] = ["dq_{}_deg_s", "{}.velocity_deg_s"];
const MEASURED: [&str; 7] =
    ["tau_meas_{}_nm", "tau_{}_nm", "tau_meas_{}", "tau_{}", "{}.effort", "effort.{}", "{}_torque"];
const COMMANDED: [&str; 3] = ["tau_cmd_{}_nm", "tau_cmd_{}", "{}.command"];
const TIME: [(&str, f64); 8] = [
    ("time_s", 1.0),
    ("time", 1.0),
    ("t", 1.0),
    ("timestamp", 1.0),
    ("timestamp_s", 1.0),
    ("time_ms", 1e-3),
    ("time_us", 1e-6),
    ("time_ns", 1e-9),
];

/// Joints and sensors of one recording, by the robot's clock. Values of each joint are in the order
/// of [`RobotModel::joints`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RobotLog {
    /// File, for messages.
    pub file: String,
    /// Time of each row, s.
    pub time_s: Vec<f64>,
    /// Coordinates, `[joint][row]`, rad or m.
    pub q: Vec<Vec<f64>>,
    /// Rates by the drives, rad/s or m/s; empty where a joint has none.
    pub dq: Vec<Vec<f64>>,
    /// Measured torques, N·m; empty where a joint has none.
    pub torque: Vec<Vec<f64>>,
    /// Commanded torques, N·m; empty where a joint has none.
    pub command: Vec<Vec<f64>>,
    /// Angular velocity in the sensor's axes, rad/s.
    pub gyro: Option<Vec<Vector3<f64>>>,
    /// Specific force in the sensor's axes, m/s².
    pub acc: Option<Vec<Vector3<f64>>>,
    /// Contact of links: the column's name and, for each row, 1 in contact and 0 without; NaN where
    /// missing.
    pub contact: Vec<(String, Vec<f64>)>,
    /// Pose of the base by the same clock, if the log holds it.
    pub base: Option<BaseLog>,
}

/// Pose of the base link in the world, by its own clock.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BaseLog {
    /// File, for messages.
    pub file: String,
    /// Time of each row, s.
    pub time_s: Vec<f64>,
    /// Origin of the base link, world, m; NaN where missing.
    pub position_m: Vec<Vector3<f64>>,
    /// Rotation from base to world.
    pub rotation: Vec<UnitQuaternion<f64>>,
}

fn named<'c>(columns: &'c Columns, patterns: &[&str], joint: &str) -> Option<&'c [f64]> {
    patterns.iter().find_map(|p| columns.get(&p.replace("{}", joint)))
}

/// Longest usual time between two rows of a log, s.
const LONGEST_STEP_S: f64 = 0.1;

fn time_of(columns: &Columns) -> Result<Vec<f64>, RobotError> {
    let found = TIME.iter().find_map(|(name, unit)| columns.get(name).map(|c| (*name, c, *unit)));
    let Some((name, values, unit)) = found else {
        return Err(RobotError::log(
            &columns.file,
            format!("no column of time; found {}", abridged(&columns.names)),
            "name it time_s (or time_ms, time_us, time_ns)",
        ));
    };
    for (row, pair) in values.windows(2).enumerate() {
        if pair[0].partial_cmp(&pair[1]) != Some(std::cmp::Ordering::Less) {
            if pair[0] == pair[1] {
                return Err(RobotError::log(
                    &columns.file,
                    format!(
                        "{}: `{name}` is {} once more, expected a time that grows",
                        columns.place(row + 1),
                        pair[1]
                    ),
                    "a row that was logged twice, or times with too few digits (single precision): remove the row, or write more digits",
                ));
            }
            let what = if pair[1].is_nan() || pair[0].is_nan() {
                format!("`{name}` is missing")
            } else {
                format!("`{name}` goes from {} to {}, expected a time that grows", pair[0], pair[1])
            };
            return Err(RobotError::log(
                &columns.file,
                format!("{}: {what}", columns.place(row + 1)),
                "a clock that was set during the recording, or two recordings in one file: cut the file there",
            ));
        }
    }
    if values.len() < 10 {
        return Err(RobotError::log(
            &columns.file,
            format!("{} rows, expected 10 at least", values.len()),
            "record longer",
        ));
    }
    let mut steps: Vec<f64> = values.windows(2).map(|w| (w[1] - w[0]) * unit).collect();
    let step_s = aloft_signal::median(&mut steps);
    if step_s > LONGEST_STEP_S {
        return Err(RobotError::log(
            &columns.file,
            format!(
                "`{name}` steps by {} from row to row, expected seconds with ten rows or more in each",
                step_s / unit
            ),
            "name the column by its unit: time_s, time_ms, time_us or time_ns",
        ));
    }
    Ok(values.iter().map(|t| t * unit).collect())
}

fn vectors(columns: &Columns, names: [&str; 3]) -> Option<Vec<Vector3<f64>>> {
    let [x, y, z] = [columns.get(names[0])?, columns.get(names[1])?, columns.get(names[2])?];
    Some((0..columns.height()).map(|i| Vector3::new(x[i], y[i], z[i])).collect())
}

/// Force on a link that counts as contact, as a share of the model's weight.
const CONTACT_SHARE: f64 = 0.02;

/// Columns of contact: `contact_LINK`, 1 in contact, and `force_z_LINK_n`, the load of a foot's
/// sensor. Of a link with both the flag is taken.
fn contacts(columns: &Columns, model: &RobotModel) -> Vec<(String, Vec<f64>)> {
    let limit_n = CONTACT_SHARE * model.mass_kg() * 9.81;
    let as_flag = |c: &[f64], above: f64| -> Vec<f64> {
        c.iter().map(|x| if x.is_finite() { f64::from(u8::from(x.abs() > above)) } else { f64::NAN }).collect()
    };
    let of = |link: &str| {
        let (flag, force) = (format!("contact_{link}"), format!("force_z_{link}_n"));
        match (columns.get(&flag), columns.get(&force)) {
            (Some(c), _) => Some((flag, as_flag(c, 0.5))),
            (None, Some(c)) => Some((force, as_flag(c, limit_n))),
            (None, None) => None,
        }
    };
    model.spec.links.iter().filter_map(|l| of(&l.name)).collect()
}

/// Columns that are named as contact and belong to no link of the model.
pub fn unknown_contacts<'c>(columns: &'c Columns, model: &RobotModel) -> Vec<&'c str> {
    let link = |n: &'c str| n.strip_prefix("contact_").or_else(|| n.strip_prefix("force_z_")?.strip_suffix("_n"));
    let unknown = |n: &&'c String| link(n).is_some_and(|l| !model.spec.links.iter().any(|own| own.name == l));
    columns.names.iter().filter(unknown).map(String::as_str).collect()
}

fn abridged(names: &[String]) -> String {
    let shown: Vec<&str> = names.iter().take(6).map(String::as_str).collect();
    if names.len() > 6 { format!("{} … ({} columns)", shown.join(", "), names.len()) } else { shown.join(", ") }
}

impl RobotLog {
    /// Picks the columns of a model's joints out of a table. Columns whose names end in `_deg` and
    /// `_deg_s` are converted.
    ///
    /// # Errors
    /// [`RobotError::MissingJoint`] for a missing joint (with the names that come near it),
    /// [`RobotError::Log`] for a missing or decreasing time.
    pub fn of(columns: &Columns, model: &RobotModel) -> Result<Self, RobotError> {
        let time_s = time_of(columns)?;
        let mut log = Self { file: columns.file.clone(), time_s, ..Self::default() };
        let degrees = |c: &[f64]| c.iter().map(|x| x.to_radians()).collect::<Vec<f64>>();
        let missing: Vec<&str> = model
            .joints
            .iter()
            .filter(|j| named(columns, &POSITION, &j.name).or_else(|| named(columns, &DEGREES, &j.name)).is_none())
            .map(|j| j.name.as_str())
            .collect();
        if let Some(first) = missing.first() {
            let more =
                if missing.len() > 1 { format!(" (and {} more joints)", missing.len() - 1) } else { String::new() };
            return Err(RobotError::MissingJoint {
                file: columns.file.clone(),
                problem: format!(
                    "no column for the joint `{first}`{more}, expected `q_{first}_rad`; found {}",
                    near(columns, first)
                ),
                hint: format!("name the columns after the joints of {}, or fix the joint in the model", model.file),
            });
        }
        for joint in &model.joints {
            let name = joint.name.as_str();
            log.q.push(match named(columns, &POSITION, name) {
                Some(c) => c.to_vec(),
                None => named(columns, &DEGREES, name).map(degrees).unwrap_or_default(),
            });
            let rate = named(columns, &RATE, name).map(<[f64]>::to_vec);
            log.dq.push(rate.or_else(|| named(columns, &RATE_DEGREES, name).map(degrees)).unwrap_or_default());
            log.torque.push(named(columns, &MEASURED, name).map(<[f64]>::to_vec).unwrap_or_default());
            log.command.push(named(columns, &COMMANDED, name).map(<[f64]>::to_vec).unwrap_or_default());
        }
        log.contact = contacts(columns, model);
        log.gyro = vectors(columns, ["gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s"])
            .or_else(|| vectors(columns, ["gyro_x", "gyro_y", "gyro_z"]))
            .or_else(|| vectors(columns, ["angular_velocity.x", "angular_velocity.y", "angular_velocity.z"]));
        log.acc = vectors(columns, ["acc_x_m_s2", "acc_y_m_s2", "acc_z_m_s2"])
            .or_else(|| vectors(columns, ["acc_x", "acc_y", "acc_z"]))
            .or_else(|| vectors(columns, ["linear_acceleration.x", "linear_acceleration.y", "linear_acceleration.z"]));
        if columns.any(["qw", "orientation.w"]).is_some() && columns.any(["x_m", "position.x"]).is_some() {
            log.base = Some(BaseLog::of(columns)?);
        }
        Ok(log)
    }

    /// Number of frames of the motion made from this log: its rows, and those that it lost.
    ///
    /// # Errors
    /// As [`crate::fuse`].
    pub fn frames(&self) -> Result<(usize, f64), RobotError> {
        let grid = crate::resample::Grid::of(self, 0.0)?;
        Ok((grid.n, 1.0 / grid.dt_s))
    }

    /// Torques at the frames of the motion, `[joint][frame]`: measured ones where every joint has
    /// them, otherwise commanded ones; none if a joint has neither.
    ///
    /// # Errors
    /// As [`crate::fuse`].
    pub fn torques_at_frames(&self) -> Result<Option<Vec<Vec<f64>>>, RobotError> {
        let whole = |t: &Vec<Vec<f64>>| !t.is_empty() && t.iter().all(|c| !c.is_empty());
        let source = match (whole(&self.torque), whole(&self.command)) {
            (true, _) => &self.torque,
            (false, true) => &self.command,
            _ => return Ok(None),
        };
        let as_joints = Self { q: source.clone(), gyro: None, acc: None, ..self.clone() };
        Ok(Some(crate::resample::Grid::of(&as_joints, 0.0)?.q))
    }

    /// Contact at the frames of the motion, as [`RobotLog::contact`].
    ///
    /// # Errors
    /// As [`crate::fuse`].
    pub fn contact_at_frames(&self) -> Result<Vec<(String, Vec<f64>)>, RobotError> {
        if self.contact.is_empty() {
            return Ok(Vec::new());
        }
        let q = self.contact.iter().map(|c| c.1.clone()).collect();
        let as_joints = Self { q, gyro: None, acc: None, ..self.clone() };
        let frames = crate::resample::Grid::of(&as_joints, 0.0)?.q;
        Ok(self.contact.iter().map(|c| c.0.clone()).zip(frames).collect())
    }

    /// Median interval of the rows, s.
    pub fn interval_s(&self) -> f64 {
        interval(&self.time_s)
    }
}

/// Columns whose names come near a joint's: those that contain a part of it.
fn near(columns: &Columns, joint: &str) -> String {
    let parts: Vec<String> = joint.split('_').filter(|p| p.len() > 2).map(str::to_lowercase).collect();
    let score = |n: &String| parts.iter().filter(|p| n.to_lowercase().contains(p.as_str())).count();
    let mut found: Vec<(usize, &String)> = columns.names.iter().map(|n| (score(n), n)).filter(|s| s.0 > 0).collect();
    found.sort_by_key(|s| std::cmp::Reverse(s.0));
    if found.is_empty() {
        return abridged(&columns.names);
    }
    found.iter().take(3).map(|s| format!("`{}`", s.1)).collect::<Vec<_>>().join(", ")
}

pub(crate) fn interval(time_s: &[f64]) -> f64 {
    let mut steps: Vec<f64> = time_s.windows(2).map(|w| w[1] - w[0]).collect();
    aloft_signal::median(&mut steps)
}

impl BaseLog {
    /// Reads poses: `x_m y_m z_m qw qx qy qz`, or the names of a ROS pose.
    ///
    /// # Errors
    /// [`RobotError::Log`] for missing columns, a decreasing time, and quaternions that are not of
    /// unit length.
    pub fn of(columns: &Columns) -> Result<Self, RobotError> {
        let time_s = time_of(columns)?;
        let get = |names: [&str; 3]| -> Result<&[f64], RobotError> {
            columns.any(names).ok_or_else(|| {
                RobotError::log(
                    &columns.file,
                    format!("no column `{}`; found {}", names[0], abridged(&columns.names)),
                    "a base recording has time_s, x_m, y_m, z_m, qw, qx, qy, qz",
                )
            })
        };
        let [x, y, z] =
            [get(["x_m", "x", "position.x"])?, get(["y_m", "y", "position.y"])?, get(["z_m", "z", "position.z"])?];
        let [qw, qx, qy, qz] = [
            get(["qw", "q_w", "orientation.w"])?,
            get(["qx", "q_x", "orientation.x"])?,
            get(["qy", "q_y", "orientation.y"])?,
            get(["qz", "q_z", "orientation.z"])?,
        ];
        let (mut position_m, mut rotation) = (Vec::new(), Vec::new());
        for i in 0..time_s.len() {
            let q = Quaternion::new(qw[i], qx[i], qy[i], qz[i]);
            let mut p = Vector3::new(x[i], y[i], z[i]);
            if !q.norm().is_finite() {
                p = Vector3::repeat(f64::NAN);
                rotation.push(UnitQuaternion::identity());
            } else if (q.norm() - 1.0).abs() > 0.02 {
                return Err(RobotError::log(
                    &columns.file,
                    format!("{}: the quaternion has length {:.3}, expected 1", columns.place(i), q.norm()),
                    "rotations are unit quaternions qw, qx, qy, qz from base to world",
                ));
            } else {
                rotation.push(UnitQuaternion::new_normalize(q));
            }
            position_m.push(p);
        }
        Ok(Self { file: columns.file.clone(), time_s, position_m, rotation })
    }

    /// True if a row holds a pose.
    pub fn is_valid(&self, row: usize) -> bool {
        self.position_m[row].iter().all(|x| x.is_finite())
    }
}
