//! Input data of effects for one trial: kinematics of every link in the frames that give rows, and
//! the measurements of the plates.
//!
//! Velocities and accelerations come from local cubics through the unfiltered coordinates (on the
//! manifold; the root's path in the world), over ±25 ms for velocities and ±50 ms for
//! accelerations, one-sided near gaps. The error of a column due to marker noise is then far below
//! the column itself (0.3 mm of noise at 200 Hz give about 10 mm/s, compared with metres per
//! second), so attenuation by errors in variables stays below 10⁻⁴ of a drag coefficient, and no
//! filter spreads the impact of a landing into the flight.

use crate::{EffectsError, Scene};
use aloft_body::rotation::quaternion_log;
use aloft_body::{BaseParameters, JointKind, Model, Motion, State};
use nalgebra::{DMatrix, DVector, Matrix3, Quaternion, UnitQuaternion, Vector3};

/// Wrench of one plate at the frames of the motion, on the body, world axes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlateSeries {
    /// Force, N.
    pub force_n: Vec<Vector3<f64>>,
    /// Moment about the world origin, N·m.
    pub moment_nm: Vec<Vector3<f64>>,
}

/// Frames that give rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Span {
    /// First frame.
    pub first_frame: usize,
    /// One past the last frame.
    pub end_frame: usize,
    /// True in flight.
    pub flight: bool,
}

/// A trial.
#[derive(Debug, Clone, Copy)]
pub struct TrialMotion<'a> {
    /// Unfiltered motion.
    pub motion: &'a Motion,
    /// Flights and contact stretches, in order.
    pub spans: &'a [Span],
    /// Plates, in the order of [`Scene::plate_centres_m`]; empty without measurements.
    pub plates: &'a [PlateSeries],
    /// Seconds from the start of the session to the first frame (0 if unknown).
    pub session_time_s: f64,
}

/// Kinematics of one link at one instant, world axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkFrame {
    /// Position of the origin, m.
    pub origin: Vector3<f64>,
    /// Rotation of the link in the world.
    pub rotation: Matrix3<f64>,
    /// Velocity of the origin, m/s.
    pub velocity: Vector3<f64>,
    /// Angular velocity, rad/s.
    pub omega: Vector3<f64>,
    /// Acceleration of the origin without gravity, m/s².
    pub acceleration: Vector3<f64>,
    /// Angular acceleration, rad/s².
    pub alpha: Vector3<f64>,
}

impl LinkFrame {
    /// World position of a point of the link.
    #[inline]
    pub fn point(&self, in_link: &Vector3<f64>) -> Vector3<f64> {
        self.origin + self.rotation * in_link
    }
    /// Velocity of a point of the link.
    #[inline]
    pub fn point_velocity(&self, in_link: &Vector3<f64>) -> Vector3<f64> {
        self.velocity + self.omega.cross(&(self.rotation * in_link))
    }
    /// Acceleration of a point of the link.
    #[inline]
    pub fn point_acceleration(&self, in_link: &Vector3<f64>) -> Vector3<f64> {
        let arm = self.rotation * in_link;
        self.acceleration + self.alpha.cross(&arm) + self.omega.cross(&self.omega.cross(&arm))
    }
}

/// Wrench of one plate and its rate at one instant.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PlateFrame {
    /// Force, N, world.
    pub force_n: Vector3<f64>,
    /// Moment about the world origin, N·m.
    pub moment_nm: Vector3<f64>,
    /// Rate of the force, N/s.
    pub force_rate: Vector3<f64>,
    /// Rate of the moment, N·m/s.
    pub moment_rate: Vector3<f64>,
}

/// One instant of a trial.
#[derive(Debug, Clone, Copy)]
pub struct EffectFrame<'a> {
    /// The constants of the scene.
    pub scene: &'a Scene,
    /// Links, in the model's order.
    pub links: &'a [LinkFrame],
    /// Plates; empty without measurements.
    pub plates: &'a [PlateFrame],
    /// Coordinates.
    pub q: &'a [f64],
    /// Velocities in the model's order.
    pub v: &'a [f64],
    /// Index of the frame in the motion.
    pub frame: usize,
    /// Seconds since the first frame of the recording.
    pub time_s: f64,
    /// Seconds since the session began.
    pub session_time_s: f64,
    /// Seconds since the stretch began.
    pub since_start_s: f64,
    /// Seconds until the stretch ends.
    pub to_end_s: f64,
    /// True in flight.
    pub flight: bool,
    /// Centre of mass, world, m.
    pub com: Vector3<f64>,
    /// Velocity of the centre of mass, m/s.
    pub com_velocity: Vector3<f64>,
    /// Acceleration of the centre of mass, m/s².
    pub com_acceleration: Vector3<f64>,
}

