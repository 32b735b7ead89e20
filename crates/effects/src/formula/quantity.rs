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

/// Quantities that formulas may name, with unit and meaning: what a formula knows, what messages
/// and the editor of laws list, and what the book says.
#[derive(Debug, Clone, Copy)]
pub struct QuantityGroup {
    /// Names, separated by spaces: the components of a vector, or numbers of one kind.
    pub names: &'static str,
    /// Unit of each of them.
    pub unit: &'static str,
    /// Meaning.
    pub meaning: &'static str,
}

impl QuantityGroup {
    /// The names one by one.
    pub fn each(&self) -> std::str::Split<'static, char> {
        self.names.split(' ')
    }
}

/// Names, unit and meaning of quantities, and the quantity that each component is.
type Named = (&'static str, &'static str, &'static str, fn(usize) -> Quantity);

/// All quantities but those of hinges and slides (`q_<link>`, `qd_<link>`).
const QUANTITIES: [Named; 24] = [
    ("v_x v_y v_z", "m/s", "velocity of the point", Quantity::V),
    ("speed", "m/s", "its size", |_| Quantity::Speed),
    ("v_world_x v_world_y v_world_z", "m/s", "the same velocity along the axes of the world", Quantity::VWorld),
    ("v_link_x v_link_y v_link_z", "m/s", "the same velocity along the axes of the link", Quantity::VLink),
    ("a_x a_y a_z", "m/s²", "acceleration of the point", Quantity::A),
    ("r_x r_y r_z", "m", "place of the point in the world", Quantity::R),
    ("omega_x omega_y omega_z", "rad/s", "angular velocity of the link", Quantity::Omega),
    ("spin", "rad/s", "its size", |_| Quantity::Spin),
    (
        "omega_world_x omega_world_y omega_world_z",
        "rad/s",
        "the same along the axes of the world",
        Quantity::OmegaWorld,
    ),
    ("omega_link_x omega_link_y omega_link_z", "rad/s", "the same along the axes of the link", Quantity::OmegaLink),
    ("alpha_x alpha_y alpha_z", "rad/s²", "angular acceleration of the link", Quantity::Alpha),
    ("tilt_x tilt_y tilt_z", "1", "vertical component of the link's axes", Quantity::Tilt),
    ("com_x com_y com_z", "m", "centre of mass of the whole body", Quantity::Com),
    ("comv_x comv_y comv_z", "m/s", "its velocity", Quantity::ComV),
    ("t", "s", "time in the recording", |_| Quantity::Time),
    ("since_start", "s", "time since take-off or release, zero in contact", |_| Quantity::SinceTakeOff),
    ("since_landing", "s", "time since the stretch of contact began, zero in flight", |_| Quantity::SinceTouchDown),
    ("to_end", "s", "time until the flight or the contact ends", |_| Quantity::ToEnd),
    ("mass", "kg", "mass of the body", |_| Quantity::Mass),
    ("link_mass", "kg", "mass of the link, from tables", |_| Quantity::LinkMass),
    ("area_share", "1", "share of the link in the mean area shown to the air", |_| Quantity::AreaShare),
    ("air_density", "kg/m³", "of the air, 1.2: 20 °C at sea level", |_| Quantity::AirDensity),
    ("gravity", "m/s²", "magnitude of gravity", |_| Quantity::Gravity),
    ("pi", "1", "3.14159…", |_| Quantity::Pi),
];

/// All quantities but those of hinges and slides, which a body may lack.
pub fn quantities() -> impl Iterator<Item = QuantityGroup> {
    QUANTITIES.iter().map(|(names, unit, meaning, _)| QuantityGroup { names, unit, meaning })
}

/// The names of all of them, separated by spaces.
pub(super) fn names() -> String {
    QUANTITIES.map(|(names, ..)| names).join(" ")
}

/// Quantity with a given name, and its unit.
pub(super) fn quantity(scene: &Scene, name: &str) -> Option<(Quantity, Unit)> {
    let component = |names: &str| names.split(' ').position(|n| n == name);
    let found = QUANTITIES.iter().find_map(|(names, unit, _, of)| Some((of(component(names)?), *unit)));
    match found {
        // none: the units of this table can be read
        Some((quantity, unit)) => Some((quantity, Unit::parse(unit).ok()?)),
        None => of_joint(scene, name),
    }
}

/// Coordinate or rate of a hinge or slide, and its unit.
fn of_joint(scene: &Scene, name: &str) -> Option<(Quantity, Unit)> {
    let (stem, link) = name.split_once('_')?;
    let joint = &scene.model.links.iter().find(|l| l.name == link)?.joint;
    let unit = match joint.kind {
        JointKind::Revolute(_) => Unit::NONE,
        JointKind::Prismatic(_) => Unit([1.0, 0.0, 0.0]),
        _ => return None,
    };
    match stem {
        "q" => Some((Quantity::Coordinate(joint.q_offset), unit)),
        "qd" => Some((Quantity::Rate(joint.v_offset), unit.times(Unit([0.0, 0.0, -1.0]), 1.0))),
        _ => None,
    }
}

impl Quantity {
    /// Name of a time that counts from or to an end of the stretch.
    pub(super) fn counts_from_an_end(self) -> Option<&'static str> {
        match self {
            Self::SinceTakeOff => Some("since_start"),
            Self::SinceTouchDown => Some("since_landing"),
            Self::ToEnd => Some("to_end"),
            _ => None,
        }
    }

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_quantity_has_a_unit_that_can_be_read() {
        for (names, unit, meaning, _) in QUANTITIES {
            assert!(Unit::parse(unit).is_ok(), "{names}: {unit}");
            assert!(!meaning.is_empty(), "{names}");
        }
    }
}
