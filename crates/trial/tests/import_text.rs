//! TRC and MOT import against hand-made text and the real drop jumps.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests, not library code")]

#[path = "../../../tests/shared_data.rs"]
mod shared_data;

use aloft_trial::{ImportOptions, Trial, TrialError, UpAxis};
use nalgebra::Vector3;

const TRC: &str = "PathFileType\t4\t(X/Y/Z)\tx.trc\n\
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n\
100\t100\t3\t2\tmm\t100\t1\t3\n\
Frame#\tTime\tS:A\t\t\tB\t\t\t\n\
\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\
\n\
1\t0.00\t1000\t2000\t3000\t0\t0\t0\t\n\
2\t0.01\t\t\t\t10\t20\t30\t\n\
4\t0.03\tNaN\t1\t2\t10\t20\t30\n";

#[test]
fn regress_trc_units_gaps_zeros_and_lost_frames() {
    let trial = Trial::from_trc_mot("t", TRC, None, &ImportOptions::default()).unwrap();
    assert_eq!(trial.markers.labels, ["A", "B"]);
    assert_eq!(trial.markers.n_frames, 4);
    assert_eq!(trial.markers.rate_hz, 100.0);
    // Y up to Z up: (x, y, z) to (x, -z, y).
    assert_eq!(trial.markers.position(0, 0), Some(Vector3::new(1.0, -3.0, 2.0)));
    assert_eq!((1..4).map(|f| trial.markers.position(0, f)).collect::<Vec<_>>(), [None, None, None]);
    assert_eq!(trial.markers.position(1, 0), None);
    assert_eq!(trial.markers.position(1, 2), None);
    assert!((trial.markers.position(1, 3).unwrap() - Vector3::new(0.01, -0.03, 0.02)).norm() < 1e-15);
    assert!(trial.warnings.iter().any(|w| w.message.contains("1 frames are not in the file")), "{:?}", trial.warnings);
}

#[test]
fn regress_errors_are_one_line_and_name_the_place() {
    let options = ImportOptions::default();
    let say = |trc: &str, mot: Option<&str>| Trial::from_trc_mot("jump 3", trc, mot, &options).unwrap_err().to_string();
    let cases = [
        (say("", None), "jump 3: the file is empty"),
        (say("hello", None), "jump 3: TRC line 1: found `hello`, expected the word `PathFileType`"),
        (say(&TRC.replace("\tmm\t", "\tbarn\t"), None), "jump 3: TRC line 3, `Units`: unit `barn`"),
        (
            say(&TRC.replace("2000", "20x0"), None),
            "jump 3: TRC line 7: found `20x0`, expected a number or an empty cell",
        ),
        (
            say(TRC, Some("no header")),
            "jump 3: MOT line 1: found `no header`, expected a header that ends with `endheader`",
        ),
        (
            say(TRC, Some("a\nendheader\ntime\tx\n0\t1\n1\n")),
            "jump 3: MOT line 5: found `1 columns`, expected 2 columns",
        ),
    ];
    for (message, expected) in cases {
        assert!(message.starts_with(expected), "{message}");
        assert!(!message.contains('\n'));
    }
    let cut = &TRC[..TRC.find("1\t0.00").unwrap()];
    assert!(matches!(Trial::from_trc_mot("t", cut, None, &options), Err(TrialError::NoFrames { .. })));
}

#[test]
fn validate_moments_about_the_origin_and_both_header_styles() {
    let body = "time\tl_ground_force_vx\tl_ground_force_vy\tl_ground_force_vz\tl_ground_force_px\tl_ground_force_py\tl_ground_force_pz\tl_ground_torque_x\tl_ground_torque_y\tl_ground_torque_z\n\
-0.002\t9\t9\t9\t9\t9\t9\t9\t9\t9\n0.000\t10\t700\t-20\t0.3\t0\t0.4\t0\t5\t0\n0.002\t0\t0\t0\t0\t0\t0\t0\t0\t0\n0.004\t0\t0\t0\t0\t0\t0\t0\t0\t0\n";
    let classic = format!("name grf\ndatacolumns 10\ndatarows 4\nrange 0 1\nendheader\n{body}");
    let modern = format!("grf\nversion=1\nnRows=4\nnColumns=10\ninDegrees=yes\nendheader\n\n{body}");
    for mot in [classic, modern] {
        let trial = Trial::from_trc_mot("t", TRC, Some(&mot), &ImportOptions::default()).unwrap();
        let plate = &trial.plates[0];
        assert_eq!((plate.name.as_str(), plate.rate_hz, plate.force_n.len()), ("l", 500.0, 3));
        assert_eq!(plate.force_n[0], Vector3::new(10.0, 20.0, 700.0));
        let source = Vector3::new(0.3, 0.0, 0.4).cross(&Vector3::new(10.0, 700.0, -20.0)) + Vector3::new(0.0, 5.0, 0.0);
        let expected = UpAxis::Y.world_from_source() * source;
        assert!((plate.moment_nm[0] - expected).norm() < 1e-12);
        assert_eq!(plate.force_n[1], Vector3::zeros());
    }
}

#[test]
fn regress_real_drop_jump() {
    let Some(folder) = shared_data::shared_data("real_drop_jump") else { return };
    let trc = std::fs::read_to_string(folder.join("markers/static1.trc")).unwrap();
    let mot = std::fs::read_to_string(folder.join("forces/static1_grf.mot")).unwrap();
    let trial = Trial::from_trc_mot("static1", &trc, Some(&mot), &ImportOptions::default()).unwrap();
    assert_eq!((trial.markers.labels.len(), trial.markers.n_frames, trial.plates.len()), (55, 517, 3));
    let head_end = trial.markers.index("C7").unwrap();
    assert!((1.3..1.6).contains(&trial.markers.position(head_end, 100).unwrap().z));
    let weight: f64 = trial.plates.iter().map(|p| p.force_n[200].z).sum();
    assert!((weight / 9.81 - 60.05).abs() < 0.6, "{weight}");
    // The centre of pressure of all plates lies below the body.
    let force = trial.plates.iter().map(|p| p.force_n[200]).sum::<Vector3<f64>>();
    let moment = trial.plates.iter().map(|p| p.moment_nm[200]).sum::<Vector3<f64>>();
    let (x, y) = (-moment.y / force.z, moment.x / force.z);
    let pelvis = trial.markers.position(trial.markers.index("L.ASIS").unwrap(), 200).unwrap();
    assert!((x - pelvis.x).abs() < 0.2 && (y - pelvis.y).abs() < 0.3, "{x} {y} {pelvis}");
    assert!(trial.warnings.is_empty(), "{:?}", trial.warnings);
}
