//! The unknowns of an effect: names, units, bounds, and geometric meaning.

use crate::{Scene, Target};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Geometric meaning of a number, so that any effect can be rotated to another direction.
/// Components 0, 1, 2 are x, y, z, in this order; a horizontal vector has only the first two.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum ParameterKind {
    /// A number without direction.
    #[default]
    Scalar,
    /// Component of a position in the world, m.
    PointInWorld(usize),
    /// Component of a vector in world axes.
    VectorInWorld(usize),
    /// Component of a position in the frame of a link, m.
    PointOnLink(usize),
    /// Component of a vector in the axes of a link.
    VectorOnLink(usize),
}

impl ParameterKind {
    /// True for the x component of a vector in any axes whose y component is the unknown `next`.
    pub fn begins_vector(self, next: Option<Self>) -> bool {
        matches!(
            (self, next),
            (Self::VectorInWorld(0), Some(Self::VectorInWorld(1)))
                | (Self::VectorOnLink(0), Some(Self::VectorOnLink(1)))
        )
    }
}

/// Names of the components of a vector.
pub(crate) const AXES: [&str; 3] = ["x", "y", "z"];

/// An unknown to which the effect's wrench is proportional.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Coefficient {
    /// Name.
    pub name: String,
    /// SI unit; `1` for none.
    pub unit: String,
    /// Smallest plausible value (physics may forbid a sign).
    pub lower: f64,
    /// Largest plausible value.
    pub upper: f64,
    /// Geometric meaning.
    #[serde(skip)]
    pub kind: ParameterKind,
}

impl Coefficient {
    /// Any finite value.
    pub fn free(name: impl Into<String>, unit: &str) -> Self {
        Self::within(name, unit, f64::NEG_INFINITY, f64::INFINITY)
    }
    /// Zero or more.
    pub fn positive(name: impl Into<String>, unit: &str) -> Self {
        Self::within(name, unit, 0.0, f64::INFINITY)
    }
    /// A number without direction, within bounds.
    pub fn within(name: impl Into<String>, unit: &str, lower: f64, upper: f64) -> Self {
        Self { name: name.into(), unit: unit.to_owned(), lower, upper, kind: ParameterKind::Scalar }
    }
    /// Components `prefix_x`, `prefix_y`, `prefix_z` of a vector in world axes, each at most `most`
    /// in magnitude.
    pub fn vector_in_world(prefix: &str, unit: &str, most: f64) -> Vec<Self> {
        Self::vector(prefix, unit, most, ParameterKind::VectorInWorld)
    }
    /// The same in the axes of a link.
    pub fn vector_on_link(prefix: &str, unit: &str, most: f64) -> Vec<Self> {
        Self::vector(prefix, unit, most, ParameterKind::VectorOnLink)
    }
    fn vector(prefix: &str, unit: &str, most: f64, kind: fn(usize) -> ParameterKind) -> Vec<Self> {
        let of = |(k, axis): (usize, &&str)| Self {
            kind: kind(k),
            ..Self::within(format!("{prefix}_{axis}"), unit, -most, most)
        };
        AXES.iter().enumerate().map(of).collect()
    }
}

/// An unknown on which the columns themselves depend nonlinearly.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NonlinearParameter {
    /// Name.
    pub name: String,
    /// SI unit; `1` for none.
    pub unit: String,
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// Step of finite differences and trust-region unit: a change that alters the columns
    /// noticeably.
    pub scale: f64,
    /// Geometric meaning.
    #[serde(skip)]
    pub kind: ParameterKind,
}

impl NonlinearParameter {
    /// A number without direction, with its bounds.
    pub fn new(name: impl Into<String>, unit: &str, lower: f64, upper: f64, scale: f64) -> Self {
        Self { name: name.into(), unit: unit.to_owned(), lower, upper, scale, kind: ParameterKind::Scalar }
    }
    /// Components `prefix_x` … of a position in the world, m, each within `reach` of `centre`.
    pub fn point_in_world(prefix: &str, centre: &Vector3<f64>, reach: f64) -> Vec<Self> {
        Self::point(prefix, centre, reach, ParameterKind::PointInWorld)
    }
    /// Components `prefix_x` … of a position in the frame of a link, m, each within `reach` of
    /// `centre`.
    pub fn point_on_link(prefix: &str, centre: &Vector3<f64>, reach: f64) -> Vec<Self> {
        Self::point(prefix, centre, reach, ParameterKind::PointOnLink)
    }
    /// The position on the target's link of a force or a mass: `point_x` …, within 0.3 m of the
    /// link's centre of mass, on a longer link as far as its ends.
    pub fn point_of(scene: &Scene, target: Target) -> Vec<Self> {
        let middle = scene.com_of(target);
        Self::point_on_link("point", &middle, (1.1 * middle.norm()).max(0.3))
    }
    /// Components `prefix_x` … of a vector in world axes, each at most `most` in magnitude.
    pub fn vector_in_world(prefix: &str, unit: &str, most: f64, scale: f64) -> Vec<Self> {
        let of = |(k, axis): (usize, &&str)| Self {
            kind: ParameterKind::VectorInWorld(k),
            ..Self::new(format!("{prefix}_{axis}"), unit, -most, most, scale)
        };
        AXES.iter().enumerate().map(of).collect()
    }
    fn point(prefix: &str, centre: &Vector3<f64>, reach: f64, kind: fn(usize) -> ParameterKind) -> Vec<Self> {
        let of = |(k, (axis, c)): (usize, (&&str, &f64))| Self {
            kind: kind(k),
            ..Self::new(format!("{prefix}_{axis}"), "m", c - reach, c + reach, 0.2 * reach.min(0.5))
        };
        AXES.iter().zip(centre.iter()).enumerate().map(of).collect()
    }
}

/// Values of nonlinear parameters, read in the order of [`crate::Effect::nonlinear`]. A missing
/// value is NaN.
#[derive(Debug, Clone)]
pub struct Values<'a> {
    rest: &'a [f64],
}

impl<'a> Values<'a> {
    /// Starts at the first value.
    pub fn new(values: &'a [f64]) -> Self {
        Self { rest: values }
    }
    /// The next number.
    pub fn scalar(&mut self) -> f64 {
        let Some((first, rest)) = self.rest.split_first() else { return f64::NAN };
        self.rest = rest;
        *first
    }
    /// The next three numbers as a position or a vector.
    pub fn vector(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.scalar())
    }
    /// All values not read yet.
    pub fn rest(self) -> &'a [f64] {
        self.rest
    }
}
