//! A jump trial: stand, dip, push off, fly, land, and repeat. On the ground the motion follows the
//! plan, in the air conservation of momentum; take-off is adjusted so that the body lands over its
//! feet.

use super::air::AirMotion;
use super::ground::{GroundMotion, PlanCurve};
use super::posture::{Footing, Moment, Stumble, lowered, rest, upper};
use super::stance::{COM, FOOT, N_UPPER, PELVIS, PLAN, Stance, UPPER};
use super::styles::{Bump, STYLES, Style, bumps};
use crate::error::SimulateError;
use crate::motion::{Jet, Piecewise, Quintic};
use crate::physics::rk4::Rk4;
use crate::physics::{Drive, ForwardDynamics, Plant, Player, TrueMotion};
use crate::random::Stream;
use crate::scenario::JumpProtocol;
use aloft_body::State;
use nalgebra::Vector3;

/// A jump trial and the styles of its flights.
#[derive(Debug, Clone)]
pub struct JumpTrial {
    /// True motion.
    pub motion: TrueMotion,
    /// Style of each flight.
    pub styles: Vec<&'static str>,
}

struct Jumper<'a, 'b> {
    plant: &'a Plant,
    stance: Stance<'b>,
    g: f64,
    tick_s: f64,
}

/// Plans of one flight, found by adjusting take-off.
struct Aimed<'b> {
    take_off: [Jet; PLAN],
    air: AirMotion<'b>,
}

