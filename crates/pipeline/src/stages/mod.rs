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
pub mod shared;

use crate::graph::Stage;
use aloft_study::config::Rows;

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

/// Name of the stage whose results hold factors of a kind of rows.
pub fn stage_of(rows: Rows) -> &'static str {
    match rows {
        Rows::Weak => regressor::STAGE.name,
        Rows::Acceleration => acceleration::STAGE.name,
    }
}
