//! Normal equations of one frame, with the sparsity pattern of the tree.
//!
//! A marker of weight w moves only with the joints above it, so JᵀWJ is the joint-space inertia
//! matrix of point masses w at the markers, and it is computed as such: moments of order 0, 1, 2
//! are gathered for each link and accumulated towards the root; then the force of each column is
//! projected onto the columns above it (composite rigid bodies: Featherstone, *Rigid Body Dynamics
//! Algorithms*, 2008, §6.2). The factorisation H = LᵀDL from the leaves to the root has no fill-in
//! (ibid. §6.5). Row k is stored as the entries of its ancestors, root first, then its diagonal;
//! since the ancestors of an ancestor are a prefix, every inner loop runs over two contiguous
//! prefixes.

use crate::tree::{JointColumns, NONE, Pose, Tree};
use nalgebra::Vector3;

/// Weighted moments of the markers on a link and its descendants, about the pose's reference point.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Moments {
    mass: f64,
    first: Vector3<f64>,
    /// xx, yy, zz, xy, xz, yz
    second: [f64; 6],
    force: Vector3<f64>,
    torque: Vector3<f64>,
}

impl Moments {
    /// Adds a marker at `arm` from the reference point, with weight and weighted residual (model
    /// minus measured).
    pub fn add_point(&mut self, arm: &Vector3<f64>, weight: f64, residual: &Vector3<f64>) {
        let weighted = arm * weight;
        self.mass += weight;
        self.first += weighted;
        self.second[0] += weighted.x * arm.x;
        self.second[1] += weighted.y * arm.y;
        self.second[2] += weighted.z * arm.z;
        self.second[3] += weighted.x * arm.y;
        self.second[4] += weighted.x * arm.z;
        self.second[5] += weighted.y * arm.z;
        let force = residual * weight;
        self.force += force;
        self.torque += arm.cross(&force);
    }

    fn add(&mut self, other: &Self) {
        self.mass += other.mass;
        self.first += other.first;
        for i in 0..6 {
            self.second[i] += other.second[i];
        }
        self.force += other.force;
        self.torque += other.torque;
    }

    /// Force and torque of a unit rate of a column, with the markers as masses.
    fn response(&self, linear: &Vector3<f64>, angular: &Vector3<f64>) -> Pull {
        let [xx, yy, zz, xy, xz, yz] = self.second;
        let spin = Vector3::new(
            (yy + zz) * angular.x - xy * angular.y - xz * angular.z,
            -xy * angular.x + (xx + zz) * angular.y - yz * angular.z,
            -xz * angular.x - yz * angular.y + (xx + yy) * angular.z,
        );
        (linear * self.mass + angular.cross(&self.first), self.first.cross(linear) + spin)
    }
}

/// Force and torque about the pose's reference point.
type Pull = (Vector3<f64>, Vector3<f64>);

/// A symmetric matrix with the tree's sparsity pattern (or its factor), and a right-hand side.
#[derive(Debug, Clone)]
pub(crate) struct Packed {
    pub values: Vec<f64>,
    /// First entry of each row.
    pub start: Vec<usize>,
    pub gradient: Vec<f64>,
}

impl Packed {
    pub fn new(tree: &Tree) -> Self {
        let mut start = Vec::with_capacity(tree.nv);
        let mut size = 0;
        for column in 0..tree.nv {
            start.push(size);
            size += tree.ancestors[column].len() + 1;
        }
        Self { values: vec![0.0; size], start, gradient: vec![0.0; tree.nv] }
    }

    /// Index of a diagonal entry.
    pub fn diagonal(&self, tree: &Tree, row: usize) -> usize {
        self.start[row] + tree.ancestors[row].len()
    }

    /// Fills matrix and gradient from the moments of each link, which are accumulated towards the
    /// root in the process.
    pub fn assemble(&mut self, tree: &Tree, pose: &Pose, moments: &mut [Moments]) {
        for index in (1..moments.len()).rev() {
            let parent = tree.links[index].parent;
            if parent != NONE {
                let below = moments[index];
                moments[parent].add(&below);
            }
        }
        for joint in &tree.joints {
            let branch = &moments[joint.link];
            let above = &tree.ancestors[joint.first];
            if joint.count == 3 {
                let pulls = [0, 1, 2].map(|i| self.project(pose, branch, joint.first + i));
                let [first, second, third] = self.rows_of_three(joint, above.len());
                for (a, &other) in above.iter().enumerate() {
                    let (linear, angular) = (&pose.linear[other], &pose.angular[other]);
                    first[a] = linear.dot(&pulls[0].0) + angular.dot(&pulls[0].1);
                    second[a] = linear.dot(&pulls[1].0) + angular.dot(&pulls[1].1);
                    third[a] = linear.dot(&pulls[2].0) + angular.dot(&pulls[2].1);
                }
                for (i, pull) in pulls.iter().enumerate() {
                    self.within(pose, joint, i, above.len(), pull);
                }
            } else {
                for i in 0..joint.count {
                    let pull = self.project(pose, branch, joint.first + i);
                    let row = &mut self.values[self.start[joint.first + i]..][..above.len()];
                    for (entry, &other) in row.iter_mut().zip(above) {
                        *entry = pose.linear[other].dot(&pull.0) + pose.angular[other].dot(&pull.1);
                    }
                    self.within(pose, joint, i, above.len(), &pull);
                }
            }
        }
    }