impl EffectFrame<'_> {
    /// Seconds since take-off (release); zero in contact.
    pub fn since_take_off_s(&self) -> f64 {
        if self.flight { self.since_start_s } else { 0.0 }
    }
    /// Seconds since the stretch of contact began; zero in flight.
    pub fn since_touch_down_s(&self) -> f64 {
        if self.flight { 0.0 } else { self.since_start_s }
    }
}

/// All frames of a trial that give rows.
#[derive(Debug, Clone)]
pub struct Series<'a> {
    /// The constants of the scene.
    pub scene: &'a Scene,
    /// Name of the trial.
    pub trial: String,
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    frames: Vec<usize>,
    spans: Vec<(usize, usize, Span)>,
    span_of: Vec<usize>,
    states: States,
    /// For each span: the frames before it, without a gap.
    lead_in: Vec<States>,
    plates: Vec<PlateFrame>,
    session_time_s: f64,
}

/// Kinematics of the body in some frames.
#[derive(Debug, Clone, Default)]
struct States {
    links: Vec<LinkFrame>,
    /// Position, velocity and acceleration of the centre of mass.
    coms: Vec<[Vector3<f64>; 3]>,
    q: Vec<f64>,
    v: Vec<f64>,
}

impl States {
    fn push(&mut self, scene: &Scene, state: &State, q: &[f64], v: &[f64]) {
        let first = self.links.len();
        self.links.extend(link_frames(state));
        let mut com = [Vector3::zeros(); 3];
        for ((link, phi), c) in self.links[first..].iter().zip(&scene.phi).zip(&scene.link_com_m) {
            com[0] += link.point(c) * phi[0];
            com[1] += link.point_velocity(c) * phi[0];
            com[2] += link.point_acceleration(c) * phi[0];
        }
        self.coms.push(com.map(|x| x / scene.mass_kg));
        self.q.extend_from_slice(q);
        self.v.extend_from_slice(v);
    }

    fn len(&self) -> usize {
        self.coms.len()
    }
}

/// Half windows of the local cubics, s.
const VELOCITY_REACH_S: f64 = 0.025;
const ACCELERATION_REACH_S: f64 = 0.05;
/// Length of the interval before a span that is known, s: the longest delay of a law.
pub const LEAD_IN_S: f64 = 0.4;

impl<'a> Series<'a> {
    /// Kinematics of all valid frames in the spans of a trial.
    ///
    /// # Errors
    /// [`EffectsError::Length`] if motion or plates do not fit the model or each other.
    pub fn new(scene: &'a Scene, trial: &TrialMotion<'_>) -> Result<Self, EffectsError> {
        let (model, motion) = (&scene.model, trial.motion);
        let length = |what, expected, found| {
            if expected == found {
                Ok(())
            } else {
                Err(EffectsError::Length { trial: motion.trial.clone(), what, expected, found })
            }
        };
        length("coordinates a frame", model.nq, motion.nq)?;
        length("links of the parameters", model.n_links(), scene.phi.len())?;
        if !trial.plates.is_empty() {
            length("plates", scene.n_plates(), trial.plates.len())?;
        }
        for plate in trial.plates {
            length("frames of a plate", motion.n_frames(), plate.force_n.len())?;
            length("frames of a plate", motion.n_frames(), plate.moment_nm.len())?;
        }
        let mut out = Self {
            scene,
            trial: motion.trial.clone(),
            rate_hz: motion.rate_hz,
            frames: Vec::new(),
            spans: Vec::new(),
            span_of: Vec::new(),
            states: States::default(),
            lead_in: Vec::new(),
            plates: Vec::new(),
            session_time_s: trial.session_time_s,
        };
        let mut differentiator = Differentiator::new(model, motion);
        let mut state = State::new(model);
        for span in trial.spans {
            let start = out.frames.len();
            let mut lead_in = States::default();
            let reach = (LEAD_IN_S * motion.rate_hz).round() as usize;
            for frame in span.first_frame.saturating_sub(reach)..span.first_frame.min(motion.n_frames()) {
                match differentiator.at(frame).filter(|_| motion.is_valid(frame)) {
                    Some((v, a)) => {
                        state.forward_acceleration(model, motion.q(frame), v, a);
                        lead_in.push(scene, &state, motion.q(frame), v);
                    }
                    None => lead_in = States::default(),
                }
            }
            out.lead_in.push(lead_in);
            for frame in span.first_frame..span.end_frame.min(motion.n_frames()) {
                if !motion.is_valid(frame) {
                    continue;
                }
                let Some((v, a)) = differentiator.at(frame) else { continue };
                state.forward_acceleration(model, motion.q(frame), v, a);
                out.states.push(scene, &state, motion.q(frame), v);
                for plate in trial.plates {
                    out.plates.push(plate_frame(plate, frame, motion.rate_hz));
                }
                out.frames.push(frame);
                out.span_of.push(out.spans.len());
            }
            out.spans.push((start, out.frames.len(), *span));
        }
        Ok(out)
    }

