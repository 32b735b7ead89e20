//! ROS messages in an MCAP file to the columns of a robot's log and of its base.
//!
//! Read are `sensor_msgs/JointState`, `sensor_msgs/Imu`, and for the base
//! `geometry_msgs/PoseStamped`, `geometry_msgs/PoseWithCovarianceStamped` or `nav_msgs/Odometry`,
//! in the encoding of ROS 2 (CDR) or of ROS 1; and for contact of the links that the description
//! names `std_msgs/Bool`, `geometry_msgs/WrenchStamped` or `gazebo_msgs/ContactsState`. Times are
//! those in the messages' headers, not those of logging (`Bool` has no header). The log's rows are
//! the joint states; the inertial unit is interpolated to them, contact is the last that was said.

use crate::mcap::{Channel, channels};
use crate::{Columns, RobotError};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Topics to read, where a file has several of one type.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Topics {
    /// Joint states.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joints: Option<String>,
    /// Inertial unit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub imu: Option<String>,
    /// Pose of the base.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base: Option<String>,
    /// Contact of a link, by the link's name in the model.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub contact: BTreeMap<String, String>,
}

const JOINTS: [&str; 1] = ["sensor_msgs/JointState"];
const IMU: [&str; 1] = ["sensor_msgs/Imu"];
const BASE: [&str; 3] = ["geometry_msgs/PoseStamped", "geometry_msgs/PoseWithCovarianceStamped", "nav_msgs/Odometry"];
const CONTACT: [&str; 3] = ["std_msgs/Bool", "geometry_msgs/WrenchStamped", "gazebo_msgs/ContactsState"];
/// Samples of the inertial unit further apart than this many usual intervals are a gap.
const GAP: f64 = 2.5;

/// Reads a robot's log and, where the file has poses, its base.
///
/// # Errors
/// [`RobotError::Table`] for a damaged container; [`RobotError::Log`] for a topic that is missing
/// or not unique, an encoding that is not read, and a message that is shorter than its type.
pub fn read(file: &str, bytes: &[u8], topics: &Topics) -> Result<(Columns, Option<Columns>), RobotError> {
    let found = channels(file, bytes)?;
    let Some(joints) = pick(file, &found, &JOINTS, topics.joints.as_deref(), "joints")? else {
        return Err(RobotError::log(
            file,
            format!("no topic of type {}; found {}", JOINTS[0], listed(&found.iter().collect::<Vec<_>>())),
            "record the topic of the joint states, usually /joint_states",
        ));
    };
    let imu = pick(file, &found, &IMU, topics.imu.as_deref(), "imu")?;
    let base = pick(file, &found, &BASE, topics.base.as_deref(), "base")?;
    let joints = joint_states(file, joints)?;
    // times from the first whole second of the log: a double holds them to a fraction of a
    // nanosecond
    let start = joints.keys().next().map_or(0, |t| t - t % 1_000_000_000);
    let seconds = |t: &i64| (t - start) as f64 * 1e-9;
    let times: Vec<f64> = joints.keys().map(seconds).collect();
    let mut names: Vec<&String> = joints.values().flat_map(|row| row.keys()).collect();
    names.sort();
    names.dedup();
    let mut table = vec![("time_s".to_owned(), times.clone())];
    for name in names {
        table.push((name.clone(), joints.values().map(|row| row.get(name).copied().unwrap_or(f64::NAN)).collect()));
    }
    if let Some(channel) = imu {
        let samples = vectors::<6>(file, channel, imu_sample)?;
        let at: Vec<f64> = samples.keys().map(seconds).collect();
        let values: Vec<[f64; 6]> = samples.into_values().collect();
        let part = ["angular_velocity.x", "angular_velocity.y", "angular_velocity.z"];
        let rest = ["linear_acceleration.x", "linear_acceleration.y", "linear_acceleration.z"];
        for (k, name) in part.iter().chain(&rest).enumerate() {
            let column: Vec<f64> = values.iter().map(|v| v[k]).collect();
            table.push(((*name).to_owned(), interpolated(&at, &column, &times)));
        }
    }
    for (link, topic) in &topics.contact {
        if let Some(channel) = pick(file, &found, &CONTACT, Some(topic), "contact")? {
            let (column, samples) = contact_of(file, channel, link)?;
            let at: Vec<f64> = samples.keys().map(seconds).collect();
            let values: Vec<f64> = samples.into_values().map(|[x]| x).collect();
            // flags are often sent only where they change
            let hold = if column.starts_with("force") { GAP * usual_step(&at) } else { f64::INFINITY };
            table.push((column, last_said(&at, &values, &times, hold)));
        }
    }
    let base = base.map(|channel| {
        let odometry = kind(&channel.schema) == "nav_msgs/Odometry";
        let poses = vectors::<7>(file, channel, |m| pose(m, odometry))?;
        let mut table = vec![("time_s".to_owned(), poses.keys().map(seconds).collect())];
        let names = [
            "position.x",
            "position.y",
            "position.z",
            "orientation.x",
            "orientation.y",
            "orientation.z",
            "orientation.w",
        ];
        for (k, name) in names.iter().enumerate() {
            table.push(((*name).to_owned(), poses.values().map(|p| p[k]).collect()));
        }
        Columns::of(file, table)
    });
    Ok((Columns::of(file, table)?, base.transpose()?))
}

