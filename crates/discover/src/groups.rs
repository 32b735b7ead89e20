//! Trials in which a load was carried: as the laboratory named them, otherwise found from the
//! trials.
//!
//! A load changes mass, first moment and inertia of its link, and its place is unknown. Every trial
//! gets the change of the mass and of the first moment of the link as unknowns (a point mass at the
//! link's centre of mass, and its derivatives with respect to the place). The trials are then
//! divided into two sets so that one common change in the first set removes most of the error.
//! Where force plates tell in which trials the body is heavier, they divide the trials.

use crate::candidate::{Variant, pseudo_inverse};
use crate::problem::{Cluster, Domain, OVERLAP, Problem};
use crate::session::Session;
use aloft_effects::{Effect, ParameterKind, Target};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Fewest trials in each set.
const FEWEST: usize = 2;
/// Up to this number of trials all divisions are tried; with more, they are improved by moving one
/// trial at a time.
const ALL_DIVISIONS: usize = 10;
/// Gain of a load over that of something taken away in the other trials from which the load is
/// preferred on a person.
const LOAD_GAIN: f64 = 0.7;
/// Difference between the masses of two sets of trials on the plates, in standard errors, from
/// which the sets count as clear; the best of all cuts through values that do not differ reaches
/// three of ten and four of 25 trials.
const CLEARLY: f64 = 5.0;
/// Share of the scatter between trials that may remain within the two sets: it is 0.36 for the best
/// cut through a normal distribution, and 0.2 for two whose means are four deviations apart.
const WITHIN: f64 = 0.2;
/// Twice the logarithm of the likelihood ratio from which a trial belongs to one of two sets: 20 to
/// one.
const TOLD: f64 = 6.0;
/// Displacement of the place in the derivatives, m.
const STEP_M: f64 = 0.1;

/// Trials in which a group effect acts: as named by the laboratory, otherwise those of the division
/// that removes most of the error, by a change of any one of the links. All links have the same
/// division, so that loads on several links are compared in the same trials. `None` if the trials
/// are too few to be divided.
pub(crate) fn group(
    session: &Session<'_>,
    problem: &Problem,
    effect: &dyn Effect,
    targets: &[Target],
) -> Option<Vec<bool>> {
    if session.groups.iter().any(Option::is_some) {
        return session.loaded();
    }
    let on_plates = session.loaded_on_plates(effect, targets);
    let trials = trials_of(problem);
    if trials.len() < 2 * FEWEST {
        return None;
    }
    let of_links: Vec<(f64, Vec<bool>)> = targets
        .par_iter()
        .filter_map(|&target| {
            let start = effect.starts(session.scene, target).into_iter().next()?;
            let variant = Variant::new(session, effect, target, start);
            let by_trial = Division::new(session, problem, &variant, &trials)?;
            if let Some(shown) = &on_plates {
                let shown: Vec<Option<bool>> = trials.iter().map(|&t| shown[t]).collect();
                let acts = by_trial.best_with(&shown);
                return Some((by_trial.gain(&acts).0, acts));
            }
            let best = if trials.len() <= ALL_DIVISIONS { by_trial.best_of_all() } else { by_trial.best_by_moves() }?;
            // a prior hardly tells a load in some trials from something taken away in the others
            let others: Vec<bool> = best.iter().map(|acts| !acts).collect();
            let ((gain, mass), (turned, load)) = (by_trial.gain(&best), by_trial.gain(&others));
            let is_load = mass < 0.0 && load > 0.0 && turned > LOAD_GAIN * gain;
            Some((gain, if is_load { others } else { best }))
        })
        .collect();
    let (_, chosen) = of_links.into_iter().reduce(|a, b| if b.0 > a.0 { b } else { a })?;
    let mut mask = vec![false; session.trials.len()];
    trials.iter().zip(&chosen).for_each(|(&t, &acts)| mask[t] = acts);
    Some(mask)
}

