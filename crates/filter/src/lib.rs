//! Smooths joint motion and computes velocities and accelerations on the manifold of joint
//! coordinates.
//!
//! Runs between inverse kinematics, which gives poses frame by frame, and every stage that needs
//! derivatives: flights, rows, comparison.
//!
//! Rotations are filtered as unit quaternions: signs are made continuous (so that ±π is not a
//! discontinuity), the four components pass through the same linear filter, and the result is
//! normalised. Filtering in the surrounding space and filtering the rotation vector of the
//! increments agree to first order; the second-order difference was measured on two-link objects
//! tumbling at up to 9 rad/s (200 Hz, order 3, 10 Hz, 14 frames from the throw): the error of the
//! filtered angular velocity is 5.7e-3 rad/s root mean square, against 5.0e-3 rad/s when the true
//! body angular velocity itself is filtered, and the same to two digits on gentler throws. The loss
//! is due to the filter's pass band and edges, not to the representation, so no more elaborate
//! method is used. With marker noise of 0.3 mm, 14 frames from the throw, the paper's rows give the
//! 17 base parameters of the fast throws within 9e-5 (kg·m, kg·m²) and of the gentle ones within
//! 1.5e-3, mostly because of errors in variables.
//!
//! Derivatives are fourth-order differences of the unit quaternion, then `ω = 2 vec(q* q̇)` and `α
//! = 2 vec(q* q̈)` in the axes of the moving link. A free joint's translation is filtered in the
//! world; its velocity is `v = Rᵀṗ` and its acceleration the rate of these components, `a = Rᵀp̈ −
//! ω × v` (the convention of [`aloft_body::State::acceleration`]).

use aloft_body::{JointKind, Model, Motion};
use aloft_signal::derivative::derivatives_of_run;
use aloft_signal::{Butterworth, DesignError, LowPass, SHORT_RUN_S, parabola_of, runs_where};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::f64::consts::{PI, TAU};

/// Errors of smoothing.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SmoothError {
    /// The filter is not valid at this sampling rate.
    #[error("{trial}: {source}")]
    Filter {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        source: DesignError,
    },
    /// The motion belongs to another model.
    #[error("{trial}: model `{model}` has {expected} coordinates a frame, the motion has {found}")]
    Coordinates {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        model: String,
        #[doc(hidden)]
        expected: usize,
        #[doc(hidden)]
        found: usize,
    },
    /// The sampling rate is not a positive number.
    #[error("{trial}: sampling rate {rate_hz} Hz: expected a positive number")]
    Rate {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        rate_hz: f64,
    },
}

/// Joint coordinates with continuous signs of quaternions and turns of hinges, normalised; without
/// derivatives.
///
/// # Errors
/// A motion whose number of coordinates differs from the model's.
pub fn continuous(model: &Model, motion: &Motion) -> Result<Motion, SmoothError> {
    check_coordinates(model, motion)?;
    let mut q = motion.q[..motion.n_frames() * model.nq].to_vec();
    make_continuous(model, &mut q);
    for frame in q.chunks_exact_mut(model.nq.max(1)) {
        model.normalize(frame);
    }
    Ok(Motion { nv: model.nv, q, ..motion_without_series(motion) })
}

fn check_coordinates(model: &Model, motion: &Motion) -> Result<(), SmoothError> {
    if motion.nq == model.nq {
        return Ok(());
    }
    Err(SmoothError::Coordinates {
        trial: motion.trial.clone(),
        model: model.name.clone(),
        expected: model.nq,
        found: motion.nq,
    })
}

