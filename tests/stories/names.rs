//! Recordings, subjects, sessions and folders whose names have a special meaning to a shell,
//! Python, HTML or a file system pass through every command. No part of a name is executed, none is
//! lost, and a printed command refers to exactly the trial that it names.
#![cfg(unix)]

use crate::support::{aloft, another, expect, folder, json, repo};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// Names of recordings; each creates a file `pwned…` if a shell or Python executes it.
const HOSTILE: [&str; 15] = [
    "a b",
    "$(touch pwned_a)",
    "`touch pwned_b`",
    "'''; open('pwned_c', 'w'); r'''",
    "\"q\"",
    "x\ny",
    "-dash",
    "--help",
    "{br}ace <p>",
    "[g]*?",
    "\\back",
    "üni 日本",
    "throws_a_b",
    "throws_a b",
    "<script>alert(1)<|script>",
];

const PIPELINE: &str = "name: names\nmodel: two_link\nmarker_set: two-link-chain\nobject: two_link_chain\ntrials:\n  static: [\"static.c3d\"]\n  calibration: [\"hinge_calib.c3d\"]\n  identify: [\"*.c3d\"]\n  validate: []\n";

fn copy(name: &str, to: &Path) {
    fs::copy(Path::new(&repo("fixtures/demo")).join(name), to).unwrap();
}

/// A laboratory with the demonstration's recordings under hostile names, and broken ones for which
/// a command is printed.
fn laboratory(at: &Path, names: &[&str]) {
    fs::create_dir_all(at).unwrap();
    for name in ["static.c3d", "hinge_calib.c3d", "object.yaml"] {
        copy(name, &at.join(name));
    }
    for (i, name) in names.iter().enumerate() {
        let from = repo(&format!("fixtures/demo/throws_0{}.c3d", 1 + i % 3));
        another(Path::new(&from), &at.join(format!("{name}.c3d")), i);
        fs::write(at.join(format!("{name}!.c3d")), b"").unwrap();
    }
}

/// Runs a line in a shell, in a folder where `aloft` is a command.
fn shell(line: &str, at: &Path) -> Output {
    let program = Path::new(env!("CARGO_BIN_EXE_aloft"));
    let path = format!("{}:{}", program.parent().unwrap().display(), std::env::var("PATH").ok().unwrap_or_default());
    Command::new("sh").arg("-c").arg(line).env("PATH", path).env("NO_COLOR", "1").current_dir(at).output().unwrap()
}

fn nothing_was_executed(dir: &Path) {
    let found: Vec<_> = walk(dir).into_iter().filter(|p| p.rsplit('/').next().unwrap().starts_with("pwned")).collect();
    assert!(found.is_empty(), "a name was executed: {found:?}");
}

fn walk(dir: &Path) -> Vec<String> {
    let mut out = Vec::new();
    for entry in fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()) {
        out.push(entry.display().to_string());
        if entry.is_dir() {
            out.extend(walk(&entry));
        }
    }
    out
}

