//! The answer of a discovery from its rounds: verdict, errors in newtons, what remains, and words.

use crate::addition::addition;
use crate::beyond::Beyond;
use crate::candidate::Variant;
use crate::held_out::{HeldOutResult, LACK_OF_FIT};
use crate::judge::may_be_zero;
use crate::ladder::extra_columns;
use crate::only_as_limit::delay_or_wind;
use crate::options::DiscoverOptions;
use crate::problem::{Domain, Problem};
use crate::progress::Until;
use crate::rank::judged_in;
use crate::refused::{Refused, Unnamed};
use crate::repeating::widen;
use crate::result::{Addition, Candidate, Discovery, Found, Group, NotTried, Round, Verdict};
use crate::round::wanted;
use crate::session::Session;
use crate::sizes::by_both;
use crate::wording;
use aloft_effects::{Effect, EffectInstance};

/// What the rounds of a discovery made.
#[derive(Clone)]
pub(crate) struct RoundResults<'a> {
    /// Rounds in their order.
    pub rounds: Vec<Round>,
    /// Effects found, and for each the variant that is in the model.
    pub found: Vec<Found>,
    /// The variants.
    pub kept: Vec<Variant<'a>>,
    /// Effects found in flight that contact contradicts, in words.
    pub contradicted: Option<String>,
    /// Effects that are not named because their size may be zero; laws are compared with them.
    pub in_doubt: Vec<Variant<'a>>,
    /// Effects that could not be ranked.
    pub left_out: Vec<NotTried>,
    /// Held-out mean square of rows before and after the effects found.
    pub errors: [f64; 2],
    /// True if the session has flights.
    pub has_flights: bool,
}

impl RoundResults<'_> {
    /// Results before the first round.
    pub fn none(has_flights: bool) -> Self {
        let (rounds, found, kept, in_doubt, left_out) = (Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { rounds, found, kept, contradicted: None, in_doubt, left_out, errors: [f64::NAN; 2], has_flights }
    }

    /// The same with nothing named, and why.
    pub fn naming_nothing(mut self, why: &Refused) -> Self {
        for round in self.rounds.iter_mut().filter(|r| matches!(r.verdict, Verdict::Supported | Verdict::OneOf)) {
            round.superseded = true;
        }
        let before = self.errors[0];
        let in_doubt = if why.size_may_be_zero { std::mem::take(&mut self.kept) } else { Vec::new() };
        let contradicted = Some(why.words.clone());
        Self { found: Vec::new(), kept: Vec::new(), contradicted, in_doubt, errors: [before; 2], ..self }
    }
}

