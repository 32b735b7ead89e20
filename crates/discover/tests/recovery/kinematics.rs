//! Kinematic errors: filters, soft tissue, joint centres, the camera volume, edges of flights.

use crate::chain;
use crate::lab::{Evidence, Known, lab, motions, moving};
use crate::person::{CAPTURE, SEED, person, plain};
use crate::{Case, recovers};
use aloft_regressor::StretchKind;
use nalgebra::Vector3;
use serde_json::json;

/// Markers averaged over eleven frames (55 ms), the person on the plates: k is half the variance of
/// the window's times. Such a filter leaves the parabola of a flight unchanged.
pub fn filter() {
    const HALF: usize = 5;
    let (lab, motions_of_twin) = plain();
    let mut smooth = lab.clone();
    for trial in &mut smooth.trials {
        for path in &mut trial.markers.trajectories {
            let raw = path.clone();
            for f in HALF..raw.len() - HALF {
                path[f] = raw[f - HALF..=f + HALF].iter().sum::<Vector3<f64>>() / (2 * HALF + 1) as f64;
            }
        }
    }
    let n = (2 * HALF + 1) as f64;
    let lag_squared = 0.5 * (n * n - 1.0) / 12.0 / (200.0 * 200.0);
    let of = |lab, motions| Evidence::new(lab, motions, Known::Tables, 0.0).only(StretchKind::Contact);
    let case = Case { key: "filter_attenuation", truth: &[lag_squared], ..Case::default() };
    recovers(&case, &of(&smooth, &motions(&smooth)), &of(lab, motions_of_twin));
}

/// All markers swing farther than the bone, `x_marker = x_bone - c x_bone''` for the person on the
/// plates: that is `x_bone = x_marker + c x_marker''` up to the square of c.
pub fn overshoot() {
    const C_S2: f64 = 1e-4;
    const REACH: usize = 4;
    let (lab, motions_of_twin) = plain();
    let mut swinging = lab.clone();
    // least-squares parabola over ±20 ms
    let square = |k: usize| (k as f64 - REACH as f64).powi(2);
    let mean = (0..=2 * REACH).map(square).sum::<f64>() / (2 * REACH + 1) as f64;
    let size: f64 = (0..=2 * REACH).map(|k| (square(k) - mean).powi(2)).sum();
    for trial in &mut swinging.trials {
        for path in &mut trial.markers.trajectories {
            let raw = path.clone();
            for f in REACH..raw.len() - REACH {
                let sum: Vector3<f64> = (0..=2 * REACH).map(|k| raw[f - REACH + k] * (square(k) - mean)).sum();
                path[f] = raw[f] - sum * (2.0 * 200.0 * 200.0 / size * C_S2);
            }
        }
    }
    let of = |lab, motions| Evidence::new(lab, motions, Known::Tables, 0.0).only(StretchKind::Contact);
    let case = Case { key: "marker_overshoot", truth: &[C_S2], ..Case::default() };
    recovers(&case, &of(&swinging, &motions(&swinging)), &of(lab, motions_of_twin));
}

/// All markers of the trunk slide forward as it bends: 20 mm at half a radian, in proportion to the
/// sine of the angle.
pub fn soft_tissue() {
    let hidden = json!([{"effect": "soft_tissue", "link": "torso", "amplitude_m": 0.02, "along_bone": false}]);
    let slid = lab(&person(), &CAPTURE, SEED, &hidden);
    let slide = 0.02 / 0.5f64.sin();
    let of = |lab, motions| Evidence::new(lab, motions, Known::Tables, 0.0);
    let truth = [0.0, 0.0, slide, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let case = Case { key: "soft_tissue[torso]", truth: &truth, ..Case::default() };
    recovers(&case, &of(&slid, &motions(&slid)), &of(&plain().0, &plain().1));
}

/// A hinge displaced by some millimetres. With the inertial parameters known its position is found;
/// when they are fitted as well they absorb most of the displacement: it is a member of their
/// class.
pub fn joint_centre() {
    const KEY: &str = "joint_centre[link1]";
    let offset = [0.004, -0.006, 0.005];
    let (lab, motions) = chain::plain();
    let displaced = |known| {
        let twin = Evidence::new(lab, motions, known, 0.0);
        let mut moved = twin.clone();
        moved.model.links[1].joint.parent_from_joint.translation.vector += Vector3::from(offset);
        (twin, moved)
    };
    let (twin, moved) = displaced(Known::All);
    recovers(&Case { key: KEY, truth: &offset, ..Case::default() }, &moved, &twin);
    let error = |e: &Evidence| e.fit(&[], KEY, &[], &[]).held_out_error_before;
    let (known, fitted) = (error(&moved), error(&displaced(Known::Mass).1));
    println!("held-out error {known} N with the parameters known, {fitted} N with them fitted");
    assert!(fitted < 0.5 * known, "{fitted} N of {known} N are left");
}

/// A bend of 0.7 × 8 mm in the height at a metre from the middle, and others. If the middle of the
/// flights differs from that of the cameras the bend causes a stretch, which is equivalent to
/// gravity of another size and direction: both are in the model as well.
pub fn camera_warp() {
    let bent = lab(&chain::chain(), &json!({}), chain::SEED, &json!([{"effect": "camera_warp", "amplitude_m": 0.008}]));
    let of = |lab, motions| Evidence::new(lab, motions, Known::Mass, 0.0);
    let case = Case {
        key: "camera_warp",
        truth: &[0.0, 0.0, 0.0, 0.7 * 0.008],
        beside: &["gravity_scale", "gravity_tilt"],
        ..Case::default()
    };
    recovers(&case, &of(&bent, &motions(&bent)), &of(&chain::plain().0, &chain::plain().1));
}

/// Flights that begin 40 ms before the feet leave the plates, the reach of the law, seen through
/// windows of 0.1 s. Both feet push, and the law has one link: the load is found within a fifth,
/// because it does not fall linearly; its line of action is not found.
pub fn residual_contact() {
    const EARLY: usize = 8;
    let (lab, motions) = plain();
    let mut load_n = Vec::new();
    let mut of = |early: usize| {
        let mut evidence = Evidence::new(lab, motions, Known::Tables, 0.0).only(StretchKind::Flight);
        evidence.options.window_s = Some(0.1);
        for t in &mut evidence.trials {
            let (_, trial) = moving(lab).find(|(_, trial)| trial.name == t.motion.trial).unwrap();
            for s in &mut t.stretches {
                s.first_frame -= 2 + early;
                if early > 0 {
                    load_n.push(trial.motion.contact[s.first_frame * lab.ticks_per_frame].force_n.z);
                }
            }
        }
        let found = evidence.fit(&[], "residual_contact[foot_r]", &[], &[]).coefficients;
        found.into_iter().find(|e| e.name == "start_force_z").unwrap()
    };
    let (found, none) = (of(EARLY), of(0));
    let load = load_n.iter().sum::<f64>() / load_n.len() as f64;
    println!("{} ± {} N of {load}; twin {} ± {}", found.value, found.se, none.value, none.se);
    assert!((found.value - load).abs() <= 0.2 * load && found.se < 0.2 * load, "{found:?} {load}");
    assert!(none.value.abs() <= (0.2 * load).max(3.0 * none.se), "{none:?} {load}");
}
