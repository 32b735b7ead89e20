//! Errors of force plates and of the scale, hidden in the recordings of a person who jumps and
//! moves on two plates.

use crate::lab::{Evidence, Known, lab};
use crate::person::{CAPTURE, SEED, person, plain};
use crate::{Case, recovers};
use aloft_discover::{DiscoverOptions, catalogue, discover};
use aloft_regressor::StretchKind;
use aloft_simulate::measure::plates::{PlateGeometry, record};
use aloft_simulate::random::Stream;
use aloft_simulate::{CaptureSpec, Hidden, Lab};
use nalgebra::{Matrix3, Vector3};
use serde_json::{Value, json};

/// Seconds between the starts of recordings.
const SPACING_S: f64 = 20.0;

/// The plates of the person's session simulated again, with errors.
fn read_again(hidden: &[Hidden]) -> Lab {
    let mut lab = plain().0.clone();
    let (ticks, capture) = (lab.ticks_per_frame, CaptureSpec::default());
    for trial in &mut lab.trials {
        let step = ticks / capture.analog_per_frame;
        let n = trial.markers.n_frames * capture.analog_per_frame;
        for (i, geometry) in PlateGeometry::pair().iter().enumerate() {
            let load: Vec<_> = (0..n).map(|k| trial.true_plates[i][k * step]).collect();
            let rng = &mut Stream::new(SEED, &format!("{}/again{i}", trial.name));
            trial.plates[i] = record(i, geometry, &load, &capture, hidden, &|k| k, rng);
        }
    }
    lab
}

fn with_plates_of(lab: &Lab) -> Evidence {
    Evidence::new(lab, &plain().1, Known::Tables, SPACING_S)
}

fn check(hidden: &[Hidden], key: &str, truth: &[f64]) {
    let case = Case { key, truth, ..Case::default() };
    recovers(&case, &with_plates_of(&read_again(hidden)), &with_plates_of(&plain().0));
}

/// Clock errors affect the whole session, not one instrument, so the whole session is simulated
/// again.
fn check_clock(hidden: &Value, key: &str, truth: f64) {
    let late = lab(&person(), &CAPTURE.clone(), SEED, hidden);
    let case = Case { key, truth: &[truth], ..Case::default() };
    recovers(&case, &with_plates_of(&late), &with_plates_of(&plain().0));
}

pub fn time_offset() {
    check_clock(&json!([{"effect": "plate_time_offset", "offset_s": 0.004}]), "plate_time_offset", 0.004);
}

pub fn clock_drift() {
    let hidden = json!([{"effect": "clock_drift", "rate_ppm": 60, "spacing_s": SPACING_S}]);
    check_clock(&hidden, "plate_clock_drift", 60e-6);
}

/// Axes of the plates in the world, and the sensor's origin from the middle of the surface.
fn axes() -> (Matrix3<f64>, Vector3<f64>) {
    let geometry = &PlateGeometry::pair()[0];
    let axes = geometry.world_from_plate();
    (axes, -(axes * geometry.origin_m))
}

/// Moments of ten newton metres and more, because soft tissue that slides by 3 mm under half the
/// body's weight amounts to one newton metre.
pub fn tare() {
    let (force_n, moment_nm) = ([10.0, -15.0, 30.0], [9.0, -12.0, 6.0]);
    let (axes, sensor) = axes();
    let force = axes * Vector3::from(force_n);
    let moment = axes * Vector3::from(moment_nm) + sensor.cross(&force);
    let truth = [-force.x, -force.y, -force.z, -moment.x, -moment.y, -moment.z];
    check(&[Hidden::PlateTare { plate: 1, force_n, moment_nm }], "plate_tare[plate1]", &truth);
}

pub fn origin() {
    let shift_m = [0.010, -0.015, 0.010];
    check(&[Hidden::PlateOrigin { plate: 2, shift_m }], "plate_origin[plate2]", &shift_m);
}

pub fn rotation() {
    let turn_deg = [1.0, -1.5, 2.0];
    let truth = turn_deg.map(f64::to_radians);
    check(&[Hidden::PlateRotation { plate: 1, turn_deg }], "plate_rotation[plate1]", &truth);
}

pub fn gain() {
    // the plates' x is the room's y
    let gain = [1.05, 0.95, 1.03, 1.1, 0.9, 1.1];
    let truth = [1, 0, 2, 4, 3, 5].map(|k: usize| 1.0 / gain[k] - 1.0);
    check(&[Hidden::PlateGain { plate: 2, gain }], "plate_gain[plate2]", &truth);
}

/// The scale reads too much, and the whole prior of the body is too heavy in proportion. One gain
/// for all plates is equivalent to this error: both members of the class are found, each in its own
/// terms.
pub fn body_mass() {
    const EXCESS: f64 = 0.04;
    let twin = with_plates_of(&plain().0);
    let mut heavy = twin.clone();
    let truth = -EXCESS * twin.mass_kg;
    heavy.mass_kg *= 1.0 + EXCESS;
    for link in &mut heavy.links {
        link.mass_kg *= 1.0 + EXCESS;
        link.inertia_com_kgm2 *= 1.0 + EXCESS;
    }
    recovers(&Case { key: "body_mass", truth: &[truth], ..Case::default() }, &heavy, &twin);
    recovers(&Case { key: "plate_gain", truth: &[EXCESS], ..Case::default() }, &heavy, &twin);
}

/// Contact alone, with a stated mass that is far too high and a plate that reads too little: a
/// wrong mass and a gain would together scale both sides of every row to zero.
#[test]
fn without_flights_only_errors_of_the_plates_are_candidates() {
    let mut heavy =
        with_plates_of(&read_again(&[Hidden::PlateGain { plate: 1, gain: [0.8; 6] }])).only(StretchKind::Contact);
    heavy.mass_kg *= 1.2;
    for link in &mut heavy.links {
        link.mass_kg *= 1.2;
        link.inertia_com_kgm2 *= 1.2;
    }
    let options = DiscoverOptions { null_draws: 20, ..DiscoverOptions::default() };
    let found = heavy.with(|_, session| discover(session, &catalogue(), &[], &options).unwrap());
    assert!(!found.candidates.is_empty());
    for c in &found.candidates {
        let acts = aloft_effects::effect(&c.effect).unwrap().acts();
        assert!(acts.in_contact() && !acts.in_flight(), "{} needs a flight", c.effect);
    }
    let named = |id: &str| found.found.iter().any(|f| f.effect == id);
    assert!(!(named("body_mass") && named("plate_gain")), "{}", found.words);
    for f in &found.found {
        assert!(f.coefficients.iter().all(|c| f.effect != "plate_gain" || c.value.abs() < 0.45), "{f:?}");
    }
    assert!(found.warnings.iter().any(|w| w.starts_with("no recording has a flight")), "{:?}", found.warnings);
    // a force that acts in the air, too, is not tried even when asked for
    let only = DiscoverOptions { only: vec!["constant_force".into()], ..options };
    let found = heavy.with(|_, session| discover(session, &catalogue(), &[], &only).unwrap());
    assert!(found.candidates.is_empty() && found.effects.is_empty(), "{}", found.words);
}
