//! Physically consistent links: masses, centres of mass and inertias of a body of positive density
//! that reproduce what motion determined and stay near the prior elsewhere.
//!
//! Minimised over the parameters φ of all links, with the sum of masses held fixed:
//!
//! ```text
//! ‖R [Bφ; θ; −1]‖² / (2 s²)  +  λ/2 (φ−φ₀)ᵀ P⁻¹ (φ−φ₀)  +  μ Σ_j [ tr(J₀ⱼ⁻¹ Jⱼ) − log det(J₀ⱼ⁻¹ Jⱼ) − 4 ]
//! ```
//!
//! The first term is the evidence itself, so base parameters are held as tightly as their
//! covariance allows; the second is the prior; the third, with the pseudo-inertia J of each link
//! (Wensing, Kim, Slotine 2017), is the entropic divergence (Bregman, of the log-determinant: Lee,
//! Wensing, Park 2020). It is infinite where J is not positive definite. All three are convex, so
//! Newton's method with step halving finds the unique minimum. The gradient of the divergence is
//! nonzero everywhere except at the prior, so `Bφ` differs slightly from the regularised estimate.
//!
//! Where a box is known that holds the mass of a link (collision geometry), the divergence also has
//! a term `t − log t − 1` for each axis of the box, with `t = ∫ (x − a)(b − x) dm` over the same
//! moment of the prior. It is linear in φ inside the logarithm, hence convex, and infinite where
//! mass would lie outside.
//!
//! The prior states relative deviations (mass, stretches and shears of the mass distribution), so φ
//! is a nonlinear function f of the ten numbers x per link ([`crate::prior`]). Its linear map is
//! first taken at the prior and then, as in Gauss and Newton's method, at the links found: `φ₀ =
//! f(x̂) − F x̂`, `P = F Cov(x) Fᵀ` with `F = ∂f/∂x` at x̂. With the map of the prior alone, the
//! values that motion does not determine keep the scale of a prior that the other values
//! contradict, and 95 % intervals contain the truth in 92 to 93 % of sets.

use crate::prior::{PriorAt, covariance_root};
use crate::system::inverse_triangle;
use crate::{IdentifyError, LinkPrior};
use aloft_body::inertia::pseudo_inertia;
use aloft_body::{BaseParameters, LinkInertia, Phi};
use aloft_regressor::Factor;
use nalgebra::{DMatrix, DVector, Matrix3, Matrix4, SMatrix, Vector3};

/// Number of times that the linear map of the prior is taken anew at the links just found. On a
/// chain one time changes widths of intervals by up to 10 %, two more times by up to 5 %.
const ROUNDS: usize = 2;

/// Weights of the three terms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkOptions {
    /// Variance s² of a row.
    pub row_variance: f64,
    /// Weight λ of the prior.
    pub prior_weight: f64,
    /// Weight μ of the divergence from the prior; small, so that it only keeps links consistent.
    pub divergence_weight: f64,
}

/// Consistent parameters of all links.
#[derive(Debug, Clone, PartialEq)]
pub struct ConsistentLinks {
    /// φ of each link.
    pub phi: Vec<Phi>,
    /// Covariance of the stacked φ, (10 n)²: from the curvature at the minimum.
    pub covariance: DMatrix<f64>,
    /// Response of φ to the score of its rows, (10 n)²: the inverse of the curvature, restricted to
    /// changes that keep the mass.
    pub response: DMatrix<f64>,
    /// Part of the covariance due to the bias from the prior and the divergence, (10 n)².
    pub known: DMatrix<f64>,
    /// Covariance of the prior with its linear map taken at these links, (10 n)².
    pub prior_covariance: DMatrix<f64>,
    /// Its part of second order ([`LinkPrior::second_order`]).
    pub second_order: DMatrix<f64>,
    /// Effect coefficients belonging to these links.
    pub effects: DVector<f64>,
    /// Number of Newton steps.
    pub steps: usize,
    /// Smallest eigenvalue of any link's second moment about its centre of mass, relative to the
    /// largest of the same link.
    pub smallest_eigenvalue: f64,
}