/// A type without the part that ROS 2 adds: `sensor_msgs/msg/Imu` is `sensor_msgs/Imu`.
fn kind(schema: &str) -> String {
    schema.replacen("/msg/", "/", 1)
}

fn listed(channels: &[&Channel]) -> String {
    if channels.is_empty() {
        return "no topics at all".to_owned();
    }
    channels.iter().map(|c| format!("`{}` ({})", c.topic, kind(&c.schema))).collect::<Vec<_>>().join(", ")
}

/// The channel of one of several types that has messages: the one that is asked for, or the only
/// one.
fn pick<'c>(
    file: &str,
    all: &'c [Channel],
    types: &[&str],
    topic: Option<&str>,
    key: &str,
) -> Result<Option<&'c Channel>, RobotError> {
    let of_type: Vec<&Channel> =
        all.iter().filter(|c| types.contains(&kind(&c.schema).as_str()) && !c.messages.is_empty()).collect();
    let chosen = match (topic, of_type.as_slice()) {
        (Some(topic), _) => Some(of_type.iter().copied().find(|c| c.topic == topic).ok_or_else(|| {
            RobotError::log(
                file,
                format!("no messages of type {} on `{topic}`; found {}", types.join(", "), listed(&of_type)),
                format!("see `topics: {{{key}: …}}` in the description of the robot"),
            )
        })?),
        (None, []) => None,
        (None, [only]) => Some(*only),
        (None, several) => {
            return Err(RobotError::log(
                file,
                format!("{} topics could be the {key}: {}", several.len(), listed(several)),
                format!("name one as `topics: {{{key}: {}}}` in the description of the robot", several[0].topic),
            ));
        }
    };
    if let Some(channel) = chosen.filter(|c| !["cdr", "ros1"].contains(&c.encoding.as_str())) {
        return Err(RobotError::log(
            file,
            format!("`{}` is encoded as `{}`, expected cdr or ros1", channel.topic, channel.encoding),
            "record with ROS 2 or ROS 1",
        ));
    }
    Ok(chosen)
}

/// The type of messages that have no header.
const NO_HEADER: &str = "std_msgs/Bool";

/// Fields of a message in order.
struct Message<'a> {
    bytes: &'a [u8],
    at: usize,
    ros1: bool,
    big: bool,
}

impl<'a> Message<'a> {
    fn new(bytes: &'a [u8], ros1: bool) -> Option<Self> {
        if ros1 {
            return Some(Self { bytes, at: 0, ros1, big: false });
        }
        // four bytes state the order of bytes; alignment counts from behind them
        let (head, bytes) = bytes.split_at_checked(4)?;
        match head[..2] {
            [0, order @ (0 | 1)] => Some(Self { bytes, at: 0, ros1, big: order == 0 }),
            _ => None,
        }
    }
    fn raw<const N: usize>(&mut self) -> Option<[u8; N]> {
        if !self.ros1 {
            self.at = self.at.next_multiple_of(N);
        }
        // none: a message that is too short, which the caller names
        let mut out: [u8; N] = self.bytes.get(self.at..self.at.checked_add(N)?)?.try_into().ok()?;
        self.at += N;
        if self.big {
            out.reverse();
        }
        Some(out)
    }
    fn integer(&mut self) -> Option<u32> {
        self.raw().map(u32::from_le_bytes)
    }
    fn float(&mut self) -> Option<f64> {
        self.raw().map(f64::from_le_bytes)
    }
    fn text(&mut self) -> Option<String> {
        let n = self.integer()? as usize;
        let bytes = self.bytes.get(self.at..self.at.checked_add(n)?)?;
        self.at += n;
        // ROS 2 counts the zero at the end
        let bytes = if self.ros1 { bytes } else { bytes.strip_suffix(b"\0").unwrap_or(bytes) };
        Some(String::from_utf8_lossy(bytes).into_owned())
    }
    /// Time of the header, ns; zero where nobody set it.
    fn header(&mut self) -> Option<i64> {
        if self.ros1 {
            self.integer()?;
        }
        let (seconds, nanoseconds) = (self.integer()?, self.integer()?);
        self.text()?;
        Some(i64::from(seconds) * 1_000_000_000 + i64::from(nanoseconds))
    }
    fn floats<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut out = [0.0; N];
        for x in &mut out {
            *x = self.float()?;
        }
        Some(out)
    }
    fn list(&mut self) -> Option<Vec<f64>> {
        let n = self.integer()? as usize;
        (0..n).map(|_| self.float()).collect()
    }
}

