//! Blocks of frames that may each see the joints elsewhere.
//!
//! Where a joint hardly turns about a direction, skin and a trunk that bends decide where its
//! centre is seen, and other frames see it elsewhere: single drop jumps of one person put the waist
//! 165 mm to one side and 191 mm to the other. The normal equations of all frames together would be
//! sure of their mean. So every recording (of fewer than three, every stretch of frames) is a block
//! with joints of its own, `γ_b = γ + u_b` with `u_b ~ N(0, T)` for the centres and axes, and T is
//! estimated from the blocks: directions in which they contradict each other lose their weight, and
//! the landmark's value remains.
//!
//! In the linearised problem a block has the normal matrix N and the gradient g of its cost by γ,
//! postures eliminated. With u_b integrated out,
//!
//! ```text
//! N* = N − N E (EᵀN E + T⁻¹)⁻¹ EᵀN,     g* = g − N E (EᵀN E + T⁻¹)⁻¹ Eᵀg
//! ```
//!
//! where E takes the joints among the unknowns. T has a block for each centre and each axis; it is
//! estimated by expectation and maximisation (Laird and Ware 1982): the mean over blocks of `E[u
//! uᵀ]`.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use std::ops::Range;

/// Iterations for T. Its directions without contradiction shrink from the landmarks' variance on;
/// what remains of them after these is small beside it.
const ITERATIONS: usize = 40;

/// Iterations after which the geometry follows T.
const FOLLOWS: usize = 8;

/// Fewest frames of a block.
const FEWEST: usize = 16;

/// Fewest blocks between which there is a spread.
const BLOCKS: usize = 3;

/// Blocks of the frames of these recordings, in their order (`None`: no recording): single
/// recordings, whose errors are independent, or several short ones; of fewer than three recordings
/// stretches of frames.
pub(super) fn parts(recordings: impl Iterator<Item = Option<usize>>) -> Vec<Range<usize>> {
    let of: Vec<Option<usize>> = recordings.collect();
    let mut found: Vec<Range<usize>> = Vec::new();
    for (i, recording) in of.iter().enumerate() {
        match found.last_mut() {
            Some(last) if last.len() < FEWEST || of[i - 1] == *recording => last.end = i + 1,
            _ => found.push(i..i + 1),
        }
    }
    if found.len() < BLOCKS {
        let stretches = (0..of.len()).step_by(FEWEST);
        found = stretches.map(|first| first..(first + FEWEST).min(of.len())).collect();
    }
    found
}

/// Normal equations of one block.
pub(super) type Equations = (DMatrix<f64>, DVector<f64>);

/// How far blocks may see the joints from each other.
#[derive(Debug, Clone)]
pub(super) struct Spread {
    /// Unknowns of each centre and each axis.
    joints: Vec<Range<usize>>,
    /// A root of T, in the order of `joints`; zero before it is estimated.
    root: DMatrix<f64>,
}

/// A block with its joints integrated out.
struct Reduced {
    /// `N E L`, with L the root of T.
    reach: DMatrix<f64>,
    /// `1 + Lᵀ EᵀN E L`.
    inner: Cholesky<f64, Dyn>,
}

impl Spread {
    /// None yet.
    pub fn none(joints: Vec<Range<usize>>) -> Self {
        let k = joints.iter().map(Range::len).sum();
        Self { joints, root: DMatrix::zeros(k, k) }
    }

