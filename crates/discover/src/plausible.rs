//! Sizes that physics allows.

use crate::candidate::Scored;
use crate::ladder::is_at_bound;
use crate::result::Estimate;
use aloft_effects::{About, Coefficient};

/// True if no coefficient is at a physical bound and not all are zero.
pub(crate) fn plausible(scored: &Scored<'_>, estimates: &[Estimate]) -> bool {
    let bounds = &scored.variant.coefficients;
    let mut moved = false;
    for (bound, estimate) in bounds.iter().zip(estimates) {
        let away_from_zero = |b: f64| if b == 0.0 { f64::INFINITY } else { b };
        if is_at_bound(estimate.value, [away_from_zero(bound.lower), away_from_zero(bound.upper)]) {
            return false;
        }
        moved |= estimate.value != 0.0;
    }
    // a coefficient of one permitted sign is zero if the data ask for the other sign
    let about = scored.variant.effect.about();
    let absent = |(b, e): (&Coefficient, &Estimate)| b.lower == 0.0 && e.value <= 0.0;
    let all_absent = bounds.iter().zip(estimates).filter(|(b, _)| !about.is_accompanied_by(&b.name)).all(absent);
    moved && !all_absent && accompanied(&about, bounds, estimates).is_none()
}

/// Names of the coefficients that make an effect, if none of them differs from zero, and of those
/// that accompany them and do: a line of no stiffness that only damps is no line, and a jet of no
/// force that only turns is no jet.
pub(crate) fn accompanied(
    about: &About<'_>,
    coefficients: &[Coefficient],
    estimates: &[Estimate],
) -> Option<[Vec<String>; 2]> {
    let is_seen = |e: &Estimate| e.ci95.is_some_and(|[low, high]| low > 0.0 || high < 0.0);
    let (main, others): (Vec<_>, Vec<_>) =
        coefficients.iter().zip(estimates).partition(|(c, _)| !about.is_accompanied_by(&c.name));
    let names = |of: &[(&Coefficient, &Estimate)]| of.iter().map(|(c, _)| c.name.clone()).collect();
    let seen: Vec<_> = others.into_iter().filter(|(_, e)| is_seen(e)).collect();
    (!seen.is_empty() && !main.iter().any(|(_, e)| is_seen(e))).then(|| [names(&main), names(&seen)])
}
