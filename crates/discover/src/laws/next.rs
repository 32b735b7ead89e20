//! Which recording would tell two laws apart: both are evaluated on the flights turned, moved,
//! faster and with more spin, and the change on which they differ most is named.

use super::fit::Fitted;
use super::kinematics::{Action, Instant};
use super::law::LawFrame;
use super::result::NextRecording;
use super::wording;
use crate::session::Session;
use aloft_effects::Scene;
use nalgebra::{Rotation3, Vector3};

/// Length over which moments are compared with forces, m.
const LEVER_M: f64 = 0.1;
/// Every how many frames are compared.
const STEP: usize = 5;

/// A change of all flights.
#[derive(Debug, Clone, Copy)]
struct Change {
    words: &'static str,
    /// Turn about the vertical, degrees.
    turn_deg: f64,
    /// Shift of the place, m.
    shift_m: [f64; 3],
    /// Factors of velocities and of angular velocities.
    speed: f64,
    spin: f64,
}

const SAME: Change = Change { words: "", turn_deg: 0.0, shift_m: [0.0; 3], speed: 1.0, spin: 1.0 };

/// Changes that a laboratory can make.
const CHANGES: [Change; 8] = [
    Change { words: "turned by a right angle about the vertical", turn_deg: 90.0, ..SAME },
    Change { words: "turned by half a turn about the vertical", turn_deg: 180.0, ..SAME },
    Change { words: "1 m further along x", shift_m: [1.0, 0.0, 0.0], ..SAME },
    Change { words: "1 m further along y", shift_m: [0.0, 1.0, 0.0], ..SAME },
    Change { words: "0.5 m higher", shift_m: [0.0, 0.0, 0.5], ..SAME },
    Change { words: "1.5 times as fast", speed: 1.5, ..SAME },
    Change { words: "with 1.5 times the spin", spin: 1.5, ..SAME },
    Change { words: "with the spin reversed", spin: -1.0, ..SAME },
];

impl Change {
    fn of(&self, at: &Instant, scene: &Scene) -> Instant {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), self.turn_deg.to_radians());
        let middle = scene.volume_centre_m;
        Instant {
            position: middle + turn * (at.position - middle) + Vector3::from(self.shift_m),
            velocity: turn * at.velocity * self.speed,
            rotation: turn.matrix() * at.rotation,
            omega: turn * at.omega * self.spin,
        }
    }

    /// The change of a frame in which a law acts.
    fn of_frame<'s>(&self, at: &LawFrame<'s>, scene: &Scene) -> LawFrame<'s> {
        let then = at.then.map(|(frame, place, share)| (frame, self.of(&place, scene), share));
        LawFrame { now: self.of(&at.now, scene), then }
    }
}

/// Force and moment about the centre of mass of a law in a frame.
fn wrench(f: &Fitted, at: &LawFrame<'_>, com: &Vector3<f64>, buffer: &mut Vec<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let (_, anchor, parts) = f.law.divided(&f.nonlinear);
    let v = f.vector(at, &anchor, &parts, buffer);
    match f.law.action {
        Action::Force => (v, (at.now.position - com).cross(&v)),
        Action::Couple => (Vector3::zeros(), v),
    }
}

/// Root mean square of the difference of two laws over all flights after a change, N.
fn difference(session: &Session<'_>, a: &Fitted, b: &Fitted, change: &Change) -> f64 {
    let frames = [a, b].map(|f| f.frames(session));
    let bodies = session
        .series
        .iter()
        .flatten()
        .zip(&frames[0])
        .flat_map(|(series, of_law)| series.instants().map(|(_, frame)| frame).take(of_law.len()));
    let (mut sum, mut n) = (0.0, 0.0);
    let mut buffer = Vec::new();
    let both = frames[0].iter().flatten().zip(frames[1].iter().flatten());
    for (body, (one, other)) in bodies.zip(both).step_by(STEP) {
        let middle = Instant { position: body.com, velocity: body.com_velocity, ..one.now };
        let com = change.of(&middle, session.scene).position;
        let (fa, ma) = wrench(a, &change.of_frame(one, session.scene), &com, &mut buffer);
        let (fb, mb) = wrench(b, &change.of_frame(other, session.scene), &com, &mut buffer);
        let d = (fa - fb).norm_squared() + (ma - mb).norm_squared() / (LEVER_M * LEVER_M);
        if d.is_finite() {
            sum += d;
            n += 1.0;
        }
    }
    if n > 0.0 { (sum / f64::max(n, 1.0)).sqrt() } else { f64::NAN }
}

/// A rival that leaves more than this multiple of the law's error is told apart already.
const TOLD_APART: f64 = 2.0;
/// A change is worth a recording if the laws differ by this factor more.
const WORTH: f64 = 1.2;

/// The recording on which a law and its rival differ most; `None` if they are told apart already,
/// or no change tells more than the present flights.
pub(crate) fn next_recording(session: &Session<'_>, law: &Fitted, rival: &Fitted) -> Option<NextRecording> {
    if rival.error() > TOLD_APART * TOLD_APART * law.error() {
        return None;
    }
    let here = difference(session, law, rival, &SAME);
    let (change, there) = CHANGES
        .iter()
        .map(|c| (c, difference(session, law, rival, c)))
        .filter(|(_, d)| d.is_finite())
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .filter(|(_, there)| *there > WORTH * here)?;
    let work = super::work::work(session, rival);
    Some(NextRecording {
        rival: wording::law(session.scene, &rival.law, &rival.nonlinear, &rival.theta, work),
        rival_error_ratio: (rival.error() / law.error()).sqrt(),
        change: change.words.to_owned(),
        differ_here_n: here,
        differ_there_n: there,
    })
}
