//! Scaling of the two-link chain against the simulator's truth. Recordings lie beside the project and may be absent.

use aloft_scale::{ObjectInput, ObjectOptions, ObjectSpec, ScaledObject, scale_object};
use aloft_trial::{ImportOptions, Trial};
use nalgebra::{Matrix3, Rotation3, Vector3};
use std::path::PathBuf;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn spec() -> ObjectSpec {
    serde_yaml::from_str(&std::fs::read_to_string(root().join("configs/objects/two_link_chain.yaml")).unwrap()).unwrap()
}

fn trial(set: &str, name: &str) -> Option<Trial> {
    let Ok(bytes) = std::fs::read(root().join("../shared/data").join(set).join(format!("{name}.c3d"))) else {
        println!("skipped: {set}/{name}.c3d is not beside the project");
        return None;
    };
    Some(Trial::from_c3d(name, &bytes, &ImportOptions::default()).unwrap())
}

#[derive(serde::Deserialize)]
struct Hinge {
    p_link0: [f64; 3],
    #[serde(rename = "R_link0_link1_q0")]
    r: [[f64; 3]; 3],
}

#[derive(serde::Deserialize)]
struct Truth {
    hinge: Hinge,
    markers_link0_m: Vec<[f64; 3]>,
    markers_link1_m: Vec<[f64; 3]>,
}

struct Errors {
    centre_mm: f64,
    axis_mrad: f64,
    zero_mrad: f64,
    marker_mm: f64,
}

fn errors(found: &ScaledObject, set: &str) -> Errors {
    let path = root().join("../shared/data").join(set).join("truth/truth.json");
    let truth: Truth = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let joint = &found.subject.model.links[1].joint.parent_from_joint;
    let r = Matrix3::from_fn(|i, j| truth.hinge.r[i][j]);
    let mine = joint.rotation.to_rotation_matrix().into_inner();
    let turn = Rotation3::from_matrix_unchecked(r.transpose() * mine).scaled_axis();
    let true_markers = truth.markers_link0_m.iter().chain(&truth.markers_link1_m);
    Errors {
        centre_mm: 1e3 * (joint.translation.vector - Vector3::from(truth.hinge.p_link0)).norm(),
        axis_mrad: 1e3 * turn.xy().norm(),
        zero_mrad: 1e3 * turn.z.abs(),
        marker_mm: found
            .subject
            .markers
            .iter()
            .zip(true_markers)
            .map(|(m, t)| 1e3 * (m.position_m - Vector3::from(*t)).norm())
            .fold(0.0, f64::max),
    }
}

fn scaled(set: &str, motion: &[&str]) -> Option<ScaledObject> {
    let still = trial(set, "static")?;
    let motion: Vec<Trial> = motion.iter().map(|n| trial(set, n)).collect::<Option<_>>()?;
    let motion: Vec<&Trial> = motion.iter().collect();
    let start = std::time::Instant::now();
    let found =
        scale_object(&ObjectInput { spec: &spec(), static_trial: &still, motion_trials: &motion }, &ObjectOptions::default())
            .unwrap();
    let e = errors_if_known(&found, set);
    println!(
        "{set}: {} frames, {} iterations, noise {:.3} mm, outliers {}, first guess {:.2} mm, range {:.0?}°{e}; {:.2} s",
        found.report.frames,
        found.report.iterations,
        1e3 * found.report.noise_m,
        found.report.outliers,
        1e3 * found.report.joints[0].first_guess_rms_m,
        (found.report.joints[0].range_rad.0.to_degrees(), found.report.joints[0].range_rad.1.to_degrees()),
        start.elapsed().as_secs_f64(),
    );
    Some(found)
}

fn errors_if_known(found: &ScaledObject, set: &str) -> String {
    if set == "chain_b" {
        return String::new();
    }
    let e = errors(found, set);
    format!(
        "; hinge {:.4} mm, axis {:.3} mrad, zero {:.3} mrad, worst marker {:.4} mm",
        e.centre_mm, e.axis_mrad, e.zero_mrad, e.marker_mm
    )
}

#[test]
fn validate_the_chains_geometry_against_the_simulators_truth() {
    for set in ["chain_a", "chain_p"] {
        let Some(found) = scaled(set, &["hinge_calib"]) else { return };
        let e = errors(&found, set);
        assert!(e.centre_mm < 0.1 && e.axis_mrad < 0.5 && e.zero_mrad < 0.5 && e.marker_mm < 0.1, "{set}");
        assert!((found.report.noise_m - 3e-4).abs() < 2e-5);
        assert_eq!(found.report.outliers, 0);
        assert!(found.report.warnings.is_empty(), "{:?}", found.report.warnings);
        let mass: f64 = found.subject.prior.iter().map(|p| p.mass_kg).sum();
        assert!((mass - 0.997).abs() < 1e-12);
        for p in &found.subject.prior {
            println!("  prior {:.3} kg at {:?}", p.mass_kg, p.com_m.as_slice());
        }
        // With the throws as well.
        let all = ["hinge_calib", "throws_01", "throws_02", "throws_03", "throws_04", "throws_05"];
        let Some(found) = scaled(set, &all) else { return };
        let e = errors(&found, set);
        assert!(e.centre_mm < 0.05 && e.axis_mrad < 0.3 && e.zero_mrad < 0.3 && e.marker_mm < 0.05, "{set}");
    }
    scaled("chain_b", &["hinge_calib"]);
}

#[test]
fn prop_a_specification_that_contradicts_itself_is_refused_with_its_link() {
    let still = Trial::default();
    let refuse = |change: &dyn Fn(&mut ObjectSpec)| {
        let mut s = spec();
        change(&mut s);
        scale_object(&ObjectInput { spec: &s, static_trial: &still, motion_trials: &[] }, &ObjectOptions::default())
            .unwrap_err()
            .to_string()
    };
    assert!(refuse(&|s| s.links[1].parent = Some("nothing".into())).contains("link1"));
    assert!(refuse(&|s| s.links[1].joint = None).contains("joint"));
    assert!(refuse(&|s| s.links[0].markers.truncate(2)).contains("three"));
    assert!(refuse(&|s| s.links[1].markers.push("L0_1".into())).contains("twice"));
    assert!(refuse(&|s| s.links[1].frame = s.links[0].frame.clone()).contains("hinge"));
    assert!(refuse(&|s| s.total_mass_kg = -1.0).contains("mass"));
    assert!(refuse(&|s| s.links.clear()).contains("no links"));
    assert!(refuse(&|_| ()).contains("no marker frames"));
}
