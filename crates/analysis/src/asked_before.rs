//! The answer of an earlier `discover` to the same question: shown at once if nothing that it rests
//! on has changed.

use crate::answers::present;
use crate::compare::compare;
use crate::discover::DiscoveryView;
use crate::question::question;
use aloft_discover::DiscoverOptions;
use aloft_study::subject_session::SubjectSession;

/// The stored answer for the present model, if the same question was asked and nothing that it
/// rests on has changed since.
pub fn answered(session: &SubjectSession, options: &DiscoverOptions) -> Option<DiscoveryView> {
    // none: an answer that cannot be read is computed again
    let kept = present(session).ok()??;
    // none: as above
    if kept.question.is_none() || kept.question != question(session, options).ok()? {
        return None;
    }
    // none: computing the answer again names what is damaged
    let errors = compare(session).ok()?.errors;
    Some(DiscoveryView {
        discovery: kept.answer,
        errors,
        errors_after: kept.errors_after,
        not_computed: Vec::new(),
        not_stored: None,
    })
}
