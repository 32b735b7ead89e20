//! Prior of the parameters before any motion: mean and covariance of every link, mapped to base
//! parameters.
//!
//! A link's ten parameters depend on ten interpretable numbers: relative mass, three shifts of the
//! centre of mass, three logarithmic stretches of the mass distribution along the link's axes
//! (radii of gyration) and three shears (directions of the principal axes). Their standard
//! deviations come from [`aloft_body::subject::PriorSd`]; a linear map converts them to φ. Left and
//! right limbs are correlated, and links on the midline keep their mass near the plane of symmetry:
//! single sides are less well determined than their sum, and without this constraint noise first
//! causes a false lateral shift of the whole body.

use crate::IdentifyError;
use aloft_body::subject::PriorSd;
use aloft_body::{BaseParameters, LinkBox, LinkInertia, Model, Phi, Subject};
use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, Vector3};
use serde::{Deserialize, Serialize};

/// Mirror symmetry of links, and its strength.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Symmetry {
    /// Pairs of mirrored links.
    pub pairs: Vec<(usize, usize)>,
    /// Links that the plane of symmetry cuts in half.
    pub midline: Vec<usize>,
    /// Link axis (0 x, 1 y, 2 z) perpendicular to the plane of symmetry, the same in every link.
    pub axis: usize,
    /// Correlation of mirrored parameters, 0 (none) to below 1. Asymmetry of midline links shrinks
    /// by √(1 − correlation).
    pub correlation: f64,
}

impl Symmetry {
    /// Pairs links by the endings `_l` and `_r`; other links count as midline if there is at least
    /// one pair. Axis z (to the right), correlation 0.9. `None` if no pair is found.
    pub fn from_names(model: &Model) -> Option<Self> {
        let mut pairs = Vec::new();
        let mut midline = Vec::new();
        for (i, link) in model.links.iter().enumerate() {
            if let Some(stem) = link.name.strip_suffix("_l") {
                let other = format!("{stem}_r");
                if let Some(j) = model.links.iter().position(|l| l.name == other) {
                    pairs.push((i, j));
                }
            } else if !link.name.ends_with("_r") {
                midline.push(i);
            }
        }
        if pairs.is_empty() { None } else { Some(Self { pairs, midline, axis: 2, correlation: 0.9 }) }
    }
}

/// Prior of all links' parameters, 10 n.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkPrior {
    /// Prior inertias.
    pub links: Vec<LinkInertia>,
    /// Their φ stacked, 10 n.
    pub mean: DVector<f64>,
    /// Covariance of the stacked φ, (10 n)².
    pub covariance: DMatrix<f64>,
    /// Covariance of the ten numbers of all links, (10 n)²; see the module's description.
    pub numbers: DMatrix<f64>,
    /// For each link the box that holds its mass, if one is known; empty if none is.
    pub boxes: Vec<Option<LinkBox>>,
}

/// Standard deviation of the shears as a share of that of the radii.
const SHEAR_SHARE: f64 = 0.5;

impl LinkPrior {
    /// Prior of a subject, with the symmetry of its model's link names.
    ///
    /// # Errors
    /// As [`LinkPrior::new`].
    pub fn of_subject(subject: &Subject) -> Result<Self, IdentifyError> {
        let symmetry = Symmetry::from_names(&subject.model);
        let prior = Self::new(&subject.prior, &subject.prior_sd, symmetry.as_ref())?;
        Ok(Self { boxes: subject.boxes.clone(), ..prior })
    }

