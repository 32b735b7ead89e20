//! Positions of the feet, and the division of the total ground wrench between two plates.

use crate::human::Person;
use crate::human::person::THIGH;
use crate::physics::{TrueMotion, Wrench};
use aloft_body::State;
use nalgebra::Vector3;

/// Distance between the centre of pressure and either end of the foot, as a share of its length.
const MARGIN: f64 = 0.03;
/// Share of the load by which the feet push apart; the plates measure it, its sum on the body is
/// zero.
const SPREAD: f64 = 0.03;

/// Heel and toe of both feet (right, left) on the floor at every tick.
#[derive(Debug, Clone)]
pub struct FootPrints {
    heel: Vec<[Vector3<f64>; 2]>,
    toe: Vec<[Vector3<f64>; 2]>,
}

impl FootPrints {
    /// Computes the footprints of a motion.
    pub fn of(person: &Person, motion: &TrueMotion) -> Self {
        let model = &person.body.model;
        let mut state = State::new(model);
        let (mut heel, mut toe) = (Vec::with_capacity(motion.n_ticks()), Vec::with_capacity(motion.n_ticks()));
        for tick in 0..motion.n_ticks() {
            state.forward_position(model, motion.q(tick));
            let at = |side: usize, share: f64| {
                let ball = person.ball_m[side];
                let point = Vector3::new(share * ball.x, ball.y, 0.0);
                state.point_in_world(THIGH[side] + 2, &point)
            };
            heel.push([at(0, -0.6), at(1, -0.6)]);
            toe.push([at(0, 1.65), at(1, 1.65)]);
        }
        Self { heel, toe }
    }

    /// Share of the stance (load above a fifth of the usual one) in which the centre of pressure is
    /// more than 3 cm outside the feet.
    pub fn stray_share(&self, motion: &TrueMotion) -> f64 {
        let heaviest = motion.contact.iter().map(|w| w.force_n.z).fold(0.0, f64::max);
        let (mut stray, mut stance) = (0usize, 0usize);
        for tick in 0..motion.n_ticks() {
            let w = &motion.contact[tick];
            if w.force_n.z < 0.08 * heaviest {
                continue;
            }
            stance += 1;
            let (x, y) = (-w.moment_nm.y / w.force_n.z, w.moment_nm.x / w.force_n.z);
            let (heel, toe) = (&self.heel[tick], &self.toe[tick]);
            let back = heel[0].x.min(heel[1].x) - 0.03;
            let front = toe[0].x.max(toe[1].x) + 0.03;
            let right = heel[0].y.min(toe[0].y) - 0.06;
            let left = heel[1].y.max(toe[1].y) + 0.06;
            if !(back..front).contains(&x) || !(right..left).contains(&y) {
                stray += 1;
            }
        }
        if stance == 0 { 1.0 } else { stray as f64 / stance as f64 }
    }

    /// The wrenches on right and left foot at a tick; their sum is exactly the body's contact
    /// wrench. Each acts at a point of its foot; the remainder that no such points can produce is
    /// added as moments.
    pub fn divide(&self, tick: usize, whole: &Wrench) -> [Wrench; 2] {
        let load = whole.force_n.z;
        if load.abs() < 1e-6 && whole.force_n.norm() < 1e-6 {
            return [Wrench::default(); 2];
        }
        let (heel, toe) = (&self.heel[tick], &self.toe[tick]);
        let divisor = if load.abs() < 1.0 { 1.0 } else { load };
        let (x, y) = (-whole.moment_nm.y / divisor, whole.moment_nm.x / divisor);
        let mean = |v: &[Vector3<f64>; 2]| 0.5 * (v[0].x + v[1].x);
        let along = ((x - mean(heel)) / (mean(toe) - mean(heel)).max(1e-3)).clamp(MARGIN, 1.0 - MARGIN);
        let point = |side: usize| {
            let p = heel[side] + (toe[side] - heel[side]) * along;
            Vector3::new(p.x, p.y, 0.0)
        };
        let points = [point(0), point(1)];
        let width = (points[1].y - points[0].y).max(1e-3);
        let left = ((y - points[0].y) / width).clamp(0.03, 0.97);
        let share = [1.0 - left, left];
        let inward = SPREAD * load * share[0].min(share[1]) * 2.0;
        let mut out = [Wrench::default(); 2];
        let mut rest = whole.moment_nm;
        for side in 0..2 {
            let sign = if side == 0 { 1.0 } else { -1.0 };
            let force = whole.force_n * share[side] + Vector3::new(0.0, sign * inward, 0.0);
            out[side].push(&force, &points[side]);
            rest -= out[side].moment_nm;
        }
        for side in 0..2 {
            out[side].moment_nm += rest * share[side];
        }
        out
    }
}
