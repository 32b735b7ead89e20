//! Force laws of the hidden effects: wrenches on links from poses, velocities and time.
//!
//! Written from the physics of each effect and independent of any estimator's columns.

use crate::error::SimulateError;
use crate::hidden::Hidden;
use crate::physics::law::{FormulaLaw, Instant, Past};
use crate::physics::plant::Body;
use aloft_body::{Model, Phi, State};
use nalgebra::Vector3;

/// Force and moment about the world origin, world axes.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Wrench {
    /// Force, N.
    pub force_n: Vector3<f64>,
    /// Moment, N·m.
    pub moment_nm: Vector3<f64>,
}

impl Wrench {
    /// Adds a force acting at a point in the world.
    pub fn push(&mut self, force: &Vector3<f64>, at: &Vector3<f64>) {
        self.force_n += force;
        self.moment_nm += at.cross(force);
    }

    /// Adds another wrench.
    pub fn add(&mut self, other: &Self) {
        self.force_n += other.force_n;
        self.moment_nm += other.moment_nm;
    }
}

#[derive(Debug, Clone)]
enum Law {
    /// −(k₁ + k₂|u|) u at the point, u relative to the air.
    Air {
        link: usize,
        point: Vector3<f64>,
        linear: f64,
        quadratic: f64,
        air: Vector3<f64>,
    },
    SpinDamping {
        coefficient: f64,
    },
    World {
        link: usize,
        point: Vector3<f64>,
        force: Vector3<f64>,
    },
    Link {
        link: usize,
        point: Vector3<f64>,
        force: Vector3<f64>,
        period: f64,
        on: f64,
    },
    Tether {
        link: usize,
        point: Vector3<f64>,
        anchor: Vector3<f64>,
        rest: f64,
        stiffness: f64,
        damping: f64,
    },
    Crane {
        link: usize,
        point: Vector3<f64>,
        pulley: Vector3<f64>,
        tension: f64,
    },
    Wheel {
        link: usize,
        momentum: Vector3<f64>,
        swing: Vector3<f64>,
        rate: f64,
    },
    Wobble {
        link: usize,
        point: Vector3<f64>,
        mass: f64,
        stiffness: f64,
        damping: f64,
        slot: usize,
    },
    /// A plate: −k |u·n| (u·n) n at the point, u relative to the air.
    Panel {
        link: usize,
        point: Vector3<f64>,
        normal: Vector3<f64>,
        coefficient: f64,
        air: Vector3<f64>,
    },
    Formula(Box<FormulaLaw>),
}

/// All hidden forces on one body. Each wobbling mass adds six states: position and velocity in the
/// world.
#[derive(Debug, Clone, Default)]
pub struct ForceField {
    laws: Vec<Law>,
    n_states: usize,
    /// Inertias of the plant, whose centre of mass the laws on the whole body follow.
    phi: Vec<Phi>,
    n_delayed: usize,
    longest_delay_s: f64,
}

