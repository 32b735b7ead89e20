//! Physically consistent links: masses, centres of mass and inertias of a body of positive density
//! that reproduce what motion determined and stay near the prior elsewhere.
//!
//! The unknowns are the ten numbers x of each link by which it differs from the prior
//! ([`crate::prior`]): the logarithm of its mass, shifts of its centre of mass, and the logarithm
//! of the stretch of its mass distribution. Every x is a body of positive density, so nothing has
//! to keep it one. Minimised is
//!
//! ```text
//! ‖R [Bφ(x); θ; −1]‖² / (2 s²)  +  λ/2 xᵀ Λ⁻¹ x        with Σ m(x) the mass of the body
//! ```
//!
//! To first order that is `Σ m₀ x = 0` over the masses, which the root of Λ keeps; what then is
//! left of the second is divided out.
//!
//! The first term is the evidence itself, so base parameters are held as tightly as their
//! covariance allows. In the metric of the noise the errors of the moment rows grow with the
//! inertias: the rows that see inertias are divided by the length that their errors have at φ, over
//! that at the estimate ([`LinkOptions::moment_errors`]). Where the motion gives only the ratios of
//! the inertias, a smaller body then fits no better than a larger one, and the prior alone decides.
//! With errors of a fixed size, the ratios that motion and table know about equally well would fit
//! better in a smaller body: drones came out 8 to 26 % too small.
//!
//! The second term is the prior as it is stated, in relative deviations: a size and its inverse are
//! equally likely, whatever the shape. φ is linear in none of these, so the minimum is found by
//! Newton's method with the full curvature of φ and step halving, from the prior, while the weight
//! of the rows grows to its value: on the way the links follow what the rows fix.
//!
//! Where a box is known that holds the mass of a link (collision geometry), the objective also has
//! a term `μ (t − log t − 1)` for each axis of the box, with `t = ∫ (x − a)(b − x) dm` over the
//! same moment of the prior. It is infinite where mass would lie outside.

use crate::interval::not_negative;
use crate::prior::{covariance_root, deformed};
use crate::system::inverse_triangle;
use crate::{IdentifyError, LinkPrior};
use aloft_body::{BaseParameters, LinkInertia, Phi};
use aloft_regressor::Factor;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix3, SMatrix, Vector3};

/// Weights of the terms.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkOptions {
    /// Variance s² of a row.
    pub row_variance: f64,
    /// Weight λ of the prior.
    pub prior_weight: f64,
    /// Weight μ of the boxes; small, so that it only keeps mass inside.
    pub box_weight: f64,
    /// Rows M over the base parameters with `‖M φ_B‖` the length of the errors that inertias bring
    /// into the rows, 1 at the estimate; none if all errors have a fixed size.
    pub moment_errors: Option<DMatrix<f64>>,
}

/// Consistent parameters of all links.
#[derive(Debug, Clone, PartialEq)]
pub struct ConsistentLinks {
    /// φ of each link.
    pub phi: Vec<Phi>,
    /// Covariance of the stacked φ, (10 n)²: from the curvature at the minimum without the bend of
    /// φ, that of a linear map.
    pub covariance: DMatrix<f64>,
    /// Response of φ to the score of its rows, (10 n)²: the inverse of that curvature, restricted
    /// to changes that keep the mass.
    pub response: DMatrix<f64>,
    /// Part of the covariance due to the bias from the prior and the boxes, (10 n)².
    pub known: DMatrix<f64>,
    /// Effect coefficients belonging to these links.
    pub effects: DVector<f64>,
    /// Number of steps.
    pub steps: usize,
}

impl ConsistentLinks {
    /// Base parameters and effect coefficients of these links.
    pub(crate) fn base(&self, base: &BaseParameters) -> DVector<f64> {
        let all = DVector::from_iterator(10 * self.phi.len(), self.phi.iter().flat_map(|phi| phi.iter().copied()));
        let of_links = &base.from_full * all;
        DVector::from_iterator(of_links.len() + self.effects.len(), of_links.iter().chain(&self.effects).copied())
    }
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
    let weights = [mass_kg, options.row_variance, options.prior_weight, options.box_weight];
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
    Problem::new(merged, base, mass_kg, prior, options)?.solve()
}

