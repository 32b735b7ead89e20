//! No stale, damaged or incomplete data is shown as a result: tested for every setting, every file
//! and every moment of a change.

use crate::support::{expect, folder, json, lab, repo, unwrapped};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// A small laboratory, its pipeline and a workspace.
struct Lab {
    dir: tempfile::TempDir,
}

impl Lab {
    fn new() -> Self {
        let dir = folder();
        let scenario = dir.path().join("tiny.yaml");
        let text = "name: tiny\nseed: 5\nbody:\n  kind: chain\n  throws: {recordings: 3, throws: 2, carry_s: [0.9, 1.1], \
                    static_s: 0.8, calibration_s: 5.0}\ncapture: {marker_noise_m: 0.0003, gap_fraction: 0.005}\n";
        fs::write(&scenario, text).unwrap();
        let data = dir.path().join("lab").display().to_string();
        expect(&["simulate", &scenario.display().to_string(), "--out", &data], 0);
        fs::copy(repo("pipelines/chain.yaml"), dir.path().join("p.yaml")).unwrap();
        Self { dir }
    }

    fn place(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn command(&self, words: &[&str], ws: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_aloft"));
        let (first, rest) = words.split_at(if words[0] == "effect" { 2 } else { 1 });
        command
            .args(first)
            .arg(self.place("p.yaml"))
            .args(rest)
            .args(["--data", &self.place("lab").display().to_string()])
            .args(["--workspace", &self.place(ws).display().to_string()])
            .env("NO_COLOR", "1")
            .env("RAYON_NUM_THREADS", "1");
        command
    }

    fn ask(&self, words: &[&str], ws: &str) -> Output {
        self.command(words, ws).output().unwrap()
    }

    /// Runs a command and expects an exit code; returns stdout and stderr.
    fn expect(&self, words: &[&str], ws: &str, code: i32) -> (String, String) {
        let output = self.ask(words, ws);
        let text = |b: &[u8]| String::from_utf8_lossy(b).into_owned();
        let (out, err) = (text(&output.stdout), text(&output.stderr));
        assert_eq!(output.status.code(), Some(code), "{}\n{out}\n{err}", words.join(" "));
        (out, err)
    }

    fn pipeline(&self, change: impl Fn(&mut serde_json::Map<String, Value>)) {
        let text = fs::read_to_string(repo("pipelines/chain.yaml")).unwrap();
        let json = "{\"name\": \"chain\", \"model\": \"two_link\", \"marker_set\": \"two-link-chain\", \"object\": \"two_link_chain\", \
                    \"trials\": {\"static\": [\"static*.c3d\"], \"calibration\": [\"hinge_calib*.c3d\"], \"identify\": [\"throw*.c3d\"], \
                    \"validate\": []}, \"import\": {\"up_axis\": \"z\"}, \"filter\": {\"order\": 3, \"cutoff_hz\": 10.0}}";
        assert!(text.contains("two-link-chain") && text.contains("cutoff_hz: 10.0"), "the pipeline is another one");
        let mut all: Value = serde_json::from_str(json).unwrap();
        change(all.as_object_mut().unwrap());
        // JSON is valid YAML
        fs::write(self.place("p.yaml"), all.to_string()).unwrap();
    }
}

fn copy(from: &Path, to: &Path) {
    if to.exists() {
        fs::remove_dir_all(to).unwrap();
    }
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &target);
        } else {
            fs::copy(&path, &target).unwrap();
        }
    }
}

/// Every file of the stages' results; manifests without the time that the work took.
fn results(ws: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    let mut open = vec![ws.to_path_buf()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(ws).unwrap().to_string_lossy().into_owned();
            if path.is_dir() {
                if !name.starts_with('.') {
                    open.push(path);
                }
            } else if name.contains('/') {
                let mut bytes = fs::read(&path).unwrap();
                if name.ends_with("manifest.json") {
                    let mut manifest: Value = serde_json::from_slice(&bytes).unwrap();
                    (manifest["seconds"], manifest["check"]) = (Value::Null, Value::Null);
                    // failure messages contain paths of the workspace
                    bytes = manifest.to_string().replace(&ws.display().to_string(), "WORKSPACE").into_bytes();
                }
                all.insert(name, bytes);
            }
        }
    }
    all
}