    /// Prior of links with their standard deviations.
    ///
    /// # Errors
    /// [`IdentifyError::Length`] if the number of standard deviations differs from that of links,
    /// [`IdentifyError::Option`] for an invalid deviation, mass or correlation.
    pub fn new(links: &[LinkInertia], sd: &[PriorSd], symmetry: Option<&Symmetry>) -> Result<Self, IdentifyError> {
        let n = links.len();
        if sd.len() != n {
            return Err(IdentifyError::Length {
                what: "standard deviations of the prior",
                expected: n,
                found: sd.len(),
            });
        }
        let bad = |problem: String| IdentifyError::Option { option: "prior", problem };
        for (i, (link, sd)) in links.iter().zip(sd).enumerate() {
            let positive =
                [link.mass_kg, sd.mass_rel, sd.com_m, sd.radius_rel].iter().all(|x| *x > 0.0 && x.is_finite());
            if !positive {
                return Err(bad(format!("link {i}: mass and standard deviations must be positive")));
            }
            if !(0.0..1.0).contains(&sd.together) {
                return Err(bad(format!("link {i}: correlation {} of the radii", sd.together)));
            }
        }
        let mut mean = DVector::zeros(10 * n);
        let mut map = DMatrix::zeros(10 * n, 10 * n);
        let mut numbers = DMatrix::zeros(10 * n, 10 * n);
        for (i, (link, sd)) in links.iter().zip(sd).enumerate() {
            mean.rows_mut(10 * i, 10).copy_from(&link.to_phi());
            map.view_mut((10 * i, 10 * i), (10, 10)).copy_from(&variation(
                link,
                &second_moment(link),
                &STRAINS.map(unit_strain),
            ));
            for (k, s) in deviations(sd).iter().enumerate() {
                numbers[(10 * i + k, 10 * i + k)] = s * s;
            }
        }
        if let Some(symmetry) = symmetry {
            symmetry.check(n).map_err(bad)?;
            let odd = odd_numbers(symmetry.axis);
            for &i in &symmetry.midline {
                for &k in &odd {
                    numbers[(10 * i + k, 10 * i + k)] *= 1.0 - symmetry.correlation;
                }
            }
            for &(i, j) in &symmetry.pairs {
                for k in 0..10 {
                    let sign = if odd.contains(&k) { -1.0 } else { 1.0 };
                    let product: f64 = numbers[(10 * i + k, 10 * i + k)] * numbers[(10 * j + k, 10 * j + k)];
                    let covariance = sign * symmetry.correlation * product.sqrt();
                    numbers[(10 * i + k, 10 * j + k)] = covariance;
                    numbers[(10 * j + k, 10 * i + k)] = covariance;
                }
            }
        }
        // what the radii of all links share
        let shared = DVector::from_fn(10 * n, |i, _| {
            let sd = &sd[i / 10];
            if (4..7).contains(&(i % 10)) { sd.together.sqrt() * sd.radius_rel } else { 0.0 }
        });
        for (i, j) in (0..10 * n).flat_map(|i| (0..10 * n).map(move |j| (i, j))) {
            let radii = |i: usize| if shared[i] > 0.0 { (1.0 - sd[i / 10].together).sqrt() } else { 1.0 };
            numbers[(i, j)] = radii(i) * radii(j) * numbers[(i, j)] + shared[i] * shared[j];
        }
        let mut covariance = &map * &numbers * map.transpose();
        for (i, (link, sd)) in links.iter().zip(sd).enumerate() {
            let mut block = covariance.fixed_view_mut::<10, 10>(10 * i, 10 * i);
            block += of_second_order(link.mass_kg, sd.com_m);
        }
        Ok(Self { links: links.to_vec(), mean, covariance, numbers, boxes: Vec::new() })
    }

    /// The same prior in base parameters.
    ///
    /// # Errors
    /// [`IdentifyError::Length`] when the base parameters belong to another model.
    pub fn base(&self, base: &BaseParameters) -> Result<Prior, IdentifyError> {
        if base.from_full.ncols() != self.mean.len() {
            return Err(IdentifyError::Length {
                what: "link parameters of the prior",
                expected: base.from_full.ncols(),
                found: self.mean.len(),
            });
        }
        Ok(Prior::of_links(base, &self.mean, &self.covariance))
    }

