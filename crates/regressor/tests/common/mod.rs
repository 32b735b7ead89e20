//! True motions of the simulated sets with markers, shared by tests of rows and of identification.
#![allow(
    dead_code,
    missing_docs,
    clippy::unwrap_used,
    reason = "every test binary uses a part; broken data should stop it"
)]

use aloft_body::inertia::Phi;
use aloft_body::{BaseParameters, Model, ModelMarker, ModelSpec, Motion, State};
use aloft_regressor::Stretch;
use nalgebra::{DMatrix, DVector, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Frame, velocities and accelerations.
pub type Instant = (usize, Vec<f64>, Vec<f64>);

/// Coordinates, residuals and places of the markers of one frame.
type Recorded = (Vec<f64>, Vec<f64>, Vec<Vector3<f64>>);

pub struct Truth {
    pub model: Model,
    pub base: BaseParameters,
    pub phi: Vec<Phi>,
    pub markers: Vec<ModelMarker>,
    pub motion: Motion,
    /// First frame of the block, first and end frame of the flight, end of the block.
    pub flights: Vec<[usize; 4]>,
}

pub fn data() -> PathBuf {
    match std::env::var_os("ALOFT_IDENTIFY_DATA") {
        Some(folder) => folder.into(),
        None => Path::new(env!("CARGO_MANIFEST_DIR")).join("../regressor/tests/data"),
    }
}

pub fn load(name: &str) -> Truth {
    let folder = data();
    let text = std::fs::read_to_string(folder.join(format!("{name}.json"))).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let spec: ModelSpec = serde_json::from_value(json["model"].clone()).unwrap();
    let mut model = Model::from_spec(&spec).unwrap();
    let gravity: [f64; 3] = serde_json::from_value(json["gravity_mps2"].clone()).unwrap();
    model.gravity_mps2 = Vector3::from(gravity);
    let base = BaseParameters::of(&model);
    let phi: Vec<[f64; 10]> = serde_json::from_value(json["phi"].clone()).unwrap();
    let markers: Vec<(usize, [f64; 3])> = serde_json::from_value(json["markers"].clone()).unwrap();
    let flights: Vec<[usize; 4]> = serde_json::from_value(json["flights"].clone()).unwrap();
    let raw = std::fs::read(folder.join(format!("{name}.i32"))).unwrap();
    let mut q: Vec<f64> =
        raw.chunks_exact(4).map(|b| 5e-9 * f64::from(i32::from_le_bytes(b.try_into().unwrap()))).collect();
    for frame in q.chunks_exact_mut(model.nq) {
        model.normalize(frame);
    }
    let motion = Motion {
        trial: name.to_owned(),
        rate_hz: json["rate_hz"].as_f64().unwrap().round(),
        nq: model.nq,
        nv: model.nv,
        q,
        ..Motion::default()
    };
    let markers = markers
        .into_iter()
        .enumerate()
        .map(|(i, (link, p))| ModelMarker { label: format!("m{i}"), link, position_m: Vector3::from(p), weight: 1.0 })
        .collect();
    Truth { base, phi: phi.into_iter().map(Phi::from).collect(), markers, motion, flights, model }
}

impl Truth {
    pub fn stretches(&self) -> Vec<Stretch> {
        let name = &self.motion.trial;
        self.flights.iter().enumerate().map(|(i, f)| Stretch::flight(name.clone(), i, f[1], f[2])).collect()
    }
    pub fn truth(&self) -> DVector<f64> {
        self.base.regroup(&self.phi)
    }
    pub fn mass(&self) -> f64 {
        self.phi.iter().map(|p| p[0]).sum()
    }
    /// Velocities and accelerations of every fourth frame, if the set has them.
    pub fn velocities(&self) -> Option<Vec<Instant>> {
        let raw = std::fs::read(data().join(format!("{}.f32", self.motion.trial))).ok()?;
        let values: Vec<f64> =
            raw.chunks_exact(4).map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap()))).collect();
        let nv = self.model.nv;
        Some(
            values.chunks_exact(2 * nv).enumerate().map(|(i, c)| (4 * i, c[..nv].to_vec(), c[nv..].to_vec())).collect(),
        )
    }

    /// Motion as obtained by inverse kinematics from markers with white noise: Gauss-Newton from
    /// the truth.
    pub fn noisy(&self, sd_m: f64, seed: u64) -> Motion {
        self.tracked(sd_m, 0.0, seed)
    }

    /// As [`Truth::noisy`], with soft tissue: every marker also moves with the coordinates of its
    /// joint, by `soft_m` (root mean square) over the whole recording.
    pub fn tracked(&self, sd_m: f64, soft_m: f64, seed: u64) -> Motion {
        self.recorded(sd_m, soft_m, seed).0
    }

    /// The same, with the places of the markers, marker × frame.
    pub fn recorded(&self, sd_m: f64, soft_m: f64, seed: u64) -> (Motion, Vec<Vec<Vector3<f64>>>) {
        let soft = self.soft_tissue(soft_m, seed);
        let model = &self.model;
        let normal = Normal::new(0.0, sd_m).unwrap();
        let mut out = self.motion.clone();
        let n = self.markers.len();
        let frames: Vec<Recorded> = (0..self.motion.n_frames())
            .into_par_iter()
            .map(|frame| {
                let mut rng = ChaCha8Rng::seed_from_u64(seed);
                rng.set_stream(frame as u64);
                let mut state = State::new(model);
                let mut q = self.motion.q(frame).to_vec();
                let mut moved = q.clone();
                state.forward_position(model, &q);
                let seen: Vec<Vector3<f64>> = self
                    .markers
                    .iter()
                    .map(|m| {
                        state.point_in_world(m.link, &m.position_m) + Vector3::from_fn(|_, _| normal.sample(&mut rng))
                    })
                    .zip(&soft)
                    .map(|(p, soft)| p + soft[frame])
                    .collect();
                let mut jacobian = DMatrix::zeros(3, model.nv);
                for _ in 0..3 {
                    state.forward_position(model, &q);
                    let mut all = DMatrix::zeros(3 * n, model.nv);
                    let mut residual = DVector::zeros(3 * n);
                    for (i, m) in self.markers.iter().enumerate() {
                        state.point_jacobian(model, m.link, &m.position_m, &mut jacobian);
                        all.rows_mut(3 * i, 3).copy_from(&jacobian);
                        residual.rows_mut(3 * i, 3).copy_from(&(seen[i] - state.point_in_world(m.link, &m.position_m)));
                    }
                    let mut normal_matrix = all.tr_mul(&all);
                    for i in 0..model.nv {
                        normal_matrix[(i, i)] += 1e-8;
                    }
                    let step = normal_matrix.cholesky().unwrap().solve(&all.tr_mul(&residual));
                    model.integrate(&q, step.as_slice(), &mut moved);
                    q.copy_from_slice(&moved);
                }
                state.forward_position(model, &q);
                let left = self.markers.iter().zip(&seen);
                let residual = left.map(|(m, p)| (p - state.point_in_world(m.link, &m.position_m)).norm()).collect();
                (q, residual, seen)
            })
            .collect();
        out.marker_labels = self.markers.iter().map(|m| m.label.clone()).collect();
        (out.q, out.residual_m) = (Vec::new(), Vec::new());
        let mut places = vec![Vec::new(); n];
        for (q, residual, seen) in frames {
            out.q.extend(q);
            out.residual_m.extend(residual);
            places.iter_mut().zip(seen).for_each(|(all, p)| all.push(p));
        }
        (out, places)
    }
}

