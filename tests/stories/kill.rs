//! A run killed at any moment can be resumed: it repeats nothing that was finished, and ends with
//! the results of an undisturbed run.

use crate::support::{another, folder, lab, repo};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Every file of the results; manifests without the time that the work took.
pub fn results(ws: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    let mut open = vec![ws.to_path_buf()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(ws).unwrap().to_string_lossy().into_owned();
            if name.starts_with('.') || name == "inputs.json" {
                continue;
            }
            if path.is_dir() {
                open.push(path);
                continue;
            }
            let mut bytes = fs::read(&path).unwrap();
            if name.ends_with("manifest.json") {
                let mut manifest: serde_json::Value =
                    serde_json::from_slice(&bytes).unwrap_or_else(|e| panic!("{name} is half-written: {e}"));
                // and the hash that covers it
                manifest["check"] = serde_json::Value::Null;
                manifest["seconds"] = serde_json::Value::Null;
                bytes = manifest.to_string().into_bytes();
            }
            all.insert(name, bytes);
        }
    }
    all
}

fn is_a_result(name: &str) -> bool {
    name.ends_with("/manifest.json")
}

struct Lab {
    data: String,
    pipelines: [String; 2],
}

impl Lab {
    fn run(&self, variant: usize, ws: &Path) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_aloft"));
        command
            .args(["run", &self.pipelines[variant], "--data", &self.data, "--workspace", &ws.display().to_string()])
            .env("NO_COLOR", "1")
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        command
    }

    /// Runs to the end; returns the numbers of tasks that ran and that were up to date.
    fn finish(&self, variant: usize, ws: &Path) -> (usize, usize) {
        let output = self.run(variant, ws).output().unwrap();
        let err = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{err}");
        let line = err.lines().find(|l| l.contains(" up to date")).unwrap_or_else(|| panic!("{err}"));
        let numbers: Vec<usize> = line.split(' ').filter_map(|w| w.parse().ok()).collect();
        (numbers[0], numbers[1])
    }
}

/// Kills runs at `times` moments spread over the whole run; some runs begin with nothing, some
/// replace results of another cut-off.
fn killed(times: usize, signal: &str) {
    let dir = folder();
    let data = lab("fixtures/scenarios/chain_small.yaml", dir.path()).display().to_string();
    let text = fs::read_to_string(repo("pipelines/chain.yaml")).unwrap();
    let pipelines = ["10.0", "8.0"].map(|hz| {
        let file = dir.path().join(format!("p{hz}.yaml"));
        fs::write(&file, text.replace("cutoff_hz: 10.0", &format!("cutoff_hz: {hz}"))).unwrap();
        file.display().to_string()
    });
    let lab = Lab { data, pipelines };
    let mut wanted = Vec::new();
    let mut length = Duration::ZERO;
    for variant in 0..2 {
        let ws = dir.path().join(format!("whole{variant}"));
        let started = Instant::now();
        lab.finish(variant, &ws);
        length = length.max(started.elapsed());
        wanted.push(results(&ws));
    }
    assert_ne!(wanted[0], wanted[1]);
    let tasks = wanted[0].keys().filter(|n| is_a_result(n)).count();

    // moments from a fixed sequence of pseudo-random numbers (Knuth's MMIX generator)
    let mut state: u64 = 20_100_505;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / (1u64 << 24) as f64
    };
    let (mut kills, mut round, mut resumed) = (0, 0, 0);
    while kills < times {
        let ws = dir.path().join(format!("ws{round}"));
        let variant = round % 2;
        if round % 4 >= 2 {
            // start from the results of the other cut-off
            lab.finish(1 - variant, &ws);
        }
        // up to five kills before the run may end
        for _ in 0..5 {
            let mut child = lab.run(variant, &ws).spawn().unwrap();
            std::thread::sleep(length.mul_f64(random()));
            if child.try_wait().unwrap().is_none() {
                let done = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
                kills += usize::from(done.success());
            }
            child.wait().unwrap();
            // every result in place is complete: it belongs to one of the two pipelines
            for (name, bytes) in if ws.is_dir() { results(&ws) } else { BTreeMap::new() } {
                let whole = wanted.iter().any(|w| w.get(&name).is_some_and(|b| *b == bytes));
                assert!(whole || name.ends_with("manifest.json"), "kill {kills}: {name} is not whole");
            }
        }
        // nothing that was finished is repeated
        let before = if ws.is_dir() { results(&ws) } else { BTreeMap::new() };
        let finished =
            before.iter().filter(|(n, b)| is_a_result(n) && wanted[variant].get(*n).is_some_and(|w| w == *b)).count();
        let (ran, current) = lab.finish(variant, &ws);
        assert_eq!(ran + current, tasks);
        assert!(current >= finished, "{finished} results were finished, {current} were kept");
        resumed += current;
        let after = results(&ws);
        assert_eq!(
            after.keys().collect::<Vec<_>>(),
            wanted[variant].keys().collect::<Vec<_>>(),
            "files after {kills} kills"
        );
        for (name, bytes) in &after {
            assert!(wanted[variant][name] == *bytes, "{name} differs from an undisturbed run after {kills} kills");
        }
        assert!(!ws.join(".tmp").exists() || fs::read_dir(ws.join(".tmp")).unwrap().next().is_none());
        fs::remove_dir_all(&ws).unwrap();
        round += 1;
    }
    assert!(resumed > 0, "no run was killed after its first result");
    #[allow(clippy::print_stderr, reason = "says what was measured, under --nocapture")]
    {
        eprintln!("{kills} kills over {round} workspaces of {tasks} results; an undisturbed run takes {length:.2?}");
    }
}

