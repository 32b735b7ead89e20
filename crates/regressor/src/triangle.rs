//! Orthogonal reduction of many rows to one upper triangle.
//!
//! Rows are absorbed in blocks that fit in the cache: with R the triangle of all earlier rows, the
//! stack `[R; block]` is reduced by Householder reflections, each of which changes one row of R and
//! the block, so that no work is spent on the zeros of R. Sixteen reflections at a time are
//! combined into `I − V T Vᵀ` (Schreiber, Van Loan 1989) and applied to the other columns as two
//! matrix products. This is the standard Householder reduction in a different order: backward
//! stable for rows of any condition.
//!
//! A tall matrix is divided into chunks of fixed height whose triangles are merged over a binary
//! tree (Demmel, Grigori, Hoemmen, Langou 2012: TSQR). Chunks and tree depend only on the number of
//! rows, so that the result is identical for any number of threads.

use faer::MatRef;
use fearless_simd::{Level, Simd, SimdBase, SimdFloat, dispatch, f64x8};
use std::ops::Range;

/// Number of columns whose reflections are combined.
const PANEL: usize = 16;
/// Number of rows absorbed together, a multiple of [`LANES`]: with 130 columns the block takes a
/// quarter of a megabyte.
const BLOCK: usize = 256;
/// Number of rows in a chunk of a tall matrix.
const CHUNK: usize = 16_384;
/// Numbers in a vector.
const LANES: usize = 8;

/// An upper triangle R that absorbs rows: RᵀR is the sum over all rows absorbed.
pub(crate) struct Triangle {
    level: Level,
    /// Number of columns.
    n: usize,
    /// Number of columns in memory, with padding.
    stride: usize,
    /// R row by row.
    r: Aligned,
    /// Rows being absorbed.
    block: Aligned,
    /// Products of a panel with the columns after it.
    products: Aligned,
}

/// Numbers aligned to a cache line.
struct Aligned {
    numbers: Vec<f64>,
    length: usize,
}

impl Aligned {
    fn new(length: usize) -> Self {
        Self { numbers: vec![0.0; length + LANES], length }
    }
    fn offset(&self) -> usize {
        // if the allocator gives no offset, only speed is lost
        self.numbers.as_ptr().align_offset(64).min(LANES)
    }
    fn get(&self) -> &[f64] {
        &self.numbers[self.offset()..][..self.length]
    }
    fn get_mut(&mut self) -> &mut [f64] {
        let offset = self.offset();
        &mut self.numbers[offset..][..self.length]
    }
}

impl Triangle {
    /// A triangle without rows.
    pub(crate) fn new(n: usize) -> Self {
        let stride = n.next_multiple_of(LANES);
        Self {
            level: Level::new(),
            n,
            stride,
            r: Aligned::new(n * stride),
            block: Aligned::new(0),
            products: Aligned::new(PANEL * stride),
        }
    }

    /// R of a matrix with at least as many rows as columns.
    pub(crate) fn of(matrix: MatRef<'_, f64>) -> Self {
        let m = matrix.nrows();
        if m > CHUNK {
            let (top, bottom) = matrix.split_at_row(m.div_ceil(CHUNK).div_ceil(2) * CHUNK);
            let (mut top, bottom) = rayon::join(|| Self::of(top), || Self::of(bottom));
            top.absorb_triangle(&bottom);
            return top;
        }
        let mut out = Self::new(matrix.ncols());
        out.absorb(matrix);
        out
    }

    /// Absorbs dense rows.
    pub(crate) fn absorb(&mut self, matrix: MatRef<'_, f64>) {
        let (m, n, stride) = (matrix.nrows(), self.n, self.stride);
        let columns: Option<Vec<&[f64]>> =
            (0..n).map(|j| matrix.col(j).try_as_col_major().map(|column| column.as_slice())).collect();
        let mut start = 0;
        while start < m {
            let height = BLOCK.min(m - start);
            let (padded, block) = self.clear_block(height);
            match &columns {
                Some(columns) => transpose(columns, start, height, stride, block),
                None => {
                    for (i, row) in block.chunks_exact_mut(stride).take(height).enumerate() {
                        for (to, from) in row.iter_mut().zip(matrix.row(start + i).iter()) {
                            *to = *from;
                        }
                    }
                }
            }
            self.reduce(padded, false);
            start += height;
        }
    }

