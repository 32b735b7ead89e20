//! The data structure shared by all estimators: one small upper triangle per flight or contact
//! phase.
//!
//! Rows read `Y φ_B − E θ = w`, with base parameters φ_B, effect coefficients θ and measured wrench
//! w. A factor is the R of a QR factorisation of `[Y | −E | w]`, so that `‖Y φ_B − E θ − w‖ = ‖R
//! [φ_B; θ; −1]‖` for every φ_B and θ: all estimates, comparisons of effects, and resampling use R
//! and never need the frames again. Factors of many flights stack: the R of stacked R's is the R of
//! all rows. Diagonals are made non-negative, which makes R unique if the rows have full rank, for
//! any order of merging.
//!
//! The rows are computed from measured motion, so the matrix has errors, not only the right-hand
//! side. Beside R a factor therefore carries a second triangle T with `TᵀT = E[ΔAᵀΔA]`, the errors
//! ΔA of `[Y | −E | w]` in the same weights ([`mod@crate::matrix_noise`]). It stacks, scales and
//! picks columns like R.

use crate::triangle::Triangle;
use crate::{RegressorError, Stretch, StretchKind};
use faer::{Mat, MatRef};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Origin of a factor's rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RowKind {
    /// Six rows per frame from accelerations (the paper).
    Acceleration,
    /// Six rows per window from momentum and first moment.
    Weak,
    /// Rows of a prior.
    Prior,
}

/// Names of a factor's columns.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Columns {
    /// Base parameters, in the order of [`aloft_body::BaseParameters`].
    pub parameters: Vec<String>,
    /// Effects.
    pub effects: Vec<String>,
    /// Those of the effects that change what tables say of the body ([`EffectColumns::of_tables`]).
    ///
    /// [`EffectColumns::of_tables`]: crate::EffectColumns::of_tables
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub of_tables: Vec<String>,
}

impl Columns {
    /// Number of all columns, including the measured one.
    pub fn len(&self) -> usize {
        self.parameters.len() + self.effects.len() + 1
    }
    /// Always false: the measured column is always present.
    pub fn is_empty(&self) -> bool {
        false
    }
    fn describe(&self) -> String {
        format!("{} parameters and the effects [{}]", self.parameters.len(), self.effects.join(", "))
    }
}

/// Upper trapezoid of one stretch, or of many merged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "StoredFactor")]
pub struct Factor {
    /// Trial; `merged` after merging several trials.
    pub trial: String,
    /// Index of the stretch in its trial (0 after merging).
    pub stretch: usize,
    /// Kind of the stretch.
    pub kind: StretchKind,
    /// How the rows were formed.
    pub rows: RowKind,
    /// Columns.
    pub columns: Columns,
    /// Number of rows before factorisation.
    pub n_rows: usize,
    /// Packed row by row: row `i` holds the columns `i ..`.
    packed: Vec<f64>,
    /// The triangle T of the errors of the rows, with the same columns; none where they were not
    /// computed.
    noise: Option<Box<Factor>>,
}

/// A factor read from a file, before its length is checked.
#[derive(Deserialize)]
struct StoredFactor {
    trial: String,
    stretch: usize,
    kind: StretchKind,
    rows: RowKind,
    columns: Columns,
    n_rows: usize,
    packed: Vec<f64>,
    #[serde(default)]
    noise: Option<Box<Factor>>,
}

impl TryFrom<StoredFactor> for Factor {
    type Error = RegressorError;
    fn try_from(stored: StoredFactor) -> Result<Self, RegressorError> {
        let StoredFactor { trial, stretch: index, kind, rows, columns, n_rows, packed, noise } = stored;
        let stretch = Stretch { trial, index, kind, first_frame: 0, end_frame: 0 };
        let factor = Self::from_values(&stretch, rows, columns, n_rows, packed)?;
        match noise {
            Some(noise) => factor.with_noise(*noise),
            None => Ok(factor),
        }
    }
}

