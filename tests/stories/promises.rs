//! What `docs/promises.md` says of files, signals and personal data, kept by the real binary.

use crate::support::{aloft, another, expect, folder, json, lab, repo, unwrapped};
use std::fs;
use std::path::Path;
use std::process::Command;

/// `aloft` with words for the demonstration in a workspace.
fn demo<'a>(command: &[&'a str], ws: &'a str, pipeline: &'a str) -> Vec<&'a str> {
    let (first, rest) = command.split_at(if command[0] == "effect" { 2 } else { 1 });
    [first, &[pipeline], rest, &["--workspace", ws]].concat()
}

/// Runs with an operation that fails; returns exit code, stdout and stderr.
fn failing(words: &[&str], fault: &str, log: &Path) -> (Option<i32>, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_aloft"));
    command.args(words).env("NO_COLOR", "1").env("COLUMNS", "2000");
    let output = command.env("ALOFT_FAULT", fault).env("ALOFT_FAULT_LOG", log).output().unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stdout).into_owned(), unwrapped(&output.stderr))
}

#[test]
fn regress_an_answer_names_what_could_not_be_computed_and_is_not_stored() {
    let dir = folder();
    let (ws, pipeline) = (dir.path().join("ws").display().to_string(), repo("pipelines/demo.yaml"));
    expect(&demo(&["run"], &ws, &pipeline), 0);
    // no room for a copy of the workspace
    let words = demo(&["discover", "--closed"], &ws, &pipeline);
    let (code, out, err) = failing(&words, "nospace@1+", &dir.path().join("log"));
    assert_eq!(code, Some(1), "{out}\n{err}");
    assert!(out.contains("quadratic_drag") && !out.contains("next:") && !err.contains("next:"), "{out}\n{err}");
    assert!(
        err.contains("could not be computed: the model with quadratic_drag") && err.contains("not stored"),
        "{err}"
    );
    assert!(!Path::new(&ws).join("discovery.json").exists() && !Path::new(&ws).join("discoveries").exists());
    // with room for it, the answer is computed anew and stored
    let whole = json(&demo(&["discover", "--closed", "--json"], &ws, &pipeline));
    assert!(whole.get("not_computed").is_none() && !whole["errors_after"].as_array().unwrap().is_empty());
    assert!(Path::new(&ws).join("discovery.json").exists());
}

#[test]
fn regress_an_answer_is_shown_where_it_cannot_be_stored() {
    let dir = folder();
    let (ws, pipeline) = (dir.path().join("ws").display().to_string(), repo("pipelines/demo.yaml"));
    let log = dir.path().join("log");
    expect(&demo(&["run"], &ws, &pipeline), 0);
    let words = demo(&["discover", "--closed"], &ws, &pipeline);
    let (_, reference, _) = failing(&words, "count", &log);
    let place = Path::new(&ws).join("discovery.json");
    assert!(place.exists());
    // the operation that stores the answer is the first on this file
    let counted = fs::read_to_string(&log).unwrap();
    let changes = counted.lines().filter(|l| l.starts_with("Change"));
    let at = 1 + changes.clone().position(|l| l.contains("discovery.json")).unwrap();
    fs::remove_file(&place).unwrap();
    fs::remove_dir_all(Path::new(&ws).join("discoveries")).unwrap();
    let again = demo(&["discover", "--closed", "--again"], &ws, &pipeline);
    // results that the first answer left ready are not computed twice: fewer changes come before
    let found = (1..=at).rev().find_map(|n| {
        let (code, out, err) = failing(&again, &format!("access@{n}+"), &log);
        (err.contains("could not be stored")).then_some((code, out, err))
    });
    let (code, out, err) = found.expect("the storing was not reached");
    assert_eq!(code, Some(1), "{err}");
    assert_eq!(out, reference, "the answer is shown");
    assert!(err.contains("permission denied") && !err.contains("next:"), "{err}");
}

