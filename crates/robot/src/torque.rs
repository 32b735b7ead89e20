//! Rows of the joints' torques in flight: the lines of the equation of motion that the base rows
//! leave out (the paper's eq. 5 before they are dropped).
//!
//! For joint j with the world axis S(t) (a spatial vector), the momentum h of everything that it
//! carries, in a frame that falls with the body, where gravity vanishes:
//!
//! ```text
//!  −∫ (ψ̇ S + ψ Ṡ)ᵀ h dt + Ia ∫ψ̈ q dt − d ∫ψ̇ q dt + c ∫ψ sgn(q̇) dt
//!      =  (1 + κ) ∫ψ τ dt − δ ∫ψ̇ τ dt + ½ δ² ∫ψ̈ τ dt
//! ```
//!
//! with the torque τ at the motor's side, reflected inertia Ia, viscous friction d, Coulomb
//! friction c, the error κ of the torque's gain and its delay δ against the encoders (a drive that
//! holds its torque from step to step has one of half a step). As in the base's weak rows no
//! acceleration is formed. Rows are linear in φ, Ia, d, c and κ, and quadratic in δ. The same
//! regrouping into base parameters holds as for the base rows.
//!
//! Rows are weighted by a constant, the torque sensor's noise. With gains unknown, weights taken
//! from residuals would shrink every gain to zero.

use crate::joint_evidence::{WINDOW_S, moving};
use crate::model::{RobotJoint, RobotModel};
use aloft_body::{BaseParameters, JointKind, Model, Motion, Phi, State};
use aloft_effects::{EffectInstance, JointSeries, SURE_OF_SIGN, Scene, Target};
use aloft_regressor::test_function::MIN_HALF_WINDOW;
use aloft_regressor::{
    Columns, Factor, RegressorError, RowKind, Stretch, TestFunction, run_velocities, window_centres,
};
use faer::Mat;
use nalgebra::{DMatrix, DVector, Vector3, Vector6};

/// Names of a joint's unknowns, in the order of their columns.
pub const UNKNOWNS: [&str; 5] = ["armature", "damping", "friction", "gain_error", "delay"];

/// Place of the gain's error among them.
pub(crate) const GAIN: usize = 3;

/// Last parts of the names of the columns of the delay's square and cube ([`TorqueRows::bends`]).
pub(crate) const BEND: &str = "delay_squared";
const TWIST: &str = "delay_cubed";

/// Share of a joint's torque (root mean square over the stretch) by which a row may be wrong in any
/// case.
const MODEL_SHARE: f64 = 0.01;

/// Power of the test functions.
const POWER: u32 = 5;

/// Rate below which a joint may stick, rad/s (m/s).
const NEAR_REST: f64 = 2.0 * SURE_OF_SIGN;

/// Torques of a recording at the frames of its motion.
#[derive(Debug, Clone, Copy)]
pub struct Torques<'a> {
    /// `[joint][frame]`, N·m or N, NaN where missing; joints in the order of
    /// [`RobotModel::joints`].
    pub values: &'a [Vec<f64>],
    /// Standard deviation of one sample, as stated.
    pub sd_nm: f64,
    /// White noise of one sample that is in the torques themselves, by joint.
    pub white_nm: &'a [f64],
}

/// Effects of the model in the rows of torques.
#[derive(Debug, Clone, Copy, Default)]
pub struct TorqueEffects<'a> {
    /// Effects that are a change of the body's inertia: names and base parameters of a unit, none
    /// in recordings in which they do not act. They are columns of the base rows, too.
    pub carried: &'a [(String, Option<DVector<f64>>)],
    /// Laws of joints.
    pub joints: &'a [EffectInstance<'a>],
}

