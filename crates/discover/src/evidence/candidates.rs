//! Which explanations are tried on these recordings, each at the optimum of its unknowns.

use super::model::Model;
use super::priors::{FAR_BEHIND, STEPS, TO_THE_END};
use crate::candidate::{Variant, solve};
use crate::nonlinear::{columns_and_slopes, improve};
use crate::options::DiscoverOptions;
use crate::rank::screen;
use crate::round::wanted;
use aloft_effects::{Effect, Target};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// An effect on a target in some or all recordings, at the optimum of its unknowns.
#[derive(Clone)]
pub(super) struct Explanation<'a> {
    pub variant: Variant<'a>,
    pub theta: DVector<f64>,
    /// Sum of squares that it leaves.
    pub left: f64,
    /// Logarithm of its marginal likelihood, the same constant left out as for "nothing"; without
    /// what it costs to choose its effect and target among others.
    pub ln_likelihood: f64,
}

impl Explanation<'_> {
    /// Effect and target.
    pub fn place(&self) -> (&str, Target) {
        (self.variant.effect.id(), self.variant.target)
    }

    /// True if another one would only describe this one once more: the same effect on the same
    /// target, on a body of one target, or one of its other names there.
    pub fn is_alike(&self, other: &Self) -> bool {
        let (own, its) = (self.variant.effect, other.variant.effect);
        let of_a_part = matches!(self.variant.target, Target::Link(_) | Target::Plate(_));
        let same = own.id() == its.id() && !(of_a_part && self.variant.target != other.variant.target);
        let wider = its.about().contains.contains(&own.id());
        let narrower = own.about().contains.contains(&its.id()) && self.variant.target == other.variant.target;
        same || wider || narrower || (own.about().aliases.contains(&its.id()) && self.variant.target == Target::Body)
    }
}

/// Explanations by effects and targets; an effect that cannot act here has none.
pub(super) fn explanations<'a>(
    model: &Model<'_>,
    effects: &[&'a dyn Effect],
    options: &DiscoverOptions,
) -> Vec<Vec<Explanation<'a>>> {
    let tried = effects.iter().filter(|e| wanted(**e, options) && !e.acts().in_joints());
    tried
        .map(|effect| {
            let found = of_effect(model, *effect);
            model.session.counter.one();
            found
        })
        .filter(|found| !found.is_empty())
        .collect()
}