impl Factor {
    /// Factor of dense rows `[Y | −E | w]`.
    ///
    /// # Errors
    /// [`RegressorError::Numeric`] if a row is not finite, [`RegressorError::Length`] if columns do
    /// not fit.
    pub fn from_rows(
        stretch: &Stretch,
        rows: RowKind,
        columns: Columns,
        matrix: MatRef<'_, f64>,
    ) -> Result<Self, RegressorError> {
        if matrix.ncols() != columns.len() {
            return Err(RegressorError::Length {
                trial: stretch.trial.clone(),
                what: "columns of the rows",
                expected: columns.len(),
                found: matrix.ncols(),
            });
        }
        let mut factor = Self {
            trial: stretch.trial.clone(),
            stretch: stretch.index,
            kind: stretch.kind,
            rows,
            columns,
            n_rows: matrix.nrows(),
            packed: Vec::new(),
            noise: None,
        };
        factor.packed = packed_triangle(matrix);
        if factor.packed.iter().any(|x| !x.is_finite()) {
            return Err(RegressorError::Numeric {
                trial: factor.trial,
                stretch: factor.stretch,
                problem: "a row holds a number that is not finite".to_owned(),
            });
        }
        Ok(factor)
    }

    /// As many rows with the same names and columns whose Gram is that of `matrix`, without their
    /// noise: what a correction leaves of this factor.
    ///
    /// # Errors
    /// As [`Factor::from_rows`]; [`RegressorError::Length`] for more rows of `matrix` than this
    /// factor holds.
    pub fn corrected(&self, matrix: MatRef<'_, f64>) -> Result<Self, RegressorError> {
        if matrix.nrows() > self.height() {
            return Err(RegressorError::Length {
                trial: self.trial.clone(),
                what: "rows of a corrected factor",
                expected: self.height(),
                found: matrix.nrows(),
            });
        }
        let padded =
            Mat::from_fn(self.height(), matrix.ncols(), |i, j| if i < matrix.nrows() { matrix[(i, j)] } else { 0.0 });
        let same = Self::from_rows(&self.as_stretch(), self.rows, self.columns.clone(), padded.as_ref())?;
        Ok(Self { n_rows: self.n_rows, ..same })
    }

    /// A factor from its parts, as stored by a cache: `values` is the result of [`Factor::values`].
    ///
    /// # Errors
    /// [`RegressorError::Length`] if the number of values is not that of an upper trapezoid.
    pub fn from_values(
        stretch: &Stretch,
        rows: RowKind,
        columns: Columns,
        n_rows: usize,
        values: Vec<f64>,
    ) -> Result<Self, RegressorError> {
        let n = columns.len();
        let kept = n_rows.min(n);
        let expected = kept * n - kept * kept.saturating_sub(1) / 2;
        if values.len() != expected {
            return Err(RegressorError::Length {
                trial: stretch.trial.clone(),
                what: "values of a factor",
                expected,
                found: values.len(),
            });
        }
        let (trial, index, kind) = (stretch.trial.clone(), stretch.index, stretch.kind);
        Ok(Self { trial, stretch: index, kind, rows, columns, n_rows, packed: values, noise: None })
    }

    /// The same factor with the triangle T of the errors of its rows.
    ///
    /// # Errors
    /// [`RegressorError::Columns`] if the errors have other columns than the rows.
    pub fn with_noise(mut self, noise: Self) -> Result<Self, RegressorError> {
        self.check_names(&noise)?;
        self.noise = Some(Box::new(noise));
        Ok(self)
    }

    /// The triangle T of the errors of the rows, `TᵀT = E[ΔAᵀΔA]`, as a factor of its own; none if
    /// they were not computed.
    pub fn noise(&self) -> Option<&Self> {
        self.noise.as_deref()
    }

    /// The upper trapezoid packed row by row: row `i` from column `i` on; `min(n_rows, columns)`
    /// rows.
    pub fn values(&self) -> &[f64] {
        &self.packed
    }

    /// Number of rows of the trapezoid: `min(n_rows, columns)`.
    pub fn height(&self) -> usize {
        self.n_rows.min(self.columns.len())
    }

    /// Number of base parameters.
    pub fn n_parameters(&self) -> usize {
        self.columns.parameters.len()
    }

