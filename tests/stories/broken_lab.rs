//! A laboratory with many broken files: one clear line for each, exit code 1, and every intact
//! trial is processed.

use crate::support::{aloft, expect, folder, json, lab, repo, root, unwrapped};
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

/// Cameras that were processed again, or noise on the markers, leave no marker sample in common;
/// the force plates still tell that it is the same jump.
#[test]
fn a_copy_with_other_markers_is_known_by_its_plates() {
    let dir = folder();
    let data = dir.path().join("lab");
    fs::create_dir(&data).unwrap();
    let twin = root().join("fixtures/human_twin");
    for file in fs::read_dir(&twin).unwrap().map(|e| e.unwrap().path()).filter(|f| f.is_file()) {
        fs::copy(&file, data.join(file.file_name().unwrap())).unwrap();
    }
    let ws = dir.path().join("ws").display().to_string();
    let pipeline = repo("pipelines/demo_human.yaml");
    let call = |command: &str, code: i32| {
        expect(&[command, &pipeline, "--data", data.to_str().unwrap(), "--workspace", &ws], code)
    };
    assert!(!call("run", 0).0.contains("repeated"));
    fs::write(data.join("jump91.c3d"), with_moved_markers(&fs::read(data.join("jump01.c3d")).unwrap())).unwrap();
    let (said, _) = call("run", 0);
    assert!(said.contains("`jump01` and `jump91` (100 % of the plates of the shorter one)"), "{said}");
    assert!(call("check", 0).0.contains("recordings that repeat another one"));
    let (_, err) = call("discover", 2);
    assert!(err.contains("`jump91`") && err.contains("exclude"), "{err}");
}

/// A C3D file of little-endian numbers with every marker coordinate moved by up to 0.3 mm; analog
/// samples stay as they are.
fn with_moved_markers(file: &[u8]) -> Vec<u8> {
    let mut out = file.to_vec();
    let word = |at: usize| usize::from(u16::from_le_bytes([file[at], file[at + 1]]));
    let (points, analogs, data) = (word(2), word(4), 512 * (word(16) - 1));
    let scale = f32::from_le_bytes(file[12..16].try_into().unwrap());
    assert!(scale < 0.0, "the fixture holds floats");
    let frame = 4 * (4 * points + analogs);
    for (n, start) in (data..=file.len() - frame).step_by(frame).enumerate() {
        for (k, at) in (0..points).flat_map(|p| (0..3).map(move |axis| 16 * p + 4 * axis)).enumerate() {
            let at = start + at;
            let x = f32::from_le_bytes(file[at..at + 4].try_into().unwrap());
            let noise = 0.1 * ((7 * n + 13 * k) % 5 + 1) as f32 - 0.25;
            out[at..at + 4].copy_from_slice(&(x + noise).to_le_bytes());
        }
    }
    out
}

/// What went wrong is named, and not what it looks like from the end.
#[test]
fn a_cause_in_the_pipeline_is_named_where_its_effect_shows() {
    let dir = folder();
    let text = fs::read_to_string(repo("pipelines/demo_human.yaml")).unwrap();
    let text = text.replace("../fixtures/human_tethered", &repo("fixtures/human_tethered"));
    let call = |name: &str, text: &str, code: i32| {
        let (file, ws) = (dir.path().join(format!("{name}.yaml")), dir.path().join(name));
        fs::write(&file, text).unwrap();
        expect(&["run", file.to_str().unwrap(), "--workspace", ws.to_str().unwrap()], code)
    };
    let (said, _) = call("cutoff", &text.replace("cutoff_hz: 10.0", "cutoff_hz: 150.0"), 1);
    assert!(said.contains("the stage `filter` failed in every recording") && said.contains("150 Hz"), "{said}");
    assert!(!said.contains("as long as a window"), "{said}");
    let (said, told) = call("prior", &format!("{text}identify: {{prior_weight: 1000000}}\n"), 0);
    assert!(said.contains("prior_weight: 1000000") && said.contains("the stated weight of the prior"), "{said}");
    assert!(!said.contains("too little motion") && !said.contains("record more"), "{said}");
    assert!(told.contains("next: aloft run"), "{told}");
    let (_, told) = call("markers", &format!("{text}ik: {{marker_sd_m: 0.1}}\n"), 2);
    assert!(told.contains("ik.marker_sd_m") && told.contains("0.03"), "{told}");
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

/// `check` says that all is well only where `run` can begin.
#[test]
fn recordings_with_too_few_markers_of_the_set_are_refused_by_check_and_run_alike() {
    let dir = folder();
    let data = dir.path().join("data");
    fs::create_dir(&data).unwrap();
    for name in ["static", "jump01", "jump02"] {
        let bytes = fs::read(repo(&format!("fixtures/human_twin/{name}.c3d"))).unwrap();
        let mut file = aloft_c3d::C3dFile::from_bytes(&bytes).unwrap();
        for (i, point) in file.points.iter_mut().enumerate().filter(|(i, _)| i % 4 != 0) {
            point.label = format!("X{i}");
        }
        fs::write(data.join(format!("{name}.c3d")), file.to_bytes().unwrap()).unwrap();
    }
    fs::copy(repo("fixtures/human_twin/subject.yaml"), data.join("subject.yaml")).unwrap();
    let pipeline = dir.path().join("aloft.yaml").display().to_string();
    let (_, err) = expect(&["init", &data.display().to_string(), "--out", &pipeline], 0);
    assert!(err.contains("no marker set fits"), "{err}");
    let ws = dir.path().join("ws").display().to_string();
    for command in ["check", "run"] {
        let said = aloft(&[command, &pipeline, "--workspace", &ws]);
        assert_eq!(said.status.code(), Some(1), "{command}");
        let all = unwrapped(&[said.stdout, said.stderr].concat());
        assert!(all.contains("of 35 markers of the set `plug-in-gait-35`"), "{command}: {all}");
    }
}