    /// Absorbs rows of an upper trapezoid: row `i` holds the columns `i ..`.
    pub(crate) fn absorb_packed<'a>(&mut self, rows: impl Iterator<Item = &'a [f64]>) {
        let stride = self.stride;
        let (height, block) = self.clear_block(self.n);
        for (i, row) in rows.enumerate() {
            block[i * stride + i..i * stride + i + row.len()].copy_from_slice(row);
        }
        self.reduce(height, true);
    }

    /// Absorbs another triangle.
    pub(crate) fn absorb_triangle(&mut self, other: &Self) {
        let (height, block) = self.clear_block(self.n);
        block[..other.r.length].copy_from_slice(other.r.get());
        self.reduce(height, true);
    }

    /// The triangle packed row by row, row `i` from column `i` on, its diagonal non-negative.
    pub(crate) fn packed(&self) -> Vec<f64> {
        let n = self.n;
        let mut packed = Vec::with_capacity(n * (n + 1) / 2);
        for (i, row) in self.r.get().chunks_exact(self.stride).enumerate() {
            let sign = if row[i] < 0.0 { -1.0 } else { 1.0 };
            packed.extend(row[i..n].iter().map(|x| sign * x));
        }
        packed
    }

    /// Clears this many rows, rounded up to a whole number of vectors; returns that number and the
    /// block.
    fn clear_block(&mut self, height: usize) -> (usize, &mut [f64]) {
        let padded = height.next_multiple_of(LANES);
        let length = padded * self.stride;
        if self.block.numbers.len() < length + LANES {
            self.block = Aligned::new(length);
        }
        self.block.length = length;
        let block = self.block.get_mut();
        block.fill(0.0);
        (padded, block)
    }

    fn reduce(&mut self, height: usize, triangular: bool) {
        let Self { level, n, stride, r, block, products } = self;
        let work = Work {
            n: *n,
            stride: *stride,
            height,
            triangular,
            r: r.get_mut(),
            block: block.get_mut(),
            products: products.get_mut(),
        };
        dispatch!(*level, simd => absorb_block(simd, work));
    }
}

/// Rows `start .. start + height` of columns, row by row.
fn transpose(columns: &[&[f64]], start: usize, height: usize, stride: usize, block: &mut [f64]) {
    let (eights, rest) = columns.as_chunks::<LANES>();
    for (k, eight) in eights.iter().enumerate() {
        let eight = eight.map(|column| &column[start..start + height]);
        for (i, row) in block.chunks_exact_mut(stride).take(height).enumerate() {
            row[LANES * k..LANES * (k + 1)].copy_from_slice(&eight.map(|column| column[i]));
        }
    }
    for (k, column) in rest.iter().enumerate() {
        for (row, x) in block.chunks_exact_mut(stride).zip(&column[start..start + height]) {
            row[LANES * eights.len() + k] = *x;
        }
    }
}

struct Work<'a> {
    n: usize,
    stride: usize,
    height: usize,
    /// Row `i` of the block is zero before column `i`.
    triangular: bool,
    r: &'a mut [f64],
    block: &'a mut [f64],
    products: &'a mut [f64],
}

/// The reflections of a panel: `H_j = I − τ_j v_j v_jᵀ` with `v_j` one in row `j` of R and
/// `scale_j` times the panel's column in the block.
struct Reflections {
    scale: [f64; PANEL],
    /// T of `H_0 H_1 … = I − V T Vᵀ`, upper, row by row.
    t: [[f64; PANEL]; PANEL],
}

