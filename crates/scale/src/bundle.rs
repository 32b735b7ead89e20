//! Estimates the geometry of jointed objects from many frames at once.
//!
//! The unknowns are marker coordinates in their links, joint positions and axes, and the pose of
//! every frame; the data are the measured markers, with equal white noise. The least-squares
//! solution is the maximum-likelihood one. The pose of each frame is solved for and eliminated
//! (variable projection: the Schur complement of the frame's block of the normal equations), so
//! that only a small system over the geometry remains, however many frames there are.
//!
//! Gauge freedoms (the placement of a link's frame relative to its markers) are held by a
//! negligible damping and fixed afterwards by the caller, who knows the definition of the frames.

use crate::ScaleError;
use crate::geometry::apply_inverse;
use aloft_body::{JointKind, Model, State};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};

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
    h_qp: DMatrix<f64>,
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

    fn scratch(&self, n: usize) -> Scratch {
        let nv = self.model.nv;
        Scratch {
            state: State::new(&self.model),
            jacobian: DMatrix::zeros(3, nv),
            h_qq: DMatrix::zeros(nv, nv),
            g_q: DVector::zeros(nv),
            h_qp: DMatrix::zeros(nv, n),
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
            let mut scratch = self.scratch(layout.n);
            let mut h = DMatrix::zeros(layout.n, layout.n);
            let mut g = DVector::zeros(layout.n);
            let (mut square, mut freedom) = (0.0, 0.0);
            let mut frames = std::mem::take(&mut self.frames);
            frames.retain_mut(|frame| match self.eliminate(frame, &layout, &mut scratch, &mut h, &mut g) {
                Some((s, f)) => {
                    square += s;
                    freedom += f;
                    true
                }
                None => false,
            });
            self.frames = frames;
            noise_m = (square / (freedom - layout.n as f64).max(1.0)).sqrt();
            // The damping fixes gauge freedoms and does not affect anything observable.
            let damping = 1e-7 * h.diagonal().max();
            for i in 0..layout.n {
                h[(i, i)] += damping;
            }
            let step = h.cholesky().map(|c| c.solve(&g)).ok_or_else(|| ScaleError::Functional {
                problem: "the geometry of the object is not determined by these frames".into(),
            })?;
            self.apply(&step, &layout);
            if step.amax() < 1e-7 || iteration == max_iterations {
                return Ok(BundleOutcome { noise_m, iterations: iteration, outliers: 0 });
            }
        }
        Ok(BundleOutcome { noise_m, iterations: max_iterations, outliers: 0 })
    }

    /// Solves a frame's pose and adds its Schur complement. `None` if the frame does not determine
    /// its pose.
    fn eliminate(
        &self,
        frame: &mut BundleFrame,
        layout: &Layout,
        s: &mut Scratch,
        h: &mut DMatrix<f64>,
        g: &mut DVector<f64>,
    ) -> Option<(f64, f64)> {
        let model = &self.model;
        for _ in 0..3 {
            s.state.forward_position(model, &frame.q);
            s.h_qq.fill(0.0);
            s.g_q.fill(0.0);
            for (m, p) in self.markers.iter().zip(&frame.measured) {
                if !p.x.is_finite() {
                    continue;
                }
                let r = p - s.state.point_in_world(m.link, &m.position_m);
                s.state.point_jacobian(model, m.link, &m.position_m, &mut s.jacobian);
                s.h_qq.gemm_tr(1.0, &s.jacobian, &s.jacobian, 1.0);
                s.g_q.gemv_tr(1.0, &s.jacobian, &r, 1.0);
            }
            let step = s.h_qq.clone().cholesky()?.solve(&s.g_q);
            model.integrate(&frame.q, step.as_slice(), &mut s.q_next);
            model.normalize(&mut s.q_next);
            frame.q.copy_from_slice(&s.q_next);
            if step.amax() < 1e-9 {
                break;
            }
        }
        s.state.forward_position(model, &frame.q);
        s.h_qq.fill(0.0);
        s.g_q.fill(0.0);
        s.h_qp.fill(0.0);
        let w = frame.weight;
        let (mut square, mut seen) = (0.0, 0usize);
        let mut columns: Vec<(usize, Matrix3<f64>, usize)> = Vec::with_capacity(4 * model.n_links());
        for (k, (m, p)) in self.markers.iter().zip(&frame.measured).enumerate() {
            if !p.x.is_finite() {
                continue;
            }
            let at = s.state.point_in_world(m.link, &m.position_m);
            let r = p - at;
            seen += 1;
            square += w * r.norm_squared();
            s.state.point_jacobian(model, m.link, &m.position_m, &mut s.jacobian);
            s.h_qq.gemm_tr(w, &s.jacobian, &s.jacobian, 1.0);
            s.g_q.gemv_tr(w, &s.jacobian, &r, 1.0);
            columns.clear();
            self.geometry_columns(&s.state, layout, k, m.link, &at, &mut columns);
            for &(first, ref block, n) in &columns {
                for c in 0..n {
                    let column = block.column(c);
                    g[first + c] += w * column.dot(&r);
                    for v in 0..model.nv {
                        s.h_qp[(v, first + c)] += w * s.jacobian.column(v).dot(&column);
                    }
                    for &(other, ref block2, n2) in &columns {
                        for c2 in 0..n2 {
                            h[(first + c, other + c2)] += w * column.dot(&block2.column(c2));
                        }
                    }
                }
            }
        }
        let factor = s.h_qq.clone().cholesky()?;
        let solved = factor.solve(&s.h_qp);
        h.gemm_tr(-1.0, &s.h_qp, &solved, 1.0);
        let solved_g = factor.solve(&s.g_q);
        g.gemv_tr(-1.0, &s.h_qp, &solved_g, 1.0);
        Some((square, 3.0 * seen as f64 - model.nv as f64))
    }

    /// Derivatives of a marker's world position with respect to the geometry: (first unknown, up to
    /// three columns, number of columns).
    fn geometry_columns(
        &self,
        state: &State,
        layout: &Layout,
        marker: usize,
        link: usize,
        at: &Vector3<f64>,
        columns: &mut Vec<(usize, Matrix3<f64>, usize)>,
    ) {
        let rotation = |q: &UnitQuaternion<f64>| q.to_rotation_matrix().into_inner();
        columns.push((3 * marker, rotation(&state.world_from_link[link].rotation), 3));
        let mut current = link;
        while let Some(parent) = self.model.links[current].parent {
            let joint = &self.model.links[current].joint;
            let free = free_directions(&joint.kind);
            if !free.is_empty() {
                let world_from_joint = state.world_from_link[parent] * joint.parent_from_joint;
                let axes = rotation(&world_from_joint.rotation);
                let turning = -axes * apply_inverse(&world_from_joint, at).cross_matrix();
                let column =
                    |d: usize| if d < 3 { axes.column(d).into_owned() } else { turning.column(d - 3).into_owned() };
                let mut first = layout.joint_at[current];
                for part in free.chunks(3) {
                    let mut block = Matrix3::zeros();
                    for (c, &d) in part.iter().enumerate() {
                        block.set_column(c, &column(d));
                    }
                    columns.push((first, block, part.len()));
                    first += part.len();
                }
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