impl Session<'_> {
    /// For each trial, whether the plates measure the larger of two clearly different masses; none
    /// for trials in which they do not tell. The plates tell the mass of what is carried, and
    /// flights hardly do.
    fn loaded_on_plates(&self, effect: &dyn Effect, targets: &[Target]) -> Option<Vec<Option<bool>>> {
        let find = || -> Option<Vec<Option<bool>>> {
            let problem = self.or_named(Problem::new(self, Domain::Contact, &[], FEWEST, 1.0))?;
            let trials = trials_of(&problem);
            let n_rows: f64 = problem.clusters.iter().map(|c| c.n_rows as f64).sum();
            // the link on which the trials' masses explain contact best: on another one they are
            // spoiled by how the links move
            let of_link = |&target: &Target| -> Option<(f64, Vec<f64>, Vec<f64>)> {
                let start = effect.starts(self.scene, target).into_iter().next()?;
                let columns = Variant::new(self, effect, target, start).columns(self, &problem)?;
                let (s, c) = problem.reduce_all(&by_trial(&problem, &[columns], &trials));
                let mass = pseudo_inverse(&s) * &c;
                let gain = c.dot(&mass);
                let variance = OVERLAP * (problem.rss - gain).max(0.0) / n_rows;
                let weights: Vec<f64> = (0..trials.len()).map(|i| s[(i, i)] / variance).collect();
                Some((gain, mass.as_slice().to_vec(), weights))
            };
            let of_links: Vec<_> = targets.par_iter().filter_map(of_link).collect();
            let (_, mass, weights) = of_links.into_iter().reduce(|a, b| if b.0 > a.0 { b } else { a })?;
            let mut told = vec![None; self.trials.len()];
            trials.iter().zip(heavier(&mass, &weights)?).for_each(|(&t, is)| told[t] = is);
            Some(told)
        };
        self.on_plates.get_or_init(find).clone()
    }
}

/// The larger of values that fall into two clear sets: those between which the scatter is largest,
/// with `weights` one over the variance of each. `None` if the means do not differ by
/// [`CLEARLY`] standard errors, if the scatter within the sets is too large a share, or if a set
/// rests on less than two values; none for a value that is as near to the other mean as its error
/// tells.
fn heavier(values: &[f64], weights: &[f64]) -> Option<Vec<Option<bool>>> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let sum = |of: &[usize], f: &dyn Fn(usize) -> f64| of.iter().map(|&i| f(i)).sum::<f64>();
    let weight = |of: &[usize]| sum(of, &|i| weights[i]);
    let mean = |of: &[usize]| sum(of, &|i| weights[i] * values[i]) / weight(of);
    let scatter = |of: &[usize]| sum(of, &|i| weights[i] * (values[i] - mean(of)).powi(2));
    let rests_on = |of: &[usize]| weight(of).powi(2) / sum(of, &|i| weights[i].powi(2));
    let all = scatter(&order);
    let (within, cut) = (1..order.len())
        .filter(|&cut| [&order[..cut], &order[cut..]].iter().all(|of| rests_on(of) > FEWEST as f64 - 0.5))
        .map(|cut| (scatter(&order[..cut]) + scatter(&order[cut..]), cut))
        .min_by(|a, b| a.0.total_cmp(&b.0))?;
    if all - within < CLEARLY * CLEARLY || within > WITHIN * all {
        return None;
    }
    let (lower, upper) = (mean(&order[..cut]), mean(&order[cut..]));
    let told = |(x, w): (&f64, &f64)| {
        // difference of the squared distances in standard errors
        let nearer = w * ((x - lower).powi(2) - (x - upper).powi(2));
        (nearer.abs() > TOLD).then_some(nearer > 0.0)
    };
    Some(values.iter().zip(weights).map(told).collect())
}

/// Trials of a problem, each once.
fn trials_of(problem: &Problem) -> Vec<usize> {
    let mut trials: Vec<usize> = problem.clusters.iter().map(|c| c.trial).collect();
    trials.sort_unstable();
    trials.dedup();
    trials
}

/// Columns of a change for each trial, by cluster: those of `parts` for the first trial, for the
/// second …
fn by_trial(problem: &Problem, parts: &[Vec<DMatrix<f64>>], trials: &[usize]) -> Vec<DMatrix<f64>> {
    let k = parts.len();
    let of_cluster = |(g, cluster): (usize, &Cluster)| {
        let mut out = DMatrix::zeros(cluster.a.nrows(), k * trials.len());
        if let Some(t) = trials.iter().position(|t| *t == cluster.trial) {
            for (j, part) in parts.iter().enumerate() {
                out.set_column(k * t + j, &part[g].column(0));
            }
        }
        out
    };
    problem.clusters.iter().enumerate().map(of_cluster).collect()
}

