//! A laboratory with many broken files: one clear line for each, exit code 1, and every intact
//! trial is processed.

use crate::support::{aloft, expect, folder, json, lab, repo};
use std::fs;

#[test]
fn broken_files_give_one_line_each_and_the_others_go_on() {
    let dir = folder();
    let data = lab("fixtures/scenarios/human_small.yaml", dir.path());
    let jump = fs::read(data.join("jump01.c3d")).unwrap();
    fs::write(data.join("jump91_truncated.c3d"), &jump[..3000]).unwrap();
    fs::write(data.join("jump92_empty.c3d"), b"").unwrap();
    fs::write(data.join("jump93_text.c3d"), "this is a letter, not a recording\n").unwrap();
    let ws = dir.path().join("ws").display().to_string();
    let data = data.display().to_string();
    let words = ["run", &repo("pipelines/human.yaml"), "--data", &data, "--workspace", &ws, "--details"];
    let (_, err) = expect(&words, 1);
    for name in ["jump91_truncated", "jump92_empty", "jump93_text"] {
        let lines: Vec<&str> = err.lines().filter(|l| l.starts_with("failed: import ") && l.contains(name)).collect();
        assert_eq!(lines.len(), 1, "one line for {name}:\n{err}");
    }
    let status = json(&["status", words[1], "--data", &data, "--workspace", &ws, "--json"]);
    for row in status["rows"].as_array().unwrap() {
        let trial = row["trial"].as_str().unwrap();
        let failed = row["cells"].as_array().unwrap().iter().any(|c| c == "failed");
        assert_eq!(failed, trial.starts_with("jump9"), "{row}");
    }
    let compared = json(&["compare", words[1], "--data", &data, "--workspace", &ws, "--json"]);
    assert!(compared["held_out"]["force_n"]["mae"][2].as_f64().unwrap() < 10.0);
}

/// The same data counted twice would make every interval too narrow.
#[test]
fn a_copy_of_a_recording_is_refused() {
    let dir = folder();
    let data = lab("fixtures/scenarios/chain_small.yaml", dir.path());
    let ws = dir.path().join("ws").display().to_string();
    let first = data.join("throws_01.c3d");
    let pipeline = repo("pipelines/chain.yaml");
    let call = |command: &[&str], code: i32| {
        let places = [&pipeline, "--data", data.to_str().unwrap(), "--workspace", &ws];
        expect(&[command, &places].concat(), code)
    };
    let _ = call(&["run"], 0);
    let (before, _) = call(&["parameters", "--json"], 0);
    fs::copy(&first, data.join("throws_91.c3d")).unwrap();
    let (_, err) = call(&["run"], 1);
    assert!(err.contains("throws_91") && err.contains("the same content as the recording throws_01"), "{err}");
    let (after, _) = call(&["parameters", "--json"], 0);
    assert_eq!(before, after);
    // without the first, the copy is a recording like any other
    fs::remove_file(&first).unwrap();
    let _ = call(&["run"], 0);
}

/// A recording that was exported again, with one sample changed, is not a copy by its bytes; its
/// data would count twice all the same.
#[test]
fn recordings_that_repeat_another_one_are_named_and_not_judged() {
    let dir = folder();
    let data = lab("fixtures/scenarios/chain_small.yaml", dir.path());
    let ws = dir.path().join("ws").display().to_string();
    let pipeline = dir.path().join("chain.yaml");
    let text = fs::read_to_string(repo("pipelines/chain.yaml")).unwrap();
    fs::write(&pipeline, &text).unwrap();
    let call = |command: &str, code: i32| {
        let places = [pipeline.to_str().unwrap(), "--data", data.to_str().unwrap(), "--workspace", &ws];
        expect(&[&[command], &places[..]].concat(), code)
    };
    assert!(!call("run", 0).0.contains("repeated"));
    let mut again = fs::read(data.join("throws_01.c3d")).unwrap();
    let at = again.len() - 3000;
    again[at] ^= 1;
    fs::write(data.join("throws_91.c3d"), again).unwrap();
    let (said, _) = call("run", 0);
    assert!(said.contains("repeated") && said.contains("`throws_01` and `throws_91`"), "{said}");
    assert!(call("check", 0).0.contains("recordings that repeat another one"));
    let (_, err) = call("discover", 2);
    assert!(err.contains("`throws_91`") && err.contains("exclude"), "{err}");
    let exclude = "trials:\n  exclude: [{trial: throws_91, reason: exported twice}]\n";
    fs::write(&pipeline, text.replace("trials:\n", exclude)).unwrap();
    assert!(!call("run", 0).0.contains("repeated"));
    let _ = call("discover", 0);
}