impl Truth {
    /// Displacement of every marker in every frame, world.
    fn soft_tissue(&self, soft_m: f64, seed: u64) -> Vec<Vec<Vector3<f64>>> {
        let n = self.motion.n_frames();
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x50f7);
        let unit = Normal::new(0.0, 1.0).unwrap();
        let mut state = State::new(&self.model);
        let rotations: Vec<Vec<nalgebra::UnitQuaternion<f64>>> = (0..n)
            .map(|f| {
                state.forward_position(&self.model, self.motion.q(f));
                state.world_from_link.iter().map(|p| p.rotation).collect()
            })
            .collect();
        self.markers
            .iter()
            .map(|m| {
                let joint = &self.model.links[m.link].joint;
                let (first, count) = if m.link == 0 { (7, 8) } else { (joint.q_offset, joint.kind.nq()) };
                let by: Vec<Vector3<f64>> =
                    (0..count).map(|_| Vector3::from_fn(|_, _| unit.sample(&mut rng))).collect();
                let local: Vec<Vector3<f64>> = (0..n)
                    .map(|f| {
                        by.iter()
                            .enumerate()
                            .map(|(k, d)| d * self.motion.q(f)[(first + k).min(self.model.nq - 1)])
                            .sum()
                    })
                    .collect();
                let mean = local.iter().sum::<Vector3<f64>>() / n as f64;
                let rms = (local.iter().map(|d| (d - mean).norm_squared()).sum::<f64>() / n as f64).sqrt();
                let gain = if rms > 0.0 { soft_m / rms } else { 0.0 };
                local.iter().enumerate().map(|(f, d)| rotations[f][m.link] * ((d - mean) * gain)).collect()
            })
            .collect()
    }
}

/// Velocities and accelerations by central differences of eighth order on the manifold (inside
/// blocks; zero near their ends).
pub fn differentiate(truth: &Truth, motion: &mut Motion) {
    let c = [4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0];
    let d = [8.0 / 5.0, -1.0 / 5.0, 8.0 / 315.0, -1.0 / 560.0];
    let (nv, model, rate) = (motion.nv, &truth.model, motion.rate_hz);
    motion.v = vec![0.0; motion.n_frames() * nv];
    motion.a = vec![0.0; motion.n_frames() * nv];
    let mut plus = vec![0.0; nv];
    let mut minus = vec![0.0; nv];
    for block in &truth.flights {
        for frame in block[0] + 4..block[3] - 4 {
            for k in 1..=4 {
                model.difference(motion.q(frame), motion.q(frame + k), &mut plus);
                model.difference(motion.q(frame), motion.q(frame - k), &mut minus);
                for i in 0..nv {
                    motion.v[frame * nv + i] += c[k - 1] * (plus[i] - minus[i]) * rate;
                    motion.a[frame * nv + i] += d[k - 1] * (plus[i] + minus[i]) * rate * rate;
                }
            }
        }
    }
}
