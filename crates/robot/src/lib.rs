//! Robots: their models, logs and sensors, and what was identified back in their files.
//!
//! A robot's motion is not found by inverse kinematics: encoders measure the joints. This crate
//! reads the model ([`RobotModel`], from URDF or MJCF), the log and the recording of the base
//! ([`RobotLog`], [`BaseLog`]), combines them with the inertial unit into the same
//! [`aloft_body::Motion`] that inverse kinematics gives for people ([`fuse`](fn@fuse)), and writes
//! identified inertias back into the model's text ([`patch`](mod@patch)). Where torques are logged,
//! [`torque`] and [`joint_fit`] add the joints' own unknowns: friction, reflected inertia, gains.
//! Everything between, from flights to verdicts, is common to people, objects and robots.

mod check;
mod clock;
mod collision;
mod combine;
pub mod description;
mod error;
mod fuse;
mod impact;
mod inertial;
pub mod joint_evidence;
pub mod joint_fit;
mod log;
pub mod markers;
pub mod mcap;
mod mjcf;
mod model;
pub mod next;
pub mod noise;
mod normal;
pub mod osim;
pub mod patch;
mod possible;
mod resample;
pub mod ros;
mod smoother;
mod subject;
mod table;
pub mod torque;
mod unpack;
mod urdf;
mod xml;

pub use check::check;
pub use clock::{RoughOffset, rough_offset};
pub use collision::{LinkSpheres, Solid};
pub use description::{Imu, MarkerPlace, ModelFiles, RobotDescription, SensorNoise};
pub use error::RobotError;
pub use fuse::{FuseInput, FusionReport, fuse};
pub use log::{BaseLog, RobotLog, unknown_contacts};
pub use model::{Format, Merged, RobotJoint, RobotModel};
pub use subject::{InertiaLimits, PriorSpread, subject};
pub use table::Columns;
