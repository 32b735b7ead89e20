//! What a law can be made of: the place on which a force acts, the direction that it keeps, and the
//! variable on which its strength depends.

use aloft_body::JointKind;
use aloft_effects::{EffectFrame, Scene};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Part of the body on which a force or couple acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Carrier {
    /// The centre of mass of the whole body; link axes are those of the root.
    Body,
    /// One link, by index.
    Link(usize),
}

/// Name of the whole body as a carrier.
pub const WHOLE_BODY: &str = "body";

impl Carrier {
    /// Name of the link, or `body`.
    pub fn name(self, scene: &Scene) -> String {
        match self {
            Self::Body => WHOLE_BODY.to_owned(),
            Self::Link(i) => scene.model.links.get(i).map_or_else(|| format!("link{i}"), |l| l.name.clone()),
        }
    }
    /// The other ones among these, each once, in their order.
    pub(super) fn others(self, carriers: impl Iterator<Item = Self>) -> Vec<Self> {
        let mut out: Vec<Self> = Vec::new();
        for other in carriers {
            if other != self && !out.contains(&other) {
                out.push(other);
            }
        }
        out
    }
    /// Index of the link whose axes are "link axes".
    pub fn link(self) -> usize {
        match self {
            Self::Body => 0,
            Self::Link(i) => i,
        }
    }
}

/// Force at a point, or couple.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// Force, N, at the carrier's point.
    Force,
    /// Couple, N·m.
    Couple,
}

/// Kinematics of a place at an instant, world axes, SI units.
#[derive(Debug, Clone, Copy)]
pub struct Instant {
    /// Position, m.
    pub position: Vector3<f64>,
    /// Velocity, m/s.
    pub velocity: Vector3<f64>,
    /// Rotation of the link in the world.
    pub rotation: Matrix3<f64>,
    /// Angular velocity of the link, rad/s.
    pub omega: Vector3<f64>,
}

impl Instant {
    /// The place `point` (link frame, m; unused for the whole body) of a carrier.
    pub fn of(frame: &EffectFrame<'_>, carrier: Carrier, point: &Vector3<f64>) -> Self {
        let link = &frame.links[carrier.link()];
        match carrier {
            Carrier::Body => {
                Self { position: frame.com, velocity: frame.com_velocity, rotation: link.rotation, omega: link.omega }
            }
            Carrier::Link(_) => Self {
                position: link.point(point),
                velocity: link.point_velocity(point),
                rotation: link.rotation,
                omega: link.omega,
            },
        }
    }
}

/// The direction that a force or couple keeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// Constant in the world.
    World,
    /// Constant in the link.
    Link,
    /// Against the velocity of the place.
    AgainstVelocity,
    /// Across the velocity: b × v/|v| with b constant in the world.
    AcrossVelocity,
    /// The same with b constant in the link.
    AcrossVelocityInLink,
    /// Against the angular velocity.
    AgainstSpin,
    /// ω × v (both from the link; not of unit length).
    SpinCrossVelocity,
    /// Towards a point of the world.
    Towards,
}

impl Direction {
    /// Directions that need no search of their own.
    pub const FIXED: [Self; 7] = [
        Self::World,
        Self::Link,
        Self::AgainstVelocity,
        Self::AcrossVelocity,
        Self::AcrossVelocityInLink,
        Self::AgainstSpin,
        Self::SpinCrossVelocity,
    ];

    /// The magnitude of the vector that this direction follows: the variable of a law that looks
    /// the same from every side.
    pub fn magnitude(self) -> Option<Variable> {
        match self {
            Self::AgainstVelocity | Self::AcrossVelocity | Self::AcrossVelocityInLink => Some(Variable::Speed),
            Self::AgainstSpin => Some(Variable::Spin),
            _ => None,
        }
    }

    /// Number of components with a coefficient each.
    pub fn components(self) -> usize {
        match self {
            Self::World | Self::Link | Self::AcrossVelocity | Self::AcrossVelocityInLink => 3,
            _ => 1,
        }
    }