    /// Number of effect columns.
    pub fn n_effects(&self) -> usize {
        self.columns.effects.len()
    }

    /// The trapezoid as a dense matrix, zeros below the diagonal.
    pub fn dense(&self) -> DMatrix<f64> {
        let n = self.columns.len();
        let mut out = DMatrix::zeros(self.height(), n);
        for (i, row) in self.packed_rows().enumerate() {
            for (j, value) in row.iter().enumerate() {
                out[(i, i + j)] = *value;
            }
        }
        out
    }

    /// The stretch of this factor (frames are not stored).
    pub fn as_stretch(&self) -> Stretch {
        Stretch { trial: self.trial.clone(), index: self.stretch, kind: self.kind, first_frame: 0, end_frame: 0 }
    }

    /// Sum of squares of `A x − w` over all rows, with x = [φ_B; θ].
    pub fn sum_of_squares(&self, x: &DVector<f64>) -> f64 {
        let m = x.len();
        self.packed_rows()
            .enumerate()
            .map(|(i, row)| {
                let fitted: f64 = row.iter().zip(i..m).map(|(r, j)| r * x[j]).sum();
                let residual = fitted - row[row.len() - 1];
                residual * residual
            })
            .sum()
    }

    /// All rows multiplied by a positive weight.
    pub fn scaled(&self, weight: f64) -> Self {
        let mut out = self.clone();
        out.packed.iter_mut().for_each(|x| *x *= weight);
        out.noise = self.noise.as_ref().map(|noise| Box::new(noise.scaled(weight)));
        out
    }

    /// The same rows with only some of the effect columns, in the given order.
    ///
    /// # Errors
    /// [`RegressorError::Columns`] for an effect that is not among the factor's columns.
    pub fn with_effects(&self, effects: &[&str]) -> Result<Self, RegressorError> {
        let p = self.n_parameters();
        let mut picked: Vec<usize> = (0..p).collect();
        for name in effects {
            match self.columns.effects.iter().position(|e| e == name) {
                Some(k) => picked.push(p + k),
                None => {
                    return Err(RegressorError::Columns {
                        trial: self.trial.clone(),
                        stretch: self.stretch,
                        expected: format!("the effect {name}"),
                        found: self.columns.describe(),
                    });
                }
            }
        }
        let last = self.columns.len() - 1;
        picked.push(last);
        let dense = self.dense();
        // the rows of the parameters' columns stay triangular; only those below are reduced again
        let above = p.min(dense.nrows());
        let mut packed: Vec<f64> =
            (0..above).flat_map(|i| picked[i..].iter().map(move |&j| (i, j))).map(|at| dense[at]).collect();
        let below = Mat::from_fn(dense.nrows() - above, picked.len() - p, |i, j| dense[(above + i, picked[p + j])]);
        packed.extend(packed_triangle(below.as_ref()));
        let columns = Columns {
            parameters: self.columns.parameters.clone(),
            effects: effects.iter().map(|&e| e.to_owned()).collect(),
            of_tables: self.columns.of_tables.iter().filter(|n| effects.contains(&n.as_str())).cloned().collect(),
        };
        let noise = self.noise.as_ref().map(|noise| noise.with_effects(effects).map(Box::new)).transpose()?;
        Ok(Self { trial: self.trial.clone(), columns, packed, noise, ..*self })
    }

    pub(crate) fn packed_rows(&self) -> impl Iterator<Item = &[f64]> {
        let n = self.columns.len();
        let mut rest = self.packed.as_slice();
        (0..self.height()).map(move |i| {
            let (row, tail) = rest.split_at(n - i);
            rest = tail;
            row
        })
    }

    /// Merges factors with the same columns over a binary tree that depends only on their order, so
    /// that the result is identical for any number of threads, and equal within rounding for any
    /// order.
    ///
    /// # Errors
    /// [`RegressorError::Empty`] without factors, [`RegressorError::Columns`] when columns differ.
    pub fn merge(factors: &[Self]) -> Result<Self, RegressorError> {
        let all: Vec<&Self> = factors.iter().collect();
        Self::merge_refs(&all)
    }

