//! The equations of motion tested against conservation laws, a shorter step, and MuJoCo.
#![allow(clippy::expect_used, clippy::panic, reason = "helpers of tests stand outside of #[test] functions")]

use aloft_body::{Joint, JointSpec, LinkInertia, LinkSpec, Model, ModelSpec, Phi, State};
use aloft_simulate::Hidden;
use aloft_simulate::physics::{Body, Drive, ForwardDynamics, Plant, rk4::Rk4};
use nalgebra::{DMatrix, Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use serde_json::Value;

struct Hinge {
    damping: f64,
    friction: f64,
}
impl Drive for Hinge {
    fn prescribe(&self, _t: f64, _q: &mut [f64], _v: &mut [f64], _a: &mut [f64]) {}
    fn torque(&self, _t: f64, _q: &[f64], v: &[f64], tau: &mut [f64]) {
        for i in 6..v.len() {
            tau[i] -= self.damping * v[i] + self.friction * (v[i] / 1e-3).tanh();
        }
    }
}
const LOOSE: Hinge = Hinge { damping: 0.0, friction: 0.0 };

fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().expect("array").iter().map(|x| x.as_f64().expect("number")).collect()
}
fn matrix(v: &Value) -> Matrix3<f64> {
    let rows: Vec<Vec<f64>> = v.as_array().expect("rows").iter().map(numbers).collect();
    Matrix3::from_fn(|i, j| rows[i][j])
}

fn two_link(at: &[f64], rotation: Matrix3<f64>) -> Model {
    let link = |name: &str, parent: Option<&str>, joint| LinkSpec {
        name: name.into(),
        parent: parent.map(Into::into),
        joint,
        position_m: [0.0; 3],
        rpy_rad: [0.0; 3],
        inertia: None,
    };
    let spec = ModelSpec {
        name: "two".into(),
        links: vec![link("link0", None, JointSpec::Free), link("link1", Some("link0"), JointSpec::RevoluteZ)],
        carries: Default::default(),
    };
    let mut model = Model::from_spec(&spec).expect("model");
    model.gravity_mps2 = Vector3::new(0.0, 0.0, -9.81);
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let joint = model.links[1].joint;
    model.links[1].joint =
        Joint { parent_from_joint: Isometry3::from_parts(Vector3::from_column_slice(at).into(), turn), ..joint };
    model
}

fn golden() -> Value {
    serde_json::from_str(include_str!("goldens/mujoco_chain.json")).expect("golden")
}

fn own_chain(golden: &Value) -> Body {
    let phi: Vec<Phi> = golden["links"]
        .as_array()
        .expect("links")
        .iter()
        .map(|l| {
            let inertia = LinkInertia {
                mass_kg: l["mass"].as_f64().expect("mass"),
                com_m: Vector3::from_vec(numbers(&l["com"])),
                inertia_com_kgm2: matrix(&l["inertia"]),
            };
            inertia.to_phi()
        })
        .collect();
    let model = two_link(&numbers(&golden["hinge_at_m"]), matrix(&golden["rotation"]));
    Body { model, area_m2: vec![1.0; phi.len()], phi }
}

/// Integrates freely; returns the state after each of the given times (multiples of the step).
fn fly(plant: &Plant, drive: &dyn Drive, q0: &[f64], v0: &[f64], step: f64, times: &[f64]) -> Vec<Vec<f64>> {
    let mut dynamics = ForwardDynamics::new(plant, &vec![true; plant.model.n_links()]);
    let mut y: Vec<f64> = q0.iter().chain(v0).copied().collect();
    y.resize(dynamics.len(), 0.0);
    let mut rk4 = Rk4::new(y.len());
    let (mut k, mut out) = (0usize, Vec::new());
    for t in times {
        while (k as f64 + 0.5) * step < *t {
            rk4.step(k as f64 * step, step, &mut y, |t, y, dy| dynamics.rate(drive, t, y, dy)).expect("step");
            dynamics.settle(drive, 0.0, &mut y);
            k += 1;
        }
        out.push(y.clone());
    }
    out
}