fn of_effect<'a>(model: &Model<'_>, effect: &'a dyn Effect) -> Vec<Explanation<'a>> {
    let Model { session, problem, likelihood, .. } = model;
    let targets = effect.targets(session.scene());
    let mut best: Vec<(Variant<'a>, f64)> = Vec::new();
    for (variant, columns) in screen(session, problem, effect, &targets, None) {
        let (s, c) = problem.reduce_all(&columns);
        let gain = solve(&s, &c, &variant.coefficients).1;
        match best.iter_mut().find(|(of, _)| of.target == variant.target) {
            Some(so_far) if gain > so_far.1 => *so_far = (variant, gain),
            Some(_) => {}
            None => best.push((variant, gain)),
        }
    }
    // a few steps for every target, more for those that may still matter
    let further = |(variant, gain): (Variant<'a>, f64), steps: usize| {
        let unknowns = !variant.effect.nonlinear(session.scene(), variant.target).is_empty();
        let better = if unknowns && gain > 0.0 { improve(session, problem, &variant, steps) } else { None };
        better.unwrap_or((variant, gain))
    };
    let worth = |gain: f64| likelihood.of_squares(problem.rss - gain);
    let nothing = worth(0.0);
    for (steps, share) in STEPS {
        let most = best.iter().map(|v| v.1).fold(0.0, f64::max);
        best.retain(|v| v.1 >= share * most || worth(v.1) > worth(most) - FAR_BEHIND);
        // what its coefficients alone cost more than it gains is not fitted further
        let may_matter = |v: &(Variant<'a>, f64)| {
            steps == STEPS[0].0 || worth(v.1) - likelihood.of_coefficients(v.0.coefficients.len()) > nothing
        };
        best = best.into_par_iter().map(|v| if may_matter(&v) { further(v, steps) } else { v }).collect();
    }
    best.into_par_iter()
        .filter_map(|(variant, _)| explained(model, variant))
        .flat_map(|everywhere| {
            let in_some = in_some_recordings(model, &everywhere);
            std::iter::once(everywhere).chain(in_some).collect::<Vec<_>>()
        })
        .collect()
}

/// The evidence of a variant as it is, in the metric of the noise as identification has it: what it
/// leaves over the noise that the rows have with it.
/// None if its columns say nothing that the model does not.
pub(super) fn explained<'a>(model: &Model<'_>, variant: Variant<'a>) -> Option<Explanation<'a>> {
    let Model { session, problem, likelihood, .. } = model;
    let columns = variant.columns(session, problem)?;
    let (s, c) = problem.reduce_all(&columns);
    if s.iter().all(|x| *x == 0.0) {
        return None;
    }
    // errors of the motion are in the columns as in the rows; a column that is noise says nothing
    let errors = model.row_errors(&variant);
    let (of_columns, with_rows, of_rows) = problem.of_errors(&columns, &errors);
    if !errors.is_empty() && (0..c.len()).any(|i| s[(i, i)] > 0.0 && of_columns[(i, i)] >= s[(i, i)]) {
        return None;
    }
    let (theta, _) = solve(&(&s - &of_columns), &(&c - &with_rows), &variant.coefficients);
    let form = |s: &DMatrix<f64>, c: &DVector<f64>| 2.0 * c.dot(&theta) - theta.dot(&(s * &theta));
    // the noise of the rows with it, over that without: a body that is taken away leaves none
    let noise = if of_rows > 0.0 { 1.0 - form(&of_columns, &with_rows) / of_rows } else { 1.0 };
    let left = (problem.rss - form(&s, &c)) / noise.max(f64::MIN_POSITIVE);
    let unknowns = variant.effect.nonlinear(session.scene(), variant.target);
    let of_unknowns = if unknowns.is_empty() {
        0.0
    } else {
        let joint = problem.reduce_all(&columns_and_slopes(session, problem, &variant, &theta)?).0;
        likelihood.of_unknowns(&joint, theta.len(), &unknowns, left)
    };
    let ln_likelihood = likelihood.of_squares(left) - likelihood.of_coefficients(theta.len()) - of_unknowns;
    Some(Explanation { variant, theta, left, ln_likelihood })
}

/// The same effect in some of the recordings, at any one cut through its sizes in each of them.
/// There are `n − 1` such cuts and half of the probability is for "in all".
fn in_some_recordings<'a>(model: &Model<'_>, everywhere: &Explanation<'a>) -> Option<Explanation<'a>> {
    let Model { session, problem, likelihood, .. } = model;
    let variant = &everywhere.variant;
    if !variant.group.is_empty() || !variant.effect.has_wrench() {
        return None;
    }
    let mut trials: Vec<usize> = problem.clusters.iter().map(|c| c.trial).collect();
    trials.sort_unstable();
    trials.dedup();
    if trials.len() < 3 {
        return None;
    }
    let columns = variant.columns(session, problem)?;
    let by_trial: Vec<DMatrix<f64>> = columns
        .iter()
        .zip(&problem.clusters)
        .map(|(c, cluster)| {
            let signal = c * &everywhere.theta;
            DMatrix::from_fn(c.nrows(), trials.len(), |i, j| if trials[j] == cluster.trial { signal[i] } else { 0.0 })
        })
        .collect();
    let (s, c) = problem.reduce_all(&by_trial);
    let size = crate::candidate::pseudo_solve(&s, &c);
    let mut order: Vec<usize> = (0..trials.len()).collect();
    order.sort_by(|&a, &b| size[b].total_cmp(&size[a]));
    let gain = |of: &[usize]| {
        let right: f64 = of.iter().map(|&i| c[i]).sum();
        let square: f64 = of.iter().flat_map(|&i| of.iter().map(move |&j| (i, j))).map(|at| s[at]).sum();
        if square > 0.0 && right > 0.0 { right * right / square } else { 0.0 }
    };
    // in this direction, or what is below the others in the other
    let cuts = (1..order.len()).flat_map(|cut| [&order[..cut], &order[cut..]]);
    let best = cuts.max_by(|a, b| gain(a).total_cmp(&gain(b)))?;
    // set by set it has to be likelier than in all recordings before it is fitted to them
    let cost = likelihood.of_squares(everywhere.left) - everywhere.ln_likelihood;
    let here = likelihood.of_squares(problem.rss - gain(best)) - cost - ln_choices(trials.len(), best.len());
    if here < everywhere.ln_likelihood {
        return None;
    }
    let mut group = vec![false; session.trials.len()];
    best.iter().for_each(|&i| group[trials[i]] = true);
    let some = Variant { group, ..variant.clone() };
    let some = improve(session, problem, &some, TO_THE_END).map_or(some, |better| better.0);
    let mut found = explained(model, some)?;
    // 2 (n - 1) sets that one order offers, of 2^n - 2: how many of them were tried does not matter
    // as much as how many there are with so many recordings
    found.ln_likelihood -= ln_choices(trials.len(), best.len());
    Some(found)
}

/// Logarithm of the number of sets of k of n recordings, and of the n − 1 sizes of such a set.
fn ln_choices(n: usize, k: usize) -> f64 {
    let ways: f64 = (0..k).map(|i| ((n - i) as f64 / (i + 1) as f64).ln()).sum();
    ways + ((n - 1) as f64).ln()
}