impl<'b> Jumper<'_, 'b> {
    /// Duration and acceleration at the lowest point of a push between rest and a free end: the
    /// smallest peak for which the ground never has to pull. Time-reversed for landings.
    fn push(&self, height: f64, speed: f64, bottom: Option<f64>) -> Option<(f64, f64)> {
        let mut best: Option<(f64, f64, f64)> = None;
        let candidates: Vec<f64> = match bottom {
            Some(a) => vec![a],
            None => (0..=12).map(|k| 2.0 + 1.5 * k as f64).collect(),
        };
        for a in candidates {
            for k in 0..60 {
                let time = 0.14 + 0.006 * k as f64;
                let end = Jet { x: height, v: speed, a: -self.g };
                let curve = Quintic::new(Jet { x: 0.0, v: 0.0, a }, end, time);
                let (mut low, mut high, mut back) = (f64::INFINITY, 0.0f64, false);
                for i in 0..40 {
                    let jet = curve.at(time * i as f64 / 40.0);
                    low = low.min(jet.a + self.g * (1.0 - 0.02 * (40 - i) as f64).max(0.0));
                    high = high.max(jet.a);
                    back |= jet.v < -1e-9;
                }
                if low > 0.0 && !back && best.is_none_or(|b| high < b.2) {
                    best = Some((time, a, high));
                }
            }
        }
        best.map(|b| (b.0, b.1))
    }

    /// Accelerations of the root in free fall under chart jets; the root's acceleration in `jets`
    /// is replaced.
    fn fall(&self, air: &dyn Drive, t: f64, jets: &mut [Jet; PLAN]) -> Result<(), SimulateError> {
        let model = &self.plant.model;
        let (y, mut a) = self.state_of(jets);
        let mut dynamics = ForwardDynamics::new(self.plant, &root_only(model.n_links()));
        a.copy_from_slice(dynamics.accelerations(air, t, &y)?.0);
        let mut out = [Jet::default(); PLAN];
        self.stance.chart.lower(model, &y[..model.nq], &y[model.nq..model.nq + model.nv], &a, &mut out);
        jets[..6].copy_from_slice(&out[..6]);
        Ok(())
    }

    fn state_of(&self, jets: &[Jet; PLAN]) -> (Vec<f64>, Vec<f64>) {
        let model = &self.plant.model;
        let mut y = vec![0.0; model.nq + model.nv + self.plant.forces.n_states()];
        let mut a = vec![0.0; model.nv];
        let (q, rest) = y.split_at_mut(model.nq);
        let (v, states) = rest.split_at_mut(model.nv);
        self.stance.chart.lift(model, jets, q, v, &mut a);
        let mut state = State::new(model);
        state.forward_velocity(model, q, v);
        self.plant.forces.rest_states(model, &state, states);
        (y, a)
    }

    /// Integrates the flight from `start` under `air`; returns the chart jets at its end.
    fn fly(
        &self,
        air: &AirMotion<'b>,
        t0: f64,
        duration: f64,
        start: &[Jet; PLAN],
    ) -> Result<[Jet; PLAN], SimulateError> {
        let model = &self.plant.model;
        let (mut y, _) = self.state_of(start);
        let mut dynamics = ForwardDynamics::new(self.plant, &root_only(model.n_links()));
        dynamics.take_off_s = Some(t0);
        dynamics.remember(air, t0, &y)?;
        let mut rk4 = Rk4::new(y.len());
        let steps = (duration / 2.5e-3).ceil() as usize;
        let h = duration / steps as f64;
        for k in 0..steps {
            let t = t0 + k as f64 * h;
            rk4.step(t, h, &mut y, |t, y, dy| dynamics.rate(air, t, y, dy))?;
            dynamics.settle(air, t + h, &mut y);
            dynamics.remember(air, t + h, &y)?;
        }
        dynamics.accelerations(air, t0 + duration, &y)?;
        let (q, v, a) = dynamics.motion();
        let mut jets = [Jet::default(); PLAN];
        self.stance.chart.lower(model, q, v, a, &mut jets);
        Ok(jets)
    }

    /// Adjusts the velocities at take-off until the body lands at the target with the feet under
    /// it.
    fn aim(
        &mut self,
        t0: f64,
        duration: f64,
        mut take_off: [Jet; PLAN],
        landing: &[Jet; PLAN],
        style: &[Bump],
    ) -> Result<Aimed<'b>, Stumble> {
        let person = self.stance.person();
        let guess = Vector3::new(take_off[0].x, take_off[1].x, take_off[2].x - 0.03);
        let mut end = self.stance.solve_jets(landing, &guess).map_err(Stumble::reach("around landing"))?;
        let mut best: Option<(f64, Aimed<'b>)> = None;
        for _ in 0..14 {
            let mut start = self.stance.solve_jets(&take_off, &guess).map_err(Stumble::reach("around take-off"))?;
            let chart = self.stance.chart.clone();
            let air = AirMotion::new(person, chart, t0, duration, &start, &end, style.to_vec(), self.tick_s);
            self.fall(&air, t0, &mut start)?;
            // the ground's moment vanishes with its force, so the pelvis leaves the ground with the
            // acceleration of free fall
            for i in 0..3 {
                take_off[PELVIS + i].a += 0.7 * (start[3 + i].a - take_off[PELVIS + i].a);
            }
            let arrived = self.fly(&air, t0, duration, &start)?;
            let posture: [f64; PLAN] = std::array::from_fn(|i| arrived[i].x);
            let com = self.stance.com(&posture);
            let miss = Vector3::from_fn(|i, _| landing[COM + i].x - com[i]);
            let lean = Vector3::from_fn(|i, _| landing[PELVIS + i].x - arrived[3 + i].x);
            let mut next = arrived;
            let reach = self.stance.leg_jets_under(landing, &mut next);
            let mut error = miss.norm() + 0.3 * lean.norm();
            if reach.is_ok() {
                for i in 26..PLAN {
                    error += 0.05 * (next[i].x - end[i].x).abs() + 0.002 * (next[i].v - end[i].v).abs();
                }
                end[26..].copy_from_slice(&next[26..]);
            } else {
                error += 1.0;
            }
            if best.as_ref().is_none_or(|b| error < b.0) {
                best = Some((error, Aimed { take_off, air }));
            }
            if error < 2e-4 {
                break;
            }
            for i in 0..3 {
                take_off[COM + i].v += 0.95 * miss[i] / duration;
                take_off[PELVIS + i].v += 0.8 * lean[i] / duration;
            }
        }
        match best {
            Some((error, aimed)) if error < 0.03 => Ok(aimed),
            Some((error, _)) => Err(Stumble::Infeasible(format!("the landing was missed by {error:.3} m"))),
            None => Err(Stumble::Infeasible("no flight".to_owned())),
        }
    }
}