    /// The entries above the joint in the rows of its three columns, of which there are `depth`.
    fn rows_of_three(&mut self, joint: &JointColumns, depth: usize) -> [&mut [f64]; 3] {
        let (first, rest) = self.values[self.start[joint.first]..].split_at_mut(depth + 1);
        let (second, third) = rest.split_at_mut(depth + 2);
        [&mut first[..depth], &mut second[..depth], &mut third[..depth]]
    }

    /// Force and torque of a column's unit rate; fills the gradient's entry.
    fn project(&mut self, pose: &Pose, branch: &Moments, column: usize) -> Pull {
        let (linear, angular) = (&pose.linear[column], &pose.angular[column]);
        self.gradient[column] = linear.dot(&branch.force) + angular.dot(&branch.torque);
        branch.response(linear, angular)
    }

    /// Entries of column `i` of a joint with the joint's own columns up to the diagonal; `depth`
    /// columns are above the joint.
    fn within(&mut self, pose: &Pose, joint: &JointColumns, i: usize, depth: usize, pull: &Pull) {
        let row = &mut self.values[self.start[joint.first + i] + depth..][..=i];
        for (entry, other) in row.iter_mut().zip(joint.first..) {
            *entry = pose.linear[other].dot(&pull.0) + pose.angular[other].dot(&pull.1);
        }
    }

    /// Removes coordinates from the problem.
    pub fn lock(&mut self, tree: &Tree, locked: &[bool]) {
        for row in 0..tree.nv {
            let above = &tree.ancestors[row];
            let at = self.start[row];
            for (i, &other) in above.iter().enumerate() {
                if locked[row] || locked[other] {
                    self.values[at + i] = 0.0;
                }
            }
            if locked[row] {
                self.values[at + above.len()] = 1.0;
                self.gradient[row] = 0.0;
            }
        }
    }

    /// Factorises `source` with its diagonal multiplied by `1 + damping` into `self`. False when it
    /// is not positive definite.
    pub fn factorise(&mut self, tree: &Tree, source: &Self, damping: f64) -> bool {
        self.values.copy_from_slice(&source.values);
        if damping > 0.0 {
            for row in 0..tree.nv {
                let at = self.diagonal(tree, row);
                self.values[at] *= 1.0 + damping;
            }
        }
        let enough = |at: usize, pivot: f64| pivot > 1e-13 * source.values[at] && pivot > 0.0;
        tree.joints.iter().rev().all(|joint| self.eliminate_joint(tree, joint, enough))
    }

    /// Eliminates the rows of a joint as [`Packed::eliminate`] does one by one, three of them at
    /// once: the numbers are the same. False if `enough` refuses the pivot at an index.
    fn eliminate_joint(&mut self, tree: &Tree, joint: &JointColumns, enough: impl Fn(usize, f64) -> bool) -> bool {
        if joint.count != 3 {
            for k in (joint.first..joint.first + joint.count).rev() {
                let at = self.diagonal(tree, k);
                if !enough(at, self.values[at]) {
                    return false;
                }
                self.eliminate(tree, k, 1.0 / self.values[at]);
            }
            return true;
        }
        let above = &tree.ancestors[joint.first];
        let n = above.len();
        let at = self.start[joint.first];
        let (head, rows) = self.values.split_at_mut(at);
        let (first, rest) = rows.split_at_mut(n + 1);
        let (second, rest) = rest.split_at_mut(n + 2);
        let third = &mut rest[..n + 3];
        // among themselves
        if !enough(at + 3 * n + 5, third[n + 2]) {
            return false;
        }
        let of_third = 1.0 / third[n + 2];
        let factor = third[n + 1] * of_third;
        second.iter_mut().zip(&third[..n + 2]).for_each(|(t, r)| *t -= factor * r);
        third[n + 1] = factor;
        let factor = third[n] * of_third;
        first.iter_mut().zip(&third[..=n]).for_each(|(t, r)| *t -= factor * r);
        third[n] = factor;
        if !enough(at + 2 * n + 2, second[n + 1]) {
            return false;
        }
        let of_second = 1.0 / second[n + 1];
        let factor = second[n] * of_second;
        first.iter_mut().zip(&second[..=n]).for_each(|(t, r)| *t -= factor * r);
        second[n] = factor;
        if !enough(at + n, first[n]) {
            return false;
        }
        let of_first = 1.0 / first[n];
        // from the rows above
        for (a, &i) in above.iter().enumerate().rev() {
            let (f, g, h) = (first[a] * of_first, second[a] * of_second, third[a] * of_third);
            let target = &mut head[self.start[i]..=self.start[i] + a];
            for (((t, x), y), z) in target.iter_mut().zip(&first[..=a]).zip(&second[..=a]).zip(&third[..=a]) {
                *t = *t - h * z - g * y - f * x;
            }
            (first[a], second[a], third[a]) = (f, g, h);
        }
        true
    }

