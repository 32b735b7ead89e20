//! What a laboratory writes down about a robot (`robot.yaml` beside the recordings).

use crate::ros::Topics;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The description. Keys that are not listed here only describe (see `aloft_study::keys`).
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RobotDescription {
    /// Link whose pose the base recording holds; the root of the model if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_link: Option<String>,
    /// Joints in the log; those of the model if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joints: Option<Vec<String>>,
    /// Model files, relative to the description.
    #[serde(default)]
    pub model: ModelFiles,
    /// Inertial measurement unit on the base.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub imu: Option<Imu>,
    /// Noise of the sensors, one standard deviation.
    #[serde(default)]
    pub noise: SensorNoise,
    /// Topics of logs in MCAP, where a file has several of one type.
    #[serde(default)]
    pub topics: Topics,
    /// Markers on links.
    #[serde(default)]
    pub markers: BTreeMap<String, MarkerPlace>,
}

/// Model files of a robot. The first that is given is the model; both are patched.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ModelFiles {
    /// URDF.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub urdf: Option<String>,
    /// MJCF (MuJoCo).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mjcf: Option<String>,
}

/// Where the inertial measurement unit is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Imu {
    /// Link that carries it; the base if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub link: Option<String>,
    /// Position in the link frame, m.
    #[serde(default)]
    pub position_m: [f64; 3],
    /// Orientation in the link frame, roll-pitch-yaw as in URDF, rad.
    #[serde(default)]
    pub rpy_rad: [f64; 3],
}

/// One standard deviation of each sensor's sample.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SensorNoise {
    /// Base position, each axis, m.
    pub position_m: f64,
    /// Base orientation, each axis, degrees.
    pub orientation_deg: f64,
    /// Joint rate by the drive, rad/s.
    pub dq_rad_s: f64,
    /// Joint torque, N·m.
    pub torque_nm: f64,
    /// Gyroscope, rad/s.
    pub gyro_rad_s: f64,
    /// Accelerometer, m/s².
    pub acc_m_s2: f64,
}

impl Default for SensorNoise {
    /// Values of usual motion capture and of usual small inertial units, for laboratories that
    /// state none.
    fn default() -> Self {
        Self {
            position_m: 0.0005,
            orientation_deg: 0.1,
            dq_rad_s: 0.02,
            torque_nm: 0.1,
            gyro_rad_s: 0.005,
            acc_m_s2: 0.05,
        }
    }
}

/// A marker on a link.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MarkerPlace {
    /// Link.
    pub link: String,
    /// Position in the link frame, m.
    pub position_m: [f64; 3],
}
