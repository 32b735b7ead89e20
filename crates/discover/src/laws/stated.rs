//! Whether laws are stated: what they have to do better than.

use super::atlas::Line;
use super::fit::Fitted;
use super::kinematics::Carrier;
use super::one_law::SIMPLER;
use super::with_contact::IN_FLIGHT;
use super::wording::fitted;
use crate::candidate::Variant;
use crate::problem::Domain;
use crate::result::AgainstLaw;
use crate::session::Session;
use crate::statistics::sign_flip_p;
use crate::wording::domain;

/// Laws are the answer if they leave no more than this multiple of the floor.
pub(super) const ANSWERED: f64 = 1.5;
/// Laws that leave more than this share of the error are not named.
const PART: f64 = 0.5;
/// Laws that leave more than this share of what the catalogue leaves are not named.
const BETTER: f64 = 0.85;
/// Probability by chance below which a law is better than an effect that is in doubt.
const TRUER: f64 = 0.01;
/// The same where the form of the effect is refuted already, with a probability of its own.
const TRUER_IN_FORM: f64 = 0.05;
/// Share of a named effect's error in flight and contact that a law leaves at most to take its
/// place.
const LESS_ON_BOTH: f64 = 0.90;
/// Share below which a law puts the name of an effect in doubt.
const IN_DOUBT: f64 = 0.95;
/// Share below which a law is mentioned beside a named effect.
const WORTH_TELLING: f64 = 0.98;
/// Share of a named effect's error in the flights of a rigid body, which has no soft tissue, that a
/// law leaves at most to take its place. Beside effects that act as their law says, the best law
/// left at least 0.998 of their error (chains of seed 11151, strengths 2 and 4), and 0.990 of that
/// of an elastic line (`tests/laws.rs`).
const LESS_IN_FLIGHT: f64 = 0.98;

impl AgainstLaw {
    /// True if the law leaves so much less than every named effect, in recording after recording,
    /// that it takes their place.
    pub(crate) fn is_for_the_law(&self) -> bool {
        self.error_ratio < self.limit(LESS_ON_BOTH) && self.p_value < TRUER
    }

    /// True if the law leaves so much less that no effect is named.
    pub(crate) fn is_against_the_effect(&self) -> bool {
        self.error_ratio < self.limit(IN_DOUBT) && self.p_value < TRUER
    }

    /// Share from which on an effect is as good as the law. In flight a simpler law may leave a
    /// little more.
    fn as_good(&self) -> f64 {
        if self.in_flight() { SIMPLER } else { 1.0 }
    }

    /// True if flights alone are compared, those of a rigid body.
    fn in_flight(&self) -> bool {
        self.judged_on == domain(Domain::Flight)
    }

    /// The largest share that a law may leave, where `on_both` is that in flight and contact.
    fn limit(&self, on_both: f64) -> f64 {
        if self.in_flight() { LESS_IN_FLIGHT } else { on_both }
    }

    /// True if the law leaves a little less in recording after recording: the effect is named, and
    /// its law may be another one.
    pub(crate) fn is_worth_telling(&self) -> bool {
        self.error_ratio < WORTH_TELLING && self.p_value < TRUER
    }

    /// True if the law predicts about as well as the effect, neither clearly better nor clearly
    /// worse: the recordings do not tell the two apart.
    pub fn is_as_good(&self) -> bool {
        (WORTH_TELLING..=WORTH_TELLING.recip()).contains(&self.error_ratio)
    }
}

/// A law as accepted in its round.
#[derive(Clone)]
pub(super) struct Step {
    pub fitted: Fitted,
    /// Error with it over that without (root mean square).
    pub ratio: f64,
    /// Family-wise p-value of its entry.
    pub p: f64,
    /// Other carriers that the rows do not exclude.
    pub also: Vec<Carrier>,
    /// True if it was fitted to flights and contact.
    pub of_both: bool,
}

/// What laws have to do better than.
pub(crate) struct Rivals<'v, 'a> {
    /// Share of the error that the best effects of the catalogue leave.
    pub ratio: f64,
    /// Share that the best single effect leaves.
    pub single: f64,
    /// Number of unknowns if the best effects are of several kinds: a single law with fewer
    /// unknowns that leaves no more is simpler, if no single effect comes near it.
    pub several: Option<usize>,
    /// Named effects that are in doubt.
    pub doubted: Option<Doubted>,
    /// True if the named effects reach the floor's interval and nothing else is held against them:
    /// any law that leaves less is stated, for the stages to compare both.
    pub within_floor: bool,
    /// Lines towards points of the room along which effects found act: their strength may depend on
    /// something in another way than the effect says.
    pub lines: Vec<Line>,
    /// True if the named effects leave contact far above its floor: a law of both is stated even if
    /// it leaves up to [`IN_FLIGHT`] times their error in flight.
    pub far_in_contact: bool,
    /// The effects that the catalogue names, of which one is missing; empty if several are.
    pub named: &'v [Variant<'a>],
    /// Effects that are missing together.
    pub together: Option<Together>,
    /// True if the catalogue names a single effect.
    pub one_effect: bool,
    /// True if nothing is held against the named effects: the first law is compared with them, and
    /// the search ends unless it does better.
    pub only_compared: bool,
}

