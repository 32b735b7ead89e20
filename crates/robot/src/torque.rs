//! Rows of the joints' torques in flight: the lines of the equation of motion that the base rows
//! leave out (the paper's eq. 5 before they are dropped).
//!
//! For joint j with the world axis S(t) (a spatial vector), the momentum h of everything that it
//! carries, in a frame that falls with the body, where gravity vanishes:
//!
//! ```text
//!  −∫ (ψ̇ S + ψ Ṡ)ᵀ h dt + Ia ∫ψ̈ q dt − d ∫ψ̇ q dt + c ∫ψ sgn(q̇) dt  =  (1 + κ) ∫ψ τ dt
//! ```
//!
//! with the torque τ at the motor's side, reflected inertia Ia, viscous friction d, Coulomb friction
//! c and the error κ of the torque's gain. As in the base's weak rows no acceleration is formed.
//! Rows are linear in φ, Ia, d, c and κ. The same regrouping into base parameters holds as for the
//! base rows.
//!
//! Rows are weighted by constants: the torque sensor's noise and a share of the torque's own size.
//! With gains unknown, weights taken from residuals would shrink every gain to zero.

use crate::model::RobotModel;
use aloft_body::{BaseParameters, JointKind, Model, Motion, Phi, State};
use aloft_regressor::test_function::MIN_HALF_WINDOW;
use aloft_regressor::{
    Columns, Factor, RegressorError, RowKind, Stretch, TestFunction, run_velocities, window_centers,
};
use faer::Mat;
use nalgebra::{DMatrix, DVector, Vector3, Vector6};

/// Names of a joint's unknowns, in the order of their columns.
pub const UNKNOWNS: [&str; 4] = ["armature", "damping", "friction", "gain_error"];

/// Share of a joint's torque (root mean square over the stretch) by which a row may be wrong in any case.
const MODEL_SHARE: f64 = 0.01;

/// Torques of a recording at the frames of its motion.
#[derive(Debug, Clone, Copy)]
pub struct Torques<'a> {
    /// `[joint][frame]`, N·m or N, NaN where missing; joints in the order of [`RobotModel::joints`].
    pub values: &'a [Vec<f64>],
    /// Standard deviation of one sample.
    pub sd_nm: f64,
}

