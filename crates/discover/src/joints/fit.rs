//! Held-out errors of the laws of one joint, and what flipped signs make of them.

use aloft_effects::{Coefficient, EffectInstance, Scene};
use aloft_robot::joint_evidence::ReducedFold;
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// One law at fixed nonlinear parameters: its columns among the candidates'.
pub(super) struct Variant<'a> {
    pub choice: EffectInstance<'a>,
    pub coefficients: Vec<Coefficient>,
    pub first: usize,
}

/// Places the columns of choices one after the other.
pub(super) fn variants<'a>(scene: &Scene, choices: &[EffectInstance<'a>]) -> Vec<Variant<'a>> {
    let mut first = 0;
    choices
        .iter()
        .map(|choice| {
            let coefficients = choice.effect.coefficients(scene, choice.target);
            let own = first;
            first += coefficients.len();
            Variant { choice: choice.clone(), coefficients, first: own }
        })
        .collect()
}

/// A law, fitted: the variant that the rest likes best in each fold.
pub(super) struct Scored {
    /// Squares of what each fold leaves.
    pub fold_error: Vec<f64>,
    /// Index of the variant chosen by all flights.
    pub best: usize,
    /// Coefficients from all flights.
    pub theta: DVector<f64>,
    /// Coefficients of every variant from all flights.
    pub thetas: Vec<DVector<f64>>,
    /// Coefficients without each flight, at the variant chosen by all.
    pub fold_theta: Vec<DVector<f64>>,
    /// Gain of each variant without each flight, for the interval of a nonlinear parameter.
    pub gains: Vec<Vec<f64>>,
}

/// Coefficients within their bounds, and the fall of the squares that they bring.
fn fitted(s: &DMatrix<f64>, t: &DVector<f64>, bounds: &[Coefficient]) -> (DVector<f64>, f64) {
    let k = t.len();
    let mut fixed: Vec<Option<f64>> = vec![None; k];
    for _ in 0..=k {
        let free: Vec<usize> = (0..k).filter(|&i| fixed[i].is_none()).collect();
        let mut theta = DVector::from_iterator(k, fixed.iter().map(|f| f.unwrap_or(0.0)));
        if !free.is_empty() {
            let matrix = DMatrix::from_fn(free.len(), free.len(), |i, j| s[(free[i], free[j])]);
            let given = s * &theta;
            let right = DVector::from_fn(free.len(), |i, _| t[free[i]] - given[free[i]]);
            // columns that body and joint explain leave no information
            let Some(solved) = solvable(&matrix).and_then(|_| matrix.cholesky().map(|c| c.solve(&right))) else {
                return (DVector::zeros(k), 0.0);
            };
            free.iter().enumerate().for_each(|(i, &at)| theta[at] = solved[i]);
        }
        let outside = free.iter().find(|&&i| theta[i] < bounds[i].lower || theta[i] > bounds[i].upper);
        match outside {
            Some(&i) => fixed[i] = Some(theta[i].clamp(bounds[i].lower, bounds[i].upper)),
            None => {
                let gain = 2.0 * theta.dot(t) - (theta.transpose() * s * &theta)[0];
                return (theta, gain.max(0.0));
            }
        }
    }
    (DVector::zeros(k), 0.0)
}

fn solvable(matrix: &DMatrix<f64>) -> Option<()> {
    let d = matrix.diagonal();
    if d.iter().any(|x| !(x.is_finite() && *x > 0.0)) {
        return None;
    }
    // correlations of one: two columns say the same
    let n = matrix.nrows();
    let same = (0..n).any(|i| (0..i).any(|j| matrix[(i, j)].powi(2) > (1.0 - 1e-9) * d[i] * d[j]));
    (!same).then_some(())
}

fn part(fold: &ReducedFold, v: &Variant<'_>) -> (DMatrix<f64>, DVector<f64>) {
    let k = v.coefficients.len();
    (fold.s.view((v.first, v.first), (k, k)).into_owned(), fold.t.rows(v.first, k).into_owned())
}

/// Scores a law: `of` are its variants. The last fold leaves nothing out.
pub(super) fn score(folds: &[ReducedFold], all: &[Variant<'_>], of: &[usize]) -> Option<Scored> {
    let (whole, folds) = folds.split_last()?;
    let best_of = |fold: &ReducedFold| {
        let fits: Vec<(DVector<f64>, f64)> = of
            .iter()
            .map(|&i| {
                let (s, t) = part(fold, &all[i]);
                fitted(&s, &t, &all[i].coefficients)
            })
            .collect();
        let best = (0..of.len()).max_by(|&a, &b| fits[a].1.total_cmp(&fits[b].1).then(b.cmp(&a)))?;
        Some((best, fits))
    };
    let (best, fits) = best_of(whole)?;
    let mut out = Scored {
        fold_error: Vec::new(),
        best: of[best],
        theta: fits[best].0.clone(),
        thetas: fits.iter().map(|f| f.0.clone()).collect(),
        fold_theta: Vec::new(),
        gains: Vec::new(),
    };
    for fold in folds {
        let (chosen, fits) = best_of(fold)?;
        let v = &all[of[chosen]];
        let left = &fold.residual - fold.columns.columns(v.first, v.coefficients.len()) * &fits[chosen].0;
        out.fold_error.push(left.norm_squared());
        out.fold_theta.push(fits[best].0.clone());
        out.gains.push(fits.iter().map(|f| f.1).collect());
    }
    Some(out)
}

/// Squares of what each fold leaves without any law.
pub(super) fn plain(folds: &[ReducedFold]) -> Vec<f64> {
    folds.split_last().map_or(Vec::new(), |(_, folds)| folds.iter().map(|f| f.residual.norm_squared()).collect())
}

/// Best ratio over all laws, in each draw of flipped signs of the clusters' residuals.
pub(super) fn null_ratios(
    folds: &[ReducedFold],
    all: &[Variant<'_>],
    laws: &[Vec<usize>],
    draws: usize,
    seed: u64,
) -> Vec<f64> {
    let Some((_, folds)) = folds.split_last() else { return Vec::new() };
    let n = folds.len();
    // the information is the same in every draw
    let informed: Vec<Vec<DMatrix<f64>>> = folds.iter().map(|f| all.iter().map(|v| part(f, v).0).collect()).collect();
    (0..draws)
        .map(|draw| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(draw as u64);
            let signs = DVector::from_fn(n, |_, _| if rng.random_bool(0.5) { 1.0 } else { -1.0 });
            let mut without = 0.0;
            let mut with = vec![0.0; laws.len()];
            for (fold, informed) in folds.iter().zip(&informed) {
                let residual = &fold.null_residual * &signs;
                let t = &fold.null_t * &signs;
                without += residual.norm_squared();
                for (of, with) in laws.iter().zip(&mut with) {
                    let fits = of.iter().map(|&i| {
                        let v = &all[i];
                        let own = t.rows(v.first, v.coefficients.len()).into_owned();
                        (i, fitted(&informed[i], &own, &v.coefficients))
                    });
                    let best = fits.reduce(|a, b| if b.1.1 > a.1.1 { b } else { a });
                    *with += match best {
                        Some((i, (theta, _))) => {
                            let v = &all[i];
                            (&residual - fold.columns.columns(v.first, v.coefficients.len()) * theta).norm_squared()
                        }
                        None => residual.norm_squared(),
                    };
                }
            }
            with.into_iter().map(|w| (w / without).sqrt()).fold(f64::INFINITY, f64::min)
        })
        .collect()
}
