//! OpenSim models (version 4): bodies with their inertias, joints with coupled coordinates,
//! markers.
//!
//! Every joint is a rotation and a translation that are functions of coordinates. Two trees are
//! made from that. The exact one ([`OsimModel::model`]) gives each joint that translates three
//! sliders and a ball, others a ball: it takes the file's own motion as it is, for `audit`. The
//! rigid one ([`RigidTree`]) has hinges and balls with fixed centres and no body without mass: it
//! is what the stages of a pipeline use. Inverse kinematics ([`OsimIk`]) is solved in the file's
//! coordinates, so that its angles are those of OpenSim.

mod chain;
mod exact;
mod function;
mod joint;
mod model;
pub mod patch;
mod read;
mod rigid;
mod solid;
mod track;

pub use model::{OsimCoordinate, OsimMarker, OsimModel};
pub use rigid::{MergedBody, RigidTree};
pub use track::{OsimIk, OsimMotion};
