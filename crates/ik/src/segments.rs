//! Each segment's own rigid fit: the noise of its markers, free of any error of the body model.
//!
//! Three markers or more on a link are fitted to their own mean shape in every frame (Kabsch 1976),
//! and that shape is the mean of the fitted frames. What remains is the noise of the markers: a
//! hinge whose axis moves, a joint centre in the wrong place or a marker that was put back
//! elsewhere leave no trace in it, because no joint and no earlier recording takes part. So sizes
//! of errors are read here, and what the model adds to them is stated separately:
//!
//! - *displaced*: how far a marker's mean place in this recording lies from that of the model, the
//!   other markers of its link aligned;
//! - *joints*: the root mean square, per degree of freedom that the joints take away, of what
//!   inverse kinematics leaves beyond the fits of the single links.

use aloft_body::rigid::fit_pose;
use aloft_body::{JointKind, Motion, Subject};
use aloft_trial::Trial;
use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

/// Least extent of a cluster of markers across its longest axis, m.
const MIN_SPREAD_M: f64 = 5e-3;

/// Rounds in which shape and poses are fitted in turn; both settle within two.
const ROUNDS: usize = 3;

/// Rigid fit of the markers of one link in one recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SegmentFit {
    /// Name of the link.
    pub link: String,
    /// Standard deviation of one coordinate of a marker, m.
    pub sd_m: f64,
    /// Degrees of freedom of that number.
    pub freedom: f64,
    /// Labels and how far each marker's mean place lies from that of the model, m.
    pub displaced_m: Vec<(String, f64)>,
}

/// What the joint that carries a link adds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointGap {
    /// Link that the joint carries.
    pub link: String,
    /// Root mean square distance of the joint's centre as the two links place it, m.
    pub centre_m: f64,
    /// Root mean square angle of a hinge's axis as the two links place it, rad; zero for others.
    pub axis_rad: f64,
}

/// Rigid fits of all links of a recording.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Segments {
    /// Links with three markers or more.
    pub segments: Vec<SegmentFit>,
    /// Standard deviation of one coordinate of a marker over all of them, m.
    pub sd_m: f64,
    /// What the joints add, m: the mean square that inverse kinematics leaves beyond the links'
    /// own fits, per degree of freedom that the joints take away. It is `sd_m` for joints that
    /// hold. None where not every link has a fit.
    pub joints_m: Option<f64>,
    /// Where it is added, the largest first.
    pub gaps: Vec<JointGap>,
}

/// Markers of one link and what a rigid fit leaves of them.
#[derive(Debug)]
pub(crate) struct Cluster {
    /// Their indices in the list that was given.
    pub markers: Vec<usize>,
    /// Measured minus fitted place in the axes of the link, `[marker][frame]`, NaN where missing.
    pub residual: Vec<Vec<Vector3<f64>>>,
    /// Mean shape in this recording, in the axes of the link.
    pub shape: Vec<Vector3<f64>>,
    /// Pose of the link in every frame by the model's own shape.
    poses: Vec<Option<Isometry3<f64>>>,
    /// Sums of squares of the residuals from its own shape and from that of the model, m².
    own: f64,
    of_model: f64,
    /// Degrees of freedom of both.
    freedom: f64,
    frames: usize,
}

