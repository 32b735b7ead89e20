//! A marker that was put back elsewhere between recordings, on a chain on which a force acts too:
//! the marker is said, and no effect is named before it is left out.

use crate::support::{expect, folder, json, names, repo, unwrapped};
use aloft_c3d::C3dFile;
use nalgebra::{Matrix3, Vector3};
use std::fs;
use std::path::Path;

const SCENARIO: &str = "name: moved\nseed: 521\nbody: {kind: chain, throws: {recordings: 5, throws: 4}}\n\
    hidden: [{effect: constant_force, link: link0, force_n: [0.08, 0.0, 0.0]}]\n";

/// Moves a marker with its link, which three other markers show; mm.
fn put_elsewhere(path: &Path, label: &str, others: [&str; 3], by_mm: Vector3<f64>) {
    let mut file = C3dFile::from_bytes(&fs::read(path).unwrap()).unwrap();
    let of = |label: &str| file.points.iter().position(|p| p.label == label).unwrap();
    let (moved, [a, b, c]) = (of(label), others.map(of));
    for frame in 0..file.n_frames {
        let at = |i: usize| Vector3::from(file.points[i].xyz[frame]).map(f64::from);
        let x = (at(b) - at(a)).normalize();
        let z = x.cross(&(at(c) - at(a))).normalize();
        let to = at(moved) + Matrix3::from_columns(&[x, z.cross(&x), z]) * by_mm;
        file.points[moved].xyz[frame] = to.map(|v| v as f32).into();
    }
    fs::write(path, file.to_bytes().unwrap()).unwrap();
}

#[test]
fn no_effect_is_named_before_a_marker_that_was_put_elsewhere_is_left_out() {
    let dir = folder();
    let scenario = dir.path().join("moved.yaml");
    fs::write(&scenario, SCENARIO).unwrap();
    let data = dir.path().join("data");
    expect(&["simulate", &scenario.display().to_string(), "--out", &data.display().to_string()], 0);
    for name in ["throws_03", "throws_04", "throws_05"] {
        let moved = Vector3::new(3.0, -3.0, 4.0);
        put_elsewhere(&data.join(format!("{name}.c3d")), "L0_5", ["L0_1", "L0_2", "L0_4"], moved);
    }
    fs::create_dir(dir.path().join("pipelines")).unwrap();
    let pipeline = dir.path().join("pipelines/chain.yaml");
    let text = fs::read_to_string(repo("pipelines/chain.yaml")).unwrap();
    fs::write(&pipeline, &text).unwrap();
    let (yaml, data, ws) =
        (pipeline.display().to_string(), data.display().to_string(), dir.path().join("ws").display().to_string());
    let at = [&yaml, "--data", &data, "--workspace", &ws];
    let (said, _) = expect(&[&["run"], &at[..]].concat(), 0);
    let said = unwrapped(said.as_bytes());
    assert!(said.contains("marker L0_5 of link0 sits") && said.contains("gate not passed"), "{said}");
    let found = json(&[&["discover"], &at[..], &["--closed", "--json"]].concat());
    assert_eq!((found["verdict"].as_str(), names(&found["effects"]).len()), (Some("not_detectable"), 0), "{found}");
    assert!(found["groups"].as_array().unwrap().is_empty());
    assert!(found["to_correct"].as_str().unwrap().contains("L0_5"), "{}", found["to_correct"]);

    // what is proposed, written into the pipeline
    fs::write(&pipeline, format!("{text}\nik: {{weights: {{L0_5: 0}}}}\n")).unwrap();
    let (said, _) = expect(&[&["run"], &at[..]].concat(), 0);
    assert!(unwrapped(said.as_bytes()).contains("something missing"), "{said}");
    let found = json(&[&["discover"], &at[..], &["--closed", "--json"]].concat());
    assert!(names(&found["effects"]).contains(&"constant_force"), "{}", found["words"]);
}