    /// Sets the centre of mass from identified base parameters (the mass first) instead of the
    /// scene's φ; its velocity and acceleration are unchanged. Values that do not fit the model are
    /// ignored.
    pub fn set_centre_of_mass(&mut self, base: &BaseParameters, values: &[f64]) {
        let model = &self.scene.model;
        if base.len() != values.len() || base.from_full.ncols() != 10 * model.n_links() || values[0] <= 0.0 {
            return;
        }
        let mut state = State::new(model);
        let mut rows = DMatrix::zeros(3, base.len());
        for states in std::iter::once(&mut self.states).chain(&mut self.lead_in) {
            for (q, com) in states.q.chunks_exact(model.nq).zip(&mut states.coms) {
                state.forward_position(model, q);
                let origin = state.world_from_link[0].translation.vector;
                state.first_moment_rows(base, &origin, &mut rows);
                let moment =
                    Vector3::from_fn(|axis, _| (0..values.len()).map(|j| rows[(axis, j)] * values[j]).sum::<f64>());
                com[0] = origin + moment / values[0];
            }
        }
    }

    /// Number of frames.
    #[inline]
    pub fn len(&self) -> usize {
        self.frames.len()
    }
    /// True without frames.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }
    /// Frames of the motion, one for each frame of the series.
    #[inline]
    pub fn motion_frames(&self) -> &[usize] {
        &self.frames
    }
    /// First and end index (in the series) of each span.
    pub fn spans(&self) -> impl Iterator<Item = (usize, usize, Span)> + '_ {
        self.spans.iter().copied()
    }
    /// Index in the series of a frame of the motion.
    #[inline]
    pub fn index_of(&self, frame: usize) -> Option<usize> {
        // none: a frame without motion has no index
        self.frames.binary_search(&frame).ok()
    }
    /// Runs of consecutive frames inside spans, as index ranges of the series.
    pub fn runs(&self) -> Vec<std::ops::Range<usize>> {
        let mut out: Vec<std::ops::Range<usize>> = Vec::new();
        for i in 0..self.len() {
            match out.last_mut() {
                Some(run)
                    if run.end == i
                        && self.frames[i] == self.frames[i - 1] + 1
                        && self.span_of[i] == self.span_of[i - 1] =>
                {
                    run.end = i + 1;
                }
                _ => out.push(i..i + 1),
            }
        }
        out
    }
    /// Links in the valid frames (up to 0.4 s) before frame `i` of the series if a span begins
    /// there, oldest first; empty elsewhere.
    pub fn lead_in(&self, i: usize) -> impl DoubleEndedIterator<Item = &[LinkFrame]> {
        let span = self.span_of[i];
        let (start, _, stretch) = self.spans[span];
        let begins = start == i && self.frames[i] == stretch.first_frame;
        let found: &[LinkFrame] = if begins { &self.lead_in[span].links } else { &[] };
        found.chunks_exact(self.scene.model.n_links())
    }
    /// Links in frame `i` of the series.
    pub fn links(&self, i: usize) -> &[LinkFrame] {
        let n = self.scene.model.n_links();
        &self.states.links[i * n..(i + 1) * n]
    }
    /// The two known frames between which the body was `delay_s` before frame `i` of the series,
    /// with their shares. What was before the span is known for up to [`LEAD_IN_S`], as far as no
    /// frame is missing there; before the first frame that is known, it is that frame. Frames
    /// before the span have no plates and no times since take-off or touch-down.
    pub fn earlier(&self, i: usize, delay_s: f64) -> [(EffectFrame<'_>, f64); 2] {
        // NaN counts as no delay
        let delay_s = if delay_s > 0.0 { delay_s.min(LEAD_IN_S) } else { 0.0 };
        let wanted = self.frames[i] as f64 - delay_s * self.rate_hz;
        let span = self.span_of[i];
        let (start, _, stretch) = self.spans[span];
        let lead_in = &self.lead_in[span];
        let (n, first) = (lead_in.len(), stretch.first_frame - lead_in.len());
        // known frames are counted from the first one before the span
        let newer = if n > 0 && wanted <= (stretch.first_frame - 1) as f64 {
            (wanted.ceil() - first as f64).max(0.0) as usize
        } else {
            n + self.frames[start..i].partition_point(|f| (*f as f64) < wanted)
        };
        let at = |k: usize| {
            if k >= n {
                return self.frame(start + k - n);
            }
            self.instant(lead_in, k, first + k, &[], Span { flight: false, first_frame: first + k, ..stretch })
        };
        let after = at(newer);
        let before = if newer > 0 && after.frame as f64 > wanted { at(newer - 1) } else { after };
        let apart = (after.frame - before.frame) as f64;
        let share = if apart > 0.0 { (wanted - before.frame as f64) / apart } else { 0.0 };
        [(before, 1.0 - share), (after, share)]
    }
    /// All frames of the series with their indices, which are those of the columns.
    pub fn instants(&self) -> impl Iterator<Item = (usize, EffectFrame<'_>)> {
        (0..self.len()).map(|i| (i, self.frame(i)))
    }
    /// Frame `i` of the series.
    #[inline]
    pub fn frame(&self, i: usize) -> EffectFrame<'_> {
        let p = if self.frames.is_empty() { 0 } else { self.plates.len() / self.frames.len() };
        let span = self.spans[self.span_of[i]].2;
        self.instant(&self.states, i, self.frames[i], &self.plates[i * p..(i + 1) * p], span)
    }
    /// Entry `i` of some frames, which is `frame` of the motion.
    #[inline]
    fn instant<'s>(
        &'s self,
        states: &'s States,
        i: usize,
        frame: usize,
        plates: &'s [PlateFrame],
        span: Span,
    ) -> EffectFrame<'s> {
        let model = &self.scene.model;
        let n = model.n_links();
        let time_s = frame as f64 / self.rate_hz;
        EffectFrame {
            scene: self.scene,
            links: &states.links[i * n..(i + 1) * n],
            plates,
            q: &states.q[i * model.nq..(i + 1) * model.nq],
            v: &states.v[i * model.nv..(i + 1) * model.nv],
            frame,
            time_s,
            session_time_s: self.session_time_s + time_s,
            since_start_s: (frame - span.first_frame) as f64 / self.rate_hz,
            to_end_s: (span.end_frame - 1).saturating_sub(frame) as f64 / self.rate_hz,
            flight: span.flight,
            com: states.coms[i][0],
            com_velocity: states.coms[i][1],
            com_acceleration: states.coms[i][2],
        }
    }
}

