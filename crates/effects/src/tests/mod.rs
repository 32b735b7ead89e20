//! Tests of the whole catalogue, by theme, on one smooth motion of two links.

mod catalogue;
mod differences;
mod formulas;
mod laws;

use crate::*;
use aloft_body::{JointSpec, LinkInertia, LinkSpec, Model, ModelSpec, Motion, Phi};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

fn model(offset: [f64; 3]) -> Model {
    let links = vec![
        LinkSpec {
            name: "base".into(),
            parent: None,
            joint: JointSpec::Free,
            position_m: [0.0; 3],
            rpy_rad: [0.0; 3],
            inertia: None,
        },
        LinkSpec {
            name: "arm".into(),
            parent: Some("base".into()),
            joint: JointSpec::RevoluteZ,
            position_m: offset,
            rpy_rad: [0.3, -0.2, 0.1],
            inertia: None,
        },
    ];
    let mut model = Model::from_spec(&ModelSpec::new("two".into(), links)).unwrap();
    // so that effects of robots have targets, too
    model.encoders = true;
    let _ = model.joint_names.insert("arm".into(), "elbow".into());
    model
}

/// A trunk with two arms on a plate, seen by markers.
fn with_limbs() -> Scene {
    let arm = |name: &str, side: f64| LinkSpec {
        name: name.into(),
        parent: Some("trunk".into()),
        joint: JointSpec::Spherical,
        position_m: [0.0, side, 0.2],
        rpy_rad: [0.0; 3],
        inertia: None,
    };
    let trunk = LinkSpec {
        name: "trunk".into(),
        parent: None,
        joint: JointSpec::Free,
        position_m: [0.0; 3],
        rpy_rad: [0.0; 3],
        inertia: None,
    };
    let model = Model::from_spec(&ModelSpec::new("limbs".into(), vec![trunk, arm("arm_l", 0.2), arm("arm_r", -0.2)]));
    let [trunk, arm]: [Phi; 2] = phi().try_into().unwrap();
    Scene::new(&model.unwrap(), &[trunk, arm, arm], &[Vector3::zeros()])
}

fn phi() -> Vec<Phi> {
    let link = |mass_kg: f64, com: [f64; 3], i: [f64; 3]| {
        LinkInertia { mass_kg, com_m: com.into(), inertia_com_kgm2: Matrix3::from_diagonal(&Vector3::from(i)) }.to_phi()
    };
    vec![link(0.7, [0.01, 0.09, 0.02], [3e-3, 1e-3, 3.5e-3]), link(0.4, [-0.1, 0.0, 0.01], [5e-4, 2e-3, 2.2e-3])]
}

/// Smooth motion in flight, with coordinates as functions of time.
fn motion(model: &Model) -> Motion {
    let rate_hz = 200.0;
    let mut q = Vec::new();
    for f in 0..160 {
        let t = f as f64 / rate_hz;
        q.extend([1.0 + 2.0 * t, 0.3 - 1.5 * t, 1.0 + 3.0 * t - 4.9 * t * t]);
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(1.5 * t, 2.0 * (2.0 * t).sin(), 0.5 - 3.0 * t));
        q.extend(turn.coords.iter());
        q.push(0.4 * (5.0 * t).sin());
    }
    Motion { trial: "smooth".into(), rate_hz, nq: model.nq, nv: model.nv, q, ..Motion::default() }
}

struct Fixture {
    scene: Scene,
    motion: Motion,
    plates: Vec<PlateSeries>,
    flight: bool,
}

impl Fixture {
    fn new(flight: bool) -> Self {
        let model = model([0.02, 0.18, -0.01]);
        let motion = motion(&model);
        let scene = Scene::new(&model, &phi(), &[Vector3::new(0.2, 0.1, 0.0), Vector3::new(0.8, 0.1, 0.0)])
            .with_volume(&[Vector3::new(1.0, 0.0, 1.0), Vector3::new(2.0, -0.5, 1.4)]);
        let plates = (0..2)
            .map(|p| {
                let at = |f: usize| f as f64 / 200.0 + p as f64;
                let n = motion.n_frames();
                PlateSeries {
                    force_n: (0..n).map(|f| Vector3::new(at(f).sin(), 0.3, 5.0 + 2.0 * (3.0 * at(f)).cos())).collect(),
                    moment_nm: (0..n).map(|f| Vector3::new(0.1, at(f).cos(), 0.2 * at(f))).collect(),
                }
            })
            .collect();
        Self { scene, motion, plates, flight }
    }
    fn with<T>(&self, f: impl FnOnce(&Series<'_>) -> T) -> T {
        let spans = [Span { first_frame: 20, end_frame: 140, flight: self.flight }];
        let plates = if self.flight { &[][..] } else { &self.plates[..] };
        let trial = TrialMotion { motion: &self.motion, spans: &spans, plates, session_time_s: 30.0 };
        let series = Series::new(&self.scene, &trial).unwrap();
        f(&series)
    }
    fn columns(&self, series: &Series<'_>, effect: &dyn Effect, target: Target, p: &[f64]) -> Columns {
        let k = effect.coefficients(&self.scene, target).len();
        let mut out = Columns::zeros(series.len(), k);
        effect.evaluate(series, target, p, &mut out);
        out
    }
}

/// Wrench required by a motion: `Y φ` about the world origin.
fn inverse_dynamics(series: &Series<'_>, phi: &[Phi]) -> Columns {
    let mut out = Columns::zeros(series.len(), 1);
    inertia::add_wrench(series, phi, 1.0, 0, &mut out);
    out
}
