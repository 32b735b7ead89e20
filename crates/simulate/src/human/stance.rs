//! Ground motion in task coordinates: centre of mass, pelvis, feet, upper joints.
//!
//! The plan has as many coordinates as the model ([`PLAN`] = 40) and determines it: legs follow in
//! closed form from pelvis and feet, and the pelvis is moved until the centre of mass is at its
//! planned position.

use super::leg::{Leg, LegPosture};
use super::person::{Person, THIGH};
use crate::motion::chart::read;
use crate::motion::{Chart, Jet};
use aloft_body::State;
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};

/// Number of plan coordinates.
pub const PLAN: usize = 40;
/// Centre of mass in the world.
pub const COM: usize = 0;
/// Rotation vector of the pelvis from upright.
pub const PELVIS: usize = 3;
/// Feet, right then left: ball on the sole in the world (3), rotation vector from flat on the floor
/// (3), swivel of the knee (1).
pub const FOOT: [usize; 2] = [6, 13];
/// Joints of torso, head and arms as in the chart.
pub const UPPER: usize = 20;
/// First chart coordinate of the upper joints; there are [`N_UPPER`].
pub const CHART_UPPER: usize = 6;
/// Number of upper coordinates.
pub const N_UPPER: usize = 20;
/// First chart coordinate of a leg, right and left; there are seven.
pub const CHART_LEG: [usize; 2] = [26, 33];

/// Step of the difference stencils, s.
const TAU: f64 = 5e-4;

/// The posture of a plan cannot be reached.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutOfReach;

/// Solver between plan and chart for one person with a given stance (toe-out of the flat feet).
pub struct Stance<'a> {
    person: &'a Person,
    /// The chart whose root reference is the upright pelvis.
    pub chart: Chart,
    /// Orientation of each flat foot in the world.
    pub flat: [UnitQuaternion<f64>; 2],
    legs: [Leg; 2],
    state: State,
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
}

/// Rotation that takes link axes (X anterior, Y up, Z right) to the world (X forward, Y left, Z
/// up).
pub fn upright() -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2)
}

