//! Inverse kinematics in the file's own coordinates: weighted least squares over the markers of a
//! frame, with the file's couplings, locks and ranges, as OpenSim's tool solves it.
//!
//! Every frame starts from the one before. The first, and one whose fit is suddenly worse, starts
//! from the posture at the defaults, put onto the markers as a whole.

use super::model::{OsimMarker, OsimModel};
use super::rigid::{RigidTree, world_from_ground};
use aloft_body::rigid::fit_pose_of_seen;
use aloft_body::{ModelMarker, Motion};
use nalgebra::{DMatrix, DVector, Isometry3, UnitQuaternion, Vector3};

/// Steps within a frame.
const MOST_STEPS: usize = 60;
/// A step below this ends the search, rad or m.
const DONE: f64 = 1e-8;
/// Standard deviation of a coordinate about its value in the frame before: holds what the markers
/// of a frame leave open, rad or m.
const DRIFT: f64 = 1.0;
/// Fewest markers of a frame.
const FEWEST: usize = 4;
/// A fit this many times worse than the one before is started again.
const WORSE: f64 = 2.0;
/// Starts of the root about each of its angles.
const TURNS: usize = 4;

/// The solver for one recording.
#[derive(Debug)]
pub struct OsimIk<'a> {
    osim: &'a OsimModel,
    tree: &'a RigidTree,
    /// Coordinates that are solved for.
    free: Vec<usize>,
    /// Markers of the file that the subject has.
    used: Vec<&'a OsimMarker>,
    /// Joints from the root to each marker's body.
    paths: Vec<Vec<usize>>,
    weights: Vec<f64>,
    sd_m: f64,
}

/// Motion of a recording in both kinds of coordinates.
#[derive(Debug, Clone)]
pub struct OsimMotion {
    /// Motion of the rigid tree, with residuals and standard deviations.
    pub motion: Motion,
    /// Values of all of the file's coordinates, frames × coordinates, rad and m; NaN where
    /// unsolved.
    pub values: Vec<f64>,
    /// Root mean square distance of the markers, m.
    pub rms_m: f64,
    /// Largest distance of a marker, m.
    pub max_m: f64,
    /// Frames without enough markers.
    pub unsolved: usize,
    /// Frames in which the search did not end.
    pub unconverged: usize,
    /// Coordinates at an end of their range, with the number of frames.
    pub at_range: Vec<(String, usize)>,
}

/// Fit of one frame.
struct Fit {
    values: Vec<f64>,
    cost: f64,
    converged: bool,
}

impl<'a> OsimIk<'a> {
    /// A solver for the markers of the file that the subject has, with their weights there.
    pub fn new(osim: &'a OsimModel, tree: &'a RigidTree, markers: &[ModelMarker], sd_m: f64) -> Self {
        let free = (0..osim.all.len()).filter(|c| !tree.held[*c] && osim.all[*c].follows.is_none()).collect();
        let own = |name: &str| markers.iter().find(|m| m.label == name);
        let used: Vec<&OsimMarker> = osim.markers.iter().filter(|m| own(&m.name).is_some()).collect();
        let paths = used.iter().map(|m| osim.path(m.joint)).collect();
        let weights = used.iter().map(|m| own(&m.name).map_or(1.0, |m| m.weight)).collect();
        Self { osim, tree, free, used, paths, weights, sd_m }
    }

    /// Labels of the markers that are fitted, in order.
    pub fn labels(&self) -> Vec<String> {
        self.used.iter().map(|m| m.name.clone()).collect()
    }

