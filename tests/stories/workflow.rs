//! The jobs of a workflow, started by hand in parallel on one workspace, with factors merged in a
//! tree; the numbers equal those of a single run.

use crate::support::{aloft, expect, folder, repo};
use std::collections::BTreeSet;
use std::fs;

const RESULTS: [&str; 3] = [
    "identify/_study/parameters_weak.json",
    "identify/_study/parameters_acceleration.json",
    "compare/_study/comparison.json",
];

#[test]
fn jobs_side_by_side_give_the_numbers_of_one_run() {
    let dir = folder();
    // ten recordings give a tree of two levels; one of them is broken
    let scenario = dir.path().join("ten.yaml");
    fs::write(
        &scenario,
        "name: ten\nseed: 9\nbody:\n  kind: chain\n  throws: {recordings: 10, throws: 2, carry_s: [0.9, 1.1], static_s: 0.8, calibration_s: 6.0}\ncapture: {marker_noise_m: 0.0003, gap_fraction: 0.005}\n",
    )
    .unwrap();
    let data = dir.path().join("lab");
    expect(&["simulate", &scenario.display().to_string(), "--out", &data.display().to_string()], 0);
    fs::write(data.join("throws_04.c3d"), b"").unwrap();
    // as in a DataLad data set: the recording is a link
    #[cfg(unix)]
    {
        let elsewhere = dir.path().join("annexed");
        fs::rename(data.join("throws_07.c3d"), &elsewhere).unwrap();
        std::os::unix::fs::symlink(&elsewhere, data.join("throws_07.c3d")).unwrap();
    }
    let place = |name: &str| dir.path().join(name).display().to_string();
    let pipeline = repo("pipelines/chain.yaml");
    let words = |ws: &str| [pipeline.clone(), "--data".into(), place("lab"), "--workspace".into(), place(ws)];
    let call = |command: &str, ws: &str, extra: &[&str], code: i32| {
        let own = words(ws);
        let all: Vec<&str> =
            std::iter::once(command).chain(own.iter().map(String::as_str)).chain(extra.iter().copied()).collect();
        expect(&all, code)
    };

    call("run", "local", &[], 1);

    let stems = |prefix: &str| -> Vec<String> {
        let mut all: Vec<String> = fs::read_dir(&data)
            .unwrap()
            .map(|e| e.unwrap().path())
            .filter(|p| p.extension().is_some_and(|e| e == "c3d"))
            .map(|p| p.file_stem().unwrap().to_string_lossy().into_owned())
            .filter(|n| n.starts_with(prefix))
            .collect();
        all.sort();
        all
    };
    let job = |stage: &str, trial: &str, code: i32| {
        call("run", "shared", &["--only", stage, "--trial", trial, "--shared", "-j", "1"], code);
    };
    let broken = |trial: &str| i32::from(trial == "throws_04");
    std::thread::scope(|scope| {
        for trial in stems("") {
            let job = &job;
            scope.spawn(move || job("import", &trial, broken(&trial)));
        }
    });
    for stage in ["scale", "calibrate"] {
        call("run", "shared", &["--only", stage, "--shared"], 0);
    }
    job("ik", "hinge_calib", 0);
    std::thread::scope(|scope| {
        for trial in stems("throws") {
            let job = &job;
            scope.spawn(move || {
                for stage in ["ik", "filter", "flight", "regressor", "acceleration"] {
                    job(stage, &trial, broken(&trial));
                }
            });
        }
    });
    let (_, err) = call("merge", "shared", &["--node", "2-0"], 2);
    assert!(err.contains("level below"), "{err}");
    for node in ["1-0", "1-1", "2-0"] {
        call("merge", "shared", &["--node", node], 0);
    }
    let (_, err) = call("merge", "shared", &["--node", "2-0"], 0);
    assert!(err.contains("up to date"), "{err}");
    let (_, err) = call("merge", "shared", &["--node", "3-0"], 2);
    assert!(err.contains("no node 3-0"), "{err}");
    for stage in ["identify", "compare"] {
        call("run", "shared", &["--only", stage, "--shared"], 0);
    }
    for file in RESULTS {
        let read = |ws: &str| fs::read(dir.path().join(ws).join(file)).unwrap();
        assert!(read("local") == read("shared"), "{file} differs");
    }

    let (_, err) = call("workflow", "shared", &["--verdict"], 1);
    assert!(err.contains("failed: import throws_04") && err.contains("1 failed or missing"), "{err}");
    let table = |ws: &str| fs::read_to_string(dir.path().join(ws).join("summary.csv")).unwrap();
    // commands in the table name the workspace
    assert_eq!(table("local").replace(&place("local"), ""), table("shared").replace(&place("shared"), ""));
    let file = place("Snakefile");
    call("workflow", "shared", &["--out", &file], 0);
    let text = fs::read_to_string(&file).unwrap();
    for part in ["rule import:", "rule regressor:", "rule merge:", "rule identify:", "rule verdict:", "--shared"] {
        assert!(text.contains(part), "the Snakefile lacks `{part}`");
    }
    // a workspace created by the workflow states the same format as one created by the program
    let marker = fs::read_to_string(dir.path().join("shared/ALOFT_WORKSPACE.txt")).unwrap();
    assert!(text.contains(&serde_json::json!(marker).to_string()), "{marker}");
    // the workflow overwrites its own files, but never others
    call("workflow", "shared", &["--out", &file], 0);
    fs::write(&file, "all: thesis.pdf\n").unwrap();
    call("workflow", "shared", &["--out", &file], 2);
    assert_eq!(fs::read_to_string(&file).unwrap(), "all: thesis.pdf\n");
}

