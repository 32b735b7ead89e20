//! Repeated runs: nothing runs if nothing changed; only what depends on it runs if a parameter
//! changed.

use crate::support::{expect, folder, lab, repo};
use std::fs;
use std::path::Path;

#[test]
fn only_what_follows_from_a_change_is_done_again() {
    let dir = folder();
    let data = lab("fixtures/scenarios/chain_small.yaml", dir.path()).display().to_string();
    let ws = dir.path().join("ws").display().to_string();
    let pipeline = dir.path().join("p.yaml");
    let text = fs::read_to_string(repo("pipelines/chain.yaml")).unwrap();
    fs::write(&pipeline, &text).unwrap();
    let p = pipeline.display().to_string();
    let base = ["--data", &data, "--workspace", &ws];
    let run = |extra: &[&str]| expect(&[&["run", &p], &base[..], extra].concat(), 0);

    run(&[]);
    let (_, err) = run(&[]);
    assert!(err.contains(" 0 done") || err.starts_with("0 done"), "nothing changed, nothing is done: {err}");

    // file time changed, content unchanged
    let first = fs::read_dir(&data)
        .unwrap()
        .filter_map(|e| e.ok())
        .find(|e| e.path().extension().is_some_and(|x| x == "c3d"))
        .unwrap();
    let bytes = fs::read(first.path()).unwrap();
    fs::write(first.path(), bytes).unwrap();
    let (_, err) = run(&[]);
    assert!(err.contains("0 done"), "{err}");

    // another cut-off: the filter and later stages run again, inverse kinematics does not
    fs::write(&pipeline, text.replace("cutoff_hz: 10.0", "cutoff_hz: 8.0")).unwrap();
    let (out, _) = run(&["--dry-run"]);
    assert!(out.contains("filter") && out.contains("cutoff_hz"), "{out}");
    assert!(!out.lines().any(|l| l.starts_with("ik ")), "{out}");
    let (explained, _) = expect(&[&["explain", &p], &base[..], &["throws_01", "filter"]].concat(), 0);
    assert!(explained.contains("stale") && explained.contains("cutoff_hz"), "{explained}");
    // `explain` of a later result also names the change
    let (explained, _) = expect(&[&["explain", &p], &base[..], &["throws_01"]].concat(), 0);
    assert!(explained.contains("acceleration of throws_01") && explained.contains("will be recomputed"), "{explained}");
    assert!(!explained.lines().any(|l| l.starts_with("ik ") || l.starts_with("regressor ")), "{explained}");
    run(&["--only", "filter"]);
    let (_, err) = expect(&[&["run", &p], &base[..], &["--only", "identify"]].concat(), 2);
    assert!(err.contains("stale"), "{err}");
    run(&["--from", "flight"]);
    let (_, err) = run(&[]);
    assert!(err.contains("0 done"), "{err}");
    let (explained, _) = expect(&[&["explain", &p], &base[..]].concat(), 0);
    assert!(explained.contains("everything is up to date"), "{explained}");

    // a recording with changed content is named in the explanation
    let other = fs::read(Path::new(&data).join("throws_02.c3d")).unwrap();
    fs::write(Path::new(&data).join("throws_01.c3d"), other).unwrap();
    let (explained, _) = expect(&[&["explain", &p], &base[..], &["throws_01", "import"]].concat(), 0);
    assert!(explained.contains("the content of the file throws_01.c3d"), "{explained}");
    let (out, _) = run(&["--dry-run", "--trial", "throws_01", "--until", "ik"]);
    assert!(out.contains("import") && out.contains("throws_01") && !out.contains("throws_02"), "{out}");
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let dir = folder();
    let data = lab("fixtures/scenarios/chain_small.yaml", dir.path()).display().to_string();
    let read = |jobs: &str| {
        let ws = dir.path().join(format!("ws{jobs}"));
        expect(
            &[
                "run",
                &repo("pipelines/chain.yaml"),
                "--data",
                &data,
                "--workspace",
                &ws.display().to_string(),
                "-j",
                jobs,
            ],
            0,
        );
        [
            "identify/_study/parameters_weak.json",
            "identify/_study/parameters_acceleration.json",
            "compare/_study/comparison.json",
        ]
        .map(|f| fs::read(ws.join(f)).unwrap())
    };
    assert_eq!(read("1"), read("3"));
}

#[test]
fn regress_the_key_of_a_trial_names_what_that_trial_needs_and_no_other_trial() {
    let dir = folder();
    let ws = dir.path().join("ws");
    let text = fs::read_to_string(repo("pipelines/demo_human.yaml")).unwrap();
    let pipeline = dir.path().join("p.yaml");
    fs::write(&pipeline, &text).unwrap();
    let words = [pipeline.display().to_string(), repo("fixtures/human_tethered"), ws.display().to_string()];
    let run = |more: &[&str]| {
        expect(&[&["run", &words[0], "--data", &words[1], "--workspace", &words[2]], more].concat(), 0).0
    };
    run(&[]);
    let mut timed = 0;
    for stage in fs::read_dir(&ws).unwrap().map(|e| e.unwrap().path()).filter(|p| p.is_dir()) {
        for place in fs::read_dir(stage).unwrap().map(|e| e.unwrap().path()) {
            let trial = place.file_name().unwrap().to_string_lossy().into_owned();
            let Ok(bytes) = fs::read(place.join("manifest.json")) else { continue };
            if trial == "_study" {
                continue;
            }
            let manifest: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
            for key in manifest["inputs"].as_object().unwrap().keys() {
                timed += usize::from(key == "time in the session");
                let of_another = key.split_once('/').is_some_and(|(_, of)| of != trial && of != "_study");
                assert!(!of_another && !key.starts_with("role "), "{key} in {}", place.display());
            }
        }
    }
    // two kinds of rows of six jumps and an exercise, all on plates
    assert_eq!(timed, 14);
    // without the recordings before it, the last one stands earlier in the session
    fs::write(&pipeline, text.replace("identify:", "exclude: [{trial: jump01, reason: none}]\n  identify:")).unwrap();
    let due = run(&["--dry-run"]);
    let row = due.lines().find(|l| l.starts_with("regressor") && l.contains("jump06")).unwrap();
    assert!(row.contains("when in the session it was recorded"), "{due}");
}