    /// Tracks a recording. `seen` gives the place of a marker (index in [`Self::labels`]) in a
    /// frame, m, world.
    pub fn track(
        &self,
        name: &str,
        rate_hz: f64,
        frames: usize,
        seen: &dyn Fn(usize, usize) -> Option<Vector3<f64>>,
    ) -> OsimMotion {
        let ground = world_from_ground().inverse();
        let n = self.used.len();
        let (nq, nv) = (self.tree.model.nq, self.tree.model.nv);
        let mut motion =
            Motion { trial: name.to_owned(), rate_hz, nq, nv, marker_labels: self.labels(), ..Motion::default() };
        let mut values = Vec::with_capacity(frames * self.osim.all.len());
        let mut before: Option<(Vec<f64>, f64)> = None;
        let (mut sum, mut count, mut max_m, mut unsolved, mut unconverged) = (0.0, 0usize, 0.0_f64, 0, 0);
        let mut at_range = vec![0usize; self.osim.all.len()];
        for frame in 0..frames {
            let targets: Vec<Option<Vector3<f64>>> = (0..n)
                .map(|m| seen(m, frame).filter(|p| p.iter().all(|x| x.is_finite())).map(|p| ground * p))
                .collect();
            let visible = targets.iter().zip(&self.weights).filter(|(t, w)| t.is_some() && **w > 0.0).count();
            let fit = (visible >= FEWEST).then(|| self.fit(&targets, before.as_ref())).flatten();
            let Some(fit) = fit else {
                unsolved += 1;
                values.extend(std::iter::repeat_n(f64::NAN, self.osim.all.len()));
                motion.q.extend(std::iter::repeat_n(f64::NAN, nq));
                motion.q_sd.extend(std::iter::repeat_n(f64::NAN, nv));
                motion.residual_m.extend(std::iter::repeat_n(f64::NAN, n));
                continue;
            };
            unconverged += usize::from(!fit.converged);
            let places = self.places(&fit.values);
            let mut own = (0.0, 0usize);
            for (target, place) in targets.iter().zip(&places) {
                let r = target.map_or(f64::NAN, |t| (t - place).norm());
                if r.is_finite() {
                    own = (own.0 + r * r, own.1 + 1);
                    max_m = max_m.max(r);
                }
                motion.residual_m.push(r);
            }
            (sum, count) = (sum + own.0, count + own.1);
            for c in &self.free {
                if let Some([low, high]) = self.range(*c) {
                    at_range[*c] += usize::from(fit.values[*c] <= low || fit.values[*c] >= high);
                }
            }
            let q = self.tree.posture(self.osim, &fit.values, &world_from_ground());
            let variance = own.0 / (3 * own.1).saturating_sub(self.free.len()).max(1) as f64;
            motion.q_sd.extend(self.deviations(&fit.values, &q, &targets, variance.sqrt().max(1e-6)));
            motion.q.extend(q);
            values.extend_from_slice(&fit.values);
            before = Some((fit.values, (own.0 / own.1.max(1) as f64).sqrt()));
        }
        let at_range =
            self.osim.all.iter().zip(at_range).filter(|(_, n)| *n > 0).map(|(c, n)| (c.name.clone(), n)).collect();
        let rms_m = (sum / count.max(1) as f64).sqrt();
        OsimMotion { motion, values, rms_m, max_m, unsolved, unconverged, at_range }
    }

    /// Range of a coordinate; the root's have none: where a laboratory's axes point is no matter of
    /// anatomy.
    fn range(&self, coordinate: usize) -> Option<[f64; 2]> {
        let root = self.osim.joints.first()?;
        let of_root = root.axes().any(|a| a.coordinate == Some(coordinate));
        self.osim.all[coordinate].range.filter(|_| !of_root)
    }

    /// Places of all markers in the ground, m.
    fn places(&self, values: &[f64]) -> Vec<Vector3<f64>> {
        let poses = self.osim.poses(values);
        self.used.iter().map(|m| poses[m.joint].transform_point(&m.on_body_m.into()).coords).collect()
    }

    fn rms(&self, targets: &[Option<Vector3<f64>>], values: &[f64]) -> f64 {
        let (mut sum, mut n) = (0.0, 0usize);
        for (target, place) in targets.iter().zip(self.places(values)) {
            if let Some(t) = target {
                (sum, n) = (sum + (t - place).norm_squared(), n + 1);
            }
        }
        (sum / n.max(1) as f64).sqrt()
    }

    fn fit(&self, targets: &[Option<Vector3<f64>>], before: Option<&(Vec<f64>, f64)>) -> Option<Fit> {
        let continued = before.map(|(values, _)| self.search(targets, values.clone()));
        if let (Some(fit), Some((_, rms))) = (&continued, before)
            && self.rms(targets, &fit.values) < WORSE * rms + 0.002
        {
            return continued;
        }
        let again = self.start(targets).map(|start| self.search(targets, start));
        match (continued, again) {
            (Some(a), Some(b)) => Some(if b.cost < 0.9 * a.cost { b } else { a }),
            (a, b) => a.or(b),
        }
    }

