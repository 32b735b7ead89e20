//! Discovery rounds: rank the effects, judge the ranking, add the best, and repeat.

use crate::DiscoverError;
use crate::beside::{Several, judge_each_beside_the_others};
use crate::conclude::{RoundResults, conclude, widen_found, widen_named};
use crate::evidence::by_evidence;
use crate::judge::AtFloor;
use crate::ladder::{extra_columns, prune, refit_found};
use crate::on_which_link::name_other_links;
use crate::one_is_enough::one_is_enough;
use crate::options::{DiscoverOptions, Method};
use crate::problem::{Domain, Problem};
use crate::progress::Until;
use crate::rank::judged_in;
use crate::refused::{Refused, Unnamed};
use crate::result::Discovery;
use crate::round::wanted;
use crate::rounds::Rounds;
use crate::session::Session;
use aloft_effects::{Effect, EffectInstance};
use aloft_regressor::StretchKind;

/// All effects of the catalogue.
pub fn catalogue() -> Vec<&'static dyn Effect> {
    aloft_effects::EFFECTS.to_vec()
}

/// Searches for missing effects: ranks `effects` against the model that already holds `accepted`,
/// adds the best effect that passes, and repeats until none does.
///
/// # Errors
/// [`DiscoverError::TooFew`] with fewer than two flights, [`DiscoverError::Numeric`] when the rows
/// do not determine the parameters.
pub fn discover(
    session: &Session<'_>,
    effects: &[&dyn Effect],
    accepted: &[EffectInstance<'_>],
    options: &DiscoverOptions,
) -> Result<Discovery, DiscoverError> {
    if options.method == Method::Evidence {
        return by_evidence(session, effects, accepted, options);
    }
    let until = Until::of(options.budget_s);
    let mut options = options.clone();
    let mut refused = Vec::new();
    loop {
        match without_refused(session, effects, accepted, &until, &options)? {
            Ok(mut answer) => {
                answer.warnings.extend(refused);
                answer.failed = session.failed().into_iter().collect();
                return Ok(answer);
            }
            Err(no) => {
                options.without.push(no.id);
                refused.push(no.words);
            }
        }
    }
}

/// The answer with the effects that `options` allow, or the one of them that contact refuses.
fn without_refused(
    session: &Session<'_>,
    effects: &[&dyn Effect],
    accepted: &[EffectInstance<'_>],
    until: &Until,
    options: &DiscoverOptions,
) -> Result<Result<Discovery, Refused>, DiscoverError> {
    let has = |contact: bool| session.blocks.iter().any(|b| (b.kind == StretchKind::Contact) == contact);
    let (has_flights, has_contact) = (has(false), has(true));
    let mut domains = Vec::new();
    if has_flights {
        domains.push(Domain::Flight);
    }
    if has_contact && (!has_flights || effects.iter().any(|e| wanted(*e, options) && judged_in(*e, Domain::Contact))) {
        domains.push(Domain::Contact);
    }
    // usually one round names an effect, and a second one finds nothing more
    let usual = 2 * effects.iter().filter(|e| wanted(**e, options)).count();
    let mut search = Rounds { session, effects, accepted, options, made: RoundResults::none(has_flights) };
    let mut floors: Vec<(Domain, Option<AtFloor>)> = Vec::new();
    for (i, domain) in domains.iter().enumerate() {
        session.counter.expect(usual * (domains.len() - i));
        floors.push((*domain, search.in_domain(*domain)?));
    }
    let mut made = search.made;
    prune(session, accepted, &mut made.kept, &mut made.found, options);
    refit_found(session, accepted, &mut made.kept, &mut made.found, options);
    let mut replaced = false;
    for (domain, at_floor) in &floors {
        let several = Several { kept: &mut made.kept, found: &mut made.found, rounds: &mut made.rounds };
        let floor = at_floor.as_ref();
        replaced |=
            judge_each_beside_the_others(session, *domain, effects, accepted, several, has_flights, floor, options);
    }
    if replaced {
        prune(session, accepted, &mut made.kept, &mut made.found, options);
        let domain = if has_flights { Domain::Flight } else { Domain::Contact };
        let extra = extra_columns(session, domain, accepted, &made.kept, &[]);
        let joint = Problem::if_possible(session, domain, &extra, options);
        made.errors[1] = joint.map_or(made.errors[1], |p| p.plain());
    }
    widen_found(session, accepted, &made.kept, &mut made.found, options);
    widen_named(session, accepted, effects, &made.kept, &mut made.rounds, options);
    let mut made = one_is_enough(session, effects, accepted, &made, options).unwrap_or(made);
    name_other_links(session, accepted, &made.kept, &mut made.found, options);
    let answer = match conclude(session, effects, accepted, made.clone(), until, options) {
        Err(Unnamed::All(why)) => {
            let nothing = made.naming_nothing(&why);
            conclude(session, effects, accepted, nothing, until, options).map(|mut answer| {
                answer.warnings.push(why.words);
                answer
            })
        }
        answer => answer,
    };
    match answer {
        Ok(answer) => Ok(Ok(answer)),
        Err(Unnamed::One(refused)) => Ok(Err(refused)),
        // with nothing named there is nothing to refuse
        Err(Unnamed::All(why)) => Err(DiscoverError::Numeric(why.words)),
    }
}
