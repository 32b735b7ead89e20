//! Hidden laws written as formulas: force and couple on a link, or on the whole body, as any
//! function of the motion, the place and the time.

use crate::error::SimulateError;
use crate::hidden::{Axes, FormulaText, Hidden, WHOLE_BODY};
use crate::physics::forces::{Wrench, omega};
use crate::physics::formula::Formula;
use aloft_body::{JointKind, Model, Phi, State};
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::VecDeque;

/// Everything that a force law may depend on, at one instant. `state` holds poses and velocities.
#[derive(Debug, Clone, Copy)]
pub struct Instant<'a> {
    /// Time of the recording, s.
    pub t: f64,
    /// Time since the last take-off (release), s; zero on the ground and in the hand.
    pub since_start: f64,
    /// The tree.
    pub model: &'a Model,
    /// Inertias of the links.
    pub phi: &'a [Phi],
    /// Poses and velocities.
    pub state: &'a State,
    /// Coordinates, length nq.
    pub q: &'a [f64],
    /// Velocities, length nv.
    pub v: &'a [f64],
}

/// What the delayed laws gave at past steps of the integrator.
#[derive(Debug, Clone, Default)]
pub struct Past {
    /// Time (s) and, for each delayed law, its six components.
    steps: VecDeque<(f64, Vec<[f64; 6]>)>,
}

impl Past {
    /// Adds the step at `t`, unless it is there already; forgets what is older than `keep_s`.
    pub fn push(&mut self, t: f64, values: Vec<[f64; 6]>, keep_s: f64) {
        if self.steps.back().is_some_and(|last| t <= last.0 + 1e-9) {
            return;
        }
        self.steps.push_back((t, values));
        // one step older than needed stays, for interpolation
        while self.steps.len() > 2 && self.steps[1].0 < t - keep_s {
            self.steps.pop_front();
        }
    }

