//! Comparison with Pinocchio 4.1: see tests/peers/body_pinocchio.py.
#![allow(clippy::unwrap_used, clippy::panic)] // functions shared by tests may stop them

mod common;

use aloft_body::{JointSpec, LinkSpec, Model, ModelSpec, Phi, State};
use common::close;
use nalgebra::{DMatrix, Vector3};
use serde_json::Value;

const TOLERANCE: f64 = 1e-10;

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn triple(value: &Value) -> [f64; 3] {
    numbers(value).try_into().unwrap()
}

fn model_of(case: &Value) -> Model {
    let links = case["links"].as_array().unwrap();
    let links = links
        .iter()
        .map(|link| LinkSpec {
            name: link["name"].as_str().unwrap().to_owned(),
            parent: link["parent"].as_str().map(str::to_owned),
            joint: match link["joint"].as_str().unwrap() {
                "free" => JointSpec::Free,
                "spherical" => JointSpec::Spherical,
                "fixed" => JointSpec::Fixed,
                "revolute" => JointSpec::Revolute(triple(&link["axis"])),
                "prismatic" => JointSpec::Prismatic(triple(&link["axis"])),
                other => panic!("joint {other}"),
            },
            position_m: triple(&link["position_m"]),
            rpy_rad: triple(&link["rpy_rad"]),
            inertia: None,
        })
        .collect();
    let mut model = Model::from_spec(&ModelSpec::new("golden".into(), links)).unwrap();
    model.gravity_mps2 = Vector3::from(triple(&case["gravity"]));
    model
}

fn for_each_frame(mut check: impl FnMut(&str, &Model, &[Phi], &Value, &Value, &mut State)) {
    let text = include_str!("../../../fixtures/goldens/body_pinocchio.json");
    let golden: Value = serde_json::from_str(text).unwrap();
    for case in golden["cases"].as_array().unwrap() {
        let model = model_of(case);
        let phi: Vec<Phi> =
            case["phi"].as_array().unwrap().iter().map(|p| Phi::from_column_slice(&numbers(p))).collect();
        let mut state = State::new(&model);
        for frame in case["frames"].as_array().unwrap() {
            state.forward_acceleration(&model, &numbers(&frame["q"]), &numbers(&frame["v"]), &numbers(&frame["a"]));
            check(case["name"].as_str().unwrap(), &model, &phi, case, frame, &mut state);
        }
    }
}

#[test]
fn validate_kinematics() {
    for_each_frame(|name, model, _, case, frame, state| {
        for (i, link) in model.links.iter().enumerate() {
            let golden = &frame["links"][i];
            let at = |what: &str| format!("{name}, {}: {what}", link.name);
            let pose = &state.world_from_link[i];
            let rotation = pose.rotation.to_rotation_matrix().into_inner();
            close(&at("rotation"), rotation.as_slice(), &numbers(&golden["rotation"]), TOLERANCE);
            close(&at("rotation"), state.rotation(i).as_slice(), &numbers(&golden["rotation"]), TOLERANCE);
            close(&at("origin"), pose.translation.vector.as_slice(), &numbers(&golden["origin"]), TOLERANCE);
            close(&at("velocity"), state.velocity[i].as_slice(), &numbers(&golden["velocity"]), TOLERANCE);
            close(&at("acceleration"), state.acceleration[i].as_slice(), &numbers(&golden["acceleration"]), TOLERANCE);
            let point = Vector3::from(triple(&case["links"][i]["point_m"]));
            let found = state.point_in_world(i, &point);
            close(&at("point"), found.as_slice(), &numbers(&golden["point"]), TOLERANCE);
            let found = state.point_velocity_in_world(i, &point);
            close(&at("point velocity"), found.as_slice(), &numbers(&golden["point_velocity"]), TOLERANCE);
            let found = state.point_acceleration_in_world(i, &point);
            close(&at("point acceleration"), found.as_slice(), &numbers(&golden["point_acceleration"]), TOLERANCE);
        }
        if let Some(golden) = frame.get("last_point_jacobian") {
            let last = model.n_links() - 1;
            let point = Vector3::from(triple(&case["links"][last]["point_m"]));
            let mut found = DMatrix::zeros(3, model.nv);
            state.point_jacobian(model, last, &point, &mut found);
            close(&format!("{name}: point Jacobian"), found.as_slice(), &numbers(golden), TOLERANCE);
        }
    });
}