/// Other values for a setting, from its schema: each variant of a choice, a number that is not the
/// default.
fn others(schema: &Value, root: &Value) -> Vec<Value> {
    let target = schema["$ref"].as_str().and_then(|r| root.pointer(r.trim_start_matches('#'))).unwrap_or(schema);
    let default = schema.get("default").unwrap_or(&Value::Null);
    let choices: Vec<Value> = target["oneOf"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(|c| c.get("const").cloned())
        .chain(target["enum"].as_array().into_iter().flatten().cloned())
        .filter(|c| c != default)
        .collect();
    if !choices.is_empty() {
        return choices;
    }
    let kind = target["type"].as_str().or_else(|| target["type"][0].as_str()).unwrap_or_default();
    match (kind, default) {
        ("boolean", Value::Bool(b)) => vec![Value::Bool(!b)],
        ("integer", Value::Number(n)) => vec![Value::from(n.as_u64().unwrap() + 1)],
        ("number", Value::Number(n)) if n.as_f64() == Some(0.0) => vec![Value::from(0.2)],
        ("number", Value::Number(n)) => vec![Value::from(n.as_f64().unwrap() * 0.75)],
        ("number", _) => vec![Value::from(0.1)],
        _ => Vec::new(),
    }
}

/// Sections of the pipeline that belong to stages.
const SECTIONS: [&str; 9] =
    ["import", "scale", "calibrate", "ik", "filter", "flight", "regressor", "identify", "compare"];

/// Change of the settings in one case.
type Change = Box<dyn Fn(&mut serde_json::Map<String, Value>)>;

#[test]
fn every_setting_changed_in_turn_gives_what_a_fresh_run_gives() {
    let lab = Lab::new();
    let schema: Value = serde_json::from_str(&expect(&["schema"], 0).0).unwrap();
    let mut changes: Vec<(String, Change)> = Vec::new();
    let mut put = |section: &'static str, name: &str, value: Value| {
        let (key, words) = (name.to_owned(), format!("{section}.{name} = {value}"));
        let change = move |all: &mut serde_json::Map<String, Value>| {
            let own = all.entry(section).or_insert_with(|| serde_json::json!({}));
            own[&key] = value.clone();
        };
        changes.push((words, Box::new(change)));
    };
    for section in SECTIONS {
        let reference = schema["properties"][section].to_string();
        let name = reference.split("#/$defs/").nth(1).and_then(|r| r.split('"').next()).unwrap().to_owned();
        for (key, own) in schema["$defs"][&name]["properties"].as_object().unwrap() {
            for value in others(own, &schema) {
                put(section, key, value);
            }
        }
    }
    // values that cannot be derived from the schema
    put("scale", "hip", "bell".into());
    put("scale", "anthropometry", "dumas".into());
    put("import", "aliases", serde_json::json!({"nothing": "m1"}));
    put("subject", "mass_kg", 1.25.into());
    put("subject", "gravity_mps2", 9.7.into());
    put("subject", "name", "somebody".into());
    put("subject", "height_m", 1.7.into());
    put("trials", "validate", serde_json::json!(["throws_03.c3d"]));
    put("trials", "exclude", serde_json::json!([{"trial": "throws_02", "reason": "test"}]));
    put("trials", "groups", serde_json::json!({"one": ["throws_01.c3d"]}));
    lab.pipeline(|_| ());
    lab.expect(&["run"], "base", 0);
    let base = results(&lab.place("base"));
    let (mut same, mut moved, mut refused) = (0, 0, 0);
    for (words, change) in &changes {
        lab.pipeline(change);
        copy(&lab.place("base"), &lab.place("cached"));
        let fresh = lab.place("fresh");
        if fresh.exists() {
            fs::remove_dir_all(&fresh).unwrap();
        }
        let (cached, again) = (lab.ask(&["run"], "cached"), lab.ask(&["run"], "fresh"));
        assert_eq!(cached.status.code(), again.status.code(), "{words}");
        if again.status.code() == Some(2) {
            refused += 1;
            continue;
        }
        let (a, b) = (results(&lab.place("cached")), results(&fresh));
        for (name, bytes) in &b {
            assert!(a.get(name) == Some(bytes), "{words}: {name} is not what a fresh run gives");
        }
        same += 1;
        moved += usize::from(b != base);
    }
    assert!(changes.len() >= 40 && moved >= 25 && refused <= 3, "{} settings, {moved} moved", changes.len());
    say(&format!(
        "settings: {same} of {} give what a fresh run gives ({moved} change results, {refused} are refused)",
        changes.len()
    ));
}