    /// [`Factor::merge`] for borrowed factors.
    ///
    /// # Errors
    /// As [`Factor::merge`].
    pub fn merge_refs(factors: &[&Self]) -> Result<Self, RegressorError> {
        let first = factors.first().ok_or(RegressorError::Empty)?;
        for factor in factors {
            first.check_columns(factor)?;
        }
        Ok(merge_tree(factors))
    }

    /// Adds one factor to another.
    ///
    /// # Errors
    /// [`RegressorError::Columns`] when columns differ.
    pub fn merged_with(&self, other: &Self) -> Result<Self, RegressorError> {
        self.check_columns(other)?;
        Ok(merge_pair(self, other))
    }

    /// Factors merge if they have the same columns, and all of them or none the errors of their
    /// rows: a stretch without them would count as free of noise.
    fn check_columns(&self, other: &Self) -> Result<(), RegressorError> {
        if self.noise.is_some() != other.noise.is_some() {
            let words = |f: &Self| if f.noise.is_some() { "rows with their noise" } else { "rows without their noise" };
            return Err(RegressorError::Columns {
                trial: other.trial.clone(),
                stretch: other.stretch,
                expected: words(self).to_owned(),
                found: words(other).to_owned(),
            });
        }
        self.check_names(other)
    }

    fn check_names(&self, other: &Self) -> Result<(), RegressorError> {
        if self.columns == other.columns {
            return Ok(());
        }
        Err(RegressorError::Columns {
            trial: other.trial.clone(),
            stretch: other.stretch,
            expected: self.columns.describe(),
            found: other.columns.describe(),
        })
    }
}

/// Calls `each(i, all but factor i)` for every factor, in parallel and without the original rows:
/// the factors before and after each one are merged only once (3 n merges in all).
///
/// # Errors
/// As [`Factor::merge`]; [`RegressorError::Empty`] for fewer than two factors.
pub fn leave_one_out<T: Send>(
    factors: &[Factor],
    each: impl Fn(usize, &Factor) -> T + Sync,
) -> Result<Vec<T>, RegressorError> {
    let groups: Vec<usize> = (0..factors.len()).collect();
    leave_group_out(factors, &groups, each)
}

/// As [`leave_one_out`], leaving out all factors of a group (a trial) at once: `group_of[i]` is the
/// number of factor `i`'s group, from zero; `each` is called once for every group that has factors,
/// in the order of group numbers.
///
/// # Errors
/// As [`Factor::merge`]; [`RegressorError::Empty`] for fewer than two groups.
pub fn leave_group_out<T: Send>(
    factors: &[Factor],
    group_of: &[usize],
    each: impl Fn(usize, &Factor) -> T + Sync,
) -> Result<Vec<T>, RegressorError> {
    let n_groups = group_of.iter().max().map_or(0, |g| g + 1);
    let members: Vec<(usize, Vec<&Factor>)> = (0..n_groups)
        .map(|g| (g, factors.iter().zip(group_of).filter(|(_, k)| **k == g).map(|(f, _)| f).collect::<Vec<_>>()))
        .filter(|(_, m)| !m.is_empty())
        .collect();
    if members.len() < 2 {
        return Err(RegressorError::Empty);
    }
    let first = members[0].1[0];
    for factor in factors {
        first.check_columns(factor)?;
    }
    let merged: Vec<(usize, Factor)> = members.par_iter().map(|(g, m)| (*g, merge_tree(m))).collect();
    let n = merged.len();
    let mut before: Vec<Factor> = Vec::with_capacity(n - 1);
    before.push(merged[0].1.clone());
    for i in 1..n - 1 {
        before.push(merge_pair(&before[i - 1], &merged[i].1));
    }
    // the suffixes are computed backwards in blocks, so that only the prefixes are all stored
    let mut out: Vec<Option<T>> = (0..n).map(|_| None).collect();
    let block = 64;
    let mut behind: Option<Factor> = None;
    let mut end = n;
    while end > 0 {
        let start = end.saturating_sub(block);
        let mut suffixes: Vec<Option<Factor>> = Vec::with_capacity(end - start);
        for i in (start..end).rev() {
            suffixes.push(behind.clone());
            behind = Some(match &behind {
                None => merged[i].1.clone(),
                Some(tail) => merge_pair(&merged[i].1, tail),
            });
        }
        suffixes.reverse();
        let results: Vec<Option<T>> = (start..end)
            .into_par_iter()
            .map(|i| {
                let rest = match (i.checked_sub(1).map(|k| &before[k]), &suffixes[i - start]) {
                    (Some(a), Some(b)) => merge_pair(a, b),
                    (Some(a), None) => a.clone(),
                    (None, Some(b)) => b.clone(),
                    (None, None) => return None,
                };
                Some(each(merged[i].0, &rest))
            })
            .collect();
        for (slot, result) in out[start..end].iter_mut().zip(results) {
            *slot = result;
        }
        end = start;
    }
    Ok(out.into_iter().flatten().collect())
}

