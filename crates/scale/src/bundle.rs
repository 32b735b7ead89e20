//! Estimates the geometry of jointed objects from many frames at once.
//!
//! The unknowns are marker coordinates in their links, joint positions and axes, and the pose of
//! every frame; the data are the measured markers, with equal white noise. The least-squares
//! solution is the maximum-likelihood one. The pose of each frame is solved for and eliminated
//! ([`GeometryEquations`]), so that only a small system over the geometry remains.
//!
//! Gauge freedoms (the placement of a link's frame relative to its markers) are held by a
//! negligible damping and fixed afterwards by the caller, who knows the definition of the frames.

use crate::ScaleError;
use crate::geometry::apply_inverse;
use aloft_body::{GeometryEquations, JointKind, Model, State};
use nalgebra::{DMatrix, DVector, Isometry3, Translation3, UnitQuaternion, Vector3};

/// Largest number of Gauss-Newton steps of a frame's pose; more of them can lead away while the
/// geometry is still coarse.
const POSE_STEPS: usize = 3;

/// A marker of the bundle.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct BundleMarker {
    pub link: usize,
    pub position_m: Vector3<f64>,
}

/// One frame's measurement.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct BundleFrame {
    /// Measured markers, m; not finite where missing.
    pub measured: Vec<Vector3<f64>>,
    /// Inverse variance relative to an ordinary frame (larger for a mean over many still frames).
    pub weight: f64,
    /// Coordinates, updated.
    pub q: Vec<f64>,
}

/// Model, markers and frames; all are refined in place.
#[derive(Debug, Clone)]
pub(crate) struct Bundle {
    pub model: Model,
    pub markers: Vec<BundleMarker>,
    pub frames: Vec<BundleFrame>,
}

/// Free directions of the joint frame at a joint, translation then rotation.
fn free_directions(kind: &JointKind) -> &'static [usize] {
    match kind {
        // The position of a hinge along its axis z and the rotation about it are conventions.
        JointKind::Revolute(_) => &[0, 1, 3, 4],
        JointKind::Spherical => &[0, 1, 2],
        _ => &[],
    }
}

/// Result of a refinement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BundleOutcome {
    /// Standard deviation of a marker coordinate estimated from the residuals, m.
    pub noise_m: f64,
    /// Outer iterations.
    pub iterations: usize,
    /// Marker observations left out as outliers.
    pub outliers: usize,
}

struct Layout {
    n: usize,
    /// First unknown of each link's joint.
    joint_at: Vec<usize>,
}

/// Scratch memory for one frame.
struct Scratch {
    state: State,
    jacobian: DMatrix<f64>,
    h_qq: DMatrix<f64>,
    g_q: DVector<f64>,
    q_next: Vec<f64>,
}

impl Bundle {
    fn layout(&self) -> Layout {
        let mut n = 3 * self.markers.len();
        let joint_at = self
            .model
            .links
            .iter()
            .map(|l| {
                let at = n;
                n += free_directions(&l.joint.kind).len();
                at
            })
            .collect();
        Layout { n, joint_at }
    }

    fn scratch(&self) -> Scratch {
        let nv = self.model.nv;
        Scratch {
            state: State::new(&self.model),
            jacobian: DMatrix::zeros(3, nv),
            h_qq: DMatrix::zeros(nv, nv),
            g_q: DVector::zeros(nv),
            q_next: vec![0.0; self.model.nq],
        }
    }

    /// Refines geometry and poses until the geometry moves by less than a tenth of a micrometre.
    pub fn refine(&mut self, max_iterations: usize) -> Result<BundleOutcome, ScaleError> {
        let mut outliers = 0;
        let mut outcome = self.iterate(max_iterations)?;
        // Repeat without observations far outside the noise: swapped labels, reflections.
        let dropped = self.drop_outliers(6.0 * outcome.noise_m);
        if dropped > 0 {
            outliers += dropped;
            outcome = self.iterate(max_iterations)?;
        }
        Ok(BundleOutcome { outliers, ..outcome })
    }

    fn iterate(&mut self, max_iterations: usize) -> Result<BundleOutcome, ScaleError> {
        let layout = self.layout();
        let mut noise_m = f64::NAN;
        for iteration in 1..=max_iterations {
            let mut scratch = self.scratch();
            let mut sums = GeometryEquations::new(layout.n, self.model.nv);
            let (mut square, mut freedom) = (0.0, 0.0);
            let mut frames = std::mem::take(&mut self.frames);
            frames.retain_mut(|frame| match self.add_frame(frame, &layout, &mut scratch, &mut sums) {
                Some((s, f)) => {
                    square += s;
                    freedom += f;
                    true
                }
                None => false,
            });
            self.frames = frames;
            noise_m = (square / (freedom - layout.n as f64).max(1.0)).sqrt();
            let (mut h, g) = sums.finish();
            // The damping fixes gauge freedoms and does not affect anything observable.
            let damping = 1e-7 * h.diagonal().max();
            for i in 0..layout.n {
                h[(i, i)] += damping;
            }
            let step = h.cholesky().map(|c| -c.solve(&g)).ok_or_else(|| ScaleError::Functional {
                problem: "the geometry of the object is not determined by these frames".into(),
            })?;
            self.apply(&step, &layout);
            if step.amax() < 1e-7 || iteration == max_iterations {
                return Ok(BundleOutcome { noise_m, iterations: iteration, outliers: 0 });
            }
        }
        Ok(BundleOutcome { noise_m, iterations: max_iterations, outliers: 0 })
    }

