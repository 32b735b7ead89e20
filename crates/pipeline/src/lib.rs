//! Configuration, stage graph, cache and runner: where functions meet files.
//!
//! A [`study::Study`] is a pipeline file bound to a folder of recordings. [`runner::run`] brings its stages up to date in a
//! [`workspace::Workspace`]; the functions in [`command`] read what lies there.

pub mod artifact;
pub mod catalog;
pub mod command;
pub mod config;
pub mod effects;
pub mod error;
pub mod graph;
pub mod place;
pub mod revision;
pub mod runner;
pub mod stages;
pub mod study;
pub mod table;
pub mod workspace;

/// JSON schema of pipeline files.
pub fn config_schema() -> schemars::Schema {
    schemars::schema_for!(config::PipelineConfig)
}
