//! `effect add` takes what `discover` computed already, bit for bit, and a change that is taken
//! back brings the results before it back.

use crate::support::{aloft, expect, folder, repo};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const STAGES: [&str; 4] = ["regressor", "acceleration", "identify", "compare"];

struct Lab(tempfile::TempDir);

impl Lab {
    fn place(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    fn words(&self, words: &[&str], ws: &str) -> Vec<String> {
        let more = [repo("pipelines/demo.yaml"), "--workspace".into(), self.place(ws).display().to_string()];
        words.iter().map(|w| (*w).to_owned()).chain(more).collect()
    }
    fn expect(&self, words: &[&str], ws: &str) {
        let words = self.words(words, ws);
        expect(&words.iter().map(String::as_str).collect::<Vec<_>>(), 0);
    }
    fn add(&self, ws: &str) {
        self.add_key(ws, "quadratic_drag[links]");
    }
    fn add_key(&self, ws: &str, key: &str) {
        let words = [self.words(&["effect", "add"], ws), vec![key.into()]].concat();
        expect(&words.iter().map(String::as_str).collect::<Vec<_>>(), 0);
    }
    fn copy(&self, from: &str, to: &str) {
        let to = self.place(to);
        let _ = fs::remove_dir_all(&to);
        for entry in walkdir::WalkDir::new(self.place(from)) {
            let entry = entry.unwrap();
            let target = to.join(entry.path().strip_prefix(self.place(from)).unwrap());
            if entry.file_type().is_dir() {
                fs::create_dir_all(target).unwrap();
            } else {
                fs::copy(entry.path(), target).unwrap();
            }
        }
    }
    /// Files of the stages that depend on the model's effects, without the manifests.
    fn results(&self, ws: &str) -> BTreeMap<PathBuf, Vec<u8>> {
        let files = STAGES.iter().flat_map(|s| walkdir::WalkDir::new(self.place(ws).join(s)));
        let files = files.map(|e| e.unwrap()).filter(|e| e.file_type().is_file() && e.file_name() != "manifest.json");
        files.map(|e| (e.path().strip_prefix(self.place(ws)).unwrap().into(), fs::read(e.path()).unwrap())).collect()
    }
    /// Seconds that the stages took for the results that are in place.
    fn seconds(&self, ws: &str) -> Vec<f64> {
        let files = STAGES.iter().flat_map(|s| walkdir::WalkDir::new(self.place(ws).join(s)).sort_by_file_name());
        let manifests = files.map(|e| e.unwrap()).filter(|e| e.file_name() == "manifest.json");
        let of = |p: &Path| serde_json::from_slice::<serde_json::Value>(&fs::read(p).unwrap()).unwrap();
        manifests.map(|e| of(e.path())["seconds"].as_f64().unwrap()).collect()
    }
}

#[test]
fn what_discover_computed_is_not_computed_again_and_is_the_same_to_the_last_bit() {
    let lab = Lab(folder());
    lab.expect(&["run"], "asked");
    lab.expect(&["discover", "--only", "quadratic_drag"], "asked");
    let plain = lab.results("asked");
    lab.copy("asked", "without");
    fs::remove_dir_all(lab.place("without/forecast")).unwrap();
    lab.add("without");
    let computed = lab.results("without");
    assert!(computed.len() > 8 && computed != plain);

    lab.copy("asked", "with");
    let forecast: Vec<f64> = lab.seconds("with/forecast");
    lab.add("with");
    assert!(lab.results("with") == computed, "the same to the last bit");
    assert_eq!(lab.seconds("with"), forecast, "the results are those that discover computed");
    assert_ne!(lab.seconds("without"), forecast);
    lab.expect(&["verify", "--strict"], "with");

    // taken back: the results before the change, as they were
    let before = lab.seconds("asked");
    let words = [lab.words(&["effect", "remove"], "with"), vec!["quadratic_drag".into()]].concat();
    expect(&words.iter().map(String::as_str).collect::<Vec<_>>(), 0);
    assert!(lab.results("with") == plain && lab.seconds("with") == before);
    lab.expect(&["verify", "--strict"], "with");
}

#[test]
fn damaged_or_unfitting_results_are_computed_again() {
    let lab = Lab(folder());
    lab.expect(&["run"], "asked");
    lab.expect(&["discover", "--only", "quadratic_drag"], "asked");
    lab.copy("asked", "sound");
    lab.add("sound");
    let sound = lab.results("sound");

    lab.copy("asked", "damaged");
    let (mut changed, mut n) = (0, 0);
    for entry in walkdir::WalkDir::new(lab.place("damaged/forecast")) {
        let entry = entry.unwrap();
        if entry.file_type().is_file() {
            n += 1;
            let mut bytes = fs::read(entry.path()).unwrap();
            let middle = bytes.len() / 2;
            bytes[middle] ^= 1;
            fs::write(entry.path(), bytes).unwrap();
            changed += 1;
        }
    }
    assert!(n > 12 && changed == n);
    lab.add("damaged");
    assert!(lab.results("damaged") == sound);

    // the forecast of one effect is none of another
    lab.copy("asked", "other");
    lab.add_key("other", "linear_drag[links]");
    lab.copy("asked", "other_alone");
    fs::remove_dir_all(lab.place("other_alone/forecast")).unwrap();
    lab.add_key("other_alone", "linear_drag[links]");
    assert!(lab.results("other") != sound && lab.results("other") == lab.results("other_alone"));
}

#[test]
fn a_change_that_takes_what_is_there_is_whole_wherever_it_is_killed() {
    let lab = Lab(folder());
    lab.expect(&["run"], "asked");
    lab.expect(&["discover", "--only", "quadratic_drag"], "asked");
    lab.copy("asked", "whole");
    lab.add("whole");
    let whole = lab.results("whole");
    let mut kills = 0;
    for n in (1..).step_by(9) {
        lab.copy("asked", "ws");
        let words = [lab.words(&["effect", "add"], "ws"), vec!["quadratic_drag[links]".into()]].concat();
        let killed = Command::new(env!("CARGO_BIN_EXE_aloft"))
            .args(&words)
            .env("ALOFT_STOP_BEFORE", n.to_string())
            .env("ALOFT_STOP_TORN", if n % 2 == 0 { "1" } else { "0" })
            .output()
            .unwrap();
        if killed.status.code() == Some(0) {
            break;
        }
        assert_eq!(killed.status.code(), Some(86), "{}", String::from_utf8_lossy(&killed.stderr));
        kills += 1;
        // again: done, or held already where the kill came after the change
        let again = aloft(&words.iter().map(String::as_str).collect::<Vec<_>>());
        let said = String::from_utf8_lossy(&again.stderr).into_owned();
        assert!(again.status.success() || said.contains("holds"), "kill {n}: {said}");
        assert!(lab.results("ws") == whole, "kill {n}");
        if !again.status.success() {
            // the kill came before the summary was written: `verify` names it until the next run
            lab.expect(&["run"], "ws");
        }
        lab.expect(&["verify", "--strict"], "ws");
    }
    assert!(kills > 8, "{kills}");
}