/// Kinematics of all links of a state.
fn link_frames(state: &State) -> impl Iterator<Item = LinkFrame> + '_ {
    state.world_from_link.iter().enumerate().map(|(i, pose)| {
        let rotation = *state.rotation(i);
        let zero = Vector3::zeros();
        let part = |x: &nalgebra::Vector6<f64>| Vector3::new(x[3], x[4], x[5]);
        LinkFrame {
            origin: pose.translation.vector,
            rotation,
            velocity: state.point_velocity_in_world(i, &zero),
            omega: rotation * part(&state.velocity[i]),
            acceleration: state.point_acceleration_in_world(i, &zero),
            alpha: rotation * part(&state.acceleration[i]),
        }
    })
}

fn plate_frame(plate: &PlateSeries, frame: usize, rate_hz: f64) -> PlateFrame {
    let rate = |x: &[Vector3<f64>]| -> Vector3<f64> {
        let at = |k: isize| frame.checked_add_signed(k).and_then(|f| x.get(f)).copied();
        match (at(-2), at(-1), at(1), at(2)) {
            // of fourth order: a straight line through five samples loses 2 % of the rate at 6 Hz
            // and 200 samples a second, and a delay comes out too large by as much. Noise of the
            // plates averages out in the windows of the rows
            (Some(a), Some(b), Some(c), Some(d)) => ((a - d) + (c - b) * 8.0) * (rate_hz / 12.0),
            (_, Some(b), Some(c), _) => (c - b) * (rate_hz / 2.0),
            _ => Vector3::repeat(f64::NAN),
        }
    };
    let finite = |x: Vector3<f64>| if x.iter().all(|v| v.is_finite()) { x } else { Vector3::zeros() };
    PlateFrame {
        force_n: plate.force_n[frame],
        moment_nm: plate.moment_nm[frame],
        force_rate: finite(rate(&plate.force_n)),
        moment_rate: finite(rate(&plate.moment_nm)),
    }
}