/// Factor of one flight from the torques of all joints; columns `[φ_B | carried | joint.armature …
/// | laws | joint.delay_squared … | τ]`. With it, for each joint, the sum over its rows of the variance that the torque's
/// noise has in a row.
///
/// Windows are those of the evidence of joints: short ones ([`WINDOW_S`]), and only where the joint
/// moves ([`moving`]). A joint that sticks has any torque up to its friction, which no column
/// describes: with all windows, Coulomb friction comes out too large and viscous friction too small
/// by several per cent, and the residuals are no noise of the sensor.
///
/// # Errors
/// [`RegressorError::TooShort`] if no window fits, [`RegressorError::Numeric`] for numbers that are
/// not finite.
pub fn torque_factor(
    robot: &RobotModel,
    base: &BaseParameters,
    source: TorqueSource<'_>,
    effects: TorqueEffects<'_>,
) -> Result<(Factor, Vec<f64>), RegressorError> {
    let stretch = source.stretch;
    let rows = TorqueRows::of(robot, source, WINDOW_S)?;
    let p = base.len();
    let extra = effects.carried.len() + UNKNOWNS.len() * rows.n_joints();
    let laws: Vec<Vec<(usize, DVector<f64>)>> = effects.joints.iter().map(|e| rows.law(e)).collect();
    let wide: usize = laws.iter().map(Vec::len).sum();
    let moving = moving(&rows);
    let first_row: Vec<usize> = (0..rows.n_joints()).map(|j| moving[..j].iter().map(Vec::len).sum()).collect();
    // a flight in which every joint rests keeps one row of zeros
    let height: usize = moving.iter().map(Vec::len).sum::<usize>().max(1);
    let mut whole = DMatrix::zeros(height, p + extra + wide + 2 * rows.n_joints() + 1);
    let weight = (rows.sensor_sd_nm() * rows.area_s()).recip();
    let mut left = Vec::new();
    for j in 0..rows.n_joints() {
        let mut put = |column: usize, values: &DVector<f64>| {
            for (row, (w, _)) in moving[j].iter().enumerate() {
                whole[(first_row[j] + row, column)] = weight * values[*w];
            }
        };
        let body = rows.body(j, base);
        (0..p).for_each(|c| put(c, &body.column(c).into_owned()));
        for (c, (_, change)) in effects.carried.iter().enumerate() {
            if let Some(change) = change {
                put(p + c, &(&body * change));
            }
        }
        for (k, column) in rows.own(j).iter().enumerate() {
            put(p + effects.carried.len() + UNKNOWNS.len() * j + k, column);
        }
        for (c, (joint, column)) in laws.iter().flatten().enumerate() {
            if *joint == j {
                put(p + extra + c, column);
            }
        }
        for (k, column) in rows.bends(j).iter().enumerate() {
            put(p + extra + wide + 2 * j + k, column);
        }
        put(p + extra + wide + 2 * rows.n_joints(), &rows.measured(j));
        // what reversals add to the rows is taken out of them
        let own = first_row[j]..first_row[j] + moving[j].len();
        let at: Vec<usize> = moving[j].iter().map(|m| m.0).collect();
        let unknown = orthonormal(&rows.reversals(j).select_rows(&at));
        let mut part = whole.rows_mut(own.start, own.len());
        let along = unknown.transpose() * &part;
        part -= &unknown * along;
        let noise = rows.noise_correlation().select_rows(&at).select_columns(&at);
        left.push(at.len() as f64 - (unknown.transpose() * noise * &unknown).trace());
    }
    let carried = effects.carried.iter().map(|c| c.0.clone());
    let own = rows.joints.list.iter().flat_map(|j| UNKNOWNS.iter().map(move |u| format!("{}.{u}", j.name)));
    let names = effects.joints.iter().flat_map(|e| e.names(source.scene));
    let bends = rows.joints.list.iter().flat_map(|j| [BEND, TWIST].map(|bend| format!("{}.{bend}", j.name)));
    let columns = Columns {
        parameters: base.parameters.iter().map(|b| b.name.clone()).collect(),
        effects: carried.chain(own).chain(names).chain(bends).collect(),
        of_tables: Vec::new(),
    };
    let matrix = Mat::from_fn(whole.nrows(), whole.ncols(), |i, k| whole[(i, k)]);
    let factor = Factor::from_rows(stretch, RowKind::Weak, columns, matrix.as_ref())?;
    let share = |j: usize| (source.torques.white_nm.get(j).copied().unwrap_or(0.0) / source.torques.sd_nm).powi(2);
    let noise = left.iter().enumerate().map(|(j, rows)| share(j) * rows).collect();
    Ok((factor, noise))
}

/// Everything that the rows of one flight's torques are formed from.
#[derive(Debug, Clone, Copy)]
pub struct TorqueSource<'a> {
    /// The body with the names of its joints.
    pub scene: &'a Scene,
    /// Motion of the recording.
    pub motion: &'a Motion,
    /// The flight.
    pub stretch: &'a Stretch,
    /// Torques at the frames of the motion.
    pub torques: Torques<'a>,
}

