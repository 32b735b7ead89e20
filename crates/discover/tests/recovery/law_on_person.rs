//! A law that no catalogue lists, on a person: a drag of the forearm that depends on how it is
//! turned.

use crate::lab::{Evidence, Known, lab, motions};
use crate::person::CAPTURE;
use aloft_discover::{Action, Direction, DiscoverOptions, HeldOutResult, Session, Verdict, catalogue, discover};
use aloft_effects::{EffectInstance, FormulaEffect, Target};
use aloft_regressor::StretchKind;
use serde_json::json;

const LAW: &str = "id: hidden\npoint: {link: forearm_r, position_m: [0.0, -0.2, 0.0]}\n\
    force: ['-c*v_x*speed*tilt_y^2', '-c*v_y*speed*tilt_y^2', '-c*v_z*speed*tilt_y^2']\n\
    coefficients: [{name: c, unit: N*s^2/m^2}]";
/// Error without the law in the model over that without the law.
const STRENGTH: f64 = 6.0;

#[test]
fn a_drag_by_the_inclination_of_its_link_is_found_on_a_person() {
    let body = json!({"kind": "human", "protocol": {"jumps": 8, "exercises": 0, "static_s": 0.5},
        "person": {"sex": "F", "height_m": 1.68, "mass_kg": 62.0}});
    let lab = lab(&body, &CAPTURE, 13, &json!([]));
    let evidence = Evidence::new(&lab, &motions(&lab), Known::Tables, 0.0).only(StretchKind::Flight);
    let formula: FormulaEffect = serde_yaml::from_str(LAW).unwrap();
    evidence.with(|scene, empty| {
        let options = DiscoverOptions { rounds: 1, null_draws: 60, ..Default::default() };
        let closed = DiscoverOptions { closed: true, only: vec!["gravity_tilt".to_owned()], ..options.clone() };
        let error = |s: &Session<'_>| discover(s, &catalogue(), &[], &closed).unwrap().held_out_error;
        let with = |size: f64| {
            let compiled = formula.compile(scene).unwrap();
            let hidden =
                EffectInstance { effect: &compiled, target: Target::Body, nonlinear: Vec::new(), trials: Vec::new() };
            let mut session = empty.clone();
            session.inject(&hidden, &[size]).unwrap();
            session
        };
        let floor = error(empty);
        let session = with((STRENGTH * STRENGTH - 1.0).sqrt() * floor / error(&with(1.0)));
        let standing = HeldOutResult {
            held_out_error: error(&session),
            noise_floor: floor,
            noise_floor_ci95: Some([0.88 * floor, 1.12 * floor]),
            by_parameters: None,
        };
        let known = session.clone().with_model_error(Some(standing), None);
        let d = discover(&known, &catalogue(), &[], &options).unwrap();
        println!("{}", d.words);
        let law = &d.open.as_ref().unwrap().laws[0];
        let links = [&law.carrier].into_iter().chain(&law.also);
        assert!(links.clone().any(|l| l == "forearm_r"), "{law:?}");
        assert_eq!((law.action, law.direction), (Action::Force, Direction::AgainstVelocity));
        assert_eq!(law.variables, ["speed", "tilt_y"]);
        // a floor that is known roughly does not hide it
        let rough = HeldOutResult {
            noise_floor: standing.held_out_error / 1.4,
            noise_floor_ci95: Some([0.6, 1.6].map(|times| times * standing.held_out_error / 1.4)),
            ..standing
        };
        let d = discover(&session.with_model_error(Some(rough), None), &catalogue(), &[], &options).unwrap();
        assert_eq!(d.verdict, Verdict::Unexplained, "{}", d.words);
        assert_eq!(d.open.as_ref().unwrap().laws[0].variables, ["speed", "tilt_y"]);
    });
}