    /// The posture at the defaults with the root put onto the markers.
    fn start(&self, targets: &[Option<Vector3<f64>>]) -> Option<Vec<f64>> {
        let rest = self.osim.values(&Default::default());
        let poses = self.osim.poses(&rest);
        let places = self.places(&rest);
        let root = poses.first()?;
        let local: Vec<Vector3<f64>> =
            places.iter().map(|p| root.inverse_transform_point(&(*p).into()).coords).collect();
        let none = Vector3::repeat(f64::NAN);
        let seen: Vec<Vector3<f64>> = targets.iter().map(|t| t.unwrap_or(none)).collect();
        let (wanted, _) = fit_pose_of_seen(&local, &seen)?;
        let own: Vec<usize> = self.free.iter().copied().filter(|c| self.is_of_root(*c)).collect();
        let angles: Vec<usize> = own.iter().copied().filter(|c| self.osim.all[*c].is_angle).collect();
        let step = std::f64::consts::TAU / TURNS as f64;
        let mut best: Option<(f64, Vec<f64>)> = None;
        for pattern in 0..TURNS.pow(angles.len().min(3) as u32) {
            let mut values = rest.clone();
            let mut left = pattern;
            for c in angles.iter().take(3) {
                values[*c] = step * (left % TURNS) as f64;
                left /= TURNS;
            }
            let (distance, values) = self.put_root(values, &own, &wanted);
            if best.as_ref().is_none_or(|b| distance < b.0 - 1e-9) {
                best = Some((distance, values));
            }
        }
        let mut values = best?.1;
        for c in &angles {
            // the turn nearest to zero
            values[*c] -= std::f64::consts::TAU * (values[*c] / std::f64::consts::TAU).round();
        }
        Some(values)
    }

    fn is_of_root(&self, coordinate: usize) -> bool {
        self.osim.joints.first().is_some_and(|j| j.axes().any(|a| a.coordinate == Some(coordinate)))
    }

    /// Moves the root's coordinates until its pose is the wanted one; distance of the corners of a
    /// cross of 0.3 m, m.
    fn put_root(&self, mut values: Vec<f64>, own: &[usize], wanted: &Isometry3<f64>) -> (f64, Vec<f64>) {
        let corners = [Vector3::zeros(), Vector3::x() * 0.3, Vector3::y() * 0.3, Vector3::z() * 0.3];
        let distance = |values: &[f64]| -> (f64, Isometry3<f64>) {
            let pose = self.osim.joints[0].body_in_parent(values);
            let sum: f64 = corners
                .iter()
                .map(|c| (pose.transform_point(&(*c).into()) - wanted.transform_point(&(*c).into())).norm_squared())
                .sum();
            (sum.sqrt(), pose)
        };
        let mut damping = 1e-3;
        let (mut cost, mut pose) = distance(&values);
        for _ in 0..30 {
            let twists = self.osim.twists(&values, &[pose]).swap_remove(0);
            let mut normal = DMatrix::<f64>::identity(own.len(), own.len()) * damping;
            let mut right = DVector::<f64>::zeros(own.len());
            for corner in &corners {
                let at = pose.transform_point(&(*corner).into()).coords;
                let miss = wanted.transform_point(&(*corner).into()).coords - at;
                let mut row = DMatrix::<f64>::zeros(3, own.len());
                for t in &twists {
                    if let Some(k) = own.iter().position(|c| *c == t.coordinate) {
                        let v = t.of_point(&at);
                        (0..3).for_each(|a| row[(a, k)] += v[a]);
                    }
                }
                normal += row.transpose() * &row;
                right += row.transpose() * DVector::from_column_slice(miss.as_slice());
            }
            let Some(step) = normal.cholesky().map(|c| c.solve(&right)) else { break };
            let mut tried = values.clone();
            own.iter().zip(step.iter()).for_each(|(c, s)| tried[*c] += s);
            self.osim.couple(&mut tried);
            let (new, at) = distance(&tried);
            if new < cost {
                (values, cost, pose) = (tried, new, at);
                damping = (0.2 * damping).max(1e-12);
            } else {
                damping *= 10.0;
                if damping > 1e3 {
                    break;
                }
            }
            if step.amax() < 1e-10 {
                break;
            }
        }
        (cost, values)
    }

    /// Normal equations of the markers at some values: JᵀJ, Jᵀr and the cost, in units of the
    /// markers' variance.
    fn normal(&self, targets: &[Option<Vector3<f64>>], values: &[f64]) -> (DMatrix<f64>, DVector<f64>, f64) {
        let n = self.free.len();
        let poses = self.osim.poses(values);
        let twists = self.osim.twists(values, &poses);
        let column: Vec<Option<usize>> =
            (0..self.osim.all.len()).map(|c| self.free.iter().position(|f| *f == c)).collect();
        let (mut normal, mut right, mut cost) = (DMatrix::zeros(n, n), DVector::zeros(n), 0.0);
        let mut touched: Vec<(usize, Vector3<f64>)> = Vec::new();
        for (m, marker) in self.used.iter().enumerate() {
            let weight = self.weights[m] / (self.sd_m * self.sd_m);
            let Some(target) = targets[m].filter(|_| weight > 0.0) else { continue };
            let place = poses[marker.joint].transform_point(&marker.on_body_m.into()).coords;
            let miss = target - place;
            cost += weight * miss.norm_squared();
            touched.clear();
            for twist in self.paths[m].iter().flat_map(|j| &twists[*j]) {
                let Some(k) = column[twist.coordinate] else { continue };
                let v = twist.of_point(&place);
                match touched.iter_mut().find(|t| t.0 == k) {
                    Some(t) => t.1 += v,
                    None => touched.push((k, v)),
                }
            }
            for (a, (i, u)) in touched.iter().enumerate() {
                right[*i] += weight * u.dot(&miss);
                for (j, v) in &touched[a..] {
                    let value = weight * u.dot(v);
                    normal[(*i, *j)] += value;
                    if i != j {
                        normal[(*j, *i)] += value;
                    }
                }
            }
        }
        (normal, right, cost)
    }