    /// Eliminates row `k`, whose inverse pivot is given, from the rows above; its entries become
    /// those of the factor.
    #[inline]
    fn eliminate(&mut self, tree: &Tree, k: usize, inverse: f64) {
        let (head, row) = self.values.split_at_mut(self.start[k]);
        for (a, &i) in tree.ancestors[k].iter().enumerate().rev() {
            let factor = row[a] * inverse;
            if factor != 0.0 {
                let target = &mut head[self.start[i]..=self.start[i] + a];
                for (t, r) in target.iter_mut().zip(&row[..=a]) {
                    *t -= factor * r;
                }
            }
            row[a] = factor;
        }
    }

    /// Eliminates the rows for which `keep` is false, which must be closed towards the leaves: the
    /// kept rows and their gradient become those of the reduced equations, the others hold their
    /// factor. False if a pivot is not positive.
    pub fn reduce(&mut self, tree: &Tree, keep: &[bool]) -> bool {
        for k in (0..tree.nv).rev().filter(|&k| !keep[k]) {
            let above = &tree.ancestors[k];
            let at = self.start[k];
            let pivot = self.values[at + above.len()];
            if pivot.is_nan() || pivot <= 0.0 {
                return false;
            }
            self.eliminate(tree, k, 1.0 / pivot);
            for (&factor, &i) in self.values[at..at + above.len()].iter().zip(above) {
                self.gradient[i] -= factor * self.gradient[k];
            }
        }
        true
    }

    /// Completes the solution `H x = −gradient` after [`Packed::reduce`], given its kept entries.
    pub fn complete(&self, tree: &Tree, keep: &[bool], x: &mut [f64]) {
        for k in (0..tree.nv).filter(|&k| !keep[k]) {
            let above = &tree.ancestors[k];
            let at = self.start[k];
            let mut value = -self.gradient[k] / self.values[at + above.len()];
            for (entry, &i) in self.values[at..at + above.len()].iter().zip(above) {
                value -= entry * x[i];
            }
            x[k] = value;
        }
    }

    /// Solves `H x = b` in place with a factor.
    pub fn solve(&self, tree: &Tree, x: &mut [f64]) {
        self.solve_upper(tree, x);
        for joint in &tree.joints {
            let above = &tree.ancestors[joint.first];
            let n = above.len();
            if joint.count == 3 {
                let [first, second, third] = self.three_rows(joint, n);
                let c = joint.first;
                let (mut u, mut v, mut w) = (x[c] / first[n], x[c + 1] / second[n + 1], x[c + 2] / third[n + 2]);
                for (((a, b), c), &i) in first.iter().zip(second).zip(third).zip(above) {
                    let known = x[i];
                    u -= a * known;
                    v -= b * known;
                    w -= c * known;
                }
                v -= second[n] * u;
                w -= third[n] * u;
                w -= third[n + 1] * v;
                x[c..c + 3].copy_from_slice(&[u, v, w]);
                continue;
            }
            for k in joint.first..joint.first + joint.count {
                let above = &tree.ancestors[k];
                let at = self.start[k];
                let mut value = x[k] / self.values[at + above.len()];
                for (entry, &i) in self.values[at..at + above.len()].iter().zip(above) {
                    value -= entry * x[i];
                }
                x[k] = value;
            }
        }
    }

