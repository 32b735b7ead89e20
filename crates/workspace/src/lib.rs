//! Results on disk: their location, what they were made from, who may write them, and whether their
//! files are unchanged.
//!
//! A [`workspace::Workspace`] holds one folder for each stage and trial, with tables and a
//! [`manifest::Manifest`]. This crate knows no stage by its name and reads no configuration.

pub mod artifact;
pub mod disk;
pub mod error;
mod fault;
mod fingerprint;
pub mod format;
pub mod input;
pub mod json;
pub mod key;
pub mod limits;
pub mod lock;
pub mod manifest;
pub mod nearest;
pub mod qc;
pub mod seal;
pub mod sharing;
pub mod table;
pub mod theirs;
mod undefined;
pub mod unfinished;
pub mod warning;
pub mod workspace;
