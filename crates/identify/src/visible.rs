//! Determines which effect coefficients the rows can identify, before any estimation.
//!
//! A column that is zero (plates in flights, a locked hinge), or that is a combination of the
//! body's own columns and of the effects before it, has no identifiable coefficient: every value
//! fits equally well. Such a column must be left out of elimination. A triangular factorisation
//! without pivoting uses up a row on it, and with the row evidence about all columns after it.
//! [`Visible::of`] finds these columns by orthogonalisation in the order of the model; estimators
//! use the others, and the coefficients left out are reported as not determined, with the reason.

use crate::{EffectEstimate, IdentifyError};
use aloft_regressor::{Factor, RepeatedErrors};
use nalgebra::{DMatrix, DVector};

/// A column whose part outside the span of the columns before it is below this share of its length
/// counts as dependent on them. Rounding error is 1e-12 or less; columns of effects that rows can
/// distinguish in the presence of any noise differ by 1e-4 and more.
const DEPENDENT: f64 = 1e-8;
/// The same among the body's own columns: rounding error only.
const BODY: f64 = 1e-10;
/// A column shorter than this share of the longest one counts as zero.
const ZERO: f64 = 1e-12;
/// Largest number of columns named for a dependent column.
const NAMED: usize = 3;

/// Why a coefficient is not determined.
#[derive(Debug, Clone, PartialEq)]
pub enum Unseen {
    /// Its column is zero in all rows.
    Zero,
    /// Its column repeats earlier effects of the model (possibly combined with some of the body's
    /// parameters): names of their coefficients.
    Repeats(Vec<String>),
    /// Its column is a combination of the body's own columns: names of the parameters with the
    /// largest share.
    Body(Vec<String>),
    /// There are no more rows than the body's own parameters, and there is no prior.
    TooFewRows,
}

impl Unseen {
    /// Text that follows "not determined:".
    pub fn describe(&self) -> String {
        let quoted = |names: &[String]| names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ");
        match self {
            Self::Zero => "it has no effect on these recordings (its column is zero in every row)".to_owned(),
            Self::Repeats(names) => format!("it does the same as {}, which the model holds already", quoted(names)),
            Self::Body(names) => {
                format!("its column is a combination of the body's own parameters ({})", quoted(names))
            }
            Self::TooFewRows => "there are no more rows than parameters of the body".to_owned(),
        }
    }
}

/// The effect columns of merged rows, split into those that the rows determine and the others.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Visible {
    n_parameters: usize,
    names: Vec<String>,
    unseen: Vec<Option<Unseen>>,
}

impl Visible {
    /// Tests every effect column against the body's columns (without the mass, which is known) and
    /// the determined effects before it. With as few rows as parameters every column looks like a
    /// combination of the body's columns; if a prior separates them (`has_prior`), only zero
    /// columns and repeated effects are left out in that case. Effects that change what tables say
    /// of the body are combinations of its columns in every recording; a prior from tables
    /// separates them, and they are compared only with each other.
    pub fn of(merged: &Factor, has_prior: bool) -> Self {
        let (p, k) = (merged.n_parameters(), merged.n_effects());
        let names = merged.columns.effects.clone();
        if k == 0 {
            return Self { n_parameters: p, names, unseen: Vec::new() };
        }
        let dense = merged.dense();
        let longest = (0..dense.ncols()).map(|j| dense.column(j).norm()).fold(0.0, f64::max);
        let mut span = Span::new(dense.nrows(), p + k);
        for j in 1..p {
            span.add(j, dense.column(j).into_owned(), ZERO * longest, BODY);
        }
        let saturated = span.len() >= dense.nrows();
        if saturated && has_prior {
            span = Span::new(dense.nrows(), p + k);
        }
        let mut of_tables = Span::new(dense.nrows(), k);
        let unseen = (0..k)
            .map(|e| {
                let column = dense.column(p + e).into_owned();
                if has_prior && merged.columns.of_tables.contains(&names[e]) {
                    return match of_tables.add(p + e, column, ZERO * longest, DEPENDENT) {
                        Added::Independent => None,
                        Added::Zero => Some(Unseen::Zero),
                        Added::Dependent(partners) => Some(named(merged, partners)),
                    };
                }
                match span.add(p + e, column, ZERO * longest, DEPENDENT) {
                    Added::Independent => None,
                    Added::Zero => Some(Unseen::Zero),
                    Added::Dependent(_) if saturated && !has_prior => Some(Unseen::TooFewRows),
                    Added::Dependent(partners) => Some(named(merged, partners)),
                }
            })
            .collect();
        Self { n_parameters: p, names, unseen }
    }

    /// [`Visible::of`] for factors that are not merged yet.
    ///
    /// # Errors
    /// [`IdentifyError::Regressor`] when they cannot be merged.
    pub fn among(factors: &[Factor], has_prior: bool) -> Result<Self, IdentifyError> {
        if factors.iter().all(|f| f.n_effects() == 0) {
            return Ok(Self::default());
        }
        Ok(Self::of(&Factor::merge(factors)?, has_prior))
    }

    /// True when every effect column is determined.
    pub fn all(&self) -> bool {
        self.unseen.iter().all(Option::is_none)
    }

    /// Reason why the coefficient of effect column `k` is not determined; none if it is.
    pub fn why(&self, k: usize) -> Option<&Unseen> {
        self.unseen.get(k).and_then(Option::as_ref)
    }

    /// Names of the coefficients that are not determined, with the reason.
    pub fn unseen(&self) -> impl Iterator<Item = (&str, &Unseen)> {
        self.names.iter().zip(&self.unseen).filter_map(|(n, u)| u.as_ref().map(|u| (n.as_str(), u)))
    }

