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

use crate::graph::{Need, Stage};
use aloft_study::config::Rows;
use aloft_study::subject_session::{SubjectSession, TrialEntry};

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

/// The stages that make rows.
static ROWS: [&Stage; 2] = [&regressor::STAGE, &acceleration::STAGE];

/// Results from which the weak rows of a trial are made, by stage and trial.
pub fn below_weak_rows<'s>(trial: &'s TrialEntry, session: &'s SubjectSession) -> Vec<Read<'s>> {
    regressor::STAGE.needs.iter().flat_map(|need| need.results(Some(trial), session)).collect()
}

/// Results from which all rows of a trial and its comparison are made, but for those that the
/// model's effects enter: stages that read rows, and what is made from these.
pub fn below_all_rows<'s>(trial: &'s TrialEntry, session: &'s SubjectSession) -> Vec<Read<'s>> {
    let rows = ROWS.iter().flat_map(|s| s.needs).flat_map(|need| need.results(Some(trial), session));
    let compared = compare::STAGE.needs.iter().flat_map(|need| need.results(Some(trial), session));
    let of_this = |t: &Option<&TrialEntry>| t.is_none_or(|t| t.name == trial.name);
    rows.chain(compared.filter(|(stage, t)| of_this(t) && !made_from_rows(stage))).collect()
}

/// A result that a stage reads: its stage and trial, `None` for the whole study.
pub type Read<'s> = (&'static str, Option<&'s TrialEntry>);

/// True for the stages that make rows and for all that read their results.
fn made_from_rows(name: &str) -> bool {
    ROWS.iter().any(|s| s.name == name)
        || STAGES.iter().filter(|s| s.name == name).any(|s| s.needs.iter().filter_map(Need::stage).any(made_from_rows))
}

/// Name of the stage whose results hold factors of a kind of rows.
pub fn stage_of(rows: Rows) -> &'static str {
    match rows {
        Rows::Weak => regressor::STAGE.name,
        Rows::Acceleration => acceleration::STAGE.name,
    }
}