#[inline(always)]
fn absorb_block<S: Simd>(simd: S, work: Work<'_>) {
    let Work { n, stride, height, triangular, r, block, products } = work;
    for first in (0..n).step_by(PANEL) {
        let depth = if triangular { height.min(first + PANEL) } else { height };
        let rows = &mut block[..depth * stride];
        let mut reflections = Reflections { scale: [0.0; PANEL], t: [[0.0; PANEL]; PANEL] };
        simd.vectorize(
            #[inline(always)]
            || eight(simd, n, stride, first, 0, &mut reflections, r, rows),
        );
        let (second, behind) = (first + LANES, first + PANEL);
        if second < n {
            // the second half of the panel treats the first as one combined reflection
            simd.vectorize(
                #[inline(always)]
                || apply::<S, LANES>(simd, stride, first, second..behind, &reflections, r, rows, products),
            );
            simd.vectorize(
                #[inline(always)]
                || eight(simd, n, stride, first, LANES, &mut reflections, r, rows),
            );
        }
        if behind < n {
            simd.vectorize(
                #[inline(always)]
                || couple(simd, stride, first, &mut reflections, rows, products),
            );
            simd.vectorize(
                #[inline(always)]
                || apply::<S, PANEL>(simd, stride, first, behind..stride, &reflections, r, rows, products),
            );
        }
    }
}

/// Reflects eight columns of a panel one after the other, from its column `from` on.
#[inline(always)]
fn eight<S: Simd>(
    simd: S,
    n: usize,
    stride: usize,
    first: usize,
    from: usize,
    out: &mut Reflections,
    r: &mut [f64],
    rows: &mut [f64],
) {
    let at = first + from;
    let width = LANES.min(n - at);
    // products of the present column with all eight
    let mut products = sweep(simd, stride, at, 0, None, rows);
    for j in 0..width {
        let top = &mut r[(at + j) * stride + at..][..width];
        let (alpha, below) = (top[j], products[j]);
        let mut change = [0.0; LANES];
        if below != 0.0 {
            let beta = -(alpha * alpha + below).sqrt().copysign(alpha);
            let tau = (beta - alpha) / beta;
            let scale = 1.0 / (alpha - beta);
            top[j] = beta;
            for l in j + 1..width {
                let along = tau * (top[l] + scale * products[l]);
                top[l] -= along;
                change[l] = scale * along;
            }
            out.scale[from + j] = scale;
            out.t[from + j][from + j] = tau;
            // T[..j, j] = −τ T[..j, ..j] V[.., ..j]ᵀ v
            for i in 0..j {
                let sum: f64 = (i..j).map(|k| out.t[from + i][from + k] * out.scale[from + k] * products[k]).sum();
                out.t[from + i][from + j] = -tau * scale * sum;
            }
        }
        if j + 1 < width {
            products = sweep(simd, stride, at, j + 1, Some(&change), rows);
        }
    }
}

/// T of both halves of a panel together: `T₁₂ = −T₁ (V₁ᵀ V₂) T₂`.
#[inline(always)]
fn couple<S: Simd>(simd: S, stride: usize, first: usize, out: &mut Reflections, rows: &[f64], products: &mut [f64]) {
    let second = first + LANES;
    project::<S, LANES>(simd, stride, first, second..first + PANEL, rows, products);
    let mut right = [[0.0; LANES]; LANES];
    for i in 0..LANES {
        for j in 0..LANES {
            let sum: f64 = (0..=j)
                .map(|k| products[i * stride + second + k] * out.scale[LANES + k] * out.t[LANES + k][LANES + j])
                .sum();
            right[i][j] = out.scale[i] * sum;
        }
    }
    for i in 0..LANES {
        for j in 0..LANES {
            out.t[i][LANES + j] = -(i..LANES).map(|k| out.t[i][k] * right[k][j]).sum::<f64>();
        }
    }
}

/// Applies the first `K` reflections of a panel to other columns.
#[inline(always)]
fn apply<S: Simd, const K: usize>(
    simd: S,
    stride: usize,
    first: usize,
    columns: Range<usize>,
    reflections: &Reflections,
    r: &mut [f64],
    rows: &mut [f64],
    products: &mut [f64],
) {
    project::<S, K>(simd, stride, first, columns.clone(), rows, products);
    gather::<K>(stride, first, columns.clone(), reflections, r, products);
    subtract::<S, K>(simd, stride, first, columns, products, rows);
}