/// Velocities and accelerations of a motion from local cubics.
struct Differentiator<'a> {
    model: &'a Model,
    motion: &'a Motion,
    valid: Vec<bool>,
    /// Of each link with a rotation of three degrees of freedom: first of its velocities, and its
    /// rotation in every frame.
    rotations: Vec<(usize, Vec<UnitQuaternion<f64>>)>,
    /// Velocity and coordinate of each joint of one degree of freedom.
    scalars: Vec<(usize, usize)>,
    reach: [usize; 2],
    central: [(Vec<f64>, Vec<f64>); 2],
    v: Vec<f64>,
    a: Vec<f64>,
}

/// Weights of samples at `t` for the first and second derivative at zero of a least-squares
/// polynomial.
fn derivative_weights(t: &[f64], degree: usize) -> Option<(Vec<f64>, Vec<f64>)> {
    let scale = t.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    if t.len() < degree + 2 || scale == 0.0 {
        return None;
    }
    let powers = DMatrix::from_fn(t.len(), degree + 1, |i, j| (t[i] / scale).powi(j as i32));
    let normal = powers.tr_mul(&powers).cholesky()?;
    let row = |k: usize| -> DVector<f64> {
        let mut unit = DVector::zeros(degree + 1);
        unit[k] = 1.0;
        &powers * normal.solve(&unit)
    };
    let first = row(1) / scale;
    let second = row(2) * (2.0 / (scale * scale));
    Some((first.as_slice().to_vec(), second.as_slice().to_vec()))
}

impl<'a> Differentiator<'a> {
    fn new(model: &'a Model, motion: &'a Motion) -> Self {
        let reach =
            [VELOCITY_REACH_S, ACCELERATION_REACH_S].map(|s| ((s * motion.rate_hz).round() as usize).clamp(3, 60));
        let central = reach.map(|h| {
            let t: Vec<f64> = (0..=2 * h).map(|i| (i as f64 - h as f64) / motion.rate_hz).collect();
            derivative_weights(&t, 3).unwrap_or_default()
        });
        let valid = (0..motion.n_frames()).map(|f| motion.is_valid(f)).collect();
        let (mut rotations, mut scalars) = (Vec::new(), Vec::new());
        for joint in model.links.iter().map(|l| &l.joint) {
            let of = |first: usize| (0..motion.n_frames()).map(|f| rotation_of(motion.q(f), first)).collect();
            match joint.kind {
                JointKind::Free => rotations.push((joint.v_offset + 3, of(joint.q_offset + 3))),
                JointKind::Spherical => rotations.push((joint.v_offset, of(joint.q_offset))),
                JointKind::Revolute(_) | JointKind::Prismatic(_) => scalars.push((joint.v_offset, joint.q_offset)),
                JointKind::Fixed => {}
            }
        }
        let (v, a) = (vec![0.0; model.nv], vec![0.0; model.nv]);
        Self { model, motion, valid, rotations, scalars, reach, central, v, a }
    }