/// Words that follow `mark` in a text.
fn words_after(text: &str, mark: &str) -> BTreeSet<String> {
    let word = |rest: &str| rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    text.split(mark).skip(1).map(word).collect()
}

#[test]
fn regress_functions_of_the_snakefile_ask_only_for_wildcards_of_its_paths() {
    let dir = folder();
    let file = dir.path().join("Snakefile").display().to_string();
    expect(
        &["workflow", &repo("pipelines/demo.yaml"), "--workspace", &file.replace("Snakefile", "ws"), "--out", &file],
        0,
    );
    let text = fs::read_to_string(&file).unwrap();
    let rules: Vec<&str> = text.split("\nrule ").skip(1).collect();
    assert!(rules.len() > 10, "{text}");
    let constrained = words_after(text.split("wildcard_constraints:").nth(1).unwrap(), "\n    ");
    let asked = words_after(&text, " w.").into_iter().chain(words_after(&text, "[w.")).chain(words_after(&text, "{w."));
    for name in asked.chain(words_after(&text, "{wildcards.")) {
        assert!(constrained.contains(&name), "`{name}` is no wildcard: {constrained:?}");
    }
    for rule in rules {
        let output = rule.split("output:").nth(1).and_then(|o| o.lines().nth(1)).unwrap();
        // what the functions of a rule ask for is in the path of its output
        let own: BTreeSet<String> = words_after(output, "{").into_iter().collect();
        for name in words_after(rule, "[w.").iter().chain(&words_after(rule, "{wildcards.")) {
            assert!(own.contains(name), "`{name}` is not in {output}");
        }
        assert!(own.iter().all(|name| constrained.contains(name)), "{output}");
    }
}

#[test]
fn a_plain_run_and_shared_ones_do_not_meet() {
    let dir = folder();
    let ws = dir.path().join("ws");
    fs::create_dir(&ws).unwrap();
    fs::write(ws.join("ALOFT_WORKSPACE.txt"), "").unwrap();
    let held = fs::File::create(ws.join(".lock")).unwrap();
    held.lock_shared().unwrap();
    let demo = repo("pipelines/demo.yaml");
    let words = ["run", &demo, "--workspace", &ws.display().to_string(), "--only", "import", "--trial", "static"];
    let output = aloft(&words);
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("in use"));
    expect(&[&words[..], &["--shared"]].concat(), 0);
}
