//! Helpers for the stories: temporary folders, and calls of the binary.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A temporary folder for a story.
pub fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

/// Root folder of the repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Path of a file in the repository.
pub fn repo(path: &str) -> String {
    root().join(path).display().to_string()
}

/// Runs `aloft` with the given arguments.
pub fn aloft(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_aloft")).args(words).env("NO_COLOR", "1").env("COLUMNS", "1000").output().unwrap()
}

/// Runs and expects an exit code; returns stdout and stderr.
pub fn expect(words: &[&str], code: i32) -> (String, String) {
    let output = aloft(words);
    let (out, err) =
        (String::from_utf8_lossy(&output.stdout).into_owned(), String::from_utf8_lossy(&output.stderr).into_owned());
    assert_eq!(output.status.code(), Some(code), "aloft {}\n{out}\n{err}", words.join(" "));
    (out, err)
}

/// What a command said, with the lines of a wrapped message joined.
pub fn unwrapped(said: &[u8]) -> String {
    let text = String::from_utf8_lossy(said).into_owned();
    text.split(['\n', '│']).map(str::trim).filter(|l| !l.is_empty()).collect::<Vec<_>>().join(" ")
}

/// Runs a `--json` command and parses its output.
pub fn json(words: &[&str]) -> serde_json::Value {
    let (out, _) = expect(words, 0);
    serde_json::from_str(&out).unwrap()
}

/// A simulated laboratory folder from a scenario of the repository.
pub fn lab(scenario: &str, at: &Path) -> PathBuf {
    let out = at.join("lab");
    expect(&["simulate", &repo(scenario), "--out", &out.display().to_string()], 0);
    out
}

/// Writes a recording that differs from another one in the last digit of a sample: a copy is
/// refused.
pub fn another(from: &Path, to: &Path, number: usize) {
    let mut bytes = fs::read(from).unwrap();
    let at = bytes.len() - 3000 - 4 * number;
    bytes[at] ^= 1;
    fs::write(to, bytes).unwrap();
}

/// What `discover` says of a scenario of the fixtures, after `run`.
pub fn discovered(scenario: &str, pipeline: &str, more: &[&str]) -> serde_json::Value {
    let dir = folder();
    let data = lab(&format!("fixtures/scenarios/{scenario}.yaml"), dir.path()).display().to_string();
    let ws = dir.path().join("ws").display().to_string();
    let words = [&repo(&format!("pipelines/{pipeline}.yaml")), "--data", &data, "--workspace", &ws];
    expect(&[&["run"], &words[..]].concat(), 0);
    json(&[&["discover"], &words[..], more, &["--json"]].concat())
}

/// The texts of a list.
pub fn names(list: &serde_json::Value) -> Vec<&str> {
    list.as_array().unwrap().iter().map(|e| e.as_str().unwrap()).collect()
}
