//! Ground phase: a plan interpolated through a few knots, and the joint motion that follows from
//! it.

use super::person::Person;
use super::stance::{OutOfReach, PLAN, Stance, vector};
use crate::motion::curve::windowed_sine;
use crate::motion::{Chart, Jet, Piecewise, Spline};
use crate::physics::Drive;
use nalgebra::Vector3;

/// Spacing of the knots at which the legs are solved, s.
const KNOT_S: f64 = 0.01;

/// A plan over time: one curve for each coordinate, and slow sways on some of them.
#[derive(Debug, Clone, Default)]
pub struct PlanCurve {
    /// One curve for each plan coordinate.
    pub curves: Vec<Piecewise>,
    /// Sines on a coordinate: coordinate, amplitude, frequency (Hz), phase.
    pub sways: Vec<(usize, f64, f64, f64)>,
    /// Sines that start and end at rest: coordinate, start, duration, amplitude, frequency (Hz),
    /// phase.
    pub bumps: Vec<(usize, f64, f64, f64, f64, f64)>,
}

impl PlanCurve {
    /// A plan through postures, all coordinates at the same times.
    pub fn through(knots: &[(f64, [Jet; PLAN])]) -> Self {
        let curve = |i: usize| {
            let own: Vec<(f64, Jet)> = knots.iter().map(|(t, jets)| (*t, jets[i])).collect();
            Piecewise::through(&own)
        };
        Self { curves: (0..PLAN).map(curve).collect(), ..Self::default() }
    }

    /// The plan at time `t`.
    pub fn at(&self, t: f64) -> [Jet; PLAN] {
        let mut jets: [Jet; PLAN] = std::array::from_fn(|i| self.curves[i].at(t));
        for (i, amplitude, frequency, phase) in &self.sways {
            let rate = 2.0 * std::f64::consts::PI * frequency;
            let (sin, cos) = (rate * t + phase).sin_cos();
            jets[*i].x += amplitude * sin;
            jets[*i].v += amplitude * rate * cos;
            jets[*i].a -= amplitude * rate * rate * sin;
        }
        for (i, start, duration, amplitude, frequency, phase) in &self.bumps {
            let w = windowed_sine(t - start, *duration, *frequency, *phase);
            jets[*i].x += amplitude * w.x;
            jets[*i].v += amplitude * w.v;
            jets[*i].a += amplitude * w.a;
        }
        jets
    }
}

/// All coordinates on the ground: a spline through the postures computed from the plan.
#[derive(Debug, Clone)]
pub struct GroundMotion<'a> {
    person: &'a Person,
    chart: Chart,
    spline: Spline,
}

impl<'a> GroundMotion<'a> {
    /// Joint motion of `plan` between two times. `first` and `last` are the chart jets at the ends;
    /// if absent they are computed from the plan.
    pub fn new(
        stance: &mut Stance<'a>,
        plan: &PlanCurve,
        times: [f64; 2],
        first: Option<&[Jet; PLAN]>,
        last: Option<&[Jet; PLAN]>,
    ) -> Result<Self, OutOfReach> {
        let [t0, t1] = times;
        let pieces = (((t1 - t0) / KNOT_S).round() as usize).max(2);
        let step = (t1 - t0) / pieces as f64;
        let start = plan.at(t0);
        let com = Vector3::new(start[0].x, start[1].x, start[2].x);
        let mut guess = com - Vector3::new(0.0, 0.0, 0.05);
        let first = match first {
            Some(jets) => *jets,
            None => stance.solve_jets(&start, &guess)?,
        };
        let mut values = vec![0.0; (pieces + 1) * PLAN];
        let mut posture: [f64; PLAN] = std::array::from_fn(|i| first[i].x);
        for k in 0..=pieces {
            if k > 0 {
                guess = vector(&posture, 0);
                let jets = plan.at(t0 + k as f64 * step);
                posture = stance.solve(&std::array::from_fn(|i| jets[i].x), &guess)?;
            }
            values[k * PLAN..(k + 1) * PLAN].copy_from_slice(&posture);
        }
        let last = match last {
            Some(jets) => *jets,
            None => stance.solve_jets(&plan.at(t1), &vector(&posture, 0))?,
        };
        for (value, jet) in values[pieces * PLAN..].iter_mut().zip(&last) {
            *value = jet.x;
        }
        let spline = Spline::new(t0, step, PLAN, &values, &first, &last);
        Ok(Self { person: stance.person(), chart: stance.chart.clone(), spline })
    }
}

impl Drive for GroundMotion<'_> {
    fn prescribe(&self, t: f64, q: &mut [f64], v: &mut [f64], a: &mut [f64]) {
        let mut jets = [Jet::default(); PLAN];
        self.spline.at(t, &mut jets);
        self.chart.lift(&self.person.body.model, &jets, q, v, a);
    }
}
