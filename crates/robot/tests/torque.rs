//! Torque rows: exact for true parameters, and what the fit makes of them.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail by panicking")]

use aloft_body::{BaseParameters, Model, Motion, Phi, State};
use aloft_effects::Scene;
use aloft_regressor::{Stretch, run_velocities};
use aloft_robot::RobotModel;
use aloft_robot::torque::{TorqueEffects, TorqueSource, Torques, torque_factor};
use nalgebra::{DVector, Vector3};

const RATE_HZ: f64 = 1000.0;

fn motion(model: &Model, n: usize, seed: f64) -> Motion {
    let mut q = Vec::new();
    for i in 0..n {
        let t = i as f64 / RATE_HZ;
        let wave = |k: usize, size: f64| size * ((3.0 + 1.3 * k as f64) * t + seed * k as f64).sin();
        let step: Vec<f64> = (0..model.nv).map(|k| wave(k, if k < 3 { 0.3 } else { 0.6 })).collect();
        let mut frame = model.neutral();
        model.integrate(&model.neutral(), &step, &mut frame);
        q.extend(frame);
    }
    Motion { trial: "a".to_owned(), rate_hz: RATE_HZ, nq: model.nq, nv: model.nv, q, ..Motion::default() }
}

#[test]
fn rows_vanish_for_true_inertias_friction_armature_and_gains() {
    let robot = RobotModel::parse("robot.urdf", include_str!("robot.urdf")).unwrap();
    let mut model = Model::from_spec(&robot.spec).unwrap();
    model.gravity_mps2 = Vector3::new(0.0, 0.0, -9.81);
    let phi: Vec<Phi> = robot.spec.links.iter().map(|l| l.inertia.unwrap().to_phi()).collect();
    let base = BaseParameters::of(&model);
    let scene = Scene::new(&model, &phi, &[]);
    // armature, damping, friction, gain of the reading
    let joints = [[0.02, 0.3, 0.4, 1.03], [0.5, 4.0, 1.5, 0.97]];
    for seed in [0.4, 1.1] {
        let n = 600;
        let motion = motion(&model, n, seed);
        let v = run_velocities(&model, &motion, 0, n);
        let mut torques = vec![vec![f64::NAN; n]; 2];
        let mut state = State::new(&model);
        let mut tau = vec![0.0; model.nv];
        for i in 4..n - 4 {
            let of = |f: usize| &v[f * model.nv..(f + 1) * model.nv];
            let a: Vec<f64> = (0..model.nv)
                .map(|k| RATE_HZ * (8.0 * (of(i + 1)[k] - of(i - 1)[k]) - (of(i + 2)[k] - of(i - 2)[k])) / 12.0)
                .collect();
            state.forward_acceleration(&model, motion.q(i), of(i), &a);
            state.inverse_dynamics(&model, &phi, &mut tau);
            for (j, [armature, damping, friction, gain]) in joints.iter().enumerate() {
                let (rate, acceleration) = (of(i)[6 + j], a[6 + j]);
                let motor = tau[6 + j] + armature * acceleration + damping * rate + friction * (rate / 0.05).tanh();
                torques[j][i] = gain * motor;
            }
        }
        let stretch = Stretch::flight("a", 0, 10, n - 10);
        let given = Torques { values: &torques, sd_nm: 0.001, white_nm: &[0.0; 2] };
        let source = TorqueSource { scene: &scene, motion: &motion, stretch: &stretch, torques: given };
        let (factor, _) = torque_factor(&robot, &base, source, TorqueEffects::default()).unwrap();
        assert_eq!(factor.columns.effects[3], "shoulder.gain_error");
        let stacked = DVector::from_iterator(30, phi.iter().flat_map(|p| p.iter().copied()));
        let mut x: Vec<f64> = (&base.from_full * stacked).iter().copied().collect();
        for [armature, damping, friction, gain] in joints {
            x.extend([armature, damping, friction, 1.0 / gain - 1.0, 0.0]);
        }
        // rows are in units of one per cent of the torque
        let rms = |x: Vec<f64>| (factor.sum_of_squares(&DVector::from_vec(x)) / factor.n_rows as f64).sqrt();
        let mut wrong = x.clone();
        wrong[base.len()] *= 1.5;
        assert!(rms(x.clone()) < 0.02, "{}", rms(x));
        assert!(rms(wrong.clone()) > 0.3, "{}", rms(wrong));
    }
}