#[test]
fn hostile_names_go_through_every_command() {
    let dir = folder();
    let data = dir.path().join("lab $(touch pwned_d)");
    laboratory(&data, &HOSTILE);
    let pipeline = dir.path().join("p '$(touch pwned_e)'.yaml");
    fs::write(&pipeline, PIPELINE).unwrap();
    let (p, d) = (pipeline.display().to_string(), data.display().to_string());
    let ws = dir.path().join("ws `touch pwned_f`").display().to_string();
    let base = [p.as_str(), "--data", &d, "--workspace", &ws];
    let call = |command: &[&str], extra: &[&str], code| expect(&[command, &base, extra].concat(), code);

    let (_, err) = call(&["run", "--details"], &[], 1);
    assert_eq!(err.lines().filter(|l| l.starts_with("failed: import ")).count(), HOSTILE.len(), "{err}");
    let status = json(&[&["status"], &base[..], &["--json"]].concat());
    let rows = status["rows"].as_array().unwrap();
    for name in HOSTILE {
        let row = rows.iter().find(|r| r["trial"] == name).unwrap_or_else(|| panic!("{name:?} is lost"));
        assert!(row["cells"].as_array().unwrap().iter().all(|c| c != "failed" && c != "blocked"), "{row}");
    }
    call(&["check"], &[], 1);
    for name in HOSTILE {
        let (out, _) = expect(&[&["explain"], &base[..], &["--", name, "import"]].concat(), 0);
        assert!(out.starts_with("import of ") && out.contains(": ok"), "{name:?}: {out}");
    }

    // the printed command repeats exactly the trial that it names
    let summary = json(&[&["summary"], &base[..], &["--json"]].concat());
    let mut repeated = BTreeSet::new();
    for row in summary["rows"].as_array().unwrap().iter().filter(|r| r["again"].is_string()) {
        let name = row["trial"].as_str().unwrap();
        let line = row["again"].as_str().unwrap();
        // wide enough that no line is broken
        let output = shell(&format!("COLUMNS=1000 {line} --details"), dir.path());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{line}\n{said}");
        let failed: Vec<&str> = said.lines().filter(|l| l.starts_with("failed: ")).collect();
        let shown = aloft_study::quote::visible(name);
        assert!(failed.len() == 1 && failed[0].starts_with(&format!("failed: import {shown}: ")), "{line}\n{said}");
        assert!(said.contains(&format!("again: {line}\n")), "{said}");
        repeated.insert(name.to_owned());
    }
    assert_eq!(repeated, HOSTILE.iter().map(|n| format!("{n}!")).collect());

    // every recording has its own exported files
    let out = dir.path().join("out $(touch pwned_g)");
    let to = out.display().to_string();
    call(&["export"], &["--to", &to], 1);
    let (mut trc, mut tables) = (BTreeSet::new(), BTreeSet::new());
    for file in walk(&out) {
        let name = file.rsplit('/').next().unwrap().to_owned();
        assert!(!name.contains(|c: char| "<>:\"|?*\\\n'` $".contains(c)), "{name:?} is no name for every system");
        if name.ends_with(".trc") {
            assert!(trc.insert(name.to_lowercase()));
        } else if name.ends_with("_motion.tsv") {
            assert!(tables.insert(name.to_lowercase()));
        }
    }
    assert_eq!((trc.len(), tables.len()), (HOSTILE.len() + 2, HOSTILE.len() + 2));

    // the page shows the names and executes none of them
    call(&["report"], &[], 0);
    let page = fs::read_to_string(Path::new(&ws).join("report.html")).unwrap();
    assert!(!page.contains("<script>alert(1)"), "a name is a script in the page");
    assert!(page.contains("alert(1)"), "the page names the recording");

    // the Snakefile is the same for every study; the names are in the JSON file next to it
    let snakefile = dir.path().join("Snake $(touch pwned_h)");
    call(&["workflow"], &["--out", &snakefile.display().to_string()], 0);
    let code = fs::read_to_string(&snakefile).unwrap();
    let plain = dir.path().join("Snakefile");
    let demo = repo("pipelines/demo.yaml");
    let elsewhere = dir.path().join("demo").display().to_string();
    expect(&["workflow", &demo, "--workspace", &elsewhere, "--out", &plain.display().to_string()], 0);
    assert_eq!(code, fs::read_to_string(&plain).unwrap(), "the code depends on the study");
    let plan: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(aloft_analysis::workflow::plan_path(&snakefile)).unwrap()).unwrap();
    let trials = plan["studies"]["names"]["trials"].as_object().unwrap();
    assert_eq!(trials.len(), 2 * HOSTILE.len() + 2);
    // the command of each trial's job runs only that trial
    for trial in trials.values().filter(|t| t["role"] == "identify") {
        let choice: Vec<&str> = trial["choice"].as_array().unwrap().iter().map(|c| c.as_str().unwrap()).collect();
        let (planned, _) = call(&["run"], &[&choice[..], &["--only", "import", "--force", "--dry-run"]].concat(), 0);
        assert_eq!(planned.lines().filter(|l| l.starts_with("import")).count(), 1, "{choice:?}\n{planned}");
    }

    // a pipeline written by `init` for such a folder finds every recording again
    let written = dir.path().join("init `touch pwned_i`.yaml");
    expect(&["init", &d, "--out", &written.display().to_string()], 0);
    let table = aloft(&["check", &written.display().to_string()]).stdout;
    let table = String::from_utf8_lossy(&table).into_owned();
    for name in HOSTILE {
        let shown = aloft_study::quote::visible(name);
        assert!(table.lines().any(|l| l.starts_with(&shown)), "{name:?} is lost:\n{table}");
    }
    nothing_was_executed(dir.path());
}