#[allow(clippy::print_stderr, reason = "says what was measured, under --nocapture")]
fn say(text: &str) {
    eprintln!("{text}");
}

#[test]
fn every_damaged_file_is_found_and_made_again() {
    let lab = Lab::new();
    lab.expect(&["run"], "whole", 0);
    let whole = results(&lab.place("whole"));
    let (mut found, mut tried, mut mended) = (0, 0, 0);
    for (i, (name, bytes)) in whole.iter().enumerate() {
        copy(&lab.place("whole"), &lab.place("ws"));
        let path = lab.place("ws").join(name);
        let bytes = if name.ends_with("manifest.json") { fs::read(&path).unwrap() } else { bytes.clone() };
        let at = (i * 7919) % bytes.len().max(1);
        match i % 4 {
            0 => fs::remove_file(&path).unwrap(),
            1 => fs::write(&path, "").unwrap(),
            2 => fs::write(&path, &bytes[..at]).unwrap(),
            _ => {
                let mut flipped = bytes.clone();
                flipped[at] ^= 1;
                fs::write(&path, flipped).unwrap();
            }
        }
        tried += 1;
        let result = name.rsplit_once('/').unwrap().0;
        let (out, _) = lab.expect(&["verify"], "ws", 1);
        found += usize::from(out.contains(result));
        let (out, _) = lab.expect(&["status"], "ws", 0);
        assert!(out.contains("damaged"), "{name}: {out}");
        // not shown by any command
        lab.expect(&["report"], "ws", 2);
        let (_, err) = lab.expect(&["run"], "ws", 0);
        let said = err.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(said.contains("damaged: ") && said.contains("made again"), "{name}: {err}");
        let after = results(&lab.place("ws"));
        assert!(after == whole, "{name} was not made again as it was");
        mended += 1;
    }
    assert_eq!((found, mended), (tried, tried));
    say(&format!("damaged files: found {found} of {tried}, made again {mended} of {tried}"));
}

#[test]
fn every_command_that_shows_results_says_what_is_stale() {
    let lab = Lab::new();
    lab.pipeline(|_| ());
    lab.expect(&["run"], "ws", 0);
    let export = lab.place("out").display().to_string();
    let commands: Vec<Vec<&str>> = vec![
        vec!["parameters"],
        vec!["compare"],
        vec!["compare", "--estimators"],
        vec!["compare", "--leave-one-out"],
        vec!["discover", "--only", "quadratic_drag"],
        vec!["history"],
        vec!["summary"],
        vec!["report"],
        vec!["export", "--to", &export],
    ];
    let shown = |stale: bool, why: &str| {
        for words in &commands {
            let (_, err) = lab.expect(&[&words[..], &["--strict"]].concat(), "ws", i32::from(stale));
            assert_eq!(err.contains("stale: ") || err.contains("missing: "), stale, "{why}: {words:?}: {err}");
            assert!(!stale || err.contains(why), "{words:?}: {err}");
            if !matches!(words[0], "report" | "export") {
                let output = lab.ask(&[&words[..], &["--json"]].concat(), "ws");
                let json: Value = serde_json::from_slice(&output.stdout).unwrap();
                assert_eq!(!json["stale"].as_array().unwrap().is_empty(), stale, "{words:?}");
            }
        }
        let html = fs::read_to_string(lab.place("ws/report.html")).unwrap();
        assert_eq!(html.contains("Not up to date when this page was written"), stale);
        let readme = fs::read_to_string(lab.place("out/README.md")).unwrap();
        assert_eq!(readme.contains("not up to date when exported"), stale);
        for text in [html, fs::read_to_string(lab.place("out/methods.txt")).unwrap()] {
            assert!(text.contains("order 3 a pass, 10 Hz"), "the results were made with 10 Hz");
        }
    };
    shown(false, "");
    lab.pipeline(|all| all["filter"]["cutoff_hz"] = 5.0.into());
    shown(true, "10.0 → 5.0");
    lab.pipeline(|_| ());
    shown(false, "");
    // another recording with the same size and time
    let (one, two) = (lab.place("lab/throws_01.c3d"), lab.place("lab/throws_02.c3d"));
    let mut bytes = fs::read(&one).unwrap();
    let time = fs::metadata(&one).unwrap().modified().unwrap();
    let old = bytes.clone();
    let last = bytes.len() - 3000;
    bytes[last] ^= 1;
    fs::write(&one, &bytes).unwrap();
    fs::File::options().write(true).open(&one).unwrap().set_modified(time).unwrap();
    shown(true, "the content of the file throws_01.c3d");
    fs::write(&one, old).unwrap();
    shown(false, "");
    // a new recording and a removed one
    fs::copy(&two, lab.place("lab/throws_09.c3d")).unwrap();
    shown(true, "never run");
    fs::remove_file(lab.place("lab/throws_09.c3d")).unwrap();
    fs::rename(&two, lab.place("kept")).unwrap();
    shown(true, "input gone");
    fs::rename(lab.place("kept"), &two).unwrap();
    shown(false, "");
}