#[test]
fn regress_every_file_in_a_workspace_is_compared_with_the_results() {
    let dir = folder();
    let (ws, pipeline) = (dir.path().join("ws").display().to_string(), repo("pipelines/demo.yaml"));
    let at = |name: &str| Path::new(&ws).join(name);
    for command in [&["run"][..], &["report"], &["export"]] {
        expect(&demo(command, &ws, &pipeline), 0);
    }
    expect(&demo(&["status", "--strict"], &ws, &pipeline), 0);
    expect(&demo(&["verify", "--strict"], &ws, &pipeline), 0);
    // a change of the model: the tables follow at once, page and export are behind
    let before = fs::read(at("summary.csv")).unwrap();
    expect(&demo(&["effect", "add", "quadratic_drag"], &ws, &pipeline), 0);
    let table = fs::read_to_string(at("summary.csv")).unwrap();
    assert_ne!(before, table.as_bytes());
    let shown = json(&demo(&["summary", "--json"], &ws, &pipeline));
    for row in shown["rows"].as_array().unwrap() {
        if let Some(error) = row["flight_error_n"].as_f64() {
            assert!(table.contains(&format!("{error:?}")), "{error} is not in summary.csv");
        }
    }
    for command in ["status", "verify"] {
        let (_, err) = expect(&demo(&[command, "--strict"], &ws, &pipeline), 1);
        for name in ["report.html", "export"] {
            assert!(err.contains(&format!("stale: {name}")) || err.contains(name), "{command}: {err}");
        }
        assert!(!err.contains("summary"), "{command}: {err}");
    }
    for command in [&["report"][..], &["export"]] {
        expect(&demo(command, &ws, &pipeline), 0);
    }
    expect(&demo(&["verify", "--strict"], &ws, &pipeline), 0);
    // every file that stands in the workspace is looked at: changed, it is found
    let mut changed = 0;
    for entry in walkdir::WalkDir::new(&ws).sort_by_file_name().into_iter().map(Result::unwrap) {
        let place = entry.path().strip_prefix(&ws).unwrap().display().to_string();
        // caches are made again where they do not fit, and hidden files belong to runs
        let own = ["forecast", "replaced", "."].iter().any(|p| place.starts_with(p));
        if !entry.file_type().is_file() || own || place == "ALOFT_WORKSPACE.txt" || place == "export/export.json" {
            continue;
        }
        // of each kind of result a few are enough
        changed += 1;
        if place.contains('/') && changed % 5 != 0 {
            continue;
        }
        let bytes = fs::read(entry.path()).unwrap();
        fs::write(entry.path(), [&bytes[..], b"x"].concat()).unwrap();
        let found = aloft(&demo(&["verify"], &ws, &pipeline));
        assert_eq!(found.status.code(), Some(if place == "model.json" { 2 } else { 1 }), "{place} was changed");
        fs::write(entry.path(), bytes).unwrap();
    }
    assert!(changed > 50);
}

#[test]
fn regress_a_name_does_not_lead_out_of_the_workspaces() {
    let dir = folder();
    let text = fs::read_to_string(repo("pipelines/demo.yaml")).unwrap();
    let data = format!("data: {}", repo("fixtures/demo"));
    for name in ["../../x", "a/../../../x", "/tmp/x", "..\\..\\x", ".."] {
        let pipeline = dir.path().join("p.yaml");
        let written = text.replace("name: demo", &format!("name: '{name}'")).replace("data: ../fixtures/demo", &data);
        fs::write(&pipeline, written).unwrap();
        let (_, err) = expect(&["run", &pipeline.display().to_string()], 2);
        assert!(err.contains("leads out of the folder"), "{name}: {err}");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "{name}");
    }
}

/// Sends a signal to a command once it has begun to write; returns its exit code and stderr.
#[cfg(unix)]
fn signalled(words: &[&str], signal: &str, begun: impl Fn() -> bool) -> (Option<i32>, String) {
    use std::process::Stdio;
    use std::time::{Duration, Instant};
    let mut command = Command::new(env!("CARGO_BIN_EXE_aloft"));
    command.args(words).env("NO_COLOR", "1").env("COLUMNS", "2000").stdout(Stdio::null()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let started = Instant::now();
    while !begun() && child.try_wait().unwrap().is_none() && started.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(1));
    }
    Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    let output = child.wait_with_output().unwrap();
    (output.status.code(), unwrapped(&output.stderr))
}