/// Rows of one flight, joint by joint: windows × columns, in N·m·s.
#[derive(Debug)]
pub struct TorqueRows {
    joints: Joints,
    frames: Frames,
    test: TestFunction,
    centres: Vec<usize>,
    n_links: usize,
    rate_hz: f64,
    /// `[joint][frame of the flight]`.
    q: Vec<Vec<f64>>,
    v: Vec<Vec<f64>>,
    torque: Vec<Vec<f64>>,
    sd_nm: f64,
}

impl TorqueRows {
    /// Rows with windows of a length.
    ///
    /// # Errors
    /// As [`torque_factor`].
    pub fn of(robot: &RobotModel, source: TorqueSource<'_>, window_s: f64) -> Result<Self, RegressorError> {
        let TorqueSource { scene, motion, stretch, torques } = source;
        let model = &scene.model;
        let (start, end) = (stretch.first_frame, stretch.end_frame);
        let n = end - start;
        let joints = Joints::of(model, robot);
        let half = ((window_s * motion.rate_hz / 2.0).round() as usize).saturating_sub(4).max(MIN_HALF_WINDOW);
        let test = TestFunction::new(half, POWER, motion.rate_hz)?;
        let hop = ((0.25 * test.length_s() * motion.rate_hz) as usize).max(1);
        // three frames at both ends have velocities of lower order
        let centres = window_centres(3, n.saturating_sub(3), half, hop);
        let measured = |t: &Vec<f64>| t.get(start..end).is_some_and(|t| t.iter().all(|x| x.is_finite()));
        let usable = (start..end).all(|f| motion.is_valid(f))
            && torques.values.len() == joints.list.len()
            && torques.values.iter().all(measured);
        if centres.is_empty() || !usable {
            return Err(RegressorError::TooShort {
                trial: stretch.trial.clone(),
                stretch: stretch.index,
                frames: n,
                needed: test.n_frames() + 6,
            });
        }
        let frames = Frames::of(model, &joints, &scene.phi, motion, start, end);
        let q = joints.list.iter().map(|j| (start..end).map(|f| motion.q(f)[j.q_offset]).collect()).collect();
        let rate = |j: &Carried| (0..n).map(|f| frames.velocities[f * model.nv + j.v_offset]).collect();
        let v = joints.list.iter().map(rate).collect();
        let torque = torques.values.iter().map(|t| t[start..end].to_vec()).collect();
        let (n_links, rate_hz) = (model.n_links(), motion.rate_hz);
        Ok(Self { joints, frames, test, centres, n_links, rate_hz, q, v, torque, sd_nm: torques.sd_nm })
    }

    /// Number of joints.
    pub fn n_joints(&self) -> usize {
        self.joints.list.len()
    }

    /// Number of windows, which are the rows of each joint.
    pub fn n_windows(&self) -> usize {
        self.centres.len()
    }

    /// Name of a joint, and the index of the link that it carries.
    pub fn joint(&self, j: usize) -> (&str, usize) {
        (&self.joints.list[j].name, self.joints.list[j].link)
    }