/// What each revision reached, and whether anything is reported as stale.
fn ladder(lab: &Lab, ws: &str) -> (Vec<(String, Value)>, bool) {
    let output = lab.ask(&["history", "--json"], ws);
    if output.status.code() == Some(2) {
        return (Vec::new(), true);
    }
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    let rows = json["revisions"].as_array().unwrap();
    let all = rows.iter().map(|r| (r["action"].as_str().unwrap().to_owned(), r["held_out_error"].clone())).collect();
    (all, !json["stale"].as_array().unwrap().is_empty())
}

/// Number of effects with which the comparison in a workspace was made; none if there is no
/// comparison.
fn compared(ws: &Path) -> Option<usize> {
    let text = fs::read(ws.join("compare/_study/manifest.json")).ok()?;
    let manifest: Value = serde_json::from_slice(&text).unwrap();
    Some(manifest["parameters"]["effects"]["model"].as_array().map_or(0, Vec::len))
}

/// Write operations before which a process is killed: the first eight and every third one after
/// them, or all if `ALOFT_ALL_KILL_POINTS` is set.
fn kill_points() -> impl Iterator<Item = usize> {
    let all = std::env::var_os("ALOFT_ALL_KILL_POINTS").is_some();
    (1..).filter(move |n| all || *n <= 8 || n % 3 == 0)
}

#[test]
fn a_change_of_the_model_that_is_killed_anywhere_is_whole_or_said_to_be_open() {
    let lab = Lab::new();
    lab.expect(&["run"], "plain", 0);
    copy(&lab.place("plain"), &lab.place("with"));
    lab.expect(&["effect", "add", "quadratic_drag"], "with", 0);
    copy(&lab.place("with"), &lab.place("without"));
    lab.expect(&["effect", "remove", "quadratic_drag"], "without", 0);
    let mut told = Vec::new();
    for (change, from, to) in [("add", "plain", "with"), ("remove", "with", "without")] {
        let words = ["effect", change, "quadratic_drag"];
        let (before, after) = (ladder(&lab, from).0, ladder(&lab, to).0);
        let (mut kills, mut open) = (0, 0);
        for n in kill_points() {
            copy(&lab.place(from), &lab.place("ws"));
            let torn = if n % 2 == 0 { "1" } else { "0" };
            let killed = lab
                .command(&words, "ws")
                .env("ALOFT_STOP_BEFORE", n.to_string())
                .env("ALOFT_STOP_TORN", torn)
                .output()
                .unwrap();
            if killed.status.code() == Some(0) {
                break;
            }
            assert_eq!(killed.status.code(), Some(86), "{}", String::from_utf8_lossy(&killed.stderr));
            kills += 1;
            let (now, stale) = ladder(&lab, "ws");
            // no revision has the error of another one
            for (i, (action, error)) in now.iter().enumerate() {
                assert_eq!(*action, after[i].0);
                assert!(error.is_null() || *error == after[i].1, "{change}, kill {n}: revision {i} has {error}");
            }
            let model = fs::read(lab.place("ws/model.json")).ok().map(|b| serde_json::from_slice::<Value>(&b).unwrap());
            let revisions = model.as_ref().and_then(|m| m["revisions"].as_array().cloned()).unwrap_or_default();
            let held = revisions.last().map_or(0, |r| r["effects"].as_array().unwrap().len());
            // results ahead of or behind the model are reported as stale
            assert!(compared(&lab.place("ws")) == Some(held) || stale, "{change}, kill {n}: nobody says so");
            if revisions.len() == after.len() {
                assert!(!stale && now == after, "{change}, kill {n}");
                continue;
            }
            open += usize::from(stale);
            // repeat the same command, or start a run that restores the earlier state
            if kills % 3 == 0 {
                lab.expect(&["run"], "ws", 0);
                let (now, stale) = ladder(&lab, "ws");
                assert!(now == before && !stale, "{change}, kill {n}, run: {now:?}");
            } else {
                lab.expect(&words, "ws", 0);
                let (now, stale) = ladder(&lab, "ws");
                assert!(now == after && !stale, "{change}, kill {n}, again: {now:?}");
            }
            lab.expect(&["verify", "--strict"], "ws", 0);
        }
        assert!(kills > 15);
        told.push(format!("effect {change}: {kills} of {kills} kill points whole or said to be open ({open} open)"));
    }
    say(&told.join("\n"));
}