/// Up to eight factors are merged in one factorisation as leaves; above them is a binary tree by
/// position.
fn merge_tree(factors: &[&Factor]) -> Factor {
    if factors.len() <= 8 {
        return stack(factors);
    }
    let half = factors.len().div_ceil(2);
    let (left, right) = rayon::join(|| merge_tree(&factors[..half]), || merge_tree(&factors[half..]));
    merge_pair(&left, &right)
}

fn stack(factors: &[&Factor]) -> Factor {
    if let [only] = factors {
        return (*only).clone();
    }
    let n = factors[0].columns.len();
    let height: usize = factors.iter().map(|f| f.height()).sum();
    if height >= n {
        let mut triangle = Triangle::new(n);
        for factor in factors {
            triangle.absorb_packed(factor.packed_rows());
        }
        return joined(factors, triangle.packed());
    }
    let mut rows = Mat::zeros(height, n);
    let mut at = 0;
    for factor in factors {
        for (i, row) in factor.packed_rows().enumerate() {
            for (j, value) in row.iter().enumerate() {
                rows[(at + i, i + j)] = *value;
            }
        }
        at += factor.height();
    }
    joined(factors, packed_triangle(rows.as_ref()))
}

fn joined(factors: &[&Factor], packed: Vec<f64>) -> Factor {
    let first = factors[0];
    let noises: Vec<&Factor> = factors.iter().filter_map(|f| f.noise()).collect();
    let same_trial = factors.iter().all(|f| f.trial == first.trial);
    let same_kind = factors.iter().all(|f| f.kind == first.kind);
    Factor {
        trial: if same_trial { first.trial.clone() } else { "merged".to_owned() },
        stretch: 0,
        kind: if same_kind { first.kind } else { StretchKind::Merged },
        rows: first.rows,
        columns: first.columns.clone(),
        n_rows: factors.iter().map(|f| f.n_rows).sum(),
        packed,
        noise: (noises.len() == factors.len()).then(|| Box::new(stack(&noises))),
    }
}

/// R of `[R1; R2]`.
fn merge_pair(a: &Factor, b: &Factor) -> Factor {
    stack(&[a, b])
}

/// Packed upper trapezoid of a matrix, diagonals non-negative.
fn packed_triangle(matrix: MatRef<'_, f64>) -> Vec<f64> {
    let (m, n) = (matrix.nrows(), matrix.ncols());
    if m >= n {
        return Triangle::of(matrix).packed();
    }
    plain_triangle(matrix)
}

/// [`packed_triangle`] by the library's QR: for fewer rows than columns, and as a reference in
/// tests.
fn plain_triangle(matrix: MatRef<'_, f64>) -> Vec<f64> {
    let (m, n) = (matrix.nrows(), matrix.ncols());
    let kept = m.min(n);
    if kept == 0 {
        return Vec::new();
    }
    let qr = matrix.qr();
    let r = qr.thin_R();
    let mut packed = Vec::with_capacity(kept * n - kept * (kept - 1) / 2);
    for i in 0..kept {
        let sign = if r[(i, i)] < 0.0 { -1.0 } else { 1.0 };
        packed.extend((i..n).map(|j| sign * r[(i, j)]));
    }
    packed
}