/// Finds consistent links for a merged factor.
///
/// # Errors
/// [`IdentifyError::Option`] for a mass or weights that are not positive,
/// [`IdentifyError::Numeric`] if a prior link is itself inconsistent or the minimum is not found.
pub fn consistent_links(
    merged: &Factor,
    base: &BaseParameters,
    mass_kg: f64,
    prior: &LinkPrior,
    options: &LinkOptions,
) -> Result<ConsistentLinks, IdentifyError> {
    let weights = [mass_kg, options.row_variance, options.prior_weight, options.divergence_weight];
    if !weights.iter().all(|w| *w > 0.0 && w.is_finite()) {
        return Err(IdentifyError::Option {
            option: "links",
            problem: "mass, row variance and weights must be positive".to_owned(),
        });
    }
    let n = prior.links.len();
    if base.from_full.ncols() != 10 * n {
        return Err(IdentifyError::Length {
            what: "links of the prior",
            expected: base.from_full.ncols() / 10,
            found: n,
        });
    }
    let start = scaled_to_mass(prior, mass_kg);
    let references: Vec<Matrix4<f64>> = start
        .iter()
        .enumerate()
        .map(|(j, phi)| {
            let inverse = pseudo_inertia(phi).cholesky().map(|c| c.inverse());
            inverse.ok_or_else(|| IdentifyError::Numeric(format!("the prior of link {j} is not physically consistent")))
        })
        .collect::<Result<_, _>>()?;
    let limits = Limits { references, slabs: slabs(prior, &start)? };
    let covariance = (prior.covariance.clone(), prior.second_order.clone());
    let mut problem = Problem::new(merged, base, &stacked(&start), covariance, limits, options)?;
    let mut links = problem.solve(options.divergence_weight)?;
    for _ in 0..ROUNDS {
        let Some(at) = prior.at(&start, &links.phi) else { break };
        let moved = problem.moved(base, at, options)?;
        let next = moved.solve_from(&stacked(&links.phi), options.divergence_weight)?;
        (problem, links) = (moved, next);
    }
    Ok(links)
}

fn stacked(phi: &[Phi]) -> DVector<f64> {
    DVector::from_iterator(10 * phi.len(), phi.iter().flat_map(|p| p.iter().copied()))
}

/// The prior's links with all masses (and quantities proportional to them) scaled so that they add
/// up to the body mass.
fn scaled_to_mass(prior: &LinkPrior, mass_kg: f64) -> Vec<Phi> {
    let phi = prior.phi();
    let total: f64 = phi.iter().map(|p| p[0]).sum();
    phi.into_iter().map(|p| p * (mass_kg / total)).collect()
}

/// A moment of one link, `row · φ`, positive for mass inside its box, over that of the prior.
#[derive(Clone)]
struct Slab {
    link: usize,
    row: Phi,
}

/// What keeps links consistent.
#[derive(Clone)]
struct Limits {
    /// Inverse pseudo-inertia of each link of the prior.
    references: Vec<Matrix4<f64>>,
    slabs: Vec<Slab>,
}

fn slabs(prior: &LinkPrior, start: &[Phi]) -> Result<Vec<Slab>, IdentifyError> {
    let boxed = prior.boxes.iter().zip(start).enumerate().filter_map(|(link, (b, phi))| Some((link, (*b)?, phi)));
    let mut out = Vec::new();
    for (link, own, phi) in boxed {
        for row in own.moment_rows() {
            let at_prior = row.dot(phi);
            if at_prior.is_nan() || at_prior <= 0.0 {
                return Err(IdentifyError::Numeric(format!("the prior of link {link} lies outside its box")));
            }
            out.push(Slab { link, row: row / at_prior });
        }
    }
    Ok(out)
}

struct Problem {
    /// Mean of the prior's linear map, 10 n.
    start: DVector<f64>,
    /// Its covariance, (10 n)², and the part of second order.
    covariance: DMatrix<f64>,
    second_order: DMatrix<f64>,
    limits: Limits,
    /// φ = start + root y keeps the total mass.
    root: DMatrix<f64>,
    /// y of a φ of that mass.
    back: DMatrix<f64>,
    /// Evidence of the rows, `A φ` and its right-hand side, both divided by s.
    by_base: DMatrix<f64>,
    by_base_right: DVector<f64>,
    /// Rows in y with the effects eliminated, and their right-hand side, both divided by s.
    rows: DMatrix<f64>,
    right: DVector<f64>,
    /// λ and Lᵀ-whitened offset of the start from the prior's mean is zero by construction.
    prior_weight: f64,
    effects: EffectsOf,
}