    /// Groups of components that are worth trying by themselves.
    pub fn choices(self) -> &'static [&'static [usize]] {
        match self {
            Self::World => &[&[0, 1, 2], &[0, 1], &[2], &[0], &[1]],
            Self::Link | Self::AcrossVelocity | Self::AcrossVelocityInLink => &[&[0, 1, 2], &[0], &[1], &[2]],
            _ => &[&[0]],
        }
    }

    /// [`vector`](Self::vector) of the motion at an earlier instant, `then`: components along axes
    /// of the link turn with it until `now`.
    pub fn vector_of(self, component: usize, then: &Instant, now: &Instant, anchor: &Vector3<f64>) -> Vector3<f64> {
        let v = self.vector(component, then, anchor);
        match self {
            Self::Link | Self::AcrossVelocityInLink => now.rotation * then.rotation.tr_mul(&v),
            _ => v,
        }
    }

    /// Unit vector of a component, world axes (of length |ω||v| or less for ω × v).
    pub fn vector(self, component: usize, at: &Instant, anchor: &Vector3<f64>) -> Vector3<f64> {
        let unit = |v: &Vector3<f64>| {
            let n = v.norm();
            if n > 1e-9 { v / n } else { Vector3::zeros() }
        };
        let axis = |k: usize| Vector3::ith(k, 1.0);
        match self {
            Self::World => axis(component),
            Self::Link => at.rotation * axis(component),
            Self::AgainstVelocity => -unit(&at.velocity),
            Self::AcrossVelocity => axis(component).cross(&unit(&at.velocity)),
            Self::AcrossVelocityInLink => (at.rotation * axis(component)).cross(&unit(&at.velocity)),
            Self::AgainstSpin => -unit(&at.omega),
            Self::SpinCrossVelocity => at.omega.cross(&at.velocity),
            Self::Towards => unit(&(anchor - at.position)),
        }
    }
}

/// A quantity on which the strength of a law depends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Variable {
    /// None: constant strength.
    None,
    /// Speed of the place, m/s.
    Speed,
    /// Component of its velocity in the world, m/s.
    VelocityInWorld(usize),
    /// Component of its velocity along an axis of the link, m/s.
    VelocityInLink(usize),
    /// Magnitude of the angular velocity, rad/s.
    Spin,
    /// Component of the angular velocity in the world, rad/s.
    SpinInWorld(usize),
    /// Component of the angular velocity along an axis of the link, rad/s.
    SpinInLink(usize),
    /// Coordinate of the place in the world, m.
    Place(usize),
    /// Vertical component of an axis of the link.
    Tilt(usize),
    /// Coordinate of the hinge or slide of a link, rad or m.
    JointAngle(usize),
    /// Its rate, rad/s or m/s.
    JointRate(usize),
    /// Time since take-off, s; zero in contact.
    SinceTakeOff,
    /// Time in the recording, s.
    Clock,
    /// Distance of the place from the point that the force is directed to, m.
    Distance,
}

impl Variable {
    /// All variables that exist for a body, apart from the clock and the distance, which have
    /// searches of their own.
    pub fn of(scene: &Scene) -> Vec<Self> {
        let mut out = vec![Self::None, Self::Speed, Self::Spin, Self::SinceTakeOff];
        let each: [fn(usize) -> Self; 6] =
            [Self::VelocityInWorld, Self::VelocityInLink, Self::SpinInWorld, Self::SpinInLink, Self::Place, Self::Tilt];
        for of in each {
            out.extend((0..3).map(of));
        }
        for (i, link) in scene.model.links.iter().enumerate() {
            if matches!(link.joint.kind, JointKind::Revolute(_) | JointKind::Prismatic(_)) {
                out.extend([Self::JointAngle(i), Self::JointRate(i)]);
            }
        }
        out
    }

    /// Pairs whose product a force or couple fixed in the link may follow. Flow past a surface of
    /// the link presses along an axis with the velocity along it times the speed of the flow, or
    /// times another component (lift: c uₖ |uⱼ|); bodies that spin inside a link resist with
    /// products of its spins.
    pub fn pairs_of(action: Action) -> Vec<(Self, Self)> {
        let (along, size): (fn(usize) -> Self, Self) = match action {
            Action::Force => (Self::VelocityInLink, Self::Speed),
            Action::Couple => (Self::SpinInLink, Self::Spin),
        };
        let others = |k: usize| [along((k + 1) % 3), along((k + 2) % 3), size];
        (0..3).flat_map(|k| others(k).map(|other| (along(k), other))).collect()
    }

    /// Highest angular frequency that is searched for waves of this variable, radians per unit: 8
    /// Hz of the clock, four periods in a turn of a hinge; none where waves have no search of their
    /// own.
    pub fn fastest(self) -> Option<f64> {
        match self {
            Self::Clock => Some(8.0 * 2.0 * std::f64::consts::PI),
            Self::JointAngle(_) => Some(4.0),
            _ => None,
        }
    }