impl Cluster {
    /// Fits markers at `places` (link axes) with their trajectories (world; NaN where missing).
    pub fn of(markers: Vec<usize>, places: &[Vector3<f64>], seen: &[&[Vector3<f64>]]) -> Option<Self> {
        let n = seen.first().map_or(0, |s| s.len());
        if places.len() < 3 || seen.iter().any(|s| s.len() != n) {
            return None;
        }
        let visible: Vec<Vec<usize>> =
            (0..n).map(|f| (0..places.len()).filter(|&m| seen[m][f].iter().all(|x| x.is_finite())).collect()).collect();
        let pose = |shape: &[Vector3<f64>], f: usize| {
            let here: Vec<Vector3<f64>> = visible[f].iter().map(|&m| shape[m]).collect();
            let there: Vec<Vector3<f64>> = visible[f].iter().map(|&m| seen[m][f]).collect();
            fit_pose(&here, &there, MIN_SPREAD_M)
        };
        let poses: Vec<Option<Isometry3<f64>>> = (0..n).map(|f| pose(places, f)).collect();
        let mut of_model = 0.0;
        for (f, at) in poses.iter().enumerate() {
            let Some(at) = at else { continue };
            let missed = |m: &usize| (local(at, &seen[*m][f]) - places[*m]).norm_squared();
            of_model += visible[f].iter().map(missed).sum::<f64>();
        }
        let mut shape = places.to_vec();
        for _ in 0..ROUNDS {
            let (mut sums, mut counts) = (vec![Vector3::zeros(); shape.len()], vec![0.0; shape.len()]);
            for (f, visible) in visible.iter().enumerate() {
                let Some(at) = pose(&shape, f) else { continue };
                for &m in visible {
                    sums[m] += local(&at, &seen[m][f]);
                    counts[m] += 1.0;
                }
            }
            for (m, place) in shape.iter_mut().enumerate() {
                if counts[m] > 0.0 {
                    *place = sums[m] / counts[m];
                }
            }
        }
        let mut residual = vec![vec![Vector3::repeat(f64::NAN); n]; shape.len()];
        let (mut own, mut freedom, mut frames) = (0.0, 0.0, 0);
        for (f, visible) in visible.iter().enumerate() {
            let Some(at) = pose(&shape, f) else { continue };
            for &m in visible {
                residual[m][f] = local(&at, &seen[m][f]) - shape[m];
                own += residual[m][f].norm_squared();
            }
            freedom += 3.0 * visible.len() as f64 - 6.0;
            frames += 1;
        }
        (freedom > 0.0).then_some(Self { markers, residual, shape, poses, own, of_model, freedom, frames })
    }

    /// Squared norms of the blocks of what a rigid fit keeps of the errors of its markers,
    /// markers × markers: `1 − J (JᵀJ)⁻¹ Jᵀ` with `J = [1, −[p]×]`.
    pub fn kept(&self) -> Option<nalgebra::DMatrix<f64>> {
        let k = self.shape.len();
        let centre = self.shape.iter().sum::<Vector3<f64>>() / k as f64;
        let mut jacobian = nalgebra::DMatrix::zeros(3 * k, 6);
        for (m, place) in self.shape.iter().enumerate() {
            jacobian.fixed_view_mut::<3, 3>(3 * m, 0).fill_with_identity();
            jacobian.fixed_view_mut::<3, 3>(3 * m, 3).copy_from(&-(place - centre).cross_matrix());
        }
        let gram = jacobian.tr_mul(&jacobian).try_inverse()?;
        let left = nalgebra::DMatrix::identity(3 * k, 3 * k) - &jacobian * gram * jacobian.transpose();
        Some(nalgebra::DMatrix::from_fn(k, k, |a, b| left.fixed_view::<3, 3>(3 * a, 3 * b).norm_squared()))
    }

    /// How far each marker's mean place lies from `places`, the other markers aligned, m. One
    /// marker that was moved would turn an alignment of all of them.
    fn displaced(&self, places: &[Vector3<f64>]) -> Vec<f64> {
        let k = places.len();
        let of = |m: usize, others: &[usize]| {
            let here: Vec<Vector3<f64>> = others.iter().map(|&i| places[i]).collect();
            let there: Vec<Vector3<f64>> = others.iter().map(|&i| self.shape[i]).collect();
            let at = fit_pose(&here, &there, MIN_SPREAD_M)?;
            let missed = |i: usize| (local(&at, &self.shape[i]) - places[i]).norm();
            Some((missed(m), others.iter().map(|&i| missed(i).powi(2)).sum::<f64>()))
        };
        let all: Vec<usize> = (0..k).collect();
        let together: Vec<f64> = all.iter().map(|&m| of(m, &all).map_or(0.0, |x| x.0)).collect();
        // the marker without which the others fit best stands out alone, or none does
        let without = |m: usize| {
            let others: Vec<usize> = all.iter().copied().filter(|&i| i != m).collect();
            of(m, &others).map(|(missed, rest)| (m, missed, rest))
        };
        let best = all.iter().filter_map(|&m| without(m)).min_by(|a, b| a.2.total_cmp(&b.2));
        let rest: f64 = together.iter().map(|x| x * x).sum();
        match best {
            Some((m, missed, left)) if k > 3 && left < 0.25 * rest => {
                let mut out = vec![(left / (k - 1) as f64).sqrt(); k];
                out[m] = missed;
                out
            }
            _ => together,
        }
    }
}

