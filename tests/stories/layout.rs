//! What a person sees: no line is wider than the terminal, a run ends with at most twelve lines,
//! failures first, and one command to type next.

use crate::support::{folder, root};
use std::fs;
use std::process::Command;

/// What a command says at a width: exit code, stdout, stderr.
fn at(width: usize, words: &[&str]) -> (Option<i32>, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_aloft"))
        .args(words)
        .current_dir(root())
        .env("COLUMNS", width.to_string())
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

fn fits(width: usize, words: &[&str]) -> (Option<i32>, String, String) {
    let (code, out, err) = at(width, words);
    for line in out.lines().chain(err.lines()) {
        let n = line.chars().count();
        assert!(n <= width, "{n} columns of {width}, aloft {}:\n{line}", words.join(" "));
        assert!(!line.contains('\u{1b}'), "colour without a terminal: {line}");
    }
    (code, out, err)
}

#[test]
fn every_text_fits_the_terminal_and_a_run_ends_with_twelve_lines() {
    let dir = folder();
    for (pipeline, name) in [("pipelines/demo.yaml", "a"), ("pipelines/demo_human.yaml", "b")] {
        let ws = dir.path().join(name).display().to_string();
        let call = |width, words: &[&str]| {
            let (code, out, err) = fits(width, &[words, &["--workspace", &ws]].concat());
            assert_eq!(code, Some(0), "aloft {}\n{out}\n{err}", words.join(" "));
            (out, err)
        };
        for width in [60, 80, 100, 120] {
            let (out, err) = call(width, &["run", pipeline]);
            let lines = out.lines().count() + err.lines().count();
            assert!(lines <= 12, "{lines} lines at the end of a run of {pipeline}\n{out}{err}");
            assert!(err.contains("next: aloft discover "), "{err}");
            assert_eq!(format!("{out}{err}").matches("subject     ").count(), 1);
            call(width, &["compare", pipeline]);
            call(width, &["history", pipeline]);
        }
        for words in [
            &["run", pipeline, "--details"][..],
            &["compare", pipeline, "--details"],
            &["check", pipeline],
            &["status", pipeline],
            &["summary", pipeline],
            &["parameters", pipeline],
            &["history", pipeline, "--details"],
        ] {
            for width in [80, 100] {
                call(width, words);
            }
        }
        for width in [80, 120] {
            let (out, err) = call(width, &["check", pipeline]);
            // value and verdict stand in one row, and what was run is not proposed again
            let heads: Vec<&str> = out.lines().filter(|l| l.starts_with("session check")).collect();
            assert!(heads.len() == 1 && heads[0].contains("value") && heads[0].contains("expected"), "{out}");
            assert!(err.contains("next: aloft discover "), "{err}");
        }
        // the earlier method is explained, and in the details only
        assert!(!call(100, &["compare", pipeline]).0.contains("acceleration rows"));
        let (out, _) = call(1000, &["compare", pipeline, "--details"]);
        assert!(
            out.lines()
                .filter(|l| l.contains("For comparison, `acceleration rows`"))
                .all(|l| l.contains("the earlier method")),
            "{out}"
        );
        let (_, err) = call(80, &["discover", pipeline]);
        assert!(err.contains("next: aloft effect add "), "{err}");
        assert!(err.contains(if name == "a" { "'quadratic_drag[links]'" } else { "'tether[pelvis]'" }), "{err}");
        call(100, &["discover", pipeline, "--details"]);
    }
    for width in [80, 120] {
        let files =
            ["fixtures/human_twin/jump01.c3d", "fixtures/human_twin/exercise01.c3d", "fixtures/demo/throws_01.c3d"];
        for file in files {
            let (code, out, _) = fits(width, &["inspect", file]);
            assert!(code == Some(0) && out.contains("residual, mm"), "{out}");
        }
        for id in aloft_effects::EFFECTS.iter().map(|e| e.id()) {
            let (code, out, _) = fits(width, &["effect", "show", id]);
            assert!(code == Some(0) && out.contains("## Physics") && out.contains("Add it"), "{out}");
        }
    }
    for words in [&["effect", "list"][..], &["effect", "list", "pipelines/demo.yaml"]] {
        for width in [60, 80, 120] {
            let (_, out, _) = fits(width, words);
            let at = |title: &str| out.find(title).unwrap_or_else(|| panic!("no {title} in\n{out}"));
            assert!(at("Forces") < at("Errors of cameras") && at("Errors of cameras") < at("Errors of force plates"));
        }
    }
}

#[test]
fn a_lost_trial_is_said_before_any_number_and_shows_none_of_its_own() {
    let dir = folder();
    let data = dir.path().join("lab");
    fs::create_dir(&data).unwrap();
    for file in fs::read_dir(root().join("fixtures/demo")).unwrap().map(|e| e.unwrap().path()) {
        if file.is_file() {
            fs::copy(&file, data.join(file.file_name().unwrap())).unwrap();
        }
    }
    let (d, ws) = (data.display().to_string(), dir.path().join("ws").display().to_string());
    let base = ["pipelines/demo.yaml", "--data", &d, "--workspace", &ws];
    let call = |words: &[&str]| fits(100, &[words, &base[1..]].concat());
    assert_eq!(call(&["run", base[0]]).0, Some(0));
    assert_eq!(call(&["effect", "add", base[0], "quadratic_drag[links]"]).0, Some(0));
    fs::write(data.join("throws_02.c3d"), b"").unwrap();
    let (code, out, err) = call(&["run", base[0]]);
    assert_eq!(code, Some(1));
    assert!(err.starts_with("failed: import throws_02: "), "{err}");
    assert!(out.lines().count() + err.lines().count() <= 12, "{out}{err}");
    assert!(out.contains("without     throws_02 (import failed)"), "{out}");
    assert!(err.contains("next: aloft explain "), "{err}");
    // neither the table of the comparison nor the summary shows figures of the earlier recording
    let (_, out, _) = call(&["compare", base[0]]);
    let row = out.lines().find(|l| l.starts_with("throws_02")).unwrap();
    assert!(row.contains("import failed") && !row.chars().skip(9).any(|c| c.is_ascii_digit()), "{row}");
    let (_, out, _) = call(&["summary", base[0]]);
    let row = out.lines().find(|l| l.starts_with("throws_02")).unwrap();
    assert!(!row.chars().skip(9).any(|c| c.is_ascii_digit()), "{row}");
    // the ladder says that its trials changed
    let (_, out, _) = call(&["history", base[0]]);
    assert!(out.contains("the set of trials is not that") && out.contains("without throws_02"), "{out}");
}

#[test]
fn names_that_do_not_exist_get_a_suggestion() {
    let dir = folder();
    let ws = dir.path().join("ws").display().to_string();
    let p = "pipelines/demo.yaml";
    for (words, meant) in [
        (&["effect", "show", "thether"][..], "did you mean `tether`?"),
        (&["run", p, "--until", "flihgt", "--workspace", &ws], "did you mean `flight`?"),
        (&["run", p, "--trial", "throws_1", "--workspace", &ws], "did you mean `throws_01`"),
        (&["explain", p, "throw_01", "--workspace", &ws], "did you mean `throws_01`"),
    ] {
        let (code, out, err) = at(1000, words);
        assert_eq!(code, Some(2), "{out}{err}");
        assert!(err.contains(meant), "aloft {}: {err}", words.join(" "));
    }
    // the pipeline comes first, the former order still works
    let show = |words: &[&str]| at(100, &[&["effect", "show"], words].concat()).1;
    assert_eq!(show(&[p, "tether"]), show(&["tether", p]));
    assert!(show(&["tether"]).starts_with("# "));
}

#[test]
fn the_default_workspace_is_beside_the_pipeline_and_one_in_the_current_folder_is_still_found() {
    let dir = folder();
    let here = dir.path().canonicalize().unwrap();
    let lab = here.join("project");
    fs::create_dir(&lab).unwrap();
    let text = fs::read_to_string(root().join("pipelines/demo.yaml")).unwrap();
    let data = root().join("fixtures/demo").canonicalize().unwrap();
    fs::write(lab.join("p.yaml"), text.replace("../fixtures/demo", &data.display().to_string())).unwrap();
    let call = |words: &[&str]| {
        let output =
            Command::new(env!("CARGO_BIN_EXE_aloft")).args(words).current_dir(&here).env("COLUMNS", "1000").output();
        let output = output.unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    call(&["run", "project/p.yaml", "--until", "import"]);
    assert!(lab.join("workspaces/demo-demo/import/throws_01/manifest.json").is_file());
    assert!(!here.join("workspaces").exists());
    // where earlier versions put it
    fs::rename(lab.join("workspaces"), here.join("workspaces")).unwrap();
    let said = call(&["run", "project/p.yaml", "--until", "import"]);
    assert!(said.contains("0 done") && said.contains("note: results are in workspaces/demo-demo"), "{said}");
    assert!(!lab.join("workspaces").exists());
}

#[test]
fn init_does_not_mix_two_laboratories() {
    let dir = folder();
    let both = dir.path().join("both");
    for (lab, file) in
        [("demo", "throws_01.c3d"), ("demo", "static.c3d"), ("human_twin", "jump01.c3d"), ("human_twin", "static.c3d")]
    {
        fs::create_dir_all(both.join(lab)).unwrap();
        fs::copy(root().join("fixtures").join(lab).join(file), both.join(lab).join(file)).unwrap();
    }
    let to = dir.path().join("p.yaml").display().to_string();
    let (code, out, err) = at(1000, &["init", &both.display().to_string(), "--out", &to]);
    assert_eq!(code, Some(2), "{out}{err}");
    assert!(err.contains("several laboratories") && err.contains("demo") && err.contains("human_twin"), "{err}");
    assert!(!dir.path().join("p.yaml").exists());
    // one stray recording among those of a laboratory is left out, and the file says so
    fs::copy(both.join("demo/throws_01.c3d"), both.join("human_twin/throws_01.c3d")).unwrap();
    let one = both.join("human_twin").display().to_string();
    let (code, _, err) = at(1000, &["init", &one, "--out", &to]);
    assert_eq!(code, Some(0), "{err}");
    let text = fs::read_to_string(dir.path().join("p.yaml")).unwrap();
    assert!(text.contains("#   throws_01.c3d") && !text.contains("[\"throws_01.c3d\"]"), "{text}");
    assert!(text.contains("identify: [\"jump01.c3d\"]"), "{text}");
}
