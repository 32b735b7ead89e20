//! Structural base parameters: the regrouping of the paper for free, spherical, revolute, prismatic
//! and fixed joints.
//!
//! With a freely moving root, a set of inertial parameters has no effect on the base wrench if and
//! only if it is a sum of the following: parameters of a child that have the same effect as
//! parameters of its parent for any motion of their joint (position and velocity), subtracted from
//! the child and added to the parent. Each joint therefore transfers to the parent
//!
//! - revolute: mass, first moment along the axis, and the second moment along the axis (three; with
//!   the axis z: m, mc_z, and Iyy as diag(Iyy, Iyy, 0)); the child keeps mc_x, mc_y, Ixx−Iyy, Izz,
//!   Iyz, Izx, Ixy,
//! - spherical: the mass (one); the child keeps nine,
//! - prismatic: the rotational inertia about the child's origin (six); the child keeps mass and
//!   first moment. The mass is *also* counted in the parent, at the joint's zero position, so that
//!   the first root parameter stays the total mass: the kept `m` then is the effect of moving that
//!   mass away from there,
//! - fixed: all ten.
//!
//! No other regrouping is needed: by induction from the leaves, coincident axes along the tree do
//! not lower the rank further, because for the last joint the rest of the tree is a rigid body in
//! general motion.

use crate::formula::Formulas;
use crate::inertia::{phi_transform, phi_transform_by};
use crate::{JointKind, Model, PHI_NAMES, Phi};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, SMatrix, Unit, Vector3};

pub(crate) type Matrix10 = SMatrix<f64, 10, 10>;

/// One base parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct BaseParameter {
    /// Name: `M MCx MCy MCz Jxx Jyy Jzz Jyz Jzx Jxy` for the root (the paper's Table I),
    /// `<link>.mcx`, `<link>.Ixx-Iyy` … for the others. Primes (`<link>.mcx'`) denote axes rotated
    /// so that z' is the joint's axis; the formula gives them.
    pub name: String,
    /// Unit: `kg`, `kg·m` or `kg·m²`.
    pub unit: &'static str,
    /// The regrouping written out, for example `m0 + m1`. Numbers are link indices; `p1` is the
    /// origin of link 1 in its parent, `a1` its axis in its parent; capitals (`M1`, `MC1x`, `J1xx`)
    /// denote a link with everything regrouped into it.
    pub formula: String,
}

/// The base parameters of a model's six root rows: `φ_B = B φ`, `Y_B = Y K`, with `Y φ = Y_B φ_B`
/// for every motion.
#[derive(Debug, Clone)]
pub struct BaseParameters {
    /// The parameters in order; the first is always the total mass `M`.
    pub parameters: Vec<BaseParameter>,
    /// B, n_base × 10n.
    pub from_full: DMatrix<f64>,
    /// K, 10n × n_base.
    pub to_full: DMatrix<f64>,
    /// Parameters kept by each link, for writing base columns without K.
    pub(crate) kept: Vec<Kept>,
    /// Entries of K that couple links: (base column, full column, coefficient).
    pub(crate) crossing: Vec<(usize, usize, f64)>,
}

/// The base columns computed from one link's ten columns.
#[derive(Debug, Clone)]
pub(crate) struct Kept {
    /// First base column.
    pub first: usize,
    /// Computation of these columns.
    pub columns: KeptColumns,
}

/// How a link's base columns are computed from its ten columns.
#[derive(Debug, Clone)]
pub(crate) enum KeptColumns {
    /// A contiguous range, unchanged: first and number.
    Run(usize, usize),
    /// A selection, unchanged.
    Some(Vec<usize>),
    /// Linear combinations: 10 × number.
    Mixed(DMatrix<f64>),
}

/// Axes of a link rotated so that z' is its joint's axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum JointAxes {
    /// Cyclic permutation: x' is the link's axis of this index.
    Cyclic(usize),
    /// Rows are x', y', z' in link axes.
    Turned(Matrix3<f64>),
}

impl JointAxes {
    pub(crate) fn of(axis: &Unit<Vector3<f64>>) -> Self {
        for k in 0..3 {
            if axis[k].abs() > 1.0 - 1e-15 && axis[(k + 1) % 3] == 0.0 && axis[(k + 2) % 3] == 0.0 {
                return Self::Cyclic((k + 1) % 3);
            }
        }
        let mut least = 0;
        for k in 1..3 {
            if axis[k].abs() < axis[least].abs() {
                least = k;
            }
        }
        let mut e = Vector3::zeros();
        e[least] = 1.0;
        let x = (e - axis.into_inner() * axis[least]).normalize();
        let y = axis.cross(&x);
        Self::Turned(Matrix3::from_rows(&[x.transpose(), y.transpose(), axis.transpose()]))
    }

    /// Rows are x', y', z' in link axes.
    pub(crate) fn matrix(&self) -> Matrix3<f64> {
        match self {
            Self::Cyclic(first) => {
                let mut m = Matrix3::zeros();
                for row in 0..3 {
                    m[(row, (first + row) % 3)] = 1.0;
                }
                m
            }
            Self::Turned(m) => *m,
        }
    }
}