/// Largest difference of marker-like points (on both links, 0.2 m out) between two coordinate
/// vectors, m.
fn point_distance(model: &Model, a: &[f64], b: &[f64]) -> f64 {
    let (mut s, mut r) = (State::new(model), State::new(model));
    s.forward_position(model, &a[..model.nq]);
    r.forward_position(model, &b[..model.nq]);
    let mut worst = 0.0f64;
    for link in 0..model.n_links() {
        for axis in 0..3 {
            let p = Vector3::ith(axis, 0.2);
            worst = worst.max((s.point_in_world(link, &p) - r.point_in_world(link, &p)).norm());
        }
    }
    worst
}

#[test]
fn validate_free_flight_against_mujoco() {
    let golden = golden();
    let body = own_chain(&golden);
    let plant = Plant::new(&body, &[], "").expect("plant");
    for flight in golden["free"].as_array().expect("flights") {
        let drive = Hinge { damping: flight["hinge_damping"].as_f64().expect("damping"), friction: 0.0 };
        let samples = flight["samples"].as_array().expect("samples");
        let times: Vec<f64> = samples.iter().map(|s| s["t_s"].as_f64().expect("time")).collect();
        let states = fly(&plant, &drive, &numbers(&flight["q0"]), &numbers(&flight["v0"]), 2.5e-4, &times);
        for (sample, y) in samples.iter().zip(&states) {
            let d = point_distance(&plant.model, y, &numbers(&sample["q"]));
            assert!(d < 1e-8, "{d:e} m at {} s", sample["t_s"]);
            for (x, want) in y[8..15].iter().zip(numbers(&sample["v"])) {
                assert!((x - want).abs() < 2e-7, "{x} {want}");
            }
        }
    }
}

/// Dry friction as modelled by MuJoCo: a soft constraint that opposes `v + a₀/b`, bounded by the
/// friction torque (default solver parameters: time constant 20 ms, impedance 0.9 … 0.95).
struct SoftFriction<'a> {
    plant: &'a Plant,
    viscous: Hinge,
    friction: f64,
    /// Inverse inertia of the hinge at zero.
    softness: f64,
}
fn hinge_mobility(plant: &Plant, q: &[f64]) -> f64 {
    let mut state = State::new(&plant.model);
    state.forward_position(&plant.model, q);
    let mut mass = DMatrix::zeros(7, 7);
    state.mass_matrix(&plant.model, &plant.phi, &mut mass);
    mass.try_inverse().expect("regular")[(6, 6)]
}
impl Drive for SoftFriction<'_> {
    fn prescribe(&self, _t: f64, _q: &mut [f64], _v: &mut [f64], _a: &mut [f64]) {}
    fn torque(&self, t: f64, q: &[f64], v: &[f64], tau: &mut [f64]) {
        self.viscous.torque(t, q, v, tau);
        let y: Vec<f64> = q.iter().chain(v).copied().collect();
        let mut free = ForwardDynamics::new(self.plant, &[true, true]);
        let a0 = free.accelerations(&self.viscous, t, &y).expect("free").0[6];
        let regularised = hinge_mobility(self.plant, q) + self.softness * (1.0 - 0.9) / 0.9;
        let rate = 2.0 / (0.95 * 0.02);
        tau[6] += (-(rate * v[6] + a0) / regularised).clamp(-self.friction, self.friction);
    }
}

