//! Coefficients of two effects of which the rows determine a combination only.
//!
//! A wheel on one link and a wheel on the next, both along the hinge between them, do the same: of
//! their momenta only the sum acts. Columns are formed from differentiated motion and are exact to
//! about a percent, so that columns which differ by less still seem to determine both, with
//! opposite values of any size and narrow intervals. Such coefficients are given no interval.

use aloft_regressor::Factor;
use nalgebra::DVector;

/// Length of a combination of unit columns, beside the body's parameters, below which it counts as
/// zero.
const TOO_ALIKE: f64 = 0.03;
/// Share of a combination from which a coefficient counts as one of its main parts.
const MAIN: f64 = 0.3;
/// Share from which it takes part in it.
const TAKES_PART: f64 = 0.01;
/// Number of standard errors by which a coefficient has to depend on a combination.
const DEPENDS: f64 = 2.0;

/// For every effect column of merged rows, whether its coefficient depends on a combination of two
/// effects or more that does nearly nothing: without it, the coefficient (`theta`) would change by
/// more than its interval. `se` are the standard errors.
pub(crate) fn alike(merged: &Factor, theta: &DVector<f64>, se: &[f64]) -> Vec<bool> {
    let (p, k) = (merged.n_parameters(), merged.n_effects());
    let mut out = vec![false; k];
    let dense = merged.dense();
    if k < 2 || dense.nrows() < p + k {
        return out;
    }
    // in a triangle the rows below those of the body are what the body leaves of the columns
    let mut left = dense.view((p, p), (dense.nrows() - p, k)).into_owned();
    let norms: Vec<f64> = left.column_iter().map(|c| c.norm().max(f64::MIN_POSITIVE)).collect();
    for (mut column, norm) in left.column_iter_mut().zip(&norms) {
        column /= *norm;
    }
    let scaled = DVector::from_fn(k, |i, _| theta[i] * norms[i]);
    let decomposed = left.tr_mul(&left).symmetric_eigen();
    let effect = |i: usize| merged.columns.effects[i].rsplit_once('.').map_or("", |(key, _)| key);
    for (value, direction) in decomposed.eigenvalues.iter().zip(decomposed.eigenvectors.column_iter()) {
        let main: Vec<usize> = (0..k).filter(|i| direction[*i].abs() > MAIN).collect();
        let several = main.iter().any(|i| effect(*i) != effect(main[0]));
        if *value < TOO_ALIKE * TOO_ALIKE && several {
            let along = direction.dot(&scaled);
            let depends = |i: &usize| (direction[*i] * along / norms[*i]).abs() > DEPENDS * se[*i];
            (0..k).filter(|i| direction[*i].abs() > TAKES_PART).filter(depends).for_each(|i| out[i] = true);
        }
    }
    out
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;
    use aloft_regressor::{Columns, RowKind, Stretch};
    use faer::Mat;

    /// Rows with one parameter of the body, two columns of one effect and one of another, which is
    /// the first of them but for `difference`.
    fn rows(difference: f64) -> Factor {
        let wave = |k: usize, r: usize| (0.37 * (k + 1) as f64 * r as f64 + k as f64).sin();
        let rows = Mat::from_fn(60, 5, |r, c| match c {
            3 => wave(1, r) + difference * wave(3, r),
            _ => wave(c, r),
        });
        let names = ["wheel[a].x", "wheel[a].y", "wheel[b].x"].map(str::to_owned);
        let columns = Columns { parameters: vec!["M".to_owned()], effects: names.to_vec(), of_tables: Vec::new() };
        let stretch = Stretch::contact("throw", 0, 0, 60);
        Factor::from_rows(&stretch, RowKind::Weak, columns, rows.as_ref()).unwrap()
    }

    #[test]
    fn effects_that_do_the_same_are_determined_together_only() {
        let opposite = DVector::from_column_slice(&[0.1, 0.002, -0.1]);
        let se = [0.003, 0.001, 0.003];
        assert_eq!(alike(&rows(0.007), &opposite, &se), [true, false, true]);
        assert_eq!(alike(&rows(0.2), &opposite, &se), [false; 3]);
        // a wide interval says the same
        assert_eq!(alike(&rows(0.007), &opposite, &[0.1; 3]), [false; 3]);
    }
}