    /// Value in a frame.
    pub fn value(self, frame: &EffectFrame<'_>, at: &Instant, anchor: &Vector3<f64>) -> f64 {
        let links = &frame.scene.model.links;
        match self {
            Self::None => 1.0,
            Self::Speed => at.velocity.norm(),
            Self::VelocityInWorld(k) => at.velocity[k],
            Self::VelocityInLink(k) => at.rotation.tr_mul(&at.velocity)[k],
            Self::Spin => at.omega.norm(),
            Self::SpinInWorld(k) => at.omega[k],
            Self::SpinInLink(k) => at.rotation.tr_mul(&at.omega)[k],
            Self::Place(k) => at.position[k],
            Self::Tilt(k) => at.rotation[(2, k)],
            Self::JointAngle(i) => frame.q[links[i].joint.q_offset],
            Self::JointRate(i) => frame.v[links[i].joint.v_offset],
            Self::SinceTakeOff => frame.since_take_off_s(),
            Self::Clock => frame.time_s,
            Self::Distance => (anchor - at.position).norm(),
        }
    }

    /// Name in formulas.
    pub fn formula(self, scene: &Scene) -> String {
        let axis = |k: usize| ["x", "y", "z"][k.min(2)];
        let link = |i: usize| scene.model.links.get(i).map_or("", |l| l.name.as_str());
        match self {
            Self::None => "1".to_owned(),
            Self::Speed => "speed".to_owned(),
            Self::VelocityInWorld(k) => format!("v_world_{}", axis(k)),
            Self::VelocityInLink(k) => format!("v_link_{}", axis(k)),
            Self::Spin => "spin".to_owned(),
            Self::SpinInWorld(k) => format!("omega_world_{}", axis(k)),
            Self::SpinInLink(k) => format!("omega_link_{}", axis(k)),
            Self::Place(k) => format!("r_{}", axis(k)),
            Self::Tilt(k) => format!("tilt_{}", axis(k)),
            Self::JointAngle(i) => format!("q_{}", link(i)),
            Self::JointRate(i) => format!("qd_{}", link(i)),
            Self::SinceTakeOff => "since_start".to_owned(),
            Self::Clock => "t".to_owned(),
            Self::Distance => "distance".to_owned(),
        }
    }

    /// SI unit in words, radians included.
    pub fn unit_in_words(self, scene: &Scene) -> &'static str {
        match (self, self.unit(scene)) {
            (Self::JointAngle(_), "1") => "rad",
            (_, "1/s") => "rad/s",
            (_, unit) => unit,
        }
    }

    /// SI unit in formulas, where radians have none.
    pub fn unit(self, scene: &Scene) -> &'static str {
        let slide =
            |i: usize| scene.model.links.get(i).is_some_and(|l| matches!(l.joint.kind, JointKind::Prismatic(_)));
        match self {
            Self::None | Self::Tilt(_) => "1",
            Self::Speed | Self::VelocityInWorld(_) | Self::VelocityInLink(_) => "m/s",
            Self::Spin | Self::SpinInWorld(_) | Self::SpinInLink(_) => "1/s",
            Self::Place(_) | Self::Distance => "m",
            Self::JointAngle(i) => {
                if slide(i) {
                    "m"
                } else {
                    "1"
                }
            }
            Self::JointRate(i) => {
                if slide(i) {
                    "m/s"
                } else {
                    "1/s"
                }
            }
            Self::SinceTakeOff | Self::Clock => "s",
        }
    }

    /// True for velocities and angular velocities.
    pub fn is_rate(self) -> bool {
        matches!(
            self,
            Self::Speed
                | Self::Spin
                | Self::VelocityInWorld(_)
                | Self::VelocityInLink(_)
                | Self::SpinInWorld(_)
                | Self::SpinInLink(_)
                | Self::JointRate(_)
        )
    }

    /// True if it differs from point to point of a link.
    pub fn is_of_point(self) -> bool {
        matches!(
            self,
            Self::Speed | Self::VelocityInWorld(_) | Self::VelocityInLink(_) | Self::Place(_) | Self::Distance
        )
    }

    /// True if it takes both signs.
    pub fn is_signed(self) -> bool {
        !matches!(self, Self::None | Self::Speed | Self::Spin | Self::SinceTakeOff | Self::Clock | Self::Distance)
    }
}
