//! The stage graph, the stages, and the runner that brings their results up to date.
//!
//! [`runner::run_all`] runs the stages of [`stages::STAGES`] for every trial of a study, stores
//! each result in its workspace, and computes only what is missing or stale.

pub mod corrected;
pub mod factors;
pub mod graph;
pub mod joint_torques;
pub mod made;
pub mod manifests;
pub mod merge;
pub mod plate_zeros;
pub mod progress;
pub mod ready_made;
pub mod recording;
pub mod results;
pub mod run_report;
pub mod runner;
pub mod selection;
pub mod stages;
mod task;
pub mod trial_rows;
mod trial_threads;
mod write_queue;