/// Subtracts column `j − 1` times `change` from eight columns, and returns the products of column
/// `j` with them.
#[inline(always)]
fn sweep<S: Simd>(
    simd: S,
    stride: usize,
    at: usize,
    j: usize,
    change: Option<&[f64; LANES]>,
    rows: &mut [f64],
) -> [f64; LANES] {
    const UNROLL: usize = 8;
    let mut sums = [f64x8::splat(simd, 0.0); UNROLL];
    let change = change.map(|change| f64x8::load_array_ref(simd, change));
    for group in rows.chunks_exact_mut(UNROLL * stride) {
        for u in 0..UNROLL {
            let row = &mut group[u * stride + at..u * stride + at + LANES];
            let mut x = f64x8::from_slice(simd, row);
            if let Some(change) = change {
                x = f64x8::splat(simd, -row[j - 1]).mul_add(change, x);
                x.store_slice(row);
            }
            sums[u] = f64x8::splat(simd, row[j]).mul_add(x, sums[u]);
        }
    }
    let halves = [sums[0] + sums[4], sums[1] + sums[5], sums[2] + sums[6], sums[3] + sums[7]];
    ((halves[0] + halves[2]) + (halves[1] + halves[3])).to_array()
}

/// `products = Xᵀ C`: the first `K` columns X of the panel with other columns C.
#[inline(always)]
fn project<S: Simd, const K: usize>(
    simd: S,
    stride: usize,
    first: usize,
    columns: Range<usize>,
    rows: &[f64],
    products: &mut [f64],
) {
    // as many sums as the processor has registers for
    if S::f64s::LEN == LANES {
        let mut at = columns.start;
        while at + 3 * LANES <= columns.end {
            project_tile::<S, K, 8, 3>(simd, stride, first, at, rows, products);
            at += 3 * LANES;
        }
        if at + 2 * LANES <= columns.end {
            project_tile::<S, K, 8, 2>(simd, stride, first, at, rows, products);
            at += 2 * LANES;
        }
        if at < columns.end {
            project_tile::<S, K, 8, 1>(simd, stride, first, at, rows, products);
        }
    } else {
        for at in columns.step_by(LANES) {
            project_tile::<S, K, 4, 1>(simd, stride, first, at, rows, products);
        }
    }
}

#[inline(always)]
fn project_tile<S: Simd, const K: usize, const COLUMNS: usize, const CHUNKS: usize>(
    simd: S,
    stride: usize,
    first: usize,
    at: usize,
    rows: &[f64],
    products: &mut [f64],
) {
    for from in (0..K).step_by(COLUMNS) {
        let mut sums = [[f64x8::splat(simd, 0.0); CHUNKS]; COLUMNS];
        for row in rows.chunks_exact(stride) {
            let x = &row[first + from..first + from + COLUMNS];
            let c = &row[at..at + CHUNKS * LANES];
            let c: [f64x8<S>; CHUNKS] =
                std::array::from_fn(|k| f64x8::from_slice(simd, &c[LANES * k..LANES * (k + 1)]));
            for m in 0..COLUMNS {
                let x = f64x8::splat(simd, x[m]);
                for k in 0..CHUNKS {
                    sums[m][k] = x.mul_add(c[k], sums[m][k]);
                }
            }
        }
        for m in 0..COLUMNS {
            let to = &mut products[(from + m) * stride + at..][..CHUNKS * LANES];
            for k in 0..CHUNKS {
                sums[m][k].store_slice(&mut to[LANES * k..LANES * (k + 1)]);
            }
        }
    }
}

/// Converts `Xᵀ C` to the amounts subtracted from each row of R and of the block.
#[inline(always)]
fn gather<const K: usize>(
    stride: usize,
    first: usize,
    columns: Range<usize>,
    reflections: &Reflections,
    r: &mut [f64],
    products: &mut [f64],
) {
    for (i, row) in products.chunks_exact_mut(stride).take(K).enumerate() {
        let scale = reflections.scale[i];
        let top = &r[(first + i) * stride..(first + i + 1) * stride];
        for (x, top) in row[columns.clone()].iter_mut().zip(&top[columns.clone()]) {
            *x = top + scale * *x;
        }
    }
    // Tᵀ from the last row to the first, in place
    for i in (0..K).rev() {
        let (before, rest) = products.split_at_mut(i * stride);
        let row = &mut rest[columns.clone()];
        let own = reflections.t[i][i];
        row.iter_mut().for_each(|x| *x *= own);
        for k in 0..i {
            let factor = reflections.t[k][i];
            let other = &before[k * stride..(k + 1) * stride];
            for (x, other) in row.iter_mut().zip(&other[columns.clone()]) {
                *x += factor * other;
            }
        }
        let scale = reflections.scale[i];
        let top = &mut r[(first + i) * stride..(first + i + 1) * stride];
        for (x, top) in row.iter_mut().zip(&mut top[columns.clone()]) {
            *top -= *x;
            *x *= scale;
        }
    }
}

