//! Limits of joints: stated in the model file, otherwise what the recordings show.

use crate::RobotModel;
use serde::{Deserialize, Serialize};

/// What the recordings show of one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Smallest and largest coordinate, rad or m.
    pub range: (f64, f64),
    /// Largest rate, rad/s or m/s.
    pub rate: f64,
    /// Largest torque or force, N·m or N; none if torques are not logged.
    pub effort: Option<f64>,
}

/// Limits that a planned flight keeps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointLimits {
    /// Joint.
    pub joint: String,
    /// Smallest coordinate, rad or m.
    pub low: f64,
    /// Largest coordinate, rad or m.
    pub high: f64,
    /// Largest rate, rad/s or m/s.
    pub rate: f64,
    /// Largest torque or force, N·m or N; none if neither model nor recordings give one.
    pub effort: Option<f64>,
}

/// Share of a joint's range that is kept free at both ends.
const RANGE_MARGIN: f64 = 0.05;

impl JointLimits {
    /// Limits of all joints, and in words which of them are not stated.
    ///
    /// Stated limits count with `share` of rate and effort, and with a twentieth of the range left
    /// at both ends. A rate is at most `faster` times the largest in the recordings, whatever is
    /// stated. What is not stated is taken from the recordings: the range and the effort as seen. A
    /// joint that hardly moved there may be as fast as the middle one of its kind.
    pub fn of(robot: &RobotModel, seen: &[Seen], share: f64, faster: f64) -> (Vec<Self>, Vec<String>) {
        let (mut unranged, mut unrated, mut weak, mut unknown) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let usual = |prismatic: bool| {
            let mut rates: Vec<f64> =
                robot.joints.iter().zip(seen).filter(|(j, _)| j.prismatic == prismatic).map(|(_, s)| s.rate).collect();
            aloft_signal::median(&mut rates)
        };
        let (turning, sliding) = (usual(false), usual(true));
        let limits = robot
            .joints
            .iter()
            .zip(seen)
            .map(|(joint, seen)| {
                let (low, high) = match joint.limits {
                    Some((low, high)) => {
                        let margin = RANGE_MARGIN * (high - low);
                        (low + margin, high - margin)
                    }
                    None => {
                        unranged.push(joint.name.as_str());
                        seen.range
                    }
                };
                if joint.rate.is_none() {
                    unrated.push(joint.name.as_str());
                }
                let stated = joint.rate.map_or(f64::INFINITY, |r| share * r);
                let effort = joint.effort.map(|e| share * e).or(seen.effort);
                match (joint.effort, seen.effort) {
                    (None, Some(_)) => weak.push(joint.name.as_str()),
                    (None, None) => unknown.push(joint.name.as_str()),
                    _ => {}
                }
                let seen_rate = faster * seen.rate.max(if joint.prismatic { sliding } else { turning });
                Self { joint: joint.name.clone(), low, high, rate: stated.min(seen_rate), effort }
            })
            .collect();
        let mut words = Vec::new();
        let mut say = |joints: &[&str], what: &str| {
            if let Some(first) = joints.first() {
                let named = if joints.len() == robot.joints.len() {
                    "all joints".to_owned()
                } else if joints.len() == 1 {
                    format!("`{first}`")
                } else {
                    format!("`{first}` and {} more joints", joints.len() - 1)
                };
                words.push(format!("{named}: {what}"));
            }
        };
        say(&unranged, "no range is stated; the coordinates of the recordings are the range");
        say(&unrated, &format!("no largest rate is stated; {faster} times the fastest of the recordings is the limit"));
        say(&weak, "no largest torque is stated; the largest of the recordings is the limit");
        say(&unknown, "no torque is stated or logged: torques are not checked");
        (limits, words)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_that_are_not_stated_come_from_the_recordings_and_are_named() {
        let text = include_str!("../../tests/robot.urdf");
        let mut robot = RobotModel::parse("robot.urdf", text).unwrap();
        let seen = vec![Seen { range: (-0.3, 0.4), rate: 2.0, effort: None }; robot.joints.len()];
        for joint in &mut robot.joints {
            (joint.limits, joint.rate, joint.effort) = (Some((-1.0, 1.0)), Some(30.0), Some(10.0));
        }
        let (limits, words) = JointLimits::of(&robot, &seen, 0.8, 1.5);
        assert!(words.is_empty(), "{words:?}");
        assert_eq!((limits[0].low, limits[0].high, limits[0].rate, limits[0].effort), (-0.9, 0.9, 3.0, Some(8.0)));
        (robot.joints[0].limits, robot.joints[0].rate, robot.joints[0].effort) = (None, None, None);
        let (limits, words) = JointLimits::of(&robot, &seen, 0.8, 1.5);
        assert_eq!((limits[0].low, limits[0].high, limits[0].rate, limits[0].effort), (-0.3, 0.4, 3.0, None));
        assert_eq!(words.len(), 3);
        assert!(words[2].contains("torques are not checked"), "{words:?}");
    }
}