/// Several effects that are missing, beside each other in the model.
pub(crate) struct Together {
    /// Their identifiers.
    pub effects: Vec<String>,
    /// Squared held-out error by cluster.
    pub errors: Vec<f64>,
}

impl Together {
    /// The effects beside a law that was fitted to the same flights.
    pub(super) fn against(&self, session: &Session<'_>, law: &Fitted, seed: u64) -> Option<AgainstLaw> {
        let squared: f64 = self.errors.iter().sum();
        (self.errors.len() == law.errors.len()).then(|| AgainstLaw {
            effect: self.effects.join("` and `"),
            judged_on: domain(Domain::Flight).to_owned(),
            error_ratio: (law.error() / squared).sqrt(),
            p_value: sign_flip_p(&law.errors, &self.errors, 2000, seed ^ 0xf02a),
            law: fitted(session, law),
            difference: None,
        })
    }
}

/// Named effects that are in doubt: their strength does not follow their law, or they act along a
/// line from far away.
pub(crate) struct Doubted {
    /// Squared held-out error by cluster.
    pub errors: Vec<f64>,
    /// True if their strength does not follow their law.
    pub by_form: bool,
}

/// What is said of laws that were found.
pub(super) struct Stated {
    /// True if they are stated.
    pub named: bool,
    /// True if they are the whole answer: what they leave is within the floor.
    pub complete: bool,
}

/// Whether `laws`, which leave the share `ratio` of the error in flight, are stated beside the
/// catalogue. `within_floor`: that is within the floor. `against`: the named effects beside a
/// single law of flights and contact.
pub(super) fn stated(
    laws: &[Step],
    ratio: f64,
    within_floor: bool,
    catalogue: &Rivals<'_, '_>,
    against: Option<&AgainstLaw>,
    seed: u64,
) -> Stated {
    // none: several laws are not a single one
    let single = <&[Step; 1]>::try_from(laws).ok().map(|[law]| law);
    let simpler = |most: usize| {
        single.is_some_and(|law| law.fitted.unknowns < most)
            && ratio <= SIMPLER * catalogue.ratio
            && ratio < BETTER * catalogue.single
    };
    // a law in place of an effect whose form is in doubt has to be better flight by flight
    let truer = |doubted: &Doubted| {
        let Some(law) = single else { return false };
        let same = law.fitted.errors.len() == doubted.errors.len();
        let limit = if doubted.by_form { TRUER_IN_FORM } else { TRUER };
        same && sign_flip_p(&law.fitted.errors, &doubted.errors, 2000, seed ^ 0xf02a) < limit
    };
    let of_both = single.is_some_and(|law| law.of_both);
    let truer_on_both = against.is_some_and(AgainstLaw::is_for_the_law);
    // the same rows say that an effect is at least as good
    let no_better = against.is_some_and(|a| a.error_ratio > a.as_good());
    let any_better = (catalogue.far_in_contact && of_both && ratio <= IN_FLIGHT * catalogue.ratio)
        || ratio < if catalogue.within_floor { 1.0 } else { BETTER } * catalogue.ratio
        || catalogue.several.is_some_and(simpler)
        || catalogue.doubted.as_ref().is_some_and(truer)
        || truer_on_both;
    let better = any_better && !no_better;
    let complete = within_floor && !laws.is_empty() && better;
    Stated { named: complete || (better && ratio < PART), complete }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_law_takes_the_place_of_an_effect_only_if_it_leaves_clearly_less() {
        let of = |on: Domain, error_ratio, p_value| {
            let (effect, judged_on) = ("effect".to_owned(), domain(on).to_owned());
            let a = AgainstLaw { effect, judged_on, error_ratio, p_value, law: String::new(), difference: None };
            [a.is_for_the_law(), a.is_against_the_effect(), a.is_worth_telling()]
        };
        let said = |error_ratio, p_value| of(Domain::Both, error_ratio, p_value);
        assert_eq!(said(0.89, 0.001), [true, true, true]);
        assert_eq!(said(0.93, 0.001), [false, true, true]);
        assert_eq!(said(0.96, 0.001), [false, false, true]);
        assert_eq!(said(0.99, 0.001), [false; 3]);
        assert_eq!(said(0.89, 0.02), [false; 3]);
        assert_eq!(of(Domain::Flight, 0.97, 0.001), [true; 3]);
        assert_eq!(of(Domain::Flight, 0.99, 0.001), [false; 3]);
        assert_eq!(of(Domain::Flight, 0.97, 0.02), [false; 3]);
    }

    #[test]
    fn a_law_that_leaves_about_as_much_error_is_as_good() {
        let of = |error_ratio| AgainstLaw {
            effect: "effect".to_owned(),
            judged_on: domain(Domain::Flight).to_owned(),
            error_ratio,
            p_value: 1.0,
            law: "law".to_owned(),
            difference: None,
        };
        assert_eq!([0.97, 0.99, 1.0, 1.01, 1.05].map(|r| of(r).is_as_good()), [false, true, true, true, false]);
        assert!(!of(f64::NAN).is_as_good());
    }
}