/// A point of the world in the axes of a pose.
fn local(at: &Isometry3<f64>, world: &Vector3<f64>) -> Vector3<f64> {
    at.inverse_transform_point(&nalgebra::Point3::from(*world)).coords
}

/// Fits of all links, by index of the link; none for a link with fewer than three markers.
pub(crate) fn clusters(subject: &Subject, trial: &Trial) -> Vec<Option<Cluster>> {
    (0..subject.model.n_links())
        .map(|link| {
            let of_link: Vec<(usize, usize)> = subject
                .markers
                .iter()
                .enumerate()
                .filter(|(_, m)| m.link == link && m.weight > 0.0)
                .filter_map(|(i, m)| Some((i, trial.markers.index(&m.label)?)))
                .collect();
            let places: Vec<Vector3<f64>> = of_link.iter().map(|(i, _)| subject.markers[*i].position_m).collect();
            let seen: Vec<&[Vector3<f64>]> =
                of_link.iter().map(|(_, at)| trial.markers.trajectories[*at].as_slice()).collect();
            Cluster::of(of_link.iter().map(|(i, _)| *i).collect(), &places, &seen)
        })
        .collect()
}

impl Segments {
    /// Of a recording and the motion that inverse kinematics made of it; none if no link has three
    /// markers.
    pub fn of(subject: &Subject, trial: &Trial, motion: &Motion) -> Option<Self> {
        let clusters = clusters(subject, trial);
        let fits: Vec<(usize, &Cluster)> =
            clusters.iter().enumerate().filter_map(|(link, c)| Some((link, c.as_ref()?))).collect();
        let (own, freedom) = fits.iter().fold((0.0, 0.0), |sum, (_, c)| (sum.0 + c.own, sum.1 + c.freedom));
        if fits.is_empty() {
            return None;
        }
        let of = |&(link, c): &(usize, &Cluster)| {
            let places: Vec<Vector3<f64>> = c.markers.iter().map(|&m| subject.markers[m].position_m).collect();
            let labels = c.markers.iter().map(|&m| subject.markers[m].label.clone());
            SegmentFit {
                link: subject.model.links[link].name.clone(),
                sd_m: (c.own / c.freedom).sqrt(),
                freedom: c.freedom,
                displaced_m: labels.zip(c.displaced(&places)).collect(),
            }
        };
        Some(Self {
            segments: fits.iter().map(of).collect(),
            sd_m: (own / freedom).sqrt(),
            joints_m: joints_m(subject, motion, &fits),
            gaps: gaps(subject, &clusters),
        })
    }

    /// The marker whose mean place differs most from that of the model, in standard deviations of
    /// one sample: link, label, distance in m, distance in standard deviations.
    pub fn most_displaced(&self) -> Option<(&str, &str, f64, f64)> {
        self.segments
            .iter()
            .flat_map(|s| s.displaced_m.iter().map(|(label, d)| (s.link.as_str(), label.as_str(), *d, d / s.sd_m)))
            .max_by(|a, b| a.3.total_cmp(&b.3))
    }
}

/// What the joints add ([`Segments::joints_m`]).
fn joints_m(subject: &Subject, motion: &Motion, fits: &[(usize, &Cluster)]) -> Option<f64> {
    let model = &subject.model;
    let removed = 6.0 * model.n_links() as f64 - model.nv as f64;
    if fits.len() != model.n_links() || removed < 1.0 {
        return None;
    }
    let frames = fits.iter().map(|(_, c)| c.frames).min().unwrap_or(0) as f64;
    let of_model: f64 = fits.iter().map(|(_, c)| c.of_model).sum();
    let of_motion: f64 = motion.residual_m.iter().filter(|r| r.is_finite()).map(|r| r * r).sum();
    (frames > 0.0).then(|| ((of_motion - of_model).max(0.0) / (removed * frames)).sqrt())
}