#[test]
#[cfg(unix)]
fn killed_at_a_few_moments() {
    killed(8, "-KILL");
}

#[test]
#[cfg(unix)]
fn interrupted_at_a_few_moments() {
    killed(3, "-INT");
}

/// The full test: `cargo test --release -p aloft-cli --test stories killed_at_fifty -- --ignored
/// --nocapture`.
#[test]
#[cfg(unix)]
#[ignore = "takes a minute"]
fn killed_at_fifty_random_moments() {
    killed(50, "-KILL");
}

#[test]
fn the_second_of_two_runs_says_who_holds_the_workspace_or_waits() {
    let dir = folder();
    let data = lab("fixtures/scenarios/chain_small.yaml", dir.path()).display().to_string();
    let lab = Lab { data, pipelines: [repo("pipelines/chain.yaml"), repo("pipelines/chain.yaml")] };
    let ws = dir.path().join("ws");
    lab.finish(0, &ws);
    // this process holds the workspace lock as a run does
    let held = fs::File::options().write(true).open(ws.join(".lock")).unwrap();
    held.lock().unwrap();
    let note = r#"{"pid": 4711, "host": "lab-pc", "since": "2026-03-01 14:05:09 UTC"}"#;
    fs::write(ws.join(".holder.json"), note).unwrap();
    let output = lab.run(0, &ws).output().unwrap();
    let err = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{err}");
    // the message may be wrapped
    let words: Vec<&str> = err.split_whitespace().filter(|w| *w != "│").collect();
    assert!(words.join(" ").contains("process 4711 on lab-pc since 2026-03-01 14:05:09 UTC"), "{err}");
    assert!(err.contains("--wait"), "{err}");
    let mut waiting = lab.run(0, &ws).arg("--wait").spawn().unwrap();
    std::thread::sleep(Duration::from_millis(700));
    assert!(waiting.try_wait().unwrap().is_none(), "it did not wait");
    held.unlock().unwrap();
    assert!(waiting.wait().unwrap().success());
    // reading works while the lock is held
    held.lock().unwrap();
    let status = Command::new(env!("CARGO_BIN_EXE_aloft"))
        .args(["status", &lab.pipelines[0], "--data", &lab.data, "--workspace", &ws.display().to_string()])
        .output()
        .unwrap();
    assert!(status.status.success());
}

/// Panics when a completed task is reported; in a plain run this happens on the thread that puts
/// results in place.
struct Breaks;

impl aloft_pipeline::progress::Progress for Breaks {
    fn stage(&self, _: &aloft_study::recordings::SessionId, _: &'static str, _: usize, _: usize) {}
    fn task(&self, _: &aloft_study::recordings::SessionId, _: &aloft_pipeline::runner::TaskReport) {
        panic!("a defect");
    }
}

#[test]
fn a_defect_beside_the_work_ends_the_run_and_leaves_whole_results() {
    use aloft_pipeline::runner::{self, Selection};
    use aloft_study::subject_session::{Overrides, SubjectSession};
    let dir = folder();
    let data = lab("fixtures/scenarios/chain_small.yaml", dir.path());
    // more results than the queue holds
    for i in 10..90 {
        another(&data.join("throws_01.c3d"), &data.join(format!("throws_{i}.c3d")), i);
    }
    let ws = dir.path().join("ws");
    let places = Overrides { data: Some(data), workspace: Some(ws.clone()), ..Overrides::default() };
    let session = SubjectSession::open(Path::new(&repo("pipelines/chain.yaml")), &places).unwrap();
    let selection = Selection { until: Some("import".into()), ..Selection::default() };
    let error = runner::run(&session, &selection, &Breaks).unwrap_err().to_string();
    assert!(error.contains("an internal error"), "{error}");
    let placed = results(&ws).keys().filter(|n| is_a_result(n)).count();
    assert!((1..80).contains(&placed), "{placed}");
    // in a run that shares the workspace, it happens on a worker thread
    let shared = Selection { shared: true, ..selection.clone() };
    assert!(std::panic::catch_unwind(|| runner::run(&session, &shared, &Breaks)).is_err());
    let placed = results(&ws).keys().filter(|n| is_a_result(n)).count();
    let report = runner::run(&session, &selection, &runner::Silent).unwrap();
    assert_eq!((report.up_to_date(), report.has_trouble()), (placed, false));
    assert!(fs::read_dir(ws.join(".tmp")).unwrap().next().is_none());
}