/// Factor of one flight from the torques of all joints; columns `[φ_B | joint.armature … | τ]`.
/// Windows are as long as those of weak rows (0.6 of the flight, 0.15 to 0.4 s).
///
/// # Errors
/// [`RegressorError::TooShort`] if no window fits, [`RegressorError::Numeric`] for numbers that are
/// not finite.
pub fn torque_factor(
    model: &Model,
    robot: &RobotModel,
    base: &BaseParameters,
    prior: &[Phi],
    motion: &Motion,
    stretch: &Stretch,
    torques: Torques<'_>,
) -> Result<Factor, RegressorError> {
    let (start, end) = (stretch.first_frame, stretch.end_frame);
    let n = end - start;
    let joints = Joints::of(model, robot);
    let duration_s = n as f64 / motion.rate_hz;
    let window_s = (0.6 * duration_s).clamp(0.15, 0.4).min(duration_s);
    let half = ((window_s * motion.rate_hz / 2.0).round() as usize).saturating_sub(4).max(MIN_HALF_WINDOW);
    let test = TestFunction::new(half, 5, motion.rate_hz)?;
    let hop = ((0.25 * test.length_s() * motion.rate_hz) as usize).max(1);
    // three frames at both ends have velocities of lower order
    let centers = window_centers(3, n.saturating_sub(3), half, hop);
    let measured = |t: &Vec<f64>| t.get(start..end).is_some_and(|t| t.iter().all(|x| x.is_finite()));
    let usable = (start..end).all(|f| motion.is_valid(f))
        && torques.values.len() == joints.list.len()
        && torques.values.iter().all(measured);
    if centers.is_empty() || !usable {
        return Err(RegressorError::TooShort {
            trial: stretch.trial.clone(),
            stretch: stretch.index,
            frames: n,
            needed: test.n_frames() + 6,
        });
    }
    let frames = Frames::of(model, &joints, prior, motion, start, end);
    let wide = 10 * model.n_links();
    let extra = UNKNOWNS.len() * joints.list.len();
    let p = base.len();
    let mut full = DMatrix::zeros(centers.len() * joints.list.len(), wide);
    let mut rest = DMatrix::<f64>::zeros(full.nrows(), extra + 1);
    let mut weight = vec![0.0; full.nrows()];
    let area = test.integral_s();
    for (w, &center) in centers.iter().enumerate() {
        for (j, joint) in joints.list.iter().enumerate() {
            let row = w * joints.list.len() + j;
            let first = UNKNOWNS.len() * j;
            let torque = &torques.values[j];
            let (mut squares, mut noise) = (0.0, 0.0);
            for i in 0..test.n_frames() {
                let f = center - half + i;
                let (psi, psi_dot, psi_ddot) = (test.psi[i], test.psi_dot[i], test.psi_ddot[i]);
                for &link in &joint.carried {
                    for c in 10 * link..10 * link + 10 {
                        let at = f * joints.width + joint.offset + joints.place[j][link] + (c - 10 * link);
                        full[(row, c)] -= psi_dot * frames.along[at] + psi * frames.turning[at];
                    }
                }
                let q = motion.q(start + f)[joint.q_offset];
                let v = frames.velocities[f * model.nv + joint.v_offset];
                let tau = torque[start + f];
                rest[(row, first)] += psi_ddot * q;
                rest[(row, first + 1)] -= psi_dot * q;
                rest[(row, first + 2)] += psi * (v / STANDSTILL).tanh();
                rest[(row, first + 3)] -= psi * tau;
                rest[(row, extra)] += psi * tau;
                squares += psi * tau * tau;
                noise += psi * psi;
            }
            let sensor = torques.sd_nm * noise.sqrt() / area;
            let size = MODEL_SHARE * (squares / area).sqrt();
            weight[row] = (sensor * sensor + size * size).sqrt().recip() / area;
        }
    }
    let regrouped = &full * &base.to_full;
    let matrix = Mat::from_fn(full.nrows(), p + extra + 1, |i, k| {
        weight[i] * if k < p { regrouped[(i, k)] } else { rest[(i, k - p)] }
    });
    let effects = joints.list.iter().flat_map(|j| UNKNOWNS.iter().map(move |u| format!("{}.{u}", j.name))).collect();
    let columns = Columns { parameters: base.parameters.iter().map(|b| b.name.clone()).collect(), effects };
    Factor::from_rows(stretch, RowKind::Weak, columns, matrix.as_ref())
}

/// How large measured torques are against what a model needs for the same motion: slope and correlation over all rows. A
/// slope far from 1 is another unit or the opposite sign. None without rows.
pub fn size(robot: &RobotModel, base: &BaseParameters, prior: &[Phi], factors: &[Factor]) -> Option<(f64, f64)> {
    let p = base.len();
    let mut x = DVector::zeros(p + UNKNOWNS.len() * robot.joints.len());
    x.rows_mut(0, p).copy_from(&base.regroup(prior));
    for (j, joint) in robot.joints.iter().enumerate() {
        let first = p + UNKNOWNS.len() * j;
        (x[first], x[first + 1], x[first + 2]) = (joint.armature, joint.damping, joint.friction);
    }
    let (mut pp, mut pm, mut mm) = (0.0, 0.0, 0.0);
    for factor in factors.iter().filter(|f| f.columns.len() == x.len() + 1) {
        // a triangle has the inner products of its rows
        let r = factor.dense();
        let predicted = r.columns(0, x.len()) * &x;
        let measured = r.column(x.len());
        pp += predicted.norm_squared();
        pm += predicted.dot(&measured);
        mm += measured.norm_squared();
    }
    (pp > 0.0 && mm > 0.0).then(|| (pm / pp, pm / (pp * mm).sqrt()))
}

/// Rate below which the sign of a joint's motion is not sure, rad/s or m/s.
const STANDSTILL: f64 = 0.05;

struct Carried {
    name: String,
    link: usize,
    prismatic: bool,
    axis: Vector3<f64>,
    q_offset: usize,
    v_offset: usize,
    /// Links that the joint carries, its own first.
    carried: Vec<usize>,
    /// First column of the joint in a frame's buffer.
    offset: usize,
}

struct Joints {
    list: Vec<Carried>,
    /// For each joint: where a link's ten columns begin within its part of the buffer.
    place: Vec<Vec<usize>>,
    width: usize,
}

