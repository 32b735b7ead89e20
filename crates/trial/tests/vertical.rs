//! The vertical of recordings without plates: told by the body, whatever the axes of the screen
//! say.
#![allow(clippy::unwrap_used, reason = "helpers of tests, not library code")]

use aloft_c3d::{C3dBuilder, Parameter};
use aloft_trial::{ImportOptions, Trial, UpAxis};
use nalgebra::Vector3;

/// Two seconds of a standing person: label and place, m, Z up.
const STANDING: [(&str, [f64; 3]); 6] = [
    ("LHEE", [0.0, 0.1, 0.05]),
    ("RTOE", [0.2, -0.1, 0.04]),
    ("RANK", [0.02, -0.1, 0.09]),
    ("C7", [-0.1, 0.0, 1.45]),
    ("LSHO", [0.0, 0.2, 1.42]),
    ("LASI", [0.1, 0.12, 0.98]),
];

/// The same in a file whose axis `up` points up, with these axes of the screen.
fn recorded(up: UpAxis, screen: Option<&str>, names: bool) -> Trial {
    let source = up.world_from_source().inverse();
    let mut file = C3dBuilder::new(100.0).point_unit("mm");
    for (i, (label, at)) in STANDING.iter().enumerate() {
        let p = source * (Vector3::from(*at) * 1000.0);
        let label = if names { (*label).to_owned() } else { format!("M{i}") };
        file = file.marker(&label, vec![[p.x as f32, p.y as f32, p.z as f32]; 200]);
    }
    if let Some(screen) = screen {
        file = file.parameter("POINT", Parameter::text("Y_SCREEN", screen));
    }
    Trial::from_c3d_file("standing", &file.build().unwrap(), &ImportOptions::default()).unwrap()
}

fn stands(trial: &Trial) -> bool {
    let z = |i: usize| trial.markers.position(i, 10).unwrap().z;
    (z(3) - 1.45).abs() < 1e-3 && (z(0) - 0.05).abs() < 1e-3
}

#[test]
fn the_body_tells_the_vertical_and_contradictions_are_said_once() {
    let all = [UpAxis::X, UpAxis::Y, UpAxis::Z, UpAxis::NegX, UpAxis::NegY, UpAxis::NegZ];
    for up in all {
        for screen in [None, Some("-Z"), Some("+Y")] {
            let trial = recorded(up, screen, true);
            assert!(stands(&trial), "{up} {screen:?}: {:?}", trial.markers.position(3, 10));
            let said = trial.warnings.iter().filter(|w| w.message.contains("Y_SCREEN")).count();
            let contradicts = screen.is_some_and(|s| UpAxis::parse(s) != Some(up));
            assert_eq!(said, usize::from(contradicts), "{up} {screen:?}: {:?}", trial.warnings);
        }
    }
}

#[test]
fn without_any_evidence_a_negative_screen_axis_does_not_turn_the_body_over() {
    let trial = recorded(UpAxis::Z, Some("-Z"), false);
    assert!(stands(&trial));
    assert!(trial.warnings.iter().any(|w| w.message.contains("is not taken as the vertical")), "{:?}", trial.warnings);
    let stated = ImportOptions { up_axis: Some(UpAxis::NegZ), ..ImportOptions::default() };
    let file = C3dBuilder::new(100.0).marker("A", vec![[0.0, 0.0, -500.0]; 20]).build().unwrap();
    let trial = Trial::from_c3d_file("stated", &file, &stated).unwrap();
    assert!((trial.markers.position(0, 0).unwrap().z - 0.5).abs() < 1e-6);
}

#[test]
fn a_body_that_tumbles_in_the_air_falls_along_the_vertical() {
    // in the third throw the shoulders are beside the feet on average
    for k in 1..=6 {
        let name = format!("throw_{k:02}");
        let path = format!("{}/../../fixtures/osim/{name}.trc", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(path).unwrap();
        let trial = Trial::from_trc_mot(&name, &text, None, &ImportOptions::default()).unwrap();
        assert_eq!(trial.world_from_source, UpAxis::Y.world_from_source(), "{name}");
    }
}