/// `C −= X products`.
#[inline(always)]
fn subtract<S: Simd, const K: usize>(
    simd: S,
    stride: usize,
    first: usize,
    columns: Range<usize>,
    products: &[f64],
    rows: &mut [f64],
) {
    if S::f64s::LEN == LANES {
        for group in rows.chunks_exact_mut(8 * stride) {
            let mut at = columns.start;
            while at + 3 * LANES <= columns.end {
                subtract_tile::<S, K, 8, 3>(simd, stride, first, at, products, group);
                at += 3 * LANES;
            }
            if at + 2 * LANES <= columns.end {
                subtract_tile::<S, K, 8, 2>(simd, stride, first, at, products, group);
                at += 2 * LANES;
            }
            if at < columns.end {
                subtract_tile::<S, K, 8, 1>(simd, stride, first, at, products, group);
            }
        }
    } else {
        for group in rows.chunks_exact_mut(4 * stride) {
            for at in columns.clone().step_by(LANES) {
                subtract_tile::<S, K, 4, 1>(simd, stride, first, at, products, group);
            }
        }
    }
}

#[inline(always)]
fn subtract_tile<S: Simd, const K: usize, const ROWS: usize, const CHUNKS: usize>(
    simd: S,
    stride: usize,
    first: usize,
    at: usize,
    products: &[f64],
    group: &mut [f64],
) {
    let mut c: [[f64x8<S>; CHUNKS]; ROWS] = std::array::from_fn(|m| {
        let row = &group[m * stride + at..m * stride + at + CHUNKS * LANES];
        std::array::from_fn(|k| f64x8::from_slice(simd, &row[LANES * k..LANES * (k + 1)]))
    });
    let x: [&[f64; K]; ROWS] =
        std::array::from_fn(|m| group[m * stride + first..].first_chunk::<K>().unwrap_or(&[0.0; K]));
    for (i, product) in products.chunks_exact(stride).take(K).enumerate() {
        let p = &product[at..at + CHUNKS * LANES];
        let p: [f64x8<S>; CHUNKS] = std::array::from_fn(|k| f64x8::from_slice(simd, &p[LANES * k..LANES * (k + 1)]));
        for m in 0..ROWS {
            let minus = f64x8::splat(simd, -x[m][i]);
            for k in 0..CHUNKS {
                c[m][k] = minus.mul_add(p[k], c[m][k]);
            }
        }
    }
    for m in 0..ROWS {
        let row = &mut group[m * stride + at..m * stride + at + CHUNKS * LANES];
        for k in 0..CHUNKS {
            c[m][k].store_slice(&mut row[LANES * k..LANES * (k + 1)]);
        }
    }
}

#[cfg(test)]
#[cfg(target_arch = "x86_64")]
mod tests {
    use super::*;
    use faer::Mat;

    #[test]
    fn every_instruction_set_gives_the_same_triangle() {
        let best = Level::new();
        for n in [5, 40, 129] {
            let rows = Mat::from_fn(600, n, |i, j| ((i * n + j) as f64 * 12.9898).sin());
            let reduced = |level: Level| {
                let mut triangle = Triangle { level, ..Triangle::new(n) };
                triangle.absorb(rows.as_ref());
                triangle.packed()
            };
            let expected = reduced(best);
            // with fused multiply-add the numbers are the same, otherwise they differ by rounding
            if let (Some(_), Some(avx2)) = (best.as_avx512(), best.as_avx2()) {
                assert!(reduced(Level::Avx2(avx2)) == expected);
            }
            let worst =
                reduced(Level::baseline()).iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-11, "{n} columns: {worst:e}");
        }
    }
}