/// Widens the intervals of the effects found by what repeats in every trial of a person.
pub(crate) fn widen_found(
    session: &Session<'_>,
    accepted: &[EffectInstance<'_>],
    kept: &[Variant<'_>],
    found: &mut [Found],
    options: &DiscoverOptions,
) {
    for (i, f) in found.iter_mut().enumerate() {
        let domain = if kept[i].effect.acts().in_flight() { Domain::Flight } else { Domain::Contact };
        widen_one(session, domain, accepted, kept, i, f, options);
    }
}

/// Widens the intervals of effect `i`, which was fitted to the rows of `domain`.
pub(crate) fn widen_one(
    session: &Session<'_>,
    domain: Domain,
    accepted: &[EffectInstance<'_>],
    kept: &[Variant<'_>],
    i: usize,
    found: &mut Found,
    options: &DiscoverOptions,
) {
    let mut others = kept.to_vec();
    others.remove(i);
    let of = |v: &[Variant<'_>]| extra_columns(session, domain, accepted, v, &[]);
    let estimates = (&mut found.coefficients[..], &mut found.nonlinear[..]);
    widen(session, domain, &of(&others), &of(kept), &kept[i], estimates, &|_| None, options);
}

/// Widens in the same way the intervals of effects that the rounds name beside the one found: each
/// takes the place of that one in the model.
pub(crate) fn widen_named<'a>(
    session: &Session<'_>,
    accepted: &[EffectInstance<'_>],
    effects: &[&'a dyn Effect],
    kept: &[Variant<'a>],
    rounds: &mut [Round],
    options: &DiscoverOptions,
) {
    for round in rounds.iter_mut().filter(|r| !r.superseded && r.verdict == Verdict::OneOf) {
        let Some(i) = kept.iter().position(|v| round.joined.iter().any(|id| id == v.effect.id())) else { continue };
        let mut others = kept.to_vec();
        others.remove(i);
        for c in round.candidates.iter_mut().filter(|c| round.effects.contains(&c.effect)) {
            let variant = Variant::of_candidate(session, effects, c).filter(|v| v.effect.id() != kept[i].effect.id());
            let Some(variant) = variant else { continue };
            let domain = if variant.effect.acts().in_flight() { Domain::Flight } else { Domain::Contact };
            let of = |v: &[Variant<'_>]| extra_columns(session, domain, accepted, v, &[]);
            let whole = [&others[..], std::slice::from_ref(&variant)].concat();
            let estimates = (&mut c.coefficients[..], &mut c.nonlinear[..]);
            widen(session, domain, &of(&others), &of(&whole), &variant, estimates, &|_| None, options);
        }
    }
}

/// What the rounds named, without what was dropped again beside effects of later rounds.
fn groups<'r>(rounds: impl Iterator<Item = &'r Round>, found: &[Found]) -> Vec<Group> {
    let mut out: Vec<Group> = Vec::new();
    for round in rounds {
        let stayed: Vec<String> =
            round.joined.iter().filter(|id| found.iter().any(|f| f.effect == **id)).cloned().collect();
        match round.verdict {
            _ if stayed.is_empty() => {}
            Verdict::Supported => out.extend(stayed.into_iter().map(|id| Group { effects: vec![id], missing: 1 })),
            _ => out.push(Group { effects: round.effects.clone(), missing: round.missing.min(stayed.len()) }),
        }
    }
    out
}

/// What the rounds name together.
struct Named {
    groups: Vec<Group>,
    verdict: Verdict,
    /// Effects of all groups, each once.
    effects: Vec<String>,
    /// True if what a round named was dropped again beside the effects of later rounds: nothing is
    /// named for sure.
    lost: bool,
}

impl Named {
    fn by(rounds: &[Round], found: &[Found]) -> Self {
        let named = |r: &&Round| !r.superseded && matches!(r.verdict, Verdict::Supported | Verdict::OneOf);
        let groups = groups(rounds.iter().filter(named), found);
        let first = rounds.first().map_or(Verdict::NotDetectable, |r| r.verdict);
        let verdict = match groups.first() {
            Some(group) if group.is_sure() => Verdict::Supported,
            Some(_) => Verdict::OneOf,
            None => rounds.iter().find(named).map_or(first, |r| r.verdict),
        };
        let mut effects: Vec<String> = Vec::new();
        for id in groups.iter().filter(|g| verdict == Verdict::OneOf || g.is_sure()).flat_map(|g| &g.effects) {
            if !effects.contains(id) {
                effects.push(id.clone());
            }
        }
        let lost = groups.is_empty() && matches!(verdict, Verdict::Supported | Verdict::OneOf);
        Self { groups, verdict, effects, lost }
    }
}

/// What each effect found adds to the model that holds those before it.
fn steps<'e>(
    session: &Session<'_>,
    accepted: &[EffectInstance<'e>],
    kept: &[Variant<'e>],
    found: &[Found],
    options: &DiscoverOptions,
) -> Vec<Addition> {
    let mut model: Vec<EffectInstance<'e>> = accepted.to_vec();
    let mut steps = Vec::new();
    for (v, f) in kept.iter().zip(found) {
        let nonlinear = f.nonlinear.iter().map(|e| e.value).collect();
        let choice = EffectInstance { effect: v.effect, target: v.target, nonlinear, trials: f.trials.clone() };
        steps.extend(session.or_named(addition(session, &model, &choice, options)));
        model.push(choice);
    }
    steps
}

/// Each effect as it was ranked first, the best ones first.
fn best_of_each(rounds: &[Round]) -> Vec<Candidate> {
    let mut out: Vec<Candidate> = Vec::new();
    for c in rounds.iter().flat_map(|r| &r.candidates) {
        if !out.iter().any(|o| o.effect == c.effect) {
            out.push(c.clone());
        }
    }
    out.sort_by(|a, b| a.held_out_ratio.total_cmp(&b.held_out_ratio));
    out
}

/// The error that is not explained, and where: it remains far above its floor, whatever was found,
/// or effects leave a share of it that the noise does not account for. `left` holds what remains in
/// flight and in contact, from the stages and from the rows. With `all_of_it` (nothing is named)
/// each error above its floor counts.
///
/// Effects found in flight are judged in flight; their error in contact also contains what only
/// contact shows, but a force that is always there cannot leave contact far above its floor.
fn not_explained(
    session: &Session<'_>,
    kept: &[Variant<'_>],
    [left, estimates]: [[Option<HeldOutResult>; 2]; 2],
    has_flights: bool,
    all_of_it: bool,
) -> Option<(&'static str, HeldOutResult)> {
    let flight_shows = |v: &&Variant<'_>| v.effect.acts().in_flight();
    let only_flight = has_flights && kept.iter().any(|v| flight_shows(&v));
    let in_both = kept.iter().filter(flight_shows).any(|v| v.effect.acts().in_contact());
    let far = |i: usize| {
        let (before, after) = (session.model_error[i]?, left[i]?);
        let place = wording::domain([Domain::Flight, Domain::Contact][i]);
        let judged_here = kept.iter().any(|v| flight_shows(&v) == (i == 0));
        // a lack of fit shows in the rows and in the comparison
        let share = [Some(after), estimates[i]].into_iter().flatten().map(|s| before.share_left(&s));
        let misfit = judged_here && share.fold(f64::INFINITY, f64::min) > LACK_OF_FIT;
        // nothing is missing only where the error is at its floor
        let remains = all_of_it && after.is_above();
        // Effects of the plates act in contact only: an error above the floor in flight may act
        // there, too. It is explained if flights are at the floor once contact helps to identify
        // the body.
        let only_plates = i == 0 && !kept.is_empty() && !kept.iter().any(|v| flight_shows(&v));
        if only_plates && has_flights && before.is_above() && after.is_above() {
            return Some((place, before));
        }
        (after.is_far() || misfit || remains).then_some((place, after))
    };
    (0..2)
        .filter(|i| *i == 0 || !only_flight || (in_both && left[1].is_some_and(|s| s.is_far())))
        .filter_map(far)
        .max_by(|a, b| a.1.times_floor().total_cmp(&b.1.times_floor()))
}

/// The answer, or what was found and is not named.
pub(crate) fn conclude(
    session: &Session<'_>,
    effects: &[&dyn Effect],
    accepted: &[EffectInstance<'_>],
    made: RoundResults<'_>,
    until: &Until,
    options: &DiscoverOptions,
) -> Result<Discovery, Unnamed> {
    let RoundResults { mut rounds, mut found, mut kept, contradicted, in_doubt, left_out, errors, has_flights } = made;
    let [before, after] = errors;
    let steps = steps(session, accepted, &kept, &found, options);
    let Named { groups, verdict, effects: once, lost } = Named::by(&rounds, &found);
    let mut candidates = best_of_each(&rounds);
    let weight = session.unit[0];
    // scale to the errors of the comparison, if one was made: relative change from the rows,
    // newtons from the comparison
    let model_error = session.model_error[usize::from(!has_flights)];
    let scale = model_error.map_or(weight, |s| s.held_out_error / before.sqrt());
    // errors of the present model, before any effect found here: contact rounds already contain
    // the effects found in flight
    let error_with = |domain: Domain, kept: &[Variant<'_>], found: &[Found]| {
        let extra = extra_columns(session, domain, accepted, kept, found);
        let problem = Problem::if_possible(session, domain, &extra, options)?;
        Some(problem.plain().sqrt() * session.unit[0])
    };
    let places = [Domain::Flight, Domain::Contact];
    let first_error = places.map(|place| {
        let judged = rounds.iter().any(|r| r.judged_on == wording::domain(place));
        if judged { error_with(place, &[], &[]).unwrap_or(f64::NAN) } else { f64::NAN }
    });
    for round in &mut rounds {
        let of = usize::from(round.judged_on != wording::domain(Domain::Flight));
        let first = first_error[of];
        if let (Some(s), true) = (session.model_error[of], first > 0.0) {
            round.held_out_error *= s.held_out_error / first;
        }
    }
    // what the user asks for by name is answered as asked
    let asked_for_all = options.only.is_empty();
    // remaining error with the effects found, in each domain: computed by the stages, or estimated
    let mut computed = if lost { None } else { session.by_stages.with(&found) };
    if let Some(staged) = computed.as_ref().filter(|_| has_flights && asked_for_all)
        && let Some((v, f)) = kept.iter().zip(&found).find(|(v, _)| v.effect.acts().in_flight())
        && let Some(no) = Refused::by_stages(v.effect.id(), &f.key, session.model_error[1], staged.errors[1])
    {
        return Err(Unnamed::One(no));
    }
    if let Some(from_flights) = computed.as_ref().filter(|_| has_flights)
        && let Some(both) = by_both(session, accepted, &kept, &found, from_flights, options)
    {
        (kept, found, computed) = (both.kept, both.found, Some(both.staged));
    }
    let estimated = |i: usize| -> Option<HeldOutResult> {
        let model_error = session.model_error[i]?;
        let share = match (i, has_flights) {
            _ if kept.is_empty() => 1.0,
            (0, true) | (_, false) if !lost => (after / before).sqrt(),
            _ => error_with(places[i], &kept, &found)? / first_error[i],
        };
        share.is_finite().then_some(HeldOutResult { held_out_error: model_error.held_out_error * share, ..model_error })
    };
    let estimates = [estimated(0), estimated(1)];
    let of_stages = |i: usize| {
        let by_parameters = session.model_error[i].and_then(|s| s.by_parameters);
        computed.as_ref().and_then(|c| c.errors[i]).map(|s| HeldOutResult { by_parameters, ..s })
    };
    let left = [0, 1].map(|i| of_stages(i).or(estimates[i]));
    if let Some(staged) = &computed {
        staged.restate(&mut found);
        // the candidate that alone was found is the same model
        if let [only] = &found[..] {
            let its = candidates.iter_mut().filter(|c| c.key == only.key && c.trials == only.trials);
            its.for_each(|c| c.coefficients.clone_from(&only.coefficients));
        }
    }
    // the effects bring the error to its floor, and without them it is above
    let reached = |e: HeldOutResult| e.reached_by(e.held_out_error);
    let at_floor = left[usize::from(!has_flights)].is_some_and(reached) && !model_error.is_some_and(reached);
    let with = computed.as_ref().map_or([None; 2], |c| c.errors);
    let no = Refused::without_what_makes_it(&kept, &found, at_floor)
        .or_else(|| Refused::where_it_is_judged(&kept, &found, [session.model_error, with]));
    if asked_for_all && let Some(no) = no {
        // others of its class are judged without it
        return Err(if found.len() == 1 && once.len() < 2 { Unnamed::All(no) } else { Unnamed::One(no) });
    }
    let together = kept.iter().zip(&found).filter(|_| at_floor).filter_map(|(variant, f)| {
        let name = may_be_zero(&variant.effect.about(), &variant.coefficients, &f.coefficients)?;
        Some(wording::with_its_unknowns(&f.key, &name))
    });
    let together: String = together.collect();
    let mut out = Discovery {
        schema: 1,
        verdict,
        effects: once,
        groups,
        words: String::new(),
        noise_floor: model_error.map_or(f64::NAN, |s| s.noise_floor),
        noise_floor_ci95: model_error.and_then(|s| s.noise_floor_ci95),
        error_by_parameters: model_error.and_then(|s| s.by_parameters),
        held_out_error: before.sqrt() * scale,
        held_out_error_after: after.sqrt() * scale,
        held_out_error_of_weight: before.sqrt() * scale / weight,
        candidates,
        rounds,
        ladder: steps,
        found,
        advice: Vec::new(),
        warnings: session.warnings.clone(),
        failed: Vec::new(),
        not_tried: left_out,
        misfit: None,
        against: None,
        open: None,
        to_correct: None,
        joints: None,
        evidence: None,
    };
    let nothing = kept.is_empty() && verdict == Verdict::NothingMissing;
    let rigid = session.prior.is_none() && has_flights && kept.iter().any(|v| v.effect.acts().in_flight());
    let far = not_explained(session, &kept, [left, estimates], has_flights, nothing || lost);
    // an error that a perfect model would hardly reach leaves nothing to explain; contact is judged
    // by itself
    let of_flights = far.is_none() && kept.iter().all(|v| v.effect.acts().in_flight());
    let contact_fits = left[1].is_none_or(|s| !s.is_above());
    let below = model_error.filter(|s| has_flights && of_flights && contact_fits && s.is_below());
    if far.is_some() || lost || below.is_some() {
        out.verdict = if below.is_some() { Verdict::NotDetectable } else { Verdict::Unexplained };
        out.effects.clear();
        out.groups.clear();
    }
    if has_flights && !options.closed && options.only.is_empty() {
        let refuted = contradicted.is_some() && in_doubt.is_empty();
        let (kept, in_doubt, left) = (&kept, &in_doubt, &left);
        Beyond { session, accepted, effects, kept, in_doubt, refuted, left, until, options }.look(&mut out);
    }
    let too_much = out.leaves_too_much(model_error, left[0], rigid);
    let far = far.or_else(|| Some((wording::domain(Domain::Flight), left[0].filter(|_| too_much)?)));
    // the force of one effect acts, and its law is another one
    let another_form = out.is_of_another_form().then(|| wording::of_another_form(&out, left[0]));
    let named = matches!(out.verdict, Verdict::Supported | Verdict::OneOf);
    let mut winds = kept.iter().zip(&out.found).filter(|_| named && asked_for_all);
    let late = winds.find_map(|(v, f)| delay_or_wind(session, v, &f.nonlinear));
    let another_form = another_form.or_else(|| Some(wording::wind_or_late(&out, left[0], late?)));
    if another_form.is_some() || too_much {
        out.verdict = Verdict::Unexplained;
        out.effects.clear();
        out.groups.clear();
    }
    // an error within the interval of a floor that is hardly known may hold anything
    let undecided = model_error.filter(|s| out.verdict == Verdict::NothingMissing && s.is_undecided());
    // nor does one beyond that interval show that nothing is missing
    let nothing = out.verdict == Verdict::NothingMissing && undecided.is_none();
    let between = (0..2).find_map(|i| Some((places[i], left[i].filter(|after| nothing && after.is_between())?)));
    if undecided.is_some() || between.is_some() {
        out.verdict = Verdict::NotDetectable;
    }
    // what is left of the parameters or of a floor known too roughly looks like some force, too:
    // it is not described
    if undecided.is_some() || between.is_some_and(|(_, s)| s.may_be_of_parameters()) {
        out.open = None;
    }
    out.words = if let Some(why) = contradicted.filter(|_| lost) {
        format!("unexplained: {why}")
    } else if lost && far.is_none() {
        "unexplained: the effects that a round named were dropped again beside those found later, so none is named"
            .to_owned()
    } else {
        wording::answer(&out, far)
    };
    if let Some(s) = below {
        out.words = wording::below(&s);
    }
    if let Some(s) = undecided {
        out.words = wording::undecided(&out, &s);
    }
    if let Some((place, s)) = between {
        out.words = wording::between(&out, place, &s);
    }
    let told = far.is_some() || another_form.is_some();
    if let Some(words) = another_form {
        out.words = words;
    }
    if let Some(open) = &out.open {
        out.words = wording::with_open(&out, open, told);
    }
    if matches!(out.verdict, Verdict::Supported | Verdict::OneOf) {
        out.words += &together;
        if let Some(against) = out.against.as_ref().filter(|a| a.is_worth_telling()) {
            out.words += &wording::of_another_law(against);
        }
    }
    if let Some(against) =
        out.against.as_ref().filter(|a| out.verdict == Verdict::Unexplained && a.is_against_the_effect())
    {
        out.words += &wording::refuted(against);
    }
    out.advice = wording::advice(&out, effects);
    if !has_flights {
        let untried = effects
            .iter()
            .filter(|e| wanted(**e, options) && !judged_in(**e, Domain::Contact) && !e.acts().in_joints())
            .count();
        out.warnings.push(wording::no_flights(untried));
    }
    Ok(out)
}