/// How far the links miss each joint.
fn gaps(subject: &Subject, clusters: &[Option<Cluster>]) -> Vec<JointGap> {
    let mut out = Vec::new();
    for (link, own) in clusters.iter().enumerate() {
        let its = &subject.model.links[link];
        let Some(parent) = its.parent.and_then(|p| clusters[p].as_ref()) else { continue };
        let Some(own) = own else { continue };
        let centre = its.joint.parent_from_joint.translation.vector;
        let (mut distance, mut angle, mut n) = (0.0, 0.0, 0.0);
        for (of_parent, of_link) in parent.poses.iter().zip(&own.poses) {
            let (Some(of_parent), Some(of_link)) = (of_parent, of_link) else { continue };
            distance += (local(of_link, &(of_parent * nalgebra::Point3::from(centre)).coords)).norm_squared();
            if let JointKind::Revolute(axis) = its.joint.kind {
                let by_parent = of_parent.rotation * its.joint.parent_from_joint.rotation * axis.into_inner();
                angle += by_parent.angle(&(of_link.rotation * axis.into_inner())).powi(2);
            }
            n += 1.0;
        }
        if n > 0.0 && !matches!(its.joint.kind, JointKind::Prismatic(_)) {
            let (centre_m, axis_rad) = ((distance / n).sqrt(), (angle / n).sqrt());
            out.push(JointGap { link: its.name.clone(), centre_m, axis_rad });
        }
    }
    out.sort_by(|a, b| b.centre_m.total_cmp(&a.centre_m));
    out
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const SD_M: f64 = 4e-4;

    fn tumbling(places: &[Vector3<f64>], frames: usize, seed: u64) -> Vec<Vec<Vector3<f64>>> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut seen = vec![Vec::new(); places.len()];
        for f in 0..frames {
            let t = 0.01 * f as f64;
            let at = Isometry3::from_parts(
                Translation3::new(t, 2.0 * t, 1.0 - t * t),
                UnitQuaternion::from_scaled_axis(Vector3::new(3.0 * t, -2.0 * t, t)),
            );
            for (m, place) in places.iter().enumerate() {
                let noise = Vector3::from_fn(|_, _| {
                    let x: f64 = StandardNormal.sample(&mut rng);
                    SD_M * x
                });
                seen[m].push((at * nalgebra::Point3::from(*place)).coords + noise);
            }
        }
        seen
    }

    fn places() -> Vec<Vector3<f64>> {
        vec![
            Vector3::new(0.1, 0.0, 0.0),
            Vector3::new(-0.1, 0.02, 0.0),
            Vector3::new(0.0, 0.12, 0.03),
            Vector3::new(0.02, -0.1, 0.05),
        ]
    }

    #[test]
    fn the_noise_of_a_segment_is_read_with_gaps_and_with_a_marker_elsewhere() {
        let model = places();
        let mut real = places();
        real[2] += Vector3::new(0.0, 0.0, 0.012);
        let mut seen = tumbling(&real, 400, 5);
        for f in 100..160 {
            seen[0][f] = Vector3::repeat(f64::NAN);
        }
        let views: Vec<&[Vector3<f64>]> = seen.iter().map(Vec::as_slice).collect();
        let fit = Cluster::of((0..4).collect(), &model, &views).unwrap();
        let sd = (fit.own / fit.freedom).sqrt();
        assert!((sd / SD_M - 1.0).abs() < 0.05, "{sd}");
        let displaced = fit.displaced(&model);
        assert!((displaced[2] - 0.012).abs() < 2e-4, "{displaced:?}");
        assert!([0, 1, 3].iter().all(|&m| displaced[m] < 2e-4), "{displaced:?}");
        assert!(fit.residual[0][120].x.is_nan() && fit.residual[1][120].x.is_finite());
        assert!((fit.kept().unwrap().sum() - 6.0).abs() < 1e-9, "12 coordinates less 6 of the pose");
    }

    #[test]
    fn two_markers_or_a_line_of_markers_give_no_fit() {
        let two = places()[..2].to_vec();
        let seen = tumbling(&two, 50, 1);
        let views: Vec<&[Vector3<f64>]> = seen.iter().map(Vec::as_slice).collect();
        assert!(Cluster::of(vec![0, 1], &two, &views).is_none());
        let line: Vec<Vector3<f64>> = (0..3).map(|i| Vector3::new(0.05 * f64::from(i), 0.0, 0.0)).collect();
        let seen = tumbling(&line, 50, 1);
        let views: Vec<&[Vector3<f64>]> = seen.iter().map(Vec::as_slice).collect();
        assert!(Cluster::of(vec![0, 1, 2], &line, &views).is_none());
    }
}
