//! Faults of what cameras and skeletons show: filters, skin, joint centres, the camera volume, edges of flights.

use crate::chain;
use crate::lab::{Evidence, Known, lab, motions, moving};
use crate::person::{CAPTURE, SEED, person, plain};
use crate::{Case, recovers};
use aloft_regressor::StretchKind;
use nalgebra::Vector3;
use serde_json::json;

/// Markers through a mean over eleven frames (55 ms), the person on the plates: k is half the variance of the window's times. In the air a parabola
/// passes such a filter unchanged.
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
    recovers(&case, &of(&smooth, &motions(&smooth)), Some(&of(lab, motions_of_twin)));
}

/// All markers of the trunk slide forward as it bends: 20 mm at half a radian, in proportion to the sine of the angle.
pub fn soft_tissue() {
    let hidden = json!([{"effect": "soft_tissue", "link": "torso", "amplitude_m": 0.02, "along_bone": false}]);
    let slid = lab(&person(), &CAPTURE, SEED, &hidden);
    let slide = 0.02 / 0.5f64.sin();
    let of = |lab, motions| Evidence::new(lab, motions, Known::Tables, 0.0);
    let truth = [0.0, 0.0, slide, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let case = Case { key: "soft_tissue[torso]", truth: &truth, ..Case::default() };
    recovers(&case, &of(&slid, &motions(&slid)), Some(&of(&plain().0, &plain().1)));
}

/// A hinge some millimetres from where it is. With the inertial parameters known its place is found; without them they take it up, and nothing is
/// left to find: a member of their class.
pub fn joint_centre() {
    let offset = [0.004, -0.006, 0.005];
    let (lab, motions) = chain::plain();
    let displaced = |known| {
        let twin = Evidence::new(lab, motions, known, 0.0);
        let mut moved = twin.clone();
        moved.model.links[1].joint.parent_from_joint.translation.vector += Vector3::from(offset);
        (twin, moved)
    };
    let (twin, moved) = displaced(Known::All);
    recovers(&Case { key: "joint_centre[link1]", truth: &offset, ..Case::default() }, &moved, Some(&twin));
    let (twin, moved) = displaced(Known::Mass);
    let error = |e: &Evidence| e.fit(&[], "joint_centre[link1]", &[], &[]).held_out_error_before;
    let ratio = error(&moved) / error(&twin);
    assert!(ratio < 1.1, "the inertial parameters leave {ratio} of the twin's error");
}

/// A bend of 0.7 × 8 mm in the height at a metre from the middle, and others. Where flights have their middle apart from that of the cameras the bend
/// brings a stretch, which is a gravity of another size and direction: both stand beside it.
pub fn camera_warp() {
    let bent = lab(&chain::chain(), &json!({}), chain::SEED, &json!([{"effect": "camera_warp", "amplitude_m": 0.008}]));
    let of = |lab, motions| Evidence::new(lab, motions, Known::Mass, 0.0);
    let case = Case {
        key: "camera_warp",
        truth: &[0.0, 0.0, 0.0, 0.7 * 0.008],
        beside: &["gravity_scale", "gravity_tilt"],
        ..Case::default()
    };
    recovers(&case, &of(&bent, &motions(&bent)), Some(&of(&chain::plain().0, &chain::plain().1)));
}

/// Flights that begin before the feet have left the plates.
pub fn residual_contact() {
    for (early, window) in [(0, 0.15), (4usize, 0.15), (6, 0.15), (8, 0.15), (4, 0.1), (6, 0.1), (8, 0.1)] {
    let (lab, motions) = plain();
    let mut e = Evidence::new(lab, motions, Known::Tables, 0.0).only(StretchKind::Flight);
    e.options.window_s = Some(window);
    let (mut sum, mut n) = (Vector3::zeros(), 0.0);
    for t in &mut e.trials {
        let trial = moving(lab).find(|(_, x)| x.name == t.motion.trial).unwrap().1;
        for s in &mut t.stretches {
            s.first_frame -= 2 + early;
            let load: Vec<String> = (0..10).map(|k| format!("{:.0}", trial.motion.contact[(s.first_frame + k) * lab.ticks_per_frame].force_n.z)).collect();
            println!("{}", load.join(" "));
            sum += trial.motion.contact[s.first_frame * lab.ticks_per_frame].force_n;
            n += 1.0;
        }
    }
    println!("early {early} window {window} truth {}", sum / n);
    for c in e.fit(&[], "residual_contact[foot_r]", &[], &[]).coefficients { println!("{} {} ± {}", c.name, c.value, c.se); }
    }
}