impl ForceField {
    /// Collects the hidden effects that are forces; `model` has the true gravity, `phi` the
    /// inertias with those of the hidden effects.
    pub fn new(body: &Body, model: &Model, phi: &[Phi], hidden: &[Hidden]) -> Result<Self, SimulateError> {
        let mut field = Self { phi: phi.to_vec(), ..Self::default() };
        let total_area: f64 = body.area_m2.iter().sum();
        let mut air = |linear: f64, quadratic: f64, air: Vector3<f64>| {
            for (link, (area, phi)) in body.area_m2.iter().zip(&body.phi).enumerate() {
                let share = area / total_area;
                let point = Vector3::new(phi[1], phi[2], phi[3]) / phi[0];
                field.laws.push(Law::Air { link, point, linear: linear * share, quadratic: quadratic * share, air });
            }
        };
        for effect in hidden {
            match effect {
                Hidden::QuadraticDrag { drag_area_m2, air_density_kgpm3 } => {
                    air(0.0, 0.5 * air_density_kgpm3 * drag_area_m2, Vector3::zeros());
                }
                Hidden::LinearDrag { coefficient_nspm } => air(*coefficient_nspm, 0.0, Vector3::zeros()),
                Hidden::Wind { velocity_mps, drag_area_m2, air_density_kgpm3 } => {
                    air(0.0, 0.5 * air_density_kgpm3 * drag_area_m2, Vector3::from(*velocity_mps));
                }
                _ => {}
            }
        }
        for (index, effect) in hidden.iter().enumerate() {
            let link = match effect.link() {
                Some(name) => model.link_index(name)?,
                None => 0,
            };
            match effect {
                Hidden::RotationalDrag { coefficient_nmsprad } => {
                    field.laws.push(Law::SpinDamping { coefficient: *coefficient_nmsprad });
                }
                Hidden::ConstantForce { point_m, force_n, .. } => {
                    field.laws.push(Law::World { link, point: (*point_m).into(), force: (*force_n).into() });
                }
                Hidden::AddedMass { point_m, mass_kg, .. } => {
                    // the plant contains the mass as inertia; here its weight is removed
                    let force = -model.gravity_mps2 * *mass_kg;
                    field.laws.push(Law::World { link, point: (*point_m).into(), force });
                }
                Hidden::Tether { point_m, anchor_m, rest_length_m, stiffness_npm, damping_nspm, .. } => {
                    field.laws.push(Law::Tether {
                        link,
                        point: (*point_m).into(),
                        anchor: (*anchor_m).into(),
                        rest: *rest_length_m,
                        stiffness: *stiffness_npm,
                        damping: *damping_nspm,
                    });
                }
                Hidden::Crane { point_m, pulley_m, tension_n, .. } => {
                    field.laws.push(Law::Crane {
                        link,
                        point: (*point_m).into(),
                        pulley: (*pulley_m).into(),
                        tension: *tension_n,
                    });
                }
                Hidden::Flywheel { momentum_nms, .. } => {
                    let momentum = (*momentum_nms).into();
                    field.laws.push(Law::Wheel { link, momentum, swing: Vector3::zeros(), rate: 0.0 });
                }
                Hidden::Rotor { axis, mean_nms, swing_nms, frequency_hz, .. } => {
                    let axis = Vector3::from(*axis).normalize();
                    field.laws.push(Law::Wheel {
                        link,
                        momentum: axis * *mean_nms,
                        swing: axis * *swing_nms,
                        rate: 2.0 * std::f64::consts::PI * frequency_hz,
                    });
                }
                Hidden::Thrust { point_m, force_n, period_s, on_s, .. } => {
                    field.laws.push(Law::Link {
                        link,
                        point: (*point_m).into(),
                        force: (*force_n).into(),
                        period: *period_s,
                        on: *on_s,
                    });
                }
                Hidden::WobblingMass { point_m, mass_kg, frequency_hz, damping_ratio, .. } => {
                    let rate = 2.0 * std::f64::consts::PI * frequency_hz;
                    field.laws.push(Law::Wobble {
                        link,
                        point: (*point_m).into(),
                        mass: *mass_kg,
                        stiffness: mass_kg * rate * rate,
                        damping: 2.0 * damping_ratio * mass_kg * rate,
                        slot: field.n_states,
                    });
                    field.n_states += 6;
                }
                Hidden::Panels { plates, wind_mps, air_density_kgpm3, normal_coefficient } => {
                    for plate in plates {
                        let link = model.link_index(&plate.link)?;
                        let phi = &body.phi[link];
                        let com = Vector3::new(phi[1], phi[2], phi[3]) / phi[0];
                        field.laws.push(Law::Panel {
                            link,
                            point: plate.point_m.map_or(com, Vector3::from),
                            normal: Vector3::from(plate.normal).normalize(),
                            coefficient: 0.5 * air_density_kgpm3 * normal_coefficient * plate.area_m2,
                            air: (*wind_mps).into(),
                        });
                    }
                }
                Hidden::Law { .. } => {
                    if let Some(law) = FormulaLaw::new(model, effect, index, field.n_delayed, &model.name)? {
                        if let Some(delay_s) = law.delay_s() {
                            field.n_delayed += 1;
                            field.longest_delay_s = field.longest_delay_s.max(delay_s);
                        }
                        field.laws.push(Law::Formula(Box::new(law)));
                    }
                }
                _ => {}
            }
        }
        Ok(field)
    }

    /// True if no force acts.
    pub fn is_empty(&self) -> bool {
        self.laws.is_empty()
    }

    /// Number of states of the laws.
    pub fn n_states(&self) -> usize {
        self.n_states
    }

    /// States of wobbling masses at static equilibrium, displaced by gravity. Needs poses and
    /// velocities.
    pub fn rest_states(&self, model: &Model, state: &State, out: &mut [f64]) {
        for law in &self.laws {
            if let Law::Wobble { link, point, mass, stiffness, slot, .. } = law {
                let place = state.point_in_world(*link, point) + model.gravity_mps2 * (mass / stiffness);
                out[*slot..slot + 3].copy_from_slice(place.as_slice());
                out[slot + 3..slot + 6].copy_from_slice(state.point_velocity_in_world(*link, point).as_slice());
            }
        }
    }

    /// Inertias of the plant.
    pub fn phi(&self) -> &[Phi] {
        &self.phi
    }

    /// Stores the step at `now` for the delayed laws; nothing to do without any.
    ///
    /// # Errors
    /// [`SimulateError::Undefined`] where a formula has no finite value.
    pub fn remember(&self, now: &Instant<'_>, past: &mut Past) -> Result<(), SimulateError> {
        if self.n_delayed == 0 {
            return Ok(());
        }
        let mut values = Vec::with_capacity(self.n_delayed);
        for law in &self.laws {
            if let Law::Formula(law) = law
                && law.delay_s().is_some()
            {
                values.push(law.components(now)?);
            }
        }
        past.push(now.t, values, self.longest_delay_s);
        Ok(())
    }