impl<'a> Stance<'a> {
    /// `toe_out[side]` in rad, positive outwards.
    pub fn new(person: &'a Person, toe_out: [f64; 2]) -> Self {
        let model = &person.body.model;
        let leg = |side: usize| {
            let thigh = THIGH[side];
            Leg {
                hip: model.links[thigh].joint.parent_from_joint.translation.vector,
                knee: model.links[thigh + 1].joint.parent_from_joint,
                ankle: model.links[thigh + 2].joint.parent_from_joint.translation.vector,
            }
        };
        // about the vertical (link Y): the right foot turns out clockwise, which is negative
        let flat = |side: usize| {
            let turn = if side == 0 { -toe_out[0] } else { toe_out[1] };
            upright() * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), turn)
        };
        Self {
            person,
            chart: Chart { root_reference: upright() },
            flat: [flat(0), flat(1)],
            legs: [leg(0), leg(1)],
            state: State::new(model),
            q: model.neutral(),
            v: vec![0.0; model.nv],
            a: vec![0.0; model.nv],
        }
    }

    fn foot_pose(&self, plan: &[f64; PLAN], side: usize) -> Isometry3<f64> {
        let i = FOOT[side];
        let rotation = self.flat[side] * UnitQuaternion::from_scaled_axis(vector(plan, i + 3));
        Isometry3::from_parts((vector(plan, i) - rotation * self.person.ball_m[side]).into(), rotation)
    }

    /// Writes leg coordinates into a chart vector for a given root pose.
    fn place_legs(&self, plan: &[f64; PLAN], root: &Isometry3<f64>, chart: &mut [f64; PLAN]) -> Result<(), OutOfReach> {
        for side in 0..2 {
            let foot = self.foot_pose(plan, side);
            let posture = self.legs[side].solve(root, &foot, plan[FOOT[side] + 6]).ok_or(OutOfReach)?;
            let i = CHART_LEG[side];
            chart[i..i + 3].copy_from_slice(posture.hip.scaled_axis().as_slice());
            chart[i + 3] = posture.knee;
            chart[i + 4..i + 7].copy_from_slice(posture.ankle.scaled_axis().as_slice());
        }
        Ok(())
    }

    fn root(&self, chart: &[f64; PLAN]) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_scaled_axis(vector(chart, 3));
        Isometry3::from_parts(vector(chart, 0).into(), self.chart.root_reference * turn)
    }

    /// Centre of mass of a chart posture.
    pub fn com(&mut self, chart: &[f64; PLAN]) -> Vector3<f64> {
        let jets: [Jet; PLAN] = std::array::from_fn(|i| Jet::rest(chart[i]));
        let model = &self.person.body.model;
        self.chart.lift(model, &jets, &mut self.q, &mut self.v, &mut self.a);
        self.state.forward_position(model, &self.q);
        self.state.centre_of_mass(&self.person.body.phi).1
    }

    /// Places the legs under a given root and upper body: only the feet of `plan` are used.
    pub fn legs_under(&self, plan: &[f64; PLAN], chart: &mut [f64; PLAN]) -> Result<(), OutOfReach> {
        let root = self.root(chart);
        self.place_legs(plan, &root, chart)
    }

    /// The posture of a plan. `guess` is a root position to start from.
    pub fn solve(&mut self, plan: &[f64; PLAN], guess: &Vector3<f64>) -> Result<[f64; PLAN], OutOfReach> {
        let mut chart = [0.0; PLAN];
        chart[3..6].copy_from_slice(&plan[PELVIS..PELVIS + 3]);
        chart[CHART_UPPER..CHART_UPPER + N_UPPER].copy_from_slice(&plan[UPPER..UPPER + N_UPPER]);
        let want = vector(plan, COM);
        let mut at = |root: &Vector3<f64>, chart: &mut [f64; PLAN]| -> Result<Vector3<f64>, OutOfReach> {
            chart[..3].copy_from_slice(root.as_slice());
            let pose = self.root(chart);
            self.place_legs(plan, &pose, chart)?;
            Ok(want - self.com(chart))
        };
        let mut root = *guess;
        let mut first = at(&root, &mut chart);
        for _ in 0..12 {
            if first.is_ok() {
                break;
            }
            root.z -= 0.03;
            first = at(&root, &mut chart);
        }
        let mut error = first?;
        let mut inverse: Option<Matrix3<f64>> = None;
        for iteration in 0..40 {
            if error.norm() < 2e-15 * 100.0 {
                return Ok(chart);
            }
            // a new Jacobian at the start, and again when the steps stop converging
            let jacobian = match (inverse, iteration % 6) {
                (Some(j), k) if k != 0 => j,
                _ => {
                    let h = 1e-6;
                    let mut columns = [Vector3::zeros(); 3];
                    for (axis, column) in columns.iter_mut().enumerate() {
                        *column = (error - at(&(root + Vector3::ith(axis, h)), &mut chart)?) / h;
                    }
                    Matrix3::from_columns(&columns).try_inverse().ok_or(OutOfReach)?
                }
            };
            inverse = Some(jacobian);
            let mut step = jacobian * error;
            let limit = 0.1;
            if step.norm() > limit {
                step *= limit / step.norm();
            }
            // shorten steps that would overextend a leg
            let mut next = at(&(root + step), &mut chart);
            for _ in 0..6 {
                if next.is_ok() {
                    break;
                }
                step *= 0.5;
                next = at(&(root + step), &mut chart);
            }
            let found = next?;
            if found.norm() < 1e-12 && found.norm() >= 0.5 * error.norm() {
                return Ok(chart);
            }
            root += step;
            error = found;
        }
        Err(OutOfReach)
    }

    /// The plan coordinates of a posture: inverse of [`Stance::solve`].
    pub fn observe(&mut self, chart: &[f64; PLAN]) -> [f64; PLAN] {
        let mut plan = [0.0; PLAN];
        let com = self.com(chart);
        plan[..3].copy_from_slice(com.as_slice());
        plan[PELVIS..PELVIS + 3].copy_from_slice(&chart[3..6]);
        plan[UPPER..UPPER + N_UPPER].copy_from_slice(&chart[CHART_UPPER..CHART_UPPER + N_UPPER]);
        let model = &self.person.body.model;
        for side in 0..2 {
            let (thigh, i) = (THIGH[side], FOOT[side]);
            let foot = self.state.world_from_link[thigh + 2];
            let ball = foot.transform_point(&self.person.ball_m[side].into()).coords;
            plan[i..i + 3].copy_from_slice(ball.as_slice());
            let turn = (self.flat[side].inverse() * foot.rotation).scaled_axis();
            plan[i + 3..i + 6].copy_from_slice(turn.as_slice());
            let joint = |link: usize| model.links[link].joint.q_offset;
            let posture = LegPosture {
                hip: read(&self.q[joint(thigh)..joint(thigh) + 4]),
                knee: self.q[joint(thigh + 1)],
                ankle: read(&self.q[joint(thigh + 2)..joint(thigh + 2) + 4]),
            };
            plan[i + 6] = self.legs[side].swivel(&self.state.world_from_link[0], &posture);
        }
        plan
    }

    /// Chart jets of plan jets (fourth-order differences of [`Stance::solve`] along the plan).
    pub fn solve_jets(&mut self, plan: &[Jet; PLAN], guess: &Vector3<f64>) -> Result<[Jet; PLAN], OutOfReach> {
        let mut samples = [[0.0; PLAN]; 5];
        let mut guess = *guess;
        for (k, sample) in samples.iter_mut().enumerate() {
            *sample = self.solve(&taylor(plan, k), &guess)?;
            guess = vector(sample, 0);
        }
        Ok(stencil(&samples))
    }

    /// Plan jets of chart jets.
    pub fn observe_jets(&mut self, chart: &[Jet; PLAN]) -> [Jet; PLAN] {
        let samples: [[f64; PLAN]; 5] = std::array::from_fn(|k| self.observe(&taylor(chart, k)));
        stencil(&samples)
    }

    /// Leg coordinates, with derivatives, that keep the feet of `plan` in place under the moving
    /// root of `chart`; written into `chart`.
    pub fn leg_jets_under(&self, plan: &[Jet; PLAN], chart: &mut [Jet; PLAN]) -> Result<(), OutOfReach> {
        let mut samples = [[0.0; PLAN]; 5];
        for (k, sample) in samples.iter_mut().enumerate() {
            *sample = taylor(chart, k);
            self.legs_under(&taylor(plan, k), sample)?;
        }
        let legs = stencil(&samples);
        chart[CHART_LEG[0]..].copy_from_slice(&legs[CHART_LEG[0]..]);
        Ok(())
    }

    /// The stance's person.
    pub fn person(&self) -> &'a Person {
        self.person
    }
}

/// Three entries of a plan or chart as a vector.
pub fn vector(x: &[f64; PLAN], i: usize) -> Vector3<f64> {
    Vector3::new(x[i], x[i + 1], x[i + 2])
}

/// The `k`-th of five points around the jets (k = 2 is the middle).
fn taylor(jets: &[Jet; PLAN], k: usize) -> [f64; PLAN] {
    let t = (k as f64 - 2.0) * TAU;
    std::array::from_fn(|i| jets[i].x + t * (jets[i].v + 0.5 * t * jets[i].a))
}

fn stencil(s: &[[f64; PLAN]; 5]) -> [Jet; PLAN] {
    std::array::from_fn(|i| Jet {
        x: s[2][i],
        v: (8.0 * (s[3][i] - s[1][i]) - (s[4][i] - s[0][i])) / (12.0 * TAU),
        a: (16.0 * (s[3][i] + s[1][i]) - (s[4][i] + s[0][i]) - 30.0 * s[2][i]) / (12.0 * TAU * TAU),
    })
}
