//! Symmetric positive definite matrices in skyline form: every row is stored from its first entry
//! to the diagonal.
//!
//! Cholesky's factor has the same form, so nothing is filled in outside of it (George and Liu,
//! *Computer Solution of Large Sparse Positive Definite Systems*, 1981, ch. 4). All inner loops run
//! over contiguous entries.

/// Lower half of a symmetric matrix, or its factor L with A = L Lᵀ.
#[derive(Debug, Clone)]
pub(crate) struct Skyline {
    /// First column of every row.
    first: Vec<usize>,
    /// Index of the diagonal entry of every row in `values`.
    diagonal: Vec<usize>,
    values: Vec<f64>,
}

impl Skyline {
    /// A zero matrix; `first[row] <= row` is the first column of a row.
    pub fn new(first: Vec<usize>) -> Self {
        let mut size = 0;
        let diagonal = first
            .iter()
            .enumerate()
            .map(|(row, &first)| {
                size += row - first + 1;
                size - 1
            })
            .collect();
        Self { first, diagonal, values: vec![0.0; size] }
    }

    pub fn clear(&mut self) {
        self.values.fill(0.0);
    }

    /// Adds to an entry inside the form, `column <= row`.
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        self.values[self.diagonal[row] + column - row] += value;
    }

    /// Multiplies the diagonal by `1 + damping`.
    pub fn damp(&mut self, damping: f64) {
        if damping > 0.0 {
            for &at in &self.diagonal {
                self.values[at] *= 1.0 + damping;
            }
        }
    }

    /// Entries of a row from a column to the one before the diagonal.
    fn row(&self, row: usize, from: usize) -> &[f64] {
        &self.values[self.diagonal[row] + from - row..self.diagonal[row]]
    }

    /// Cholesky's factor in place; false if the matrix is not positive definite.
    pub fn factorise(&mut self) -> bool {
        for row in 0..self.first.len() {
            let first = self.first[row];
            let start = self.diagonal[row] + first - row;
            let (above, here) = self.values.split_at_mut(start);
            for column in first..row {
                let from = first.max(self.first[column]);
                let d = self.diagonal[column];
                let sum = dot(&here[from - first..column - first], &above[d + from - column..d]);
                here[column - first] = (here[column - first] - sum) / above[d];
            }
            let n = row - first;
            let own = here[n];
            let pivot = own - dot(&here[..n], &here[..n]);
            if pivot.is_nan() || pivot <= 1e-14 * own.abs() {
                return false;
            }
            here[n] = pivot.sqrt();
        }
        true
    }

    /// Solves `A x = b` in place with the factor.
    pub fn solve(&self, x: &mut [f64]) {
        for row in 0..self.first.len() {
            let first = self.first[row];
            x[row] = (x[row] - dot(self.row(row, first), &x[first..row])) / self.values[self.diagonal[row]];
        }
        for row in (0..self.first.len()).rev() {
            let first = self.first[row];
            x[row] /= self.values[self.diagonal[row]];
            let value = x[row];
            x[first..row].iter_mut().zip(self.row(row, first)).for_each(|(x, l)| *x -= l * value);
        }
    }

    /// Diagonal of the inverse, from the factor (Takahashi's recursion within the form).
    pub fn variances(&self) -> Vec<f64> {
        let n = self.first.len();
        let mut z = Self { values: vec![0.0; self.values.len()], ..self.clone() };
        // Last row that reaches a column.
        let mut last: Vec<usize> = (0..n).collect();
        for row in 0..n {
            for last in &mut last[self.first[row]..row] {
                *last = row;
            }
        }
        let (mut low, mut sum) = (vec![0.0; n], vec![0.0; n]);
        for column in (0..n).rev() {
            let rows = column + 1..last[column] + 1;
            for row in rows.clone() {
                let inside = self.first[row] <= column;
                low[row] = if inside { self.values[self.diagonal[row] + column - row] } else { 0.0 };
                sum[row] = 0.0;
            }
            for row in rows.clone() {
                let from = z.first[row].max(column + 1);
                let entries = z.row(row, from);
                sum[row] += dot(&low[from..row], entries) + low[row] * z.values[z.diagonal[row]];
                let value = low[row];
                sum[from..row].iter_mut().zip(entries).for_each(|(s, z)| *s += value * z);
            }
            let inverse = 1.0 / self.values[self.diagonal[column]];
            let mut own = inverse;
            for row in rows.filter(|&row| self.first[row] <= column) {
                let entry = -sum[row] * inverse;
                z.values[z.diagonal[row] + column - row] = entry;
                own -= low[row] * entry;
            }
            z.values[z.diagonal[column]] = inverse * own;
        }
        z.diagonal.iter().map(|&d| z.values[d]).collect()
    }
}

/// Inner product in eight sums, which the compiler vectorises.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (heads_a, rest_a) = a.as_chunks::<8>();
    let (heads_b, rest_b) = b.as_chunks::<8>();
    for (x, y) in heads_a.iter().zip(heads_b) {
        for k in 0..8 {
            sums[k] += x[k] * y[k];
        }
    }
    let rest: f64 = rest_a.iter().zip(rest_b).map(|(x, y)| x * y).sum();
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn skyline_algebra_against_dense_algebra() {
        let n = 43;
        let first: Vec<usize> = (0..n).map(|row: usize| row.saturating_sub((row * 7) % 19)).collect();
        let mut matrix = Skyline::new(first.clone());
        let mut dense = DMatrix::zeros(n, n);
        for (row, &first) in first.iter().enumerate() {
            for column in first..=row {
                let value = if row == column { 12.0 } else { (1.3 * (row * 7 + column) as f64).sin() };
                matrix.add(row, column, value);
                dense[(row, column)] = value;
                dense[(column, row)] = value;
            }
        }
        let b = DVector::from_fn(n, |i, _| (i as f64).cos());
        assert!(matrix.factorise());
        let mut x = b.as_slice().to_vec();
        matrix.solve(&mut x);
        let inverse = dense.try_inverse().unwrap();
        let expected = &inverse * &b;
        assert!(x.iter().zip(expected.iter()).all(|(a, b)| (a - b).abs() < 1e-12));
        let variances = matrix.variances();
        assert!((0..n).all(|i| (variances[i] - inverse[(i, i)]).abs() < 1e-12));
        let mut indefinite = Skyline::new(vec![0, 0]);
        indefinite.add(0, 0, 1.0);
        indefinite.add(1, 0, 2.0);
        indefinite.add(1, 1, 1.0);
        assert!(!indefinite.factorise());
    }
}
