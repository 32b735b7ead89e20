//! Flight phase: joint motion from take-off to landing, and the drive that leaves the root in free
//! fall.

use super::person::Person;
use super::stance::PLAN;
use super::styles::Bump;
use crate::motion::{Chart, Jet, Quintic};
use crate::physics::Drive;

/// Joint motion of a flight. Velocities at the ends are braked within an eighth of a second; in
/// between there is one smooth change of posture with the bumps of the style added.
#[derive(Debug, Clone)]
pub struct AirMotion<'a> {
    person: &'a Person,
    chart: Chart,
    start_s: f64,
    duration_s: f64,
    curves: Vec<[Quintic; 3]>,
    bumps: Vec<Bump>,
}

/// Chart coordinates of the knees.
const KNEES: [usize; 2] = [29, 36];
/// Flexion at which a braked knee should stop, rad.
const STRAIGHT_RAD: f64 = 0.10;
/// Distance covered while braking, as a share of `velocity · brake`.
const BRAKING: f64 = 0.36;

impl<'a> AirMotion<'a> {
    /// From the jets at take-off to those at landing (in the chart; the six root coordinates are
    /// not used).
    pub fn new(
        person: &'a Person,
        chart: Chart,
        start_s: f64,
        duration_s: f64,
        from: &[Jet; PLAN],
        to: &[Jet; PLAN],
        bumps: Vec<Bump>,
        tick_s: f64,
    ) -> Self {
        // pieces join at ticks: a kink in the jerk inside an integration step would cost two orders
        // of accuracy
        let snap = |t: f64| (t / tick_s).round().max(1.0) * tick_s;
        let usual_s = snap((0.26 * duration_s).clamp(0.05, 0.14));
        let brake = |i: usize, jet: &Jet| {
            if KNEES.contains(&i) {
                // a knee is braked before it is fully extended
                let room = (-jet.x - STRAIGHT_RAD).max(0.0) / (BRAKING * jet.v.abs()).max(1e-6);
                snap(room.clamp(0.045, usual_s))
            } else {
                usual_s
            }
        };
        let curves = (6..PLAN)
            .map(|i| {
                let (a, b) = (from[i], to[i]);
                let (t0, t1) = (brake(i, &a), brake(i, &b));
                let first = BRAKING * a.v * t0;
                let last = BRAKING * b.v * t1;
                let start = Quintic::new(Jet { x: 0.0, ..a }, Jet::rest(first), t0);
                let end = Quintic::new(Jet::rest(-last), Jet { x: 0.0, ..b }, t1);
                [start, Quintic::new(Jet::rest(a.x + first), Jet::rest(b.x - last), duration_s), end]
            })
            .collect();
        Self { person, chart, start_s, duration_s, curves, bumps }
    }

    /// Joint jets at time `t`; the six root coordinates are unchanged.
    pub fn at(&self, t: f64, jets: &mut [Jet; PLAN]) {
        let s = t - self.start_s;
        for (curves, jet) in self.curves.iter().zip(&mut jets[6..]) {
            let [start, change, end] = curves;
            *jet = change.at(s.clamp(0.0, self.duration_s));
            // the change is measured from the braked posture: the part not yet braked is added
            let full = start.at(start.duration()).x;
            let first = if s < start.duration() { start.at(s) } else { Jet::rest(full) };
            let late = s - (self.duration_s - end.duration());
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
