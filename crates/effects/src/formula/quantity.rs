//! Named quantities for use in formulas, with their units.

use super::spec::FormulaAxes;
use super::unit::Unit;
use crate::scene::AIR_DENSITY_KGPM3;
use crate::{EffectFrame, Scene};
use aloft_body::JointKind;
use nalgebra::Vector3;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Quantity {
    V(usize),
    VWorld(usize),
    VLink(usize),
    OmegaWorld(usize),
    OmegaLink(usize),
    Tilt(usize),
    Speed,
    A(usize),
    R(usize),
    Omega(usize),
    Spin,
    Alpha(usize),
    Com(usize),
    ComV(usize),
    Time,
    SinceTakeOff,
    SinceTouchDown,
    ToEnd,
    Coordinate(usize),
    Rate(usize),
    Mass,
    LinkMass,
    AreaShare,
    AirDensity,
    Gravity,
    Pi,
}

/// Quantities by name, without those of the joints.
pub(super) const QUANTITIES: &str = "v_x v_y v_z speed a_x a_y a_z r_x r_y r_z omega_x omega_y omega_z spin alpha_x alpha_y alpha_z \
v_world_x … v_link_x … omega_world_x … omega_link_x … tilt_x tilt_y tilt_z com_x com_y com_z comv_x comv_y comv_z t since_start since_landing to_end mass link_mass area_share air_density gravity pi";

/// Quantity with a given name, and its unit.
pub(super) fn quantity(scene: &Scene, name: &str) -> Option<(Quantity, Unit)> {
    let (m, kg) = (Unit([1.0, 0.0, 0.0]), Unit([0.0, 1.0, 0.0]));
    let (per_s, per_s2) = (Unit([0.0, 0.0, -1.0]), Unit([0.0, 0.0, -2.0]));
    let speed = m.times(per_s, 1.0);
    let plain = match name {
        "speed" => Some((Quantity::Speed, speed)),
        "spin" => Some((Quantity::Spin, per_s)),
        "t" => Some((Quantity::Time, per_s.raised(-1.0))),
        "since_start" => Some((Quantity::SinceTakeOff, per_s.raised(-1.0))),
        "since_landing" => Some((Quantity::SinceTouchDown, per_s.raised(-1.0))),
        "to_end" => Some((Quantity::ToEnd, per_s.raised(-1.0))),
        "mass" => Some((Quantity::Mass, kg)),
        "link_mass" => Some((Quantity::LinkMass, kg)),
        "area_share" => Some((Quantity::AreaShare, Unit::NONE)),
        "air_density" => Some((Quantity::AirDensity, kg.times(m, -3.0))),
        "gravity" => Some((Quantity::Gravity, m.times(per_s2, 1.0))),
        "pi" => Some((Quantity::Pi, Unit::NONE)),
        _ => None,
    };
    if plain.is_some() {
        return plain;
    }
    let (stem, rest) = name.split_once('_')?;
    if stem == "q" || stem == "qd" {
        let joint = &scene.model.links.iter().find(|l| l.name == rest)?.joint;
        let unit = match joint.kind {
            JointKind::Revolute(_) => Unit::NONE,
            JointKind::Prismatic(_) => m,
            _ => return None,
        };
        return Some(match stem {
            "q" => (Quantity::Coordinate(joint.q_offset), unit),
            _ => (Quantity::Rate(joint.v_offset), unit.times(per_s, 1.0)),
        });
    }
    let axis_of = |name: &str| ["x", "y", "z"].iter().position(|a| *a == name);
    if let Some((axes, axis)) = rest.split_once('_') {
        let k = axis_of(axis)?;
        return match (stem, axes) {
            ("v", "world") => Some((Quantity::VWorld(k), speed)),
            ("v", "link") => Some((Quantity::VLink(k), speed)),
            ("omega", "world") => Some((Quantity::OmegaWorld(k), per_s)),
            ("omega", "link") => Some((Quantity::OmegaLink(k), per_s)),
            _ => None,
        };
    }
    let axis = axis_of(rest)?;
    Some(match stem {
        "v" => (Quantity::V(axis), speed),
        "a" => (Quantity::A(axis), m.times(per_s2, 1.0)),
        "r" => (Quantity::R(axis), m),
        "omega" => (Quantity::Omega(axis), per_s),
        "alpha" => (Quantity::Alpha(axis), per_s2),
        "tilt" => (Quantity::Tilt(axis), Unit::NONE),
        "com" => (Quantity::Com(axis), m),
        "comv" => (Quantity::ComV(axis), speed),
        _ => return None,
    })
}

impl Quantity {
    /// Value of the quantity at a place in a frame.
    pub(super) fn value(self, f: &EffectFrame<'_>, place: &Place, axes: FormulaAxes) -> f64 {
        let link = &f.links[place.link];
        let turn = |v: Vector3<f64>| match axes {
            FormulaAxes::World => v,
            FormulaAxes::Link => link.rotation.tr_mul(&v),
        };
        match self {
            Self::V(k) => turn(place.velocity(f))[k],
            Self::VWorld(k) => place.velocity(f)[k],
            Self::VLink(k) => link.rotation.tr_mul(&place.velocity(f))[k],
            Self::OmegaWorld(k) => link.omega[k],
            Self::OmegaLink(k) => link.rotation.tr_mul(&link.omega)[k],
            Self::Tilt(k) => link.rotation[(2, k)],
            Self::Speed => place.velocity(f).norm(),
            Self::A(k) => turn(place.acceleration(f))[k],
            Self::R(k) => place.position(f)[k],
            Self::Omega(k) => turn(link.omega)[k],
            Self::Spin => link.omega.norm(),
            Self::Alpha(k) => turn(link.alpha)[k],
            Self::Com(k) => f.com[k],
            Self::ComV(k) => turn(f.com_velocity)[k],
            Self::Time => f.time_s,
            Self::SinceTakeOff => f.since_take_off_s(),
            Self::SinceTouchDown => f.since_touch_down_s(),
            Self::ToEnd => f.to_end_s,
            Self::Coordinate(i) => f.q[i],
            Self::Rate(i) => f.v[i],
            Self::Mass => f.scene.mass_kg,
            Self::LinkMass => match place.point {
                Some(_) => f.scene.phi[place.link][0],
                None => f.scene.mass_kg,
            },
            Self::AreaShare => match place.point {
                Some(_) => f.scene.area_share[place.link],
                None => 1.0,
            },
            Self::AirDensity => AIR_DENSITY_KGPM3,
            Self::Gravity => f.scene.gravity(),
            Self::Pi => std::f64::consts::PI,
        }
    }
}

/// Place of a law: a point of a link, or the centre of mass of the body (with the root's axes).
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub link: usize,
    /// Position in the link's frame, m; none for the centre of mass of the body.
    pub point: Option<Vector3<f64>>,
}

impl Place {
    pub(super) fn position(&self, f: &EffectFrame<'_>) -> Vector3<f64> {
        self.point.map_or(f.com, |p| f.links[self.link].point(&p))
    }
    fn velocity(&self, f: &EffectFrame<'_>) -> Vector3<f64> {
        self.point.map_or(f.com_velocity, |p| f.links[self.link].point_velocity(&p))
    }
    fn acceleration(&self, f: &EffectFrame<'_>) -> Vector3<f64> {
        self.point.map_or(f.com_acceleration, |p| f.links[self.link].point_acceleration(&p))
    }
}
