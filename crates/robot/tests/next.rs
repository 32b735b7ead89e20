//! Planned flights: physics of the flight that is computed, and logs of it.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail by panicking")]

use aloft_body::{LinkInertia, Model, Phi, State};
use aloft_robot::next::{Extents, Rehearsal, Release, Wave, fly};
use aloft_robot::{FuseInput, Imu, RobotModel, SensorNoise, fuse};
use nalgebra::{UnitQuaternion, Vector3};

fn robot() -> (RobotModel, Model, Vec<Phi>) {
    let robot = RobotModel::parse("robot.urdf", include_str!("robot.urdf")).unwrap();
    let mut model = Model::from_spec(&robot.spec).unwrap();
    model.gravity_mps2 = Vector3::new(0.0, 0.0, -9.81);
    let phi = robot.spec.links.iter().map(|l| l.inertia.unwrap().to_phi()).collect();
    (robot, model, phi)
}

fn wave() -> Wave {
    Wave {
        hold: vec![0.2, 0.05],
        control: vec![vec![1.4, -1.1, 0.8, -0.5], vec![0.03, -0.02, 0.03, 0.02]],
        duration_s: 0.5,
    }
}

#[test]
fn no_wrench_acts_on_the_base_of_a_computed_flight() {
    let (_, model, phi) = robot();
    let wave = wave();
    let release = Release {
        centre_m: Vector3::new(0.1, -0.2, 1.0),
        speed_m_s: Vector3::new(0.3, 0.0, 2.4),
        rotation: UnitQuaternion::from_euler_angles(0.3, -0.4, 1.0),
        turn_rad_s: Vector3::new(2.0, -3.0, 1.0),
    };
    let rate_hz = 2000.0;
    let flown = fly(&model, &phi, &release, &|t| wave.at(t), 1001, rate_hz, 2);
    let mut state = State::new(&model);
    let mut tau = vec![0.0; model.nv];
    let (mut largest, mut torque) = (0.0f64, 0.0f64);
    for i in 1..1000 {
        let a: Vec<f64> = flown.v(i + 1).iter().zip(flown.v(i - 1)).map(|(b, a)| (b - a) * 0.5 * rate_hz).collect();
        state.forward_acceleration(&model, flown.q(i), flown.v(i), &a);
        state.inverse_dynamics(&model, &phi, &mut tau);
        largest = tau[..6].iter().fold(largest, |m, x| m.max(x.abs()));
        torque = torque.max(tau[6].abs());
        // velocities are the derivative of positions
        let mut change = vec![0.0; model.nv];
        model.difference(flown.q(i - 1), flown.q(i + 1), &mut change);
        for (c, v) in change.iter().zip(flown.v(i)) {
            assert!((c * 0.5 * rate_hz - v).abs() < 2e-3, "{c} {v}");
        }
    }
    // the differences of the check are the limit
    assert!(largest < 0.02 && torque > 5.0, "{largest} N, {torque} N·m");
}

#[test]
fn a_rehearsed_log_gives_its_motion_and_clock_back() {
    let (robot, model, phi) = robot();
    let imu = Imu { link: None, position_m: [0.03, -0.02, 0.05], rpy_rad: [0.0; 3] };
    let noise = SensorNoise {
        position_m: 3e-4,
        orientation_deg: 0.05,
        gyro_rad_s: 0.004,
        acc_m_s2: 0.04,
        ..SensorNoise::default()
    };
    let rehearsal = Rehearsal {
        robot: &robot,
        model: &model,
        phi: &phi,
        imu: &imu,
        noise,
        rate_hz: 500.0,
        base_hz: 200.0,
        offset_s: 0.004,
    };
    let turns = [Vector3::new(2.0, 1.0, -1.0), Vector3::new(-1.0, 3.0, 0.5)];
    let flights: Vec<(Wave, Vector3<f64>)> = turns.iter().map(|t| (wave(), *t)).collect();
    let (log, base, times) = rehearsal.record(&flights, 3);
    assert_eq!(times.len(), 2);
    let input =
        FuseInput { trial: "a", model: &model, log: &log, base: Some(&base), imu: Some(&imu), noise, bridged_s: 0.0 };
    let (motion, report) = fuse(&input).unwrap();
    let (offset, sd) = (report.clock_offset_s.unwrap(), report.clock_offset_sd_s.unwrap());
    assert!((offset - 0.004).abs() < 4.0 * sd && sd < 2e-4, "{offset} ± {sd}");
    // in flight the centre of mass falls
    let mut state = State::new(&model);
    for (start, end) in times {
        let at = |t: f64| ((t - log.time_s[0]) * motion.rate_hz).round() as usize;
        let mut centre = |t: f64| {
            state.forward_position(&model, motion.q(at(t)));
            state.centre_of_mass(&phi).1
        };
        let (h, middle) = (0.2, 0.5 * (start + end));
        let fall = (centre(middle + h) - centre(middle) * 2.0 + centre(middle - h)) / (h * h);
        assert!((fall - model.gravity_mps2).norm() < 0.02, "{fall}");
    }
}

#[test]
fn links_that_overlap_in_recordings_may_overlap_again_but_not_more() {
    let (robot, model, _) = robot();
    let links: Vec<LinkInertia> = robot.spec.links.iter().map(|l| l.inertia.unwrap()).collect();
    let mut extents = Extents::of(&model, &links, &[], 0.01);
    let posture = |shoulder: f64, extend: f64| {
        let mut q = model.neutral();
        (q[7], q[8]) = (shoulder, extend);
        let mut state = State::new(&model);
        state.forward_position(&model, &q);
        state
    };
    // the slider points away from the base, then into it
    let (away, into) = (posture(0.0, 0.05), posture(-1.9, 0.0));
    let (free, close) = (extents.room_m(&away), extents.room_m(&into));
    assert!(free > close, "{free} {close}");
    extents.allow(&into);
    assert!(extents.room_m(&into) >= 0.0 && extents.room_m(&away) >= extents.room_m(&into));
}
