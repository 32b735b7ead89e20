//! Results of an identification: values with their uncertainty, the prior for comparison, and a
//! verdict on their reliability.

use crate::clusters::{ClusterBy, WeightTrial};
use crate::determination::{Determination, Origin};
use crate::gate::Gate;
use crate::information::Information;
use crate::links::LinkSd;
use crate::missing_number::{nothing, nullable};
use crate::noise_metric::NoiseUnits;
use crate::{ColumnScaling, KindBalance, Sigma};
use aloft_body::LinkInertia;
use aloft_regressor::RowKind;
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// How parameters are estimated from the merged factor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Estimator {
    /// Smallest singular vector, scaled by the body mass (the paper).
    NullVector(ColumnScaling),
    /// The smallest vector in the metric of the rows' own noise, the mass held fixed; directions at
    /// the level of the noise are left to the prior ([`mod@crate::noise_metric`]).
    NoiseMetric,
    /// Least squares with the body mass held fixed.
    MassConstrained,
    /// Least squares with the body mass held fixed, regularised towards the prior.
    #[serde(alias = "regularized")]
    Regularised {
        /// Weight λ of the prior; if absent, chosen by leave-one-cluster-out error.
        #[serde(default)]
        weight: Option<f64>,
    },
}

impl Estimator {
    /// Name used in tables.
    pub fn name(&self) -> &'static str {
        match self {
            Self::NullVector(_) => "null_vector",
            Self::NoiseMetric => "noise_metric",
            Self::MassConstrained => "mass_constrained",
            Self::Regularised { .. } => "regularised",
        }
    }
}

/// One base parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BaseEstimate {
    /// Name, as in [`aloft_body::BaseParameter`].
    pub name: String,
    /// Estimate.
    pub value: f64,
    /// Standard error.
    #[serde(deserialize_with = "nullable")]
    pub se: f64,
    /// 95 % interval ([`crate::interval95`]); none if the standard error is unknown.
    pub ci95: Option<[f64; 2]>,
    /// Degrees of freedom of the standard error; null for infinity.
    #[serde(default = "nothing", deserialize_with = "nullable")]
    pub freedom: f64,
    /// `kg`, `kg·m` or `kg·m²`.
    pub unit: String,
    /// The regrouping as a formula.
    pub formula: String,
    /// Value of the prior, if there is one.
    pub prior: Option<f64>,
    /// Standard deviation of the prior.
    pub prior_sd: Option<f64>,
    /// How well the motion determines it.
    #[serde(rename = "seen")]
    pub determination: Determination,
    /// Origin of the value.
    #[serde(default)]
    pub from: Origin,
}

impl BaseEstimate {
    /// How well motion determines the value, or its origin if motion does not.
    pub fn determined_by(&self) -> &'static str {
        match (self.from, self.determination) {
            (Origin::Motion, Determination::Well) => "well",
            (Origin::Motion, _) => "partly",
            (other, _) => other.describe(),
        }
    }
}

/// One effect coefficient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EffectEstimate {
    /// Name of the column.
    pub name: String,
    /// Estimate; NaN if the rows do not determine it.
    #[serde(deserialize_with = "nullable")]
    pub value: f64,
    /// Standard error.
    #[serde(deserialize_with = "nullable")]
    pub se: f64,
    /// 95 % interval ([`crate::interval95`]); none if the standard error is unknown.
    pub ci95: Option<[f64; 2]>,
    /// Degrees of freedom of the standard error; null for infinity.
    #[serde(default = "nothing", deserialize_with = "nullable")]
    pub freedom: f64,
    /// Reason why the rows do not determine the coefficient; none if they do.
    #[serde(default)]
    pub not_determined: Option<String>,
}

impl EffectEstimate {
    /// A coefficient without a value.
    pub(crate) fn not_determined(name: &str, why: String) -> Self {
        let none = f64::NAN;
        Self { name: name.to_owned(), value: none, se: none, ci95: None, freedom: none, not_determined: Some(why) }
    }
}

/// Origins of a link's values.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LinkOrigin {
    /// Origin of the mass.
    pub mass_kg: Origin,
    /// Origin of the centre of mass.
    pub com_m: Origin,
    /// Origin of the inertia.
    pub inertia_kgm2: Origin,
}

impl LinkOrigin {
    /// The values that motion did not determine, in words; empty if it determined all.
    pub fn from_table(&self) -> String {
        let values = [(self.mass_kg, "mass"), (self.com_m, "centre of mass"), (self.inertia_kgm2, "inertia")];
        let named: Vec<&str> = values.iter().filter(|(o, _)| *o != Origin::Motion).map(|(_, name)| *name).collect();
        named.join(", ")
    }

    /// Text for a table column: `motion`, `from the table`, or which of the values are from the
    /// table.
    pub fn describe(&self) -> String {
        let by_motion = [self.mass_kg, self.com_m, self.inertia_kgm2].map(|o| o == Origin::Motion);
        match by_motion.iter().filter(|m| **m).count() {
            3 => Origin::Motion.describe().to_owned(),
            0 => Origin::Table.describe().to_owned(),
            _ => format!("{}: {}", self.from_table(), Origin::Table.describe()),
        }
    }
}

/// 95 % intervals of a link's values; none where a standard error is unknown.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct LinkIntervals {
    /// Interval of the mass, kg.
    pub mass_kg: Option<[f64; 2]>,
    /// Intervals of the centre of mass in the link frame, m.
    pub com_m: [Option<[f64; 2]>; 3],
    /// Intervals of the inertia about the centre of mass in link axes, kg·m²: xx yy zz yz zx xy.
    pub inertia_kgm2: [Option<[f64; 2]>; 6],
}