    /// A factor with the same columns, without those that are not determined.
    ///
    /// # Errors
    /// [`IdentifyError::Regressor`] for a factor with other columns.
    pub fn reduce(&self, factor: &Factor) -> Result<Factor, IdentifyError> {
        if self.all() {
            return Ok(factor.clone());
        }
        let kept: Vec<&str> =
            self.names.iter().zip(&self.unseen).filter(|(_, u)| u.is_none()).map(|(n, _)| n.as_str()).collect();
        Ok(factor.with_effects(&kept)?)
    }

    /// [`Visible::reduce`] for several factors.
    ///
    /// # Errors
    /// As [`Visible::reduce`].
    pub fn reduce_all(&self, factors: &[Factor]) -> Result<Vec<Factor>, IdentifyError> {
        factors.iter().map(|f| self.reduce(f)).collect()
    }

    /// Errors of the reduced rows.
    pub(crate) fn reduce_errors(&self, errors: &RepeatedErrors) -> RepeatedErrors {
        let mut out = errors.clone();
        if !self.all() {
            let places: Vec<usize> = self.places().collect();
            out.markers = out.markers.select_rows(&places);
            out.geometry = out.geometry.select_rows(&places);
        }
        out
    }

    /// Parameters and coefficients of the reduced rows at their places among all columns; zero for
    /// undetermined ones, which does not change predictions of these rows.
    pub fn whole(&self, reduced: DVector<f64>) -> DVector<f64> {
        if self.all() {
            return reduced;
        }
        let mut out = DVector::zeros(self.n_parameters + self.names.len());
        for (value, place) in reduced.iter().zip(self.places()) {
            out[place] = *value;
        }
        out
    }

    /// The same for a covariance.
    pub(crate) fn whole_covariance(&self, reduced: DMatrix<f64>) -> DMatrix<f64> {
        if self.all() {
            return reduced;
        }
        let n = self.n_parameters + self.names.len();
        let places: Vec<usize> = self.places().collect();
        let mut out = DMatrix::zeros(n, n);
        for (i, a) in places.iter().enumerate() {
            for (j, b) in places.iter().enumerate() {
                out[(*a, *b)] = reduced[(i, j)];
            }
        }
        out
    }

    /// Estimates of all coefficients in the order of the columns, from those of the reduced rows.
    pub(crate) fn estimates(&self, reduced: Vec<EffectEstimate>) -> Vec<EffectEstimate> {
        let mut found = reduced.into_iter();
        let of = |(name, unseen): (&String, &Option<Unseen>)| match unseen {
            None => found.next(),
            Some(why) => Some(EffectEstimate::not_determined(name, why.describe())),
        };
        self.names.iter().zip(&self.unseen).filter_map(of).collect()
    }

    /// Indices of the reduced columns among all columns.
    fn places(&self) -> impl Iterator<Item = usize> + '_ {
        let kept = self.unseen.iter().enumerate().filter(|(_, u)| u.is_none()).map(|(k, _)| self.n_parameters + k);
        (0..self.n_parameters).chain(kept)
    }
}

/// Names effects first; the body's parameters if no effect is involved.
fn named(merged: &Factor, mut partners: Vec<(usize, f64)>) -> Unseen {
    partners.sort_by(|a, b| b.1.total_cmp(&a.1));
    let largest = partners.first().map_or(0.0, |p| p.1);
    partners.retain(|p| p.1 > 1e-3 * largest);
    let p = merged.n_parameters();
    let effects: Vec<String> = partners
        .iter()
        .filter_map(|(j, _)| j.checked_sub(p).and_then(|e| merged.columns.effects.get(e)).cloned())
        .take(NAMED)
        .collect();
    if !effects.is_empty() {
        return Unseen::Repeats(effects);
    }
    let body = partners.iter().filter_map(|(j, _)| merged.columns.parameters.get(*j)).take(NAMED).cloned();
    Unseen::Body(body.collect())
}

/// Columns orthogonalised one by one (Gram-Schmidt, each column twice).
struct Span {
    /// Orthonormal columns.
    basis: DMatrix<f64>,
    /// Column `i` of unit length in terms of the basis.
    triangle: DMatrix<f64>,
    /// Column that each basis vector comes from.
    from: Vec<usize>,
}

enum Added {
    Independent,
    Zero,
    /// The columns that it depends on, with their shares.
    Dependent(Vec<(usize, f64)>),
}

impl Span {
    fn new(rows: usize, most: usize) -> Self {
        let width = rows.min(most);
        Self { basis: DMatrix::zeros(rows, width), triangle: DMatrix::zeros(width, width), from: Vec::new() }
    }

    fn len(&self) -> usize {
        self.from.len()
    }

    fn add(&mut self, index: usize, mut column: DVector<f64>, zero: f64, dependent: f64) -> Added {
        let norm = column.norm();
        if norm <= zero {
            return Added::Zero;
        }
        column /= norm;
        let n = self.len();
        let basis = self.basis.columns(0, n);
        let mut along = DVector::zeros(n);
        for _ in 0..2 {
            let part = basis.tr_mul(&column);
            column.gemv(-1.0, &basis, &part, 1.0);
            along += part;
        }
        let rest = column.norm();
        if rest < dependent || n >= self.basis.ncols() {
            let triangle = self.triangle.view((0, 0), (n, n));
            // columns of the span are independent by construction, so the triangle is invertible
            let shares = triangle.solve_upper_triangular(&along).unwrap_or(along);
            return Added::Dependent(self.from.iter().copied().zip(shares.iter().map(|s| s.abs())).collect());
        }
        self.basis.set_column(n, &(column / rest));
        self.triangle.view_mut((0, n), (n, 1)).copy_from(&along);
        self.triangle[(n, n)] = rest;
        self.from.push(index);
        Added::Independent
    }
}