    /// Coordinate, rate and torque of a joint.
    pub fn series(&self, j: usize) -> JointSeries<'_> {
        JointSeries { rate_hz: self.rate_hz, q: &self.q[j], v: &self.v[j], torque: &self.torque[j] }
    }

    /// Sums over the windows of what `of` gives for a frame and the test function's values there.
    fn sums(&self, of: impl Fn(usize, [f64; 3]) -> f64) -> DVector<f64> {
        let half = self.test.n_frames() / 2;
        let window = |centre: &usize| -> f64 {
            (0..self.test.n_frames())
                .map(|i| of(centre - half + i, [self.test.psi[i], self.test.psi_dot[i], self.test.psi_ddot[i]]))
                .sum()
        };
        DVector::from_iterator(self.centres.len(), self.centres.iter().map(window))
    }

    /// Columns of the base parameters.
    pub fn body(&self, j: usize, base: &BaseParameters) -> DMatrix<f64> {
        self.links(j) * &base.to_full
    }

    /// Columns of φ of all links, ten a link.
    pub fn links(&self, j: usize) -> DMatrix<f64> {
        let joint = &self.joints.list[j];
        let half = self.test.n_frames() / 2;
        let mut full = DMatrix::zeros(self.centres.len(), 10 * self.n_links);
        for (w, centre) in self.centres.iter().enumerate() {
            for i in 0..self.test.n_frames() {
                let (psi, psi_dot) = (self.test.psi[i], self.test.psi_dot[i]);
                let begin = (centre - half + i) * self.joints.width + joint.offset;
                for &link in &joint.carried {
                    let from = begin + self.joints.place[j][link];
                    for c in 0..10 {
                        full[(w, 10 * link + c)] -=
                            psi_dot * self.frames.along[from + c] + psi * self.frames.turning[from + c];
                    }
                }
            }
        }
        full
    }

    /// Columns of the joint's own unknowns ([`UNKNOWNS`]).
    pub fn own(&self, j: usize) -> [DVector<f64>; 5] {
        let (q, v, torque) = (&self.q[j], &self.v[j], &self.torque[j]);
        [
            self.sums(|f, [_, _, bend]| bend * q[f]),
            self.sums(|f, [_, slope, _]| -slope * q[f]),
            self.sums(|f, [psi, _, _]| psi * (v[f] / SURE_OF_SIGN).tanh()),
            self.sums(|f, [psi, _, _]| -psi * torque[f]),
            self.sums(|f, [_, slope, _]| slope * torque[f]),
        ]
    }

    /// Columns of half the square and of a sixth of the cube of the delay: what the first order of
    /// the delay leaves out.
    pub fn bends(&self, j: usize) -> [DVector<f64>; 2] {
        let torque = &self.torque[j];
        let half = self.test.half;
        let reach_s = self.test.length_s() / 2.0;
        let third = |i: usize| {
            let x = self.test.time_s(i) / reach_s;
            let u = 1.0 - x * x;
            (240.0 * x * u.powi(3) - 480.0 * x.powi(3) * u * u) * self.test.step_s / reach_s.powi(3)
        };
        let third: Vec<f64> = (0..self.test.n_frames()).map(third).collect();
        let window = |centre: &usize| third.iter().enumerate().map(|(i, w)| w * torque[centre - half + i]).sum::<f64>();
        [
            self.sums(|f, [_, _, bend]| -bend * torque[f]),
            DVector::from_iterator(self.centres.len(), self.centres.iter().map(window)),
        ]
    }

    /// What an impulse at each reversal of the joint adds to its rows, windows × reversals.
    ///
    /// Around a reversal the friction is not that of its law: it turns over a short way, a sampled
    /// torque shows the jump up to one frame late, and noise of the encoder moves the instant at
    /// which the rate changes its sign. All this is short against a window, so that it acts as an
    /// impulse of unknown size.
    fn reversals(&self, j: usize) -> DMatrix<f64> {
        let v = &self.v[j];
        let at: Vec<f64> = (1..v.len())
            .filter(|&f| (v[f] > 0.0) != (v[f - 1] > 0.0))
            .map(|f| f as f64 - v[f] / (v[f] - v[f - 1]))
            .collect();
        let reach = (self.test.half + 1) as f64;
        DMatrix::from_fn(self.centres.len(), at.len(), |w, k| {
            let x = (at[k] - self.centres[w] as f64) / reach;
            (1.0 - x * x).max(0.0).powi(POWER as i32)
        })
    }

    /// Correlation of the noise of rows, which overlap.
    fn noise_correlation(&self) -> DMatrix<f64> {
        let psi = &self.test.psi;
        let at = |shift: usize| psi.iter().skip(shift).zip(psi).map(|(a, b)| a * b).sum::<f64>();
        let n = self.centres.len();
        DMatrix::from_fn(n, n, |a, b| at(self.centres[a].abs_diff(self.centres[b])) / at(0))
    }

    /// Share of each window in which the joint is near rest. There its friction is that of
    /// sticking, which no rate determines.
    pub fn at_rest(&self, j: usize) -> DVector<f64> {
        let v = &self.v[j];
        self.sums(|f, [psi, _, _]| if v[f].abs() < NEAR_REST { psi } else { 0.0 }) / self.area_s()
    }

    /// The measured torque.
    pub fn measured(&self, j: usize) -> DVector<f64> {
        self.column(&self.torque[j])
    }

    /// A torque given at the frames of the flight.
    pub fn column(&self, values: &[f64]) -> DVector<f64> {
        self.sums(|f, [psi, _, _]| psi * values.get(f).copied().unwrap_or(0.0))
    }

    /// Columns of an effect, each with the index of its joint; none if it acts on no joint.
    pub fn law(&self, effect: &EffectInstance<'_>) -> Vec<(usize, DVector<f64>)> {
        let Target::Joint(link) = effect.target else { return Vec::new() };
        let Some(j) = self.joints.list.iter().position(|joint| joint.link == link) else { return Vec::new() };
        effect.effect.torque(&self.series(j), &effect.nonlinear).iter().map(|c| (j, self.column(c))).collect()
    }

    /// Integral of the test function, s: rows over it are torques.
    pub fn area_s(&self) -> f64 {
        self.test.integral_s()
    }

    /// Weight of each row: the sensor's noise, and a share of the torque's own size.
    pub fn weights(&self, j: usize) -> DVector<f64> {
        let area = self.area_s();
        let torque = &self.torque[j];
        let squares = self.sums(|f, [psi, _, _]| psi * torque[f] * torque[f]);
        let sensor = self.sensor_sd_nm();
        squares.map(|s| {
            let size = MODEL_SHARE * (s / area).sqrt();
            (sensor * sensor + size * size).sqrt().recip() / area
        })
    }

    /// Standard deviation of a row, as a torque, that the torque sensor's noise causes, N·m.
    pub fn sensor_sd_nm(&self) -> f64 {
        let noise: f64 = self.test.psi.iter().map(|p| p * p).sum();
        self.sd_nm * noise.sqrt() / self.area_s()
    }
}