/// One link, physically consistent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LinkEstimate {
    /// Name of the link.
    pub name: String,
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass in the link frame, m.
    pub com_m: [f64; 3],
    /// Inertia about the centre of mass in link axes, kg·m², row by row.
    pub inertia_kgm2: [[f64; 3]; 3],
    /// Standard deviations.
    pub sd: LinkSd,
    /// 95 % intervals.
    pub ci95: LinkIntervals,
    /// Prior of the link.
    pub prior: LinkInertia,
    /// How well motion determines the link.
    #[serde(rename = "seen")]
    pub determination: Determination,
    /// Origins of its values.
    #[serde(default)]
    pub from: LinkOrigin,
    /// How far the recordings moved the mass from the table's, in the table's standard deviations.
    /// Where both agree it is below one: the variance of the move is that of the table less that of
    /// the estimate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mass_against_table: Option<f64>,
    /// How well the link is determined, in words.
    pub words: String,
}

/// From how many of the table's standard deviations on a mass contradicts it: three, which chance
/// gives fewer than one link in 370.
const CONTRADICTS: f64 = 3.0;

impl LinkEstimate {
    /// Whether the recordings contradict the table's mass.
    pub fn contradicts_table(&self) -> bool {
        self.mass_against_table.is_some_and(|z| z.abs() >= CONTRADICTS)
    }

    /// The link in the type used by the body crate.
    pub fn inertia(&self) -> LinkInertia {
        LinkInertia {
            mass_kg: self.mass_kg,
            com_m: self.com_m.into(),
            inertia_com_kgm2: nalgebra::Matrix3::from_fn(|i, j| self.inertia_kgm2[i][j]),
        }
    }
}

/// Result of an identification.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Parameters {
    /// Kind of rows.
    pub rows: RowKind,
    /// Estimator.
    pub estimator: Estimator,
    /// Body mass that fixes the scale, kg.
    pub mass_kg: f64,
    /// Base parameters.
    pub base: Vec<BaseEstimate>,
    /// Effect coefficients fitted with the base parameters.
    pub effects: Vec<EffectEstimate>,
    /// Consistent links; empty without a prior.
    pub links: Vec<LinkEstimate>,
    /// Singular values of the flights' parameter columns.
    pub sigma: Sigma,
    /// The rows in units of their noise; none where that was not computed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_units: Option<NoiseUnits>,
    /// Information that motion added to the prior; none without a prior.
    #[serde(default)]
    pub information: Option<Information>,
    /// Verdict on whether the numbers are reliable.
    pub gate: Gate,
    /// Number of stretches used, flights and contact.
    pub n_stretches: usize,
    /// Number of stretches of contact among them.
    #[serde(default)]
    pub n_contacts: usize,
    /// Number of trials used.
    pub n_trials: usize,
    /// Number of rows.
    pub n_rows: usize,
    /// Root mean square of the residual rows.
    #[serde(deserialize_with = "nullable")]
    pub row_rms: f64,
    /// Standard deviation s of a row, which sets the weight of the prior.
    #[serde(deserialize_with = "nullable")]
    pub row_sd: f64,
    /// Weight λ of the prior; 0 without a prior.
    pub prior_weight: f64,
    /// Weights that were tried.
    pub weights_tried: Vec<WeightTrial>,
    /// Unit of independent evidence.
    pub cluster: ClusterBy,
    /// Weighting of contact against flights; none if one of them is missing.
    #[serde(default)]
    pub contact: Option<KindBalance>,
    /// Source of the standard errors, in words.
    pub se_from: String,
    /// True if the intervals hold drawn errors of joint centres and marker places.
    #[serde(default)]
    pub with_geometry: bool,
}

impl Parameters {
    /// What the intervals hold and what they do not, as every surface says it.
    pub fn intervals_hold(&self) -> &'static str {
        if self.with_geometry {
            "95 % interval from the noise of the recordings and from errors of joint centres and marker places; effects that the model lacks are not in it"
        } else {
            "95 % interval from the noise of the recordings; errors of joint centres and marker places, and effects that the model lacks, are not in it"
        }
    }
    /// Number of flights used.
    pub fn n_flights(&self) -> usize {
        self.n_stretches.saturating_sub(self.n_contacts)
    }

    /// What the parameters were identified from, in words: *20 flights and 28 stretches of
    /// contact*.
    pub fn stretches(&self) -> String {
        let n = self.n_flights();
        let flights = format!("{n} flight{}", if n == 1 { "" } else { "s" });
        match self.n_contacts {
            0 => flights,
            1 => format!("{flights} and 1 stretch of contact"),
            n => format!("{flights} and {n} stretches of contact"),
        }
    }

    /// Coefficients by name for predictions: zero if the rows do not determine one, as in the fit.
    pub fn coefficients(&self) -> Vec<(String, f64)> {
        self.effects.iter().map(|e| (e.name.clone(), if e.value.is_finite() { e.value } else { 0.0 })).collect()
    }

    /// Values of the base parameters.
    pub fn base_values(&self) -> nalgebra::DVector<f64> {
        nalgebra::DVector::from_iterator(self.base.len(), self.base.iter().map(|b| b.value))
    }
}

/// Parameters together with the matrices that other stages need.
#[derive(Debug, Clone, PartialEq)]
pub struct Identification {
    /// The result.
    pub parameters: Parameters,
    /// Covariance of base parameters and effects.
    pub covariance: DMatrix<f64>,
    /// Bootstrap draws of base parameters and effects; empty unless asked for.
    pub draws: Vec<nalgebra::DVector<f64>>,
}
