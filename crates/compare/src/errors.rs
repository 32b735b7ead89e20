//! Error statistics: running sums over samples and the figures reported from them.
//!
//! The error is always *predicted − measured*. A figure over no samples is NaN, which is `null` in
//! JSON.

use nalgebra::{UnitQuaternion, Vector3, Vector6};
use serde::{Deserialize, Serialize};

/// Errors of a vector quantity, axis by axis (x, y, z), in the unit given by the field's name.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AxisErrors {
    /// Mean of the absolute error.
    #[serde(with = "nullable")]
    pub mae: [f64; 3],
    /// Root mean square error.
    #[serde(with = "nullable")]
    pub rmse: [f64; 3],
    /// Mean error, with sign.
    #[serde(with = "nullable")]
    pub bias: [f64; 3],
    /// Largest absolute error.
    #[serde(with = "nullable")]
    pub max: [f64; 3],
}

impl AxisErrors {
    /// Mean over the axes of the mean absolute error.
    pub fn mean_mae(&self) -> f64 {
        self.mae.iter().sum::<f64>() / 3.0
    }
    /// Root mean square over samples of the length of the error vector.
    pub fn norm_rms(&self) -> f64 {
        self.rmse.iter().map(|x| x * x).sum::<f64>().sqrt()
    }
}

/// Errors of the wrench on the root over frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WrenchErrors {
    /// Number of frames.
    pub frames: usize,
    /// Force in root axes, N.
    pub force_n: AxisErrors,
    /// Moment about the root origin in root axes, N·m.
    pub moment_nm: AxisErrors,
    /// Force in world axes, N.
    pub force_world_n: AxisErrors,
    /// Moment about the root origin in world axes, N·m.
    pub moment_world_nm: AxisErrors,
}

impl WrenchErrors {
    /// Scalar error for ranking: root mean square of the force error, and of the moment error over
    /// a lever of 0.1 m, N.
    pub fn size(&self) -> f64 {
        size(&self.force_n, &self.moment_nm)
    }
}

/// Errors of weak-window averages `∫ψ e dt / ∫ψ dt` over windows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WindowErrors {
    /// Number of windows; neighbours overlap.
    pub windows: usize,
    /// Force in world axes, N.
    pub force_n: AxisErrors,
    /// Moment in world axes about the path of the centre of mass, N·m.
    pub moment_nm: AxisErrors,
}

impl WindowErrors {
    /// As [`WrenchErrors::size`].
    pub fn size(&self) -> f64 {
        size(&self.force_n, &self.moment_nm)
    }
}

/// Lever that converts moments into forces where both are added, m.
pub(crate) const MOMENT_LEVER_M: f64 = 0.1;

fn size(force_n: &AxisErrors, moment_nm: &AxisErrors) -> f64 {
    force_n.norm_rms().hypot(moment_nm.norm_rms() / MOMENT_LEVER_M)
}

/// Residual wrench in flight, where it should be zero.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AxisResidual {
    /// Root mean square, axis by axis.
    #[serde(with = "nullable")]
    pub rms: [f64; 3],
    /// Mean absolute value.
    #[serde(with = "nullable")]
    pub mae: [f64; 3],
    /// Mean, with sign.
    #[serde(with = "nullable")]
    pub bias: [f64; 3],
    /// Largest absolute value.
    #[serde(with = "nullable")]
    pub max: [f64; 3],
}

impl From<AxisErrors> for AxisResidual {
    fn from(e: AxisErrors) -> Self {
        Self { rms: e.rmse, mae: e.mae, bias: e.bias, max: e.max }
    }
}

/// Residual wrench over flights: root axes, about the root origin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FlightErrors {
    /// Number of frames.
    pub frames: usize,
    /// Force, N.
    pub residual_force_n: AxisResidual,
    /// Moment, N·m.
    pub residual_moment_nm: AxisResidual,
}

impl From<&WrenchErrors> for FlightErrors {
    fn from(e: &WrenchErrors) -> Self {
        Self { frames: e.frames, residual_force_n: e.force_n.into(), residual_moment_nm: e.moment_nm.into() }
    }
}

/// Running sums of six components.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sums {
    pub n: usize,
    absolute: Vector6<f64>,
    square: Vector6<f64>,
    signed: Vector6<f64>,
    max: Vector6<f64>,
}

impl Sums {
    pub fn add(&mut self, e: &Vector6<f64>) {
        self.n += 1;
        let absolute = e.abs();
        self.absolute += absolute;
        self.square += e.component_mul(e);
        self.signed += e;
        self.max = self.max.sup(&absolute);
    }
    pub fn merge(&mut self, other: &Self) {
        self.n += other.n;
        self.absolute += other.absolute;
        self.square += other.square;
        self.signed += other.signed;
        self.max = self.max.sup(&other.max);
    }
    fn axes(&self, first: usize) -> AxisErrors {
        let n = if self.n == 0 { f64::NAN } else { self.n as f64 };
        let of = |v: &Vector6<f64>, f: &dyn Fn(f64) -> f64| std::array::from_fn(|i| f(v[first + i]));
        AxisErrors {
            mae: of(&self.absolute, &|x| x / n),
            rmse: of(&self.square, &|x| (x / n).sqrt()),
            bias: of(&self.signed, &|x| x / n),
            max: of(&self.max, &|x| if self.n == 0 { f64::NAN } else { x }),
        }
    }
    pub fn windows(&self) -> WindowErrors {
        WindowErrors { windows: self.n, force_n: self.axes(0), moment_nm: self.axes(3) }
    }
}

/// Running sums in root and world axes.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct WrenchSums {
    root: Sums,
    world: Sums,
}

impl WrenchSums {
    /// Adds an error in root axes; `rotation` turns root axes into world axes.
    pub fn add(&mut self, e: &Vector6<f64>, rotation: &UnitQuaternion<f64>) {
        self.root.add(e);
        self.world.add(&rotated(e, rotation));
    }
    pub fn merge(&mut self, other: &Self) {
        self.root.merge(&other.root);
        self.world.merge(&other.world);
    }
    pub fn errors(&self) -> WrenchErrors {
        WrenchErrors {
            frames: self.root.n,
            force_n: self.root.axes(0),
            moment_nm: self.root.axes(3),
            force_world_n: self.world.axes(0),
            moment_world_nm: self.world.axes(3),
        }
    }
}

/// Rotates force and moment of a wrench.
pub(crate) fn rotated(w: &Vector6<f64>, rotation: &UnitQuaternion<f64>) -> Vector6<f64> {
    let (f, m) = halves(w);
    joined(&(rotation * f), &(rotation * m))
}

pub(crate) fn halves(w: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (Vector3::new(w[0], w[1], w[2]), Vector3::new(w[3], w[4], w[5]))
}

pub(crate) fn joined(f: &Vector3<f64>, m: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(f.x, f.y, f.z, m.x, m.y, m.z)
}

/// NaN is `null` in text formats and is read back as NaN.
pub(crate) mod nullable {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(values: &[f64; 3], to: S) -> Result<S::Ok, S::Error> {
        values.map(|x| x.is_finite().then_some(x)).serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<[f64; 3], D::Error> {
        Ok(<[Option<f64>; 3]>::deserialize(from)?.map(|x| x.unwrap_or(f64::NAN)))
    }

    /// The same for one number.
    pub mod one {
        use super::*;

        pub fn serialize<S: Serializer>(value: &f64, to: S) -> Result<S::Ok, S::Error> {
            value.is_finite().then_some(*value).serialize(to)
        }

        pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
            Ok(Option::<f64>::deserialize(from)?.unwrap_or(f64::NAN))
        }
    }
}