#[test]
fn recordings_that_name_two_persons_are_reported_with_the_result() {
    let dir = folder();
    let data = lab("fixtures/scenarios/human_small.yaml", dir.path());
    let ws = dir.path().join("ws").display().to_string();
    let pipeline = repo("pipelines/human.yaml");
    let call = |command: &str| expect(&[command, &pipeline, "--data", data.to_str().unwrap(), "--workspace", &ws], 0).0;
    assert!(!call("run").contains("persons"));
    fs::copy(repo("fixtures/human_twin/jump02.c3d"), data.join("jump92.c3d")).unwrap();
    let said = call("run");
    let line = said.lines().skip_while(|l| !l.starts_with("persons")).take(4).collect::<Vec<_>>().join(" ");
    assert!(line.contains("in jump92") && line.contains("all of them were used for one body"), "{said}");
    assert!(call("check").contains("persons named in the files"));
}

#[test]
fn results_of_a_recording_that_breaks_later_are_not_used_any_more() {
    let dir = folder();
    let data = lab("fixtures/scenarios/chain_small.yaml", dir.path());
    let ws = dir.path().join("ws").display().to_string();
    let words = [&repo("pipelines/chain.yaml"), "--data", &data.display().to_string(), "--workspace", &ws];
    expect(&[&["run"], &words[..]].concat(), 0);
    let whole = fs::read(data.join("throws_02.c3d")).unwrap();
    fs::write(data.join("throws_02.c3d"), b"").unwrap();
    let (_, err) = expect(&[&["run"], &words[..]].concat(), 1);
    let failed: Vec<&str> = err.lines().filter(|l| l.starts_with("failed: ")).collect();
    assert!(failed.len() == 1 && failed[0].starts_with("failed: import throws_02"), "{err}");
    let compared = json(&[&["compare"], &words[..], &["--json"]].concat());
    assert!(compared["trials"].as_array().unwrap().iter().all(|t| t["trial"] != "throws_02"), "{}", compared["trials"]);
    let status = json(&[&["status"], &words[..], &["--json"]].concat());
    let row = status["rows"].as_array().unwrap().iter().find(|r| r["trial"] == "throws_02").unwrap();
    assert_eq!(row["cells"][0], "failed");
    assert!(row["cells"].as_array().unwrap().iter().any(|c| c == "blocked"), "{row}");
    // after repair, the results are as if nothing had been broken
    fs::write(data.join("throws_02.c3d"), whole).unwrap();
    let (_, err) = expect(&[&["run"], &words[..]].concat(), 0);
    assert!(err.lines().all(|l| !l.starts_with("failed")), "{err}");
    let (_, err) = expect(&[&["run"], &words[..]].concat(), 0);
    assert!(err.contains("0 done"), "{err}");
}

