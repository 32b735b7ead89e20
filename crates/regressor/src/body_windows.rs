//! Weak rows of one body with known parameters: the wrench that its motion requires, window by
//! window, without the columns of the base parameters.
//!
//! The same sums as in [`crate::weak_windows`], with C, P and H of the whole body in place of those
//! of each base parameter. If only the wrench of one model is needed (repeated draws of errors for
//! the noise floor of a comparison) this takes a tenth of the time.

use crate::stretch::Acting;
use crate::test_function::{TestFunction, window_centres};
use crate::velocities::{run_velocities, valid_runs};
use crate::weak_windows::fit_origin;
use crate::{RegressorError, Stretch, WeakOptions};
use aloft_body::{Model, Motion, Phi, State};
use nalgebra::{SMatrix, Vector3, Vector6};

/// Mean wrench `∫ψ w dt / ∫ψ dt` required by the motion of a body beyond gravity and the measured
/// wrench, in the windows of a stretch.
#[derive(Debug, Clone, Default)]
pub struct BodyWindows {
    /// Frame at the centre of each window.
    pub centres: Vec<usize>,
    /// Force (N) and moment about the moment origin (N·m), world axes.
    pub wrench: Vec<Vector6<f64>>,
    /// `∫ψ o dt / ∫ψ dt` of the moment origin, m, world.
    pub path: Vec<Vector3<f64>>,
}

/// Windows of one stretch, placed as by [`weak_rows`](crate::weak_rows); none if the stretch is too
/// short. `phi` are the links' parameters, `prior` gives the moment origin. Effects of `acting` are
/// ignored.
///
/// # Errors
/// As [`weak_rows`](crate::weak_rows), for a stretch or a wrench that does not fit the motion.
pub fn body_windows(
    model: &Model,
    phi: &[Phi],
    prior: &[Phi],
    motion: &Motion,
    stretch: &Stretch,
    acting: Acting<'_>,
    options: &WeakOptions,
) -> Result<BodyWindows, RegressorError> {
    stretch.check(model, motion)?;
    acting.check(motion, stretch)?;
    let margin = (options.margin_s.max(0.0) * motion.rate_hz).round() as usize;
    let (first, end) = (stretch.first_frame + margin, stretch.end_frame.saturating_sub(margin));
    let half = options.half_window(end.saturating_sub(first + 2), motion.rate_hz);
    let test = TestFunction::new(half, options.power, motion.rate_hz)?;
    let hop = ((options.hop * test.length_s() * motion.rate_hz).floor() as usize).max(1);
    let per_second = 1.0 / test.integral_s();
    let mass_kg: f64 = phi.iter().map(|p| p[0]).sum();
    let mut out = BodyWindows::default();
    let mut state = State::new(model);
    for (start, stop) in valid_runs(first, end, |f| motion.is_valid(f) && acting.is_finite(stretch, f)) {
        let centres = window_centres(start + 1, stop.saturating_sub(1), half, hop);
        if centres.is_empty() {
            continue;
        }
        state.forward_position(model, motion.q((start + stop) / 2));
        let fixed = state.centre_of_mass(prior).1;
        let velocities = run_velocities(model, motion, start, stop);
        let mut sums = Vec::with_capacity(stop - start);
        let mut path = Vec::with_capacity(stop - start);
        for frame in start..stop {
            let v = &velocities[(frame - start) * model.nv..][..model.nv];
            state.forward_velocity(model, motion.q(frame), v);
            sums.push(moments(&state, phi, &fixed));
            path.push(state.centre_of_mass(prior).1);
        }
        for centre in centres {
            let begin = centre - half - start;
            let (origin, fall) =
                fit_origin(&path[begin..begin + test.n_frames()], &test, stretch.kind, &model.gravity_mps2);
            let (mut force, mut moment) = (Vector3::zeros(), Vector3::zeros());
            let mut middle = Vector3::zeros();
            for (i, (at, fall)) in origin.iter().zip(&fall).enumerate() {
                let s = &sums[begin + i];
                let d = at.position - fixed;
                let c = s.fixed_rows::<3>(0) - d * mass_kg;
                let p: Vector3<f64> = s.fixed_rows::<3>(3).into();
                let h = s.fixed_rows::<3>(6) - d.cross(&p) + at.velocity.cross(&c);
                let (psi, first, second) = (test.psi[i], test.psi_dot[i], test.psi_ddot[i]);
                let measured: Vector6<f64> = acting.wrench(stretch, centre - half + i);
                let (f, n): (Vector3<f64>, Vector3<f64>) =
                    (measured.fixed_rows::<3>(0).into(), measured.fixed_rows::<3>(3).into());
                force += c * second - fall * (psi * mass_kg) - f * psi;
                moment += fall.cross(&c) * psi - h * first - (n - at.position.cross(&f)) * psi;
                middle += at.position * psi;
            }
            out.centres.push(centre);
            out.wrench.push(Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z) * per_second);
            out.path.push(middle * per_second);
        }
    }
    Ok(out)
}

/// First moment, momentum and angular momentum of a body about a fixed point.
pub(crate) fn moments(state: &State, phi: &[Phi], fixed: &Vector3<f64>) -> SMatrix<f64, 9, 1> {
    let mut out = SMatrix::<f64, 9, 1>::zeros();
    for ((pose, velocity), phi) in state.world_from_link.iter().zip(&state.velocity).zip(phi) {
        let rotation = pose.rotation.to_rotation_matrix();
        let (v, w): (Vector3<f64>, Vector3<f64>) =
            (velocity.fixed_rows::<3>(0).into(), velocity.fixed_rows::<3>(3).into());
        let mc = Vector3::new(phi[1], phi[2], phi[3]);
        let inertia = aloft_body::inertia::inertia_about_origin(phi);
        let linear = rotation * (v * phi[0] + w.cross(&mc));
        let angular = rotation * (mc.cross(&v) + inertia * w);
        let arm = pose.translation.vector - fixed;
        let first = rotation * mc + arm * phi[0];
        let angular = angular + arm.cross(&linear);
        for axis in 0..3 {
            out[axis] += first[axis];
            out[3 + axis] += linear[axis];
            out[6 + axis] += angular[axis];
        }
    }
    out
}
