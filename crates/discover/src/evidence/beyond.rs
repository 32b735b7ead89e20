//! Where the catalogue leaves an error, the search for a law beyond it.

use super::search::Search;
use super::sizes::predicts_as_well;
use crate::by_stages::Staged;
use crate::candidate::Variant;
use crate::ladder::extra_columns;
use crate::laws::{FoundLaw, Line, OpenWorld, Rivals};
use crate::options::DiscoverOptions;
use crate::problem::{Domain, Problem};
use crate::progress::Until;
use crate::result::Discovery;
use crate::session::Session;
use crate::wording;
use aloft_effects::{Effect, EffectInstance};

/// Largest share of the error in contact that a law of both may leave.
const IN_CONTACT: f64 = 0.9;

/// Share of what the catalogue leaves that laws may leave, unless the form of its effects is
/// refuted.
const BETTER: f64 = 0.85;

/// Searches for laws in what the present model leaves in flight, and lets those that leave less
/// than the effects found stand in their place.
pub(super) fn look(
    session: &Session<'_>,
    effects: &[&dyn Effect],
    accepted: &[EffectInstance<'_>],
    made: &Search<'_>,
    options: &DiscoverOptions,
    out: &mut Discovery,
) {
    let until = Until::of(options.budget_s);
    session.counter.so_far(&wording::so_far(session.model_error[0]));
    let taken: Vec<&str> = effects.iter().map(|e| e.id()).collect();
    let variants: Vec<_> = made.kept.iter().map(|k| k.variant.clone()).collect();
    let with = |kept: &[Variant<'_>]| {
        let extra = extra_columns(session, Domain::Flight, accepted, kept, &[]);
        Problem::if_possible(session, Domain::Flight, &extra, options).map(|p| p.plain())
    };
    // laws are judged on the same rows
    let left = with(&variants).zip(with(&[])).map_or(1.0, |(with, without)| (with / without).sqrt());
    let rivals = Rivals {
        most: left * if made.misfit.is_some() { 1.0 } else { BETTER },
        lines: made.kept.iter().filter_map(|k| Line::of(session.scene, &k.variant)).collect(),
    };
    let Some(mut open) = crate::laws::search(session, accepted, &rivals, &taken, &until, options) else { return };
    if let Some(staged) = where_they_act(session, &mut open) {
        open.times_floor_in_contact = staged.errors[1].map(|e| e.times_floor()).filter(|t| t.is_finite());
        if let Some(flights) = &staged.errors[0] {
            open.judged_by_stages(flights);
        }
    }
    if !open.laws.is_empty() {
        // effects that removed a part of the error stood in for the law
        out.found.clear();
        out.held_out_error_after = open.held_out_error_after;
    }
    out.words = wording::with_open(out, &open);
    out.open = Some(open);
}

/// Errors with the laws of a search in the model, by the stages. Laws are fitted to flights; if
/// they also lower the error in contact, of which the search has no row, they become laws of both,
/// with sizes from both where these predict as well.
fn where_they_act(session: &Session<'_>, open: &mut OpenWorld) -> Option<Staged> {
    let in_flight = session.by_stages.with_laws(&open.laws)?;
    let everywhere: Vec<FoundLaw> = open.laws.iter().map(FoundLaw::acting_everywhere).collect();
    let sized: Vec<FoundLaw> =
        everywhere.iter().map(|law| FoundLaw { sized_with_contact: true, ..law.clone() }).collect();
    let Some(contact) = in_flight.errors[1] else { return Some(in_flight) };
    let limit = IN_CONTACT * contact.held_out_error.min(session.model_error[1].map_or(0.0, |e| e.held_out_error));
    let Some(from_flights) = session.by_stages.with_laws(&everywhere) else { return Some(in_flight) };
    let from_both = session.by_stages.with_laws(&sized).filter(|s| predicts_as_well(from_flights.errors, s.errors));
    let (laws, both) = from_both.map_or((everywhere, from_flights), |both| (sized, both));
    if both.errors[1].is_none_or(|e| e.held_out_error >= limit) {
        return Some(in_flight);
    }
    open.laws = laws;
    Some(both)
}
