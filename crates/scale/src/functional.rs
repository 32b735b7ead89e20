//! Functional calibration: joint centres and axes from the relative motion of two rigid segments.
//!
//! * [`score`]: symmetrical centre of rotation, Ehrig, Taylor, Duda, Heller, *J Biomech* 39 (2006)
//!   2798.
//! * [`sara`]: symmetrical axis of rotation, Ehrig, Taylor, Duda, Heller, *J Biomech* 40 (2007)
//!   2150.
//!
//! The input poses ([`aloft_body::rigid::fit_pose_of_seen`]) must be of the same frames. For
//! objects the result is refined afterwards ([`crate::scale_object`]).

use crate::ScaleError;
use crate::geometry::unit;
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Vector3};

/// A centre of rotation seen from both segments.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FunctionalCentre {
    /// In the parent's frame, m.
    pub in_parent: Vector3<f64>,
    /// In the child's frame, m.
    pub in_child: Vector3<f64>,
    /// Root mean square distance of the two world points over the frames, m.
    pub residual_rms_m: f64,
    /// Smallest over largest singular value of the system; below about 0.05 the motion is nearly
    /// about one axis.
    pub conditioning: f64,
}

/// An axis of rotation seen from both segments; the points are those on the axis nearest to each
/// frame's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FunctionalAxis {
    /// Point of the axis in the parent's frame, m.
    pub point_in_parent: Vector3<f64>,
    /// Direction in the parent's frame, unit.
    pub direction_in_parent: Vector3<f64>,
    /// Point of the axis in the child's frame, m (not the same material point as
    /// `point_in_parent`).
    pub point_in_child: Vector3<f64>,
    /// Direction in the child's frame, unit, same sense.
    pub direction_in_child: Vector3<f64>,
    /// Root mean square distance between the two lines' foot points over the frames, m.
    pub residual_rms_m: f64,
    /// Smallest over second smallest singular value: small if the motion has one distinct axis.
    pub axis_clarity: f64,
}

/// The stacked system `R_p c_p − R_c c_c = t_c − t_p` of both methods, reduced to its normal
/// equations.
fn normal_equations(
    parent: &[Isometry3<f64>],
    child: &[Isometry3<f64>],
) -> Result<(DMatrix<f64>, DVector<f64>, f64), ScaleError> {
    if parent.len() != child.len() || parent.len() < 3 {
        return Err(ScaleError::Functional {
            problem: format!(
                "{} parent and {} child poses; at least three common ones are needed",
                parent.len(),
                child.len()
            ),
        });
    }
    let mut h = DMatrix::zeros(6, 6);
    let mut g = DVector::zeros(6);
    let mut square = 0.0;
    for (p, c) in parent.iter().zip(child) {
        let rp = p.rotation.to_rotation_matrix().into_inner();
        let rc = c.rotation.to_rotation_matrix().into_inner();
        let d = c.translation.vector - p.translation.vector;
        if !d.iter().chain(rp.iter()).chain(rc.iter()).all(|x| x.is_finite()) {
            return Err(ScaleError::Functional { problem: "a pose is not finite".into() });
        }
        let cross: Matrix3<f64> = rp.transpose() * rc;
        for i in 0..3 {
            h[(i, i)] += 1.0;
            h[(i + 3, i + 3)] += 1.0;
            for j in 0..3 {
                h[(i, j + 3)] -= cross[(i, j)];
                h[(j + 3, i)] -= cross[(i, j)];
            }
        }
        let gp = rp.transpose() * d;
        let gc = -(rc.transpose() * d);
        for i in 0..3 {
            g[i] += gp[i];
            g[i + 3] += gc[i];
        }
        square += d.norm_squared();
    }
    Ok((h, g, square))
}

struct Decomposed {
    /// In ascending order.
    values: Vec<f64>,
    vectors: DMatrix<f64>,
}

