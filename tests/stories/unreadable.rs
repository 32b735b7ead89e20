//! Paths that have the name of a recording and are no readable file: each is one failed trial with
//! its reason, and the others run.

use crate::support::*;
use std::fs;
use std::path::Path;
use std::process::Command;

/// The demonstration's recordings with some paths that cannot be read; their names and a part of
/// the reason.
fn lab_with_odd_paths(at: &Path) -> Vec<(&'static str, &'static str)> {
    fs::create_dir(at).unwrap();
    for entry in fs::read_dir(repo("fixtures/demo")).unwrap().map(|e| e.unwrap().path()).filter(|p| p.is_file()) {
        fs::copy(&entry, at.join(entry.file_name().unwrap())).unwrap();
    }
    std::os::unix::fs::symlink("../.git/annex/objects/xy/MD5E", at.join("throws_91.c3d")).unwrap();
    assert!(Command::new("mkfifo").arg(at.join("throws_92.c3d")).status().unwrap().success());
    fs::create_dir(at.join("throws_93.c3d")).unwrap();
    std::os::unix::fs::symlink("/dev/zero", at.join("throws_94.c3d")).unwrap();
    fs::File::create(at.join("throws_95.c3d")).unwrap().set_len(1 << 42).unwrap();
    std::os::unix::fs::symlink("throws_96.c3d", at.join("throws_96.c3d")).unwrap();
    // an editor's mark is no recording
    std::os::unix::fs::symlink("me@here.1", at.join(".#throws_01.c3d")).unwrap();
    vec![
        ("throws_91", "which is not there"),
        ("throws_92", "it is a named pipe"),
        ("throws_93", "it is a folder"),
        ("throws_94", "it is a device"),
        ("throws_95", "of memory are free"),
        ("throws_96", "cannot read"),
    ]
}

#[test]
#[cfg(unix)]
fn regress_what_cannot_be_read_is_one_failed_trial_with_its_reason() {
    let dir = folder();
    let data = dir.path().join("lab");
    let odd = lab_with_odd_paths(&data);
    let words = |ws: &str| {
        let ws = dir.path().join(ws).display().to_string();
        vec![repo("pipelines/demo.yaml"), "--data".into(), data.display().to_string(), "--workspace".into(), ws]
    };
    let with = |command: &[&str], ws: &str| -> Vec<String> {
        command.iter().map(|w| (*w).to_owned()).chain(words(ws)).collect()
    };
    let call = |words: &[String], code: i32| expect(&words.iter().map(String::as_str).collect::<Vec<_>>(), code);
    let said = |(out, err): (String, String)| unwrapped(format!("{out}\n{err}").as_bytes());
    let check = said(call(&with(&["check", "--details"], "ws"), 1));
    let run = said(call(&with(&["run", "--details"], "ws"), 1));
    let (status, _) = call(&with(&["status"], "ws"), 0);
    for (trial, reason) in &odd {
        assert!(check.contains(trial) && check.contains(reason), "{trial}: {check}");
        assert!(run.contains(reason), "{trial}: {run}");
        let row = status.lines().find(|l| l.trim_start().starts_with(trial)).unwrap_or_default();
        assert!(row.contains("failed"), "{trial}: {status}");
    }
    assert!(!check.contains(".#"), "{check}");
    // the others are as they are without them
    let whole = json(&[
        "parameters",
        &repo("pipelines/demo.yaml"),
        "--data",
        &data.display().to_string(),
        "--workspace",
        &words("ws")[4],
        "--json",
    ]);
    for (trial, _) in &odd {
        let path = data.join(format!("{trial}.c3d"));
        if path.symlink_metadata().unwrap().is_dir() {
            fs::remove_dir(&path).unwrap()
        } else {
            fs::remove_file(&path).unwrap()
        }
    }
    call(&with(&["run"], "plain"), 0);
    let plain = json(&[
        "parameters",
        &repo("pipelines/demo.yaml"),
        "--data",
        &data.display().to_string(),
        "--workspace",
        &words("plain")[4],
        "--json",
    ]);
    assert!(whole["base"].is_array() || whole["base"].is_object(), "{whole}");
    assert_eq!(whole["base"], plain["base"]);
}

#[test]
#[cfg(unix)]
fn inspect_and_init_name_what_cannot_be_read() {
    let dir = folder();
    let data = dir.path().join("lab");
    let odd = lab_with_odd_paths(&data);
    for (trial, reason) in &odd {
        let output = aloft(&["inspect", &data.join(format!("{trial}.c3d")).display().to_string()]);
        assert_eq!(output.status.code(), Some(2));
        assert!(unwrapped(&output.stderr).contains(reason), "{trial}: {}", unwrapped(&output.stderr));
    }
    let pipeline = dir.path().join("p.yaml");
    expect(&["init", &data.display().to_string(), "--out", &pipeline.display().to_string()], 0);
    let written = fs::read_to_string(&pipeline).unwrap();
    for (trial, _) in &odd {
        assert!(written.contains(trial), "{trial}: {written}");
    }
}