    /// The rows of the three columns of a joint that has `depth` columns above it, diagonals last.
    fn three_rows(&self, joint: &JointColumns, depth: usize) -> [&[f64]; 3] {
        let (first, rest) = self.values[self.start[joint.first]..].split_at(depth + 1);
        let (second, rest) = rest.split_at(depth + 2);
        [first, second, &rest[..depth + 3]]
    }

    /// Solves `Lᵀ x = b` in place.
    pub fn solve_upper(&self, tree: &Tree, x: &mut [f64]) {
        for joint in tree.joints.iter().rev() {
            if joint.count == 3 {
                let above = &tree.ancestors[joint.first];
                let n = above.len();
                let [first, second, third] = self.three_rows(joint, n);
                let c = joint.first;
                let w = x[c + 2];
                let v = x[c + 1] - third[n + 1] * w;
                let u = x[c] - third[n] * w - second[n] * v;
                (x[c], x[c + 1]) = (u, v);
                for (((a, b), c), &i) in first.iter().zip(second).zip(third).zip(above) {
                    x[i] = x[i] - c * w - b * v - a * u;
                }
                continue;
            }
            for k in (joint.first..joint.first + joint.count).rev() {
                let above = &tree.ancestors[k];
                let at = self.start[k];
                let value = x[k];
                if value != 0.0 {
                    for (entry, &i) in self.values[at..at + above.len()].iter().zip(above) {
                        x[i] -= entry * value;
                    }
                }
            }
        }
    }

