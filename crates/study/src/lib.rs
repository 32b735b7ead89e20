//! A pipeline file bound to recordings.
//!
//! A [`data_set::DataSet`] is a pipeline file with a folder of recordings. Each subject and session
//! in it is a [`subject_session::SubjectSession`]: its configuration after inheritance, its trials
//! and their roles, the facts about the subject, and the effects of the model's present revision.

pub mod calendar;
pub mod catalog;
pub mod commands;
pub mod config;
pub mod data_set;
pub mod effects;
pub mod facts;
pub mod inherit;
mod keys;
pub mod old_names;
pub mod opencap;
pub mod osim;
pub mod place;
pub mod possible;
pub mod quote;
pub mod ranges;
pub mod recordings;
pub mod revision;
pub mod robot;
pub mod settings;
pub mod subject_session;

pub use aloft_workspace::nearest;

/// JSON schema of pipeline files.
pub fn config_schema() -> schemars::Schema {
    schemars::schema_for!(config::PipelineConfig)
}
