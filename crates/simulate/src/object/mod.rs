//! Thrown objects: the two-link chain and any other model, and the session of throws.

pub mod chain;
pub mod custom;
pub mod throws;

use crate::physics::Body;
use nalgebra::Vector3;

/// A marker at its true position.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueMarker {
    /// Label.
    pub label: String,
    /// Index of the link.
    pub link: usize,
    /// Position in the link frame, m.
    pub position_m: Vector3<f64>,
}

/// An object that can be thrown.
#[derive(Debug, Clone)]
pub struct ThrownObject {
    /// Tree and inertias.
    pub body: Body,
    /// Markers.
    pub markers: Vec<TrueMarker>,
    /// Viscous friction of every joint except the root's, N·m·s/rad or N·s/m.
    pub damping: f64,
    /// Dry friction, N·m or N.
    pub friction: f64,
}
