//! The first minutes with a folder of one's own: each message names the way out, and what is the
//! same in many recordings is said once.

use crate::support::{aloft, expect, folder, json, repo, unwrapped};
use aloft_c3d::{C3dFile, Parameter};
use std::fs;
use std::path::Path;

/// A recording of the demonstration under the name of a subject.
fn recording(from: &str, subject: Option<&str>, to: &Path) {
    let mut file = C3dFile::from_bytes(&fs::read(repo(from)).unwrap()).unwrap();
    if let Some(name) = subject {
        file.groups.set("SUBJECTS", Parameter::texts("NAMES", &[name]));
    }
    fs::write(to, file.to_bytes().unwrap()).unwrap();
}

#[test]
fn a_folder_of_several_subjects_names_every_way_out() {
    let dir = folder();
    let lab = dir.path().join("the lab");
    fs::create_dir(&lab).unwrap();
    for (name, subject) in [("static", "Ann B"), ("jump01", "ann_b"), ("jump02", "Bo"), ("exercise01", "Ann B")] {
        recording(&format!("fixtures/human_twin/{name}.c3d"), Some(subject), &lab.join(format!("{name}.c3d")));
    }
    let (lab, yaml) = (lab.display().to_string(), dir.path().join("s.yaml").display().to_string());
    let init = |more: &[&str], code: i32| {
        let output = aloft(&[&["init", &lab, "--out", &yaml], more].concat());
        assert_eq!(output.status.code(), Some(code), "{}", unwrapped(&output.stderr));
        unwrapped(&output.stderr)
    };
    let refused = init(&[], 2);
    assert!(refused.contains("2 subjects (SUBJECTS:NAMES): Ann B (3 files), Bo (1 file)"), "{refused}");
    let quoted = format!("aloft init '{lab}'");
    assert!(refused.contains(&format!("`{quoted} --subject 'Ann B'`")), "{refused}");
    assert!(refused.contains(&format!("`{quoted} --one-subject`")), "{refused}");
    assert!(init(&["--subject", "Cleo"], 2).contains("the files name Ann B (3 files), Bo (1 file)"));

    init(&["--subject", "Ann B"], 0);
    let text = fs::read_to_string(&yaml).unwrap();
    assert!(text.contains("identify: [\"jump01.c3d\"]") && text.contains("# of other subjects; not used:"), "{text}");
    assert!(text.contains("#   jump02.c3d (Bo)"), "{text}");

    let again = init(&["--one-subject"], 2);
    let other = dir.path().join("s-2.yaml").display().to_string();
    assert!(again.contains(&format!("`aloft run {yaml}`")), "{again}");
    assert!(again.contains(&format!("`{quoted} --out {other}`")), "{again}");
    expect(&["init", &lab, "--out", &other, "--one-subject"], 0);
    let text = fs::read_to_string(&other).unwrap();
    assert!(text.contains("identify: [\"jump01.c3d\", \"jump02.c3d\"]"), "{text}");
}

#[test]
fn what_is_alike_in_many_recordings_is_one_line_and_nothing_is_lost() {
    let dir = folder();
    let lab = dir.path().join("lab");
    fs::create_dir(&lab).unwrap();
    for n in 1..=9 {
        let mut file = C3dFile::from_bytes(&fs::read(repo("fixtures/human_twin/jump01.c3d")).unwrap()).unwrap();
        for point in file.points.iter_mut().take(12) {
            for frame in 100..300 {
                point.xyz[frame] = [f32::NAN; 3];
            }
        }
        fs::write(lab.join(format!("jump{n:02}.c3d")), file.to_bytes().unwrap()).unwrap();
    }
    recording("fixtures/human_twin/static.c3d", None, &lab.join("static.c3d"));
    let (lab, yaml) = (lab.display().to_string(), dir.path().join("s.yaml").display().to_string());
    expect(&["init", &lab, "--out", &yaml], 0);
    let text = fs::read_to_string(&yaml).unwrap();
    let sure = text.replace("  mass_kg:              #", "  mass_kg: 61.5 #").replace("  sex:  ", "  sex: F");
    fs::write(&yaml, sure).unwrap();

    let lines = |text: &str| text.lines().filter(|l| l.starts_with("warning: ")).count();
    let (_, short) = expect(&["check", &yaml], 0);
    assert!(short.contains("117 gaps too long to fill in 13 markers: "), "{short}");
    assert!(short.contains("9 of 10 trials: jump01, jump02, jump03 …"), "{short}");
    assert!(lines(&short) < 12 && short.contains(&format!("aloft check {yaml} --details")), "{short}");
    let (_, whole) = expect(&["check", &yaml, "--details"], 0);
    assert!(lines(&whole) >= 117, "{whole}");

    let found = json(&["check", &yaml, "--json"]);
    let trials = found["trials"].as_array().unwrap();
    let remarks: usize = trials.iter().map(|t| t["remarks"].as_array().unwrap().len()).sum();
    let of_findings: usize =
        found["findings"].as_array().unwrap().iter().map(|f| f["trials"].as_array().unwrap().len()).sum();
    assert!(remarks >= 117 && of_findings < remarks, "{remarks} remarks, {of_findings} places of findings");
}