/// Messages of a channel by the time of their headers, ns.
fn decoded<T>(
    file: &str,
    channel: &Channel,
    of: impl Fn(&mut Message<'_>) -> Option<T>,
) -> Result<Vec<(i64, T)>, RobotError> {
    let ros1 = channel.encoding == "ros1";
    let read = |(logged, bytes): &(u64, Vec<u8>)| -> Option<(i64, T)> {
        let mut message = Message::new(bytes, ros1)?;
        let stamp = if kind(&channel.schema) == NO_HEADER { 0 } else { message.header()? };
        // none: a time beyond the year 2262, which the caller names
        let time = if stamp == 0 { i64::try_from(*logged).ok()? } else { stamp };
        Some((time, of(&mut message)?))
    };
    let each = channel.messages.iter().enumerate().map(|(i, m)| {
        read(m).ok_or_else(|| {
            RobotError::log(
                file,
                format!(
                    "message {} of {} on `{}` is not a whole {} in {}",
                    i + 1,
                    channel.messages.len(),
                    channel.topic,
                    kind(&channel.schema),
                    channel.encoding
                ),
                "the definition of the message or its encoding differs from the common one",
            )
        })
    });
    each.collect()
}

fn vectors<const N: usize>(
    file: &str,
    channel: &Channel,
    of: impl Fn(&mut Message<'_>) -> Option<[f64; N]>,
) -> Result<BTreeMap<i64, [f64; N]>, RobotError> {
    Ok(decoded(file, channel, of)?.into_iter().collect())
}

/// Rows of the joint states; messages of one time are parts of one row.
fn joint_states(file: &str, channel: &Channel) -> Result<BTreeMap<i64, BTreeMap<String, f64>>, RobotError> {
    let messages = decoded(file, channel, |m| {
        let n = m.integer()? as usize;
        let names: Vec<String> = (0..n).map(|_| m.text()).collect::<Option<_>>()?;
        Some((names, [m.list()?, m.list()?, m.list()?]))
    })?;
    let mut rows: BTreeMap<i64, BTreeMap<String, f64>> = BTreeMap::new();
    for (time, (names, lists)) in messages {
        let row = rows.entry(time).or_default();
        for (what, values) in ["position", "velocity", "effort"].iter().zip(&lists) {
            row.extend(names.iter().zip(values).map(|(name, value)| (format!("{what}.{name}"), *value)));
        }
    }
    Ok(rows)
}

/// Angular velocity and specific force.
fn imu_sample(m: &mut Message<'_>) -> Option<[f64; 6]> {
    let _orientation = m.floats::<13>()?;
    let [x, y, z] = m.floats::<3>()?;
    let _covariance = m.floats::<9>()?;
    let [a, b, c] = m.floats::<3>()?;
    Some([x, y, z, a, b, c])
}

/// Contact of a link: the column of the log that holds it, and its samples. Forces are the size of
/// the sensor's force, N; the others are 1 in contact and 0 without.
fn contact_of(file: &str, channel: &Channel, link: &str) -> Result<(String, BTreeMap<i64, [f64; 1]>), RobotError> {
    let flag = format!("contact_{link}");
    match kind(&channel.schema).as_str() {
        NO_HEADER => Ok((flag, vectors(file, channel, |m| Some([f64::from(u8::from(m.raw::<1>()? != [0]))]))?)),
        "geometry_msgs/WrenchStamped" => {
            let force = |m: &mut Message<'_>| m.floats::<3>().map(|f| [f.iter().map(|x| x * x).sum::<f64>().sqrt()]);
            Ok((format!("force_z_{link}_n"), vectors(file, channel, force)?))
        }
        _ => Ok((flag, vectors(file, channel, |m| Some([f64::from(u8::from(m.integer()? > 0))]))?)),
    }
}

/// Values at other times: the last one before, if it is no older than `hold_s`; else NaN.
fn last_said(at: &[f64], values: &[f64], times: &[f64], hold_s: f64) -> Vec<f64> {
    let one = |t: f64| {
        let before = at.partition_point(|x| *x <= t).checked_sub(1)?;
        (t - at[before] <= hold_s).then(|| values[before])
    };
    times.iter().map(|t| one(*t).unwrap_or(f64::NAN)).collect()
}

/// Median time between samples, s; zero for fewer than two.
fn usual_step(at: &[f64]) -> f64 {
    let mut steps: Vec<f64> = at.windows(2).map(|w| w[1] - w[0]).collect();
    if steps.is_empty() { 0.0 } else { aloft_signal::median(&mut steps) }
}

/// Position and quaternion x, y, z, w.
fn pose(m: &mut Message<'_>, odometry: bool) -> Option<[f64; 7]> {
    if odometry {
        m.text()?;
    }
    m.floats()
}

/// Values at other times, linear between samples; NaN in gaps and outside.
fn interpolated(at: &[f64], values: &[f64], times: &[f64]) -> Vec<f64> {
    let usual = usual_step(at);
    let one = |t: f64| -> Option<f64> {
        let after = at.partition_point(|x| *x < t);
        if at.get(after).is_some_and(|x| *x == t) {
            return Some(values[after]);
        }
        let (before, after) = (after.checked_sub(1)?, (after < at.len()).then_some(after)?);
        let width = at[after] - at[before];
        let share = (t - at[before]) / width;
        (width <= GAP * usual).then(|| values[before] + (values[after] - values[before]) * share)
    };
    times.iter().map(|t| one(*t).unwrap_or(f64::NAN)).collect()
}