/// θ as a function of the base parameters.
#[derive(Clone)]
struct EffectsOf {
    inverse: DMatrix<f64>,
    coupling: DMatrix<f64>,
    right: DVector<f64>,
    from_full: DMatrix<f64>,
}

impl Problem {
    fn new(
        merged: &Factor,
        base: &BaseParameters,
        start: &DVector<f64>,
        covariance: (DMatrix<f64>, DMatrix<f64>),
        limits: Limits,
        options: &LinkOptions,
    ) -> Result<Self, IdentifyError> {
        // effects first, so that one triangularisation eliminates them
        let (p, k) = (merged.n_parameters(), merged.n_effects());
        let dense = merged.dense();
        let h = dense.nrows();
        let stacked = faer::Mat::from_fn(h.max(p + k + 1), p + k + 1, |i, j| {
            let column = if j < k {
                p + j
            } else if j < k + p {
                j - k
            } else {
                p + k
            };
            if i < h { dense[(i, column)] } else { 0.0 }
        });
        let qr = stacked.qr();
        let r = qr.thin_R();
        let get = |i: usize, j: usize| if i <= j { r[(i, j)] } else { 0.0 };
        let effects = EffectsOf {
            inverse: inverse_triangle(&DMatrix::from_fn(k, k, get))?,
            coupling: DMatrix::from_fn(k, p, |i, j| get(i, k + j)),
            right: DVector::from_fn(k, |i, _| get(i, k + p)),
            from_full: base.from_full.clone(),
        };
        let s = options.row_variance.sqrt();
        let a = DMatrix::from_fn(p, p, |i, j| get(k + i, k + j)) / s;
        let b = DVector::from_fn(p, |i, _| get(k + i, k + p)) / s;
        Self::of(start, covariance, limits, (a, b), base, options, effects)
    }

    /// From the rows `a` of the base parameters with their right-hand side `b`.
    fn of(
        start: &DVector<f64>,
        (covariance, second_order): (DMatrix<f64>, DMatrix<f64>),
        limits: Limits,
        (a, b): (DMatrix<f64>, DVector<f64>),
        base: &BaseParameters,
        options: &LinkOptions,
        effects: EffectsOf,
    ) -> Result<Self, IdentifyError> {
        let (root, back) = mass_keeping_root(&covariance)?;
        let by_full = &a * &base.from_full;
        let right = &b - &by_full * start;
        let rows = by_full * &root;
        Ok(Self {
            start: start.clone(),
            covariance,
            second_order,
            limits,
            root,
            back,
            by_base: a,
            by_base_right: b,
            rows,
            right,
            prior_weight: options.prior_weight,
            effects,
        })
    }

    /// The same rows with the prior's linear map taken elsewhere.
    fn moved(&self, base: &BaseParameters, at: PriorAt, options: &LinkOptions) -> Result<Self, IdentifyError> {
        let evidence = (self.by_base.clone(), self.by_base_right.clone());
        let covariance = (at.covariance, at.second_order);
        Self::of(&at.mean, covariance, self.limits.clone(), evidence, base, options, self.effects.clone())
    }

    fn phi(&self, y: &DVector<f64>) -> DVector<f64> {
        &self.start + &self.root * y
    }

    /// Value of the objective; infinite if a link is not consistent.
    fn value(&self, y: &DVector<f64>, mu: f64) -> f64 {
        let phi = self.phi(y);
        let mut divergence = 0.0;
        for (j, reference) in self.limits.references.iter().enumerate() {
            let Some(cholesky) = pseudo_inertia(&block(&phi, j)).cholesky() else { return f64::INFINITY };
            let pseudo = pseudo_inertia(&block(&phi, j));
            let log_det: f64 = (0..4).map(|i| 2.0 * cholesky.l_dirty()[(i, i)].ln()).sum();
            divergence += (reference * pseudo).trace() - log_det;
        }
        for slab in &self.limits.slabs {
            let t = slab.row.dot(&block(&phi, slab.link));
            if t.is_nan() || t <= 0.0 {
                return f64::INFINITY;
            }
            divergence += t - t.ln();
        }
        0.5 * (&self.rows * y - &self.right).norm_squared()
            + 0.5 * self.prior_weight * y.norm_squared()
            + mu * divergence
    }

