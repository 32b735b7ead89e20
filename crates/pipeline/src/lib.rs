//! Configuration, stage graph, cache and runner: where functions meet files.
//!
//! A [`studies::StudySet`] is a pipeline file bound to a folder of recordings; each subject and session in it is a [`study::Study`].
//! [`runner::run_all`] brings their stages up to date, each in a [`workspace::Workspace`] of its own; the functions in [`command`]
//! read what lies there.

pub mod artifact;
pub mod catalog;
pub mod command;
pub mod config;
pub mod disk;
pub mod effects;
pub mod error;
pub mod facts;
pub mod graph;
pub mod inherit;
mod lanes;
pub mod made;
pub mod merge;
pub mod place;
pub mod progress;
pub mod qc;
pub mod quote;
pub mod ranges;
pub mod revision;
pub mod runner;
pub mod seal;
pub mod session;
pub mod sharing;
pub mod stages;
pub mod studies;
pub mod study;
pub mod table;
pub mod workspace;

/// JSON schema of pipeline files.
pub fn config_schema() -> schemars::Schema {
    schemars::schema_for!(config::PipelineConfig)
}