    /// Solves a frame's pose and adds its equations. Returns the weighted sum of squares and the
    /// degrees of freedom; `None` if the frame does not determine its pose.
    fn add_frame(
        &self,
        frame: &mut BundleFrame,
        layout: &Layout,
        s: &mut Scratch,
        sums: &mut GeometryEquations,
    ) -> Option<(f64, f64)> {
        let model = &self.model;
        for _ in 0..POSE_STEPS {
            self.pose_equations(frame, s);
            let step = s.h_qq.clone().cholesky()?.solve(&s.g_q);
            model.integrate(&frame.q, step.as_slice(), &mut s.q_next);
            model.normalize(&mut s.q_next);
            frame.q.copy_from_slice(&s.q_next);
            if step.amax() < 1e-9 {
                break;
            }
        }
        self.pose_equations(frame, s);
        let w = frame.weight;
        let factor = (&s.h_qq * w).cholesky()?;
        let (mut square, mut seen) = (0.0, 0usize);
        let mut columns: Vec<(usize, Vector3<f64>)> = Vec::with_capacity(3 + 4 * model.n_links());
        let mut motions: Vec<(usize, Vector3<f64>)> = Vec::with_capacity(model.nv);
        for (k, (m, p)) in self.markers.iter().zip(&frame.measured).enumerate() {
            if !p.x.is_finite() {
                continue;
            }
            let at = s.state.point_in_world(m.link, &m.position_m);
            let residual = at - p;
            seen += 1;
            square += w * residual.norm_squared();
            s.state.point_jacobian(model, m.link, &m.position_m, &mut s.jacobian);
            self.geometry_columns(&s.state, layout, k, m.link, &at, &mut columns);
            motions.clear();
            motions.extend((0..model.nv).map(|v| (v, s.jacobian.fixed_view::<3, 1>(0, v).into_owned())));
            sums.add_point(w, &residual, &columns, &motions);
        }
        s.g_q *= -w;
        sums.eliminate_posture(&factor, Some(s.g_q.as_mut_slice()));
        Some((square, 3.0 * seen as f64 - model.nv as f64))
    }

    /// Normal equations of a frame's pose, without the frame's weight.
    fn pose_equations(&self, frame: &BundleFrame, s: &mut Scratch) {
        s.state.forward_position(&self.model, &frame.q);
        s.h_qq.fill(0.0);
        s.g_q.fill(0.0);
        for (m, p) in self.markers.iter().zip(&frame.measured) {
            if !p.x.is_finite() {
                continue;
            }
            let r = p - s.state.point_in_world(m.link, &m.position_m);
            s.state.point_jacobian(&self.model, m.link, &m.position_m, &mut s.jacobian);
            s.h_qq.gemm_tr(1.0, &s.jacobian, &s.jacobian, 1.0);
            s.g_q.gemv_tr(1.0, &s.jacobian, &r, 1.0);
        }
    }

    /// Derivatives of a marker's world position with respect to the unknowns of the geometry.
    fn geometry_columns(
        &self,
        state: &State,
        layout: &Layout,
        marker: usize,
        link: usize,
        at: &Vector3<f64>,
        columns: &mut Vec<(usize, Vector3<f64>)>,
    ) {
        let rotation = |q: &UnitQuaternion<f64>| q.to_rotation_matrix().into_inner();
        let own = rotation(&state.world_from_link[link].rotation);
        columns.clear();
        columns.extend((0..3).map(|c| (3 * marker + c, own.column(c).into_owned())));
        let mut current = link;
        while let Some(parent) = self.model.links[current].parent {
            let joint = &self.model.links[current].joint;
            let world_from_joint = state.world_from_link[parent] * joint.parent_from_joint;
            let axes = rotation(&world_from_joint.rotation);
            let turning = -axes * apply_inverse(&world_from_joint, at).cross_matrix();
            for (c, &d) in free_directions(&joint.kind).iter().enumerate() {
                let column = if d < 3 { axes.column(d) } else { turning.column(d - 3) };
                columns.push((layout.joint_at[current] + c, column.into_owned()));
            }
            current = parent;
        }
    }

    fn apply(&mut self, step: &DVector<f64>, layout: &Layout) {
        for (k, m) in self.markers.iter_mut().enumerate() {
            m.position_m += Vector3::new(step[3 * k], step[3 * k + 1], step[3 * k + 2]);
        }
        for (link, &at) in self.model.links.iter_mut().zip(&layout.joint_at) {
            let mut twist = [0.0; 6];
            for (c, &d) in free_directions(&link.joint.kind).iter().enumerate() {
                twist[d] = step[at + c];
            }
            let delta = Isometry3::from_parts(
                Translation3::new(twist[0], twist[1], twist[2]),
                UnitQuaternion::from_scaled_axis(Vector3::new(twist[3], twist[4], twist[5])),
            );
            link.joint.parent_from_joint *= delta;
        }
    }

    /// Discards measurements farther than `limit_m` from the model; returns how many.
    fn drop_outliers(&mut self, limit_m: f64) -> usize {
        let mut state = State::new(&self.model);
        let mut dropped = 0;
        for frame in &mut self.frames {
            state.forward_position(&self.model, &frame.q);
            for (m, p) in self.markers.iter().zip(&mut frame.measured) {
                let d = (*p - state.point_in_world(m.link, &m.position_m)).norm();
                if d > limit_m {
                    *p = Vector3::repeat(f64::NAN);
                    dropped += 1;
                }
            }
        }
        dropped
    }
}