/// Normal equations of one change for each trial.
struct Division {
    trials: usize,
    /// Unknowns of one change; the first one is the mass.
    unknowns: usize,
    s: DMatrix<f64>,
    c: DVector<f64>,
}

impl Division {
    fn new(session: &Session<'_>, problem: &Problem, variant: &Variant<'_>, trials: &[usize]) -> Option<Self> {
        let columns = variant.columns(session, problem)?;
        let place = variant.effect.nonlinear(session.scene, variant.target);
        let mut parts = vec![columns];
        for (i, _) in place.iter().enumerate().filter(|(_, p)| matches!(p.kind, ParameterKind::PointOnLink(_))) {
            let at = |step: f64| {
                let mut p = variant.nonlinear.clone();
                p[i] += step;
                variant.columns_at(session, problem, &p)
            };
            let (ahead, behind) = (at(STEP_M)?, at(-STEP_M)?);
            parts.push(ahead.iter().zip(&behind).map(|(a, b)| (a - b) / (2.0 * STEP_M)).collect());
        }
        let k = parts.len();
        let (s, c) = problem.reduce_all(&by_trial(problem, &parts, trials));
        Some(Self { trials: trials.len(), unknowns: k, s, c })
    }

    /// Gain of one common change in these trials, and its mass.
    fn gain(&self, acts: &[bool]) -> (f64, f64) {
        let k = self.unknowns;
        let mut s = DMatrix::zeros(k, k);
        let mut c = DVector::zeros(k);
        let of: Vec<usize> = (0..self.trials).filter(|&t| acts[t]).collect();
        for &i in &of {
            c += self.c.rows(k * i, k);
            for &j in &of {
                s += self.s.view((k * i, k * j), (k, k));
            }
        }
        let x = pseudo_inverse(&s) * &c;
        (c.dot(&x), x[0])
    }

    fn is_allowed(&self, acts: &[bool]) -> bool {
        let with = acts.iter().filter(|a| **a).count();
        with >= FEWEST && self.trials - with >= FEWEST
    }

    /// The better of two divisions: the larger gain, among equal ones that with a load (and not
    /// with something taken away).
    fn better(&self, a: Option<Vec<bool>>, b: Vec<bool>) -> Option<Vec<bool>> {
        let Some(a) = a else { return Some(b) };
        let ((ga, ma), (gb, mb)) = (self.gain(&a), self.gain(&b));
        let equal = (ga - gb).abs() <= 1e-6 * ga.abs().max(gb.abs());
        let takes_over = if equal { ma <= 0.0 && mb > 0.0 } else { gb > ga };
        Some(if takes_over { b } else { a })
    }

    fn best_of_all(&self) -> Option<Vec<bool>> {
        (1..(1usize << self.trials) - 1)
            .map(|bits| (0..self.trials).map(|t| bits >> t & 1 == 1).collect::<Vec<bool>>())
            .filter(|acts| self.is_allowed(acts))
            .fold(None, |best, acts| self.better(best, acts))
    }

    /// The division in which the trials that are `told` act or do not, and the others act where
    /// that gains.
    fn best_with(&self, told: &[Option<bool>]) -> Vec<bool> {
        let mut acts: Vec<bool> = told.iter().map(|t| t.unwrap_or(false)).collect();
        for t in (0..self.trials).filter(|&t| told[t].is_none()) {
            let mut with = acts.clone();
            with[t] = true;
            if self.gain(&with).0 > self.gain(&acts).0 {
                acts = with;
            }
        }
        acts
    }