#[test]
fn validate_recorded_chain_a_flights() {
    let golden = golden();
    let Some(chain) = golden.get("chain_a") else {
        println!("skipped: the golden holds no flights of chain_a");
        return;
    };
    let phi: Vec<Phi> = chain["phi"].as_array().expect("phi").iter().map(|p| Phi::from_vec(numbers(p))).collect();
    let model = two_link(&numbers(&chain["hinge_at_m"]), matrix(&chain["rotation"]));
    let body = Body { model, area_m2: vec![1.0; 2], phi };
    let plant = Plant::new(&body, &[], "").expect("plant");
    let drive = SoftFriction {
        plant: &plant,
        viscous: Hinge { damping: chain["hinge_damping"].as_f64().expect("damping"), friction: 0.0 },
        friction: chain["hinge_friction"].as_f64().expect("friction"),
        softness: hinge_mobility(&plant, &plant.model.neutral()),
    };
    let mut worst = 0.0f64;
    for flight in chain["flights"].as_array().expect("flights") {
        let samples = flight["samples"].as_array().expect("samples");
        let times: Vec<f64> = samples.iter().map(|s| s["t_s"].as_f64().expect("time")).collect();
        let states = fly(&plant, &drive, &numbers(&flight["q0"]), &numbers(&flight["v0"]), 5e-4, &times);
        for (sample, y) in samples.iter().zip(&states) {
            worst = worst.max(point_distance(&plant.model, y, &numbers(&sample["q"])));
        }
    }
    println!("largest distance to the recorded truth: {worst:.2e} m");
    assert!(worst < 1e-5, "{worst:e} m");
}

#[test]
fn fourth_order() {
    let golden = golden();
    let plant = Plant::new(&own_chain(&golden), &[], "").expect("plant");
    let flight = &golden["free"][0];
    let (q0, v0) = (numbers(&flight["q0"]), numbers(&flight["v0"]));
    let end = |step: f64| fly(&plant, &LOOSE, &q0, &v0, step, &[0.64]).remove(0);
    let truth = end(1.25e-4);
    let errors: Vec<f64> = [4e-3, 2e-3, 1e-3].iter().map(|h| point_distance(&plant.model, &end(*h), &truth)).collect();
    println!("error after 0.64 s at 4, 2, 1 ms: {errors:?} m");
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((3.7..4.6).contains(&order), "order {order}");
    }
    assert!(errors[2] < 1e-7);
}

fn energy_and_momentum(body: &Body, y: &[f64]) -> (f64, Vector3<f64>, Vector3<f64>) {
    let model = &body.model;
    let mut state = State::new(model);
    let (q, v) = (&y[..model.nq], &y[model.nq..model.nq + model.nv]);
    state.forward_velocity(model, q, v);
    let mut mass = DMatrix::zeros(model.nv, model.nv);
    state.mass_matrix(model, &body.phi, &mut mass);
    let v = nalgebra::DVector::from_column_slice(v);
    let (m, com) = state.centre_of_mass(&body.phi);
    let kinetic = 0.5 * v.dot(&(&mass * &v));
    let mut rows = DMatrix::zeros(6, 10 * model.n_links());
    state.momentum_regressor(model, &com, &mut rows);
    let phi = nalgebra::DVector::from_iterator(10 * body.phi.len(), body.phi.iter().flat_map(|p| p.iter().copied()));
    let h = rows * phi;
    let energy = kinetic - m * model.gravity_mps2.dot(&com);
    (energy, Vector3::new(h[0], h[1], h[2]), Vector3::new(h[3], h[4], h[5]))
}

#[test]
fn energy_and_momentum_are_kept() {
    let golden = golden();
    let body = own_chain(&golden);
    let plant = Plant::new(&body, &[], "").expect("plant");
    let flight = &golden["free"][1];
    let (q0, v0) = (numbers(&flight["q0"]), numbers(&flight["v0"]));
    let start: Vec<f64> = q0.iter().chain(&v0).copied().collect();
    let (e0, p0, l0) = energy_and_momentum(&body, &start);
    let end = fly(&plant, &LOOSE, &q0, &v0, 5e-4, &[0.7]).remove(0);
    let (e1, p1, l1) = energy_and_momentum(&body, &end);
    let fall = Vector3::new(0.0, 0.0, -9.81 * 0.7) * (body.phi[0][0] + body.phi[1][0]);
    assert!((e1 - e0).abs() < 1e-9 * e0.abs(), "{e0} {e1}");
    assert!((p1 - p0 - fall).norm() < 1e-9, "{p0} {p1}");
    assert!((l1 - l0).norm() < 1e-9 * l0.norm(), "{l0} {l1}");
}