#[test]
fn hostile_subjects_and_sessions_are_studies_like_others() {
    let dir = folder();
    let data = dir.path().join("lab");
    let subjects = ["sub $(touch pwned_a)", "-s'2", "[s]*", "s_1", "s1"];
    let sessions = ["ses `touch pwned_b`", "ses-\"2\""];
    for subject in subjects {
        for session in sessions {
            let at = data.join(subject).join(session);
            fs::create_dir_all(&at).unwrap();
            copy("object.yaml", &at.join("object.yaml"));
            copy("static.c3d", &at.join("static.c3d"));
            fs::write(at.join("throw $(touch pwned_c).c3d"), b"").unwrap();
        }
    }
    let pipeline = dir.path().join("p.yaml");
    fs::write(&pipeline, format!("{PIPELINE}subjects: {{folders: [\"*\"], sessions: [\"*\"]}}\n")).unwrap();
    let (p, d) = (pipeline.display().to_string(), data.display().to_string());
    let ws = dir.path().join("ws").display().to_string();
    let base = [p.as_str(), "--data", &d, "--workspace", &ws];
    expect(&[&["run"], &base[..], &["--until", "import"]].concat(), 1);
    let summary = json(&[&["summary"], &base[..], &["--json"]].concat());
    let rows: Vec<&serde_json::Value> = summary["rows"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|r| r["again"].is_string() && r["trial"] != "_study" && r["reasons"][0] == "unreadable_file")
        .collect();
    assert_eq!(rows.len(), subjects.len() * sessions.len());
    for row in rows {
        let line = format!("{} --only import", row["again"].as_str().unwrap());
        let output = shell(&line, dir.path());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        let (subject, session) = (row["subject"].as_str().unwrap(), row["session"].as_str().unwrap());
        let failed: Vec<&str> = said.lines().filter(|l| l.starts_with("failed: ")).collect();
        assert!(
            failed.len() == 1 && failed[0].starts_with(&format!("failed: import {subject} {session} ")),
            "{line}\n{said}"
        );
    }
    nothing_was_executed(dir.path());
}

#[test]
fn recordings_that_would_share_results_are_refused_before_anything_runs() {
    // pairs of paths below the data folder, and whether both can be used together
    let pairs: [(&str, &str, bool); 12] = [
        ("a/throws_1.c3d", "b/throws_1.c3d", true),
        ("a-b/x.c3d", "a/b/x.c3d", false),
        ("throws_1.c3d", "throws1.c3d", true),
        ("a_b.c3d", "a.b.c3d", true),
        ("throws_a b.c3d", "throws_a_b.c3d", true),
        ("Jump.c3d", "jump.c3d", false),
        ("A/x.c3d", "a/x.c3d", false),
        ("a-x.c3d.c3d", "a/x.c3d", true),
        ("con.c3d", "con_.c3d", true),
        ("_study.c3d", "x.c3d", false),
        ("...c3d", "x.c3d", false),
        ("..c3d", "x.c3d", false),
    ];
    for (one, other, usable) in pairs {
        let dir = folder();
        let data = dir.path().join("lab");
        fs::create_dir_all(&data).unwrap();
        for name in ["static.c3d", "hinge_calib.c3d", "object.yaml"] {
            copy(name, &data.join(name));
        }
        for (path, source) in [(one, "throws_01.c3d"), (other, "throws_02.c3d")] {
            let to = data.join(path);
            fs::create_dir_all(to.parent().unwrap()).unwrap();
            copy(source, &to);
        }
        let pipeline = dir.path().join("p.yaml");
        fs::write(&pipeline, PIPELINE.replace("\"*.c3d\"", "\"**/*.c3d\"")).unwrap();
        let (p, d) = (pipeline.display().to_string(), data.display().to_string());
        let ws = dir.path().join("ws").display().to_string();
        let base = [p.as_str(), "--data", &d, "--workspace", &ws];
        if !usable {
            for command in ["check", "run", "export"] {
                let (_, err) = expect(&[&[command], &base[..]].concat(), 2);
                let words: String = err.split(['\n', '│', ' ']).map(str::trim).collect();
                assert!(words.contains(one) && words.contains("rename"), "{one} {other}: {err}");
            }
            assert!(!Path::new(&ws).exists(), "{one} {other}: something was written");
            continue;
        }
        expect(&[&["run"], &base[..]].concat(), 0);
        let out = dir.path().join("out");
        expect(&[&["export"], &base[..], &["--to", &out.display().to_string()]].concat(), 0);
        let count = |ending: &str| {
            let all: BTreeSet<String> =
                walk(&out).iter().filter(|f| f.ends_with(ending)).map(|f| f.to_lowercase()).collect();
            all.len()
        };
        assert_eq!((count(".trc"), count("_motion.tsv"), count(".parquet")), (4, 4, 4), "{one} {other}");
    }
}