/// Orthonormal basis of the columns of a matrix.
fn orthonormal(columns: &DMatrix<f64>) -> DMatrix<f64> {
    let mut out: Vec<DVector<f64>> = Vec::new();
    for column in columns.column_iter() {
        let size = column.norm();
        let mut rest = column.into_owned();
        // twice: the second pass removes rounding errors
        for _ in 0..2 {
            for unit in &out {
                let along = unit.dot(&rest);
                rest.axpy(-along, unit, 1.0);
            }
        }
        if rest.norm() > 1e-3 * size && size > 1e-6 {
            out.push(rest.normalize());
        }
    }
    if out.is_empty() { DMatrix::zeros(columns.nrows(), 0) } else { DMatrix::from_columns(&out) }
}

/// The model's values before identification: its base parameters, and what its file says of joints.
fn nominal(robot: &RobotModel, base: &BaseParameters, prior: &[Phi], factors: &[Factor]) -> Option<DVector<f64>> {
    let p = base.len();
    // unknowns of effects are zero: a wrong unit shows without them
    let columns = &factors.first()?.columns;
    let mut x = DVector::zeros(columns.len() - 1);
    x.rows_mut(0, p).copy_from(&base.regroup(prior));
    for joint in &robot.joints {
        let first = first_of(joint, p, columns)?;
        (x[first], x[first + 1], x[first + 2]) = (joint.armature, joint.damping, joint.friction);
    }
    Some(x)
}

/// Place of the first of a joint's unknowns among the columns.
fn first_of(joint: &RobotJoint, p: usize, columns: &Columns) -> Option<usize> {
    let first = format!("{}.{}", joint.name, UNKNOWNS[0]);
    Some(p + columns.effects.iter().position(|n| *n == first)?)
}

/// How large measured torques are against what a model needs for the same motion: slope and
/// correlation over all rows. A slope far from 1 is another unit or the opposite sign. None without
/// rows.
pub fn size(robot: &RobotModel, base: &BaseParameters, prior: &[Phi], factors: &[Factor]) -> Option<(f64, f64)> {
    let x = nominal(robot, base, prior, factors)?;
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

/// The torque that a model needs in each joint as a multiple of the measured one (regression over
/// the rows of the joint), in the order of the joints: about 1, negative where the measured one has
/// the opposite sign. NaN for a joint without torques; empty without rows.
pub fn needed_of_measured(robot: &RobotModel, base: &BaseParameters, prior: &[Phi], factors: &[Factor]) -> Vec<f64> {
    let Some(x) = nominal(robot, base, prior, factors) else { return Vec::new() };
    let mut sums = vec![(0.0, 0.0); robot.joints.len()];
    for factor in factors.iter().filter(|f| f.columns.len() == x.len() + 1) {
        let r = factor.dense();
        let predicted = r.columns(0, x.len()) * &x;
        for (joint, (pm, mm)) in robot.joints.iter().zip(&mut sums) {
            let Some(first) = first_of(joint, base.len(), &factor.columns) else { continue };
            // the column of the gain's error is the measured torque in the rows of its joint
            let measured = -r.column(first + GAIN);
            *pm += predicted.dot(&measured);
            *mm += measured.norm_squared();
        }
    }
    sums.into_iter().map(|(pm, mm)| pm / mm).collect()
}

#[derive(Debug)]
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

#[derive(Debug)]
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
#[derive(Debug)]
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
        let centre = state.centre_of_mass(prior).1;
        let speed = state.centre_of_mass_velocity(prior);
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