    /// The parameters of each link.
    pub fn phi(&self) -> Vec<Phi> {
        self.links.iter().map(LinkInertia::to_phi).collect()
    }
}

impl Symmetry {
    fn check(&self, n: usize) -> Result<(), String> {
        let indices = self.pairs.iter().flat_map(|&(i, j)| [i, j]).chain(self.midline.iter().copied());
        let mut seen = vec![false; n];
        for i in indices {
            match seen.get_mut(i) {
                Some(seen @ false) => *seen = true,
                Some(true) => return Err(format!("link {i} is named twice in the symmetry")),
                None => return Err(format!("the symmetry names link {i}, there are {n}")),
            }
        }
        if self.axis > 2 {
            return Err(format!("axis {} of the symmetry", self.axis));
        }
        if !(0.0..1.0).contains(&self.correlation) {
            return Err(format!("correlation {} of the symmetry", self.correlation));
        }
        Ok(())
    }
}

/// Standard deviations of the ten numbers: mass, shifts x y z, stretches x y z, shears yz zx xy.
fn deviations(sd: &PriorSd) -> [f64; 10] {
    let (m, c, r, s) = (sd.mass_rel, sd.com_m, sd.radius_rel, SHEAR_SHARE * sd.radius_rel);
    [m, c, c, c, r, r, r, s, s, s]
}

/// Indices of the ten numbers that change sign under reflection across `axis`.
fn odd_numbers(axis: usize) -> [usize; 3] {
    // shear 7 is yz, 8 zx, 9 xy: those that contain the axis are odd
    match axis {
        0 => [1, 8, 9],
        1 => [2, 7, 9],
        _ => [3, 7, 8],
    }
}

/// Covariance of the terms neglected by the linear map: a shift d of the centre of mass also adds m
/// d dᵀ to the second moments about the origin. For limbs thinner than the shift's standard
/// deviation s this term is as large as that of the radii: without it a shift would require a
/// change of thickness. Expected squares: 3 m² s⁴ on the diagonal, m² s⁴ off the diagonal.
fn of_second_order(mass_kg: f64, com_sd_m: f64) -> SMatrix<f64, 10, 10> {
    let size = mass_kg * com_sd_m * com_sd_m;
    let mut map = SMatrix::<f64, 10, 6>::zeros();
    for k in 0..3 {
        // I = tr(Σ) 1 − Σ
        for (row, share) in [(4, 1.0), (5, 1.0), (6, 1.0)] {
            map[(row, k)] = share;
        }
        map[(4 + k, k)] -= 1.0;
        map[(7 + k, 3 + k)] = -1.0;
    }
    let squares = SMatrix::<f64, 6, 1>::from_column_slice(&[3.0, 3.0, 3.0, 1.0, 1.0, 1.0]) * (size * size);
    map * SMatrix::<f64, 6, 6>::from_diagonal(&squares) * map.transpose()
}

/// Second moments of mass about the centre of mass, kg·m².
fn second_moment(link: &LinkInertia) -> Matrix3<f64> {
    let i = link.inertia_com_kgm2;
    Matrix3::identity() * (0.5 * i.trace()) - i
}