    /// Minimum for the weight `target` of the divergence. Continuation from the prior, which is the
    /// minimum for a large weight, reduces the weight tenfold per step: far from the minimum a
    /// small weight would make Newton's method converge slowly along the boundary of consistency.
    fn solve(&self, target: f64) -> Result<ConsistentLinks, IdentifyError> {
        let m = self.root.ncols();
        let gram = self.rows.tr_mul(&self.rows) + DMatrix::identity(m, m) * self.prior_weight;
        let mut y = DVector::zeros(m);
        let misfit = 0.5 * self.right.norm_squared();
        let mut mu = target.max(misfit);
        let mut steps = 0;
        let hessian = loop {
            let hessian = self.descend(mu, &gram, &mut y, &mut steps)?;
            if mu <= target {
                break hessian;
            }
            mu = (0.1 * mu).max(target);
        };
        self.at_minimum(&y, &hessian, steps)
    }

    /// Minimum for the weight `target`, from consistent links `phi` of the body's mass near it.
    fn solve_from(&self, phi: &DVector<f64>, target: f64) -> Result<ConsistentLinks, IdentifyError> {
        let m = self.root.ncols();
        let gram = self.rows.tr_mul(&self.rows) + DMatrix::identity(m, m) * self.prior_weight;
        let mut y = &self.back * (phi - &self.start);
        let mut steps = 0;
        let hessian = self.descend(target, &gram, &mut y, &mut steps)?;
        self.at_minimum(&y, &hessian, steps)
    }

    fn at_minimum(
        &self,
        y: &DVector<f64>,
        hessian: &DMatrix<f64>,
        steps: usize,
    ) -> Result<ConsistentLinks, IdentifyError> {
        let phi = self.phi(y);
        let inverse = hessian
            .clone()
            .cholesky()
            .ok_or_else(|| IdentifyError::Numeric("the curvature of the link problem is singular".to_owned()))?
            .inverse();
        // noise of the rows, and the bias from the prior and the divergence: with their curvature λ
        // + μD, and a truth distributed about the prior with unit variance, the bias term has the
        // variance (λ + μD)²
        let by_rows = self.rows.tr_mul(&self.rows);
        let pull = hessian - &by_rows;
        let bias = &pull * &pull;
        let middle = by_rows + &bias;
        let response = &self.root * &inverse * self.root.transpose();
        let known = &self.root * (&inverse * bias * &inverse) * self.root.transpose();
        let covariance = &self.root * (&inverse * middle * &inverse) * self.root.transpose();
        let n = self.limits.references.len();
        let phi_links: Vec<Phi> = (0..n).map(|j| block(&phi, j)).collect();
        let smallest = phi_links
            .iter()
            .map(|p| {
                let eigenvalues = central_second_moment(p).symmetric_eigenvalues();
                eigenvalues.min() / eigenvalues.max()
            })
            .fold(f64::INFINITY, f64::min);
        let effects = self.effects.of(&phi);
        Ok(ConsistentLinks {
            phi: phi_links,
            covariance,
            response,
            known,
            prior_covariance: self.covariance.clone(),
            second_order: self.second_order.clone(),
            effects,
            steps,
            smallest_eigenvalue: smallest,
        })
    }