/// Internal effects (wheel, wobbling mass) conserve momentum; drag and tether do the expected work.
#[test]
fn hidden_forces_obey_their_laws() {
    let golden = golden();
    let body = own_chain(&golden);
    let flight = &golden["free"][1];
    let (q0, v0) = (numbers(&flight["q0"]), numbers(&flight["v0"]));
    let fly_with = |hidden: &[Hidden], t: f64| {
        let plant = Plant::new(&body, hidden, "").expect("plant");
        fly(&plant, &LOOSE, &q0, &v0, 2.5e-4, &[t]).remove(0)
    };
    let start: Vec<f64> = q0.iter().chain(&v0).copied().collect();
    let (e0, _, l0) = energy_and_momentum(&body, &start);

    // a wheel: the sum of its momentum and the body's is constant, no work is done
    let h = Vector3::new(0.02, -0.01, 0.03);
    let end = fly_with(&[Hidden::Flywheel { link: "link1".into(), momentum_nms: h.into() }], 0.5);
    let spin = |y: &[f64]| {
        let mut state = State::new(&body.model);
        state.forward_position(&body.model, &y[..8]);
        state.world_from_link[1].rotation * h
    };
    let (e1, _, l1) = energy_and_momentum(&body, &end);
    assert!((l1 + spin(&end) - l0 - spin(&start)).norm() < 1e-9);
    assert!((e1 - e0).abs() < 1e-8, "{e0} {e1}");

    // damping dissipates energy, monotonically
    for hidden in [
        Hidden::QuadraticDrag { drag_area_m2: 0.03, air_density_kgpm3: 1.2 },
        Hidden::LinearDrag { coefficient_nspm: 0.1 },
        Hidden::RotationalDrag { coefficient_nmsprad: 1e-3 },
    ] {
        let mut last = e0;
        for t in [0.1, 0.2, 0.4] {
            let e = energy_and_momentum(&body, &fly_with(std::slice::from_ref(&hidden), t)).0;
            assert!(e < last, "{}: {last} {e}", hidden.name());
            last = e;
        }
    }

    // an undamped line stores the work done on it
    let anchor = Vector3::new(0.0, 0.0, 2.5);
    let tether = Hidden::Tether {
        link: "link0".into(),
        point_m: [0.0, 0.2, 0.0],
        anchor_m: anchor.into(),
        rest_length_m: 0.5,
        stiffness_npm: 12.0,
        damping_nspm: 0.0,
    };
    let stored = |y: &[f64]| {
        let mut state = State::new(&body.model);
        state.forward_position(&body.model, &y[..8]);
        let length = (state.point_in_world(0, &Vector3::new(0.0, 0.2, 0.0)) - anchor).norm();
        6.0 * (length - 0.5).max(0.0).powi(2)
    };
    let end = fly_with(&[tether], 0.5);
    let e1 = energy_and_momentum(&body, &end).0;
    assert!((e1 + stored(&end) - e0 - stored(&start)).abs() < 1e-7, "{e0} {e1}");

    // added mass is inertia without weight: a heavier body falls slower
    let added = Hidden::AddedMass { link: "link0".into(), point_m: [0.0, 0.12, 0.0], mass_kg: 0.1 };
    let (_, p, _) = energy_and_momentum(&body, &fly_with(&[added], 0.3));
    let (_, q, _) = energy_and_momentum(&body, &fly_with(&[], 0.3));
    assert!(p.z > q.z + 0.1);
}