/// The prior's links with all masses (and quantities proportional to them) scaled so that they add
/// up to the body mass.
pub(crate) fn scaled_to_mass(prior: &LinkPrior, mass_kg: f64) -> Vec<Phi> {
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
    /// The prior's links, with the mass of the body.
    own: Vec<Phi>,
    mass_kg: f64,
    /// Λ = root · rootᵀ given the mass of the body: x = root · y with y of unit variance.
    root: DMatrix<f64>,
    slabs: Vec<Slab>,
    /// Rows of the stacked φ with the effects eliminated, and their right-hand side, both divided
    /// by s. The first `seeing_inertias` of them are all that see an inertia.
    rows: DMatrix<f64>,
    right: DVector<f64>,
    seeing_inertias: usize,
    /// Errors that inertias bring into these, over the stacked φ.
    moment_errors: Option<DMatrix<f64>>,
    prior_weight: f64,
    box_weight: f64,
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

/// The links of one y: their stacked φ, and its change with y.
struct Links {
    phi: DVector<f64>,
    by_y: DMatrix<f64>,
    /// Factor that gives them the mass of the body.
    to_mass: f64,
}

/// Unit of the base parameters that are inertias.
pub(crate) const INERTIA_UNIT: &str = "kg·m²";

/// Factor between the weights of the rows of successive minima, on which the last does not depend.
const GROWTH: f64 = 10.0;

impl Problem {
    fn new(
        merged: &Factor,
        base: &BaseParameters,
        mass_kg: f64,
        prior: &LinkPrior,
        options: &LinkOptions,
    ) -> Result<Self, IdentifyError> {
        // effects first, so that one triangularisation eliminates them, then the inertias
        let (p, k) = (merged.n_parameters(), merged.n_effects());
        let dense = merged.dense();
        let h = dense.nrows();
        let is_inertia = |j: &usize| base.parameters[*j].unit == INERTIA_UNIT;
        let (inertias, others): (Vec<usize>, Vec<usize>) = (0..p).partition(is_inertia);
        let order: Vec<usize> = inertias.iter().chain(&others).copied().collect();
        let columns: Vec<usize> = (p..p + k).chain(order.iter().copied()).chain([p + k]).collect();
        let stacked =
            faer::Mat::from_fn(h.max(p + k + 1), p + k + 1, |i, j| if i < h { dense[(i, columns[j])] } else { 0.0 });
        let from_full = base.from_full.select_rows(&order);
        let qr = stacked.qr();
        let r = qr.thin_R();
        let get = |i: usize, j: usize| if i <= j { r[(i, j)] } else { 0.0 };
        let effects = EffectsOf {
            inverse: inverse_triangle(&DMatrix::from_fn(k, k, get))?,
            coupling: DMatrix::from_fn(k, p, |i, j| get(i, k + j)),
            right: DVector::from_fn(k, |i, _| get(i, k + p)),
            from_full: from_full.clone(),
        };
        let s = options.row_variance.sqrt();
        let own = scaled_to_mass(prior, mass_kg);
        Ok(Self {
            slabs: slabs(prior, &own)?,
            mass_kg,
            root: mass_keeping(covariance_root(&prior.numbers)?, &own),
            rows: DMatrix::from_fn(p, p, |i, j| get(k + i, k + j)) / s * &from_full,
            right: DVector::from_fn(p, |i, _| get(k + i, k + p)) / s,
            seeing_inertias: inertias.len(),
            moment_errors: options.moment_errors.as_ref().map(|errors| errors * &base.from_full),
            prior_weight: options.prior_weight,
            box_weight: options.box_weight,
            effects,
            own,
        })
    }

    /// The links of y; `None` where a mass distribution overflows.
    fn links(&self, y: &DVector<f64>) -> Option<Links> {
        let x = &self.root * y;
        let n = self.own.len();
        let mut phi = DVector::zeros(10 * n);
        let mut by_x = DMatrix::zeros(10 * n, 10 * n);
        for (j, own) in self.own.iter().enumerate() {
            let (link, map) = deformed(own, &x.fixed_rows::<10>(10 * j).into())?;
            phi.fixed_rows_mut::<10>(10 * j).copy_from(&link);
            by_x.fixed_view_mut::<10, 10>(10 * j, 10 * j).copy_from(&map);
        }
        // the body's mass is given
        let to_mass = self.mass_kg / (0..n).map(|j| phi[10 * j]).sum::<f64>();
        if !(to_mass > 0.0 && to_mass.is_finite()) {
            return None;
        }
        phi *= to_mass;
        by_x *= to_mass;
        let share = DVector::from_fn(10 * n, |i, _| if i % 10 == 0 { phi[i] / self.mass_kg } else { 0.0 });
        by_x.ger(-1.0, &phi, &share, 1.0);
        Some(Links { by_y: by_x * &self.root, phi, to_mass })
    }

    /// What links leave of the rows, in units of their errors, and its change with φ.
    fn residual(&self, phi: &DVector<f64>) -> (DVector<f64>, DMatrix<f64>) {
        let (mut left, mut by_phi) = (&self.rows * phi - &self.right, self.rows.clone());
        if let Some(errors) = &self.moment_errors {
            let along = errors * phi;
            let square = along.norm_squared();
            if square > 0.0 {
                let n = self.seeing_inertias;
                let mut seeing = left.rows_mut(0, n);
                let mut by_phi = by_phi.rows_mut(0, n);
                by_phi.ger(-square.recip(), &seeing, &errors.tr_mul(&along), 1.0);
                by_phi /= square.sqrt();
                seeing /= square.sqrt();
            }
        }
        (left, by_phi)
    }

    /// Value of the objective for a weight of the rows; infinite where mass lies outside a box.
    fn value(&self, y: &DVector<f64>, of_rows: f64) -> f64 {
        let Some(links) = self.links(y) else { return f64::INFINITY };
        let mut boxes = 0.0;
        for slab in &self.slabs {
            let t = slab.row.dot(&block(&links.phi, slab.link));
            if t.is_nan() || t <= 0.0 {
                return f64::INFINITY;
            }
            boxes += t - t.ln();
        }
        0.5 * of_rows * self.residual(&links.phi).0.norm_squared()
            + 0.5 * self.prior_weight * y.norm_squared()
            + self.box_weight * boxes
    }

    fn solve(&self) -> Result<ConsistentLinks, IdentifyError> {
        let m = self.root.ncols();
        let mut y = DVector::zeros(m);
        let start = self.links(&y).ok_or_else(|| no_minimum(0))?;
        let misfit = self.residual(&start.phi).0.norm_squared();
        let mut of_rows = misfit.recip().min(1.0);
        let mut steps = 0;
        loop {
            let hessian = self.descend(of_rows, &mut y, &mut steps)?;
            if of_rows >= 1.0 {
                return self.at_minimum(&y, &hessian, steps);
            }
            of_rows = (of_rows * GROWTH).min(1.0);
        }
    }

    fn at_minimum(
        &self,
        y: &DVector<f64>,
        hessian: &DMatrix<f64>,
        steps: usize,
    ) -> Result<ConsistentLinks, IdentifyError> {
        let links = self.links(y).ok_or_else(|| no_minimum(steps))?;
        let inverse = regular(hessian)
            .ok_or_else(|| IdentifyError::Numeric("the curvature of the link problem is singular".to_owned()))?
            .inverse();
        // noise of the rows, and the bias from the prior and the boxes: with their curvature λ +
        // μD, and a truth distributed about the prior with unit variance, the bias term has the
        // variance (λ + μD)²
        let along = self.residual(&links.phi).1 * &links.by_y;
        let by_rows = along.tr_mul(&along);
        let pull = hessian - &by_rows;
        let bias = &pull * &pull;
        let of = |middle: &DMatrix<f64>| &links.by_y * middle * links.by_y.transpose();
        let known = of(&(&inverse * &bias * &inverse));
        let covariance = of(&(&inverse * (by_rows + bias) * &inverse));
        let phi: Vec<Phi> = (0..self.own.len()).map(|j| block(&links.phi, j)).collect();
        Ok(ConsistentLinks {
            phi,
            covariance,
            response: of(&inverse),
            known,
            effects: self.effects.of(&links.phi),
            steps,
        })
    }

    /// Part of the curvature that comes from the bend of φ(y), for a gradient g by φ. With S the
    /// sum of the masses before they are given that of the body, M, φ = (M/S) φ̂ and h = g −
    /// (g·φ/M) ∂S/∂φ̂, it is `(M/S) h·φ̂″ − (f′ S′ᵀ + S′ f′ᵀ)/S` where `f′ = (M/S) φ̂′ᵀ h` is the
    /// gradient by the numbers. φ̂″ is taken by differences of the links' own maps.
    fn bend(
        &self,
        y: &DVector<f64>,
        links: &Links,
        by_phi: &DVector<f64>,
        gradient: &DVector<f64>,
    ) -> Option<DMatrix<f64>> {
        // logarithms and metres: the maps are smooth over much longer steps
        const STEP: f64 = 1e-4;
        let x = &self.root * y;
        let n = self.own.len();
        let mut held = by_phi.clone();
        let along_mass = by_phi.dot(&links.phi) / self.mass_kg;
        for j in 0..n {
            held[10 * j] -= along_mass;
        }
        let mut bend = DMatrix::zeros(x.len(), x.len());
        for (j, own) in self.own.iter().enumerate() {
            let (at, by) = (x.fixed_rows::<10>(10 * j), held.fixed_rows::<10>(10 * j));
            for k in 0..10 {
                let side = |sign: f64| {
                    let mut moved: SMatrix<f64, 10, 1> = at.into();
                    moved[k] += sign * STEP;
                    deformed(own, &moved).map(|(_, map)| map.tr_mul(&by))
                };
                let column = (side(1.0)? - side(-1.0)?) * (links.to_mass / (2.0 * STEP));
                bend.fixed_view_mut::<10, 1>(10 * j, 10 * j + k).copy_from(&column);
            }
        }
        let shares = DVector::from_fn(10 * n, |i, _| if i % 10 == 0 { links.phi[i] / self.mass_kg } else { 0.0 });
        let along = self.root.tr_mul(&(&bend * &self.root)) - gradient * self.root.tr_mul(&shares).transpose() * 2.0;
        Some(0.5 * (&along + along.transpose()))
    }

    /// Steps to the minimum for one weight of the rows; returns the curvature there, without the
    /// bend of φ.
    fn descend(&self, of_rows: f64, y: &mut DVector<f64>, steps: &mut usize) -> Result<DMatrix<f64>, IdentifyError> {
        const MOST_STEPS: usize = 100;
        let mut value = self.value(y, of_rows);
        // rounding error of the objective, and a value small against its unit: half a squared
        // standard deviation
        let enough = |value: f64| 1e-9_f64.max(1e-12 * value);
        for _ in 0..MOST_STEPS {
            let links = self.links(y).ok_or_else(|| no_minimum(*steps))?;
            let (left, jacobian) = self.residual(&links.phi);
            let along = &jacobian * &links.by_y;
            let mut by_phi = jacobian.tr_mul(&left) * of_rows;
            let mut gradient = &*y * self.prior_weight;
            let mut hessian = along.tr_mul(&along) * of_rows;
            for i in 0..y.len() {
                hessian[(i, i)] += self.prior_weight;
            }
            for slab in &self.slabs {
                let t = slab.row.dot(&block(&links.phi, slab.link));
                let by_y = links.by_y.fixed_rows::<10>(10 * slab.link).tr_mul(&slab.row);
                let mut own = by_phi.fixed_rows_mut::<10>(10 * slab.link);
                own += slab.row * (self.box_weight * (1.0 - t.recip()));
                hessian.ger(self.box_weight / (t * t), &by_y, &by_y, 1.0);
            }
            let of_phi = links.by_y.tr_mul(&by_phi);
            let bend = self.bend(y, &links, &by_phi, &of_phi).ok_or_else(|| no_minimum(*steps))?;
            gradient += of_phi;
            let cholesky = with_bend(&hessian, bend).ok_or_else(|| no_minimum(*steps))?;
            let step = cholesky.solve(&gradient);
            let decrement = gradient.dot(&step);
            *steps += 1;
            if decrement < enough(value) {
                return Ok(hessian);
            }
            let mut length = 1.0;
            loop {
                let candidate = &*y - &step * length;
                let next = self.value(&candidate, of_rows);
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
}

impl EffectsOf {
    fn of(&self, phi: &DVector<f64>) -> DVector<f64> {
        if self.right.is_empty() {
            return DVector::zeros(0);
        }
        &self.inverse * (&self.right - &self.coupling * (&self.from_full * phi))
    }
}

/// A root of the covariance of the numbers without the direction that changes the mass of the body.
fn mass_keeping(root: DMatrix<f64>, own: &[Phi]) -> DMatrix<f64> {
    let masses = DVector::from_fn(root.nrows(), |i, _| if i % 10 == 0 { own[i / 10][0] } else { 0.0 });
    let along = root.tr_mul(&masses).normalize();
    &root - (&root * &along) * along.transpose()
}

/// Cholesky factor of a curvature with its bend, or where that is not positive definite (far from
/// the minimum) with the half, the quarter, … of it.
fn with_bend(hessian: &DMatrix<f64>, mut bend: DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    loop {
        if let Some(found) = (hessian + &bend).cholesky() {
            return Some(found);
        }
        if !bend.amax().is_finite() || bend.amax() < f64::EPSILON * hessian.amax() {
            return regular(hessian);
        }
        bend *= 0.5;
    }
}

/// Cholesky factor of a curvature with its rounding error added: rows without noise weigh so much
/// that the prior's share is lost in it.
fn regular(hessian: &DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    let n = hessian.nrows();
    let rounding = n as f64 * f64::EPSILON * hessian.diagonal().amax();
    (hessian + DMatrix::identity(n, n) * rounding).cholesky()
}

fn no_minimum(steps: usize) -> IdentifyError {
    IdentifyError::Numeric(format!("consistent links: no minimum after {steps} steps"))
}

fn block(phi: &DVector<f64>, j: usize) -> Phi {
    phi.fixed_rows::<10>(10 * j).into()
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
    let sd = (by * covariance * by.transpose()).diagonal().map(|v| not_negative(v).sqrt());
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
