//! The answer of an earlier `discover` to the same question: shown at once if nothing that it rests
//! on has changed.

use crate::compare::compare;
use crate::discover::{DiscoveryView, Kept, answer_of};
use crate::question::question;
use aloft_discover::{DiscoverOptions, Discovery};
use aloft_study::revision::Revisions;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::seal;

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