    /// The entries of H⁻¹ within the tree's pattern, from a factor (Takahashi's recursion, root to
    /// leaves), for the first `rows` rows.
    pub fn invert(&mut self, tree: &Tree, factor: &Self, rows: usize) {
        for k in 0..rows.min(tree.nv) {
            let above = &tree.ancestors[k];
            let depth = above.len();
            let at = self.start[k];
            let low = &factor.values[at..at + depth];
            let (head, row) = self.values.split_at_mut(at);
            for (a, &i) in above.iter().enumerate() {
                let mut sum = 0.0;
                let row_i = &head[self.start[i]..=self.start[i] + a];
                for (l, z) in low[..=a].iter().zip(row_i) {
                    sum += l * z;
                }
                for (b, &m) in above.iter().enumerate().skip(a + 1) {
                    sum += low[b] * head[self.start[m] + a];
                }
                row[a] = -sum;
            }
            let mut diagonal = 1.0 / factor.values[at + depth];
            for (l, z) in low.iter().zip(&row[..depth]) {
                diagonal -= l * z;
            }
            row[depth] = diagonal;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use aloft_body::{JointSpec, LinkSpec, Model, ModelSpec, State};
    use nalgebra::{DMatrix, DVector, UnitQuaternion};

    fn tree_of_all_joints() -> Model {
        let kinds = [
            ("root", None, JointSpec::Free),
            ("a", Some("root"), JointSpec::Spherical),
            ("b", Some("a"), JointSpec::Revolute([0.0, 0.6, 0.8])),
            ("c", Some("b"), JointSpec::Fixed),
            ("d", Some("c"), JointSpec::Prismatic([1.0, 0.0, 0.0])),
            ("e", Some("root"), JointSpec::RevoluteZ),
            ("f", Some("a"), JointSpec::Spherical),
        ];
        let links = kinds.iter().enumerate().map(|(i, (name, parent, joint))| LinkSpec {
            name: (*name).to_owned(),
            parent: parent.map(str::to_owned),
            joint: *joint,
            position_m: [0.1 * i as f64, 0.2, -0.05 * i as f64],
            rpy_rad: [0.1, -0.3 * i as f64, 0.2],
            inertia: None,
        });
        Model::from_spec(&ModelSpec::new("all".to_owned(), links.collect())).unwrap()
    }

    /// Compares the normal equations with Jacobians of another crate, and factor and inverse with
    /// dense ones.
    #[test]
    fn normal_equations_against_dense_algebra() {
        let model = tree_of_all_joints();
        let tree = Tree::new(&model);
        let mut q = model.neutral();
        let dv: Vec<f64> = (0..model.nv).map(|i| (1.7 * i as f64).sin()).collect();
        let start = q.clone();
        model.integrate(&start, &dv, &mut q);
        let mut state = State::new(&model);
        state.forward_position(&model, &q);
        let mut pose = tree.pose();
        tree.forward(&q, &mut pose);
        tree.columns(&mut pose);
        let mut moments = vec![Moments::default(); tree.links.len()];
        let mut dense = DMatrix::zeros(model.nv, model.nv);
        let mut gradient = DVector::zeros(model.nv);
        let mut jacobian = DMatrix::zeros(3, model.nv);
        for i in 0..28 {
            let (link, x) = (i % 7, i as f64);
            let local = Vector3::new(x.sin(), (2.0 * x).cos(), (3.0 * x).sin()) * 0.2;
            let (weight, residual) = (1.0 + 0.1 * x, Vector3::new(0.01 * x, -0.02, 0.03));
            let point = state.point_in_world(link, &local);
            assert!((point - pose.origin[link] - pose.rotation[link] * local).norm() < 1e-12);
            moments[link].add_point(&(point - pose.reference), weight, &residual);
            state.point_jacobian(&model, link, &local, &mut jacobian);
            dense += weight * jacobian.transpose() * &jacobian;
            gradient += weight * jacobian.transpose() * residual;
        }
        let mut normal = Packed::new(&tree);
        normal.assemble(&tree, &pose, &mut moments);
        for row in 0..tree.nv {
            for (i, &column) in tree.ancestors[row].iter().chain([&row]).enumerate() {
                assert!((normal.values[normal.start[row] + i] - dense[(row, column)]).abs() < 1e-10);
            }
            assert!((normal.gradient[row] - gradient[row]).abs() < 1e-10);
        }
        let mut factor = normal.clone();
        assert!(factor.factorise(&tree, &normal, 0.0));
        let mut x = normal.gradient.clone();
        factor.solve(&tree, &mut x);
        let inverse = dense.try_inverse().unwrap();
        let expected = &inverse * &gradient;
        // rows at the leaves eliminated, the others solved densely
        let keep: Vec<bool> = (0..tree.nv).map(|row| tree.column_link[row] < 3).collect();
        let mut reduced = normal.clone();
        assert!(reduced.reduce(&tree, &keep));
        let kept: Vec<usize> = (0..tree.nv).filter(|&row| keep[row]).collect();
        let entry = |row: usize, column: usize| {
            let (low, high) = (row.max(column), row.min(column));
            let place = tree.ancestors[low].iter().chain([&low]).position(|&c| c == high);
            place.map_or(0.0, |k| reduced.values[reduced.start[low] + k])
        };
        let small = DMatrix::from_fn(kept.len(), kept.len(), |i, j| entry(kept[i], kept[j]));
        let right = DVector::from_fn(kept.len(), |i, _| -reduced.gradient[kept[i]]);
        let solved = small.lu().solve(&right).unwrap();
        let mut y = vec![0.0; tree.nv];
        kept.iter().zip(solved.iter()).for_each(|(&row, s)| y[row] = *s);
        reduced.complete(&tree, &keep, &mut y);
        assert!(y.iter().zip(expected.iter()).all(|(y, e)| (y + e).abs() < 1e-8));
        let mut selected = normal.clone();
        selected.invert(&tree, &factor, tree.nv);
        for row in 0..tree.nv {
            assert!((x[row] - expected[row]).abs() < 1e-8);
            for (i, &column) in tree.ancestors[row].iter().chain([&row]).enumerate() {
                assert!((selected.values[selected.start[row] + i] - inverse[(row, column)]).abs() < 1e-8);
            }
        }
    }

    /// Compares poses, retraction and extrapolation with those of the model.
    #[test]
    fn retraction_against_the_model() {
        let model = tree_of_all_joints();
        let tree = Tree::new(&model);
        let q0 = model.neutral();
        let step: Vec<f64> = (0..model.nv).map(|i| 1e-5 * (2.3 * i as f64).sin()).collect();
        let (mut a, mut b) = (q0.clone(), q0.clone());
        let big: Vec<f64> = step.iter().map(|s| 8e4 * s).collect();
        model.integrate(&q0, &big, &mut a);
        let start = a.clone();
        tree.retract(&start, &step, &mut a);
        model.integrate(&start, &step, &mut b);
        // the root's position agrees to second order
        assert!(a.iter().zip(&b).all(|(x, y)| (x - y).abs() < 1e-9));
        let mut next = start.clone();
        tree.extrapolate(&start, &a, &mut next);
        let mut dv = vec![0.0; model.nv];
        model.difference(&a, &next, &mut dv);
        assert!(dv.iter().zip(&step).all(|(x, y)| (x - y).abs() < 1e-9));
        let mut pose = tree.pose();
        tree.forward(&a, &mut pose);
        let turn = UnitQuaternion::from_euler_angles(0.3, -0.2, 1.0).to_rotation_matrix().into_inner();
        tree.set_rotation(6, &turn, &pose, &mut a);
        tree.forward(&a, &mut pose);
        assert!((pose.rotation[6] - turn).amax() < 1e-12);
    }
}