#[test]
#[cfg(unix)]
fn a_result_that_the_disk_does_not_take_fails_alone_and_says_which_file() {
    let dir = folder();
    let data = lab("fixtures/scenarios/chain_small.yaml", dir.path());
    let ws = dir.path().join("ws");
    let words = [
        &repo("pipelines/chain.yaml"),
        "--data",
        &data.display().to_string(),
        "--workspace",
        &ws.display().to_string(),
    ];
    expect(&[&["run"], &words[..]].concat(), 0);
    let whole = json(&[&["parameters"], &words[..], &["--json"]].concat());
    let model = fs::read(ws.join("model.json")).ok();
    for (extra, place) in [(None, "filter/throws_02"), (Some("--shared"), "filter/throws_02"), (None, "scale/_study")] {
        let place = ws.join(place);
        fs::remove_dir_all(&place).unwrap();
        // a folder cannot be renamed onto this
        std::os::unix::fs::symlink(dir.path().join("nowhere"), &place).unwrap();
        let (_, err) = expect(&[&["run"], &words[..], extra.as_slice()].concat(), 1);
        let failed: Vec<&str> = err.lines().filter(|l| l.starts_with("failed: ")).collect();
        let (stage, trial) = place.to_str().and_then(|p| p.rsplit_once('/')).unwrap();
        let stage = stage.rsplit('/').next().unwrap();
        assert!(failed.len() == 1 && failed[0].starts_with(&format!("failed: {stage} {trial}")), "{err}");
        assert!(failed[0].contains(".tmp") && failed[0].contains("cannot move"), "{err}");
        assert!(err.contains("hint: make room on the disk"), "{err}");
        if extra.is_none() {
            // a change of the model is not based on such a result
            let (_, err) = expect(&[&["effect", "add", words[0], "quadratic_drag"], &words[1..]].concat(), 2);
            assert!(err.contains("could not be written"), "{err}");
            assert_eq!(fs::read(ws.join("model.json")).ok(), model);
        }
        fs::remove_file(&place).unwrap();
        expect(&[&["run"], &words[..]].concat(), 0);
        assert_eq!(json(&[&["parameters"], &words[..], &["--json"]].concat()), whole);
        expect(&[&["verify"], &words[..], &["--strict"]].concat(), 0);
    }
}

#[test]
fn no_static_trial_is_said_with_a_way_out() {
    let dir = folder();
    let data = lab("fixtures/scenarios/human_small.yaml", dir.path());
    fs::remove_file(data.join("static.c3d")).unwrap();
    let ws = dir.path().join("ws").display().to_string();
    let (_, err) =
        expect(&["run", &repo("pipelines/human.yaml"), "--data", &data.display().to_string(), "--workspace", &ws], 1);
    assert!(err.contains("no static trial") && err.contains("static_frames"), "{err}");
}

#[test]
fn a_wrong_word_in_the_pipeline_is_shown_at_its_line() {
    let dir = folder();
    let file = dir.path().join("p.yaml");
    fs::write(&file, "name: x\nmodel: human34\nmarker_set: plug-in-gait-35\ndata: .\nfilter:\n  cutoff: 6\n").unwrap();
    let (_, err) = expect(&["run", &file.display().to_string()], 2);
    assert!(err.contains("line 6") && err.contains("cutoff_hz"), "{err}");
    fs::write(&file, "name: x\nmodel: human35\nmarker_set: plug-in-gait-35\ndata: .\n").unwrap();
    let (_, err) = expect(&["check", &file.display().to_string()], 2);
    assert!(err.contains("human35") && err.contains("human34"), "{err}");
}

#[test]
fn a_workspace_that_is_somebody_elses_folder_is_left_alone() {
    let dir = folder();
    let data = lab("fixtures/scenarios/chain_small.yaml", dir.path());
    let theirs = dir.path().join("thesis");
    fs::create_dir(&theirs).unwrap();
    fs::write(theirs.join("chapter1.txt"), "precious").unwrap();
    let words = [
        "run",
        &repo("pipelines/chain.yaml"),
        "--data",
        &data.display().to_string(),
        "--workspace",
        &theirs.display().to_string(),
    ];
    let output = aloft(&words);
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(fs::read_to_string(theirs.join("chapter1.txt")).unwrap(), "precious");
    assert_eq!(fs::read_dir(&theirs).unwrap().count(), 1);
}