/// Index in φ of an inertia tensor element.
pub(crate) fn inertia_index(row: usize, column: usize) -> usize {
    match (row.min(column), row.max(column)) {
        (0, 0) => 4,
        (1, 1) => 5,
        (2, 2) => 6,
        (1, 2) => 7,
        (0, 2) => 8,
        _ => 9,
    }
}

/// One parameter that a link keeps, as a combination of its regrouped φ and as columns of its
/// block.
pub(crate) struct KeptParameter {
    /// Name without the link.
    pub name: String,
    /// Row: the parameter as a combination of the regrouped φ.
    pub row: Phi,
    /// Column: the corresponding combination of the link's ten regressor columns.
    pub column: Phi,
    /// φ index (with primes: of φ in joint axes) and the index subtracted from it, for the formula.
    pub of: (usize, Option<usize>),
}

pub(crate) const UNITS: [&str; 10] =
    ["kg", "kg·m", "kg·m", "kg·m", "kg·m²", "kg·m²", "kg·m²", "kg·m²", "kg·m²", "kg·m²"];
const ROOT_NAMES: [&str; 10] = ["M", "MCx", "MCy", "MCz", "Jxx", "Jyy", "Jzz", "Jyz", "Jzx", "Jxy"];

fn unit(k: usize) -> Phi {
    let mut e = Phi::zeros();
    e[k] = 1.0;
    e
}

fn plain(k: usize, name: &str) -> KeptParameter {
    KeptParameter { name: name.to_owned(), row: unit(k), column: unit(k), of: (k, None) }
}

/// Parameters that a link keeps.
pub(crate) fn kept_parameters(kind: &JointKind) -> Vec<KeptParameter> {
    match kind {
        JointKind::Free => (0..10).map(|k| plain(k, ROOT_NAMES[k])).collect(),
        JointKind::Spherical => (1..10).map(|k| plain(k, PHI_NAMES[k])).collect(),
        JointKind::Prismatic(_) => (0..4).map(|k| plain(k, PHI_NAMES[k])).collect(),
        JointKind::Fixed => Vec::new(),
        JointKind::Revolute(axis) => {
            let axes = JointAxes::of(axis);
            let in_joint_axes = phi_transform_by(&axes.matrix(), &Vector3::zeros());
            // The transform of φ by a rotation is not orthogonal, so its inverse is the transform
            // by the inverse rotation.
            let back = phi_transform_by(&axes.matrix().transpose(), &Vector3::zeros());
            let (names, index): (Vec<String>, Vec<usize>) = match axes {
                JointAxes::Cyclic(first) => {
                    let at = |k: usize| (first + k) % 3;
                    let index = [
                        1 + at(0),
                        1 + at(1),
                        4 + at(0),
                        4 + at(2),
                        inertia_index(at(1), at(2)),
                        inertia_index(at(2), at(0)),
                        inertia_index(at(0), at(1)),
                    ];
                    let mut names: Vec<String> = index.iter().map(|k| PHI_NAMES[*k].to_owned()).collect();
                    names[2] = format!("{}-{}", PHI_NAMES[4 + at(0)], PHI_NAMES[4 + at(1)]);
                    (names, index.to_vec())
                }
                JointAxes::Turned(_) => {
                    let index = vec![1, 2, 4, 6, 7, 8, 9];
                    let mut names: Vec<String> = index.iter().map(|k| format!("{}'", PHI_NAMES[*k])).collect();
                    names[2] = "Ixx'-Iyy'".to_owned();
                    (names, index)
                }
            };
            let joint_index = [1, 2, 4, 6, 7, 8, 9];
            let subtracted = match axes {
                JointAxes::Cyclic(first) => 4 + (first + 1) % 3,
                JointAxes::Turned(_) => 5,
            };
            let mut kept: Vec<KeptParameter> = (0..7)
                .map(|k| {
                    let mut row: Phi = in_joint_axes.row(joint_index[k]).transpose();
                    if k == 2 {
                        row -= in_joint_axes.row(5).transpose();
                    }
                    KeptParameter {
                        name: names[k].clone(),
                        row,
                        column: back.column(joint_index[k]).into_owned(),
                        of: (index[k], (k == 2).then_some(subtracted)),
                    }
                })
                .collect();
            // Order of φ, as far as the names are those of φ.
            kept.sort_by_key(|parameter| parameter.of.0);
            kept
        }
    }
}

/// 10×10 matrix: contribution to the parent's φ (parent axes and origin) from the link's own
/// regrouped φ.
fn given_to_parent(kind: &JointKind, parent_from_joint: &Isometry3<f64>) -> Matrix10 {
    let mut part = Matrix10::zeros();
    match kind {
        JointKind::Free => return part,
        JointKind::Fixed => part = Matrix10::identity(),
        JointKind::Spherical => part[(0, 0)] = 1.0,
        JointKind::Prismatic(_) => {
            part[(0, 0)] = 1.0;
            for k in 4..10 {
                part[(k, k)] = 1.0;
            }
        }
        JointKind::Revolute(axis) => {
            let to_joint = JointAxes::of(axis).matrix();
            part[(0, 0)] = 1.0;
            part[(3, 3)] = 1.0;
            part[(4, 5)] = 1.0;
            part[(5, 5)] = 1.0;
            let back = phi_transform_by(&to_joint.transpose(), &Vector3::zeros());
            part = back * part * phi_transform_by(&to_joint, &Vector3::zeros());
        }
    }
    phi_transform(parent_from_joint) * part
}