    /// True if a law is delayed.
    pub fn is_delayed(&self) -> bool {
        self.n_delayed > 0
    }

    /// Wrenches on the links at an instant (overwritten, one per link), and rates of the laws'
    /// states.
    ///
    /// # Errors
    /// [`SimulateError::Undefined`] where a formula has no finite value.
    pub fn evaluate(
        &self,
        now: &Instant<'_>,
        past: &Past,
        states: &[f64],
        wrenches: &mut [Wrench],
        rates: &mut [f64],
    ) -> Result<(), SimulateError> {
        let (t, model, state) = (now.t, now.model, now.state);
        wrenches.fill(Wrench::default());
        for law in &self.laws {
            match law {
                Law::Air { link, point, linear, quadratic, air } => {
                    let u = state.point_velocity_in_world(*link, point) - air;
                    wrenches[*link].push(&(-u * (linear + quadratic * u.norm())), &state.point_in_world(*link, point));
                }
                Law::SpinDamping { coefficient } => {
                    for (link, wrench) in wrenches.iter_mut().enumerate() {
                        wrench.moment_nm -= omega(state, link) * *coefficient;
                    }
                }
                Law::World { link, point, force } => {
                    wrenches[*link].push(force, &state.point_in_world(*link, point));
                }
                Law::Link { link, point, force, period, on } => {
                    if *period <= 0.0 || t.rem_euclid(*period) < *on {
                        let force = state.world_from_link[*link].rotation * force;
                        wrenches[*link].push(&force, &state.point_in_world(*link, point));
                    }
                }
                Law::Tether { link, point, anchor, rest, stiffness, damping } => {
                    let at = state.point_in_world(*link, point);
                    let line = anchor - at;
                    let length = line.norm();
                    if length > *rest && length > 1e-9 {
                        let along = line / length;
                        let stretch_rate = -along.dot(&state.point_velocity_in_world(*link, point));
                        let tension = (stiffness * (length - rest) + damping * stretch_rate).max(0.0);
                        wrenches[*link].push(&(along * tension), &at);
                    }
                }
                Law::Crane { link, point, pulley, tension } => {
                    let at = state.point_in_world(*link, point);
                    let line = pulley - at;
                    wrenches[*link].push(&(line * (tension / line.norm().max(1e-9))), &at);
                }
                Law::Wheel { link, momentum, swing, rate } => {
                    let (sin, cos) = (rate * t).sin_cos();
                    let rotation = state.world_from_link[*link].rotation;
                    let spin = rotation * (momentum + swing * sin);
                    // the wheel receives d/dt (R h) = ω × R h + R ḣ; the link receives the opposite
                    // moment
                    wrenches[*link].moment_nm -= omega(state, *link).cross(&spin) + rotation * (swing * (rate * cos));
                }
                Law::Wobble { link, point, mass, stiffness, damping, slot } => {
                    let read = |i: usize| Vector3::new(states[i], states[i + 1], states[i + 2]);
                    let (place, velocity) = (read(*slot), read(slot + 3));
                    let offset = place - state.point_in_world(*link, point);
                    // velocity of the mass relative to the rotating link
                    let slip =
                        velocity - state.point_velocity_in_world(*link, point) - omega(state, *link).cross(&offset);
                    let pull = offset * *stiffness + slip * *damping;
                    // the reaction acts at the position of the mass, so that no internal moment
                    // remains
                    wrenches[*link].push(&pull, &place);
                    let accel = model.gravity_mps2 - pull / *mass;
                    rates[*slot..slot + 3].copy_from_slice(velocity.as_slice());
                    rates[slot + 3..slot + 6].copy_from_slice(accel.as_slice());
                }
                Law::Panel { link, point, normal, coefficient, air } => {
                    let normal = state.world_from_link[*link].rotation * normal;
                    let u = (state.point_velocity_in_world(*link, point) - air).dot(&normal);
                    wrenches[*link].push(&(normal * (-coefficient * u.abs() * u)), &state.point_in_world(*link, point));
                }
                Law::Formula(law) => law.add(now, past, wrenches)?,
            }
        }
        Ok(())
    }

    /// Total wrench of the hidden forces on the body, including the weight-free share of wobbling
    /// masses: the wrench missing from a rigid model.
    pub fn total(wrenches: &[Wrench]) -> Wrench {
        let mut sum = Wrench::default();
        for wrench in wrenches {
            sum.add(wrench);
        }
        sum
    }
}

/// Angular velocity of a link in the world.
pub(crate) fn omega(state: &State, link: usize) -> Vector3<f64> {
    let v = &state.velocity[link];
    state.world_from_link[link].rotation * Vector3::new(v[3], v[4], v[5])
}