/// Gives trunk and arms an upward velocity at the lowest point: braking them late would tip the
/// body over its toes.
fn unfold(crouch: &mut [Jet; PLAN]) {
    crouch[PELVIS + 2].v = 1.0;
    crouch[UPPER + 2].v = 0.6;
    for arm in [UPPER + 8, UPPER + 15] {
        crouch[arm].v = 4.0;
    }
}

fn root_only(n: usize) -> Vec<bool> {
    (0..n).map(|i| i == 0).collect()
}

/// Simulates one jump trial. `tick_s` is the sampling interval of the fastest instrument.
pub fn jump_trial(
    person: &super::Person,
    plant: &Plant,
    protocol: &JumpProtocol,
    tick_s: f64,
    rng: &mut Stream,
) -> Result<JumpTrial, Stumble> {
    let h = person.height_m;
    let mut footing = Footing::comfortable(h, rng);
    let g = plant.model.gravity_mps2.norm();
    let mut jumper = Jumper { plant, stance: Stance::new(person, footing.toe_out), g, tick_s };
    let snap = |t: f64| (t / tick_s).round() * tick_s;
    let ticks = |a: f64, b: f64| ((b - a) / tick_s).round() as usize;
    let n_links = plant.model.n_links();
    let held = vec![false; n_links];
    let flights = rng.whole(protocol.flights[0].max(1), protocol.flights[1].max(1));
    let vigour = protocol.vigour;

    // initial standing phase
    let lean = |rng: &mut Stream, pitch: f64, sd: f64| {
        Vector3::new(0.5 * sd * rng.moderate(), 0.8 * sd * rng.moderate(), -pitch + sd * rng.moderate())
    };
    let pelvis = lean(rng, 0.05, 0.03);
    let first =
        lowered(&mut jumper.stance, &footing, pelvis, &upper(Moment::Stand, vigour, rng), 0.0, rng.between(0.25, 0.4))
            .map_err(Stumble::reach("in stance"))?;
    let pelvis = lean(rng, 0.05, 0.03);
    let second =
        lowered(&mut jumper.stance, &footing, pelvis, &upper(Moment::Stand, vigour, rng), 0.0, rng.between(0.25, 0.4))
            .map_err(Stumble::reach("in stance"))?;
    let stand_s = snap(rng.between(0.45, 0.65));
    let dip_s = snap(rng.between(0.45, 0.55));
    let mut knots = vec![(0.0, rest(&first)), (stand_s, rest(&second))];
    let mut player: Option<Player<'_>> = None;
    let mut landed: Option<[Jet; PLAN]> = None;
    let mut styles = Vec::new();
    let mut last_style = None;

    for _ in 0..flights {
        let duration = snap(rng.between(protocol.flight_s[0], protocol.flight_s[1]));
        let style = draw_style(&mut last_style, rng);
        styles.push(style.name());
        let shape = bumps(style, vigour, rng);

        // take-off and landing as planned; the velocities at take-off are adjusted later
        let pelvis = lean(rng, 0.10, 0.04);
        let pitch = rng.between(0.52, 0.62);
        let arms = upper(Moment::TakeOff, vigour, rng);
        let plan = lowered(&mut jumper.stance, &footing, pelvis, &arms, pitch, rng.between(0.62, 0.72))
            .map_err(Stumble::reach("before take-off"))?;
        let mut take_off = rest(&plan);
        for i in 0..N_UPPER {
            take_off[UPPER + i].v = arms[i].v;
        }
        for side in 0..2 {
            take_off[FOOT[side] + 5].v = -rng.between(4.0, 5.0);
        }
        let mut down = footing;
        for ball in &mut down.ball {
            ball.x += -0.3 * ball.x + 0.02 + 0.015 * rng.moderate();
            ball.y += 0.010 * rng.moderate();
        }
        let pelvis = lean(rng, 0.15, 0.07);
        let arms = upper(Moment::Landing, vigour, rng);
        let plan = lowered(&mut jumper.stance, &down, pelvis, &arms, rng.between(0.35, 0.45), rng.between(0.72, 0.82))
            .map_err(Stumble::reach("at landing"))?;
        let mut landing = rest(&plan);
        for i in 0..N_UPPER {
            landing[UPPER + i].v = arms[i].v;
        }
        for side in 0..2 {
            landing[FOOT[side] + 4].x = 0.04 * rng.moderate();
            landing[FOOT[side] + 5].v = rng.between(3.5, 4.5);
        }
        let g = jumper.plant.model.gravity_mps2;
        for i in 0..3 {
            let v = (landing[COM + i].x - take_off[COM + i].x) / duration - 0.5 * g[i] * duration;
            take_off[COM + i] = Jet { v, a: g[i], ..take_off[COM + i] };
            landing[COM + i].v = v + g[i] * duration;
            landing[COM + i].a = g[i];
        }

        // timing: the push that reaches the required speed, and the braking of the landing
        let pelvis = lean(rng, 0.38, 0.05);
        let crouch = lowered(
            &mut jumper.stance,
            &footing,
            pelvis,
            &upper(Moment::Crouch, vigour, rng),
            0.0,
            rng.between(1.85, 2.05),
        )
        .map_err(Stumble::reach("in the crouch"))?;
        let rise = take_off[COM + 2].x - crouch[COM + 2];
        let speed = take_off[COM + 2].v;
        let (push_s, bottom) = jumper
            .push(rise, speed, None)
            .ok_or_else(|| Stumble::Infeasible(format!("no push over {rise:.2} m to {speed:.2} m/s")))?;
        let push_s = snap(push_s);
        let (t_bottom, contact_start) = match &landed {
            None => (stand_s + dip_s, 0.0),
            Some(jets) => {
                let now = player.as_ref().map_or(0.0, Player::time);
                let fall = jets[COM + 2].x - crouch[COM + 2];
                let (time, _) = jumper
                    .push(fall, -jets[COM + 2].v, Some(bottom))
                    .ok_or_else(|| Stumble::Infeasible(format!("no landing within {fall:.2} m")))?;
                (now + snap(time), now)
            }
        };
        let t_off = t_bottom + push_s;
        let aimed = jumper.aim(t_off, duration, take_off, &landing, &shape)?;
        let mut crouch = rest(&crouch);
        crouch[COM + 2].a = bottom;
        unfold(&mut crouch);
        knots.push((t_bottom, crouch));
        knots.push((t_off, aimed.take_off));
        let mut plan = PlanCurve::through(&knots);
        feet(&mut plan, &footing, landed.as_ref().map(|jets| (contact_start, jets)), Some((t_off, &aimed.take_off)));

        let mut chart_off = jumper
            .stance
            .solve_jets(&aimed.take_off, &Vector3::new(0.0, 0.0, 0.5 * h))
            .map_err(Stumble::reach("at take-off"))?;
        jumper.fall(&aimed.air, t_off, &mut chart_off)?;
        let start = player.as_ref().map(|p| chart_now(&jumper, p));
        let ground =
            GroundMotion::new(&mut jumper.stance, &plan, [contact_start, t_off], start.as_ref(), Some(&chart_off))
                .map_err(Stumble::reach("on the ground"))?;
        let mut p = match player.take() {
            Some(p) => p,
            None => {
                let (mut q, mut v, mut a) =
                    (plant.model.neutral(), vec![0.0; plant.model.nv], vec![0.0; plant.model.nv]);
                ground.prescribe(0.0, &mut q, &mut v, &mut a);
                Player::new(plant, tick_s, &q)
            }
        };
        p.advance(ticks(contact_start, t_off), &held, &ground)?;
        p.advance(ticks(0.0, duration), &root_only(n_links), &aimed.air)?;

        // the next contact starts from the state in which the flight actually ends
        let chart = chart_now(&jumper, &p);
        let jets = jumper.stance.observe_jets(&chart);
        for side in 0..2 {
            let i = FOOT[side];
            footing.ball[side] = Vector3::new(jets[i].x, jets[i + 1].x, 0.0);
        }
        knots = vec![(p.time(), jets)];
        landed = Some(jets);
        player = Some(p);
    }

    let (Some(mut p), Some(jets)) = (player, landed) else {
        return Err(Stumble::Infeasible("no flight was asked for".to_owned()));
    };
    // last landing, then standing up
    let now = p.time();
    let pelvis = lean(rng, 0.38, 0.05);
    let crouch =
        lowered(&mut jumper.stance, &footing, pelvis, &upper(Moment::Crouch, vigour, rng), 0.0, rng.between(1.75, 2.0))
            .map_err(Stumble::reach("in the last crouch"))?;
    let fall = jets[COM + 2].x - crouch[COM + 2];
    let (time, bottom) = jumper
        .push(fall, -jets[COM + 2].v, Some(4.5))
        .ok_or_else(|| Stumble::Infeasible(format!("no landing within {fall:.2} m")))?;
    let mut low = rest(&crouch);
    low[COM + 2].a = bottom;
    let pelvis = lean(rng, 0.05, 0.03);
    let stand =
        lowered(&mut jumper.stance, &footing, pelvis, &upper(Moment::Stand, vigour, rng), 0.0, rng.between(0.3, 0.45))
            .map_err(Stumble::reach("in the last stance"))?;
    let t_bottom = now + snap(time);
    let t_up = t_bottom + snap(rng.between(0.6, 0.75));
    let t_end = t_up + snap(rng.between(0.15, 0.3));
    knots.push((t_bottom, low));
    knots.push((t_up, rest(&stand)));
    knots.push((t_end, rest(&stand)));
    let mut plan = PlanCurve::through(&knots);
    feet(&mut plan, &footing, Some((now, &jets)), None);
    let start = chart_now(&jumper, &p);
    let ground = GroundMotion::new(&mut jumper.stance, &plan, [now, t_end], Some(&start), None)
        .map_err(Stumble::reach("after the last landing"))?;
    p.advance(ticks(now, t_end), &held, &ground)?;
    Ok(JumpTrial { motion: p.finish(), styles })
}