fn decompose(h: &DMatrix<f64>) -> Decomposed {
    let eigen = h.clone().symmetric_eigen();
    let mut order: Vec<usize> = (0..h.nrows()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    let values = order.iter().map(|&i| eigen.eigenvalues[i].max(0.0)).collect();
    let vectors = DMatrix::from_fn(h.nrows(), h.nrows(), |r, c| eigen.eigenvectors[(r, order[c])]);
    Decomposed { values, vectors }
}

fn rms(h: &DMatrix<f64>, g: &DVector<f64>, square: f64, x: &DVector<f64>, n: usize) -> f64 {
    ((x.dot(&(h * x)) - 2.0 * g.dot(x) + square).max(0.0) / n as f64).sqrt()
}

/// Centre of rotation between two segments (SCoRE).
///
/// # Errors
/// [`ScaleError::Functional`] with fewer than three frames, or if the motion does not determine the
/// centre along an axis (use [`sara`] for a hinge).
pub fn score(parent: &[Isometry3<f64>], child: &[Isometry3<f64>]) -> Result<FunctionalCentre, ScaleError> {
    let (h, g, square) = normal_equations(parent, child)?;
    let d = decompose(&h);
    let conditioning = (d.values[0] / d.values[5]).sqrt();
    if conditioning < 1e-6 {
        return Err(ScaleError::Functional {
            problem: "the segments turn about one axis only: their centre is a line".into(),
        });
    }
    let mut x = DVector::zeros(6);
    for k in 0..6 {
        let v = d.vectors.column(k);
        x += v * (v.dot(&g) / d.values[k]);
    }
    Ok(FunctionalCentre {
        in_parent: Vector3::new(x[0], x[1], x[2]),
        in_child: Vector3::new(x[3], x[4], x[5]),
        residual_rms_m: rms(&h, &g, square, &x, parent.len()),
        conditioning,
    })
}

/// Axis of rotation between two segments (SARA). The sign of the direction is arbitrary, but the
/// same in both segments.
///
/// # Errors
/// [`ScaleError::Functional`] with fewer than three frames or if the segments do not rotate
/// relative to each other.
pub fn sara(parent: &[Isometry3<f64>], child: &[Isometry3<f64>]) -> Result<FunctionalAxis, ScaleError> {
    let (h, g, square) = normal_equations(parent, child)?;
    let d = decompose(&h);
    let axis_clarity = (d.values[0] / d.values[1].max(f64::MIN_POSITIVE)).sqrt();
    if d.values[1] < 1e-6 * d.values[5] {
        return Err(ScaleError::Functional {
            problem: format!(
                "the segments hardly turn against each other (singular values {:.2e}, {:.2e} of {:.2e})",
                d.values[0].sqrt(),
                d.values[1].sqrt(),
                d.values[5].sqrt()
            ),
        });
    }
    // Minimum-norm solution, excluding the null direction, which is the axis.
    let mut x = DVector::zeros(6);
    for k in 1..6 {
        let v = d.vectors.column(k);
        x += v * (v.dot(&g) / d.values[k]);
    }
    let v = d.vectors.column(0);
    let open = || ScaleError::Functional { problem: "no axis was found".into() };
    let direction_in_parent = unit(&Vector3::new(v[0], v[1], v[2])).ok_or_else(open)?;
    let direction_in_child = unit(&Vector3::new(v[3], v[4], v[5])).ok_or_else(open)?;
    let foot = |p: Vector3<f64>, a: &Vector3<f64>| p - a * a.dot(&p);
    Ok(FunctionalAxis {
        point_in_parent: foot(Vector3::new(x[0], x[1], x[2]), &direction_in_parent),
        direction_in_parent,
        point_in_child: foot(Vector3::new(x[3], x[4], x[5]), &direction_in_child),
        direction_in_child,
        residual_rms_m: rms(&h, &g, square, &x, parent.len()),
        axis_clarity,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::apply;
    use nalgebra::{Translation3, UnitQuaternion};

    fn swing(i: usize) -> Isometry3<f64> {
        let t = i as f64 * 0.17;
        Isometry3::from_parts(
            Translation3::new(0.3 * t.sin(), 0.2 * (1.3 * t).cos(), 1.0 + 0.1 * t.sin()),
            UnitQuaternion::from_euler_angles(0.4 * t.sin(), 0.3 * (0.7 * t).cos(), 0.5 * t),
        )
    }

    #[test]
    fn score_finds_the_centre() {
        let (cp, cc) = (Vector3::new(0.05, -0.2, 0.1), Vector3::new(0.01, 0.3, -0.02));
        let parent: Vec<_> = (0..60).map(swing).collect();
        let child: Vec<_> = parent
            .iter()
            .enumerate()
            .map(|(i, p)| {
                let r = p.rotation
                    * UnitQuaternion::from_euler_angles(
                        0.5 * (i as f64 * 0.3).sin(),
                        0.4 * (i as f64 * 0.2).cos(),
                        0.1,
                    );
                Isometry3::from_parts(Translation3::from(apply(p, &cp) - r * cc), r)
            })
            .collect();
        let c = score(&parent, &child).unwrap();
        assert!((c.in_parent - cp).norm() < 1e-10 && (c.in_child - cc).norm() < 1e-10);
        assert!(c.residual_rms_m < 1e-7);
    }

    #[test]
    fn sara_finds_the_axis_and_score_refuses_a_hinge() {
        let axis = Vector3::new(0.2, 1.0, -0.4).normalize();
        let point = Vector3::new(0.05, 0.0, 0.1);
        let zero = UnitQuaternion::from_euler_angles(0.3, -0.2, 0.9);
        let parent: Vec<_> = (0..80).map(swing).collect();
        let child: Vec<_> = parent
            .iter()
            .enumerate()
            .map(|(i, p)| {
                let turn = UnitQuaternion::from_scaled_axis(axis * (i as f64 * 0.25).sin());
                let r = p.rotation * turn * zero;
                let at = apply(p, &(point + turn * (zero * Vector3::new(0.2, 0.0, 0.0))));
                Isometry3::from_parts(Translation3::from(at), r)
            })
            .collect();
        let a = sara(&parent, &child).unwrap();
        assert!(a.direction_in_parent.cross(&axis).norm() < 1e-9);
        assert!((a.point_in_parent - point).cross(&axis).norm() < 1e-9);
        assert!(((zero * a.direction_in_child) - a.direction_in_parent).norm() < 1e-8);
        assert!(a.residual_rms_m < 1e-7);
        assert!(score(&parent, &child).is_err());
        let still = vec![parent[0]; 20];
        assert!(sara(&still, &still).is_err());
    }
}