    /// Starts with the largest gaps between the changes of single trials, one for each unknown, and
    /// moves single trials while that helps.
    fn best_by_moves(&self) -> Option<Vec<bool>> {
        let k = self.unknowns;
        let single = pseudo_inverse(&self.s) * &self.c;
        let mut best = None;
        for j in 0..k {
            let size = |t: usize| single[k * t + j];
            let mut order: Vec<usize> = (0..self.trials).collect();
            order.sort_by(|&a, &b| size(a).total_cmp(&size(b)));
            let gap = |i: usize| size(order[i]) - size(order[i - 1]);
            let Some(cut) = (FEWEST..=self.trials - FEWEST).max_by(|&a, &b| gap(a).total_cmp(&gap(b))) else {
                continue;
            };
            let mut acts = vec![false; self.trials];
            order[cut..].iter().for_each(|&t| acts[t] = true);
            let mut reached = self.gain(&acts).0;
            while let Some((t, gain)) = (0..self.trials)
                .filter_map(|t| {
                    let mut moved = acts.clone();
                    moved[t] = !moved[t];
                    self.is_allowed(&moved).then(|| (t, self.gain(&moved).0))
                })
                .max_by(|a, b| a.1.total_cmp(&b.1))
                .filter(|m| m.1 > reached * (1.0 + 1e-9))
            {
                acts[t] = !acts[t];
                reached = gain;
            }
            best = self.better(best, acts.clone());
            best = self.better(best, acts.iter().map(|a| !a).collect());
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Normal equations of trials with uncorrelated columns, in which one change acts in `truth`.
    fn division(truth: &[bool], change: [f64; 2]) -> Division {
        let trials = truth.len();
        let c = DVector::from_fn(2 * trials, |i, _| {
            // an error of a tenth that differs from trial to trial
            let size = if truth[i / 2] { change[i % 2] } else { 0.0 };
            size + 0.1 * ((7 * i + 3) as f64).sin()
        });
        Division { trials, unknowns: 2, s: DMatrix::identity(2 * trials, 2 * trials), c }
    }

    #[test]
    fn the_loaded_trials_are_found_by_both_searches() {
        // a load whose first moment shows and whose mass hardly does
        for change in [[0.05, 1.0], [1.0, 0.0], [0.5, -0.5]] {
            let truth = [true, true, false, false, false, true, false];
            let d = division(&truth, change);
            assert_eq!(d.best_of_all().unwrap(), truth);
            assert_eq!(d.best_by_moves().unwrap(), truth);
        }
        let many: Vec<bool> = (0..14).map(|t| t % 3 == 0).collect();
        assert_eq!(division(&many, [0.2, 1.0]).best_by_moves().unwrap(), many);
    }

    #[test]
    fn the_heavier_of_two_clear_sets_are_found() {
        let masses = [0.61, 0.23, 0.49, 0.20, 0.53, 0.17, 0.48, 0.19, 5.0];
        let mut weights = [1.0 / 0.06_f64.powi(2); 9];
        // a trial that hardly determines its mass says nothing
        weights[8] = 1e-4;
        let found = heavier(&masses, &weights).unwrap();
        assert_eq!(found[..8], [true, false, true, false, true, false, true, false].map(Some));
        assert_eq!(found[8], None);
        // the same masses as far as their errors tell
        assert_eq!(heavier(&masses, &weights.map(|w| w / 16.0)), None);
        // evenly spread
        assert_eq!(heavier(&[0.1, 0.2, 0.3, 0.4, 0.5, 0.6], &[1e4; 6]), None);
        // one trial apart from the others
        assert_eq!(heavier(&[0.1, 0.11, 0.12, 0.1, 0.9], &[1e4; 5]), None);
        assert_eq!(heavier(&[], &[]), None);
    }

    #[test]
    fn trials_that_the_plates_do_not_tell_are_divided_by_the_flights() {
        let truth = [true, true, false, false, false, true, false];
        let d = division(&truth, [0.5, 1.0]);
        let told = [Some(true), None, Some(false), Some(false), None, Some(true), Some(false)];
        assert_eq!(d.best_with(&told), truth);
        // what the plates tell stands
        assert_eq!(d.best_with(&truth.map(|t| Some(!t))), truth.map(|t| !t));
    }

    #[test]
    fn each_set_has_two_trials() {
        let d = division(&[true, false, false, false, false], [1.0, 1.0]);
        for acts in [d.best_of_all().unwrap(), d.best_by_moves().unwrap()] {
            assert!((2..=3).contains(&acts.iter().filter(|a| **a).count()), "{acts:?}");
        }
    }
}