    /// Newton steps to the minimum for one weight of the divergence; returns the curvature there.
    fn descend(
        &self,
        mu: f64,
        gram: &DMatrix<f64>,
        y: &mut DVector<f64>,
        steps: &mut usize,
    ) -> Result<DMatrix<f64>, IdentifyError> {
        const MOST_STEPS: usize = 100;
        let basis = pseudo_basis();
        let mut value = self.value(y, mu);
        // rounding error of the objective, and a value small against its unit: half a squared
        // standard deviation
        let enough = |value: f64| 1e-9_f64.max(1e-12 * value);
        for _ in 0..MOST_STEPS {
            let phi = self.phi(y);
            let (gradient_phi, blocks) = self.divergence(&phi, &basis);
            let gradient = self.rows.tr_mul(&(&self.rows * &*y - &self.right))
                + &*y * self.prior_weight
                + self.root.tr_mul(&gradient_phi) * mu;
            let mut hessian = gram.clone();
            for (j, curvature) in blocks.iter().enumerate() {
                let rows = self.root.rows(10 * j, 10);
                hessian += rows.tr_mul(&(curvature * rows * mu));
            }
            let Some(cholesky) = hessian.clone().cholesky() else {
                return Err(IdentifyError::Numeric(
                    "the curvature of the link problem is not positive definite".to_owned(),
                ));
            };
            let step = cholesky.solve(&gradient);
            let decrement = gradient.dot(&step);
            *steps += 1;
            if decrement < enough(value) {
                return Ok(hessian);
            }
            let mut length = 1.0;
            loop {
                let candidate = &*y - &step * length;
                let next = self.value(&candidate, mu);
                if next <= value - 1e-4 * length * decrement {
                    *y = candidate;
                    value = next;
                    break;
                }
                length *= 0.5;
                if length < 1e-12 {
                    // the objective no longer decreases beyond rounding
                    return if decrement < 1e-4 { Ok(hessian) } else { Err(no_minimum(*steps)) };
                }
            }
        }
        Err(no_minimum(*steps))
    }

    /// Gradient of the divergence with respect to φ and its curvature, link by link.
    fn divergence(&self, phi: &DVector<f64>, basis: &[Matrix4<f64>; 10]) -> (DVector<f64>, Vec<SMatrix<f64, 10, 10>>) {
        let mut gradient = DVector::zeros(phi.len());
        let mut blocks = Vec::with_capacity(self.limits.references.len());
        for (j, reference) in self.limits.references.iter().enumerate() {
            // callers evaluate this only where every link is consistent
            let inverse = pseudo_inertia(&block(phi, j)).cholesky().map_or(*reference, |c| c.inverse());
            let difference = reference - inverse;
            let products: [Matrix4<f64>; 10] = std::array::from_fn(|k| inverse * basis[k]);
            for k in 0..10 {
                gradient[10 * j + k] = difference.dot(&basis[k]);
            }
            blocks.push(SMatrix::from_fn(|a, b| products[a].dot(&products[b].transpose())));
        }
        for slab in &self.limits.slabs {
            let t = slab.row.dot(&block(phi, slab.link));
            let mut own = gradient.rows_mut(10 * slab.link, 10);
            own += slab.row * (1.0 - 1.0 / t);
            blocks[slab.link] += slab.row * slab.row.transpose() / (t * t);
        }
        (gradient, blocks)
    }
}

impl EffectsOf {
    fn of(&self, phi: &DVector<f64>) -> DVector<f64> {
        if self.right.is_empty() {
            return DVector::zeros(0);
        }
        &self.inverse * (&self.right - &self.coupling * (&self.from_full * phi))
    }
}

fn no_minimum(steps: usize) -> IdentifyError {
    IdentifyError::Numeric(format!("consistent links: no minimum after {steps} steps"))
}

fn block(phi: &DVector<f64>, j: usize) -> Phi {
    phi.fixed_rows::<10>(10 * j).into()
}

/// ∂J/∂φ_k.
fn pseudo_basis() -> [Matrix4<f64>; 10] {
    std::array::from_fn(|k| {
        let mut unit = Phi::zeros();
        unit[k] = 1.0;
        pseudo_inertia(&unit)
    })
}

/// Columns that span all changes of φ that keep the total mass, scaled by the prior covariance, and
/// their pseudo-inverse.
fn mass_keeping_root(covariance: &DMatrix<f64>) -> Result<(DMatrix<f64>, DMatrix<f64>), IdentifyError> {
    let n = covariance.nrows();
    let masses = DVector::from_fn(n, |i, _| if i % 10 == 0 { 1.0 } else { 0.0 });
    let cross = covariance * &masses;
    let variance = masses.dot(&cross);
    // with one link the mass is fixed, so this direction has no variance left
    let conditional = covariance - &cross * cross.transpose() / variance;
    let root = covariance_root(covariance)?;
    let inverse = root
        .clone()
        .try_inverse()
        .ok_or_else(|| IdentifyError::Numeric("the prior covariance of the links is singular".to_owned()))?;
    let whitened = &inverse * conditional * inverse.transpose();
    let eigen = (0.5 * (&whitened + whitened.transpose())).symmetric_eigen();
    // in whitened coordinates the conditional covariance is a projector: one eigenvalue is zero,
    // the others are one
    let kept: Vec<usize> = (0..n).filter(|&i| eigen.eigenvalues[i] > 0.5).collect();
    let along = eigen.eigenvectors.select_columns(&kept);
    Ok((&root * &along, along.tr_mul(&inverse)))
}