    /// Levenberg-Marquardt from a start, within the ranges.
    fn search(&self, targets: &[Option<Vector3<f64>>], start: Vec<f64>) -> Fit {
        let hold = 1.0 / (DRIFT * DRIFT);
        let origin = start.clone();
        let mut values = start;
        self.clip(&mut values);
        let pull = |values: &[f64]| self.free.iter().map(|c| hold * (values[*c] - origin[*c]).powi(2)).sum::<f64>();
        let (mut normal, mut right, cost) = self.normal(targets, &values);
        let mut cost = cost + pull(&values);
        let mut damping = 1e-6;
        for _ in 0..MOST_STEPS {
            let mut a = normal.clone();
            let mut b = right.clone();
            for (k, c) in self.free.iter().enumerate() {
                a[(k, k)] += hold + damping * normal[(k, k)].max(1.0);
                b[k] -= hold * (values[*c] - origin[*c]);
            }
            // coordinates at an end of their range that would leave it stay there
            for (k, c) in self.free.iter().enumerate() {
                let Some([low, high]) = self.range(*c) else { continue };
                if (values[*c] <= low && b[k] < 0.0) || (values[*c] >= high && b[k] > 0.0) {
                    a.row_mut(k).fill(0.0);
                    a.column_mut(k).fill(0.0);
                    a[(k, k)] = 1.0;
                    b[k] = 0.0;
                }
            }
            let Some(step) = a.cholesky().map(|c| c.solve(&b)) else { break };
            let mut tried = values.clone();
            self.free.iter().zip(step.iter()).for_each(|(c, s)| tried[*c] += s);
            self.clip(&mut tried);
            let moved = self.free.iter().map(|c| (tried[*c] - values[*c]).abs()).fold(0.0, f64::max);
            let (new_normal, new_right, new_cost) = self.normal(targets, &tried);
            let new_cost = new_cost + pull(&tried);
            if new_cost <= cost {
                (values, normal, right, cost) = (tried, new_normal, new_right, new_cost);
                damping = (0.1 * damping).max(1e-9);
            } else {
                damping = (10.0 * damping).max(1e-6);
                if damping > 1e8 {
                    return Fit { values, cost, converged: true };
                }
            }
            if moved < DONE {
                return Fit { values, cost, converged: true };
            }
        }
        Fit { values, cost, converged: false }
    }

    fn clip(&self, values: &mut [f64]) {
        for c in &self.free {
            if let Some([low, high]) = self.range(*c) {
                values[*c] = values[*c].clamp(low, high);
            }
        }
        self.osim.couple(values);
    }

    /// Standard deviations in the tangent space of the rigid tree's `v`, for markers with this
    /// standard deviation.
    fn deviations(&self, values: &[f64], q: &[f64], targets: &[Option<Vector3<f64>>], sd_m: f64) -> Vec<f64> {
        let nv = self.tree.model.nv;
        let (mut normal, _, _) = self.normal(targets, values);
        normal *= (self.sd_m / sd_m).powi(2);
        (0..self.free.len()).for_each(|k| normal[(k, k)] += 1.0 / (DRIFT * DRIFT));
        let Some(factor) = normal.cholesky() else { return vec![f64::NAN; nv] };
        let covariance = factor.inverse();
        let mut map = DMatrix::<f64>::zeros(nv, self.free.len());
        let upright: UnitQuaternion<f64> = world_from_ground();
        let h = 1e-5;
        let mut change = vec![0.0; nv];
        for (k, c) in self.free.iter().enumerate() {
            let mut moved = values.to_vec();
            moved[*c] += h;
            self.osim.couple(&mut moved);
            let end = self.tree.posture(self.osim, &moved, &upright);
            self.tree.model.difference(q, &end, &mut change);
            (0..nv).for_each(|i| map[(i, k)] = change[i] / h);
        }
        let own = &map * covariance;
        (0..nv).map(|i| own.row(i).dot(&map.row(i)).max(0.0).sqrt()).collect()
    }
}