#[test]
fn validate_dynamics() {
    for_each_frame(|name, model, phi, _, frame, state| {
        let mut tau = vec![0.0; model.nv];
        state.inverse_dynamics(model, phi, &mut tau);
        close(&format!("{name}: tau"), &tau, &numbers(&frame["tau"]), TOLERANCE);
        let (mass, com) = state.centre_of_mass(phi);
        close(&format!("{name}: mass"), &[mass], &[frame["mass"].as_f64().unwrap()], TOLERANCE);
        close(&format!("{name}: centre of mass"), com.as_slice(), &numbers(&frame["com"]), TOLERANCE);
        let momentum = numbers(&frame["momentum_about_world_origin"]);
        let com_velocity = state.centre_of_mass_velocity(phi) * mass;
        close(&format!("{name}: momentum"), com_velocity.as_slice(), &momentum[..3], TOLERANCE);
        let mut rows = DMatrix::zeros(6, 10 * model.n_links());
        state.momentum_regressor(model, &Vector3::zeros(), &mut rows);
        let stacked = nalgebra::DVector::from_iterator(rows.ncols(), phi.iter().flat_map(|p| p.iter().copied()));
        close(&format!("{name}: momentum rows"), (rows * stacked).as_slice(), &momentum, TOLERANCE);
        if let Some(golden) = frame.get("mass_matrix_upper") {
            let mut found = DMatrix::zeros(model.nv, model.nv);
            state.mass_matrix(model, phi, &mut found);
            let mut upper = Vec::new();
            for r in 0..model.nv {
                for c in r..model.nv {
                    upper.push(found[(r, c)]);
                    assert_eq!(found[(r, c)], found[(c, r)]);
                }
            }
            close(&format!("{name}: mass matrix"), &upper, &numbers(golden), TOLERANCE);
        }
    });
}

#[test]
fn validate_base_rows() {
    let mut compared = 0;
    for_each_frame(|name, model, _, _, frame, state| {
        let Some(golden) = frame.get("base_rows") else { return };
        let mut rows = DMatrix::zeros(6, 10 * model.n_links());
        state.base_wrench_regressor(model, &mut rows);
        for (i, link) in model.links.iter().enumerate() {
            if let Some(golden) = golden.get(&link.name) {
                let block = rows.columns(10 * i, 10).into_owned();
                close(&format!("{name}: rows of {}", link.name), block.as_slice(), &numbers(golden), TOLERANCE);
                compared += 1;
            }
        }
    });
    assert_eq!(compared, 9 + 2 + 15);
}

#[test]
fn validate_integrate_and_difference() {
    for_each_frame(|name, model, _, _, frame, _| {
        let q = numbers(&frame["q"]);
        let mut found = vec![0.0; model.nq];
        model.integrate(&q, &numbers(&frame["step"]), &mut found);
        let mut expected = numbers(&frame["integrated"]);
        // A quaternion and its negative are the same rotation.
        for joint in model.links.iter().map(|link| &link.joint) {
            if let Some(first) = joint.quaternion_offset() {
                let same: f64 = (first..first + 4).map(|k| found[k] * expected[k]).sum();
                expected[first..first + 4].iter_mut().for_each(|x| *x *= same.signum());
            }
        }
        close(&format!("{name}: integrate"), &found, &expected, TOLERANCE);
        let mut found = vec![0.0; model.nv];
        model.difference(&q, &numbers(&frame["other"]), &mut found);
        close(&format!("{name}: difference"), &found, &numbers(&frame["difference"]), TOLERANCE);
    });
}
