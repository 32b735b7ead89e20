//! The answer of an earlier `discover` to the same question: shown at once if nothing that it rests
//! on has changed.
//!
//! An answer rests on the results of all stages, on what the pipeline and the files beside it say,
//! on the effects of the model, on the options, and on the program. All of these are in one hash,
//! which is stored with the answer.

use crate::compare::compare;
use crate::discover::{DiscoveryView, Kept, answer_of};
use aloft_discover::{DiscoverOptions, Discovery};
use aloft_pipeline::graph::results_hash;
use aloft_pipeline::stages::STAGES;
use aloft_study::revision::Revisions;
use aloft_study::subject_session::{FileSizes, SubjectSession};
use aloft_workspace::seal;
use aloft_workspace::workspace::Workspace;
use std::fs::File;
use std::sync::OnceLock;

/// Hash of everything that an answer rests on; none if the answer depends on the time that it was
/// given, or if the program cannot be read.
pub(crate) fn question(session: &SubjectSession, options: &DiscoverOptions) -> Option<String> {
    if options.budget_s.is_some() {
        return None;
    }
    let results = STAGES.iter().flat_map(|stage| stage.tasks(session).into_iter().map(|trial| (stage.name, trial)));
    let results = results_hash(&Workspace::open(&session.workspace), results);
    let revisions = Revisions::load(&session.workspace).ok()?;
    // read when first asked for, and no part of the question
    let asked = SubjectSession { sizes: FileSizes::default(), ..session.clone() };
    let mut hasher = blake3::Hasher::new();
    hasher.update(program()?.as_bytes()).update(results.as_bytes());
    hasher.update(format!("{asked:?}\n{revisions:?}\n{options:?}").as_bytes());
    Some(hasher.finalize().to_hex().to_string())
}

/// Hash of the program's file.
fn program() -> Option<blake3::Hash> {
    static PROGRAM: OnceLock<Option<blake3::Hash>> = OnceLock::new();
    let read = || {
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(File::open(std::env::current_exe().ok()?).ok()?).ok()?;
        Some(hasher.finalize())
    };
    *PROGRAM.get_or_init(read)
}

/// The stored answer for the present model, if the same question was asked and nothing that it
/// rests on has changed since.
pub fn answered(session: &SubjectSession, options: &DiscoverOptions) -> Option<DiscoveryView> {
    let revision = Revisions::load(&session.workspace).ok()?.revisions.len().saturating_sub(1);
    let kept: Kept<Discovery> = seal::read_if_there(&answer_of(session, revision)).ok()??;
    if kept.question.is_none() || kept.question != question(session, options) {
        return None;
    }
    let errors = compare(session).ok()?.errors;
    Some(DiscoveryView { discovery: kept.answer, errors, errors_after: kept.errors_after })
}