fn draw_style(last: &mut Option<Style>, rng: &mut Stream) -> Style {
    loop {
        let style = STYLES[rng.whole(0, STYLES.len() - 1)];
        if *last != Some(style) {
            *last = Some(style);
            return style;
        }
    }
}

/// Chart jets at the player's last tick.
fn chart_now(jumper: &Jumper<'_, '_>, player: &Player<'_>) -> [Jet; PLAN] {
    let (tick, motion) = (player.tick(), player.motion());
    let mut jets = [Jet::default(); PLAN];
    jumper.stance.chart.lower(&jumper.plant.model, motion.q(tick), motion.v(tick), motion.a(tick), &mut jets);
    jets
}

/// Feet on the ground: flat after a landing, heels rising before a take-off.
fn feet(
    plan: &mut PlanCurve,
    footing: &Footing,
    landing: Option<(f64, &[Jet; PLAN])>,
    take_off: Option<(f64, &[Jet; PLAN])>,
) {
    let (flatten_s, rise_s) = (0.13, 0.17);
    for side in 0..2 {
        let first = FOOT[side];
        for k in 0..7 {
            let i = first + k;
            let flat = match k {
                0..=2 => footing.ball[side][k],
                4 => landing.map_or(0.0, |(_, jets)| jets[i].x),
                _ => 0.0,
            };
            let mut knots = Vec::new();
            if let Some((t, jets)) = landing {
                knots.push((t, jets[i]));
                knots.push((t + flatten_s, Jet::rest(flat)));
            } else {
                knots.push((-10.0, Jet::rest(flat)));
            }
            if let Some((t, jets)) = take_off {
                let begin = (t - rise_s).max(landing.map_or(0.0, |(t, _)| t + flatten_s + 1e-3));
                knots.push((begin, Jet::rest(flat)));
                let end = if k == 4 { Jet::rest(flat) } else { jets[i] };
                knots.push((t, end));
            } else if let Some((t, _)) = knots.last().copied() {
                knots.push((t + 10.0, Jet::rest(flat)));
            }
            plan.curves[i] = Piecewise::through(&knots);
        }
    }
}
