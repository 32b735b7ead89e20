//! Effects and laws that lower the error in flight and are not named all the same.

use crate::candidate::Variant;
use crate::held_out::HeldOutResult;
use crate::judge::{accompanied, may_be_zero, no_component_is_seen};
use crate::problem::Domain;
use crate::result::Found;
use crate::wording::{digits, domain};

/// Error in contact with an effect over that without it, as computed by all stages, above which
/// contact speaks against the effect. On the sets for development the right effects leave less than
/// the error before.
const RISES: f64 = 1.15;

/// An effect or law that is not named, although it lowers the error in flight.
pub(crate) struct Refused {
    /// Identifier.
    pub id: String,
    /// Reason, in words.
    pub words: String,
    /// True if it lowers the error and only its size may be zero: it remains a rival of laws.
    pub size_may_be_zero: bool,
}

/// What is not named of the effects that the rounds found.
pub(crate) enum Unnamed {
    /// One of them: the ranking is made again without it.
    One(Refused),
    /// All of them: there is only one, and it is refused.
    All(Refused),
}

impl Refused {
    /// What was found in flight is refused if all stages compute more error in contact with it than
    /// without it, and more than the floor there.
    pub fn by_stages(id: &str, key: &str, without: Option<HeldOutResult>, with: Option<HeldOutResult>) -> Option<Self> {
        let (without, with) = (without?, with?);
        let rises = with.held_out_error > RISES * without.held_out_error;
        let above = with.noise_floor_ci95.is_some() && !with.reached_by(with.held_out_error);
        let newtons = |e: &HeldOutResult| digits(e.held_out_error, 3);
        (rises && above).then(|| Self {
            id: id.to_owned(),
            words: format!(
                "`{key}` is not named: it lowers the error in flight, and the error in contact rises from {} to {} N with it",
                newtons(&without),
                newtons(&with)
            ),
            size_may_be_zero: false,
        })
    }

    /// What the rounds found in a domain is refused if all stages compute no less error there with
    /// all effects than without them: the last one found there. `errors` are those in flight and in
    /// contact, without and with the effects.
    pub fn where_it_is_judged(
        kept: &[Variant<'_>],
        found: &[Found],
        errors: [[Option<HeldOutResult>; 2]; 2],
    ) -> Option<Self> {
        let [without, with] = errors;
        (0..2).find_map(|i| {
            let last = kept.iter().rposition(|v| v.effect.acts().in_flight() == (i == 0))?;
            let words = not_confirmed(&found[last].key, [Domain::Flight, Domain::Contact][i], without[i]?, with[i]?)?;
            Some(Self { id: found[last].effect.clone(), words, size_may_be_zero: false })
        })
    }

    /// A force or another vector is refused if no component of it differs from zero, beside others
    /// and where it has no further unknowns: nothing makes up for its components then.
    ///
    /// An effect of which only what accompanies it differs from zero ([`accompanied`]) is refused,
    /// and one whose size may be zero ([`may_be_zero`]), unless `found` holds it more than once:
    /// then only their sum may be seen. `at_floor`: with the effects the error is at its floor, and
    /// without them it is not. The size of a single effect is not doubted then: an interval of
    /// first order contains zero if other unknowns make up for the size, as the rest length of a
    /// tether does for its stiffness.
    pub fn without_what_makes_it(kept: &[Variant<'_>], found: &[Found], at_floor: bool) -> Option<Self> {
        kept.iter().zip(found).find_map(|(variant, its)| {
            let (about, of) = (variant.effect.about(), &variant.coefficients);
            let once = || found.iter().filter(|f| f.effect == its.effect).count() == 1;
            let accompanied = accompanied(&about, of, &its.coefficients);
            let size_may_be_zero = accompanied.is_none();
            let further = found.len() > 1;
            let why = match accompanied {
                Some([main, others]) => {
                    let (main, others) = (main.join(", "), others.join(", "));
                    format!("its {main} could be zero (95 % intervals); only {others} could not")
                }
                None if (further || its.nonlinear.is_empty())
                    && no_component_is_seen(&about, of, &its.coefficients) =>
                {
                    "each of its components could be zero (95 % intervals)".to_owned()
                }
                None => {
                    let main =
                        may_be_zero(&about, of, &its.coefficients).filter(|_| once() && (further || !at_floor))?;
                    format!("its {main} could be zero (95 % interval)")
                }
            };
            Some(Self { id: its.effect.clone(), words: format!("`{}` is not named: {why}", its.key), size_may_be_zero })
        })
    }
}

/// Why an effect is not named although rows speak for it, if all stages compute no less error with
/// it than without it.
fn not_confirmed(key: &str, place: Domain, without: HeldOutResult, with: HeldOutResult) -> Option<String> {
    let newtons = |e: &HeldOutResult| digits(e.held_out_error, 3);
    (with.held_out_error >= without.held_out_error).then(|| {
        format!(
            "`{key}` is not named: it lowers the error of rows in {}, and all stages compute {} N with it and {} N without it",
            domain(place),
            newtons(&with),
            newtons(&without)
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_that_does_not_fall_refuses_an_effect() {
        let of = |held_out_error| HeldOutResult {
            held_out_error,
            noise_floor: 5.87,
            noise_floor_ci95: Some([4.05, 8.51]),
            by_parameters: None,
        };
        let words = not_confirmed("turned[plate2]", Domain::Contact, of(5.13), of(7.53)).unwrap();
        assert_eq!(
            words,
            "`turned[plate2]` is not named: it lowers the error of rows in contact, and all stages compute 7.53 N with it and 5.13 N without it"
        );
        assert!(not_confirmed("gain", Domain::Contact, of(5.13), of(5.12)).is_none());
    }
}