impl Joints {
    fn of(model: &Model, robot: &RobotModel) -> Self {
        let (mut list, mut place, mut offset) = (Vec::new(), Vec::new(), 0);
        for joint in &robot.joints {
            let Some(link) = model.links.iter().position(|l| l.name == joint.link) else { continue };
            let own = &model.links[link].joint;
            let (prismatic, axis) = match own.kind {
                JointKind::Revolute(a) => (false, a.into_inner()),
                JointKind::Prismatic(a) => (true, a.into_inner()),
                _ => continue,
            };
            let mut below = vec![false; model.n_links()];
            below[link] = true;
            for (i, l) in model.links.iter().enumerate() {
                below[i] |= l.parent.is_some_and(|p| below[p]);
            }
            let carried: Vec<usize> = (0..below.len()).filter(|&i| below[i]).collect();
            let mut places = vec![0; model.n_links()];
            for (k, &l) in carried.iter().enumerate() {
                places[l] = 10 * k;
            }
            let width = 10 * carried.len();
            list.push(Carried {
                name: joint.name.clone(),
                link,
                prismatic,
                axis,
                q_offset: own.q_offset,
                v_offset: own.v_offset,
                carried,
                offset,
            });
            place.push(places);
            offset += width;
        }
        Self { list, place, width: offset }
    }
}

/// What the windows add up: for every frame and joint Sᵀh and Ṡᵀh, by columns of the links carried.
struct Frames {
    velocities: Vec<f64>,
    along: Vec<f64>,
    turning: Vec<f64>,
}

impl Frames {
    fn of(model: &Model, joints: &Joints, prior: &[Phi], motion: &Motion, start: usize, end: usize) -> Self {
        let n = end - start;
        let velocities = run_velocities(model, motion, start, end);
        let mut state = State::new(model);
        // a frame that falls with the body: position and velocity of the prior's centre of mass in
        // the middle, and gravity
        let middle = n / 2;
        state.forward_velocity(model, motion.q(start + middle), &velocities[middle * model.nv..][..model.nv]);
        let centre = state.center_of_mass(prior).1;
        let speed = state.center_of_mass_velocity(prior);
        let mut momentum = DMatrix::zeros(6, 10 * model.n_links());
        let mut along = vec![0.0; n * joints.width];
        let mut turning = vec![0.0; n * joints.width];
        for f in 0..n {
            let t = (f as f64 - middle as f64) / motion.rate_hz;
            let at = centre + speed * t + model.gravity_mps2 * (0.5 * t * t);
            let falling = speed + model.gravity_mps2 * t;
            let mut q = motion.q(start + f).to_vec();
            let mut v = velocities[f * model.nv..][..model.nv].to_vec();
            let turn = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(q[6], q[3], q[4], q[5]));
            let own = turn.inverse() * falling;
            for k in 0..3 {
                q[k] -= at[k];
                v[k] -= own[k];
            }
            state.forward_velocity(model, &q, &v);
            state.momentum_regressor(model, &Vector3::zeros(), &mut momentum);
            for (j, joint) in joints.list.iter().enumerate() {
                let (s, s_dot) = axis_in_world(&state, joint);
                let begin = f * joints.width + joint.offset;
                for &link in &joint.carried {
                    for c in 0..10 {
                        let h = momentum.fixed_view::<6, 1>(0, 10 * link + c);
                        let to = begin + joints.place[j][link] + c;
                        along[to] = s.dot(&h);
                        turning[to] = s_dot.dot(&h);
                    }
                }
            }
        }
        Self { velocities, along, turning }
    }
}

/// The joint's axis as a spatial vector about the world's origin, and its derivative.
fn axis_in_world(state: &State, joint: &Carried) -> (Vector6<f64>, Vector6<f64>) {
    let pose = &state.world_from_link[joint.link];
    let axis = pose.rotation * joint.axis;
    let twist = &state.velocity[joint.link];
    let omega = pose.rotation * Vector3::new(twist[3], twist[4], twist[5]);
    let turned = omega.cross(&axis);
    let join = |f: Vector3<f64>, m: Vector3<f64>| Vector6::new(f.x, f.y, f.z, m.x, m.y, m.z);
    if joint.prismatic {
        return (join(axis, Vector3::zeros()), join(turned, Vector3::zeros()));
    }
    let p = pose.translation.vector;
    let velocity = pose.rotation * Vector3::new(twist[0], twist[1], twist[2]);
    (join(-axis.cross(&p), axis), join(-(turned.cross(&p) + axis.cross(&velocity)), turned))
}
