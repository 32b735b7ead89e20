//! Recordings as other programs and laboratories write them: what cannot be read is named, of
//! several people one is chosen by name, and no column or clock is dropped in silence.

use crate::robot::copy;
use crate::shared::shared_data;
use crate::support::{aloft, expect, folder, json, repo, unwrapped};
use aloft_c3d::{C3dFile, Parameter};
use std::fs;
use std::path::Path;

/// A recording of the demonstration.
fn recording(name: &str) -> C3dFile {
    C3dFile::from_bytes(&fs::read(repo(&format!("fixtures/human_twin/{name}.c3d"))).unwrap()).unwrap()
}

/// A folder of recordings that hold Ben, who stands 2 m beside, before Anna; and her facts.
fn two_people(lab: &Path, called: &str) {
    fs::create_dir(lab).unwrap();
    for name in ["static", "jump01", "jump02", "exercise01"] {
        let mut file = recording(name);
        let mut ben = file.points.clone();
        for point in &mut ben {
            point.label = format!("Ben:{}", point.label);
            point.xyz.iter_mut().for_each(|p| p[0] = 1.1 * p[0] + 2000.0);
        }
        file.points.iter_mut().for_each(|p| p.label = format!("Anna:{}", p.label));
        file.points.splice(0..0, ben);
        file.groups.set("SUBJECTS", Parameter::texts("NAMES", &["Ben", "Anna"]));
        fs::write(lab.join(format!("{name}.c3d")), file.to_bytes().unwrap()).unwrap();
    }
    fs::write(lab.join("subject.yaml"), format!("name: {called}\nsex: F\nheight_m: 1.7\nmass_kg: 60.0\n")).unwrap();
}

#[test]
fn a_recording_that_cannot_be_read_is_named_by_init_and_counted() {
    let dir = folder();
    let lab = dir.path().join("lab");
    fs::create_dir(&lab).unwrap();
    for name in ["static", "jump01", "exercise01"] {
        fs::write(lab.join(format!("{name}.c3d")), recording(name).to_bytes().unwrap()).unwrap();
    }
    fs::write(lab.join("jump02.c3d"), b"none").unwrap();
    let yaml = dir.path().join("a.yaml").display().to_string();
    let said = aloft(&["init", &lab.display().to_string(), "--out", &yaml]);
    let said = unwrapped(&said.stderr);
    assert!(said.contains("1 of 4 recordings cannot be read and is not used:"), "{said}");
    assert!(said.contains("jump02.c3d: jump02:"), "{said}");
}

#[test]
fn of_two_people_in_every_file_one_is_chosen_by_name_or_init_refuses() {
    let dir = folder();
    for (called, n) in [("Anna", 1), ("S01", 2)] {
        let lab = dir.path().join(format!("lab{n}"));
        two_people(&lab, called);
        let lab = lab.display().to_string();
        let yaml = dir.path().join(format!("{n}.yaml")).display().to_string();
        if called == "S01" {
            let refused = unwrapped(&aloft(&["init", &lab, "--out", &yaml]).stderr);
            assert!(refused.contains("4 of 4 recordings hold markers of several people (Anna, Ben)"), "{refused}");
            assert!(refused.contains("--subject Anna`"), "{refused}");
            let nobody = unwrapped(&aloft(&["init", &lab, "--out", &yaml, "--subject", "Cleo"]).stderr);
            assert!(nobody.contains("`Cleo` is none of them"), "{nobody}");
            expect(&["init", &lab, "--out", &yaml, "--subject", "anna"], 0);
        } else {
            let (_, said) = expect(&["init", &lab, "--out", &yaml], 0);
            assert!(unwrapped(said.as_bytes()).contains("those of Anna are used"), "{said}");
        }
        let text = fs::read_to_string(&yaml).unwrap();
        assert!(text.contains("  person: Anna "), "{text}");
        let (out, err) = expect(&["check", &yaml], 0);
        let said = unwrapped((out + &err).as_bytes());
        assert!(
            said.contains("markers of several people (Anna, Ben): those of Anna are used (all 4 trials)"),
            "{said}"
        );
        fs::write(&yaml, text.replace("  person: Anna ", "  person: Cleo ")).unwrap();
        let output = aloft(&["check", &yaml]);
        let said = unwrapped(&[output.stdout, output.stderr].concat());
        assert!(said.contains("none has the subject's name"), "{said}");
    }
    let file = dir.path().join("lab1/jump01.c3d").display().to_string();
    let labels: Vec<String> = json(&["inspect", &file, "--json"])["markers"]
        .as_array()
        .unwrap()
        .iter()
        .map(|m| m["label"].as_str().unwrap().to_owned())
        .collect();
    assert!(labels.contains(&"Anna:LASI".to_owned()) && labels.contains(&"Ben:LASI".to_owned()), "{labels:?}");
}

#[test]
fn columns_of_forces_that_belong_to_no_plate_are_named() {
    let dir = folder();
    let file = dir.path().join("a_grf.mot");
    let mut text = "grf\nversion=1\nnRows=100\nnColumns=7\nendheader\n".to_owned();
    text.push_str("time\tground_force_vx\tground_force_vy\tground_force_vz\tspin_x\tspin_y\tspin_z\n");
    (0..100).for_each(|r| text.push_str(&format!("{:.3}\t1\t700\t2\t0\t3\t0\n", f64::from(r) / 1000.0)));
    fs::write(&file, text).unwrap();
    let (out, _) = expect(&["inspect", &file.display().to_string()], 0);
    let said = unwrapped(out.as_bytes());
    assert!(said.contains("belong to no plate are not used: `spin_x` to `z`; `import: {forces: …}`"), "{said}");
}

#[test]
fn files_of_other_programs_give_the_result_of_the_plain_ones() {
    for (case, base) in [("mot_motonms_names", "_t_base"), ("two_people_second_named", "_base")] {
        let (Some(base), Some(case)) =
            (shared_data(&format!("../cases/r3/{base}")), shared_data(&format!("../cases/r3/{case}")))
        else {
            return;
        };
        let dir = folder();
        let lab = dir.path().join("lab");
        copy(&base, &lab);
        for entry in fs::read_dir(&case).unwrap() {
            let (from, name) = entry.map(|e| (e.path(), e.file_name())).unwrap();
            // copies of files that may not be written
            let to = lab.join(name);
            if to.exists() {
                fs::remove_file(&to).unwrap();
            }
            fs::write(to, fs::read(from).unwrap()).unwrap();
        }
        let path = |name: &str| dir.path().join(name).display().to_string();
        let (yaml, ws) = (path("a.yaml"), path("ws"));
        expect(&["init", &lab.display().to_string(), "--out", &yaml], 0);
        let (out, err) = expect(&["run", &yaml, "--workspace", &ws], 0);
        let said = unwrapped((out + &err).as_bytes());
        let person = "the markers of `Anna` were used, in 6 recordings that also hold Ben";
        assert_eq!(said.contains(person), case.ends_with("two_people_second_named"), "{said}");
        let found = json(&["compare", &yaml, "--workspace", &ws, "--json"]);
        let error = |place: &str| {
            let of = found["errors"].as_array().unwrap().iter().find(|e| e["judged_on"] == place).unwrap();
            of["held_out_error"].as_f64().unwrap()
        };
        assert!((error("contact") - 4.98).abs() < 0.05, "{}", error("contact"));
        assert!((error("flight") - 11.0).abs() < 0.2, "{}", error("flight"));
    }
}