#[test]
fn commands_that_write_leave_nothing_half_done_when_they_are_killed() {
    let lab = Lab::new();
    lab.expect(&["run"], "plain", 0);
    let whole = results(&lab.place("plain"));
    let export = lab.place("out").display().to_string();
    let page = lab.place("page.html").display().to_string();
    let file = lab.place("Snakefile").display().to_string();
    let commands: Vec<(Vec<&str>, bool)> = vec![
        (vec!["run"], false),
        (vec!["run", "--force", "--until", "import"], true),
        (vec!["run", "--force", "--from", "identify"], true),
        (vec!["run", "--force", "--only", "filter", "--shared"], true),
        (vec!["merge", "--node", "1-0"], true),
        (vec!["discover", "--only", "quadratic_drag"], true),
        (vec!["parameters", "--assess"], true),
        (vec!["summary"], true),
        (vec!["report"], true),
        (vec!["report", "--out", &page], true),
        (vec!["export", "--to", &export, "--format", "urdf,csv"], true),
        (vec!["workflow", "--out", &file], true),
    ];
    let mut told = Vec::new();
    for (words, onto) in commands {
        let mut kills = 0;
        for n in kill_points() {
            let ws = lab.place("ws");
            if onto {
                copy(&lab.place("plain"), &ws);
            } else if ws.exists() {
                fs::remove_dir_all(&ws).unwrap();
            }
            let killed = lab
                .command(&words, "ws")
                .env("ALOFT_STOP_BEFORE", n.to_string())
                .env("ALOFT_STOP_TORN", if n % 2 == 0 { "1" } else { "0" })
                .output()
                .unwrap();
            if killed.status.code() == Some(0) {
                break;
            }
            assert_eq!(killed.status.code(), Some(86), "{words:?} {n}: {}", String::from_utf8_lossy(&killed.stderr));
            kills += 1;
            // every result in place is undamaged
            let json: Value = match lab.ask(&["verify", "--json"], "ws") {
                o if o.status.code() == Some(2) => panic!("{words:?} {n}: {}", String::from_utf8_lossy(&o.stderr)),
                o => serde_json::from_slice(&o.stdout).unwrap(),
            };
            for damage in json["damaged"].as_array().unwrap() {
                // the old result was moved away for its successor; the next run restores it
                assert!(damage["problems"][0].as_str().unwrap().contains("is missing"), "{words:?} {n}: {damage}");
            }
            // repeating the command gives the results of an uninterrupted one
            lab.expect(&words, "ws", 0);
            lab.expect(&["run"], "ws", 0);
            lab.expect(&["verify", "--strict"], "ws", 0);
            let mut now = results(&ws);
            now.retain(|name, _| whole.contains_key(name));
            assert!(now == whole, "{words:?} {n}: the results are others");
        }
        told.push(format!("{}: {kills} of {kills} kill points leave whole files", words[0]));
    }
    say(&told.join("\n"));
}

