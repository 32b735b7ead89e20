//! Work that a law does.

use super::fit::Fitted;
use super::kinematics::Action;
use super::result::Work;
use crate::session::Session;

/// Work of a law over all flights.
pub(super) fn work(session: &Session<'_>, f: &Fitted) -> Work {
    let (_, anchor, parts) = f.law.divided(&f.nonlinear);
    let (mut taken, mut absolute, mut size) = (0.0, 0.0, 0.0);
    let mut strengths = Vec::new();
    for at in f.frames(session).iter().flatten() {
        let v = f.vector(at, &anchor, &parts, &mut strengths);
        let rate = match f.law.action {
            Action::Force => at.now.velocity,
            Action::Couple => at.now.omega,
        };
        let power = v.dot(&rate);
        absolute += power.abs();
        taken += (-power).max(0.0);
        size += v.norm() * rate.norm();
    }
    Work {
        taken: if absolute > 0.0 { taken / absolute } else { 0.0 },
        share: if size > 0.0 { absolute / size } else { 0.0 },
    }
}
