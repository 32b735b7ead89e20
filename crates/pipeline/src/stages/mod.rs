//! The stages, one file each. To add one: write a file with a `STAGE` and name it in [`STAGES`].

pub mod acceleration;
pub mod calibrate;
pub mod compare;

pub mod filter;
pub mod flight;

pub mod identify;
pub mod ik;
pub mod import;
pub mod object;
pub mod osim;
pub mod regressor;
pub mod robot;
pub mod robot_torques;
pub mod scale;

use crate::graph::Stage;

/// All stages in the order in which they run. Help, status, README table and conformance tests are
/// generated from this slice.
pub static STAGES: &[&Stage] = &[
    &import::STAGE,
    &scale::STAGE,
    &calibrate::STAGE,
    &ik::STAGE,
    &filter::STAGE,
    &flight::STAGE,
    &regressor::STAGE,
    &acceleration::STAGE,
    &identify::STAGE,
    &compare::STAGE,
];