    fn unknowns(&self) -> impl Iterator<Item = usize> + '_ {
        self.joints.iter().cloned().flatten()
    }

    fn is_none(&self) -> bool {
        self.root.amax() == 0.0
    }

    /// `None` for equations that are not finite.
    fn reduce(&self, matrix: &DMatrix<f64>) -> Option<Reduced> {
        let at: Vec<usize> = self.unknowns().collect();
        let reach = matrix.select_columns(&at) * &self.root;
        let mut inner = self.root.tr_mul(&reach.select_rows(&at));
        (0..inner.nrows()).for_each(|i| inner[(i, i)] += 1.0);
        Some(Reduced { reach, inner: inner.cholesky()? })
    }

    /// `Lᵀ Eᵀ g`.
    fn of(&self, gradient: &DVector<f64>) -> DVector<f64> {
        let at: Vec<usize> = self.unknowns().collect();
        self.root.tr_mul(&gradient.select_rows(&at))
    }

    /// Equations of all blocks with the joints of each integrated out, and what that takes off
    /// their cost.
    pub fn together(&self, blocks: &[Equations]) -> Option<(Equations, f64)> {
        let (mut matrix, mut gradient, mut less) = (DMatrix::zeros(0, 0), DVector::zeros(0), 0.0);
        for (n, g) in blocks {
            if matrix.is_empty() {
                (matrix, gradient) = (DMatrix::zeros(n.nrows(), n.nrows()), DVector::zeros(n.nrows()));
            }
            matrix += n;
            gradient += g;
            if !self.is_none() {
                let reduced = self.reduce(n)?;
                let own = self.of(g);
                let solved = reduced.inner.solve(&own);
                less += 0.5 * own.dot(&solved);
                gradient -= &reduced.reach * solved;
                matrix -= &reduced.reach * reduced.inner.solve(&reduced.reach.transpose());
            }
        }
        Some(((matrix, gradient), less))
    }

    /// Gradients of the drawn errors of each block (one column a draw), the joints integrated out,
    /// summed; `own` are the draws of the blocks' own joints in standard deviations.
    pub fn drawn(
        &self,
        blocks: &[Equations],
        drawn: &[DMatrix<f64>],
        mut own: impl FnMut() -> f64,
    ) -> Option<DMatrix<f64>> {
        let mut total = drawn.first()?.map(|_| 0.0);
        let at: Vec<usize> = self.unknowns().collect();
        for ((n, _), drawn) in blocks.iter().zip(drawn) {
            let mut of_block = drawn.clone();
            if !self.is_none() {
                let reduced = self.reduce(n)?;
                of_block += &reduced.reach * DMatrix::from_fn(at.len(), drawn.ncols(), |_, _| own());
                let inner = reduced.inner.solve(&self.root.tr_mul(&of_block.select_rows(&at)));
                of_block -= &reduced.reach * inner;
            }
            total += of_block;
        }
        Some(total)
    }

    /// T from the blocks' equations at the present geometry, whose distance from the landmarks is
    /// `deviation` with the inverse variances `precision`.
    pub fn estimated(&self, blocks: &[Equations], precision: &DVector<f64>, deviation: &DVector<f64>) -> Option<Self> {
        let at: Vec<usize> = self.unknowns().collect();
        let sd = |i: usize| precision[at[i]].sqrt().recip();
        let mut found = Self {
            joints: self.joints.clone(),
            root: DMatrix::from_diagonal(&DVector::from_fn(at.len(), |i, _| sd(i))),
        };
        let mut step = DVector::zeros(precision.len());
        for iteration in 0..ITERATIONS {
            if iteration % FOLLOWS == 0 {
                let ((mut matrix, mut gradient), _) = found.together(blocks)?;
                for i in 0..precision.len() {
                    matrix[(i, i)] += precision[i];
                    gradient[i] += precision[i] * deviation[i];
                }
                step = -matrix.cholesky()?.solve(&gradient);
            }
            let mut spread = DMatrix::zeros(at.len(), at.len());
            for (n, g) in blocks {
                let reduced = found.reduce(n)?;
                let mean = &found.root * reduced.inner.solve(&found.of(&(g + n * &step)));
                spread += &found.root * reduced.inner.solve(&found.root.transpose()) + &mean * mean.transpose();
            }
            spread /= blocks.len().max(1) as f64;
            let mut first = 0;
            for joint in &found.joints {
                let own = spread.view((first, first), (joint.len(), joint.len())).into_owned();
                let eigen = own.symmetric_eigen();
                let root = &eigen.eigenvectors * DMatrix::from_diagonal(&eigen.eigenvalues.map(|v| v.max(0.0).sqrt()));
                found.root.view_mut((first, first), (joint.len(), joint.len())).copy_from(&root);
                first += joint.len();
            }
        }
        Some(found)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    /// One centre with a standard deviation of 30 mm from its landmark, seen by 20 blocks to 10 mm
    /// each: all 50 mm off along x, and along y by turns 200 mm to either side of 60 mm.
    #[test]
    fn a_direction_in_which_blocks_contradict_each_other_keeps_the_landmark() {
        let precision = DVector::from_element(3, 0.03_f64.powi(-2));
        let n = DMatrix::from_diagonal_element(3, 3, 0.01_f64.powi(-2));
        let seen = |b: i32| DVector::from_vec(vec![0.05, 0.06 + if b % 2 == 0 { 0.2 } else { -0.2 }, 0.0]);
        let blocks: Vec<Equations> = (0..20).map(|b| (n.clone(), -(&n * seen(b)))).collect();
        let landmark = DVector::zeros(3);
        let estimate = |spread: &Spread| {
            let ((matrix, gradient), _) = spread.together(&blocks).unwrap();
            -(matrix + DMatrix::from_diagonal(&precision)).cholesky().unwrap().solve(&gradient)
        };
        let none = Spread::none(std::iter::once(0..3).collect());
        let plain = estimate(&none);
        assert!((plain[0] - 0.05).abs() < 1e-3 && (plain[1] - 0.06).abs() < 1e-3, "{plain}");
        let found = none.estimated(&blocks, &precision, &landmark).unwrap();
        let sd = (&found.root * found.root.transpose()).diagonal().map(f64::sqrt);
        assert!((sd[1] - 0.2).abs() < 0.01 && sd[0] < 4e-3 && sd[2] < 4e-3, "{sd}");
        // a mean with 200 mm / √20 against 30 mm
        let held = estimate(&found);
        assert!((held[0] - 0.05).abs() < 2e-3, "{held}");
        let expected = 0.06 / (1.0 + (0.2_f64.powi(2) + 0.01_f64.powi(2)) / 20.0 / 0.03_f64.powi(2));
        assert!((held[1] - expected).abs() < 2e-3, "{held} {expected}");
    }

    #[test]
    fn integrated_equations_are_those_of_blocks_with_joints_of_their_own() {
        // cost ½ (x + u − a)ᵀ N (x + u − a) + ½ uᵀ T⁻¹ u over u, for unknowns of which two are a
        // joint
        let half = DMatrix::from_row_slice(3, 3, &[3.0, 0.5, 0.2, 0.1, 2.0, 0.4, 0.3, 0.1, 1.5]);
        let n = half.transpose() * &half;
        let a = DVector::from_vec(vec![0.3, -0.2, 0.5]);
        let spread = Spread {
            joints: std::iter::once(1..3).collect(),
            root: DMatrix::from_row_slice(2, 2, &[0.7, 0.1, 0.0, 0.4]),
        };
        let t = (&spread.root * spread.root.transpose()).try_inverse().unwrap();
        let cost = |x: &DVector<f64>| {
            let g = &n * (x - &a);
            let inner = n.view((1, 1), (2, 2)) + &t;
            let joint = g.rows(1, 2).into_owned();
            0.5 * (x - &a).dot(&g) - 0.5 * joint.dot(&(inner.try_inverse().unwrap() * &joint))
        };
        let x = DVector::from_vec(vec![0.1, 0.2, -0.1]);
        let g = &n * (&x - &a);
        let ((matrix, gradient), less) = spread.together(&[(n.clone(), g.clone())]).unwrap();
        assert!((0.5 * (&x - &a).dot(&g) - less - cost(&x)).abs() < 1e-12);
        for i in 0..3 {
            let moved = |h: f64| &x + DVector::from_fn(3, |j, _| if i == j { h } else { 0.0 });
            let slope = (cost(&moved(1e-5)) - cost(&moved(-1e-5))) / 2e-5;
            assert!((slope - gradient[i]).abs() < 1e-8, "{slope} {}", gradient[i]);
            let bend = (cost(&moved(1e-3)) - 2.0 * cost(&x) + cost(&moved(-1e-3))) / 1e-6;
            assert!((bend - matrix[(i, i)]).abs() < 1e-6, "{bend} {}", matrix[(i, i)]);
        }
    }
}