/// Derivatives of mass, centre of mass (x y z) and inertia about it (xx yy zz yz zx xy) with
/// respect to φ, one per row.
pub(crate) fn gradient(phi: &Phi) -> SMatrix<f64, 10, 10> {
    let (m, c) = (phi[0], LinkInertia::from_phi(phi).com_m);
    let mut out = SMatrix::<f64, 10, 10>::zeros();
    out[(0, 0)] = 1.0;
    for k in 0..3 {
        out[(1 + k, 0)] = -c[k] / m;
        out[(1 + k, 1 + k)] = 1.0 / m;
    }
    let pairs = [(0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1)];
    for (&(a, b), k) in pairs.iter().zip(4..) {
        // I_com = I_O − (|mc|² 1 − mc mcᵀ) / m
        out[(k, k)] = 1.0;
        let delta = if a == b { 1.0 } else { 0.0 };
        out[(k, 0)] = delta * c.norm_squared() - c[a] * c[b];
        for i in 0..3 {
            let by = 2.0 * delta * c[i] - if i == a { c[b] } else { 0.0 } - if i == b { c[a] } else { 0.0 };
            out[(k, 1 + i)] -= by;
        }
    }
    out
}

/// Mass, centre of mass and inertia about it with standard deviations, from φ and its covariance
/// (first order).
pub(crate) fn link_with_sd(phi: &Phi, covariance: &SMatrix<f64, 10, 10>) -> (LinkInertia, LinkSd) {
    let by = gradient(phi);
    let sd = (by * covariance * by.transpose()).diagonal().map(|v| v.max(0.0).sqrt());
    (LinkInertia::from_phi(phi), LinkSd::of(sd.as_slice()))
}

/// Standard deviations of a link's properties.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LinkSd {
    /// Standard deviation of the mass, kg.
    pub mass_kg: f64,
    /// Standard deviation of the centre of mass, m, link axes.
    pub com_m: Vector3<f64>,
    /// Standard deviation of the inertia about the centre of mass, kg·m²: xx yy zz yz zx xy.
    pub inertia_kgm2: [f64; 6],
}

impl LinkSd {
    /// From the ten numbers in the order of [`gradient`].
    pub(crate) fn of(sd: &[f64]) -> Self {
        let at = |i: usize| sd.get(i).copied().unwrap_or(f64::NAN);
        Self {
            mass_kg: at(0),
            com_m: Vector3::new(at(1), at(2), at(3)),
            inertia_kgm2: std::array::from_fn(|i| at(4 + i)),
        }
    }
}

/// Second moments of mass about the centre of mass, kg·m². With positive mass, the link is
/// consistent if and only if this matrix is positive definite.
fn central_second_moment(phi: &Phi) -> Matrix3<f64> {
    let i = LinkInertia::from_phi(phi).inertia_com_kgm2;
    Matrix3::identity() * (0.5 * i.trace()) - i
}

/// Consistent parameters near arbitrary ones of a single link of positive mass: eigenvalues of the
/// second moment about the centre of mass are raised to at least `floor` times the largest one
/// (which is itself raised to at least `floor` squared centimetres times the mass).
pub fn clipped(phi: &Phi, floor: f64) -> Phi {
    let mut link = LinkInertia::from_phi(phi);
    let eigen = central_second_moment(phi).symmetric_eigen();
    let least = floor * eigen.eigenvalues.max().max(1e-4 * link.mass_kg);
    let clipped = Matrix3::from_diagonal(&eigen.eigenvalues.map(|l| l.max(least)));
    let second = eigen.eigenvectors * clipped * eigen.eigenvectors.transpose();
    link.inertia_com_kgm2 = Matrix3::identity() * second.trace() - second;
    link.to_phi()
}