    /// Components of delayed law `slot` at time `t`: linear between steps, the first step before
    /// it; `None` if nothing is stored.
    fn at(&self, t: f64, slot: usize) -> Option<[f64; 6]> {
        let after = self.steps.partition_point(|s| s.0 <= t);
        let (a, b) = match after {
            0 => return self.steps.front().map(|s| s.1[slot]),
            n if n == self.steps.len() => return self.steps.back().map(|s| s.1[slot]),
            n => (&self.steps[n - 1], &self.steps[n]),
        };
        let share = (t - a.0) / (b.0 - a.0);
        Some(std::array::from_fn(|i| a.1[slot][i] + share * (b.1[slot][i] - a.1[slot][i])))
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Quantity {
    Place(usize),
    Velocity(usize),
    LinkVelocity(usize),
    Speed,
    Omega(usize),
    LinkOmega(usize),
    Spin,
    /// Component `1` (world) of the link's axis `0`.
    AxisOf(usize, usize),
    Coordinate(usize),
    Rate(usize),
    Time,
    SinceStart,
}

/// Names of the quantities of every model, with one meaning each.
const NAMES: [(&str, Quantity); 31] = [
    ("x", Quantity::Place(0)),
    ("y", Quantity::Place(1)),
    ("z", Quantity::Place(2)),
    ("vx", Quantity::Velocity(0)),
    ("vy", Quantity::Velocity(1)),
    ("vz", Quantity::Velocity(2)),
    ("ux", Quantity::LinkVelocity(0)),
    ("uy", Quantity::LinkVelocity(1)),
    ("uz", Quantity::LinkVelocity(2)),
    ("speed", Quantity::Speed),
    ("wx", Quantity::Omega(0)),
    ("wy", Quantity::Omega(1)),
    ("wz", Quantity::Omega(2)),
    ("px", Quantity::LinkOmega(0)),
    ("py", Quantity::LinkOmega(1)),
    ("pz", Quantity::LinkOmega(2)),
    ("spin", Quantity::Spin),
    ("up_x", Quantity::AxisOf(0, 2)),
    ("up_y", Quantity::AxisOf(1, 2)),
    ("up_z", Quantity::AxisOf(2, 2)),
    ("ex_x", Quantity::AxisOf(0, 0)),
    ("ex_y", Quantity::AxisOf(0, 1)),
    ("ex_z", Quantity::AxisOf(0, 2)),
    ("ey_x", Quantity::AxisOf(1, 0)),
    ("ey_y", Quantity::AxisOf(1, 1)),
    ("ey_z", Quantity::AxisOf(1, 2)),
    ("ez_x", Quantity::AxisOf(2, 0)),
    ("ez_y", Quantity::AxisOf(2, 1)),
    ("ez_z", Quantity::AxisOf(2, 2)),
    ("t", Quantity::Time),
    ("since_start", Quantity::SinceStart),
];

/// One hidden law, ready to be evaluated.
#[derive(Debug, Clone)]
pub struct FormulaLaw {
    /// The link; `None`: the whole body.
    link: Option<usize>,
    point: Vector3<f64>,
    axes: Axes,
    /// Components of force, then couple, with their texts; `None` is zero.
    components: [Option<(Formula<Quantity>, String)>; 6],
    /// Delay, s, and the slot in [`Past`].
    delayed: Option<(f64, usize)>,
    place: String,
}

/// Position, velocity, orientation and angular velocity (world) of what the law acts on.
struct Carrier {
    at: Vector3<f64>,
    velocity: Vector3<f64>,
    rotation: UnitQuaternion<f64>,
    omega: Vector3<f64>,
}

impl FormulaLaw {
    /// Parses the formulas of entry `index` of the hidden effects; `None` for another effect than a
    /// law. `slot` is the number of delayed laws before this one, `scenario` its name for messages.
    ///
    /// # Errors
    /// [`SimulateError::Formula`] with entry, formula and position.
    pub fn new(
        model: &Model,
        effect: &Hidden,
        index: usize,
        slot: usize,
        scenario: &str,
    ) -> Result<Option<Self>, SimulateError> {
        let Hidden::Law { link, point_m, axes, force, moment, delay_s } = effect else {
            return Ok(None);
        };
        let link = match model.links.iter().position(|l| l.name == *link) {
            None if link == WHOLE_BODY => None,
            _ => Some(model.link_index(link)?),
        };
        let (lookup, known) = (|name: &str| quantity(model, name), known(model));
        let mut components = std::array::from_fn(|_| None);
        let texts = [("force", force), ("moment", moment)];
        for (k, (name, texts)) in texts.into_iter().enumerate() {
            for (i, text) in texts.iter().flatten().enumerate() {
                let formula = match text {
                    FormulaText::Number(x) if *x == 0.0 => continue,
                    FormulaText::Number(x) => format!("{x}"),
                    FormulaText::Text(text) => text.clone(),
                };
                let parsed = Formula::parse(&formula, &lookup, &known).map_err(|p| SimulateError::Formula {
                    scenario: scenario.to_owned(),
                    place: format!("hidden[{index}].{name}[{i}]"),
                    formula: formula.clone(),
                    position: p.at + 1,
                    problem: p.text,
                })?;
                components[3 * k + i] = Some((parsed, formula));
            }
        }
        let delayed = (*delay_s > 0.0).then_some((*delay_s, slot));
        let place = format!("hidden[{index}]");
        Ok(Some(Self { link, point: (*point_m).into(), axes: *axes, components, delayed, place }))
    }

    /// The delay, s; `None` if the law follows the motion at once.
    pub fn delay_s(&self) -> Option<f64> {
        self.delayed.map(|d| d.0)
    }

    fn carrier(&self, now: &Instant<'_>) -> Carrier {
        let link = self.link.unwrap_or(0);
        let (at, velocity) = match self.link {
            Some(link) => {
                (now.state.point_in_world(link, &self.point), now.state.point_velocity_in_world(link, &self.point))
            }
            None => (now.state.centre_of_mass(now.phi).1, now.state.centre_of_mass_velocity(now.phi)),
        };
        let rotation = now.state.world_from_link[link].rotation;
        Carrier { at, velocity, rotation, omega: omega(now.state, link) }
    }

    /// Values of the six formulas at an instant, in the law's axes: what [`Past`] stores.
    ///
    /// # Errors
    /// [`SimulateError::Undefined`] where a formula has no finite value.
    pub fn components(&self, now: &Instant<'_>) -> Result<[f64; 6], SimulateError> {
        self.components_of(now, &self.carrier(now))
    }

    fn components_of(&self, now: &Instant<'_>, carrier: &Carrier) -> Result<[f64; 6], SimulateError> {
        let along = carrier.rotation.inverse_transform_vector(&carrier.velocity);
        let spin = carrier.rotation.inverse_transform_vector(&carrier.omega);
        let axes = carrier.rotation.to_rotation_matrix();
        let of = |q: Quantity| match q {
            Quantity::Place(i) => carrier.at[i],
            Quantity::Velocity(i) => carrier.velocity[i],
            Quantity::LinkVelocity(i) => along[i],
            Quantity::Speed => carrier.velocity.norm(),
            Quantity::Omega(i) => carrier.omega[i],
            Quantity::LinkOmega(i) => spin[i],
            Quantity::Spin => carrier.omega.norm(),
            Quantity::AxisOf(axis, i) => axes[(i, axis)],
            Quantity::Coordinate(i) => now.q[i],
            Quantity::Rate(i) => now.v[i],
            Quantity::Time => now.t,
            Quantity::SinceStart => now.since_start,
        };
        let (mut out, mut stack, place) = ([0.0; 6], Vec::with_capacity(16), carrier.at.into());
        for (value, component) in out.iter_mut().zip(&self.components) {
            if let Some((formula, text)) = component {
                *value = formula.value(&mut stack, &place, of);
                if !value.is_finite() {
                    return Err(SimulateError::Undefined {
                        place: self.place.clone(),
                        formula: text.clone(),
                        found: format!("{value}"),
                        time_s: now.t,
                        at_m: place,
                    });
                }
            }
        }
        Ok(out)
    }

    /// Adds the law's wrench to those of the links. A delayed law takes its components from the
    /// past; they act at the present point, along the present axes. Before the first stored step
    /// the components of that step are taken, without any those of the present.
    ///
    /// # Errors
    /// As [`FormulaLaw::components`].
    pub fn add(&self, now: &Instant<'_>, past: &Past, wrenches: &mut [Wrench]) -> Result<(), SimulateError> {
        let carrier = self.carrier(now);
        let components = match self.delayed.and_then(|(delay, slot)| past.at(now.t - delay, slot)) {
            Some(components) => components,
            None => self.components_of(now, &carrier)?,
        };
        let turn = |i: usize| {
            let vector = Vector3::new(components[i], components[i + 1], components[i + 2]);
            match self.axes {
                Axes::World => vector,
                Axes::Link => carrier.rotation * vector,
            }
        };
        let (force, moment) = (turn(0), turn(3));
        match self.link {
            Some(link) => {
                wrenches[link].push(&force, &carrier.at);
                wrenches[link].moment_nm += moment;
            }
            None => {
                let mass: f64 = now.phi.iter().map(|p| p[0]).sum();
                for (link, phi) in now.phi.iter().enumerate().filter(|(_, phi)| phi[0] > 0.0) {
                    let share = phi[0] / mass;
                    let com = Vector3::new(phi[1], phi[2], phi[3]) / phi[0];
                    wrenches[link].push(&(force * share), &now.state.point_in_world(link, &com));
                    wrenches[link].moment_nm += moment * share;
                }
            }
        }
        Ok(())
    }
}

/// Joints with one coordinate: link, index in `q` and in `v`.
fn hinges(model: &Model) -> impl Iterator<Item = (&str, usize, usize)> {
    model.links.iter().filter_map(|link| match link.joint.kind {
        JointKind::Revolute(_) | JointKind::Prismatic(_) => {
            Some((link.name.as_str(), link.joint.q_offset, link.joint.v_offset))
        }
        _ => None,
    })
}

fn quantity(model: &Model, name: &str) -> Option<Quantity> {
    let hinge = |name: &str| hinges(model).find(|h| h.0 == name);
    if let Some(found) = NAMES.iter().find(|n| n.0 == name) {
        return Some(found.1);
    }
    let angle = name.strip_prefix("q_").and_then(hinge).map(|h| Quantity::Coordinate(h.1));
    angle.or_else(|| name.strip_prefix("qd_").and_then(hinge).map(|h| Quantity::Rate(h.2)))
}

fn known(model: &Model) -> String {
    let hinges = hinges(model).flat_map(|h| [format!("q_{}", h.0), format!("qd_{}", h.0)]);
    NAMES.iter().map(|n| n.0.to_owned()).chain(hinges).collect::<Vec<_>>().join(" ")
}