    /// Frames up to `reach` from one.
    fn window(&self, frame: usize, reach: usize) -> std::ops::Range<usize> {
        frame.saturating_sub(reach)..(frame + reach + 1).min(self.motion.n_frames())
    }

    /// Velocities and accelerations; `None` if too few frames are valid.
    fn at(&mut self, frame: usize) -> Option<(&[f64], &[f64])> {
        let here = self.motion.q(frame);
        let free_root = self.model.links.first().is_some_and(|l| l.joint.kind == JointKind::Free);
        let widest = self.window(frame, self.reach[0].max(self.reach[1]));
        // weights of both derivatives; zero outside their windows and in frames that are not valid
        let mut weights = vec![[0.0; 2]; widest.len()];
        for order in 0..2 {
            let h = self.reach[order];
            let range = self.window(frame, h);
            let whole = range.len() == 2 * h + 1 && self.valid[range.clone()].iter().all(|v| *v);
            let used = range.filter(|&f| self.valid[f]);
            let own;
            let both = if whole {
                &self.central[order]
            } else {
                let t: Vec<f64> = used.clone().map(|f| (f as f64 - frame as f64) / self.motion.rate_hz).collect();
                own = derivative_weights(&t, if t.len() > 2 * h { 3 } else { 2 })?;
                &own
            };
            let of_order = if order == 0 { &both.0 } else { &both.1 };
            used.zip(of_order).for_each(|(f, w)| weights[f - widest.start][order] = *w);
        }
        let mut root = [Vector3::zeros(), Vector3::zeros()];
        self.v.fill(0.0);
        self.a.fill(0.0);
        for (f, [first, second]) in widest.zip(weights).filter(|(f, _)| self.valid[*f]) {
            let there = self.motion.q(f);
            for &(iv, iq) in &self.scalars {
                let difference = there[iq] - here[iq];
                self.v[iv] += first * difference;
                self.a[iv] += second * difference;
            }
            for (iv, turned) in &self.rotations {
                let difference = quaternion_log(&(turned[frame].inverse() * turned[f]));
                for axis in 0..3 {
                    self.v[iv + axis] += first * difference[axis];
                    self.a[iv + axis] += second * difference[axis];
                }
            }
            if free_root {
                for k in 0..3 {
                    let difference = there[k] - here[k];
                    root[0][k] += first * difference;
                    root[1][k] += second * difference;
                }
            }
        }
        if free_root {
            // in free fall the root's path is a polynomial in the world; differentiate there, then
            // convert to link axes
            let base = self.model.links[0].joint.parent_from_joint.rotation;
            let world_from_link = base * self.rotations[0].1[frame];
            let v = world_from_link.inverse() * (base * root[0]);
            let omega = Vector3::new(self.v[3], self.v[4], self.v[5]);
            let a = world_from_link.inverse() * (base * root[1]) - omega.cross(&v);
            self.v[..3].copy_from_slice(v.as_slice());
            self.a[..3].copy_from_slice(a.as_slice());
        }
        Some((&self.v, &self.a))
    }
}

/// Rotation of a joint from the four coordinates that begin at `first`.
fn rotation_of(q: &[f64], first: usize) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Quaternion::new(q[first + 3], q[first], q[first + 1], q[first + 2]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Most of a jump's force lies below 8 Hz.
    #[test]
    fn the_rate_of_a_force_is_that_of_a_jump() {
        let (rate_hz, omega) = (200.0, 2.0 * std::f64::consts::PI * 8.0);
        let force = |i: usize| Vector3::new(0.0, 0.0, 700.0 * (omega * i as f64 / rate_hz).sin());
        let plate = PlateSeries { force_n: (0..40).map(force).collect(), moment_nm: vec![Vector3::zeros(); 40] };
        for i in 2..38 {
            let expected = 700.0 * omega * (omega * i as f64 / rate_hz).cos();
            assert!((plate_frame(&plate, i, rate_hz).force_rate.z - expected).abs() < 2e-4 * 700.0 * omega);
        }
    }
}