#[test]
fn two_changes_at_once_lose_nothing() {
    let lab = Lab::new();
    lab.expect(&["run"], "ws", 0);
    let names = ["quadratic_drag", "gravity_tilt", "linear_drag"];
    let known = expect(&["effect", "list"], 0).0;
    let names: Vec<&str> = names.into_iter().filter(|n| known.contains(n)).collect();
    assert!(names.len() >= 2, "{known}");
    let mut all: Vec<_> = names
        .iter()
        .map(|name| {
            let mut command = lab.command(&["effect", "add", name, "--wait"], "ws");
            command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
        })
        .collect();
    // a run at the same time uses the model that is current when it gets the lock
    let mut beside = lab.command(&["run", "--wait"], "ws").stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let ended: Vec<bool> = all.iter_mut().map(|c| c.wait().unwrap().success()).collect();
    assert!(beside.wait().unwrap().success());
    assert!(ended.iter().all(|e| *e), "{ended:?}");
    let (now, stale) = ladder(&lab, "ws");
    assert!(!stale && now.len() == names.len() + 1, "{now:?}");
    let json: Value = serde_json::from_slice(&lab.ask(&["history", "--json"], "ws").stdout).unwrap();
    let held = json["revisions"][names.len()]["effects"].as_array().unwrap().len();
    assert_eq!(held, names.len());
    // without --wait the second process reports who holds the workspace
    let held = fs::File::options().write(true).open(lab.place("ws/.lock")).unwrap();
    held.lock().unwrap();
    let (_, err) = lab.expect(&["effect", "remove", names[0]], "ws", 2);
    assert!(err.contains("in use"), "{err}");
}

/// With 5 mm of noise on a chain of 0.3 m the error is at its floor and the gate passes, but
/// inertias are 40 % too small, which no interval shows.
#[test]
fn noise_that_moves_parameters_is_said() {
    let dir = folder();
    let scenario = dir.path().join("noisy.yaml");
    let text = "name: noisy\nseed: 613\nbody: {kind: chain}\ncapture: {marker_noise_m: 0.005, gap_fraction: 0.005}\n";
    fs::write(&scenario, text).unwrap();
    let data = dir.path().join("lab").display().to_string();
    expect(&["simulate", scenario.to_str().unwrap(), "--out", &data], 0);
    let ws = dir.path().join("ws").display().to_string();
    let words = [&repo("pipelines/chain.yaml"), "--data", &data, "--workspace", &ws];
    let (said, _) = expect(&[&["run"], &words[..]].concat(), 0);
    assert!(said.contains("gate passed") && said.contains("check the markers (noise, labels"), "{said}");
    let assessed = json(&[&["parameters"], &words[..], &["--assess", "--json"]].concat());
    let weak = &assessed["assessment"]["errors_in_variables"][0];
    assert!(weak["biased"].as_u64().unwrap() >= 3, "{weak}");
    // of a session like any other nothing is said
    let other = folder();
    let data = lab("fixtures/scenarios/chain_small.yaml", other.path()).display().to_string();
    let quiet = dir.path().join("quiet").display().to_string();
    let words = ["run", &repo("pipelines/chain.yaml"), "--data", &data, "--workspace", &quiet];
    assert!(!expect(&words, 0).0.contains("check the markers"));
}

/// Markers that fit by centimetres leave a floor under which any error is small: nothing is judged,
/// and every command says what comes first.
#[test]
fn nothing_is_judged_where_markers_do_not_fit() {
    let dir = folder();
    let scenario = dir.path().join("loose.yaml");
    let body = "body: {kind: human, person: {sex: F, height_m: 1.7, mass_kg: 64}, protocol: {jumps: 4, exercises: 1, exercise_s: 3.0}}";
    fs::write(&scenario, format!("name: loose\nseed: 5\n{body}\ncapture: {{soft_tissue_m: 0.05}}\n")).unwrap();
    let data = dir.path().join("lab").display().to_string();
    expect(&["simulate", scenario.to_str().unwrap(), "--out", &data], 0);
    let ws = dir.path().join("ws").display().to_string();
    let words = [&repo("pipelines/human.yaml"), "--data", &data, "--workspace", &ws];
    let (said, _) = expect(&[&["run"], &words[..]].concat(), 0);
    let first = "check the markers first (labels, static trial, units, placement)";
    assert!(unwrapped(said.as_bytes()).contains(first) && !said.contains("at the floor"), "{said}");
    let compared = json(&[&["compare"], &words[..], &["--json"]].concat());
    assert_eq!((&compared["to_correct"]["void"], &compared["errors"][0]["signal"]), (&true.into(), &"poor".into()));
    let found = json(&[&["discover"], &words[..], &["--closed", "--json"]].concat());
    assert_eq!(found["verdict"], "not_detectable", "{}", found["words"]);
    assert!(found["words"].as_str().unwrap().contains(first), "{}", found["words"]);
}