/// The link that differs from `own` by ten numbers, and ∂φ/∂(ten numbers) there; `None` if they
/// overflow. The numbers are the logarithm of the ratio of masses, the shift of the centre of mass,
/// and the strain E (Hencky's) with which the second moments S per unit of mass about the centres
/// of mass are `S = exp(E) S₀ exp(E)`. Its logarithm makes a size and its inverse equally likely
/// and independent of the shape: with `1 + E` a link whose ratios differ from the table's is pulled
/// to a smaller size.
pub(crate) fn deformed(own: &Phi, x: &SMatrix<f64, 10, 1>) -> Option<(Phi, SMatrix<f64, 10, 10>)> {
    let from = LinkInertia::from_phi(own);
    let before = second_moment(&from) / from.mass_kg;
    let mut e = Matrix3::zeros();
    for (k, &(a, b)) in STRAINS.iter().enumerate() {
        (e[(a, b)], e[(b, a)]) = (x[4 + k], x[4 + k]);
    }
    let eigen = e.symmetric_eigen();
    let stretch =
        eigen.eigenvectors * Matrix3::from_diagonal(&eigen.eigenvalues.map(f64::exp)) * eigen.eigenvectors.transpose();
    let (_, by_strain) = logarithm(&stretch)?;
    let mass_kg = from.mass_kg * x[0].exp();
    let behind = before * stretch * mass_kg;
    let second = stretch * behind;
    let to = LinkInertia {
        mass_kg,
        com_m: from.com_m + x.fixed_rows::<3>(1),
        inertia_com_kgm2: Matrix3::identity() * second.trace() - second,
    };
    let phi = to.to_phi();
    phi.iter().all(|v| v.is_finite()).then(|| (phi, variation(&to, &behind, &by_strain)))
}

/// Logarithm E of a symmetric positive definite matrix, and the change of `exp(E)` for each of the
/// changes of E in the order of the ten numbers (Daleckii and Krein).
fn logarithm(stretch: &Matrix3<f64>) -> Option<(Matrix3<f64>, [Matrix3<f64>; 6])> {
    let eigen = stretch.symmetric_eigen();
    if !eigen.eigenvalues.iter().all(|l| *l > 0.0 && l.is_finite()) {
        return None;
    }
    let (v, l) = (&eigen.eigenvectors, &eigen.eigenvalues);
    // divided differences of the exponential between logarithms; of equal ones its derivative
    let divided = Matrix3::from_fn(|i, j| {
        let apart = (l[i] / l[j]).ln();
        if apart.abs() < 1e-8 { l[j] } else { (l[i] - l[j]) / apart }
    });
    let change = STRAINS.map(|at| v * divided.component_mul(&(v.transpose() * unit_strain(at) * v)) * v.transpose());
    Some((v * Matrix3::from_diagonal(&l.map(f64::ln)) * v.transpose(), change))
}

/// Places of the six strains in a symmetric matrix, in the order of the ten numbers.
const STRAINS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1)];

fn unit_strain((a, b): (usize, usize)) -> Matrix3<f64> {
    let mut strain = Matrix3::zeros();
    strain[(a, b)] = 1.0;
    strain[(b, a)] = 1.0;
    strain
}

/// ∂φ/∂(ten numbers) at a link; `behind` is the matrix B for which a change X of the stretch
/// changes the second moments about the centre of mass by `X B + Bᵀ X` (at the prior these moments
/// themselves), `strains` the changes X for each of the six strains.
fn variation(link: &LinkInertia, behind: &Matrix3<f64>, strains: &[Matrix3<f64>; 6]) -> SMatrix<f64, 10, 10> {
    let i = link.inertia_com_kgm2;
    let inertia_of = |s: Matrix3<f64>| Matrix3::identity() * s.trace() - s;
    let about_origin = |mass: f64, com: Vector3<f64>, inertia: Matrix3<f64>| {
        let steiner = Matrix3::identity() * com.norm_squared() - com * com.transpose();
        let full = inertia + steiner * mass;
        Phi::from_column_slice(&[
            mass,
            mass * com.x,
            mass * com.y,
            mass * com.z,
            full[(0, 0)],
            full[(1, 1)],
            full[(2, 2)],
            full[(1, 2)],
            full[(2, 0)],
            full[(0, 1)],
        ])
    };
    let (m, c) = (link.mass_kg, link.com_m);
    let mut out = SMatrix::<f64, 10, 10>::zeros();
    // mass at constant shape
    out.set_column(0, &about_origin(m, c, i));
    for k in 0..3 {
        let mut shift = Vector3::zeros();
        shift[k] = 1.0;
        let cross = (Matrix3::identity() * (2.0 * c.dot(&shift))) - c * shift.transpose() - shift * c.transpose();
        let mut column = about_origin(0.0, Vector3::zeros(), cross * m);
        column[1 + k] = m;
        out.set_column(1 + k, &column);
    }
    for (k, strain) in strains.iter().enumerate() {
        let change = strain * behind + behind.transpose() * strain;
        out.set_column(4 + k, &about_origin(0.0, Vector3::zeros(), inertia_of(change)));
    }
    out
}

