//! Effects that flights ask for and contact contradicts.
//!
//! Errors that repeat from flight to flight (soft tissue, wrong tables) can be imitated by a force,
//! and the parameters then absorb the opposite of it. Contact takes no part in the ranking of
//! flights, so that it is an independent test of what was found there: with the right effect the
//! parameters become better, and the error in contact falls or stays.

use crate::held_out::HeldOutError;
use aloft_discover::Discovery;

/// Error in contact with the effect over that without it, above which contact contradicts it. On
/// the sets for development the right effects leave less than the error before.
const CONTRADICTED: f64 = 1.15;

/// What is refused, and why.
pub(crate) struct Refused {
    /// Identifier of the effect; none for a law beyond the catalogue.
    pub effect: Option<String>,
    /// Reason, in words.
    pub words: String,
}

/// The first effect found in flight, if the error in contact rises with what was found.
pub(crate) fn contradicted(found: &Discovery, before: &[HeldOutError], after: &[HeldOutError]) -> Option<Refused> {
    let of = |errors: &[HeldOutError], place: &str| errors.iter().find(|e| e.judged_on == place).cloned();
    let [contact, with] = [before, after].map(|errors| of(errors, "contact"));
    let (contact, with) = (contact?, with?);
    let rises = with.held_out_error > CONTRADICTED * contact.held_out_error;
    if !rises || with.at_floor != Some(false) || of(before, "flight").is_none() {
        return None;
    }
    let in_flight = |id: &str| found.candidates.iter().any(|c| c.effect == id && c.judged_on == "flight");
    let first = found.found.iter().find(|f| in_flight(&f.effect));
    let law = || found.open.as_ref().filter(|o| found.found.is_empty() && o.complete)?.laws.first();
    let (effect, key) = match first {
        Some(f) => (Some(f.effect.clone()), f.key.clone()),
        None => (None, law()?.id.clone()),
    };
    let newtons = |e: &HeldOutError| aloft_compare::significant(e.held_out_error, 3);
    let words = format!(
        "`{key}` is not named: it lowers the error in flight, and the error in contact rises from {} to {} N with it",
        newtons(&contact),
        newtons(&with)
    );
    Some(Refused { effect, words })
}