impl BaseParameters {
    /// Derives the regrouping from the tree alone. It depends on the joint positions, so derive it
    /// again after scaling.
    pub fn of(model: &Model) -> Self {
        let n = model.n_links();
        // φ of each link with everything regrouped into it, as a matrix on the stacked φ of its
        // subtree.
        let mut regrouped: Vec<Vec<(usize, Matrix10)>> = (0..n).map(|i| vec![(i, Matrix10::identity())]).collect();
        for i in (1..n).rev() {
            let joint = &model.links[i].joint;
            let given = given_to_parent(&joint.kind, &joint.parent_from_joint);
            let carried: Vec<_> = regrouped[i]
                .iter()
                .map(|(link, matrix)| (*link, given * matrix))
                .filter(|(_, matrix)| matrix.iter().any(|x| *x != 0.0))
                .collect();
            if let Some(parent) = model.links[i].parent {
                regrouped[parent].extend(carried);
            }
        }
        let kept_of: Vec<Vec<KeptParameter>> =
            model.links.iter().map(|link| kept_parameters(&link.joint.kind)).collect();
        let n_base = kept_of.iter().map(Vec::len).sum();
        let formulas = Formulas::of(model);
        let mut from_full = DMatrix::zeros(n_base, 10 * n);
        let mut to_full = DMatrix::zeros(10 * n, n_base);
        let mut parameters = Vec::with_capacity(n_base);
        let mut kept = Vec::with_capacity(n);
        let mut crossing = Vec::new();
        for (i, link) in model.links.iter().enumerate() {
            let first = parameters.len();
            for parameter in &kept_of[i] {
                let row = parameters.len();
                for (source, matrix) in &regrouped[i] {
                    let values = parameter.row.transpose() * matrix;
                    from_full.view_mut((row, 10 * source), (1, 10)).copy_from(&values);
                }
                to_full.view_mut((10 * i, row), (10, 1)).copy_from(&parameter.column);
                let name = match link.parent {
                    None => parameter.name.clone(),
                    Some(_) => format!("{}.{}", link.name, parameter.name),
                };
                parameters.push(BaseParameter {
                    name,
                    unit: UNITS[parameter.of.0],
                    formula: formulas.kept(i, parameter.of),
                });
            }
            if let (JointKind::Prismatic(_), Some(parent)) = (&link.joint.kind, link.parent) {
                // The mass is already counted in the parent, at the joint's zero position: subtract
                // it there.
                let at_zero: Phi = phi_transform(&link.joint.parent_from_joint).column(0).into_owned();
                for (k, value) in at_zero.iter().enumerate().filter(|(_, value)| **value != 0.0) {
                    to_full[(10 * parent + k, first)] -= value;
                    crossing.push((first, 10 * parent + k, -value));
                }
            }
            kept.push(Kept { first, columns: KeptColumns::of(&kept_of[i]) });
        }
        Self { parameters, from_full, to_full, kept, crossing }
    }

    /// Number of base parameters.
    pub fn len(&self) -> usize {
        self.parameters.len()
    }

    /// True for a model without links.
    pub fn is_empty(&self) -> bool {
        self.parameters.is_empty()
    }

    /// Index of a parameter by name.
    pub fn index(&self, name: &str) -> Option<usize> {
        self.parameters.iter().position(|parameter| parameter.name == name)
    }

    /// Base parameters `B φ` of links' parameters, in the order of [`BaseParameters::parameters`].
    ///
    /// # Panics
    /// If there are not as many `phi` as the model has links.
    pub fn regroup(&self, phi: &[Phi]) -> DVector<f64> {
        assert_eq!(10 * phi.len(), self.from_full.ncols(), "number of link parameters");
        let stacked = DVector::from_iterator(10 * phi.len(), phi.iter().flat_map(|phi| phi.iter().copied()));
        &self.from_full * stacked
    }
}

impl KeptColumns {
    fn of(kept: &[KeptParameter]) -> Self {
        let single = |column: &Phi| {
            let mut entries = column.iter().enumerate().filter(|(_, value)| **value != 0.0);
            match (entries.next(), entries.next()) {
                (Some((k, value)), None) if *value == 1.0 => Some(k),
                _ => None,
            }
        };
        let columns: Option<Vec<usize>> = kept.iter().map(|parameter| single(&parameter.column)).collect();
        match columns {
            Some(columns) if columns.windows(2).all(|pair| pair[1] == pair[0] + 1) => {
                Self::Run(columns.first().copied().unwrap_or(0), columns.len())
            }
            Some(columns) => Self::Some(columns),
            None => Self::Mixed(DMatrix::from_fn(10, kept.len(), |row, column| kept[column].column[row])),
        }
    }
}