#[test]
#[cfg(unix)]
fn regress_a_signal_ends_with_a_word_and_leaves_nothing() {
    let dir = folder();
    let beside = dir.path().join("beside");
    fs::create_dir(&beside).unwrap();
    let (ws, pipeline) = (dir.path().join("ws").display().to_string(), repo("pipelines/demo.yaml"));
    expect(&demo(&["run"], &ws, &pipeline), 0);
    let to = beside.join("out").display().to_string();
    let holds = |folder: &Path| fs::read_dir(folder).unwrap().count();
    for (signal, code, name) in [("-INT", 130, "SIGINT"), ("-TERM", 143, "SIGTERM"), ("-HUP", 129, "SIGHUP")] {
        let words = demo(&["export", "--to", &to], &ws, &pipeline);
        let (ended, err) = signalled(&words, signal, || holds(&beside) > 0);
        assert_eq!(ended, Some(code), "{err}");
        assert!(err.contains(&format!("stopped by {name}")) && err.contains("run the same command again"), "{err}");
        assert_eq!(holds(&beside), 0, "{signal} left something behind");
    }
    // what a killed process leaves is removed by the next command there
    let words = demo(&["export", "--to", &to], &ws, &pipeline);
    let (ended, _) = signalled(&words, "-KILL", || holds(&beside) > 1);
    assert!(ended.is_none() && holds(&beside) > 0);
    expect(&words, 0);
    assert_eq!(holds(&beside), 1);
}

#[test]
fn regress_forget_removes_all_that_a_workspace_holds_about_a_subject() {
    let dir = folder();
    let first = lab("fixtures/scenarios/chain_small.yaml", dir.path());
    let data = dir.path().join("data");
    for (i, name) in ["anna", "ben"].into_iter().enumerate() {
        fs::create_dir_all(data.join(name)).unwrap();
        for file in fs::read_dir(&first).unwrap().map(|e| e.unwrap().path()).filter(|p| p.is_file()) {
            let to = data.join(name).join(file.file_name().unwrap());
            if file.extension().is_some_and(|e| e == "c3d") {
                another(&file, &to, i)
            } else {
                fs::copy(&file, &to).map(|_| ()).unwrap()
            }
        }
    }
    let pipeline = dir.path().join("p.yaml");
    let text = fs::read_to_string(repo("pipelines/chain.yaml")).unwrap();
    fs::write(&pipeline, format!("{text}\nsubjects: {{folders: [\"*\"]}}\n")).unwrap();
    let ws = dir.path().join("ws");
    let places = [pipeline.display().to_string(), data.display().to_string(), ws.display().to_string()];
    let words =
        |command: &'static str| vec![command, places[0].as_str(), "--data", &places[1], "--workspace", &places[2]];
    for command in ["run", "report", "export"] {
        expect(&words(command), 0);
    }
    let named = |name: &str| -> Vec<String> {
        let files = walkdir::WalkDir::new(&ws).into_iter().map(Result::unwrap).filter(|e| e.file_type().is_file());
        let holds = |p: &Path| {
            let place = p.strip_prefix(&ws).unwrap().display().to_string();
            place.contains(name) || String::from_utf8_lossy(&fs::read(p).unwrap()).contains(&format!("/{name}"))
        };
        files.filter(|e| holds(e.path())).map(|e| e.path().display().to_string()).collect()
    };
    assert!(!named("anna").is_empty() && !named("ben").is_empty());
    let recordings = walkdir::WalkDir::new(&data).into_iter().count();
    let forget = |name: &'static str, more: &'static [&'static str]| [&words("forget")[..], &[name], more].concat();
    let (out, _) = expect(&forget("anna", &["--dry-run"]), 0);
    assert!(out.contains("would be removed") && !named("anna").is_empty());
    let (_, err) = expect(&forget("../data", &[]), 2);
    assert!(err.contains("holds nothing about"), "{err}");
    let (out, _) = expect(&forget("anna", &[]), 0);
    assert!(out.contains("anna") && out.contains("summary.csv") && out.contains("not touched"), "{out}");
    assert_eq!(named("anna"), Vec::<String>::new());
    assert!(!named("ben").is_empty() && walkdir::WalkDir::new(&data).into_iter().count() == recordings);
    // the workspace is usable; without the recordings, nothing about the subject comes back
    fs::remove_dir_all(data.join("anna")).unwrap();
    expect(&words("run"), 0);
    expect(&words("verify"), 0);
    assert_eq!(named("anna"), Vec::<String>::new());
}
