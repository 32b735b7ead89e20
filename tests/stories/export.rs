//! Export: files for other programs, a README, and no foreign file is overwritten.

use crate::support::{expect, folder, lab, repo};
use std::fs;

#[test]
fn an_export_is_written_explained_and_never_overwrites() {
    let dir = folder();
    let ws = dir.path().join("ws").display().to_string();
    let pipeline = dir.path().join("p.yaml");
    let text = fs::read_to_string(repo("pipelines/demo.yaml")).unwrap();
    let recordings = repo("fixtures/demo");
    fs::write(&pipeline, &text).unwrap();
    let p = pipeline.display().to_string();
    let base = [p.as_str(), "--data", &recordings, "--workspace", &ws];
    let out = dir.path().join("out");
    let to = out.display().to_string();
    let export = |extra: &[&str], code| expect(&[&["export"], &base[..], &["--to", &to], extra].concat(), code);

    let (_, err) = export(&[], 2);
    assert!(err.contains("aloft run"), "nothing was run yet: {err}");
    expect(&[&["run"], &base[..]].concat(), 0);

    // one trial in two formats; then everything else in addition
    export(&["--format", "trc,csv", "--trial", "throws_01"], 0);
    assert!(out.join("MarkerData/throws_01.trc").is_file() && out.join("Tables/throws_01.csv").is_file());
    assert!(!out.join("Models").exists() && !out.join("MarkerData/throws_02.trc").exists());
    let (path, err) = export(&[], 0);
    assert_eq!(path.trim(), to);
    assert!(err.contains("2 as before") || err.contains(" as before"), "{err}");
    let id = fs::read_dir(out.join("Models"))
        .unwrap()
        .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
        .find(|n| n.ends_with(".urdf"))
        .unwrap();
    let id = id.trim_end_matches(".urdf");
    let readme = fs::read_to_string(out.join("README.md")).unwrap();
    for file in [
        format!("Models/{id}.osim"),
        format!("Models/{id}.urdf"),
        format!("Models/{id}.xml"),
        "MarkerData/throws_02.trc".into(),
        "IK/throws_02_ik.mot".into(),
        "IK/throws_02_velocities.sto".into(),
        "ID/throws_02_residual.sto".into(),
        "C3D/throws_02.c3d".into(),
        "Tables/throws_02.parquet".into(),
        "Tables/throws_02.csv".into(),
        "BIDS/dataset_description.json".into(),
        "pipeline.yaml".into(),
        "methods.txt".into(),
    ] {
        assert!(out.join(&file).is_file(), "{file}");
        assert!(readme.contains(&format!("`{file}`")), "README does not name {file}");
    }
    let methods = fs::read_to_string(out.join("methods.txt")).unwrap();
    assert!(
        readme.contains(methods.trim()) && methods.contains("18 flights") && methods.contains("σ(N−1)/σ(N)"),
        "{methods}"
    );
    let hash = |f: &str| {
        let manifest: serde_json::Value =
            serde_json::from_str(&fs::read_to_string(out.join("export.json")).unwrap()).unwrap();
        manifest["files"][f]["blake3"].as_str().unwrap().to_owned()
    };
    assert_eq!(hash("pipeline.yaml").len(), 64);
    assert!(!readme.contains(&dir.path().display().to_string()), "paths in the README are relative");

    // a second export changes nothing
    let (_, err) = export(&[], 0);
    assert!(err.contains("as before") && !err.contains("new") && !err.contains(" changed"), "{err}");

    // another cut-off changes the filtered files but not the markers
    let before = (hash("MarkerData/throws_02.trc"), hash("IK/throws_02_ik_filtered.mot"));
    fs::write(&pipeline, text.replace("cutoff_hz: 10.0", "cutoff_hz: 8.0")).unwrap();
    let (_, err) = export(&["--format", "trc"], 2);
    assert!(err.contains("earlier results"), "{err}");
    let (_, err) = export(&[], 0);
    assert!(err.contains("stale"), "{err}");
    expect(&[&["run"], &base[..]].concat(), 0);
    let (_, err) = export(&[], 0);
    assert!(err.contains("changed"), "{err}");
    assert_eq!(hash("MarkerData/throws_02.trc"), before.0);
    assert_ne!(hash("IK/throws_02_ik_filtered.mot"), before.1);

    // files edited by the user and foreign files are kept
    let edited = out.join("Tables/throws_01.csv");
    fs::write(&edited, "my own columns").unwrap();
    let (_, err) = export(&[], 2);
    // long paths are wrapped
    let err: String = err.split(['\n', '│']).map(str::trim).collect();
    assert!(err.contains("Tables/throws_01.csv") && err.contains("--to"), "{err}");
    assert_eq!(fs::read_to_string(&edited).unwrap(), "my own columns");
    let theirs = dir.path().join("thesis");
    fs::create_dir(&theirs).unwrap();
    fs::write(theirs.join("chapter1.txt"), "precious").unwrap();
    let (_, err) = expect(&[&["export"], &base[..], &["--to", &theirs.display().to_string()]].concat(), 2);
    let words: Vec<&str> = err.split(['\n', '│']).map(str::trim).collect();
    assert!(words.join(" ").contains("nothing of yours is overwritten"), "{err}");
    assert_eq!(fs::read_dir(&theirs).unwrap().count(), 1);
    let (_, err) = export(&["--format", "docx"], 2);
    assert!(err.contains("docx") && err.contains("parquet"), "{err}");
}

#[test]
fn a_person_is_handed_over_in_either_convention() {
    let dir = folder();
    let data = lab("fixtures/scenarios/human_small.yaml", dir.path()).display().to_string();
    let ws = dir.path().join("ws").display().to_string();
    let base = [repo("pipelines/human.yaml"), "--data".into(), data, "--workspace".into(), ws];
    let base: Vec<&str> = base.iter().map(String::as_str).collect();
    expect(&[&["run"], &base[..]].concat(), 0);
    for (angles, coordinate) in [("model", "arm_flex_r"), ("isb", "shoulder_elevation_r")] {
        let out = dir.path().join(angles);
        let to = out.display().to_string();
        expect(
            &[&["export"], &base[..], &["--to", &to, "--angles", angles, "--format", "osim,mot,forces,sto"]].concat(),
            0,
        );
        let mot = fs::read_to_string(out.join("IK/exercise01_ik.mot")).unwrap();
        assert!(mot.contains(&format!("\t{coordinate}\t")) && mot.contains("inDegrees=yes"), "{angles}");
        let model = fs::read_dir(out.join("Models")).unwrap().map(|e| e.unwrap().path());
        let model = model
            .filter(|p| !p.display().to_string().contains("prior"))
            .find(|p| p.extension().is_some_and(|e| e == "osim"));
        let osim = fs::read_to_string(model.unwrap()).unwrap();
        assert!(osim.contains(&format!("<Coordinate name=\"{coordinate}\">")), "model and table agree");
        let loads = fs::read_to_string(out.join("ID/exercise01_external_forces.xml")).unwrap();
        assert!(
            loads.contains("<applied_to_body>foot_r</applied_to_body>")
                && loads.contains("<applied_to_body>foot_l</applied_to_body>")
        );
        assert!(fs::read_to_string(out.join("README.md")).unwrap().contains(&format!("convention `{angles}`")));
    }
}