/// Prior of the base parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Prior {
    /// Mean, n_base.
    pub mean: DVector<f64>,
    /// Covariance, n_base².
    pub covariance: DMatrix<f64>,
}

impl Prior {
    /// That of links with the stacked φ `mean` and its covariance.
    pub(crate) fn of_links(base: &BaseParameters, mean: &DVector<f64>, covariance: &DMatrix<f64>) -> Self {
        let b = &base.from_full;
        Self { mean: b * mean, covariance: b * covariance * b.transpose() }
    }

    /// Mean and root of the covariance of all base parameters except the mass, conditional on the
    /// mass. The prior given the mass, ready for many systems: the root of its covariance takes
    /// longer than a solution.
    ///
    /// # Errors
    /// [`IdentifyError::Numeric`] for a covariance without a root.
    pub fn prepared(&self, mass_kg: f64) -> Result<PreparedPrior, IdentifyError> {
        let (mean, root) = self.given_mass(self.mean.len(), mass_kg)?;
        Ok(PreparedPrior { mean, root })
    }

    pub(crate) fn given_mass(&self, p: usize, mass_kg: f64) -> Result<(DVector<f64>, DMatrix<f64>), IdentifyError> {
        if self.mean.len() != p || self.covariance.shape() != (p, p) {
            return Err(IdentifyError::Length {
                what: "base parameters of the prior",
                expected: p,
                found: self.mean.len(),
            });
        }
        let variance = self.covariance[(0, 0)];
        let cross = self.covariance.view((1, 0), (p - 1, 1)).into_owned();
        let mut mean = self.mean.rows(1, p - 1).into_owned();
        let mut rest = self.covariance.view((1, 1), (p - 1, p - 1)).into_owned();
        if variance > 0.0 {
            mean += cross.column(0) * ((mass_kg - self.mean[0]) / variance);
            rest -= &cross * cross.transpose() / variance;
        }
        let root = covariance_root(&rest)?;
        Ok((mean, root))
    }
}

/// A [`Prior`] given the mass: mean and a root of the covariance of the other base parameters.
#[derive(Debug, Clone)]
pub struct PreparedPrior {
    pub(crate) mean: DVector<f64>,
    pub(crate) root: DMatrix<f64>,
}

/// Symmetric root of a covariance; eigenvalues at rounding level are raised so that the root can be
/// inverted.
pub(crate) fn covariance_root(covariance: &DMatrix<f64>) -> Result<DMatrix<f64>, IdentifyError> {
    let n = covariance.nrows();
    // scale to correlations first: units differ by orders of magnitude
    let sd = DVector::from_fn(n, |i, _| covariance[(i, i)].max(0.0).sqrt());
    if sd.iter().any(|s| !s.is_finite() || *s == 0.0) {
        return Err(IdentifyError::Numeric(
            "the prior covariance has a variance that is zero or not finite".to_owned(),
        ));
    }
    let correlation = DMatrix::from_fn(n, n, |i, j| 0.5 * (covariance[(i, j)] + covariance[(j, i)]) / (sd[i] * sd[j]));
    let eigen = correlation.symmetric_eigen();
    let floor = 1e-10;
    let roots = eigen.eigenvalues.map(|l| l.max(floor).sqrt());
    Ok(DMatrix::from_diagonal(&sd) * &eigen.eigenvectors * DMatrix::from_diagonal(&roots))
}