/// Joint coordinates filtered forward and backward, with velocities and accelerations. If `spec` is
/// `None`, the coordinates are not filtered (only signs of quaternions and turns of hinges are made
/// continuous) and the derivatives are added.
///
/// Runs without missing frames are processed separately, joint by joint: frames of runs too short
/// for the filter ([`Butterworth::padding`]) become NaN, and runs shorter than
/// [`aloft_signal::derivative::SHORTEST_RUN`] have NaN derivatives. Marker residuals, labels and
/// standard deviations are kept.
///
/// # Errors
/// A filter that is not valid at the rate; a motion whose number of coordinates differs from the
/// model's.
pub fn smooth(model: &Model, motion: &Motion, spec: Option<LowPass>) -> Result<Motion, SmoothError> {
    let trial = || motion.trial.clone();
    check_coordinates(model, motion)?;
    let rate_hz = motion.rate_hz;
    if !(rate_hz > 0.0 && rate_hz.is_finite()) {
        return Err(SmoothError::Rate { trial: trial(), rate_hz });
    }
    let (n, nq, nv) = (motion.n_frames(), model.nq, model.nv);
    let mut q = motion.q[..n * nq].to_vec();
    make_continuous(model, &mut q);
    if let Some(spec) = spec {
        let filter =
            Butterworth::design(spec, rate_hz).map_err(|source| SmoothError::Filter { trial: trial(), source })?;
        // a flight that the recording ends in is filtered about its own parabola
        let parabolas = short_parabolas(model, &q, rate_hz);
        let add = |q: &mut [f64], sign: f64| {
            for (channel, from, values) in &parabolas {
                values.iter().enumerate().for_each(|(i, x)| q[(from + i) * nq + channel] += sign * x);
            }
        };
        add(&mut q, -1.0);
        filter.filtfilt_interleaved(&mut q, nq);
        add(&mut q, 1.0);
    }
    for frame in q.chunks_exact_mut(nq.max(1)) {
        model.normalize(frame);
    }

    let mut q1 = vec![f64::NAN; q.len()];
    let mut q2 = vec![f64::NAN; q.len()];
    let mut v = vec![f64::NAN; n * nv];
    let mut a = vec![f64::NAN; n * nv];
    for link in &model.links {
        let joint = &link.joint;
        let channels = joint.q_offset..joint.q_offset + joint.kind.nq();
        for run in runs_where(n, |f| q[f * nq..][channels.clone()].iter().all(|x| x.is_finite())) {
            let part = run.start * nq..run.end * nq;
            for channel in channels.clone() {
                derivatives_of_run(
                    &q[part.clone()],
                    nq,
                    channel,
                    rate_hz,
                    &mut q1[part.clone()],
                    &mut q2[part.clone()],
                );
            }
            for f in run {
                let (q, q1, q2) = (&q[f * nq..], &q1[f * nq..], &q2[f * nq..]);
                let (v, a) = (&mut v[f * nv + joint.v_offset..], &mut a[f * nv + joint.v_offset..]);
                joint_rates(joint.kind, joint.q_offset, [q, q1, q2], v, a);
            }
        }
    }
    Ok(Motion { nv, q, v, a, ..motion_without_series(motion) })
}

/// Parabolas of the free joints' translations in runs of at most [`SHORT_RUN_S`]: channel, first
/// frame, values.
fn short_parabolas(model: &Model, q: &[f64], rate_hz: f64) -> Vec<(usize, usize, Vec<f64>)> {
    let (nq, n) = (model.nq, q.len() / model.nq.max(1));
    let free = model.links.iter().filter(|l| l.joint.kind == JointKind::Free).map(|l| l.joint.q_offset);
    let mut out = Vec::new();
    for channel in free.flat_map(|at| at..at + 3) {
        let values: Vec<f64> = q.iter().skip(channel).step_by(nq).copied().collect();
        for run in
            runs_where(n, |f| values[f].is_finite()).into_iter().filter(|r| r.len() as f64 <= SHORT_RUN_S * rate_hz)
        {
            out.push((channel, run.start, parabola_of(&values[run])));
        }
    }
    out
}

fn motion_without_series(motion: &Motion) -> Motion {
    Motion {
        trial: motion.trial.clone(),
        rate_hz: motion.rate_hz,
        nq: motion.nq,
        nv: motion.nv,
        q: Vec::new(),
        v: Vec::new(),
        a: Vec::new(),
        marker_labels: motion.marker_labels.clone(),
        residual_m: motion.residual_m.clone(),
        q_sd: motion.q_sd.clone(),
    }
}

