//! In the air: joint motion from take-off to landing, and the drive that lets the root fall.

use super::person::Person;
use super::stance::PLAN;
use super::styles::Bump;
use crate::motion::{Chart, Jet, Quintic};
use crate::physics::Drive;

/// Joint motion of a flight. Velocities at the ends are braked within `brake_s`, the rest is one smooth change of posture
/// with the bumps of the style on it.
#[derive(Debug, Clone)]
pub struct AirMotion<'a> {
    person: &'a Person,
    chart: Chart,
    start_s: f64,
    duration_s: f64,
    curves: Vec<[Quintic; 3]>,
    brake_s: f64,
    bumps: Vec<Bump>,
}

/// Share of the distance `velocity · brake` that braking takes.
const BRAKING: f64 = 0.36;

impl<'a> AirMotion<'a> {
    /// From the jets at take-off to those at landing (chart; the root's six are not used).
    pub fn new(
        person: &'a Person,
        chart: Chart,
        start_s: f64,
        duration_s: f64,
        from: &[Jet; PLAN],
        to: &[Jet; PLAN],
        bumps: Vec<Bump>,
    ) -> Self {
        let brake_s = (0.26 * duration_s).clamp(0.05, 0.14);
        let curves = (6..PLAN)
            .map(|i| {
                let (a, b) = (from[i], to[i]);
                let first = BRAKING * a.v * brake_s;
                let last = BRAKING * b.v * brake_s;
                let start = Quintic::new(Jet { x: 0.0, ..a }, Jet::rest(first), brake_s);
                let end = Quintic::new(Jet::rest(-last), Jet { x: 0.0, ..b }, brake_s);
                [start, Quintic::new(Jet::rest(a.x + first), Jet::rest(b.x - last), duration_s), end]
            })
            .collect();
        Self { person, chart, start_s, duration_s, curves, brake_s, bumps }
    }

    /// Joint jets at time `t`; the root's six are left alone.
    pub fn at(&self, t: f64, jets: &mut [Jet; PLAN]) {
        let s = t - self.start_s;
        for (curves, jet) in self.curves.iter().zip(&mut jets[6..]) {
            let [start, change, end] = curves;
            *jet = change.at(s.clamp(0.0, self.duration_s));
            // the change is measured from the braked posture: what the brakes have not yet taken is added
            let full = start.at(self.brake_s).x;
            let first = if s < self.brake_s { start.at(s) } else { Jet::rest(full) };
            let late = s - (self.duration_s - self.brake_s);
            let rest = end.at(0.0).x;
            let last = if late > 0.0 { end.at(late) } else { Jet::rest(rest) };
            jet.x += first.x - full + last.x - rest;
            jet.v += first.v + last.v;
            jet.a += first.a + last.a;
        }
        for bump in &self.bumps {
            bump.add(s, self.duration_s, &mut jets[bump.coordinate]);
        }
    }
}

impl Drive for AirMotion<'_> {
    fn prescribe(&self, t: f64, q: &mut [f64], v: &mut [f64], a: &mut [f64]) {
        let mut jets = [Jet::default(); PLAN];
        self.at(t, &mut jets);
        let model = &self.person.body.model;
        for link in 1..model.n_links() {
            self.chart.lift_link(model, link, &jets, q, v, a);
        }
    }
}
