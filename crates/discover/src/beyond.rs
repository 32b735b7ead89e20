//! The search beyond the catalogue as part of a discovery: when it is made, and when its laws
//! replace what the catalogue names.

use crate::candidate::Variant;
use crate::held_out::HeldOutResult;
use crate::ladder::extra_columns;
use crate::laws::Direction;
use crate::options::DiscoverOptions;
use crate::problem::{Domain, Problem};
use crate::progress::Until;
use crate::result::{Discovery, Verdict};
use crate::session::Session;
use aloft_effects::{Effect, EffectInstance};

/// Searches for laws beyond the catalogue where flights leave an error above the interval of its
/// floor, where the catalogue needs effects of several kinds, or where the strength of a named
/// effect does not follow its law, and lets laws that convince replace what the catalogue names.
pub(crate) fn look_beyond(
    session: &Session<'_>,
    accepted: &[EffectInstance<'_>],
    effects: &[&dyn Effect],
    kept: &[Variant<'_>],
    left: &[Option<HeldOutResult>; 2],
    out: &mut Discovery,
    until: &Until,
    options: &DiscoverOptions,
) {
    let several = kept.iter().any(|v| v.effect.id() != kept[0].effect.id());
    let named = matches!(out.verdict, Verdict::Supported | Verdict::OneOf);
    let with_effects = (named && !kept.is_empty() && !until.is_over())
        .then(|| {
            let extra = extra_columns(session, Domain::Flight, accepted, kept, &out.found);
            Problem::new(session, Domain::Flight, &extra, options.fewest_trials, options.prior_weight).ok()
        })
        .flatten();
    out.misfit = with_effects.as_ref().and_then(|problem| {
        crate::laws::misfit(session, problem, kept, &out.found, options.belief_kinematics, options.seed)
    });
    let remains = left[0].as_ref().is_some_and(HeldOutResult::may_hold_more);
    let several_above = several && session.model_error[0].as_ref().is_some_and(HeldOutResult::may_hold_more);
    if !(remains || several_above || out.misfit.is_some()) {
        return;
    }
    if until.is_over() {
        let budget = options.budget_s.unwrap_or_default();
        out.warnings
            .push(format!("the search beyond the catalogue was not begun: the budget of {budget} s was used up"));
        return;
    }
    let first = out.rounds.first().map_or(&out.candidates, |r| &r.candidates);
    let single = first.iter().filter(|c| !c.placebo).map(|c| c.held_out_ratio).fold(1.0, f64::min);
    let ratio = (out.held_out_error_after / out.held_out_error).min(single);
    let taken: Vec<&str> = effects.iter().map(|e| e.id()).collect();
    let unknowns: usize = kept.iter().map(Variant::unknowns).sum();
    let errors = |p: Problem| p.folds.iter().map(|f| f.error).collect();
    let doubted = with_effects.filter(|_| out.misfit.is_some()).map(errors);
    let rival = crate::laws::Rivals { ratio, single, several: several.then_some(unknowns), doubted };
    out.open = crate::laws::search(session, accepted, rival, &taken, until, options);
    let Some(open) = &out.open else { return };
    // a force of constant size is what the catalogue's own forces, gravity and frame rate look like
    let constant = open.laws.iter().all(|l| l.variables.is_empty() && l.direction != Direction::Towards);
    if named && (!open.complete || constant) {
        // what the catalogue names stands, unless a law brings the error to the floor
        out.open = None;
        return;
    }
    let limit = if session.prior.is_some() { options.belief_kinematics } else { options.belief };
    let acts =
        open.diagnosis.as_ref().is_some_and(|d| d.held_out_ratio < limit && d.family_wise_p < options.significance);
    if !open.laws.is_empty() || acts {
        out.verdict = Verdict::Unexplained;
        out.effects.clear();
    }
    if open.complete {
        // effects that removed a part of the error stood in for the law
        out.misfit = None;
        out.found.clear();
        out.ladder.clear();
        out.held_out_error_after = open.held_out_error_after;
    }
}