/// Joint velocity and acceleration from coordinates and their first two derivatives (`[q, q̇, q̈]`,
/// offset `at`).
fn joint_rates(kind: JointKind, at: usize, q: [&[f64]; 3], v: &mut [f64], a: &mut [f64]) {
    let vector = |x: &[f64], at: usize| Vector3::new(x[at], x[at + 1], x[at + 2]);
    match kind {
        JointKind::Fixed => {}
        JointKind::Revolute(_) | JointKind::Prismatic(_) => {
            v[0] = q[1][at];
            a[0] = q[2][at];
        }
        JointKind::Spherical => {
            let (omega, alpha) = angular_rates(q, at);
            v[..3].copy_from_slice(omega.as_slice());
            a[..3].copy_from_slice(alpha.as_slice());
        }
        JointKind::Free => {
            let (omega, alpha) = angular_rates(q, at + 3);
            let body_from_world = UnitQuaternion::new_unchecked(quaternion(q[0], at + 3)).inverse();
            let linear = body_from_world * vector(q[1], at);
            let rate = body_from_world * vector(q[2], at) - omega.cross(&linear);
            v[..3].copy_from_slice(linear.as_slice());
            v[3..6].copy_from_slice(omega.as_slice());
            a[..3].copy_from_slice(rate.as_slice());
            a[3..6].copy_from_slice(alpha.as_slice());
        }
    }
}

fn quaternion(x: &[f64], at: usize) -> Quaternion<f64> {
    Quaternion::new(x[at + 3], x[at], x[at + 1], x[at + 2])
}

/// `ω = 2 vec(q* q̇)`, `α = 2 vec(q* q̈)`: with `q̈ = ½(q̇ω + qω̇)`, the part `½ q* q̇ ω = ¼ ω ω`
/// is a pure scalar.
fn angular_rates(q: [&[f64]; 3], at: usize) -> (Vector3<f64>, Vector3<f64>) {
    let conjugate = quaternion(q[0], at).conjugate();
    let body = |rate: &[f64]| 2.0 * (conjugate * quaternion(rate, at)).vector();
    (body(q[1]), body(q[2]))
}

