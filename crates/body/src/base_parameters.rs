//! Structural base parameters: the regrouping of the paper for free, spherical, revolute, prismatic and fixed joints.

use crate::Model;
use nalgebra::DMatrix;

/// One base parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct BaseParameter {
    /// Name: `M MCx MCy MCz Jxx Jyy Jzz Jyz Jzx Jxy` for the root (the paper's Table I), `<link>.mcx`, `<link>.Ixx-Iyy` … for the others.
    pub name: String,
    /// Unit: `kg`, `kg·m` or `kg·m²`.
    pub unit: &'static str,
    /// The regrouping spelled out, for example `m0 + m1`.
    pub formula: String,
}

/// The base parameters of a model's six root rows: `φ_B = B φ`, `Y_B = Y K`, with `Y φ = Y_B φ_B` for every motion.
#[derive(Debug, Clone)]
pub struct BaseParameters {
    /// The parameters in order; the first is always the total mass `M`.
    pub parameters: Vec<BaseParameter>,
    /// B, n_base × 10n.
    pub from_full: DMatrix<f64>,
    /// K, 10n × n_base.
    pub to_full: DMatrix<f64>,
}

impl BaseParameters {
    /// Derives the regrouping from the tree alone.
    pub fn of(_model: &Model) -> Self {
        todo!()
    }
    /// Number of base parameters.
    pub fn len(&self) -> usize {
        self.parameters.len()
    }
    /// True for a model without links.
    pub fn is_empty(&self) -> bool {
        self.parameters.is_empty()
    }
}