/// Chooses, of the two quaternions of each rotation, the one nearer to the previous frame, and for
/// hinges the nearest turn, also across gaps. A quaternion with a missing component is missing.
fn make_continuous(model: &Model, q: &mut [f64]) {
    let nq = model.nq;
    for link in &model.links {
        let joint = &link.joint;
        if let Some(at) = joint.quaternion_offset() {
            let mut before: Option<[f64; 4]> = None;
            for frame in q.chunks_exact_mut(nq) {
                let now = &mut frame[at..at + 4];
                let norm2: f64 = now.iter().map(|x| x * x).sum();
                if !(norm2 > 0.0 && norm2.is_finite()) {
                    now.fill(f64::NAN);
                    continue;
                }
                if before.is_some_and(|b| b.iter().zip(now.iter()).map(|(a, b)| a * b).sum::<f64>() < 0.0) {
                    now.iter_mut().for_each(|x| *x = -*x);
                }
                before = Some([now[0], now[1], now[2], now[3]]);
            }
        }
        if let JointKind::Revolute(_) = joint.kind {
            let mut before: Option<f64> = None;
            for frame in q.chunks_exact_mut(nq) {
                let angle = &mut frame[joint.q_offset];
                if !angle.is_finite() {
                    continue;
                }
                if let Some(b) = before
                    && (*angle - b).abs() > PI
                {
                    *angle -= TAU * ((*angle - b) / TAU).round();
                }
                before = Some(*angle);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use aloft_body::{JointSpec, LinkSpec, ModelSpec};
    use aloft_signal::CutoffCorrection;

    fn link(name: &str, parent: Option<&str>, joint: JointSpec) -> LinkSpec {
        LinkSpec {
            name: name.into(),
            parent: parent.map(Into::into),
            joint,
            position_m: [0.0, 0.1, 0.0],
            rpy_rad: [0.0; 3],
            inertia: None,
        }
    }

    /// Free root, spherical child, hinge on it.
    fn tree() -> Model {
        let links = vec![
            link("root", None, JointSpec::Free),
            link("ball", Some("root"), JointSpec::Spherical),
            link("hinge", Some("ball"), JointSpec::RevoluteZ),
        ];
        Model::from_spec(&ModelSpec::new("tree".into(), links)).unwrap()
    }

    fn turn(axis: Vector3<f64>, angle: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_scaled_axis(axis * angle)
    }

    /// Coordinates, velocities and accelerations in closed form: spin about the world's z after a
    /// swing about the body's x, R = Rz(a(t)) Rx(b(t)), with ω = ȧ Rxᵀz + ḃ x in body axes.
    fn truth(t: f64) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let (z, x) = (Vector3::z(), Vector3::x());
        let rotation = |a: [f64; 3], b: [f64; 3]| {
            let rx = turn(x, b[0]);
            let zb = rx.inverse() * z;
            let omega = zb * a[1] + x * b[1];
            let alpha = zb * a[2] + (-(x * b[1]).cross(&zb)) * a[1] + x * b[2];
            (turn(z, a[0]) * rx, omega, alpha)
        };
        let sine = |offset: f64, rate: f64, amplitude: f64, w: f64| {
            let (s, c) = (w * t).sin_cos();
            [offset + rate * t + amplitude * s, rate + amplitude * w * c, -amplitude * w * w * s]
        };
        let (root, w0, al0) = rotation(sine(1.0, 9.0, 0.2, 5.0), sine(0.2, 1.0, 0.5, 4.0));
        let (ball, w1, al1) = rotation(sine(0.0, -4.0, 0.0, 1.0), sine(0.0, 0.0, 1.2, 3.0));
        let hinge = sine(3.0, 7.0, 0.3, 6.0);
        let p = Vector3::new(0.5 * t, 0.2 * (3.0 * t).sin(), 1.0 + 2.0 * t - 4.9 * t * t);
        let p1 = Vector3::new(0.5, 0.6 * (3.0 * t).cos(), 2.0 - 9.8 * t);
        let p2 = Vector3::new(0.0, -1.8 * (3.0 * t).sin(), -9.8);
        let v0 = root.inverse() * p1;
        let a0 = root.inverse() * p2 - w0.cross(&v0);
        let q = [p.as_slice(), root.coords.as_slice(), ball.coords.as_slice(), &hinge[..1]].concat();
        let v = [v0.as_slice(), w0.as_slice(), w1.as_slice(), &hinge[1..2]].concat();
        let a = [a0.as_slice(), al0.as_slice(), al1.as_slice(), &hinge[2..]].concat();
        (q, v, a)
    }

    fn motion(n: usize, rate_hz: f64) -> Motion {
        let q = (0..n).flat_map(|f| truth(f as f64 / rate_hz).0).collect();
        Motion { trial: "t".into(), rate_hz, nq: 12, q, ..Motion::default() }
    }

    fn largest_error(found: &Motion, frames: std::ops::Range<usize>) -> (f64, f64) {
        frames.fold((0.0f64, 0.0f64), |(ev, ea), f| {
            let (_, v, a) = truth(f as f64 / found.rate_hz);
            let gap = |x: &[f64], y: &[f64]| x.iter().zip(y).fold(0.0f64, |e, (x, y)| e.max((x - y).abs()));
            (ev.max(gap(found.v(f), &v)), ea.max(gap(found.a(f), &a)))
        })
    }

    #[test]
    fn rates_of_the_unfiltered_motion_are_those_of_the_closed_form() {
        let model = tree();
        let coarse = smooth(&model, &motion(200, 200.0), None).unwrap();
        let fine = smooth(&model, &motion(400, 400.0), None).unwrap();
        let (ev, ea) = largest_error(&coarse, 2..198);
        let (fv, fa) = largest_error(&fine, 2..398);
        assert!(ev < 2e-5 && ea < 1e-3, "{ev:e} {ea:e}");
        assert!(ev / fv > 14.0 && ea / fa > 14.0, "fourth order: {ev:e} {fv:e} {ea:e} {fa:e}");
    }

    #[test]
    fn velocities_agree_with_the_models_own_difference() {
        let model = tree();
        let rate = 4000.0;
        let m = smooth(&model, &motion(40, rate), None).unwrap();
        let (mut forward, mut backward) = (vec![0.0; 10], vec![0.0; 10]);
        for f in 3..37 {
            model.difference(m.q(f), m.q(f + 1), &mut forward);
            model.difference(m.q(f), m.q(f - 1), &mut backward);
            for i in 0..10 {
                let v = 0.5 * rate * (forward[i] - backward[i]);
                assert!((v - m.v(f)[i]).abs() < 2e-4, "frame {f}, velocity {i}: {v} {}", m.v(f)[i]);
                // components of v change by a dt
                let a = 0.5 * rate * (m.v(f + 1)[i] - m.v(f - 1)[i]);
                assert!((a - m.a(f)[i]).abs() < 5e-3, "frame {f}, acceleration {i}: {a} {}", m.a(f)[i]);
            }
        }
    }

    #[test]
    fn filter_keeps_slow_motion_and_is_blind_to_signs_and_turns() {
        let model = tree();
        let spec = LowPass { order: 3, cutoff_hz: 10.0, correction: CutoffCorrection::None };
        let plain = motion(300, 200.0);
        let mut flipped = plain.clone();
        for f in 0..300 {
            let q = &mut flipped.q[f * 12..(f + 1) * 12];
            if f % 3 == 0 {
                q[3..7].iter_mut().for_each(|x| *x = -*x);
            }
            q[7..11].iter_mut().for_each(|x| *x *= if f % 5 < 2 { 1.0 } else { -1.0 });
            q[11] = (q[11] + PI).rem_euclid(TAU) - PI; // wrapped into ±π
        }
        let (a, b) = (smooth(&model, &plain, Some(spec)).unwrap(), smooth(&model, &flipped, Some(spec)).unwrap());
        for (x, y) in a.v.iter().chain(&a.a).zip(b.v.iter().chain(&b.a)) {
            assert!((x - y).abs() < 1e-8, "{x} {y}");
        }
        let (ev, ea) = largest_error(&a, 60..240);
        assert!(ev < 1e-2 && ea < 0.1, "{ev:e} {ea:e}");
    }

    #[test]
    fn gaps_stay_gaps_and_runs_are_apart() {
        let model = tree();
        let spec = LowPass { order: 3, cutoff_hz: 10.0, correction: CutoffCorrection::None };
        let mut holed = motion(150, 200.0);
        for f in [0, 60, 61, 66] {
            holed.q[f * 12..(f + 1) * 12].fill(f64::NAN);
        }
        let s = smooth(&model, &holed, Some(spec)).unwrap();
        let valid: Vec<bool> = (0..150).map(|f| s.is_valid(f)).collect();
        assert!((1..60).chain(67..150).all(|f| valid[f]) && (60..67).all(|f| !valid[f]) && !valid[0]);
        let mut part = holed.clone();
        part.q = holed.q[67 * 12..].to_vec();
        let part = smooth(&model, &part, Some(spec)).unwrap();
        assert_eq!(s.q[67 * 12..], part.q[..]);
        assert_eq!(s.a[67 * 10..], part.a[..]);
        let unfiltered = smooth(&model, &holed, None).unwrap();
        assert!(unfiltered.is_valid(63) && unfiltered.v(63).iter().all(|x| x.is_nan()));
    }

    #[test]
    fn foreign_motions_and_filters_are_refused() {
        let model = tree();
        let spec = LowPass { order: 3, cutoff_hz: 100.0, correction: CutoffCorrection::None };
        let m = motion(10, 200.0);
        assert!(matches!(smooth(&model, &m, Some(spec)), Err(SmoothError::Filter { .. })));
        assert!(matches!(smooth(&model, &Motion { nq: 7, ..m.clone() }, None), Err(SmoothError::Coordinates { .. })));
        assert!(matches!(smooth(&model, &Motion { rate_hz: 0.0, ..m }, None), Err(SmoothError::Rate { .. })));
    }
}
